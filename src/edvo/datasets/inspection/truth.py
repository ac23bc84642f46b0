"""Whether the camera moves as the ground truth says.

A wrong depth scale leaves the registration's residual as it is, and scales the way.
"""

from collections.abc import Sequence

import numpy as np

from edvo import se3
from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.walk import Step, motion, pairs_within
from edvo.trajectory import Trajectory

LEAST_M = 0.03  # a shorter way is mostly noise
FARTHEST = 8  # frames of a walk
FEWEST = 5  # pairs
WRONG = 1.25  # factor of scale that is worth a warning
SPREAD = 0.5  # of the logarithm of the factor, that it may vary by from pair to pair
TURN_DEG, TURN_SHARE = 2.0, 0.5  # by which turns differ, where true poses are of other frames


def check_truth(steps: Sequence[Step], truth: Trajectory | None, depth_scale: float) -> Finding:
    """Compare motions with the true ones.

    Parameters
    ----------
    steps : sequence of Step
        Frames and how the camera moved between them.
    truth : Trajectory or None
        True poses.
    depth_scale : float
        What is assumed, for the message.

    Returns
    -------
    Finding
        Undecided without truth, or where the camera hardly moves.
    """
    name = "motion against ground truth"
    if truth is None:
        return Finding(name, undecided="there is no ground truth")
    scales, errors, turns = [], [], []
    first, last = (float(time) for time in truth.timestamps[[0, -1]])
    for a, b in pairs_within(steps, FARTHEST):
        if not all(first <= step.timestamp <= last for step in (a, b)):
            continue
        T_true = se3.inverse(truth.at(a.timestamp)) @ truth.at(b.timestamp)
        T_found = motion(a, b)
        turns.append(np.rad2deg(se3.rotation_angle(T_true)))
        errors.append(np.rad2deg(se3.rotation_angle(se3.inverse(T_true) @ T_found)))
        way, true_way = (float(np.linalg.norm(T[:3, 3])) for T in (T_found, T_true))
        if true_way > LEAST_M and way > 0:
            scales.append(np.log(way / true_way))
    if len(errors) < FEWEST:
        return Finding(name, undecided="too few frames with truth could be registered")
    error, turn = float(np.median(errors)), float(np.median(turns))
    measured = {"turn_error_deg": round(error, 3)}
    if error > max(TURN_DEG, TURN_SHARE * turn):
        warning = (
            f"the camera turns otherwise than ground truth says, by {error:.1f} degrees between "
            "frames: check the stamps of images and truth, and that truth is camera to world"
        )
        return Finding(name, (warning,), measured=measured)
    if len(scales) < FEWEST:
        return Finding(name, undecided="the camera hardly moves", measured=measured)
    low, middle, high = (float(value) for value in np.percentile(scales, (25, 50, 75)))
    scale = float(np.exp(middle))
    measured["scale"] = round(scale, 3)
    if abs(middle) < np.log(WRONG):
        return Finding(name, measured=measured)
    if high - low > SPREAD * abs(middle):
        return Finding(name, undecided="motions are too uncertain", measured=measured)
    warning = (
        f"the camera moves {scale:.3g} times as far as ground truth says: depth_scale is "
        f"{depth_scale:g}, try {depth_scale * scale:.4g}"
    )
    return Finding(name, (warning,), measured=measured)
