"""Fig. 5 in a small setting."""

import numpy as np

from edvo.experiments import fig5
from edvo.experiments.bench import Bench
from edvo.experiments.fig5 import EXPERIMENT, Angles
from edvo.frame import Frame

from .outcomes import check


def test_fig5(bench: Bench) -> None:
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    assert len(outcome.tables[0].rows) == len(bench.names)


def test_on_straight_edges_all_angles_are_zero() -> None:
    grey = np.full((120, 160), 50, np.uint8)
    grey[:, 80:] = 150
    angles = fig5.measure([Frame(0.0, grey, np.ones((120, 160), np.float32))])
    assert angles.edges == len(angles.values) == 120
    np.testing.assert_allclose(angles.values, 0, atol=1e-9)
    assert angles.shares == (1.0, 1.0)


def test_it_is_said_where_the_claim_does_not_hold() -> None:
    good, bad = Angles(np.zeros(10), 10), Angles(np.full(10, 45.0), 10)
    assert fig5.judge({"good": good}).holds
    finding = fig5.judge({"good": good, "bad": bad})
    assert finding.holds is False
    assert "on 1 of 2, not on bad" in finding.sentence
    none = Angles(np.empty(0), 0)
    assert fig5.judge({"none": none}).holds is False
