"""Compiling registration in a process of its own: two fifths of all there is to compile."""

from typing import Any, cast

import numpy as np

from edvo import kernels
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.matching import EdgeIndex
from edvo.planes import NO_PLANES, NO_POINTS
from edvo.registration import EDGES_ALONE, Registration
from edvo.report.elsewhere import Elsewhere
from edvo.report.warmup import CAMERA, FAR_M
from edvo.uncertainty import Uncertainty

STEP_PX = 8


def warm_up_registering() -> None:
    """Compile what registers edges, whatever the parameters, and tells what that is worth.

    Of edges made by hand: so nothing has to be compiled that finds them.
    """
    config, edges = Config(), _edges()
    registration = Registration(CAMERA, config.matching, config.registration)
    index = EdgeIndex(edges)
    found = registration.align(index, edges, np.eye(4)[None])
    uncertainty = Uncertainty(CAMERA, config, registration.solver)
    uncertainty.covariance(index, edges, NO_PLANES, NO_POINTS, EDGES_ALONE, found)
    uncertainty.evidence.amiss(edges, edges, found)


def _edges() -> EdgePixels:
    """Edges of two directions across a plane."""
    v, u = np.mgrid[STEP_PX : CAMERA.height : STEP_PX, STEP_PX : CAMERA.width : STEP_PX]
    upright = ((u + v) // STEP_PX % 2).ravel()
    return EdgePixels(
        np.column_stack([u.ravel(), v.ravel()]).astype(np.float32),
        np.column_stack([upright, 1 - upright]).astype(np.float32),
        np.full(u.size, FAR_M, np.float32),
        np.zeros((u.size, 2), np.float32),
    )


def registration_compiling_aside() -> Elsewhere:
    """Give the process that compiles registration; it is not started yet.

    Returns
    -------
    Elsewhere
    """
    return Elsewhere(warm_up_registering)


def is_registration_here() -> bool:
    """Whether this process has it, compiled or loaded.

    Returns
    -------
    bool
    """
    return bool(cast(Any, kernels.align).signatures)
