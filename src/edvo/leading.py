"""Depth that leads on where the edges of a view have changed at once, as light does that.

Not in the paper. A lamp that is switched, or a camera whose exposure settles, leaves hardly an edge
in its place, but the surfaces stay where they were. Where these alone say where the camera is, it
goes on from there, and makes a keyframe of what it sees by now.
"""

from edvo import se3
from edvo.course import Course
from edvo.doubt import Doubt
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import speed_of
from edvo.uncertainty import degenerate_directions, in_current_camera

LEADS = "the view has changed at once: depth alone says where it is"


class Leading:
    """Says where a frame was taken by its depth alone, if that leaves nothing open.

    Parameters
    ----------
    kit : Kit
    course : Course
    locator : Locator
        Says where the camera is expected, and how far from there it may be.
    doubt : Doubt
        Says whether something moves.
    """

    def __init__(self, kit: Kit, course: Course, locator: Locator, doubt: Doubt) -> None:
        self._depth_alone, self._judge, self._clock = kit.depth_alone, kit.judge, kit.clock
        self._course, self._locator, self._contours = course, locator, kit.contours
        self._doubt = doubt
        rule = kit.config.planes
        self._is_on = kit.fitter.is_on and rule.alone_share > 0 and rule.lead == "changed-views"

    def lead(self, seen: Seen) -> Alignment | None:
        """Register a frame by depth alone.

        Parameters
        ----------
        seen : Seen
            With edges, by which it is lost.

        Returns
        -------
        Alignment or None
            None where depth does not fit, or leaves a motion open.
        """
        course, timestamp = self._course, seen.frame.timestamp
        if not self._is_on or seen.is_stale or not course.follows(timestamp):
            return None
        if course.is_adrift or self._depth_alone.has_to_tell(seen.samples):
            return None
        with self._clock("registration"):
            parts = course.key, seen.samples, seen.points
            start = self._locator.starts(seen)[0]
            found = self._depth_alone.align(*parts, start)
            covariance = self._depth_alone.covariance(*parts, found)
            if len(degenerate_directions(in_current_camera(covariance, found.T_ref_cur))):
                if self._doubt.moved(timestamp):
                    return None
                given = course.key, seen, found.T_ref_cur, covariance
                along = self._contours.along(*given, start, self._doubt.stray_m(timestamp))
                if along is None or along.leaves_open:
                    return None
                found = self._depth_alone.at(*parts, along.T_key_cur, found)
        T_last_cur = se3.inverse(course.T_key_last) @ found.T_ref_cur
        speed = speed_of(T_last_cur, course.period(timestamp))
        if self._judge.judge_alone(found, len(seen.points.sigma), *speed):
            return None
        assessor = self._locator.assessor
        is_near = assessor.off(found.T_ref_cur, timestamp) <= assessor.limit(timestamp)
        return found if is_near else None
