"""Errors of trajectories by the TUM RGB-D protocol."""

from edvo.evaluation.ate import AbsoluteTrajectoryError, absolute_trajectory_error
from edvo.evaluation.coverage import coverage, span_coverage
from edvo.evaluation.rpe import RelativePoseError, relative_pose_error, standing_still
from edvo.evaluation.summary import Evaluation, evaluate

__all__ = [
    "AbsoluteTrajectoryError",
    "Evaluation",
    "RelativePoseError",
    "absolute_trajectory_error",
    "coverage",
    "evaluate",
    "relative_pose_error",
    "span_coverage",
    "standing_still",
]
