"""The loop: frames from a source, read ahead, through a tracker, to a `Run`."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edvo.clock import StageClock
from edvo.datasets import Reading, Source, read_ahead
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.registration import Alignment
from edvo.trajectory import Trajectory

# Decoding threads: a frame takes several times as long to decode as to track, and one more than
# two cores hold fills the gaps that the other threads leave.
_WORKERS = 3


class Tracker(Protocol):
    """What `edvo.Odometry` does, and whatever is compared with it."""

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of a frame."""
        ...

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be read."""
        ...


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """What is kept of one frame: small, since a run may have many.

    Parameters
    ----------
    stamp : str
        Its time as the source writes it.
    timestamp : float
        The same in seconds.
    status : Status
        How far its pose may be trusted.
    reason : str
        Why it is not tracked; empty where it is.
    T_world_cam : ndarray, shape (4, 4), float64
        Its pose, metres; predicted where it is lost.
    keyframe : int
        Number, in this run, of the frame it was registered to; -1 for none.
    is_keyframe : bool
        Whether it became a keyframe.
    edges, samples : int
        Edge pixels, and how many of them were registered.
    registration : Registration or None
        How that went; None where there was none.
    track_s : float or None
        Wall time of ``track`` alone, seconds; None for a frame that could not be read.
    stages : mapping of str to float
        Seconds of each stage.
    problem : str or None
        Why the frame could not be read; None if it could.
    covariance : ndarray, shape (6, 6), float64, or None
        Of its motion since the keyframe, see `edvo.odometry.TrackedFrame`; None without one.
    piece : int
        Of the path, see there.
    """

    stamp: str
    timestamp: float
    status: Status
    reason: str
    T_world_cam: NDArray[np.float64]
    keyframe: int
    is_keyframe: bool
    edges: int
    samples: int
    registration: "Registration | None"
    track_s: float | None
    stages: Mapping[str, float]
    problem: str | None
    covariance: NDArray[np.float64] | None = None
    piece: int = 0


@dataclass(frozen=True, slots=True)
class Registration:
    """The numbers of an `edvo.registration.Alignment`, without its arrays.

    Parameters
    ----------
    iterations : int
        Trial steps.
    matches, inliers : int
        Samples with a match, and with a good one.
    agreeing : int
        Inliers whose gradient is that of their match.
    sigma_px : float
        Scale of the residuals, pixels.
    plane_points : int
        Points of the depth image near a plane of the keyframe.
    sigma_depth : float
        Scale of their distances, in units of the sensor's noise.
    depth_balance : float
        What they counted against the edges.
    """

    iterations: int
    matches: int
    inliers: int
    agreeing: int
    sigma_px: float
    plane_points: int
    sigma_depth: float
    depth_balance: float

    @classmethod
    def of(cls, found: Alignment) -> "Registration":
        """Take the numbers of a registration."""
        return cls(
            found.iterations,
            found.match_count,
            found.inliers,
            found.agreeing,
            found.sigma_px,
            found.plane_points,
            found.sigma_depth,
            found.depth_balance,
        )


@dataclass(frozen=True)
class Run:
    """A source, tracked.

    Parameters
    ----------
    source : Source
        What was tracked.
    frames : sequence of FrameRecord
        Every frame, in order, those that were lost or unreadable too.
    wanted : int
        Frames that were to be tracked; more than there are records if the run was interrupted.
    wall_s : float
        Wall time of the whole loop, decoding included, seconds.
    dropped : int
        Frames of a camera that there was no time for; they are not among `frames`.
    measured : mapping of str to float
        What the tracker has measured of the camera, by name, with the unit.
    """

    source: Source
    frames: Sequence[FrameRecord]
    wanted: int
    wall_s: float
    dropped: int = 0
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def interrupted(self) -> bool:
        """Whether the run was stopped before its end."""
        return len(self.frames) < self.wanted

    @property
    def problems(self) -> list[str]:
        """A line for each frame that could not be read."""
        return [record.problem for record in self.frames if record.problem is not None]

    def count(self, status: Status) -> int:
        """Count the frames of a status.

        Parameters
        ----------
        status : Status
            Which one.

        Returns
        -------
        int
            How many.
        """
        return sum(record.status is status for record in self.frames)

    def trajectory(self) -> Trajectory:
        """Collect the poses that may be trusted.

        Returns
        -------
        Trajectory
            Tracked and degraded frames only, ``T_world_cam``, by time and with the stamps of the
            source. Of frames with the same stamp, as a camera may give them, it holds the first.
        """
        kept = [record for record in self.frames if record.status is not Status.LOST]
        return Trajectory.from_frames(
            [record.timestamp for record in kept],
            [record.T_world_cam for record in kept],
            [record.stamp for record in kept],
        )

    @property
    def track_times(self) -> NDArray[np.float64]:
        """Wall times of the track calls, seconds; one for each frame that could be read."""
        return np.array([r.track_s for r in self.frames if r.track_s is not None])

    @property
    def frames_per_s(self) -> float:
        """Frames a second of wall time, decoding included."""
        return len(self.frames) / self.wall_s


def choose_frames(
    source: Source, *, start: int = 0, max_frames: int | None = None, stride: int = 1
) -> range:
    """Choose some frames of a source.

    Parameters
    ----------
    source : Source
        Whose frames.
    start : int
        The first one, counted from 0.
    max_frames : int, optional
        At most so many; all by default.
    stride : int
        Each n-th one only.

    Returns
    -------
    range
        Their indices, at least one.

    Raises
    ------
    DatasetError
        If the first one lies behind the end.
    """
    if start >= len(source):
        raise DatasetError(
            f"{source.path}: there is no frame {start}, it has {len(source)}; start before that"
        )
    chosen = range(start, len(source), stride)
    return chosen if max_frames is None else chosen[:max_frames]


def track_source(
    source: Source,
    tracker: Tracker,
    *,
    indices: Sequence[int] | None = None,
    clock: StageClock | None = None,
    on_frame: Callable[[FrameRecord], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Run:
    """Track frames of a source while the next ones are decoded.

    Parameters
    ----------
    source : Source
        Where the frames come from.
    tracker : Tracker
        What tracks them; an `edvo.Odometry` for instance.
    indices : sequence of int, optional
        Which frames; all by default.
    clock : StageClock, optional
        The clock that the tracker was given.
    on_frame : callable, optional
        Called with each record as it is made.
    stop : callable, optional
        Asked before each frame; once it says yes, the run ends with what there is.

    Returns
    -------
    Run
        Every frame up to the end or the stop.

    Notes
    -----
    A frame that cannot be read is skipped, and recorded as lost with its reason.
    """

    def after(records: Sequence[FrameRecord]) -> None:
        if on_frame is not None:
            on_frame(records[0])

    return track_together(
        source, [tracker], indices=indices, clocks=[clock], on_frame=after, stop=stop
    )[0]


def track_together(
    source: Source,
    trackers: Sequence[Tracker],
    *,
    indices: Sequence[int] | None = None,
    clocks: Sequence[StageClock | None] | None = None,
    on_frame: Callable[[Sequence[FrameRecord]], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> list[Run]:
    """Give the same frames to several trackers, one after the other, each frame decoded once.

    Parameters
    ----------
    source : Source
        Where the frames come from.
    trackers : sequence of Tracker
        What tracks them.
    indices : sequence of int, optional
        Which frames; all by default.
    clocks : sequence of StageClock or None, optional
        The clock that each tracker was given.
    on_frame : callable, optional
        Called after each frame with a record of each tracker.
    stop : callable, optional
        Asked before each frame; once it says yes, the runs end with what there is.

    Returns
    -------
    list of Run
        One for each tracker; the wall time of each is that of all.
    """
    wanted = range(len(source)) if indices is None else indices
    clocks = [None] * len(trackers) if clocks is None else clocks
    frames: list[list[FrameRecord]] = [[] for _ in trackers]
    begin = time.perf_counter()
    with closing(read_ahead(source, wanted, workers=_WORKERS, ahead=4 * _WORKERS)) as readings:
        for reading in readings:
            if stop is not None and stop():
                break
            for records, tracker, clock in zip(frames, trackers, clocks, strict=True):
                records.append(track_reading(tracker, reading, clock))
            if on_frame is not None:
                on_frame([records[-1] for records in frames])
    wall_s = time.perf_counter() - begin
    return [
        Run(source, records, len(wanted), wall_s, measured=measured_by(tracker))
        for tracker, records in zip(trackers, frames, strict=True)
    ]


def measured_by(tracker: Tracker) -> dict[str, float]:
    """Say what a tracker has measured of its camera.

    Parameters
    ----------
    tracker : Tracker

    Returns
    -------
    dict
        By name, with the unit; empty if it measures nothing.
    """
    inner: object = tracker
    while hasattr(inner, "tracker"):  # it may be watched, or shown
        inner = inner.tracker
    if not isinstance(inner, Odometry):
        return {}
    return {
        "depth_delay_s": inner.depth_delay,
        "readout_s": inner.readout,
        "exposure_s": inner.exposure,
    }


def track_reading(tracker: Tracker, reading: Reading, clock: StageClock | None) -> FrameRecord:
    """Track one frame, or have it skipped if it could not be read.

    Parameters
    ----------
    tracker : Tracker
        What tracks.
    reading : Reading
        The frame.
    clock : StageClock or None
        The clock that the tracker was given.

    Returns
    -------
    FrameRecord
        What came of it.
    """
    if reading.frame is None:
        return _skip(tracker, reading, reading.problem or "no images")
    begin = time.perf_counter()
    try:
        result = tracker.track(reading.frame)
    except FrameError as error:
        return _skip(tracker, reading, str(error))
    seconds = time.perf_counter() - begin
    return _record(reading, result, seconds, {} if clock is None else clock.take(), None)


def _skip(tracker: Tracker, reading: Reading, problem: str) -> FrameRecord:
    return _record(reading, tracker.skip(reading.timestamp, problem), None, {}, problem)


def _record(
    reading: Reading,
    result: TrackedFrame,
    track_s: float | None,
    stages: Mapping[str, float],
    problem: str | None,
) -> FrameRecord:
    found = result.alignment
    return FrameRecord(
        stamp=reading.stamp,
        timestamp=reading.timestamp,
        status=result.status,
        reason=result.reason,
        T_world_cam=result.T_world_cam,
        keyframe=result.keyframe,
        is_keyframe=result.is_keyframe,
        edges=result.edges,
        samples=result.samples,
        registration=None if found is None else Registration.of(found),
        track_s=track_s,
        stages=stages,
        problem=problem,
        covariance=result.covariance,
        piece=result.piece,
    )
