"""Images whose rows are not taken at once: unrolled, measured, and what it is worth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.evaluation import evaluate
from edvo.measuring import Moment
from edvo.odometry import Odometry, Status
from edvo.planes import camera_of
from edvo.registration import AT_ONCE, Registration
from edvo.rolling import LARGEST_S, LEAST_S, RollingShutter
from edvo.slack import bend_of
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins

CAMERA = problems.CAMERA
VGA = problems.VGA
READOUT = 0.025
PERIOD = 1 / 30
VELOCITY = np.array([0.4, -0.3, 0.5, 0.3, -0.5, 0.4])


def registration_of(camera, **changes):
    config = Config()
    return Registration(camera, config.matching, config.registration.model_copy(update=changes))


def shutter(seconds=0.0, camera=VGA):
    """One that has measured so much; up to three sigmas of what is expected."""
    rolling = RollingShutter(camera, registration_of(camera).solver, "measured")
    rolling.estimate.note(1e12, 1e12 * seconds, PERIOD)
    return rolling


def rolled(samples, twist, readout, camera=VGA):
    """Samples as a rolling shutter sees them, by a twist that the camera makes in a second."""
    points, pixels = samples.points(camera), samples.pixels
    for _ in range(5):  # the row decides when, and that which row
        rows = (pixels[:, 1].astype(np.float64) / camera.height - 0.5) * readout
        there = np.array(
            [
                (se3.exp(-t * twist) @ np.append(X, 1.0))[:3]
                for t, X in zip(rows, points, strict=True)
            ]
        )
        pixels = camera.project(there).astype(np.float32)
    return EdgePixels(pixels, samples.gradients, there[:, 2].astype(np.float32))


# --------------------------------------------------------------------------------------- kernels


def test_moving_samples_equals_its_numpy_twin():
    rng = np.random.default_rng(0)
    points, rows = rng.normal([0, 0, 2], 0.7, (60, 3)), rng.uniform(-0.5, 0.5, 60)
    T_last, slack = se3.exp([0.3, 0.1, -0.2, 0.1, 0.2, 0.3]), rng.normal(0, 0.1, 6)

    def moved_by(step):
        moved, T = np.empty_like(points), T_last @ se3.exp(step)
        lag = AT_ONCE._replace(T_ref_last=T_last, rows=rows)
        loose = lag._replace(bends=bend_of(rows))
        kernels.unroll_points(points, T, loose, slack, moved)
        own = se3.adjoint(se3.inverse(T)) @ slack
        expected = twins.roll(points, rows, step, rows * (1 + rows) / 2, own)
        np.testing.assert_allclose(moved, expected, atol=1e-9)
        kernels.unroll_points(points, T, lag, slack, moved)  # rows that bend by nothing
        np.testing.assert_allclose(moved, twins.roll(points, rows, step), atol=1e-9)
        whole = [se3.exp(s * step) for s in rows]
        exact = np.array(
            [T[:3, :3] @ X + T[:3, 3] for T, X in zip(whole, points, strict=True)],
        )
        return abs(moved - exact).max()

    step = 0.1 * VELOCITY
    assert moved_by(step) < 0.003
    assert moved_by(step / 10) < moved_by(step) / 80  # right to first order


@pytest.mark.parametrize("typical", [1.5, np.inf])
def test_moving_edges_equals_its_numpy_twin(typical):
    rng = np.random.default_rng(1)
    pixels = rng.uniform((0, 0), (320, 240), (80, 2)).astype(np.float32)
    depths = rng.uniform(0.5, 4, 80).astype(np.float32)
    depths[::5] = 0
    depths[1::20] = 0.001  # would come to lie beside or behind the camera
    depths[2::20] = 0.06
    seconds = 0.08
    rows = (pixels[:, 1].astype(np.float64) / CAMERA.height - 0.5) * seconds
    velocity = 5 * VELOCITY
    pinhole = camera_of(CAMERA)
    moved, moved_depths = np.empty_like(pixels), np.empty_like(depths)
    how = depths, np.float32(typical), seconds, velocity, pinhole
    kernels.unroll_pixels(pixels.ravel(), *how, moved.ravel(), moved_depths)
    wanted, wanted_depths = twins.unroll_pixels(pixels, depths, typical, rows, velocity, CAMERA)
    np.testing.assert_allclose(moved, wanted, atol=1e-3)
    np.testing.assert_allclose(moved_depths, wanted_depths, rtol=1e-5)
    assert np.median(abs(moved - pixels)) > 2
    usual = depths >= 0.5  # what a point of that depth is projected to
    X = CAMERA.backproject(pixels[usual].astype(np.float64), depths[usual].astype(np.float64))
    there = twins.roll(X, rows[usual], velocity)
    np.testing.assert_allclose(moved[usual], CAMERA.project(there), atol=1e-3)
    np.testing.assert_allclose(moved_depths[usual], there[:, 2], rtol=1e-5)
    none, near = depths == 0, depths == np.float32(0.001)
    assert not moved_depths[none].any()
    np.testing.assert_array_equal(moved[near], pixels[near])
    if typical == np.inf:  # turned, but not carried
        rays = CAMERA.backproject(pixels[none].astype(np.float64), np.ones(none.sum()))
        turned = twins.roll(rays, rows[none], np.append(np.zeros(3), velocity[3:]))
        np.testing.assert_allclose(moved[none], CAMERA.project(turned), atol=1e-3)


@pytest.mark.parametrize(("weight", "stride"), [("t", 1), ("huber", 1), ("t", 7)])
def test_the_equations_by_rows_equal_their_numpy_twin(weight, stride):
    rng = np.random.default_rng(2)
    pixels = rng.uniform((0, 0), (320, 240), (90, 2)).astype(np.float32)
    depths = rng.uniform(0.5, 4, 90).astype(np.float32)
    gradients = problems.random_edges(rng, 40).gradients
    matches = rng.integers(-1, 40, 90).astype(np.int32)
    residuals = np.where(matches < 0, np.nan, rng.normal(0, 0.5, 90))
    trust = rng.uniform(0.2, 1.5, 90)
    given = pixels, depths, gradients, matches, residuals, trust
    T = se3.exp(rng.normal(0, 0.1, 6))
    solver = registration_of(CAMERA, weight=weight).solver
    found = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    rule = solver.weight, solver.tuning, 0.4
    kernels.row_equations(*given, camera_of(CAMERA), T, *rule, stride, *found)
    few = (pixels, depths, matches, residuals, trust)
    few = [each[::stride] for each in few]
    expected = twins.row_equations(*few[:2], gradients, *few[2:], CAMERA, T, weight, *rule[1:])
    for got, wanted in zip(found, expected, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-4)


# ------------------------------------------------------------------------------------ unrolling


def test_rows_go_from_the_first_to_the_last_about_the_middle():
    pixels = np.array([[5, 0], [7, 240], [9, 480]], np.float32)
    np.testing.assert_allclose(shutter(0.02).rows(pixels), [-0.01, 0, 0.01], rtol=1e-5)
    np.testing.assert_allclose(shutter(-0.02).rows(pixels), [0.01, 0, -0.01], rtol=1e-5)
    for seconds in (0.0, 0.9 * LEAST_S):
        assert shutter(seconds).rows(pixels).size == 0
    rolling = shutter(0.029)
    rolling.estimate.note(1e14, 1e14 * 0.05, PERIOD)
    assert rolling.seconds == LARGEST_S
    rolling.forget()
    assert rolling.seconds == 0.0


def test_edges_are_put_where_they_are_at_the_instant_of_the_image():
    samples = problems.segments_problem(0, np.eye(4)).samples
    seen = rolled(samples, VELOCITY, 0.02)
    assert np.linalg.norm(seen.pixels - samples.pixels, axis=1).max() > 2
    found = shutter(0.02).unrolled(seen, VELOCITY)
    np.testing.assert_allclose(found.pixels, samples.pixels, atol=0.05)
    np.testing.assert_allclose(found.depths, samples.depths, atol=1e-3)
    assert found.gradients is seen.gradients
    by_column = replace(seen, pixels=np.asfortranarray(seen.pixels))
    np.testing.assert_array_equal(shutter(0.02).unrolled(by_column, VELOCITY).pixels, found.pixels)
    bare = replace(seen, depths=np.zeros_like(seen.depths))
    np.testing.assert_array_equal(
        shutter(0.02).unrolled(bare, VELOCITY, seen.depths).pixels, found.pixels
    )
    assert shutter(0.0).unrolled(seen, VELOCITY) is seen
    nothing = EdgePixels(*(array[:0] for array in (seen.pixels, seen.gradients, seen.depths)))
    assert len(shutter(0.02).unrolled(nothing, VELOCITY)) == 0


def test_edges_without_depth_take_that_of_the_others():
    samples = problems.segments_problem(0, np.eye(4)).samples
    depths = np.full(len(samples), 2.0, np.float32)
    depths[::3] = 0
    rolling = shutter(0.02)
    found = rolling.unrolled(samples, VELOCITY, depths)
    wanted = rolling.unrolled(samples, VELOCITY, np.full_like(depths, 2.0))
    np.testing.assert_array_equal(found.pixels, wanted.pixels)
    assert not found.depths[::3].any()


def test_a_depth_of_next_to_nothing_leaves_an_edge_in_the_image():
    """Where depth is far too small, edges far outside would take all memory to index."""
    samples = problems.segments_problem(0, np.eye(4)).samples
    near = replace(samples, depths=np.full(len(samples), 1e-6, np.float32))
    found = shutter(0.02).unrolled(near, 5 * VELOCITY)
    np.testing.assert_array_equal(found.pixels, near.pixels)


def problem_of(seed, step, readout):
    """Samples seen row by row, of a camera that makes a step of a frame's time, and the truth."""
    T_last = problems.motion(np.random.default_rng(seed), 0.05, 3.0)
    T = T_last @ se3.exp(step)
    problem = problems.segments_problem(seed, T)
    return problem, T_last, rolled(problem.samples, step / PERIOD, readout)


def test_a_registration_finds_the_pose_of_the_middle_row():
    step = np.array([0.01, -0.01, 0.012, 0.012, -0.015, 0.01])
    registration = registration_of(VGA)
    for seed in range(3):
        problem, T_last, seen = problem_of(seed, step, READOUT)
        keyframe = registration.index(problem.reference)

        def error(lag, keyframe=keyframe, seen=seen, T_last=T_last, problem=problem):
            found = registration.align(keyframe, seen, T_last[None], lag=lag)
            return problems.error(problem.T_ref_cur, found.T_ref_cur)

        rows = shutter(READOUT).rows(seen.pixels) / PERIOD
        metres, degrees = error(AT_ONCE._replace(T_ref_last=T_last, rows=rows))
        assert metres < 3e-4
        assert degrees < 0.01
        assert error(AT_ONCE)[0] > 10 * metres
        assert error(AT_ONCE)[1] > 10 * degrees


# ------------------------------------------------------------------------------------ measuring


def moments(registration, rolling, seed=0, count=20):
    """Frames of one keyframe whose velocity changes, registered by what is known by then."""
    rng = np.random.default_rng(seed)
    keyframe = None
    for _ in range(count):
        step = rng.normal(0, 0.008, 6)
        problem, T_last, seen = problem_of(seed, step, READOUT)
        keyframe = keyframe or SimpleNamespace(edges=registration.index(problem.reference))
        lag = AT_ONCE._replace(T_ref_last=T_last, rows=rolling.rows(seen.pixels) / PERIOD)
        found = registration.align(keyframe.edges, seen, T_last[None], lag=lag)
        velocity = step / PERIOD
        seen = SimpleNamespace(samples=rolling.unrolled(seen, velocity))
        yield Moment(keyframe, seen, found, PERIOD, velocity, velocity)


def test_the_readout_shows_in_how_misfits_by_rows_change_with_velocity():
    registration = registration_of(VGA)
    rolling = RollingShutter(VGA, registration.solver, "measured")
    seconds = []
    for moment in moments(registration, rolling):
        seconds.append(rolling.seconds)
        rolling.learn(moment)
    assert rolling.seconds == pytest.approx(READOUT, rel=0.1)
    assert seconds[:2] == [0.0, 0.0]  # a change takes two


@pytest.mark.parametrize("what", ["loose", "distance", "none"])
def test_nothing_is_learned_where_nothing_can_be(what):
    changes = {"residual": "distance"} if what == "distance" else {}
    registration = registration_of(VGA, **changes)
    rule = "none" if what == "none" else "measured"
    rolling = RollingShutter(VGA, registration.solver, rule)
    for moment in moments(registration, rolling):
        if what == "loose":
            loose = moment.alignment.H.copy()
            loose[1] = loose[:, 1] = 0.0
            moment = replace(moment, alignment=replace(moment.alignment, H=loose))
        rolling.learn(moment)
    assert rolling.seconds == 0.0


def test_what_was_made_up_for_is_that_of_the_registration():
    """Though another readout is believed by now."""
    registration = registration_of(VGA)
    rolling = shutter(0.01)
    *_, moment = moments(registration, rolling, count=2)
    assert rolling._made_up(moment) == pytest.approx(0.01, rel=1e-6)
    rolling.forget()
    assert rolling._made_up(moment) == pytest.approx(0.01, rel=1e-6)
    *_, at_once = moments(registration, rolling, count=2)
    assert rolling._made_up(at_once) == 0.0


# ------------------------------------------------------------------------------------- sequences


def clip(readout, frames=60):
    recipe = make_recipe(
        "texture_near",
        frames=frames,
        camera=CAMERA,
        speed=0.5,
        shutter=Shutter(exposure=0.0, steps=1, readout=readout),
        seed=3,
    )
    source = SyntheticSource(recipe)
    return [source.read(i).frame for i in range(frames)], source.ground_truth


@pytest.fixture(scope="module")
def row_by_row():
    return clip(READOUT)


def follow(frames, truth, rule, *others):
    given = f"motion.readout={rule}", "status.torn=ignore"  # which rows that are late make them
    given += others
    odometry = Odometry(CAMERA, Config().with_overrides(given))
    results = [odometry.track(frame) for frame in frames]
    assert {result.status for result in results} == {Status.TRACKED}
    return evaluate(truth, odometry.trajectory, len(frames)).rpe.rmse, odometry


def test_a_readout_is_measured_and_made_up_for(row_by_row):
    frames, truth = row_by_row
    at_once, _ = follow(frames, truth, "none")
    rmse, odometry = follow(frames, truth, "measured")
    assert 0.012 < odometry._instants.rolling.seconds < 0.038
    assert rmse < 0.85 * at_once
    odometry.reset()
    assert odometry._instants.rolling.seconds == 0.0


def test_how_a_hand_accelerates_within_an_image_does_not_move_the_pose(row_by_row):
    given = "known", f"motion.readout_s={READOUT}"
    held, _ = follow(*row_by_row, *given, "motion.row_slack=none")
    loose, _ = follow(*row_by_row, *given)
    assert loose < 0.75 * held


def test_where_all_rows_are_taken_at_once_no_readout_is_found():
    frames, truth = clip(0.0)
    at_once, _ = follow(frames, truth, "none")
    rmse, odometry = follow(frames, truth, "measured")
    assert abs(odometry._instants.rolling.estimate.value) < 0.001
    assert abs(rmse - at_once) < 0.1 * at_once


def test_paper_takes_all_rows_as_simultaneous():
    assert Config.preset("paper").motion.readout == "none"
