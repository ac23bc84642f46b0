"""Depth that lies elsewhere, as one, than the camera's velocity puts it."""

from types import SimpleNamespace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config, MatchingConfig, PlanesConfig, RegistrationConfig
from edvo.course import ACCELERATION_S, HAND, Course
from edvo.delay import LEAST_SHARE, LEAST_SLACK, DepthDelay
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, PlaneMap, PlanePoints, move_points
from edvo.registration import AS_ONE, AT_ONCE, Alignment, Registration
from edvo.seen import Seen
from edvo.synthesis.clock import Clock
from edvo.uncertainty import DOUBT, SHARES, Parts, given_way

from . import problems

PERIOD, LATE = 1 / 30, 0.016
RESTLESS = np.array([2.0] * 3 + [5.0] * 3)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def curvature(rng, size=6, rows=40):
    J = rng.normal(size=(rows, size))
    return J.T @ J


# -------------------------------------------------------------------------------- the equations


@pytest.mark.parametrize("moves", [1.0, 1.48, 0.62])
def test_a_step_is_that_of_the_equations_of_pose_and_slack_together(rng, moves):
    edges, A, P = curvature(rng), curvature(rng), curvature(rng, rows=7)
    g_edges, g, slack = rng.normal(size=(3, 6))
    H, b, room = edges.copy(), g_edges.copy(), np.empty((4, 6, 6))
    kernels.give_way(A, g, P, slack, moves, room, H, b)
    whole = np.block([[edges + moves**2 * A, moves * A], [moves * A, A + P]])
    gradient = np.concatenate([g_edges + moves * g, g + P @ slack])
    expected = -np.linalg.solve(whole, gradient)
    step, now = np.empty(6), np.empty(6)
    assert kernels.solve_damped(H, b, 0.0, step)
    np.testing.assert_allclose(step, expected[:6], rtol=1e-7, atol=1e-12)
    kernels.yielded(A, g, P, slack, moves, room, step, now)
    np.testing.assert_allclose(now - slack, expected[6:], rtol=1e-7, atol=1e-12)


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
        lag = self.lag if steady is None else self.lag._replace(steady=steady)
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
    found.lag = lag._replace(T_depth_cam=apart, steady=np.eye(6))
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
    lag = measure.lag(late(delay), T_last, PERIOD)
    lag = measure.slackened(lag, late(delay), PERIOD, RESTLESS**2)
    offs = []
    for a in rng.normal(0, RESTLESS, (4000, 6)):
        # at rest in the middle of the step: what it has moved by since the last frame is nothing
        moved = 0.5 * a * (delay**2 + delay * PERIOD)
        offs.append(se3.adjoint(T_last) @ moved)
    found = np.cov(np.array(offs).T)
    expected = np.linalg.inv(lag.steady / AS_ONE)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.08)


def test_depth_as_old_as_the_last_frame_lies_where_the_velocity_before_puts_it(rng):
    delay = -0.03
    measure = delay_of()
    lag = measure.lag(late(delay), np.eye(4), PERIOD)
    assert lag.share == LEAST_SHARE
    steady = measure.slackened(lag, late(delay), PERIOD, RESTLESS**2).steady
    s = delay / PERIOD
    times = abs(0.5 * s**2 + s - 0.5 * LEAST_SHARE) * PERIOD**2
    expected = AS_ONE / ((times * RESTLESS) ** 2 + LEAST_SLACK**2)
    np.testing.assert_allclose(steady, np.diag(expected), rtol=1e-9)


def test_depth_of_the_same_instant_lies_where_the_camera_was():
    measure = delay_of()
    at_once = measure.lag(late(0.0), np.eye(4), PERIOD)
    assert measure.slackened(at_once, late(0.0), PERIOD, RESTLESS**2) is at_once
    lag = measure.lag(late(), np.eye(4), PERIOD)
    still = measure.slackened(lag, late(), PERIOD, 1e-3 * RESTLESS**2)
    assert still is lag  # by less than a tenth of a pixel
    assert delay_of("none").slackened(lag, late(), PERIOD, RESTLESS**2) is lag


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


def test_paper_has_depth_where_it_is():
    assert Config.preset("paper").motion.depth_slack == "none"
