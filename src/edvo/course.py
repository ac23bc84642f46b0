"""The course of the camera: where it was last, how it moves, and since when that is a guess."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.errors import TrajectoryError
from edvo.front_end import rigid
from edvo.keyframes import Keyframe

FASTEST_M_S = 2.0  # that a camera may go by while its velocity is not known
LONGEST_PREDICTION_S = 0.2  # beyond it a constant velocity says nothing about a hand
CRUISE_S = 0.5  # that the velocity is averaged over which a lost camera is expected to keep
HAND = np.array([3.0] * 3 + [6.0] * 3)  # how a hand accelerates, m/s^2 and rad/s^2 (one sigma)
ACCELERATION_S = 1.0  # that the acceleration is averaged over
FADING_S = 0.5  # that a velocity lasts which nothing confirms, where depth alone goes on
SHORTEST_PERIOD_S = 1e-3  # closer stamps are no more than a clock's jitter
NOMINAL_PERIOD_S = 1 / 30  # stands in where stamps repeat, all but repeat, or go back
BACK_S = 1.0  # a clock that jumps back so far has begun anew
# Lost for longer, by time and by frames, a frame may show any place that was seen before.
LONG_LOST_S, LONG_LOST_FRAMES = 0.3, 3


class Whereabouts(NamedTuple):
    """Where a course is; for its parts see `Course`."""

    keyframe: Keyframe | None
    T_key_last: NDArray[np.float64]
    T_world_last: NDArray[np.float64]
    velocity: NDArray[np.float64]
    stood: tuple[float, NDArray[np.float64]] | None
    before: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None


class Course:
    """Where a camera was last, and how it goes on from there.

    Parameters
    ----------
    T_world_cam : ndarray of float64, shape (4, 4), optional
        Of the first frame; the origin where not given.

    Raises
    ------
    TrajectoryError
        If it is no rigid motion.

    Attributes
    ----------
    keyframe : Keyframe or None
        That frames are registered with; None before the first one.
    T_key_last : ndarray of float64, shape (4, 4)
        Of the last frame that was not lost, and
    T_world_last : ndarray of float64, shape (4, 4)
        where that is in the world.
    velocity : ndarray of float64, shape (6,)
        Of the camera, in its own frame, 1/s.
    cruise : ndarray of float64, shape (6,)
        The same of the last half second, where it was tracked.
    last_time : float or None
        Of the last frame that was not lost, seconds; one that repeats the image before it does not
        count.
    losses : int
        Frames lost in a row.
    is_blind : bool
        Whether depth alone gave the last pose.
    anchor : (float, ndarray of float64, shape (4, 4)) or None
        When and where it was last known where it is, if depth alone has let it drift since.
    stood : (float, ndarray of float64, shape (4, 4)) or None
        When and where the last registration was that stood, if the last pose is one that goes on
        along what hardly anything constrains.
    before : (float, ndarray of float64, shape (4, 4), ndarray of float64, shape (6,)) or None
        When (seconds) and where (T_world_cam) it was before it moved on to the last pose, and its
        velocity then, 1/s.
    acceleration : ndarray of float64, shape (6,)
        Of late, mean squares along any axis and about it, m^2/s^4 and rad^2/s^4; those of a hand
        before any are known.
    """

    def __init__(self, T_world_cam: NDArray[np.float64] | None = None) -> None:
        self.keyframe: Keyframe | None = None
        self.T_key_last = np.eye(4)
        self.T_world_last = np.eye(4) if T_world_cam is None else _checked(T_world_cam)
        self.velocity = np.zeros(6)
        self.cruise = np.zeros(6)
        self.last_time: float | None = None
        self.losses = 0
        self.is_blind = False
        self.anchor: tuple[float, NDArray[np.float64]] | None = None
        self.stood: tuple[float, NDArray[np.float64]] | None = None
        self.before: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None = None
        self.acceleration = HAND**2
        self._frames = 1  # that the last step was over

    @property
    def key(self) -> Keyframe:
        """The keyframe, where there is one for sure."""
        assert self.keyframe is not None
        return self.keyframe

    @property
    def whereabouts(self) -> Whereabouts:
        """Where it is, to return to."""
        where = self.T_key_last, self.T_world_last
        return Whereabouts(self.keyframe, *where, self.velocity, self.stood, self.before)

    def return_to(self, there: Whereabouts) -> None:
        """Be where it was, as if it had never left.

        Parameters
        ----------
        there : Whereabouts
        """
        self.keyframe, self.T_key_last, self.T_world_last = there[:3]
        self.velocity, self.stood, self.before = there[3:]

    def compare_with(self, keyframe: Keyframe) -> None:
        """Register the next frame with another keyframe; where the camera is stays as it is.

        Parameters
        ----------
        keyframe : Keyframe
        """
        self.keyframe = keyframe
        self.T_key_last = se3.inverse(keyframe.T_world_key) @ self.T_world_last

    @property
    def is_adrift(self) -> bool:
        """Whether depth alone told of the last pose, and not all: it may be anywhere along that."""
        return self.is_blind and self.anchor is not None

    def period(self, timestamp: float) -> float:
        """Seconds since the last frame that was not lost; the usual where stamps make no sense.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        float
        """
        if self.last_time is None or timestamp - self.last_time < SHORTEST_PERIOD_S:
            return NOMINAL_PERIOD_S
        return timestamp - self.last_time

    @property
    def period_before(self) -> float:
        """Seconds a frame in the last step; 0 where there was none, or none that stood."""
        if self.before is None or self.last_time is None or self.stood is not None:
            return 0.0
        period = (self.last_time - self.before[0]) / self._frames
        return period if period >= SHORTEST_PERIOD_S else NOMINAL_PERIOD_S

    def follows(self, timestamp: float) -> bool:
        """Whether the last pose is that of a moment ago.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return not self.losses and self.period(timestamp) <= LONGEST_PREDICTION_S

    def is_just_lost(self, timestamp: float) -> bool:
        """Whether it was lost so recently that it is near to where it is expected.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        few = 0 < self.losses <= LONG_LOST_FRAMES
        return few and self.period(timestamp) <= LONGEST_PREDICTION_S

    def is_far_step(self, timestamp: float) -> bool:
        """Whether so few frames come that the camera may be far from where the last one was.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        few = self.losses < LONG_LOST_FRAMES
        return few and self.period(timestamp) > LONGEST_PREDICTION_S * (self.losses + 1)

    def unseen(self, timestamp: float) -> float:
        """Seconds since it was last known where it is.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        float
        """
        period = self.period(timestamp)
        return period if self.anchor is None else max(period, timestamp - self.anchor[0])

    def ahead(self, timestamp: float) -> NDArray[np.float64]:
        """Motion since the last pose, at constant velocity.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        ndarray of float64, shape (4, 4)
        """
        return se3.exp(self.velocity * min(self.period(timestamp), LONGEST_PREDICTION_S))

    def expected(self, timestamp: float) -> NDArray[np.float64]:
        """Where the camera is expected, at constant velocity.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        ndarray of float64, shape (4, 4)
            T_world_cam.
        """
        return self.T_world_last @ self.ahead(timestamp)

    def ahead_of_before(self, timestamp: float) -> NDArray[np.float64] | None:
        """Where it is expected from the pose before the last, of which that knows nothing.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            T_world_cam; None where that is long ago.
        """
        if self.before is None or not 0 < timestamp - self.before[0] <= LONGEST_PREDICTION_S:
            return None
        time, T_world_cam, velocity = self.before
        return T_world_cam @ se3.exp(velocity * (timestamp - time))

    def moved(
        self, T_key_cur: NDArray[np.float64], timestamp: float
    ) -> tuple[NDArray[np.float64], float]:
        """Motion since the last pose that is not a guess, and the seconds that it took.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it is now, and
        timestamp : float
            when, seconds.

        Returns
        -------
        (ndarray of float64, shape (4, 4), float)
        """
        if self.is_blind and self.anchor is not None:
            T_world_cur = self.key.T_world_key @ T_key_cur
            return se3.inverse(self.anchor[1]) @ T_world_cur, self.unseen(timestamp)
        period = self.period(timestamp)
        if self.stood is not None:
            T_world_cur = self.key.T_world_key @ T_key_cur
            return se3.inverse(self.stood[1]) @ T_world_cur, max(timestamp - self.stood[0], period)
        return kernels.inverted(self.T_key_last) @ T_key_cur, period

    def step(
        self, T_key_cur: NDArray[np.float64], T_last_cur: NDArray[np.float64], seconds: float
    ) -> None:
        """Move on to a pose; that its time has come is noted apart.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
        T_last_cur : ndarray of float64, shape (4, 4)
            The motion, and
        seconds : float
            that it took.
        """
        self.stood = None
        is_known = self.before is not None and not self.losses
        if self.last_time is not None:
            self.before = self.last_time, self.T_world_last, self.velocity
        self._frames = self.losses + 1
        velocity = se3.log(T_last_cur) / seconds
        if is_known and seconds <= LONGEST_PREDICTION_S:
            x, y, z, a, b, c = (((velocity - self.velocity) / seconds) ** 2).tolist()
            now = np.array([(x + y + z) / 3] * 3 + [(a + b + c) / 3] * 3)
            share = seconds / ACCELERATION_S
            self.acceleration = self.acceleration + (now - self.acceleration) * share
        self.velocity = velocity
        self._stand_at(T_key_cur)

    def leap(self, T_key_cur: NDArray[np.float64]) -> None:
        """Be elsewhere than where it was, by a step that is no motion: the velocity stays.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it is, or must have been at the last frame.
        """
        self.stood = self.before = None
        self._stand_at(T_key_cur)

    def drift(self, T_key_cur: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
        """Move on to a pose of which a part is where the camera was bound for.

        Parameters
        ----------
        T_key_cur : ndarray of float64, shape (4, 4)
        velocity : ndarray of float64, shape (6,)
            Of the camera, in its own frame, 1/s.
        """
        if self.stood is None and self.last_time is not None:
            self.stood = self.last_time, self.T_world_last
        self.velocity = velocity.copy()
        self._stand_at(T_key_cur)

    def _stand_at(self, T_key_cur: NDArray[np.float64]) -> None:
        self.T_key_last = T_key_cur.copy()  # whoever gets the registration may write to it
        self.T_world_last = self.key.T_world_key @ T_key_cur

    def note_tracked(self, seconds: float) -> None:
        """Take the velocity of a tracked frame into account: a lost camera is to keep it.

        Parameters
        ----------
        seconds : float
            Since the frame before it.
        """
        self.cruise += (self.velocity - self.cruise) * min(seconds / CRUISE_S, 1.0)

    def rewind(self, timestamp: float) -> bool:
        """Count anew where a clock has jumped back, as a recording that starts over.

        Parameters
        ----------
        timestamp : float
            Of the next frame, seconds.

        Returns
        -------
        bool
            Whether it has.
        """
        if self.last_time is None or timestamp >= self.last_time - BACK_S:
            return False
        self.last_time = timestamp
        if self.anchor is not None:
            self.anchor = timestamp, self.anchor[1]
        self.stood = self.before = None
        return True


def _checked(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Copy of a pose that came from outside, or an error."""
    motion = se3.checked(T)
    if motion is not None:
        return rigid(motion)
    raise TrajectoryError(
        f"T_world_cam is no rigid motion: {' '.join(repr(T).split()):.60}; give a 4 x 4 matrix of "
        "a rotation and a translation"
    )
