"""Depth that repeats to the bit: taken for what it is, and doubted where it lasts."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.delay import LARGEST_S
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.registration import AT_ONCE, Alignment
from edvo.stale import MOVED_M, MOVED_RAD, StaleDepth
from edvo.status import Judge
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

PERIOD, COUNT = 1 / 30, 45
AT = np.eye(4)
FROZEN = "depth stayed the same image for"


@pytest.fixture(scope="module")
def corridor():
    """A corridor at 320 x 240 with noise of a sensor, its camera and its truth."""
    source = SyntheticSource(make_recipe("corridor", camera=problems.CAMERA, frames=COUNT, seed=4))
    frames = [source.read(i).frame for i in range(COUNT)]
    return source.camera, frames, [source.ground_truth.at(each.timestamp) for each in frames]


def repeated(frames, every):
    """The depth of every so manieth frame, handed out again with those that follow."""
    return [replace(f, depth=frames[i // every * every].depth) for i, f in enumerate(frames)]


def run(camera, frames, *changes):
    odometry = Odometry(camera, Config().with_overrides(changes))
    return [odometry.track(frame) for frame in frames]


def off(truth, results):
    """Root mean square of what the way from each frame to the third after it is off by, mm."""
    squares = []
    for i in range(len(results) - 3):
        true = se3.inverse(truth[i]) @ truth[i + 3]
        found = se3.inverse(results[i].T_world_cam) @ results[i + 3].T_world_cam
        squares.append(problems.error(true, found)[0] ** 2)
    return 1e3 * float(np.sqrt(np.mean(squares)))


def image(seed=0, share=1.0):
    """A depth image, of which so much has depth."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random((240, 320)) < share, rng.uniform(1, 2, (240, 320)), 0)


def frame(timestamp, depth, delay=0.0):
    grey = np.zeros((240, 320), np.uint8)
    return Frame(timestamp, grey, depth.astype(np.float32), depth_delay=delay)


def test_depth_that_repeats_is_of_the_instant_when_it_was_new():
    stale, depth = StaleDepth(), image()
    first = frame(1.0, depth, 0.012)
    assert stale.dated(first, AT) == (first, False)
    second = frame(1.0 + PERIOD, depth.copy(), 0.012)
    dated, is_stale = stale.dated(second, AT)
    assert is_stale
    assert dated.depth_delay == pytest.approx(0.012 - PERIOD)
    assert dated.timestamp == second.timestamp
    assert dated.grey is second.grey
    assert dated.depth is second.depth
    assert second.depth_delay == 0.012  # is not written to
    third, is_stale = stale.dated(frame(1.0 + 2 * PERIOD, depth), AT)
    assert is_stale
    assert third.depth_delay == -LARGEST_S  # 55 ms


def test_a_copy_that_was_made_before_keeps_its_own_instant():
    given = frame(1.0, image())
    kept = given.kept()
    other = given.delayed(-0.02)
    assert kept.depth_delay == 0.0
    assert other.kept().depth_delay == other.depth_delay == -0.02


def test_stamps_that_say_the_same_are_believed():
    stale, depth = StaleDepth(), image()
    stale.dated(frame(1.0, depth, 0.0155), AT)
    second = frame(1.0 + PERIOD, depth, 0.0155 - PERIOD + 4e-4)
    dated, is_stale = stale.dated(second, AT)
    assert is_stale
    assert dated is second


@pytest.mark.parametrize("delay", [-2 * PERIOD, -0.1])
def test_stamps_that_say_the_same_from_long_ago_go_back_as_far_as_is_believed(delay):
    stale, depth = StaleDepth(), image()
    stale.dated(frame(1.0 + delay, depth), AT)
    dated, is_stale = stale.dated(frame(1.0, depth, delay), AT)
    assert is_stale
    assert dated.depth_delay == -LARGEST_S


@pytest.mark.parametrize(("delay", "known"), [(0.045, 0.045), (0.2, 0), (1000, 0), (-1000, 0)])
def test_depth_may_be_later_than_its_image_or_of_another_clock(delay, known):
    stale, depth = StaleDepth(), image()
    assert not stale.dated(frame(1.0, depth, delay), AT)[1]
    dated, is_stale = stale.dated(frame(1.0 + PERIOD, depth, delay), AT)
    assert is_stale
    assert dated.depth_delay == pytest.approx(known - PERIOD)
    assert stale.frozen_for(1.1, se3.exp(np.ones(6))) == 0


def test_where_stamps_stand_still_images_are_counted():
    stale, depth = StaleDepth(), image()
    for k in range(12):
        dated, _ = stale.dated(frame(1.0, depth), AT)
        assert dated.depth_delay == pytest.approx(max(-k * PERIOD, -LARGEST_S))
    assert stale.frozen_for(1.0, se3.exp(np.ones(6))) == pytest.approx(11 * PERIOD)


def test_a_way_to_where_depth_was_new_is_none_since():
    stale, depth = StaleDepth(), image()
    lost, found = AT, se3.exp(np.full(6, 0.3))
    stale.dated(frame(1.0, depth), lost)  # the last pose, before this frame was found again
    for k in range(1, 15):
        stale.dated(frame(1.0 + k * PERIOD, depth), found)
    assert stale.frozen_for(1.5, found) == 0
    assert stale.frozen_for(1.5, lost) > 0


def test_new_depth_is_new_and_so_is_a_clock_that_jumps_back():
    stale, depth = StaleDepth(), image()
    stale.dated(frame(1.0, depth), AT)
    changed = depth.copy()
    changed[112, 160] += 1e-3
    assert not stale.dated(frame(1.1, changed), AT)[1]
    assert stale.dated(frame(1.15, changed), AT)[1]
    assert not stale.dated(frame(0.5, changed), AT)[1]


def test_with_little_depth_two_images_may_look_the_same_by_chance():
    stale = StaleDepth()
    for k in range(3):
        assert not stale.dated(frame(1 + k * PERIOD, image(share=0.05)), AT)[1]


def test_a_wall_without_noise_looks_the_same_from_everywhere_along_it():
    stale, wall = StaleDepth(), np.full((240, 320), 1.5)
    wall[:, :40] = 0  # not measured
    for k in range(3):
        assert not stale.dated(frame(1 + k * PERIOD, wall), AT)[1]


@pytest.mark.parametrize("twist", [(2, 0, 0, 0, 0, 0), (0, 0, 0, 0, -2, 0)])
def test_it_is_frozen_once_the_camera_has_moved_and_time_has_passed(twist):
    stale, depth = StaleDepth(), image()
    stale.dated(frame(1.0, depth), AT)
    scale = np.array([MOVED_M] * 3 + [MOVED_RAD] * 3)
    moved, hardly = (se3.exp(share * scale * np.array(twist)) for share in (1.0, 0.4))
    assert stale.frozen_for(1.2, moved) == 0
    assert stale.frozen_for(1.4, hardly) == 0
    assert stale.frozen_for(1.4, moved) == pytest.approx(0.4)


@pytest.mark.parametrize("every", [2, 3])
def test_fewer_depth_images_are_nearly_as_good_as_all(corridor, every):
    camera, frames, truth = corridor
    whole = run(camera, frames)
    known = run(camera, repeated(frames, every))
    taken = run(camera, repeated(frames, every), "motion.repeated_depth=new")
    assert {each.status for each in known} == {Status.TRACKED}
    assert off(truth, known) < 0.7 * off(truth, taken)
    assert off(truth, known) < 1.5 * every * off(truth, whole)
    assert sum(each.is_keyframe for each in known) > 1
    assert not any(r.is_keyframe for k, r in enumerate(known) if k % every == 1)


def test_the_paper_takes_each_image_as_it_is(corridor):
    camera, frames, _ = corridor
    some = repeated(frames, 2)[:12]
    results = []
    for rule in ("new", "recognised"):
        config = Config.preset("paper").with_overrides([f"motion.repeated_depth={rule}"])
        odometry = Odometry(camera, config)
        results.append([odometry.track(each) for each in some])
    assert Config.preset("paper").motion.repeated_depth == "new"
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)


def alignment(sigma_depth):
    """Edges that fit, and depth that is off the planes by so much."""
    n = 200
    return Alignment(
        T_ref_cur=np.eye(4),
        H=np.eye(6),
        matches=np.arange(n, dtype=np.int32),
        residuals=np.full(n, 0.2),
        trust=np.ones(n),
        pixels=np.zeros((n, 2), np.float32),
        references=np.zeros((n, 2), np.float32),
        inliers=n,
        agreeing=n,
        sigma_px=0.3,
        plane_points=300,
        plane_inliers=300,
        plane_area=0.5,
        sigma_depth=sigma_depth,
        depth_balance=1.0,
        cost=0.1,
        iterations=3,
        converged=True,
        reason="",
        history=np.zeros((3, 8)),
        lag=AT_ONCE,
    )


def test_what_depth_may_be_off_by_grows_where_it_was_not_asked_and_else_does_not():
    judge = Judge(Config())
    judge.note(alignment(1.0))
    assert judge.is_off(alignment(3.5))
    judge.note(replace(alignment(1.0), depth_balance=0.0))
    assert judge.is_off(alignment(3.5))  # edges alone were enough: nothing is to be pardoned
    judge.note(alignment(1.0), is_stale=True)
    assert not judge.is_off(alignment(3.5))
    assert judge.is_off(alignment(6.5))
    for _ in range(9):
        judge.note(alignment(1.0), is_stale=True)
    assert judge.is_off(alignment(9.5))
    judge.note(alignment(1.0))
    assert judge.is_off(alignment(3.5))


def test_depth_that_stays_the_same_while_the_camera_moves_is_doubted(corridor):
    camera, frames, _ = corridor
    start, end = 5, 25
    shown = [
        replace(f, depth=frames[start].depth) if start < i < end else f
        for i, f in enumerate(frames)
    ]
    results = run(camera, shown)
    for i, (given, result) in enumerate(zip(shown, results, strict=True)):
        age = given.timestamp - shown[start].timestamp
        if i <= start or age < 0.3:
            assert result.status is Status.TRACKED, i
        elif i < end and age > 0.3 + 2 * PERIOD:
            assert result.status is not Status.TRACKED, i
            if result.status is Status.DEGRADED:
                assert result.reason.startswith(FROZEN)
    assert sum(each.reason.startswith(FROZEN) for each in results) > 5


def test_a_camera_that_stands_still_may_show_the_same_depth(corridor):
    camera, frames, _ = corridor
    rng = np.random.default_rng(0)
    still = []
    for k in range(40):
        noisy = frames[0].grey + rng.normal(0, 1.5, frames[0].grey.shape)
        grey = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        still.append(replace(frames[0], timestamp=k * PERIOD, grey=grey))
    results = run(camera, still)
    assert {each.status for each in results} == {Status.TRACKED}
    assert max(problems.error(AT, each.T_world_cam)[0] for each in results) < 3e-3
