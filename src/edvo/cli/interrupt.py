"""Ctrl-C that lets a frame be finished."""

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType


@contextmanager
def stop_on_interrupt(
    signals: Sequence[signal.Signals] = (signal.SIGINT,),
) -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a flag; the second one interrupts as ever.

    Parameters
    ----------
    signals : sequence of signal.Signals
        What counts as Ctrl-C.

    Yields
    ------
    callable
        Says whether there was one.
    """
    asked = threading.Event()
    before = {each: signal.getsignal(each) for each in signals}

    def restore() -> None:
        for each, handler in before.items():
            signal.signal(each, handler)

    def remember(number: int, frame: FrameType | None) -> None:
        asked.set()
        restore()

    # Python delivers signals to the main thread only; elsewhere there is nothing to catch.
    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    for each in signals:
        signal.signal(each, remember)
    try:
        yield asked.is_set
    finally:
        restore()
