"""Edges that only one of two images has in view, as where texture comes in beside a plain wall.

Not in the paper. A frame that shows much that its keyframe does not has few edges that fit, however
well it is placed. So before it is lost for that, it is asked how much of what both have in view is
where it belongs, of the one as of the other; then it may become the keyframe of what is new.
"""

from edvo.course import Course
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status

EXCUSED = ", but of what both images have in view most does"


class Unshared:
    """Excuses edges that only one of frame and keyframe has in view.

    Parameters
    ----------
    kit : Kit
    course : Course
    locator : Locator
        Says how far a registration is to be trusted else.
    """

    def __init__(self, kit: Kit, course: Course, locator: Locator) -> None:
        self._course, self._assessor = course, locator.assessor
        self._search, self._clock = kit.search, kit.clock
        self._is_on = kit.config.status.unshared == "excused"

    def excuse(self, seen: Seen, found: Alignment) -> str:
        """Say why a frame that is lost for how few of its edges fit is only degraded.

        Parameters
        ----------
        seen : Seen
            The frame.
        found : Alignment
            With the keyframe.

        Returns
        -------
        str
            Empty where it is lost: something else is amiss, or what both have in view fits no
            better.
        """
        if not self._is_on or not self._assessor.may_be_excused(seen, found):
            return ""
        status, reason = self._assessor.assess(found, seen.frame.timestamp, is_shared=True)
        if status is Status.LOST:
            return ""
        with self._clock("search"):
            is_shared = self._search.is_shared(self._course.key, found, seen)
        return reason + EXCUSED if is_shared else ""
