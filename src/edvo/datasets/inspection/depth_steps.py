"""The depth scale by the sensor's own ruler: the steps in which its depth comes.

A structured-light camera measures a disparity in steps of an eighth of a pixel, and its depth is
a constant over the disparity: inverse depth comes in equal steps 1/K, depth in steps of z^2/K,
with K = 8 focal baseline. A wrong depth scale multiplies K. Measured: 351 m on ICL-NUIM (whose
noise model has this law), 347 m and 342 m on TUM fr1 and fr3.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.finding import Finding
from edvo.frame import Frame

KINECT_M = 345.0
TOLERANCE = 0.045  # relative, of K: cameras of one kind differ by 2.5 %
# Wrong factors that occur: millimetres, centimetres, TUM's 5000 for 1000 and the other way round.
FACTORS = (0.001, 0.01, 0.1, 0.2, 5.0, 10.0, 100.0, 1000.0)
KINECT_RANGE_M = (0.35, 12.0)  # that a Kinect sees; other cameras may have 5 times its K
CLEAR = 0.35  # coherence of steps that are there (0.7 to 0.98 on the sequences above)
SEARCH = (15.0, 2600.0)  # K over the median depth
NARROWEST = 1.15  # ratio of far to near depth, below which any steps look like these
MEDIUM = 0.6  # of the strongest coherence: a lower K that has so much is no mere fraction of it
LOW = 0.1  # coherence at which the lobe at zero has ended
WIDEST = 20.0  # range of inverse depth in units of its median that is looked at
_FINENESS = 8  # bins for a step of the largest K


def check_depth_steps(frames: Sequence[Frame], depth_scale: float) -> Finding:
    """Compare the steps of depth with those of a Kinect.

    Parameters
    ----------
    frames : sequence of Frame
        At least one.
    depth_scale : float
        What is assumed, for the message.

    Returns
    -------
    Finding
        Undecided where depth has no such steps, or those of an unknown camera.
    """
    name = "depth steps"
    depth = np.concatenate([frame.depth[::3, ::3].ravel() for frame in frames])
    depth = depth[depth > 0]
    found = step_constant(depth)
    if found is None:
        return Finding(name, undecided="depth does not come in steps that grow with its square")
    constant, coherence = found
    measured = {"constant_m": round(constant, 2), "coherence": round(coherence, 3)}
    if abs(constant / KINECT_M - 1) < TOLERANCE:
        return Finding(name, measured=measured)
    near, far = (float(value) for value in np.percentile(depth, (1, 99)))
    for factor in FACTORS:
        fits = abs(constant / factor / KINECT_M - 1) < TOLERANCE
        if fits and near / factor > KINECT_RANGE_M[0] and far / factor < KINECT_RANGE_M[1]:
            much = (
                f"{factor:g} times too large" if factor > 1 else f"{1 / factor:g} times too small"
            )
            warning = (
                f"depth comes in steps of z^2/{constant:.4g} m, a Kinect's are z^2/{KINECT_M:g} m: "
                f"depth is {much}; depth_scale is {depth_scale:g}, try {depth_scale * factor:g}"
            )
            return Finding(name, (warning,), measured=measured)
    why = f"depth comes in steps of z^2/{constant:.4g} m, which no camera is known for here"
    return Finding(name, undecided=why, measured=measured)


def step_constant(depth: NDArray[np.float32]) -> tuple[float, float] | None:
    """Find the K of steps z^2/K.

    Parameters
    ----------
    depth : ndarray of float32, shape (N,)
        Metres, all positive.

    Returns
    -------
    (float, float) or None
        K in metres, and the coherence of the steps, from 0 to 1; None if there are none.

    Notes
    -----
    The histogram of inverse depth is a comb; its Fourier transform has a peak at K.
    """
    if len(depth) < 1000:
        return None
    near, middle, far = (float(value) for value in np.percentile(depth, (0.5, 50, 99.5)))
    if far < NARROWEST * near:
        return None
    near = max(near, middle / WIDEST)
    inverse = middle / depth[(depth >= near) & (depth <= far)].astype(np.float64)
    low, high = float(inverse.min()), float(inverse.max())
    bins = int(np.ceil((high - low) * SEARCH[1] * _FINENESS))
    counts, _ = np.histogram(inverse, bins, (low, high))
    length = 2 ** int(np.ceil(np.log2(4 * bins)))  # zeros after it: a finer spectrum
    spectrum = np.abs(np.fft.rfft(counts, length)) / counts.sum()
    unit = bins / (high - low) / length  # of K over the median depth, for one bin
    # The lobe at zero tells of the scene, not of steps.
    first = max(int(SEARCH[0] / unit), int((spectrum < LOW).argmax()))
    last = int(SEARCH[1] / unit)
    part = spectrum[first:last]
    if not len(part):
        return None
    peak = float(part.max())
    if peak < CLEAR:
        return None
    # Multiples of K fit as well, if less: take the lowest that fits about as well.
    lowest = int(np.flatnonzero(part > MEDIUM * peak)[0])
    reach = max(2, round(0.02 * (first + lowest)))
    at = lowest + int(part[lowest : lowest + reach].argmax())
    return (first + at) * unit * middle, float(part[at])
