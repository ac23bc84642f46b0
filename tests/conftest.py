"""What several tests share."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent

# How long an example takes is the machine's affair: compiling, or other work on it.
settings.register_profile("edvo", deadline=None)
settings.load_profile("edvo")

# A shell that starts the tests behind its back has them, and all that they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# With nothing compiled yet the worker that begins with the first compiles the tracker for two
# minutes. The other one compiles the renderer, and then goes on with what neither tracks nor looks
# for edges: so no two compile the same.
FIRST = (
    "cli/test_bad_input.py",
    "synthesis/",
    "evaluation/",
    "datasets/test_ros_bad.py",
    "datasets/test_fetch_download.py",
    "experiments/test_sequences.py",
    "experiments/test_fig11.py",
    "baselines/test_opencv.py",
    "report/test_run_page.py",
    "report/test_plots.py",
    "test_camera.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Have those begin that compile for all others."""
    items.sort(key=_turn)


def _turn(item: pytest.Item) -> int:
    path = item.path.as_posix()
    return next((k for k, part in enumerate(FIRST) if f"/tests/{part}" in path), len(FIRST))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real sequences, or a skip that says how to give one."""
    folder = Path(os.environ.get("EDVO_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real sequences at {folder}: set EDVO_DATA to a folder of TUM sequences")
    return folder
