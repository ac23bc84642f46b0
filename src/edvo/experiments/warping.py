"""A frame as it would look from elsewhere, with the true place of each of its pixels (Fig. 8)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.frame import Frame, register_depth

_CRACK_NEIGHBOURS = 6  # of the eight, with depth, that make a pixel without depth a mere crack
_MARGIN_PX = 5  # what the blur, Sobel and Canny see around a pixel, and one more


@dataclass(frozen=True)
class Warped:
    """An image warped by depth.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
        The new image.
    origin : ndarray of float64, shape (H, W, 2)
        Raw pixel u, v of the original image that each of its pixels shows; NaN where it shows
        nothing, or is so near to nothing that an edge there may be made by the hole.
    """

    grey: NDArray[np.uint8]
    origin: NDArray[np.float64]


def warp_frame(frame: Frame, camera: Camera, T_view_frame: NDArray[np.float64]) -> Warped:
    """Show a frame from another view, by its depth.

    Parameters
    ----------
    frame : Frame
        The original.
    camera : Camera
        Of both views.
    T_view_frame : ndarray of float64, shape (4, 4)
        Maps points from the frame's camera to the new view's.

    Returns
    -------
    Warped
        Made in two steps: the depth of the new view, near surfaces hiding far ones, then for each
        of its pixels the grey value of the place in the original that this depth leads back to.
        So the place is exact whatever the errors of the depth: they bend the scene, no more.
    """
    depth = _without_cracks(register_depth(frame.depth, camera, camera, T_view_frame))
    height, width = depth.shape
    v, u = np.mgrid[:height, :width]
    pixels = np.column_stack((u.ravel(), v.ravel())).astype(np.float64)
    points = camera.backproject(pixels, depth.ravel().astype(np.float64))
    T_frame_view = se3.inverse(T_view_frame)
    with np.errstate(divide="ignore", invalid="ignore"):
        origin = camera.project(points @ T_frame_view[:3, :3].T + T_frame_view[:3, 3])
    origin = origin.reshape(height, width, 2)
    inside = (origin >= 0).all(axis=2) & (origin <= (width - 1, height - 1)).all(axis=2)
    seen = (depth > 0) & inside
    place = np.where(seen[:, :, None], origin, 0.0).astype(np.float32)
    grey = cv2.remap(frame.grey, place[:, :, 0], place[:, :, 1], cv2.INTER_CUBIC)
    grey = np.where(seen, grey, np.uint8(0))
    margin = np.ones((2 * _MARGIN_PX + 1,) * 2, np.uint8)
    safe = cv2.erode(seen.astype(np.uint8), margin, borderValue=1)
    origin[safe == 0] = np.nan
    return Warped(np.ascontiguousarray(grey, np.uint8), origin)


def _without_cracks(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Close single missing pixels by the mean of their neighbours, as resampling leaves them."""
    have = (depth > 0).astype(np.float32)
    ring = np.ones((3, 3), np.float32)
    ring[1, 1] = 0
    count = cv2.filter2D(have, -1, ring, borderType=cv2.BORDER_CONSTANT)
    total = cv2.filter2D(depth, -1, ring, borderType=cv2.BORDER_CONSTANT)
    crack = (have == 0) & (count >= _CRACK_NEIGHBOURS)
    return np.where(crack, total / np.maximum(count, 1), depth).astype(np.float32)
