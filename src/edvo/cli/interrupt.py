"""Ctrl-C that lets a frame be finished."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stop:
    """Whether it is time to stop, and by which signal that was asked for."""

    def __init__(self) -> None:
        self._signal = 0

    def __call__(self) -> bool:
        """Say whether it is."""
        return bool(self._signal)

    @property
    def status(self) -> int:
        """What a shell says of a program that the signal ended; 0 if there was none."""
        return 128 + self._signal if self._signal else 0

    def ask(self, number: int) -> None:
        """Ask for it, as a signal does."""
        self._signal = number


@contextmanager
def stop_on_interrupt() -> Iterator[Stop]:
    """Turn the first Ctrl-C or SIGTERM into a flag; the second one ends the process as ever.

    Yields
    ------
    Stop
        Says whether there was one.
    """
    asked = Stop()
    # Whoever runs edvo as a service or a job ends it by SIGTERM, and wants the results too.
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for each, handler in before.items():
            signal.signal(each, handler)

    def remember(number: int, frame: FrameType | None) -> None:
        asked.ask(number)
        restore()

    # Python delivers signals to the main thread only; elsewhere there is nothing to catch.
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    for each in before:
        signal.signal(each, remember)
    try:
        yield asked
    finally:
        restore()
