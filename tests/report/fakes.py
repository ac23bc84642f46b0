"""A source and trackers for comparisons, made up so that every figure is known."""

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets import Reading
from edvo.errors import FrameError
from edvo.frame import Frame
from edvo.odometry import Status, TrackedFrame
from edvo.trajectory import Trajectory

CAMERA = Camera(width=16, height=12, fx=15.0, fy=15.0, cx=7.5, cy=5.5)
RATE_HZ = 10.0


def place(time: float) -> NDArray[np.float64]:
    """Give the true pose: 0.3 m/s to the right."""
    T_world_cam = np.eye(4)
    T_world_cam[0, 3] = 0.3 * time
    return T_world_cam


def path(times: Sequence[float], scale: float = 1.0) -> Trajectory:
    """Give the true path at a scale."""
    poses = np.array([place(scale * time) for time in times])
    return Trajectory.from_poses(np.array(times), poses)


class FakeSource:
    """Frames that know how many of them are being read."""

    format = "fake"
    camera = CAMERA
    camera_origin = "made up"
    path = Path("fake")
    warnings: tuple[str, ...] = ()

    def __init__(
        self,
        frames: int = 40,
        *,
        name: str = "fake",
        truth: bool = True,
        unreadable: Sequence[int] = (),
    ) -> None:
        self.name = name
        self.timestamps = np.arange(frames) / RATE_HZ
        self.stamps = tuple(f"{t:.6f}" for t in self.timestamps)
        self.ground_truth = path(self.timestamps.tolist()) if truth else None
        self.reading = 0
        self.log: list[str] = []
        self._unreadable = unreadable
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self.timestamps)

    def read(self, index: int) -> Reading:
        with self._lock:
            self.reading += 1
            self.log.append(f"read {index}")
        time = float(self.timestamps[index])
        threading.Event().wait(0.002)  # long enough to be caught at it
        frame, problem = None, f"{index}.png is broken"
        if index not in self._unreadable:
            grey = np.full((12, 16), index % 256, np.uint8)
            frame, problem = Frame(time, grey, np.ones((12, 16), np.float32)), ""
        with self._lock:
            self.reading -= 1
        return Reading(index, self.stamps[index], time, frame, problem or None)

    def describe(self) -> dict[str, Any]:
        return {}


class FakeTracker:
    """Goes the true way at a scale, and loses or refuses what it is told to."""

    def __init__(
        self,
        scale: float = 1.0,
        *,
        lost: Sequence[int] = (),
        raises: dict[int, Exception] | None = None,
        on_track: Callable[[int], None] | None = None,
    ) -> None:
        self.scale = scale
        self._lost, self._raises = lost, raises or {}
        self._on_track = on_track or (lambda index: None)
        self.trajectory = path([])

    def track(self, frame: Frame) -> TrackedFrame:
        index = round(frame.timestamp * RATE_HZ)
        self._on_track(index)
        if index in self._raises:
            raise self._raises[index]
        status = Status.LOST if index in self._lost else Status.TRACKED
        return self._result(frame.timestamp, status)

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        assert reason
        return self._result(timestamp, Status.LOST)

    def _result(self, timestamp: float, status: Status) -> TrackedFrame:
        pose = place(self.scale * timestamp)
        return TrackedFrame(timestamp, 0, status, "", pose, np.eye(4), 0, False, 0, 0, None)


class FakeTime:
    """Stands in for the module `time` of who measures: it passes only where it is told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    process_time = perf_counter


REFUSED = FrameError("of another size")
