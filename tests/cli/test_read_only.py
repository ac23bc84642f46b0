"""An installation that cannot be written, with no home folder and no cache folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import edvo as package


@pytest.fixture(scope="module")
def read_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package in which no compiled code can be kept, even by root.

    Permissions do not bind root; files where the cache folders would be do.
    """
    site = tmp_path_factory.mktemp("site")
    copy = site / "edvo"
    shutil.copytree(
        Path(package.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").write_text("")
    return site


def edvo(site: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}
    }
    environment |= {"HOME": os.devnull + "/home", "PYTHONPATH": str(site)}
    environment["NUMBA_OPT"] = "0"  # to be compiled in two thirds of the time
    code = (
        "import edvo, sys; from edvo.cli import main; print(edvo.__file__, file=sys.stderr); main()"
    )
    return subprocess.run(
        [sys.executable, "-B", "-c", code, *arguments],
        capture_output=True,
        text=True,
        env=environment,
        timeout=300,
        check=False,
    )


@pytest.mark.slow  # half a minute of compiling
def test_run_compiles_without_a_cache(
    read_only: Path, whole_sequence: Path, tmp_path: Path
) -> None:
    # the preset that has least to be compiled
    how = "--preset", "paper", "--max-frames", "6"
    done = edvo(read_only, "run", str(whole_sequence), "-o", str(tmp_path), *how)
    assert done.returncode == 0, done.stderr
    assert str(read_only) in done.stderr
    assert "NUMBA_CACHE_DIR" in done.stderr
    assert len((tmp_path / "frames.csv").read_text().splitlines()) == 7


def test_warmup_says_that_it_is_in_vain(read_only: Path) -> None:
    done = edvo(read_only, "warmup")
    assert done.returncode == 1
    assert "NUMBA_CACHE_DIR" in done.stderr.splitlines()[-1]
