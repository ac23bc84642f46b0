"""Stamps in other units than seconds, and time lapses, which are in seconds."""

import numpy as np
import pytest

from edvo.datasets.inspection.unit import check_unit

SECONDS = np.arange(120) / 30


@pytest.mark.parametrize("start", [0.0, 7.25, 1.3e9])
@pytest.mark.parametrize(
    ("parts", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_other_units_are_named(start: float, parts: float, unit: str) -> None:
    (warning,) = check_unit(np.rint(parts * (start + SECONDS))).warnings
    assert f"stamps look like {unit}; edvo takes seconds: divide them by {parts:.0f}" in warning


@pytest.mark.parametrize("interval", [33, 40, 50, 100])
def test_small_whole_milliseconds_are_no_time_lapse(interval: int) -> None:
    (warning,) = check_unit(float(interval) * np.arange(120)).warnings
    assert "stamps look like milliseconds" in warning


@pytest.mark.parametrize(
    ("start", "longest"), [(0.0, 5.0), (1.3e9, 60.0)], ids=["own beginning", "clock"]
)
@pytest.mark.parametrize("interval", [1 / 30, 0.5, 2.0, 5.0, 10.0, 60.0])
def test_seconds_and_time_lapses_are_sound(start: float, longest: float, interval: float) -> None:
    verdict = check_unit(start + interval * np.arange(120)).verdict
    assert (verdict == "sound") == (interval <= longest)


def test_one_frame_tells_nothing() -> None:
    assert check_unit(np.array([5.0])).verdict == "not observable"
