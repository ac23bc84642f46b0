"""Fig. 3 in a small setting."""

from dataclasses import replace

import numpy as np
import pytest

from edvo.experiments import fig3
from edvo.experiments.bench import Bench
from edvo.experiments.fig3 import EXPERIMENT, Look

from .outcomes import check


def test_fig3(bench: Bench) -> None:
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    for record in outcome.tables[0].records:
        assert 0 < float(record["found_again_share"] or 0) <= 1
        assert 0.5 < float(record["within_10_deg"] or 0) <= float(record["within_20_deg"] or 0)


def test_the_same_light_changes_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fig3, "DEFAULT_SEVERITY", 0.0)
    sequence = bench.sequence("fr3/long_office_household")
    looks = fig3.look(sequence, sequence.frames[:2], 0)
    assert fig3.shares(looks) == (1.0, 1.0)
    assert all(len(look.angles) == len(look.edges) and look.change == 0 for look in looks)
    assert fig3.judge({"a": looks}).holds


def test_depth_is_as_late_as_it_was(bench: Bench) -> None:
    sequence = bench.sequence("fr3/long_office_household")
    late = replace(sequence.frames[0], depth_delay=0.012)
    (look,) = fig3.look(sequence, [late], 0)
    assert look.relit.depth_delay == 0.012
    assert (look.relit.grey != late.grey).any()


def test_directions_that_turn_do_not_hold(bench: Bench) -> None:
    frame = bench.sequence("fr3/long_office_household").frames[0]
    edges = fig3.extract_edges(frame.grey, fig3.Config.preset("paper").edges)
    turned = Look(frame, frame, edges, edges, np.array([5.0, 15.0, 25.0, 180.0]))
    assert fig3.shares([turned]) == (0.25, 0.5)
    finding = fig3.judge({"a": [turned]})
    assert finding.holds is False
    assert "a 25% and 50%" in finding.sentence
