"""Timing the stages of a call without a clock inside it: one is handed in."""

import time
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import Protocol


class Clock(Protocol):
    """Anything that gives a context manager for a named stage."""

    def __call__(self, stage: str) -> AbstractContextManager[object]:
        """Context within which the stage runs."""
        ...


class StageClock:
    """Sums the wall time of each stage between two looks at it.

    Examples
    --------
    >>> clock = StageClock()
    >>> with clock("edges"):
    ...     pass
    >>> list(clock.take())
    ['edges']
    """

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._stage = ""
        self._start = 0.0

    def __call__(self, stage: str) -> "StageClock":
        """Name the stage that starts; stages do not nest."""
        self._stage = stage
        return self

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        spent = time.perf_counter() - self._start
        self._seconds[self._stage] = self._seconds.get(self._stage, 0.0) + spent

    def take(self) -> dict[str, float]:
        """Give the seconds of each stage since the last call, and start anew.

        Returns
        -------
        dict of str to float
            In the order in which the stages first ran.
        """
        seconds, self._seconds = self._seconds, {}
        return seconds


_NOTHING = nullcontext()


def no_clock(stage: str) -> AbstractContextManager[object]:
    """Clock that does not look."""
    return _NOTHING
