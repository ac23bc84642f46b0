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
from edvo.config import Config, EdgesConfig
from edvo.edges import EdgeBuffers, EdgePixels, extract_edges
from edvo.gathering import carried
from edvo.keyframes import Keyframe
from edvo.matching import EdgeIndex
from edvo.planes import PlaneFitter
from edvo.registration import Registration
from edvo.seen import Seen
from edvo.uncertainty import (
    BOUNDS,
    PER_SQUARES,
    PRODUCTS,
    Uncertainty,
    degenerate_directions,
    in_current_camera,
)

FARTHEST_M, PER_LOG = 10.0, 85.0  # depth as grey levels: from black on, and so many to a factor e
# How the edges of that are found, whatever is set for those of images
EDGES = EdgesConfig(bands="kept", max_noise=0.0)
REACH_PX = 3  # as far depth has to be known round a contour, and the nearer side is looked for
FEWEST, MOST = 60, 1500  # contour pixels that tell a pose; that are taken for it
FIRST_SIGMA_PX = 2.0  # along what was open they are off by pixels, and across it they fit
AGREEING = 0.5  # of them, that have to lie where those of the keyframe do
KEPT = 3  # keyframes whose depth is kept


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
        Its ``planes.contours``.
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
        self._is_on = config.planes.contours == "followed" and fitter.is_on
        self._camera, self._term = camera, fitter.term
        self._registration, self._uncertainty = registration, uncertainty
        self._buffers: EdgeBuffers | None = None  # hardly any run needs them
        self.forget()

    def forget(self) -> None:
        """Drop all that is held."""
        self._held: list[_Held] = []

    def hold(self, keyframe: Keyframe, seen: Seen) -> None:
        """Remember the depth of a keyframe, and of the two before it.

        Parameters
        ----------
        keyframe : Keyframe
        seen : Seen
            What it was made of, its images kept.
        """
        if self._is_on:
            held = _Held(keyframe.index, seen.frame.depth, seen.T_cam_depth)
            self._held = [held, *self._held[: KEPT - 1]]

    def move(self, keyframe: Keyframe, T_cam_depth: NDArray[np.float64] | None) -> None:
        """Take note that the depth of a keyframe was taken elsewhere than was thought.

        Parameters
        ----------
        keyframe : Keyframe
        T_cam_depth : ndarray of float64, shape (4, 4), or None
            See `edvo.seen.Seen`.
        """
        for held in self._held:
            if held.index == keyframe.index:
                held.T_cam_depth, held.found = T_cam_depth, None

    def may_tell(self, T_key_cur: NDArray[np.float64], covariance: NDArray[np.float64]) -> bool:
        """Whether a motion may be open, told fast where none is, as of nearly all frames.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
        covariance : ndarray of float64, shape (6, 6)
            As for `along`.

        Returns
        -------
        bool
        """
        if not self._is_on:
            return False
        own = in_current_camera(covariance, T_key_cur)
        return bool(own.diagonal() @ PER_SQUARES >= 1)  # below, each eigenvalue is too

    def along(
        self,
        key: Keyframe,
        seen: Seen,
        T_key_cur: NDArray[np.float64],
        covariance: NDArray[np.float64],
        T_key_expected: NDArray[np.float64],
        stray_m: float,
    ) -> Along | None:
        """Move a pose along what is not constrained to where contours fit.

        Parameters
        ----------
        key : Keyframe
        seen : Seen
            The frame.
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it was found.
        covariance : ndarray of float64, shape (6, 6)
            Of that.
        T_key_expected : ndarray of float64, shape (4, 4)
            Where it was expected: contours that lead away from there are of what moves by itself.
        stray_m : float
            Metres; so far they may, or as far as it was found away from there, if that is more.

        Returns
        -------
        Along or None
            None where all is constrained, or contours do not tell what is not: there are hardly
            any, they do not fit, run along that motion themselves, or are not the scene's; where
            depth repeats, or a part of the view is known to move or to be the camera's own; and
            of a keyframe that is not one of the last three.
        """
        held = next((each for each in self._held if each.index == key.index), None)
        if held is None or seen.is_stale or seen.without_movers or seen.is_parted:
            return None
        own = in_current_camera(covariance, T_key_cur) / PRODUCTS
        values, ways = np.linalg.eigh(own)
        loose = ways[:, values > 1]
        registered = self._registered(held, key, seen, T_key_cur) if loose.size else None
        if registered is None:
            return None
        T_key_found, known = registered
        variances, mix = np.linalg.eigh(loose.T @ (known / PRODUCTS) @ loose)
        told, variances = loose @ mix[:, variances < 1], variances[variances < 1]
        if not told.size:
            return None
        way = se3.log(se3.inverse(T_key_cur) @ T_key_found) / BOUNDS
        T = T_key_cur @ se3.exp(told @ (told.T @ way) * BOUNDS)
        most = max(se3.distance(T_key_cur, T_key_expected), stray_m)
        if se3.distance(T, T_key_expected) > most:
            return None
        sure = np.linalg.inv(np.linalg.inv(own) + told / variances @ told.T) * PRODUCTS
        in_key = np.empty((6, 6))
        kernels.carry_covariance(T, sure, in_key)
        return Along(T, in_key)

    def _registered(
        self, held: _Held, key: Keyframe, seen: Seen, T_key_start: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Register contours and planes, if they fit.

        Returns T_key_cur, and its covariance in the camera of the frame.
        """
        if held.found is None:
            held.found = self._registration.index(self.find(held.depth, held.T_cam_depth))
        samples = self.find(seen.frame.depth, seen.T_cam_depth)
        if min(len(samples), len(held.found.edges)) < FEWEST:
            return None
        samples = samples.every(math.ceil(len(samples) / MOST))
        start, surface = T_key_start[None], (key.planes, seen.points, self._term)
        found = self._registration.align(
            held.found, samples, start, *surface, first_sigma_px=FIRST_SIGMA_PX
        )
        if not found.converged or found.inliers < max(AGREEING * len(samples), FEWEST):
            return None
        covariance = self._uncertainty.covariance(held.found, samples, *surface, found)
        return found.T_ref_cur, in_current_camera(covariance, found.T_ref_cur)

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
        edges = extract_edges(_nearness(filled), EDGES, self._buffers)
        depths = np.empty(len(edges), np.float32)
        kernels.nearer_sides(filled, edges.index, REACH_PX, depths)
        which = np.flatnonzero(depths).astype(np.int32)
        found = edges.describe(self._camera, which, depths[which])
        found = EdgePixels(found.pixels, found.gradients, found.depths)  # they look like none
        return found if T_cam_depth is None else carried(found, T_cam_depth, self._camera)


def _nearness(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depth as grey levels, by its logarithm: a step by the same factor is as high near and far."""
    levels = np.maximum(depth, np.float32(1e-3))
    np.log(levels, out=levels)
    levels *= -PER_LOG
    levels += PER_LOG * math.log(FARTHEST_M)
    levels[depth == 0] = 0  # as if far away
    return np.clip(levels, 0, 255, out=levels).astype(np.uint8)
