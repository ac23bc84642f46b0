"""When a camera takes its images: two cameras of one device rarely do so together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Clock:
    """The instants of one camera.

    Parameters
    ----------
    rate : float
        Images a second.
    offset : float
        Seconds after the start of the first image.
    jitter : float
        Standard deviation in seconds of each instant about its regular place; no more than 0.4
        periods away from it, so that the order stays.

    Notes
    -----
    A Kinect's colour and depth cameras run freely, each at its own phase: in the TUM sequences
    their stamps differ by up to 20 ms. ``Clock(30)`` for one and ``Clock(30, offset=0.012,
    jitter=0.001)`` for the other is like that.
    """

    rate: float = 30.0
    offset: float = 0.0
    jitter: float = 0.0

    def times(self, frames: int, rng: np.random.Generator | None = None) -> NDArray[np.float64]:
        """Give the instants of the first images.

        Parameters
        ----------
        frames : int
            How many.
        rng : numpy.random.Generator, optional
            Where the jitter comes from; none without it.

        Returns
        -------
        ndarray of float64, shape (frames,)
            Seconds from the start of the sequence, rising.
        """
        regular = self.offset + np.arange(frames) / self.rate
        if rng is None or self.jitter == 0:
            return regular
        limit = 0.4 / self.rate
        return regular + np.clip(rng.normal(0.0, self.jitter, frames), -limit, limit)
