"""Trackers side by side on the same frames, each under several lights."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any, Protocol
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from edvo.baselines.opencv import opencv_odometry
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets.readahead import read_ahead
from edvo.datasets.source import Source
from edvo.edges import EdgePixels
from edvo.errors import EvaluationError
from edvo.evaluation import Evaluation, evaluate
from edvo.frame import Frame
from edvo.matching import EdgeIndex
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.registration import Registration
from edvo.synthesis.relighting import Relighter
from edvo.trajectory import Trajectory

SEEDS = 3  # of edvo's sampling; the other methods draw nothing
OPENCV = {"OpenCV RGB-D": "rgbd", "OpenCV RGB": "rgb"}  # to a keyframe, as edvo
SYSTEMS = ("edvo default", "edvo paper", *OPENCV)


class Tracker(Protocol):
    """What edvo and its baselines have in common."""

    def track(self, frame: Frame) -> TrackedFrame: ...

    @property
    def trajectory(self) -> Trajectory: ...


@dataclass(frozen=True)
class Clip:
    """Frames in memory, with their truth."""

    name: str
    camera: Camera
    truth: Trajectory
    frames: tuple[Frame, ...]
    unreadable: int

    def lit(self, relighter: Relighter, index: int) -> Frame:
        """Give a frame under another light, which begins with the first frame."""
        frame = self.frames[index]
        t = frame.timestamp - self.frames[0].timestamp
        grey = relighter.relight(frame.grey, frame.depth, self.camera, t)
        return replace(frame, grey=grey)


@dataclass(frozen=True)
class Result:
    """One tracker under one light.

    Parameters
    ----------
    sequence, system : str
    severity : float
        0 is the light as it was.
    seed : int
    frames, tracked : int
        All, and those with the status ``tracked``.
    errors : Evaluation or None
        None where there are too few poses to compare.
    """

    sequence: str
    system: str
    severity: float
    seed: int
    frames: int
    tracked: int
    errors: Evaluation | None

    @property
    def rpe(self) -> float:
        """Root mean square of the relative pose error, m/s; infinite without one."""
        found = None if self.errors is None else self.errors.rpe
        return float("inf") if found is None else found.rmse

    @property
    def rpe_median(self) -> float:
        """Its median, m/s."""
        found = None if self.errors is None else self.errors.rpe
        return float("inf") if found is None else found.median

    @property
    def coverage(self) -> float:
        """Share of the frames that have a pose."""
        return 0.0 if self.errors is None else self.errors.poses / self.frames


def load(source: Source) -> Clip:
    """Read or render a whole sequence, two frames at a time."""
    frames, unreadable = [], 0
    with closing(read_ahead(source, range(len(source)), workers=2)) as readings:
        for reading in readings:
            if reading.frame is None:
                unreadable += 1
            else:
                frames.append(reading.frame)
    truth = source.ground_truth
    if truth is None:
        raise RuntimeError(f"{source.name} has no ground truth")
    return Clip(source.name, source.camera, truth, tuple(frames), unreadable)


def follow(clip: Clip, relighters: dict[float, Relighter]) -> list[Result]:
    """Track each frame by each tracker under each light before the next one."""
    runs = [
        _Run(system, severity, seed, tracker)
        for severity in relighters
        for system, seed, tracker in _trackers(clip.camera)
    ]
    with ThreadPoolExecutor(2) as pool:
        for index in range(len(clip.frames)):
            frames = pool.map(clip.lit, relighters.values(), repeat(index))
            lit = dict(zip(relighters, frames, strict=True))
            list(pool.map(_Run.track, runs, [lit[run.severity] for run in runs]))
    return [run.result(clip) for run in runs]


def _trackers(camera: Camera) -> Iterator[tuple[str, int, Tracker]]:
    for preset in ("default", "paper"):
        for seed in range(SEEDS):
            config = Config.preset(preset).with_overrides([f"seed={seed}"])
            yield f"edvo {preset}", seed, Odometry(camera, config)
    for name, kind in OPENCV.items():
        yield name, 0, opencv_odometry(camera, kind)


class _Run:
    def __init__(self, system: str, severity: float, seed: int, tracker: Tracker) -> None:
        self.severity = severity
        self._system, self._seed, self._tracker = system, seed, tracker
        self._tracked = 0

    def track(self, frame: Frame) -> None:
        self._tracked += self._tracker.track(frame).status is Status.TRACKED

    def result(self, clip: Clip) -> Result:
        frames = len(clip.frames) + clip.unreadable
        try:
            errors = evaluate(clip.truth, self._tracker.trajectory, frames)
        except EvaluationError:
            errors = None
        return Result(
            clip.name,
            self._system,
            self.severity,
            self._seed,
            frames,
            self._tracked,
            errors,
        )


@dataclass(frozen=True)
class Look:
    """One registration, seen from inside.

    Parameters
    ----------
    frame : Frame
    tracked : TrackedFrame
    reference : EdgePixels
        Edges of the keyframe.
    samples : EdgePixels
        Edges of the frame.
    error : ndarray, shape (3,)
        Metres by which ``T_key_cur`` is off, in the camera.
    """

    frame: Frame
    tracked: TrackedFrame
    reference: EdgePixels
    samples: EdgePixels
    error: NDArray[np.float64]


def look_closely(clip: Clip, relighter: Relighter, config: Config) -> list[Look]:
    """Track once more and keep every registration."""
    given: list[tuple[EdgeIndex, EdgePixels]] = []
    align = Registration.align

    def keep(
        self: Registration, reference: EdgeIndex, samples: EdgePixels, *rest: Any, **options: Any
    ) -> Any:
        given.append((reference, samples))
        return align(self, reference, samples, *rest, **options)

    truth = clip.truth
    true = [truth.poses[truth.nearest(frame.timestamp)] for frame in clip.frames]
    odometry, looks = Odometry(clip.camera, config), []
    with patch.object(Registration, "align", keep):
        for index in range(len(clip.frames)):
            given.clear()
            frame = clip.lit(relighter, index)
            tracked = odometry.track(frame)
            if tracked.alignment is None:
                continue
            T_key_cur = np.linalg.inv(true[tracked.keyframe]) @ true[index]
            off = np.linalg.inv(T_key_cur) @ tracked.T_key_cur
            reference, samples = given[0]
            looks.append(Look(frame, tracked, reference.edges, samples, off[:3, 3]))
    return looks


def median_of(results: Sequence[Result]) -> Result:
    """Give the run in the middle, by its error."""
    return sorted(results, key=lambda result: result.rpe)[len(results) // 2]
