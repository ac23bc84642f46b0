"""What edges err by together, as the frames of late show it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edvo.config import Config, PlanesConfig, RegistrationConfig
from edvo.edges import EdgePixels
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, PlaneMap, PlanePoints
from edvo.registration import Alignment, Registration
from edvo.sharing import FAIR, MEMORY_S, SharedErrors

from . import problems

MOST = PlanesConfig().edge_doubt_px
SIGMA = 0.1
PER_CELL = 16
FIXED = "planes.edge_doubt_rule=fixed"


def shared_errors(**changes):
    config = Config(planes=PlanesConfig(**changes))
    solver = Registration(problems.VGA, config.matching, RegistrationConfig(weight="none")).solver
    return SharedErrors(problems.VGA, config, solver)


def edges(per_cell=PER_CELL, spread=math.pi):
    """So many edges in each cell of 40 px, with normals that differ by up to ``spread``."""
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid(np.arange(16), np.arange(12)), -1).reshape(-1, 2) * 40.0
    pixels = (
        np.repeat(corners, per_cell, axis=0) + rng.uniform(1, 39, (192 * per_cell, 2))
    ).astype(np.float32)
    angles = rng.uniform(-spread, spread, len(pixels))
    gradients = np.column_stack((np.cos(angles), np.sin(angles))).astype(np.float32)
    return EdgePixels(pixels, gradients, np.zeros(len(pixels), np.float32))


def cell_of(reference):
    return (reference.pixels[:, 1] // 40 * 16 + reference.pixels[:, 0] // 40).astype(int)


def found(residuals):
    """A registration that matched the k-th sample to the k-th edge."""
    none = np.zeros(0)
    return Alignment(
        T_ref_cur=np.eye(4),
        H=np.eye(6),
        matches=np.arange(len(residuals), dtype=np.int32),
        residuals=residuals,
        trust=np.ones(len(residuals)),
        pixels=none.astype(np.float32),
        references=none.astype(np.float32),
        inliers=len(residuals),
        agreeing=len(residuals),
        sigma_px=SIGMA,
        plane_points=0,
        plane_inliers=0,
        plane_area=0.0,
        sigma_depth=1.0,
        depth_balance=0.0,
        cost=0.0,
        iterations=1,
        converged=True,
        reason="",
        history=none,
    )


def after(reference, residuals, seconds=1.0, **changes):
    errors = shared_errors(**changes)
    errors.note(reference, found(residuals), seconds)
    return errors.px


def test_what_is_independent_is_not_shared():
    reference, rng = edges(), np.random.default_rng(1)
    assert after(reference, rng.normal(0, SIGMA, len(reference))) < 0.3 * SIGMA


@pytest.mark.parametrize("spread", [0.0, math.pi])
def test_what_a_cell_is_off_by_is_found(spread):
    """Cells are off by a shift each, which their edges have in common."""
    reference, rng = edges(spread=spread), np.random.default_rng(2)
    own, shift = 0.06, 0.08
    shifts = rng.normal(0, shift, (192, 2))[cell_of(reference)]
    residuals = (shifts * reference.gradients).sum(axis=1) + rng.normal(0, own, len(reference))
    total = own**2 + shift**2
    # normals all alike: each pair of a cell agrees; in all directions: half as much in the mean
    factor = 1 + (PER_CELL - 1) * shift**2 / total * (1.0 if spread == 0 else 0.5)
    expected = SIGMA * math.sqrt(factor - 1)
    assert after(reference, residuals) == pytest.approx(expected, rel=0.15)


def test_it_is_bounded():
    reference = edges(spread=0.0)
    residuals = np.full(len(reference), 0.1)
    assert SIGMA * math.sqrt(PER_CELL - 1) < MOST
    assert after(reference, residuals) == pytest.approx(SIGMA * math.sqrt(PER_CELL - 1))
    assert after(reference, residuals, edge_doubt_px=0.2) == 0.2


def test_where_cells_hold_one_edge_nothing_is_told():
    reference = edges(per_cell=1)
    assert after(reference, np.random.default_rng(1).normal(0, SIGMA, len(reference))) == MOST
    assert after(reference, np.zeros(len(reference))) == MOST


def test_a_rule_keeps_it():
    reference = edges()
    residuals = np.random.default_rng(1).normal(0, SIGMA, len(reference))
    assert after(reference, residuals, edge_doubt_rule="fixed") == MOST
    assert after(reference, residuals, weight=0.0) == MOST


def test_matches_that_are_missing_or_outliers_do_not_count():
    reference = edges(per_cell=2 * PER_CELL)
    residuals = np.random.default_rng(1).normal(0, SIGMA, len(reference))
    some = found(residuals)
    none = np.arange(len(reference)) % 2 == 0
    spoilt = replace(
        some,
        matches=np.where(none, -1, some.matches).astype(np.int32),
        residuals=np.where(none, np.nan, residuals),
    )
    errors = shared_errors()
    errors.note(reference, spoilt, 1.0)
    assert errors.px < 0.5 * SIGMA
    solver = Registration(problems.VGA, Config().matching, RegistrationConfig()).solver
    robust = SharedErrors(problems.VGA, Config(), solver)
    robust.note(reference, replace(some, residuals=np.where(none, 10.0, residuals)), 1.0)
    assert robust.px < 0.5 * SIGMA


def test_it_is_a_mean_of_late():
    reference = edges(spread=0.0)
    apart = np.random.default_rng(1).normal(0, SIGMA, len(reference))
    together = np.full(len(reference), SIGMA)
    errors = shared_errors()
    errors.note(reference, found(together), 0.0)  # the first one is taken whole
    first = errors.px
    for _ in range(3):
        errors.note(reference, found(apart), MEMORY_S / 3)
    later = errors.px
    # the factor above 1 is the square of it
    assert (later / first) ** 2 == pytest.approx((2 / 3) ** 3, rel=0.05)
    errors.note(reference, found(apart), 10 * MEMORY_S)  # after a gap only the last counts
    assert errors.px < 0.3 * SIGMA
    errors.forget()
    assert errors.px == MOST


def wall(shared, own=0.3, seed=0):
    """Points over the whole image, off a wall by noise, and by a shift for each cell."""
    rng = np.random.default_rng(seed)
    camera = problems.VGA
    v, u = (part.ravel() for part in np.mgrid[8:480:16, 8:640:16])
    off = rng.normal(0, own, len(u)) + rng.normal(0, shared, 12)[v // 160 * 4 + u // 160]
    sigma = np.full(len(u), 0.01)
    X = camera.backproject(np.column_stack([u, v]).astype(float), np.full(len(u), 2.0))
    X[:, 2] += off * sigma
    normals = np.tile([0.0, 0.0, 1.0], (len(u), 1))
    planes = PlaneMap(np.tile([0.0, 0.0, 1.0], (60 * 80, 1)), np.full(60 * 80, 2.0), 60, 80, 8.0)
    return planes, PlanePoints(X, normals, sigma, 16.0), PlaneFitter(camera, PlanesConfig()).term


def most_after(shared, seconds=(0.03,) * 12, **changes):
    reference, rng = edges(), np.random.default_rng(1)
    residuals = rng.normal(0, SIGMA, len(reference))
    errors = shared_errors(**changes)
    for k, each in enumerate(seconds):
        planes, points, term = wall(shared, seed=k)
        sigma_depth = math.hypot(0.3, shared)
        seen = replace(
            found(residuals), depth_balance=1.0, sigma_depth=sigma_depth, plane_points=1200
        )
        errors.note(reference, seen, each, planes, points, term)
    return errors.most


def test_depth_that_errs_by_itself_counts_as_before():
    assert most_after(0.0) == pytest.approx(FAIR, rel=0.25)


def test_depth_that_errs_together_counts_less():
    """Two thirds of the variance are the same for the hundred points of a cell."""
    share = 0.4**2 / (0.3**2 + 0.4**2)
    assert most_after(0.4) == pytest.approx(FAIR / (1 + 99 * share), rel=0.4)
    assert most_after(0.4) < most_after(0.1) < most_after(0.0)


def test_what_depth_shares_is_not_told_by_few_frames_after_a_gap_nor_by_another_rule():
    assert most_after(0.4, (0.03,) * 12 + (0.7,)) == math.inf
    assert most_after(0.4, (0.03,) * 8) == math.inf
    assert most_after(0.4, ()) == math.inf
    assert most_after(0.4, depth_doubt_rule="none") == math.inf
    assert most_after(0.4, weight=0.0) == math.inf


def test_depth_never_counts_more_than_that():
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA)
    for frame in frames[:2]:
        odometry.track(frame)
    key, front_end = odometry._course.keyframe, odometry._front_end
    seen, free = front_end.see(frames[2], 2), odometry._fitter.term

    def balance(most):
        return odometry._registration.align(
            key.edges,
            seen.samples,
            np.eye(4)[None],
            key.planes,
            seen.points,
            free._replace(most=most),
        ).depth_balance

    assert balance(math.inf) > 1
    assert balance(100 * balance(math.inf)) == balance(math.inf)
    assert balance(0.5) == 0.5


def test_depth_that_errs_together_counts_less_in_a_run():
    """A wave that stands in the depth image, as that of a lens, whatever the camera looks at."""
    frames, _ = problems.sequence(30)
    v, u = np.mgrid[: problems.CAMERA.height, : problems.CAMERA.width]
    rng = np.random.default_rng(0)
    wave = [
        1 + 0.01 * np.sin(u / 70 + a) * np.sin(v / 70 + b) for a, b in rng.uniform(0, 6, (30, 2))
    ]
    bent = [
        replace(f, depth=(f.depth * w).astype(np.float32))
        for f, w in zip(frames, wave, strict=True)
    ]
    balances = []
    for rule in ("measured", "none"):
        config = Config().with_overrides([f"planes.depth_doubt_rule={rule}"])
        odometry = Odometry(problems.CAMERA, config)
        results = [odometry.track(frame) for frame in bent]
        balances.append(np.array([r.alignment.depth_balance for r in results[1:]]))
    np.testing.assert_array_equal(balances[0][:5], balances[1][:5])  # as long as it is not known
    assert np.median(balances[0][15:]) < 0.7 * np.median(balances[1][15:])


def test_what_depth_shares_is_forgotten():
    reference, rng = edges(), np.random.default_rng(1)
    seen = replace(
        found(rng.normal(0, SIGMA, len(reference))),
        depth_balance=1.0,
        sigma_depth=0.5,
        plane_points=1200,
        plane_inliers=1200,
    )
    errors = shared_errors()
    for forget in (errors.interrupt, errors.forget):
        for k in range(12):
            errors.note(reference, seen, 0.03, *wall(0.4, seed=k))
        free = wall(0.0)[2]
        assert errors.term(free, 0.1).most == errors.most < math.inf
        assert errors.term(free, 2 * MEMORY_S).most == math.inf  # that was long ago
        forget()
        assert errors.most == math.inf


def track(*overrides, count=12):
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames[:count]]
    assert all(result.status is Status.TRACKED for result in results)
    return odometry, results


def test_depth_counts_less_where_edges_err_by_themselves():
    """The first frames are registered alike; then the textured room shows its edges."""
    _, fixed = track(FIXED)
    odometry, measured = track()
    balances = [[r.alignment.depth_balance for r in rs[1:]] for rs in (fixed, measured)]
    assert balances[0][0] == balances[1][0]
    assert np.median(balances[1][3:]) < 0.8 * np.median(balances[0][3:])
    odometry.reset()
    frames, _ = problems.sequence(30)
    again = [odometry.track(frame) for frame in frames[:12]]
    for a, b in zip(again, measured, strict=True):
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)


@pytest.mark.parametrize("without", ["planes.edge_doubt_px=0", "planes.weight=0"])
def test_without_doubt_the_rule_does_not_matter(without):
    for a, b in zip(track(without)[1], track(without, FIXED)[1], strict=True):
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)
