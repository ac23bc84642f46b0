"""Baselines by name."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from edvo.baselines import registry
from edvo.baselines.registry import (
    baseline_names,
    expand,
    find_baseline,
    group_names,
    make_tracker,
)
from edvo.camera import Camera
from edvo.errors import ConfigError, MissingExtraError
from edvo.frame import Frame
from edvo.odometry import Status

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)


def frame(time: float) -> Frame:
    v, u = np.mgrid[:120, :160]
    rng = np.random.default_rng(3)
    grey = (60 + 120 * ((u // 16 + v // 16) % 2) + rng.integers(0, 20, (120, 160))).astype(np.uint8)
    depth = (1.5 + 0.002 * u + 0.1 * np.sin(v / 15)).astype(np.float32)
    return Frame(time, np.ascontiguousarray(grey), depth)


@pytest.mark.parametrize("name", baseline_names())
def test_each_name_makes_a_tracker(name: str) -> None:
    extra = find_baseline(name).extra
    if extra is not None and find_spec(extra) is None:
        with pytest.raises(MissingExtraError, match=rf"edvo\[{extra}\]"):
            make_tracker(name, CAMERA)
        return
    tracker = make_tracker(name, CAMERA, seed=1)
    results = [tracker.track(frame(index / 30)) for index in range(2)]
    assert all(result.status is not Status.LOST for result in results)
    assert len(tracker.trajectory) == 2
    assert np.linalg.norm(tracker.trajectory.poses[1][:3, 3]) < 0.05  # nothing has moved
    assert tracker.skip(1.0, "no image").status is Status.LOST


def test_the_seed_reaches_edvo() -> None:
    tracker = make_tracker("edvo-paper", CAMERA, seed=7)
    assert tracker.config.seed == 7  # type: ignore[attr-defined]
    assert tracker.config.sampling.count == 450  # type: ignore[attr-defined]


def test_groups_become_their_members_each_once() -> None:
    assert expand(["opencv-rgbd", "opencv"])[:2] == ("opencv-rgbd", "opencv-rgb")
    assert len(expand(["opencv", "opencv-rgb"])) == len(expand(["opencv"]))
    assert set(expand(["opencv", "open3d"])) < set(expand(["all"]))
    assert expand(["opencv-f2f"]) == tuple(f"{name}-f2f" for name in expand(["opencv"]))
    assert not set(expand(["all"])) & {"edvo-default", "edvo-paper", "zero-motion"}
    for group in group_names():
        assert set(expand([group, f"{group}-f2f"])) <= set(baseline_names())


@pytest.mark.parametrize("name", ["opencv-rbgd", "", "zero-motion-f2f", "edvo-default-f2f", "-f2f"])
def test_an_unknown_name_lists_what_there_is(name: str) -> None:
    with pytest.raises(ConfigError) as caught:
        expand([name])
    message = str(caught.value)
    assert f"'{name}'" in message
    assert "orb-pnp" in message
    assert "all" in message
    assert "\n" not in message


def test_frame_to_frame_is_another_rule() -> None:
    kept, followed = (make_tracker(name, CAMERA) for name in ("opencv-rgbd", "opencv-rgbd-f2f"))
    for tracker in (kept, followed):
        tracker.track(frame(0.0))
    assert not kept.track(frame(1 / 30)).is_keyframe
    assert followed.track(frame(1 / 30)).is_keyframe


def test_nothing_is_imported_before_it_is_made() -> None:
    code = (
        f"import sys, {registry.__name__} as r; r.expand(['all']); "
        "print([m for m in sys.modules if m in ('open3d', 'matplotlib', 'edvo.baselines.orb')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
