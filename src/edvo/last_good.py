"""The last image that was as it should be: what a lost camera saw before things went wrong.

Not in the paper. A hand that comes before the lens is in the view before the camera is lost, and
the keyframes of that time show it. The last image from before, made a keyframe once the camera is
lost, is what it is found again by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.frame import Frame

APART_S = 0.1  # an image is taken no more often than that


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
    """Keeps one of the last good images."""

    def __init__(self) -> None:
        self._good: Good | None = None

    def forget(self) -> None:
        """Keep none."""
        self._good = None

    def note(self, index: int, frame: Frame, T_world_cam: NDArray[np.float64]) -> None:
        """Take a good image in place of the last one, if that is old enough.

        Parameters
        ----------
        index : int
            Of the frame in the sequence.
        frame : Frame
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was taken.
        """
        last = self._good
        if last is not None and 0 <= frame.timestamp - last.frame.timestamp < APART_S:
            return
        self._good = Good(index, frame.kept(), T_world_cam)

    def take(self) -> Good | None:
        """Give the last one away.

        Returns
        -------
        Good or None
            None where there is none.
        """
        good, self._good = self._good, None
        return good
