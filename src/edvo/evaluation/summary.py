"""All that is said of an estimate, in one object for table, file and plot."""

from dataclasses import dataclass
from typing import Any

from edvo.errors import EvaluationError
from edvo.evaluation.ate import AbsoluteTrajectoryError, absolute_trajectory_error
from edvo.evaluation.checks import check_number, check_trajectories
from edvo.evaluation.coverage import coverage, span_coverage
from edvo.evaluation.rpe import (
    RelativePoseError,
    Unit,
    check_span,
    relative_pose_error,
    standing_still,
)
from edvo.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of an estimate beside those of standing still.

    Parameters
    ----------
    poses : int
        Poses in the estimate.
    frames : int or None
        Frames that could have had one, where known.
    coverage : float or None
        Share of the frames that have a pose, where their number is known.
    span_coverage : float
        Share of the reference about which there is an estimate.
    rpe, rpe_sturm : RelativePoseError or None
        Relative pose error by the script's formula and by Sturm's; None if the estimate is too
        short for it.
    rpe_zero_motion : RelativePoseError or None
        The same (script's formula) of an estimate that stands still.
    ate, ate_zero_motion : AbsoluteTrajectoryError or None
        Absolute trajectory error, of the estimate and of one that stands still; None if fewer
        than three poses have a partner.
    notes : tuple of str
        Why an error is missing, a line each.
    """

    poses: int
    frames: int | None
    coverage: float | None
    span_coverage: float
    rpe: RelativePoseError | None
    rpe_sturm: RelativePoseError | None
    rpe_zero_motion: RelativePoseError | None
    ate: AbsoluteTrajectoryError | None
    ate_zero_motion: AbsoluteTrajectoryError | None
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Give everything but the single errors in plain types.

        Returns
        -------
        dict
            Keys as the attributes; each error by its own ``to_dict``, or None.
        """
        errors = {
            "rpe": self.rpe,
            "rpe_sturm": self.rpe_sturm,
            "rpe_zero_motion": self.rpe_zero_motion,
            "ate": self.ate,
            "ate_zero_motion": self.ate_zero_motion,
        }
        return {
            "poses": self.poses,
            "frames": self.frames,
            "coverage": self.coverage,
            "span_coverage": self.span_coverage,
            **{name: None if error is None else error.to_dict() for name, error in errors.items()},
            "notes": list(self.notes),
        }


def evaluate(
    reference: Trajectory,
    estimate: Trajectory,
    frames: int | None = None,
    *,
    delta: float = 1.0,
    unit: Unit = "s",
    max_pairs: int = 10_000,
    max_difference: float = 0.02,
    seed: int = 0,
) -> Evaluation:
    """Evaluate an estimate by the TUM protocol.

    Parameters
    ----------
    reference, estimate : Trajectory
        True and estimated poses, on the same clock.
    frames : int, optional
        Frames that could have had a pose.
    delta, unit, max_pairs, seed
        See `edvo.evaluation.rpe.relative_pose_error`.
    max_difference : float
        See `edvo.evaluation.ate.absolute_trajectory_error`.

    Returns
    -------
    Evaluation
        Errors, coverage, and the errors of standing still. An estimate too short for one of the
        errors gets the other, with a note.

    Raises
    ------
    EvaluationError
        If neither error can be had, an argument is out of range, or one is no trajectory.
    """
    check_trajectories(reference, estimate)
    check_span(delta, unit)
    check_number("max_pairs", max_pairs, "how many, or 0 for all")
    check_number("max_difference", max_difference, "seconds")
    share = None if frames is None else coverage(len(estimate), frames)
    still = standing_still(estimate)
    notes = []
    rpe = rpe_sturm = rpe_still = None
    try:
        options: dict[str, Any] = {
            "delta": delta,
            "unit": unit,
            "max_pairs": max_pairs,
            "seed": seed,
        }
        rpe = relative_pose_error(reference, estimate, **options)
        rpe_sturm = relative_pose_error(reference, estimate, formula="sturm", **options)
        rpe_still = relative_pose_error(reference, still, **options)
    except EvaluationError as error:
        notes.append(f"no relative pose error: {error}")
    ate = ate_still = None
    try:
        ate = absolute_trajectory_error(reference, estimate, max_difference=max_difference)
        ate_still = absolute_trajectory_error(reference, still, max_difference=max_difference)
    except EvaluationError as error:
        if rpe is None:
            raise EvaluationError(f"nothing to compare: {error}") from error
        notes.append(f"no absolute trajectory error: {error}")
    return Evaluation(
        poses=len(estimate),
        frames=frames,
        coverage=share,
        span_coverage=span_coverage(reference, estimate),
        rpe=rpe,
        rpe_sturm=rpe_sturm,
        rpe_zero_motion=rpe_still,
        ate=ate,
        ate_zero_motion=ate_still,
        notes=tuple(notes),
    )
