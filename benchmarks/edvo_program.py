"""Running the command `edvo` as a shell does."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.frames import Recording
from edvo.synthesis.sequence import SyntheticSource, write_sequence


def edvo(*arguments: str | Path) -> float:
    """Run it and give the wall seconds of the whole process.

    Python keeps its bytecode, as that of an installed package is, whatever is asked of this one.
    """
    program = Path(sys.executable).with_name("edvo")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    begin = time.perf_counter()
    subprocess.run([program, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - begin


@contextmanager
def folder_of(recording: Recording) -> Iterator[Path]:
    """Give a folder of image files of a recording; a rendered one is written for the time."""
    if isinstance(recording.source, SyntheticSource):
        with TemporaryDirectory() as folder:
            yield write_sequence(recording.source, folder)
    else:
        yield recording.source.path
