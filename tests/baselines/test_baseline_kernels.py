"""The baselines' kernels against what they compute, in plain NumPy, and against differences."""

import itertools

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import robust, se3
from edvo.baselines import kernels
from edvo.baselines.least_squares import Robust, fit
from edvo.kernels import Pinhole

CAMERA = Pinhole(150.0, 152.0, 79.3, 60.1, 160, 120)
T = se3.exp([0.02, -0.03, 0.01, 0.02, -0.01, 0.03])
STEP = 1e-4


def bumps() -> NDArray[np.float32]:
    """A smooth image, so that a bilinear lookup has the derivative of the image."""
    noise = np.random.default_rng(1).normal(size=(120, 160))
    smooth = cv2.GaussianBlur(noise, (0, 0), 8.0)
    return np.asarray(120 + 100 * smooth / np.abs(smooth).max(), np.float32)


def cloud(n: int) -> NDArray[np.float64]:
    """Points before the camera, well inside its view."""
    rng = np.random.default_rng(2)
    z = rng.uniform(1.0, 3.0, n)
    u, v = rng.uniform(25, 135, n), rng.uniform(25, 95, n)
    return np.column_stack(((u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z))


def warp(points: NDArray[np.float64], motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels of moved points, with NumPy."""
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    return moved[:, :2] / moved[:, 2:] * CAMERA[:2] + CAMERA[2:4]


def distance_rows(field, points, motion):
    rows = np.empty((len(points), kernels.ROW), np.float32)
    count = kernels.distance_rows(field, points, motion, CAMERA, rows)
    return rows[:count].astype(float)


def photometric_rows(image, points, motion):
    rows = np.empty((len(points), kernels.ROW), np.float32)
    pairs = np.empty((len(points), 2), np.float32)
    count = kernels.photometric_rows(points, image, motion, CAMERA, rows, pairs)
    return rows[:count].astype(float), pairs[:count]


def by_differences(residuals) -> NDArray[np.float64]:
    """Derivative over a left perturbation of T, central differences."""
    columns = [
        (residuals(se3.exp(STEP * axis) @ T) - residuals(se3.exp(-STEP * axis) @ T)) / (2 * STEP)
        for axis in np.eye(6)
    ]
    return np.stack(columns, axis=1)


def inside_a_patch(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out what a small step takes over a pixel's border, where the derivative jumps."""
    fraction = warp(points, T) % 1
    return points[((fraction > 0.1) & (fraction < 0.9)).all(axis=1)]


def test_distances_are_those_of_the_transform_at_the_warped_points() -> None:
    mask = np.full((120, 160), 255, np.uint8)
    mask[30, 20:140] = 0
    field = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    points = cloud(300)
    pixels = warp(points, T)
    below = (pixels[:, 1] > 32) & (np.abs(pixels[:, 0] - 80) < 58)
    rows = distance_rows(field, points[below], T)
    np.testing.assert_allclose(rows[:, 0], pixels[below, 1] - 30, atol=1e-3)


def test_jacobian_of_the_distance_by_differences() -> None:
    mask = np.full((120, 160), 255, np.uint8)
    mask[60, 80] = 0
    field = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    points = inside_a_patch(cloud(300))
    numeric = by_differences(lambda motion: distance_rows(field, points, motion)[:, 0])
    rows = distance_rows(field, points, T)
    scale = np.abs(rows[:, 1:]).max()
    np.testing.assert_allclose(rows[:, 1:], numeric, atol=2e-3 * scale)


def test_jacobian_of_the_brightness_by_differences() -> None:
    """Where both images' gradients agree, their mean is the gradient of either."""
    grey = bumps()
    image = np.empty((*grey.shape, 3), np.float32)
    kernels.central_differences(grey, image)
    xyz = inside_a_patch(cloud(400))
    pixels = warp(xyz, T).astype(np.float32)
    looked_up = cv2.remap(image, pixels[:, None], None, cv2.INTER_LINEAR).reshape(-1, 3)
    points = np.column_stack((xyz, looked_up)).astype(np.float32)
    numeric = by_differences(lambda motion: photometric_rows(image, points, motion)[0][:, 0])
    rows, pairs = photometric_rows(image, points, T)
    scale = np.abs(numeric).max()
    np.testing.assert_allclose(rows[:, 1:], numeric, atol=0.05 * scale)
    np.testing.assert_allclose(pairs[:, 1] - pairs[:, 0], rows[:, 0], atol=1e-4)
    np.testing.assert_allclose(rows[:, 0], 0, atol=0.2)  # remap rounds to a 32nd of a pixel


def test_points_out_of_sight_have_no_row() -> None:
    points = np.array([[0, 0, 2.0], [0, 0, -1.0], [0, 0, 0.01], [9.0, 0, 2.0], [0, -9.0, 2.0]])
    field = np.zeros((120, 160), np.float32)
    assert len(distance_rows(field, points, np.eye(4))) == 1
    six = np.zeros((5, 6), np.float32)
    six[:, :3] = points
    assert len(photometric_rows(np.zeros((120, 160, 3), np.float32), six, np.eye(4))[0]) == 1


def test_scale_is_that_of_the_plain_twin() -> None:
    rows = np.random.default_rng(3).standard_t(5, size=(1000, kernels.ROW)).astype(np.float32)
    found = kernels.student_scale(rows, 900, 5.0, 1.0, 1e-3)
    assert found == pytest.approx(robust.student_scale(rows[:900, 0].astype(float), 5.0), rel=1e-6)


def test_normal_equations_are_those_of_numpy() -> None:
    rows = np.random.default_rng(4).normal(size=(500, kernels.ROW)).astype(np.float32)
    H, b = np.empty((6, 6)), np.empty(6)
    total = kernels.normal_equations(rows, 400, 5.0, 0.7, H, b)
    r, J = rows[:400, 0].astype(float), rows[:400, 1:].astype(float)
    w = robust.weights(r / 0.7, "t", 5.0)
    np.testing.assert_allclose(H, J.T @ (w[:, None] * J), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(b, J.T @ (w * r), rtol=1e-6, atol=1e-6)
    assert total == pytest.approx(w.sum())


def test_the_cost_falls_along_the_weighted_gradient() -> None:
    """Weight x residual / sigma^2 is the derivative of the cost."""
    rows = np.zeros((1, kernels.ROW), np.float32)
    for r in (0.1, 1.0, 4.0):
        costs = []
        for value in (r - 1e-2, r + 1e-2):
            rows[0, 0] = value
            costs.append(kernels.student_cost(rows, 1, 5.0, 0.8))
        weight = robust.weights(np.array([r / 0.8]), "t", 5.0)[0]
        assert (costs[1] - costs[0]) / 2e-2 == pytest.approx(weight * r / 0.8**2, rel=1e-3)


def test_fit_finds_a_motion_in_spite_of_outliers() -> None:
    rng = np.random.default_rng(5)
    points = cloud(200)
    pixels = warp(points, T)
    pixels[:40] += rng.uniform(-30, 30, (40, 2))

    def linearise(motion: NDArray[np.float64], rows: NDArray[np.float32]) -> int:
        def residuals(at: NDArray[np.float64]) -> NDArray[np.float64]:
            return (warp(points, at) - pixels).ravel()

        rows[:, 0] = residuals(motion)
        for k, axis in enumerate(np.eye(6)):
            up, down = se3.exp(STEP * axis) @ motion, se3.exp(-STEP * axis) @ motion
            rows[:, 1 + k] = (residuals(up) - residuals(down)) / (2 * STEP)
        return len(rows)

    terms = Robust(2.0, floor=1e-3, min_rows=6, max_iterations=99, stop=1e-4, stop_decrease=0.0)
    found = fit(linearise, np.eye(4), 400, terms)
    assert found is not None
    np.testing.assert_allclose(found.T, T, atol=1e-4)


def test_fit_has_no_answer_to_too_little() -> None:
    terms = Robust(nu=5.0, floor=1e-3, min_rows=6, max_iterations=50, stop=1e-4)

    def flat(motion: NDArray[np.float64], rows: NDArray[np.float32]) -> int:
        rows[:] = 0
        return len(rows)

    assert fit(flat, np.eye(4), 3, terms) is None
    assert fit(flat, np.eye(4), 100, terms) is None


def test_half_depth_leaves_out_contours_and_holes() -> None:
    depth = np.array([[2, 2.02, 1, 2, 0, 2], [2, 2.02, 2, 2, 2, 2]], np.float32)
    half = np.empty((1, 3), np.float32)
    kernels.halve_depth(depth, 0.05, half)
    np.testing.assert_allclose(half, [[2.01, 0, 0]])


def test_stray_depths_are_left_out() -> None:
    depth = np.full((7, 9), 2.0, np.float32)
    depth[3, 4] = 0.1
    kept = np.empty_like(depth)
    kernels.smooth_depth_only(depth, 0.05, kept)
    away = np.abs(np.arange(9) - 4)[None, :] + np.abs(np.arange(7) - 3)[:, None] > 1
    inner = np.zeros_like(away)
    inner[1:-1, 1:-1] = True
    np.testing.assert_array_equal(kept > 0, away & inner)


def test_gradients_are_those_of_a_ramp() -> None:
    v, u = np.mgrid[:5, :6].astype(np.float32)
    image = np.empty((5, 6, 3), np.float32)
    kernels.central_differences(3 * u - 2 * v, image)
    np.testing.assert_array_equal(image[..., 1], 3)
    np.testing.assert_array_equal(image[..., 2], -2)


def test_bits_are_counted() -> None:
    a, b = np.random.default_rng(6).integers(0, 256, (2, 50, 32), dtype=np.uint8)
    expected = np.unpackbits(a ^ b, axis=1).sum(axis=1)
    for k in range(50):
        assert kernels.distance_in_bits(a[k].view(np.uint64), b[k].view(np.uint64)) == expected[k]


def test_matches_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(7)
    n, m, radius, ratio = 60, 70, 25.0, 0.9
    predicted = rng.uniform(0, 100, (n, 2)).astype(np.float32)
    pixels = rng.uniform(0, 100, (m, 2)).astype(np.float32)
    bytes_a = rng.integers(0, 256, (n, 32), dtype=np.uint8)
    bytes_b = rng.integers(0, 256, (m, 32), dtype=np.uint8)
    bytes_b[:40] = bytes_a[:40]
    bytes_b[:40, :5] = rng.integers(0, 256, (40, 5))
    octaves_a = rng.integers(0, 3, n).astype(np.int32)
    octaves_b = rng.integers(0, 3, m).astype(np.int32)
    pixels[:30] = predicted[:30] + rng.uniform(-20, 20, (30, 2))

    bits = np.full((n, m), 257)
    for i, j in itertools.product(range(n), range(m)):
        near = np.abs(pixels[j] - predicted[i]).max() <= radius
        if near and abs(octaves_a[i] - octaves_b[j]) <= 1:
            bits[i, j] = np.unpackbits(bytes_a[i] ^ bytes_b[j]).sum()
    expected = np.full(n, kernels.NO_MATCH)
    for i in range(n):
        j = int(bits[i].argmin())
        second = np.partition(bits[i], 1)[1]
        if bits[i, j] <= 64 and bits[i, j] < ratio * second and bits[:, j].argmin() == i:
            expected[i] = j

    matches = np.empty(n, np.int32)
    count = kernels.match_near(
        predicted,
        pixels,
        bytes_a.view(np.uint64),
        bytes_b.view(np.uint64),
        octaves_a,
        octaves_b,
        radius,
        64,
        ratio,
        matches,
    )
    np.testing.assert_array_equal(matches, expected)
    assert count == np.count_nonzero(expected >= 0) > 10
