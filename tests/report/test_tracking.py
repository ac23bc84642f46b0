"""The loop, with a source and a tracker that do as they are told."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets import Reading, Source
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.report.tracking import choose_frames, track_source

CAMERA = Camera(width=8, height=6, fx=8.0, fy=8.0, cx=3.5, cy=2.5)


@dataclass
class Still:
    """A source of the same frame again and again, some of them unreadable."""

    count: int = 10
    bad: frozenset[int] = frozenset()
    name: str = "still"
    path: Path = Path("still")

    def __len__(self) -> int:
        return self.count

    def read(self, index: int) -> Reading:
        time = index / 10
        if index in self.bad:
            return Reading(index, f"{time:.3f}", time, None, f"still/{index}.png is bad")
        frame = Frame(time, np.zeros((6, 8), np.uint8), np.ones((6, 8), np.float32))
        return Reading(index, f"{time:.3f}", time, frame, None)


@dataclass
class Scripted:
    """A tracker that remembers its calls, and moves a metre each time."""

    refused: frozenset[float] = frozenset()
    lost: frozenset[float] = frozenset()
    calls: list[tuple[str, float, str]] = field(default_factory=list)

    def track(self, frame: Frame) -> TrackedFrame:
        if frame.timestamp in self.refused:
            raise FrameError("too small")
        self.calls.append(("track", frame.timestamp, ""))
        status = Status.LOST if frame.timestamp in self.lost else Status.TRACKED
        return self._result(frame.timestamp, status, "")

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        self.calls.append(("skip", timestamp, reason))
        return self._result(timestamp, Status.LOST, reason)

    def _result(self, timestamp: float, status: Status, reason: str) -> TrackedFrame:
        # A real one, for all its fields, and then what this test wants of it.
        result = Odometry(CAMERA).skip(timestamp, reason)
        pose = np.eye(4)
        pose[0, 3] = len(self.calls)
        return replace(result, status=status, T_world_cam=pose)


def source(**options: Any) -> Source:
    return cast(Source, Still(**options))


def stamps(records: Sequence[Any]) -> list[str]:
    return [record.stamp for record in records]


def test_every_frame_in_order() -> None:
    tracker, seen = Scripted(), []
    run = track_source(source(), tracker, on_frame=seen.append)
    assert [call[1] for call in tracker.calls] == [index / 10 for index in range(10)]
    assert list(run.frames) == seen
    assert stamps(run.frames)[:2] == ["0.000", "0.100"]
    assert not run.interrupted
    assert len(run.track_times) == 10
    assert run.wall_s > 0


def test_unreadable_frame_is_skipped_with_its_reason() -> None:
    tracker = Scripted()
    run = track_source(source(bad=frozenset({3})), tracker)
    assert tracker.calls[3] == ("skip", 0.3, "still/3.png is bad")
    assert run.problems == ["still/3.png is bad"]
    assert run.frames[3].track_s is None
    assert len(run.track_times) == 9
    assert run.count(Status.LOST) == 1


def test_frame_that_the_tracker_refuses_is_skipped() -> None:
    run = track_source(source(), Scripted(refused=frozenset({0.5})))
    assert run.problems == ["too small"]
    assert run.frames[5].status is Status.LOST
    assert len(run.frames) == 10


def test_trajectory_holds_what_may_be_trusted() -> None:
    run = track_source(source(bad=frozenset({2})), Scripted(lost=frozenset({0.4})))
    trajectory = run.trajectory()
    assert trajectory.stamps == tuple(f"{i / 10:.3f}" for i in range(10) if i not in (2, 4))
    assert trajectory.poses[2, 0, 3] == 4.0


def test_stamps_that_repeat_or_go_back_cost_no_run() -> None:
    """A camera's clock may do so; what was tracked is known all the same."""

    class Resetting(Still):
        def read(self, index: int) -> Reading:
            time = (0.0, 0.1, 0.1, 0.2, 0.05)[index]
            return replace(super().read(index), stamp=f"{time:.2f}", timestamp=time)

    run = track_source(cast(Source, Resetting(5)), Scripted())
    assert stamps(run.frames) == ["0.00", "0.10", "0.10", "0.20", "0.05"]
    trajectory = run.trajectory()
    assert trajectory.stamps == ("0.00", "0.05", "0.10", "0.20")
    assert trajectory.poses[:, 0, 3].tolist() == [1.0, 5.0, 2.0, 4.0]


def test_stops_when_asked_with_what_there_is() -> None:
    tracker = Scripted()
    run = track_source(source(), tracker, stop=lambda: len(tracker.calls) == 4)
    assert len(run.frames) == 4
    assert run.wanted == 10
    assert run.interrupted


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, range(10)),
        ({"start": 4}, range(4, 10)),
        ({"stride": 3}, range(0, 10, 3)),
        ({"start": 1, "stride": 4, "max_frames": 2}, range(1, 9, 4)),
        ({"max_frames": 99}, range(10)),
    ],
)
def test_choice_of_frames(options: dict[str, int], expected: range) -> None:
    assert list(choose_frames(source(), **options)) == list(expected)
    run = track_source(source(), Scripted(), indices=choose_frames(source(), **options))
    assert len(run.frames) == len(expected)


def test_start_behind_the_end() -> None:
    with pytest.raises(DatasetError, match="no frame 10"):
        choose_frames(source(), start=10)
