"""Whether the images are sharp."""

from collections.abc import Sequence

import cv2
import numpy as np

from edvo.datasets.inspection.finding import Finding
from edvo.frame import Frame

# Width of the edges of an image (median), pixels. Measured: 2.7 to 4.5 on the recordings at hand;
# 5 with a box of 5 pixels over them, 7 to 8 with one of 9.
WIDE = 5.4
SHARE = 0.5  # of the frames that may be blurred
FEWEST = 100  # edge pixels
CONTRAST = 20.0  # grey values that an edge must span
_WINDOW = np.ones((11, 11), np.uint8)
_BESIDE = np.ones((5, 5), np.uint8)


def check_blur(frames: Sequence[Frame]) -> Finding:
    """Measure how wide edges are.

    Parameters
    ----------
    frames : sequence of Frame

    Returns
    -------
    Finding
        Undecided where there are too few edges of contrast.
    """
    name = "sharpness"
    widths = [width for frame in frames if (width := edge_width(frame)) is not None]
    if 2 * len(widths) < len(frames):
        return Finding(name, undecided="too few edges of enough contrast")
    share = float(np.mean(np.array(widths) > WIDE))
    measured = {"edge_width_px": round(float(np.median(widths)), 2), "blurred": round(share, 3)}
    if share <= SHARE:
        return Finding(name, measured=measured)
    warning = (
        f"images are blurred: edges are {np.median(widths):.1f} px wide in the middle of "
        f"{share:.0%} of the frames: focus, expose for a shorter time, or move more slowly"
    )
    return Finding(name, (warning,), measured=measured)


def edge_width(frame: Frame) -> float | None:
    """Measure over how many pixels an edge goes from dark to bright.

    Parameters
    ----------
    frame : Frame

    Returns
    -------
    float or None
        The median over edges: the range of grey values around over the steepest gradient; None
        where there are too few edges.
    """
    grey = frame.grey
    fine = cv2.GaussianBlur(grey, (0, 0), 0.8)
    edges = cv2.Canny(cv2.GaussianBlur(grey, (0, 0), 2.0), 15, 45) > 0
    du, dv = cv2.Sobel(fine, cv2.CV_32F, 1, 0), cv2.Sobel(fine, cv2.CV_32F, 0, 1)
    steepest = cv2.dilate(np.hypot(du, dv) / 8, _BESIDE)
    span = cv2.subtract(cv2.dilate(fine, _WINDOW), cv2.erode(fine, _WINDOW))
    edges &= span > CONTRAST
    if np.count_nonzero(edges) < FEWEST:
        return None
    return float(np.median(span[edges] / steepest[edges]))
