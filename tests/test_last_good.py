"""A hand before the lens: what was seen before it came is what the camera is found again by."""

import numpy as np

from edvo.config import Config
from edvo.doubt import MOVED
from edvo.frame import Frame
from edvo.last_good import APART_S, LastGood
from edvo.odometry import Odometry, Status

from . import problems


def image(timestamp, level, depth_delay=0.0):
    grey = np.full((4, 6), level, np.uint8)
    return Frame(timestamp, grey, np.full((4, 6), 1.0 + level / 100, np.float32), depth_delay)


def test_the_last_one_is_given_away_once():
    kept = LastGood()
    assert kept.take() is None
    for index, level in enumerate((10, 20, 30)):
        kept.note(index, image(index * 2 * APART_S, level), index * np.eye(4))
    good = kept.take()
    assert good is not None
    assert (good.index, good.frame.timestamp) == (2, 4 * APART_S)
    assert (good.frame.grey == 30).all()
    np.testing.assert_array_equal(good.T_world_cam, 2 * np.eye(4))
    assert kept.take() is None


def test_it_is_a_copy_and_taken_no_more_often_than_it_has_to_be():
    kept, first = LastGood(), image(0.0, 10)
    grey, depth = first.grey.copy(), first.depth.copy()
    kept.note(0, Frame(0.0, grey, depth), np.eye(4))
    grey[:], depth[:] = 99, 9.0  # a camera uses its memory again
    kept.note(1, image(0.9 * APART_S, 20), np.eye(4))
    good = kept.take()
    assert good is not None
    assert good.index == 0
    np.testing.assert_array_equal(good.frame.grey, first.grey)
    np.testing.assert_array_equal(good.frame.depth, first.depth)


def test_a_camera_may_use_its_memory_again():
    frames, _ = problems.sequence(30)
    memory = frames[0].grey.copy(), frames[0].depth.copy()
    often = Config().with_overrides(["keyframes.max_translation_m=0.02"])
    for config in (often, Config()):
        apart, again = Odometry(problems.CAMERA, config), Odometry(problems.CAMERA, config)
        for k, frame in enumerate(frames):
            memory[0][:], memory[1][:] = frame.grey, frame.depth
            one, other = apart.track(frame), again.track(Frame(frame.timestamp, *memory))
            np.testing.assert_array_equal(one.T_world_cam, other.T_world_cam)
            assert one.status is other.status
            memory[0][:], memory[1][:] = k, 1.0 + k  # before the next one comes
            if k == 20:  # what is stored then is made of an image of before
                for each in (apart, again):
                    each.skip(frame.timestamp + 1e-3, "broken")


def test_the_delay_of_its_depth_goes_with_it():
    kept = LastGood()
    kept.note(0, image(0.0, 10, -0.012), np.eye(4))
    kept.note(1, image(0.9 * APART_S, 20, 0.005), np.eye(4))
    assert kept.take().frame.depth_delay == -0.012
    kept.note(2, image(1.0, 30), np.eye(4))
    assert kept.take().frame.depth_delay == 0.0


def test_a_clock_that_starts_over_does_not_keep_the_old_one():
    kept = LastGood()
    kept.note(0, image(100.0, 10), np.eye(4))
    kept.note(1, image(1.0, 20), np.eye(4))
    good = kept.take()
    assert good is not None
    assert good.index == 1


def walked(count, *overrides):
    """Walk through a room, and lose it."""
    frames, truth = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames[:count]]
    assert {result.status for result in results} == {Status.TRACKED}
    odometry.skip(frames[count - 1].timestamp + 1 / 30, "no depth")
    return odometry, frames, truth


def test_once_it_is_lost_the_last_good_image_is_a_keyframe():
    far = ("keyframes.max_translation_m=9", "keyframes.max_rotation_deg=179")
    far += ("keyframes.min_overlap=0.6",)
    odometry, frames, truth = walked(25, *far)
    assert len(odometry._upkeep.store) == 2
    index, T_world_key = odometry._upkeep.store.places(0)[-1]
    assert 24 - 30 * APART_S <= index <= 24
    assert problems.error(truth[index], T_world_key)[0] < 0.02
    # what it shows is registered as with any other
    odometry._course.keyframe = odometry._upkeep.store.newest()
    odometry._course.T_key_last = np.eye(4)
    noisy = Frame(frames[25].timestamp, frames[25].grey, frames[25].depth)
    result = odometry.track(noisy)
    assert result.keyframe == index
    assert problems.error(truth[25], result.T_world_cam)[0] < 0.02


def test_where_a_keyframe_is_near_it_is_not_one():
    odometry, _, _ = walked(4)
    assert [index for index, _ in odometry._upkeep.store.places(0)] == [0]


def test_a_frame_in_doubt_is_not_good():
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA)
    for frame in frames[:3]:
        odometry.track(frame)
    odometry._doubt.cast(frames[3].timestamp, MOVED)
    odometry._upkeep._last_good.forget()
    assert odometry.track(frames[3]).status is Status.DEGRADED
    assert odometry._upkeep._last_good.take() is None
