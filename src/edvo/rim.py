"""The black rim that undistorted or registered images have, whose edges stay with the camera.

Not in the paper. What is outside the view of a lens, or of the camera that an image was registered
to, is black in all images; its border would say that the camera stands still.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

BLACK = 8  # grey levels that count as such: compressed images are not quite black
LEAST_SHARE = 0.001  # of the pixels: less is no rim
# What a rim surrounds is most of the image, and nearly convex (undistorted images bend inwards).
# What lies dark behind an object is not like that, and gives way as the camera moves.
LEAST_INSIDE, LEAST_CONVEX = 0.5, 0.9
MOST_GIVEN = 0.02  # of the pixels, to what is seen later
REACH_PX = 8  # to which its edges are blurred, and compressed


class Rim:
    """What has been black in all images so far, and hung together with the border of the first."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start anew: nothing is known of the images."""
        self._black: NDArray[np.uint8] | None = None
        self._near: NDArray[np.bool_] | None = None
        self._area = self._taken = (
            0  # pixels that are black, and that were when it was taken for one
        )
        self._is_without = False

    def near(self, grey: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
        """Learn from an image, and say where its edges are those of the rim.

        Images without any are told at the first one, and cost nothing from then on.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
            Of one size with those before.

        Returns
        -------
        ndarray of bool, shape (H, W), or None
            Pixels in the rim, or so near that its edge may be there; None where there is none.
        """
        if self._is_without:
            return None
        dark = (grey <= BLACK).astype(np.uint8)
        black = _at_border(dark) if self._black is None else dark & self._black
        before, self._area, self._black = self._area, cv2.countNonZero(black), black
        given = self._taken - self._area
        if self._area < LEAST_SHARE * grey.size or given > MOST_GIVEN * grey.size:
            self._is_without = True
            self._black = self._near = None
        elif self._area != before and (self._near is not None or _is_around(black)):
            self._taken = self._taken or self._area
            side = 2 * REACH_PX + 1
            self._near = cv2.dilate(black, np.ones((side, side), np.uint8)).astype(bool)
        return self._near


def _is_around(black: NDArray[np.uint8]) -> bool:
    """Say whether what is not black is most of an image, and nearly convex."""
    inside = 1 - black
    area = cv2.countNonZero(inside)
    if area < LEAST_INSIDE * inside.size:
        return False
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    corners = cv2.convexHull(np.concatenate(contours))
    hull = cv2.fillConvexPoly(np.zeros_like(black), corners, 1)
    return area >= LEAST_CONVEX * cv2.countNonZero(hull)


def _at_border(black: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Keep of a mask what hangs together with the border of the image."""
    around = cv2.copyMakeBorder(black, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    cv2.floodFill(around, None, (0, 0), 2)
    return np.ascontiguousarray(around[1:-1, 1:-1] == 2, np.uint8)
