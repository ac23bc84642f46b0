"""Whether the images are in the order in which they were taken.

Of three images in a row, the first and the last differ most, unless the camera turned back just
then. Where neighbours are swapped, that is so for hardly any three.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.thumbnail import Thumbnail, colour_change, depth_change

CLEARLY = 1.1  # factor by which a change is larger than another
# Share of threes out of order. Measured: at most 0.12 at 30 frames a second and 0.42 at 1.5; above
# 0.84 with neighbours swapped, 0.64 shuffled.
DISORDER = 0.55
FEWEST = 8  # threes that must be clear one way or the other

Change = Callable[[Thumbnail, Thumbnail], float]
KINDS: dict[str, Change] = {"colour": colour_change, "depth": depth_change}


def check_stamps(timestamps: NDArray[np.float64]) -> Finding:
    """Look for stamps that go back or repeat.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Seconds.

    Returns
    -------
    Finding
    """
    back = [i for i, (a, b) in enumerate(pairwise(timestamps.tolist()), 1) if b < a]
    same = [i for i, (a, b) in enumerate(pairwise(timestamps.tolist()), 1) if b == a]
    warnings = [
        f"{len(indices)} stamps {what} (first: frame {indices[0]}): sort the frames by time, each "
        "time once"
        for indices, what in ((back, "go back in time"), (same, "repeat the one before"))
        if indices
    ]
    return Finding("stamps", tuple(warnings))


def check_order(spans: Sequence[Sequence[Thumbnail]]) -> Finding:
    """Look for images that are out of order.

    Parameters
    ----------
    spans : sequence of sequences of Thumbnail
        Frames that follow each other.

    Returns
    -------
    Finding
        Undecided where too little moves.
    """
    warnings: list[str] = []
    measured: dict[str, float] = {}
    for kind, change in KINDS.items():
        clear, wrong = _count(spans, change)
        if clear < FEWEST:
            continue
        measured[f"{kind}_out_of_order"] = round(wrong / clear, 3)
        if wrong > DISORDER * clear:
            warnings.append(
                f"{kind} images are not in the order in which they were taken: {wrong} of {clear} "
                "are not between the one before and the one after: check the stamps and the names "
                f"of the {kind} images"
            )
    undecided = "" if measured else "too little moves from frame to frame"
    return Finding("order of images", tuple(warnings), undecided, measured)


def _count(spans: Sequence[Sequence[Thumbnail]], change: Change) -> tuple[int, int]:
    """Threes that tell something, and those of them that are out of order."""
    clear = wrong = 0
    for span in spans:
        steps = [change(a, b) for a, b in pairwise(span)]
        across = [change(a, b) for a, b in zip(span, span[2:], strict=False)]
        for before, after, both in zip(steps, steps[1:], across, strict=False):
            most = max(before, after)
            wrong += both * CLEARLY < most
            clear += both * CLEARLY < most or both > CLEARLY * most
    return clear, wrong
