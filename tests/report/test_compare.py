"""Rows: the failure rule, ranks, ratios, several runs, and poses made elsewhere."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.errors import MissingExtraError
from edvo.evaluation import evaluate
from edvo.report import compare_run
from edvo.report.compare import Comparison, System, compare_source
from edvo.report.compare_rank import _speed, ordinal, summary_verdicts, times, verdicts
from edvo.report.compare_rule import failed, judge, middle
from edvo.trajectory import Trajectory

from .fakes import FakeSource, FakeTime, FakeTracker, path, place

Make = Callable[[Camera, int], FakeTracker]


def system(name: str, make: Make, *, repeats: int = 1, kind: str = "baseline") -> System:
    return System(name, name, kind, make, repeats)  # type: ignore[arg-type]


def scaled(name: str, scale: float, *, kind: str = "baseline") -> System:
    """Make one whose error is known: 0.3 m/s times what the scale differs from 1."""
    return system(name, lambda camera, seed: FakeTracker(scale), kind=kind)


Taking = Callable[..., System]


@pytest.fixture
def taking(monkeypatch: pytest.MonkeyPatch) -> Taking:
    """Make one that takes so many seconds for a frame."""
    clock = FakeTime()
    monkeypatch.setattr(compare_run, "time", clock)

    def make(name: str, seconds: float, *, kind: str = "baseline") -> System:
        def work(index: int) -> None:
            clock.now += seconds

        return system(name, lambda camera, seed: FakeTracker(0.9, on_track=work), kind=kind)

    return make


def compared(*systems: System, **options: object) -> Comparison:
    source = options.pop("source", None) or FakeSource()
    return compare_source(source, systems, **options)  # type: ignore[arg-type]


def test_errors_are_those_of_the_evaluation() -> None:
    comparison = compared(scaled("good", 0.9))
    row = comparison.row("good")
    assert row is not None
    assert row.score is not None
    assert row.rpe == pytest.approx(0.03, rel=1e-9)
    assert row.score.coverage == 1.0
    still = comparison.rows[-1]
    assert (still.name, still.kind) == ("zero-motion", "reference")
    assert still.rpe == pytest.approx(0.3)
    assert not still.failure


def test_the_rule() -> None:
    times = np.arange(40) / 10
    truth = path(times.tolist())
    assert failed(evaluate(truth, path(times.tolist(), 0.9), 40)) == ""
    half = path(times[:20].tolist())
    assert failed(evaluate(truth, half, 40)) == ""  # half of the frames is enough
    assert "48%" in failed(evaluate(truth, path(times[:19].tolist()), 40))
    assert "diverged" in failed(evaluate(truth, path(times.tolist(), -0.1), 40))
    assert "diverged" in failed(evaluate(truth, path(times.tolist(), 0.0), 40))  # stands still
    assert "diverged" in failed(evaluate(truth, path(times.tolist(), 1e15), 40))
    short = evaluate(truth, path(times[:8].tolist(), 0.9), 8)
    assert short.rpe is None
    assert failed(short) == ""
    assert "ATE" in failed(evaluate(truth, path(times[:8].tolist(), 5.0), 8))
    nothing = Trajectory.from_poses(np.empty(0), np.empty((0, 4, 4)))
    assert judge(truth, nothing, 40) == (None, "no poses")
    assert judge(None, half, 40) == (None, "")
    assert "25%" in judge(None, path(times[:10].tolist()), 40)[1]
    assert "clock" in judge(truth, path((times + 1000).tolist()), 40)[1]


def test_ranks_count_those_that_failed() -> None:
    comparison = compared(
        scaled("edvo-default", 0.95, kind="edvo"),
        scaled("edvo-paper", 0.8, kind="edvo"),
        scaled("better", 0.99),
        scaled("diverged", 9.0),
        system("lost", lambda camera, seed: FakeTracker(lost=range(5, 40))),
    )
    places = {row.name: comparison.rank(row) for row in comparison.rows}
    assert places == {
        "better": 1,
        "edvo-default": 2,
        "edvo-paper": 3,
        "diverged": None,
        "lost": None,
        "zero-motion": None,
    }
    assert len(comparison.ranked) == 5
    assert verdicts(comparison)[0].startswith("edvo-default: 2nd of 5 in RPE; ")
    failures = {row.name: row.failure for row in comparison.rows if row.failure}
    assert "diverged" in failures["diverged"]
    assert "12%" in failures["lost"]


def test_edvo_fails_by_the_same_rule() -> None:
    comparison = compared(scaled("edvo-default", -1.0, kind="edvo"), scaled("other", 0.9))
    assert "edvo-default: failed (diverged" in verdicts(comparison)[0]


def test_speed_is_said_as_a_ratio(taking: Taking) -> None:
    comparison = compared(
        taking("edvo-default", 0.01, kind="edvo"),
        taking("slow", 0.05),
        source=FakeSource(15),
    )
    slow = comparison.row("slow")
    assert slow is not None
    assert comparison.time_ratio(slow) == pytest.approx(5)
    assert "5.0x faster than slow" in verdicts(comparison)[0]
    assert [times(9.94), times(9.96), times(14.4), times(1.25)] == ["9.9x", "10x", "14x", "1.2x"]


@pytest.mark.parametrize(("frames", "known"), [(2, False), (3, True)])
def test_no_ratio_of_times_below_three_frames(taking: Taking, frames: int, known: bool) -> None:
    comparison = compared(
        taking("edvo-default", 0.001, kind="edvo"),
        taking("slow", 0.005),
        source=FakeSource(frames),
    )
    slow = comparison.row("slow")
    assert slow is not None
    assert math.isfinite(comparison.time_ratio(slow)) is known
    assert math.isfinite(comparison.cpu_ratio(slow)) is known
    assert any("faster" in line for line in verdicts(comparison)) is known


def test_processor_time_is_said_where_it_differs() -> None:
    assert _speed("peer", 12.0, 11.0) == "12x faster than peer"
    assert _speed("peer", 1.01, 1.2) == "as fast as peer"
    assert _speed("peer", 4.0, 8.0) == "4.0x faster than peer (by processor time 8.0x faster)"
    assert _speed("peer", 0.5, 1.0) == "2.0x slower than peer (by processor time as fast)"


def test_of_many_only_the_quickest_and_the_slowest_are_named(taking: Taking) -> None:
    comparison = compared(
        taking("edvo-default", 0.004, kind="edvo"),
        taking("quick", 0.001),
        *(taking(f"slow{i}", 0.004 * i) for i in range(2, 8)),
        source=FakeSource(12),
    )
    line = verdicts(comparison)[0]
    assert "slower than quick" in line
    assert "faster than the other 6" in line
    assert "2.0x (slow2) to 7.0x (slow7)" in line
    assert "slow4" not in line


def test_several_runs_show_the_one_in_the_middle_and_the_worst() -> None:
    scales = {5: 0.9, 6: 0.99, 7: -3.0}
    some = system("some", lambda camera, seed: FakeTracker(scales[seed]), repeats=3)
    row = compared(some, seed=5).row("some")
    assert row is not None
    assert row.score is not None
    assert row.score.seed == 5
    assert row.rpe == pytest.approx(0.03)
    assert row.worst_rpe == math.inf
    assert row.failed_runs == 1
    assert len(row.wall_s) == 3 * 40


def test_more_runs_that_fail_than_not_are_a_failure() -> None:
    some = system("some", lambda camera, seed: FakeTracker(1.0 if seed else -3.0), repeats=2)
    row = compared(some).row("some")
    assert row is not None
    assert "diverged" in row.failure


def test_later_runs_begin_later() -> None:
    some = System("some", "", "edvo", lambda camera, seed: FakeTracker(0.9), 3, later=True)
    row = compared(some).row("some")
    assert row is not None
    assert [(run.begin, run.frames, run.seed) for run in row.runs] == [
        (0, 40, 0),
        (3, 37, 1),
        (6, 34, 2),
    ]
    assert all(run.coverage == 1.0 for run in row.runs)


def test_what_is_not_installed_is_a_row() -> None:
    def missing(camera: Camera, seed: int) -> FakeTracker:
        raise MissingExtraError("open3d is missing; pip install 'edvo[open3d]'")

    comparison = compared(system("absent", missing), scaled("there", 0.9))
    row = comparison.row("absent")
    assert row is not None
    assert row.failure.startswith("not installed: ")
    assert row.runs == ()
    assert [each.name for each in comparison.ranked] == ["there"]


def test_who_raises_is_a_failed_row() -> None:
    broken = system("broken", lambda camera, seed: FakeTracker(raises={9: ValueError("nan")}))
    row = compared(broken).row("broken")
    assert row is not None
    assert row.failure == "stopped at frame 9: ValueError: nan"


def external(poses: Trajectory, **options: object) -> Comparison:
    return compared(scaled("here", 0.9), trajectories={"there": poses}, **options)


def test_poses_made_elsewhere_are_evaluated_at_the_frames() -> None:
    # At twice the rate of the frames, a little late, and from before them to after them.
    grid = np.arange(-20, 120) / 20 + 0.004
    row = external(path(grid.tolist(), 0.95)).row("there")
    assert row is not None
    assert row.score is not None
    assert len(row.score.trajectory) == 40
    assert row.score.coverage == 1.0
    assert row.rpe == pytest.approx(0.015, rel=1e-6)
    assert row.wall_s.size == 0


def test_poses_made_elsewhere_fail_by_the_same_rule() -> None:
    times = np.arange(40) / 10
    assert "38%" in str(_failure(external(path(times[:15].tolist()))))
    assert "diverged" in str(_failure(external(path(times.tolist(), 3.0))))
    missed = _failure(external(path((times + 1e9).tolist())))
    assert "no pose within 20 ms of a frame" in str(missed)
    assert "1000000000.000" in str(missed)
    empty = Trajectory.from_poses(np.empty(0), np.empty((0, 4, 4)))
    assert _failure(external(empty)) == "no poses"


def _failure(comparison: Comparison) -> str | None:
    row = comparison.row("there")
    return None if row is None else row.failure


def test_poses_between_two_worlds_do_not_matter() -> None:
    times = (np.arange(40) / 10).tolist()
    T_other_world = np.eye(4)
    T_other_world[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    T_other_world[:3, 3] = 3.0, -2.0, 9.0
    moved = Trajectory.from_poses(times, [T_other_world @ place(0.9 * t) for t in times])
    row = external(moved).row("there")
    assert row is not None
    assert row.rpe == pytest.approx(0.03)


def test_without_truth_there_are_times_and_coverage_only() -> None:
    comparison = compared(
        scaled("edvo-default", 0.9, kind="edvo"),
        system("lost", lambda camera, seed: FakeTracker(lost=range(30))),
        source=FakeSource(truth=False),
    )
    edvo, lost = comparison.rows[:2]
    assert math.isnan(edvo.rpe)
    assert not edvo.failure
    assert "25%" in lost.failure
    assert comparison.rank(edvo) is None
    assert "no rank" in verdicts(comparison)[0]
    assert summary_verdicts([comparison, comparison]) == []


def test_stopping_evaluates_what_is_done() -> None:
    asked = 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 30

    comparison = compared(scaled("edvo-default", 0.9, kind="edvo"), stop=stop)
    assert (comparison.frames, comparison.wanted) == (30, 40)
    assert comparison.interrupted
    row = comparison.rows[0]
    assert row.rpe == pytest.approx(0.03)
    assert row.score is not None
    assert row.score.coverage == 1.0


def test_unreadable_frames_are_named() -> None:
    comparison = compared(scaled("a", 0.9), source=FakeSource(unreadable=[3]))
    assert comparison.unreadable == ("3.png is broken",)


def test_changes_of_one_part_are_measured_and_not_ranked() -> None:
    comparison = compared(
        scaled("edvo-paper", 0.9, kind="edvo"),
        scaled("edges: none", 0.8, kind="variant"),
        scaled("edges: finer", 0.95, kind="variant"),
        scaled("edges: lost", -1.0, kind="variant"),
        base="edvo-paper",
    )
    assert len(comparison.ranked) == 1
    line = verdicts(comparison)[-1]
    assert "1 of 3 changes lower the error (most: edges: finer, 0.50x)" in line
    assert "1 do not (least good: edges: none, 2.00x), 1 fail" in line


def test_several_sequences_in_a_sentence() -> None:
    first = compared(scaled("edvo-default", 0.99, kind="edvo"), scaled("o", 0.9))
    second = compared(scaled("edvo-default", 0.9, kind="edvo"), scaled("o", 0.99))
    third = compared(scaled("edvo-default", 9.0, kind="edvo"), scaled("o", 0.99))
    assert summary_verdicts([first, second, third]) == [
        "edvo-default: 1st in 1 of 3 sequences by RPE (1st, 2nd, x)"
    ]


@pytest.mark.parametrize(
    ("number", "text"),
    [(1, "1st"), (2, "2nd"), (3, "3rd"), (4, "4th"), (11, "11th"), (12, "12th"), (21, "21st")],
)
def test_ordinals(number: int, text: str) -> None:
    assert ordinal(number) == text


def test_a_recording_may_repeat_stamps_and_go_back() -> None:
    source = FakeSource()
    source.timestamps[[20, 30]] = source.timestamps[[19, 28]]
    comparison = compared(scaled("good", 0.9), source=source)
    for name in ("good", "zero-motion"):
        row = comparison.row(name)
        assert row is not None
        assert row.score is not None
        assert len(row.score.trajectory) == 38
    assert comparison.rows[0].rpe == pytest.approx(0.03, rel=0.05)


def test_the_worst_is_known_if_one_run_has_no_error() -> None:
    row = compared(system("some", lambda camera, seed: FakeTracker(0.9), repeats=3)).row("some")
    assert row is not None
    unknown = replace(row.runs[0], evaluation=None)
    for runs in ((unknown, *row.runs[1:]), (*row.runs[1:], unknown)):
        assert replace(row, runs=runs).worst_rpe == pytest.approx(0.03)
    assert math.isnan(replace(row, runs=(unknown, unknown)).worst_rpe)
    failed_run = replace(row.runs[0], failure="diverged")
    assert replace(row, runs=(unknown, failed_run)).worst_rpe == math.inf


def test_the_middle_of_an_even_number_is_the_worse() -> None:
    assert middle([0.3, 0.1, math.inf, 0.2], float) == 0.3
    assert middle([math.nan, 0.1, 0.2], float) == 0.2
