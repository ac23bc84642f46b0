"""Each compiled kernel does what its plain twin says; both times are printed (pytest -s)."""

import ast
import inspect
import itertools
import re
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import kernels, robust, se3, strays, uncertainty
from edvo.camera import Camera
from edvo.config import EdgesConfig, MatchingConfig, RegistrationConfig
from edvo.edges import EdgePixels, extract_edges
from edvo.matching import Criterion, EdgeIndex
from edvo.planes import camera_of
from edvo.registration import AT_ONCE, COARSE_POINTS, NOTHING_NEAR, Registration

from . import problems, twins

LEAN = {"lean", "lean_float"}
TYPES = ("float64", "float32", "uint64", "int64", "uint32", "int32", "uint16", "int16", "uint8")
SCALAR = {"np." + name for name in ("isfinite", "sqrt", "log", "log1p", *TYPES)}

LENS = problems.LENS


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def both(name, kernel, twin):
    """Results of kernel (called twice, so that its compilation is not timed) and twin."""
    kernel()
    start = time.perf_counter()
    fast = kernel()
    middle = time.perf_counter()
    slow = twin()
    end = time.perf_counter()
    times = f"kernel {1e6 * (middle - start):9.1f} us, NumPy {1e6 * (end - middle):9.1f} us"
    print(f"\n{name:18s} {times}")
    return fast, slow


def depth_image(rng, shape=(120, 160)):
    """Two surfaces with noise, strays between them, and holes."""
    depth = np.where(np.arange(shape[1]) < 80, 1.5, 2.5) + np.zeros(shape)
    depth += rng.normal(0, 0.01, shape)
    depth[:, 78:82] = rng.uniform(1.5, 2.5, (shape[0], 4))
    depth[rng.random(shape) < 0.3] = 0
    depth[40:60, 20:120] = 0
    return depth.astype(np.float32)


# ---------------------------------------------------------------------------------------- edges


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (7, 8), (480, 640), (37, 61)])
@pytest.mark.parametrize("share", [0.0, 0.02, 1.0])
def test_collect_edges(rng, shape, share):
    mask = (rng.random(shape) < share).astype(np.uint8) * np.uint8(255)
    room = np.full(2 * mask.size + 64, -1, np.int32)
    index = room[: 2 * mask.size]
    count, expected = both(
        "collect_edges",
        lambda: kernels.collect_edges(mask, index),
        lambda: twins.collect_edges(mask),
    )
    assert count == len(expected)
    np.testing.assert_array_equal(index[:count], expected)
    assert (room[2 * mask.size :] == -1).all()


@pytest.mark.parametrize("finely", [False, True], ids=["pixel", "vertex"])
@pytest.mark.parametrize("distorted", [False, True])
def test_describe_edges(rng, distorted, finely):
    dx, dy = rng.integers(-1000, 1000, (2, 480, 640)).astype(np.int16)
    mask = rng.random((480, 640)) < 0.005
    mask[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    index = np.flatnonzero(mask & ((dx != 0) | (dy != 0))).astype(np.int32)
    table = LENS.undistortion_table() if distorted else np.empty((0, 0, 2), np.float32)
    pixels, gradients, profiles = np.zeros((3, len(index), 2), np.float32)
    given = index, dx, dy, table, finely, pixels, gradients
    _, (twin_pixels, twin_gradients, twin_profiles) = both(
        "describe_edges",
        lambda: kernels.describe_edges(*given, profiles),
        lambda: twins.describe_edges(index, dx, dy, table if distorted else None, finely),
    )
    np.testing.assert_allclose(pixels, twin_pixels, atol=1e-4)
    np.testing.assert_allclose(gradients, twin_gradients, atol=2e-4)
    # else this would show nothing
    assert (pixels % 1 != 0).any() == (finely or distorted)
    if finely:
        np.testing.assert_allclose(profiles, twin_profiles, rtol=1e-4, atol=1e-4)
        assert 0.1 < profiles.any(axis=1).mean() < 0.9
    else:
        assert not profiles.any()  # there is none
    with_room = pixels.copy()
    kernels.describe_edges(*given, np.empty((0, 2), np.float32))
    np.testing.assert_array_equal(pixels, with_room)


@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    size=st.sampled_from([1, 2, 5, 100, 1020]),
)
def test_describe_edges_of_any_gradients(seed, shape, size):
    """Small images, whose borders are most of them, and the largest gradients that there are."""
    dx, dy = np.random.default_rng(seed).integers(-size, size + 1, (2, *shape)).astype(np.int16)
    index = np.flatnonzero((dx != 0) | (dy != 0)).astype(np.int32)
    pixels, gradients, profiles = np.empty((3, len(index), 2), np.float32)
    none = np.empty((0, 0, 2), np.float32)
    kernels.describe_edges(index, dx, dy, none, True, pixels, gradients, profiles)
    expected, twin_gradients, twin_profiles = twins.describe_edges(index, dx, dy, finely=True)
    # the flatter it is, the less sure is where it is highest; and at the bound of what is flat
    # rounding decides
    bends = [abs(twins.parabola_at(dx, dy, *divmod(int(i), shape[1])[::-1])[2]) for i in index]
    sure = [abs(bend / kernels.FLAT - 1) > 0.9 for bend in bends]
    for mine, other, bend in zip(pixels[sure], expected[sure], np.array(bends)[sure], strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-5 + (1e-6 / bend if bend else 0))
    np.testing.assert_allclose(profiles[sure], twin_profiles[sure], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(gradients, twin_gradients, atol=1e-5)


@pytest.mark.parametrize("radius", [0, 1, 2, 5])
@pytest.mark.parametrize("gap", [0.01, 0.05, 0.5])
def test_depths_at(rng, radius, gap):
    depth = depth_image(rng)
    index = np.arange(depth.size, dtype=np.int32)[::3].copy()
    result = np.empty(len(index), np.float32)
    _, expected = both(
        "depths_at",
        lambda: kernels.depths_at(depth, index, radius, gap, result),
        lambda: twins.depths_at(depth, index, radius, gap),
    )
    # where a depth lies on the very edge of the gap, rounding decides
    differs = ~np.isclose(result, expected, rtol=1e-5)
    assert differs.mean() < 1e-3
    assert np.count_nonzero(expected == 0) > 0
    window = kernels.room_for_window(radius)
    for i in index[::37]:  # on the border and inside
        one = kernels.depth_at(depth, int(i) % 160, int(i) // 160, radius, gap, window)
        assert one == result[i // 3]


# ------------------------------------------------------------------------------------- sampling


@pytest.mark.parametrize("seed", [0, 1, 2**31 * 1_000_003, 987654321])
@pytest.mark.parametrize(
    ("cell", "per_cell", "count"),
    [(80, 5, 450), (16, 5, 100), (40, 0, 300), (500, 7, 50), (20, 100, 5000), (20, 3, 0)],
)
def test_draw_samples_to_the_last_one(rng, seed, cell, per_cell, count):
    depth = depth_image(rng)
    index = np.flatnonzero(rng.random(depth.shape) < 0.05).astype(np.int32)
    radius, gap = 1, 0.05
    available = np.empty(len(index), np.float32)
    kernels.depths_at(depth, index, radius, gap, available)
    samples = np.empty(len(index), np.int32)
    depths = np.empty(len(index), np.float32)
    drawn, expected = both(
        "draw_samples",
        lambda: kernels.draw_samples(
            index, depth, cell, per_cell, count, radius, gap, False, seed, samples, depths
        ),
        lambda: twins.draw_samples(index, available, depth.shape, cell, per_cell, count, seed),
    )
    np.testing.assert_array_equal(samples[:drawn], expected)
    np.testing.assert_array_equal(depths[:drawn], available[expected])


@pytest.mark.parametrize("seed", [0, 1, 987654321])
@pytest.mark.parametrize(
    ("cell", "tried", "count"), [(16, 3, 100), (5, 1, 300), (500, 4, 50), (8, 9, 5000), (8, 3, 0)]
)
def test_draw_informative_to_the_last_one(rng, seed, cell, tried, count):
    depth = depth_image(rng)
    height, width = depth.shape
    camera = Camera(width, height, 150.0, 145.0, width / 2, height / 2 - 3)
    index = np.flatnonzero(rng.random(depth.shape) < 0.05).astype(np.int32)
    du, dv = rng.integers(1, 200, (2, *depth.shape)).astype(np.int16)
    du[rng.random(depth.shape) < 0.5] *= -1
    radius, gap = 1, 0.05
    available = np.empty(len(index), np.float32)
    kernels.depths_at(depth, index, radius, gap, available)
    worth = rng.uniform(0, 1, (3, 4, kernels.LINE_DIRECTIONS)).astype(np.float32)
    samples, depths = np.empty(len(index), np.int32), np.empty(len(index), np.float32)
    drawn, expected = both(
        "draw_informative",
        lambda: kernels.draw_informative(
            index,
            du,
            dv,
            depth,
            camera_of(camera),
            worth,
            cell,
            tried,
            count,
            radius,
            gap,
            False,
            seed,
            samples,
            depths,
        ),
        lambda: twins.draw_informative(
            index, du, dv, available, camera, worth, cell, tried, count, seed
        ),
    )
    np.testing.assert_array_equal(samples[:drawn], expected)
    np.testing.assert_array_equal(depths[:drawn], available[expected])
    assert count == 0 or (available <= 0).any()  # some were passed over


@pytest.mark.parametrize("z", [1e-30, np.inf])
def test_draw_informative_comes_to_an_end_whatever_depth_is(z):
    depth = np.full((48, 64), z, np.float32)
    index = np.arange(0, 48 * 64, 3, dtype=np.int32)
    du, dv = np.full((2, 48, 64), 90, np.int16)
    alike = np.ones((1, 1, kernels.LINE_DIRECTIONS), np.float32)
    camera = camera_of(Camera(64, 48, 50.0, 50.0, 31.5, 23.5))
    samples, depths = np.empty(301, np.int32), np.empty(301, np.float32)
    how = alike, 8, 3, 300, 1, 0.05, True, 0, samples, depths
    drawn = kernels.draw_informative(index, du, dv, depth, camera, *how)
    assert drawn == 300
    assert (np.diff(samples) > 0).all()


def test_draw_samples_of_no_edges():
    none, depth = np.empty(0, np.int32), np.ones((48, 64), np.float32)
    buffers = np.empty(6, np.int32), np.empty(6, np.float32)
    assert kernels.draw_samples(none, depth, 16, 5, 5, 2, 0.05, False, 0, *buffers) == 0


def test_back_project(rng):
    edges, camera = problems.random_edges(rng, 300), problems.CAMERA
    depths = rng.uniform(0, 5, 300).astype(np.float32)
    points, lens = np.empty((300, 3)), (camera.fx, camera.fy, camera.cx, camera.cy)
    _, expected = both(
        "back_project",
        lambda: kernels.back_project(edges.pixels, depths, *lens, points),
        lambda: camera.backproject(edges.pixels, depths),
    )
    np.testing.assert_allclose(points, expected, rtol=1e-6, atol=1e-6)


# --------------------------------------------------------------------------------------- planes


def test_pack_points(rng):
    offsets = rng.uniform(-1, 1, 200)
    normals, centres, sigma = rng.normal(size=(200, 3)), rng.normal(size=(200, 3)), rng.random(200)

    def pack():
        given = normals.copy(), centres.copy(), sigma.copy()
        count = kernels.pack_points(offsets, *given)
        return [each[:count] for each in given]

    packed, expected = both(
        "pack_points", pack, lambda: [each[offsets > 0] for each in (normals, centres, sigma)]
    )
    for one, other in zip(packed, expected, strict=True):
        np.testing.assert_array_equal(one, other)


# ------------------------------------------------------------------------------------- matching


@pytest.mark.parametrize("n", [0, 1, 2, 500])
@pytest.mark.parametrize("cell", [1.0, 8.0, 5000.0])
def test_build_grid_keeps_every_edge_in_its_cell(rng, n, cell):
    edges = problems.random_edges(rng, n)
    grid = kernels.build_grid(edges.pixels, edges.gradients, cell)
    assert sorted(grid.order) == list(range(n))
    np.testing.assert_array_equal(grid.points[:, :2], edges.pixels[grid.order])
    np.testing.assert_array_equal(grid.points[:, 2:], edges.gradients[grid.order])
    assert grid.start[0] == 0
    assert grid.start[-1] == n
    assert len(grid.start) == grid.rows * grid.cols + 1
    cells = np.repeat(np.arange(grid.rows * grid.cols), np.diff(grid.start))
    row, col = np.divmod(cells, grid.cols)
    corner = np.column_stack((grid.left + col * cell, grid.top + row * cell))
    inside = grid.points[:, :2] - corner
    assert (inside >= -1e-3).all()
    assert (inside <= cell + 1e-3).all()


@pytest.mark.parametrize("n", [0, 1, 2, 3, 64, 1000])
@pytest.mark.parametrize("weight", [0.0, 100.0, 1e6])
def test_build_tree_is_balanced(rng, n, weight):
    edges = problems.random_edges(rng, n)
    tree = kernels.build_tree(edges.pixels, edges.gradients, weight)
    assert sorted(tree.order) == list(range(n))
    points = np.column_stack((edges.pixels, edges.gradients))
    np.testing.assert_array_equal(tree.points, points[tree.order])
    twins.check_tree(tree)
    if weight == 0 and n > 2:
        assert set(tree.axis) <= {0, 1}


def test_build_tree_of_equal_points():
    ones = np.ones((300, 2), np.float32)
    tree = kernels.build_tree(ones, ones, 100.0)
    assert sorted(tree.order) == list(range(300))
    twins.check_tree(tree)


# --------------------------------------------------------------------------------- robust costs


@pytest.mark.parametrize("nu", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("start", [1.0, 0.01, 100.0])
def test_student_scale(rng, nu, start):
    residuals = rng.standard_t(2, 450) * 0.7
    sigma, expected = both(
        "student_scale",
        lambda: kernels.student_scale(residuals, len(residuals), nu, start, 1e-3),
        lambda: robust.student_scale(residuals, nu, tolerance=1e-9),
    )
    assert sigma == pytest.approx(expected, rel=5e-3)  # both stop at a relative change of 1e-3
    assert kernels.student_scale(residuals, len(residuals), nu, 1.0, 1e-3) == pytest.approx(
        robust.student_scale(residuals, nu), rel=1e-12
    )


def test_scales_have_a_floor():
    zeros = np.zeros(20)
    assert kernels.student_scale(zeros, 20, 2.0, 1.0, 1e-3) == 1e-3
    assert kernels.median_scale(zeros, 20, 1e-3) == 1e-3


@pytest.mark.parametrize("n", [1, 2, 451])
def test_median_scale(rng, n):
    residuals = rng.normal(size=n + 10)
    sigma, expected = both(
        "median_scale",
        lambda: kernels.median_scale(residuals, n, 1e-9),
        lambda: robust.median_scale(residuals[:n]),
    )
    assert sigma == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "of",
    [
        lambda r: r * 1e-9,  # below the bins of the histogram,
        lambda r: r * 1e9,  # above,
        lambda r: np.where(r < 0, 0.0, 1e300),  # and not to be had in single precision
        np.round,
        np.ones_like,
    ],
)
def test_median_scale_is_exact_whatever_the_bins_hold(rng, of):
    for n in range(1, 80):
        residuals = of(rng.normal(size=n))
        expected = max(robust.median_scale(residuals), 1e-12)
        assert kernels.median_scale(residuals, n, 1e-12) == expected


def test_a_scale_of_nothing_is_the_floor():
    assert kernels.median_scale(np.empty(0), 0, 0.5) == 0.5


@pytest.mark.parametrize("name", robust.WEIGHTS)
def test_robust_weight_and_cost(name):
    tuning = robust.TUNING.get(name, 2.0)
    residuals = np.concatenate(([0.0], np.geomspace(1e-6, 1e6, 60)))
    code = robust.WEIGHTS[name]
    weight, cost = kernels.robust_weight, kernels.robust_cost
    np.testing.assert_allclose(
        [weight(r * r, code, tuning) for r in residuals],
        robust.weights(residuals, name, tuning),
        rtol=1e-12,
        atol=1e-300,
    )
    np.testing.assert_allclose(
        [cost(r * r, code, tuning) for r in residuals],
        twins.cost(residuals, name, tuning),
        rtol=1e-9,
    )


def solver(config=None, **changes):
    """What a configuration (by default one with the t-distribution) means to the kernels."""
    config = config or RegistrationConfig(weight="t")
    values = {
        "residual": kernels.SIGNED,
        "weight": robust.WEIGHTS[config.weight],
        "tuning": robust.TUNING.get(config.weight, config.nu),
        "min_sigma": config.min_sigma_px,
        "max_sigma": np.inf,
        "first_sigma": config.first_sigma_px,
        "coarse_samples": config.coarse_samples,
        "coarse_points": COARSE_POINTS,
        "first_points": np.int64(900),
        "first_samples": config.first_samples,
        "min_matches": config.min_matches,
        "max_iterations": config.max_iterations,
        "switch_px": MatchingConfig().switch_px,
        "stop_px": config.stop_px,
        "stop_share": config.stop_share,
        "leave_px": 0.0,
        "stop_cost": config.stop_decrease,
        "damping": config.damping,
        "damping_up": config.damping_up,
        "damping_down": config.damping_down,
        "max_rejections": config.max_rejections,
        "max_stretch": config.max_stretch,
        "kept_px": config.kept_px,
        "profile_spread": config.profile_spread,
    }
    return kernels.Solver(**{**values, **changes})


@pytest.mark.parametrize("name", robust.WEIGHTS)
@pytest.mark.parametrize("count", [0, 1, 16, 17, 437])
@pytest.mark.parametrize("missing", [0, 13])
def test_mean_cost(rng, name, count, missing):
    missing += not count  # of no sample at all there is no mean
    tuning = robust.TUNING.get(name, 2.0)
    residuals = rng.standard_t(2, 500) * 3
    sigma, limit = 0.4, 900.0
    settings = solver(weight=robust.WEIGHTS[name], tuning=tuning)
    cost, expected = both(
        f"mean_cost {name}",
        lambda: kernels.mean_cost(residuals, count, count + missing, sigma, limit, settings),
        lambda: twins.mean_cost(residuals[:count], count + missing, sigma, limit, name, tuning),
    )
    assert cost == pytest.approx(expected, rel=1e-9)


def test_mean_cost_does_not_overflow():
    residuals = np.full(450, 1e6)
    cost = kernels.mean_cost(residuals, 450, 450, 1e-3, 900.0, solver())
    assert cost == pytest.approx(twins.mean_cost(residuals, 450, 1e-3, 900.0, "t", 2.0), rel=1e-9)


# --------------------------------------------------------------------------------- registration


def test_exp_se3(rng):
    for size in (0.0, 1e-12, 1e-6, 1e-4, 1e-2, 1.0, 3.1):
        xi = rng.normal(size=6)
        xi[3:] *= size / np.linalg.norm(xi[3:])
        T, expected = both("exp_se3", lambda xi=xi: kernels.exp_se3(xi), lambda xi=xi: se3.exp(xi))
        np.testing.assert_allclose(T, expected, atol=1e-12)


def test_product(rng):
    A, B = problems.motion(rng, 2.0, 50), problems.motion(rng, 1.0, 170)
    C, expected = both("product", lambda: kernels.product(A, B), lambda: A @ B)
    np.testing.assert_allclose(C, expected, atol=1e-14)


def test_motions_are_inverted_as_outside_of_kernels(rng):
    for T in (np.eye(4), problems.motion(rng, 2.0, 50), problems.motion(rng, 0.0, 170)):
        back, expected = both(
            "inverted", lambda T=T: kernels.inverted(T), lambda T=T: se3.inverse(T)
        )
        np.testing.assert_array_equal(back, expected)
        Ad, expected = both(
            "adjoint_back",
            lambda T=T: kernels.adjoint_back(T),
            lambda T=T: se3.adjoint(se3.inverse(T)),
        )
        np.testing.assert_array_equal(Ad, expected)


def test_orthonormalize(rng):
    for _ in range(20):
        T = problems.motion(rng, 1.0, rng.uniform(0, 180))
        drifted = T.copy()
        drifted[:3, :3] += rng.normal(0, 1e-3, (3, 3))
        expected = twins.orthonormal(drifted)
        kernels.orthonormalize(drifted)
        np.testing.assert_allclose(drifted, expected, atol=1e-12)
        np.testing.assert_allclose(drifted[:3, :3].T @ drifted[:3, :3], np.eye(3), atol=1e-14)
        assert np.linalg.det(drifted[:3, :3]) == pytest.approx(1)
        np.testing.assert_array_equal(drifted[:, 3], T[:, 3])


@pytest.mark.parametrize("damping", [0.0, 1e-4, 10.0])
def test_solve_damped(rng, damping):
    step = np.empty(6)
    J = rng.normal(size=(40, 6)) * (1, 1, 1, 100, 100, 1e-3)  # columns as unlike as in practice
    H, b = J.T @ J, rng.normal(size=6)
    good, expected = both(
        "solve_damped",
        lambda: kernels.solve_damped(H, b, damping, step),
        lambda: twins.solve_damped(H, b, damping),
    )
    assert good
    np.testing.assert_allclose(step, expected, rtol=1e-8)


def test_solve_damped_refuses_what_is_singular(rng):
    J = rng.normal(size=(40, 6))
    J[:, 5] = J[:, 0] - 2 * J[:, 3]
    step = np.empty(6)
    assert not kernels.solve_damped(J.T @ J, rng.normal(size=6), 0.0, step)
    assert not kernels.solve_damped(np.zeros((6, 6)), np.ones(6), 1e-4, step)
    assert not kernels.solve_damped(np.full((6, 6), np.nan), np.ones(6), 1e-4, step)


def test_the_parts_of_a_covariance(rng):
    """The twin is `uncertainty.combine` of what `without_blur` takes for known."""
    scale = np.array([1, 1, 1, 100, 100, 1e-2])  # directions as unlike as in practice
    J, D = (rng.normal(size=(40, 6)) * scale for _ in range(2))
    H, blur = J.T @ J, 0.1 * D.T @ D
    parts = np.array([(A := rng.normal(size=(9, 6)) * scale).T @ A for _ in range(4)])
    shares, C = np.array(uncertainty.SHARES), np.empty((6, 6))
    good, expected = both(
        "combine_parts",
        lambda: kernels.combine_parts(
            H, blur, parts, uncertainty.DOUBT, shares, 0.7**4, uncertainty.PRIOR, C
        ),
        lambda: uncertainty.combine(uncertainty.without_blur(H, blur), parts, 0.7),
    )
    assert good
    unit = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(C / np.outer(unit, unit), expected / np.outer(unit, unit), atol=1e-9)
    np.testing.assert_array_equal(C, C.T)


def test_a_covariance_of_what_is_not_all_known_is_left_to_numpy(rng):
    J = rng.normal(size=(40, 6))
    C = np.full((6, 6), 7.0)
    arguments = np.ones((4, 6, 6)), 1.2, np.ones(4), 1.0, np.ones(6), C
    assert not kernels.combine_parts(J.T @ J, 50 * np.eye(6), *arguments)
    assert not kernels.combine_parts(np.full((6, 6), np.nan), np.eye(6), *arguments)
    assert (C == 7).all()


def pinhole(camera):
    return kernels.Pinhole(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


class Warp:
    """The kernel `warp_and_match` with its state, as a function of the pose."""

    def __init__(self, problem, criterion, residual=kernels.SIGNED):
        self.problem, self.criterion, self.residual = problem, criterion, residual
        self.index = EdgeIndex(problem.reference)
        self.nearby, self.stage = NOTHING_NEAR, kernels.ROBUST
        self.points = problem.samples.points(problem.camera)
        self.state = kernels.new_matches(len(self.points))
        self.state.bound[:] = 0
        self.residuals = np.empty(len(self.points))

    def __call__(self, T, stride=1):
        count = kernels.warp_and_match(
            self.index.grid,
            self.nearby,
            self.stage,
            self.points,
            self.problem.samples.gradients,
            stride,
            pinhole(self.problem.camera),
            T,
            self.criterion,
            self.residual,
            self.state,
            self.residuals,
        )
        return self.residuals[:count].copy()

    def fresh(self, T):
        """The same by the twin."""
        return twins.warp_and_match(
            self.problem.reference,
            self.points,
            self.problem.samples.gradients,
            self.problem.camera,
            T,
            self.criterion,
            self.residual == kernels.SIGNED,
        )

    def check(self, T):
        """Assert that the matches the kernel holds are the best that there are."""
        expected = self.fresh(T)
        found = expected.matched
        np.testing.assert_array_equal(self.state.edge >= 0, found)
        np.testing.assert_allclose(
            self.costs(T)[found], expected.costs[found], rtol=1e-6, atol=1e-4
        )

    def costs(self, T):
        """Costs of the matches that the kernel holds, by Eq. (6) in float64."""
        edge = self.state.edge
        _, pixels, _ = twins.warp(self.points, self.problem.camera, T)
        reference = self.index.grid.points[edge].astype(np.float64)
        distance = ((pixels - reference[:, :2]) ** 2).sum(axis=1)
        dot = (self.problem.samples.gradients * reference[:, 2:]).sum(axis=1)
        cost = distance + self.criterion.direction * (dot - 1) ** 2
        return np.where(edge < 0, np.inf, cost)


CRITERIA = {
    "robust": Criterion(0.7, 640, 30.0),
    "normal": Criterion(0.0, 640, 30.0),
    "far": Criterion(0.7, 640, np.inf),
    "narrow": Criterion(0.7, 640, 4.0, 20.0),
}


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("residual", [kernels.SIGNED, kernels.DISTANCE])
def test_warp_and_match(rng, criterion, residual):
    problem = problems.segments_problem(3, problems.motion(rng), outliers=0.2)
    warp = Warp(problem, CRITERIA[criterion].compile(), residual)
    T = problem.T_ref_cur @ problems.motion(rng, 0.02, 1.0)
    residuals, expected = both("warp_and_match", lambda: warp(T), lambda: warp.fresh(T))
    found = warp.state.edge >= 0
    np.testing.assert_array_equal(found, expected.matched)
    np.testing.assert_allclose(warp.costs(T)[found], expected.costs[found], atol=1e-3)
    same = warp.index.grid.order[warp.state.edge[found]] == expected.matches[found]
    assert same.mean() > 0.98  # ties aside
    np.testing.assert_allclose(residuals[same], expected.residuals[same], atol=1e-4)
    np.testing.assert_allclose(warp.state.Y[found], expected.points[found], atol=1e-12)
    np.testing.assert_allclose(warp.state.normal[found][same], expected.normals[same], atol=1e-3)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("start", range(3))
def test_matches_kept_without_a_search_are_still_the_best(criterion, start):
    rng = np.random.default_rng(start)
    problem = problems.segments_problem(start, problems.motion(rng), count=150, outliers=0.3)
    warp = Warp(problem, CRITERIA[criterion].compile())
    T = problem.T_ref_cur @ problems.motion(rng, 0.03, 2.0)
    # the step sizes of a registration and of a drifting one, to and fro, and a leap
    for size in (0.0, 1e-6, 1e-4, 1e-3, 3e-3, 1e-2, 1e-4, 0.1, 1e-3, 1e-5, 3e-3, 3e-3):
        T = problems.motion(rng, size * 2 + 1e-12, size * 60 + 1e-12) @ T
        warp(T)
        warp.check(T)


def test_samples_behind_the_camera_or_outside_of_the_image_have_no_match(rng):
    problem = problems.segments_problem(3, np.eye(4))
    warp = Warp(problem, CRITERIA["far"].compile())
    behind = se3.exp([0, 0, -10, 0, 0, 0])
    assert len(warp(behind)) == 0
    beside = se3.exp([100, 0, 0, 0, 0, 0])
    assert len(warp(beside)) == 0
    assert len(warp(np.eye(4))) == len(problem.samples)


def test_stride_takes_every_so_manyth_sample(rng):
    problem = problems.segments_problem(3, np.eye(4), count=101)
    warp = Warp(problem, CRITERIA["robust"].compile())
    every = warp(np.eye(4))
    assert len(warp(np.eye(4), 4)) == 26
    np.testing.assert_array_equal(warp.state.edge[::4] >= 0, True)
    np.testing.assert_allclose(warp(np.eye(4), 4), every[::4], atol=1e-9)


@pytest.mark.parametrize("residual", [kernels.SIGNED, kernels.DISTANCE])
@pytest.mark.parametrize("name", robust.WEIGHTS)
def test_normal_equations(rng, residual, name):
    problem = problems.segments_problem(4, problems.motion(rng), outliers=0.3)
    warp = Warp(problem, CRITERIA["robust"].compile(), residual)
    T = problem.T_ref_cur @ problems.motion(rng, 0.02, 1.0)
    residuals = warp(T)
    settings = solver(
        residual=residual, weight=robust.WEIGHTS[name], tuning=robust.TUNING.get(name, 2.0)
    )
    sigma, H, b = 0.8, np.empty((6, 6)), np.empty(6)
    C, K, g, none = np.zeros((6, 6)), np.zeros((6, 6)), np.empty(6), np.empty(0)
    seen = warp.fresh(T)

    def twin():
        J = twins.jacobian(seen, problem.camera)
        W = robust.weights(seen.residuals / sigma, name, settings.tuning)
        return J.T @ (W[:, None] * J), J.T @ (W * seen.residuals), W.sum()

    total, (H_twin, _, total_twin) = both(
        "normal_equations",
        lambda: kernels.normal_equations(
            pinhole(problem.camera),
            settings,
            sigma,
            warp.state,
            residuals,
            none,
            False,
            H,
            b,
            C,
            K,
            g,
        ),
        twin,
    )
    assert not C.any()
    assert not g.any()
    # the matches are the same but for ties, the residuals to float32
    assert total == pytest.approx(total_twin, rel=1e-3)
    scale = np.sqrt(np.diag(H_twin))
    np.testing.assert_allclose(
        H / np.outer(scale, scale), H_twin / np.outer(scale, scale), atol=2e-2
    )
    np.testing.assert_array_equal(H, H.T)
    # to the last digits with the kernel's own matches
    own = EdgePixels(
        warp.index.grid.points[:, :2], warp.index.grid.points[:, 2:], problem.reference.depths
    )
    offset = seen.pixels - own.pixels[warp.state.edge]
    matched = warp.state.edge >= 0
    warped = twins.Warped(
        seen.points,
        seen.pixels,
        warp.state.edge,
        seen.costs,
        warp.state.normal[matched],
        (offset * warp.state.normal).sum(axis=1)[matched],
    )
    J = twins.jacobian(warped, problem.camera)
    W = robust.weights(residuals / sigma, name, settings.tuning)
    np.testing.assert_allclose(H, J.T @ (W[:, None] * J), rtol=1e-9, atol=1e-9 * scale.max() ** 2)
    np.testing.assert_allclose(b, J.T @ (W * residuals), rtol=1e-8, atol=1e-8 * scale.max())
    np.testing.assert_allclose(residuals, warped.residuals, atol=1e-9)
    # and where each moves by a share of a slack as well
    bends = rng.normal(0, 0.2, len(problem.samples))
    again, pull = np.empty((6, 6)), np.empty(6)
    given = pinhole(problem.camera), settings, sigma, warp.state, residuals, bends
    kernels.normal_equations(*given, True, again, pull, C, K, g)
    np.testing.assert_array_equal(again, H)
    np.testing.assert_array_equal(pull, b)
    own = bends[matched]
    tight = {"rtol": 1e-9, "atol": 1e-9 * scale.max() ** 2}
    np.testing.assert_allclose(C, J.T @ ((W * own)[:, None] * J), **tight)
    np.testing.assert_allclose(K, J.T @ ((W * own**2)[:, None] * J), **tight)
    np.testing.assert_allclose(g, J.T @ (W * own * residuals), rtol=1e-8, atol=1e-8 * scale.max())
    kept = C.copy(), g.copy()
    kernels.normal_equations(*given, False, again, pull, C, K, g)  # coupled before
    np.testing.assert_array_equal(C, kept[0])
    np.testing.assert_allclose(g, kept[1], rtol=1e-12)


def with_profiles(problem, rng):
    """Give the edges of a problem profiles that say nothing of one another."""
    reference, samples = problem.reference, problem.samples
    known, seen = (rng.normal(0, 0.1, (len(each), 2)) for each in (reference, samples))
    problem.reference = replace(reference, profiles=known.astype(np.float32))
    problem.samples = replace(samples, profiles=(seen + np.array([0.5, -0.2])).astype(np.float32))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n", [1, 7, 399, 1000, 4500])
def test_trust_in_matches(seed, n):
    rng = np.random.default_rng(seed)
    known, profiles = (rng.normal(0, 0.1, (size, 2)).astype(np.float32) for size in (300, n))
    order = rng.permutation(300).astype(np.int32)
    matches, residuals = kernels.new_matches(n), rng.normal(size=n)
    matches.edge[:] = np.where(np.arange(n) % 10 == 5, -1, rng.integers(300, size=n))
    matches.normal[:] = normals = rng.normal(size=(n, 2))
    index = np.where(matches.edge >= 0, order[matches.edge], -1)
    seen = profiles, problems.random_edges(rng, n).gradients
    change, (middle, wide, norm) = both(
        "usual_change",
        lambda: kernels.usual_change(order, known, *seen, matches, 2.0),
        lambda: twins.usual_change(known, *seen, index, 2.0),
    )
    np.testing.assert_allclose(change.middle, middle, rtol=1e-5, atol=1e-7)
    assert (len(np.unique(change.middle)) > 2) == (n > 100)  # a few tell of no direction
    np.testing.assert_allclose(change.per, 1 / wide, rtol=1e-5)
    np.testing.assert_allclose(change.norm, norm, rtol=1e-5)
    given = residuals.copy()
    kernels.trust_matches(order, known, *seen, change, AT_ONCE.sharp, matches, residuals)
    trust = twins.trust(known, *seen, index, middle, wide, norm)
    matched = index >= 0
    count = np.count_nonzero(matched)
    np.testing.assert_allclose(residuals[:count], given[:count] * trust[matched], rtol=1e-6)
    np.testing.assert_array_equal(residuals[count:], given[count:])
    np.testing.assert_allclose(matches.normal, trust[:, None] * normals, rtol=1e-6)
    np.testing.assert_array_equal(matches.judged, matches.edge)
    # one that stays is not asked for again, and one that changes is
    matches.edge[:] = np.where(rng.random(n) < 0.5, matches.edge, rng.integers(300, size=n))
    index = order[matches.edge]
    kernels.trust_matches(order, known, *seen, change, AT_ONCE.sharp, matches, residuals)
    again = twins.trust(known, *seen, index, middle, wide, norm)
    now = matches.edge >= 0
    np.testing.assert_allclose(matches.trust[now], again[now], rtol=1e-6)


def test_where_nothing_matches_there_is_no_usual_change():
    known, profiles, gradients = np.ones((3, 5, 2), np.float32)
    order, matches = np.arange(5, dtype=np.int32), kernels.new_matches(5)
    change = kernels.usual_change(order, known, profiles, gradients, matches, 3.0)
    for got, wanted in zip(change, kernels.no_change(), strict=True):
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize("weight", ["t", "huber", "tukey"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("max_sigma", "spread"), [(np.inf, 0), (0.5, 0), (np.inf, 1), (0.5, 3)])
@pytest.mark.parametrize("smeared", [False, True])
def test_align(seed, weight, max_sigma, spread, smeared):
    rng = np.random.default_rng(seed)
    problem = problems.segments_problem(seed, problems.motion(rng, 0.05, 2.0), outliers=0.1)
    with_profiles(problem, rng)
    config = RegistrationConfig(weight=weight, first_samples=100, profile_spread=spread)
    matching = MatchingConfig(criterion="robust-then-normal")
    registration = Registration(problem.camera, matching, config)
    index = registration.index(problem.reference)
    limits = (problem.camera.width, matching.max_distance_px, matching.max_angle_deg)
    counts = rng.uniform(0.2, 1, len(problem.samples)) if smeared else np.ones(len(problem.samples))
    lag = AT_ONCE._replace(sharp=counts) if smeared else AT_ONCE
    alignment, (T, iterations, seen) = both(
        "align",
        lambda: registration.align(
            index, problem.samples, np.eye(4)[None], lag=lag, max_sigma_px=max_sigma
        ),
        lambda: twins.align(
            problem.reference,
            problem.samples.points(problem.camera),
            problem.samples.gradients,
            problem.camera,
            np.eye(4),
            Criterion(matching.gamma, *limits).compile(),
            Criterion(0.0, *limits).compile(),
            solver(config, max_sigma=max_sigma),
            problem.samples.profiles,
            counts,
        ),
    )
    np.testing.assert_allclose(alignment.T_ref_cur, T, atol=1e-6)
    assert alignment.iterations == iterations
    assert alignment.sigma_px <= max_sigma
    assert (alignment.trust == 1).all() == (not spread)
    assert (alignment.matches == seen.matches).mean() > 0.98  # ties aside


@pytest.mark.parametrize("seed", range(8))
def test_stretch_step(seed):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(9, 6))
    H, last = rows.T @ rows, rng.normal(size=6)
    step = last * rng.uniform(-0.5, 1.5) + rng.normal(size=6) * 0.3
    went, most, stretched = last * rng.uniform(1, 3), rng.uniform(1, 4), np.empty(6)
    told = kernels.stretch_step(H, step, last, went, most, stretched)
    expected = twins.stretch_step(H, step, last, went, most)
    assert told == (expected is not None)
    if told:
        np.testing.assert_allclose(stretched, expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.3])
@pytest.mark.parametrize("taken", [1.0, 1.1])
def test_a_stretched_step_goes_all_the_way(share, taken):
    """Where each step takes the same share of the way that is left, two of them tell it."""
    H, way = np.diag([1.0, 2, 3, 4, 5, 6]), np.arange(1.0, 7)
    last = share * way
    left = way - taken * last
    stretched = np.empty(6)
    assert kernels.stretch_step(H, share * left, last, taken * last, 4.0, stretched)
    np.testing.assert_allclose(stretched, left, rtol=1e-9)
    assert kernels.stretch_step(H, share * left, last, taken * last, 1.0, stretched)
    np.testing.assert_allclose(stretched, share * left, rtol=1e-9)  # no longer than it may be


def test_steps_that_grow_are_stretched_as_far_as_may_be_and_such_that_turn_back_are_shortened():
    H, stretched = np.eye(6), np.empty(6)
    step = np.arange(1.0, 7)
    assert kernels.stretch_step(H, step, step / 2, step / 2, 3.0, stretched)
    np.testing.assert_allclose(stretched, 3 * step)
    assert not kernels.stretch_step(H, step, step, step, 3.0, stretched)  # no telling
    assert not kernels.stretch_step(H, step, -step / 4, step / 2, 3.0, stretched)
    assert kernels.stretch_step(H, step, -step / 2, -step / 2, 3.0, stretched)  # it went too far
    np.testing.assert_allclose(stretched, step / 3)


def test_a_step_that_was_rejected_is_not_tried_again(monkeypatch):
    """Damping far below 1 shortens it by nothing that counts."""
    calls, again = [], []
    warp, first = kernels.warp_and_match, problems.segments_problem(0, np.eye(4))
    registration = Registration(first.camera, MatchingConfig(), RegistrationConfig())
    # what align calls has to be compiled by what is compiled itself
    registration.align(registration.index(first.reference), first.samples, np.eye(4)[None])
    monkeypatch.setattr(kernels, "warp_and_match", lambda *given: calls.append(1) or warp(*given))
    monkeypatch.setattr(kernels, "align", kernels.align.py_func)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        problem = problems.segments_problem(seed, problems.motion(rng, 0.02, 1.0), outliers=0.5)
        shaken = problem.samples.pixels + rng.normal(0, 1, problem.samples.pixels.shape)
        samples = replace(problem.samples, pixels=shaken.astype(np.float32))
        config = RegistrationConfig(stop_px=1e-9, stop_decrease=0.0, weight="tukey", max_stretch=1)
        registration = Registration(problem.camera, MatchingConfig(), config)
        index = registration.index(problem.reference)
        calls.clear()
        steps = registration.align(index, samples, np.eye(4)[None]).steps()
        pairs = [(a, b) for a, b in itertools.pairwise(steps) if not (a.accepted or b.accepted)]
        same = [(a, b) for a, b in pairs if b.step_px > (1 - kernels.SAME_STEP) * a.step_px]
        assert all(b.trial_cost == a.trial_cost for a, b in same)
        tried = sum(not np.isnan(step.trial_cost) for step in steps)
        assert len(calls) == 2 + tried - len(same)  # each stage begins with one
        again += same
    assert again


def test_align_on_rendered_images():
    frames, poses = problems.sequence()
    camera, config = problems.CAMERA, EdgesConfig()
    reference = extract_edges(frames[0].grey, config).describe(camera)
    current = extract_edges(frames[3].grey, config)
    which = np.arange(0, len(current), 5, dtype=np.int32)
    depths = np.empty(len(which), np.float32)
    kernels.depths_at(frames[3].depth, current.index[which], 2, 0.05, depths)
    samples = current.describe(camera, which[depths > 0], depths[depths > 0])
    matching = MatchingConfig(criterion="robust-then-normal")
    registration = Registration(camera, matching, RegistrationConfig(weight="t"))
    index = registration.index(reference)
    limits = (camera.width, matching.max_distance_px, matching.max_angle_deg)
    # off the lattice of pixels, where many matches tie
    start = se3.exp([0.0013, 0.0007, 0.0003, 0.0011, 0.0005, 0.0017])
    alignment, (T, *_) = both(
        "align, images",
        lambda: registration.align(index, samples, start[None]),
        lambda: twins.align(
            reference,
            samples.points(camera),
            samples.gradients,
            camera,
            start,
            Criterion(matching.gamma, *limits).compile(),
            Criterion(0.0, *limits).compile(),
            solver(),
            samples.profiles,
        ),
    )
    np.testing.assert_allclose(alignment.T_ref_cur, T, atol=1e-6)
    assert (alignment.trust != 1).any()
    distance, angle = problems.error(se3.inverse(poses[0]) @ poses[3], alignment.T_ref_cur)
    assert distance < 0.015
    assert angle < 0.3


# -------------------------------------------------------------------------------- shared errors


@pytest.mark.parametrize("name", robust.WEIGHTS)
def test_shared_factors(rng, name):
    edges = problems.random_edges(rng, 2000)
    pixels = edges.pixels * np.float32(1.02) - np.float32(5)  # ideal ones may lie outside
    index = rng.integers(-1, 2000, 1500).astype(np.int32)
    residuals = np.where(index >= 0, rng.standard_t(3, 1500) * 0.2, np.nan)
    robustly = robust.WEIGHTS[name], robust.TUNING.get(name, 2.0)
    trust = rng.uniform(0.1, 1.5, 1500)
    arguments = (pixels, edges.gradients, index, residuals, trust, *robustly, 0.2, 40.0, 12, 15, 4)
    value, expected = both(
        "shared_factors",
        lambda: kernels.shared_factors(*arguments),
        lambda: twins.shared_factors(*arguments),
    )
    assert value == pytest.approx(expected, rel=1e-6)
    assert value[0] != value[1]
    few = index.copy()
    few[100:] = -1
    for matches in (few, np.full(1500, -1, np.int32)):
        assert np.isnan(kernels.shared_factors(*arguments[:2], matches, *arguments[3:])[0])
        assert np.isnan(twins.shared_factors(*arguments[:2], matches, *arguments[3:])[0])


# -------------------------------------------------------------------------------------- witness


PLAIN = Camera(160, 120, 145.0, 146.0, 78.0, 61.0)
BENT = Camera(160, 120, 145.0, 146.0, 78.0, 61.0, (0.1, -0.2, -0.001, 0.002, 0.05))


def lens(camera):
    return kernels.Lens(*camera.distortion)


def test_distorted(rng):
    rays = rng.uniform(-0.6, 0.6, (500, 2))
    expected = LENS.distort(rays * (LENS.fx, LENS.fy) + (LENS.cx, LENS.cy))
    found = [kernels.distorted(x, y, lens(LENS)) for x, y in rays]
    np.testing.assert_allclose(
        np.array(found) * (LENS.fx, LENS.fy) + (LENS.cx, LENS.cy), expected, atol=1e-9
    )


@pytest.mark.parametrize("size", [1, 2, 3, 8])
def test_mirrored(size):
    for i in range(-7, size + 7):
        assert kernels.mirrored(i, size) == cv2.borderInterpolate(i, size, cv2.BORDER_REFLECT_101)


@pytest.mark.parametrize("side", [1, 2, 5, 7, 8])
def test_squares_ahead(rng, side):
    image = rng.random((30, 40)).astype(np.float32)
    least, expected = both(
        "least_ahead",
        lambda: kernels.least_ahead(image.flatten(), 40, side),
        lambda: twins.least_ahead(image, side),
    )
    rows, cols = expected.shape
    np.testing.assert_array_equal(least.reshape(30, 40)[:rows, :cols], expected)
    there = (image > 0.5).astype(np.int16)
    total, expected = both(
        "sum_ahead",
        lambda: kernels.sum_ahead(there.flatten(), 40, side),
        lambda: twins.sum_ahead(there, side),
    )
    np.testing.assert_array_equal(total.reshape(30, 40)[:rows, :cols], expected)


@pytest.mark.parametrize("reach", [0, 1, 3])
@pytest.mark.parametrize(("shape", "step"), [((120, 160), 4), ((480, 640), 4), ((11, 7), 3)])
def test_surround(rng, shape, step, reach):
    depth = rng.uniform(0.3, 8.0, shape).astype(np.float32)
    depth[rng.random(shape) < 0.4] = 0
    depth[: shape[0] // 4, : shape[1] // 3] = 0
    size = depth[step // 2 :: step, step // 2 :: step].shape
    kept, near, far = np.empty((3, *size), np.float32)
    _, expected = both(
        "surround",
        lambda: kernels.surround(depth, step, reach, kept, near, far),
        lambda: twins.surround(depth, step, reach),
    )
    for found, wanted in zip((kept, near, far), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("shape", [(20, 30), (3, 1), (1, 9)])
def test_fill_gaps(rng, shape):
    depth = rng.uniform(0.3, 8.0, shape).astype(np.float32)
    depth[rng.random(shape) < 0.6] = 0
    depth[: shape[0] // 3] = 0
    filled = np.empty_like(depth)
    _, expected = both(
        "fill_gaps", lambda: kernels.fill_gaps(depth, filled), lambda: twins.fill_gaps(depth)
    )
    np.testing.assert_array_equal(filled, expected)


@pytest.mark.parametrize("reach", [0, 1, 3])
def test_nearer_sides(rng, reach):
    depth = rng.uniform(1.0, 1.1, (40, 50)).astype(np.float32)
    depth[15:30, 20:40] += 0.2
    depth[rng.random(depth.shape) < 0.01] = 0
    index = np.arange(depth.size, dtype=np.int32)
    depths = np.empty(depth.size, np.float32)
    _, expected = both(
        "nearer_sides",
        lambda: kernels.nearer_sides(depth, index, reach, depths),
        lambda: twins.nearer_sides(depth, index, reach),
    )
    np.testing.assert_array_equal(depths, expected)
    assert 0.3 < np.count_nonzero(depths) / depth.size < 1


@pytest.mark.parametrize("around", [strays.NOWHERE, strays.ring(160)], ids=["all", "no strays"])
@pytest.mark.parametrize(("shape", "every"), [((120, 160), 4), ((7, 9), 3), ((1, 1), 1)])
def test_place_points(rng, shape, every, around):
    kept = (2.0 + rng.exponential(0.1, shape)).astype(np.float32)
    for row, col in rng.integers(shape, size=(kept.size // 50, 2)):
        kept[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = rng.uniform(0.3, 1.5)
    kept[rng.random(shape) < 0.4] = 0
    rays = rng.normal(size=(kept[every // 2 :: every, every // 2 :: every].size, 3))
    points = np.empty_like(rays)
    count, expected = both(
        "place_points",
        lambda: kernels.place_points(kept, every, rays, around, points),
        lambda: twins.place_points(kept, every, rays, around),
    )
    np.testing.assert_allclose(points[:count], expected, rtol=1e-12)
    assert min(shape) < 100 or 0.2 < count / len(rays) < 0.6  # some have no depth, some none beside
    strays_too = len(twins.place_points(kept, every, rays, strays.NOWHERE))
    assert min(shape) < 100 or (count < 0.95 * strays_too) == (len(around) > 0)


@pytest.mark.parametrize("camera", [PLAIN, BENT])
def test_points_in_front(rng, camera):
    points = rng.uniform((-1, -1, -0.2), (1, 1, 3), (1200, 3))
    T, (rows, cols) = problems.motion(rng, 0.1, 5.0), (30, 40)
    z, (cell, which) = np.empty(len(points)), np.empty((2, len(points)), np.int32)
    count, (expected_z, expected_cell, expected_which) = both(
        "warp_to_cells",
        lambda: kernels.warp_to_cells(
            points, T, pinhole(camera), lens(camera), 4, rows, cols, z, cell, which
        ),
        lambda: twins.warp_to_cells(points, T, camera, 4, rows, cols),
    )
    assert 100 < count < len(points)
    np.testing.assert_array_equal(cell[:count], expected_cell)
    np.testing.assert_array_equal(which[:count], expected_which)
    np.testing.assert_allclose(z[:count], expected_z, rtol=1e-12)
    near, far = np.sort(rng.uniform(0, 3, (2, rows, cols)), axis=0).astype(np.float32)
    near[near < 0.1], far[rng.random(far.shape) < 0.2] = 0, 0
    slack = 0.02 + 0.1 * rng.random(count)
    found, expected = both(
        "count_in_front",
        lambda: kernels.count_in_front(z[:count], slack, cell[:count], near, far),
        lambda: twins.count_in_front(z[:count], slack, cell[:count], near, far),
    )
    assert found == expected


@pytest.mark.parametrize("count", [0, 1, 60])
def test_far_points(rng, count):
    points, others = rng.uniform(-1, 1, (1500, 3)), rng.uniform(-1, 1, (count, 3))
    T, is_far = problems.motion(rng, 0.3, 20.0), np.empty(1500, np.bool_)
    _, expected = both(
        "find_far",
        lambda: kernels.find_far(points, T, others, 0.35, is_far),
        lambda: twins.find_far(points, T, others, 0.35),
    )
    np.testing.assert_array_equal(is_far, expected)
    assert np.any(~is_far) == (count > 0)
    assert np.any(is_far)


# ---------------------------------------------------------------------------- depth registration


@pytest.mark.parametrize("camera", [PLAIN, BENT])
def test_project_row(rng, camera):
    rays = rng.uniform(-4, 4, (3, 3, 500))
    z, shift, seen = rng.uniform(0.3, 3, 499), np.array([0.03, -0.01, 0.02]), np.empty((3, 499))
    _, expected = both(
        "project_row",
        lambda: kernels.project_row(
            z, rays, 2, 1, shift, pinhole(camera), lens(camera), camera.fold, seen
        ),
        lambda: twins.project_row(z, rays[:, 2, 1:], shift, camera),
    )
    visible = ~np.isnan(expected[0])
    assert 0.1 < visible.mean() < 0.9
    np.testing.assert_array_equal(~np.isnan(seen[0]), visible)
    np.testing.assert_array_equal(seen[:, visible], expected[:, visible])


@pytest.mark.parametrize("camera", [PLAIN, BENT])
@pytest.mark.parametrize("seed", range(4))
def test_splat_depth(camera, seed):
    rng = np.random.default_rng(seed)
    depth = depth_image(rng)
    depth[1, :3] = np.nan, np.inf, -1.0
    u, v = np.meshgrid(np.arange(161) - 0.5, np.arange(121) - 0.5)
    rays = np.stack(((u - 79.0) / 150.0, (v - 60.0) / 150.0, np.ones_like(u)))
    T = problems.motion(rng, 0.1, (3.0, 30.0, 90.0, 180.0)[seed])
    rays = np.ascontiguousarray(np.einsum("ij,jvu->ivu", T[:3, :3], rays))
    image = np.empty((120, 160), np.float32)
    _, expected = both(
        "splat_depth",
        lambda: kernels.splat_depth(
            depth, rays, T[:3, 3], pinhole(camera), lens(camera), camera.fold, 16, image
        ),
        lambda: twins.splat_depth(depth, rays, T[:3, 3], camera, 16),
    )
    np.testing.assert_array_equal(image, expected)


# ------------------------------------------------------------------------------------- evidence


@pytest.mark.parametrize("shape", [(480, 640), (3, 3), (4, 9), (11, 3)])
@pytest.mark.parametrize("steps", [1, 2, 4, 8])
def test_blurred_gradients(rng, shape, steps):
    grey = rng.integers(0, 256, shape, np.uint8)
    grey[:1], grey[-1:] = 0, 255  # as steep as can be
    du, dv = np.full((2, *shape), 77, np.int16)
    _, expected = both(
        "blurred_gradients",
        lambda: kernels.blurred_gradients(grey, np.int32(steps), du, dv),
        lambda: twins.blurred_gradients(grey, steps),
    )
    np.testing.assert_array_equal(du, expected[0])
    np.testing.assert_array_equal(dv, expected[1])
    if steps == 1:  # whole grey levels: OpenCV's, to the bit
        smooth = cv2.GaussianBlur(grey, (5, 5), 0)
        np.testing.assert_array_equal(du, cv2.Sobel(smooth, cv2.CV_16S, 1, 0))
        np.testing.assert_array_equal(dv, cv2.Sobel(smooth, cv2.CV_16S, 0, 1))


@pytest.mark.parametrize("shape", [(480, 640), (3, 3), (4, 9), (11, 3)])
@pytest.mark.parametrize("passes", [1, 2, 4])
def test_widely_blurred_gradients(rng, shape, passes):
    grey = rng.integers(0, 256, shape, np.uint8)
    grey[: shape[0] // 2], grey[:, -1:] = 255, 0
    du, dv = np.full((2, *shape), 77, np.int16)
    here, there = np.full((2, shape[0], shape[1] + 2), 77, np.int16)
    _, expected = both(
        "widely_blurred_gradients",
        lambda: kernels.widely_blurred_gradients(grey, np.int32(8), passes, here, there, du, dv),
        lambda: twins.blurred_gradients(grey, 8, passes),
    )
    np.testing.assert_array_equal(du, expected[0])
    np.testing.assert_array_equal(dv, expected[1])


def test_judge_matches(rng):
    matches = rng.integers(-1, 50, 400).astype(np.int32)
    matches[:100] = -1
    packed = rng.normal(0, 2, np.count_nonzero(matches >= 0))
    angle = rng.uniform(0, 2 * np.pi, 450)
    unit = np.column_stack((np.cos(angle), np.sin(angle))).astype(np.float32)
    residuals, matched = np.empty(len(matches)), np.empty((len(matches), 2), np.float32)
    given = matches, packed, 300 * unit[50:100], unit[:50], unit[50:], 2.0, 0.7071
    (inliers, agreeing), expected = both(
        "judge_matches",
        lambda: kernels.judge_matches(*given, residuals, matched),
        lambda: twins.judge_matches(*given),
    )
    assert 0 < agreeing < inliers < len(packed)
    assert (inliers, agreeing) == expected[:2]
    np.testing.assert_array_equal(residuals, expected[2])
    np.testing.assert_array_equal(matched, expected[3])


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 7), (5, 1), (4, 9)])
def test_marks_spread_to_their_neighbours(rng, shape):
    marks = rng.integers(0, 256, shape, np.uint8) * (rng.random(shape) < 0.3)
    spread = marks.copy()
    kernels.spread_marks(spread)
    for v, u in np.ndindex(shape):
        square = marks[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        assert spread[v, u] == np.bitwise_or.reduce(square, axis=None)


@settings(deadline=None)
@given(st.lists(st.floats(width=32, allow_nan=False), min_size=1, max_size=40), st.data())
def test_smallest_and_median_are_what_sorting_gives(values, data):
    values = np.array(values, np.float32)
    k = data.draw(st.integers(0, len(values) - 1))
    ordered = np.sort(values)
    assert kernels.smallest(values, k) == ordered[k]
    middle = ordered[[(len(values) - 1) // 2, len(values) // 2]].astype(np.float64)
    np.testing.assert_array_equal(kernels.median(values), middle.mean())


@settings(deadline=None)
@given(st.lists(st.integers(-9, 9), min_size=1, max_size=60), st.data())
def test_what_is_selected_is_what_sorting_gives(values, data):
    values = np.array(values, float)  # many of them alike
    k = data.draw(st.integers(0, len(values) - 1))
    parted = values.copy()
    assert kernels.select(parted, k) == np.sort(values)[k]
    np.testing.assert_array_equal(np.sort(parted), np.sort(values))
    assert (parted[:k] <= parted[k]).all()
    assert (parted[k:] >= parted[k]).all()


def test_kernels_that_count_no_references_keep_to_the_rules():
    """They make no array, return none, and call only their like: else memory is lost or freed."""
    tree = ast.parse(inspect.getsource(kernels))
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    lean = {
        name
        for name, node in functions.items()
        if any(isinstance(by, ast.Name) and by.id in LEAN for by in node.decorator_list)
    }
    assert {"scan_window", "nearest_in_grid", "warp_and_match", "chamfer_score"} <= lean
    for name in lean:
        assert functions[name].returns is not None
        returned = ast.unparse(functions[name].returns)
        assert not re.search(r"F64|F32|I32|I16|U8|NDArray|Matches|Grid", returned), name
        for call in ast.walk(functions[name]):
            if isinstance(call, ast.Call):
                called = ast.unparse(call.func)
                assert called in lean or called not in functions, (name, called)
                of = call.func.value if isinstance(call.func, ast.Attribute) else None
                if isinstance(of, ast.Call) and call.func.attr == "view":  # the bits of a number
                    called = ast.unparse(of.func)
                if called.startswith("np."):
                    assert called in SCALAR, (name, called)
