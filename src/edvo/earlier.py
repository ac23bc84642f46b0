"""Earlier keyframes: what a frame may fit where it no longer fits the last one.

Not in the paper. Where a lamp swings, a fold that was brighter to its left is darker to its left a
moment later: of a keyframe made while it was dark hardly an edge fits then, though one before it
shows the place as it looks again. And a keyframe that was left along what nothing told, for one
that tells it from there on, says how far the camera has gone, once it turns back.
"""

from typing import NamedTuple

import numpy as np

from edvo import se3
from edvo.course import LONGEST_PREDICTION_S, Course, Whereabouts
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status

REACH_M = 0.6  # farther off they show too little of the same; a radian counts as a metre
LEFT_S = 5.0  # that a keyframe is remembered which was left along what nothing told
SELDOM = 3  # a frame of so many is registered with it, which takes as long as with the last one


class _Left(NamedTuple):
    """A keyframe that was left along what nothing told."""

    keyframe: Keyframe
    when: float  # seconds


class Back(NamedTuple):
    """How a camera has come back to a keyframe that it had left.

    Attributes
    ----------
    alignment : Alignment
        With that.
    off : float
        How far from there it seemed to be, m.
    since : float
        When that was left, seconds.
    """

    alignment: Alignment
    off: float
    since: float


class EarlierKeyframes:
    """Registers a frame with keyframes before the last one.

    Parameters
    ----------
    kit : Kit
    course : Course
        Which goes on from the keyframe that fits.
    pieces : Pieces
        Of the path.
    locator : Locator
    store : KeyframeStore
    """

    def __init__(
        self,
        kit: Kit,
        course: Course,
        pieces: Pieces,
        locator: Locator,
        store: KeyframeStore,
    ) -> None:
        self._most = kit.config.keyframes.earlier if kit.fitter.is_on else 0
        asked = kit.config.keyframes.tells_times and kit.config.status.min_told
        self._ties = bool(self._most and asked)
        self._judge, self._clock, self._depth_alone = kit.judge, kit.clock, kit.depth_alone
        self._course, self._pieces = course, pieces
        self._locator, self._store = locator, store
        self._before: Whereabouts | None = None
        self._left: _Left | None = None
        self._asked = 0

    def leave(self, timestamp: float) -> None:
        """Remember the keyframe, which gives way to a frame that it does not tell the place of.

        Parameters
        ----------
        timestamp : float
            Of the frame, seconds.
        """
        if self._ties and not self._is_left(timestamp):
            self._left, self._asked = _Left(self._course.key, timestamp), 0

    def forget(self) -> None:
        """Forget what was left: where the camera has gone is known by other means."""
        self._left = None

    def come_back(self, seen: Seen, found: Alignment, status: Status) -> Back | None:
        """Look for the keyframe that was left, and be there if it says that the way since is wrong.

        It is to be believed by `settle`, or `stay` where it was.

        Parameters
        ----------
        seen : Seen
        found : Alignment
            With the last keyframe, and
        status : Status
            how far it is to be trusted: if it is lost, what was expected counts.

        Returns
        -------
        Back or None
        """
        course, timestamp, left = self._course, seen.frame.timestamp, self._left
        if left is None or not self._is_left(timestamp) or not course.follows(timestamp):
            return None
        if course.key.index == left.keyframe.index:  # gone back to by other means
            self._left = None
            return None
        if course.is_blind or self._depth_alone.has_to_tell(seen.samples):
            return None
        self._asked += 1
        T_left_key = se3.inverse(left.keyframe.T_world_key) @ course.key.T_world_key
        T_left_last = T_left_key @ course.T_key_last
        away = se3.distance(T_left_last, np.eye(4)) + se3.rotation_angle(T_left_last)
        if self._asked % SELDOM or away > REACH_M:
            return None
        T_last_cur = course.ahead(timestamp)
        if status is not Status.LOST:
            T_key_last = self._locator.mender.last_pose(found)
            T_last_cur = se3.inverse(T_key_last) @ found.T_ref_cur
            T_left_last = T_left_key @ T_key_last
        self._before = course.whereabouts
        course.compare_with(left.keyframe)
        with self._clock("search"):
            again = self._locator.mender.find_again(seen, T_left_last @ T_last_cur, T_last_cur)
        if again is None:
            self.stay()
            return None
        return Back(*again, left.when)

    def settle(self) -> None:
        """Believe that the camera has come back: keyframes since then are elsewhere, and go."""
        if self._left is not None:
            self._store.drop_since(self._left.keyframe)
            self._left = None

    def go_back(self, seen: Seen) -> Alignment | None:
        """Go back to the near keyframe that a frame fits best, if it fits one.

        Depth has to fit as ever: what a hand hides of the last one it hides of the others, too, and
        where some edges of its own fit one of them it would lead the camera astray. But not after
        darkness, through which no hand has come, and in which it has drifted. That the camera
        then has gone farther or less far than expected is no motion, but what the keyframes are off
        each other; that it has turned otherwise is one.

        Parameters
        ----------
        seen : Seen
            Which fits the last one too little to be trusted.

        Returns
        -------
        Alignment or None
            With that keyframe; None where it is lost for longer than a velocity lasts, or fits none
            where a hand may have moved it.
        """
        course, timestamp = self._course, seen.frame.timestamp
        bare = course.is_adrift or self._depth_alone.has_to_tell(seen.samples)
        if not self._most or bare or course.period(timestamp) > LONGEST_PREDICTION_S:
            return None
        self._before = course.whereabouts
        best: tuple[Keyframe, Alignment] | None = None
        course.stood = None
        with self._clock("search"):
            for key in self._near(course.key):
                course.compare_with(key)
                found, status, _ = self._locator.register(seen)
                fits = status is Status.TRACKED
                fits = fits and (course.is_blind or self._judge.scatter.has_usual_depth(found))
                if fits and (best is None or found.inliers > best[1].inliers):
                    best = key, found
        if best is None:
            self.stay()
            return None
        key, found = best
        course.compare_with(key)
        step = se3.inverse(course.T_key_last) @ found.T_ref_cur
        step[:3, 3] = course.ahead(timestamp)[:3, 3]
        course.T_key_last = found.T_ref_cur @ se3.inverse(step)
        return found

    def stay(self) -> None:
        """Go on from the last keyframe, since what fitted an earlier one is not believed."""
        if self._before is not None:
            self._course.return_to(self._before)

    def _near(self, last: Keyframe) -> list[Keyframe]:
        """Choose those to be tried, the nearest first."""
        others = self._store.near(self._course.T_world_last, self._pieces.here, REACH_M)
        return [key for key in others if key.index != last.index][: self._most]

    def _is_left(self, timestamp: float) -> bool:
        """Whether one is remembered."""
        left = self._left
        if left is None or left.keyframe.piece != self._pieces.here:
            return False
        return 0 <= timestamp - left.when <= LEFT_S
