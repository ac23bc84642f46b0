"""Depth that is not taken at the instant of its image: moved, measured, and what it is worth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config, EdgesConfig, PlanesConfig, SamplingConfig
from edvo.delay import LARGEST_S, LEAST_SHARE, DepthDelay
from edvo.edges import NO_TABLE, depth_at_edges, extract_edges
from edvo.evaluation import evaluate
from edvo.frame import Frame
from edvo.measuring import Moment
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, camera_of, move_points
from edvo.registration import AT_ONCE, Registration
from edvo.sampling import sample_edges
from edvo.seen import Seen
from edvo.synthesis.clock import Clock
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins

CAMERA = problems.CAMERA
BENT = replace(CAMERA, distortion=(0.1, -0.2, 1e-3, -2e-3, 0.05))
# From the instant of depth to that of the image: some 7 px, at a metre and a half.
T_CAM_DEPTH = se3.exp(np.array([0.02, -0.01, 0.015, 0.01, -0.015, 0.02]))
OLDER = -0.015


def surfaces(camera, T_cam_world):
    """A box before a slanted wall, each an endless plane: their distances and edges between."""
    v, u = np.mgrid[: camera.height, : camera.width]
    raw = np.stack([u.ravel(), v.ravel()], 1).astype(np.float64)
    rays = camera.backproject(raw, np.ones(len(raw))) @ T_cam_world[:3, :3]
    eye = -T_cam_world[:3, :3].T @ T_cam_world[:3, 3]
    normal = np.array([0.2, -0.1, 0.97])
    wall = (2.0 - eye @ normal) / (rays @ normal)
    box = (1.2 - eye[2]) / rays[:, 2]
    at = eye + box[:, None] * rays
    inside = (abs(at[:, 0]) < 0.25) & (abs(at[:, 1]) < 0.2)
    points = eye + np.where(inside, box, wall)[:, None] * rays
    depth = (points @ T_cam_world[:3, :3].T + T_cam_world[:3, 3])[:, 2]
    shape = camera.height, camera.width
    return depth.reshape(shape).astype(np.float32), inside.reshape(shape)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
def test_planes_are_those_that_the_camera_sees_at_the_instant_of_the_image(camera):
    fitter = PlaneFitter(camera, PlanesConfig())
    then, _ = surfaces(camera, se3.inverse(T_CAM_DEPTH))
    now, _ = surfaces(camera, np.eye(4))
    wanted, as_they_are, moved = (
        fitter.planes(*each) for each in ((now,), (then,), (then, T_CAM_DEPTH))
    )
    both = (wanted.offsets > 0) & (moved.offsets > 0)
    assert both.sum() > 0.85 * (wanted.offsets > 0).sum()
    off = abs(moved.offsets - wanted.offsets)[both]
    assert np.quantile(off, 0.97) < 1e-4  # but for what lies at the border of the box
    assert np.median(abs(as_they_are.offsets - wanted.offsets)[both]) > 0.005
    cosine = (moved.normals * wanted.normals).sum(1)[both]
    assert np.quantile(cosine, 0.03) > 1 - 1e-6
    points = fitter.points(then, T_CAM_DEPTH)
    found = kernels.new_plane_matches(len(points.sigma))
    count = kernels.match_planes(wanted, points, camera_of(camera), np.eye(4), fitter.term, found)
    assert count > 0.85 * len(points.sigma)
    assert np.median(abs(found.residuals[:count])) < 0.01


def test_points_move_as_planes_do():
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    depth, _ = surfaces(CAMERA, np.eye(4))
    points, moved = fitter.points(depth), fitter.points(depth, T_CAM_DEPTH)
    other = move_points(points, T_CAM_DEPTH)
    np.testing.assert_allclose(other.X, moved.X, atol=1e-12)
    np.testing.assert_allclose(other.normals, moved.normals, atol=1e-12)
    np.testing.assert_array_equal(other.sigma, points.sigma)
    assert not np.shares_memory(other.X, points.X)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
def test_edges_take_the_depth_that_they_had_then(camera):
    """On the contour of a box, which is some pixels away in the depth image."""
    then, _ = surfaces(camera, se3.inverse(T_CAM_DEPTH))
    now, box = surfaces(camera, np.eye(4))
    config, edges_config = SamplingConfig(count=0), EdgesConfig()
    edges = extract_edges(np.where(box, 200, 60).astype(np.uint8), edges_config)

    def depths(depth, T=None):
        # nothing is left out, so that edges are the same ones
        return sample_edges(edges, depth, camera, config, edges_config, 0, T).depths

    wanted = depths(now)
    assert len(wanted) > 300
    np.testing.assert_allclose(wanted, 1.2, atol=0.02)
    assert np.mean(abs(depths(then) - wanted) > 0.1) > 0.2
    moved = depths(then, T_CAM_DEPTH)
    assert np.mean(abs(moved - wanted) < 0.004) > 0.95


def test_moving_depth_equals_its_numpy_twin():
    rng = np.random.default_rng(0)
    T = T_CAM_DEPTH
    normals, offsets, centres = (
        rng.normal(size=(50, 3)),
        rng.uniform(0, 2, 50),
        rng.normal(size=(50, 3)),
    )
    offsets[::7] = 0  # no plane
    expected = twins.move_planes(T, normals, offsets, centres)
    kernels.move_planes(T, normals, offsets, centres)
    for got, wanted in zip((normals, offsets, centres), expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-12)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
def test_looking_up_depth_of_another_instant_equals_its_numpy_twin(camera):
    rng = np.random.default_rng(1)
    depth, box = surfaces(camera, np.eye(4))
    depth[rng.random(depth.shape) < 0.2] = 0
    table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
    pinhole, T = camera_of(camera), se3.inverse(T_CAM_DEPTH)
    nodes = rng.integers((-9, -9), (330, 250), (400, 2)).astype(np.int32)
    moved = np.empty_like(nodes)
    kernels.shift_nodes(depth, nodes, table, pinhole, T, moved)
    np.testing.assert_array_equal(moved, twins.shift_nodes(depth, nodes, camera, T))
    edges = extract_edges(np.where(box, 200, 60).astype(np.uint8), EdgesConfig())
    which = np.arange(0, len(edges), 3, dtype=np.int32)
    given = rng.uniform(0.9, 2.2, len(which)).astype(np.float32)
    found = given.copy()
    kernels.delayed_depths(edges.index, which, depth, table, pinhole, T, 2, 0.05, found)
    expected = twins.delayed_depths(edges.index[which], depth, camera, T, 2, 0.05, given)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert (found != given).mean() > 0.9
    for size in (1e-3, 1e-2, 0.1):  # some stay at the pixel that they were looked up at
        T = se3.exp(size * se3.log(T_CAM_DEPTH))
        depths_at_edges = depth_at_edges(depth, edges.index[which], EdgesConfig())
        seen = np.flatnonzero(depths_at_edges > 0)
        found = depths_at_edges[seen]
        kernels.delayed_depths(edges.index, which[seen], depth, table, pinhole, T, 2, 0.05, found)
        expected = twins.delayed_depths(
            edges.index[which[seen]], depth, camera, T, 2, 0.05, depths_at_edges[seen]
        )
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_where_another_instant_shows_a_hole_the_depth_stays():
    depth = np.full((CAMERA.height, CAMERA.width), 2.4, np.float32)
    depth[:, 160:] = 0
    index = np.arange(100, 150, dtype=np.int32) + 120 * CAMERA.width
    found = np.full(50, 2.4, np.float32)
    T = se3.exp(np.array([0.0, 0.0, -0.1, 0.0, 0.4, 0.0]))  # to the right, and to the front
    kernels.delayed_depths(
        index, np.arange(50, dtype=np.int32), depth, NO_TABLE, camera_of(CAMERA), T, 2, 0.05, found
    )
    assert (found > 2.0).all()
    assert (found == np.float32(2.4)).any()


def test_the_twist_of_a_motion_equals_its_numpy_twin():
    rng = np.random.default_rng(2)
    for size in (0.0, 1e-9, 1e-5, 1e-3, 0.1, 1.0, 2.9):
        xi = rng.normal(size=6)
        xi[3:] *= size / np.linalg.norm(xi[3:])
        T = se3.exp(xi)
        np.testing.assert_allclose(kernels.log_se3(T), se3.log(T), atol=1e-9)
        np.testing.assert_allclose(kernels.inverted(T), se3.inverse(T), atol=1e-12)


def test_the_equations_of_depth_equal_their_numpy_twin():
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    depth, _ = surfaces(CAMERA, np.eye(4))
    planes, points = fitter.planes(depth), fitter.points(depth)
    T = se3.exp(0.2 * se3.log(T_CAM_DEPTH))
    H, b = np.full((6, 6), np.nan), np.full(6, np.nan)
    kernels.depth_equations(planes, points, camera_of(CAMERA), T, fitter.term, 3.0, 0.7, H, b)
    expected = twins.depth_equations(planes, points, CAMERA, T, fitter.term, 3.0, 0.7)
    np.testing.assert_allclose(H, expected[0], rtol=1e-6, atol=1e-6 * abs(H).max())
    np.testing.assert_allclose(b, expected[1], rtol=1e-6, atol=1e-6 * abs(b).max())


def test_depth_lags_by_a_share_of_the_motion():
    step = np.array([0.01, 0.02, -0.01, 0.02, 0.01, -0.03])
    T_last = se3.exp([0.3, 0.1, -0.2, 0.1, 0.2, 0.3])
    T = T_last @ se3.exp(step)
    assert kernels.lagged(T, AT_ONCE) is T
    for share in (-1.0, -0.4, 0.5):
        lag = AT_ONCE._replace(share=share, T_ref_last=T_last)
        np.testing.assert_allclose(kernels.lagged(T, lag), T_last @ se3.exp((1 + share) * step))
        expected = se3.exp([0.0, 0.01, 0.0, 0.0, 0.02, 0.0])  # what points were moved by
        moved = kernels.lagged(T, lag._replace(T_depth_cam=se3.inverse(expected)))
        np.testing.assert_allclose(moved @ expected, kernels.lagged(T, lag), atol=1e-12)


def test_a_registration_finds_the_pose_of_the_image_not_of_the_depth():
    """Edges that say little, and depth of half a step ago: only the lag tells where it is now."""
    step = np.array([0.0, 0.0, 0.03, 0.0, 0.02, 0.0])
    config = Config()
    registration = Registration(CAMERA, config.matching, config.registration)
    fitter = PlaneFitter(CAMERA, config.planes)
    first, box = surfaces(CAMERA, np.eye(4))
    grey = np.where(box, 200, 60).astype(np.uint8)
    keyframe = registration.index(extract_edges(grey, config.edges).describe(CAMERA))
    then, _ = surfaces(CAMERA, se3.inverse(se3.exp(step / 2)))
    now, box = surfaces(CAMERA, se3.inverse(se3.exp(step)))
    edges = extract_edges(np.where(box, 200, 60).astype(np.uint8), config.edges)
    samples = sample_edges(edges, now, CAMERA, config.sampling, config.edges, 0)
    term = fitter.term._replace(weight=30.0)

    def error(lag):
        found = registration.align(
            keyframe,
            samples,
            np.eye(4)[None],
            fitter.planes(first),
            fitter.points(then),
            term,
            lag,
        )
        return problems.error(se3.exp(step), found.T_ref_cur)[0]

    assert error(AT_ONCE) > 0.008
    assert error(AT_ONCE._replace(share=-0.5)) < 0.001


def seen(delay=0.0):
    frame = Frame(0.0, np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32), delay)
    return Seen(frame, None, None, None)


def test_what_the_camera_moves_by_in_between():
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    velocity = np.array([0.3, 0.0, -0.2, 0.0, 0.5, 0.1])
    delay = DepthDelay(CAMERA, fitter, "stamps")
    assert delay.seconds == 0.0
    for stamps in (0.016, -0.016):
        T = delay.motion(velocity, seen(stamps).frame.depth_delay)
        np.testing.assert_allclose(T, se3.exp(velocity * stamps))
        lag = delay.lag(seen(stamps), np.eye(4), 1 / 20)
        assert lag.share == pytest.approx(20 * stamps)
    assert delay.motion(velocity, seen(-3.0).frame.depth_delay) is None  # stamps that make no sense
    assert delay.lag(seen(LARGEST_S), np.eye(4), 1 / 100).share == pytest.approx(100 * LARGEST_S)
    # Nearer to the last frame than to its image errors would grow: the rest stays as expected.
    expected = se3.exp(-LARGEST_S * velocity)
    lag = delay.lag(replace(seen(-LARGEST_S), T_cam_depth=expected), np.eye(4), 1 / 30)
    assert lag.share == LEAST_SHARE
    at_that_velocity = kernels.lagged(se3.exp(velocity / 30), lag) @ expected
    np.testing.assert_allclose(at_that_velocity, se3.exp(velocity / 30) @ expected, atol=1e-12)
    assert delay.motion(velocity, seen(0.0).frame.depth_delay) is None
    assert (
        delay.motion(1e-3 * velocity, seen(0.016).frame.depth_delay) is None
    )  # far less than a pixel
    assert delay.lag(seen(0.0), np.eye(4), 1 / 30) is AT_ONCE
    off = DepthDelay(CAMERA, fitter, "none")
    assert off.motion(velocity, seen(0.016).frame.depth_delay) is None
    assert off.lag(seen(0.016), np.eye(4), 1 / 30) is AT_ONCE
    alone = DepthDelay(CAMERA, PlaneFitter(CAMERA, PlanesConfig(weight=0)), "measured")
    assert alone.motion(velocity, seen(0.016).frame.depth_delay) is None


def test_the_delay_shows_in_how_misfits_change_with_velocity():
    """At the true pose, which edges hold, and of which depth knows nothing where it is loose."""
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    planes = fitter.planes(surfaces(CAMERA, np.eye(4))[0])
    keyframe, rng = SimpleNamespace(planes=planes), np.random.default_rng(3)
    held, loose = DepthDelay(CAMERA, fitter, "measured"), DepthDelay(CAMERA, fitter, "measured")
    for _ in range(8):
        velocity = rng.normal(0, 0.3, 6)
        depth, _ = surfaces(CAMERA, se3.inverse(se3.exp(velocity * 0.008)))
        for delay, H in ((held, 1e9 * np.eye(6)), (loose, np.zeros((6, 6)))):
            here = replace(seen(), points=fitter.points(depth))
            here = delay.settled(here, velocity)
            alignment = SimpleNamespace(
                T_ref_cur=np.eye(4),
                H=H,
                depth_balance=100.0,
                sigma_depth=3.0,
                sigma_px=0.1,
                lag=AT_ONCE,
            )
            delay.learn(Moment(keyframe, here, alignment, 1 / 30, velocity, velocity))
    assert held.seconds == pytest.approx(0.008, rel=0.1)
    assert loose.seconds == 0.0


def test_a_pose_that_gives_way_to_depth_hides_nothing_of_the_delay():
    """Edges hold it no better than depth pulls at it, and depth moves by less than it does."""
    # windows that look at little of the border of the box take it for one with the wall, or not,
    # as it moves: that is what holds a way to the side
    fitter = PlaneFitter(CAMERA, PlanesConfig(stride_px=4))
    planes = fitter.planes(surfaces(CAMERA, np.eye(4))[0])
    keyframe, rng, period = SimpleNamespace(planes=planes), np.random.default_rng(3), 1 / 30
    delay = DepthDelay(CAMERA, fitter, "measured")
    for _ in range(8):
        velocity = rng.normal(0, 0.3, 6)
        T, T_last = np.eye(4), se3.exp(-velocity * period)
        raw = seen(-0.01)  # a third of a period by its stamp
        depth, _ = surfaces(CAMERA, se3.inverse(se3.exp(velocity * (-0.01 + 0.006))))
        raw = replace(raw, points=fitter.points(depth))
        for _ in range(6):
            here = delay.settled(raw, se3.log(se3.inverse(T_last) @ T) / period)
            lag = delay.lag(here, T_last, period)
            moves = 1 + lag.share
            found = SimpleNamespace(
                T_ref_cur=T, depth_balance=100.0, sigma_depth=3.0, sigma_px=0.1, H=None, lag=lag
            )
            moment = Moment(keyframe, here, found, period, velocity, velocity)
            H, b = delay._equations(moment)
            H_edges = 0.5 * H
            found.H = H_edges + moves**2 * H
            T = se3.exp(-np.linalg.solve(found.H, H_edges @ se3.log(T) + moves * b)) @ T
        delay.learn(moment)
    assert delay.seconds == pytest.approx(0.006, rel=0.2)


def test_what_is_made_up_for_stays_so_however_closely_depth_fits_by_then():
    """Taken back, it would be many times off what is left, and no one would believe it."""
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    planes = fitter.planes(surfaces(CAMERA, np.eye(4))[0])
    keyframe, rng = SimpleNamespace(planes=planes), np.random.default_rng(3)
    delay, period = DepthDelay(CAMERA, fitter, "measured"), 1 / 30
    for _ in range(30):
        velocity = rng.normal(0, 0.3, 6)
        depth, _ = surfaces(CAMERA, se3.inverse(se3.exp(velocity * 0.008)))
        here = delay.settled(replace(seen(), points=fitter.points(depth)), velocity)
        near = kernels.new_plane_matches(len(here.points.sigma))
        pinhole = delay._pinhole
        count = kernels.match_planes(planes, here.points, pinhole, np.eye(4), fitter.term, near)
        close = float(np.median(np.abs(near.residuals[:count]))) + 0.01
        found = SimpleNamespace(
            T_ref_cur=np.eye(4),
            H=1e9 * np.eye(6),
            depth_balance=1.0,
            sigma_depth=close,
            sigma_px=0.1,
            lag=AT_ONCE,
        )
        delay.learn(Moment(keyframe, here, found, period, velocity, velocity))
    assert delay.seconds == pytest.approx(0.008, rel=0.05)


# ------------------------------------------------------------------------------------- sequences


def clip(scene, offset, frames=60):
    clock = Clock(30.0, offset=-offset)
    recipe = make_recipe(scene, frames=frames, camera=CAMERA, speed=0.5, colour_clock=clock, seed=3)
    source = SyntheticSource(recipe)
    return [source.read(i).frame for i in range(frames)], source.ground_truth


@pytest.fixture(scope="module")
def older():
    """Images 15 ms later than depth, and stamped so."""
    return clip("texture_near", OLDER)


def follow(frames, truth, rule, *others):
    config = Config().with_overrides([f"motion.depth_delay={rule}", *others])
    odometry = Odometry(CAMERA, config)
    results = [odometry.track(frame) for frame in frames]
    return evaluate(truth, odometry.trajectory, len(frames)).rpe.rmse, odometry, results


def test_depth_that_is_older_by_its_stamps_costs_little(older):
    frames, truth = older
    for frame in frames:
        assert frame.depth_delay == pytest.approx(OLDER)
    at_once, _, _ = follow(frames, truth, "none")
    for rule in ("stamps", "measured"):
        rmse, odometry, results = follow(frames, truth, rule)
        assert rmse < 0.6 * at_once
        assert {result.status for result in results} == {Status.TRACKED}
        assert abs(odometry._instants.depth.seconds) < 0.002  # nothing beyond the stamps


def test_a_delay_that_no_stamp_tells_is_measured():
    """And is made up for as well as one that is stamped."""
    stamped, truth = clip("cabinet", OLDER)
    frames = [replace(frame, depth_delay=0.0) for frame in stamped]
    # else late depth counts little, and harms as little; and less near a keyframe
    how = "planes.depth_doubt_rule=none", "keyframes.max_translation_m=0.3"
    how += ("motion.depth_slack=none",)  # which is worth more to depth whose stamp tells at once
    told, _, _ = follow(stamped, truth, "stamps", *how)
    rmse, odometry, _ = follow(frames, truth, "measured", *how)
    assert odometry.depth_delay == pytest.approx(OLDER, rel=0.15)
    assert rmse < 1.1 * told
    odometry.reset()
    assert odometry._instants.depth.seconds == 0.0


def test_a_delay_is_measured_where_depth_tells_little_of_the_pose(older):
    """Crisp edges are all over the image."""
    frames, truth = older
    frames = [replace(frame, depth_delay=0.0) for frame in frames]
    whole = "planes.depth_doubt_rule=none"
    at_once, _, _ = follow(frames, truth, "none", whole)
    rmse, odometry, _ = follow(frames, truth, "measured", whole)
    assert odometry.depth_delay == pytest.approx(OLDER, rel=0.15)
    assert rmse < 0.9 * at_once


def test_where_there_is_none_none_is_found():
    frames, truth = clip("office", 0.0)
    at_once, _, _ = follow(frames, truth, "none")
    rmse, odometry, _ = follow(frames, truth, "measured")
    assert abs(odometry._instants.depth.seconds) < 0.001
    assert rmse < 1.1 * at_once


def test_the_depth_of_the_first_keyframe_is_moved_once_its_velocity_is_known(older, monkeypatch):
    frames, _ = older
    odometry = Odometry(CAMERA, Config().with_overrides(["motion.depth_delay=stamps"]))
    odometry.track(frames[0])
    first = odometry._course.keyframe
    odometry.track(frames[1])
    assert odometry._course.keyframe is first  # this one has had enough to do
    align, asked = odometry._registration.align, []

    def watched(*given, **options):
        asked.append(given[3])
        return align(*given, **options)

    monkeypatch.setattr(odometry._registration, "align", watched)
    odometry.track(frames[2])
    second = odometry._course.keyframe
    assert second.index == first.index
    assert np.median(abs(second.planes.offsets - first.planes.offsets)) > 1e-3
    assert asked[0] is second.planes  # but before the next one is registered
    assert odometry._upkeep.store.newest() is second
    for frame in frames[3:5]:
        odometry.track(frame)
        assert odometry._course.keyframe is second  # as good as before


def test_paper_takes_them_as_simultaneous():
    assert Config.preset("paper").motion.depth_delay == "none"
