"""Going on blind: frames without edges, followed by what depth alone says of them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.contours import Along
from edvo.course import FADING_S, Course
from edvo.doubt import Doubt
from edvo.frame import Frame
from edvo.freeze import glimpse
from edvo.kit import Kit
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status, speed_of
from edvo.uncertainty import degenerate_directions, describe, in_current_camera

DUE_SHARE = 0.75  # of its points on planes of the keyframe: with fewer it is the next one itself
DARK_STRAY_M = 0.1  # from where it was expected: while nothing told, its velocity was a guess
HELD = "contours of depth alone told of a motion less than a second ago"


@dataclass(frozen=True, slots=True)
class Followed:
    """What depth alone says of a frame.

    Attributes
    ----------
    alignment : Alignment
    status : Status
        ``DEGRADED`` or ``LOST``.
    reason : str
    covariance : ndarray of float64, shape (6, 6)
        Of ``T_key_cur``.
    degenerate : tuple of str
        Motions in the frame's own camera that planes do not notice.
    is_due : bool
        Whether it is to be the next keyframe.
    """

    alignment: Alignment
    status: Status
    reason: str
    covariance: NDArray[np.float64]
    degenerate: tuple[str, ...]
    is_due: bool = False


class Blind:
    """Follows a camera by depth alone.

    Parameters
    ----------
    kit : Kit
    course : Course
        Moved on with each frame that is followed.
    doubt : Doubt
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt) -> None:
        self._config, self._clock = kit.config, kit.clock
        self._depth_alone, self._judge = kit.depth_alone, kit.judge
        self._instants, self._contours = kit.instants, kit.contours
        self._course, self._doubt = course, doubt
        self._is_on = kit.fitter.is_on and kit.config.planes.alone_share > 0
        self._makes_keyframes = kit.config.planes.alone_keyframes == "made"
        self._depth = np.empty((0, 0), np.float32)  # of the last frame without edges, which has
        self._repeats = 0  # come again so many times

    def may_tell(self, frame: Frame) -> bool:
        """Whether depth alone may say how a camera moves.

        Parameters
        ----------
        frame : Frame
            With hardly any edges.

        Returns
        -------
        bool
        """
        sight = glimpse(frame.depth)
        fresh = not np.array_equal(sight, self._depth)  # to the bit: depth is frozen
        self._depth, self._repeats = sight, 0 if fresh else self._repeats + 1
        return fresh and self._is_on and self._course.keyframe is not None

    def may_wait(self, timestamp: float) -> bool:
        """Whether a frame may stay where the last one was, since its depth is still that of it.

        Once, where depth comes a little less often than colour: it has not frozen by then.

        Parameters
        ----------
        timestamp : float
            Of a frame that may not tell, seconds.

        Returns
        -------
        bool
        """
        course = self._course
        return self._repeats == 1 and course.is_blind and course.follows(timestamp)

    def follow(self, seen: Seen, few: str) -> Followed:
        """Go on by depth alone, where it fits the keyframe's; the frame is degraded, or lost.

        Parameters
        ----------
        seen : Seen
        few : str
            How many edges it has.

        Returns
        -------
        Followed
        """
        course, timestamp = self._course, seen.frame.timestamp
        key, period = course.key, course.period(timestamp)
        with self._clock("registration"):
            start = course.T_key_last
            if self._config.motion.prior == "constant-velocity":
                # That of the last frames with edges is poor where they had few, as walls do.
                velocity = course.velocity if course.is_blind else course.cruise
                start = start @ se3.exp(velocity * math.exp(-period / FADING_S) * period)
            parts = key, seen.samples, seen.points
            alignment = self._depth_alone.align(*parts, start)
            covariance = self._depth_alone.covariance(*parts, alignment)
            alignment, along = self._along(seen, alignment, covariance, start)
        T_last_cur = se3.inverse(course.T_key_last) @ alignment.T_ref_cur
        own = in_current_camera(covariance, alignment.T_ref_cur)  # in which it was held still
        loose = tuple(describe(way) for way in degenerate_directions(own))
        misfit = self._judge.judge_alone(
            alignment, len(seen.points.sigma), *speed_of(T_last_cur, period)
        )
        if len(loose) == 6 and misfit in ("", alignment.reason):
            misfit = "depth constrains nothing"
        is_open = bool(loose) and (along is None or along.leaves_open)
        reason = f"depth alone: {few}"
        if loose:
            held = "" if is_open else " but by contours"
            reason += f"; not constrained{held}: {', '.join(loose)}"
        status = Status.LOST if misfit else Status.DEGRADED
        # Where it may have drifted there is nothing to hold against the depth of a moment ago.
        if not misfit and not loose and self._config.status.max_conflict:
            status, reason = self._doubt.question(seen, alignment, status, reason)
        if status is Status.LOST:
            return Followed(alignment, status, f"{few}; {misfit or reason}", covariance, loose)
        if loose:
            self._doubt.is_sure = False
        if is_open and course.anchor is None:
            course.anchor = timestamp - period, course.T_world_last
        elif loose and not is_open:
            self._doubt.cast(timestamp, HELD)
        course.is_blind, course.last_time = True, timestamp
        course.step(alignment.T_ref_cur, T_last_cur, period)
        self._instants.interrupt()
        few_fit = alignment.plane_points < DUE_SHARE * len(seen.points.sigma)
        # of what it has drifted by before that the anchor tells whatever follows
        is_due = self._makes_keyframes and few_fit and not is_open
        return Followed(alignment, status, reason, covariance, loose, is_due)

    def _along(
        self,
        seen: Seen,
        found: Alignment,
        covariance: NDArray[np.float64],
        expected: NDArray[np.float64],
    ) -> tuple[Alignment, Along | None]:
        """Move what depth has found to where contours fit, if planes fit there; else the same."""
        course, timestamp = self._course, seen.frame.timestamp
        if self._doubt.moved(timestamp):
            return found, None
        given = course.key, seen, found.T_ref_cur, covariance
        along = self._contours.along(*given, expected, DARK_STRAY_M)
        if along is None:
            return found, None
        parts = course.key, seen.samples, seen.points
        there = self._depth_alone.at(*parts, along.T_key_cur, found)
        T_last_cur = se3.inverse(course.T_key_last) @ along.T_key_cur
        speed = speed_of(T_last_cur, course.period(timestamp))
        misfit = self._judge.judge_alone(there, len(seen.points.sigma), *speed)
        return (found, None) if misfit else (there, along)
