"""`edvo run --save-view` and `--view` as from a shell."""

import sys
from pathlib import Path

import pytest

from edvo.cli import run as run_module

from .conftest import Command, full_disk, images_of, interrupting

RESULTS = {"trajectory.txt", "frames.csv", "summary.json", "config.yaml"}


@pytest.fixture
def rerun() -> object:
    return pytest.importorskip(
        "rerun", reason="rerun-sdk is not installed: pip install 'edvo[view]'"
    )


def test_file_beside_the_results(
    edvo: Command, whole_sequence: Path, tmp_path: Path, rerun: object
) -> None:
    plain, shown = tmp_path / "plain", tmp_path / "shown"
    assert edvo("run", whole_sequence, "-o", plain).status == 0
    done = edvo("run", whole_sequence, "-o", shown, "--save-view", shown / "run.rrd")
    assert done.status == 0, done.err
    assert f"wrote {shown / 'run.rrd'}" in done.out
    assert {file.name for file in shown.iterdir()} == RESULTS | {"run.rrd"}
    assert images_of(shown / "run.rrd") == 36
    trajectories = [(folder / "trajectory.txt").read_bytes() for folder in (plain, shown)]
    assert trajectories[0] == trajectories[1]


def test_beside_report_and_unreadable_frames(
    edvo: Command, sequence: Path, tmp_path: Path, rerun: object
) -> None:
    (sequence / "depth" / "7.png").write_bytes(b"no image")
    file = tmp_path / "run.rrd"
    done = edvo("run", sequence, "-o", tmp_path / "out", "--report", "--save-view", file)
    assert done.status == 0, done.err
    assert "depth/7.png" in done.err
    assert images_of(file) == 35
    assert (tmp_path / "out" / "report.html").exists()


def test_interrupted(
    edvo: Command,
    whole_sequence: Path,
    tmp_path: Path,
    rerun: object,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_module, "progress", interrupting)
    file = tmp_path / "run.rrd"
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--save-view", file)
    assert done.status == 130
    assert images_of(file) == 7


def test_full_disk_leaves_the_results(
    edvo: Command, whole_sequence: Path, tmp_path: Path, rerun: object
) -> None:
    with full_disk(files=4):
        done = edvo("run", whole_sequence, "-o", tmp_path, "--save-view", tmp_path / "run.rrd")
    assert done.status == 1
    assert "run.rrd" in done.err
    assert "No space left" in done.err
    assert "RPE" in done.out
    assert {file.name for file in tmp_path.iterdir()} == RESULTS


def test_dropped_images_are_counted(
    edvo: Command,
    whole_sequence: Path,
    tmp_path: Path,
    rerun: object,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("edvo.report.viewer.FILE_BYTES", 0)
    monkeypatch.setattr("edvo.report.viewer.WINDOW_PICTURES", 0)
    file = tmp_path / "run.rrd"
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--save-view", file)
    assert done.status == 0, done.err
    assert "left out the images of 36 of 36 frames" in done.err
    assert images_of(file) == 0


@pytest.mark.parametrize("options", [("--view",), ("--save-view", "a.rrd")])
def test_missing_package_is_named_before_anything_is_done(
    edvo: Command,
    whole_sequence: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", *options)
    assert done.status == 1
    assert 'pip install "edvo[view]"' in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_no_display_is_said_before_anything_is_done(
    edvo: Command,
    whole_sequence: Path,
    tmp_path: Path,
    rerun: object,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--view")
    assert done.status == 1
    assert "no display" in done.err
    assert "--save-view" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_other_ending_is_refused(
    edvo: Command, whole_sequence: Path, tmp_path: Path, rerun: object
) -> None:
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--save-view", "view.mp4")
    assert done.status == 1
    assert "view.mp4" in done.err
    assert "name it *.rrd" in done.err
    assert not (tmp_path / "out").exists()
