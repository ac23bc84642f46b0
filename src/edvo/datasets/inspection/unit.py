"""Whether stamps are in seconds."""

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.finding import Finding
from edvo.stamps import mend_of


def check_unit(timestamps: NDArray[np.float64]) -> Finding:
    """Look for stamps in milliseconds and smaller units.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Taken as seconds.

    Returns
    -------
    Finding
        A time lapse by the stamps of a clock is none.
    """
    if len(timestamps) < 3:
        return Finding("unit of stamps", undecided="there are too few frames")
    warning = mend_of(timestamps)
    return Finding("unit of stamps", (warning,) if warning else ())
