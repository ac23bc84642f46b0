"""A triangle mesh of what was seen: depth images fused by Open3D (extra ``edvo[open3d]``).

B. Curless and M. Levoy, *A Volumetric Method for Building Complex Models from Range Images*,
SIGGRAPH 1996: each voxel holds its signed distance to the surface, averaged over the images.
"""

import math
from collections.abc import Sequence
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines.open3d import load_open3d
from edvo.datasets import Source, read_ahead
from edvo.export.ply import to_ply

VOXEL_M = 0.015
TRUNCATION_VOXELS = 4.0
MAX_DEPTH_M = 4.0
MIN_VIEWS = 2  # what one image alone has seen may be a stray pixel
BLOCKS = 4000  # of 8 x 8 x 8 voxels to begin with; the grid grows by itself
STEP_M = 0.04  # images from nearer to the last one add nothing but time
STEP_DEG = 4.0


def fuse(source: Source, indices: Sequence[int], poses: NDArray[np.float64]) -> bytes:
    """Fuse the depth images of a tracked source into a mesh.

    Parameters
    ----------
    source : Source
        Read again, in part: the frames that lie 4 cm or 4 degrees apart.
    indices : sequence of int, length N
        Frames that have a pose.
    poses : ndarray of float64, shape (N, 4, 4)
        Their ``T_world_cam``.

    Returns
    -------
    bytes
        A PLY file with the grey values as colours; positions in the world, metres.

    Raises
    ------
    MissingExtraError
        If Open3D is not installed or does not load.
    """
    library = load_open3d()
    core, image = library.core, library.t.geometry.Image
    camera = source.camera
    pinhole = core.Tensor(np.ascontiguousarray(camera.matrix), core.float64)
    grid = library.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"),
        (core.float32, core.float32, core.float32),
        ((1,), (1,), (3,)),
        VOXEL_M,
        block_resolution=8,
        block_count=BLOCKS,
        device=core.Device("CPU:0"),
    )
    chosen = apart(poses)
    with closing(read_ahead(source, [indices[i] for i in chosen])) as readings:
        for i, reading in zip(chosen, readings, strict=True):
            if reading.frame is None:
                continue
            grey = camera.undistort_image(reading.frame.grey).astype(np.float32) / 255
            depth = image(np.ascontiguousarray(camera.undistort_depth(reading.frame.depth)))
            colour = image(np.repeat(grey[:, :, None], 3, axis=2))
            T_cam_world = core.Tensor(se3.inverse(poses[i]), core.float64)
            limits = (1.0, MAX_DEPTH_M, TRUNCATION_VOXELS)  # depth is in metres
            blocks = grid.compute_unique_block_coordinates(depth, pinhole, T_cam_world, *limits)
            grid.integrate(blocks, depth, colour, pinhole, pinhole, T_cam_world, *limits)
    mesh = grid.extract_triangle_mesh(min(MIN_VIEWS, len(chosen)) - 0.5).to_legacy()
    colours = np.rint(255 * np.clip(np.asarray(mesh.vertex_colors), 0, 1)).astype(np.uint8)
    return to_ply(
        np.asarray(mesh.vertices).reshape(-1, 3),
        colours.reshape(-1, 3),
        np.asarray(mesh.triangles).reshape(-1, 3),
        comment="edvo mesh",
    )


def apart(poses: NDArray[np.float64]) -> list[int]:
    """Choose poses each of which is some way from the one chosen before.

    Parameters
    ----------
    poses : ndarray of float64, shape (N, 4, 4)
        ``T_world_cam``.

    Returns
    -------
    list of int
        Which ones; the first always.
    """
    chosen: list[int] = []
    for index, pose in enumerate(poses):
        if chosen:
            T_last_cur = se3.inverse(poses[chosen[-1]]) @ pose
            turn = math.degrees(se3.rotation_angle(T_last_cur))
            if math.hypot(*T_last_cur[:3, 3].tolist()) < STEP_M and turn < STEP_DEG:
                continue
        chosen.append(index)
    return chosen
