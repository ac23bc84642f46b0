"""Sub-sampling of edge pixels, spread over the image by a grid (§IV-A)."""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import EdgesConfig, SamplingConfig
from edvo.edges import NO_TABLE, EdgeImage, EdgePixels
from edvo.planes import camera_of
from edvo.sensor import DEPTH_NOISE, DepthNoise

AT_ONCE = np.eye(4)


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
) -> EdgePixels:
    """Draw N edges with depth: so many from each grid cell, the rest at random from all.

    Depth is looked up only for the edges that are drawn (see ``edges.depth_at_edges``); one
    without depth is passed over and another drawn. By the rule ``sides`` one that has a depth at
    its pixel is drawn by that; where nothing around agrees with it, it is left out, and no other
    drawn for it.

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

    Returns
    -------
    EdgePixels
        At most N, each with a depth > 0, in row order.
    """
    wanted = config.count if count is None else count
    count = min(wanted, len(edges)) if wanted else len(edges)
    which = np.empty(count, np.int32)
    depths = np.empty(count, np.float32)
    radius, gap = edges_config.depth_window_px // 2, edges_config.depth_gap
    by_sides = edges_config.depth_rule == "sides"
    drawn = kernels.draw_samples(
        edges.index,
        depth,
        config.cell_px,
        config.per_cell,
        count,
        radius,
        gap,
        by_sides,
        seed,
        which,
        depths,
    )
    which, depths = which[:drawn], depths[:drawn]
    table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
    T_depth_cam = AT_ONCE if T_cam_depth is None else se3.inverse(T_cam_depth)
    delayed = T_cam_depth is not None
    if not by_sides:
        if delayed:
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
        return edges.describe(camera, which, depths)
    described = edges.describe(camera, which, depths)
    kernels.fit_edge_depths(
        described.pixels,
        described.gradients,
        edges.index[which],
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
    agreed = depths > 0
    return described if agreed.all() else described.where(agreed)
