"""Sharing the processor's cores between threads that decode and the one that tracks."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager


def core_count() -> int:
    """Count the cores that this process may use.

    Returns
    -------
    int
        At least one.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Cores:
    """So many permits to compute, of which the next free one goes to the tracker if it waits.

    With more threads at work than cores, the system takes the tracker off its core in the middle
    of a frame: nothing is gained, since the cores are busy anyway, and the time a frame took would
    say more about the decoding than about the tracking.

    Parameters
    ----------
    count : int
        Permits.
    """

    def __init__(self, count: int) -> None:
        self._free = count
        self._tracker_waits = False
        self._changed = threading.Condition()

    @contextmanager
    def decoding(self) -> Iterator[None]:
        """Hold a permit, taken while no tracker waits for one."""
        with self._changed:
            self._changed.wait_for(lambda: self._free > 0 and not self._tracker_waits)
            self._free -= 1
        try:
            yield
        finally:
            self._give_back()

    @contextmanager
    def tracking(self) -> Iterator[None]:
        """Hold a permit, the first that is free."""
        with self._changed:
            self._tracker_waits = True
            self._changed.wait_for(lambda: self._free > 0)
            self._tracker_waits = False
            self._free -= 1
        try:
            yield
        finally:
            self._give_back()

    def _give_back(self) -> None:
        with self._changed:
            self._free += 1
            self._changed.notify_all()
