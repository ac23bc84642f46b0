"""A tracker made of any aligner: what it asks, believes, tries again, and keeps rigid."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.frame import Frame
from edvo.odometry import Status

CAMERA = Camera(width=8, height=6, fx=8.0, fy=8.0, cx=3.5, cy=2.5)
STEP = se3.exp(np.array([0.02, 0.0, 0.01, 0.0, 0.01, 0.0]))


def frame(index: int) -> Frame:
    grey = np.full((6, 8), index, np.uint8)
    return Frame(index / 30, grey, np.full((6, 8), 2.0, np.float32))


def motion(steps: int) -> NDArray[np.float64]:
    return se3.compose(np.eye(4), *[STEP] * steps)


class Oracle:
    """Knows the motion from the brightness, which counts the frames, and notes what it is asked."""

    name = "oracle"

    def __init__(self, fails: tuple[tuple[int, int], ...] = (), sloppy: float = 0.0) -> None:
        self.fails = fails
        self.sloppy = sloppy
        self.asked: list[tuple[int, int, NDArray[np.float64]]] = []

    def prepare(self, seen: Frame) -> int:
        return int(seen.grey[0, 0])

    def align(self, reference: Any, current: Any, T_ref_guess: Any) -> NDArray[np.float64] | None:
        self.asked.append((reference, current, T_ref_guess))
        if (reference, current) in self.fails:
            return None
        T_ref_cur = motion(current - reference)
        T_ref_cur[:3, :3] *= 1 + self.sloppy
        return T_ref_cur


def test_the_guess_is_the_motion_at_the_last_velocity() -> None:
    oracle = Oracle()
    tracker = PairwiseOdometry(CAMERA, oracle, keyframes=KeyframeRule(1.0, 90.0))
    for index in range(4):
        tracker.track(frame(index))
    guesses = [guess for _, _, guess in oracle.asked]
    np.testing.assert_allclose(guesses[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(guesses[1], motion(2), atol=1e-12)
    np.testing.assert_allclose(guesses[2], motion(3), atol=1e-12)


@pytest.mark.parametrize(
    ("rule", "references"),
    [(KeyframeRule(0.05, 90.0), [0, 0, 0, 3]), (FRAME_TO_FRAME, [0, 1, 2, 3])],
)
def test_the_rule_chooses_the_reference(rule: KeyframeRule, references: list[int]) -> None:
    oracle = Oracle()
    tracker = PairwiseOdometry(CAMERA, oracle, keyframes=rule)
    for index in range(5):
        result = tracker.track(frame(index))
    assert [reference for reference, _, _ in oracle.asked] == references
    np.testing.assert_allclose(result.T_world_cam, motion(4), atol=1e-9)


def test_turns_to_the_last_frame_where_the_keyframe_fails() -> None:
    oracle = Oracle(fails=((0, 3),))
    tracker = PairwiseOdometry(CAMERA, oracle, keyframes=KeyframeRule(1.0, 90.0))
    results = [tracker.track(frame(index)) for index in range(4)]
    assert [(a, b) for a, b, _ in oracle.asked[-2:]] == [(0, 3), (2, 3)]
    assert results[-1].status is Status.TRACKED
    assert results[-1].keyframe == 2
    np.testing.assert_allclose(results[-1].T_world_cam, motion(3), atol=1e-9)


def test_is_lost_where_both_fail() -> None:
    tracker = PairwiseOdometry(
        CAMERA, Oracle(fails=((0, 2), (1, 2))), keyframes=KeyframeRule(1.0, 90.0)
    )
    results = [tracker.track(frame(index)) for index in range(4)]
    assert [result.status for result in results[2:]] == [Status.LOST, Status.TRACKED]
    assert results[2].reason == "registration failed"
    assert len(tracker.trajectory) == 3


def test_motions_stay_rigid_though_each_is_the_next_ones_guess() -> None:
    tracker = PairwiseOdometry(CAMERA, Oracle(sloppy=1e-4), keyframes=FRAME_TO_FRAME)
    for index in range(60):
        tracker.track(frame(index))
    rotations = tracker.trajectory.poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (60, 3, 3)), atol=1e-9
    )


def test_a_recording_may_repeat_stamps_and_go_back() -> None:
    tracker = PairwiseOdometry(CAMERA, Oracle(), keyframes=KeyframeRule(1.0, 90.0))
    for index, time in enumerate((0.1, 0.2, 0.2, 0.0)):
        tracker.track(replace(frame(index), timestamp=time))
    found = tracker.trajectory
    assert found.timestamps.tolist() == [0.0, 0.1, 0.2]
    np.testing.assert_allclose(found.poses[2], motion(1))


def test_a_straightened_frame_has_the_times_of_the_bent_one() -> None:
    prepared: list[Frame] = []

    class Noting(Oracle):
        def prepare(self, seen: Frame) -> int:
            prepared.append(seen)
            return super().prepare(seen)

    bent = replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    tracker = PairwiseOdometry(bent, Noting(), keyframes=FRAME_TO_FRAME)
    tracker.track(replace(frame(3), depth_delay=-0.007))
    assert [(seen.timestamp, seen.depth_delay) for seen in prepared] == [(0.1, -0.007)]
