"""Sub-sampling of edge pixels, spread over the image by a grid (§IV-A)."""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import EdgesConfig, SamplingConfig
from edvo.edges import NO_TABLE, EdgeImage, EdgePixels
from edvo.planes import camera_of
from edvo.sensor import DEPTH_NOISE, DepthNoise
from edvo.strays import drop_strays

AT_ONCE = np.eye(4)
CELLS_A_SAMPLE = 4  # where edges are chosen by what they tell: most cells of an image have none


def sample_edges(
    edges: EdgeImage,
    depth: NDArray[np.float32],
    camera: Camera,
    config: SamplingConfig,
    edges_config: EdgesConfig,
    seed: int,
    T_cam_depth: NDArray[np.float64] | None = None,
    count: int | None = None,
    noise: DepthNoise = DEPTH_NOISE["kinect_v1"],
    worth: NDArray[np.float32] | None = None,
) -> EdgePixels:
    """Draw N edges with depth: so many from each grid cell, the rest at random from all.

    Where ``SamplingConfig.selection`` says so, those instead that tell most of the motion: the
    cells, smaller ones, each give in turn, of a few that are drawn, the edge that adds most to the
    determinant of the information (not in the paper; after EdgeSLAM, T-RO 2025).

    Depth is looked up only for the edges that are drawn (see ``edges.depth_at_edges``); one
    without depth is passed over and another drawn. By the rule ``sides`` one that has a depth at
    its pixel is drawn by that; where nothing around agrees with it, it is left out, and no other
    drawn for it. So is, by ``edges.strays``, one whose depth is a speck's: see `edvo.strays`.

    Parameters
    ----------
    edges : EdgeImage
        Of the current frame.
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    camera : Camera
    config : SamplingConfig
        N, the size of a cell and how many each gives; N = 0 takes every edge that has depth.
    edges_config : EdgesConfig
        How depth is taken at an edge.
    seed : int
        The same seed draws the same edges.
    T_cam_depth : ndarray of float64, shape (4, 4), optional
        Maps points of the depth image to the camera at the instant of the grey image; taken to be
        the same where not given.
    count : int, optional
        N, where it is not that of ``config``.
    noise : DepthNoise, optional
        Of the depth image, which tells a bend of a surface, or its end, from chance.
    worth : ndarray of float32, shape (rows, cols, 4), optional
        What an edge is worth where those are chosen that tell most: see
        `reobservation.Reobserved.worth`; all of them the same where not given.

    Returns
    -------
    EdgePixels
        At most N, each with a depth > 0, in row order.
    """
    wanted = config.count if count is None else count
    count = min(wanted, len(edges)) if wanted else len(edges)
    which, depths = np.empty(count + 1, np.int32), np.empty(count + 1, np.float32)
    radius, gap = edges_config.depth_window_px // 2, edges_config.depth_gap
    by_sides = edges_config.depth_rule == "sides"
    how = radius, gap, by_sides, seed, which, depths
    if config.selection == "informative":
        side = max(int(math.sqrt(depth.size / (CELLS_A_SAMPLE * max(count, 1)))), 1)
        all_alike = np.ones((1, 1, kernels.LINE_DIRECTIONS), np.float32)
        drawn = kernels.draw_informative(
            edges.index,
            edges.du,
            edges.dv,
            depth,
            camera_of(camera),
            all_alike if worth is None else worth,
            side,
            config.tried,
            count,
            *how,
        )
    else:
        drawn = kernels.draw_samples(
            edges.index, depth, config.cell_px, config.per_cell, count, *how
        )
    which, depths = which[:drawn], depths[:drawn]
    table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
    T_depth_cam = AT_ONCE if T_cam_depth is None else se3.inverse(T_cam_depth)
    delayed = T_cam_depth is not None
    described, raw = edges.describe(camera, which, depths), edges.index.take(which)
    if by_sides:
        kernels.fit_edge_depths(
            described.pixels,
            described.gradients,
            raw,
            depth,
            table,
            camera_of(camera),
            T_depth_cam,
            delayed,
            radius,
            gap,
            noise.sigma_z(depths),
            depths,
        )
    elif delayed:
        kernels.delayed_depths(
            edges.index,
            which,
            depth,
            table,
            camera_of(camera),
            T_depth_cam,
            radius,
            gap,
            depths,
        )
    if edges_config.strays == "left-out":
        pixels = described.pixels
        drop_strays(pixels, raw, depth, camera, table, T_depth_cam, delayed, gap, depths)
    agreed = depths > 0
    return described if agreed.all() else described.where(agreed)
