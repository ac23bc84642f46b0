"""Open3D's RGB-D odometry: multi-scale on tensors, and the older pipeline.

References
----------
J. Park, Q.-Y. Zhou, V. Koltun, "Colored Point Cloud Registration Revisited", ICCV 2017: the hybrid
of brightness and depth. F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from
dense RGB-D images", ICCV Workshops 2011: brightness alone.
"""

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.baselines.pairwise import KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.errors import ConfigError, MissingExtraError
from edvo.frame import Frame

_TENSOR_METHODS = {"hybrid": "Hybrid", "intensity": "Intensity", "plane": "PointToPlane"}
_LEGACY_TERMS = {
    "legacy-hybrid": "RGBDOdometryJacobianFromHybridTerm",
    "legacy-colour": "RGBDOdometryJacobianFromColorTerm",
}
KINDS = (*_TENSOR_METHODS, *_LEGACY_TERMS)
"""Brightness and depth, brightness, point-to-plane distances; the older pipeline's two."""

ITERATIONS = (40, 30, 20)
"""From coarse to fine; the defaults, 10, 5 and 3, do not arrive from a keyframe."""

MAX_DEPTH_M = 4.0
MAX_DEPTH_DIFFERENCE_M = 0.07
LEAST_OVERLAP = 0.1
"""Share of the image whose points must have found a partner: Open3D itself reports success where
two images show nothing in common."""


class TensorAligner:
    """Registers two frames by ``open3d.t.pipelines.odometry.rgbd_odometry_multi_scale``.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    kind : str
        ``hybrid``, ``intensity`` or ``plane``.

    Raises
    ------
    MissingExtraError
        If Open3D is not installed or does not load.
    """

    def __init__(self, camera: Camera, kind: str) -> None:
        self.name = f"open3d-{kind}"
        library = load_open3d()
        odometry = library.t.pipelines.odometry
        self._tensor = library.core.Tensor
        self._image = library.t.geometry.Image
        self._pair = library.t.geometry.RGBDImage
        self._register = odometry.rgbd_odometry_multi_scale
        self._method = getattr(odometry.Method, _TENSOR_METHODS[kind])
        self._criteria = [odometry.OdometryConvergenceCriteria(count) for count in ITERATIONS]
        self._intrinsics = self._tensor(camera.matrix)

    def prepare(self, frame: Frame) -> Any:
        """Wrap a frame; Open3D builds its pyramids in each registration."""
        colour = np.repeat(frame.grey[..., None], 3, axis=2)
        return self._pair(
            self._image(self._tensor(colour)), self._image(self._tensor(frame.depth.copy()))
        )

    def align(
        self, reference: Any, current: Any, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur`` by descent from the guess; None where too little overlaps."""
        try:
            result = self._register(
                current,
                reference,
                self._intrinsics,
                self._tensor(T_ref_guess),
                depth_scale=1.0,
                depth_max=MAX_DEPTH_M,
                criteria_list=self._criteria,
                method=self._method,
            )
        except RuntimeError:  # equations without a solution
            return None
        if not result.fitness >= LEAST_OVERLAP:
            return None
        return np.array(result.transformation.numpy(), np.float64)


class LegacyAligner:
    """Registers two frames by ``open3d.pipelines.odometry.compute_rgbd_odometry``.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    kind : str
        ``legacy-hybrid`` or ``legacy-colour``.

    Raises
    ------
    MissingExtraError
        If Open3D is not installed or does not load.
    """

    def __init__(self, camera: Camera, kind: str) -> None:
        self.name = f"open3d-{kind}"
        library = load_open3d()
        odometry = library.pipelines.odometry
        self._image = library.geometry.Image
        self._pair = library.geometry.RGBDImage
        self._register = odometry.compute_rgbd_odometry
        self._term = getattr(odometry, _LEGACY_TERMS[kind])()
        self._option = odometry.OdometryOption(
            iteration_number_per_pyramid_level=library.utility.IntVector(ITERATIONS),
            depth_diff_max=MAX_DEPTH_DIFFERENCE_M,
            depth_max=MAX_DEPTH_M,
        )
        self._intrinsics = library.camera.PinholeCameraIntrinsic(
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        )
        self._pixels = camera.width * camera.height

    def prepare(self, frame: Frame) -> Any:
        """Wrap a frame; Open3D builds its pyramids in each registration."""
        pair = self._pair()
        pair.color = self._image(frame.grey.astype(np.float32) / np.float32(255.0))
        pair.depth = self._image(frame.depth.copy())
        return pair

    def align(
        self, reference: Any, current: Any, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur`` by descent from the guess; None where too little overlaps."""
        found, T_ref_cur, information = self._register(
            current, reference, self._intrinsics, T_ref_guess, self._term, self._option
        )
        # Each pair of points adds one to this entry of its information matrix.
        if not found or not information[3, 3] >= LEAST_OVERLAP * self._pixels:
            return None
        return np.array(T_ref_cur, np.float64)


def open3d_odometry(
    camera: Camera, kind: str = "hybrid", *, keyframes: KeyframeRule | None = None
) -> PairwiseOdometry:
    """Make an odometry of Open3D's.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    kind : str
        One of `KINDS`.
    keyframes : KeyframeRule, optional
        To a keyframe of at most 0.10 m or 8 degrees by default;
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
        If Open3D is not installed or does not load.
    """
    if kind not in KINDS:
        raise ConfigError(f"Open3D odometry '{kind}'; known: {', '.join(KINDS)}")
    make = TensorAligner if kind in _TENSOR_METHODS else LegacyAligner
    return PairwiseOdometry(camera, make(camera, kind), keyframes=keyframes)


def load_open3d() -> Any:
    """Import Open3D, which takes a second or two and needs libraries of the system.

    Returns
    -------
    module
        ``open3d``, untyped.

    Raises
    ------
    MissingExtraError
        If it is not installed or does not load.
    """
    try:
        return importlib.import_module("open3d")
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"Open3D is not installed ({error}); pip install 'edvo[open3d]'"
        ) from error
    except (ImportError, OSError) as error:
        raise MissingExtraError(
            f"Open3D is installed but does not load ({error}); install that system library, "
            "on Debian and Ubuntu: apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1"
        ) from error
