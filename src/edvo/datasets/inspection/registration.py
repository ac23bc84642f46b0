"""Whether the edges of depth lie on those of colour.

They are laid over each other at all small offsets, and enlarged or reduced a little. Contours of
depth are the better evidence; creases, where planes meet, say something in bare places as well.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.inspection.edge_fields import Field, colour_field, depth_field, reduction
from edvo.datasets.inspection.finding import Finding
from edvo.frame import Frame

REACH = 16  # reduced pixels: the farthest offset that is looked for
# Offsets to worry about, in pixels of an image 640 wide. Measured: up to 3 on the TUM and ICL-NUIM
# recordings at hand, as their makers registered them.
ALLOWED = 4.0
# How much better another offset must fit than any within half of that. Measured: 1.11 to 2.9 with
# depth moved by 8 pixels on those recordings, up to 1.05 as they are and on rendered corridors.
BETTER = 1.08
AGREEMENT = 3.0  # pixels of an image 640 wide within which both halves of the frames agree
SCALES = (0.7, 0.77, 0.84, 0.92, 1.09, 1.19, 1.3, 1.42)
BETTER_SCALED = 1.25  # how much better depth must fit when enlarged or reduced
FRAMES, SCALED_FRAMES = 18, 6  # that are looked at, and that are tried at all scales
FEWEST_FRAMES = 5  # one alone may fit anywhere by chance
FEWEST = 100  # edge pixels of depth a frame, reduced; below that there is nothing to compare
LEAST_FIT = 0.06  # mean agreement of directions at the best offset, weighted by contrast

Map = NDArray[np.float64]


@dataclass(frozen=True)
class Offset:
    """How depth has to move to fit colour best.

    Parameters
    ----------
    right, down : float
        Pixels of the full image.
    fit, fit_near : float
        How well it fits there, and at the best place near zero.
    stable : bool
        Whether both halves of the frames say the same.
    """

    right: float
    down: float
    fit: float
    fit_near: float
    stable: bool


def check_registration(frames: Sequence[Frame]) -> Finding:
    """Compare the edges of depth with those of colour.

    Parameters
    ----------
    frames : sequence of Frame
        Of one size.

    Returns
    -------
    Finding
        Undecided where depth shows too few edges, or they fit nowhere.
    """
    name = "registration"
    width = frames[0].grey.shape[1]
    if len(frames) < FEWEST_FRAMES:
        return Finding(name, undecided="too few frames")
    fields = list(_fields(frames))
    edges = float(np.mean([np.count_nonzero(depth.any(axis=2)) for _, depth in fields]))
    if edges < FEWEST:
        return Finding(name, undecided="depth shows too few contours and creases")
    offset = _offset(fields, reduction(width))
    allowed = ALLOWED * width / 640
    farthest = max(abs(offset.right), abs(offset.down))
    measured = {
        "right_px": round(-offset.right, 1),
        "down_px": round(-offset.down, 1),
        "fit": round(offset.fit, 3),
    }
    scale, gain = _scale(fields[:: max(1, len(fields) // SCALED_FRAMES)])
    if gain > BETTER_SCALED:
        warning = (
            f"depth fits colour best when it is scaled by {scale:g} about the centre: it is of "
            "another camera; register depth to colour"
        )
        return Finding(name, (warning,), measured={**measured, "scale": scale})
    if offset.fit < LEAST_FIT:
        return Finding(name, undecided="edges of depth fit those of colour nowhere near")
    if farthest <= allowed:
        return Finding(name, measured=measured)
    if not offset.stable or offset.fit < BETTER * offset.fit_near:
        return Finding(name, undecided="edges leave the offset open", measured=measured)
    # Where depth has to move, there it is not.
    across = f"{abs(offset.right):.0f} px {'left' if offset.right > 0 else 'right'}"
    down = f"{abs(offset.down):.0f} px {'above' if offset.down > 0 else 'below'}"
    warning = (
        f"depth lies about {across} and {down} colour: "
        "register depth to colour, and pair images of the same time"
    )
    return Finding(name, (warning,), measured=measured)


def _fields(frames: Sequence[Frame]) -> Iterator[tuple[Field, Field]]:
    """Spectrum of colour and field of depth of some frames."""
    factor = reduction(frames[0].grey.shape[1])
    for frame in frames[:: max(1, len(frames) // FRAMES)]:
        colour = colour_field(frame.grey, factor)
        yield np.asarray(cv2.dft(_padded(colour)), np.float32), depth_field(frame.depth, factor)


def _offset(fields: Sequence[tuple[Field, Field]], factor: int) -> Offset:
    halves = [_fit(fields[::2]), _fit(fields[1::2] or fields)]
    whole = halves[0] + halves[1]
    right, down = _peak(whole)
    others = [_peak(half) for half in halves]
    allowed = AGREEMENT / 2
    stable = all(max(abs(u - right), abs(v - down)) <= allowed for u, v in others)
    half = round(ALLOWED / 4)
    middle = slice(REACH - half, REACH + half + 1)
    # A reduced pixel is the mean of colour there, but depth of its first pixel.
    first = (factor - 1) / 2
    return Offset(
        right * factor + first,
        down * factor + first,
        float(whole.max()) / 2,
        float(whole[middle, middle].max()) / 2,
        stable,
    )


def _scale(fields: Sequence[tuple[Field, Field]]) -> tuple[float, float]:
    """Scale of depth at which it fits best, and how much better than as it is."""
    fit = float(_fit(fields).max())
    best, most = 1.0, fit
    for scale in SCALES:
        found = float(_fit(fields, scale).max())
        if found > most:
            best, most = scale, found
    return best, most / max(fit, 1e-6)


def _scaled(field: Field, scale: float) -> Field:
    height, width = field.shape[:2]
    u, v = (1 - scale) * (width - 1) / 2, (1 - scale) * (height - 1) / 2
    matrix = np.array([[scale, 0, u], [0, scale, v]], np.float32)
    return np.asarray(
        cv2.warpAffine(field, matrix, (width, height), flags=cv2.INTER_NEAREST), np.float32
    )


def _fit(fields: Sequence[tuple[Field, Field]], scale: float = 1.0) -> Map:
    """Agreement at each offset, (2 REACH + 1)^2: rows down, columns right that depth moves."""
    total = np.zeros_like(fields[0][0])
    pixels = 0
    for spectrum, depth in fields:
        scaled = depth if scale == 1 else _scaled(depth, scale)
        total += cv2.mulSpectrums(spectrum, cv2.dft(_padded(scaled)), 0, conjB=True)
        pixels += int(np.count_nonzero(scaled.any(axis=2)))
    whole = cv2.dft(total, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)[..., 0]
    side = 2 * REACH + 1
    offsets = np.roll(whole, (REACH, REACH), (0, 1))[:side, :side].astype(np.float64)
    return offsets / max(pixels, 1)


def _padded(field: Field) -> Field:
    """Field with room for offsets, of a size that transforms fast."""
    height, width = field.shape[:2]
    down = cv2.getOptimalDFTSize(height + 2 * REACH) - height
    right = cv2.getOptimalDFTSize(width + 2 * REACH) - width
    return np.pad(field, ((0, down), (0, right), (0, 0)))


def _peak(fit: Map) -> tuple[float, float]:
    """Offset right and down of the peak, by parabolas between pixels."""
    v, u = (int(i) for i in np.unravel_index(int(fit.argmax()), fit.shape))
    return u - REACH + _between(fit[v], u), v - REACH + _between(fit[:, u], v)


def _between(values: Map, at: int) -> float:
    if not 0 < at < len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1 : at + 2].tolist()
    bend = left - 2 * middle + right
    return 0.5 * (left - right) / bend if bend < 0 else 0.0
