"""What the tracker hands to the viewer of one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from edvo.frame import Frame
from edvo.odometry import TrackedFrame
from edvo.report.tracking import Registration


@dataclass(frozen=True, slots=True)
class Shot:
    """A frame and what was made of it.

    Attributes
    ----------
    result : TrackedFrame
    registration : Registration or None
        Its numbers.
    track_s : float or None
        Wall time of ``track``, seconds.
    stages : mapping of str to float
        Seconds of each stage.
    frame : Frame or None
        The images; None where the frame could not be read, or its picture was dropped.
    """

    result: TrackedFrame
    registration: Registration | None
    track_s: float | None
    stages: Mapping[str, float]
    frame: Frame | None

    def without_picture(self) -> "Shot":
        """Leave out all that is large; pose, status and numbers stay."""
        return replace(self, result=replace(self.result, alignment=None), frame=None)
