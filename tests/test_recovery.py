"""Finding back to a place that was seen before."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import yaml

from edvo import se3
from edvo.delay import DepthDelay
from edvo.frame import Frame
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.odometry import Odometry, Status
from edvo.recovery import Recovery
from edvo.synthesis.clock import Clock
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

from . import problems

PERIOD = 1 / 30
SEEN, COVERED_S = 40, 2.0


@pytest.fixture(scope="module", params=["stairs", "office"])
def walk(request):
    """Frames of a walk: of stairs, whose steps are alike, or round a desk."""
    recipe = make_recipe(request.param, frames=SEEN, camera=problems.CAMERA, seed=3)
    source = SyntheticSource(recipe)
    frames = [source.read(i).frame for i in range(SEEN)]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def covered_and_back(walk, back, monkeypatch):
    """Track a walk, cover the lens, and go on from an earlier frame; the results after that.

    And of those the numbers of the frames by which the way there is forgotten.
    """
    camera, frames, truth = walk
    odometry = Odometry(camera)
    for frame in frames:
        odometry.track(frame)
    t = frames[-1].timestamp
    for _ in range(4):
        t += COVERED_S / 4
        dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
        assert odometry.track(dark).status is Status.LOST
    results, first = [], odometry._record.count
    forgotten = problems.ways_forgotten(odometry, monkeypatch)
    for k in range(12):
        t += PERIOD
        frame = frames[back + k]
        result = odometry.track(Frame(t, frame.grey, frame.depth))
        off = se3.inverse(truth[back + k]) @ result.T_world_cam
        results.append((result.status, float(np.linalg.norm(off[:3, 3]))))
    return results, [index - first for index in forgotten]


@pytest.mark.parametrize("back", [2, 12])
def test_found_again_after_two_seconds_in_the_dark(walk, back, monkeypatch):
    results, forgotten = covered_and_back(walk, back, monkeypatch)
    assert results[-1][0] is Status.TRACKED
    assert results[-1][1] < 0.02
    # never somewhere else, though steps are alike
    assert all(error < 0.03 for status, error in results if status is not Status.LOST)
    found = [status is not Status.LOST for status, _ in results].index(True)
    assert forgotten == [found]  # how it came there


@cache
def other_place(place, seed, camera):
    """Four frames, the same after each walk."""
    other = SyntheticSource(make_recipe(place, frames=4, seed=seed, camera=camera))
    return [other.read(k).frame for k in range(4)]


@pytest.mark.parametrize(
    ("place", "seed"), [("texture_near", 1), ("texture_near", 2), ("texture_far", 3)]
)
def test_a_place_never_seen_is_not_recognised(walk, place, seed):
    """Where edges are dense, most of them fit anywhere, but few are turned alike."""
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:10]:
        odometry.track(frame)
    t = frames[9].timestamp + COVERED_S
    dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
    odometry.track(dark)
    for k, frame in enumerate(other_place(place, seed, camera)):
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


@pytest.fixture(scope="module")
def out_of_step():
    """Frames of a camera that never rests, 16 ms from their depth, and stamped so."""
    camera, clock = problems.CAMERA.scaled(0.5), Clock(30.0, offset=-0.016)
    recipe = make_recipe(
        "texture_near", frames=56, camera=camera, speed=2.0, colour_clock=clock, seed=3
    )
    source = SyntheticSource(recipe)
    readings = (source.read(i) for i in range(len(source)))
    frames = [reading.frame for reading in readings if reading.frame is not None]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def found_after(out_of_step, *, looked_s=math.inf):
    """Lose twelve frames, without images, and say how many more pass till it is found, and where.

    It has last looked for a place so many seconds before the first of these.
    """
    camera, frames, truth = out_of_step
    odometry, back = Odometry(camera), 42
    for frame in frames[:30]:
        odometry.track(frame)
    for frame in frames[30:back]:
        odometry.skip(frame.timestamp, "no image")
    odometry._recovery._last_time = frames[back].timestamp - looked_s
    for k, frame in enumerate(frames[back:], back):
        result = odometry.track(frame)
        if result.status is not Status.LOST:
            off = se3.inverse(truth[k]) @ result.T_world_cam
            seconds = frame.timestamp - frames[k - 1].timestamp
            wanted = se3.log(se3.inverse(truth[k - 1]) @ truth[k]) / seconds
            return k - back, np.linalg.norm(off[:3, 3]), odometry._course.velocity - wanted
    return len(frames), np.inf, np.full(6, np.inf)


def test_a_camera_in_motion_is_found_though_depth_is_out_of_step(out_of_step, monkeypatch):
    """By its edges, which fit; that it moves is what depth is off by."""
    after, off, _ = found_after(out_of_step)
    assert after == 0
    assert off < 0.01
    monkeypatch.setattr(DepthDelay, "at_most", lambda *given: 0.0)
    assert found_after(out_of_step)[0] > 0


def test_how_fast_a_camera_is_found_to_go_is_told_by_the_frame_before(out_of_step, monkeypatch):
    after, off, velocity = found_after(out_of_step, looked_s=0.13)
    assert after == 1
    assert off < 0.01
    assert np.linalg.norm(velocity[:3]) < 0.2  # of 2 m/s
    assert np.linalg.norm(velocity[3:]) < 0.1
    monkeypatch.setattr(Recovery, "_just_before", lambda *given: None)
    velocity = found_after(out_of_step, looked_s=0.13)[2]
    assert np.linalg.norm(velocity[:3]) > 1.0


def test_only_a_frame_that_was_lost_just_before_tells_how_fast_it_goes(out_of_step):
    camera, frames, _ = out_of_step
    odometry = Odometry(camera)
    odometry.track(frames[0])
    recovery = odometry._recovery
    other = [replace(frame, grey=frame.grey[::-1, ::-1].copy()) for frame in frames[:6]]
    assert odometry.track(other[1]).status is Status.LOST
    seen = odometry._front_end.see(frames[2], 2)
    assert recovery._just_before(seen).frame.timestamp == other[1].timestamp
    assert recovery._just_before(replace(seen, is_stale=True)) is None
    late = replace(seen, frame=replace(seen.frame, timestamp=frames[1].timestamp + 0.25))
    assert recovery._just_before(late) is None
    in_step = replace(seen, frame=replace(seen.frame, depth_delay=0.0))
    assert recovery._just_before(in_step) is None
    odometry.skip(frames[2].timestamp, "no image")
    assert recovery._just_before(odometry._front_end.see(frames[3], 3)) is None
    odometry.track(other[4])
    again = replace(frames[0], timestamp=frames[0].timestamp + 2.0)
    assert odometry.track(again).status is not Status.LOST
    assert recovery._before is None


BEHIND_M = 0.02, 0.07  # the bars of two grids, a wall
BESIDE_M = 3.0


@pytest.fixture(scope="module")
def grids(tmp_path_factory):
    """Frames before two grids of bars that look alike, but for how far off the wall is."""
    rng = np.random.default_rng(4)
    shapes: list[dict[str, object]] = []
    for k in range(24):
        x, z, long = rng.uniform(-0.9, 0.8), rng.uniform(0.5, 1.9), rng.uniform(0.2, 0.6)
        size = [long, 0.01, 0.03] if k % 2 else [0.03, 0.01, long]
        shapes += [
            {"shape": "box", "material": "bar", "at": [x + aside, 0.005, z], "size": size}
            for aside in (0.0, BESIDE_M)
        ]
    for corner, wide, far in zip((-3.0, 1.5), (4.5, 6.5), BEHIND_M, strict=True):
        panel = {"corner": [corner, far, 0.0], "along": [wide, 0.0, 0.0], "up": [0.0, 0.0, 3.0]}
        shapes.append({"shape": "panel", "material": "wall", **panel})
    scene = {
        "about": "two grids",
        "background": [0.7, 0.7, 0.7],
        "materials": {"wall": {"albedo": [0.8] * 3}, "bar": {"albedo": [0.15] * 3}},
        "shapes": shapes,
        "lights": {"ambient": 0.9},
        "camera": {
            "points": [[-0.05, -1.3, 1.3], [0.05, -1.25, 1.3]],
            "targets": [[-0.05, 0.0, 1.3], [0.05, 0.0, 1.3]],
            "centre": [0.0, 0.0, 1.3],
            "radius": 1.3,
            "height": 1.3,
            "speed": 0.2,
        },
    }
    folder = tmp_path_factory.mktemp("grids")
    (folder / "grids.yaml").write_text(yaml.safe_dump(scene), encoding="utf-8")
    pose = np.array([[1.0, 0, 0, 0], [0, 0, 1, -1.3], [0, -1, 0, 1.3], [0, 0, 0, 1]])
    beside = pose.copy()
    beside[0, 3] += BESIDE_M
    times, path = PERIOD * np.arange(13), folder / "path.txt"
    Trajectory.from_poses(times, [pose] * 6 + [beside] * 7).write(path)
    recipe = make_recipe(folder / "grids.yaml", frames=12, camera=problems.CAMERA, trajectory=path)
    source = SyntheticSource(recipe)
    frames = [source.read(i).frame for i in range(12)]
    return frames[:6], frames[6:]


@pytest.mark.parametrize("delay", [0.0, -0.016])
@pytest.mark.parametrize("place", [0, 1], ids=["the-same", "the-other"])
def test_depth_tells_places_whose_edges_are_alike(grids, delay, place, monkeypatch):
    """By more than what a camera moves by from an image to its depth."""

    def status_there():
        odometry, t = Odometry(problems.CAMERA), 0.0
        for frame in grids[0]:
            odometry.track(replace(frame, timestamp=t, depth_delay=delay))
            t += PERIOD
        for _ in range(30):
            odometry.skip(t, "covered")
            t += PERIOD
        for frame in grids[place]:
            result = odometry.track(replace(frame, timestamp=t, depth_delay=delay))
            t += PERIOD
        return result.status

    assert status_there() is (Status.LOST if place else Status.TRACKED)
    if place and delay:
        monkeypatch.setattr(DepthDelay, "at_most", lambda *given: 1.0)
        assert status_there() is Status.DEGRADED  # but for depth it is all the same
