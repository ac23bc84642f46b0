import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from edvo.evaluation import evaluate
from edvo.report.demo import SCENES
from edvo.trajectory import Trajectory

from .conftest import Command


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """One demo for all: its folder and what it prints."""
    folder = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-c", "from edvo.cli import main; main()", "demo"]
    done = subprocess.run(
        [*command, "-o", str(folder), "--seconds", "1.5"],
        capture_output=True,
        text=True,
        check=True,
    )
    return folder, done.stdout


def test_tracks_both_scenes(shown: tuple[Path, str]) -> None:
    folder, _ = shown
    for place in (folder, folder / SCENES[1]):
        truth = Trajectory.read(place / "groundtruth.txt")
        estimate = Trajectory.read(place / "trajectory.txt")
        errors = evaluate(truth, estimate, 45)
        assert errors.coverage == 1.0
        assert errors.rpe is not None
        assert errors.rpe_zero_motion is not None
        assert errors.rpe.rmse < 0.3 * errors.rpe_zero_motion.rmse
        summary = json.loads((place / "summary.json").read_text())
        assert summary["evaluation"]["rpe"]["translation_m"]["rmse"] == pytest.approx(
            errors.rpe.rmse, rel=1e-6
        )


def test_prints_errors_and_frame_rate(shown: tuple[Path, str]) -> None:
    _, printed = shown
    assert "RPE rmse m/s" in printed
    assert "zero motion" in printed
    assert "frames/s" in printed
    for scene in SCENES:
        assert scene in printed


def test_draws_a_picture(shown: tuple[Path, str]) -> None:
    picture = cv2.imread(str(shown[0] / "demo.png"))
    assert picture.shape[0] > 1000
    assert picture.std() > 20


def test_folder_in_the_way(edvo: Command, tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("")
    done = edvo("demo", "-o", tmp_path / "demo")
    assert done.status == 1
    assert done.err.count("\n") == 1
