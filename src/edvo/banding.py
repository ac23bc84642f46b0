"""Bands across an image: lamps flicker while a shutter reads out its rows, one after the other.

Not in the paper. Where light rises and falls from row to row, Canny finds a line along each slope,
across the whole image and elsewhere in the next one. All pixels of a row are lit alike, so what
most of them share is light; of an edge along a row little is left in those above and below.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels

STEP_V, STEP_U = 2, 8  # of so many rows, and so many of their pixels, one is looked at
LEAST = 10  # pixels of half a row that tell
ONE_SIDED = 0.1  # share of the rows in which light rises, and falls: fewer are no band
LATEST, MOST = 0.2, 0.5  # weight of the latest image; a lamp flickers in most of them
MATTERS = 3.0  # grey levels of gradient that may be found as an edge, where an image is plain


class Bands:
    """Takes bands off the gradients of images, where most of these have some.

    Attributes
    ----------
    share : float
        Of the images of late, so many had bands; a half before the first one.
    """

    def __init__(self) -> None:
        self.share = MOST

    def remove(self, grey: NDArray[np.uint8], dv: NDArray[np.int16], grey_steps: int) -> bool:
        """Take from gradients what the rows of an image share, if it has bands.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
        dv : ndarray of int16, shape (H, W)
            Sobel gradients along columns, in ``grey_steps``-ths of a grey level; written to.
        grey_steps : int

        Returns
        -------
        bool
            Whether anything was taken.
        """
        slopes = _bands_of(grey, dv, grey_steps)
        has_some = slopes is not None
        self.share += (has_some - self.share) * LATEST
        if slopes is None or self.share < MOST:
            return False
        kernels.take_off_slopes(grey, slopes, STEP_V, dv)
        return True


def _bands_of(
    grey: NDArray[np.uint8], dv: NDArray[np.int16], grey_steps: int
) -> NDArray[np.float64] | None:
    """Say how light changes from row to row, for each that is looked at, if there are bands."""
    if kernels.one_sided_rows(dv, 4 * STEP_V, STEP_U, LEAST) < ONE_SIDED:
        return None
    slopes = np.empty((len(grey) + STEP_V // 2 - 1) // STEP_V)
    largest = kernels.row_slopes(grey, dv, STEP_V, STEP_U, LEAST, slopes)
    return None if largest < MATTERS * grey_steps else slopes
