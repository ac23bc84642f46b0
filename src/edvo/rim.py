"""The black rim that undistorted or registered images have, whose edges stay with the camera.

Not in the paper. What is outside the view of a lens, or of the camera that an image was registered
to, is black in all images; its border would say that the camera stands still.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

BLACK = 8  # grey levels that count as such: compressed images are not quite black
# What a rim surrounds is most of the image, lit, and nearly convex (some bend inwards).
LEAST_INSIDE, LEAST_CONVEX, LEAST_LIT = 0.5, 0.9, 20
# It lies along most of two opposite sides, or at all corners. If not along all of all four it has
# no depth, as a dark door has.
LEAST_ALONG, LEAST_CORNERS, ALL_ROUND, MOST_DEPTH = 0.5, 0.15, 0.95, 0.02
STEP_PX = 8  # one pixel in so many tells whether an image is lit
EVERY = 10  # frames, after which it is looked for anew: a dark thing may have touched it
BLOCK_PX = 8  # that images are compressed by
REACH_PX = 10  # to which its edges are blurred, and compressed


class Rim:
    """Looks for a black rim about the images of a camera."""

    def __init__(self) -> None:
        self._near: NDArray[np.bool_] | None = None
        self._wait = self._left = 0  # frames between two looks, and until the next one
        self._is_without = False

    def near(self, grey: NDArray[np.uint8], depth: NDArray[np.float32]) -> NDArray[np.bool_] | None:
        """Learn from a frame, and say where its edges are those of the rim.

        The border of the first frame that is lit settles it where it is not black, so that
        recordings without a rim cost nothing more. What is too dark to tell leaves it open.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
            Of one size with those before.
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.

        Returns
        -------
        ndarray of bool, shape (H, W), or None
            Pixels in the rim, or so near that its edge may be there; None where there is none.
        """
        if self._is_without:
            return None
        if self._left:
            self._left -= 1
            return self._near
        if np.mean(grey[::STEP_PX, ::STEP_PX]) < LEAST_INSIDE * LEAST_LIT:
            return self._near
        self._is_without = self._near is None and black_sides(grey) is None
        self._near = find_rim(grey, depth)
        # light may still be coming up: what is not found is soon looked for again, and then seldom
        self._wait = min(2 * self._wait + 1, EVERY) if self._near is None else EVERY
        self._left = self._wait - 1
        return self._near


def black_sides(grey: NDArray[np.uint8]) -> float | None:
    """Say how much of the border of an image is black, if it is where a rim has its border.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)

    Returns
    -------
    float or None
        Share of that side of which least is; None if neither two opposite sides are, for the most
        part, nor the ends of all four.
    """
    top, bottom, left, right = (
        float(np.mean(line <= BLACK)) for line in (grey[0], grey[-1], grey[:, 0], grey[:, -1])
    )
    least = min(top, bottom, left, right)
    opposite = max(min(top, bottom), min(left, right))
    return least if opposite >= LEAST_ALONG or least >= LEAST_CORNERS else None


def find_rim(grey: NDArray[np.uint8], depth: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Find the black rim of an image.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.

    Returns
    -------
    ndarray of bool, shape (H, W), or None
        Pixels that are in it, or within ``REACH_PX`` of it; None where there is none.
    """
    along = black_sides(grey)
    if along is None:
        return None
    black = cv2.copyMakeBorder(
        (grey <= BLACK).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1
    )
    cv2.floodFill(black, None, (0, 0), 2)
    rim = black[1:-1, 1:-1] == 2
    within = (~rim).astype(np.uint8)
    area = cv2.countNonZero(within)
    if area < LEAST_INSIDE * rim.size or np.mean(grey[~rim]) < LEAST_LIT:
        return None
    if along < ALL_ROUND and np.count_nonzero(depth[rim]) > MOST_DEPTH * (rim.size - area):
        return None
    # without what compression leaves in the rim, up to a block from its edge
    within = cv2.morphologyEx(
        within, cv2.MORPH_OPEN, np.ones((BLOCK_PX + 1, BLOCK_PX + 1), np.uint8)
    )
    contours, _ = cv2.findContours(within, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not contours:
        return None
    hull = np.zeros_like(within)
    cv2.fillConvexPoly(hull, cv2.convexHull(np.concatenate(contours)), 1)
    if cv2.countNonZero(within) < LEAST_CONVEX * cv2.countNonZero(hull):
        return None
    side = 2 * REACH_PX + 1
    return cv2.dilate(rim.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
