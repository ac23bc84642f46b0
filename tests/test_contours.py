"""Contours of depth: where a surface ends before another, that says where a camera is."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import blind, se3
from edvo.blind import HELD
from edvo.config import Config
from edvo.contours import FEWEST, Contours
from edvo.doubt import STRAY_M
from edvo.frame import Frame
from edvo.leading import LEADS
from edvo.odometry import Odometry, Status
from edvo.sensor import DEPTH_NOISE
from edvo.uncertainty import DEGENERATE_M

from . import problems

CAMERA = problems.CAMERA
PERIOD = 1 / 30
WALL_M, PLATE_M = 2.0, 1.4
PLATE = 0.25, 0.2  # half of its width and height, m
FAR_UP = 0.25, 9.0  # a column: its sides run upright through the view
OFF = "planes.contours=none"
IN_PLANE = ("translation along x", "translation along y", "rotation about z")


def plate(T_world_cam, timestamp, half=PLATE, picture=None, seed=0):
    """A plate before a wall, both square to z, as a Kinect sees them; all white, or as painted."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    ray = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], 2)
    ray = ray @ T_world_cam[:3, :3].T
    far, near = ((z - T_world_cam[2, 3]) / ray[..., 2] for z in (WALL_M, PLATE_M))
    x, y = (T_world_cam[i, 3] + near * ray[..., i] for i in (0, 1))
    z = np.where((np.abs(x) < half[0]) & (np.abs(y) < half[1]), near, far)
    rng = np.random.default_rng(seed)
    depth = z + rng.normal(0, 1, z.shape) * DEPTH_NOISE["kinect_v1"].sigma_z(z)
    grey = np.full(u.shape, 200, np.uint8) if picture is None else picture
    grey = np.clip(grey + rng.normal(0, 1, z.shape), 0, 255).astype(np.uint8)
    return Frame(timestamp, grey, depth.astype(np.float32))


@pytest.fixture(scope="module")
def painted():
    return problems.drawn_image(np.random.default_rng(1), (CAMERA.height, CAMERA.width), 40)


def stripes():
    """Level ones: they say nothing of how far to the side the camera is."""
    level = np.repeat(np.random.default_rng(3).integers(20, 230, 40), 6).astype(np.uint8)
    return np.ascontiguousarray(np.tile(level[: CAMERA.height, None], (1, CAMERA.width)))


def going(way, count=20):
    """Where a camera is that goes there, frame by frame."""
    return [se3.exp(k / count * np.array(way)) for k in range(1, count + 1)]


def in_white(painted, poses, *overrides, half=PLATE):
    """Two painted frames, and then all is white."""
    odometry = Odometry(CAMERA, Config().with_overrides(overrides))
    for k in range(2):
        odometry.track(plate(np.eye(4), k * PERIOD, half, painted, k))
    return odometry, [
        odometry.track(plate(T, (k + 2) * PERIOD, half, seed=k + 2)) for k, T in enumerate(poses)
    ]


def contours(*overrides):
    odometry = Odometry(CAMERA, Config().with_overrides(overrides))
    return Contours(
        CAMERA,
        odometry.config,
        odometry._registration,
        odometry._fitter,
        odometry._uncertainty,
    )


def test_they_lie_where_a_surface_ends():
    depth = plate(np.eye(4), 0.0).depth
    found = contours().find(depth)
    x, y = ((found.pixels - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx * PLATE_M).T
    off = np.abs(np.maximum(np.abs(x) / PLATE[0], np.abs(y) / PLATE[1]) - 1) * PLATE[1]
    pixel = PLATE_M / CAMERA.fx
    assert off.max() < 2 * pixel
    assert off.mean() < 0.7 * pixel
    round_it = 4 * sum(PLATE) / pixel
    assert 0.9 * round_it < len(found) < 1.2 * round_it
    np.testing.assert_allclose(found.depths, PLATE_M, atol=0.03)
    inwards = -np.column_stack((x / PLATE[0], y / PLATE[1])) / np.hypot(x / 1, y / 1)[:, None]
    assert (np.einsum("ij,ij->i", found.gradients, inwards) > 0).all()


def test_what_a_near_thing_hides_from_the_sensor_is_behind_it():
    depth = plate(np.eye(4), 0.0).depth
    width = round(PLATE[0] / PLATE_M * CAMERA.fx)
    left = round(CAMERA.cx) - width
    shadow = depth.copy()
    shadow[60:180, left - 8 : left] = 0
    found, with_shadow = contours().find(depth), contours().find(shadow)
    assert abs(len(found) - len(with_shadow)) < 0.1 * len(found)
    aside = with_shadow.pixels[np.abs(with_shadow.pixels[:, 1] - CAMERA.cy) < 25]
    assert np.abs(np.abs(aside[:, 0] - CAMERA.cx) - width).max() < 2.5


def test_a_tenth_is_a_step_but_a_slope_is_none():
    wall = plate(np.eye(4), 0.0, half=(0, 0)).depth
    assert not len(contours().find(wall))
    for times, any_found in ((1.04, False), (1.15, True)):
        stepped = wall.copy()
        stepped[:, 160:] *= times
        assert bool(len(contours().find(stepped))) is any_found
    slope = wall.copy()  # half as far again, over so many pixels that it is no step
    slope[:, 140:180] *= np.geomspace(1.0, 1.5, 40, dtype=np.float32)
    slope[:, 180:] *= 1.5
    assert not len(contours().find(slope))


def test_what_is_set_for_edges_of_images_is_not_for_these():
    depth = plate(np.eye(4), 0.0).depth
    usual = contours().find(depth)
    other = contours("edges.low=100", "edges.high=200", "edges.blur_px=0").find(depth)
    np.testing.assert_array_equal(other.pixels, usual.pixels)


def test_depth_of_another_instant_is_moved():
    depth, T = plate(np.eye(4), 0.0).depth, se3.exp(np.array([0.02, -0.01, -0.1, 0, 0, 0]))
    here, there = contours().find(depth), contours().find(depth, T)
    X = here.points(CAMERA) + T[:3, 3]
    expected = X[:, :2] / X[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
    np.testing.assert_allclose(there.pixels, expected, atol=1e-3)
    np.testing.assert_allclose(there.depths, X[:, 2], rtol=1e-6)
    np.testing.assert_allclose(there.gradients, here.gradients, atol=0.05)
    far_ahead = se3.exp(np.array([0, 0, -PLATE_M, 0, 0, 0]))  # they would lie in the lens
    assert not len(contours().find(depth, far_ahead))


def test_in_white_they_hold_what_planes_leave_open(painted):
    poses = going([0.12, -0.06, 0.05, 0.02, 0.03, 0.1])
    _, results = in_white(painted, poses)
    _, without = in_white(painted, poses, OFF)
    for result, T in zip(results, poses, strict=True):
        distance, angle = problems.error(T, result.T_world_cam)
        assert distance < 0.012
        assert angle < 0.8
        assert result.status is Status.DEGRADED
        assert result.degenerate == IN_PLANE
        assert result.reason.endswith(f"not constrained but by contours: {', '.join(IN_PLANE)}")
    assert problems.error(poses[-1], without[-1].T_world_cam)[0] > 0.1


def test_what_they_held_is_in_doubt_for_a_second(painted):
    odometry, results = in_white(painted, going([0.0] * 6))
    after = []
    for k in range(len(results) + 2, len(results) + 40):
        after.append(odometry.track(plate(np.eye(4), k * PERIOD, picture=painted, seed=k)))
    assert {(r.status, r.reason) for r in after[:29]} == {(Status.DEGRADED, HELD)}
    assert after[-1].status is Status.TRACKED


def test_what_they_run_along_stays_open(painted):
    """The sides of a column say how far to the side the camera is, but not how far up."""
    poses = going([0.1, -0.1, 0, 0, 0, 0])
    _, results = in_white(painted, poses, half=FAR_UP)
    off = results[-1].T_world_cam[:3, 3] - poses[-1][:3, 3]
    assert abs(off[0]) < 0.012
    assert off[1] > 0.08


@pytest.mark.parametrize(("half", "fits"), [(PLATE, True), ((0.12, 0.32), False)])
def test_they_do_not_fit_a_plate_that_is_another(painted, half, fits):
    """Of another shape, it is not the one the keyframe shows, and where it is says nothing."""
    odometry, _ = in_white(painted, [])
    seen = odometry._front_end.see(plate(np.eye(4), 1.0, half, seed=9), 9)
    key, given, here = odometry._course.key, odometry._contours, np.eye(4)
    assert len(given.find(seen.frame.depth)) > FEWEST
    loose = 1e-6 * np.eye(6)
    loose[0, 0] = 1.0
    assert (given.along(key, seen, here, loose, here, STRAY_M) is not None) == fits


def test_what_is_constrained_is_left_as_it_is(painted):
    odometry, _ = in_white(painted, [])
    seen = odometry._front_end.see(plate(going([0.02, 0, 0, 0, 0, 0])[-1], 1.0, seed=9), 9)
    key, given = odometry._course.key, odometry._blind._contours
    here, there = np.eye(4), se3.exp(np.array([0.02, 0, 0, 0, 0, 0]))
    assert given.along(key, seen, here, 1e-6 * np.eye(6), there, STRAY_M) is None
    loose = 1e-6 * np.eye(6)
    loose[0, 0] = 1.0
    along = given.along(key, seen, here, loose, there, STRAY_M)
    assert along is not None
    assert not along.leaves_open
    np.testing.assert_allclose(along.T_key_cur[:3, 3], (0.02, 0, 0), atol=0.006)
    np.testing.assert_allclose(along.T_key_cur[:3, :3], np.eye(3), atol=1e-3)
    assert along.covariance[0, 0] < DEGENERATE_M**2
    np.testing.assert_allclose(np.diag(along.covariance)[1:], 1e-6, rtol=0.2)
    assert given.along(replace(key, index=key.index + 1), seen, here, loose, there, STRAY_M) is None
    for flag in ("is_stale", "is_parted", "without_movers"):
        assert given.along(key, replace(seen, **{flag: True}), here, loose, there, STRAY_M) is None
    assert given.along(key, seen, here, loose, here, 0.03) is not None  # as far as poses scatter
    assert given.along(key, seen, here, loose, here, 0.01) is None
    elsewhere = se3.exp(np.array([-0.05, 0, 0, 0, 0, 0]))  # where it was expected
    assert given.along(key, seen, here, loose, elsewhere, STRAY_M) is None


def test_beside_edges_of_one_direction_they_say_the_rest():
    """Level stripes are in view all the time, so that depth is never alone.

    In the first second they may be of what moves, and has not been noticed yet.
    """
    poses = going([0.1, 0, 0, 0, 0, 0])
    ends = []
    for overrides in ((), (OFF,)):
        odometry = Odometry(CAMERA, Config().with_overrides(overrides))
        for k in range(32):
            odometry.track(plate(np.eye(4), k * PERIOD, FAR_UP, stripes(), k))
        results = []
        for k, T in enumerate(poses, start=32):
            results.append(odometry.track(plate(T, k * PERIOD, FAR_UP, stripes(), k)))
        ends.append(results)
    followed, left = ends
    assert abs(followed[-1].T_world_cam[0, 3] - 0.1) < 0.012
    assert left[-1].status is not Status.TRACKED
    assert abs(left[-1].T_world_cam[0, 3] - 0.1) > 0.03


@pytest.mark.parametrize(("bound_m", "follows"), [(0.01, False), (0.1, True)])
def test_they_do_not_lead_farther_than_a_camera_goes(painted, monkeypatch, bound_m, follows):
    """A plate that slides by in the dark takes along whoever is not asked how far he may go."""
    monkeypatch.setattr(blind, "DARK_STRAY_M", bound_m)
    odometry, _ = in_white(painted, [])
    for k in range(2, 8):
        T = se3.exp(np.array([-0.02 * (k - 1), 0, 0, 0, 0, 0]))  # as if the camera went
        result = odometry.track(plate(T, k * PERIOD, seed=k))
    assert (problems.error(np.eye(4), result.T_world_cam)[0] > 0.05) == follows


@pytest.mark.parametrize("is_striped", [False, True])
def test_not_where_something_moves(painted, is_striped):
    """In the dark, and beside edges that tell one way along the wall."""
    ends = []
    for overrides in ((), (OFF,)):
        odometry = Odometry(CAMERA, Config().with_overrides(overrides))
        for k in range(32):
            odometry._doubt.moving_time = (k - 1) * PERIOD
            lit = stripes() if is_striped else painted
            odometry.track(plate(np.eye(4), k * PERIOD, FAR_UP, lit, k))
        for k, T in enumerate(going([0.03, 0, 0, 0, 0, 0], 6), start=32):
            odometry._doubt.moving_time = (k - 1) * PERIOD
            picture = stripes() if is_striped else None
            result = odometry.track(plate(T, k * PERIOD, FAR_UP, picture, k))
        ends.append(result.T_world_cam)
    np.testing.assert_array_equal(*ends)


def test_once_it_is_known_how_fast_a_keyframe_went_its_contours_are_moved(painted):
    odometry = Odometry(CAMERA)
    for k in range(4):
        T = se3.exp(np.array([0.015 * k, 0, 0, 0, 0, 0]))
        frame = plate(T, k * PERIOD, picture=np.roll(painted, -2 * k, axis=1), seed=k)
        odometry.track(replace(frame, depth_delay=0.03))
    held = odometry._contours._held[-1]
    assert held.index == 0
    np.testing.assert_allclose(held.T_cam_depth[:3, 3], (0.0135, 0, 0), atol=0.004)


def test_depth_that_was_elsewhere_than_was_thought_is_moved(painted):
    """Once the velocity of a keyframe is known."""
    odometry, _ = in_white(painted, [])
    key, given = odometry._course.key, odometry._contours
    seen = odometry._front_end.see(plate(going([0.02, 0, 0, 0, 0, 0])[-1], 1.0, seed=9), 9)
    loose = 1e-6 * np.eye(6)
    loose[0, 0] = 1.0
    expected = se3.exp(np.array([0.02, 0, 0, 0, 0, 0]))
    at_once = given.along(key, seen, np.eye(4), loose, expected, STRAY_M)
    T = se3.exp(np.array([0.01, 0, 0, 0, 0, 0]))
    given.move(key, T)
    late = given.along(key, seen, np.eye(4), loose, expected, STRAY_M)
    off = late.T_key_cur[:3, 3] - at_once.T_key_cur[:3, 3]
    np.testing.assert_allclose(off, (0.01, 0, 0), atol=0.002)


def test_depth_leads_with_them_where_light_jumps(painted):
    odometry, _ = in_white(painted, [])
    inverse = plate(np.eye(4), 2 * PERIOD, picture=255 - painted, seed=9)
    assert odometry.track(inverse).reason == LEADS
    odometry, _ = in_white(painted, [], OFF)
    assert odometry.track(inverse).status is Status.LOST


def test_the_paper_follows_none():
    assert Config.preset("paper").planes.contours == "none"
    assert Config().planes.contours == "followed"
