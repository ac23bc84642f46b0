"""Decoding ahead of the tracker.

Decoding a pair of PNG images costs more than tracking it, and OpenCV releases the interpreter
lock meanwhile, so that threads are enough to keep every core busy.
"""

import os
import sys
import threading
from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from edvo.datasets.source import Reading, Source

# How much more willingly than the tracker a decoding thread gives up its core: of two cores and
# three such threads a frame is tracked on most of one, and a run takes no longer; a quarter longer
# where others keep both cores busy (by 10 three times as long).
_NICENESS = 5


def read_ahead(
    source: Source, indices: Iterable[int], *, workers: int = 2, ahead: int = 8
) -> Generator[Reading, None, None]:
    """Read frames in threads, some way ahead of who takes them.

    Parameters
    ----------
    source : Source
        Where to read.
    indices : iterable of int
        Which frames, in the order wanted; drawn on only as far as is read ahead.
    workers : int
        Threads that decode.
    ahead : int
        Frames that are decoded or being decoded before they are taken; bounds the memory.

    Yields
    ------
    Reading
        In the order of `indices`.

    Raises
    ------
    ValueError
        If `workers` or `ahead` is not positive.

    Notes
    -----
    An exception of `Source.read` is raised where its frame would have been yielded. Closing the
    generator (``with contextlib.closing(...)``) drops what was not begun and waits for the rest,
    so that no thread outlives it.
    """
    if workers < 1 or ahead < 1:
        raise ValueError(f"workers ({workers}) and ahead ({ahead}) must be at least 1")
    return _read_ahead(source, indices, workers, ahead)


def _read_ahead(
    source: Source, indices: Iterable[int], workers: int, ahead: int
) -> Generator[Reading, None, None]:
    wanted = iter(indices)
    pending: deque[Future[Reading]] = deque()
    pool = ThreadPoolExecutor(
        max_workers=workers, thread_name_prefix="edvo-read", initializer=give_way
    )
    try:
        for index in wanted:
            pending.append(pool.submit(source.read, index))
            if len(pending) == ahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def give_way() -> None:
    """Let the thread that tracks go first where there are fewer cores than threads."""
    if sys.platform == "linux":  # elsewhere the niceness is the process's
        thread = threading.get_native_id()
        with suppress(OSError):
            now = os.getpriority(os.PRIO_PROCESS, thread)
            os.setpriority(os.PRIO_PROCESS, thread, now + _NICENESS)
