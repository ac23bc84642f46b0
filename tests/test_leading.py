"""Where light jumps so that hardly an edge is left in its place, depth leads on."""

from dataclasses import replace

import pytest

from edvo import se3
from edvo.config import Config
from edvo.doubt import CHANGED
from edvo.leading import LEADS
from edvo.odometry import Odometry, Status

from . import problems

JUMP, FRAMES = 8, 16  # the frame from which on it is another light
LONG = 45  # frames, more than a second of them in the other light
OFF = "planes.lead=none"


def sequence(scene, frames=FRAMES):
    return problems.rendered(scene, frames, seed=3)


@pytest.fixture(scope="module")
def long():
    return sequence("stairs", LONG)


@pytest.fixture(scope="module")
def stairs(long):
    """The beginning of it."""
    camera, frames, truth = long
    return camera, frames[:FRAMES], truth[:FRAMES]


@pytest.fixture(scope="module")
def corridor():
    return sequence("corridor")


def relit(frames):
    """From some frame on what was light is dark: no edge is turned as it was."""
    return [negative(frame) if k >= JUMP else frame for k, frame in enumerate(frames)]


def negative(frame):
    return replace(frame, grey=255 - frame.grey)


def tracked(camera, frames, *overrides):
    odometry = Odometry(camera, Config().with_overrides(overrides))
    return odometry, [odometry.track(frame) for frame in frames]


def off(results, truth):
    return [se3.distance(result.T_world_cam, T) for result, T in zip(results, truth, strict=True)]


def test_it_goes_on_where_the_surfaces_stayed(stairs):
    camera, frames, truth = stairs
    changed = relit(frames)
    _, results = tracked(camera, changed)
    led = results[JUMP]
    assert (led.status, led.reason) == (Status.DEGRADED, LEADS)
    assert led.is_keyframe
    assert led.alignment.match_count == 0
    assert max(off(results, truth)) < 0.01
    for result in results[JUMP + 1 :]:
        assert result.status is Status.DEGRADED
        assert result.reason in (CHANGED, LEADS)
    _, without = tracked(camera, changed, OFF)
    assert all(result.status is Status.LOST for result in without[JUMP : JUMP + 4])


def test_after_a_second_it_is_sure_again(long):
    camera, frames, truth = long
    _, results = tracked(camera, relit(frames))
    assert results[-1].status is Status.TRACKED
    assert max(off(results, truth)) < 0.01


def test_not_at_another_place(stairs, corridor):
    camera, frames, _ = stairs
    swapped = [*frames[:JUMP], *corridor[1][JUMP:]]
    _, results = tracked(camera, swapped)
    assert not any(result.reason == LEADS for result in results)
    assert results[JUMP].status is Status.LOST


def test_not_where_depth_leaves_a_motion_open():
    """Before a wall it says nothing of the two ways along it."""
    camera, frames, _ = sequence("texture_near")
    _, results = tracked(camera, relit(frames))
    assert not any(result.reason == LEADS for result in results)
    assert results[JUMP].status is Status.LOST


def test_not_farther_than_a_hand_moves_a_camera(stairs):
    camera, frames, _ = stairs
    odometry, _ = tracked(camera, frames[:JUMP])
    odometry._course.velocity[:3] += 2.0  # by which it is expected 0.1 m off
    assert odometry.track(negative(frames[JUMP])).reason != LEADS


def test_not_while_something_moves(stairs):
    camera, frames, _ = stairs
    odometry, _ = tracked(camera, frames[:JUMP])
    odometry._doubt.moving_time = frames[JUMP - 1].timestamp
    changed = relit(frames)[JUMP]
    assert odometry.track(changed).reason != LEADS


def test_not_by_depth_that_repeats(stairs):
    camera, frames, _ = stairs
    odometry, _ = tracked(camera, frames[:JUMP])
    stale = replace(negative(frames[JUMP]), depth=frames[JUMP - 1].depth.copy())
    assert odometry.track(stale).reason != LEADS


def test_the_paper_has_no_depth_that_leads():
    assert Config.preset("paper").planes.lead == "none"
    assert Config().planes.lead == "changed-views"
