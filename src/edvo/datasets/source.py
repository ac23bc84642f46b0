"""What every reader of recordings offers."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import DatasetError
from edvo.frame import Frame
from edvo.trajectory import Trajectory

# An interval this many times the usual one is a gap: at least one image is missing in it.
_GAP = 1.8


@dataclass(frozen=True)
class Reading:
    """One frame as it came from a source, or what was wrong with it.

    Parameters
    ----------
    index : int
        Which frame of the source.
    stamp : str
        Its time as the source writes it.
    timestamp : float
        Its time in seconds.
    frame : Frame or None
        The images; None if there is a problem.
    problem : str or None
        One line that names the file; None if all is well.
    size : (int, int) or None
        Width and height of the images, where the problem is that they are not the camera's.
    """

    index: int
    stamp: str
    timestamp: float
    frame: Frame | None
    problem: str | None
    size: tuple[int, int] | None = None


@runtime_checkable
class Source(Protocol):
    """Frames in order of time, each read when asked for.

    `read` is called from several threads at once (see `edvo.datasets.readahead`) and returns a
    `Reading` with a problem, rather than raise, for a frame whose data are bad.
    """

    @property
    def name(self) -> str:
        """Short name of the recording."""
        ...

    @property
    def path(self) -> Path:
        """Where it lies."""
        ...

    @property
    def format(self) -> str:
        """Name of the format in the registry."""
        ...

    @property
    def camera(self) -> Camera:
        """The camera both images of each frame belong to."""
        ...

    @property
    def camera_origin(self) -> str:
        """Where the camera's numbers come from, for people."""
        ...

    @property
    def ground_truth(self) -> Trajectory | None:
        """True poses, where there are any."""
        ...

    @property
    def stamps(self) -> Sequence[str]:
        """Time of each frame as the source writes it."""
        ...

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Time of each frame in seconds, shape (N,), increasing."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong with the recording, a line each."""
        ...

    def __len__(self) -> int:
        """Count the frames."""
        ...

    def read(self, index: int) -> Reading:
        """Read one frame; `DatasetError` where there is none of that index."""
        ...

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the recording, in plain types."""
        ...


def check_index(index: int, stamps: Sequence[str], name: str) -> None:
    """Refuse to read a frame that is none.

    Parameters
    ----------
    index : int
        Of the frame wanted.
    stamps : sequence of str
        Of the frames there are.
    name : str
        Of the recording.

    Raises
    ------
    DatasetError
        Where there is no such frame.
    """
    if not 0 <= index < len(stamps):
        there = f"there are 0 to {len(stamps) - 1}" if stamps else "there is none"
        raise DatasetError(f"{name}: no frame {index}; {there}")


def describe_timing(timestamps: NDArray[np.float64]) -> dict[str, Any]:
    """Describe how frames lie in time.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Seconds, increasing.

    Returns
    -------
    dict
        ``frames``; ``duration_s`` from first to last; ``frame_rate_hz`` by the median interval
        (None with fewer than two frames); ``gaps``, the count of intervals of more than 1.8
        times the median; ``longest_gap_s``, the longest interval.
    """
    timing: dict[str, Any] = {
        "frames": len(timestamps),
        "duration_s": 0.0,
        "frame_rate_hz": None,
        "gaps": 0,
        "longest_gap_s": 0.0,
    }
    if len(timestamps) > 1:
        intervals = np.diff(timestamps)
        usual = float(np.median(intervals))
        timing["duration_s"] = float(timestamps[-1] - timestamps[0])
        timing["frame_rate_hz"] = 1.0 / usual
        timing["gaps"] = int(np.count_nonzero(intervals > _GAP * usual))
        timing["longest_gap_s"] = float(intervals.max())
    return timing
