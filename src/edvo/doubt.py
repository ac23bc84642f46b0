"""Doubt: what makes a pose no better than the way that led to it, and the questions that raise it.

Not in the paper. A pose may fit and be wrong. Something moves by itself, the view changes at once,
a step is so far that it may have led elsewhere, a camera is found again that was lost from a pose
in doubt, edges and depth are torn, or a keyframe is made where hardly anything tells or, just after
the start, of what fitted poorly: what follows is held in doubt for a second, too.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo.course import Course
from edvo.keyframes import Keyframe
from edvo.kit import Kit
from edvo.movers import LITTLE, Movers
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status
from edvo.witness import Surface, Witness

STRAY_M, EARLY_STRAY_M = 0.02, 0.005  # as far as poses scatter; less before movers are noticed
DOUBTFUL_S = 1.0  # after what raises doubt, a pose is no better than the way that led to it
MOVED, ASTRAY = "something moved less than a second ago", "found again, lost from a doubtful pose"
STEPPED = "a far step less than a second ago"
WAS_LOOSE = "hardly constrained less than a second ago"
PUT_RIGHT = "put right less than a second ago: till then it went along what hardly an edge told"
FOUND_FAR = "found again less than a second ago, lost where it would have leapt"
LEAPT_HERE = "less than a second ago it leapt, or was astray till then"
# Motion alone does not change a view so much in so short a time: light does, or a hand that comes.
JUST_NOW_S = 0.1
CALM, ASK_S = 0.25, 0.05  # less than that of max_conflict is none; then depth rests so long, s
WRONG_M = 0.05  # that poses were off by, to be called wrong
WAS_TORN = "less than a second ago edges scattered and depth was off, both more than of late"
CHANGED = "less than a second ago the view had changed at once"
BEGUN_POORLY = "just begun, and less than a second ago a keyframe was made of what fitted poorly"
LONG_SURE_S = 3.0  # after so long in doubt a pose that was sure tells nothing


class Doubt:
    """Questions poses, and remembers what doubt there is, and where the camera was before it.

    Parameters
    ----------
    kit : Kit
    course : Course

    Attributes
    ----------
    reason : str
        Of the last doubt.
    way_reason : str
        Of the last doubt on the way.
    moving_time : float
        When something was last seen to move by itself, seconds.
    is_sure : bool
        Whether the last pose was tracked.
    movers : Movers
        What moves in a small part of the view.
    """

    def __init__(self, kit: Kit, course: Course) -> None:
        self._limits, self._judge, self._clock = kit.config.status, kit.judge, kit.clock
        self._course = course
        keeps_strays = kit.config.edges.strays == "kept"
        self._witness = Witness(kit.camera, kit.config.planes.sensor, keeps_strays=keeps_strays)
        self.movers = Movers(kit, course, self._witness)
        self._time, self.reason = -math.inf, MOVED
        self._begun = math.inf  # when the first frame was taken, seconds
        # When a keyframe was made of a pose that may be off, or the camera found elsewhere.
        self._loose_time, self.way_reason = -math.inf, WAS_LOOSE
        self._has_leapt = False
        self.moving_time = self._calm_time = -math.inf
        self.is_sure = True
        # When a pose last was, and by which keyframe where.
        self._last_sure: tuple[float, Keyframe, NDArray[np.float64]] | None = None

    def cast(self, timestamp: float, reason: str) -> None:
        """Cast doubt on what follows.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str
        """
        self._time, self.reason = timestamp, reason

    def see_motion(self, timestamp: float) -> None:
        """Cast doubt on what follows, since something moves by itself.

        Parameters
        ----------
        timestamp : float
            Seconds.
        """
        self.moving_time = timestamp
        self.cast(timestamp, MOVED)

    def lasts(self, timestamp: float) -> bool:
        """Whether something of late makes a pose no better than the way that led to it.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return 0 <= timestamp - self._time < DOUBTFUL_S

    def moved(self, timestamp: float) -> bool:
        """Whether something moved by itself of late.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return 0 <= timestamp - self.moving_time < DOUBTFUL_S

    def cast_on_way(self, timestamp: float, reason: str = WAS_LOOSE) -> None:
        """Cast doubt on the way to what follows, which by itself is as good as any.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str, optional
            Why, for the result.
        """
        self._loose_time, self.way_reason = timestamp, reason
        self.movers.mind_doubt(timestamp)  # from before to after nobody knows the way

    def mind_mending(self, timestamp: float, off: float) -> None:
        """Doubt the way to where it is now, if the poses before that were wrong.

        Parameters
        ----------
        timestamp : float
            Seconds.
        off : float
            By how much they were put right, m.
        """
        self._last_sure = None
        if off > WRONG_M:
            self.cast_on_way(timestamp, PUT_RIGHT)

    def note_loss(self, *, leapt: bool) -> None:
        """Take note of a loss.

        Parameters
        ----------
        leapt : bool
            Whether the frame fits farther from where it was expected than a hand moves a camera:
            among things that are alike it may be the wrong one, now and when it is found again.
        """
        self._has_leapt |= leapt

    def mind_leap(self, timestamp: float, *, is_proven: bool) -> None:
        """Doubt the way to where it is now, if it was lost by a leap.

        Parameters
        ----------
        timestamp : float
            Seconds.
        is_proven : bool
            Whether it was looked for and found in both ways, which ends the doubt.
        """
        if self._has_leapt and not is_proven:
            self.cast_on_way(timestamp, FOUND_FAR)
        self._has_leapt = False

    def is_way_loose(self, timestamp: float) -> bool:
        """Whether the way here is in doubt.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return 0 <= timestamp - self._loose_time < DOUBTFUL_S

    def calm(self) -> None:
        """Let nothing be in doubt, by what was seen till now."""
        self._time = self.moving_time = self._loose_time = self._calm_time = -math.inf
        self._has_leapt = False

    def forget(self) -> None:
        """Drop what was seen on the way here."""
        self._witness.forget()
        self.movers.forget()
        self._calm_time = -math.inf
        self._last_sure = None

    def forget_since(self, timestamp: float) -> None:
        """Drop the depth that was seen since a time, from poses that are wrong.

        Parameters
        ----------
        timestamp : float
            Seconds.
        """
        self._witness.forget(timestamp)
        self.movers.forget(timestamp)
        self._calm_time = -math.inf

    def rewind(self) -> None:
        """Take note of a clock that has jumped back."""
        self._last_sure = None
        self.movers.forget()
        self.calm()

    def note_sure(self, timestamp: float, T_key_cur: NDArray[np.float64]) -> None:
        """Remember a pose that is beyond doubt.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_key_cur : ndarray of float64, shape (4, 4)
        """
        self._last_sure = timestamp, self._course.key, T_key_cur.copy()

    def before(self, timestamp: float) -> tuple[Keyframe, NDArray[np.float64]] | None:
        """Where it was when it was last sure, if it was lost from a doubtful pose soon after.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        (Keyframe, ndarray of float64, shape (4, 4)) or None
            And T_key_cur.
        """
        last = self._last_sure
        if self.is_sure or last is None or timestamp - last[0] > LONG_SURE_S:
            return None
        return last[1:]

    def begin(self, seen: Seen) -> None:
        """Remember the depth of the first frame, to hold later ones against.

        Parameters
        ----------
        seen : Seen
        """
        self._begun = seen.frame.timestamp
        if self._limits.max_conflict:
            with self._clock("witness"):
                surface = self._witness.surface(seen.frame.depth)
                T_world_cam = self._course.T_world_last
                self._witness.remember(seen.frame.timestamp, T_world_cam, surface)

    def has_just_begun(self, timestamp: float) -> bool:
        """Whether the first frame is so recent that how well things fit as a rule is not known.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return 0 < timestamp - self._begun <= DOUBTFUL_S

    def stray_m(self, timestamp: float) -> float:
        """Say how far contours may lead from where a camera was expected: movers have them, too.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        float
            Metres; less in the first second, in which nobody has been noticed yet.
        """
        return EARLY_STRAY_M if self.has_just_begun(timestamp) else STRAY_M

    def question(
        self, seen: Seen, alignment: Alignment, status: Status, reason: str
    ) -> tuple[Status, str]:
        """Hold a pose against the depth of a moment ago: what was empty cannot be filled.

        Depth that repeats is that of a moment ago itself, and is not asked. Nor, without doubt, is
        what follows closely on a frame that was, and by which nothing moved.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment
        status, reason
            As they were.

        Returns
        -------
        (Status, str)
            As they are then.
        """
        timestamp, limits = seen.frame.timestamp, self._limits
        if self.moved(timestamp) and self.moving_time > self._time and not seen.without_movers:
            self.cast(self.moving_time, MOVED)
        if seen.is_stale or (status is Status.TRACKED and self._has_just_asked(timestamp)):
            return status, reason
        with self._clock("witness"):
            conflict, T_world_cam, surface = self._conflict(seen, alignment)
        if conflict > limits.max_conflict:
            self.moving_time = timestamp
            moves = f"{conflict:.0%} of the view stands where nothing was: something moves"
            if conflict > limits.lost_conflict:
                self.cast(timestamp, MOVED)
                return Status.LOST, moves
            if not self._is_calm_apart(seen, T_world_cam, surface):
                self.cast(timestamp, MOVED)
                status, reason = Status.DEGRADED, moves
        if conflict < CALM * limits.max_conflict:
            self._calm_time = timestamp
        unsure = status is not Status.TRACKED or self.lasts(timestamp)
        unsure = unsure and not self.moved(timestamp)
        if unsure or self.has_just_begun(timestamp):
            self.movers.mind_doubt(timestamp)
        else:
            self.movers.note(timestamp, T_world_cam, surface)
        self._witness.remember(timestamp, T_world_cam, surface)
        return status, reason

    def _is_calm_apart(
        self, seen: Seen, T_world_cam: NDArray[np.float64], surface: Surface
    ) -> bool:
        """Whether all that moves, which is little, was left out, and the rest stands still."""
        if not seen.without_movers:
            return False
        timestamp, rest_of = seen.frame.timestamp, self.movers.rest_of
        with self._clock("witness"):
            rest = rest_of(surface, T_world_cam)
            if len(rest.points) < (1 - LITTLE) * len(surface.points):
                return False
            conflict = self._witness.question_apart(timestamp, T_world_cam, rest, rest_of)
        return conflict < CALM * self._limits.max_conflict

    def _has_just_asked(self, timestamp: float) -> bool:
        """Whether depth was held against that of before a frame ago, and nothing moved at all."""
        return 0 < timestamp - self._calm_time < ASK_S and not self.lasts(timestamp)

    def finds_motion(self, seen: Seen, alignment: Alignment) -> bool:
        """Whether things move past a pose, though not so much that it is none; casts no doubt.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment

        Returns
        -------
        bool
        """
        with self._clock("witness"):
            conflict = self._conflict(seen, alignment)[0]
        return self._limits.max_conflict < conflict <= self._limits.lost_conflict

    def mind_start(self, alignment: Alignment, timestamp: float) -> None:
        """Doubt the way on, where a frame of the first second is a keyframe that fitted poorly.

        Later ones fit it, however far off it is.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Seconds.
        """
        if self.has_just_begun(timestamp) and self._judge.is_poor_keyframe(alignment):
            self.cast_on_way(timestamp, BEGUN_POORLY)

    def mind_torn(self, alignment: Alignment, timestamp: float) -> None:
        """Doubt what follows a frame whose edges and depth say different things.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Seconds.
        """
        if self._judge.torn.is_in_doubt(alignment):
            self._judge.torn.widen(alignment)
            self.cast(timestamp, WAS_TORN)

    def mind_change(self, alignment: Alignment, timestamp: float) -> None:
        """Doubt what follows a frame that fits poorly what was seen just now.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Seconds.
        """
        if self._limits.sudden_change == "ignore":
            return
        key = self._course.key
        age = timestamp - (key.gathered_at if key.gathered else key.timestamp)
        if 0 <= age < JUST_NOW_S and self._judge.fits_poorly(alignment):
            self.cast(timestamp, CHANGED)

    def _conflict(
        self, seen: Seen, alignment: Alignment
    ) -> tuple[float, NDArray[np.float64], Surface]:
        """How much of a frame contradicts a pose; that of its depth, and what was asked."""
        timestamp = seen.frame.timestamp
        T = seen.T_world_depth(self._course.key.T_world_key @ alignment.T_ref_cur)
        self._witness.forget(timestamp)  # what it was told of this frame by another pose
        self.movers.forget(timestamp)
        surface = self._witness.surface(seen.frame.depth)
        return self._witness.question(timestamp, T, surface), T, surface
