"""Relative pose error: how far motion over a fixed span is off.

To the letter of the TUM RGB-D benchmark's ``evaluate_rpe --fixed_delta``, from which published
tables come (J. Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems*, IROS 2012).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from edvo.errors import EvaluationError
from edvo.evaluation.checks import check_number, check_trajectories
from edvo.evaluation.statistics import Statistics
from edvo.trajectory import Trajectory, nearest_indices

Unit = Literal["s", "f"]
Formula = Literal["script", "sturm"]

_FEWEST_POSES = 4  # two pairs, none of which ends on the last pose


@dataclass(frozen=True, eq=False)
class RelativePoseError:
    """The error of each pair of poses.

    Parameters
    ----------
    translation : ndarray, shape (M,), float64
        Metres over the span `delta`; at the usual one second, metres a second.
    rotation : ndarray, shape (M,), float64
        Radians over the span, in [0, pi].
    stamps : ndarray, shape (M,), float64
        Time of each pair's first pose, seconds, increasing.
    delta : float
        The span.
    unit : {"s", "f"}
        Seconds or frames.
    formula : {"script", "sturm"}
        See `relative_pose_error`.
    """

    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]
    stamps: NDArray[np.float64]
    delta: float
    unit: Unit
    formula: Formula

    def __len__(self) -> int:
        return len(self.translation)

    @cached_property
    def translation_statistics(self) -> Statistics:
        """Statistics of the translation, metres."""
        return Statistics.of(self.translation)

    @cached_property
    def rotation_statistics(self) -> Statistics:
        """Statistics of the rotation, radians."""
        return Statistics.of(self.rotation)

    @property
    def rmse(self) -> float:
        """Root mean square of the translation, metres: the number that papers print."""
        return self.translation_statistics.rmse

    @property
    def median(self) -> float:
        """Median of the translation, metres."""
        return self.translation_statistics.median

    @property
    def mean(self) -> float:
        """Mean of the translation, metres."""
        return self.translation_statistics.mean

    @property
    def max(self) -> float:
        """Largest translation, metres."""
        return self.translation_statistics.max

    @property
    def rotation_rmse(self) -> float:
        """Root mean square of the rotation, radians."""
        return self.rotation_statistics.rmse

    @property
    def rotation_median(self) -> float:
        """Median of the rotation, radians."""
        return self.rotation_statistics.median

    def to_dict(self) -> dict[str, Any]:
        """Give the settings and statistics in plain types; angles in degrees, as papers do.

        Returns
        -------
        dict
            ``formula``, ``delta``, ``unit``, ``pairs``, ``translation_m`` and ``rotation_deg``.
        """
        return {
            "formula": self.formula,
            "delta": self.delta,
            "unit": self.unit,
            "pairs": len(self),
            "translation_m": self.translation_statistics.to_dict(),
            "rotation_deg": Statistics.of(np.rad2deg(self.rotation)).to_dict(),
        }


def relative_pose_error(
    reference: Trajectory,
    estimate: Trajectory,
    *,
    delta: float = 1.0,
    unit: Unit = "s",
    formula: Formula = "script",
    max_pairs: int = 10_000,
    seed: int = 0,
) -> RelativePoseError:
    """Compare motions over a fixed span.

    Parameters
    ----------
    reference, estimate : Trajectory
        True and estimated poses, on the same clock; their worlds may differ.
    delta : float
        The span: seconds, or frames of the estimate.
    unit : {"s", "f"}
        Seconds or frames.
    formula : {"script", "sturm"}
        With estimated motion ``P`` and true motion ``Q`` over the span, ``P Q^-1`` as the script
        computes it, or ``Q^-1 P`` as Sturm's Eq. 1 and evo have it. Rotations are the same,
        translations differ by up to 5 %.
    max_pairs : int
        Above this many pairs a random sample of them is taken; 0 takes all.
    seed : int
        Of that sample.

    Returns
    -------
    RelativePoseError
        In order of time.

    Raises
    ------
    EvaluationError
        If fewer than two pairs have true poses near, an argument is out of range, or one
        is no trajectory.

    Notes
    -----
    Each estimated pose is paired with the one whose time is nearest to `delta` later. A pair
    that ends on the last pose is dropped: its time may be too early. The true pose is the nearest
    in time, not interpolated; a pair is skipped where that is further than twice the median
    interval of the truth.

    In one point this departs from the script: across a gap of more than twice `delta` the pose
    nearest to the span's end is the first one itself. The script counts such a pair as an error
    of zero; here it is skipped.
    """
    check_trajectories(reference, estimate)
    check_span(delta, unit)
    check_number("max_pairs", max_pairs, "how many, or 0 for all")
    if formula not in get_args(Formula):
        raise EvaluationError(f"unknown formula {formula!r}; choose script or sturm")
    if len(reference) < 2 or len(estimate) < 2:
        raise EvaluationError(
            f"{len(reference)} true and {len(estimate)} estimated poses; give two of each at least"
        )
    first, second = _pairs(estimate, delta, unit)
    if max_pairs and len(first) > max_pairs:
        chosen = np.random.default_rng(seed).choice(len(first), max_pairs, replace=False)
        chosen.sort()
        first, second = first[chosen], second[chosen]

    tolerance = 2.0 * np.median(np.diff(reference.timestamps))
    true_first, near_first = _true(reference, estimate.timestamps[first], tolerance)
    true_second, near_second = _true(reference, estimate.timestamps[second], tolerance)
    kept = near_first & near_second
    if np.count_nonzero(kept) < 2:
        raise EvaluationError(_why_none(reference, estimate, delta, unit, len(first)))

    P = _motion(estimate.poses[first[kept]], estimate.poses[second[kept]])
    Q_inverse = _motion(reference.poses[true_second[kept]], reference.poses[true_first[kept]])
    error = P @ Q_inverse if formula == "script" else Q_inverse @ P
    return RelativePoseError(
        translation=np.linalg.norm(error[:, :3, 3], axis=1),
        rotation=_angles(error[:, :3, :3]),
        stamps=estimate.timestamps[first[kept]],
        delta=float(delta),
        unit=unit,
        formula=formula,
    )


def standing_still(trajectory: Trajectory) -> Trajectory:
    """Give the estimate of who does not move, at the times of another.

    Parameters
    ----------
    trajectory : Trajectory
        Whose times to use.

    Returns
    -------
    Trajectory
        Identity poses. Their error is the motion itself: what an estimate must beat.
    """
    still = np.tile(np.eye(4), (len(trajectory), 1, 1))
    return Trajectory(trajectory.timestamps, still, trajectory.stamps)


def check_span(delta: float, unit: str) -> None:
    """See that a span makes sense.

    Parameters
    ----------
    delta : float
        The span.
    unit : str
        Its unit.

    Raises
    ------
    EvaluationError
        If it is not positive, or the unit is none of `Unit`.
    """
    check_number("delta", delta, "a positive number")
    if not (np.isfinite(delta) and delta > 0):
        raise EvaluationError(f"delta is {delta}; give a positive number")
    if unit not in get_args(Unit):
        raise EvaluationError(f"unknown unit {unit!r}; choose s (seconds) or f (frames)")


def _pairs(
    estimate: Trajectory, delta: float, unit: Unit
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    count = len(estimate)
    axis = estimate.timestamps if unit == "s" else np.arange(count, dtype=np.float64)
    first = np.arange(count)
    second = nearest_indices(axis, axis + delta)
    kept = (second != count - 1) & (second != first)
    return first[kept], second[kept]


def _true(
    reference: Trajectory, times: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    index = nearest_indices(reference.timestamps, times)
    return index, np.abs(reference.timestamps[index] - times) <= tolerance


def _motion(T_world_a: NDArray[np.float64], T_world_b: NDArray[np.float64]) -> NDArray[np.float64]:
    T_a_b: NDArray[np.float64] = np.linalg.inv(T_world_a) @ T_world_b
    return T_a_b


def _angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation angles by sine and cosine: exact near zero, where the script's arc cosine is not."""
    skew = rotations - rotations.transpose(0, 2, 1)
    sine = 0.5 * np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2)
    cosine = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0)
    angles: NDArray[np.float64] = np.arctan2(sine, cosine)
    return angles


def _why_none(
    reference: Trajectory, estimate: Trajectory, delta: float, unit: Unit, pairs: int
) -> str:
    if pairs < 2:
        return (
            f"fewer than two pairs of estimated poses lie {_span(delta, unit)} apart "
            f"({len(estimate)} poses, {estimate.stamps[0]} to {estimate.stamps[-1]}); "
            f"{_better_span(estimate, delta, unit)}"
        )
    return (
        f"fewer than two of {pairs} pairs {_span(delta, unit)} apart have a true pose near: truth "
        f"spans {reference.stamps[0]} to {reference.stamps[-1]}, the estimate "
        f"{estimate.stamps[0]} to {estimate.stamps[-1]}; check that both have the same clock"
    )


def _span(delta: float, unit: Unit) -> str:
    return f"{delta:g} {'s' if unit == 's' else 'frame' if delta == 1 else 'frames'}"


def _better_span(estimate: Trajectory, delta: float, unit: Unit) -> str:
    """Say which span there are pairs for."""
    if len(estimate) < _FEWEST_POSES:
        return f"give {_FEWEST_POSES} poses at least"
    axis = estimate.timestamps if unit == "s" else np.arange(len(estimate), dtype=np.float64)
    step = float(np.median(np.diff(axis)))
    if delta < step:
        one = _three_digits(step, math.ceil)
        return f"give a longer delta{_if_it_does(estimate, one, unit, '')}"
    # The first two poses have a partner then, other than the last pose.
    longest = _three_digits(float(axis[-2] - axis[1]), math.floor)
    if longest >= delta:
        return "there is a gap between them; give another delta"
    return f"give a shorter delta{_if_it_does(estimate, longest, unit, 'up to ')}"


def _if_it_does(estimate: Trajectory, delta: float, unit: Unit, how: str) -> str:
    if delta > 0 and len(_pairs(estimate, delta, unit)[0]) > 1:
        return f": {how}{_span(delta, unit)} will do"
    return ""


def _three_digits(value: float, rounded: Callable[[float], int]) -> float:
    """Shorten a span; the hundredth of a digit is the stamps' own rounding."""
    if value <= 0:
        return 0.0
    digits = 2 - math.floor(math.log10(value))
    return rounded(round(value * 10.0**digits, 2)) / 10.0**digits
