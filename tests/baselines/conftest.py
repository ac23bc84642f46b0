"""Frames with known motion, small and rendered, for several tests."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.frame import Frame
from edvo.synthesis.sequence import SyntheticSource, make_recipe

CAMERA = Camera(width=320, height=240, fx=267.7, fy=269.6, cx=159.8, cy=123.6)
STEPS, STRIDE = 6, 2
OFFICE = Camera(width=320, height=240, fx=260.0, fy=260.0, cx=159.5, cy=119.5)

Office = Callable[[int], tuple[Frame, NDArray[np.float64]]]


@dataclass(frozen=True)
class Rendered:
    """A camera moved past a scene."""

    camera: Camera
    frames: tuple[Frame, ...]
    T_world_cam: tuple[NDArray[np.float64], ...]

    def motion(self, reference: int, current: int) -> NDArray[np.float64]:
        """True ``T_ref_cur``."""
        return se3.inverse(self.T_world_cam[reference]) @ self.T_world_cam[current]

    def empty(self, timestamp: float, *, noise: float) -> Frame:
        """Show a wall without texture, seen by a camera with noise."""
        rng = np.random.default_rng(round(timestamp * 1000))
        grey = 120 + noise * rng.normal(size=(self.camera.height, self.camera.width))
        return Frame(timestamp, grey.astype(np.uint8), np.full(grey.shape, 2.0, np.float32))


@pytest.fixture(scope="session")
def rendered() -> Rendered:
    """A few frames of an office, a moderate motion apart."""
    source = SyntheticSource(make_recipe("office", frames=STEPS * STRIDE, camera=CAMERA))
    readings = [source.read(index) for index in range(0, STEPS * STRIDE, STRIDE)]
    frames = tuple(reading.frame for reading in readings if reading.frame is not None)
    poses = tuple(source.ground_truth.at(frame.timestamp) for frame in frames)
    assert len(frames) == STEPS
    return Rendered(CAMERA, frames, poses)


@pytest.fixture(scope="session")
def office() -> Office:
    """Show a furnished room, which has shape for depth alone, and the true pose."""
    source = SyntheticSource(make_recipe("office", frames=31, camera=OFFICE))

    def at(index: int) -> tuple[Frame, NDArray[np.float64]]:
        frame = source.read(index).frame
        assert frame is not None
        return frame, source.ground_truth.at(frame.timestamp)

    return at
