"""What edvo is compared with, as a user would call it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.frame import Frame


class EdgeDetector:
    """Blur, differentiate and run Canny: the least that any method based on edges has to do.

    Results go to arrays made beforehand: otherwise glibc may hand 2 MB back to the system after
    each image and take it again for the next, which costs more than the detector does.

    Parameters
    ----------
    camera : Camera
        Gives the size of the images.
    config : EdgesConfig
        Thresholds of Canny.
    """

    def __init__(self, camera: Camera, config: EdgesConfig) -> None:
        size = camera.height, camera.width
        self._config = config
        self._smooth, self._mask = np.empty(size, np.uint8), np.empty(size, np.uint8)
        self._du, self._dv = np.empty(size, np.int16), np.empty(size, np.int16)

    def detect(self, frame: Frame) -> NDArray[np.uint8]:
        """Find the edge pixels; the mask is good until the next call."""
        cv2.GaussianBlur(frame.grey, (5, 5), 0, dst=self._smooth)
        cv2.Sobel(self._smooth, cv2.CV_16S, 1, 0, dst=self._du)
        cv2.Sobel(self._smooth, cv2.CV_16S, 0, 1, dst=self._dv)
        cv2.Canny(self._du, self._dv, self._config.low, self._config.high, edges=self._mask)
        return self._mask


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
