"""How busy an image is and how much of its depth is missing: made sequences beside real ones."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.source import Source
from edvo.errors import DatasetError

_LOW, _HIGH = 50, 100  # Canny's usual thresholds, not those of a tracker


@dataclass(frozen=True)
class Look:
    """Means over the images of a sequence.

    Parameters
    ----------
    edges : float
        Share of edge pixels, by Canny 50/100 after a 5x5 blur.
    gradient : float
        Mean length of the 3x3 Sobel gradient after that blur, grey levels.
    missing : float
        Share of pixels without depth.
    """

    edges: float
    gradient: float
    missing: float

    def over(self, other: "Look") -> "Look":
        """Give the ratio of each figure to that of another sequence."""
        names = [each.name for each in fields(self)]
        return Look(*(getattr(self, name) / getattr(other, name) for name in names))


def look_of(grey: NDArray[np.uint8], depth: NDArray[np.float32]) -> Look:
    """Measure a frame.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
        Its image.
    depth : ndarray of float32, shape (H, W)
        0 where missing.

    Returns
    -------
    Look
        Of this frame alone.
    """
    blurred = cv2.GaussianBlur(grey, (5, 5), 0)
    dx, dy = (cv2.Sobel(blurred, cv2.CV_16S, *order) for order in ((1, 0), (0, 1)))
    edges = cv2.Canny(dx, dy, _LOW, _HIGH) > 0
    steep = np.hypot(dx.astype(np.float32), dy.astype(np.float32))
    return Look(float(edges.mean()), float(steep.mean()), float((depth == 0).mean()))


def look_of_source(source: Source, frames: int = 12) -> Look:
    """Measure a sequence.

    Parameters
    ----------
    source : Source
        Made or recorded.
    frames : int
        How many to look at, evenly spread.

    Returns
    -------
    Look
        Means over them.

    Raises
    ------
    DatasetError
        If none of them can be read.
    """
    chosen = np.unique(np.linspace(0, len(source) - 1, frames).round().astype(int))
    read = (source.read(int(index)).frame for index in chosen)
    looks = [look_of(frame.grey, frame.depth) for frame in read if frame is not None]
    if not looks:
        raise DatasetError(f"{source.name}: no frame to look at can be read")
    names = [each.name for each in fields(Look)]
    return Look(*(float(np.mean([getattr(look, name) for look in looks])) for name in names))


#: The real sequences that a scene is to look like, and in what. Of the textured sequences at hand
#: none shows the structure of `texture_*`: how busy the image is comes from a desk, how many holes
#: the depth has from the same structure without texture. The holes on dark, glossy and slanted
#: surfaces are held to the scenes that have them: a desk with screens, a dark cabinet.
MODELLED_ON: Mapping[str, Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "notexture_far": {
            "tum_fr3_structure_notexture_far": ("edges", "gradient", "missing"),
        },
        "texture_far": {
            "tum_fr1_xyz": ("edges", "gradient"),
            "tum_fr3_structure_notexture_far": ("missing",),
        },
        "texture_near": {
            "tum_fr1_xyz": ("edges", "gradient"),
            "tum_fr3_structure_notexture_far": ("missing",),
        },
        "office": {"tum_fr1_xyz": ("edges", "missing")},
        "cabinet": {"tum_fr3_cabinet_sparse": ("missing",)},
    }
)
