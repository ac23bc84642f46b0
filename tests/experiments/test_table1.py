"""Table I in a small setting, and registrations taken apart."""

from functools import partial

import numpy as np
import pytest

from edvo import kernels
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.experiments.bench import Bench
from edvo.experiments.fig10 import thinned
from edvo.experiments.registrations import pairs, registration
from edvo.experiments.stage_times import search_times, take_apart
from edvo.experiments.table1 import EXPERIMENT, SEARCHES, STAGES, Column, judge, measure
from edvo.matching import EdgeIndex

from .outcomes import check, finite


def again(registration, pair):
    return partial(registration.align, pair.reference, pair.samples, pair.starts)


def test_table1(bench: Bench) -> None:
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    table = outcome.tables[0]
    assert [row[0] for row in table.rows] == [*STAGES, "Total", "track in one piece"]
    assert table.rows[3][1:3] == ("300.95", "30.84")
    assert table.rows[5][1:3] == ("338.59", "40.91")
    total = table.records[5]
    for title in ("4-D_k-d_tree", "grid", "as_edvo_runs"):
        for name in ("without", "with"):
            key = f"{title}_{name}_ms"
            parts = [record[key] for record in table.records[:5]]
            assert all(finite(part) for part in parts)
            assert total[key] == pytest.approx(sum(float(part or 0) for part in parts))


def test_a_registration_is_taken_apart_without_changing_it(bench: Bench) -> None:
    sequence, config = bench.sequence("fr3/long_office_household"), Config.preset("paper")
    pair = pairs(sequence, config, 1)[0]
    align, compiled = registration(sequence, config), kernels.align
    before = align.align(pair.reference, pair.samples, pair.starts)
    parts = take_apart(again(align, pair), 1)
    assert kernels.align is compiled
    after = align.align(pair.reference, pair.samples, pair.starts)
    np.testing.assert_array_equal(before.T_ref_cur, after.T_ref_cur)
    assert parts.whole > 0
    assert parts.matching > 0
    # one warp at the start of each stage, one for each trial step, none for one too small to try,
    # and two over every fourth sample to choose between the starts
    tried = sum(not np.isnan(step.trial_cost) for step in before.steps())
    assert len(parts.queries) == tried + 2
    assert {query.criterion.gamma > 0 for query in parts.queries} == {True, False}
    assert all(len(query.pixels) <= len(pair.samples) for query in parts.queries)


def test_tree_and_grid_must_agree(bench: Bench) -> None:
    sequence, config = bench.sequence("fr3/long_office_household"), Config.preset("paper")
    pair = pairs(sequence, config, 1)[0]
    queries = take_apart(again(registration(sequence, config), pair), 1).queries
    edges = pair.reference.edges
    by_grid, by_tree = search_times(pair.reference, EdgeIndex(edges, "tree"), queries)
    assert by_grid > 0
    assert by_tree > 0
    other = EdgeIndex(pair.samples, "tree")
    with pytest.raises(EvaluationError, match="different matches"):
        search_times(pair.reference, other, queries)


def test_too_few_frames_are_an_error(bench: Bench) -> None:
    with pytest.raises(EvaluationError, match="no three frames"):
        measure(thinned(bench.sequence("fr3/long_office_household"), 40), 450, 1)


def test_verdicts(bench: Bench) -> None:
    def column(match: float) -> Column:
        by = dict.fromkeys(SEARCHES, match)
        return Column(1.0, 1.0, 1.0, dict.fromkeys(SEARCHES, 1.0), by, 1.0, 1.0, 1.0, 1.0)

    sequence = bench.sequence("fr3/long_office_household")
    like = judge(sequence, {"all": column(300.0), "sampled": column(20.0)})
    assert [finding.holds for finding in like] == [True, True]
    unlike = judge(sequence, {"all": column(1.0), "sampled": column(50.0)})
    assert [finding.holds for finding in unlike] == [False, False]
