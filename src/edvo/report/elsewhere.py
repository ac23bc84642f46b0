"""Compiling in a process of its own, while this one compiles something else."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

from edvo.cores import usable_cores
from edvo.report.warmup import cache_folder


class Elsewhere:
    """A process that compiles what this one will need.

    A process compiles one function at a time, whatever the number of its threads; two of them all
    but halve the wait of who starts for the first time. What is compiled meets in the cache. It is
    a matter of speed only: should it fail, this process compiles all of it.

    As a context it waits at its end for that process, or stops it if an exception leaves it.

    Parameters
    ----------
    task : callable
        A function of a module, without arguments.
    """

    def __init__(self, task: Callable[[], None]) -> None:
        module, name = task.__module__, task.__name__
        # -P: nothing that lies in the folder that somebody works in is imported, a numpy.py say
        self._command = [sys.executable, "-P", "-c", f"from {module} import {name}; {name}()"]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, where it helps."""
        if self._process is None and helps():
            nothing = subprocess.DEVNULL
            with suppress(OSError):  # no memory for it, or no right to
                self._process = subprocess.Popen(
                    self._command, stdin=nothing, stdout=nothing, stderr=nothing
                )

    def wait(self) -> None:
        """Wait until it has done, if it was started."""
        if self._process is not None:
            self._process.wait()

    def __enter__(self) -> "Elsewhere":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None and self._process is not None:
            self._process.kill()
        self.wait()


def helps() -> bool:
    """Whether another process helps: what it compiles can be kept, and there is a core for it.

    Returns
    -------
    bool
    """
    return cache_folder() is not None and usable_cores() > 1
