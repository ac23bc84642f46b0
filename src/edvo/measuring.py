"""Numbers of a camera that are measured while it is tracked, by how misfits change with velocity.

Not in the paper. Whatever the scene and the depth image err by hardly changes from one frame to the
next; the velocity of a hand does.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.keyframes import Keyframe
from edvo.registration import Alignment
from edvo.seen import Seen

LONGEST_S = 0.2  # between frames, for the velocity to be known
MEMORY_S = 5.0  # that a number is taken from: clocks wander
UNTOLD = 1e-9  # of what is told in all, that is added to each direction
SETTLING_S = 1.0  # that a misfit is averaged over, which its changes are taken from
SHARED = 100.0  # points and edges that err together, from frame to frame too: so many count as one
GATE = 3.0  # sigmas, that a frame may be off by
TAKEN = 0.1  # of what the pose takes up is not known: edges count for more than they are worth
REACHED = 0.5  # of how far a number is extrapolated it may be off by (one sigma)
SURE = 2.0  # sigmas from 0, for a number to be one


@dataclass(frozen=True, slots=True)
class Equations:
    """What residuals say of a number, in px^2, over the number and the pose.

    Attributes
    ----------
    curvature, gradient : float
        Of half the sum of squares, along the number.
    mixed : ndarray of float64, shape (6,)
        Its curvature along the number and the pose, and
    gradient_pose : ndarray of float64, shape (6,)
        its gradient along the pose, both where the number is 0.
    """

    curvature: float
    gradient: float
    mixed: NDArray[np.float64]
    gradient_pose: NDArray[np.float64]

    def without_pose(
        self, alignment: Alignment, least_px: float = 0.0
    ) -> tuple[float, float] | None:
        """Say what is told of the number, less what the pose would take up of it.

        Parameters
        ----------
        alignment : Alignment
            Of the frame.
        least_px : float, optional
            Scale of the residuals below which a frame is no more certain.

        Returns
        -------
        tuple of (float, float), or None
            One over the variance of the number, were all residuals independent and what the pose
            takes up known to a tenth, and the gradient along the number, in units of the scale, as
            far as it counts; None where the pose is not constrained.
        """
        taken = taken_by_pose(alignment.H, self.mixed)
        if taken is None:
            return None
        scale = 1 / max(alignment.sigma_px, least_px) ** 2
        left = max(self.curvature - float(self.mixed @ taken), 0.0)
        scale *= left / (left + TAKEN * (self.curvature - left)) if left else 0.0
        return left * scale, (self.gradient - float(taken @ self.gradient_pose)) * scale

    def certainty(self, alignment: Alignment, least_px: float = 0.0) -> float:
        """Say how surely the number is told; for the parameters see `without_pose`.

        Returns
        -------
        float
            One over its variance, with what residuals share; 0 where the pose is not constrained.
        """
        told = self.without_pose(alignment, least_px)
        return told[0] / SHARED if told else 0.0


class Measured(NamedTuple):
    """A number as one frame shows it, in the unit of the number."""

    value: float
    information: float  # one over its variance, were all residuals independent
    off: float  # from the number by which it was found: so far it is extrapolated


class Estimate:
    """A number, its prior being that it is not far from 0.

    Parameters
    ----------
    expected : float
        How far (one sigma).
    wanted : bool, optional
        False where nobody asks for it: then it stays 0, and there is nothing to find out.
    shared : float, optional
        Of what measures it, so many err together, and count as one.

    Attributes
    ----------
    wanted : bool
    likely : float
        The most likely one, and
    variance : float
        its variance.
    value : float
        The most likely one, or 0 as long as that is not to be told from it.
    doubt : float
        Mean square of what the value is off by, in its unit squared; 0 where nobody asks.
    """

    def __init__(self, expected: float, *, wanted: bool = True, shared: float = SHARED) -> None:
        self.wanted, self._shared = wanted, shared
        self._variance = expected * expected
        self.forget()

    def forget(self) -> None:
        """Know nothing but the prior."""
        self._know(0.0, 0.0)

    def _know(self, information: float, weighted: float) -> None:
        """Set what is known, and what follows from it, which is asked ten times a frame."""
        self._information, self._sum = information, weighted
        self.variance = 1 / (information + 1 / self._variance)
        self.likely = weighted * self.variance
        self.value = self.likely if self.likely**2 > SURE * SURE * self.variance else 0.0
        self.doubt = self.variance + (self.likely - self.value) ** 2 if self.wanted else 0.0

    def is_known(self, sigma: float) -> bool:
        """Say whether it is certain, or not asked for.

        Parameters
        ----------
        sigma : float
            How certain (one sigma), in the unit of the number.

        Returns
        -------
        bool
        """
        return not self.wanted or self.variance < sigma * sigma

    def note(self, information: float, weighted: float, seconds: float) -> None:
        """Take a measurement into account, unless it contradicts what is known.

        Parameters
        ----------
        information : float
            One over its variance, were all residuals independent.
        weighted : float
            The number measured, times that.
        seconds : float
            Since the one before it.
        """
        information, weighted = information / self._shared, weighted / self._shared
        off = weighted - information * self.likely
        if not off * off <= GATE * GATE * information * (1 + information * self._variance):
            return  # nor is what is no number taken
        fade = math.exp(-seconds / MEMORY_S)
        self._know(fade * self._information + information, fade * self._sum + weighted)

    def take(self, measured: Measured) -> None:
        """Take a measurement into account that is the less certain the farther it reaches.

        Parameters
        ----------
        measured : Measured
        """
        if not measured.information > 0:
            return
        doubt = (REACHED * measured.off) ** 2 / self._shared
        information = measured.information / (1 + measured.information * doubt)
        self.note(information, information * measured.value, 0.0)  # its frame was noted already

    def learn(
        self, told: Equations, alignment: Alignment, seconds: float, least_px: float = 0.0
    ) -> None:
        """Take a frame into account; what the pose would take up of the number tells nothing.

        Parameters
        ----------
        told : Equations
        alignment : Alignment
            Of the frame.
        seconds : float
            Since the one before it.
        least_px : float, optional
            Scale of the residuals below which a frame is no more certain.
        """
        alone = told.without_pose(alignment, least_px)
        if alone is not None:
            information, gradient = alone
            self.note(information, -gradient, seconds)


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame between two others, all registered with one keyframe.

    Attributes
    ----------
    keyframe : Keyframe
    seen : Seen
    alignment : Alignment
    period : float
        Seconds since the frame before it.
    expected : ndarray of float64, shape (6,)
        Velocity since the frame before it, of the camera in its own frame, 1/s.
    velocity : ndarray of float64, shape (6,)
        That of both steps, which an error of the pose between them does not change.
    """

    keyframe: Keyframe
    seen: Seen
    alignment: Alignment
    period: float
    expected: NDArray[np.float64]
    velocity: NDArray[np.float64]


class Moments:
    """Gives each frame a velocity, once the next one is there."""

    def __init__(self) -> None:
        self.interrupt()

    def interrupt(self) -> None:
        """Begin anew: the next frame does not follow on the last one."""
        self._last: tuple[Keyframe, Seen, Alignment, float] | None = None
        self._T_before: NDArray[np.float64] | None = None  # of the frame before that

    def note(
        self,
        keyframe: Keyframe,
        seen: Seen,
        alignment: Alignment,
        period: float,
        *,
        wanted: bool = True,
        is_second: bool = False,
    ) -> Moment | None:
        """Take the next frame.

        Parameters
        ----------
        keyframe : Keyframe
            That it was registered with.
        seen : Seen
        alignment : Alignment
        period : float
            Seconds since the frame before it.
        wanted : bool
            False where there is no need to look at the frame before it.
        is_second : bool
            Whether the frame before it is the keyframe itself.

        Returns
        -------
        Moment or None
            The frame before it.
        """
        last, before = self._last, self._T_before
        if period > LONGEST_S or (last is not None and last[0] is not keyframe):
            self.interrupt()
            last = None
            if is_second and period <= LONGEST_S:
                self._T_before = np.eye(4)
        self._last = keyframe, seen, alignment, period
        if last is None:
            return None
        T = last[2].T_ref_cur
        self._T_before = T
        if before is None or not wanted:
            return None
        T_cur_before = kernels.inverted(T) @ before
        both = (
            T_cur_before
            @ (kernels.inverted(before) @ alignment.T_ref_cur)
            @ kernels.inverted(T_cur_before)
        )
        return Moment(
            *last,
            expected=-se3.log(T_cur_before) / last[3],
            velocity=se3.log(both) / (last[3] + period),
        )


class Change(NamedTuple):
    """By how much a frame differs from those of late, of the same keyframe.

    Attributes
    ----------
    twists : ndarray of float64, shape (N, 6)
        Less their means, as far as these are known: by few frames they are not.
    whole : ndarray of float64, shape (6,)
        The first of them, less its mean.
    gradient : ndarray of float64, shape (6,)
        Less what the mean asks for, as far as that is known.
    """

    twists: NDArray[np.float64]
    whole: NDArray[np.float64]
    gradient: NDArray[np.float64]


class Changes:
    """Takes from twists what they have been of late, as long as the keyframe stays.

    Their mean is that of least squares: how much a frame tells of each direction differs, and
    gradients of frames that tell much and little have no mean.
    """

    def __init__(self) -> None:
        self._keyframe: Keyframe | None = None

    def of(
        self,
        H: NDArray[np.float64],
        twists: NDArray[np.float64],
        gradient: NDArray[np.float64],
        keyframe: Keyframe,
        period: float,
    ) -> Change | None:
        """Say by how much twists, and that which a gradient asks for, differ from theirs of late.

        The mean is not known either: with S the sum of H of late, H (S + H / 100)^-1 S is left of
        H, as what a hundred residuals share stays for longer than a frame. So what no frame has
        told of yet counts nothing.

        Parameters
        ----------
        H : ndarray of float64, shape (6, 6)
            What the frame tells of each direction.
        twists : ndarray of float64, shape (N, 6)
        gradient : ndarray of float64, shape (6,)
            H times the twist that it asks for.
        keyframe : Keyframe
        period : float
            Seconds since the frame before it.

        Returns
        -------
        Change or None
            None for the first ones of a keyframe.
        """
        sums = np.vstack([twists @ H, gradient])
        if not np.isfinite(H).all() or not np.isfinite(sums).all():
            return None
        if keyframe is not self._keyframe:
            self._keyframe, self._sums = keyframe, np.zeros(sums.shape)
            self._told = np.zeros((6, 6))
        told, change = self._told + UNTOLD * np.trace(self._told) * np.eye(6), None
        if np.trace(told) > 0:
            means = self._sums @ np.linalg.inv(told)
            kept = np.linalg.solve(told + H / SHARED, told)
            less = twists - means[:-1]
            change = Change(less @ kept.T, less[0], kept.T @ (gradient - H @ means[-1]))
        fade = math.exp(-period / SETTLING_S)
        self._told, self._sums = fade * self._told + H, fade * self._sums + sums
        return change


def taken_by_pose(
    H: NDArray[np.float64], pushed: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Say by how much a pose would follow where misfits push it.

    Parameters
    ----------
    H : ndarray of float64, shape (6, 6)
        Of the registration; see ``Alignment``.
    pushed : ndarray of float64, shape (6,)

    Returns
    -------
    ndarray of float64, shape (6,), or None
        None where edges and depth do not constrain the pose.
    """
    taken = np.empty(6)
    return taken if kernels.solve_damped(H, -pushed, 0.0, taken) else None
