"""In how many frames depth is the very image of the frame before."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.thumbnail import Thumbnail

REPEATED_DEPTH = "repeated depth"  # the name of the check, whose figure `edvo info` shows


def check_repeats(spans: Sequence[Sequence[Thumbnail]]) -> Finding:
    """Count frames whose depth is to the bit that of the frame before, behind another image.

    Parameters
    ----------
    spans : sequence of sequences of Thumbnail
        Runs of frames that follow each other.

    Returns
    -------
    Finding
        Without a warning: the tracker takes such depth for what it is.
    """
    pairs = [pair for span in spans for pair in pairwise(span)]
    if not pairs:
        return Finding(REPEATED_DEPTH, undecided="there is one frame only")
    repeated = sum(
        bool(np.ptp(after.closeness) > 0)  # else it is that of a wall without noise
        and np.array_equal(before.closeness, after.closeness)
        and not np.array_equal(before.grey, after.grey)
        for before, after in pairs
    )
    return Finding(REPEATED_DEPTH, measured={"share": round(repeated / len(pairs), 3)})
