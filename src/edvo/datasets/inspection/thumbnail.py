"""A frame made small, to see how it differs from the next."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.holes import filled
from edvo.frame import Frame

WIDTH = 160  # pixels of a thumbnail
_CLIP = 4.0  # times the usual inverse depth: what is nearer counts as that near
_DETAIL = 6.0  # pixels; slower changes over a thumbnail are light, not detail
_MOST = 0.2  # a larger change of depth is an object's contour, however far it jumps


@dataclass(frozen=True)
class Thumbnail:
    """A small frame.

    Parameters
    ----------
    timestamp : float
        Seconds.
    grey : ndarray of float32, shape (h, w)
        Grey values, 0 to 255.
    detail : ndarray of float32, shape (h, w)
        The same without what changes slowly over the image.
    closeness : ndarray of float32, shape (h, w)
        Inverse depth in units of its median, holes filled.
    valid : ndarray of bool, shape (h, w)
        Where depth was measured.
    """

    timestamp: float
    grey: NDArray[np.float32]
    detail: NDArray[np.float32]
    closeness: NDArray[np.float32]
    valid: NDArray[np.bool_]


def thumbnail(frame: Frame) -> Thumbnail:
    """Make a frame small.

    Parameters
    ----------
    frame : Frame
        Of any size.

    Returns
    -------
    Thumbnail
        About 160 pixels wide.
    """
    height, width = frame.grey.shape
    size = (WIDTH, max(1, round(height * WIDTH / width)))
    # Area averaging stands in for a blur of the whole image.
    small = cv2.resize(frame.grey, size, interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.GaussianBlur(small, (0, 0), 0.7), np.float32)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), _DETAIL)
    depth = np.asarray(cv2.resize(frame.depth, size, interpolation=cv2.INTER_NEAREST), np.float32)
    valid = depth > 0
    if not valid.any():
        return Thumbnail(frame.timestamp, grey, detail, np.zeros_like(depth), valid)
    whole = filled(depth, 6)
    inverse = np.divide(1, whole, out=np.zeros_like(whole), where=whole > 0)
    usual = float(np.median(inverse[valid]))
    closeness = cv2.GaussianBlur(np.minimum(inverse / usual, _CLIP), (0, 0), 1.0)
    return Thumbnail(frame.timestamp, grey, detail, np.asarray(closeness, np.float32), valid)


def colour_change(a: Thumbnail, b: Thumbnail) -> float:
    """Say how much the detail of two images differs: the mean, grey values."""
    return float(np.abs(a.detail - b.detail).mean())


def depth_change(a: Thumbnail, b: Thumbnail) -> float:
    """Say how much two depth images differ: the mean, in units of the usual inverse depth."""
    both = a.valid & b.valid
    if not both.any():
        return 0.0
    return float(np.minimum(np.abs(a.closeness - b.closeness), _MOST)[both].mean())
