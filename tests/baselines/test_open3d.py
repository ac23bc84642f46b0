"""Open3D's odometry uses its guess, fails where nothing overlaps, says what is missing."""

import importlib

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines.open3d import KINDS, open3d_odometry
from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule
from edvo.errors import ConfigError, MissingExtraError
from edvo.odometry import Status

from .conftest import OFFICE, Office


@pytest.fixture
def installed() -> None:
    """Skip where Open3D is not there to be tested."""
    try:
        importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        pytest.skip(
            f"Open3D is not installed or does not load ({error}); the extra is edvo[open3d]"
        )


def error_of(found: NDArray[np.float64] | None, T_ref_cur: NDArray[np.float64]) -> float:
    assert found is not None
    return float(np.linalg.norm((se3.inverse(T_ref_cur) @ found)[:3, 3]))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", [None, FRAME_TO_FRAME])
def test_follows_a_hand(kind: str, rule: KeyframeRule | None, office: Office) -> None:
    tracker = open3d_odometry(OFFICE, kind, keyframes=rule)
    assert tracker.name == f"open3d-{kind}"
    start = office(0)[1]
    tracker.reset(start)
    for index in (0, 3, 6, 9):
        frame, T_world_cam = office(index)
        result = tracker.track(frame)
        assert result.status is Status.TRACKED
    assert error_of(result.T_world_cam, T_world_cam) < 0.02  # of 0.09 m
    assert error_of(start, T_world_cam) > 0.06


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("kind", ["intensity", "legacy-colour"])
def test_uses_the_guess(kind: str, office: Office) -> None:
    (reference, T_world_ref), (current, T_world_cur) = office(0), office(15)
    T_ref_cur = se3.inverse(T_world_ref) @ T_world_cur
    aligner = open3d_odometry(OFFICE, kind)._aligner
    pair = aligner.prepare(reference), aligner.prepare(current)
    away = se3.exp(np.array([0.01, -0.01, 0.01, 0.005, -0.005, 0.005]))
    assert error_of(aligner.align(*pair, T_ref_cur @ away), T_ref_cur) < 0.01  # of 0.15 m
    blind = aligner.align(*pair, np.eye(4))
    assert blind is None or error_of(blind, T_ref_cur) > 0.03


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("kind", KINDS)
def test_fails_where_the_guess_points_elsewhere(kind: str, office: Office) -> None:
    aligner = open3d_odometry(OFFICE, kind)._aligner
    pair = aligner.prepare(office(0)[0]), aligner.prepare(office(2)[0])
    behind = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.pi, 0.0]))
    assert aligner.align(*pair, behind) is None


def test_unknown_kind() -> None:
    with pytest.raises(ConfigError, match="hybrid, intensity, plane, legacy-hybrid, legacy-colour"):
        open3d_odometry(OFFICE, "colour")


@pytest.mark.parametrize(
    ("problem", "mend"),
    [
        (ModuleNotFoundError("No module named 'open3d'"), r"pip install 'edvo\[open3d\]'"),
        (ImportError("libusb-1.0.so.0: cannot open"), "apt-get install libusb-1.0-0"),
    ],
)
def test_missing_says_what_to_install(
    problem: ImportError, mend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str) -> None:
        raise problem

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(MissingExtraError, match=mend) as caught:
        open3d_odometry(OFFICE, "hybrid")
    assert "\n" not in str(caught.value)
    assert str(problem) in str(caught.value)
