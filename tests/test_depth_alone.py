"""Frames without edges: what depth says of them, and what it does not."""

from itertools import pairwise

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.frame import Frame
from edvo.odometry import SAME_DEPTH, Odometry, Status
from edvo.sensor import DEPTH_NOISE

from . import problems

CAMERA = problems.CAMERA
PERIOD = 1 / 30
WALL_M = 2.0
IN_PLANE = ("translation along x", "translation along y", "rotation about z")


@pytest.fixture(scope="module")
def poster():
    """What is on the wall, larger than the view of it."""
    return problems.drawn_image(np.random.default_rng(1), (480, 640), 40)


def wall(T_world_cam, timestamp, picture=None, seed=0):
    """A wall at z = 2 as a Kinect sees it; with a picture on it only from straight ahead."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    ray = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], 2)
    z = (WALL_M - T_world_cam[2, 3]) / (ray @ T_world_cam[2, :3])
    rng = np.random.default_rng(seed)
    depth = z + rng.normal(0, 1, z.shape) * DEPTH_NOISE["kinect_v1"].sigma_z(z)
    grey = np.full(u.shape, 90, np.uint8)
    if picture is not None:
        middle = np.array([160, 120])
        col, row = middle + np.rint(T_world_cam[:2, 3] * CAMERA.fx / WALL_M).astype(int)
        noisy = picture[row : row + CAMERA.height, col : col + CAMERA.width]
        grey = np.clip(noisy + rng.normal(0, 1, u.shape), 0, 255).astype(np.uint8)
    return Frame(timestamp, grey, depth.astype(np.float32))


def aside(pixels):
    """A pose that shifts the picture by so much to the left."""
    return se3.exp(np.array([pixels * WALL_M / CAMERA.fx, 0, 0, 0, 0, 0]))


def dark(frame, timestamp=None):
    grey = np.full_like(frame.grey, 5)
    return Frame(frame.timestamp if timestamp is None else timestamp, grey, frame.depth)


def from_wall(poster, *overrides, preset="default", first=0):
    odometry = Odometry(CAMERA, Config.preset(preset).with_overrides(overrides))
    for k in range(first, 3):
        at = wall(np.eye(4), k * PERIOD, poster, k - first)
        assert odometry.track(at).status is Status.TRACKED
    return odometry


def test_of_a_wall_distance_and_tilt_are_known_and_the_rest_is_said_not_to_be(poster):
    odometry = from_wall(poster)
    off = []
    for k in range(3, 30):
        way = (k - 2) / 27
        T = se3.exp(way * np.array([0.05, -0.03, 0.12, 0.06, -0.08, 0.05]))
        result = odometry.track(wall(T, k * PERIOD, seed=k))
        assert result.status is Status.DEGRADED
        assert result.reason.startswith("depth alone: 0 edges with depth; 30 needed; not constr")
        assert result.degenerate == IN_PLANE
        assert not result.is_keyframe
        # the wall's normal as either camera has it, and how far either is from the wall
        tilt = np.arccos(min(1.0, result.T_world_cam[2, :3] @ T[2, :3]))
        distance = result.T_world_cam[2, 3] - T[2, 3]
        deviation = np.sqrt(np.diag(result.covariance))  # in the keyframe's camera, the world's
        assert (deviation[[0, 1, 5]] > 0.1).all()
        assert deviation[2] < 0.005
        assert (deviation[3:5] < np.radians(1.0)).all()
        off.append((distance, tilt))
    distance, tilt = np.abs(off).max(axis=0)
    assert distance < 0.002
    assert np.degrees(tilt) < 0.1


def test_a_far_and_narrow_patch_of_depth_says_nothing(poster, monkeypatch):
    monkeypatch.setitem(globals(), "WALL_M", 14.0)
    odometry = from_wall(poster, "planes.min_points=6")
    frame = wall(np.eye(4), 3 * PERIOD, seed=3)
    depth = np.zeros_like(frame.depth)
    depth[80:160, 120:200] = frame.depth[80:160, 120:200]
    result = odometry.track(Frame(frame.timestamp, frame.grey, depth))
    assert result.status is Status.LOST
    assert result.reason == "0 edges with depth; 30 needed; depth constrains nothing"


def test_found_again_after_a_drift_its_velocity_is_not_known(poster, monkeypatch):
    odometry, told = from_wall(poster), []
    attend = odometry._upkeep.attend

    def noting(seen, index, share, covariance, period, velocity, **rest):
        told.append(velocity)
        return attend(seen, index, share, covariance, period, velocity, **rest)

    monkeypatch.setattr(odometry._upkeep, "attend", noting)
    for k in range(3, 18):
        assert odometry.track(wall(aside(k - 2), k * PERIOD, seed=k)).degenerate == IN_PLANE
    for k in range(18, 20):
        assert odometry.track(wall(aside(16), k * PERIOD, poster, k)).status is Status.DEGRADED
    assert told[0] is None
    assert np.abs(told[1]).max() > 0


@pytest.mark.parametrize("seed", range(2))
def test_the_corner_of_a_room_says_all_in_darkness(seed):
    frames, truth = problems.sequence(30)
    odometry = Odometry(CAMERA, Config().with_overrides([f"seed={seed}"]))
    results = [
        odometry.track(dark(frame) if 10 <= k < 24 else frame) for k, frame in enumerate(frames)
    ]
    for result, T in zip(results, truth, strict=True):
        distance, angle = problems.error(T, result.T_world_cam)
        assert distance < 0.01
        assert angle < 0.3
    for result in results[10:24]:
        assert result.status is Status.DEGRADED
        assert result.reason == "depth alone: 0 edges with depth; 30 needed"
        assert result.degenerate == ()
        assert not result.is_keyframe
        assert result.alignment.plane_points > 100
        assert (result.alignment.match_count, result.alignment.inliers) == (0, 0)
        assert len(result.alignment.matches) == result.samples
    assert all(result.status is Status.TRACKED for result in results[24:])
    assert len(odometry.trajectory) == len(frames)


@pytest.mark.parametrize(
    ("preset", "override"),
    [("paper", "seed=0"), ("default", "planes.alone_share=0"), ("default", "planes.weight=0")],
)
def test_it_can_be_left_out(preset, override):
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA, Config.preset(preset).with_overrides([override]))
    for frame in frames[:3]:
        odometry.track(frame)
    result = odometry.track(dark(frames[3]))
    assert result.status is Status.LOST
    assert result.reason == "0 edges with depth; 30 needed"
    assert result.alignment is None


def test_depth_that_does_not_fit_is_no_pose(poster):
    odometry = from_wall(poster)
    seen = wall(np.eye(4), 3 * PERIOD)
    depth = seen.depth.copy()
    depth[:, 100:] *= 0.8  # something else stands before the most of it
    result = odometry.track(Frame(3 * PERIOD, seen.grey, depth))
    assert result.status is Status.LOST
    assert result.reason.startswith("0 edges with depth; 30 needed; ")
    rough = depth * np.random.default_rng(0).uniform(0.8, 1.2, depth.shape).astype(np.float32)
    result = odometry.track(Frame(4 * PERIOD, seen.grey, rough))
    assert result.status is Status.LOST
    assert "hardly a plane" in result.reason


def test_depth_that_repeats_is_no_witness():
    """No sensor measures the same twice: it is frozen, and the camera may move on.

    But once it may, where depth images come a little less often than those in colour.
    """
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA)
    for frame in frames[:5]:
        odometry.track(frame)
    results = [odometry.track(dark(frames[5], 10 + k * PERIOD)) for k in range(5, 9)]
    assert [result.status for result in results] == [Status.DEGRADED] * 2 + [Status.LOST] * 2
    assert results[1].reason == SAME_DEPTH
    np.testing.assert_array_equal(results[1].T_world_cam, results[0].T_world_cam)
    result = odometry.track(dark(frames[9], 10 + 9 * PERIOD))
    assert result.status is Status.DEGRADED


def test_nothing_is_said_from_nothing():
    """Not of the first frame; nor after a gap, in which the camera may have gone anywhere."""
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA)
    assert odometry.track(dark(frames[0])).status is Status.LOST
    for frame in frames[1:4]:
        odometry.track(frame)
    assert odometry.track(dark(frames[4], 10.6)).status is Status.LOST


def test_where_nothing_is_constrained_a_motion_fades(poster):
    odometry = Odometry(CAMERA)
    speed = 2 * WALL_M / CAMERA.fx / PERIOD  # of two pixels a frame, m/s
    for k in range(20):
        odometry.track(wall(aside(2 * k), k * PERIOD, poster, k))
    results = [odometry.track(wall(aside(2 * k), k * PERIOD, seed=k)) for k in range(20, 50)]
    x = [result.T_world_cam[0, 3] - aside(38)[0, 3] for result in results]
    assert 0.2 * speed * PERIOD < x[0] < speed * PERIOD
    assert 0.1 * speed < x[-1] < 0.6 * speed  # after a second of it
    steps = [b - a for a, b in pairwise(x)]
    assert abs(steps[-1]) < 0.4 * abs(steps[0])


def test_edges_that_come_back_tell_where_it_has_drifted_to(poster):
    odometry = from_wall(poster)
    for k in range(3, 20):
        lost_way = odometry.track(wall(aside(k), k * PERIOD, seed=k))
    assert problems.error(aside(19), lost_way.T_world_cam)[0] > 0.1
    back = [odometry.track(wall(aside(19), k * PERIOD, poster, k)) for k in range(20, 54)]
    for result in back:
        assert problems.error(aside(19), result.T_world_cam)[0] < 0.01
    # The path has a jump, so it is not to be trusted until that is a second ago.
    assert {result.status for result in back[:28]} == {Status.DEGRADED}
    assert back[0].reason == "found again, lost from a doubtful pose"
    assert back[-1].status is Status.TRACKED


@pytest.mark.parametrize("first", [0, -25])  # by then a frame is looked at closely
def test_edges_that_repeat_do_not_tell_where_it_has_drifted_to(first):
    """On a wallpaper one place looks like the next."""
    repeat = 64  # px, 0.3 m
    tile = problems.drawn_image(np.random.default_rng(1), (480, repeat), 12)
    paper = np.ascontiguousarray(np.tile(tile, (1, 12)))
    for moved in (0, repeat):
        odometry = from_wall(paper, first=first)
        for k in range(3, 33):
            odometry.track(wall(aside(moved * (k - 2) / 30), k * PERIOD, seed=k))
        back = [odometry.track(wall(aside(moved), k * PERIOD, paper, k)) for k in range(33, 68)]
        assert {result.status for result in back if not result.piece} == {Status.LOST}
        assert {result.status for result in back if result.piece} == {Status.DEGRADED}


@pytest.mark.parametrize("covariance", ["cells", "none"])
def test_edges_along_the_drift_do_not_end_it(covariance):
    """Level stripes say nothing of how far it went along them."""
    rng = np.random.default_rng(3)
    rows = np.repeat(rng.integers(20, 230, 40), 12).astype(np.uint8)
    stripes = np.ascontiguousarray(np.tile(rows[:, None], (1, 640)))
    odometry = Odometry(CAMERA, Config().with_overrides([f"status.covariance={covariance}"]))
    for k in range(3):
        odometry.track(wall(np.eye(4), k * PERIOD, stripes, k))
    for k in range(3, 18):
        odometry.track(wall(aside(4 * (k - 2)), k * PERIOD, seed=k))
    back = [odometry.track(wall(aside(60), k * PERIOD, stripes, k)) for k in range(18, 60)]
    assert Status.TRACKED not in {result.status for result in back}


def test_a_frame_that_could_not_be_read_does_not_end_it(poster):
    """Not where there are a few edges, either, too few to be found by."""
    few = np.full_like(poster, 90)
    few[200:230, 300:330] = poster[200:230, 300:330]
    odometry = from_wall(poster)
    results = [odometry.track(wall(np.eye(4), k * PERIOD, few, k)) for k in range(3, 20)]
    assert 30 <= results[-1].samples < 150
    assert results[-1].status is Status.DEGRADED
    assert odometry.skip(20 * PERIOD, "broken").status is Status.LOST
    results = [odometry.track(wall(np.eye(4), k * PERIOD, few, k)) for k in range(21, 30)]
    assert {result.status for result in results} == {Status.DEGRADED}


def test_edges_that_come_back_must_be_sure(poster):
    """What is believed without a blind stretch before it is not believed after one."""
    other = problems.drawn_image(np.random.default_rng(7), poster.shape, 40)
    half = poster.copy()
    half[:, 360:] = other[:, 360:]
    doubtful = Config().with_overrides(["status.doubt_inliers=0.9", "status.doubt_agreeing=0.9"])
    for blind, status in ((0, Status.DEGRADED), (15, Status.LOST)):
        odometry = Odometry(CAMERA, doubtful)
        for k in range(3):
            odometry.track(wall(np.eye(4), k * PERIOD, poster, k))
        for k in range(3, 3 + blind):
            assert odometry.track(wall(np.eye(4), k * PERIOD, seed=k)).status is Status.DEGRADED
        result = odometry.track(wall(np.eye(4), (3 + blind) * PERIOD, half, 99))
        assert result.status is status
    assert result.reason == "after a stretch without edges they fit no place for sure"
    # and the place itself is found again
    for k in range(19, 55):
        result = odometry.track(wall(np.eye(4), k * PERIOD, poster, k))
    assert result.status is Status.TRACKED
    assert problems.error(np.eye(4), result.T_world_cam)[0] < 0.005
