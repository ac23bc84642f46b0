"""Keyframes by information: which frames are better placed than those of late.

Not in the paper. A keyframe hands its own error on to all frames that are registered with it, and
not every frame near the end of a keyframe's reach is equally good: one may be blurred, turning, or
see little. Covariances tell. How large they are in general differs from scene to scene, so each is
held against those of the last half second.
"""

import math

import numpy as np
from numpy.typing import NDArray

MEMORY_S = 0.5  # that the mean of the spread is taken over


def spread(covariance: NDArray[np.float64]) -> float:
    """Size of a region of confidence in one number: what its half-axes are, in the geometric mean.

    Parameters
    ----------
    covariance : ndarray of float64, shape (6, 6)
        Of a twist [v, w], metres and radians.

    Returns
    -------
    float
        The entropy's exponential but for a factor: det(C)^(1/12). Ratios of it do not depend on
        units.
    """
    return math.exp(float(np.linalg.slogdet(covariance)[1]) / 12)


class Information:
    """Compares each frame's covariance with the mean of late."""

    def __init__(self) -> None:
        self._usual = math.nan

    def is_better(self, covariance: NDArray[np.float64], seconds: float) -> bool:
        """Whether a frame is better constrained than those of late; then it is one of them.

        Parameters
        ----------
        covariance : ndarray of float64, shape (6, 6)
            Of ``T_key_cur``.
        seconds : float
            Since the frame before it.

        Returns
        -------
        bool
            False for the first one, which nothing can be held against.
        """
        size = spread(covariance)
        better = size < self._usual
        if math.isnan(self._usual):
            self._usual = size
        self._usual += (size - self._usual) * min(seconds / MEMORY_S, 1.0)
        return better
