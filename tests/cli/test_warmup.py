import os
import subprocess
import sys
from pathlib import Path


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
