"""What a pose may be off by since the parts of its images were not taken at one instant.

Not in the paper. Rows are read one after the other, depth comes late, and an image is exposed for
some time; what is known of that is made up for, with the velocity from one frame to the next. What
that leaves is the same for all of an image, or all of a row, so that no residual tells of it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.course import Course
from edvo.kit import Kit
from edvo.planes import camera_of
from edvo.registration import Alignment
from edvo.seen import Seen

LASTING_S = 1.0  # that changes of the velocity are averaged over
STRIDE, ENOUGH = 8, 100  # one edge in so many tells what rows do, where these are so many
SAME_S = 1e-3  # instants that are one
WRONG = 0.05  # of the exposure, that an image is dated wrong by (one sigma)


class Timing:
    """Says what instants add to a covariance.

    Parameters
    ----------
    kit : Kit
    course : Course
        Its keyframe, and how fast it goes.
    """

    def __init__(self, kit: Kit, course: Course) -> None:
        self._is_on = kit.config.status.covariance == "instants"
        self._pinhole, self._solver = camera_of(kit.camera), kit.registration.solver
        self._instants, self._course = kit.instants, course
        self._last, self._last_time = np.zeros(6), -math.inf
        self._changes, self._weight = np.zeros((6, 6)), 0.0

    def widened(
        self,
        covariance: NDArray[np.float64],
        seen: Seen,
        alignment: Alignment,
        by_depth: NDArray[np.float64],
        period: float,
        velocity: NDArray[np.float64] | None,
    ) -> NDArray[np.float64]:
        """Add to a covariance what instants may make a pose off by.

        Parameters
        ----------
        covariance : ndarray of float64, shape (6, 6)
            Of all else; see `edvo.uncertainty.Uncertainty`.
        seen : Seen
            The frame.
        alignment : Alignment
            With the keyframe.
        by_depth : ndarray of float64, shape (6, 6)
            What depth tells; see `edvo.uncertainty.Parts`.
        period : float
            Seconds since the last frame.
        velocity : ndarray of float64, shape (6,), or None
            Of the camera at the frame, 1/s; None where it is not known.

        Returns
        -------
        ndarray of float64, shape (6, 6)
        """
        if velocity is None or not self._is_on:
            return covariance
        course, instants = self._course, self._instants
        self._note(course.velocity, seen.frame.timestamp, period)
        before = instants.velocity_of(course.key)
        if before is None:  # it may have gone as fast then
            before = se3.adjoint(alignment.T_ref_cur) @ velocity
        rolling, part = instants.rolling, np.empty((6, 6))
        kernels.instants_part(
            alignment.H,
            self._by_rows(seen, alignment),
            by_depth,
            alignment.T_ref_cur,
            velocity,
            before,
            self._changes,
            rolling.seconds,
            rolling.estimate.doubt,
            instants.depth.of(seen.frame.depth_delay),
            instants.depth.estimate.doubt,
            WRONG * WRONG * instants.exposure.squared,
            part,
        )
        return covariance + part

    def _note(self, velocity: NDArray[np.float64], timestamp: float, period: float) -> None:
        """Take note of how the velocity changes from one frame to the next, if it is the next."""
        if abs(timestamp - period - self._last_time) < SAME_S:
            self._weight = math.exp(-period / LASTING_S) * self._weight + 1
            kernels.note_change(velocity, 1 / self._weight, self._last, self._changes)
        else:
            self._last[:] = velocity
        self._last_time = timestamp

    def _by_rows(self, seen: Seen, alignment: Alignment) -> NDArray[np.float64]:
        """J^T W J times the row, -1/2 to 1/2, of the edges of a registration, px^2."""
        by_rows, squared, score = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
        stride = STRIDE if len(seen.samples) >= STRIDE * ENOUGH else 1
        if alignment.sigma_px:
            kernels.row_equations(
                seen.samples.pixels,
                seen.samples.depths,
                self._course.key.edges.edges.gradients,
                alignment.matches,
                alignment.residuals,
                alignment.trust,
                self._pinhole,
                alignment.T_ref_cur,
                self._solver.weight,
                self._solver.tuning,
                alignment.sigma_px,
                stride,
                by_rows,
                squared,
                score,
            )
        return stride * by_rows
