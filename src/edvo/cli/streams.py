"""Standard streams that are not there, as after ``2>&-`` in a shell."""

import os
import sys


def open_closed_streams() -> None:
    """Let standard streams that are closed lead nowhere, as with ``/dev/null``.

    Python has None in their place, which no caller expects. Their numbers are taken, too: else
    the next file that is opened gets one, and what a C library says on standard error goes there.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            _take(number)
            mode = "w" if number else "r"
            nowhere = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nowhere, mode, encoding="utf-8"))


def _take(number: int) -> None:
    """Open the number of a stream, if nothing has it already, for programs begun from here, too."""
    try:
        os.fstat(number)
    except OSError:
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(nowhere, number)
        if nowhere != number:
            os.close(nowhere)
        os.set_inheritable(number, True)
