"""Whether there is light enough, and stays the same."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.thumbnail import Thumbnail
from edvo.frame import Frame

DARK = 40.0  # grey value that all but the brightest twentieth of a dark image stay below
# Change of brightness from frame to frame (median), and its spread over bands of rows. Measured:
# 0.00 to 0.01 and 0.00 to 0.02 on the recordings at hand at 30 frames a second.
UNSTEADY = 0.04
BANDS = 0.06
SLOWEST_S = 0.2  # frames farther apart may well show other light
FEWEST = 8  # changes to look at
_BLACK = 4.0  # added to grey values, so that noise in the dark is no change


def check_darkness(frames: Sequence[Frame]) -> Finding:
    """Look for images with hardly any light.

    Parameters
    ----------
    frames : sequence of Frame

    Returns
    -------
    Finding
    """
    bright = float(np.median([np.percentile(frame.grey[::4, ::4], 95) for frame in frames]))
    warnings = []
    if bright < DARK:
        warnings.append(
            f"images are too dark: 95 % of the pixels are below grey value {bright:.0f} of 255: "
            "add light, or lengthen exposure or gain"
        )
    return Finding("darkness", tuple(warnings), measured={"bright_grey": round(bright, 1)})


def check_exposure(spans: Sequence[Sequence[Thumbnail]], interval: float) -> Finding:
    """Look for brightness that changes from frame to frame, as a whole or in bands.

    Parameters
    ----------
    spans : sequence of sequences of Thumbnail
        Frames that follow each other.
    interval : float
        Usual time between two, seconds.

    Returns
    -------
    Finding
        Undecided where frames are too far apart.
    """
    name = "steady exposure"
    pairs = [pair for span in spans for pair in pairwise(span)]
    if len(pairs) < FEWEST or interval > SLOWEST_S:
        return Finding(name, undecided="too few frames follow each other closely")
    gains, bands = [], []
    for a, b in pairs:
        change = np.log((b.grey + _BLACK) / (a.grey + _BLACK))
        gain = float(np.median(change))
        gains.append(abs(gain))
        bands.append(float((np.median(change, axis=1) - gain).std()))
    gain, band = float(np.median(gains)), float(np.median(bands))
    measured = {"gain_change": round(gain, 4), "band_change": round(band, 4)}
    warnings = []
    if gain > UNSTEADY:
        warnings.append(
            f"brightness changes by {np.expm1(gain):.0%} from frame to frame: fix the exposure, or "
            "take lamps that do not flicker"
        )
    if band > BANDS:
        warnings.append(
            "brightness changes in bands of rows from frame to frame: lamps flicker under a "
            "rolling shutter; expose for whole periods of the mains"
        )
    return Finding(name, tuple(warnings), measured=measured)
