"""Stamps that are no seconds: counted in smaller units, or the same for all frames.

Whatever is judged by time, as speeds and jumps are, is then judged wrongly, and no frame tells.
"""

import logging

import numpy as np
from numpy.typing import NDArray

logger = logging.getLogger("edvo.odometry")  # one for all that the tracker has to say

LONGEST_S = 5.0  # between frames; more is no video
SHORTEST_S, SLOWEST_S = 1 / 200, 1.0  # the intervals of cameras
UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
# Seconds since 1970, from the year 1980 on: such stamps, seconds apart, are those of a time lapse.
# Small ones may be one's, too, but are likelier to be counted in milliseconds.
UNIX_S = (3e8, 1e10)
ENOUGH = 8  # stamps that tell


def mend_of(timestamps: NDArray[np.float64]) -> str:
    """Say what is wrong with the unit of stamps, and the mend.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Taken as seconds, three at least.

    Returns
    -------
    str
        Empty where they look like seconds; a time lapse by the stamps of a clock does.
    """
    usual = float(np.median(np.diff(timestamps)))
    if usual <= LONGEST_S:
        return ""
    on_clock = bool(UNIX_S[0] < timestamps[0] < UNIX_S[1])
    if on_clock and usual <= SLOWEST_S * UNITS["milliseconds"]:
        return ""
    for unit, parts in UNITS.items():
        if SHORTEST_S <= usual / parts <= SLOWEST_S:
            return (
                f"{1 / usual:.2g} frames a second: stamps look like {unit}; edvo takes seconds: "
                f"divide them by {parts:.0f}"
            )
    return ""


class Stamps:
    """Warns once, of the first frames, where their stamps are no seconds."""

    def __init__(self) -> None:
        self._first: list[float] = []

    def note(self, timestamp: float) -> None:
        """Take note of a stamp.

        Parameters
        ----------
        timestamp : float
            Of a frame, as it was given.
        """
        if len(self._first) == ENOUGH:
            return
        self._first.append(timestamp)
        if len(self._first) < ENOUGH:
            return
        times = np.array(self._first)
        if (times == times[0]).all():
            logger.warning("the first %d frames have one stamp: give each its own", ENOUGH)
        elif mend := mend_of(times):
            logger.warning("%s", mend)
