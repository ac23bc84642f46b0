"""A tracker whose frames are shown."""

from typing import TYPE_CHECKING

from edvo.frame import Frame
from edvo.odometry import TrackedFrame
from edvo.report.tracking import FrameRecord, Tracker

if TYPE_CHECKING:
    from edvo.report.viewer import Viewer


class Shown:
    """Hands frames on to a tracker, and with its results to a viewer.

    Parameters
    ----------
    tracker : Tracker
        What tracks.
    viewer : Viewer or None
        What shows; nothing where None.

    Attributes
    ----------
    tracker : Tracker
    """

    def __init__(self, tracker: Tracker, viewer: "Viewer | None") -> None:
        self.tracker, self._viewer = tracker, viewer
        self._fresh: tuple[Frame | None, TrackedFrame] | None = None

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of a frame; it is shown later, outside of its time."""
        result = self.tracker.track(frame)
        self._fresh = frame, result
        return result

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be read."""
        result = self.tracker.skip(timestamp, reason)
        self._fresh = None, result
        return result

    def after(self, record: FrameRecord) -> None:
        """Show the last frame.

        Parameters
        ----------
        record : FrameRecord
            Of that frame.
        """
        fresh, self._fresh = self._fresh, None
        if self._viewer is not None and fresh is not None:
            self._viewer.show(*fresh, track_s=record.track_s, stages=record.stages)
