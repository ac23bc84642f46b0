"""Truth beside the estimate while it is made: true poses in its world, and the error so far."""

from bisect import bisect_left
from collections import deque

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.trajectory import Trajectory

SPAN_S = 1.0

Pose = NDArray[np.float64]


class Truth:
    """Follows the true trajectory frame by frame.

    Parameters
    ----------
    trajectory : Trajectory
        True poses, in a world of their own.

    Notes
    -----
    The worlds are joined at the first frame that has a true pose; nothing is fitted, so that
    drift is seen as it grows. The error is that of ``edvo.evaluation.relative_pose_error``, for
    the pair of frames that ends now.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self._trajectory = trajectory
        intervals = np.diff(trajectory.timestamps)
        self._tolerance = 2.0 * float(np.median(intervals)) if len(intervals) else 0.0
        self._T_world_truth: Pose | None = None
        self._past: deque[tuple[float, Pose, Pose]] = deque()

    def at(self, timestamp: float, T_world_cam: Pose | None) -> Pose | None:
        """Give the true pose of a frame in the world of the estimate.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray, shape (4, 4), or None
            Estimated pose, which joins the worlds if it is the first; None where it is lost.

        Returns
        -------
        ndarray, shape (4, 4), or None
            None where no true pose is near in time, or none was so far.
        """
        T_truth_cam = self._near(timestamp)
        if T_truth_cam is None:
            return None
        if self._T_world_truth is None:
            if T_world_cam is None:
                return None
            self._T_world_truth = T_world_cam @ se3.inverse(T_truth_cam)
        return self._T_world_truth @ T_truth_cam

    def error(self, timestamp: float, T_world_cam: Pose | None) -> tuple[float, float] | None:
        """Give the relative pose error over the second that ends now.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray, shape (4, 4), or None
            Estimated pose; None where it is lost.

        Returns
        -------
        (float, float) or None
            Metres and radians; None in the first second, behind gaps, and without truth near.
        """
        T_truth_cam = self._near(timestamp)
        if T_truth_cam is None or T_world_cam is None:
            return None
        if self._past and timestamp <= self._past[-1][0]:  # stamps go back: begin anew
            self._past.clear()
        self._past.append((timestamp, T_world_cam, T_truth_cam))
        begin = timestamp - SPAN_S
        while len(self._past) > 1 and self._past[1][0] <= begin:
            self._past.popleft()
        times = [time for time, _, _ in self._past]
        place = bisect_left(times, begin)
        place -= place > 0 and begin - times[place - 1] <= times[place] - begin
        then, T_world_then, T_truth_then = self._past[place]
        if abs(then - begin) > 0.5 * (times[-1] - times[0]) / max(len(times) - 1, 1) + 1e-9:
            return None
        T_then_cam = se3.inverse(T_world_then) @ T_world_cam
        T_true = se3.inverse(T_truth_then) @ T_truth_cam
        T_error = T_then_cam @ se3.inverse(T_true)
        return float(np.linalg.norm(T_error[:3, 3])), se3.rotation_angle(T_error)

    def _near(self, timestamp: float) -> Pose | None:
        if not len(self._trajectory):
            return None
        index = self._trajectory.nearest(timestamp)
        if abs(self._trajectory.timestamps[index] - timestamp) > self._tolerance:
            return None
        pose: Pose = self._trajectory.poses[index]
        return pose
