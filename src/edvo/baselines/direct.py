"""The direct method with a t-distribution: brightness of every pixel with depth.

Own code after the paper; its authors' programs are GPL and nothing is taken from them.

References
----------
C. Kerl, J. Sturm, D. Cremers, "Robust odometry estimation for RGB-D cameras", ICRA 2013.
E. Malis, "Improving vision-based control using efficient second-order minimization techniques",
ICRA 2004.
"""

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines import kernels
from edvo.baselines.least_squares import Robust, fit
from edvo.baselines.pairwise import KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.frame import Frame
from edvo.kernels import Pinhole

LEVELS = 4  # 640 to 80 pixels
FINEST = 1  # the half size: the full one takes three times as long and gains nothing
DEPTH_GAP = 0.05  # relative depth step that separates two surfaces
MIN_GRADIENT = 3.0  # grey values a pixel; flat surfaces only show how light drifts
MIN_CORRELATION = 0.5  # of both brightnesses, below which two images show different things
ROBUST = Robust(nu=5.0, floor=0.1, min_rows=200, max_iterations=30, stop=0.002, stop_decrease=1e-5)


@dataclass(frozen=True, slots=True)
class Level:
    """One size of an image.

    Attributes
    ----------
    image : ndarray of float32, shape (H, W, 3)
        Brightness and its two derivatives.
    points : ndarray of float32, shape (N, 6)
        x, y, z in metres, brightness and its derivatives of the pixels with depth.
    """

    image: NDArray[np.float32]
    points: NDArray[np.float32]


class DirectAligner:
    """Registers two frames by their brightness.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    levels : int
        Sizes of the pyramid, each half of the one before.
    finest : int
        The last level that is registered, 0 for the full size.
    min_gradient : float
        Pixels with less, grey values a pixel, are left out.
    robust : Robust
        Weights and stopping, residuals in grey values.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        levels: int = LEVELS,
        finest: int = FINEST,
        min_gradient: float = MIN_GRADIENT,
        robust: Robust = ROBUST,
    ) -> None:
        self.name = "direct-t"
        self._finest = finest
        self._min_gradient = min_gradient
        self._robust = robust
        self._pinholes = []
        for level in range(levels):
            scale = 0.5**level
            self._pinholes.append(
                Pinhole(
                    camera.fx * scale,
                    camera.fy * scale,
                    (camera.cx + 0.5) * scale - 0.5,
                    (camera.cy + 0.5) * scale - 0.5,
                    camera.width >> level,
                    camera.height >> level,
                )
            )

    def prepare(self, frame: Frame) -> list[Level]:
        """Build the pyramid of a frame, finest level first."""
        grey = frame.grey.astype(np.float32)
        depth = np.empty_like(frame.depth)
        kernels.smooth_depth_only(frame.depth, DEPTH_GAP, depth)
        levels = []
        for number, pinhole in enumerate(self._pinholes):
            if number:
                height, width = pinhole.height, pinhole.width
                whole = grey[: 2 * height, : 2 * width]
                grey = np.asarray(
                    cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.float32
                )
                half = np.empty((height, width), np.float32)
                kernels.halve_depth(depth, DEPTH_GAP, half)
                depth = half
            if number >= self._finest:
                image = np.empty((*grey.shape, 3), np.float32)
                kernels.central_differences(grey, image)
                points = np.empty((grey.size, 6), np.float32)
                count = kernels.gather_points(image, depth, pinhole, self._min_gradient, points)
                levels.append(Level(image, points[:count]))
        return levels

    def align(
        self, reference: list[Level], current: list[Level], T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur``, from the coarsest level to the finest; None where it fails."""
        T_cur_ref = se3.inverse(T_ref_guess)
        for level in range(len(reference) - 1, -1, -1):
            points, image = reference[level].points, current[level].image
            pinhole = self._pinholes[self._finest + level]
            rows = np.empty((len(points), kernels.ROW), np.float32)
            pairs = np.empty((len(points), 2), np.float32)
            photometric = partial(_photometric, points, image, pinhole, pairs)
            found = fit(photometric, T_cur_ref, len(points), self._robust)
            if found is not None:
                T_cur_ref = found.T
            elif level == 0:  # a coarse level may show too little: it only helps
                return None
        # what is matched must look alike: differences alone are small in a dark image also
        seen = pairs[: photometric(T_cur_ref, rows)]
        correlation = float(np.atleast_2d(np.corrcoef(seen.T))[0, 1])
        return se3.inverse(T_cur_ref) if correlation > MIN_CORRELATION else None


def _photometric(
    points: NDArray[np.float32],
    image: NDArray[np.float32],
    pinhole: Pinhole,
    pairs: NDArray[np.float32],
    T_cur_ref: NDArray[np.float64],
    rows: NDArray[np.float32],
) -> int:
    return kernels.photometric_rows(points, image, T_cur_ref, pinhole, rows, pairs)


def direct_odometry(camera: Camera, *, keyframes: KeyframeRule | None = None) -> PairwiseOdometry:
    """Make a tracker of the robust direct method.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    keyframes : KeyframeRule, optional
        0.10 m or 8 degrees by default, since farther ones lose the panels without texture;
        `edvo.baselines.pairwise.FRAME_TO_FRAME` for none.

    Returns
    -------
    PairwiseOdometry
        With ``track``, ``skip``, ``reset`` and ``trajectory``, as `edvo.Odometry`.
    """
    return PairwiseOdometry(camera, DirectAligner(camera), keyframes=keyframes)
