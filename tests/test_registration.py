from dataclasses import replace

import numpy as np
import pytest

from edvo import kernels, robust, se3
from edvo.config import Config, MatchingConfig, RegistrationConfig
from edvo.edges import EdgePixels
from edvo.matching import Criterion
from edvo.registration import REASONS, Registration

from . import problems, twins

TIGHT = {"stop_px": 1e-4, "stop_decrease": 0.0}


def register(problem, *starts, matching=None, floor_px=0.0, **changes):
    """Align the samples of a problem from some starts, the identity where none is given."""
    registration = Registration(
        problem.camera,
        matching or MatchingConfig(),
        RegistrationConfig(**{"weight": "t", **changes}),
    )
    index = registration.index(problem.reference)
    starts = np.array(starts or [np.eye(4)])
    return registration.align(index, problem.samples, starts, first_sigma_px=floor_px)


def moved(seed, translation=0.05, rotation_deg=2.0, **options):
    rng = np.random.default_rng(seed)
    T = problems.motion(rng, translation, rotation_deg)
    return problems.segments_problem(seed, T, **options)


def rails(T_ref_cur):
    """Level lines in a plane that faces the reference, and a few plumb ones."""
    across, down = np.linspace(150, 490, 340), np.linspace(150, 330, 30)
    level = [(u, v, 0, 1) for v in np.linspace(100, 380, 8) for u in across]
    plumb = [(u, v, 1, 0) for u in (160, 250, 390, 470) for v in down]
    edges = np.array(level + plumb, np.float32)
    pixels, gradients, camera = edges[:, :2], edges[:, 2:], problems.VGA
    reference = EdgePixels(pixels, gradients, np.full(len(edges), 1.5, np.float32))
    T = se3.inverse(T_ref_cur)
    points = reference.points(camera) @ T[:3, :3].T + T[:3, 3]
    seen = points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    samples = EdgePixels(seen.astype(np.float32), gradients.copy(), points[:, 2].astype(np.float32))
    return problems.Problem(camera, reference, samples.every(4), T_ref_cur)


def straight(rng, planes=(1.0,), n=60):
    """Edges and samples on vertical lines in planes that face the camera."""
    u = np.repeat(rng.uniform(100, 540, 6), n).astype(np.float32)
    v = np.tile(np.linspace(60, 420, n), 6).astype(np.float32)
    pixels = np.column_stack((u, v))
    gradients = np.tile(np.array([[1, 0]], np.float32), (len(u), 1))
    depths = np.resize(np.array(planes, np.float32), len(u))
    return problems.Problem(
        problems.VGA,
        EdgePixels(pixels, gradients, np.zeros_like(depths)),
        EdgePixels(pixels, gradients, depths),
        np.eye(4),
    )


# ------------------------------------------------------------------------------------- jacobian


@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_jacobian_by_finite_differences(signed, seed):
    problem = moved(seed, outliers=0.3)
    points = problem.samples.points(problem.camera)
    T = problem.T_ref_cur @ problems.motion(np.random.default_rng(seed), 0.02, 1.0)
    warped = twins.warp_and_match(
        problem.reference,
        points,
        problem.samples.gradients,
        problem.camera,
        T,
        Criterion(0.7, 640, 30.0).compile(),
        signed,
    )
    edges = problem.reference.pixels[warped.matches[warped.matched]]

    def residuals(xi):
        """With the matches fixed, and a left perturbation of T."""
        _, pixels, _ = twins.warp(points, problem.camera, se3.exp(xi) @ T)
        F = pixels[warped.matched] - edges
        return (F * warped.normals).sum(axis=1) if signed else np.linalg.norm(F, axis=1)

    np.testing.assert_allclose(residuals(np.zeros(6)), warped.residuals, atol=1e-9)
    h = 1e-6
    numeric = np.column_stack([(residuals(h * e) - residuals(-h * e)) / (2 * h) for e in np.eye(6)])
    J = twins.jacobian(warped, problem.camera)
    # the distance has no derivative where it is nothing
    far = np.abs(warped.residuals) > (0 if signed else 0.05)
    assert far.sum() > 100
    np.testing.assert_allclose(J[far], numeric[far], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("residual", ["divergence", "distance"])
def test_H_is_that_of_the_twin(residual):
    """J^T W J of the last look at the images, against finite differences by way of the twin."""
    problem = moved(1, outliers=0.2)
    matching = MatchingConfig(criterion="robust")
    start = problem.T_ref_cur @ problems.motion(np.random.default_rng(0), 0.01, 0.5)
    alignment = register(problem, start, matching=matching, residual=residual, max_iterations=1)
    # the first iteration looks from the start itself
    seen = twins.warp_and_match(
        problem.reference,
        problem.samples.points(problem.camera),
        problem.samples.gradients,
        problem.camera,
        start,
        Criterion(matching.gamma, 640, matching.max_distance_px).compile(),
        residual == "divergence",
    )
    sigma = robust.student_scale(seen.residuals)
    assert alignment.steps()[0].sigma_px == pytest.approx(sigma, rel=1e-2)
    J = twins.jacobian(seen, problem.camera)
    W = robust.weights(seen.residuals / alignment.steps()[0].sigma_px, "t", 2.0)
    H = J.T @ (W[:, None] * J)
    units = np.sqrt(np.outer(np.diag(H), np.diag(H)))
    np.testing.assert_allclose(alignment.H / units, H / units, atol=0.02)
    np.testing.assert_array_equal(alignment.H, alignment.H.T)
    assert (np.linalg.eigvalsh(alignment.H) > 0).all()


# --------------------------------------------------------------------------------- known answers


@pytest.mark.parametrize("weight", robust.WEIGHTS)
@pytest.mark.parametrize(("translation", "rotation"), [(0.005, 0.3), (0.03, 1.0), (0.06, 2.0)])
@pytest.mark.parametrize("seed", range(3))
def test_a_known_motion_is_found(weight, translation, rotation, seed):
    problem = moved(seed, translation, rotation)
    # without weights a single false match bends the answer: it gets directions to the end
    matching = MatchingConfig(criterion="robust") if weight == "none" else None
    alignment = register(problem, matching=matching, weight=weight, **TIGHT)
    distance, angle = problems.error(problem.T_ref_cur, alignment.T_ref_cur)
    assert alignment.converged, alignment.reason
    assert distance < 1e-5
    assert angle < 1e-3
    assert alignment.sigma_px < 0.01
    assert alignment.inliers > 0.95 * len(problem.samples)


@pytest.mark.parametrize("weight", ["t", "tukey", "cauchy", "huber"])
@pytest.mark.parametrize("seed", range(3))
def test_a_known_motion_is_found_among_outliers(weight, seed):
    problem = moved(seed, 0.03, 1.5, outliers=0.3)
    alignment = register(problem, weight=weight, **TIGHT)
    distance, angle = problems.error(problem.T_ref_cur, alignment.T_ref_cur)
    assert distance < 1e-4
    assert angle < 5e-3


def test_outliers_ruin_least_squares():
    errors = {
        weight: np.mean(
            [
                problems.error(p.T_ref_cur, register(p, weight=weight, **TIGHT).T_ref_cur)
                for p in (moved(seed, 0.03, 1.5, outliers=0.3) for seed in range(5))
            ],
            axis=0,
        )
        for weight in ("t", "none")
    }
    print(errors)
    assert (errors["none"] > 3 * errors["t"]).all()


def test_the_signed_residual_beats_the_distance():
    """The paper's argument (§III-C): a distance is never negative, and biases the update."""
    problem_set = [moved(seed, 0.04, 1.5) for seed in range(6)]
    errors, iterations = {}, {}
    for residual in ("divergence", "distance"):
        alignments = [register(p, residual=residual) for p in problem_set]
        errors[residual] = np.array(
            [
                problems.error(p.T_ref_cur, a.T_ref_cur)
                for p, a in zip(problem_set, alignments, strict=True)
            ]
        )
        iterations[residual] = np.mean([a.iterations for a in alignments])
    medians = {name: np.median(error, axis=0) for name, error in errors.items()}
    print("median error m, deg:", medians, "mean iterations:", iterations)
    assert (medians["distance"] > 3 * medians["divergence"]).all()
    assert iterations["distance"] > iterations["divergence"]


def test_directions_widen_the_basin():
    """§V-B: in a dense scene with large motions the robust criterion finds what distance misses."""
    found = {"robust-then-normal": 0, "normal": 0}
    for seed in range(20):
        problem = moved(seed, 0.12, 4.0, segments=80)
        for criterion in found:
            alignment = register(problem, matching=MatchingConfig(criterion=criterion))
            distance, _ = problems.error(problem.T_ref_cur, alignment.T_ref_cur)
            found[criterion] += distance < 0.005
    print("found of 20:", found)
    assert found["robust-then-normal"] >= found["normal"] + 3
    assert found["robust-then-normal"] >= 12


def test_the_best_of_several_starts_is_taken():
    problem = moved(3, 0.8, 45.0)
    far = register(problem, **TIGHT)
    near = problem.T_ref_cur @ problems.motion(np.random.default_rng(0), 0.01, 0.5)
    for starts in ([np.eye(4), near], [near, np.eye(4)], [np.eye(4), near, se3.exp([1] * 6)]):
        alignment = register(problem, *starts, **TIGHT)
        assert problems.error(problem.T_ref_cur, alignment.T_ref_cur)[0] < 1e-3
    assert problems.error(problem.T_ref_cur, far.T_ref_cur)[0] > 0.01


def test_edges_across_a_turn_count_where_the_scale_begins_wide():
    """Most lines fit however far the camera has turned along them."""
    turn = se3.exp([0, 0, 0, 0, 0.006, 0])  # 3 px, six times the usual floor of the scale
    problem = rails(turn)
    narrow = register(problem, weight="tukey")
    wide = register(problem, weight="tukey", floor_px=2.0)
    assert narrow.inliers < 0.97 * len(narrow.matches)
    assert problems.error(turn, narrow.T_ref_cur)[1] > 0.2
    assert problems.error(turn, wide.T_ref_cur)[1] < 0.01
    lower = register(problem, weight="tukey", floor_px=0.1)
    np.testing.assert_array_equal(lower.T_ref_cur, narrow.T_ref_cur)  # the higher floor counts


@pytest.mark.parametrize("first_samples", [0, 60, 250])
@pytest.mark.parametrize("criterion", ["robust-then-normal", "robust", "normal"])
def test_a_worse_start_leaves_no_trace(first_samples, criterion):
    """Whatever part of the samples the choice looks at, and the first stage after it."""
    problem = moved(3)
    worse = problem.T_ref_cur @ problems.motion(np.random.default_rng(0), 0.3, 12.0)
    kind = {"matching": MatchingConfig(criterion=criterion)}
    alone = register(problem, np.eye(4), first_samples=first_samples, **kind)
    for starts in ((np.eye(4), worse), (worse, np.eye(4)), (worse, np.eye(4), worse)):
        chosen = register(problem, *starts, first_samples=first_samples, **kind)
        np.testing.assert_array_equal(alone.T_ref_cur, chosen.T_ref_cur)
        np.testing.assert_array_equal(alone.history, chosen.history)
        np.testing.assert_array_equal(alone.matches, chosen.matches)


def test_at_the_answer_one_step_a_stage_is_enough():
    problem = moved(2)
    alignment = register(problem, problem.T_ref_cur)
    assert alignment.converged
    assert alignment.iterations <= 4
    assert problems.error(problem.T_ref_cur, alignment.T_ref_cur)[0] < 1e-3


def test_the_rotation_is_exact():
    T = register(moved(2)).T_ref_cur
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


# ------------------------------------------------------------------------------------- evidence


def test_evidence_is_consistent():
    problem = moved(5, outliers=0.2)
    alignment = register(problem)
    n = len(problem.samples)
    assert alignment.matches.shape == alignment.residuals.shape == (n,)
    np.testing.assert_array_equal(np.isnan(alignment.residuals), alignment.matches < 0)
    assert alignment.match_count == np.count_nonzero(alignment.matches >= 0)
    small = np.abs(alignment.residuals) < 2.0
    assert alignment.inliers == np.count_nonzero(small)
    assert alignment.matches.max() < len(problem.reference)
    assert alignment.history.shape == (alignment.iterations, kernels.HISTORY)
    assert len(alignment.steps()) == alignment.iterations
    # the residual is the way from the edge matched, along its normal
    _, pixels, _ = twins.warp(
        problem.samples.points(problem.camera), problem.camera, alignment.T_ref_cur
    )
    edges, seen = problem.reference, alignment.matches >= 0
    F = pixels[seen] - edges.pixels[alignment.matches[seen]]
    r = (F * edges.gradients[alignment.matches[seen]]).sum(axis=1)
    np.testing.assert_allclose(alignment.residuals[seen], r, atol=0.1)


def test_the_input_is_left_alone():
    problem = moved(5)
    start = np.eye(4)
    arrays = (problem.samples.pixels, problem.samples.depths, problem.reference.pixels, start)
    before = [array.tobytes() for array in arrays]
    register(problem, start)
    assert [array.tobytes() for array in arrays] == before


def test_the_same_twice():
    problem = moved(6, outliers=0.2)
    a, b = register(problem), register(problem)
    assert a.T_ref_cur.tobytes() == b.T_ref_cur.tobytes()
    assert a.history.tobytes() == b.history.tobytes()


@pytest.mark.parametrize("seed", range(4))
def test_steps_that_lower_the_cost_are_accepted_and_others_damped(seed):
    problem = moved(seed, 0.15, 5.0, outliers=0.3)
    config = RegistrationConfig()
    steps = register(problem, weight="t", max_stretch=1.0, **TIGHT).steps()
    rejected = 0
    for now, then in zip(steps, [*steps[1:], None], strict=True):
        if np.isnan(now.trial_cost):
            assert now.accepted  # too small a step to be tried
            assert now.step_px < 0.5
            continue
        assert now.accepted == (now.trial_cost < now.cost)
        rejected += not now.accepted
        if then is None or then.robust != now.robust:
            continue  # each stage starts at the damping configured
        factor = config.damping_down if now.accepted else config.damping_up
        assert then.damping == pytest.approx(now.damping * factor)
        if not now.accepted:
            assert then.cost == now.cost
            assert then.step_px < now.step_px
            assert then.matches == now.matches
    assert steps[0].damping == config.damping


def test_some_steps_are_rejected():
    rejected = [
        not step.accepted
        for seed in range(8)
        for step in register(moved(seed, 0.2, 8.0, outliers=0.4), **TIGHT).steps()
    ]
    assert 0 < np.mean(rejected) < 0.8


@pytest.mark.parametrize("criterion", ["robust-then-normal", "robust", "normal"])
def test_which_criterion_runs_when(criterion):
    steps = register(moved(1), matching=MatchingConfig(criterion=criterion)).steps()
    robust_first = [step.robust for step in steps]
    assert robust_first == sorted(robust_first, reverse=True)
    assert (
        set(robust_first)
        == {
            "robust-then-normal": {True, False},
            "robust": {True},
            "normal": {False},
        }[criterion]
    )


# -------------------------------------------------------------------------------------- reasons


def test_too_few_samples():
    alignment = register(moved(0, count=29))
    assert not alignment.converged
    assert alignment.reason == "too few matches"
    assert alignment.iterations == 0
    np.testing.assert_array_equal(alignment.T_ref_cur, np.eye(4))
    assert register(moved(0, count=29), min_matches=29).reason != "too few matches"


@pytest.mark.parametrize("what", ["samples", "edges", "both"])
def test_nothing_to_register(what):
    problem = moved(0)
    nothing = EdgePixels(*(np.empty(s, np.float32) for s in ((0, 2), (0, 2), 0)))
    if what in ("samples", "both"):
        problem.samples = nothing
    if what in ("edges", "both"):
        problem.reference = nothing
    alignment = register(problem)
    assert alignment.reason == "too few matches"
    assert alignment.inliers == alignment.match_count == 0
    assert np.isfinite(alignment.T_ref_cur).all()


def test_a_start_that_sees_nothing():
    problem = moved(0)
    alignment = register(problem, se3.exp([0, 0, -50, 0, 0, 0]))
    assert alignment.reason == "too few matches"
    alignment = register(problem, se3.exp([0, 0, -50, 0, 0, 0]), np.eye(4))
    assert alignment.converged


def test_parallel_edges_do_not_constrain_the_motion():
    rng = np.random.default_rng(0)
    alignment = register(straight(rng))
    assert not alignment.converged
    assert alignment.reason == "edges do not constrain the motion"
    assert np.isfinite(alignment.T_ref_cur).all()


def test_iterations_used_up():
    alignment = register(moved(0, 0.05, 2.0), max_iterations=1)
    assert not alignment.converged
    assert alignment.reason == "iterations used up"
    assert alignment.iterations == 1
    assert register(moved(0, 0.05, 2.0), max_iterations=3).iterations <= 3


def test_no_step_lowers_the_cost():
    never = {"stop_px": 1e-12, "stop_decrease": 0.0, "first_sigma_px": 0.0}
    alignment = register(moved(0), moved(0).T_ref_cur, **never)
    assert alignment.converged
    assert alignment.reason == "no step lowers the cost any more"


def test_every_reason_has_words():
    codes = {
        kernels.CONVERGED,
        kernels.STALLED,
        kernels.EXHAUSTED,
        kernels.TOO_FEW,
        kernels.SINGULAR,
    }
    assert set(REASONS) == codes
    assert len(set(REASONS.values())) == 5


def test_a_match_must_lie_within_reach():
    problem = moved(0, 0.06, 2.0)
    near = register(problem, matching=MatchingConfig(max_distance_px=0.5), max_iterations=1)
    far = register(problem, matching=MatchingConfig(max_distance_px=100.0), max_iterations=1)
    assert near.match_count < 0.5 * far.match_count
    assert far.match_count == len(problem.samples)


def test_a_match_must_turn_little():
    problem = moved(0, 0.0, 1e-9)
    problem.samples.gradients[::2] *= -1
    strict = MatchingConfig(max_angle_deg=30.0, criterion="normal")
    alignment = register(problem, matching=strict)
    seen = alignment.matches >= 0
    dot = (
        problem.samples.gradients[seen] * problem.reference.gradients[alignment.matches[seen]]
    ).sum(axis=1)
    assert (dot >= np.cos(np.radians(30)) - 1e-6).all()
    assert seen[1::2].all()


def scattered(problem, px):
    """Samples that lie beside their edges."""
    seen = problem.samples
    off = np.random.default_rng(0).normal(0, px, (len(seen), 1)).astype(np.float32)
    return replace(problem, samples=replace(seen, pixels=seen.pixels + off * seen.gradients))


@pytest.mark.parametrize("criterion", ["robust-then-normal", "robust", "normal"])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_left_is_little_beside_the_scale(seed, criterion):
    """Sharp edges constrain some motions hardly, which a step of 0.03 px may leave far off."""
    problem = scattered(moved(seed), 0.05)
    matching = MatchingConfig(criterion=criterion)
    rule = {"stop_decrease": 0.0, "first_sigma_px": 0.0, "stop_px": 0.3, "matching": matching}
    settled = register(problem, **rule, stop_share=1e-4)
    early, late = (register(problem, **rule, stop_share=share) for share in (0.0, 0.05))
    assert early.steps()[-1].step_px > 0.05 * early.sigma_px  # else this tells nothing
    assert late.iterations > early.iterations
    last = late.steps()[-1]
    assert late.reason == "converged"
    assert last.step_px < 0.05 * last.sigma_px
    off = [problems.error(settled.T_ref_cur, each.T_ref_cur)[0] for each in (early, late)]
    assert off[1] < 0.5 * off[0]


def test_where_edges_scatter_widely_the_bound_in_pixels_holds():
    problem = scattered(moved(0), 2.0)
    either = [register(problem, stop_share=share) for share in (0.0, 0.05)]
    assert either[0].sigma_px > 0.03 / 0.05
    assert either[0].iterations == either[1].iterations
    np.testing.assert_array_equal(*(each.T_ref_cur for each in either))


def test_paper_asks_for_no_share():
    assert Config.preset("paper").registration.stop_share == 0
