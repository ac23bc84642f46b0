"""Whether stamps are in seconds."""

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.finding import Finding

LONGEST_S = 5.0  # between frames; more is no video
SHORTEST_S, SLOWEST_S = 1 / 200, 1.0  # the intervals of cameras
UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
# Seconds since 1970, from the year 1980 on: such stamps, seconds apart, are those of a time lapse.
# Small ones may be one's, too, but are likelier to be counted in milliseconds.
UNIX_S = (3e8, 1e10)


def check_unit(timestamps: NDArray[np.float64]) -> Finding:
    """Look for stamps in milliseconds and smaller units.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Taken as seconds.

    Returns
    -------
    Finding
        A time lapse by the stamps of a clock is none.
    """
    if len(timestamps) < 3:
        return Finding("unit of stamps", undecided="there are too few frames")
    usual = float(np.median(np.diff(timestamps)))
    if usual <= LONGEST_S:
        return Finding("unit of stamps")
    on_clock = bool(UNIX_S[0] < timestamps[0] < UNIX_S[1])
    if on_clock and usual <= SLOWEST_S * UNITS["milliseconds"]:
        return Finding("unit of stamps")
    for unit, parts in UNITS.items():
        if SHORTEST_S <= usual / parts <= SLOWEST_S:
            warning = (
                f"{1 / usual:.2g} frames a second: stamps look like {unit}; edvo takes seconds: "
                f"divide them by {parts:.0f}"
            )
            return Finding("unit of stamps", (warning,))
    return Finding("unit of stamps")
