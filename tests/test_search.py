"""Looking farther afield where a registration is in doubt."""

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

YAW_DEG = 13.0
PERIOD = 1 / 30


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """Two frames of a cabinet that a turn of the camera lies between, and that motion."""
    start = make_recipe("cabinet", frames=1).truth().poses[0]
    turn = se3.exp(np.array([0.05, 0.0, 0.02, 0.0, np.radians(YAW_DEG), 0.0]))
    path = tmp_path_factory.mktemp("path") / "path.txt"
    times = [0.0, PERIOD]
    Trajectory.from_poses(times, [start, start @ turn]).write(path)
    source = SyntheticSource(make_recipe("cabinet", frames=2, trajectory=path))
    frames = [source.read(i).frame for i in range(2)]
    T = source.ground_truth
    truth = se3.inverse(T.at(frames[0].timestamp)) @ T.at(frames[1].timestamp)
    return source.camera, frames, truth


def second(apart, *overrides):
    camera, frames, truth = apart
    odometry = Odometry(camera, Config().with_overrides(overrides))
    odometry.track(frames[0])
    # a hand does not turn so far in a thirtieth of a second
    result = odometry.track(Frame(frames[0].timestamp + 0.5, frames[1].grey, frames[1].depth))
    off = se3.inverse(truth) @ result.T_key_cur
    return result, np.linalg.norm(off[:3, 3]), np.degrees(se3.rotation_angle(off))


def test_a_turn_too_wide_for_the_edges_is_found(apart):
    near, *_ = second(apart, "motion.search_deg=0")
    assert near.status is not Status.TRACKED
    wide, distance, angle = second(apart)
    assert wide.status is not Status.LOST
    assert distance < 0.01
    assert angle < 0.5


def test_the_search_turns_the_camera_where_it_is(apart):
    """Not round the keyframe's: far from that, a turn would carry it away."""
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    T = se3.exp(np.array([0.4, 0.0, 0.1, 0.0, 0.1, 0.0]))
    starts = []

    def keep(key, samples, points, given):
        starts.append(given)
        return align(key, samples, points, given)

    align, odometry._search._register = odometry._search._register, keep
    key = odometry._keyframe
    seen = type("Seen", (), {"samples": key.samples, "points": key.points})
    odometry._search.around(key, T, seen)
    assert len(starts) == 16
    np.testing.assert_allclose([s[:3, 3] for s in starts[:15]], [T[:3, 3]] * 15, atol=1e-12)


def test_the_search_never_makes_it_worse(apart):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    key = odometry._keyframe
    seen = type("Seen", (), {"samples": key.samples, "points": key.points})
    perfect = odometry._search._register(key, key.samples, key.points, np.eye(4))
    assert odometry._search.around(key, np.eye(4), seen, perfect) is perfect


def test_no_search_without_doubt(apart):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    calls = []
    odometry._search.around = lambda *given: calls.append(given)
    odometry.track(frames[0])
    noise = np.random.default_rng(0).integers(-1, 2, frames[0].grey.shape)  # else it is a repeat
    grey = np.clip(frames[0].grey + noise, 0, 255).astype(np.uint8)
    again = Frame(frames[0].timestamp + PERIOD, grey, frames[0].depth)
    assert odometry.track(again).status is Status.TRACKED
    assert not calls


def test_where_depth_contradicts_the_edges_a_doubtful_frame_is_lost(apart):
    strict = ["status.doubt_inliers=1.0", "status.max_depth_sigma=1e-3"]
    result, *_ = second(apart, *strict)
    assert result.status is Status.LOST
    assert "depth contradicts the edges" in result.reason
