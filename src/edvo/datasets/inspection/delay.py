"""By how much depth is taken later than colour, as the stamps tell."""

from collections.abc import Sequence

import numpy as np

from edvo.datasets.inspection.finding import Finding
from edvo.frame import Frame

DEPTH_DELAY = "depth delay"  # the name of the check, whose figure `edvo info` shows


def check_delay(frames: Sequence[Frame]) -> Finding:
    """Take the median of the frames' delays of depth.

    Parameters
    ----------
    frames : sequence of Frame
        At least one.

    Returns
    -------
    Finding
        Without a warning: the tracker takes the delay into account.
    """
    median = float(np.median([frame.depth_delay for frame in frames]))
    return Finding(DEPTH_DELAY, measured={"median_s": round(median, 6)})
