"""What is kept of a run: the worst and the usual, and never much."""

from dataclasses import replace
from typing import Any, cast

import numpy as np

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.export.edge_map import EdgeMap
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.registration import Alignment
from edvo.report.tracking import FrameRecord, Registration
from edvo.report.watch import SPANS, TYPICAL_SHOWN, WORST_SHOWN, Watch, doubt

CAMERA = Camera(width=16, height=12, fx=15.0, fy=15.0, cx=7.5, cy=5.5)
SAMPLES = 100


def alignment(inliers: int, sigma_px: float = 0.5) -> Alignment:
    numbers = dict.fromkeys(Alignment.__slots__, 0)
    return Alignment(
        **{
            **cast(dict[str, Any], numbers),
            "matches": np.zeros(SAMPLES, np.int32),
            "inliers": inliers,
            "sigma_px": sigma_px,
        }
    )


class Scripted:
    """A tracker whose frames fit as well as it is told."""

    def __init__(self, inliers: list[int], lost: tuple[int, ...] = ()) -> None:
        self.inliers, self.lost = inliers, lost
        self.count = 0
        self.blank = Odometry(CAMERA).skip(0.0, "")

    def track(self, frame: Frame) -> TrackedFrame:
        index = self.count
        self.count += 1
        return replace(
            self.blank,
            index=index,
            status=Status.LOST if index in self.lost else Status.TRACKED,
            keyframe=(index - 1) // 10 * 10 if index else -1,
            is_keyframe=index % 10 == 0,
            alignment=alignment(self.inliers[index]) if index else None,
        )

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        self.count += 1
        return self.blank


def watched(inliers: list[int], lost: tuple[int, ...] = (), **options: Any) -> Watch:
    watch = Watch(Scripted(inliers, lost), len(inliers), **options)
    for index, share in enumerate(inliers):
        grey = np.full((12, 16), index % 256, np.uint8)
        frame = Frame(index / 10, grey, np.ones((12, 16), np.float32))
        result = watch.track(frame)
        watch.after(replace(record(share), status=result.status))
    return watch


def record(inliers: int) -> FrameRecord:
    found = Registration.of(alignment(inliers))
    made = dict.fromkeys(FrameRecord.__slots__)
    return FrameRecord(**{**cast(Any, made), "samples": SAMPLES, "registration": found})


def test_worst_come_from_all_parts_of_the_run() -> None:
    inliers = [90] * 80
    for bad, share in ((5, 40), (6, 41), (33, 20), (71, 50), (72, 88)):
        inliers[bad] = share
    found = [sight.result.index for sight in watched(inliers).worst()]
    assert {5, 33, 71} <= set(found)
    assert 6 not in found  # beside a worse one
    assert found == sorted(found)
    assert len(found) == WORST_SHOWN


def test_lost_is_worse_than_any_misfit() -> None:
    inliers = [90] * 80
    inliers[20], inliers[25] = 5, 80
    found = watched(inliers, lost=(25,)).worst()
    assert 25 in [sight.result.index for sight in found]
    assert 20 not in [sight.result.index for sight in found]


def test_a_loss_is_shown_by_how_it_began() -> None:
    inliers = [90] * 23 + [20] + [10] * 6 + [90] * 50
    found = watched(inliers, lost=tuple(range(23, 30))).worst()
    assert [s.result.index for s in found if s.result.status is Status.LOST] == [23]


def test_typical_fit_as_most_do() -> None:
    inliers = [60] * 40 + [90] * 40
    inliers[7] = inliers[27] = 90
    watch = watched(inliers)
    found = watch.typical([record(share) for share in [60, 90, 90]])
    assert len(found) == TYPICAL_SHOWN
    assert all(sight.result.alignment.inliers == 90 for sight in found if sight.result.alignment)
    assert not {s.result.index for s in found} & {s.result.index for s in watch.worst()}


def test_memory_does_not_grow_with_the_run() -> None:
    watch = watched([90] * 1000)
    kept = len(watch._worst) + len(watch._plain)
    assert kept <= 2 * SPANS


def test_nothing_is_kept_unasked() -> None:
    watch = watched([90] * 50, keep_sights=False)
    assert watch.worst() == []
    assert watch.typical([record(90)]) == []


def test_unreadable_frames_are_not_kept() -> None:
    watch = Watch(Scripted([90] * 3), 3)
    watch.skip(0.0, "broken")
    watch.after(record(0))
    assert watch.worst() == []


def test_only_keyframes_go_to_the_map() -> None:
    added: list[float] = []

    class Counted(EdgeMap):
        def add(self, frame: Frame, T_world_cam: Any) -> None:
            added.append(frame.timestamp)

    watched([90] * 25, edge_map=Counted(CAMERA, EdgesConfig()))
    assert added == [0.0, 1.0, 2.0]


def test_order_of_doubt() -> None:
    blank = Odometry(CAMERA).skip(0.0, "")
    lost = replace(blank, alignment=None)
    first = replace(blank, status=Status.TRACKED)
    good, fair, blurred = (
        replace(first, alignment=found)
        for found in (alignment(95), alignment(80), alignment(80, 1.0))
    )
    degraded = replace(good, status=Status.DEGRADED)
    order = [first, good, fair, blurred, degraded, lost]
    assert sorted(order, key=doubt) == order
    assert doubt(blurred) < doubt(lost, still_lost=True) < doubt(degraded)
