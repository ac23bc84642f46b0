"""Waiting for a camera, but not for ever."""

import threading
import time
from collections.abc import Callable, Generator
from typing import TypeVar

from edvo.errors import DatasetError

T = TypeVar("T")

WAIT_MS = 500
"""How long a driver may wait for the next images before it is asked whether to go on."""

LONGEST_S = 5.0
"""After so long without images a camera has failed."""


def images_of(
    take: Callable[[], T | None], name: str, closed: threading.Event
) -> Generator[T, None, None]:
    """Give images as they come, until the camera is closed.

    Parameters
    ----------
    take : callable
        Waits a while and gives the next images, or None if there were none.
    name : str
        Of the camera, for the error.
    closed : threading.Event
        Set when the camera is closed.

    Yields
    ------
    object
        What `take` gives.

    Raises
    ------
    DatasetError
        If none come for five seconds.
    """
    last = time.monotonic()
    while not closed.is_set():
        images = take()
        if images is not None:
            yield images
            last = time.monotonic()
        elif time.monotonic() - last >= LONGEST_S:
            raise DatasetError(f"{name}: no image for {LONGEST_S:g} s; see to its cable")


class Counter:
    """Counts the images whose number never came."""

    def __init__(self) -> None:
        self.missed = 0
        self._last: int | None = None

    def is_new(self, number: int) -> bool:
        """Take note of an image; say whether it is another one than the last."""
        last, self._last = self._last, number
        if last is not None:
            self.missed += max(number - last - 1, 0)
        return number != last
