from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets import Reading, Source, open_source
from edvo.datasets.inspection import contour_offset, inspect
from edvo.frame import Frame

CAMERA = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)


def scene(seed: int) -> Frame:
    """Boxes of many greys before a wall."""
    rng = np.random.default_rng(seed)
    grey = np.full((240, 320), 90, np.uint8)
    depth = np.full((240, 320), 3.0, np.float32)
    for u, v in rng.integers((10, 10), (260, 190), (8, 2)):
        width, height = rng.integers(20, 60, 2)
        grey[v : v + height, u : u + width] = rng.integers(0, 255)
        depth[v : v + height, u : u + width] = rng.uniform(1.0, 2.0)
    return Frame(0.0, cv2.GaussianBlur(grey, (3, 3), 0), depth)


def moved(frame: Frame, right: int, down: int) -> Frame:
    depth = np.roll(frame.depth, (down, right), (0, 1))
    return replace(frame, depth=np.ascontiguousarray(depth))


@dataclass
class Given:
    frames: list[Frame | None]
    camera: Camera = CAMERA

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> Reading:
        frame = self.frames[index]
        problem = None if frame is not None else f"{index}.png is cut short"
        return Reading(index, str(index), float(index), frame, problem)


def source(*frames: Frame | None) -> Source:
    return cast(Source, Given(list(frames)))


def test_nothing_wrong() -> None:
    assert inspect(source(*(scene(i) for i in range(4)))) == []


@pytest.mark.parametrize(("right", "down"), [(12, 0), (-20, 5), (0, 15)])
def test_depth_beside_colour(right: int, down: int) -> None:
    frames = [moved(scene(i), right, down) for i in range(4)]
    offset = contour_offset(frames)
    assert offset is not None
    assert np.abs(np.add(offset, (right, down))).max() <= 2
    (warning,) = inspect(source(*frames))
    assert "register depth to colour" in warning


def test_flat_wall_tells_nothing_of_registration() -> None:
    wall = Frame(0.0, scene(0).grey, np.full((240, 320), 2.0, np.float32))
    assert contour_offset([wall]) is None


@pytest.mark.parametrize(("factor", "word"), [(0.02, "below"), (20.0, "above")])
def test_implausible_depth_scale(factor: float, word: str) -> None:
    frames = [replace(scene(i), depth=scene(i).depth * np.float32(factor)) for i in range(3)]
    (warning,) = inspect(source(*frames))
    assert word in warning
    assert "depth_scale" in warning


def test_hardly_any_depth() -> None:
    frame = scene(0)
    depth = np.zeros_like(frame.depth)
    depth[:10, :10] = 1.0
    (warning,) = inspect(source(replace(frame, depth=depth)))
    assert "depth pixels" in warning


def test_unreadable_frames_are_named() -> None:
    assert inspect(source(scene(0), None)) == ["1.png is cut short"]
    assert inspect(source(None)) == ["0.png is cut short"]


def test_real_recordings_are_registered(real_data: Path) -> None:
    for folder in sorted(real_data.iterdir()):
        if (folder / "rgb.txt").exists():
            found: Any = inspect(open_source(folder))
            assert found == [], folder.name
