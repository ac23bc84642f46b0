"""The last image that was as it should be: what a lost camera saw before things went wrong.

Not in the paper. A hand that comes before the lens is in the view before the camera is lost, and
the keyframes of that time show it. The last image from before, made a keyframe once the camera is
lost, is what it is found again by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.frame import Frame

APART_S = 0.1  # an image is copied no more often than that


@dataclass(frozen=True, slots=True)
class Good:
    """An image and where it was taken.

    Attributes
    ----------
    index : int
        Of the frame in the sequence.
    frame : Frame
    T_world_cam : ndarray of float64, shape (4, 4)
    """

    index: int
    frame: Frame
    T_world_cam: NDArray[np.float64]


class LastGood:
    """Keeps a copy of one of the last good images."""

    def __init__(self) -> None:
        self._grey = np.empty((0, 0), np.uint8)
        self._depth = np.empty((0, 0), np.float32)
        self.forget()

    def forget(self) -> None:
        """Keep none."""
        self._index, self._timestamp, self._depth_delay = -1, 0.0, 0.0
        self._T_world_cam = np.eye(4)

    def note(self, index: int, frame: Frame, T_world_cam: NDArray[np.float64]) -> None:
        """Take a good image in place of the last one, if that is old enough.

        Parameters
        ----------
        index : int
            Of the frame in the sequence.
        frame : Frame
            It is copied.
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was taken.
        """
        if self._index >= 0 and 0 <= frame.timestamp - self._timestamp < APART_S:
            return
        if self._grey.shape != frame.grey.shape:  # new memory costs more than the copy
            self._grey, self._depth = np.empty_like(frame.grey), np.empty_like(frame.depth)
        np.copyto(self._grey, frame.grey)
        np.copyto(self._depth, frame.depth)
        self._index, self._timestamp, self._depth_delay = index, frame.timestamp, frame.depth_delay
        self._T_world_cam = T_world_cam

    def take(self) -> Good | None:
        """Give the last one away.

        Returns
        -------
        Good or None
            None where there is none.
        """
        if self._index < 0:
            return None
        images = self._grey.copy(), self._depth.copy()
        frame = Frame(self._timestamp, *images, self._depth_delay)
        good = Good(self._index, frame, self._T_world_cam)
        self.forget()
        return good
