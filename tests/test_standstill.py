"""A camera that stands: noise alone must not carry the pose away."""

import numpy as np
import pytest

from edvo.config import Config
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import DEFAULT_CAMERA, SyntheticSource, make_recipe

RATE = 30
MM_A_MINUTE = 1.0


def drift(scene, seconds, camera):
    """Distance (mm) between the mean positions of the first and of the last second."""
    recipe = make_recipe(scene, frames=seconds * RATE, trajectory="still", camera=camera)
    source = SyntheticSource(recipe)
    view = source.render(0)  # one view; what the sensor makes of it is new each time
    odometry = Odometry(camera, Config())
    positions = []
    for k in range(len(source)):
        colour, depth = source.colour(k, view), source.depth(k, view)
        scale = camera.depth_scale
        frame = Frame.from_images(k / RATE, colour, depth, depth_scale=scale, order="rgb")
        result = odometry.track(frame)
        assert result.status is Status.TRACKED
        positions.append(result.T_world_cam[:3, 3])
    first, last = (np.mean(part, axis=0) for part in (positions[:RATE], positions[-RATE:]))
    assert np.std(positions, axis=0).max() > 0  # there is noise
    return 1000 * float(np.linalg.norm(last - first))


def test_ten_seconds_of_standing_still():
    assert drift("office", 10, DEFAULT_CAMERA.scaled(0.5)) < MM_A_MINUTE / 6


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["office", "texture_near", "notexture_near"])
def test_a_minute_of_standing_still(scene):
    assert drift(scene, 60, DEFAULT_CAMERA) < MM_A_MINUTE
