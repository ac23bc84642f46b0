"""Looking at a few frames for what commonly is wrong with recordings."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.source import Source
from edvo.frame import Frame

# What depth cameras are used for; a wrong depth scale (1000 for 5000) mostly leads out of it.
PLAUSIBLE_DEPTH_M = (0.25, 12.0)
FEWEST_VALID = 0.1  # share of pixels with depth

# Contours of depth lie within so many pixels of edges in colour, for all the noise of sensors.
NEAR_PX = 5
REACH_PX = 32  # the farthest offset that is looked for
# How much better they must fit elsewhere. Measured: 1.0 to 1.1 on registered TUM and ICL-NUIM
# recordings, above 2 on the same with depth moved by 12 pixels.
BETTER = 1.5
FEWEST_CONTOUR_PIXELS = 200  # a frame; below that there is nothing to compare
DEPTH_STEP = 1.1  # a contour is where depth grows by this factor


def inspect(source: Source, *, frames: int = 6) -> list[str]:
    """Look at some frames, evenly spread.

    Parameters
    ----------
    source : Source
        Whose frames.
    frames : int
        How many to look at.

    Returns
    -------
    list of str
        What looks wrong, a line each: unreadable frames, a depth scale that gives implausible
        depth, hardly any depth, depth that is not registered to colour.
    """
    indices = np.unique(np.linspace(0, len(source) - 1, frames).astype(int))
    readings = [source.read(int(index)) for index in indices]
    warnings = [reading.problem for reading in readings if reading.problem is not None]
    good = [reading.frame for reading in readings if reading.frame is not None]
    if good:
        warnings += _look_at_depth(good, source.camera.depth_scale)
        warnings += _look_at_registration(good)
    return warnings


def contour_offset(frames: Sequence[Frame]) -> tuple[int, int] | None:
    """Find how far the contours of depth lie from those of colour, if they do.

    Parameters
    ----------
    frames : sequence of Frame
        Of one size; several, so that chance averages out.

    Returns
    -------
    (int, int) or None
        Pixels right and down by which depth has to move to fit best; None where it fits as it
        is, or where there are too few contours to tell.

    Notes
    -----
    The correlation of both edge masks, by Fourier transform, is searched within `REACH_PX`.
    """
    side = 2 * REACH_PX + 1
    total = np.zeros((side, side))
    pixels = 0
    for frame in frames:
        edges, contours = _edges(frame.grey), _contours(frame.depth)
        size = tuple(2 * length for length in edges.shape)
        spectrum = np.fft.rfft2(edges - edges.mean(), size)
        spectrum *= np.conj(np.fft.rfft2(contours, size))
        whole = np.roll(np.fft.irfft2(spectrum, size), (REACH_PX, REACH_PX), (0, 1))
        total += whole[:side, :side]
        pixels += int(contours.sum())
    if pixels < FEWEST_CONTOUR_PIXELS * len(frames):
        return None
    down, right = np.unravel_index(int(total.argmax()), total.shape)
    near = slice(REACH_PX - NEAR_PX, REACH_PX + NEAR_PX + 1)
    if total.max() <= BETTER * max(float(total[near, near].max()), 0.0):
        return None
    return int(right) - REACH_PX, int(down) - REACH_PX


def _look_at_depth(frames: Sequence[Frame], depth_scale: float) -> list[str]:
    warnings = []
    valid = float(np.mean([np.mean(frame.depth > 0) for frame in frames]))
    if valid < FEWEST_VALID:
        warnings.append(f"only {valid:.1%} of the depth pixels have a value")
    middle = float(np.median([np.median(frame.depth[frame.depth > 0]) for frame in frames]))
    nearest, farthest = PLAUSIBLE_DEPTH_M
    if not nearest <= middle <= farthest:
        warnings.append(
            f"half of the depth is {'below' if middle < nearest else 'above'} {middle:.3g} m, "
            f"which is implausible: check depth_scale ({depth_scale:g} now; 5000 for TUM, 1000 "
            "for most cameras)"
        )
    return warnings


def _look_at_registration(frames: Sequence[Frame]) -> list[str]:
    offset = contour_offset(frames)
    if offset is None:
        return []
    return [
        f"contours of depth lie about {-offset[0]} px right and {-offset[1]} px below those of "
        "colour: register depth to colour"
    ]


def _edges(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Edges of an image, widened by a pixel or two so that a near miss counts."""
    mask = cv2.Canny(cv2.GaussianBlur(grey, (5, 5), 0), 30, 90)
    return np.asarray(cv2.GaussianBlur(mask, (5, 5), 0), np.float32) * np.float32(1 / 255)


def _contours(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels near which, on the far side of any hole, depth is much larger."""
    beyond = cv2.dilate(depth, np.ones((5, 5), np.uint8))
    far = np.asarray(beyond, np.float32) > DEPTH_STEP * depth
    return np.asarray((depth > 0) & far, np.float32)
