"""Finding back to a place that was seen before."""

from dataclasses import dataclass

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.frame import Frame
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

PERIOD = 1 / 30
SEEN, COVERED_S = 40, 2.0


@pytest.fixture(scope="module", params=["stairs", "office"])
def walk(request):
    """Frames of a walk: of stairs, whose steps are alike, or round a desk."""
    source = SyntheticSource(make_recipe(request.param, frames=SEEN, seed=3))
    frames = [source.read(i).frame for i in range(SEEN)]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def covered_and_back(walk, back, *overrides):
    """Track a walk, cover the lens, and go on from an earlier frame; the results after that."""
    camera, frames, truth = walk
    odometry = Odometry(camera, Config().with_overrides(overrides))
    for frame in frames:
        odometry.track(frame)
    t = frames[-1].timestamp
    for _ in range(4):
        t += COVERED_S / 4
        dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
        assert odometry.track(dark).status is Status.LOST
    results = []
    for k in range(12):
        t += PERIOD
        frame = frames[back + k]
        result = odometry.track(Frame(t, frame.grey, frame.depth))
        off = se3.inverse(truth[back + k]) @ result.T_world_cam
        results.append((result.status, float(np.linalg.norm(off[:3, 3]))))
    return results


@pytest.mark.parametrize("back", [2, 12])
def test_found_again_after_two_seconds_in_the_dark(walk, back):
    results = covered_and_back(walk, back)
    assert results[-1][0] is Status.TRACKED
    assert results[-1][1] < 0.02
    # never somewhere else, though steps are alike
    assert all(error < 0.03 for status, error in results if status is not Status.LOST)


@pytest.mark.parametrize(
    ("place", "seed"), [("texture_near", 1), ("texture_near", 2), ("texture_far", 3)]
)
def test_a_place_never_seen_is_not_recognised(walk, place, seed):
    """Where edges are dense, most of them fit anywhere, but few are turned alike."""
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:10]:
        odometry.track(frame)
    other = SyntheticSource(make_recipe(place, frames=4, seed=seed, camera=camera))
    t = frames[9].timestamp + COVERED_S
    dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
    odometry.track(dark)
    for k in range(4):
        frame = other.read(k).frame
        result = odometry.track(Frame(t + (k + 1) * PERIOD, frame.grey, frame.depth))
        assert result.status is Status.LOST


@dataclass(frozen=True)
class Alike:
    """Stands in for a look, and says how much it is like any other."""

    share: float = 1.0

    def likeness(self, other):
        return other.share


def keyframe(index, x, angle=0.0, share=1.0, piece=0):
    T = se3.exp(np.array([x, 0.0, 0.0, 0.0, angle, 0.0]))
    return Keyframe(index, T, None, None, None, None, None, Alike(share), None, 0.0, piece)


def stored(store):
    return sorted(k.index for k in store.likest(Alike(), 100))


def test_a_full_store_lets_go_of_the_older_of_the_nearest_two():
    store = KeyframeStore(3)
    for index, x in enumerate([0.0, 1.0, 1.1]):
        store.add(keyframe(index, x))
    assert stored(store) == [0, 1, 2]
    store.add(keyframe(3, 3.0))
    assert stored(store) == [0, 2, 3]
    store.add(keyframe(4, 3.0, angle=1.5))  # another view from the same place is another place
    assert stored(store) == [2, 3, 4]


def test_keyframes_of_different_pieces_are_not_near_each_other():
    """Where they are to each other is a guess."""
    store = KeyframeStore(3)
    for index, (x, piece) in enumerate([(0.0, 0), (2.0, 0), (2.1, 1)]):
        store.add(keyframe(index, x, piece=piece))
    store.add(keyframe(3, 2.9, piece=1))
    assert stored(store) == [0, 1, 3]
    assert [index for index, _ in store.places(1)] == [3]


def test_the_likest_come_first():
    store = KeyframeStore(5)
    for index, share in enumerate([0.2, 0.9, 0.5]):
        store.add(keyframe(index, index, share=share))
    assert [k.index for k in store.likest(Alike(), 2)] == [1, 2]


def test_a_clock_that_starts_over_counts_how_long_it_has_been_lost(walk):
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:3]:
        odometry.track(Frame(frame.timestamp + 100.0, frame.grey, frame.depth))
    for k in range(4):
        assert odometry.skip(0.09 * k, "broken").status is Status.LOST
        assert not odometry._recovery.is_long_lost(0.09 * k)
    assert odometry._recovery.is_long_lost(0.5)


@pytest.mark.parametrize("doubted", [False, True])
def test_what_has_led_it_away_in_doubt_does_not_hide_where_it_was(walk, monkeypatch, doubted):
    """A hand is followed, *degraded*: its keyframes look liker the frame than that of the place."""
    camera, frames, truth = walk
    odometry = Odometry(camera)
    for frame in frames[:30]:
        odometry.track(frame)
    hand = SyntheticSource(make_recipe("texture_near", frames=1, seed=1, camera=camera))
    seen = odometry._front_end.see(hand.read(0).frame, 30).kept()
    course = odometry._course
    course.T_world_last = course.T_world_last @ se3.exp(np.array([1.5, 0, 0, 0, 0, 0]))
    astray = odometry._upkeep.make(seen, 30, None)
    monkeypatch.setattr(odometry._upkeep.store, "likest", lambda look, count: [astray])
    odometry._doubt.is_sure = not doubted
    t = frames[29].timestamp
    for _ in range(4):
        t += 0.1
        odometry.skip(t, "the hand goes")
    results = []
    for k in range(24, 36):
        t += PERIOD
        results.append(odometry.track(Frame(t, frames[k].grey, frames[k].depth)))
    if not doubted:
        assert {result.status for result in results} == {Status.LOST}
        return
    assert Status.LOST not in {result.status for result in results[6:]}
    off = se3.inverse(truth[35]) @ results[-1].T_world_cam
    assert np.linalg.norm(off[:3, 3]) < 0.02


def test_a_pose_that_was_sure_long_ago_is_no_help(walk):
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:3]:
        odometry.track(frame)
    t = frames[2].timestamp
    assert odometry._doubt.before(t + 0.1) is None  # it is sure
    odometry._doubt.is_sure = False
    key, T_key_cur = odometry._doubt.before(t + 2.9)
    assert key is odometry._course.keyframe
    np.testing.assert_array_equal(T_key_cur, odometry._course.T_key_last)
    assert odometry._doubt.before(t + 3.1) is None
    odometry.skip(t - 50.0, "a clock that starts over")
    assert odometry._doubt.before(t - 49.9) is None
