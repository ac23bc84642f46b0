"""Depth that repeats: fewer depth images than colour images, each handed out twice, or more often.

Not in the paper. Pairs by nearest stamps have it, and drivers that hand out the last depth image
with each colour image. Such depth says nothing of what has happened since. Taken for new it holds
the camera where it was: it lies to the planes of the keyframe just as it lay there.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import NOMINAL_PERIOD_S, SHORTEST_PERIOD_S
from edvo.delay import LARGEST_S, credible
from edvo.frame import Frame
from edvo.freeze import FREEZE_S, glimpse

LEAST_DEPTHS = 100  # of the pixels looked at: with fewer, two images may look the same by chance
SOON_S = 1e-3  # instants that are one
MOVED_M, MOVED_RAD = 0.02, math.radians(1.0)  # by which depth of before is wrong at edges


class StaleDepth:
    """Remembers the last depth image that was a new one, when it was taken, and where."""

    def __init__(self) -> None:
        self._sight = np.empty((0, 0), np.float32)
        self._last = self._since = -math.inf  # stamps of the last frame, and of that image's
        self._delay = 0.0  # of that image
        self._times = 0  # that it has come again
        self._T_world_cam = np.eye(4)

    def dated(self, frame: Frame, T_world_last: NDArray[np.float64]) -> tuple[Frame, bool]:
        """Say when the depth of a frame was taken, if it is the very same as that of the last one.

        Parameters
        ----------
        frame : Frame
        T_world_last : ndarray of float64, shape (4, 4)
            Where the last one was.

        Returns
        -------
        (Frame, bool)
            With its delay, and whether it is that of the last frame.
        """
        sight, stamped = glimpse(frame.depth), credible(frame.depth_delay)
        goes_back, self._last = frame.timestamp < self._last, frame.timestamp
        if goes_back or not np.array_equal(sight, self._sight) or not _can_tell(sight):
            self._sight, self._since, self._delay, self._times = sight, self._last, stamped, 0
            return frame, False
        if not self._times:
            self._T_world_cam = T_world_last.copy()
        self._times += 1
        delay = self._delay - self._age(frame.timestamp)
        if abs(delay - frame.depth_delay) < SOON_S and stamped:  # stamps say so, too
            return frame, True
        return frame.delayed(max(delay, -LARGEST_S)), True

    def frozen_for(self, timestamp: float, T_world_last: NDArray[np.float64]) -> float:
        """Say for how long depth has been the same while the camera moved, if that is too long.

        Parameters
        ----------
        timestamp : float
            Of the frame, seconds.
        T_world_last : ndarray of float64, shape (4, 4)
            Where the last one was.

        Returns
        -------
        float
            Seconds; 0 where it is not too long, or the camera has hardly moved.
        """
        age = self._age(timestamp)
        if age <= FREEZE_S:
            return 0.0
        moved = np.abs(se3.log(se3.inverse(self._T_world_cam) @ T_world_last))
        return age if moved[:3].max() > MOVED_M or moved[3:].max() > MOVED_RAD else 0.0

    def _age(self, timestamp: float) -> float:
        """For how long depth has been the same, seconds; by counting where stamps stand still."""
        age = timestamp - self._since
        return self._times * NOMINAL_PERIOD_S if age < SHORTEST_PERIOD_S else age


def _can_tell(sight: NDArray[np.float32]) -> bool:
    """Whether two depth images that look like that are one: not those of a wall without noise."""
    measured = sight[sight > 0]
    return len(measured) >= LEAST_DEPTHS and float(np.ptp(measured)) > 0
