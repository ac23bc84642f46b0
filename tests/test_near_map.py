"""Edges that are looked up: near, turned alike, and enough to bring a far start home."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.config import MatchingConfig, RegistrationConfig
from edvo.edges import EdgePixels
from edvo.matching import NEAR_CELL_PX, Criterion, EdgeIndex
from edvo.registration import Registration

from . import problems, twins
from .test_kernels import Warp, both

ROBUST = Criterion(0.7, 640, 30.0).compile()
ALIKE = (0, 1, 7)  # directions that count as those of an edge


@pytest.fixture
def index() -> EdgeIndex:
    return EdgeIndex(problems.segments_problem(5, np.eye(4)).reference)


def parts(near: kernels.NearMap) -> tuple[np.ndarray, np.ndarray]:
    """How far off, in quarters of a cell, and which edge; for each cell and direction."""
    keys = near.keys.reshape(near.rows, near.cols, kernels.DIRECTIONS).astype(np.int64)
    return keys >> kernels.EDGE_BITS, keys & ((1 << kernels.EDGE_BITS) - 1)


def test_ways_are_those_of_the_twin(index: EdgeIndex) -> None:
    points = index.grid.points
    shape = index.near.rows, index.near.cols, kernels.DIRECTIONS
    near, ways = both(
        "build_near_map",
        lambda: kernels.build_near_map(index.grid, NEAR_CELL_PX),
        lambda: twins.near_ways(
            points[:, :2], points[:, 2:], (index.grid.left, index.grid.top), NEAR_CELL_PX, shape
        ),
    )
    np.testing.assert_array_equal(parts(near)[0], ways)


def test_an_edge_looked_up_is_turned_alike_and_hardly_farther_than_the_nearest(
    index: EdgeIndex,
) -> None:
    points = index.grid.points
    directions = twins.directions_of(points[:, 2:])
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(400):
        u, v = rng.uniform(-20, 660), rng.uniform(-20, 500)  # some beside the image
        gu, gv = problems.random_edges(rng, 1).gradients[0]
        k = kernels.near_edge(index.near, u, v, gu, gv)
        direction = twins.directions_of(np.array([[gu, gv]], np.float32))[0]
        alike = np.isin((directions - direction) % 8, ALIKE)
        if k == kernels.NO_MATCH:
            assert not alike.any()
            continue
        assert alike[k]
        away = np.hypot(points[:, 0] - u, points[:, 1] - v)
        inside = index.grid.left <= u <= points[:, 0].max()
        inside &= index.grid.top <= v <= points[:, 1].max()
        if inside:  # both ends within a cell, and steps to 8 neighbours err by 8 %
            assert away[k] <= 1.08 * away[alike].min() + 2.5 * NEAR_CELL_PX
            found += 1
    assert found > 100


def test_residuals_at_the_stage_of_looking_up_are_those_of_the_edges_looked_up() -> None:
    rng = np.random.default_rng(2)
    problem = problems.segments_problem(3, problems.motion(rng), outliers=0.2)
    warp = Warp(problem, ROBUST)
    warp.nearby, warp.stage = warp.index.near, kernels.LOOK_UP
    T = problem.T_ref_cur @ problems.motion(rng, 0.02, 1.0)
    residuals = warp(T)
    _, pixels, seen = twins.warp(warp.points, problem.camera, T)
    expected, edges = [], []
    for (u, v), (gu, gv), is_seen in zip(pixels, problem.samples.gradients, seen, strict=True):
        k = kernels.near_edge(warp.index.near, u, v, gu, gv) if is_seen else kernels.NO_MATCH
        point = warp.index.grid.points[k].astype(np.float64)
        if k >= 0 and (u - point[0]) ** 2 + (v - point[1]) ** 2 > ROBUST.limit:
            k = kernels.NO_MATCH
        edges.append(k)
        if k >= 0:
            expected.append((u - point[0]) * point[2] + (v - point[1]) * point[3])
    np.testing.assert_array_equal(warp.state.edge, edges)
    np.testing.assert_allclose(residuals, expected, atol=1e-9)


def test_matches_are_the_best_whatever_was_looked_up_before() -> None:
    rng = np.random.default_rng(4)
    problem = problems.segments_problem(4, problems.motion(rng), outliers=0.3)
    warp = Warp(problem, ROBUST)
    warp.nearby = warp.index.near
    for size in (0.1, 0.05, 0.01, 1e-3):
        T = problem.T_ref_cur @ problems.motion(rng, size, 60 * size)
        warp.stage = kernels.LOOK_UP
        warp(T)
        warp.stage = kernels.ROBUST
        warp.state.bound[:] = 0  # as a stage begins
        warp(T)
        warp.check(T)


def registration(**changes: int) -> Registration:
    return Registration(problems.VGA, MatchingConfig(), RegistrationConfig(**changes))


def test_a_far_start_leads_to_where_a_near_one_does() -> None:
    far = registration()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        truth = problems.motion(rng, 0.02, 1.0)
        problem = problems.segments_problem(seed, truth, outliers=0.1, count=1500, segments=60)
        index = far.index(problem.reference)
        off = (truth @ se3.exp([0.02, 0.01, 0, 0, np.radians(1.2), 0]))[None]
        alignment = far.align(index, problem.samples, off, far=True)
        near = far.align(index, problem.samples, truth[None])
        assert max(problems.error(near.T_ref_cur, alignment.T_ref_cur)) < 1e-3
        steps = alignment.steps()
        stages = [(step.looked_up, step.robust) for step in steps]
        assert stages == sorted(stages, reverse=True)
        assert {(True, False), (False, False)} == set(stages)  # no edge was in doubt any more
        assert max(step.matches for step in steps if step.looked_up) <= 375


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_what_is_left_to_go_is_the_rest_of_a_geometric_series(share: float) -> None:
    steps = 3.0 * share ** np.arange(400)
    for k in (1, 4):
        left = kernels.left_to_go(steps[k], steps[k - 1])
        assert left == pytest.approx(steps[k + 1 :].sum(), rel=1e-9)
    assert kernels.left_to_go(1.0, 1.0) == np.inf == kernels.left_to_go(1.0, 0.0)


def far_problem(
    seed: int, metres: float, degrees: float
) -> tuple[problems.Problem, NDArray[np.float64]]:
    """Edges, half of which are elsewhere, and a start that is far off."""
    truth = problems.motion(np.random.default_rng(seed), metres, degrees)
    problem = problems.segments_problem(seed, truth, outliers=0.5, count=1500, segments=60)
    return problem, np.eye(4)[None]


def test_where_looking_up_does_not_converge_the_robust_criterion_has_its_turn() -> None:
    problem, start = far_problem(3, 0.1, 5.0)
    brief = registration(max_iterations=4)
    found = brief.align(brief.index(problem.reference), problem.samples, start, far=True)
    assert [step.looked_up for step in found.steps()] == [True, True, False, False]
    assert found.steps()[2].robust


def test_a_far_registration_ends_as_soon_as_little_is_left() -> None:
    sooner = 0
    for seed in range(6):
        problem, start = far_problem(seed, 0.05, 2.0)
        brief, long = (
            found.align(found.index(problem.reference), problem.samples, start, far=True)
            for found in (registration(), registration(far_leave_px=0))
        )
        assert brief.iterations <= long.iterations
        sooner += brief.iterations < long.iterations
        *_, before, last = [step.step_px for step in brief.steps()]
        if last > 0.03 and brief.converged and np.isnan(brief.history[-1, 7]):
            assert last**2 / (before - last) < 0.08
    assert sooner > 0


def test_a_far_registration_leaps_once_where_a_step_is_rejected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Matches that change all at once raise the cost a little: beyond that it may fall again."""
    monkeypatch.setattr(kernels, "align", kernels.align.py_func)
    monkeypatch.setattr(kernels, "stretch_step", lambda *_: False)  # that has rejections, too
    leaps = {False: 0, True: 0}
    for seed in range(6):
        problem, start = far_problem(seed, 0.15, 8.0)
        for is_far in leaps:
            found = registration()
            index = found.index(problem.reference)
            steps = found.align(index, problem.samples, start, far=is_far).steps()
            same = [
                not one.accepted and other.step_px == pytest.approx(one.step_px, rel=1e-5)
                for one, other in pairwise(steps)
            ]
            costs = [step.trial_cost for step in steps]
            first = [k for k in range(len(same)) if same[k] and not (k and same[k - 1])]
            for k in first:
                leaps[is_far] += costs[k + 1] != costs[k]
                if k + 1 < len(same) and same[k + 1]:  # the leap was rejected, too
                    assert costs[k + 2] == costs[k]
    assert leaps[True] > 0 == leaps[False]


@pytest.mark.parametrize("count", [40, 376, 749, 750, 1124, 1500])
def test_no_stage_is_left_with_matches_of_samples_that_it_does_not_take(count: int) -> None:
    problem = problems.segments_problem(1, np.eye(4), count=count)
    found = registration(first_samples=400)
    alignment = found.align(
        found.index(problem.reference), problem.samples, np.eye(4)[None], far=True
    )
    assert alignment.converged
    assert max(problems.error(np.eye(4), alignment.T_ref_cur)) < 1e-3
    for step in alignment.steps():
        if step.looked_up:
            assert step.matches <= -(-count // max(count // 375, 1))
        elif step.robust:
            assert step.matches <= -(-count // max(count // 400, 1))


@pytest.mark.parametrize("criterion", ["robust-then-normal", "robust", "normal"])
def test_edges_are_looked_up_before_any_criterion(criterion: str) -> None:
    far = Registration(problems.VGA, MatchingConfig(criterion=criterion), RegistrationConfig())
    truth = problems.motion(np.random.default_rng(3), 0.02, 1.0)
    problem = problems.segments_problem(3, truth, count=1500, segments=60)
    index = far.index(problem.reference)
    found = far.align(index, problem.samples, np.eye(4)[None], far=True)
    assert max(problems.error(truth, found.T_ref_cur)) < 1e-3
    assert found.steps()[0].looked_up


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_exact_matches_follow_however_few_the_iterations(count: int) -> None:
    problem = problems.segments_problem(2, problems.motion(np.random.default_rng(2)), count=1500)
    far = registration(max_iterations=count)
    index = far.index(problem.reference)
    found = far.align(index, problem.samples, np.eye(4)[None], far=True)
    assert sum(step.looked_up for step in found.steps()) <= count // 2
    exact = twins.warp_and_match(
        problem.reference,
        problem.samples.points(problem.camera),
        problem.samples.gradients,
        problem.camera,
        found.T_ref_cur,
        ROBUST,
    )
    same = found.matches == exact.matches
    assert same.mean() > 0.8  # the last step moved some of them on


def test_without_samples_to_look_up_a_far_registration_is_a_near_one() -> None:
    problem = problems.segments_problem(2, problems.motion(np.random.default_rng(2)))
    plain = registration(coarse_samples=0, far_leave_px=0)
    index = plain.index(problem.reference)
    start = np.eye(4)[None]
    far, near = (plain.align(index, problem.samples, start, far=is_far) for is_far in (True, False))
    np.testing.assert_array_equal(far.T_ref_cur, near.T_ref_cur)
    assert not any(step.looked_up for step in far.steps())


def test_what_cannot_be_looked_up_is_searched_for() -> None:
    """A map that knows of no edge leaves the start as it is."""
    problem = problems.segments_problem(2, problems.motion(np.random.default_rng(2)))
    far = registration()
    index = far.index(problem.reference)
    empty = index.near._replace(keys=np.full_like(index.near.keys, kernels.NOWHERE))
    index._near = empty
    start = np.eye(4)[None]
    found = far.align(index, problem.samples, start, far=True)
    np.testing.assert_array_equal(
        found.T_ref_cur, far.align(index, problem.samples, start).T_ref_cur
    )


def test_of_no_edges_none_is_near() -> None:
    nothing = EdgePixels(*(np.empty(s, np.float32) for s in ((0, 2), (0, 2), 0)))
    near = EdgeIndex(nothing).near
    assert (near.keys == kernels.NOWHERE).all()
    assert kernels.near_edge(near, 3.0, 4.0, 1.0, 0.0) == kernels.NO_MATCH
