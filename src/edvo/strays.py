"""Stray depth: specks that a sensor sees where no surface is.

Not in the paper. A stereo camera that matches wrongly, a lamp that shines into a sensor, or a pixel
between two surfaces give depth that the surface around does not share. An edge with such depth
that is too near moves by far more pixels than others as the camera does: a few of them outweigh
all that is right. All that lies on the ring round such a speck lies behind it; a surface goes on.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.planes import camera_of

REACH = 1 / 32  # of the width of the image: 20 pixels of 640, as far as a speck may
LEAST_PX = 3.0  # of a ring: within less, stray pixels at a contour lie beside each other
NEAREST, TIMES = 0.02, 3.0  # the share of the edges that may be far nearer than the rest; how far
LEAST = 0.1  # of the edges, that have to be left: where fewer are, the scene is of small things
# Its pixels, in sixteenths, those across from each other first: half lie on a surface that ends.
ORDER = 0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15
NOWHERE = np.empty((0, 2), np.int32)  # where none is left out: no ring, no stray depth
NOWHERE.setflags(write=False)  # as `ring`: else kernels compile twice


@functools.lru_cache(16)
def ring(width: int) -> NDArray[np.int32]:
    """Give the pixels of the ring round one of an image, or of every so manyth pixel of one.

    Parameters
    ----------
    width : int
        Of the image, pixels.

    Returns
    -------
    ndarray of int32, shape (16, 2)
        Steps (u, v), not to be written to.
    """
    radius = max(REACH * width, LEAST_PX)
    angles = 2 * math.pi / len(ORDER) * np.array(ORDER)
    around = np.rint(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    steps: NDArray[np.int32] = around.astype(np.int32)
    steps.setflags(write=False)
    return steps


def drop_strays(
    pixels: NDArray[np.float32],
    index: NDArray[np.int32],
    depth: NDArray[np.float32],
    camera: Camera,
    table: NDArray[np.float32],
    T_depth_cam: NDArray[np.float64],
    delayed: bool,
    gap: float,
    depths: NDArray[np.float32],
) -> None:
    """Write 0 for stray depths of edges, and then for the few that are far nearer than the rest.

    Nearer than a third of what all but a fiftieth are away. These are of larger specks; or of a
    cable before the lens, which would tell much of the pose, but less than specks would spoil.

    Parameters
    ----------
    pixels : ndarray of float32, shape (N, 2)
        Ideal.
    index : ndarray of int32, shape (N,)
        Their raw pixels in the image.
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    camera : Camera
    table : ndarray of float32, shape (H, W, 2) or (0, 0, 2)
        Its ideal pixels; empty where it does not distort.
    T_depth_cam : ndarray of float64, shape (4, 4)
        Maps points to the camera at the instant of the depth image.
    delayed : bool
        Whether that is another than the edges'; else all is looked up where they are.
    gap : float
        The relative step between two surfaces.
    depths : ndarray of float32, shape (N,)
        Metres, 0 where missing.
    """
    left, around = depths.copy(), ring(camera.width)
    kernels.drop_strays(
        pixels, index, depth, table, camera_of(camera), T_depth_cam, delayed, around, gap, left
    )
    kernels.drop_far_nearer(left, NEAREST, TIMES)
    if np.count_nonzero(left) >= LEAST * np.count_nonzero(depths):
        depths[:] = left
