"""Whether an image was compressed in blocks, and that their borders are no edges then."""

import cv2
import numpy as np
import pytest

from edvo import kernels
from edvo.compression import blockiness
from edvo.config import EdgesConfig
from edvo.edges import extract_edges

from . import problems, twins
from .test_kernels import both

SHAPE = (240, 320)
MOST = EdgesConfig().max_blockiness


def panel(seed=0):
    """A dim slope with a little noise, and a brighter square."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    grey = 90 + 0.15 * u + 0.05 * v + np.random.default_rng(seed).normal(0, 1.0, SHAPE)
    grey[101:163, 84:190] += 30
    return grey.round().astype(np.uint8)


def compressed(grey, quality):
    data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize("quality", [80, 60, 30])
def test_blocks_are_seen(quality):
    assert blockiness(compressed(panel(), quality)) > MOST


def test_none_are_seen_where_there_are_none():
    textured = problems.drawn_image(np.random.default_rng(0))
    for grey in (panel(), textured, np.full(SHAPE, 7, np.uint8)):
        assert blockiness(grey) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (8, 9), (9, 8)])
def test_images_too_small_for_two_blocks(shape):
    assert blockiness(np.zeros(shape, np.uint8)) == 1


def test_steps_are_those_by_numpy():
    grey = np.random.default_rng(1).integers(0, 12, (50, 67)).astype(np.uint8)
    grey[:, 40:] += 100
    found, expected = both(
        "mean_steps",
        lambda: kernels.mean_steps(grey, 10, 4),
        lambda: twins.mean_steps(grey, 10, 4),
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_their_borders_are_no_faint_edges():
    grey = compressed(panel(), 30)
    inside = np.zeros(SHAPE, bool)
    inside[96:168, 79:195] = True  # the square, and as far as its own blocks reach

    def beside(edges):
        return np.count_nonzero(~inside.ravel()[edges.index])

    assert beside(extract_edges(grey, EdgesConfig(), faint=True)) <= 5
    assert len(extract_edges(grey, EdgesConfig(), faint=True)) > 200
    taken_for_edges = EdgesConfig(max_blockiness=1e9)
    assert beside(extract_edges(grey, taken_for_edges, faint=True)) > 50
