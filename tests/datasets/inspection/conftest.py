"""Sound recordings to make faulty ones from."""

import pytest

from edvo.camera import Camera
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from .faults import Remembered

CAMERA = Camera(320, 240, 267.0, 267.0, 159.5, 119.5)


def rendered(motion: str) -> Remembered:
    recipe = make_recipe("office", frames=48, camera=CAMERA, trajectory=motion)
    return Remembered(SyntheticSource(recipe, threads=2))


@pytest.fixture(scope="session")
def handheld() -> Remembered:
    """A rendered office, carried about; Kinect noise."""
    return rendered("handheld")


@pytest.fixture(scope="session")
def turning() -> Remembered:
    """The same from a camera that only turns."""
    return rendered("rotation")
