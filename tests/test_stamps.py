"""Stamps that are no seconds are told once, where no folder is looked through."""

import logging

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.frame import Frame
from edvo.odometry import Odometry
from edvo.stamps import ENOUGH

CAMERA = Camera(64, 48, fx=50, fy=50, cx=31.5, cy=23.5)
SECONDS = 1_305_031_102.175 + np.arange(ENOUGH + 4) / 30


def told(
    caplog: pytest.LogCaptureFixture, times: NDArray[np.float64], odometry: Odometry | None = None
) -> list[str]:
    """What is said of stamps, whatever is said of the frames."""
    odometry = odometry or Odometry(CAMERA)
    caplog.clear()
    with caplog.at_level(logging.WARNING, "edvo"):
        for time in times:
            grey, depth = np.zeros((48, 64), np.uint8), np.ones((48, 64), np.float32)
            odometry.track(Frame(float(time), grey, depth))
    return [line for line in caplog.messages if "stamp" in line]


@pytest.mark.parametrize(
    ("parts", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
@pytest.mark.parametrize("start", [0.0, SECONDS[0]])
def test_another_unit_is_told_once(
    caplog: pytest.LogCaptureFixture, parts: float, unit: str, start: float
) -> None:
    (line,) = told(caplog, parts * (SECONDS - SECONDS[0] + start))
    assert f"stamps look like {unit}; edvo takes seconds: divide them by {parts:.0f}" in line


def test_frames_that_share_a_stamp_are_told(caplog: pytest.LogCaptureFixture) -> None:
    (line,) = told(caplog, np.full(ENOUGH + 4, 5.0))
    assert "have one stamp: give each its own" in line


@pytest.mark.parametrize("times", [SECONDS, SECONDS - SECONDS[0], SECONDS[: ENOUGH - 1] * 1e3])
def test_seconds_are_not_told_nor_what_too_few_frames_tell(
    caplog: pytest.LogCaptureFixture, times: NDArray[np.float64]
) -> None:
    assert told(caplog, times) == []


def test_what_begins_anew_is_looked_at_anew(caplog: pytest.LogCaptureFixture) -> None:
    odometry = Odometry(CAMERA)
    assert told(caplog, SECONDS, odometry) == []
    odometry.reset()
    assert len(told(caplog, SECONDS * 1e3, odometry)) == 1
