"""Progress: the course moves on to where a frame was placed, and what that teaches is learned."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo.contours import Along
from edvo.course import Course
from edvo.doubt import Doubt
from edvo.inertia import Inertia
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.places import Found
from edvo.placing import Placed
from edvo.planes import DepthTerm, PlaneMap, PlanePoints
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.standing import Standing
from edvo.timing import Timing
from edvo.uncertainty import degenerate_directions
from edvo.upkeep import Upkeep

_Compared = tuple[PlaneMap, PlanePoints, DepthTerm]


class Step(NamedTuple):
    """A step of the course, to a frame.

    Attributes
    ----------
    registered : Seen
        What of the frame was registered.
    period : float
        Seconds since the last pose that is not a guess.
    velocity : ndarray of float64, shape (6,), or None
        Of the camera, in its own frame, 1/s: since the last pose, or at the frame, where that is
        told, or as a lost one was found with; None where it is not known.
    covariance : ndarray of float64, shape (6, 6), or None
        Of ``T_key_cur``, as the registration tells it; None where nobody asks.
    told : ndarray of float64, shape (6, 6), or None
        The same with what parts taken at other instants may be off by.
    loose : ndarray of float64, shape (K, 6)
        Motions that hardly anything constrains.
    follows : bool
        Whether the last pose is that of a moment ago, and it has moved here from there.
    is_held : bool
        Whether contours of depth tell of all motions in ``loose``.
    """

    registered: Seen
    period: float
    velocity: NDArray[np.float64] | None
    covariance: NDArray[np.float64] | None
    told: NDArray[np.float64] | None
    loose: NDArray[np.float64]
    follows: bool
    is_held: bool


class Progress:
    """Moves a course on, and learns from frames that are to be trusted.

    Parameters
    ----------
    kit : Kit
    course : Course
        Which moves on.
    doubt : Doubt
    locator : Locator
        Knows what was put right.
    standing : Standing
    upkeep : Upkeep
    """

    def __init__(
        self,
        kit: Kit,
        course: Course,
        doubt: Doubt,
        locator: Locator,
        standing: Standing,
        upkeep: Upkeep,
    ) -> None:
        self._clock, self._fitter, self._judge = kit.clock, kit.fitter, kit.judge
        self._uncertainty, self._front_end = kit.uncertainty, kit.front_end
        self._shared, self._instants = kit.shared, kit.instants
        self._contours = kit.contours
        self._course, self._doubt, self._locator = course, doubt, locator
        self._standing, self._upkeep = standing, upkeep
        self._timing = Timing(kit, course)
        self._inertia = Inertia(kit.config)
        self._asks_covariance = kit.config.status.covariance != "none"

    @property
    def is_adrift(self) -> bool:
        """Whether the last pose may be off so far that a motion counts as not constrained."""
        return self._inertia.is_adrift

    def forget_way(self) -> None:
        """Take note that where the camera is says nothing of how it came there."""
        self._inertia.forget()
        if self._front_end.carried is not None:
            self._front_end.carried.forget_view()

    def step(self, placed: Placed, found: Found | None = None) -> Step:
        """Move on to the pose of a frame; that its time has come is noted apart.

        A camera that was lost has not moved to where it is found: how fast it goes is told apart.

        Parameters
        ----------
        placed : Placed
            The frame.
        found : Found, optional
            How a lost camera was found there.

        Returns
        -------
        Step
        """
        course, alignment, timestamp = self._course, placed.alignment, placed.seen.frame.timestamp
        registered = placed.seen if placed.still is None else placed.still.seen
        follows = course.follows(timestamp) and found is None
        covariance, by_depth = self._covariance(registered, alignment)
        along = None
        if follows and covariance is not None:
            along = self._along(registered, alignment, covariance)
        T_key_cur, sure = along or (alignment.T_ref_cur, covariance)
        T_last_cur, seconds = course.moved(T_key_cur, timestamp)
        period = seconds if course.is_blind else course.period(timestamp)
        goes_on = self._move(
            timestamp, alignment, T_key_cur, sure, T_last_cur, seconds, period, follows=follows
        )
        is_plain = goes_on and not course.is_blind
        velocity = course.velocity if follows else None
        if velocity is not None and is_plain:
            velocity = velocity + alignment.faster / period
        if found is not None:
            velocity = found.velocity
            course.velocity = np.zeros(6) if velocity is None else velocity
        told, loose, is_held = covariance, np.empty((0, 6)), False
        if covariance is not None:
            with self._clock("uncertainty"):
                given = covariance, registered, alignment, by_depth
                told = self._timing.widened(*given, period, velocity if follows else None)
                loose = degenerate_directions(told)
                if along is not None and not along.leaves_open:  # if instants open no more
                    is_held = len(loose) == len(degenerate_directions(covariance))
        course.is_blind = False
        return Step(registered, period, velocity, covariance, told, loose, follows, is_held)

    def learn(self, placed: Placed, step: Step, *, has_time: bool) -> None:
        """Learn how well things fit, what errors have in common, and when parts are taken.

        From a frame in doubt nothing is learned, and nothing that takes several frames goes on.

        Parameters
        ----------
        placed : Placed
            The frame; whether it is in doubt is noted in `Doubt.is_sure` by now.
        step : Step
            To it.
        has_time : bool
            Whether there is time for what may as well wait for the next frame.
        """
        course, alignment, is_stale = self._course, placed.alignment, placed.seen.is_stale
        if not self._doubt.is_sure:
            self._shared.interrupt()
            self._instants.interrupt()
            return
        self._doubt.note_sure(placed.seen.frame.timestamp, course.T_key_last)
        self._judge.note(alignment, is_stale=is_stale)
        self._front_end.note(step.registered, alignment)
        asked = () if is_stale else self._compared(step.registered)
        self._shared.note(course.key.edges.edges, alignment, step.period, *asked)
        if self._locator.mender.put_right(alignment) is not None:
            self._instants.interrupt()
        else:
            with self._clock("registration"):
                self._instants.note(
                    course.key, step.registered, alignment, step.period, has_time=has_time
                )
        course.note_tracked(step.period)

    def learn_carried(self, placed: Placed) -> None:
        """Learn what of the image is the camera's own from a frame that is to be trusted.

        Parameters
        ----------
        placed : Placed
        """
        carried = self._front_end.carried
        if carried is None or placed.still is not None or self._instants.is_trying:
            return
        if self._doubt.is_sure or placed.seen.is_parted:
            carried.note(placed.seen, self._course.T_world_last)

    def _compared(self, seen: Seen) -> _Compared:
        """What depth was held against, by what, and how it counts."""
        return self._course.key.planes, seen.points, self._fitter.term

    def _covariance(
        self, seen: Seen, alignment: Alignment
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
        """How far a registration may be off, where that is asked for, and what depth tells."""
        if not self._asks_covariance and self._course.anchor is None:
            return None, np.zeros((6, 6))
        with self._clock("uncertainty"):
            return self._uncertainty.spread(
                self._course.key.edges, seen.samples, *self._compared(seen), alignment
            )

    def _along(
        self, seen: Seen, alignment: Alignment, covariance: NDArray[np.float64]
    ) -> Along | None:
        """Where contours say that a frame is, along what nothing else constrains.

        Not where something moves.
        """
        course, timestamp = self._course, seen.frame.timestamp
        if not self._contours.may_tell(alignment.T_ref_cur, covariance):
            return None
        if self._doubt.moved(timestamp) or self._locator.mender.put_right(alignment) is not None:
            return None
        expected = course.T_key_last @ course.ahead(timestamp)
        given = course.key, seen, alignment.T_ref_cur, covariance
        with self._clock("registration"):
            return self._contours.along(*given, expected, self._doubt.stray_m(timestamp))

    def _move(
        self,
        timestamp: float,
        alignment: Alignment,
        T_key_cur: NDArray[np.float64],
        covariance: NDArray[np.float64] | None,
        T_last_cur: NDArray[np.float64],
        seconds: float,
        period: float,
        *,
        follows: bool,
    ) -> bool:
        """Move on to the pose found, or where hardly anything constrains it, as it was going.

        Returns whether it went there from the last one.
        """
        course, inertia, held = self._course, self._inertia, None
        put_right = self._locator.mender.put_right(alignment)
        if put_right is not None:
            self._doubt.mind_mending(timestamp, put_right.off)
            self._standing.forget(timestamp - period)
            self._upkeep.forget_good()
            self.forget_way()
            course.leap(alignment.T_ref_cur)
            course.velocity = put_right.velocity
            return False
        if covariance is not None:
            with self._clock("uncertainty"):
                held = inertia.settle(
                    course.key.index,
                    course.T_key_last,
                    T_key_cur,
                    covariance,
                    period,
                    follows=follows and not course.is_blind,
                )
        if held is not None:
            course.drift(held, inertia.velocity)
            return False
        closes = follows and course.stood is not None  # a gap, by a step that is no speed
        course.step(T_key_cur, T_last_cur, seconds)
        if closes:
            course.velocity = inertia.velocity.copy()
        return not closes
