"""Whether colour and depth move at the same time.

What depth images move by from frame to frame is compared with what colour images move by, at
several delays; the delay at which the two agree best is the one between colour and depth.
"""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.thumbnail import Thumbnail, colour_change, depth_change

FARTHEST = 3  # frames of delay that are looked for
AGREEMENT = 0.6  # correlation at the best delay that can be trusted
SHARPNESS = 0.15  # and how much lower it must be two frames off
# Correlation lost at no delay against the best: 0.08 on TUM fr1, whose depth is half a frame off.
LOSS = 0.15
LEAST = 0.75  # frames of delay that are worth a warning
FEWEST = 24  # changes to compare


def check_step(spans: Sequence[Sequence[Thumbnail]], interval: float) -> Finding:
    """Estimate the delay of depth against colour.

    Parameters
    ----------
    spans : sequence of sequences of Thumbnail
        Frames that follow each other.
    interval : float
        Usual time between two, seconds.

    Returns
    -------
    Finding
        Undecided where the motion is too even to tell.
    """
    name = "colour and depth in step"
    runs = [_changes(span) for span in spans if len(span) > 2 * FARTHEST + 2]
    if sum(len(run) for run in runs) < FEWEST:
        return Finding(name, undecided="too few frames follow each other")
    best: tuple[float, NDArray[np.float64]] | None = None
    for channel in range(3):
        curve = _curve([run[:, channel] for run in runs], [run[:, 3 + channel] for run in runs])
        at = int(curve.argmax())
        beside = np.abs(np.arange(len(curve)) - at) >= 2
        sharpness = float(curve[at] - curve[beside].max())
        clear = curve[at] >= AGREEMENT and sharpness >= SHARPNESS and 0 < at < len(curve) - 1
        if clear and (best is None or sharpness > best[0]):
            best = sharpness, curve
    if best is None:
        return Finding(name, undecided="the motion is too even, or too little, to tell a delay")
    curve = best[1]
    at = int(curve.argmax())
    left, middle, right = curve[at - 1 : at + 2].tolist()
    delay = at - FARTHEST + 0.5 * (left - right) / (left - 2 * middle + right)
    measured = {"delay_frames": round(delay, 2), "correlation": round(middle, 3)}
    if abs(delay) < LEAST or middle - curve[FARTHEST] < LOSS:
        return Finding(name, measured=measured)
    warning = (
        f"depth {'lags' if delay > 0 else 'leads'} colour by about {abs(delay):.1f} frames "
        f"({abs(delay) * interval * 1e3:.0f} ms): pair the images by the times they were taken at"
    )
    return Finding(name, (warning,), measured=measured)


def _changes(span: Sequence[Thumbnail]) -> NDArray[np.float64]:
    """Motion right and down and amount of change of colour, then of depth; (N - 1, 6)."""
    height, width = span[0].grey.shape
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    rows = []
    for a, b in pairwise(span):
        colour, _ = cv2.phaseCorrelate(a.grey, b.grey, window)
        depth, _ = cv2.phaseCorrelate(a.closeness, b.closeness, window)
        rows.append([*colour, colour_change(a, b), *depth, depth_change(a, b)])
    return np.array(rows, np.float64)


def _curve(
    colour: Sequence[NDArray[np.float64]], depth: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Correlation at each delay of depth, from -FARTHEST to FARTHEST frames."""
    curve = np.zeros(2 * FARTHEST + 1)
    for delay in range(-FARTHEST, FARTHEST + 1):
        # The same changes of colour at each delay.
        a = np.concatenate([run[FARTHEST : len(run) - FARTHEST] for run in colour])
        b = np.concatenate([run[FARTHEST + delay : len(run) - FARTHEST + delay] for run in depth])
        a, b = a - a.mean(), b - b.mean()
        scale = float(np.sqrt((a @ a) * (b @ b)))
        curve[FARTHEST + delay] = float(a @ b) / scale if scale > 0 else 0.0
    return curve
