"""Bands that a flickering lamp makes of rows read out one after the other are no edges."""

import numpy as np
import pytest
from benchmarks.defects import bands

from edvo import kernels, se3
from edvo.banding import MATTERS, Bands
from edvo.config import Config
from edvo.edges import EdgeBuffers, extract_edges, slopes
from edvo.odometry import Odometry, Status

from . import problems, twins

FRAMES = 12
STEPS = 8  # of gradients, a grey level


@pytest.fixture(scope="module")
def wall():
    """Plain panels, each frame with where it was taken."""
    return problems.rendered("notexture_near", FRAMES, seed=2)


def lit_by(rows, shape=(96, 192), level=120.0, seed=1):
    """Texture of which light changes from row to row; grey, and gradients along columns."""
    rng = np.random.default_rng(seed)
    grey = np.full(shape, level) + rng.normal(0, 2, shape)
    grey = np.clip(grey * np.asarray(rows)[:, None], 0, 255).astype(np.uint8)
    buffers = EdgeBuffers(*shape)
    slopes(grey, Config().edges, buffers)
    return grey, buffers.dv


def waves(rows=96, period=80.0, depth=0.4):
    return 1 + depth * np.sin(2 * np.pi * np.arange(rows) / period)


# --------------------------------------------------------------------------------------- kernels


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shape", [(96, 128), (97, 131), (3, 3), (2, 64), (17, 20)])
def test_kernels_are_their_twins(seed, shape):
    rng = np.random.default_rng(seed)
    grey = rng.integers(0, 256, shape, np.uint8)
    drift = 300 * np.sin(np.arange(shape[0]) / 9)[:, None]
    dv = (rng.normal(drift, 200, shape)).astype(np.int16)
    dv[rng.random(shape) < 0.1] = 0
    share = kernels.one_sided_rows(dv, 8, 4, 6)
    assert share == twins.one_sided_rows(dv, 8, 4, 6)
    found = np.full(shape[0] // 2, 7.0)
    largest = kernels.row_slopes(grey, dv, 2, 4, 3, found)
    wanted = twins.row_slopes(grey, dv, 2, 4, 3, len(found))
    np.testing.assert_allclose(found, wanted[0], rtol=1e-12)
    assert largest == pytest.approx(wanted[1], rel=1e-12)
    given = rng.normal(0, 2, len(found))
    given[::5] = 0
    left = dv.copy()
    kernels.take_off_slopes(grey, given, 2, left)
    np.testing.assert_array_equal(left, twins.take_off_slopes(grey, given, 2, dv))
    assert (left.astype(int) * dv >= 0).all()


@pytest.mark.parametrize("side", [1, 5, 9])
def test_a_peak_narrower_than_that_goes_and_a_step_stays(side):
    rng = np.random.default_rng(side)
    values = np.zeros(60)
    values[10 : 10 + side] = 3.0
    values[30 : 30 + side - 1] = 5.0
    values[45:] = rng.uniform(1, 2, 15)
    found, room = values.copy(), np.empty(60)
    kernels.least_of_any(found, side, room)
    np.testing.assert_array_equal(found, twins.least_of_any(values, side))
    np.testing.assert_array_equal(found[10 : 10 + side], 3.0)
    assert not found[30 : 30 + side - 1].any()
    assert (found <= values).all()


# ------------------------------------------------------------------------------------ which bands


def test_bands_leave_no_gradient():
    grey, dv = lit_by(waves())
    before = np.abs(dv).astype(float)
    assert np.median(before.max(axis=1)) > 10 * STEPS
    assert Bands().remove(grey, dv, STEPS)
    quiet = lit_by(np.ones(96))[1]
    assert np.abs(dv[2:-2]).mean() < 1.5 * np.abs(quiet).mean()


@pytest.mark.parametrize(
    "rows",
    [
        np.ones(96),  # as light as each other
        np.linspace(0.5, 1.5, 96),  # a lamp on one side
        1 + 0.005 * np.sin(np.arange(96) / 6),  # less than noise
        np.where(np.abs(np.arange(96) - 50) < 20, 1.2, 0.8),  # a board, by its two edges
        1 + 0.4 * (np.arange(96) // 3 % 2),  # blinds
    ],
)
def test_what_is_no_band_stays_to_the_bit(rows):
    grey, dv = lit_by(rows)
    before = dv.copy()
    assert not Bands().remove(grey, dv, STEPS)
    np.testing.assert_array_equal(dv, before)


def test_light_that_falls_on_half_of_an_image_is_no_band():
    grey, dv = lit_by(waves())
    dv[:, 96:] = lit_by(np.ones(96))[1][:, 96:]
    before = dv.copy()
    assert not Bands().remove(grey, dv, STEPS)
    np.testing.assert_array_equal(dv, before)


def test_where_one_half_is_white_the_other_tells():
    grey, dv = lit_by(waves())
    grey[:, :96], dv[:, :96] = 255, 0
    assert Bands().remove(grey, dv, STEPS)
    assert not dv[:, :96].any()


def test_bands_fainter_than_any_edge_stay():
    faint = MATTERS / 8 / 120 * 80 / (2 * np.pi)  # grey levels a pixel, by Sobel's eight
    for depth, is_removed in ((0.5 * faint, False), (2.0 * faint, True)):
        grey = np.full((96, 192), 120, np.uint8)
        dv = np.rint(STEPS * 8 * 120 * np.gradient(waves(depth=depth))).astype(np.int16)
        dv = np.repeat(dv[:, None], 192, axis=1)
        assert Bands().remove(grey, dv, STEPS) is is_removed


def test_now_and_then_an_image_that_looks_like_it_is_let_be():
    """Lines along the rows of a scene, out of focus, come and go; a lamp flickers in each image."""
    seen = [lit_by(waves()), *(lit_by(np.ones(96)) for _ in range(4))]
    some, most = Bands(), Bands()
    taken = [some.remove(*(each.copy() for each in seen[(k + 1) % 5]), STEPS) for k in range(20)]
    assert not any(taken)
    taken = [
        most.remove(*(each.copy() for each in seen[0 if k > 3 else 1]), STEPS) for k in range(12)
    ]
    assert taken == [False] * 6 + [True] * 6


@pytest.mark.parametrize("shape", [(3, 3), (4, 100), (100, 4), (480, 640)])
@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_images_have_none(shape, level):
    grey, dv = np.full(shape, level, np.uint8), np.zeros(shape, np.int16)
    assert not Bands().remove(grey, dv, STEPS)
    assert not dv.any()


# -------------------------------------------------------------------------------------- by edges


def test_of_a_banded_image_the_edges_of_the_scene_are_left(wall):
    frame = wall[1][0]
    banded = bands(frame, np.random.default_rng(0)).grey
    true, config = extract_edges(frame.grey, Config().edges), Config()
    near = np.zeros(frame.grey.shape, bool)
    rows, cols = np.divmod(true.index, frame.grey.shape[1])
    for dr in range(-2, 3):
        for dc in range(-2, 3):
            r, c = (rows + dr).clip(0, 479), (cols + dc).clip(0, 639)
            near[r, c] = True
    share = {}
    for rule in ("kept", "removed"):
        found = extract_edges(banded, config.with_overrides([f"edges.bands={rule}"]).edges)
        share[rule] = near.reshape(-1)[found.index].mean()
    assert share["kept"] < 0.5
    assert share["removed"] > 0.9


@pytest.mark.parametrize("rule", ["removed", "kept"])
def test_a_plain_wall_is_followed_in_banded_light(wall, rule):
    camera, frames, truth = wall
    odometry = Odometry(camera, Config().with_overrides([f"edges.bands={rule}"]))
    off, tracked = [], []
    for frame, T in zip(frames, truth, strict=True):
        result = odometry.track(bands(frame, np.random.default_rng(0)))
        tracked.append(result.status is Status.TRACKED)
        off.append(se3.distance(T, result.T_world_cam))
    if rule == "removed":
        assert all(tracked)
        assert max(off) < 0.003
    else:
        assert np.mean(tracked) < 0.5


def test_nothing_is_left_to_be_compiled_when_a_lamp_flickers(monkeypatch, wall):
    names = "take_off_slopes", "row_slopes"
    compiled = [getattr(kernels, name) for name in names]
    writeable = problems.watched_by_warm_up(monkeypatch, *names)
    before = [len(kernel.signatures) for kernel in compiled]
    frame = bands(wall[1][0], np.random.default_rng(0))
    for image in (frame.grey, frame.grey.copy()):
        extract_edges(image, Config().edges)
    assert before == [len(kernel.signatures) for kernel in compiled]
    assert not any(map(any, writeable.values()))


def test_images_blurred_by_more_keep_theirs(wall):
    """Their edges are as wide as bands."""
    banded = bands(wall[1][0], np.random.default_rng(0)).grey
    found = [
        extract_edges(banded, Config().with_overrides([f"edges.bands={rule}"]).edges, passes=2)
        for rule in ("kept", "removed")
    ]
    np.testing.assert_array_equal(found[0].index, found[1].index)
