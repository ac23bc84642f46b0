"""Recovery: a camera that is lost for long is found again where it was before, or begins anew."""

import math

from edvo import se3
from edvo.anew import SETTLED_S, Chain
from edvo.course import (
    FADING_S,
    LONG_LOST_FRAMES,
    LONG_LOST_S,
    LONGEST_PREDICTION_S,
    Course,
)
from edvo.doubt import ASTRAY, Doubt
from edvo.kit import Kit
from edvo.pieces import Pieces
from edvo.places import Found
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.standing import Standing
from edvo.status import Status
from edvo.upkeep import Upkeep

RECOVERY_PERIOD_S = 0.15  # a frame is held against the stored keyframes no more often than that
BY_EDGES = "found by its edges; depth is out of step with them, as the camera moves"
LONGEST_GAP_S = 1.0  # for so long a lost camera is expected to keep its velocity


class Recovery:
    """Finds a lost camera again.

    Parameters
    ----------
    kit : Kit
    course : Course
        Which goes on from where the camera is found.
    pieces : Pieces
        Of the path.
    doubt : Doubt
    standing : Standing
    upkeep : Upkeep
        Stores the keyframes that it is found by.
    """

    def __init__(
        self,
        kit: Kit,
        course: Course,
        pieces: Pieces,
        doubt: Doubt,
        standing: Standing,
        upkeep: Upkeep,
    ) -> None:
        self._may_begin_anew = kit.config.status.lost == "begin-anew"
        self._front_end, self._depth_alone = kit.front_end, kit.depth_alone
        self._search, self._shared = kit.search, kit.shared
        self._instants = kit.instants
        self._clock = kit.clock
        self._course, self._pieces, self._doubt = course, pieces, doubt
        self._standing, self._upkeep, self._store = standing, upkeep, upkeep.store
        self._chain = Chain(kit.registration, kit.fitter, kit.depth_alone, kit.search, kit.judge)
        self._last_time = -math.inf
        self._before: Seen | None = None

    def is_adrift(self, timestamp: float) -> bool:
        """Whether depth alone has let it drift for so long that edges must find it again.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return self._course.is_adrift and self._course.unseen(timestamp) > LONG_LOST_S

    def is_long_lost(self, timestamp: float) -> bool:
        """Whether it has been lost for so long that it may be anywhere it was before.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        enough = LONG_LOST_FRAMES if self._course.anchor is None else 1
        long = self._course.losses >= enough and self._course.unseen(timestamp) > LONG_LOST_S
        return long and len(self._store) > 0

    def is_expected_nowhere(self, timestamp: float) -> bool:
        """Whether it is lost for so long that it may begin anew, once images have settled.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        wanted = self._may_begin_anew and len(self._store) > 0
        return wanted and self._course.unseen(timestamp) > LONGEST_GAP_S - SETTLED_S

    def find(self, seen: Seen) -> tuple[Found, Status, str] | None:
        """Go on from a stored keyframe, if the frame is sure to fit one.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        (Found, Status, str) or None
            How far it is to be trusted, and why not further.
        """
        course, timestamp = self._course, seen.frame.timestamp
        with self._clock("recovery"):
            found = self._look(seen)
        if found is None:
            return None
        apart = self._pieces.here
        course.keyframe = found.key
        course.is_blind, course.T_key_last = False, found.alignment.T_ref_cur  # found, not moved
        self._forget_the_way()
        self._pieces.enter(course.keyframe.piece, timestamp - course.unseen(timestamp))
        if self._doubt.is_sure and not apart and not self._pieces.here:
            if found.by_edges:
                return found, Status.DEGRADED, BY_EDGES
            return found, Status.TRACKED, ""
        self._doubt.cast(timestamp, ASTRAY)
        return found, Status.DEGRADED, ASTRAY

    def begin_anew(self, seen: Seen, index: int) -> bool:
        """Go on from where it was expected, once images fit one another.

        Parameters
        ----------
        seen : Seen
        index : int
            Of the frame.

        Returns
        -------
        bool
            Whether the frame is the keyframe of a new piece.
        """
        course, timestamp = self._course, seen.frame.timestamp
        with self._clock("recovery"):
            if self._chain.rests(timestamp):
                return False
            T_world_cam = course.T_world_last @ se3.exp(course.cruise * FADING_S)  # till it fades
            piece = self._pieces.following
            keyframe = self._front_end.keyframe(seen, index, T_world_cam, piece)
            velocity = self._chain.join(seen, keyframe)
        if velocity is None or course.unseen(timestamp) <= LONGEST_GAP_S:
            return False
        bare = self._depth_alone.has_to_tell(seen.samples)
        self._pieces.begin(timestamp, timestamp - course.unseen(timestamp))
        course.T_world_last, course.velocity = T_world_cam, velocity
        course.is_blind = bare  # edges that come back then are none that it knows
        course.anchor = (self._pieces.since, T_world_cam) if bare else None
        course.last_time = timestamp
        self._upkeep.take(keyframe, seen.kept(), keep=not bare)
        self._front_end.forget()
        self._shared.forget()
        self._chain.forget()
        self._search.forget()
        self._before = None
        self._forget_the_way()
        self._doubt.calm()
        self._standing.remember(seen)
        return True

    def join(self, seen: Seen, alignment: Alignment) -> Alignment | None:
        """Look for what was seen before it began anew; where it is found, the piece is moved.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment
            With the keyframe of this piece.

        Returns
        -------
        Alignment or None
            With that of an earlier one.
        """
        course, timestamp = self._course, seen.frame.timestamp
        if not self._pieces.may_ask(timestamp):
            return None
        piece, gap = self._pieces.here, self._pieces.gap(timestamp)
        earlier = self._store.before(piece)
        if not len(earlier):
            return None
        T_world_cam = course.key.T_world_key @ alignment.T_ref_cur
        with self._clock("recovery"):
            found = self._search.everywhere(earlier, earlier.newest(), seen, [T_world_cam], gap)
        if found is None:
            return None
        T_last_cur = se3.inverse(course.T_key_last) @ alignment.T_ref_cur
        course.keyframe, joined = found.key, found.alignment
        T = course.keyframe.T_world_key @ joined.T_ref_cur @ se3.inverse(T_world_cam)
        self._store.move(piece, course.keyframe.piece, T)
        if course.anchor is not None:
            course.anchor = course.anchor[0], T @ course.anchor[1]
        self._pieces.here = course.keyframe.piece
        self._forget_the_way()
        course.T_key_last = joined.T_ref_cur @ se3.inverse(T_last_cur)
        self._doubt.cast(timestamp, ASTRAY)
        return joined

    def note(self) -> None:
        """Take note of a frame that was registered: it is known where it is in its piece."""
        if not self._pieces.here:  # else a doubt lasts where it is to what was before
            self._search.forget()
        self._chain.forget()
        self._before = None

    def note_lost(self, seen: Seen | None) -> None:
        """Take note of a frame that was lost: by the next one it may tell how fast it goes.

        Parameters
        ----------
        seen : Seen or None
            None where it had no image, or that of before.
        """
        self._before = seen

    def rewind(self, timestamp: float) -> None:
        """Take note of a clock that has jumped back.

        Parameters
        ----------
        timestamp : float
            To there, seconds.
        """
        self._last_time = -math.inf
        self._pieces.rewind(timestamp)
        self._chain.forget()

    def _look(self, seen: Seen) -> Found | None:
        """Find the stored keyframe that a frame is sure to fit, but not too often."""
        course, timestamp = self._course, seen.frame.timestamp
        if abs(timestamp - self._last_time) < RECOVERY_PERIOD_S:
            return None
        self._last_time = timestamp
        gap = self._pieces.gap(timestamp) if self._pieces.here else course.unseen(timestamp)
        T_world_known = course.T_world_last if course.anchor is None else course.anchor[1]
        last, seen_last = min(course.period(timestamp), LONGEST_GAP_S), min(gap, LONGEST_GAP_S)
        expected = [
            course.T_world_last @ se3.exp(course.velocity * last),
            T_world_known @ se3.exp(course.cruise * seen_last),
        ]
        return self._search.everywhere(
            self._store,
            course.key,
            seen,
            expected,
            gap,
            self._doubt.before(timestamp),
            self._just_before(seen),
            at_any_speed=not seen.is_stale,
        )

    def _just_before(self, seen: Seen) -> Seen | None:
        """Give the frame before, if it was lost too, and tells when parts of this were taken."""
        before, parts_matter = self._before, self._instants.matter(seen)
        if before is None or before.is_stale or seen.is_stale or not parts_matter:
            return None
        gap = seen.frame.timestamp - before.frame.timestamp
        return before if 0 < gap <= LONGEST_PREDICTION_S else None

    def _forget_the_way(self) -> None:
        """Drop what was seen on the way here: from poses that are doubtful by now, or of a hand."""
        self._course.stood = None
        self._doubt.forget()
        self._standing.forget()
        self._upkeep.forget_good()
