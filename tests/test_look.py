"""What an image looks like, against a twin in NumPy, and from one image to another."""

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.edges import EdgePixels, extract_edges
from edvo.look import COLS, ENOUGH, ROWS, Look

CAMERA = Camera(width=80, height=60, fx=70, fy=70, cx=39.5, cy=29.5)


def scattered(rng, n):
    """Edges anywhere, and a little beyond the image, as undistorted pixels may be."""
    pixels = rng.uniform((-3, -3), (82, 62), (n, 2)).astype(np.float32)
    angles = rng.uniform(0, 2 * np.pi, n)
    gradients = np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)
    return EdgePixels(pixels, gradients, np.zeros(n, np.float32))


def shares_by_numpy(edges):
    col = np.clip((edges.pixels[:, 0] * COLS / CAMERA.width).astype(int), 0, COLS - 1)
    row = np.clip((edges.pixels[:, 1] * ROWS / CAMERA.height).astype(int), 0, ROWS - 1)
    angle = np.degrees(np.arctan2(edges.gradients[:, 1], edges.gradients[:, 0])) % 180
    direction = np.floor((angle + 22.5) / 45).astype(int) % 4
    counts = np.bincount((row * COLS + col) * 4 + direction, minlength=ROWS * COLS * 4)
    return np.sqrt(counts / max(len(edges), 1))


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.parametrize("seed", range(3))
def test_shares_are_those_of_the_numpy_twin(seed):
    edges = scattered(np.random.default_rng(seed), 700)
    look = Look(edges, CAMERA)
    np.testing.assert_allclose(look.shares, shares_by_numpy(edges), atol=1e-6)
    assert np.isclose(look.likeness(look), 1)


def test_of_very_many_edges_some_tell_the_look(rng):
    edges = scattered(rng, 5 * ENOUGH)
    look = Look(edges, CAMERA)
    assert np.count_nonzero(look.shares) == len(look.shares)
    np.testing.assert_allclose(look.shares, shares_by_numpy(edges.every(5)), atol=1e-6)


def test_an_image_without_edges_is_like_no_other(rng):
    none = Look(scattered(rng, 0), CAMERA)
    assert none.likeness(none) == 0 == none.likeness(Look(scattered(rng, 50), CAMERA))


def test_a_look_stays_when_bright_and_dark_change_places(rng):
    grey = np.kron(rng.integers(0, 255, (6, 8)), np.ones((10, 10))).astype(np.uint8)
    config = EdgesConfig(strong_share=0)
    once, inverted = (
        Look(extract_edges(image, config).describe(CAMERA), CAMERA) for image in (grey, 255 - grey)
    )
    other = Look(scattered(rng, 700), CAMERA)
    assert once.likeness(inverted) > 0.99 > 0.95 > once.likeness(other)
