import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from edvo.evaluation import evaluate
from edvo.trajectory import Trajectory

from .conftest import Command

FRAMES = 45


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """One demo for all: its folder and what it prints."""
    folder = tmp_path_factory.mktemp("demo")
    for name in ("report.html", "mine.html"):
        (folder / name).write_text("of a run before")
    (folder / "summary.json").write_text('{"edvo": "1", "more_files": ["report.html"]}')
    command = [sys.executable, "-c", "from edvo.cli import main; main()", "demo"]
    done = subprocess.run(
        [*command, "-o", str(folder), "--seconds", "1.5"],
        capture_output=True,
        text=True,
        check=True,
    )
    return folder, done.stdout


def test_tracks_and_writes_what_run_writes(shown: tuple[Path, str]) -> None:
    folder, _ = shown
    truth = Trajectory.read(folder / "groundtruth.txt")
    estimate = Trajectory.read(folder / "trajectory.txt")
    errors = evaluate(truth, estimate, FRAMES)
    assert errors.coverage == 1.0
    assert errors.rpe is not None
    assert errors.rpe_zero_motion is not None
    assert errors.rpe.rmse < 0.3 * errors.rpe_zero_motion.rmse
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["evaluation"]["rpe"]["translation_m"]["rmse"] == pytest.approx(
        errors.rpe.rmse, rel=1e-6
    )
    assert set(summary["measured"]) == {"depth_delay_s", "readout_s", "exposure_s"}


def test_leaves_nothing_of_a_run_before(shown: tuple[Path, str]) -> None:
    assert not (shown[0] / "report.html").exists()
    assert (shown[0] / "mine.html").exists()
    assert json.loads((shown[0] / "summary.json").read_text())["more_files"] == []


def test_opencv_tracks_the_same_frames(shown: tuple[Path, str]) -> None:
    folder, _ = shown
    edvo = Trajectory.read(folder / "trajectory.txt")
    opencv = Trajectory.read(folder / "opencv-rgbd.txt")
    assert set(opencv.stamps) <= set(edvo.stamps)
    errors = evaluate(Trajectory.read(folder / "groundtruth.txt"), opencv, FRAMES)
    assert errors.rpe is not None
    assert f"{errors.rpe.rmse:.4f}" in shown[1]


def test_prints_a_row_for_each_tracker_and_one_for_none(shown: tuple[Path, str]) -> None:
    _, printed = shown
    assert "frames/s" in printed
    table = printed[printed.index("RPE rmse m/s") :].splitlines()
    assert table[0].endswith("ms a frame")
    rows = {line[: len("opencv-rgbd")].strip(): line.split() for line in table[2:5]}
    assert list(rows) == ["edvo", "opencv-rgbd", "zero motion"]
    assert rows["edvo"][-2] == "100.0%"
    for name in ("edvo", "opencv-rgbd"):
        assert float(rows[name][-1]) > 0


def test_draws_a_picture(shown: tuple[Path, str]) -> None:
    picture = cv2.imread(str(shown[0] / "demo.png"))
    assert picture.shape[0] > 500
    assert picture.std() > 20


def test_the_animation_moves(shown: tuple[Path, str]) -> None:
    path = shown[0] / "demo.webp"
    assert path.stat().st_size < 5_000_000
    with Image.open(path) as animation:
        assert animation.n_frames == -(-FRAMES // 2)
        assert animation.info["loop"] == 0
        first = np.asarray(animation.convert("RGB"), float)
        animation.seek(animation.n_frames - 1)
        last = np.asarray(animation.convert("RGB"), float)
    assert first.shape == last.shape
    assert np.abs(first - last).mean() > 2


def test_unknown_scene(edvo: Command, tmp_path: Path) -> None:
    done = edvo("demo", "-o", tmp_path / "demo", "--scene", "moon")
    assert done.status == 1
    assert "notexture_far" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "demo").exists()


def test_folder_in_the_way(edvo: Command, tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("")
    done = edvo("demo", "-o", tmp_path / "demo")
    assert done.status == 1
    assert done.err.count("\n") == 1
