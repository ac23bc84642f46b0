"""How far Canny's thresholds sink where an image is plain or dark. Not in the paper."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.config import EdgesConfig

STRONGEST = 2**14  # more than |du| + |dv| can be, in eighths: a threshold that marks nothing
STEP_PX = 4  # a sixteenth of the pixels tells how strong their gradients are
QUIET_SHARE = 0.25  # of the pixels that have a gradient: on so many it is taken for noise


class Scales(NamedTuple):
    """By what the thresholds on ``|du| + |dv|`` are multiplied, in (0, 1].

    Attributes
    ----------
    usual : float
        So that the edges tell places.
    faint : float
        As low as the noise of the image allows; no more than ``usual``.
    """

    usual: float
    faint: float


def threshold_scales(du: NDArray[np.int16], dv: NDArray[np.int16], config: EdgesConfig) -> Scales:
    """Tell how far the thresholds sink for an image.

    Parameters
    ----------
    du, dv : ndarray of int16, shape (H, W)
        Sobel gradients, in ``config.grey_steps``-ths of a grey level.
    config : EdgesConfig

    Returns
    -------
    Scales
    """
    if not config.strong_share:
        return Scales(1.0, 1.0)
    high = config.grey_steps * max(config.low, config.high)
    counts = np.zeros(min(math.ceil(high), STRONGEST) + 1, np.int32)
    kernels.count_strengths(du, dv, STEP_PX, counts)
    strong = exceeded(counts, config.strong_share) / high
    noise = config.noise_margin * undercut(counts, QUIET_SHARE) / high
    lowest = min(config.least_scale, max(noise, config.faint_scale))
    return Scales(*(min(max(strong, floor), 1.0) for floor in (config.least_scale, lowest)))


def exceeded(counts: NDArray[np.int32], share: float) -> int:
    """Tell which strength this share of the pixels exceeds, at most.

    Parameters
    ----------
    counts : ndarray of int32, shape (N,)
        How many pixels have the strength 0, 1, and so on, in steps of ``|du| + |dv|``.
    share : float
        Of all of them, in [0, 1).

    Returns
    -------
    int
    """
    return kernels.exceeded(counts, share)


def undercut(counts: NDArray[np.int32], share: float) -> float:
    """Tell which strength this share of the pixels that have any stays below.

    Those without lie in what is black or white, where noise is cut off.

    Parameters
    ----------
    counts : ndarray of int32, shape (N,)
        As for `exceeded`.
    share : float
        Of those with any, in (0, 1].

    Returns
    -------
    float
        Between two whole numbers; 0 where no pixel has any.
    """
    return kernels.undercut(counts, share)
