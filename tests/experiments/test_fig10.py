"""Fig. 10 in a small setting."""

from dataclasses import replace

import numpy as np
import pytest

from edvo.experiments import fig10
from edvo.experiments.bench import Bench
from edvo.experiments.fig10 import EXPERIMENT, READINGS, Cell, Grid
from edvo.report import compare_rule

from .outcomes import check, finite


def test_fig10(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fig10, "GAPS_QUICK", (1, 5, 30))
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    for table in outcome.tables:
        assert [row[1] for row in table.rows] == ["1", "5", "30"] * 2
        tracked = [r for r in table.records if r["reading"] == READINGS["tracked"]]
        assert all(finite(record["robust_rpe_rmse_m_s"]) for record in tracked)


def test_thinned_leaves_frames_out(bench: Bench) -> None:
    sequence = bench.sequence("fr3/long_office_household")
    thin = fig10.thinned(sequence, 5)
    assert thin.frames == sequence.frames[::5]
    assert fig10.thinned(sequence, 1).frames == sequence.frames


def test_keyframes_are_so_many_frames_apart(bench: Bench) -> None:
    sequence = bench.sequence("fr3/long_office_household")
    cell = fig10.measure(sequence, "tracked", "robust", 5, range(2))
    assert len(cell.iterations) == 2 * (len(sequence.frames) - 1)
    skipped = fig10.measure(sequence, "skipped", "robust", 5, range(1))
    assert len(skipped.iterations) == len(sequence.frames[::5]) - 1


def grid(normal: list[tuple[float, int]], robust: list[tuple[float, int]]) -> Grid:
    return {
        (reading, criterion, gap): Cell(rmse, np.array([steps, steps]), 1.0)
        for criterion, cells in (("normal", normal), ("robust", robust))
        for reading in READINGS
        for gap, (rmse, steps) in zip((1, 5, 20), cells, strict=True)
    }


def test_verdicts() -> None:
    like_the_paper = grid([(9, 20), (8, 30), (7, 60)], [(9, 15), (5, 16), (3, 17)])
    assert [f.holds for f in (fig10._judge_gap({"a": like_the_paper}),)] == [True]
    assert fig10._judge_drift({"a": like_the_paper}).holds
    assert fig10._judge_steps({"a": like_the_paper}, "tracked").holds
    assert fig10._judge_steps({"a": like_the_paper}, "skipped").holds
    other = grid([(3, 20), (4, 20), (5, 20)], [(3, 15), (4, 40), (5, 50)])
    assert fig10._judge_gap({"a": other}).holds is False
    assert fig10._judge_drift({"a": other}).holds is False
    assert fig10._judge_steps({"a": other}, "tracked").holds is False
    both = fig10._judge_gap({"a": like_the_paper, "b": other})
    assert both.holds is False
    assert "It holds on 1 of 2: a." in both.sentence


def test_without_errors_nothing_can_be_said() -> None:
    nothing = grid([(float("nan"), 1)] * 3, [(float("nan"), 1)] * 3)
    assert fig10._judge_gap({"a": nothing}).holds is None
    assert fig10._judge_drift({"a": nothing}).holds is None
    like_the_paper = grid([(9, 20), (8, 30), (7, 60)], [(9, 15), (5, 16), (3, 17)])
    found = fig10._judge_gap({"a": like_the_paper, "b": nothing})
    assert found.holds is None
    assert found.sentence.endswith("It holds on 1 of 2: a. It cannot be said of b.")


@pytest.mark.parametrize("reading", READINGS)
def test_without_registrations_nothing_can_be_said(reading: str) -> None:
    cells = grid([(9, 20)] * 3, [(9, 15)] * 3)
    nothing = {key: replace(cell, iterations=cell.iterations[:0]) for key, cell in cells.items()}
    assert fig10._judge_steps({"a": nothing}, reading).holds is None


def failing(whole: Grid, criterion: str) -> Grid:
    """Let a criterion fail at the largest gap, with an error that looks good."""
    return {
        (reading, each, gap): replace(cell, rmse=0.001, coverage=0.1, failures=1)
        if (each, gap) == (criterion, 20)
        else cell
        for (reading, each, gap), cell in whole.items()
    }


def test_a_run_that_loses_most_frames_does_not_look_better() -> None:
    alike = grid([(9, 20), (8, 30), (7, 60)], [(9, 15), (8, 16), (7, 17)])
    assert fig10._judge_drift({"a": alike}).holds is False
    normal, robust = failing(alike, "normal"), failing(alike, "robust")
    assert fig10._judge_drift({"a": normal}).holds is True
    assert fig10._judge_drift({"a": robust}).holds is False
    assert fig10._judge_drift({"a": failing(normal, "robust")}).holds is None
    assert fig10._judge_gap({"a": robust}).holds is False
    assert "from a gap of 1 to 5" in fig10._judge_steps({"a": robust}, "tracked").sentence
    assert "x (1.0)" in fig10.make_table("a", robust).rows[2]


def test_a_run_over_few_frames_is_marked(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = bench.sequence("fr3/long_office_household")
    assert fig10.measure(sequence, "tracked", "robust", 5, range(1)).failures == 0
    monkeypatch.setattr(compare_rule, "LEAST_COVERAGE", 1.1)
    assert fig10.measure(sequence, "tracked", "robust", 5, range(2)).failures == 2
