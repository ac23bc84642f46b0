"""A stream that freezes: no sensor gives the same image twice, for its noise."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from edvo.frame import Frame

Pixel = TypeVar("Pixel", bound=np.generic)

FREEZE_S = 0.3  # for so long images may repeat: a recorder wrote one twice
# Every fourth pixel of every sixteenth row tells whether an image is a new one: rows lie far apart
# in memory, and to fetch one takes longer than to read it.
ROWS, COLUMNS = 16, 4


def glimpse(image: NDArray[Pixel]) -> NDArray[Pixel]:
    """Give of an image what tells whether it is a new one.

    Parameters
    ----------
    image : ndarray, shape (H, W)

    Returns
    -------
    ndarray of the same type, shape (H / 16, W / 4)
        A copy of every fourth pixel of every sixteenth row, packed.
    """
    return image[::ROWS, ::COLUMNS].copy()


class Freeze:
    """Remembers the last image that was a new one."""

    def __init__(self) -> None:
        self._sight = np.empty((0, 0), np.uint8)
        self._time = -math.inf
        self._times = 0

    def repeats(self, frame: Frame) -> bool:
        """Say whether an image is the very same as the last one.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        bool
            False for an image of one grey, which may be that of a dark room, or of a wall.
        """
        sight = glimpse(frame.grey)
        if np.array_equal(sight, self._sight) and sight.min() < sight.max():
            self._times += 1
            return True
        self._sight, self._time, self._times = sight, frame.timestamp, 0
        return False

    def age(self, timestamp: float, least_s: float, period_s: float) -> float:
        """Say for how long the last image has been the same.

        Parameters
        ----------
        timestamp : float
            Seconds.
        least_s : float
            Where stamps stand still, or go back, so that they tell less than that,
        period_s : float
            each image counts for so many seconds.

        Returns
        -------
        float
            Seconds.
        """
        age = timestamp - self._time
        return self._times * period_s if age < least_s else age
