"""Which frames of a recording are looked at, and what is kept of them."""

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.inspection.thumbnail import Thumbnail, thumbnail
from edvo.datasets.readahead import read_ahead
from edvo.datasets.source import Source
from edvo.frame import Frame
from edvo.trajectory import Trajectory

# Frames that follow each other, small, to see how images change from one to the next.
SPANS, SPAN_FRAMES = 3, 24
# Frames at full size, far enough apart in time to see motion.
WALKS, WALK_FRAMES, WALK_STEP_S = 3, 12, 0.1


@dataclass(frozen=True)
class Looks:
    """What was looked at.

    Parameters
    ----------
    camera : Camera
        Of the frames.
    timestamps : ndarray, shape (N,), float64
        Seconds, of all frames of the recording.
    truth : Trajectory or None
        True poses.
    spans : sequence of sequences of Thumbnail
        Runs of frames that follow each other.
    walks : sequence of sequences of Frame
        Runs of frames of about ten a second.
    problems : tuple of str
        Frames that could not be read, a line each.
    looked_at : int
        Frames that were to be read.
    other_size : (int, int) or None
        Width and height of the images, where none is of the camera's size: those frames are not
        among the problems.
    """

    camera: Camera
    timestamps: NDArray[np.float64]
    truth: Trajectory | None
    spans: Sequence[Sequence[Thumbnail]]
    walks: Sequence[Sequence[Frame]]
    problems: tuple[str, ...]
    looked_at: int
    other_size: tuple[int, int] | None

    @cached_property
    def frames(self) -> list[Frame]:
        """All frames at full size."""
        return [frame for walk in self.walks for frame in walk]

    @property
    def interval(self) -> float:
        """Usual time between two frames, seconds; 0 where there is only one."""
        if len(self.timestamps) < 2:
            return 0.0
        return float(np.median(np.abs(np.diff(self.timestamps))))


def look_at(source: Source) -> Looks:
    """Read some frames of a recording, evenly spread.

    Parameters
    ----------
    source : Source
        Whose frames.

    Returns
    -------
    Looks
        What was seen.
    """
    times = np.asarray(source.timestamps, np.float64)
    count = len(source)
    interval = float(np.median(np.abs(np.diff(times)))) if count > 1 else 0.0
    step = max(1, round(WALK_STEP_S / interval)) if interval > 0 else 1
    spans = _runs(count, SPANS, SPAN_FRAMES, 1)
    walks = _runs(count, WALKS, WALK_FRAMES, step)
    small = {index for span in spans for index in span}
    whole = {index for walk in walks for index in walk}
    frames: dict[int, Frame] = {}
    thumbnails: dict[int, Thumbnail] = {}
    problems: list[tuple[str, tuple[int, int] | None]] = []
    size: tuple[int, ...] | None = None
    with closing(read_ahead(source, sorted(small | whole))) as readings:
        for reading in readings:
            if reading.frame is None:
                told = reading.problem or f"frame {reading.index} cannot be read"
                problems.append((told, reading.size))
                continue
            shape = reading.frame.grey.shape
            size = size or shape
            if shape != size:
                told = (
                    f"frame {reading.index} is {shape[1]} x {shape[0]}, those before it "
                    f"{size[1]} x {size[0]}: give images of one size"
                )
                problems.append((told, None))
                continue
            if reading.index in small:
                thumbnails[reading.index] = thumbnail(reading.frame)
            if reading.index in whole:
                frames[reading.index] = reading.frame
    sizes = Counter(other for _, other in problems if other is not None)
    other = sizes.most_common(1)[0][0] if sizes and size is None else None
    return Looks(
        source.camera,
        times,
        source.ground_truth,
        [[thumbnails[index] for index in span if index in thumbnails] for span in spans],
        [[frames[index] for index in walk if index in frames] for walk in walks],
        tuple(told for told, each in problems if each is None or each != other),
        len(small | whole),
        other,
    )


def _runs(count: int, runs: int, length: int, step: int) -> list[list[int]]:
    """Runs of indices so many steps apart, evenly spread; one of all if there are few."""
    if count <= runs * length * step:
        return [list(range(0, count, step))]
    starts = np.linspace(0, count - 1 - (length - 1) * step, runs).astype(int)
    return [list(range(int(start), int(start) + length * step, step)) for start in starts]
