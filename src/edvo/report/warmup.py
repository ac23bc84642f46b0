"""Compiling the tracker by tracking a little."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from edvo import kernels
from edvo.camera import Camera
from edvo.chamfer import ChamferMap
from edvo.config import Config
from edvo.edges import NO_TABLE, EdgeBuffers, depth_at_edges, edges_to_keep, extract_edges
from edvo.exposure import Exposure
from edvo.frame import Frame, register_depth
from edvo.gathering import carried, unknown
from edvo.look import Look
from edvo.matching import EdgeIndex
from edvo.measuring import taken_by_pose
from edvo.odometry import Odometry
from edvo.planes import camera_of
from edvo.registration import Registration
from edvo.rolling import unroll
from edvo.thresholds import Scales

MOVING = 5  # frames: after so many the instants of depth and rows are measured
DEPTH_DELAY_S = 0.015


def cache_folder() -> Path | None:
    """Say where compiled code is kept.

    Returns
    -------
    pathlib.Path or None
        The folder; None if no folder can be written, so that each process compiles anew.
    """
    path = cast(Any, kernels.align).stats.cache_path
    return None if path is None else Path(path)


def warm_up_reading() -> None:
    """Compile what registers depth to colour, which most recordings do without."""
    camera = Camera(width=16, height=12, fx=13.0, fy=13.0, cx=7.5, cy=5.5)
    register_depth(np.full((12, 16), 2.0, np.float32), camera, camera, np.eye(4))


def warm_up(config: Config) -> None:
    """Compile every kernel that a run with these parameters calls, or load it from the cache.

    Parameters
    ----------
    config : Config
        The parameters.
    """
    # Bars across a plane, seen from two places: enough edges of two directions to register.
    width, height = 160, 120
    camera = Camera(width=width, height=height, fx=130.0, fy=130.0, cx=79.5, cy=59.5)
    depth = np.full((height, width), 2.0, np.float32)
    v, u = np.mgrid[:height, :width]
    odometry = Odometry(camera, config)
    for index in range(MOVING):
        bars = ((u + index) // 16 + v // 16) % 2
        # each a little lighter, so that none counts as the same image as before
        grey = np.ascontiguousarray(60 + 2 * index + 120 * bars, dtype=np.uint8)
        frame = Frame(index / 30.0, grey, depth, depth_delay=DEPTH_DELAY_S)
        odometry.track(frame)
    # and darkness, where depth alone goes on
    odometry.track(Frame(MOVING / 30.0, np.zeros_like(grey), depth))
    # and light again, a second later: a far step
    odometry.track(Frame(MOVING / 30.0 + 1.0, grey + np.uint8(1), depth))
    # and a rolling shutter, which takes longer to be found
    edges = extract_edges(grey, config.edges)
    depths = depth_at_edges(frame.depth, edges.index, config.edges)
    described = edges.describe(camera)
    unroll(described, 0.0, np.zeros(6), camera_of(camera), depths)
    # and what the camera carries with it, which takes longer, too
    marks, room, *counts = np.zeros((5, height, width), np.uint8)
    view = NO_TABLE, frame.depth, camera_of(camera), np.eye(4), marks, 4.0
    kernels.count_stays(edges.index, edges.du, edges.dv, *view, room, np.array(counts), 1)
    # and faint edges, of which a keyframe has more
    buffers = EdgeBuffers(height, width)
    faint = replace(extract_edges(grey, config.edges, buffers), scale=0.7, scales=Scales(1.0, 0.5))
    edges_to_keep(faint, config.edges, buffers, 1.0)
    # and images that are smeared
    extract_edges(grey, config.edges, buffers, passes=1)
    # and bands that a lamp makes of rows
    bands = np.repeat((120 + 40 * np.sin(np.arange(height) / 12))[:, None], width, axis=1)
    extract_edges(bands.astype(np.uint8), config.edges)
    # and motion that has smeared them, which takes longer to be found
    known = ["motion.exposure=known", "motion.exposure_s=0.02", "registration.profile_spread=3"]
    Exposure(camera, config.with_overrides(known)).sharpness(described, np.zeros(6))
    # and what a number of the camera would move
    taken_by_pose(np.eye(6), np.zeros(6))
    # and a lamp that moves, whose edges a keyframe gathers
    with_depth = replace(described, depths=depths)
    unknown(EdgeIndex(described), carried(with_depth, np.eye(4), camera), camera)
    # and what a trial of readouts costs, how far along a motion edges tell, and which are amiss
    registration = Registration(camera, config.matching, config.registration)
    found = registration.align(EdgeIndex(described), with_depth, np.eye(4)[None])
    registration.cost(found, 1.0)
    ChamferMap(described, camera).stands_out(with_depth, np.eye(4), np.zeros(6))
    given = (
        with_depth.points(camera),
        described.gradients,
        described.gradients,
        found.matches,
        found.residuals,
        found.trust,
        camera_of(camera),
        found.T_ref_cur,
        kernels.Places(1.0, 1.0, 1.0),
    )
    kernels.find_amiss(*given, np.empty((len(described), 6)), np.empty(len(described), np.uint8))
    # and what a lost camera asks for
    look = Look(described, camera)
    look.likeness(look)
