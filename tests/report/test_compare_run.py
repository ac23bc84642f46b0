"""Interleaving: who tracks what when, and that nothing decodes meanwhile."""

import time

import numpy as np
import pytest

from edvo.datasets import Reading
from edvo.odometry import Status
from edvo.report import compare_run
from edvo.report.compare_run import Entrant, Followed, follow_together

from .fakes import REFUSED, FakeSource, FakeTracker

Calls = list[tuple[str, int]]
WARM_UP = 3


def entrants(calls: Calls, names: str) -> list[Entrant]:
    """Make trackers that note when they are called."""

    def make(name: str) -> FakeTracker:
        return FakeTracker(on_track=lambda index: calls.append((name, index)))

    return [Entrant(lambda name=name: make(name)) for name in names]


def counted(calls: Calls, names: str) -> Calls:
    """Leave out what happened before anything counted."""
    return calls[WARM_UP * len(names) :]


def test_each_frame_goes_through_all_before_the_next() -> None:
    calls: Calls = []
    follow_together(FakeSource(9), entrants(calls, "abc"), indices=range(9), chunk=4)
    seen = counted(calls, "abc")
    assert [index for _, index in seen] == [i for i in range(9) for _ in range(3)]
    rounds = ["".join(name for name, _ in seen[i : i + 3]) for i in range(0, 27, 3)]
    assert rounds == ["abc", "bca", "cab"] * 3


def test_nothing_is_decoded_while_one_is_timed() -> None:
    source = FakeSource(23)
    busy: list[int] = []

    def look(index: int) -> None:
        source.log.append("track")
        time.sleep(0.003)  # a reader in the background would show up meanwhile
        busy.append(source.reading)

    follow_together(
        source, [Entrant(lambda: FakeTracker(on_track=look))], indices=range(23), chunk=5
    )
    assert len(busy) == WARM_UP + 23
    assert not any(busy)
    tracked = [i for i, entry in enumerate(source.log) if entry == "track"]
    read_before = [sum(e.startswith("read") for e in source.log[:i]) for i in tracked]
    # A chunk is read as a whole, and the next one only once this one is done with.
    assert read_before[WARM_UP:] == [min(23, 5 * (i // 5 + 1)) for i in range(23)]


def test_frames_chosen_come_in_order_whatever_the_chunk() -> None:
    for chunk in (1, 3, 100):
        calls: Calls = []
        chosen = range(4, 20, 3)
        found = follow_together(FakeSource(30), entrants(calls, "a"), indices=chosen, chunk=chunk)
        assert [index for _, index in calls[-len(chosen) :]] == list(chosen)
        assert found[0].frames == len(chosen)
        assert found[0].timestamps == [i / 10 for i in chosen]


def test_only_the_call_is_timed() -> None:
    def dawdle(index: int) -> None:
        time.sleep(0.05)

    slow, quick = follow_together(
        FakeSource(6),
        [Entrant(lambda: FakeTracker(on_track=dawdle)), Entrant(FakeTracker)],
        indices=range(6),
        chunk=2,
    )
    assert min(slow.wall_s) >= 0.05
    assert np.median(slow.cpu_s) < 0.05  # who sleeps takes no processor time
    assert np.median(quick.wall_s) < 0.05
    assert len(slow.wall_s) == len(quick.cpu_s) == 6


def test_what_is_made_for_warming_up_is_thrown_away() -> None:
    made: list[FakeTracker] = []

    def make() -> FakeTracker:
        made.append(FakeTracker())
        return made[-1]

    (found,) = follow_together(FakeSource(4), [Entrant(make)], indices=range(4))
    assert len(made) == 2
    assert found.timestamps == [0.0, 0.1, 0.2, 0.3]


def test_a_frame_that_cannot_be_read_is_lost_to_all_and_not_timed() -> None:
    problems: list[Reading] = []
    source = FakeSource(10, unreadable=[0, 4])
    found = follow_together(
        source,
        [Entrant(FakeTracker), Entrant(FakeTracker)],
        indices=range(10),
        on_frame=problems.append,
    )
    for run in found:
        assert run.frames == 10
        assert run.count(Status.LOST) == 2
        assert np.isnan(run.wall_s).nonzero()[0].tolist() == [0, 4]
        assert run.trajectory().timestamps.tolist() == [
            i / 10 for i in range(10) if i not in (0, 4)
        ]
    assert [r.problem for r in problems if r.problem] == ["0.png is broken", "4.png is broken"]


def test_a_frame_that_is_refused_is_lost_to_that_one_alone() -> None:
    found = follow_together(
        FakeSource(8),
        [Entrant(lambda: FakeTracker(raises={5: REFUSED})), Entrant(FakeTracker)],
        indices=range(8),
    )
    assert [run.count(Status.LOST) for run in found] == [1, 0]
    assert not found[0].stopped


@pytest.mark.parametrize("at", [1, 6])  # while warming up, and later
def test_who_raises_is_out_and_the_others_go_on(at: int) -> None:
    broken = {at: RuntimeError("singular matrix\nand a long trace")}
    found = follow_together(
        FakeSource(12),
        [Entrant(lambda: FakeTracker(raises=broken)), Entrant(FakeTracker)],
        indices=range(12),
        chunk=4,
    )
    assert "RuntimeError: singular matrix" in found[0].stopped
    assert "\n" not in found[0].stopped
    assert len(found[0].statuses) < 12 == found[0].frames
    assert len(found[1].statuses) == 12
    assert not found[1].stopped


@pytest.mark.parametrize("at", [5, 23])  # while warming up, and later
def test_the_frame_at_which_one_stops_counts_from_the_recordings_start(at: int) -> None:
    broken = {at: RuntimeError("singular")}
    (found,) = follow_together(
        FakeSource(30), [Entrant(lambda: FakeTracker(raises=broken))], indices=range(5, 30, 2)
    )
    assert found.stopped == f"stopped at frame {at}: RuntimeError: singular"


def test_stopping_leaves_all_with_the_same_frames() -> None:
    asked = 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 3 * 5 + 2  # in the middle of the sixth frame

    found = follow_together(
        FakeSource(20), [Entrant(FakeTracker)] * 3, indices=range(20), stop=stop
    )
    assert [run.frames for run in found] == [5, 5, 5]
    for run in found:
        assert len(run.statuses) == len(run.poses) == len(run.wall_s) == len(run.stamps) == 5


def test_one_may_begin_later() -> None:
    first, later = follow_together(
        FakeSource(10), [Entrant(FakeTracker), Entrant(FakeTracker, begin=3)], indices=range(10)
    )
    assert (first.frames, later.frames) == (10, 7)
    assert later.timestamps[0] == 0.3


def test_nobody_needs_no_frames() -> None:
    source = FakeSource(5)
    assert follow_together(source, [], indices=range(5)) == []
    assert not source.log


def test_an_empty_run_has_an_empty_trajectory() -> None:
    assert len(Followed().trajectory()) == 0
    assert compare_run.CHUNK_FRAMES > 1
