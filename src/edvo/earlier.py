"""Earlier keyframes: what a frame may fit where it no longer fits the last one.

Not in the paper. Where a lamp swings, a fold that was brighter to its left is darker to its left a
moment later: of a keyframe made while it was dark hardly an edge fits then, though one before it
shows the place as it looks again.
"""

from edvo.course import LONGEST_PREDICTION_S, Course
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.search import Seen
from edvo.status import Status

REACH_M = 0.6  # farther off they show too little of the same; a radian counts as a metre


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
        self, kit: Kit, course: Course, pieces: Pieces, locator: Locator, store: KeyframeStore
    ) -> None:
        self._most, self._judge, self._clock = kit.config.keyframes.earlier, kit.judge, kit.clock
        self._course, self._pieces, self._locator, self._store = course, pieces, locator, store

    def go_back(self, seen: Seen) -> Alignment | None:
        """Go back to the near keyframe that a frame fits best, if it is beyond doubt that it does.

        Depth has to fit as ever: what a hand hides of the last one it hides of the others, too, and
        where some edges of its own fit one of them it would lead the camera astray.

        Parameters
        ----------
        seen : Seen
            Which fits the last one too little to be trusted.

        Returns
        -------
        Alignment or None
            With that keyframe, from where the camera is expected; None where it is lost for longer
            than a velocity lasts, or fits none.
        """
        course = self._course
        if course.is_blind or course.period(seen.frame.timestamp) > LONGEST_PREDICTION_S:
            return None
        last, best = course.key, None
        before = course.T_key_last
        with self._clock("search"):
            for key in self._near(last):
                course.compare_with(key)
                found, status, _ = self._locator.register(seen)
                fits = status is Status.TRACKED and self._judge.scatter.has_usual_depth(found)
                if fits and (best is None or found.inliers > best[1].inliers):
                    best = key, found
        if best is None:
            course.keyframe, course.T_key_last = last, before
            return None
        course.compare_with(best[0])
        return best[1]

    def _near(self, last: Keyframe) -> list[Keyframe]:
        """Choose those to be tried, the nearest first."""
        others = self._store.near(self._course.T_world_last, self._pieces.here, REACH_M)
        return [key for key in others if key.index != last.index][: self._most]
