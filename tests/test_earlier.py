"""Where a frame no longer fits the last keyframe, one before it may do."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.frame import Frame
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

BEFORE = 8  # frames, before another light makes a keyframe of its own


@pytest.fixture(scope="module")
def walk():
    """Frames of a walk, and where they are in the camera of the first one."""
    recipe = make_recipe("office", frames=BEFORE + 3, camera=problems.CAMERA, seed=3)
    source = SyntheticSource(recipe)
    frames = [source.read(i).frame for i in range(len(source))]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def in_another_light(walk, *overrides):
    """Track a walk until a keyframe is made of which each edge is turned the other way."""
    camera, frames, _ = walk
    odometry = Odometry(camera, Config().with_overrides(overrides))
    for frame in frames[:BEFORE]:
        assert odometry.track(frame).status is Status.TRACKED
    last = frames[BEFORE - 1]
    negative = odometry._front_end.see(replace(last, grey=255 - last.grey), BEFORE - 1)
    odometry._upkeep.make(negative.kept(), BEFORE - 1, None)
    return odometry


def test_it_goes_back_to_the_keyframe_that_fits(walk, monkeypatch):
    _, frames, truth = walk
    odometry = in_another_light(walk)
    forgotten = problems.ways_forgotten(odometry, monkeypatch)
    for k in range(BEFORE, len(frames)):
        result = odometry.track(frames[k])
        assert result.status is Status.TRACKED
        off = se3.inverse(truth[k]) @ result.T_world_cam
        assert np.linalg.norm(off[:3, 3]) < 0.002
        assert odometry._course.key.index == 0
    assert forgotten == [BEFORE]


def test_asked_for_none_it_is_lost(walk):
    odometry = in_another_light(walk, "keyframes.earlier=0", "planes.lead=none")
    assert odometry.track(walk[1][BEFORE]).status is Status.LOST


def test_it_stays_with_the_last_one_where_none_fits(walk):
    camera, frames, _ = walk
    odometry = in_another_light(walk)
    last, T_key_last = odometry._course.key, odometry._course.T_key_last
    other = SyntheticSource(make_recipe("texture_near", frames=1, camera=camera)).read(0).frame
    elsewhere = Frame(frames[BEFORE].timestamp, other.grey, other.depth)
    assert odometry.track(elsewhere).status is Status.LOST
    assert odometry._course.key is last
    assert odometry._course.T_key_last is T_key_last


def test_not_once_it_is_lost_for_longer_than_a_velocity_lasts(walk):
    _, frames, _ = walk
    odometry = in_another_light(walk)
    last = odometry._course.key
    late = replace(frames[BEFORE], timestamp=frames[BEFORE - 1].timestamp + 0.25)
    seen = odometry._front_end.see(late, BEFORE)
    assert odometry._earlier.go_back(seen) is None
    assert odometry._course.key is last


def test_not_without_depth_which_knows_no_light(walk):
    odometry = in_another_light(walk, "planes.weight=0")
    assert odometry.track(walk[1][BEFORE]).status is Status.LOST


def with_the_first_aside(walk):
    """The same, the earlier keyframe put 1 cm aside, and a pose held before."""
    _, frames, _ = walk
    odometry = in_another_light(walk)
    (first,) = odometry._upkeep.store.near(np.eye(4), 0, 1e-6)
    moved = first.T_world_key @ se3.exp([0, 0.01, 0, 0, 0, 0])
    odometry._upkeep.store.replace(first, replace(first, T_world_key=moved))
    odometry._course.stood = frames[BEFORE - 2].timestamp, np.eye(4)
    return odometry, frames[BEFORE]


def test_what_keyframes_are_off_each_other_is_no_motion(walk):
    odometry, frame = with_the_first_aside(walk)
    velocity = odometry._course.velocity.copy()
    assert odometry.track(frame).status is Status.TRACKED
    np.testing.assert_allclose(odometry._course.velocity[:3], velocity[:3], atol=0.003)


def test_one_that_stands_farther_off_than_a_hand_moves_is_not_gone_back_to(walk, monkeypatch):
    odometry, frame = with_the_first_aside(walk)
    monkeypatch.setattr("edvo.assessing.LEAP_M_S2", 5.0)  # by 6 mm from frame to frame
    monkeypatch.setattr("edvo.assessing.SCATTER_M", 0.0)
    monkeypatch.setattr(odometry._placer._leading, "lead", lambda seen: None)
    assert odometry.track(frame).status is Status.LOST
    assert odometry._course.key.index == BEFORE - 1


def test_what_is_not_believed_in_the_end_is_left_again(walk, monkeypatch):
    _, frames, _ = walk
    odometry = in_another_light(walk)
    course = odometry._course
    course.stood = frames[BEFORE - 2].timestamp, np.eye(4)
    before = now_of(course)
    monkeypatch.setattr(odometry._doubt, "question", lambda *given: (Status.LOST, "it cannot be"))
    assert odometry.track(frames[BEFORE]).reason == "it cannot be"
    assert all(now is was for now, was in zip(now_of(course), before, strict=True))


def now_of(course):
    """Where a course goes on from."""
    return course.key, course.T_key_last, course.stood


def test_the_nearest_of_a_piece_come_first():
    store = KeyframeStore(9)
    for index, (x, turn, piece) in enumerate(
        [(0.3, 0.0, 0), (0.0, 0.1, 0), (0.2, 0.15, 0), (0.01, 0.0, 1), (0.0, 0.9, 0)]
    ):
        T = se3.exp([x, 0, 0, 0, turn, 0])
        store.add(Keyframe(index, T, None, None, None, None, None, None, None, 0.0, piece))
    assert [key.index for key in store.near(np.eye(4), 0, 0.6)] == [1, 0, 2]
    assert [key.index for key in store.near(np.eye(4), 1, 0.6)] == [3]
    assert [key.index for key in store.near(np.eye(4), 0, 0.2)] == [1]
