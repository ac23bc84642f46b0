"""Leaps that a frame bears out, as where a camera is knocked.

Not in the paper. What is farther from where it was expected than a hand moves a camera is the next
of things that are alike, more often than not. But a camera is knocked, too, or was astray a frame
ago and is right by now. Then most of what both images show fits, and nothing beside it does.
"""

from edvo.assessing import LEAPT
from edvo.course import Course
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.registration import Alignment
from edvo.scatter import SURE
from edvo.seen import Seen
from edvo.uncertainty import degenerate_directions

BORNE_OUT = ", but most of what both images have in view fits there, and nowhere beside"


class Leaping:
    """Excuses leaps that a frame bears out.

    Parameters
    ----------
    kit : Kit
    course : Course
    locator : Locator
        Says whether a frame is to be asked.
    """

    def __init__(self, kit: Kit, course: Course, locator: Locator) -> None:
        self._course, self._assessor = course, locator.assessor
        self._search, self._clock = kit.search, kit.clock
        self._uncertainty, self._fitter = kit.uncertainty, kit.fitter
        rule = kit.config
        self._is_on = rule.status.leaps == "asked" and rule.motion.search_deg > 0

    def excuse(self, seen: Seen, found: Alignment, reason: str) -> str:
        """Say why a frame that is lost for a leap is only degraded.

        Parameters
        ----------
        seen : Seen
            The frame.
        found : Alignment
            With the keyframe.
        reason : str
            Why it is lost.

        Returns
        -------
        str
            Empty where it is lost: for another reason, or it may be elsewhere.
        """
        if not self._is_on or reason != LEAPT or not self._assessor.may_be_excused(seen, found):
            return ""
        key = self._course.key
        with self._clock("search"):
            is_there = self._search.is_alone(key, found.T_ref_cur, seen)
            is_there = is_there and self._search.is_shared(key, found, seen, SURE)
        is_there = is_there and not self._leaves_open(seen, found)
        return reason + BORNE_OUT if is_there else ""

    def _leaves_open(self, seen: Seen, found: Alignment) -> bool:
        """Whether hardly anything constrains a motion: then it may be anywhere along that."""
        key, term = self._course.key, self._fitter.term
        with self._clock("uncertainty"):
            covariance = self._uncertainty.covariance(
                key.edges, seen.samples, key.planes, seen.points, term, found
            )
        return len(degenerate_directions(covariance)) > 0
