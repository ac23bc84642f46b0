"""What instants that are not known for sure add to a covariance."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config
from edvo.odometry import Odometry, Status
from edvo.synthesis.renderer import Shutter
from edvo.timing import ENOUGH, LASTING_S, STRIDE, WRONG

from . import problems, twins

PERIOD, FRAMES = 1 / 30, 40
INSTANTS, CELLS = "status.covariance=instants", "status.covariance=cells"


def spd(rng, scale=1.0):
    A = rng.normal(size=(6, 6))
    return scale * (A @ A.T + np.eye(6))


@pytest.mark.parametrize(
    ("readout", "readout_variance", "delay", "delay_variance", "wrong"),
    [
        (0.02, 1e-5, -0.01, 2e-5, 1e-6),
        (0.0, 1e-5, 0.0, 0.0, 0.0),
        (0.02, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 2e-5, 1e-6),
        (0.0, 0.0, 0.01, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_the_part_equals_its_numpy_twin(readout, readout_variance, delay, delay_variance, wrong):
    rng = np.random.default_rng(4)
    H, changes = spd(rng, 100.0), spd(rng, 1e-3)
    by_rows, by_depth = spd(rng, 10.0), spd(rng, 20.0)
    by_rows -= 40 * np.eye(6)  # rows have signs
    T, own, key = se3.exp(rng.normal(0, 0.3, 6)), rng.normal(size=6), rng.normal(size=6)
    times = readout, readout_variance, delay, delay_variance, wrong
    part = np.empty((6, 6))
    assert kernels.instants_part(H, by_rows, by_depth, T, own, key, changes, *times, part)
    wanted = twins.instants_part(H, by_rows, by_depth, T, own, key, changes, *times)
    np.testing.assert_allclose(part, wanted, rtol=1e-9, atol=1e-18)
    assert part.any() == any(times)
    np.testing.assert_array_equal(part, part.T)


def test_where_nothing_constrains_a_pose_instants_add_nothing():
    part, none = np.full((6, 6), np.nan), np.zeros((6, 6))
    given = np.eye(6), np.eye(6), np.eye(4), np.ones(6), np.ones(6), np.eye(6)
    assert not kernels.instants_part(none, *given, 0.02, 1.0, 0.01, 1.0, 1.0, part)
    assert not part.any()


def test_the_changes_of_the_velocity_are_averaged_over_a_while():
    rng = np.random.default_rng(1)
    timing = Odometry(problems.CAMERA)._progress._timing
    velocities = rng.normal(size=(90, 6))
    for k, velocity in enumerate(velocities):
        timing._note(velocity, k * PERIOD, PERIOD)
    steps = np.diff(velocities, axis=0)
    weights = np.exp(-PERIOD / LASTING_S * np.arange(len(steps))[::-1])
    wanted = np.einsum("n,ni,nj->ij", weights, steps, steps) / weights.sum()
    np.testing.assert_allclose(timing._changes, wanted, rtol=1e-9)
    later = 92 * PERIOD  # whatever was in between, lost, blind, or begun anew
    timing._note(velocities[0] + 100.0, later, PERIOD)  # follows on nothing
    np.testing.assert_allclose(timing._changes, wanted, rtol=1e-9)
    timing._note(velocities[0] + 100.0, later + PERIOD, PERIOD)
    assert np.abs(timing._changes).max() < np.abs(wanted).max()


class Stream:
    """Frames of a camera, tracked, with what `Timing` was given for the last one."""

    def __init__(self, *overrides, frames, camera):
        self.odometry = Odometry(camera, Config().with_overrides(overrides))
        self.given = None
        widened = self.odometry._progress._timing.widened

        def recorded(*given):
            self.key, self.given = self.odometry._course.key, given
            return widened(*given)

        self.odometry._progress._timing.widened = recorded
        self.results = [self.odometry.track(frame) for frame in frames]


@pytest.fixture(scope="module")
def rolled():
    """A hand that turns a camera before an office, rows read in 20 ms."""
    return problems.rendered("office", FRAMES, seed=2, shutter=Shutter(readout=0.02), speed=0.6)


def test_it_knows_what_instants_are_believed(rolled):
    camera, frames, _ = rolled
    stream = Stream(frames=frames, camera=camera)
    _, seen, alignment, by_depth, period, velocity = stream.given
    assert period == pytest.approx(PERIOD, abs=2e-3)
    went = stream.odometry._course.velocity
    np.testing.assert_allclose(velocity, went + alignment.faster / period, rtol=1e-12)
    assert alignment.faster.any()
    odometry = stream.odometry
    timing, instants = odometry._progress._timing, odometry._instants
    assert 0.005 < instants.rolling.seconds < 0.033
    by_rows = timing._by_rows(seen, alignment)
    solver, samples = odometry._registration.solver, seen.samples
    few = (samples.pixels[::STRIDE], samples.depths[::STRIDE])
    gradients = stream.key.edges.edges.gradients
    told = [getattr(alignment, n)[::STRIDE] for n in ("matches", "residuals", "trust")]
    every, _, _ = twins.row_equations(
        *few,
        gradients,
        *told,
        camera,
        alignment.T_ref_cur,
        "tukey",
        solver.tuning,
        alignment.sigma_px,
    )
    np.testing.assert_allclose(by_rows, STRIDE * every, rtol=1e-5, atol=1e-3)
    # as depth is what is left of the curvature beside edges
    assert 0 < np.trace(by_depth) < np.trace(alignment.H)
    assert not timing._by_rows(seen, replace(alignment, sigma_px=0.0)).any()
    rolling, depth = instants.rolling.estimate, instants.depth.estimate
    for estimate in (rolling, depth):
        off = estimate.likely - estimate.value
        assert estimate.doubt == pytest.approx(estimate.variance + off * off)
    before, changes = instants.velocity_of(stream.key), timing._changes
    wanted = twins.instants_part(
        alignment.H,
        by_rows,
        by_depth,
        alignment.T_ref_cur,
        velocity,
        before,
        changes,
        instants.rolling.seconds,
        rolling.doubt,
        instants.depth.of(frames[-1].depth_delay),
        depth.doubt,
        WRONG**2 * instants.exposure.squared,
    )
    cells = Stream(CELLS, frames=frames, camera=camera)
    got = stream.results[-1].covariance - cells.results[-1].covariance
    np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-9 * wanted.max())


def test_poses_are_the_same_and_errors_are_where_they_are_said_to_be(rolled):
    camera, frames, truth = rolled
    squares = {}
    for rule in (INSTANTS, CELLS):
        results = Stream(rule, frames=frames, camera=camera).results
        squares[rule] = [
            float(error @ np.linalg.solve(result.covariance, error))
            for result in results
            if result.status is Status.TRACKED and result.covariance is not None
            for T_true in [se3.inverse(truth[result.keyframe]) @ truth[result.index]]
            for error in [se3.log(T_true @ se3.inverse(result.T_key_cur))]
        ]
        if rule == INSTANTS:
            poses = [result.T_world_cam for result in results]
        else:
            np.testing.assert_array_equal(poses, [result.T_world_cam for result in results])
    inside = {rule: np.mean(np.array(squares[rule]) < 10.64) for rule in squares}
    assert len(squares[INSTANTS]) > 30
    assert inside[CELLS] < 0.5
    assert inside[INSTANTS] > 0.7


def test_a_camera_at_rest_is_not_dated_wrong():
    """Whatever is not known of instants, a pose at rest is where it is."""
    frames, _ = problems.sequence(2)
    still = [replace(frames[0], timestamp=k * PERIOD) for k in range(6)]
    noise = np.random.default_rng(0)
    for k, frame in enumerate(still):
        grey = frame.grey.astype(np.int16) + noise.integers(-1, 2, frame.grey.shape)
        still[k] = replace(frame, grey=np.clip(grey, 0, 255).astype(np.uint8))
    with_instants = Stream(frames=still, camera=problems.CAMERA).results[-1].covariance
    without = Stream(CELLS, frames=still, camera=problems.CAMERA).results[-1].covariance
    np.testing.assert_allclose(with_instants, without, rtol=0.2, atol=1e-10)


def test_where_no_velocity_leads_a_covariance_stays_as_it_is(rolled):
    camera, frames, _ = rolled
    stream = Stream(frames=frames[:10], camera=camera)
    later = replace(frames[11], timestamp=frames[11].timestamp + 1.0)
    stream.odometry.track(later)
    covariance, velocity = stream.given[0], stream.given[-1]
    assert velocity is None
    np.testing.assert_array_equal(
        stream.odometry._progress._timing.widened(*stream.given), covariance
    )


def test_what_is_not_known_of_a_keyframe_is_as_it_is_now(rolled, monkeypatch):
    camera, frames, _ = rolled
    stream = Stream(frames=frames, camera=camera)
    alignment = stream.given[2]
    carried = se3.adjoint(alignment.T_ref_cur) @ stream.given[-1]
    parts = []
    for before in (None, carried, np.zeros(6)):
        monkeypatch.setattr(stream.odometry._instants, "velocity_of", lambda _, v=before: v)
        parts.append(stream.odometry._progress._timing.widened(*stream.given) - stream.given[0])
    np.testing.assert_allclose(parts[0], parts[1], rtol=1e-12)
    assert np.trace(parts[2]) > 1.03 * np.trace(parts[0])


def test_late_depth_and_exposures_add_to_it(rolled):
    camera, frames, _ = rolled
    stream = Stream(frames=frames, camera=camera)
    odometry, seen = stream.odometry, stream.given[1]
    usual = odometry._progress._timing.widened(*stream.given)
    late = replace(seen, frame=replace(seen.frame, depth_delay=0.03))
    given = stream.given[0], late, *stream.given[2:]
    assert np.trace(odometry._progress._timing.widened(*given)) > 1.05 * np.trace(usual)
    exposure = odometry._instants.exposure
    assert exposure.squared == pytest.approx(max(exposure.estimate.likely, 0.0))
    exposure.estimate.note(1e12, 1e12 * 0.03**2, PERIOD)
    assert exposure.squared == pytest.approx(0.03**2, rel=1e-3)
    assert np.trace(odometry._progress._timing.widened(*stream.given)) > 1.05 * np.trace(usual)
    exposure.estimate.note(1e15, 1e15 * 0.5**2, PERIOD)
    assert exposure.squared <= 0.05**2  # no camera exposes for so long
    known = Odometry(
        camera,
        Config().with_overrides(["motion.exposure=known", "motion.exposure_s=0.02"]),
    )
    assert known._instants.exposure.squared == pytest.approx(0.02**2)


@pytest.mark.parametrize("rule", ["none", "known"])
def test_what_nobody_asks_for_is_in_no_doubt(rule):
    given = [f"motion.readout={rule}"] + ["motion.readout_s=0.02"] * (rule == "known")
    odometry = Odometry(problems.CAMERA, Config().with_overrides(given))
    assert odometry._instants.rolling.estimate.doubt == 0
    assert odometry._instants.depth.estimate.doubt == pytest.approx(0.01**2)


def test_motions_are_named_by_all_that_is_said_and_followed_by_what_stands(rolled, monkeypatch):
    """What instants add names a motion; keyframes go by the covariance without them."""
    camera, frames, _ = rolled
    odometry = Odometry(camera)
    for frame in frames[:8]:
        odometry.track(frame)
    attended, widened = [], odometry._progress._timing.widened
    attend = odometry._upkeep.attend
    monkeypatch.setattr(
        odometry._upkeep, "attend", lambda *a, **k: (attended.append(a), attend(*a, **k))[1]
    )
    wide = np.diag([1.0, 0, 0, 0, 0, 0])
    monkeypatch.setattr(
        odometry._progress._timing, "widened", lambda C, *more: widened(C, *more) + wide
    )
    result = odometry.track(frames[8])
    assert result.status is Status.DEGRADED
    assert result.degenerate
    assert result.covariance[0, 0] > 1.0
    assert attended[0][3][0, 0] < 1e-3


def test_few_edges_are_all_asked(rolled):
    camera, frames, _ = rolled
    stream = Stream("sampling.count=300", "sampling.max_growth=1", frames=frames[:8], camera=camera)
    seen, alignment = stream.given[1:3]
    assert len(seen.samples) < STRIDE * ENOUGH
    told = [getattr(alignment, name) for name in ("matches", "residuals", "trust")]
    every, _, _ = twins.row_equations(
        seen.samples.pixels,
        seen.samples.depths,
        stream.key.edges.edges.gradients,
        *told,
        camera,
        alignment.T_ref_cur,
        "tukey",
        stream.odometry._registration.solver.tuning,
        alignment.sigma_px,
    )
    by_rows = stream.odometry._progress._timing._by_rows(seen, alignment)
    np.testing.assert_allclose(by_rows, every, rtol=1e-5, atol=1e-3)


def test_the_paper_has_no_covariance():
    assert Config.preset("paper").status.covariance == "none"
    assert Config().status.covariance == "instants"
