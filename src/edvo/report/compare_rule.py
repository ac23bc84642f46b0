"""The rules of a comparison, the same for edvo and for all that is beside it.

When an odometry counts as failed, in which words, and which of several runs stands for it.
"""

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from edvo.errors import EdvoError, EvaluationError
from edvo.evaluation import Evaluation, evaluate
from edvo.trajectory import Trajectory

Run = TypeVar("Run")

LEAST_COVERAGE = 0.5
"""Share of the frames that must have a pose."""


def failed(evaluation: Evaluation) -> str:
    """Say why an estimate is a failure.

    Parameters
    ----------
    evaluation : Evaluation
        Made with the number of frames.

    Returns
    -------
    str
        The reason; empty where it is none.

    Notes
    -----
    It is one if fewer than half of the frames have a pose, or if its relative pose error is not
    below that of an estimate that stands still, at the same times. Where the estimate is too
    short for a relative error, the absolute one takes its place.
    """
    if evaluation.poses == 0:
        return "no poses"
    if evaluation.coverage is not None and evaluation.coverage < LEAST_COVERAGE:
        return _too_few(evaluation.coverage)
    if evaluation.rpe is not None and evaluation.rpe_zero_motion is not None:
        error, still, what = evaluation.rpe.rmse, evaluation.rpe_zero_motion.rmse, "RPE"
    elif evaluation.ate is not None and evaluation.ate_zero_motion is not None:
        error, still, what = evaluation.ate.rmse, evaluation.ate_zero_motion.rmse, "ATE"
    else:
        return ""
    if not error < still:  # also where the error is no number
        return f"diverged: {what} {error:.3g}, standing still {still:.3g}"
    return ""


def judge(
    reference: Trajectory | None, estimate: Trajectory, frames: int
) -> tuple[Evaluation | None, str]:
    """Evaluate an estimate, and say why it is a failure.

    Parameters
    ----------
    reference : Trajectory or None
        True poses, if there are any; without them it must only cover the frames.
    estimate : Trajectory
        Estimated poses.
    frames : int
        Frames that could have had a pose.

    Returns
    -------
    (Evaluation or None, str)
        None where there is nothing to compare; the reason as of `failed`.
    """
    if not len(estimate):
        return None, "no poses"
    share = len(estimate) / frames
    too_few = _too_few(share) if share < LEAST_COVERAGE else ""
    if reference is None:
        return None, too_few
    try:
        evaluation = evaluate(reference, estimate, frames)
    except EvaluationError as error:
        return None, too_few or str(error)
    return evaluation, failed(evaluation)


def raised(error: Exception) -> str:
    """Name in a line what a tracker raised.

    Parameters
    ----------
    error : Exception
        Whatever it is: the libraries behind a tracker have errors of their own.

    Returns
    -------
    str
        The first line of what it says, with its type unless it is one of edvo's own.
    """
    first_line = (str(error).strip().splitlines() or [""])[0]
    if isinstance(error, EdvoError) and first_line:
        return first_line
    return f"{type(error).__name__}: {first_line}"


def middle(runs: Sequence[Run], error: Callable[[Run], float]) -> Run:
    """Choose the run that stands for several of a system.

    Parameters
    ----------
    runs : sequence
        At least one.
    error : callable
        Gives the error of a run: infinite if it failed, not a number where it has none.

    Returns
    -------
    Run
        The one in the middle by its error; of an even number the worse of the two.
    """

    def order(run: Run) -> float:
        value = error(run)
        return math.inf if math.isnan(value) else value

    return sorted(runs, key=order)[len(runs) // 2]


def _too_few(share: float) -> str:
    return f"poses for {share:.0%} of the frames only"
