import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.trajectory import Trajectory

from .conftest import Command


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Truth along a line at 0.1 m/s, and an estimate that makes each metre 1.1 m long."""
    times = np.arange(90) / 30.0
    poses = np.tile(np.eye(4), (90, 1, 1))
    poses[:, 0, 3] = 0.1 * times
    truth = tmp_path / "truth.txt"
    Trajectory.from_poses(times, poses).write(truth)
    poses[:, 0, 3] *= 1.1
    estimate = tmp_path / "estimate.txt"
    Trajectory.from_poses(times, poses).write(estimate)
    return truth, estimate


def test_prints_what_is_known_by_hand(edvo: Command, files: tuple[Path, Path]) -> None:
    done = edvo("evaluate", *files)
    assert done.status == 0
    assert "0.0100" in done.out  # a tenth of 0.1 m/s
    assert "zero motion" in done.out
    assert "0.1000" in done.out


def test_json(edvo: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "rgb.txt").write_text("# list\n" + "1.0 a.png\n" * 100)
    done = edvo("evaluate", *files, "--json", "--frames", tmp_path / "rgb.txt", "--delta", 0.5)
    errors = json.loads(done.out)
    assert errors["rpe"]["delta"] == 0.5
    assert errors["rpe"]["translation_m"]["rmse"] == pytest.approx(0.005, rel=1e-6)
    assert errors["rpe_zero_motion"]["translation_m"]["rmse"] == pytest.approx(0.05, rel=1e-6)
    assert errors["coverage"] == pytest.approx(0.9)


FRAMES_CSV = "timestamp,status\n" + "1.0,tracked\n" * 120


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('{\n  "edvo": "0.1.0"\n}\n', "list:1: '{' is no time"),
        ("# a comment\n\n1.0 a.png\nnan b.png\n", "list:4: 'nan' is no time"),
        (FRAMES_CSV + FRAMES_CSV, "list:122: 'timestamp' is no time"),
        ("# a comment\n", "list lists no frames"),
    ],
)
def test_what_is_no_list_of_frames(
    edvo: Command, files: tuple[Path, Path], tmp_path: Path, text: str, named: str
) -> None:
    (tmp_path / "list").write_text(text)
    done = edvo("evaluate", *files, "--frames", tmp_path / "list")
    assert done.status == 1
    assert named in done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("begin", ["", "\ufeff", "# a comment\n\n"])
def test_lists_of_frames(
    edvo: Command, files: tuple[Path, Path], tmp_path: Path, begin: str
) -> None:
    for text in (FRAMES_CSV, "1.0 rgb/1.png 1.0 depth/1.png\n" * 120, "1.0\t2\n" * 120):
        (tmp_path / "list").write_text(begin + text, encoding="utf-8")
        assert "75.0%" in edvo("evaluate", *files, "--frames", tmp_path / "list").out


def test_plot_is_a_picture(edvo: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    picture = tmp_path / "plot.png"
    assert edvo("evaluate", *files, "--plot", picture).status == 0
    pixels = cv2.imread(str(picture))
    assert pixels.shape[1] > 1000
    assert pixels.std() > 5


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--delta", "-1"], "delta"),
        (["--plot", "plot.xyz"], ".xyz"),
        (["--plot", "missing/plot.png"], "missing"),
        (["--frames", "missing.txt"], "cannot read missing.txt: No such file or directory; give"),
    ],
)
def test_wrong_option_is_one_line(
    edvo: Command, files: tuple[Path, Path], arguments: list[str], named: str
) -> None:
    done = edvo("evaluate", *files, *arguments)
    assert done.status == 1
    assert named in done.err
    assert done.err.count("\n") == 1


def test_a_span_that_was_asked_for_and_is_too_long_is_told(
    edvo: Command, files: tuple[Path, Path], tmp_path: Path
) -> None:
    done = edvo("evaluate", *files, "--delta", 100)
    assert done.status == 1
    assert str(Trajectory.read(files[1]).stamps[-1]) in done.err
    assert done.err.startswith(f"edvo: {files[1]}: no relative pose error: fewer than two pairs")
    assert done.err.endswith("; give a shorter delta: up to 2.9 s will do\n")
    assert done.err.count("\n") == 1
    assert "ATE" in done.out
    assert json.loads(edvo("evaluate", *files, "--delta", 100, "--json").out)["ate"] is not None
    assert edvo("evaluate", *files, "--delta", 2.9).status == 0
    short = Trajectory.read(files[1]).between(0.0, 0.5)
    short.write(tmp_path / "short.txt")
    done = edvo("evaluate", files[0], tmp_path / "short.txt")  # nobody asked for a second
    assert done.status == 0
    assert "no relative pose error" in done.err


def test_files_that_are_no_trajectories(
    edvo: Command, files: tuple[Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    bad, none = tmp_path / "bad.txt", tmp_path / "none.txt"
    for pair, wrong in (((files[0], bad), bad), ((none, files[1]), none)):
        done = edvo("evaluate", *pair)
        assert done.status == 1
        assert done.err.count("\n") == 1
        assert str(wrong) in done.err


def test_nothing_in_common(edvo: Command, files: tuple[Path, Path], tmp_path: Path) -> None:
    late = Trajectory.read(files[1])
    Trajectory.from_poses(late.timestamps + 1e6, late.poses).write(tmp_path / "late.txt")
    done = edvo("evaluate", files[0], tmp_path / "late.txt")
    assert done.status == 1
    assert done.err.count("\n") == 1
