"""Directions at edges, on edges whose direction is known."""

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.edges import EdgeImage, extract_edges
from edvo.experiments.directions import angles_between, colour_wheel, common_edges, edge_normals

CAMERA = Camera(width=160, height=120, fx=130.0, fy=130.0, cx=79.5, cy=59.5)


def half_plane(angle_deg):
    """An edge through the middle, dark to bright along a direction, smooth as by a lens."""
    v, u = np.mgrid[:120, :160]
    a = np.radians(angle_deg)
    distance = (u - 79.6) * np.cos(a) + (v - 59.7) * np.sin(a)
    return np.clip(128 + 60 * np.tanh(distance), 0, 255).astype(np.uint8)


def edge_image(mask):
    zeros = np.zeros(mask.shape, np.int16)
    return EdgeImage(np.flatnonzero(mask).astype(np.int32), zeros, zeros)


@pytest.mark.parametrize("angle", [0, 90, 180, 270])
def test_on_a_straight_edge_along_the_grid_the_angle_is_zero(angle):
    edges = extract_edges(half_plane(angle), EdgesConfig())
    normals = edge_normals(edges)
    found = angles_between(edges.describe(CAMERA).gradients, normals, signed=False)
    assert len(found) > 80
    np.testing.assert_allclose(found, 0, atol=0.5)


@pytest.mark.parametrize("angle", [17, 30, 45, 62, 101])
def test_on_a_slanting_edge_it_is_small(angle):
    edges = extract_edges(half_plane(angle), EdgesConfig())
    normals = edge_normals(edges)
    found = angles_between(edges.describe(CAMERA).gradients, normals, signed=False)
    assert len(found) > 80
    assert np.median(found) < 4
    assert np.mean(found < 10) > 0.97


def test_a_gradient_that_is_turned_shows():
    edges = extract_edges(half_plane(90), EdgesConfig())
    turned = np.tile([np.cos(np.radians(65)), np.sin(np.radians(65))], (len(edges), 1))
    found = angles_between(turned, edge_normals(edges), signed=False)
    np.testing.assert_allclose(found, 25, atol=1e-6)


def test_the_normal_of_a_row_of_pixels_is_down_and_dots_have_none():
    mask = np.zeros((60, 80), bool)
    mask[20, 10:40] = True  # a line
    mask[40, 60] = mask[50, 5] = True  # dots
    normals = edge_normals(edge_image(mask))
    np.testing.assert_allclose(np.abs(normals[:30]), np.tile([0, 1], (30, 1)), atol=1e-12)
    assert np.isnan(normals[30:]).all()


def test_a_parallel_edge_nearby_changes_nothing_and_a_junction_has_no_normal():
    mask = np.zeros((60, 80), bool)
    mask[20, 10:40] = mask[23, 10:40] = True
    np.testing.assert_allclose(np.abs(edge_normals(edge_image(mask))[:, 1]), 1, atol=1e-12)
    mask = np.zeros((60, 80), bool)
    mask[30, 20:60] = mask[10:50, 40] = True
    normals = edge_normals(edge_image(mask))
    middle = np.flatnonzero(np.flatnonzero(mask) == 30 * 80 + 40)[0]
    assert np.isnan(normals[middle]).all()
    assert np.isfinite(normals[0]).all()


def test_edges_at_the_border_of_the_image_have_normals_too():
    mask = np.zeros((60, 80), bool)
    mask[0] = True
    np.testing.assert_allclose(np.abs(edge_normals(edge_image(mask))[:, 1]), 1, atol=1e-12)
    assert edge_normals(edge_image(np.zeros((60, 80), bool))).shape == (0, 2)


def test_angles_of_vectors_and_of_lines():
    a = np.array([[1.0, 0], [1, 0], [1, 0], [np.nan, 0]])
    b = np.array([[0.0, 1], [-1, 0], [np.cos(0.1), np.sin(-0.1)], [1, 0]])
    np.testing.assert_allclose(angles_between(a, b), [90, 180, np.degrees(0.1)], atol=1e-9)
    np.testing.assert_allclose(
        angles_between(a, b, signed=False), [90, 0, np.degrees(0.1)], atol=1e-9
    )


def test_common_edges_are_the_nearest_ones():
    rng = np.random.default_rng(0)
    a, b = (np.flatnonzero(rng.random((40, 50)) < 0.05).astype(np.int32) for _ in range(2))
    found, partner = common_edges(a, b, 50)
    expected = {}
    for i, p in enumerate(a):
        offsets = np.abs(np.array([b // 50 - p // 50, b % 50 - p % 50]))
        near = np.flatnonzero(offsets.max(axis=0) <= 1)
        if len(near):
            expected[i] = (offsets[:, near] ** 2).sum(axis=0).min()
    assert found.tolist() == list(expected)
    for i, j in zip(found, partner, strict=True):
        d = (b[j] // 50 - a[i] // 50) ** 2 + (b[j] % 50 - a[i] % 50) ** 2
        assert d == expected[i]
    assert len(common_edges(a, np.empty(0, np.int32), 50)[0]) == 0


def test_the_wheel_is_a_ring_whose_right_is_red():
    wheel = colour_wheel(101)
    assert wheel[50, 50, 3] == 0
    right = wheel[50, 95]
    assert right[3] == 1
    assert right[0] > 0.9
    assert max(right[1], right[2]) < 0.4


def test_a_real_drawing_has_its_normals_along_its_gradients():
    image = np.full((120, 160), 60, np.uint8)
    cv2.circle(image, (80, 60), 40, 180, -1, cv2.LINE_AA)
    edges = extract_edges(image, EdgesConfig())
    found = angles_between(edges.describe(CAMERA).gradients, edge_normals(edges), signed=False)
    assert len(found) > 0.8 * len(edges)
    assert np.median(found) < 4
