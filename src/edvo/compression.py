"""Whether an image was compressed in blocks of 8 x 8 pixels. Not in the paper.

JPEG takes the noise of plain surfaces away and leaves steps between its blocks, which lie at the
same pixels wherever the camera looks: faint edges that say that it stands still.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels

LINES_PX = 40  # from one row, or column, that is looked at to the next
LARGEST = 4  # grey levels: what steps by more is an edge, and counts as so much
NONE = 0.02  # grey levels, which both kinds of steps have beside their own: both may be 0


def blockiness(grey: NDArray[np.uint8]) -> float:
    """Compare steps between blocks of 8 x 8 pixels with those amid them.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
        Neither scaled, undistorted nor cut off at the left or the top since it was compressed.

    Returns
    -------
    float
        How many times as large they are: 0.9 to 1.1 of images that were not compressed, 1.3 to 2.5
        of JPEG images of quality 95 to 80. 1 where no two blocks lie side by side.
    """
    between, amid = kernels.mean_steps(grey, LINES_PX, LARGEST)
    return (between + NONE) / (amid + NONE)
