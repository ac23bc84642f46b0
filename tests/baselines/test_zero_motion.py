"""Standing still."""

import numpy as np

from edvo import se3
from edvo.baselines.zero_motion import ZeroMotion
from edvo.evaluation import evaluate
from edvo.odometry import Status
from edvo.trajectory import Trajectory

from .conftest import Rendered


def test_stands_still_and_says_so(rendered: Rendered) -> None:
    tracker = ZeroMotion(rendered.camera)
    results = [tracker.track(frame) for frame in rendered.frames]
    assert all(result.status is Status.TRACKED for result in results)
    assert [result.index for result in results] == list(range(len(results)))
    assert [result.is_keyframe for result in results] == [True] + [False] * (len(results) - 1)
    assert [result.keyframe for result in results] == [-1] + [0] * (len(results) - 1)
    np.testing.assert_array_equal(tracker.trajectory.poses, [np.eye(4)] * len(results))


def test_its_error_is_the_motion() -> None:
    times = np.arange(60) / 30
    truth = Trajectory.from_poses(times, [se3.exp([0.2 * t, 0, 0, 0, 0, 0]) for t in times])
    still = Trajectory.from_poses(times, [np.eye(4)] * len(times))
    result = evaluate(truth, still, len(times))
    assert result.rpe is not None
    assert result.rpe_zero_motion is not None
    assert result.rpe.rmse == result.rpe_zero_motion.rmse


def test_skipped_frames_are_lost_and_not_in_the_trajectory(rendered: Rendered) -> None:
    tracker = ZeroMotion(rendered.camera)
    before = tracker.skip(0.0, "no file")
    first = tracker.track(rendered.frames[0])
    after = tracker.skip(1.0, "no file")
    assert (before.status, before.reason, before.keyframe) == (Status.LOST, "no file", -1)
    assert (first.index, first.is_keyframe) == (1, True)
    assert (after.status, after.keyframe, after.is_keyframe) == (Status.LOST, 1, False)
    assert len(tracker.trajectory) == 1


def test_reset_stands_where_it_is_told(rendered: Rendered) -> None:
    start = se3.exp(np.array([1.0, 2.0, 3.0, 0.1, 0.0, 0.0]))
    tracker = ZeroMotion(rendered.camera)
    tracker.track(rendered.frames[0])
    tracker.reset(start)
    result = tracker.track(rendered.frames[1])
    np.testing.assert_array_equal(result.T_world_cam, start)
    assert (result.index, len(tracker.trajectory)) == (0, 1)
