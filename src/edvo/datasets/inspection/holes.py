"""Filling the holes of depth images."""

import cv2
import numpy as np
from numpy.typing import NDArray


def filled(depth: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Fill holes from their rims, with the farthest depth near: what is hidden lies behind.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    reach : int
        Pixels to fill from each side.

    Returns
    -------
    ndarray of float32, shape (H, W)
        With 0 left in larger holes.
    """
    near = np.ones((3, 3), np.uint8)
    result = depth
    for _ in range(reach):
        grown = np.asarray(cv2.dilate(result, near), np.float32)
        result = np.where(result == 0, grown, result)
    return result
