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
from edvo.scatter import fitting_depth
from edvo.seen import Seen
from edvo.status import agreement
from edvo.uncertainty import degenerate_directions, in_current_camera

LATE_S = 0.03  # that depth or a row is late by, at most
SLACK_M = 0.02  # as far as poses by either scatter
REASON = "just begun, and edges and depth lead apart: something moves"


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
    ) -> Alignment | None:
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
        Alignment or None
            ``found`` where edges and depth agree on it more; None where they do not lead apart, or
            depth leaves a motion open, or it is not asked: later, or where either fits.
        """
        timestamp = seen.frame.timestamp
        is_asked = self._is_on and self._judge.is_out_of_step(found)
        if not is_asked or not self._doubt.has_just_begun(timestamp):
            return None
        with self._clock("search"):
            level = self._level(seen, start, found)
            if level is None:
                return None
            self._doubt.see_motion(timestamp, REASON)
            key, sharp_px = self._course.key, self._judge.scatter.sharp_px
            again = self._registrar.register(seen, level.T_ref_cur[None], term, sharp_px)
        return max((found, again), key=lambda each: agreement(each, key.planes, seen.points))

    def _level(self, seen: Seen, start: NDArray[np.float64], found: Alignment) -> Alignment | None:
        """Where depth alone leads, if that is elsewhere, and it leaves no motion open."""
        course, parts = self._course, (self._course.key, seen.samples, seen.points)
        begun = found.T_ref_cur, start
        levels = [self._depth_alone.align(*parts, T_key_cur) for T_key_cur in begun]
        level = max(levels, key=fitting_depth)
        T_key_level = level.T_ref_cur
        step_m = se3.distance(course.T_key_last, found.T_ref_cur)
        late_m = LATE_S * step_m / course.period(seen.frame.timestamp)
        if se3.distance(found.T_ref_cur, T_key_level) < SLACK_M + late_m:
            return None
        own = in_current_camera(self._depth_alone.covariance(*parts, level), T_key_level)
        return None if len(degenerate_directions(own)) else level
