"""Ctrl-C and SIGTERM, and how they let a frame be finished."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command just as Ctrl-C does."""


def exit_status(interrupt: KeyboardInterrupt) -> int:
    """Give what a shell says of a program that was ended so."""
    return 128 + (signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT)


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Raise `Terminated` at a SIGTERM, which else ends the process without a word."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


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
    """Turn the first Ctrl-C or SIGTERM into a flag; the second one ends the command at once.

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
