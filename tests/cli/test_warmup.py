import importlib
import os
import subprocess
import sys
import time
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from numba.core import event

from edvo.cli import compiling
from edvo.config import Config
from edvo.report import elsewhere
from edvo.report.elsewhere import Elsewhere
from edvo.report.warmup_aside import warm_up_registering


@pytest.mark.slow
def test_second_process_finds_all_compiled(whole_sequence: Path, tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def edvo(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-c", "from edvo.cli import main; main()", *arguments],
            capture_output=True,
            text=True,
            env=environment,
            check=True,
        )

    def compiled() -> dict[Path, int]:
        return {file: file.stat().st_mtime_ns for file in (tmp_path / "cache").rglob("*.nb*")}

    assert str(tmp_path / "cache") in edvo("warmup").stdout
    before = compiled()
    assert before
    for preset in ("default", "paper"):
        edvo("run", str(whole_sequence), "-o", str(tmp_path / preset), "--preset", preset)
    assert compiled() == before


@pytest.mark.parametrize(("folder", "told"), [(Path("cache"), "once"), (None, "NUMBA_CACHE_DIR")])
def test_says_so_only_if_it_takes_a_while(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    folder: Path | None,
    told: str,
) -> None:
    monkeypatch.setattr(compiling, "cache_folder", lambda: folder)
    monkeypatch.setattr(compiling, "is_registration_here", lambda: True)
    monkeypatch.setattr(compiling, "warm_up_seeing", lambda config: None)
    monkeypatch.setattr(compiling, "warm_up_tracking", lambda config: None)
    monkeypatch.setattr(compiling, "_PATIENCE_S", 60.0)
    compiling.compile_now(Config())
    assert capsys.readouterr().err == ""
    note, noted = compiling.note, Event()

    def say(message: str) -> None:
        note(message)
        noted.set()

    monkeypatch.setattr(compiling, "note", say)
    monkeypatch.setattr(compiling, "_PATIENCE_S", 0.0)
    monkeypatch.setattr(compiling, "warm_up_tracking", lambda config: noted.wait(0.5))
    compiling.compile_now(Config())
    assert capsys.readouterr().err == ""  # nothing was compiled: it was loaded

    def compile_something(config: Config) -> None:
        with event.trigger_event("numba:compile"):
            noted.wait(60)

    monkeypatch.setattr(compiling, "warm_up_tracking", compile_something)
    compiling.compile_now(Config())
    assert told in capsys.readouterr().err


class Told(Elsewhere):
    """Says when it is started and waited for, and does nothing."""

    def __init__(self, told: list[str]) -> None:
        super().__init__(warm_up_registering)
        self._told = told

    def start(self) -> None:
        self._told.append("start")

    def wait(self) -> None:
        self._told.append("wait")


@pytest.mark.parametrize(
    ("compiled", "here", "order"),
    [
        (True, False, ["see", "start", "wait", "track"]),
        (False, False, ["see", "wait", "track"]),
        (True, True, ["see", "wait", "track"]),
    ],
)
def test_another_process_compiles_what_tracking_begins_with(
    monkeypatch: pytest.MonkeyPatch, compiled: bool, here: bool, order: list[str]
) -> None:
    told: list[str] = []

    def see(config: Config) -> None:
        told.append("see")
        for _ in range(2 * compiled):
            with event.trigger_event("numba:compile"):
                pass

    monkeypatch.setattr(compiling, "registration_compiling_aside", lambda: Told(told))
    monkeypatch.setattr(compiling, "is_registration_here", lambda: here)
    monkeypatch.setattr(compiling, "warm_up_seeing", see)
    monkeypatch.setattr(compiling, "warm_up_tracking", lambda config: told.append("track"))
    compiling.compile_now(Config())
    assert told[:-1] == order  # the last is that it is waited for at the end


SIGNATURES = """
from edvo import kernels
from edvo.config import Config
from edvo.report.warmup import warm_up
from edvo.report.warmup_aside import is_registration_here, warm_up_registering

def signatures():
    found = vars(kernels).items()
    return {name: {*map(str, it.signatures)} for name, it in found if hasattr(it, "signatures")}

assert not is_registration_here()
"""
ALONE = """
warm_up_registering()
assert is_registration_here()
for kernel in (kernels.align, kernels.score_parts, kernels.is_told, kernels.is_amiss):
    assert kernel.signatures, kernel
"""
AFTER = """
for preset in ("default", "paper"):
    warm_up(Config.preset(preset))
before = signatures()
warm_up_registering()
assert signatures() == before
"""


@pytest.mark.parametrize("code", [ALONE, AFTER])
def test_other_process_compiles_what_this_one_calls(code: str) -> None:
    """Kernels called with arrays of another kind would be compiled for nothing."""
    subprocess.run([sys.executable, "-c", SIGNATURES + code], check=True)


@pytest.fixture
def tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A module of tasks for another process."""
    (tmp_path / "tasks.py").write_text(TASKS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(elsewhere, "usable_cores", lambda: 2)
    monkeypatch.setattr(elsewhere, "cache_folder", lambda: tmp_path)
    monkeypatch.delitem(sys.modules, "tasks", raising=False)
    return importlib.import_module("tasks")


LONG_S = 60.0
TASKS = """
import time
from pathlib import Path

DONE = Path(__file__).with_name("done")

def write():
    with DONE.open("a") as file:
        file.write("once")

def fail():
    write()
    raise SystemExit("told to nobody")

def last():
    write()
    time.sleep(300)
"""


@pytest.mark.parametrize("name", ["write", "fail"])
def test_is_started_once_and_waited_for(
    tasks: Any, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    with Elsewhere(getattr(tasks, name)) as aside:
        aside.start()
        aside.start()
    assert tasks.DONE.read_text() == "once"
    assert capfd.readouterr() == ("", "")


def test_what_lies_in_the_folder_of_work_is_not_run(
    tasks: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "work"
    work.mkdir()
    (work / "pathlib.py").write_text("raise SystemExit('not the one')")
    monkeypatch.chdir(work)
    with Elsewhere(tasks.write) as aside:
        aside.start()
    assert tasks.DONE.exists()


def test_is_stopped_if_this_one_fails(tasks: Any) -> None:
    def interrupted() -> None:
        with Elsewhere(tasks.last) as aside:
            aside.start()
            end = time.monotonic() + LONG_S
            while not tasks.DONE.exists():
                assert time.monotonic() < end
                time.sleep(0.01)
            raise KeyboardInterrupt

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begin < 2 * LONG_S


def test_system_that_starts_no_process(tasks: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nonexistent/python")
    with Elsewhere(tasks.write) as aside:
        aside.start()
    assert not tasks.DONE.exists()


@pytest.mark.parametrize(("place", "answer"), [("usable_cores", 1), ("cache_folder", None)])
def test_is_not_started_where_it_would_not_help(
    tasks: Any, monkeypatch: pytest.MonkeyPatch, place: str, answer: int | None
) -> None:
    monkeypatch.setattr(elsewhere, place, lambda: answer)
    with Elsewhere(tasks.write) as aside:
        aside.start()
    assert not tasks.DONE.exists()
