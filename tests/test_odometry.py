import copy
import logging
import threading
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.clock import StageClock
from edvo.config import PRESETS, Config
from edvo.errors import CameraError, ConfigError, FrameError, TrajectoryError
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame

from . import problems

CAMERA = problems.CAMERA
PERIOD = 1 / 30


def make(*overrides, preset="default", **options):
    return Odometry(CAMERA, Config.preset(preset).with_overrides(overrides), **options)


def track(frames, *overrides, **options):
    odometry = make(*overrides, **options)
    return odometry, [odometry.track(frame) for frame in frames]


def poses_of(results):
    return np.array([result.T_world_cam for result in results])


def errors(results, truth):
    """Greatest distance (m) and angle (deg) from the truth."""
    pairs = zip(truth, results, strict=True)
    return np.max([problems.error(T, result.T_world_cam) for T, result in pairs], axis=0)


def at(frame, timestamp):
    return Frame(timestamp, frame.grey, frame.depth)


def noisy(frame, timestamp, seed=0):
    """Like that of a sensor: two images of one view are never the same."""
    noise = np.random.default_rng(seed).normal(0, 1, frame.grey.shape)
    grey = np.clip(frame.grey + noise, 0, 255).round().astype(np.uint8)
    return Frame(timestamp, grey, frame.depth)


def blank(frame, timestamp=None):
    grey = np.full_like(frame.grey, 90)
    return Frame(frame.timestamp if timestamp is None else timestamp, grey, frame.depth)


def without_depth_at_edges(frame):
    depth = np.zeros_like(frame.depth)
    depth[0, 0] = 1.0
    return Frame(frame.timestamp, frame.grey, depth)


def shuffled(frame, seed=0):
    """Tiles of image and depth in another order: edges, but of no place seen before."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(12 * 16)

    def shuffle(image):
        tiles = image.reshape(12, 20, 16, 20).swapaxes(1, 2).reshape(-1, 20, 20)[order]
        tiles = tiles.reshape(12, 16, 20, 20).swapaxes(1, 2)
        return np.ascontiguousarray(tiles.reshape(image.shape))

    return Frame(frame.timestamp, shuffle(frame.grey), shuffle(frame.depth))


@pytest.fixture(scope="module")
def room():
    """Thirty frames and their poses."""
    return problems.sequence(30)


def check_finite(results):
    for result in results:
        for T in (result.T_world_cam, result.T_key_cur):
            assert np.isfinite(T).all()
            assert np.linalg.norm(T[:3, 3]) < 3
            np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
            np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


# ------------------------------------------------------------------------------------- tracking


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("seed", range(3))
def test_a_known_path_is_followed(room, preset, seed):
    frames, truth = room
    _, results = track(frames, f"seed={seed}", preset=preset)
    assert {result.status for result in results} == {Status.TRACKED}
    distance, angle = errors(results, truth)
    assert distance < 0.02
    assert angle < 0.5
    check_finite(results)
    # a frame's own motion is far better than a guess of none
    steps = [
        problems.error(se3.inverse(a) @ b, se3.inverse(p.T_world_cam) @ q.T_world_cam)[0]
        for (a, b), (p, q) in zip(pairwise(truth), pairwise(results), strict=True)
    ]
    assert np.median(steps) < 0.004


def test_with_all_edges_it_is_better_still(room):
    frames, truth = room
    _, results = track(frames, "sampling.count=0")
    distance, angle = errors(results, truth)
    assert distance < 0.01
    assert angle < 0.25


@pytest.mark.parametrize("extractor", ["canny", "sobel", "dog"])
@pytest.mark.parametrize("criterion", ["robust-then-normal", "robust", "normal"])
def test_every_extractor_and_criterion_follows(room, extractor, criterion):
    frames, truth = room
    _, results = track(frames, f"edges.extractor={extractor}", f"matching.criterion={criterion}")
    assert {result.status for result in results} <= {Status.TRACKED, Status.DEGRADED}
    assert errors(results, truth)[0] < 0.05


def test_what_a_frame_brings_back(room):
    frames, _ = room
    odometry, results = track(frames[:5])
    first, second = results[:2]
    assert isinstance(first, TrackedFrame)
    assert first.is_keyframe
    assert first.keyframe == -1
    assert first.alignment is None
    np.testing.assert_array_equal(first.T_world_cam, np.eye(4))
    for k, (frame, result) in enumerate(zip(frames, results, strict=False)):
        assert result.index == k
        assert result.timestamp == frame.timestamp
        assert result.status is Status.TRACKED
        assert result.reason == ""
        assert result.edges > 500
        sampling = odometry.config.sampling
        assert 0 < result.samples <= sampling.count * sampling.max_growth
    assert second.keyframe == 0
    assert second.alignment.T_ref_cur.shape == (4, 4)
    np.testing.assert_array_equal(second.alignment.T_ref_cur, second.T_key_cur)
    assert len(second.alignment.matches) == second.samples


def test_poses_and_keyframes_belong_together(room):
    frames, _ = room
    _, results = track(frames, "keyframes.rule=gap", "keyframes.gap_frames=7")
    for result in results[1:]:
        key = results[result.keyframe]
        assert key.is_keyframe
        T = key.T_world_cam @ result.T_key_cur
        np.testing.assert_allclose(result.T_world_cam, T, atol=1e-12)


def test_the_trajectory_holds_the_poses(room):
    frames, _ = room
    odometry, results = track(frames)
    trajectory = odometry.trajectory
    assert len(trajectory) == len(frames)
    np.testing.assert_array_equal(trajectory.timestamps, [f.timestamp for f in frames])
    np.testing.assert_array_equal(trajectory.poses, poses_of(results))
    assert len(make().trajectory) == 0


def test_results_do_not_change_afterwards(room):
    frames, _ = room
    odometry = make("keyframes.rule=gap", "keyframes.gap_frames=3")
    results, copies = [], []
    for frame in frames[:12]:
        results.append(odometry.track(frame))
        copies.append((results[-1].T_world_cam.copy(), results[-1].T_key_cur.copy()))
    for result, (T_world, T_key) in zip(results, copies, strict=True):
        np.testing.assert_array_equal(result.T_world_cam, T_world)
        np.testing.assert_array_equal(result.T_key_cur, T_key)


@pytest.mark.parametrize("name", ["T_world_cam", "T_key_cur", "alignment"])
def test_poses_that_were_given_may_be_written_to(room, name):
    frames, _ = room
    rules = ("keyframes.rule=gap", "keyframes.gap_frames=3")
    wanted = poses_of(track(frames[:9], *rules)[1])
    odometry = make(*rules)
    for frame, T_world_cam in zip(frames, wanted, strict=False):
        result = odometry.track(frame)
        np.testing.assert_array_equal(result.T_world_cam, T_world_cam)
        if name != "alignment":
            getattr(result, name)[:3, 3] *= 1000  # somebody wants millimetres
        elif result.alignment is not None:
            result.alignment.T_ref_cur[:3, 3] *= 1000
    np.testing.assert_array_equal(odometry.trajectory.poses, wanted)


def test_frames_are_left_alone(room):
    frames, _ = room
    before = [(f.grey.tobytes(), f.depth.tobytes()) for f in frames[:4]]
    track(frames[:4])
    assert [(f.grey.tobytes(), f.depth.tobytes()) for f in frames[:4]] == before


def test_a_frame_may_be_written_over_once_it_is_tracked(room):
    frames, _ = room
    _, wanted = track(frames, "keyframes.gap_frames=3", "keyframes.rule=gap")
    odometry = make("keyframes.gap_frames=3", "keyframes.rule=gap")
    grey, depth = np.empty_like(frames[0].grey), np.empty_like(frames[0].depth)
    for frame, same in zip(frames, wanted, strict=True):
        grey[:], depth[:] = frame.grey, frame.depth
        result = odometry.track(Frame(frame.timestamp, grey, depth))
        np.testing.assert_array_equal(result.T_world_cam, same.T_world_cam)
        grey[:], depth[:] = 0, 9  # a keyframe is made of it when the next one is there
    assert sum(result.is_keyframe for result in wanted) > 2


@pytest.mark.parametrize("window", [1, 5])
def test_a_keyframe_takes_its_time_from_the_next_frame(room, window):
    frames, _ = room
    odometry = make("keyframes.gap_frames=3", "keyframes.rule=gap", f"keyframes.window={window}")
    for frame in frames[:6]:
        odometry.track(frame)
        assert odometry._course.keyframe.index == max((odometry._record.count - 2) // 3, 0) * 3
    assert odometry.track(frames[6]).is_keyframe
    assert odometry._course.keyframe.index == 3
    assert odometry.skip(frames[7].timestamp, "gone").keyframe == 6  # it need not be a good one


def gaps(*overrides):
    return make("keyframes.gap_frames=3", "keyframes.rule=gap", *overrides)


def test_a_reset_forgets_a_keyframe_that_is_due(room):
    frames, _ = room
    odometry = gaps()
    for frame in frames[:4]:
        last = odometry.track(frame)
    assert last.is_keyframe
    odometry.reset()
    fresh = gaps()
    for frame in frames[10:13]:
        again, wanted = odometry.track(frame), fresh.track(frame)
        np.testing.assert_array_equal(again.T_world_cam, wanted.T_world_cam)
        assert again.keyframe == wanted.keyframe


def test_a_keyframe_that_is_due_is_made_before_anything_else_is_seen(room, monkeypatch):
    """A stream that freezes is lost, and what a lost camera does next uses the same memory."""
    frames, _ = room
    monkeypatch.setattr("edvo.upkeep.is_apart", lambda *given: True)  # it keeps the last image
    made = []
    for frozen in (True, False):
        odometry = gaps()
        for frame in frames[:4]:
            last = odometry.track(frame)
        assert last.is_keyframe
        if frozen:
            for k in range(1, 15):
                odometry.track(at(frames[3], frames[3].timestamp + k * PERIOD))
        odometry.skip(frames[3].timestamp + 15 * PERIOD, "gone")
        made.append(odometry._course.keyframe)
    assert [key.index for key in made] == [3, 3]
    for a, b in zip(made[0].edges.grid, made[1].edges.grid, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_keyframe_is_made_for_the_velocity_it_was_taken_at(room, monkeypatch):
    frames, _ = room
    odometry, given = gaps(), []
    unrolled = odometry._instants.unrolled

    def noted(edges, seen, velocity):
        given.append(velocity)
        return unrolled(edges, seen, velocity)

    monkeypatch.setattr(odometry._instants, "unrolled", noted)
    for frame in frames[:4]:
        odometry.track(frame)
    velocity = odometry._course.velocity.copy()
    odometry.track(frames[4])
    assert given[0] is None
    np.testing.assert_array_equal(given[1], velocity)


def test_planes_of_a_keyframe_are_moved_by_the_velocity_measured(room, monkeypatch):
    frames, _ = room
    odometry, given = gaps(), []
    planes = odometry._fitter.planes

    def noted(depth, T_cam_depth=None, **options):
        given.append(T_cam_depth)
        return planes(depth, T_cam_depth, **options)

    monkeypatch.setattr(odometry._fitter, "planes", noted)
    for frame in frames[:4]:
        expected = odometry._course.velocity.copy()
        odometry.track(replace(frame, depth_delay=0.01))
    measured = odometry._course.velocity
    assert np.abs(measured - expected).max() > 1e-3
    assert given[0] is None  # of the first, which are found anew once it is known how it moved
    np.testing.assert_array_equal(given[-1], odometry._instants.depth.motion(measured, 0.01))


def test_a_keyframe_is_made_in_the_time_of_two_frames(room, monkeypatch):
    frames, _ = room
    odometry, done = gaps(), []

    def watch(part, name):
        make = getattr(part, name)

        def noted(*args, **options):
            done.append((name, len(results)))
            return make(*args, **options)

        monkeypatch.setattr(part, name, noted)

    watch(odometry._fitter, "planes")
    watch(odometry._registration, "indices")
    results = []
    for frame in frames[:5]:
        results.append(odometry.track(frame))
    assert done == [("planes", 0), ("indices", 0), ("planes", 3), ("indices", 4)]


def test_planes_wait_where_an_earlier_keyframe_was_asked(room, monkeypatch):
    frames, _ = room
    found = []
    for asked in (False, True):
        odometry, done, tracked = gaps(), [], []
        planes, place = odometry._fitter.planes, odometry._upkeep._window.place

        def noted(*given, planes=planes, done=done, tracked=tracked, **options):
            done.append(len(tracked))
            return planes(*given, **options)

        def placed(*given, place=place, asked=asked):
            return place(*given)[0], asked

        monkeypatch.setattr(odometry._fitter, "planes", noted)
        monkeypatch.setattr(odometry._upkeep._window, "place", placed)
        for frame in frames[:6]:
            tracked.append(odometry.track(frame))
        assert done == [0, 4 if asked else 3]
        found.append([result.T_world_cam for result in tracked])
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(("busy", "then"), [((), [2, 5, 8]), ((5,), [2, 8])])
def test_what_takes_long_goes_on_in_frames_that_have_time(room, monkeypatch, busy, then):
    """Those that make no keyframe, nor were to be parted."""
    frames, _ = room
    odometry, when = gaps(), []
    monkeypatch.setattr(odometry._instants, "go_on", lambda: when.append(len(results)))
    parting = SimpleNamespace(apart=lambda seen: None, is_trying=False)
    monkeypatch.setattr(odometry, "_parting", parting)
    results = []
    for frame in frames[:9]:
        parting.is_trying = len(results) in busy
        results.append(odometry.track(frame))
    assert [result.is_keyframe for result in results] == [
        True,
        *[False, False, True] * 2,
        *[False] * 2,
    ]
    assert when == then  # nor in that which finishes one


def test_a_camera_of_which_no_motion_is_known_starts_where_it_was(room):
    frames, _ = room
    odometry, starts = make(), []
    locator = odometry._locator
    for i, frame in enumerate(frames[:3]):
        seen = odometry._front_end.see(frame, i)
        if i:
            starts.append(locator.starts(seen))
        odometry.track(frame)
    still, moving = starts
    np.testing.assert_array_equal(still, np.eye(4)[None])
    assert len(moving) == 2
    assert not np.array_equal(*moving)


def test_what_is_held_of_the_first_keyframe_is_a_copy(room):
    frames, _ = room
    depth = frames[0].depth.copy()
    odometry = make()
    odometry.track(Frame(frames[0].timestamp, frames[0].grey, depth))
    depth[:] = 9
    np.testing.assert_array_equal(odometry._instants._held.depth, frames[0].depth)


def test_stages_are_timed(room):
    frames, _ = room
    clock = StageClock()
    odometry = make(clock=clock)
    odometry.track(frames[0])
    assert set(clock.take()) == {"edges", "sampling", "planes", "keyframe", "witness"}
    odometry.track(frames[1])
    assert {"edges", "sampling", "registration"} <= set(clock.take())


# ------------------------------------------------------------------------------------ keyframes


@pytest.mark.parametrize("gap", [1, 4, 10])
def test_keyframes_by_gap(room, gap):
    frames, truth = room
    rules = ("keyframes.rule=gap", f"keyframes.gap_frames={gap}")
    _, results = track(frames, *rules)
    taken = [result.index for result in results if result.is_keyframe]
    assert taken == list(range(0, len(frames), gap))
    for result in results[1:]:
        assert result.keyframe == (result.index - 1) // gap * gap
    assert errors(results, truth)[0] < 0.05


def test_keyframes_by_motion(room):
    frames, _ = room
    rules = ("keyframes.max_translation_m=0.05", "keyframes.min_overlap=0")
    _, results = track(frames, "keyframes.rule=motion", *rules)
    taken = [result.index for result in results if result.is_keyframe]
    assert len(taken) > 2
    for result in results[1:]:
        far = np.linalg.norm(result.T_key_cur[:3, 3]) > 0.05
        turned = se3.rotation_angle(result.T_key_cur) > np.radians(15)
        assert result.is_keyframe == (far or turned)


def test_a_still_camera_keeps_its_keyframe_and_its_place(room):
    frames, _ = room
    still = [noisy(frames[0], 10 + k * PERIOD, k) for k in range(10)]
    _, results = track(still)
    assert [result.is_keyframe for result in results] == [True] + [False] * 9
    distance, angle = errors(results, [np.eye(4)] * 10)
    assert distance < 1e-3
    assert angle < 0.02


# ---------------------------------------------------------------------------------- motion prior


@pytest.mark.parametrize("prior", ["constant-velocity", "still"])
def test_either_prior_follows(room, prior):
    frames, truth = room
    _, results = track(frames, f"motion.prior={prior}")
    assert errors(results, truth)[0] < 0.02


def test_constant_velocity_predicts_lost_frames(room):
    frames, truth = room
    for prior, ahead in (("constant-velocity", True), ("still", False)):
        rules = (f"motion.prior={prior}", "planes.alone_share=0")
        odometry, results = track(frames[:15], *rules)
        lost = odometry.track(blank(frames[15]))
        assert lost.status is Status.LOST
        stayed = problems.error(results[-1].T_world_cam, lost.T_world_cam)[0]
        off = problems.error(truth[15], lost.T_world_cam)[0]
        moved = problems.error(truth[14], truth[15])[0]
        if ahead:
            assert stayed == pytest.approx(moved, rel=0.8)
        assert off < 0.02


def test_a_prediction_does_not_run_away(room):
    frames, _ = room
    odometry, results = track(frames[:15])
    lost = odometry.skip(frames[14].timestamp + 1000.0, "gone")
    assert problems.error(results[-1].T_world_cam, lost.T_world_cam)[0] < 0.2


# ------------------------------------------------------------------------------------------ lost


@pytest.mark.parametrize("spoil", [blank, without_depth_at_edges, shuffled])
def test_lost_and_found_again(room, spoil, caplog, capsys):
    frames, truth = room
    odometry = make("planes.alone_share=0")
    results = []
    with caplog.at_level(logging.DEBUG, logger="edvo"):
        for k, frame in enumerate(frames):
            results.append(odometry.track(spoil(frame) if 10 <= k < 14 else frame))
    lost = [result.index for result in results if result.status is Status.LOST]
    assert lost == [10, 11, 12, 13]
    for k in lost:
        result = results[k]
        assert result.reason
        assert "\n" not in result.reason
        assert not result.is_keyframe
    check_finite(results)
    assert errors(results[14:], truth[14:])[0] < 0.02
    trajectory = odometry.trajectory
    assert len(trajectory) == len(frames) - 4
    kept = [f.timestamp for k, f in enumerate(frames) if k not in lost]
    np.testing.assert_array_equal(trajectory.timestamps, kept)
    # said once when it happens, and once when it is over
    warnings = [r for r in caplog.records if r.levelno == logging.WARNING]
    assert [r.getMessage() for r in warnings] == [f"frame 10 lost: {results[10].reason}"]
    found = [r.getMessage() for r in caplog.records if r.levelno == logging.INFO]
    assert found == ["frame 14: found again"]
    assert all(record.name == "edvo.odometry" for record in caplog.records)
    assert capsys.readouterr() == ("", "")


def test_why_it_is_lost(room):
    frames, _ = room
    odometry, _ = track(frames[:3], "planes.alone_share=0")
    assert odometry.track(blank(frames[3])).reason == "0 edges with depth; 30 needed"
    result = odometry.track(without_depth_at_edges(frames[4]))
    assert result.edges > 500
    assert result.samples < 30
    assert "edges with depth" in result.reason


def test_an_implausible_jump_is_not_believed(room):
    frames, _ = room
    limits = ("motion.max_speed_m_s=0.05", "motion.max_turn_deg_s=500")
    _, results = track([frames[0], at(frames[3], frames[1].timestamp)], *limits)
    assert results[1].status is Status.LOST
    assert results[1].reason.startswith("implausible jump: ")
    assert "m/s" in results[1].reason
    assert results[1].alignment is not None
    _, results = track([frames[0], at(frames[3], frames[0].timestamp + 10)], *limits)
    assert results[1].status is Status.TRACKED
    limits = ("motion.max_speed_m_s=50", "motion.max_turn_deg_s=1")
    _, results = track([frames[0], at(frames[3], frames[1].timestamp)], *limits)
    assert results[1].status is Status.LOST


def test_found_again_back_at_the_keyframe(room):
    """Matches must be near here: from where it was lost, registration would not find home."""
    frames, truth = room
    rules = ("matching.max_distance_px=3", "keyframes.rule=gap", "keyframes.gap_frames=1000")
    rules += ("motion.search_deg=0",)
    odometry, results = track(frames, *rules)
    assert {result.status for result in results} == {Status.TRACKED}
    assert odometry.track(at(frames[0], 20.0)).status is Status.LOST
    result = odometry.track(noisy(frames[0], 20.1))
    assert result.status is Status.TRACKED
    assert problems.error(truth[0], result.T_world_cam)[0] < 0.005


def test_lost_by_too_few_that_fit(room):
    frames, _ = room
    _, results = track([frames[0], shuffled(frames[1])])
    assert results[1].status is Status.LOST


def test_degraded_is_in_the_trajectory(room):
    frames, _ = room
    odometry, results = track(frames[:6], "status.doubt_inliers=1.0", "status.inlier_px=0.5")
    states = [result.status for result in results]
    assert states[0] is Status.TRACKED
    assert Status.DEGRADED in states
    reasons = {result.reason for result in results if result.status is Status.DEGRADED}
    assert all("of the samples fit" in reason for reason in reasons)
    assert len(odometry.trajectory) == sum(s is not Status.LOST for s in states)
    _, results = track(frames[:6], "registration.max_iterations=1", "registration.stop_px=1e-9")
    assert results[1].status is Status.DEGRADED
    assert results[1].reason == "iterations used up"


def test_lost_from_the_start(room):
    """The origin is where the first frame was that showed something."""
    frames, truth = room
    odometry = make()
    for k in range(3):
        result = odometry.track(blank(frames[0], 9 + k * PERIOD))
        assert result.status is Status.LOST
        assert result.keyframe == -1
        np.testing.assert_array_equal(result.T_world_cam, np.eye(4))
    results = [odometry.track(frame) for frame in frames]
    assert results[0].index == 3
    assert results[0].is_keyframe
    assert results[1].keyframe == 3
    assert errors(results, truth)[0] < 0.02


def test_nothing_explodes(room):
    """Good and bad frames in any order, at any time."""
    frames, _ = room
    rng = np.random.default_rng(0)
    for preset in PRESETS:
        odometry = make(preset=preset)
        results = []
        for k in range(60):
            frame = frames[rng.integers(len(frames))]
            spoil = (lambda f: f, blank, without_depth_at_edges, shuffled)[rng.integers(4)]
            frame = spoil(at(frame, float(rng.uniform(0, 100))))
            results.append(odometry.track(frame))
            if k % 7 == 0:
                results.append(odometry.skip(float(rng.uniform(0, 100)), "skipped"))
        check_finite(results)
        assert np.isfinite(odometry.trajectory.poses).all()


# --------------------------------------------------------------------------- skip, reset, stamps


def test_skip(room, caplog):
    frames, truth = room
    odometry, _ = track(frames[:10])
    with caplog.at_level(logging.WARNING):
        result = odometry.skip(frames[10].timestamp, "rgb/10.png is truncated")
    assert result.status is Status.LOST
    assert result.reason == "rgb/10.png is truncated"
    assert result.index == 10
    assert (result.edges, result.samples, result.alignment) == (0, 0, None)
    assert problems.error(truth[10], result.T_world_cam)[0] < 0.02
    assert caplog.messages == ["frame 10 lost: rgb/10.png is truncated"]
    results = [odometry.track(frame) for frame in frames[11:]]
    assert results[0].index == 11
    assert errors(results, truth[11:])[0] < 0.02
    assert len(odometry.trajectory) == len(frames) - 1


@pytest.mark.parametrize("stamp", [np.nan, np.inf, "12 o'clock", None])
def test_a_frame_that_could_not_be_had_has_a_time_all_the_same(room, stamp):
    frames, _ = room
    for count in (0, 3):
        odometry, _ = track(frames[:count])
        with pytest.raises(FrameError, match=r"timestamp is .*; give finite seconds"):
            odometry.skip(stamp, "unread")
        assert len(odometry.trajectory) == count
        assert odometry.track(frames[count]).index == count


@pytest.mark.parametrize("given", [None, np.zeros((240, 320), np.uint8), "frame"])
def test_what_is_no_frame_is_refused(room, given):
    odometry, _ = track(room[0][:2])
    with pytest.raises(FrameError, match=r"frame is \w+; give a Frame, as Frame.from"):
        odometry.track(given)
    assert odometry.track(room[0][2]).status is Status.TRACKED


@pytest.mark.parametrize("given", [None, {"width": 640}, Config(), "camera.yaml"])
def test_what_is_no_camera_is_refused(given):
    with pytest.raises(CameraError, match=r"^camera is .{4,40}; give a Camera, as Camera.from"):
        Odometry(given)


def test_what_is_no_configuration_is_refused():
    with pytest.raises(ConfigError, match=r"config is 'paper'; give a Config, as Config.preset"):
        Odometry(CAMERA, "paper")


def test_results_can_be_told_apart(room):
    """By which they are: their arrays have no truth value."""
    _, results = track(room[0][:2])
    assert results[0] == results[0]
    assert results[0] != copy.deepcopy(results[0])
    assert len(set(results)) == 2


def test_without_logging_set_up_nothing_is_printed(room, capfd, monkeypatch):
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    odometry, _ = track(room[0][:2])
    odometry.skip(room[0][2].timestamp, "unread")
    assert capfd.readouterr() == ("", "")


def test_reset(room):
    frames, _ = room
    odometry, before = track(frames)
    odometry.track(blank(frames[0]))
    odometry.reset()
    assert len(odometry.trajectory) == 0
    again = [odometry.track(frame) for frame in frames]
    assert poses_of(again).tobytes() == poses_of(before).tobytes()


def test_reset_to_a_pose(room):
    frames, truth = room
    start = problems.motion(np.random.default_rng(0), 2.0, 100.0)
    given = start.copy()
    odometry = make()
    odometry.reset(given)
    given[:] = 0  # what is done with the array afterwards is no matter
    results = [odometry.track(frame) for frame in frames[:10]]
    np.testing.assert_allclose(results[0].T_world_cam, start, atol=1e-12)
    _, plain = track(frames[:10])
    np.testing.assert_allclose(poses_of(results), start @ poses_of(plain), atol=1e-9)
    assert errors(results, start @ truth[:10])[0] < 0.02


@pytest.mark.parametrize(
    "stamps",
    [
        [5.0] * 12,
        np.arange(12, 0, -1.0).tolist(),
        [k // 2 * 2 * PERIOD for k in range(12)],
        [0, 1, 0, 2, 1, 3, 2, 4, 3, 5, 4, 6],
        [k * 1000.0 for k in range(12)],
    ],
    ids=["equal", "backwards", "twice", "to and fro", "rare"],
)
def test_stamps_that_make_no_sense(room, stamps):
    frames, truth = room
    odometry, results = track([at(f, t) for f, t in zip(frames, stamps, strict=False)])
    assert {result.status for result in results} == {Status.TRACKED}
    assert odometry.trajectory.timestamps.tolist() == sorted(set(stamps))
    assert errors(results, truth[:12])[0] < 0.02
    assert [result.timestamp for result in results] == stamps


@pytest.mark.parametrize("shape", [(240, 319), (480, 640), (320, 240)])
def test_a_frame_of_another_size(room, shape):
    frames, truth = room
    odometry, _ = track(frames[:3])
    wrong = Frame(0.0, np.zeros(shape, np.uint8), np.ones(shape, np.float32))
    with pytest.raises(FrameError) as caught:
        odometry.track(wrong)
    message = str(caught.value)
    assert f"{shape[1]} x {shape[0]}" in message
    assert "320 x 240" in message
    assert "\n" not in message
    # it is as if nothing had happened
    result = odometry.track(frames[3])
    assert result.index == 3
    assert problems.error(truth[3], result.T_world_cam)[0] < 0.02


# ---------------------------------------------------------------------------------- determinism


@pytest.mark.parametrize("preset", PRESETS)
def test_same_bits_whatever_the_threads_of_opencv(room, preset):
    frames, _ = room
    before = cv2.getNumThreads()
    try:
        runs = []
        for threads in (1, 2, 0):
            cv2.setNumThreads(threads)
            _, results = track(frames, preset=preset)
            runs.append((poses_of(results).tobytes(), [r.samples for r in results]))
    finally:
        cv2.setNumThreads(before)
    assert runs[0] == runs[1] == runs[2]


def test_seeds(room):
    frames, _ = room
    a, b, c = (poses_of(track(frames[:8], f"seed={seed}", preset="paper")[1]) for seed in (1, 1, 2))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()


def test_instances_in_threads_do_not_meet(room):
    frames, _ = room
    orders = [frames, frames[::-1], frames[5:] + frames[:5]]
    alone = [poses_of(track(order)[1]).tobytes() for order in orders]
    together = [b""] * len(orders)

    def run(i):
        together[i] = poses_of(track(orders[i])[1]).tobytes()

    threads = [threading.Thread(target=run, args=(i,)) for i in range(len(orders))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


def test_instances_in_turn_do_not_meet(room):
    frames, _ = room
    _, alone = track(frames[:8])
    one, other = make(), make("seed=5")
    taken = []
    for k in range(8):
        taken.append(one.track(frames[k]))
        other.track(frames[-1 - k])
    assert poses_of(taken).tobytes() == poses_of(alone).tobytes()


def test_a_lens_is_allowed_for(room):
    """Frames as a lens bends them, tracked with the distorted camera."""
    frames, truth = room
    lens = replace(CAMERA, distortion=(0.15, -0.2, 0.002, -0.001, 0.0))
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    ideal = lens.undistort(np.column_stack((u.ravel(), v.ravel())))
    maps = ideal.astype(np.float32).reshape(*u.shape, 2)

    def bend(frame):
        grey = cv2.remap(frame.grey, maps, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        depth = cv2.remap(frame.depth, maps, None, cv2.INTER_NEAREST)
        return Frame(frame.timestamp, grey, depth)

    bent = [bend(frame) for frame in frames[::3]]
    right, wrong = Odometry(lens), Odometry(CAMERA)
    right = errors([right.track(frame) for frame in bent], truth[::3])
    wrong = errors([wrong.track(frame) for frame in bent], truth[::3])
    assert right[0] < 0.02
    assert right[0] < wrong[0]


@pytest.mark.parametrize(
    "pose",
    [
        np.zeros((4, 4)),
        np.full((4, 4), np.nan),
        np.eye(3),
        2 * np.eye(4),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.ones((4, 4)),
    ],
)
def test_a_reset_to_what_is_no_rigid_motion_is_refused(pose):
    odometry = Odometry(problems.VGA)
    with pytest.raises(TrajectoryError, match="no rigid motion"):
        odometry.reset(pose)
