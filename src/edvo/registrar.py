"""Registering frames with the keyframe that the camera is at."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.course import Course
from edvo.edges import EdgePixels
from edvo.kit import Kit
from edvo.planes import DepthTerm
from edvo.registration import AT_ONCE, Alignment
from edvo.seen import Seen

WIDE_PX = 2.0  # scale of a second look: of a turn that was not foreseen by so much


class Registrar:
    """Registers frames with the keyframe, by what is known of depth, rows and errors by now.

    Parameters
    ----------
    kit : Kit
    course : Course
        Where the camera is and goes, and its keyframe.

    Attributes
    ----------
    begins_narrow : bool
        Whether registration begins by a scale so narrow that there is a wider one to begin with.
    """

    def __init__(self, kit: Kit, course: Course) -> None:
        self._registration, self._fitter = kit.registration, kit.fitter
        self._shared, self._instants = kit.shared, kit.instants
        self._course = course
        two_stages = kit.config.matching.criterion == "robust-then-normal"
        self.begins_narrow = two_stages and kit.config.registration.first_sigma_px < WIDE_PX

    def edges(self, seen: Seen) -> EdgePixels:
        """Give the edges of the keyframe that a frame is registered with.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        EdgePixels
        """
        return self._course.key.edges_for(near=seen.is_near).edges

    def term(self, timestamp: float) -> DepthTerm:
        """Say what depth counts.

        Parameters
        ----------
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        DepthTerm
        """
        return self._shared.term(self._fitter.term, self._course.period(timestamp))

    def register(
        self,
        seen: Seen,
        starts: NDArray[np.float64],
        term: DepthTerm,
        max_sigma_px: float = math.inf,
        *,
        far: bool = False,
        at_once: bool = False,
        first_sigma_px: float = 0.0,
        factors: NDArray[np.float64] | None = None,
    ) -> Alignment:
        """Register a frame with the keyframe.

        Depth that repeats lies where the camera is expected: that is one guess, however many points
        it has. How far off the planes it is says nothing of depth.

        Parameters
        ----------
        seen : Seen
        starts : ndarray of float64, shape (N, 4, 4)
            Poses relative to the keyframe, the likeliest first.
        term : DepthTerm
            See `term`.
        max_sigma_px, first_sigma_px : float
        far : bool
            See `Registration.align`.
        at_once : bool
            Whether its parts stay where they were expected, and count alike: where it was last,
            from which they are moved on, is wrong.
        factors : ndarray of float64, shape (N,), optional
            What each sample counts, as a factor on residual and derivative.

        Returns
        -------
        Alignment
        """
        key = self._course.key
        if seen.is_stale:
            term = term._replace(weight=term.weight / max(len(seen.points.sigma), 1))
        lag = AT_ONCE if at_once else self._lag(seen)
        if factors is not None:
            lag = lag._replace(sharp=lag.sharp * factors if len(lag.sharp) else factors)
        found = self._registration.align(
            key.edges_for(near=seen.is_near),
            seen.samples,
            starts,
            key.planes,
            seen.points,
            term,
            lag,
            max_sigma_px=max_sigma_px,
            far=far,
            first_sigma_px=first_sigma_px,
        )
        if not seen.is_stale:
            return found
        balance = found.depth_balance / found.sigma_depth**2
        return replace(found, sigma_depth=1.0, depth_balance=balance, is_stale=True)

    def widely(self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm) -> Alignment:
        """Register so that edges count which are pixels off at first.

        Parameters
        ----------
        seen : Seen
        starts : ndarray of float64, shape (N, 4, 4)
        term : DepthTerm

        Returns
        -------
        Alignment
        """
        return self.register(seen, starts, term, first_sigma_px=WIDE_PX)

    def _lag(self, seen: Seen) -> kernels.Lag:
        """When depth and rows were taken, as shares of the time since the last frame."""
        course, timestamp = self._course, seen.frame.timestamp
        if not course.follows(timestamp):
            return AT_ONCE
        period = course.period(timestamp)
        lag = self._instants.lag(seen, course.key, course.T_key_last, period, course.velocity)
        return self._instants.slackened(lag, seen, period, course.acceleration)
