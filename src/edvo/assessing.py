"""Assessing registrations by how well they fit, and by where the camera was expected."""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import FASTEST_M_S, LONGEST_PREDICTION_S, Course
from edvo.doubt import WRONG_M, Doubt
from edvo.kit import Kit
from edvo.registration import Alignment
from edvo.scatter import clarity, is_sharper
from edvo.seen import Seen
from edvo.status import Status, speed_of

LEAP_M_S2 = 30.0  # what pushes a camera harder is a wrong match, more often than not;
SCATTER_M = 0.02  # but poses scatter by half of that themselves, from one frame to the next
JITTER_S = 0.04  # by which stamps are late, at most; what takes longer was no frame
LEFT = 0.25  # share of the points that fit the keyframe which another registration has to keep
LEAPT = "farther from where it was expected than a hand moves a camera"


class Assessor:
    """Says how far a registration is to be trusted, and which of two is the better.

    Parameters
    ----------
    kit : Kit
    course : Course
        Says where the camera is expected.
    doubt : Doubt
        Says whether that is to be relied on.
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt) -> None:
        self._judge, self._course, self._doubt = kit.judge, course, doubt
        self._depth_alone = kit.depth_alone
        self._asks_scatter = kit.config.status.edge_jump > 0
        self._allowed: Alignment | None = None

    def allow(self, alignment: Alignment) -> None:
        """Let a registration be farther from where it was expected than a hand moves a camera.

        Parameters
        ----------
        alignment : Alignment
        """
        self._allowed = alignment

    def assess(
        self, alignment: Alignment, timestamp: float, *, is_shared: bool = False
    ) -> tuple[Status, str]:
        """Judge a registration by its evidence, and by how far it is from the last pose.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.
        is_shared : bool
            Whether what both images have in view fits; see `Judge.judge`.

        Returns
        -------
        (Status, str)
            How far it is to be trusted, and why not further.
        """
        T_last_cur, period = self._course.moved(alignment.T_ref_cur, timestamp)
        follows = self._course.follows(timestamp)
        speed = speed_of(T_last_cur, period)
        said = self._judge.judge(alignment, *speed, follows=follows, is_shared=is_shared)
        # from a doubtful pose, as one that went along with people, it may well come back at once
        sure = self._doubt.is_sure and not self._doubt.lasts(timestamp)
        expected = self._asks_scatter and sure
        if said[0] is not Status.LOST and expected and self.leaps(alignment, timestamp):
            return Status.LOST, LEAPT
        if said[0] is Status.TRACKED and follows and self._doubt.has_just_begun(timestamp):
            poor = self._judge.poor_start(alignment)
            return (Status.DEGRADED, poor) if poor else said
        return said

    def may_be_excused(self, seen: Seen, alignment: Alignment) -> bool:
        """Whether a frame that is lost is near, and neither its depth nor its edges are poor.

        Parameters
        ----------
        seen : Seen
            The frame.
        alignment : Alignment
            With the keyframe.

        Returns
        -------
        bool
            False where it does not follow closely, its depth repeats or is off by more than of
            late, or depth has to tell alone, now or in the last frame.
        """
        course = self._course
        if course.is_blind or not course.follows(seen.frame.timestamp) or seen.is_stale:
            return False
        return not (self._depth_alone.has_to_tell(seen.samples) or self._judge.is_off(alignment))

    def leaps(self, alignment: Alignment, timestamp: float) -> bool:
        """Whether a registration is farther from where it was expected than a hand moves a camera.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        bool
            False where the last pose is older than a velocity lasts, so that nothing is expected,
            or where it fits better than the last one, and is where it was expected before that, or
            where it was put right.
        """
        off, limit = self.off(alignment.T_ref_cur, timestamp), self.limit(timestamp)
        if off <= limit or alignment is self._allowed:
            return False
        if not self._judge.fits_better(alignment):
            return True
        course = self._course
        T_expected = course.ahead_of_before(timestamp)  # the last one may have been astray
        T_world_cur = course.key.T_world_key @ alignment.T_ref_cur
        return T_expected is None or se3.distance(T_expected, T_world_cur) > limit

    def leaps_far(self, alignment: Alignment, timestamp: float) -> bool:
        """Whether it leaps so far that poses were wrong till then, or this one is.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        bool
            False where no leap is asked about (``status.edge_jump`` is 0).
        """
        if not self._asks_scatter or self.off(alignment.T_ref_cur, timestamp) <= WRONG_M:
            return False
        return self.leaps(alignment, timestamp)

    def off(self, T_key_cur: NDArray[np.float64], timestamp: float) -> float:
        """Say how far a pose is from where it was expected.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        float
            Metres; 0 where the last pose is older than a velocity lasts, so that nothing is
            expected.
        """
        course = self._course
        if course.period(timestamp) > LONGEST_PREDICTION_S:
            return 0.0
        return se3.distance(course.expected(timestamp), course.key.T_world_key @ T_key_cur)

    def limit(self, timestamp: float) -> float:
        """Say how far from there a hand may move the camera.

        Stamps may be those of a computer that was busy: a step that is shorter or longer than the
        one before it may have been as long as that.

        Parameters
        ----------
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        float
            Metres.
        """
        course = self._course
        period = course.period(timestamp)
        alike = course.period_before * (1 + course.losses)  # as many frames, at the last one's pace
        before = min(alike or period, period + JITTER_S)
        longer = max(period, (period + before) / 2)
        is_known = bool(course.velocity.any())
        speed = math.hypot(*course.velocity[:3].tolist()) if is_known else FASTEST_M_S
        unknown_s = abs(period - before) if is_known else period
        return speed * unknown_s + max(LEAP_M_S2 * longer * longer, SCATTER_M)

    def better(self, found: Alignment, other: Alignment, timestamp: float) -> Alignment:
        """Of two that fit: what is not lost, else whose depth is not off, else the clearer.

        What is tracked is only left for what is tracked, too, and clearly sharper. Where depth fits
        nothing is left for what takes nearly all of it off the planes of the keyframe.

        Parameters
        ----------
        found, other : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        Alignment
            One of them.
        """
        if other is found or other.plane_points < LEFT * found.plane_inliers:
            return found
        if self.assess(found, timestamp)[0] is Status.TRACKED:
            is_tracked = self.assess(other, timestamp)[0] is Status.TRACKED
            return other if is_tracked and is_sharper(other, found) else found
        lost = [self.is_lost(each, timestamp) for each in (found, other)]
        off = [self._judge.is_off(each) for each in (found, other)]
        for fails, other_fails in (lost, off):
            if fails != other_fails:
                return other if fails else found
        return max(found, other, key=clarity)

    def is_lost(self, alignment: Alignment, timestamp: float) -> bool:
        """Say whether a registration is not to be trusted at all.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        bool
        """
        return self.assess(alignment, timestamp)[0] is Status.LOST

    def is_impossible(self, alignment: Alignment, timestamp: float) -> bool:
        """Say whether it leads where no camera can be, however well it fits.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        bool
        """
        T_last_cur, period = self._course.moved(alignment.T_ref_cur, timestamp)
        is_jump = bool(self._judge.jump(*speed_of(T_last_cur, period)))
        return is_jump or self.assess(alignment, timestamp)[1] == LEAPT
