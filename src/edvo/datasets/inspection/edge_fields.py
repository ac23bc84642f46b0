"""Edges of colour and of depth as fields of directions, to lay one over the other.

A pixel on an edge holds the doubled angle of the edge's normal as a vector (so that both senses
are one), any other pixel zero. Two such fields agree where edges lie on each other and run the
same way; edges that cross at random cancel.
"""

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.holes import filled

Field = NDArray[np.float32]
Pixel = TypeVar("Pixel", np.float32, np.uint8)

WIDTH = 320  # pixels that an image is reduced to
JUMP = 1.08  # a contour is where depth grows by this factor from a pixel to the next
HOLES = 8  # pixels of a hole that are bridged from each side: the shadow of a contour
CREASE = 0.012  # bend of inverse depth over twice ARM, relative to it; grows with depth, as noise
ARM = 4  # pixels from a crease to where the slopes on both sides are taken
SHORTEST_CONTOUR, SHORTEST_CREASE = 6, 8  # pixels; less is noise
_AROUND = 41  # pixels over which contrast is made equal
_FAINT = 1.0  # gradient that counts as none
_DIAGONAL = float(np.sqrt(0.5))
_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (_DIAGONAL, _DIAGONAL), (_DIAGONAL, -_DIAGONAL))
_NEIGHBOURS = np.ones((3, 3), np.uint8)


def reduction(width: int) -> int:
    """Say by what whole factor an image of this width is reduced."""
    return max(1, width // WIDTH)


def colour_field(grey: NDArray[np.uint8], factor: int) -> Field:
    """Find the edges of an image.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    factor : int
        Of reduction.

    Returns
    -------
    ndarray of float32, shape (H // factor, W // factor, 2)
        As strong as the gradient against what is usual around, not thinned.
    """
    height, width = grey.shape
    size = (width // factor, height // factor)
    small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.float32)
    du, dv = _gradient(small)
    strength = np.hypot(du, dv)
    weight = strength / (cv2.blur(strength, (_AROUND, _AROUND)) + _FAINT)
    return np.asarray(_doubled(du, dv) * weight[..., None], np.float32)


def depth_field(depth: NDArray[np.float32], factor: int) -> Field:
    """Find contours and creases of a depth image.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    factor : int
        Of reduction.

    Returns
    -------
    ndarray of float32, shape (H // factor, W // factor, 2)
        Of length 1 on the near side of contours and on creases.
    """
    height, width = depth.shape
    size = (width // factor, height // factor)
    calm = cv2.medianBlur(depth, 5)
    small = np.asarray(cv2.resize(calm, size, interpolation=cv2.INTER_NEAREST), np.float32)
    whole = filled(small, HOLES)
    near = (small > 0) & (cv2.dilate(whole, _NEIGHBOURS) > JUMP * small)
    # Both sides of a contour, so that it lies between them.
    far = (cv2.dilate(np.where(near, 1 / np.maximum(small, 1e-6), 0), _NEIGHBOURS) * whole) > JUMP
    near |= far
    inverse = np.divide(1, whole, out=np.zeros_like(whole), where=whole > 0)
    field, apart = _creases(small, inverse, near)
    field[~_long(apart, SHORTEST_CREASE)] = 0
    contours = _long(near, SHORTEST_CONTOUR)
    field[contours] = _doubled(*_gradient(inverse))[contours]
    return field


def _creases(
    depth: Field, inverse: Field, contours: NDArray[np.bool_]
) -> tuple[Field, NDArray[np.bool_]]:
    """Where the slope of inverse depth, constant on a plane, changes; and where that is most."""
    known = depth > 0
    field = np.zeros((*depth.shape, 2), np.float32)
    if not known.any():
        return field, known
    share = cv2.blur(known.astype(np.float32), (5, 5))
    sums = cv2.blur(np.where(known, inverse, np.float32(0)), (5, 5))
    level = np.asarray(sums / np.maximum(share, 1e-6), np.float32)
    around = np.ones((2 * ARM + 1, 2 * ARM + 1), np.uint8)
    clear = cv2.dilate(contours.astype(np.uint8), around) == 0
    smooth = ((share > 0.9) & clear).astype(np.uint8)
    least = CREASE * np.maximum(1, depth / np.median(depth[known]))
    most = np.zeros(depth.shape, np.float32)
    for u, v in _DIRECTIONS:
        sides = _moved(level, ARM * u, ARM * v) + _moved(level, -ARM * u, -ARM * v)
        on_surface = smooth & _moved(smooth, ARM * u, ARM * v) & _moved(smooth, -ARM * u, -ARM * v)
        bend = np.abs(sides - 2 * level) / np.maximum(level, 1e-6) * on_surface
        bend = np.asarray(cv2.blur(bend, (3, 3)), np.float32)
        ridge = (bend > least) & (bend > most)
        for step in (1, 2, 3):
            ridge &= bend >= _moved(bend, step * u, step * v)
            ridge &= bend >= _moved(bend, -step * u, -step * v)
        most[ridge] = bend[ridge]
        field[ridge] = (u * u - v * v, 2 * u * v)
    return field, most > 0


def _gradient(image: Field) -> tuple[Field, Field]:
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8)
    du = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    dv = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    return np.asarray(du, np.float32), np.asarray(dv, np.float32)


def _doubled(du: Field, dv: Field) -> Field:
    """Unit vectors of twice the angle."""
    square = np.maximum(du * du + dv * dv, np.float32(1e-20))
    return np.stack([(du * du - dv * dv) / square, 2 * du * dv / square], axis=2)


def _moved(image: NDArray[Pixel], right: float, down: float) -> NDArray[Pixel]:
    """Move an image, with zero where nothing comes from."""
    height, width = image.shape
    matrix = np.array([[1, 0, right], [0, 1, down]], np.float32)
    moved = cv2.warpAffine(image, matrix, (width, height), flags=cv2.INTER_NEAREST)
    return np.asarray(moved, image.dtype)


def _long(mask: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """Keep connected pixels that are so many."""
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    keep = statistics[:, cv2.CC_STAT_AREA] >= least
    keep[0] = False
    return np.asarray(keep[labels])
