"""Whether the focal length is right.

A camera that turns sees the middle of its image and the border move differently, by how much
depends on its focal length: with a wrong one the edges of two images do not fit, whatever the
motion. Sideways motion alone says nothing, since a longer way makes up for it.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.walk import Step, mean_residual, motion, pairs_within, registration

FACTORS = (0.7, 0.76, 0.82, 0.87, 0.935, 1.0, 1.07, 1.15, 1.22, 1.32, 1.43)
TURN_DEG = (3.5, 20.0)  # between two frames: less shows nothing, more leaves little to compare
FARTHEST = 10  # frames of a walk between the two
PAIRS, FEWEST_PAIRS = 16, 4
USES = 2  # of a frame
SURE = 2.5  # standard errors by which the fit must be worse away from the best focal length
WORSE_PX = 0.015  # and by how much at least
WRONG = 0.07  # relative error that is worth a warning


def check_focal(steps: Sequence[Step], camera: Camera) -> Finding:
    """Register pairs of frames with focal lengths that are longer and shorter.

    Parameters
    ----------
    steps : sequence of Step
        Frames and how the camera moved between them.
    camera : Camera
        As assumed.

    Returns
    -------
    Finding
        Undecided where the camera turns too little, or the fit says nothing.
    """
    name = "focal length"
    pairs = _turning(steps)
    if len(pairs) < FEWEST_PAIRS:
        return Finding(name, undecided="the camera turns too little between the frames looked at")
    table = np.array([_residuals(pairs, camera, factor) for factor in FACTORS])
    mean = table.mean(axis=1)
    best = int(mean.argmin())
    factor, assumed = _refined(mean, best), FACTORS.index(1.0)
    measured = {"best_factor": round(factor, 3), "pairs": len(pairs)}
    inside = 0 < best < len(FACTORS) - 1
    if inside and abs(np.log(factor)) > WRONG and _is_worse(table[assumed], table[best]):
        return Finding(name, (_warning(camera, factor),), measured=measured)
    # Sure that it is right only if 15 % more or less would have been seen.
    beside = [table[i] for i in (best - 2, best + 2) if 0 <= i < len(FACTORS)]
    if len(beside) == 2 and all(_is_worse(there, table[best]) for there in beside):
        return Finding(name, measured=measured)
    return Finding(name, undecided="other focal lengths fit as well", measured=measured)


def _warning(camera: Camera, factor: float) -> str:
    return (
        f"edges of turning views fit best with {factor:.2f} times the focal length: check fx and "
        f"fy ({camera.fx:.1f} and {camera.fy:.1f} now; about {camera.fx * factor:.0f} fits), and "
        "that they belong to this image size"
    )


def _turning(steps: Sequence[Step]) -> list[tuple[Step, Step]]:
    """Pairs whose views are turned much, the most turned first; no frame in many of them."""
    least, most = np.deg2rad(TURN_DEG)
    turned: list[tuple[float, int, Step, Step]] = []
    for a, b in pairs_within(steps, FARTHEST):
        angle = se3.rotation_angle(motion(a, b))
        if least <= angle <= most:
            turned.append((angle, len(turned), a, b))
    chosen: list[tuple[Step, Step]] = []
    uses: Counter[int] = Counter()
    for _, _, a, b in sorted(turned, key=lambda pair: (-pair[0], pair[1])):
        if len(chosen) < PAIRS and max(uses[id(a)], uses[id(b)]) < USES:
            uses.update((id(a), id(b)))
            chosen.append((a, b))
    return chosen


def _residuals(pairs: Sequence[tuple[Step, Step]], camera: Camera, factor: float) -> list[float]:
    """How well each pair fits with a focal length so many times as long, px."""
    register = registration(camera, factor)
    residuals = []
    for a, b in pairs:
        twist = se3.log(motion(a, b))
        twist[3:] /= factor  # the same motion of the image's middle
        starts = np.array([se3.exp(twist), motion(a, b)])
        residuals.append(mean_residual(register.align(a.index, b.samples, starts)))
    return residuals


def _is_worse(there: NDArray[np.float64], best: NDArray[np.float64]) -> bool:
    """Whether pairs fit worse there, beyond chance."""
    loss = there - best
    error = float(loss.std(ddof=1)) / np.sqrt(len(loss))
    return bool(loss.mean() > max(SURE * error, WORSE_PX))


def _refined(mean: NDArray[np.float64], best: int) -> float:
    """Factor of the best fit, by a parabola over the logarithm."""
    if not 0 < best < len(FACTORS) - 1:
        return FACTORS[best]
    around = slice(best - 1, best + 2)
    a, b, _ = np.polyfit(np.log(FACTORS[around]), mean[around], 2)
    if a <= 0:
        return FACTORS[best]
    low, high = FACTORS[best - 1], FACTORS[best + 1]
    return float(np.clip(np.exp(-b / (2 * a)), low, high))
