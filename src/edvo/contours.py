"""Contours of depth: along what neither edges nor planes tell, they say where a camera is.

Not in the paper. In darkness, and where white things stand before white walls, planes leave motions
open along which no edge is seen. But where a surface ends before another, depth steps; these steps
are found as edges are, in the logarithm of depth, and registered as such with those of the keyframe
and its planes. What that tells is taken along the open motions alone: depth errs most at contours.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgeBuffers, EdgePixels, extract_edges
from edvo.keyframes import Keyframe
from edvo.matching import EdgeIndex
from edvo.planes import PlaneFitter
from edvo.registration import Registration
from edvo.seen import Seen
from edvo.uncertainty import (
    BOUNDS,
    PER_SQUARES,
    Uncertainty,
    degenerate_directions,
    in_current_camera,
)

FARTHEST_M, PER_LOG = 10.0, 85.0  # depth as grey levels: from black on, and so many to a factor e
STEP, REACH_PX = 1.04, 3  # by what factor depth has to rise, within how many pixels
FEWEST, MOST = 60, 1500  # contour pixels that tell a pose; that are taken for it
FIRST_SIGMA_PX = 2.0  # along what was open they are off by pixels, and across it they fit
AGREEING = 0.5  # of them, that have to lie where those of the keyframe do
_BOUNDS = np.outer(BOUNDS, BOUNDS)


class Along(NamedTuple):
    """Where a camera is, contours taken into account.

    Attributes
    ----------
    T_key_cur : ndarray of float64, shape (4, 4)
    covariance : ndarray of float64, shape (6, 6)
        Of that; see `edvo.uncertainty.Uncertainty`.
    """

    T_key_cur: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def leaves_open(self) -> bool:
        """Whether contours do not tell all of what was not constrained."""
        own = in_current_camera(self.covariance, self.T_key_cur)
        return len(degenerate_directions(own)) > 0


@dataclass(slots=True)
class _Held:
    """What a keyframe's contours are found in, once they are asked for."""

    index: int
    depth: NDArray[np.float32]
    T_cam_depth: NDArray[np.float64] | None
    found: EdgeIndex | None = None


class Contours:
    """Moves poses along what is not constrained to where the contours of a keyframe lie.

    Parameters
    ----------
    camera : Camera
        Of all frames.
    config : Config
        Its ``planes.contours`` and ``edges``.
    registration : Registration
    fitter : PlaneFitter
        Its term: how points are compared with planes.
    uncertainty : Uncertainty
        Says what contours tell.
    """

    def __init__(
        self,
        camera: Camera,
        config: Config,
        registration: Registration,
        fitter: PlaneFitter,
        uncertainty: Uncertainty,
    ) -> None:
        is_known = config.status.covariance != "none"
        self._is_on = config.planes.contours == "followed" and fitter.is_on and is_known
        plain = {"extractor": "canny", "bands": "kept", "max_noise": 0.0}
        self._edges = config.edges.model_copy(update=plain)
        self._camera, self._term = camera, fitter.term
        self._registration, self._uncertainty = registration, uncertainty
        self._buffers: EdgeBuffers | None = None  # hardly any run needs them
        self._held: _Held | None = None

    def hold(self, keyframe: Keyframe, seen: Seen) -> None:
        """Remember the depth of a keyframe.

        Parameters
        ----------
        keyframe : Keyframe
        seen : Seen
            What it was made of, its images kept.
        """
        if self._is_on:
            self._held = _Held(keyframe.index, seen.frame.depth, seen.T_cam_depth)

    def along(
        self,
        key: Keyframe,
        seen: Seen,
        T_key_cur: NDArray[np.float64],
        covariance: NDArray[np.float64],
    ) -> Along | None:
        """Move a pose along what is not constrained to where contours fit.

        Parameters
        ----------
        key : Keyframe
        seen : Seen
            The frame, its depth a new one.
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it was found.
        covariance : ndarray of float64, shape (6, 6)
            Of that.

        Returns
        -------
        Along or None
            None where all is constrained, or contours do not tell what is not: there are hardly
            any, they do not fit, or run along that motion themselves.
        """
        held = self._held
        if not self._is_on or held is None or held.index != key.index:
            return None
        own = in_current_camera(covariance, T_key_cur)
        if own.diagonal() @ PER_SQUARES < 1:  # as then is each eigenvalue
            return None
        own /= _BOUNDS
        values, ways = np.linalg.eigh(own)
        loose = ways[:, values > 1]
        found = self._registered(held, key, seen, T_key_cur) if loose.size else None
        if found is None:
            return None
        variances, mix = np.linalg.eigh(loose.T @ (found.covariance / _BOUNDS) @ loose)
        told, variances = loose @ mix[:, variances < 1], variances[variances < 1]
        if not told.size:
            return None
        way = se3.log(se3.inverse(T_key_cur) @ found.T_key_cur) / BOUNDS
        T = T_key_cur @ se3.exp(told @ (told.T @ way) * BOUNDS)
        sure = np.linalg.inv(np.linalg.inv(own) + told / variances @ told.T) * _BOUNDS
        carried = np.empty((6, 6))
        kernels.carry_covariance(T, sure, carried)
        return Along(T, carried)

    def _registered(
        self, held: _Held, key: Keyframe, seen: Seen, T_key_start: NDArray[np.float64]
    ) -> Along | None:
        """Register contours and planes, if they fit; the covariance is in the own camera."""
        if held.found is None:
            held.found = self._registration.index(self.find(held.depth, held.T_cam_depth))
        samples = self.find(seen.frame.depth, seen.T_cam_depth)
        if min(len(samples), len(held.found.edges)) < FEWEST:
            return None
        samples = samples.every(math.ceil(len(samples) / MOST))
        surface = key.planes, seen.points, self._term
        start = T_key_start[None]
        found = self._registration.align(
            held.found, samples, start, *surface, first_sigma_px=FIRST_SIGMA_PX
        )
        if not found.converged or found.inliers < max(AGREEING * len(samples), FEWEST):
            return None
        covariance = self._uncertainty.covariance(held.found, samples, *surface, found)
        return Along(found.T_ref_cur, in_current_camera(covariance, found.T_ref_cur))

    def find(
        self, depth: NDArray[np.float32], T_cam_depth: NDArray[np.float64] | None = None
    ) -> EdgePixels:
        """Find the contours of a depth image.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.
        T_cam_depth : ndarray of float64, shape (4, 4), optional
            Maps its points to the camera at the instant of the grey image; taken to be the same
            where not given.

        Returns
        -------
        EdgePixels
            With the depths of the nearer side, and gradients that point there.
        """
        if self._buffers is None:
            self._buffers = EdgeBuffers(*depth.shape)
        filled = np.empty(depth.shape, np.float32)
        kernels.fill_gaps(depth, filled)
        nearness = np.log(FARTHEST_M / np.maximum(filled, np.float32(1e-3)))
        levels = np.where(filled > 0, np.clip(PER_LOG * nearness, 0, 255), 0).astype(np.uint8)
        edges = extract_edges(levels, self._edges, self._buffers)
        depths = np.empty(len(edges), np.float32)
        kernels.nearer_sides(filled, edges.index, REACH_PX, STEP, depths)
        which = np.flatnonzero(depths).astype(np.int32)
        found = edges.describe(self._camera, which, depths[which])
        found = EdgePixels(found.pixels, found.gradients, found.depths)  # they look like none
        return found if T_cam_depth is None else self._moved(found, T_cam_depth)

    def _moved(self, edges: EdgePixels, T_cam_depth: NDArray[np.float64]) -> EdgePixels:
        """Put contours where they would be seen from elsewhere."""
        camera = self._camera
        x, y, z = (edges.points(camera) @ T_cam_depth[:3, :3].T + T_cam_depth[:3, 3]).T
        pixels = np.column_stack((camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy))
        return EdgePixels(pixels.astype(np.float32), edges.gradients, z.astype(np.float32))
