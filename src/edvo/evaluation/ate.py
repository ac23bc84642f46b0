"""Absolute trajectory error: how far positions are off after the best rigid alignment.

As the TUM RGB-D benchmark's ``evaluate_ate``: without scale, and with each pose used once.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.errors import EvaluationError
from edvo.evaluation.checks import check_number, check_trajectories
from edvo.evaluation.statistics import Statistics
from edvo.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class AbsoluteTrajectoryError:
    """The error of each position.

    Parameters
    ----------
    errors : ndarray, shape (M,), float64
        Distance between the aligned estimate and the truth, metres.
    stamps : ndarray, shape (M,), float64
        Times of the estimated poses, seconds.
    T_ref_est : ndarray, shape (4, 4), float64
        The alignment: maps points of the estimate's world to the reference's.
    """

    errors: NDArray[np.float64]
    stamps: NDArray[np.float64]
    T_ref_est: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.errors)

    @cached_property
    def statistics(self) -> Statistics:
        """Statistics of the errors, metres."""
        return Statistics.of(self.errors)

    @property
    def rmse(self) -> float:
        """Root mean square, metres: the number that papers print."""
        return self.statistics.rmse

    @property
    def median(self) -> float:
        """Median, metres."""
        return self.statistics.median

    @property
    def mean(self) -> float:
        """Mean, metres."""
        return self.statistics.mean

    @property
    def max(self) -> float:
        """Largest, metres."""
        return self.statistics.max

    def to_dict(self) -> dict[str, Any]:
        """Give the statistics and the alignment in plain types.

        Returns
        -------
        dict
            ``poses``, ``translation_m`` and ``T_ref_est``.
        """
        return {
            "poses": len(self),
            "translation_m": self.statistics.to_dict(),
            "T_ref_est": self.T_ref_est.tolist(),
        }


def absolute_trajectory_error(
    reference: Trajectory, estimate: Trajectory, *, max_difference: float = 0.02
) -> AbsoluteTrajectoryError:
    """Align an estimate with the truth and compare positions.

    Parameters
    ----------
    reference, estimate : Trajectory
        True and estimated poses, on the same clock.
    max_difference : float
        Poses further apart in time than this, or as far, are not compared, seconds.

    Returns
    -------
    AbsoluteTrajectoryError
        In order of time.

    Raises
    ------
    EvaluationError
        If fewer than three poses have a partner, the difference is no number, or one is no
        trajectory.
    """
    check_trajectories(reference, estimate)
    check_number("max_difference", max_difference, "seconds")
    true, estimated = _match(reference.timestamps, estimate.timestamps, max_difference)
    if len(true) < 3:
        raise EvaluationError(
            f"{len(true)} of {len(estimate)} estimated poses have a true pose within "
            f"{max_difference * 1e3:g} ms; give three at least, on the same clock"
        )
    target = reference.poses[true][:, :3, 3]
    points = estimate.poses[estimated][:, :3, 3]
    T_ref_est = align(target, points)
    aligned = points @ T_ref_est[:3, :3].T + T_ref_est[:3, 3]
    return AbsoluteTrajectoryError(
        errors=np.linalg.norm(aligned - target, axis=1),
        stamps=estimate.timestamps[estimated],
        T_ref_est=T_ref_est,
    )


def align(target: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the rigid motion that brings points nearest to their targets in least squares.

    Parameters
    ----------
    target, points : ndarray, shape (N, 3), float64
        Pairs of points, metres.

    Returns
    -------
    ndarray, shape (4, 4), float64
        ``T_target_points``. Where the points do not fix it (all alike, or on a line), one of the
        best.

    Notes
    -----
    Horn, JOSA 1988; Umeyama, PAMI 1991, Eq. 40-43 without scale.
    """
    target_mean, points_mean = target.mean(axis=0), points.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - target_mean).T @ (points - points_mean))
    mirror = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    T = np.eye(4)
    T[:3, :3] = U @ np.diag([1.0, 1.0, mirror]) @ Vt
    T[:3, 3] = target_mean - T[:3, :3] @ points_mean
    return T


def _match(
    true: NDArray[np.float64], estimated: NDArray[np.float64], max_difference: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pair times one to one, nearest pair first, as ``associate.py`` does."""
    # A little more than needed: the sums round, and what counts is the difference below.
    reach = 1.001 * max_difference + 1e-6
    start = np.searchsorted(true, estimated - reach, side="left")
    counts = np.searchsorted(true, estimated + reach, side="right") - start
    b = np.repeat(np.arange(len(estimated)), counts)
    within = np.arange(len(b)) - np.repeat(np.cumsum(counts) - counts, counts)
    a = np.repeat(start, counts) + within
    difference = np.abs(true[a] - estimated[b])
    close = difference < max_difference
    a, b, difference = a[close], b[close], difference[close]
    true_free, estimated_free = [True] * len(true), [True] * len(estimated)
    pairs = []
    for candidate in np.lexsort((b, a, difference)).tolist():
        i, j = int(a[candidate]), int(b[candidate])
        if true_free[i] and estimated_free[j]:
            true_free[i] = estimated_free[j] = False
            pairs.append((j, i))
    matched = np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)
    return matched[:, 1], matched[:, 0]
