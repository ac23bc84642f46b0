"""Which depth image goes with which colour image.

Cameras of the Kinect kind take colour and depth at times of their own. Each colour image gets
the depth image nearest in time, if that is near enough; a depth image may serve two colour
images, and one that is nearest to none is left out.

TUM's ``associate.py`` instead pairs greedily, nearest pair first, and uses each depth image
once. The two differ only where two colour images claim the same depth image, that is where a
depth image was dropped: there the second colour image is paired with a worse one or lost, while
here both are kept, since every frame without a pose is a hole in the trajectory.
"""

import numpy as np
from numpy.typing import NDArray

from edvo.trajectory import nearest_indices

MAX_DIFFERENCE_S = 0.02
"""Seconds between colour and depth that are still one frame (TUM's value)."""


def associate(
    colour: NDArray[np.float64],
    depth: NDArray[np.float64],
    *,
    max_difference: float = MAX_DIFFERENCE_S,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Give each colour image its nearest depth image.

    Parameters
    ----------
    colour, depth : ndarray, shapes (N,) and (M,), float64
        Times in seconds, increasing.
    max_difference : float
        Colour images further than this from any depth image are left out, seconds.

    Returns
    -------
    colour_indices, depth_indices : ndarray, shape (K,), intp
        The pairs, in order of colour.
    """
    if not len(depth):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    partner = nearest_indices(depth, colour)
    kept = np.flatnonzero(np.abs(depth[partner] - colour) <= max_difference)
    return kept, partner[kept]


def stamped_delay(colour: float, depth: float) -> float:
    """Say by how much depth is later than the colour image that it was paired with already.

    Parameters
    ----------
    colour, depth : float
        Times of both as they are stamped, seconds.

    Returns
    -------
    float
        Seconds, to the microsecond: of times since 1970 a float has hardly more. 0 if they are
        further apart than the images of a frame may be: such stamps are of different clocks.
    """
    delay = round(depth - colour, 6)
    return delay if abs(delay) <= MAX_DIFFERENCE_S else 0.0
