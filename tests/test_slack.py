"""Depth, and rows, that lie elsewhere than the camera's velocity puts them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config, MatchingConfig, MotionConfig, PlanesConfig, RegistrationConfig
from edvo.course import ACCELERATION_S, HAND, Course
from edvo.delay import LEAST_SHARE, DepthDelay
from edvo.edges import EdgePixels
from edvo.exposure import Exposure
from edvo.frame import Frame
from edvo.instants import Instants
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, PlaneMap, PlanePoints, move_points
from edvo.registration import AS_ONE, AT_ONCE, Alignment, Registration
from edvo.seen import Seen
from edvo.slack import LEAST_SLACK, bend_of, slackened
from edvo.synthesis.clock import Clock
from edvo.uncertainty import DOUBT, SHARES, Parts, given_way

from . import problems

PERIOD, LATE = 1 / 30, 0.016
EYE = np.eye(4)
RESTLESS = np.array([2.0] * 3 + [5.0] * 3)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def curvature(rng, size=6, rows=40):
    J = rng.normal(size=(rows, size))
    return J.T @ J


# -------------------------------------------------------------------------------- the equations


def test_a_step_is_that_of_the_equations_of_pose_and_slack_together(rng):
    whole, gradient, slack = curvature(rng, 12), rng.normal(size=12), rng.normal(size=6)
    H, C, K, b = whole[:6, :6].copy(), whole[:6, 6:], whole[6:, 6:], gradient[:6].copy()
    room, step, now = np.empty((4, 6, 6)), np.empty(6), np.empty(6)
    kernels.give_way(C, K, gradient[6:], room, H, b)
    assert kernels.solve_damped(H, b, 0.0, step)
    kernels.yielded(slack, room, step, now)
    expected = -np.linalg.solve(whole, gradient)
    np.testing.assert_allclose(step, expected[:6], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(now - slack, expected[6:], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(H, np.linalg.inv(np.linalg.inv(whole)[:6, :6]), rtol=1e-7)


def test_what_depth_still_tells_is_what_its_slack_leaves(rng):
    """As the registration's own equations weigh it: edges, and depth that gives way."""
    edges, A, P = curvature(rng), curvature(rng), curvature(rng, rows=7)
    S_edges, S_planes, S_depth = (curvature(rng) for _ in range(3))
    parts, square = np.array([S_edges, S_planes, S_depth, curvature(rng)]), 0.09
    told = Parts(edges + A, 0.3 * A / DOUBT, parts, A)
    left, M = given_way(told, P / square, square), AS_ONE * square * np.linalg.inv(P)
    sure, G = 0.7 * A, np.eye(6) - A @ np.linalg.inv(A + P)
    whole = np.block([[edges + sure, sure], [sure, sure + P]])
    marginal = np.linalg.inv(np.linalg.inv(whole)[:6, :6])
    np.testing.assert_allclose(left.curvature, marginal, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(left.by_depth, G @ A, atol=1e-9)
    assert not left.blur.any()
    planes = SHARES.planes * G @ S_planes @ G.T + G @ A @ M @ A @ G.T
    np.testing.assert_allclose(SHARES.planes * left.parts[1], planes, rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(left.parts[0], S_edges)
    np.testing.assert_array_equal(left.parts[2], S_depth)
    np.testing.assert_allclose(left.parts[3], G @ parts[3] @ G.T, atol=1e-9)


def test_depth_that_gives_no_way_tells_what_it_did(rng):
    """Noise of the normals included, of which more is taken off than depth seems to tell."""
    edges, A = curvature(rng), curvature(rng, rows=4)
    told = Parts(edges + A, A, np.zeros((4, 6, 6)), A)
    left = given_way(told, 1e13 * np.eye(6), 1.0)
    np.testing.assert_allclose(left.curvature, edges + A - DOUBT * A, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("P", [1.0, 20.0, 21.0, 1e6])
def test_noise_of_the_normals_hides_what_it_did_however_little_of_the_slack_is_known(P):
    A = np.diag([100.0, 1, 1, 1, 1, 1])
    left = given_way(Parts(2 * A, A, np.zeros((4, 6, 6)), A), P * np.eye(6), 1.0)
    np.testing.assert_allclose(left.curvature, A + (1 - DOUBT) * A, atol=1e-9)


# ----------------------------------------------------------------------------- the registration


class Corner:
    """Edges at their places, and a corner of three walls whose depth lies elsewhere as one."""

    def __init__(self, seed, share, twist, noise=2e-3):
        rng = np.random.default_rng(seed)
        self.T = problems.motion(rng, 0.05, 3.0)
        self.problem = problems.segments_problem(seed, self.T)
        camera, rows, cols = self.problem.camera, 60, 80
        walls = np.array([[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [0.0, 0.8, 0.6]])
        which = np.repeat(np.arange(cols) * 3 // cols, rows).reshape(cols, rows).T.ravel()
        self.planes = PlaneMap(walls[which], np.full(rows * cols, 2.0), rows, cols, 8.0)
        self.lag = AT_ONCE._replace(
            share=share, T_ref_last=self.T @ se3.exp(rng.normal(0, 0.005, 6))
        )
        self.slack = np.asarray(twist, float)
        there = se3.exp(self.slack) @ kernels.lagged(self.T, self.lag)
        pixels = rng.uniform([60, 60], [580, 420], (900, 2))
        u, v = (pixels // 8).astype(int).T
        mine = walls[which[v * cols + u]]
        rays = camera.backproject(pixels, np.ones(900))
        back = se3.inverse(there)
        X = (rays * (2.0 / (rays * mine).sum(1))[:, None]) @ back[:3, :3].T + back[:3, 3]
        X += rng.normal(0, noise, X.shape)
        sigma = np.full(900, noise)
        self.points = PlanePoints(X, mine @ back[:3, :3].T, sigma, 16.0)

    def register(self, steady=None):
        config = RegistrationConfig(stop_px=1e-5, stop_share=1e-5, max_rejections=9)
        registration = Registration(self.problem.camera, MatchingConfig(), config)
        term = PlaneFitter(self.problem.camera, PlanesConfig()).term
        lag = self.lag if steady is None else self.lag._replace(bend=1.0, steady=steady)
        start = (self.T @ se3.exp(np.full(6, 0.002)))[None]
        reference = registration.index(self.problem.reference)
        given = (reference, self.problem.samples, start, self.planes, self.points)
        return registration.align(*given, term, lag)


@pytest.mark.parametrize("share", [0.48, -0.3])
@pytest.mark.parametrize("seed", range(3))
def test_depth_that_lies_elsewhere_is_found_there_and_leaves_the_pose_alone(seed, share):
    twist = [0.004, -0.003, 0.002, 0.002, 0.003, -0.003]
    corner = Corner(seed, share, twist)
    steady = np.diag(1 / np.array([4e-3] * 3 + [3e-3] * 3) ** 2)
    held, loose = corner.register(), corner.register(steady)
    assert held.depth_balance > 0
    assert held.T_cam_points is None
    np.testing.assert_array_equal(held.slack, 0)
    off, better = (problems.error(corner.T, each.T_ref_cur)[0] for each in (held, loose))
    assert better < 0.5 * off
    np.testing.assert_allclose(loose.slack, twist, atol=1.2e-3)
    assert loose.sigma_depth < held.sigma_depth
    there = se3.exp(loose.slack) @ kernels.lagged(loose.T_ref_cur, corner.lag)
    np.testing.assert_allclose(kernels.lagged(loose.T_ref_cur, loose.lag), there, atol=1e-12)
    np.testing.assert_allclose(loose.T_ref_cur @ loose.T_cam_points, there, atol=1e-12)
    assert loose.slack_px2 > loose.sigma_px**2


def test_depth_that_is_sure_to_lie_nowhere_else_pulls_as_before():
    corner = Corner(0, 0.48, [0.004, -0.003, 0.002, 0.002, 0.003, -0.003])
    held, sure = corner.register(), corner.register(1e12 * np.eye(6))
    assert problems.error(held.T_ref_cur, sure.T_ref_cur)[0] < 2e-5
    assert np.abs(sure.slack).max() < 1e-6
    assert sure.cost == pytest.approx(held.cost, rel=1e-3)


def bending(seed, faster, readout=0.025):
    """Samples seen row by row by a camera that accelerates evenly, from the last image on.

    ``faster`` (6,), 1/s, is by how much it goes faster at the image than on its way to it.
    """
    step = np.array([0.01, -0.01, 0.012, 0.012, -0.015, 0.01])
    T_last = problems.motion(np.random.default_rng(seed), 0.05, 3.0)
    T = T_last @ se3.exp(step)
    problem = problems.segments_problem(seed, T)
    points, pixels = problem.samples.points(problem.camera), problem.samples.pixels
    for _ in range(5):  # the row decides when, and that which row
        t = (pixels[:, 1].astype(np.float64) / problem.camera.height - 0.5) * readout
        twists = t[:, None] * step / PERIOD + (t + t**2 / PERIOD)[:, None] * faster
        there = np.array(
            [
                (se3.exp(-twist) @ np.append(X, 1.0))[:3]
                for twist, X in zip(twists, points, strict=True)
            ]
        )
        pixels = problem.camera.project(there).astype(np.float32)
    seen = EdgePixels(pixels, problem.samples.gradients, there[:, 2].astype(np.float32))
    rows = (pixels[:, 1].astype(np.float64) / problem.camera.height - 0.5) * readout / PERIOD
    return problem, T_last, seen, AT_ONCE._replace(T_ref_last=T_last, rows=rows)


@pytest.mark.parametrize("seed", range(3))
def test_rows_tell_how_the_camera_accelerates(seed):
    """And the pose is that of the middle of the image, though it did not go on as it went."""
    faster = np.array([0.05, -0.06, 0.04, 0.09, -0.1, 0.08])
    problem, T_last, seen, lag = bending(seed, faster)
    config = RegistrationConfig(stop_px=1e-5, stop_share=1e-5, max_rejections=9)
    registration = Registration(problem.camera, MatchingConfig(), config)
    reference = registration.index(problem.reference)
    bends = bend_of(lag.rows)
    bent = slackened(lag, 0.0, bends, PERIOD, (3 * faster / PERIOD) ** 2)
    held = registration.align(reference, seen, T_last[None], lag=lag)
    free = registration.align(reference, seen, T_last[None], lag=bent)
    off, better = (problems.error(problem.T_ref_cur, each.T_ref_cur) for each in (held, free))
    assert better[0] < 0.2 * off[0]
    assert better[1] < 0.2 * off[1]
    np.testing.assert_allclose(free.faster / PERIOD, faster, atol=0.01)
    np.testing.assert_array_equal(held.faster, 0)
    assert free.T_cam_points is None  # depth was taken at once
    # what edges tell, wherever their rows were
    sound = registration.align(reference, problem.samples, problem.T_ref_cur[None])
    np.testing.assert_allclose(free.H, sound.H, rtol=0.1, atol=0.02 * sound.H.max())


# ------------------------------------------------------------------------------- how much it is


def late(delay=LATE):
    frame = Frame(0.0, np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32), delay)
    return Seen(frame, None, None, None)


def delay_of(slack="measured"):
    fitter = PlaneFitter(problems.CAMERA, PlanesConfig())
    return DepthDelay(problems.CAMERA, fitter, "stamps", slack)


@pytest.mark.parametrize("delay", [LATE, -0.008, -0.025])
def test_points_are_moved_to_where_they_were_found(rng, delay):
    """By a camera that accelerates evenly, so that the slack is known: early and late."""
    measure, a = delay_of(), rng.normal(0, RESTLESS)
    velocity = rng.normal(0, 0.3, 6)
    T, T_last = np.eye(4), se3.inverse(se3.exp(velocity * PERIOD))
    X = np.column_stack([rng.uniform(-1, 1, (50, 2)), rng.uniform(1, 3, 50)])
    raw = PlanePoints(X, np.tile([0.0, 0.0, -1.0], (50, 1)), np.full(50, 1e-3), 8.0)
    expected = se3.exp((velocity - a * PERIOD) * delay)
    there = Seen(late(delay).frame, None, None, move_points(raw, expected), expected)
    lag = measure.lag(there, T_last, PERIOD)
    true = se3.exp(velocity * delay + 0.5 * a * (delay**2 + delay * PERIOD))
    slack = se3.log(true @ se3.inverse(kernels.lagged(T, lag) @ expected))
    found = SimpleNamespace(T_ref_cur=T, lag=lag, slack=slack)
    on = kernels.lagged(T, lag)
    apart = lag.T_depth_cam @ se3.inverse(on) @ se3.exp(slack) @ on
    found.lag = lag._replace(bend=1.0, T_depth_cam=apart, steady=np.eye(6))
    T_cam_points = Alignment.T_cam_points.fget(found)
    settled = measure.settled(there, velocity, T_cam_points)
    where = se3.exp(slack) @ on
    moved = move_points(there.points, where)
    np.testing.assert_allclose(settled.points.X, moved.X, atol=1e-12)
    np.testing.assert_allclose(settled.T_cam_depth, true, atol=1e-12)


@pytest.mark.parametrize("delay", [LATE, -0.008])
def test_the_slack_is_what_a_steady_acceleration_moves_it_by(rng, delay):
    """Of a camera that accelerates from the last frame on, evenly, by as much as it is wont to."""
    T_last, measure = problems.motion(rng, 0.3, 20.0), delay_of()
    lag = loose(measure, late(delay), T_last)
    offs = []
    for a in rng.normal(0, RESTLESS, (4000, 6)):
        # at rest in the middle of the step: what it has moved by since the last frame is nothing
        moved = 0.5 * a * (delay**2 + delay * PERIOD)
        offs.append(se3.adjoint(T_last) @ moved)
    found = np.cov(np.array(offs).T)
    expected = lag.bend**2 * np.linalg.inv(lag.steady / AS_ONE)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.08)


def test_depth_as_old_as_the_last_frame_lies_where_the_velocity_before_puts_it(rng):
    delay = -0.03
    measure = delay_of()
    lag = loose(measure, late(delay))
    assert lag.share == LEAST_SHARE
    s = delay / PERIOD
    assert lag.bend == pytest.approx(0.5 * s**2 + s - 0.5 * LEAST_SHARE, rel=1e-12)
    expected = AS_ONE / ((PERIOD**2 * RESTLESS) ** 2 + (LEAST_SLACK / lag.bend) ** 2)
    np.testing.assert_allclose(lag.steady, np.diag(expected), rtol=1e-9)


def test_depth_of_the_same_instant_lies_where_the_camera_was():
    measure = delay_of()
    assert measure.bend(measure.lag(late(0.0), np.eye(4), PERIOD), late(0.0), PERIOD) == 0
    assert not loose(
        measure, late(), acceleration=1e-3 * RESTLESS**2
    ).steady.size  # a tenth of a px
    lag = measure.lag(late(), np.eye(4), PERIOD)
    assert delay_of("none").bend(lag, late(), PERIOD) == 0


def test_rows_are_off_as_depth_of_their_instants_is():
    samples = SimpleNamespace(pixels=np.array([[9, 0], [9, 240], [9, 480]], np.float32))
    seen = replace(late(0.0), samples=samples)
    fitter = PlaneFitter(problems.VGA, PlanesConfig())
    for rule in ("measured", "none"):
        rules = {"readout": "known", "readout_s": 0.02, "row_slack": rule, "depth_delay": "stamps"}
        config = Config(motion=MotionConfig(**rules))
        registration = Registration(problems.VGA, config.matching, config.registration)
        exposure = Exposure(problems.VGA, config)
        instants = Instants(problems.VGA, config, registration, fitter, exposure)
        for delay in (0.0, 0.01):
            frame = replace(seen.frame, depth_delay=delay)
            this = replace(seen, frame=frame)
            lag = instants.lag(this, None, np.eye(4), PERIOD, np.zeros(6))
            found = instants.slackened(lag, this, PERIOD, RESTLESS**2)
            bends = [-0.105, 0.0, 0.195] if rule == "measured" else []
            np.testing.assert_allclose(found.bends, bends, atol=1e-12)
            assert found.bend == pytest.approx(0.195 if delay else 0.0, abs=1e-12)
            still = instants.slackened(lag, this, PERIOD, 1e-5 * RESTLESS**2)
            assert still is lag
            if rule == "none" and not delay:
                assert found is lag


def loose(measure, seen, T_last=EYE, acceleration=RESTLESS**2):
    lag = measure.lag(seen, T_last, PERIOD)
    return slackened(lag, measure.bend(lag, seen, PERIOD), lag.rows, PERIOD, acceleration)


def start():
    course = Course()
    course.keyframe = SimpleNamespace(T_world_key=np.eye(4))
    return course


def test_the_acceleration_is_that_of_late(rng):
    course = start()
    assert np.array_equal(course.acceleration, HAND**2)
    frames = round(5 * ACCELERATION_S / PERIOD)
    for i in range(frames):
        course.step(np.eye(4), np.eye(4), PERIOD)
        course.last_time = i * PERIOD
    assert np.all(course.acceleration < 0.01 * HAND**2)
    squares = []
    for i in range(frames):
        before = course.velocity
        course.step(np.eye(4), se3.exp(rng.normal(0, RESTLESS) * PERIOD**2), PERIOD)
        course.last_time = (frames + i) * PERIOD
        squares.append(((course.velocity - before) / PERIOD) ** 2)
    of_late = np.array(squares[-30:]).mean(axis=0).reshape(2, 3).mean(axis=1).repeat(3)
    np.testing.assert_allclose(course.acceleration, of_late, rtol=0.5)
    np.testing.assert_allclose(course.acceleration, 2 * RESTLESS**2, rtol=0.6)


def test_what_begins_to_be_seen_on_its_way_does_not_accelerate():
    """Nor is what lies between two steps of a second an acceleration."""
    course, went = start(), se3.exp(np.array([1.0, 0, 0, 0, 2.0, 0]) * PERIOD)
    course.last_time = 0.0
    for i in range(10):
        course.step(np.eye(4), went, PERIOD)
        course.last_time = i * PERIOD
        assert np.all(course.acceleration <= HAND**2)
    before = course.acceleration
    course.step(np.eye(4), np.eye(4), 1.0)
    assert course.acceleration is before


def test_what_was_lost_meanwhile_tells_no_acceleration():
    course = start()
    course.step(np.eye(4), np.eye(4), PERIOD)
    course.last_time, course.losses = 0.0, 3
    course.step(np.eye(4), se3.exp(np.full(6, 0.1)), 4 * PERIOD)
    assert np.array_equal(course.acceleration, HAND**2)


# ------------------------------------------------------------------------------------ sequences


@pytest.fixture(scope="module")
def hand_held():
    """Stairs, seen by a hand, and depth that is 16 ms late by its stamps."""
    clock = Clock(30.0, offset=LATE)
    return problems.rendered(
        "stairs", 60, camera=problems.CAMERA, speed=0.5, seed=3, depth_clock=clock
    )


def follow(clip, *others):
    camera, frames, truth = clip
    odometry = Odometry(camera, Config().with_overrides(others))
    turned, regions = [], []
    for i, frame in enumerate(frames):
        result = odometry.track(frame)
        assert result.status is Status.TRACKED
        if i > 0:
            T_key_cur = se3.inverse(truth[result.keyframe]) @ truth[i]
            e = se3.log(T_key_cur @ se3.inverse(result.T_key_cur))
            turned.append(np.linalg.norm(e[3:]))
            regions.append(e @ np.linalg.solve(result.covariance, e))
    return np.sqrt(np.mean(np.square(turned))), np.median(regions)


def test_late_depth_does_not_turn_the_pose_of_a_hand(hand_held):
    held, _ = follow(hand_held, "motion.depth_slack=none")
    loose, square = follow(hand_held)
    assert loose < 0.75 * held
    assert 1.5 < square < 5.35  # the latter is the median of chi^2 of six


def test_paper_has_depth_and_rows_where_they_are():
    motion = Config.preset("paper").motion
    assert motion.depth_slack == motion.row_slack == "none"
