"""Edges and depth that lead apart just after the start: somebody near who walks may be followed.

Not in the paper. How well both fit as a rule is not known then. Where edges agree as a whole, depth
that is far off may be late, or of rows that are read late; then it leads no farther from where the
edges do than the camera moves meanwhile. Else the edges lie on what moves by itself.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import Course
from edvo.doubt import Doubt
from edvo.kit import Kit
from edvo.planes import DepthTerm
from edvo.registrar import Registrar
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import agreement

LATE_S = 0.03  # that depth or a row is late by as a rule, which leads aside by as much motion
SLACK_M = 0.02  # as far as poses by either scatter
LEAD_APART = "just begun, and edges and depth lead apart: something moves"


class Apart:
    """Asks in the first second whether edges and depth lead to different places.

    Parameters
    ----------
    kit : Kit
    course : Course
    doubt : Doubt
        Is told that something moves.
    registrar : Registrar
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt, registrar: Registrar) -> None:
        status = kit.config.status
        self._is_on = status.first_agreeing > 0 and status.max_conflict > 0
        self._depth_alone, self._judge, self._clock = kit.depth_alone, kit.judge, kit.clock
        self._course, self._doubt, self._registrar = course, doubt, registrar

    def look(
        self, seen: Seen, start: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register a frame from where depth leads, if that is far from where edges do.

        Parameters
        ----------
        seen : Seen
            The frame.
        start : ndarray of float64, shape (4, 4)
            Where it was expected, relative to the keyframe.
        term : DepthTerm
            How depth counts.
        found : Alignment
            Where edges and depth have led.

        Returns
        -------
        Alignment
            ``found`` where edges and depth agree on it more, or do not lead apart, or depth leaves
            a motion open; and where none of it is asked: later than in the first second, or if
            edges do not agree as a whole, or depth fits.
        """
        timestamp = seen.frame.timestamp
        is_asked = self._is_on and self._judge.is_out_of_step(found)
        if not is_asked or not self._doubt.has_just_begun(timestamp):
            return found
        course, points = self._course, seen.points
        with self._clock("search"):
            begun = found.T_ref_cur, start
            level = self._depth_alone.lead(course.key, seen.samples, points, begun)
            if level is None:
                return found
            step_m = se3.distance(course.T_key_last, found.T_ref_cur)
            late_m = LATE_S * step_m / course.period(timestamp)
            if se3.distance(found.T_ref_cur, level.T_ref_cur) < SLACK_M + late_m:
                return found
            self._doubt.see_motion(timestamp)
            there, sharp_px = level.T_ref_cur[None], self._judge.scatter.sharp_px
            # at once, since the last pose may be wrong, too
            again = self._registrar.register(seen, there, term, sharp_px, at_once=True)
        return max((found, again), key=lambda each: agreement(each, course.key.planes, points))
