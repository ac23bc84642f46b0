"""Recordings with one thing wrong each, made from sound ones as they are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets import Reading, Source
from edvo.datasets.inspection import Finding, examine
from edvo.datasets.inspection.focal import check_focal
from edvo.datasets.inspection.looks import Looks, look_at
from edvo.datasets.inspection.truth import check_truth
from edvo.datasets.inspection.walk import walk_all
from edvo.frame import Frame

Alter = Callable[[Frame], Frame]
Indices = NDArray[np.intp]


@dataclass
class Altered:
    """A source with other frames, another order or another camera."""

    source: Any
    alter: Alter | None = None
    camera: Camera = None  # type: ignore[assignment]
    order: Indices | None = None
    depth_order: Indices | None = None

    def __post_init__(self) -> None:
        self.camera = self.camera or self.source.camera

    def __len__(self) -> int:
        return len(self.source)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def read(self, index: int) -> Reading:
        reading = self.source.read(index if self.order is None else int(self.order[index]))
        time = float(self.source.timestamps[index])
        frame = replace(reading.frame, timestamp=time)
        if self.depth_order is not None:
            depth = self.source.read(int(self.depth_order[index])).frame.depth
            frame = replace(frame, depth=depth)
        if self.alter is not None:
            frame = self.alter(frame)
        return Reading(index, reading.stamp, time, frame, None)


@dataclass
class Remembered:
    """A source that reads each frame once."""

    source: Any
    readings: dict[int, Reading] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.source)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def read(self, index: int) -> Reading:
        if index not in self.readings:
            self.readings[index] = self.source.read(index)
        return self.readings[index]


@dataclass
class Given:
    """Frames as a source, 30 a second."""

    given: Sequence[Frame | None]
    camera: Camera
    ground_truth: None = None

    def __len__(self) -> int:
        return len(self.given)

    @property
    def timestamps(self) -> NDArray[np.float64]:
        return np.arange(len(self.given)) / 30

    def read(self, index: int) -> Reading:
        frame = self.given[index]
        problem = None if frame is not None else f"{index}.png is cut short"
        return Reading(index, str(index), index / 30, frame, problem)


def scaled(factor: float) -> Alter:
    """Depth by a wrong scale."""
    return lambda frame: replace(frame, depth=frame.depth * np.float32(factor))


def moved(right: int, down: int) -> Alter:
    """Depth beside colour."""

    def alter(frame: Frame) -> Frame:
        height, width = frame.depth.shape
        matrix = np.array([[1.0, 0, right], [0, 1, down]])
        depth = cv2.warpAffine(frame.depth, matrix, (width, height), flags=cv2.INTER_NEAREST)
        return replace(frame, depth=np.asarray(depth, np.float32))

    return alter


def swapped(count: int) -> Indices:
    """Indices with each two neighbours exchanged."""
    order = np.arange(count)
    pairs = order[: count // 2 * 2].reshape(-1, 2)
    pairs[:] = pairs[:, ::-1].copy()
    return order


def stretched(camera: Camera, factor: float) -> Camera:
    """A camera with a wrong focal length."""
    return replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)


def found(source: Any) -> dict[str, Finding]:
    """What each check says of a source."""
    return {finding.check: finding for finding in examine(cast(Source, source))}


def looks(source: Any) -> Looks:
    """What is looked at of a source."""
    return look_at(cast(Source, source))


def focal(source: Any) -> Finding:
    """What is said of the focal length alone."""
    seen = looks(source)
    return check_focal(walk_all(seen.walks, seen.camera), seen.camera)


def truth(seen: Looks) -> Finding:
    """What is said of the motion against the truth alone, by what was looked at."""
    return check_truth(walk_all(seen.walks, seen.camera), seen.truth, seen.camera.depth_scale)
