"""Ctrl-C and SIGTERM: what was tracked is written, and complete."""

import json
import signal
from pathlib import Path

import pytest

from edvo.cli import run as run_module
from edvo.cli.interrupt import (
    Terminated,
    exit_status,
    stop_on_interrupt,
    terminated_as_interrupted,
)
from edvo.trajectory import Trajectory

from .conftest import Command, interrupted, interrupting, rows


def written(folder: Path) -> int:
    """Check that all files are there and agree; returns the number of frames."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert (folder / "config.yaml").exists()
    found = rows(folder)
    tracked = [row["timestamp"] for row in found if row["status"] != "lost"]
    assert list(Trajectory.read(folder / "trajectory.txt").stamps) == tracked
    assert summary["frames"]["processed"] == len(found)
    assert not [file for file in folder.iterdir() if file.name.startswith(".")]
    return len(found)


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_from_outside(
    whole_sequence: Path, tmp_path: Path, how: signal.Signals, status: int
) -> None:
    command = ("run", whole_sequence, "-o", tmp_path)
    done = interrupted("run.progress = progress", *command, steps=10, how=how)
    assert done.status == status
    assert "interrupted after 10 of 36 frames" in done.err
    assert "Traceback" not in done.err
    assert written(tmp_path) == 10


def test_frame_in_hand_is_finished(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "progress", interrupting)
    done = edvo("run", whole_sequence, "-o", tmp_path)
    assert done.status == 130
    assert "interrupted after 7 of 36 frames" in done.err
    assert written(tmp_path) == 7
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_before_the_first_frame(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(config: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_module, "compile_now", interrupted)
    done = edvo("run", whole_sequence, "-o", tmp_path)
    assert done.status == 130
    assert done.err == "edvo: interrupted\n"
    assert not list(tmp_path.iterdir())


def test_a_second_one_ends_the_command_at_once() -> None:
    with terminated_as_interrupted():
        with stop_on_interrupt() as stop:
            signal.raise_signal(signal.SIGTERM)
            assert stop()
            assert stop.status == 143
            with pytest.raises(Terminated) as caught:
                signal.raise_signal(signal.SIGTERM)
        assert exit_status(caught.value) == 143
        with pytest.raises(Terminated):
            signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    assert exit_status(KeyboardInterrupt()) == 130


def test_sigterm_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with terminated_as_interrupted():
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
