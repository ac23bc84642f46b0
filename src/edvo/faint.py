"""Faint edges of a frame that is lost just after another was.

Not in the paper. While frames follow one another closely they show faint edges, too; a lost one
only what tells places. But the contrast of one texture may be just above that bound in one image,
and just below in another: then the keyframe lacks most of what the frame shows.
"""

from typing import NamedTuple

from edvo.course import Course
from edvo.detail import usual_detail
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.scatter import SURE
from edvo.seen import Seen
from edvo.status import Status


class SecondLook(NamedTuple):
    """A frame that was looked at once more, where it is, and how far that is to be trusted."""

    seen: Seen
    alignment: Alignment
    status: Status
    reason: str


class FaintEdges:
    """Registers lost frames once more, by faint edges of theirs and of the keyframe.

    Parameters
    ----------
    kit : Kit
    course : Course
    pieces : Pieces
        Of the path.
    locator : Locator
    """

    def __init__(self, kit: Kit, course: Course, pieces: Pieces, locator: Locator) -> None:
        self._course, self._pieces, self._locator = course, pieces, locator
        self._front_end, self._config = kit.front_end, kit.config
        self._is_on = kit.config.status.just_lost == "by-faint-edges"

    def look(self, seen: Seen, index: int) -> SecondLook | None:
        """Look at a frame once more, if it is lost just after another, near the same keyframe.

        Parameters
        ----------
        seen : Seen
            The frame, as one that is lost; its gradients do not last if it is looked at again.
        index : int
            Its number.

        Returns
        -------
        SecondLook or None
            None where hardly more of it fits, or nothing says that it is near.
        """
        course, key = self._course, self._course.key
        if not self._is_on or not course.is_just_lost(seen.frame.timestamp):
            return None
        if seen.is_stale or seen.is_parted or key.edges is key.telling:
            return None  # what is carried would count again, or there are no others
        if course.is_blind or course.anchor is not None or self._pieces.here:
            return None  # places are to be told apart
        detail = usual_detail(self._config)._replace(is_near=True, is_faint=key.is_faint)
        again = self._front_end.see(seen.frame, index, detail=detail, again=True)
        alignment, status, reason = self._locator.locate(again)
        is_there = alignment.agreeing >= SURE * len(again.samples) and status is not Status.LOST
        return SecondLook(again, alignment, status, reason) if is_there else None
