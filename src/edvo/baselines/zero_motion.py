"""Standing still: the error that any odometry has to stay below."""

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.frame import Frame
from edvo.odometry import Status, TrackedFrame
from edvo.trajectory import Trajectory


class ZeroMotion:
    """Says of each frame that the camera has not moved.

    Its relative pose error is the camera's own motion.

    Parameters
    ----------
    camera : Camera
        Of the frames to come, which are not looked at.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.name = "zero-motion"
        self.reset()

    def reset(self, T_world_cam: NDArray[np.float64] | None = None) -> None:
        """Forget everything and start anew.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4), optional
            Where to stand; the origin where not given.
        """
        self._T_world_cam = np.eye(4) if T_world_cam is None else np.array(T_world_cam, np.float64)
        self._count = 0
        self._timestamps: list[float] = []

    @property
    def trajectory(self) -> Trajectory:
        """The same pose for each frame that was tracked, of equal stamps once."""
        return Trajectory.from_frames(self._timestamps, [self._T_world_cam] * len(self._timestamps))

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of the next frame, which is that of the first.

        Parameters
        ----------
        frame : Frame
            Only its time counts.

        Returns
        -------
        TrackedFrame
            ``TRACKED``.
        """
        self._timestamps.append(frame.timestamp)
        return self._result(frame.timestamp, Status.TRACKED, "")

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be had.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str
            For the result.

        Returns
        -------
        TrackedFrame
            ``LOST``, with the same pose as ever.
        """
        return self._result(timestamp, Status.LOST, reason)

    def _result(self, timestamp: float, status: Status, reason: str) -> TrackedFrame:
        is_first = len(self._timestamps) == 1 and status is Status.TRACKED
        if is_first:
            self._keyframe = self._count
        seen = bool(self._timestamps)
        self._count += 1
        return TrackedFrame(
            timestamp=timestamp,
            index=self._count - 1,
            status=status,
            reason=reason,
            T_world_cam=self._T_world_cam.copy(),
            T_key_cur=np.eye(4),
            keyframe=self._keyframe if seen and not is_first else -1,
            is_keyframe=is_first,
            edges=0,
            samples=0,
            alignment=None,
        )
