"""Fig. 6 in a small setting."""

import numpy as np
import pytest

from edvo.experiments import fig6
from edvo.experiments.bench import Bench
from edvo.experiments.fig6 import EXPERIMENT, Point

from .outcomes import check, finite


def test_fig6(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fig6, "COUNTS_QUICK", (100, 450, 0))
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    for table in outcome.tables:
        few, paper, every = table.records
        assert (few["samples_asked"], every["samples_asked"]) == (100, "all")
        assert few["samples_mean"] == 100
        assert finite(paper["rpe_rmse_mean_m_s"])
        assert float(few["rpe_rmse_std_m_s"] or 0) > 0
        assert (every["rpe_rmse_std_m_s"], every["runs"]) == (0.0, 1)
        assert all(finite(record["track_median_ms"]) for record in table.records)


def point(count: int, *rmse: float) -> Point:
    return Point(count, float(count or 9000), np.array(rmse), 1.0, 1.0, 1.0)


def test_spread_is_that_of_a_sample() -> None:
    assert point(50, 1.0, 3.0).mean == 2.0
    assert point(50, 1.0, 3.0).spread == pytest.approx(2**0.5)
    assert point(50, 1.0).spread == 0.0


@pytest.mark.parametrize(
    ("paper", "holds"), [(0.010, True), (0.0109, True), (0.012, False), (np.nan, None)]
)
def test_enough_is_within_a_tenth_of_all_edges(paper: float, holds: bool | None) -> None:
    points = [point(100, 0.5), point(450, paper), point(0, 0.010)]
    assert fig6.judge("a", points).holds is holds


def test_any_larger_number_may_lower_the_error() -> None:
    points = [point(100, 0.001), point(450, 0.012), point(1000, 0.010), point(0, 0.013)]
    found = fig6.judge("a", points)
    assert found.holds is False
    assert "10.0 mm/s at 1000." in found.sentence
    points[2] = point(1000, np.nan)
    assert fig6.judge("a", points).holds is True
    points[3] = point(0, np.nan)
    assert fig6.judge("a", points).holds is None
