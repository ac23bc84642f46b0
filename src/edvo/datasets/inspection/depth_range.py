"""Whether the depth is such as depth cameras measure."""

from collections.abc import Sequence

import numpy as np

from edvo.datasets.inspection.finding import Finding
from edvo.frame import Frame

DEPTH_RANGE = "depth range"  # the name of the check, whose figures `edvo info` always shows
# What depth cameras are used for; a wrong depth scale (1000 for 5000) mostly leads out of it.
PLAUSIBLE_DEPTH_M = (0.25, 12.0)
FEWEST_VALID = 0.1  # share of pixels with depth


def check_depth_range(frames: Sequence[Frame], depth_scale: float) -> Finding:
    """Look at how far things are, and how many pixels have depth.

    Parameters
    ----------
    frames : sequence of Frame
        At least one.
    depth_scale : float
        What is assumed, for the message.

    Returns
    -------
    Finding
    """
    warnings = []
    valid = float(np.mean([np.mean(frame.depth > 0) for frame in frames]))
    if valid < FEWEST_VALID:
        warnings.append(f"only {valid:.1%} of the depth pixels have a value")
    some = np.concatenate([frame.depth[::4, ::4].ravel() for frame in frames])
    some = some[some > 0] if (some > 0).any() else frames[0].depth[frames[0].depth > 0]
    least, middle, most = (float(value) for value in np.percentile(some, (1, 50, 99)))
    nearest, farthest = PLAUSIBLE_DEPTH_M
    if not nearest <= middle <= farthest:
        warnings.append(
            f"half of the depth is {'below' if middle < nearest else 'above'} {middle:.3g} m, "
            f"which is implausible: check depth_scale ({depth_scale:g} now; 5000 for TUM, 1000 "
            "for most cameras)"
        )
    measured = {
        "valid": round(valid, 4),
        "nearest_m": round(least, 4),
        "median_m": round(middle, 4),
        "farthest_m": round(most, 4),
    }
    return Finding(DEPTH_RANGE, tuple(warnings), measured=measured)
