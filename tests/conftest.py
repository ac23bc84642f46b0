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


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real sequences, or a skip that says how to give one."""
    folder = Path(os.environ.get("EDVO_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real sequences at {folder}: set EDVO_DATA to a folder of TUM sequences")
    return folder
