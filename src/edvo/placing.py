"""Where a frame was taken: by the keyframe, or by what else may tell.

Not in the paper, which has the keyframe alone. Where a keyframe was left along what nothing told,
and the camera is back, that says so. A frame that is lost may have slid along what nothing
constrains, fit an earlier keyframe, be excused for what it is lost for, show more edges when looked
at again, or be led by its depth: in this order.
"""

from enum import Enum, auto
from typing import NamedTuple

from edvo.background import Still
from edvo.course import Course
from edvo.doubt import CHANGED, LEAPT_HERE, Doubt
from edvo.earlier import EarlierKeyframes
from edvo.faint import FaintEdges
from edvo.kit import Kit
from edvo.leading import LEADS, Leading
from edvo.leaping import Leaping
from edvo.locating import Locator
from edvo.movers import LITTLE
from edvo.parting import Parting
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.standing import Standing
from edvo.status import Status
from edvo.unshared import Unshared
from edvo.upkeep import Upkeep


class Way(Enum):
    """What says where a frame was taken."""

    KEYFRAME = auto()  # the last one
    RETURN = auto()  # one that was left along what nothing told, to which the camera came back
    EARLIER = auto()  # another
    LEAP = auto()  # the last one, farther from where it was expected than a hand moves a camera
    DEPTH = auto()  # depth alone


class Placed(NamedTuple):
    """Where a frame was taken, and how far that is to be trusted.

    Attributes
    ----------
    seen : Seen
        The frame.
    alignment : Alignment
        With the keyframe of the course; the one that failed, where it is lost.
    status : Status
    reason : str
        Why it is to be trusted no further.
    still : Still or None
        What stands still, if that is all that was registered.
    way : Way
    off : float
        How far from where it is it seemed to be, m, before it came back to a keyframe.
    """

    seen: Seen
    alignment: Alignment
    status: Status
    reason: str
    still: Still | None = None
    way: Way = Way.KEYFRAME
    off: float = 0.0

    @property
    def is_lost(self) -> bool:
        """Whether nothing says where it was taken."""
        return self.status is Status.LOST

    @property
    def is_back(self) -> bool:
        """Whether another keyframe than the last one says so."""
        return self.way in (Way.RETURN, Way.EARLIER)


class Placer:
    """Says where frames were taken.

    Parameters
    ----------
    kit : Kit
    course : Course
        Which goes on from another keyframe, where that fits.
    pieces : Pieces
        Of the path.
    doubt : Doubt
    locator : Locator
    standing : Standing
    parting : Parting
    earlier : EarlierKeyframes
    upkeep : Upkeep
        Drops what is wrong, where the camera has come back.
    """

    def __init__(
        self,
        kit: Kit,
        course: Course,
        pieces: Pieces,
        doubt: Doubt,
        locator: Locator,
        standing: Standing,
        parting: Parting,
        earlier: EarlierKeyframes,
        upkeep: Upkeep,
    ) -> None:
        self._movers = doubt.movers
        self._doubt, self._locator, self._standing = doubt, locator, standing
        self._parting, self._earlier, self._upkeep = parting, earlier, upkeep
        self._unshared = Unshared(kit, course, locator)
        self._leaping = Leaping(kit, course, locator)
        self._faint = FaintEdges(kit, course, pieces, locator)
        self._leading = Leading(kit, course, locator, doubt)

    def place(self, seen: Seen, index: int) -> Placed:
        """Register a frame.

        Parameters
        ----------
        seen : Seen
            The frame.
        index : int
            Its number.

        Returns
        -------
        Placed
            To be confirmed where it is not lost.
        """
        seen = self._parting.apart(seen) or seen
        placed = self._without_movers(seen) or Placed(seen, *self._standing.register(seen))
        back = self._come_back(placed) if placed.still is None else None
        if back is not None:
            return back
        if not placed.is_lost or self._standing.is_moving(seen.frame.timestamp):
            return placed
        return self._save(placed, index)

    def confirm(self, placed: Placed) -> Placed:
        """Ask depth whether a frame may be there, and cast doubt by how it got there.

        Parameters
        ----------
        placed : Placed
            That is not lost.

        Returns
        -------
        Placed
            With its parts at its instant; lost, or placed anew by what stands still, where depth
            contradicts.
        """
        seen, alignment, status, reason, still = placed[:5]
        timestamp = seen.frame.timestamp
        answer = self._standing.confirm(seen, alignment, status, reason, still)
        confirmed = Placed(*answer, placed.way, placed.off)
        if confirmed.is_lost:
            if placed.is_back:
                self._earlier.stay()
            self._doubt.note_loss(leapt=placed.way is Way.LEAP)
            return confirmed
        # in doubt no frame is lost for it; back at a keyframe it need not have come from there
        leaps = self._locator.assessor.leaps_far(confirmed.alignment, timestamp)
        if placed.way is Way.LEAP or (leaps and not placed.is_back):
            self._doubt.cast_on_way(timestamp, LEAPT_HERE)
        if placed.way is Way.DEPTH:
            self._doubt.cast(timestamp, CHANGED)
        if placed.way is Way.RETURN and confirmed.alignment is alignment:
            self._earlier.settle()
            self._upkeep.forget_good()
            self._doubt.mind_mending(timestamp, placed.off)
        if confirmed.status is Status.DEGRADED and confirmed.still is None:
            self._doubt.mind_change(confirmed.alignment, timestamp)
        return confirmed

    def _without_movers(self, seen: Seen) -> Placed | None:
        """Place a frame by what is left of it where it is known what moves, if that fits."""
        if seen.is_parted:
            return None
        is_moving = self._standing.is_moving(seen.frame.timestamp)
        rest = self._movers.apart(seen, LITTLE) if is_moving else self._movers.apart(seen)
        if rest is None:
            return None
        placed = Placed(rest, *self._locator.locate(rest))
        return None if placed.is_lost else placed

    def _come_back(self, placed: Placed) -> Placed | None:
        """Go on from the keyframe that was left along what nothing told, if that is to be had."""
        seen = placed.seen
        if self._standing.is_moving(seen.frame.timestamp):
            return None
        back = self._earlier.come_back(seen, placed.alignment, placed.status)
        if back is None:
            return None
        # what was seen since then was seen from elsewhere, believed or not
        self._doubt.forget_since(back.since)
        self._standing.forget(back.since)
        return Placed(seen, back.alignment, Status.TRACKED, "", way=Way.RETURN, off=back.off)

    def _save(self, lost: Placed, index: int) -> Placed:
        """Place a frame that is lost by what else may tell; the same where nothing does."""
        seen, alignment, reason = lost.seen, lost.alignment, lost.reason
        if excuse := self._leaping.slides(seen, alignment, reason):
            return lost._replace(status=Status.DEGRADED, reason=excuse)
        other = self._earlier.go_back(seen)
        if other is not None:
            return Placed(seen, other, Status.TRACKED, "", way=Way.EARLIER)
        if excuse := self._unshared.excuse(seen, alignment):
            return lost._replace(status=Status.DEGRADED, reason=excuse)
        if excuse := self._leaping.excuse(seen, alignment, reason):
            return lost._replace(status=Status.DEGRADED, reason=excuse, way=Way.LEAP)
        again = self._faint.look(seen, index)
        if again is not None:
            return Placed(*again)
        led = self._leading.lead(seen)
        return lost if led is None else Placed(seen, led, Status.DEGRADED, LEADS, way=Way.DEPTH)
