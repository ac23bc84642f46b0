"""A stream that freezes: images that repeat to the bit, which no sensor's noise allows."""

import numpy as np
import pytest

from edvo.config import PRESETS, Config
from edvo.frame import Frame
from edvo.odometry import Odometry, Status

from . import problems

PERIOD = 1 / 30
BEFORE = 10  # frames that move, then it freezes


@pytest.fixture(scope="module")
def room():
    """Forty frames and their poses."""
    return problems.sequence(40)


def started(frames, preset="default"):
    odometry = Odometry(problems.CAMERA, Config.preset(preset))
    return odometry, [odometry.track(frame) for frame in frames[:BEFORE]]


def again(frame, timestamp):
    return Frame(timestamp, frame.grey.copy(), frame.depth)


def repeat(odometry, frame, count):
    return [odometry.track(again(frame, frame.timestamp + k * PERIOD)) for k in range(1, count + 1)]


def off(T, result):
    return problems.error(T, result.T_world_cam)[0]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("count", [1, 3, 8])
def test_a_few_repeats_keep_the_pose(room, preset, count):
    frames, truth = room
    odometry, before = started(frames, preset)
    last = before[-1]
    for result in repeat(odometry, frames[BEFORE - 1], count):
        assert result.status is Status.DEGRADED
        assert result.reason == "the same image as before"
        assert not result.is_keyframe
        np.testing.assert_array_equal(result.T_world_cam, last.T_world_cam)
    assert len(odometry.trajectory) == BEFORE + count
    # the camera has gone on meanwhile
    after = [odometry.track(frame) for frame in frames[BEFORE + count :]]
    assert {result.status for result in after} == {Status.TRACKED}
    assert max(off(T, r) for T, r in zip(truth[BEFORE + count :], after, strict=True)) < 0.02


def test_the_pose_kept_belongs_to_its_keyframe(room):
    frames, _ = room
    rules = ["keyframes.rule=gap", "keyframes.gap_frames=3"]
    odometry = Odometry(problems.CAMERA, Config().with_overrides(rules))
    results = []
    for frame in frames[:8]:
        results.append(odometry.track(frame))
        held = odometry.track(again(frame, frame.timestamp + 0.01))
        key = next(r for r in results if r.index == held.keyframe)
        assert key.is_keyframe
        np.testing.assert_allclose(
            key.T_world_cam @ held.T_key_cur, results[-1].T_world_cam, atol=1e-12
        )


def test_the_velocity_is_not_spoiled(room):
    """After repeats, a prediction is as good as without them."""
    frames, truth = room
    ahead = []
    for repeats in (0, 3):
        odometry, _ = started(frames)
        repeat(odometry, frames[BEFORE - 1], repeats)
        for frame in frames[BEFORE + 3 : BEFORE + 6]:
            odometry.track(frame)
        lost = odometry.skip(frames[BEFORE + 7].timestamp, "gone")
        moved = problems.error(truth[BEFORE + 5], truth[BEFORE + 7])[0]
        assert off(truth[BEFORE + 7], lost) < 0.6 * moved
        ahead.append(lost.T_world_cam)
    distance, angle = problems.error(*ahead)
    assert distance < 0.004
    assert angle < 0.3


def test_a_prediction_right_after_a_repeat(room):
    frames, truth = room
    odometry, before = started(frames)
    repeat(odometry, frames[BEFORE - 1], 2)
    lost = odometry.skip(frames[BEFORE + 2].timestamp, "gone")
    moved = problems.error(before[-1].T_world_cam, truth[BEFORE + 2])[0]
    assert off(truth[BEFORE + 2], lost) < 0.6 * moved


@pytest.mark.parametrize("preset", PRESETS)
def test_a_frozen_stream_is_lost_until_it_goes_on(room, preset):
    frames, truth = room
    odometry, _ = started(frames, preset)
    results = repeat(odometry, frames[BEFORE - 1], 20)
    states = [result.status for result in results]
    assert states[:8] == [Status.DEGRADED] * 8
    assert states[9:] == [Status.LOST] * 11  # 0.3 s is the ninth, or not quite
    assert all("the stream is frozen" in result.reason for result in results[9:])
    assert all(np.isfinite(result.T_world_cam).all() for result in results)
    later = [
        odometry.track(again(frames[k], frames[k].timestamp + 20 * PERIOD))
        for k in range(BEFORE + 2, BEFORE + 12)
    ]
    assert later[0].status is not Status.LOST
    assert off(truth[BEFORE + 2], later[0]) < 0.02
    assert {result.status for result in later[1:]} == {Status.TRACKED}


def test_found_back_after_a_minute(room):
    frames, truth = room
    odometry, _ = started(frames)
    for second in range(1, 60):
        frozen = odometry.track(again(frames[BEFORE - 1], frames[BEFORE - 1].timestamp + second))
        assert frozen.status is Status.LOST
    results = [
        odometry.track(again(frames[k], frames[BEFORE].timestamp + 60 + k * PERIOD))
        for k in range(BEFORE, BEFORE + 12)
    ]
    assert results[-1].status is Status.TRACKED
    assert off(truth[BEFORE + 11], results[-1]) < 0.02


def test_images_without_contrast_are_lost_for_lack_of_edges(room):
    """A covered lens may give black alone: it is not the stream that is frozen."""
    frames, _ = room
    odometry, _ = started(frames)
    for k in range(20):
        dark = np.zeros_like(frames[0].grey)
        result = odometry.track(Frame(11 + k * PERIOD, dark, frames[0].depth))
        assert result.status is Status.LOST
        assert "0 edges with depth" in result.reason


def test_depth_that_goes_on_does_not_make_an_image_new(room):
    frames, _ = room
    odometry, before = started(frames)
    last = frames[BEFORE - 1]
    result = odometry.track(Frame(last.timestamp + PERIOD, last.grey, frames[BEFORE].depth))
    assert result.status is Status.DEGRADED
    np.testing.assert_array_equal(result.T_world_cam, before[-1].T_world_cam)


def test_noise_is_enough_to_be_new(room):
    frames, truth = room
    rng = np.random.default_rng(0)
    odometry, _ = started(frames)
    last = frames[BEFORE - 1]
    for k in range(1, 20):
        noise = rng.integers(-1, 2, last.grey.shape)
        grey = np.clip(last.grey + noise, 0, 255).astype(np.uint8)
        result = odometry.track(Frame(last.timestamp + k * PERIOD, grey, last.depth))
        assert result.status is Status.TRACKED
        assert off(truth[BEFORE - 1], result) < 0.01


def test_an_image_that_was_lost_is_lost_again(room):
    frames, _ = room
    odometry, _ = started(frames)
    turned = np.ascontiguousarray(frames[0].grey[::-1, ::-1])
    for k in range(3):
        result = odometry.track(Frame(11 + k * PERIOD, turned, frames[0].depth))
        assert result.status is Status.LOST
        assert not k or result.reason == "the same image as before, which had no pose"


def test_frozen_from_the_start(room):
    """The first image shows where it is; if it repeats, it goes on from there."""
    frames, truth = room
    odometry = Odometry(problems.CAMERA)
    assert odometry.track(frames[0]).status is Status.TRACKED
    assert repeat(odometry, frames[0], 15)[-1].status is Status.LOST
    results = [odometry.track(frame) for frame in frames[16:20]]
    assert results[-1].status is Status.TRACKED
    assert off(truth[19], results[-1]) < 0.02


def test_a_reset_forgets_the_image(room):
    frames, _ = room
    odometry, _ = started(frames)
    odometry.reset()
    result = odometry.track(frames[BEFORE - 1])
    assert result.status is Status.TRACKED
    assert result.is_keyframe


@pytest.mark.parametrize("back", [0.0, 0.01, 5.0, 1e6])
def test_stamps_that_jump_back_do_no_harm(room, back):
    frames, truth = room
    odometry, before = started(frames)
    last = frames[BEFORE - 1]
    for k in range(3):
        result = odometry.track(again(last, last.timestamp - back + k * 1e-3))
        assert result.status is not Status.TRACKED
        assert problems.error(before[-1].T_world_cam, result.T_world_cam)[0] < 0.02
    results = [
        odometry.track(again(frames[k], frames[k].timestamp - back))
        for k in range(BEFORE, BEFORE + 6)
    ]
    assert results[0].status is not Status.LOST
    assert results[-1].status is Status.TRACKED
    assert off(truth[BEFORE + 5], results[-1]) < 0.02


def test_what_is_said_when_stamps_jump_back_makes_sense(room):
    frames, _ = room
    odometry, _ = started(frames)
    last = frames[BEFORE - 1]
    assert "-" not in odometry.track(again(last, last.timestamp - 5)).reason


def test_a_frozen_stream_whose_stamps_are_frozen_too_is_lost_in_the_end(room):
    frames, _ = room
    odometry, _ = started(frames)
    results = [odometry.track(again(frames[BEFORE - 1], 10.3)) for _ in range(100)]
    assert results[-1].status is Status.LOST
