"""What edvo is compared with, as a user would call it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.frame import Frame


def edge_detector(grey: NDArray[np.uint8], config: EdgesConfig) -> NDArray[np.uint8]:
    """Blur, differentiate and run Canny: the least that any method based on edges has to do."""
    smooth = cv2.GaussianBlur(grey, (5, 5), 0)
    du = cv2.Sobel(smooth, cv2.CV_16S, 1, 0)
    dv = cv2.Sobel(smooth, cv2.CV_16S, 0, 1)
    return np.asarray(cv2.Canny(du, dv, config.low, config.high), np.uint8)


class OpenCvOdometry:
    """``cv2.Odometry`` of colour and depth, each frame registered with the one before it.

    Parameters
    ----------
    camera : Camera
        Of both images, taken for an ideal one.
    """

    def __init__(self, camera: Camera) -> None:
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(camera.matrix.astype(np.float32))
        self._odometry = cv2.Odometry(
            cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON
        )
        self._last: cv2.OdometryFrame | None = None

    def track(self, frame: Frame) -> bool:
        """Prepare this frame and find its motion from the last one; False where it fails."""
        current = cv2.OdometryFrame(frame.depth, frame.grey)
        self._odometry.prepareFrame(current)
        last, self._last = self._last, current
        return last is None or bool(self._odometry.compute(last, current)[0])
