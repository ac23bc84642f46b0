"""Robust least squares over a rigid motion, for baselines that are edvo's own code."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines import kernels

Linearise = Callable[[NDArray[np.float64], NDArray[np.float32]], int]
"""Writes rows ``[r, J]`` at a motion, see `edvo.baselines.kernels`; returns how many."""

DAMPING = 1e-4  # lambda at the start, over the diagonal
DAMPING_UP, DAMPING_DOWN = 10.0, 0.1
MAX_REJECTIONS = 3  # in a row
FIRST_SIGMA = 1.0  # where the fixed-point iteration for the scale begins


@dataclass(frozen=True, slots=True)
class Robust:
    """How residuals are weighed and when to stop.

    Attributes
    ----------
    nu : float
        Degrees of freedom of the t-distribution.
    floor : float
        Least scale, in the unit of the residuals.
    min_rows : int
        With fewer residuals there is no answer.
    max_iterations : int
        Trial steps.
    stop : float
        Converged once a step changes the residuals by less (rms).
    stop_decrease : float
        Or lowers the cost by less, relative.
    """

    nu: float
    floor: float
    min_rows: int
    max_iterations: int
    stop: float
    stop_decrease: float = 1e-4


@dataclass(frozen=True, slots=True)
class Fit:
    """Where an iteration came to rest.

    Attributes
    ----------
    T : ndarray of float64, shape (4, 4)
    H : ndarray of float64, shape (6, 6)
        J^T W J at the last linearisation.
    sigma : float
        Scale of the residuals.
    count : int
        Residuals at ``T``.
    """

    T: NDArray[np.float64]
    H: NDArray[np.float64]
    sigma: float
    count: int


def fit(linearise: Linearise, T: NDArray[np.float64], size: int, robust: Robust) -> Fit | None:
    """Move a motion until the residuals are least, by Levenberg-Marquardt steps.

    The weights and the scale are those of a t-distribution, found anew at each step (Kerl, Sturm,
    Cremers 2013).

    Parameters
    ----------
    linearise : callable
        The problem.
    T : ndarray of float64, shape (4, 4)
        Where to start.
    size : int
        Most rows that there can be.
    robust : Robust

    Returns
    -------
    Fit or None
        None where there are too few residuals, or they do not hold all six directions.
    """
    rows, trial_rows = np.empty((2, size, kernels.ROW), np.float32)
    H, b = np.empty((6, 6)), np.empty(6)
    count = linearise(T, rows)
    damping, rejections, sigma, cost = DAMPING, 0, FIRST_SIGMA, 0.0
    total = 0.0
    stale = True
    for _ in range(robust.max_iterations):
        if count < robust.min_rows:
            return None
        if stale:
            sigma = kernels.student_scale(rows, count, robust.nu, sigma, robust.floor)
            cost = kernels.student_cost(rows, count, robust.nu, sigma)
            total = kernels.normal_equations(rows, count, robust.nu, sigma, H, b)
            stale = False
        try:
            step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -b)
        except np.linalg.LinAlgError:
            return None
        change = np.sqrt(max(float(step @ H @ step), 0.0) / total)
        trial = se3.exp(step) @ T
        if change < robust.stop:  # too small a step to be worth a trial
            T = trial
            break
        trial_count = linearise(trial, trial_rows)
        if trial_count >= robust.min_rows:
            trial_cost = kernels.student_cost(trial_rows, trial_count, robust.nu, sigma)
        else:
            trial_cost = np.inf
        if trial_cost < cost:
            T, count, stale, rejections = trial, trial_count, True, 0
            rows, trial_rows = trial_rows, rows
            damping *= DAMPING_DOWN
            if cost - trial_cost < robust.stop_decrease * cost:
                break
        else:
            damping *= DAMPING_UP
            rejections += 1
            if rejections > MAX_REJECTIONS:
                break
    return Fit(T, H, sigma, count)
