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

# With nothing compiled yet a worker that begins with the one compiles the tracker for a minute or
# more, and one that begins with the others the renderer: so no two compile the same.
TRACKER, RENDERER = "cli/test_bad_input.py", "synthesis"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Have those begin that compile for all others."""
    items.sort(key=_turn)


def _turn(item: pytest.Item) -> int:
    if item.path.as_posix().endswith(TRACKER):
        return 0
    return 1 if item.path.parent.name == RENDERER else 2


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real sequences, or a skip that says how to give one."""
    folder = Path(os.environ.get("EDVO_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real sequences at {folder}: set EDVO_DATA to a folder of TUM sequences")
    return folder
