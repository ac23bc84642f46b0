"""Ctrl-C: what was tracked is written, and complete."""

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from edvo.cli import run as run_module
from edvo.trajectory import Trajectory

from .conftest import Command

# The command as installed, but that it says when it is in the middle, and dawdles from there on.
DAWDLING = """
import sys, time
from contextlib import contextmanager
from edvo.cli import main, run

@contextmanager
def progress(what, total):
    count = 0
    def advance():
        nonlocal count
        count += 1
        if count == 10:
            print("in the middle", flush=True)
        if count >= 10:
            time.sleep(0.1)
    yield advance

run.progress = progress
main()
"""


def written(folder: Path) -> int:
    """Check that all files are there and agree; returns the number of frames."""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert (folder / "config.yaml").exists()
    with (folder / "frames.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    tracked = [row["timestamp"] for row in rows if row["status"] != "lost"]
    assert list(Trajectory.read(folder / "trajectory.txt").stamps) == tracked
    assert summary["frames"]["processed"] == len(rows)
    assert not [file for file in folder.iterdir() if file.name.startswith(".")]
    return len(rows)


def test_from_outside(whole_sequence: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", DAWDLING, "run", str(whole_sequence), "-o", str(tmp_path)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "in the middle\n"
    os.kill(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "interrupted after" in errors
    assert "Traceback" not in errors
    assert 10 <= written(tmp_path) < 36


def test_frame_in_hand_is_finished(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def interrupting(what: str, total: int) -> Iterator[object]:
        calls = iter(range(total))

        def advance() -> None:
            if next(calls) == 6:
                signal.raise_signal(signal.SIGINT)

        yield advance

    monkeypatch.setattr(run_module, "progress", interrupting)
    done = edvo("run", whole_sequence, "-o", tmp_path)
    assert done.status == 130
    assert "interrupted after 7 of 36 frames" in done.err
    assert written(tmp_path) == 7
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


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
