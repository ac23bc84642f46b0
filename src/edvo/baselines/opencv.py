"""OpenCV's own RGB-D odometry, `cv2.Odometry`.

References
----------
F. Steinbruecker, J. Sturm, D. Cremers, "Real-time visual odometry from dense RGB-D images", ICCV
Workshops 2011: the direct method, which the paper calls DVO. With depth it is joined by the
point-to-plane distances of the iterative closest point.
"""

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.baselines.pairwise import KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.errors import ConfigError, MissingExtraError
from edvo.frame import Frame

_TYPES = {"rgb": "OdometryType_RGB", "rgbd": "OdometryType_RGB_DEPTH"}
KINDS = tuple(_TYPES)
"""What is compared: ``rgb`` the brightness, ``rgbd`` brightness and depth."""


class OpenCvAligner:
    """Registers two frames by ``cv2.Odometry``.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    kind : str
        One of `KINDS`.

    Raises
    ------
    ConfigError
        If there is no such kind.
    MissingExtraError
        If the installed OpenCV has no ``Odometry``.
    """

    def __init__(self, camera: Camera, kind: str) -> None:
        if kind not in _TYPES:
            raise ConfigError(f"OpenCV odometry '{kind}'; known: {', '.join(KINDS)}")
        if not hasattr(cv2, "Odometry"):
            # The packages share one folder; whichever was installed last has overwritten it.
            raise MissingExtraError(
                f"OpenCV {cv2.__version__} has no Odometry: another opencv package hides it; "
                "uninstall all of them, then install 'opencv-python-headless>=5.0'"
            )
        self.name = f"opencv-{kind}"
        library = cast(Any, cv2)
        settings = library.OdometrySettings()
        settings.setCameraMatrix(camera.matrix.astype(np.float32))
        self._frame = library.OdometryFrame
        self._odometry = library.Odometry(
            getattr(library, _TYPES[kind]), settings, library.OdometryAlgoType_COMMON
        )

    def prepare(self, frame: Frame) -> Any:
        """Build the pyramids of a frame, once for all its registrations."""
        prepared = self._frame(frame.depth, frame.grey)
        self._odometry.prepareFrame(prepared)
        return prepared

    def align(
        self, reference: Any, current: Any, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur``; None where OpenCV says that it failed, which takes no guess."""
        found, T_ref_cur = self._odometry.compute(current, reference)
        return np.array(T_ref_cur, np.float64) if found else None


def opencv_odometry(
    camera: Camera, kind: str = "rgbd", *, keyframes: KeyframeRule | None = None
) -> PairwiseOdometry:
    """Make a tracker of ``cv2.Odometry``.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    kind : str
        ``rgb``, the direct method, or ``rgbd``, with depth.
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
    return PairwiseOdometry(camera, OpenCvAligner(camera, kind), keyframes=keyframes)
