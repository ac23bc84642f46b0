"""Coverage: the share of frames that have a pose.

Errors count only where there is a pose, so that a method that gives up where it is hard looks
good: no error is printed without its coverage.
"""

import numpy as np

from edvo.errors import EvaluationError
from edvo.evaluation.checks import check_number
from edvo.trajectory import Trajectory, nearest_indices

# Further than this many usual intervals of the estimate from any of its poses, it has a hole.
_HOLE = 1.5


def coverage(poses: int, frames: int) -> float:
    """Say which share of the frames has a pose.

    Parameters
    ----------
    poses : int
        Poses in the estimate.
    frames : int
        Frames that could have had one: colour images with a depth image.

    Returns
    -------
    float
        In [0, 1].

    Raises
    ------
    EvaluationError
        If there are no frames or more poses than frames, or it is no number.
    """
    check_number("frames", frames, "how many there are")
    if not 0 <= poses <= frames or frames == 0:
        raise EvaluationError(f"{poses} poses of {frames} frames; count the frames of this source")
    return poses / frames


def span_coverage(reference: Trajectory, estimate: Trajectory) -> float:
    """Say which share of the true poses has an estimate about it, for want of a frame count.

    Parameters
    ----------
    reference, estimate : Trajectory
        True and estimated poses, on the same clock.

    Returns
    -------
    float
        In [0, 1]: the share of reference poses that are within 1.5 times the estimate's median
        interval of an estimated pose. Truth recorded before and after the images lowers it.
    """
    if not len(reference) or len(estimate) < 2:
        return 0.0
    nearest = nearest_indices(estimate.timestamps, reference.timestamps)
    distance = np.abs(estimate.timestamps[nearest] - reference.timestamps)
    usual = float(np.median(np.diff(estimate.timestamps)))
    return float(np.mean(distance <= _HOLE * usual))
