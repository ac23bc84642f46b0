"""OpenCV's own RGB-D odometry, `cv2.Odometry`, given the initial pose that it does not take.

References
----------
F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images", ICCV
Workshops 2011: the direct method, which the paper calls DVO. With depth it is joined by the
point-to-plane distances of the iterative closest point; FAST is the latter of KinectFusion.
"""

import math
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.errors import ConfigError, MissingExtraError
from edvo.frame import Frame

_KINDS = {
    "rgb": ("OdometryType_RGB", "OdometryAlgoType_COMMON"),
    "depth": ("OdometryType_DEPTH", "OdometryAlgoType_COMMON"),
    "rgbd": ("OdometryType_RGB_DEPTH", "OdometryAlgoType_COMMON"),
    "fast-depth": ("OdometryType_DEPTH", "OdometryAlgoType_FAST"),
    "fast-rgbd": ("OdometryType_RGB_DEPTH", "OdometryAlgoType_FAST"),
}
KINDS = tuple(_KINDS)
"""What is compared, brightness, depth or both; OpenCV's FAST is there with depth only."""

NEAREST_M = 0.05
"""Points closer to the camera than this are not seen."""

LOOKS = 2
"""How often a pixel of the view to draw is looked up, with the depth found before."""

ROLL_RAD = math.radians(0.7)
"""The guess is turned by this about the optical axis before it is applied."""
_ROLL = se3.exp([0.0, 0.0, 0.0, 0.0, 0.0, ROLL_RAD])


class _Prepared:
    """A frame, and what is made of it once it is asked for."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.pyramids: Any = None
        self.points: NDArray[np.float32] | None = None


class OpenCvAligner:
    """Registers two frames by ``cv2.Odometry``.

    OpenCV 5 starts each registration at no motion. Here the current frame is first drawn as the
    reference camera would see it were the guess right; what OpenCV then finds is added to the
    guess. Where it finds nothing, it is given the frame as it is. From frame to frame the order is
    the other way round: the motion is within OpenCV's own reach, where it measures better.

    The guess is turned a little on purpose: OpenCV compares whole pixels, and when the drawn view
    lies right on the reference all of them round alike, so that steps below half a pixel change
    nothing but are added up. A roll of up to five pixels at the border spreads the rounding.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    kind : str
        One of `KINDS`.
    guess_first : bool
        Whether the guess is tried before no motion at all, or after it.

    Raises
    ------
    ConfigError
        If there is no such kind.
    MissingExtraError
        If the installed OpenCV has no ``Odometry``.
    """

    def __init__(self, camera: Camera, kind: str, *, guess_first: bool = True) -> None:
        if kind not in _KINDS:
            raise ConfigError(f"OpenCV odometry '{kind}'; known: {', '.join(KINDS)}")
        if not hasattr(cv2, "Odometry"):
            # The packages share one folder; whichever was installed last has overwritten it.
            raise MissingExtraError(
                f"OpenCV {cv2.__version__} has no Odometry: another opencv package hides it; "
                "uninstall all of them, then install 'opencv-python-headless>=5.0'"
            )
        self.name = f"opencv-{kind}"
        self._camera = camera
        self._guess_first = guess_first
        library = cast(Any, cv2)
        settings = library.OdometrySettings()
        settings.setCameraMatrix(camera.matrix.astype(np.float32))
        what, how = _KINDS[kind]
        self._frame = library.OdometryFrame
        self._odometry = library.Odometry(getattr(library, what), settings, getattr(library, how))
        v, u = np.mgrid[: camera.height, : camera.width].astype(np.float32)
        self._rays = np.dstack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)]
        ).astype(np.float32)

    def prepare(self, frame: Frame) -> Any:
        """Keep a frame: its pyramids are built when it is registered as it is."""
        return _Prepared(frame)

    def align(
        self, reference: Any, current: Any, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur`` by descent from the guess or from none; None where both fail."""
        attempts = (self._from_guess, self._from_none)
        for attempt in attempts if self._guess_first else reversed(attempts):
            T_ref_cur = attempt(reference, current, T_ref_guess)
            if T_ref_cur is not None:
                return T_ref_cur
        return None

    def _from_guess(
        self, reference: _Prepared, current: _Prepared, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        T_ref_start = _ROLL @ T_ref_guess
        view = self._pyramids(*self._view(reference, current.frame, T_ref_start))
        found, T_start_cur = self._odometry.compute(view, self._pyramids_of(reference))
        return np.asarray(np.array(T_start_cur, np.float64) @ T_ref_start) if found else None

    def _from_none(
        self, reference: _Prepared, current: _Prepared, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        found, T_ref_cur = self._odometry.compute(
            self._pyramids_of(current), self._pyramids_of(reference)
        )
        return np.array(T_ref_cur, np.float64) if found else None

    def _pyramids_of(self, prepared: _Prepared) -> Any:
        if prepared.pyramids is None:
            prepared.pyramids = self._pyramids(prepared.frame.grey, prepared.frame.depth)
        return prepared.pyramids

    def _pyramids(self, grey: NDArray[np.uint8], depth: NDArray[np.float32]) -> Any:
        built = self._frame(depth, grey)
        self._odometry.prepareFrame(built)
        return built

    def _view(
        self, reference: _Prepared, current: Frame, T_ref_cur: NDArray[np.float64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Draw the current frame as seen from the reference.

        Each reference point is looked up in the current frame, which leaves no holes and needs no
        z-buffer. What is found there lies nearer or farther, along its own ray; a second look with
        the depth so found makes the view one of the current frame's surface, whatever the guess.
        """
        seen = reference.frame.depth
        if reference.points is None:
            reference.points = self._rays * seen[..., None]
        points = reference.points
        T_cur_ref = se3.inverse(T_ref_cur)
        into_pixels = np.vstack([self._camera.matrix[:2] @ T_cur_ref[:3], T_cur_ref[2:3]])
        lift = np.float32(T_ref_cur[2, 3])
        for _ in range(LOOKS):
            x, y, z = cv2.split(cv2.transform(points, into_pixels))
            # What is not a number is looked up anywhere and stays without a depth.
            z[(seen == 0) | (z < NEAREST_M)] = np.nan
            x, y = cv2.divide(x, z), cv2.divide(y, z)
            depth = cv2.remap(current.depth, x, y, cv2.INTER_NEAREST)
            # Depth in the reference grows in proportion along a ray of the current frame.
            seen = np.asarray(lift + depth * (seen - lift) / z, np.float32)
            seen[~((depth > 0) & (seen > NEAREST_M))] = 0.0
            points = self._rays * seen[..., None]
        grey = cv2.remap(current.grey, x, y, cv2.INTER_LINEAR)
        return np.asarray(grey, np.uint8), seen


def opencv_odometry(
    camera: Camera, kind: str = "rgbd", *, keyframes: KeyframeRule | None = None
) -> PairwiseOdometry:
    """Make an odometry of OpenCV's.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    kind : str
        One of `KINDS`: ``rgb``, the direct method; ``depth``, the iterative closest point;
        ``rgbd``, both; the latter two also with OpenCV's FAST algorithm.
    keyframes : KeyframeRule, optional
        To a keyframe of at most 0.10 m or 8 degrees by default, which halves the drift;
        `edvo.baselines.pairwise.FRAME_TO_FRAME` otherwise.

    Returns
    -------
    PairwiseOdometry
        With ``track``, ``skip``, ``reset`` and ``trajectory``, as `edvo.Odometry`.

    Raises
    ------
    ConfigError
        If there is no such kind.
    MissingExtraError
        If the installed OpenCV has no ``Odometry``.
    """
    aligner = OpenCvAligner(camera, kind, guess_first=keyframes != FRAME_TO_FRAME)
    return PairwiseOdometry(camera, aligner, keyframes=keyframes)
