"""What a frame is located by: all of it, or what stands still where much moves by itself."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.background import YOUNG_S, Background, Still
from edvo.course import LONGEST_PREDICTION_S, Course
from edvo.doubt import MOVED, Doubt
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status


class Standing:
    """Registers frames, and leaves out what moves by itself.

    Parameters
    ----------
    kit : Kit
    course : Course
    doubt : Doubt
        Knows when something moves.
    locator : Locator
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt, locator: Locator) -> None:
        self._limits, self._judge, self._clock = kit.config.status, kit.judge, kit.clock
        self._course, self._doubt, self._locator = course, doubt, locator
        self._background = Background(kit.camera, kit.fitter)
        # Depth has to tell what moves from what does not.
        asked = self._limits.moving == "leave-out" and self._limits.max_conflict > 0
        self._leaves_out = asked and kit.fitter.is_on

    def forget(self, since: float = -math.inf) -> None:
        """Drop what was seen on the way here.

        Parameters
        ----------
        since : float, optional
            Seconds; all where not given.
        """
        self._background.forget(since)

    def remember(self, seen: Seen) -> None:
        """Keep the depth of a frame whose pose is known, to tell later what has moved.

        Parameters
        ----------
        seen : Seen
        """
        if self._leaves_out and not seen.is_stale:
            T_world_depth = seen.T_world_depth(self._course.T_world_last)
            self._background.remember(seen.frame, T_world_depth)

    def is_moving(self, timestamp: float) -> bool:
        """Whether something moved by itself of late, and is to be left out.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return self._leaves_out and self._doubt.moved(timestamp)

    def register(self, seen: Seen) -> tuple[Alignment, Status, str, Still | None]:
        """Register a frame with the keyframe: what stands still, where much moves, or all of it.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        (Alignment, Status, str, Still or None)
            How far it is to be trusted, why not further, and what stands still if that is
            all that was registered.
        """
        timestamp = seen.frame.timestamp
        moving = self.is_moving(timestamp)
        still = self._stand_still(seen) if moving else None
        if still is None or (_is_little(still, seen) and self._course.follows(timestamp)):
            alignment, status, reason = self._locator.locate(seen)
            if status is not Status.LOST and self._judge.is_out_of_step(alignment):
                still = None
            if status is Status.LOST and not moving:
                still = self._stand_out(seen)
            if still is None:
                return alignment, status, reason, None
        return still.alignment, Status.DEGRADED, MOVED, still

    def confirm(
        self,
        seen: Seen,
        alignment: Alignment,
        status: Status,
        reason: str,
        still: Still | None,
    ) -> tuple[Seen, Alignment, Status, str, Still | None]:
        """Ask the depth of a moment ago, and register anew what stands still if something moves.

        Parameters
        ----------
        seen, alignment, status, reason, still
            As `register` was given the frame, and gave the rest.

        Returns
        -------
        (Seen, Alignment, Status, str, Still or None)
            As they are then, the parts of the frame, and of what stands still, at its instant; but
            where they were expected where the poses of late are wrong, which would tell that.
        """
        settled = self._locator.settled(seen, alignment)
        if not self._limits.max_conflict:
            return settled, alignment, status, reason, still
        status, reason = self._doubt.question(settled, alignment, status, reason)
        doubted = status is Status.LOST or not self._judge.is_out_of_step(alignment)
        is_whole = still is None and not seen.without_movers
        if is_whole and doubted and self._is_noticed(seen.frame.timestamp):
            back = self._go_back(seen)
            if back is not None:
                answer = self._doubt.question(seen, back.alignment, Status.DEGRADED, MOVED)
                return seen, back.alignment, *answer, back
        if still is not None:
            still = replace(still, seen=self._locator.settled(still.seen, alignment))
        return settled, alignment, status, reason, still

    def _is_noticed(self, timestamp: float) -> bool:
        """Whether this frame shows that something moves."""
        return self.is_moving(timestamp) and self._doubt.moving_time == timestamp

    def _stand_still(self, seen: Seen, *, at_once: bool = False) -> Still | None:
        """Register what stands still of a frame, if that is enough to be trusted."""
        key, registrar = self._course.key, self._locator.registrar
        term = registrar.term(seen.frame.timestamp)

        def align(kept: Seen, T_key_start: NDArray[np.float64]) -> Alignment:
            return registrar.register(kept, T_key_start[None], term, at_once=at_once)

        with self._clock("background"):
            starts = list(self._locator.starts(seen))
            then = self._background.last_pose()
            if then is not None:
                starts.append(se3.inverse(key.T_world_key) @ then)
            still = self._background.register(key, seen, starts, self._course.cruise, align)
        if still is None:
            return None
        status, _ = self._locator.assessor.assess(still.alignment, seen.frame.timestamp)
        return None if status is Status.LOST else still

    def _stand_out(self, seen: Seen) -> Still | None:
        """Of a frame that fits as a whole nowhere, what stands still, if the rest moves past it."""
        period = self._course.period(seen.frame.timestamp)
        if not self._leaves_out or period > LONGEST_PREDICTION_S or seen.is_stale:
            return None
        still = self._stand_still(seen)
        if still is None:
            return None
        settled = self._locator.settled(seen, still.alignment)
        return still if self._doubt.finds_motion(settled, still.alignment) else None

    def _go_back(self, seen: Seen) -> Still | None:
        """Register again what stands still, from where the camera was before anything moved."""
        since = seen.frame.timestamp - YOUNG_S
        if not self._background.reaches(since):
            return None  # in a moment it will
        self._background.forget(since)
        self._doubt.forget_since(since)
        return self._stand_still(seen, at_once=True)  # the last pose is wrong


def _is_little(still: Still, seen: Seen) -> bool:
    """Whether less than half of a frame is said to stand still."""
    return 2 * len(still.seen.samples) < len(seen.samples)
