"""Leaps that a frame bears out, as where a camera is knocked.

Not in the paper. What is farther from where it was expected than a hand moves a camera is the next
of things that are alike, more often than not. But a camera is knocked, too, or was astray a frame
ago and is right by now. Then most of what both images show fits, and nothing beside it does. And
where nothing constrains a motion a registration may slide along that, and tells all others.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.assessing import LEAPT
from edvo.course import Course
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.registration import Alignment
from edvo.scatter import SURE
from edvo.seen import Seen
from edvo.uncertainty import BOUNDS, degenerate_directions, in_current_camera

SLID = ", but along what nothing constrains"
BORNE_OUT = ", but most of what both images have in view fits there, and nowhere beside"


class Leaping:
    """Excuses leaps that a frame bears out, or that only slide along what nothing constrains.

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
        self._is_held = rule.motion.inertia == "loose" and rule.status.covariance != "none"

    def slides(self, seen: Seen, found: Alignment, reason: str) -> str:
        """Say why a frame is only degraded that leaps along what nothing constrains, and else not.

        There the camera goes on as it was going; see `edvo.inertia`.

        Parameters
        ----------
        seen, found, reason
            See `excuse`.

        Returns
        -------
        str
            Empty where it is lost: for another reason, or what is constrained leaps, too, or
            nothing would hold it there (``motion.inertia``).
        """
        if not self._is_held or not self._may_excuse(seen, found, reason):
            return ""
        ways, timestamp = self._open_ways(seen, found), seen.frame.timestamp
        if not len(ways):
            return ""
        T_world_cur = self._course.key.T_world_key @ found.T_ref_cur
        T_expected_cur = kernels.inverted(self._course.expected(timestamp)) @ T_world_cur
        leap = se3.log(T_expected_cur)
        along = np.linalg.lstsq((ways / BOUNDS).T, leap / BOUNDS, rcond=None)[0]
        rest_m = float(np.linalg.norm((leap - along @ ways)[:3]))
        return reason + SLID if rest_m <= self._assessor.limit(timestamp) else ""

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
        if not self._may_excuse(seen, found, reason):
            return ""
        key = self._course.key
        with self._clock("search"):
            is_there = self._search.is_alone(key, found.T_ref_cur, seen)
            is_there = is_there and self._search.is_shared(key, found, seen, SURE)
        is_there = is_there and not len(self._open_ways(seen, found))
        return reason + BORNE_OUT if is_there else ""

    def _may_excuse(self, seen: Seen, found: Alignment, reason: str) -> bool:
        """Whether it is lost for a leap alone."""
        return self._is_on and reason == LEAPT and self._assessor.may_be_excused(seen, found)

    def _open_ways(self, seen: Seen, found: Alignment) -> NDArray[np.float64]:
        """Motions, shape (K, 6), that hardly anything constrains: it may be anywhere along them."""
        key, term = self._course.key, self._fitter.term
        with self._clock("uncertainty"):
            covariance = self._uncertainty.covariance(
                key.edges, seen.samples, key.planes, seen.points, term, found
            )
        return degenerate_directions(in_current_camera(covariance, found.T_ref_cur))
