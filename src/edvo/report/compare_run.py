"""Several trackers over the same frames, so that their times can be compared.

Frames are decoded a chunk at a time, and while a chunk is tracked nothing is decoded. Each frame
goes through every tracker before the next one does, so that what else the machine does meets them
all alike; the order changes from frame to frame, so that nobody always finds the images warm in
the cache.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edvo.baselines.registry import Tracker
from edvo.datasets import Reading, Source, read_ahead
from edvo.errors import FrameError
from edvo.odometry import Status, TrackedFrame
from edvo.report.compare_rule import raised
from edvo.trajectory import Trajectory

CHUNK_FRAMES = 16
"""Frames that are decoded before they are tracked; bounds the memory."""

_WORKERS = 3
_WARM_UP_FRAMES = 3  # a keyframe, a frame against it, and one with a motion to predict from


@dataclass(frozen=True)
class Entrant:
    """A tracker that takes part.

    Attributes
    ----------
    make : callable
        Gives the tracker at its beginning.
    begin : int
        Frames that pass before its first one.
    """

    make: Callable[[], Tracker]
    begin: int = 0


@dataclass
class Followed:
    """What came of one tracker.

    Attributes
    ----------
    frames : int
        Frames since it began; it has seen fewer if it stopped.
    stamps, timestamps : list
        Of each frame it has seen, as text and in seconds.
    statuses : list of Status
        Lost for a frame that could not be read.
    poses : list of ndarray, shape (4, 4)
        ``T_world_cam``.
    wall_s, cpu_s : list of float
        Wall time of each call of ``track``, and processor time, summed over the threads, seconds;
        not a number for a frame that could not be read.
    stopped : str
        The exception that ended it; empty if none did.
    """

    frames: int = 0
    stamps: list[str] = field(default_factory=list)
    timestamps: list[float] = field(default_factory=list)
    statuses: list[Status] = field(default_factory=list)
    poses: list[NDArray[np.float64]] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)
    stopped: str = ""

    def count(self, status: Status) -> int:
        """Count the frames of a status."""
        return sum(each is status for each in self.statuses)

    def trajectory(self) -> Trajectory:
        """Collect the poses of the frames that were not lost; of equal stamps the first."""
        kept = [i for i, status in enumerate(self.statuses) if status is not Status.LOST]
        return Trajectory.from_frames(
            [self.timestamps[i] for i in kept],
            [self.poses[i] for i in kept],
            [self.stamps[i] for i in kept],
        )


def follow_together(
    source: Source,
    entrants: Sequence[Entrant],
    *,
    indices: Sequence[int],
    chunk: int = CHUNK_FRAMES,
    on_frame: Callable[[Reading], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> list[Followed]:
    """Give the same frames to several trackers in turn.

    Parameters
    ----------
    source : Source
        Where the frames come from.
    entrants : sequence of Entrant
        Who tracks them.
    indices : sequence of int
        Which frames.
    chunk : int
        Frames that are decoded before they are tracked.
    on_frame : callable, optional
        Called with each frame after it has been tracked.
    stop : callable, optional
        Asked before each call; once it says yes, the run ends with the last frame that all have
        had.

    Returns
    -------
    list of Followed
        One for each entrant.

    Notes
    -----
    Before its first call counts, each entrant is made once more and tracks a few frames, so that
    nothing is compiled or loaded while it is timed. An entrant that raises anything is not given
    more frames.
    """
    runs = [_Run(entrant) for entrant in entrants]
    if not runs:
        return []
    done = 0
    for number, reading in enumerate(_in_chunks(source, indices, chunk, runs)):
        turn = number % len(runs)
        for run in (*runs[turn:], *runs[:turn]):
            if stop is not None and stop():
                return [each.finish(number) for each in runs]
            run.take(number, reading)
        done = number + 1
        if on_frame is not None:
            on_frame(reading)
    return [run.finish(done) for run in runs]


def _in_chunks(
    source: Source, indices: Sequence[int], chunk: int, runs: Sequence["_Run"]
) -> Iterator[Reading]:
    """Give frames that are decoded, with all decoding at rest."""
    for begin in range(0, len(indices), chunk):
        wanted = indices[begin : begin + chunk]
        with closing(read_ahead(source, wanted, workers=_WORKERS, ahead=chunk)) as readings:
            decoded = list(readings)
        if begin == 0:
            there = [reading for reading in decoded if reading.frame is not None]
            for run in runs:
                run.warm_up(there[:_WARM_UP_FRAMES])
        yield from decoded


class _Run:
    def __init__(self, entrant: Entrant) -> None:
        self.followed = Followed()
        self._entrant = entrant
        self._tracker = entrant.make()

    def warm_up(self, readings: Sequence[Reading]) -> None:
        frame = readings[0].index if readings else 0
        try:
            tracker = self._entrant.make()
            for reading in readings:
                frame = reading.index
                if reading.frame is not None:
                    tracker.track(reading.frame)
        except FrameError:
            pass  # it says so again, and is recorded, when the frame's turn comes
        except Exception as error:
            self._give_up(frame, error)

    def take(self, number: int, reading: Reading) -> None:
        followed = self.followed
        if number < self._entrant.begin or followed.stopped:
            return
        try:
            result, wall_s, cpu_s = self._track(reading)
        except Exception as error:  # a library of others may raise anything, and this is a finding
            self._give_up(reading.index, error)
            return
        followed.stamps.append(reading.stamp)
        followed.timestamps.append(reading.timestamp)
        followed.statuses.append(Status.LOST if math.isnan(wall_s) else result.status)
        followed.poses.append(result.T_world_cam)
        followed.wall_s.append(wall_s)
        followed.cpu_s.append(cpu_s)

    def finish(self, done: int) -> Followed:
        """Give what came of so many frames, without one that others may not have had."""
        followed = self.followed
        followed.frames = max(0, done - self._entrant.begin)
        for column in (
            followed.stamps,
            followed.timestamps,
            followed.statuses,
            followed.poses,
            followed.wall_s,
            followed.cpu_s,
        ):
            del column[followed.frames :]
        return followed

    def _track(self, reading: Reading) -> tuple[TrackedFrame, float, float]:
        problem = reading.problem or "no images"
        if reading.frame is not None:
            cpu, wall = time.process_time(), time.perf_counter()
            try:
                result = self._tracker.track(reading.frame)
            except FrameError as error:
                problem = str(error)
            else:
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                return result, wall, cpu
        return self._tracker.skip(reading.timestamp, problem), math.nan, math.nan

    def _give_up(self, frame: int, error: Exception) -> None:
        """Take it out at a frame, counted from the recording's first."""
        self.followed.stopped = f"stopped at frame {frame}: {raised(error)}"
