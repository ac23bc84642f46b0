"""Which depth noise a camera's name stands for."""

import pytest

from edvo.config import Config
from edvo.datasets.devices.noise import noise_of


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        ("Intel RealSense D435I", "realsense_d435"),
        ("Intel RealSense D455", "realsense_d435"),
        ("Intel RealSense D415", "realsense_d415"),
        ("Intel RealSense L515", "azure_kinect"),
        ("Orbbec Femto Bolt", "azure_kinect"),
        ("Orbbec Gemini 335", "realsense_d435"),
        ("Orbbec Astra 2", "kinect_v1"),
    ],
)
def test_is_one_that_the_tracker_knows(name: str, noise: str) -> None:
    assert noise_of(name) == noise
    assert Config().with_overrides([f"planes.sensor={noise}"]).planes.sensor == noise


@pytest.mark.parametrize("name", ["", "RealSense", "Webcam 3"])
def test_is_none_of_a_camera_that_nothing_is_known_of(name: str) -> None:
    assert noise_of(name) is None
