import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from edvo.config import EdgesConfig, SamplingConfig
from edvo.edges import EdgeImage, depth_at_edges, extract_edges
from edvo.sampling import CELLS_A_SAMPLE, sample_edges

from . import problems

CAMERA = problems.VGA
EDGES = EdgesConfig(depth_rule="window", strays="kept")


def edge_image(mask):
    """Edges where the mask says, with some gradient."""
    index = np.flatnonzero(mask).astype(np.int32)
    du = np.full(mask.shape, 3, np.int16)
    return EdgeImage(index, du, np.full(mask.shape, 4, np.int16))


def scattered(seed, share=0.02, missing=0.3):
    """Edges scattered unevenly over an image, and a depth image of blocks, some missing."""
    rng = np.random.default_rng(seed)
    density = share * 2 * np.linspace(0, 1, CAMERA.width) ** 2
    mask = rng.random((CAMERA.height, CAMERA.width)) < density
    blocks = rng.uniform(1, 3, (30, 40)) * (rng.random((30, 40)) >= missing)
    return edge_image(mask), np.kron(blocks, np.ones((16, 16))).astype(np.float32)


def draw(edges, depth, seed=0, camera=CAMERA, **config):
    return sample_edges(edges, depth, camera, SamplingConfig(**config), EDGES, seed)


def flat(samples):
    u, v = samples.pixels.astype(int).T
    return v * CAMERA.width + u


def cell_of(index, cell):
    v, u = np.divmod(index, CAMERA.width)
    return v // cell * -(-CAMERA.width // cell) + u // cell


def check_drawn(edges, depth, samples, count):
    """Assert that as many as can be are drawn, each once, with its depth; gives all, and those."""
    available = depth_at_edges(depth, edges.index, EDGES)
    good = edges.index[available > 0]
    drawn = flat(samples)
    assert len(samples) == min(count, len(good))
    assert (np.diff(drawn) > 0).all()  # row order, none twice
    assert np.isin(drawn, good).all()
    where = np.searchsorted(edges.index, drawn)
    np.testing.assert_array_equal(samples.depths, available[where])
    return good, drawn


@settings(max_examples=40)
@given(
    scene=st.integers(0, 5),
    seed=st.integers(0, 2**40),
    count=st.sampled_from([1, 17, 450, 3000]),
    cell=st.sampled_from([30, 64, 80, 700]),
    per_cell=st.sampled_from([0, 1, 5, 20]),
)
def test_what_is_drawn(scene, seed, count, cell, per_cell):
    edges, depth = scattered(scene)
    samples = draw(edges, depth, seed, count=count, cell_px=cell, per_cell=per_cell)
    good, drawn = check_drawn(edges, depth, samples, count)
    assert (samples.depths > 0).all()
    np.testing.assert_allclose(samples.gradients, [[0.6, 0.8]] * len(samples), atol=1e-6)
    # each cell has given its share, unless there are too many cells for that
    have = np.bincount(cell_of(good, cell))
    share = np.minimum(have, per_cell)
    given = np.bincount(cell_of(drawn, cell), minlength=len(have))
    if share.sum() <= count:
        assert (given >= share).all()
    else:
        assert (given <= share).all()
        assert given.sum() == count


@settings(max_examples=20)
@given(
    scene=st.integers(0, 5),
    seed=st.integers(0, 2**40),
    count=st.sampled_from([1, 17, 450, 3000]),
    tried=st.sampled_from([1, 3, 10]),
)
def test_what_is_chosen(scene, seed, count, tried):
    edges, depth = scattered(scene)
    samples = draw(edges, depth, seed, count=count, tried=tried, selection="informative")
    check_drawn(edges, depth, samples, count)


def information(samples):
    """Log det of J^T J at no motion."""
    X = samples.points(CAMERA)
    a = samples.gradients * [CAMERA.fx, CAMERA.fy] / X[:, 2:]
    a = np.column_stack((a, -(a * X[:, :2]).sum(axis=1) / X[:, 2]))
    J = np.column_stack((a, np.cross(X, a)))
    return np.linalg.slogdet(J.T @ J)[1]


@pytest.mark.parametrize("scene", [0, 1, 2])
def test_those_that_tell_most_tell_more(scene):
    edges = extract_edges(problems.drawn_image(np.random.default_rng(scene)), EDGES)
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[:, : CAMERA.width // 2] = 1.0

    def told(**how):
        return [information(draw(edges, depth, seed, count=300, **how)) for seed in range(5)]

    one, few, many = (told(selection="informative", tried=k) for k in (1, 3, 30))
    assert np.mean(one) < np.mean(few) < np.mean(many)
    assert min(many) > max(told())


def test_what_is_worth_nothing_is_drawn_last():
    edges, depth = scattered(3, missing=0)
    worth = np.ones((1, 2, 4), np.float32)
    worth[:, 0] = 0  # the left half
    config = SamplingConfig(count=300, selection="informative", tried=1000)
    half = CAMERA.width // 2
    side = math.isqrt(CAMERA.width * CAMERA.height // (CELLS_A_SAMPLE * 300))
    samples = sample_edges(edges, depth, CAMERA, config, EDGES, 0, worth=worth)
    u = samples.pixels[:, 0]
    cells, first = np.unique(cell_of(flat(samples), side), return_index=True)
    astride = half // side  # of cells that have both, none of the left is drawn
    both = cells % -(-CAMERA.width // side) == astride
    assert both.any()
    assert (u[first][both] >= half).all()


def test_all_of_them():
    edges, depth = scattered(1)
    samples = draw(edges, depth, count=0)
    available = depth_at_edges(depth, edges.index, EDGES)
    np.testing.assert_array_equal(flat(samples), edges.index[available > 0])
    same = draw(edges, depth, count=len(edges) + 1000)
    np.testing.assert_array_equal(same.pixels, samples.pixels)


def test_seeds():
    edges, depth = scattered(2)
    first, again, other = (draw(edges, depth, seed, count=450) for seed in (3, 3, 4))
    assert first.pixels.tobytes() == again.pixels.tobytes()
    assert first.depths.tobytes() == again.depths.tobytes()
    shared = np.isin(flat(first), flat(other)).mean()
    assert shared < 0.6


def test_consecutive_seeds_are_unrelated():
    edges, depth = scattered(2, missing=0)
    seen = [set(flat(draw(edges, depth, seed, count=450)).tolist()) for seed in range(20)]
    shares = [len(a & b) / 450 for a, b in pairwise(seen)]
    far = [len(a & b) / 450 for a, b in zip(seen, seen[10:], strict=False)]
    assert np.mean(shares) == pytest.approx(np.mean(far), abs=0.03)


def test_the_rest_is_uniform_over_all_edges():
    edges, depth = scattered(3, share=0.01, missing=0)
    hits = np.zeros(CAMERA.width * CAMERA.height, int)
    draws, count = 400, 300
    for seed in range(draws):
        hits[flat(draw(edges, depth, seed, count=count, per_cell=0))] += 1
    hits = hits[edges.index]
    assert hits.sum() == draws * count
    n = len(edges)
    p = count / n
    # drawn without replacement, an edge's variance is binomial, the total's is none
    statistic = ((hits - draws * p) ** 2).sum() / (draws * p * (1 - p)) * (n - 1) / n
    assert 1e-4 < stats.chi2.sf(statistic, n - 1) < 1 - 1e-4


def test_within_a_cell_each_edge_has_the_same_chance():
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[10:14, 10:20] = True  # 40 edges in one cell
    mask[300, 300] = True  # and one in another
    edges, depth = edge_image(mask), np.ones(mask.shape, np.float32)
    hits = np.zeros(mask.size, int)
    draws = 2000
    for seed in range(draws):
        hits[flat(draw(edges, depth, seed, count=6, cell_px=80, per_cell=5))] += 1
    assert hits[300 * CAMERA.width + 300] == draws
    inside = hits[edges.index[:40]]
    p = 5 / 40
    statistic = ((inside - draws * p) ** 2).sum() / (draws * p * (1 - p)) * 39 / 40
    assert 1e-4 < stats.chi2.sf(statistic, 39) < 1 - 1e-4


def test_too_many_cells_take_turns():
    edges, depth = scattered(3, missing=0)
    cells = [
        set(cell_of(flat(draw(edges, depth, seed, count=50, cell_px=16)), 16).tolist())
        for seed in range(30)
    ]
    assert len(set.union(*cells)) > 3 * max(len(some) for some in cells)


def test_without_edges_or_without_depth_there_is_no_sample():
    edges, depth = scattered(1)
    none = edge_image(np.zeros((CAMERA.height, CAMERA.width), bool))
    for samples in (draw(none, depth), draw(edges, np.zeros_like(depth))):
        assert len(samples) == 0
        assert samples.pixels.shape == samples.gradients.shape == (0, 2)
        assert samples.points(CAMERA).shape == (0, 3)


def test_samples_of_a_distorted_camera_are_ideal_pixels():
    camera = problems.LENS
    rng = np.random.default_rng(0)
    edges = extract_edges(problems.drawn_image(rng), EDGES)
    depth = np.full((480, 640), 2.0, np.float32)
    ideal, raw = (draw(edges, depth, 1, c, count=200) for c in (camera, CAMERA))
    np.testing.assert_allclose(ideal.pixels, camera.undistort(raw.pixels), atol=1e-3)
    assert np.abs(ideal.pixels - raw.pixels).max() > 1
    np.testing.assert_allclose(
        ideal.points(camera), camera.backproject(raw.pixels, raw.depths), atol=1e-5
    )
