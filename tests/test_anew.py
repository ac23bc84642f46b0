"""Beginning anew: a lost camera that sees what it has never seen."""

from copy import deepcopy

import numpy as np
import pytest

from edvo import se3
from edvo.anew import Chain
from edvo.config import Config
from edvo.evaluation.honesty import error_speed
from edvo.frame import Frame
from edvo.odometry import ANEW, Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

CAMERA = problems.CAMERA
PERIOD = 1 / 30
SEEN, LOST_S = 20, 1.2


def rendered(scene, count, **given):
    source = SyntheticSource(make_recipe(scene, frames=count, seed=3, camera=CAMERA, **given))
    frames = [source.read(i).frame for i in range(count)]
    return frames, np.array([source.ground_truth.at(frame.timestamp) for frame in frames])


@pytest.fixture(scope="module")
def office():
    return rendered("office", SEEN)


@pytest.fixture(scope="module")
def elsewhere():
    return rendered("texture_near", 45)


def later(frames, t):
    """The same, from another time on, and with other noise: a camera gives no image twice."""
    rng = np.random.default_rng(int(1000 * t))
    shown = []
    for k, frame in enumerate(frames):
        grey = np.clip(frame.grey + rng.integers(-1, 2, frame.grey.shape), 0, 255)
        shown.append(Frame(t + k * PERIOD, grey.astype(np.uint8), frame.depth))
    return shown


@pytest.fixture(scope="module")
def anew(office, elsewhere):
    """What `lost_and_elsewhere` gives of a tracker as it is; not to be changed."""
    return lost_and_elsewhere(office, elsewhere)


def lost_and_elsewhere(office, elsewhere, *overrides, preset="default"):
    """See an office, nothing for a while, and another place."""
    odometry = Odometry(CAMERA, Config.preset(preset).with_overrides(overrides))
    for frame in later(office[0], 0.0):
        odometry.track(frame)
    t = SEEN * PERIOD
    for k in range(3):
        odometry.skip(t + k * LOST_S / 3, "no depth")
    return odometry, [odometry.track(frame) for frame in later(elsewhere[0], t + LOST_S)]


def test_images_are_held_against_one_another_from_how_fast_it_went_too(
    office, elsewhere, monkeypatch
):
    """From where it was alone, a step is the wrong one where things repeat."""
    follow, begun = Chain._follows, []

    def spied(chain, last, seen):
        align = chain._registration.align

        def noted(edges, samples, starts, *given, **options):
            begun.append((starts, seen.frame.timestamp - last.timestamp))
            return align(edges, samples, starts, *given, **options)

        with monkeypatch.context() as patch:
            patch.setattr(chain._registration, "align", noted)
            velocity = follow(chain, last, seen)
        begun.append(velocity)
        return velocity

    monkeypatch.setattr(Chain, "_follows", spied)
    lost_and_elsewhere(office, elsewhere)
    (first, _), velocity, (second, period) = begun[:3]
    np.testing.assert_array_equal(first, np.eye(4)[None])
    np.testing.assert_array_equal(second, [np.eye(4), se3.exp(velocity * period)])


def test_what_did_not_follow_says_nothing_of_how_fast_it_goes(elsewhere, anew, monkeypatch):
    odometry, _ = deepcopy(anew)
    chain = odometry._recovery._chain
    seen = [odometry._front_end.see(each, k) for k, each in enumerate(later(elsewhere[0][:4], 9.0))]
    keyframes = [odometry._front_end.keyframe(each, k, np.eye(4), 0) for k, each in enumerate(seen)]
    for each, keyframe in zip(seen[:2], keyframes[:2], strict=True):
        chain.join(each, keyframe)
    assert chain._velocity is not None
    with monkeypatch.context() as patch:
        patch.setattr(chain, "_follows", lambda last, seen: None)
        chain.join(seen[2], keyframes[2])
    assert chain._velocity is None
    chain.join(seen[3], keyframes[3])
    assert chain._velocity is not None
    chain.forget()
    assert chain._velocity is None


def test_it_begins_anew_once_images_have_fitted_one_another_for_half_a_second(anew):
    _, results = anew
    assert [result.status for result in results[:15]] == [Status.LOST] * 15
    assert {result.status for result in results[16:]} == {Status.DEGRADED}
    assert {result.piece for result in results[16:]} == {1}
    first = next(result for result in results if result.piece)
    assert (first.is_keyframe, first.reason, first.alignment) == (True, ANEW, None)
    assert {result.reason for result in results[16:]} == {ANEW}


def test_the_poses_of_a_piece_belong_together(elsewhere, anew):
    _, results = anew
    times = np.array([result.timestamp for result in results])
    poses = np.array([result.T_world_cam for result in results])
    given = np.array([result.status is not Status.LOST for result in results])
    speed = error_speed(times, elsewhere[1], poses, given)
    assert np.nanmax(speed) < 0.01
    assert np.count_nonzero(np.isfinite(speed)) > 25


def test_it_begins_where_it_was_expected(office, anew):
    odometry, results = anew
    first = next(result for result in results if result.piece)
    known = se3.inverse(office[1][0]) @ office[1][-1]
    assert 0.01 < problems.error(known, first.T_world_cam)[0] < 0.5
    assert odometry._upkeep.store.newest().piece == 1


@pytest.mark.parametrize("override", ["status.lost=wait", "keyframes.stored=0"])
def test_it_waits_where_it_is_told_to_or_could_not_find_back(office, elsewhere, override):
    _, results = lost_and_elsewhere(office, elsewhere, override)
    assert {result.status for result in results} == {Status.LOST}
    assert {result.piece for result in results} == {0}


def test_the_preset_of_the_paper_begins_no_piece(office, elsewhere):
    _, results = lost_and_elsewhere(office, elsewhere, preset="paper")
    assert {result.piece for result in results} == {0}
    assert ANEW not in {result.reason for result in results}


def test_images_that_do_not_fit_are_not_all_tried(office, elsewhere):
    odometry, _ = lost_and_elsewhere(office, (elsewhere[0][:1], None))
    tried, join = [], odometry._recovery._chain.join
    odometry._recovery._chain.join = lambda seen, this: tried.append(this) or join(seen, this)
    other, _ = rendered("cabinet", 1)
    t = odometry._course.last_time + 5.0
    for k in range(30):
        frame = (elsewhere[0][0], other[0])[(k // 2) % 2]
        odometry.track(later([frame], t + k * PERIOD)[0])
    assert 5 < len(tried) < 20


def test_images_that_do_not_fit_one_another_begin_nothing(office, elsewhere):
    """Those of two cameras in turn."""
    odometry, _ = lost_and_elsewhere(office, (elsewhere[0][:1], None))
    other, _ = rendered("cabinet", 1)
    t = odometry._course.last_time + 5.0
    states = set()
    for k in range(40):
        frame = (elsewhere[0][0], other[0])[k % 2]
        states.add(odometry.track(later([frame], t + k * PERIOD)[0]).status)
    assert states == {Status.LOST}


def test_a_piece_that_is_lost_is_no_hindrance_to_being_found(office, anew):
    odometry, results = deepcopy(anew)
    t = results[-1].timestamp + PERIOD
    back = [odometry.track(frame) for frame in later([office[0][10]] * 40, t)]
    found = next(k for k, result in enumerate(back) if not result.piece)
    assert found < 10
    known = se3.inverse(office[1][0]) @ office[1][10]
    for result in back[found:]:
        assert problems.error(known, result.T_world_cam)[0] < 0.01
        assert result.piece == 0
    assert {result.status for result in back[found : found + 28]} == {Status.DEGRADED}
    assert back[-1].status is Status.TRACKED


def test_a_piece_is_joined_when_it_sees_what_was_seen_before(monkeypatch):
    """Turned aside while it sees nothing, and back while it does."""
    frames, truth = rendered("office", 90, speed=1.0)
    odometry = Odometry(CAMERA)
    forgotten = problems.ways_forgotten(odometry, monkeypatch)
    for frame in later(frames[:SEEN], 0.0):
        odometry.track(frame)
    t = SEEN * PERIOD + LOST_S
    odometry.skip(t, "no depth")
    way = [*range(70, 90), *range(89, 0, -1), *range(45)]
    results = [odometry.track(frame) for frame in later([frames[k] for k in way], t + PERIOD)]
    off = [
        problems.error(se3.inverse(truth[0]) @ truth[k], result.T_world_cam)[0]
        for k, result in zip(way, results, strict=True)
    ]
    begun = next(k for k, result in enumerate(results) if result.piece)
    joined = next(k for k in range(begun, len(way)) if not results[k].piece)
    assert off[joined - 1] > 0.1  # by the guess that it began with
    assert {results[begun].index, results[joined].index} <= set(forgotten)
    assert results[joined].status is Status.DEGRADED
    assert Status.LOST not in {result.status for result in results[begun:]}
    assert np.median(off[joined:]) < 0.003
    assert max(off[joined:]) < 0.03  # where it turns back within a frame
    assert results[-1].status is Status.TRACKED
    # What it has seen in between is moved along.
    for key in odometry._upkeep.store.before(99)._keyframes:
        assert key.piece == 0


def test_a_wall_that_comes_into_view_of_a_lost_camera_is_followed(office):
    odometry = Odometry(CAMERA)
    for frame in later(office[0], 0.0):
        odometry.track(frame)
    t = SEEN * PERIOD + LOST_S
    odometry.skip(t, "no depth")
    rng = np.random.default_rng(1)
    results = []
    for k in range(1, 40):
        depth = 2.0 - 0.005 * k + rng.normal(0, 0.003, (CAMERA.height, CAMERA.width))
        grey = np.full(depth.shape, 90, np.uint8)
        results.append(odometry.track(Frame(t + k * PERIOD, grey, depth.astype(np.float32))))
    assert {result.status for result in results[:14]} == {Status.LOST}
    assert {result.status for result in results[17:]} == {Status.DEGRADED}
    assert {result.piece for result in results[17:]} == {1}
    assert len(results[-1].degenerate) == 3  # along the wall, and about its normal
    moved = se3.inverse(results[17].T_world_cam) @ results[-1].T_world_cam
    assert abs(moved[2, 3] - 0.005 * 21) < 0.005
    assert odometry._upkeep.store.newest().piece == 0  # nothing to be found again by
