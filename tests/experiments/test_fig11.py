"""Contact sheet and brightness."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from edvo.experiments import fig11
from edvo.experiments.bench import Bench


def test_half_a_period_apart() -> None:
    times = np.arange(90) / 30
    first, second = fig11.half_a_period_apart(times, 0.5)
    assert times[second] - times[first] == pytest.approx(0.25, abs=0.04)
    assert times[first] == pytest.approx(0.125, abs=0.03)


def test_few_frames() -> None:
    assert fig11.half_a_period_apart(np.zeros(1), 0.5) == (0, 0)
    first, second = fig11.half_a_period_apart(np.array([0.0, 0.66]), 0.5)
    assert 0 <= first <= second < 2


@pytest.mark.parametrize("hertz", [0.5, 2.0, 4.5])
def test_dominant_frequency(hertz: float) -> None:
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0, 6, 200))
    values = 3 + np.sin(2 * np.pi * hertz * times + 1) + 0.3 * rng.standard_normal(200)
    assert fig11.dominant_frequency(times, values) == pytest.approx(hertz, abs=0.06)


def test_in_a_small_setting(bench: Bench) -> None:
    outcome = fig11.EXPERIMENT.run(bench)
    records = outcome.tables[0].records
    assert [record["sequence"] for record in records] == list(bench.names)
    for record in records:
        assert record["first_mean_grey"] > record["second_mean_grey"]
        assert 0.2 < record["second_s"] - record["first_s"] < 0.32
        assert 0 < record["least_mean_grey"] < record["largest_mean_grey"] < 255
    held = {finding.claim: finding.holds for finding in outcome.findings}
    assert held["The light varies at 2 Hz"] is True
    assert held["Images one second apart are half a period of the light apart"] is False
    assert [figure.name for figure in outcome.figures] == ["contact_sheet", "brightness"]


def test_frequency_of_the_light_is_seen_where_it_is_long_enough() -> None:
    times = np.arange(120) / 30
    one = fig11.Look(
        cast(Any, None),
        cast(Any, ()),
        times,
        np.full(120, 100.0),
        100 * np.exp(0.3 * np.sin(2 * np.pi * 2.0 * times)),
        (0, 1),
        0.1,
    )
    assert fig11._frequency([one], 2.0).holds is True
    slow = replace(one, after=100 * np.exp(0.3 * np.sin(2 * np.pi * 0.5 * times)))
    assert fig11._frequency([slow], 2.0).holds is False
    short = replace(one, times=times[:20], before=one.before[:20], after=one.after[:20])
    assert fig11._frequency([short], 2.0).holds is None
