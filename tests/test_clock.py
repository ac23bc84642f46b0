import time

import pytest

from edvo.clock import StageClock, no_clock


def test_a_stage_takes_as_long_as_it_takes():
    clock = StageClock()
    before = time.perf_counter()
    with clock("sleep"):
        time.sleep(0.01)
    passed = time.perf_counter() - before
    seconds = clock.take()["sleep"]
    assert 0.01 <= seconds <= passed


def test_visits_add_up_and_stages_keep_the_order_of_their_first():
    clock = StageClock()
    for stage in ("b", "a", "b"):
        with clock(stage):
            time.sleep(0.001)
    seconds = clock.take()
    assert list(seconds) == ["b", "a"]
    assert seconds["b"] >= 0.002


def test_take_starts_anew():
    clock = StageClock()
    with clock("once"):
        pass
    clock.take()
    assert clock.take() == {}


def test_a_stage_that_fails_is_timed_and_its_error_goes_on():
    clock = StageClock()
    with pytest.raises(ValueError, match="no"), clock("bad"):
        raise ValueError("no")
    assert list(clock.take()) == ["bad"]


def test_no_clock_does_nothing():
    with no_clock("edges"), no_clock("edges"):
        pass
