"""The covariance of a registration: against plain NumPy, Monte Carlo, and walls and corners."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.planes import NO_PLANES, NO_POINTS, PlaneFitter
from edvo.registration import EDGES_ALONE, Registration
from edvo.sensor import DEPTH_NOISE
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.uncertainty import (
    CELLS,
    DEGENERATE_M,
    DEGENERATE_RAD,
    DOUBT,
    PRIOR,
    SHARES,
    Uncertainty,
    combine,
    constrained_directions,
    degenerate_directions,
    describe,
    in_current_camera,
)

from . import problems, twins

CONFIG = Config()
CAMERA = Camera(width=640, height=480, fx=535.0, fy=539.0, cx=320.1, cy=247.6)
NO_EDGES = EdgePixels(*(np.zeros(shape, np.float32) for shape in ((0, 2), (0, 2), 0)))


def estimator(camera=CAMERA, config=CONFIG):
    registration = Registration(camera, config.matching, config.registration)
    return registration, Uncertainty(camera, config, registration.solver)


def depth_of(*planes):
    """Depth image of the nearest of the planes (normal, offset)."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    raw = np.stack([u.ravel(), v.ravel()], 1).astype(np.float64)
    rays = CAMERA.backproject(raw, np.ones(len(raw)))
    away = [rays @ np.asarray(normal) / offset for normal, offset in planes]
    return (1 / np.max(away, axis=0)).reshape(480, 640).astype(np.float32)


def by_depth_alone(*planes):
    """Covariance of a frame that shows planes and no edge at all."""
    fitter = PlaneFitter(CAMERA, CONFIG.planes)
    depth = depth_of(*planes)
    rng = np.random.default_rng(0)
    noise = DEPTH_NOISE["kinect_v1"].sigma_z(depth)
    noisy = [(depth + noise * rng.standard_normal(depth.shape)).astype(np.float32) for _ in "ab"]
    registration, uncertainty = estimator()
    index, map_, points = registration.index(NO_EDGES), *parts_of(fitter, *noisy)
    found = registration.align(index, NO_EDGES, np.eye(4)[None], map_, points, fitter.term)
    found = replace(found, sigma_px=1.0, sigma_depth=1.0, depth_balance=1.0)
    return uncertainty.covariance(index, NO_EDGES, map_, points, fitter.term, found)


def parts_of(fitter, depth, other):
    return fitter.planes(depth), fitter.points(other)


def names(covariance):
    return [describe(direction) for direction in degenerate_directions(covariance)]


def check_covariance(C):
    assert C.shape == (6, 6)
    assert C.dtype == np.float64
    assert (C == C.T).all()
    assert np.linalg.eigvalsh(C)[0] > 0


# ------------------------------------------------------------------------------- what is known


def test_a_blank_wall_leaves_two_translations_and_the_turn_about_its_normal():
    C = by_depth_alone(((0, 0, 1), 1.5))
    check_covariance(C)
    assert names(C) == ["translation along x", "translation along y", "rotation about z"]
    sigma = np.sqrt(np.diag(C))
    np.testing.assert_allclose(sigma[[0, 1, 5]], 1, rtol=1e-3)  # unknown
    assert sigma[2] < 3e-3
    assert (sigma[3:5] < np.radians(0.5)).all()


def test_a_slanted_wall_leaves_what_lies_in_it():
    normal = np.array([0.5, 0.1, 0.86])
    normal /= np.linalg.norm(normal)
    directions = degenerate_directions(by_depth_alone((normal, 1.5)))
    assert len(directions) == 3
    np.testing.assert_allclose(directions[:2, :3] @ normal, 0, atol=0.01)
    np.testing.assert_allclose(directions[:2, 3:], 0)
    np.testing.assert_allclose(np.abs(directions[2, 3:] @ normal), 1, atol=0.01)
    assert describe(directions[2]).startswith("rotation about (")


def test_two_walls_leave_the_translation_along_their_seam():
    right, left = np.array([0.7, 0, 0.71]), np.array([-0.7, 0, 0.71])
    assert names(by_depth_alone((right, 1.4), (left, 1.4))) == ["translation along y"]


def test_a_corner_leaves_nothing():
    C = by_depth_alone(((0.7, 0, 0.71), 1.4), ((-0.7, 0, 0.71), 1.4), ((0, 0.8, 0.6), 1.2))
    check_covariance(C)
    assert names(C) == []


def test_without_anything_all_is_unknown():
    zero = np.zeros((6, 6))
    C = combine(zero, np.zeros((4, 6, 6)), 1.0)
    np.testing.assert_allclose(C, np.diag(1 / PRIOR))
    assert [len(name) > 0 for name in names(C)] == [True] * 6
    assert names(C)[:3] == [f"translation along {axis}" for axis in "xyz"]


def test_the_bound_of_what_is_degenerate():
    sigma = np.array([DEGENERATE_M] * 3 + [DEGENERATE_RAD] * 3)
    assert names(np.diag((0.99 * sigma) ** 2)) == []
    sigma[:4] *= 0.5
    sigma[4] *= 1.01
    assert names(np.diag(sigma**2 * [1, 1, 1, 1, 1, 0.5])) == ["rotation about y"]


def test_a_motion_that_is_both():
    twist = np.array([0, DEGENERATE_M, 0, DEGENERATE_RAD, 0, 0])
    C = 4 * np.outer(twist, twist) + 1e-8 * np.eye(6)
    assert names(C) == ["translation along y with rotation about x"]


@pytest.mark.parametrize("seed", range(5))
def test_directions_span_what_is_loose(seed):
    """Whatever the mixture, the motions named are loose, and as many as there are."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    scale = np.array([DEGENERATE_M] * 3 + [DEGENERATE_RAD] * 3)
    k = seed + 1
    values = np.r_[np.full(k, 1e4), np.full(6 - k, 1e-4)]
    C = np.outer(scale, scale) * (Q * values @ Q.T)
    directions = degenerate_directions(C)
    assert np.linalg.matrix_rank(directions / scale) == len(directions) == k
    for direction in directions / scale:
        unit = direction / np.linalg.norm(direction)
        assert np.linalg.norm(Q[:, k:].T @ unit) < 0.15


# ------------------------------------------------------------------------------- NumPy's twin


def rows_by_numpy(problem, found, weight, tuning):
    """Of the matched samples: J, how much the other image's differs, r, w, cell, depth."""
    has = found.matches >= 0
    edges = problem.reference
    points = problem.samples.points(problem.camera)[has]
    Y, pixels, _ = twins.warp(points, problem.camera, found.T_ref_cur)
    normal = edges.gradients[found.matches[has]].astype(np.float64)
    r = ((pixels - edges.pixels[found.matches[has]]) * normal).sum(axis=1)

    def jacobian(n):
        a = np.column_stack(
            [n * [problem.camera.fx, problem.camera.fy] / Y[:, 2:], np.zeros(len(n))]
        )
        a[:, 2] = -(a[:, :2] * Y[:, :2]).sum(axis=1) / Y[:, 2]
        return np.hstack([a, np.cross(Y, a)])

    normal = normal * found.trust[has, None]
    r = r * found.trust[has]
    R = found.T_ref_cur[:2, :2] / np.hypot(*found.T_ref_cur[:2, 0])
    roll = np.array([[R[0, 0], -R[1, 0]], [R[1, 0], R[0, 0]]])
    other = problem.samples.gradients[has] @ roll.T
    other *= found.trust[has, None]
    other *= np.where((other * normal).sum(axis=1) < 0, -1, 1)[:, None]
    J = jacobian(normal)
    w = np.clip(1 - (r / found.sigma_px / tuning) ** 2, 0, None) ** 2
    size = problem.camera.width / CELLS
    cell = (pixels // size).astype(int) @ [1, 1000]
    turned = points @ found.T_ref_cur[:3, :3].T
    noise = DEPTH_NOISE["kinect_v1"].sigma_z(points[:, 2])
    by_depth = (J[:, :3] * turned).sum(axis=1) / points[:, 2] * noise
    return J, J - jacobian(other), r, w, cell, by_depth


def noisy_problem(seed):
    rng = np.random.default_rng(seed)
    problem = problems.segments_problem(seed, problems.motion(rng, 0.05, 2.0), outliers=0.1)
    pixels = problem.samples.pixels
    problem.samples = replace(
        problem.samples, pixels=(pixels + rng.normal(0, 0.5, pixels.shape)).astype(np.float32)
    )
    return problem


@pytest.mark.parametrize("seed", range(3))
def test_parts_equal_their_numpy_twin(seed):
    problem = noisy_problem(seed)
    registration, uncertainty = estimator(problem.camera)
    index = registration.index(problem.reference)
    found = registration.align(index, problem.samples, problem.T_ref_cur[None])
    found.matches[len(found.matches) - seed :] = -1  # the last ones, or none
    found.trust[:] = np.random.default_rng(seed).uniform(0.2, 1.5, len(found.trust))
    H, blur, parts, depth = uncertainty.parts(
        index, problem.samples, NO_PLANES, NO_POINTS, EDGES_ALONE, found
    )
    assert not depth.any()
    J, D, r, w, cell, by_depth = rows_by_numpy(problem, found, "tukey", 4.6851)
    np.testing.assert_allclose(H, J.T @ (w[:, None] * J), rtol=1e-6)
    np.testing.assert_allclose(blur, D.T @ (w[:, None] * D) / 2, rtol=1e-4, atol=1e-5 * blur.max())

    def shared(score):
        sums = [score[cell == c].sum(axis=0) for c in np.unique(cell)]
        return np.einsum("ci,cj->ij", sums, sums)

    wJ = w[:, None] * J
    total = (wJ * r[:, None]).sum(axis=0)
    wanted = [
        shared(wJ * r[:, None]),
        np.zeros((6, 6)),
        shared(wJ * by_depth[:, None]),
        np.outer(total, total),
    ]
    for part, twin in zip(parts, wanted, strict=True):
        np.testing.assert_allclose(part, twin, rtol=1e-5, atol=1e-6 * np.abs(twin).max())
    C = uncertainty.covariance(index, problem.samples, NO_PLANES, NO_POINTS, EDGES_ALONE, found)
    middle = np.tensordot(SHARES, wanted, 1)
    gain = np.linalg.inv(H - DOUBT * blur)
    twin = gain @ middle @ gain
    np.testing.assert_allclose(C, twin, rtol=1e-3, atol=1e-3 * np.abs(twin).max())
    check_covariance(C)


def test_depth_derivative_by_finite_differences():
    """What depth does to a residual is what the kernel says: its part for one sample a cell."""
    problem = noisy_problem(5)
    registration, uncertainty = estimator(problem.camera)
    index = registration.index(problem.reference)
    found = registration.align(index, problem.samples, problem.T_ref_cur[None])
    one = np.flatnonzero(found.matches >= 0)[7]
    alone = replace(
        found, matches=np.where(np.arange(len(found.matches)) == one, found.matches, -1)
    )
    H, _, parts, _ = uncertainty.parts(
        index, problem.samples, NO_PLANES, NO_POINTS, EDGES_ALONE, alone
    )

    def residual(dz, xi):
        samples = replace(problem.samples, depths=problem.samples.depths + dz)
        points = samples.points(problem.camera)[one][None].astype(np.float64)
        _, pixels, _ = twins.warp(points, problem.camera, se3.exp(xi) @ found.T_ref_cur)
        k = found.matches[one]
        return float((pixels[0] - problem.reference.pixels[k]) @ problem.reference.gradients[k])

    h, zero = 1e-3, np.zeros(6)
    slope = (residual(np.float32(h), zero) - residual(np.float32(-h), zero)) / (2 * h)
    noise = float(DEPTH_NOISE["kinect_v1"].sigma_z(problem.samples.depths[one]))
    J = np.array(
        [residual(np.float32(0), 1e-6 * e) - residual(np.float32(0), -1e-6 * e) for e in np.eye(6)]
    )
    J /= 2e-6
    w = H[0, 0] / J[0] ** 2
    np.testing.assert_allclose(H, w * np.outer(J, J), rtol=1e-3, atol=1e-3 * np.abs(H).max())
    wanted = (w * slope * noise) ** 2 * np.outer(J, J)
    np.testing.assert_allclose(parts[2], wanted, rtol=2e-2, atol=2e-2 * np.abs(wanted).max())


def test_planes_equal_their_numpy_twin():
    rng = np.random.default_rng(2)
    fitter = PlaneFitter(CAMERA, CONFIG.planes)
    depth = depth_of(((0.7, 0, 0.71), 1.4), ((-0.7, 0, 0.71), 1.4), ((0, 0.8, 0.6), 1.2))
    noisy = depth + DEPTH_NOISE["kinect_v1"].sigma_z(depth) * rng.standard_normal(depth.shape)
    planes, points = fitter.planes(depth), fitter.points(noisy.astype(np.float32))
    registration, uncertainty = estimator()
    index = registration.index(NO_EDGES)
    found = registration.align(index, NO_EDGES, np.eye(4)[None], planes, points, fitter.term)
    T = se3.exp([1e-3, -1e-3, 2e-3, 1e-3, 0, -1e-3])
    found = replace(found, T_ref_cur=T, sigma_px=0.4, sigma_depth=0.8, depth_balance=0.3)
    H, blur, parts, by_depth = uncertainty.parts(
        index, NO_EDGES, planes, points, fitter.term, found
    )
    np.testing.assert_array_equal(by_depth, H)
    near = kernels.new_plane_matches(len(points.sigma))
    count = kernels.match_planes(planes, points, fitter._pinhole, T, fitter.term, near)
    assert count > 500
    Y, n, r = near.Y[:, :count].T, near.normal[:, :count].T, near.residuals[:count]
    J = np.hstack([n, np.cross(Y, n)])
    w = 0.3 * (0.4 / 0.8) ** 2 * np.clip(1 - (r / 0.8 / 4.685) ** 2, 0, None) ** 2
    np.testing.assert_allclose(H, J.T @ (w[:, None] * J), rtol=1e-6, atol=1e-6 * np.abs(H).max())
    other = points.normals[near.point[:count]] @ T[:3, :3].T
    other *= np.linalg.norm(n, axis=1, keepdims=True)
    D = J - np.hstack([other, np.cross(Y, other)])
    np.testing.assert_allclose(blur, D.T @ (w[:, None] * D) / 2, rtol=1e-6, atol=1e-6 * blur.max())
    pixel = Y[:, :2] / Y[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
    cell = np.clip(pixel // 40, 0, [16, 12]).astype(int) @ [1, 1000]
    sums = np.array([(w * r)[cell == c] @ J[cell == c] for c in np.unique(cell)])
    np.testing.assert_allclose(
        parts[1], sums.T @ sums, rtol=1e-5, atol=1e-6 * np.abs(parts[1]).max()
    )
    assert not parts[[0, 2, 3]].any()


# ------------------------------------------------------------------------------- frames


def test_it_moves_to_the_other_camera_as_errors_do():
    rng = np.random.default_rng(3)
    T = problems.motion(rng, 0.3, 20.0)
    root = rng.normal(size=(6, 6)) * 1e-3
    C = root @ root.T
    errors = rng.multivariate_normal(np.zeros(6), C, 4000)
    moved = [se3.log(se3.inverse(T) @ se3.exp(error) @ T) for error in errors]
    D = in_current_camera(C, T)
    check_covariance(0.5 * (D + D.T))
    scale = np.sqrt(np.diag(D))
    np.testing.assert_allclose(
        np.cov(np.transpose(moved)) / np.outer(scale, scale), D / np.outer(scale, scale), atol=0.06
    )
    np.testing.assert_allclose(in_current_camera(D, se3.inverse(T)), C, atol=1e-12)


def test_the_odometry_gives_it_with_each_frame():
    recipe = make_recipe("texture_near", frames=8, camera=problems.CAMERA, seed=4)
    source = SyntheticSource(recipe)
    odometry = Odometry(source.camera)
    results = [odometry.track(source.read(i).frame) for i in range(len(source))]
    assert results[0].covariance is None
    for result in results[1:]:
        assert result.status is Status.TRACKED
        assert result.degenerate == ()
        check_covariance(result.covariance)
        T_true = se3.inverse(source.recipe.motion.at(results[result.keyframe].timestamp))
        T_true = T_true @ source.recipe.motion.at(result.timestamp)
        error = se3.log(T_true @ se3.inverse(result.T_key_cur))
        assert error @ np.linalg.solve(result.covariance, error) < 40
        sigma = np.sqrt(np.diag(result.covariance))
        assert (sigma[:3] < 5e-3).all()
        assert (sigma[3:] < np.radians(0.3)).all()
    assert odometry.skip(1.0, "gone").covariance is None


def test_what_nothing_constrains_is_not_called_tracked():
    """Vertical stripes on a wall do not tell how far up the camera is."""
    rng = np.random.default_rng(0)
    stripes = np.where(np.arange(640) // 40 % 2, 200.0, 60.0)
    depth = depth_of(((0, 0, 1), 1.5))
    noise = DEPTH_NOISE["kinect_v1"].sigma_z(depth)
    odometry, results = Odometry(CAMERA), []
    for i in range(2):
        grey = np.clip(stripes + 2 * rng.standard_normal((480, 640)), 0, 255).astype(np.uint8)
        noisy = (depth + noise * rng.standard_normal(depth.shape)).astype(np.float32)
        results.append(odometry.track(Frame(i / 30, grey, noisy)))
    result = results[1]
    assert result.status is Status.DEGRADED
    assert result.degenerate == ("translation along y",)
    assert result.reason == "not constrained: translation along y"
    assert np.sqrt(result.covariance[1, 1]) > 0.1


def test_errors_shared_by_neighbours_make_it_larger():
    """The same noise, once drawn anew for each sample and once for each cell of the image."""
    rng = np.random.default_rng(7)
    problem = problems.segments_problem(7, problems.motion(rng, 0.05, 2.0))
    pixels = problem.samples.pixels
    registration, uncertainty = estimator(problem.camera)
    index = registration.index(problem.reference)
    cell = (pixels // 40).astype(int) @ [1, 16]
    volumes = []
    for group in (np.arange(len(pixels)), cell):
        noise = rng.normal(0, 0.4, (group.max() + 1, 2))[group]
        samples = replace(problem.samples, pixels=(pixels + noise).astype(np.float32))
        found = registration.align(index, samples, problem.T_ref_cur[None])
        H, _, parts, _ = uncertainty.parts(index, samples, NO_PLANES, NO_POINTS, EDGES_ALONE, found)
        gain = np.linalg.inv(H)
        volumes.append(
            np.sqrt(np.diag(gain @ parts[0] @ gain)) / np.sqrt(np.diag(gain)) / found.sigma_px
        )
    assert (volumes[1] > 1.3 * volumes[0]).all()


def test_constrained_directions_are_those_that_are_not_degenerate():
    rng = np.random.default_rng(0)
    bounds = np.array([DEGENERATE_M] * 3 + [DEGENERATE_RAD] * 3)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    covariance = (Q * np.array([0.1, 0.5, 0.9, 1.1, 4.0, 900.0])) @ Q.T * np.outer(bounds, bounds)
    basis = constrained_directions(covariance)
    assert basis.shape == (6, 3)
    np.testing.assert_allclose(np.abs(basis.T @ (Q[:, :3] / bounds[:, None])), np.eye(3), atol=1e-9)
    assert len(degenerate_directions(covariance)) == 3
    assert constrained_directions(np.eye(6)).shape == (6, 0)
    assert constrained_directions(1e-8 * np.eye(6)).shape == (6, 6)
