"""Compiling the tracker by tracking a little.

In two parts, so that another process can meanwhile compile what the second one begins with: see
`edvo.report.warmup_aside`.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.chamfer import ChamferMap
from edvo.clock import no_clock
from edvo.config import Config
from edvo.depth_alone import STOP
from edvo.edges import (
    NO_TABLE,
    EdgeBuffers,
    EdgeImage,
    EdgePixels,
    depth_at_edges,
    edges_to_keep,
    extract_edges,
)
from edvo.exposure import Exposure
from edvo.frame import Frame, register_depth
from edvo.front_end import FrontEnd
from edvo.gathering import carried, unknown
from edvo.look import Look
from edvo.matching import EdgeIndex
from edvo.measuring import taken_by_pose
from edvo.odometry import Odometry
from edvo.planes import NO_PLANES, NO_POINTS, PlaneFitter, camera_of
from edvo.registration import Registration
from edvo.rolling import unroll
from edvo.thresholds import Scales
from edvo.witness import Witness

WIDTH, HEIGHT = 160, 120
CAMERA = Camera(width=WIDTH, height=HEIGHT, fx=130.0, fy=130.0, cx=79.5, cy=59.5)
FAR_M = 2.0  # of the plane that is seen
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
    warm_up_seeing(config)
    warm_up_tracking(config)


def warm_up_seeing(config: Config) -> None:
    """Compile what makes edges and surfaces of images, and whatever needs no registration.

    Parameters
    ----------
    config : Config
        The parameters.
    """
    registration = Registration(CAMERA, config.matching, config.registration)
    fitter, exposure = PlaneFitter(CAMERA, config.planes), Exposure(CAMERA, config)
    front_end = FrontEnd(CAMERA, config, registration, fitter, no_clock, exposure)
    frame = _frame(0)
    for T_cam_depth in (None, se3.exp(np.array([0.001, 0.0, 0.0, 0.0, 0.0, 0.0]))):
        seen = front_end.see(frame, 0, T_cam_depth)
        front_end.keyframe(seen, 0, np.eye(4), 0)
    Witness(CAMERA, config.planes.sensor).surface(frame.depth)
    # and a rolling shutter, which takes longer to be found
    edges = extract_edges(frame.grey, config.edges)
    described = _described(edges, frame, config)
    unroll(described, 0.0, np.zeros(6), camera_of(CAMERA), described.depths)
    # and what the camera carries with it, which takes longer, too
    marks, room, *counts = np.zeros((5, HEIGHT, WIDTH), np.uint8)
    view = NO_TABLE, frame.depth, camera_of(CAMERA), np.eye(4), marks, 4.0
    kernels.count_stays(edges.index, edges.du, edges.dv, *view, room, np.array(counts), 1)
    # and faint edges, of which a keyframe has more
    buffers = EdgeBuffers(HEIGHT, WIDTH)
    faint = replace(
        extract_edges(frame.grey, config.edges, buffers), scale=0.7, scales=Scales(1.0, 0.5)
    )
    edges_to_keep(faint, config.edges, buffers, 1.0)
    # and images that are smeared
    extract_edges(frame.grey, config.edges, buffers, passes=1)
    # and bands that a lamp makes of rows
    bands = np.repeat((120 + 40 * np.sin(np.arange(HEIGHT) / 12))[:, None], WIDTH, axis=1)
    extract_edges(bands.astype(np.uint8), config.edges)
    # and motion that has smeared them, which takes longer to be found
    known = ["motion.exposure=known", "motion.exposure_s=0.02", "registration.profile_spread=3"]
    Exposure(CAMERA, config.with_overrides(known)).sharpness(described, np.zeros(6))
    # and what a number of the camera would move
    taken_by_pose(np.eye(6), np.zeros(6))
    # and a lamp that moves, whose edges a keyframe gathers
    unknown(EdgeIndex(described), carried(described, np.eye(4), CAMERA), CAMERA)
    # and what a lost camera asks for
    look = Look(described, CAMERA)
    look.likeness(look)
    ChamferMap(described, CAMERA).beside(described, np.eye(4)[None])
    # and where depth alone goes on, and when it was taken
    surface = NO_PLANES, NO_POINTS, camera_of(CAMERA)
    term, solver, T, H = fitter.term, registration.solver, np.eye(4), np.eye(6)
    kernels.descend_on_planes(*surface, term, H, 1.0, solver, STOP, T)
    kernels.depth_equations(*surface, T, term, 1.0, 1.0, H, np.empty(6))


def warm_up_tracking(config: Config) -> None:
    """Compile what registers frames and judges that.

    Parameters
    ----------
    config : Config
        The parameters.
    """
    odometry = Odometry(CAMERA, config)
    frame = _frame(0)
    for index in range(MOVING):
        frame = _frame(index)
        odometry.track(frame)
    # and darkness, where depth alone goes on
    odometry.track(Frame(MOVING / 30.0, np.zeros_like(frame.grey), frame.depth))
    # and light again, a second later: a far step
    odometry.track(Frame(MOVING / 30.0 + 1.0, frame.grey + np.uint8(1), frame.depth))
    # and what a trial of readouts costs, how far along a motion edges tell, and which are amiss
    described = _described(extract_edges(frame.grey, config.edges), frame, config)
    registration = Registration(CAMERA, config.matching, config.registration)
    found = registration.align(EdgeIndex(described), described, np.eye(4)[None])
    registration.cost(found, 1.0)
    ChamferMap(described, CAMERA).stands_out(described, np.eye(4), np.zeros(6))
    given = (
        described.points(CAMERA),
        described.gradients,
        described.gradients,
        found.matches,
        found.residuals,
        found.trust,
        camera_of(CAMERA),
        found.T_ref_cur,
        kernels.Places(1.0, 1.0, 1.0),
    )
    kernels.find_amiss(*given, np.empty((len(described), 6)), np.empty(len(described), np.uint8))


def _frame(index: int) -> Frame:
    """Bars across a plane, seen from another place: edges of two directions, to register by.

    Each is a little lighter, so that none counts as the same image as before.
    """
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    bars = ((u + index) // 16 + v // 16) % 2
    grey = np.ascontiguousarray(60 + 2 * index + 120 * bars, dtype=np.uint8)
    depth = np.full((HEIGHT, WIDTH), FAR_M, np.float32)
    return Frame(index / 30.0, grey, depth, depth_delay=DEPTH_DELAY_S)


def _described(edges: EdgeImage, frame: Frame, config: Config) -> EdgePixels:
    """All edges of a frame, with depth."""
    depths = depth_at_edges(frame.depth, edges.index, config.edges)
    return replace(edges.describe(CAMERA), depths=depths)
