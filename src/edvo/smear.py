"""How smeared the edges of images are, and by how much they are blurred for that.

Not in the paper. What moves while an image is exposed, or is out of focus, leaves ramps in place of
edges, and of a texture what depends on the way that it moved: the next image shows other edges.
Blurred by more, images that are smeared otherwise become alike, and a ramp has a middle again.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.config import EdgesConfig
from edvo.edges import EdgeImage
from edvo.exposure import Exposure, sharp_variance

SMEARED_PX2 = 0.6  # of what is added to that: by so much for each pass images are blurred by more
PASSES = (0, 1, 2, 4)
HOLLOW_PX2 = 0.4  # what a pass adds in the middle of a profile beyond its own: it skips pixels
LASTING = 0.5  # of that by which a pass begins, down to which it goes on: texture tells less then
FAR = 2  # of `PASSES`: what lacks so many is mended at once
MEMORY_S = 0.3  # that is averaged over
ENOUGH = 50  # edges that tell


class Smear:
    """Measures by how much the edges of a camera's images are smeared, frame after frame.

    Parameters
    ----------
    config : EdgesConfig
        ``smear`` says whether it is measured, ``blur_px`` how wide sharp edges are. By other
        extractors than Canny, or at whole pixels, it is not.
    exposure : Exposure, optional
        Of the images: as long as none is known, edges are soft by themselves. Where it is not
        asked for, or not given, motion is taken to have smeared them.

    Attributes
    ----------
    passes : int
        Of a blur of 2 px^2 each, beyond the usual, for the next image.
    """

    def __init__(self, config: EdgesConfig, exposure: Exposure | None = None) -> None:
        self._exposure = exposure if exposure is not None and exposure.is_on else None
        self._is_on = (config.smear, config.extractor) == ("measured", "canny")
        self._sharp = sharp_variance(config.blur_px)
        self.forget()

    def forget(self) -> None:
        """Take images to be sharp, until there is evidence to the contrary."""
        self.passes, self._variance, self._last = 0, 0.0, -math.inf

    def note(self, edges: EdgeImage, profiles: NDArray[np.float32], timestamp: float) -> None:
        """Learn from the edges of an image.

        Parameters
        ----------
        edges : EdgeImage
            All of them.
        profiles : ndarray of float32, shape (N, 2) or (0, 2)
            Of some of them, see ``EdgePixels``; fewer than 50 tell nothing.
        timestamp : float
            Seconds.
        """
        if not self._is_on or len(profiles) < ENOUGH:
            return
        blur = edges.blur_px2 + (HOLLOW_PX2 if edges.passes else 0.0)
        smeared = edge_variance(profiles) - self._sharp - blur
        share = min(abs(timestamp - self._last) / MEMORY_S, 1.0)
        self._variance += share * (smeared - self._variance)
        self._last = timestamp
        wanted = self._wanted()
        if PASSES.index(wanted) - PASSES.index(self.passes) >= FAR:
            self.passes = wanted

    def settle(self) -> int:
        """Choose by how much a keyframe is blurred, and those after it.

        Until the next one that is only raised, and only by much: blurred otherwise, an image shows
        other edges.

        Returns
        -------
        int
            ``passes``.
        """
        self.passes = self._wanted()
        return self.passes

    def _wanted(self) -> int:
        """The passes that edges so smeared call for; a little less lets those there are go on."""
        if self._exposure is not None and not self._exposure.seconds:
            return 0
        for passes in reversed(PASSES):
            lasts = LASTING if passes <= self.passes else 1.0
            if self._variance > lasts * passes * SMEARED_PX2:
                return passes
        return 0


def edge_variance(profiles: NDArray[np.float32]) -> float:
    """Tell how wide the middle one of the stronger half of some edges is: noise widens faint ones.

    Parameters
    ----------
    profiles : ndarray of float32, shape (N, 2)
        See ``EdgePixels``.

    Returns
    -------
    float
        Variance, px^2, of the Gaussian that its gradient falls off by.
    """
    half = len(profiles) // 2
    bends = profiles[np.argpartition(profiles[:, 0], half)[half:], 1]
    middle = len(bends) // 2
    return -1.0 / min(float(np.partition(bends, middle)[middle]), -kernels.FLATTEST)
