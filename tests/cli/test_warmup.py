import os
import subprocess
import sys
from pathlib import Path
from threading import Event

import pytest
from numba.core import event

from edvo.cli import compiling
from edvo.config import Config


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
    monkeypatch.setattr(compiling, "warm_up", lambda config: None)
    monkeypatch.setattr(compiling, "_PATIENCE_S", 60.0)
    compiling.compile_now(Config())
    assert capsys.readouterr().err == ""
    note, noted = compiling.note, Event()

    def say(message: str) -> None:
        note(message)
        noted.set()

    monkeypatch.setattr(compiling, "note", say)
    monkeypatch.setattr(compiling, "_PATIENCE_S", 0.0)
    monkeypatch.setattr(compiling, "warm_up", lambda config: noted.wait(0.5))
    compiling.compile_now(Config())
    assert capsys.readouterr().err == ""  # nothing was compiled: it was loaded

    def compile_something(config: Config) -> None:
        with event.trigger_event("numba:compile"):
            noted.wait(60)

    monkeypatch.setattr(compiling, "warm_up", compile_something)
    compiling.compile_now(Config())
    assert told in capsys.readouterr().err
