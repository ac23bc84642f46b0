"""The grid and the tree give what looking at every pair gives, on random and on real edges."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import se3
from edvo.config import EdgesConfig
from edvo.datasets import open_source
from edvo.edges import EdgePixels, depth_at_edges, extract_edges
from edvo.matching import Criterion, EdgeIndex, match_all_pairs

from . import problems, twins

WIDTH = 640
METHODS = ("grid", "tree")
# float32 pixels: a cost is right to about 1e-6 of the terms it is made of
RELATIVE, ABSOLUTE = 1e-5, 1e-3


def all_costs(edges, pixels, gradients, criterion):
    """Eq. (6) times width^2 for every pair, and how far each pair is from being rejected."""
    offset = edges.pixels[None].astype(np.float64) - pixels[:, None]
    distance = np.linalg.norm(offset, axis=2)
    dot = gradients.astype(np.float64) @ edges.gradients.astype(np.float64).T
    cost = distance**2 + criterion.gamma / 4 * criterion.width**2 * (dot - 1) ** 2
    out = distance > criterion.max_distance_px
    doubtful = np.isclose(distance, criterion.max_distance_px, rtol=1e-5, atol=0)
    if criterion.max_angle_deg < 180:
        least = math.cos(math.radians(criterion.max_angle_deg))
        out |= dot < least
        doubtful |= np.isclose(dot, least, rtol=0, atol=1e-5)
    return np.where(out, np.inf, cost), doubtful


def check(edges, pixels, gradients, criterion, cell_px=4.0):
    """Assert that grid, tree and every pair agree on all queries, ties and limits aside."""
    expected = match_all_pairs(edges, pixels, gradients, criterion)
    assert expected.indices.dtype == np.int32
    assert expected.costs.dtype == np.float64
    if not len(edges):
        for method in METHODS:
            found = EdgeIndex(edges, method).match(pixels, gradients, criterion)
            np.testing.assert_array_equal(found.indices, -1)
            np.testing.assert_array_equal(found.costs, np.inf)
        return
    costs, doubtful = all_costs(edges, pixels, gradients, criterion)
    rows = np.arange(len(pixels))
    clear = ~doubtful.any(axis=1)
    least = costs.min(axis=1)
    np.testing.assert_allclose(expected.costs[clear], least[clear], rtol=RELATIVE, atol=ABSOLUTE)
    tolerance = ABSOLUTE + RELATIVE * np.where(np.isinf(least), 0, least)
    unique = (costs <= (least + tolerance)[:, None]).sum(axis=1) == 1
    for method in METHODS:
        found = EdgeIndex(edges, method, cell_px).match(pixels, gradients, criterion)
        assert found.indices.dtype == np.int32
        none = found.indices < 0
        np.testing.assert_array_equal(none[clear], np.isinf(least)[clear], err_msg=method)
        np.testing.assert_array_equal(np.isinf(found.costs), none)
        np.testing.assert_allclose(
            found.costs[clear], least[clear], rtol=RELATIVE, atol=ABSOLUTE, err_msg=method
        )
        # the cost told is that of the edge told
        some = clear & ~none
        own = costs[rows[some], found.indices[some]]
        np.testing.assert_allclose(found.costs[some], own, rtol=RELATIVE, atol=ABSOLUTE)
        np.testing.assert_array_equal(
            found.indices[clear & unique], expected.indices[clear & unique], err_msg=method
        )


def unit(angles):
    return np.column_stack((np.cos(angles), np.sin(angles))).astype(np.float32)


def arrange(kind, rng, n):
    """Edges in one of the arrangements that a search may trip over."""
    if kind == "uniform":
        return problems.random_edges(rng, n)
    if kind == "clustered":
        centres = rng.uniform((0, 0), (640, 480), (3, 2))
        pixels = centres[rng.integers(3, size=n)] + rng.normal(0, 2, (n, 2))
        angles = rng.choice([0.3, 0.31, 3.4], n) + rng.normal(0, 0.02, n)
    elif kind == "row":  # collinear: one cell high
        pixels = np.column_stack((rng.integers(0, 640, n), np.full(n, 200)))
        angles = np.full(n, np.pi / 2)
    elif kind == "column":
        pixels = np.column_stack((np.full(n, 0), rng.integers(0, 480, n)))
        angles = rng.choice([0.0, np.pi], n)
    elif kind == "duplicates":
        pixels = rng.integers(0, 4, (n, 2)) * 50
        angles = rng.integers(0, 4, n) * np.pi / 2
    elif kind == "lattice":  # whole pixels and few directions: many ties
        pixels = rng.integers(0, 30, (n, 2))
        angles = rng.integers(0, 8, n) * np.pi / 4
    else:
        raise AssertionError(kind)
    return EdgePixels(pixels.astype(np.float32), unit(angles), np.zeros(n, np.float32))


KINDS = ("uniform", "clustered", "row", "column", "duplicates", "lattice")


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(KINDS),
    n=st.sampled_from([0, 1, 2, 3, 7, 60, 400]),
    gamma=st.sampled_from([0.0, 0.05, 0.7, 5.0]),
    max_distance=st.sampled_from([0.0, 0.4, 3.0, 30.0, 1e4, math.inf]),
    max_angle=st.sampled_from([1.0, 30.0, 90.0, 179.0, 180.0]),
    cell=st.sampled_from([0.7, 4.0, 8.0, 33.0, 2000.0]),
    reach=st.sampled_from([0.0, 1.0, 30.0, 5000.0]),
)
def test_all_methods_agree(seed, kind, n, gamma, max_distance, max_angle, cell, reach):
    rng = np.random.default_rng(seed)
    edges = arrange(kind, rng, n)
    count = 40
    # on the edges, near them, anywhere, and (by reach) far outside of the image
    near = edges.pixels[rng.integers(n, size=count)] if n else np.zeros((count, 2))
    pixels = (near + rng.normal(0, 1, (count, 2)) * reach).astype(np.float32)
    gradients = unit(rng.uniform(0, 2 * np.pi, count))
    if n:
        same = rng.random(count) < 0.5
        gradients[same] = edges.gradients[rng.integers(n, size=int(same.sum()))]
    check(edges, pixels, gradients, Criterion(gamma, WIDTH, max_distance, max_angle), cell)


coordinate = st.floats(-50, 700, width=32)
angle = st.floats(0, 6.25, width=32)
places = st.lists(st.tuples(coordinate, coordinate, angle), min_size=1, max_size=12)


@settings(max_examples=100)
@given(edges=places, queries=places, gamma=st.floats(0, 3), reach=st.floats(0.1, 2000))
def test_any_few_edges(edges, queries, gamma, reach):
    edges, queries = np.array(edges, np.float32), np.array(queries, np.float32)
    reference = EdgePixels(edges[:, :2].copy(), unit(edges[:, 2]), np.zeros(len(edges), np.float32))
    check(reference, queries[:, :2].copy(), unit(queries[:, 2]), Criterion(gamma, WIDTH, reach))


def test_the_criterion_by_hand():
    edges = EdgePixels(
        np.array([[10, 10], [13, 10]], np.float32),
        np.array([[-1, 0], [1, 0]], np.float32),
        np.zeros(2, np.float32),
    )
    query, gradient = np.array([[11, 10]], np.float32), np.array([[1, 0]], np.float32)
    for method in ("grid", "tree", "brute"):
        index = EdgeIndex(edges, method)
        assert len(index) == 2
        normal = index.match(query, gradient, Criterion(0.0, WIDTH))
        assert normal.indices.tolist() == [0]
        assert normal.costs.tolist() == [1.0]
        robust = index.match(query, gradient, Criterion(0.7, WIDTH))
        assert robust.indices.tolist() == [1]
        assert robust.costs.tolist() == [4.0]
        # the nearer one points the other way: |p|^2 + gamma / 4 width^2 (-1 - 1)^2
        alone = EdgeIndex(
            EdgePixels(edges.pixels[:1], edges.gradients[:1], edges.depths[:1]), method
        )
        found = alone.match(query, gradient, Criterion(0.7, WIDTH))
        assert found.costs[0] == pytest.approx(1 + 0.7 / 4 * WIDTH**2 * 4)
        assert alone.match(query, gradient, Criterion(0.7, WIDTH, 0.5)).indices.tolist() == [-1]
        turned = alone.match(query, gradient, Criterion(0.7, WIDTH, math.inf, 90.0))
        assert turned.indices.tolist() == [-1]


def test_limits_are_inclusive_enough_to_find_a_match_at_no_distance():
    edges = arrange("uniform", np.random.default_rng(0), 50)
    for method in ("grid", "tree", "brute"):
        found = EdgeIndex(edges, method).match(
            edges.pixels, edges.gradients, Criterion(0.7, WIDTH, 0.0)
        )
        np.testing.assert_array_equal(found.indices, np.arange(50))


def test_without_queries():
    edges = arrange("uniform", np.random.default_rng(0), 50)
    for method in ("grid", "tree", "brute"):
        none = np.empty((0, 2), np.float32)
        found = EdgeIndex(edges, method).match(none, none, Criterion(0.7, WIDTH))
        assert len(found.indices) == len(found.costs) == 0


def test_only_the_grid_serves_registration():
    edges = arrange("uniform", np.random.default_rng(0), 5)
    assert EdgeIndex(edges).grid.points.shape == (5, 4)
    for method in ("tree", "brute"):
        with pytest.raises(ValueError, match=f"index by '{method}' holds no grid"):
            _ = EdgeIndex(edges, method).grid


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("criterion", [Criterion(0.7, 640), Criterion(0.0, 640, 30.0)])
def test_drawn_images(seed, criterion):
    rng = np.random.default_rng(seed)
    config = EdgesConfig()
    edges = extract_edges(problems.drawn_image(rng), config).describe(problems.VGA)
    assert len(edges) > 500
    which = rng.integers(len(edges), size=300)
    shift = rng.normal(0, 5, 2)
    pixels = (edges.pixels[which] + shift).astype(np.float32)
    check(edges, pixels, edges.gradients[which], criterion)


@pytest.mark.parametrize(
    "name",
    [
        "tum_fr3_structure_notexture_far",
        "tum_fr1_xyz",
        "icl_office_kt3",
        "tum_fr3_cabinet_sparse",
    ],
)
def test_real_edges(real_data, name):
    rng = np.random.default_rng(0)
    source = open_source(real_data / name)
    camera, config = source.camera, EdgesConfig()
    frames = [f for i in range(6) if (f := source.read(i).frame) is not None][:2]
    reference = extract_edges(frames[0].grey, config).describe(camera)
    current = extract_edges(frames[1].grey, config)
    which = np.sort(rng.choice(len(current), 200, replace=False)).astype(np.int32)
    depths = depth_at_edges(frames[1].depth, current.index[which], config)
    samples = current.describe(camera, which[depths > 0], depths[depths > 0])
    points = samples.points(camera)
    assert len(points) > 50
    for criterion in (Criterion(0.7, 640), Criterion(0.7, 640, 30.0), Criterion(0.0, 640, 30.0)):
        T = problems.motion(rng, 0.05, 3.0)
        pixels = twins.warp(points, camera, T)[1].astype(np.float32)
        check(reference, pixels, samples.gradients, criterion)
    # the warp is that of the camera
    np.testing.assert_allclose(twins.warp(points, camera, np.eye(4))[1], samples.pixels, atol=1e-3)
    assert se3.rotation_angle(T) == pytest.approx(math.radians(3))
