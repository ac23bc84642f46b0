"""Depth alone: frames without edges, held to the planes of the keyframe.

Not in the paper. A blank wall, or darkness, shows no edges, but depth is still measured. A wall
says how far away the camera is and how it is tilted, the corner of a room says everything. Only
what depth constrains is moved; in all else the camera stays where it was expected.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.keyframes import Keyframe
from edvo.planes import DepthTerm, PlanePoints, camera_of
from edvo.registration import REASONS, Alignment
from edvo.scatter import fitting_depth
from edvo.uncertainty import (
    Uncertainty,
    constrained_directions,
    degenerate_directions,
    in_current_camera,
)

# Least scales of the residuals, in units of the noise, one after the other. A plane that is alone
# in saying something is not the median: from a bad start it must not be cut off as an outlier.
SCALES = (8.0, 2.0, 0.5)
STOP = 0.003  # of what may be off: a smaller step is not worth another
HARDLY_ANY = 5  # times the fewest edges that can be registered: too few to doubt depth by


class DepthAlone:
    """Registers frames by their depth.

    Parameters
    ----------
    camera : Camera
        Of all frames.
    solver : kernels.Solver
        Of the registration: the limits of the descent.
    term : DepthTerm
        How points are compared with planes.
    uncertainty : Uncertainty
        Says what is constrained.
    """

    def __init__(
        self, camera: Camera, solver: kernels.Solver, term: DepthTerm, uncertainty: Uncertainty
    ) -> None:
        self._pinhole = camera_of(camera)
        self._solver = solver
        self._term = term
        self._uncertainty = uncertainty

    def has_to_tell(self, samples: EdgePixels) -> bool:
        """Whether a frame has hardly any edges with depth.

        Parameters
        ----------
        samples : EdgePixels
            Of the frame.

        Returns
        -------
        bool
        """
        return len(samples) < HARDLY_ANY * self._solver.min_matches

    def align(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        T_key_start: NDArray[np.float64],
    ) -> Alignment:
        """Find what depth says of the motion since a keyframe.

        Parameters
        ----------
        key : Keyframe
        samples : EdgePixels
            N edges of the frame, which play no role, however few they are.
        points : PlanePoints
            Of the frame.
        T_key_start : ndarray of float64, shape (4, 4)
            Where the camera is expected.

        Returns
        -------
        Alignment
            Without matches of edges; ``too few matches`` where hardly a point has a plane.
        """
        T, iterations, reason = T_key_start.copy(), 0, kernels.EXHAUSTED
        none = samples.first(0)
        for scale in SCALES:
            found = self._state(key, none, points, T, scale, iterations, reason)
            if found.plane_points < self._term.min_points:
                break
            covariance = self.covariance(key, none, points, found)
            # Across the camera's own axes, not the keyframe's: as it tilts it stays in its place.
            basis = se3.adjoint(T) @ constrained_directions(in_current_camera(covariance, T))
            if basis.size:
                steps, reason = kernels.descend_on_planes(
                    key.planes,
                    points,
                    self._pinhole,
                    self._term,
                    np.ascontiguousarray(basis),
                    scale,
                    self._solver,
                    STOP,
                    T,
                )
                iterations += steps
        return self._state(key, samples, points, T, SCALES[-1], iterations, reason)

    def covariance(
        self, key: Keyframe, samples: EdgePixels, points: PlanePoints, found: Alignment
    ) -> NDArray[np.float64]:
        """Say how certain that is.

        Parameters
        ----------
        key, samples, points
            As `align` was given them.
        found : Alignment
            What it gave.

        Returns
        -------
        ndarray of float64, shape (6, 6)
            Of ``T_ref_cur``, as `Uncertainty.covariance` gives it.
        """
        return self._uncertainty.covariance(
            key.edges, samples, key.planes, points, self._term, found
        )

    def lead(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        starts: Sequence[NDArray[np.float64]],
    ) -> Alignment | None:
        """Find where most of depth fits, of where it leads from several starts.

        Parameters
        ----------
        key, samples, points
            See `align`.
        starts : sequence of ndarray of float64, shape (4, 4)

        Returns
        -------
        Alignment or None
            None where depth leaves a motion open there.
        """
        parts = key, samples, points
        level = max((self.align(*parts, T_key_cur) for T_key_cur in starts), key=fitting_depth)
        own = in_current_camera(self.covariance(*parts, level), level.T_ref_cur)
        return None if len(degenerate_directions(own)) else level

    def at(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        T_key_cur: NDArray[np.float64],
        found: Alignment,
    ) -> Alignment:
        """Say what depth is like at another pose than the one that it led to.

        Parameters
        ----------
        key, samples, points
            As `align` was given them.
        T_key_cur : ndarray of float64, shape (4, 4)
        found : Alignment
            What it gave, which led there.

        Returns
        -------
        Alignment
        """
        reason = kernels.CONVERGED if found.converged else kernels.EXHAUSTED
        return self._state(key, samples, points, T_key_cur, SCALES[-1], found.iterations, reason)

    def _state(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        T: NDArray[np.float64],
        scale: float,
        iterations: int,
        reason: int,
    ) -> Alignment:
        """What is found at a pose, as a registration without edges."""
        near, n = kernels.new_plane_matches(len(points.sigma)), len(samples)
        T = T.copy()
        kernels.orthonormalize(T)
        count, fitting = self._match(key, points, T, near), 0
        sigma, cost, H, b = 1.0, 0.0, np.zeros((6, 6)), np.empty(6)
        if count:
            sigma = kernels.median_scale(near.residuals, count, scale)
            kernels.plane_equations(near, count, sigma, H, b)
            cost = kernels.plane_cost(near, count, len(points.sigma), sigma) / len(points.sigma)
            fitting = kernels.count_fitting(near.residuals, count, sigma)
        if fitting < self._term.min_points:
            reason = kernels.TOO_FEW
        return Alignment(
            T_ref_cur=T,
            H=H / sigma**2,
            matches=np.full(n, kernels.NO_MATCH, np.int32),
            residuals=np.full(n, np.nan),
            trust=np.ones(n),
            pixels=samples.pixels,
            references=np.full((n, 2), np.nan, np.float32),
            inliers=0,
            agreeing=0,
            sigma_px=0.0,
            plane_points=fitting,
            plane_inliers=fitting,
            plane_area=fitting * points.step_px**2 / (self._pinhole.width * self._pinhole.height),
            sigma_depth=sigma,
            depth_balance=1.0,
            cost=cost,
            iterations=iterations,
            converged=reason in (kernels.CONVERGED, kernels.STALLED),
            reason=REASONS[reason],
            history=np.empty((0, kernels.HISTORY)),
        )

    def _match(
        self,
        key: Keyframe,
        points: PlanePoints,
        T: NDArray[np.float64],
        near: kernels.PlaneMatches,
    ) -> int:
        return kernels.match_planes(key.planes, points, self._pinhole, T, self._term, near)
