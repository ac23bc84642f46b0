"""Earlier keyframes: what a frame may fit where it no longer fits the last one.

Not in the paper. Where a lamp swings, a fold that was brighter to its left is darker to its left a
moment later: of a keyframe made while it was dark hardly an edge fits then, though one before it
shows the place as it looks again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import LONGEST_PREDICTION_S, Course
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status

REACH_M = 0.6  # farther off they show too little of the same; a radian counts as a metre


class _Before(NamedTuple):
    """What a course went on from before it went back."""

    keyframe: Keyframe
    T_key_last: NDArray[np.float64]
    stood: tuple[float, NDArray[np.float64]] | None


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
        self._judge, self._clock, self._depth_alone = kit.judge, kit.clock, kit.depth_alone
        self._course, self._pieces = course, pieces
        self._locator, self._store = locator, store
        self._before: _Before | None = None

    def go_back(self, seen: Seen) -> Alignment | None:
        """Go back to the near keyframe that a frame fits best, if it fits one.

        Depth has to fit as ever: what a hand hides of the last one it hides of the others, too, and
        where some edges of its own fit one of them it would lead the camera astray. That the camera
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
        bare = course.is_blind or self._depth_alone.has_to_tell(seen.samples)
        if not self._most or bare or course.period(timestamp) > LONGEST_PREDICTION_S:
            return None
        self._before = _Before(course.key, course.T_key_last, course.stood)
        best: tuple[Keyframe, Alignment] | None = None
        course.stood = None
        with self._clock("search"):
            for key in self._near(course.key):
                course.compare_with(key)
                found, status, _ = self._locator.register(seen)
                fits = status is Status.TRACKED and self._judge.scatter.has_usual_depth(found)
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
            course = self._course
            course.keyframe, course.T_key_last, course.stood = self._before

    def _near(self, last: Keyframe) -> list[Keyframe]:
        """Choose those to be tried, the nearest first."""
        others = self._store.near(self._course.T_world_last, self._pieces.here, REACH_M)
        return [key for key in others if key.index != last.index][: self._most]
