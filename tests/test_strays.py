"""Specks of depth where no surface is: what tells them, and that they do not hold the pose."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from benchmarks.defects import speckled
from hypothesis import given
from hypothesis import strategies as st

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config, EdgesConfig, SamplingConfig
from edvo.edges import NO_TABLE, EdgeImage
from edvo.odometry import Odometry, Status
from edvo.planes import camera_of
from edvo.sampling import sample_edges
from edvo.strays import NEAREST, NOWHERE, REACH, TIMES, drop_strays, ring
from edvo.witness import Witness

from . import problems, twins

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
BENT = Camera(160, 120, 140, 141, 78, 60, (0.2, -0.4, 0.001, 0.002, 0.1))
WIDE = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
WALL = np.full((480, 640), 3.0, np.float32)
GAP = EdgesConfig().depth_gap
OFF = "edges.strays=kept"


def is_stray(depth, u, v, around=None):
    around = ring(depth.shape[1]) if around is None else around
    return kernels.is_stray(depth, u, v, float(depth[v, u]), around, GAP)


def disc(radius, z=1.0, at=(320, 240)):
    return cv2.circle(WALL.copy(), at, radius, z, -1)


def with_specks(depth, seed):
    return speckled(depth, np.random.default_rng(seed))


def test_a_ring_has_the_size_of_what_a_speck_may_have():
    for width in (160, 640, 1280):
        np.testing.assert_allclose(np.linalg.norm(ring(width), axis=1), REACH * width, atol=0.75)
        assert len(np.unique(ring(width), axis=0)) == 16
    # a surface that ends in a straight line is found by the second pixel asked
    np.testing.assert_array_equal(ring(640)[0], -ring(640)[1])
    for width in (1, 16, 60):  # of an image so small a ring would be the pixel itself
        assert (np.linalg.norm(ring(width), axis=1) > 2.5).all()


@pytest.mark.parametrize("z", [0.1, 0.3, 2.5])
@pytest.mark.parametrize("radius", [1, 5, 9])
def test_a_speck_is_told_all_over(radius, z):
    depth = disc(radius, z)
    for u, v in ((320, 240), (320 + radius, 240), (320, 240 - radius)):
        assert is_stray(depth, u, v)
    assert not is_stray(depth, 320 + radius + 1, 240)  # the wall beside it


@pytest.mark.parametrize(("angle", "width"), [*((a, 9) for a in range(0, 90, 15)), (45, 3), (0, 2)])
def test_a_rod_is_no_speck(angle, width):
    way = 300 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    ends = [tuple(np.rint((320, 240) + side * way).astype(int).tolist()) for side in (-1, 1)]
    rod = cv2.line(WALL.copy(), *ends, 1.0, width)
    assert not is_stray(rod, 320, 240)


def test_what_is_seen_through_a_gap_is_none():
    assert not is_stray(disc(5, 8.0), 320, 240)
    between = disc(5)
    between[:, 335:345] = 0.8
    assert not is_stray(between, 320, 240)


def test_the_end_of_a_surface_is_none():
    for depth, u, v in (
        (disc(60), 320 + 60, 240),
        (disc(60, at=(0, 0)), 0, 0),  # in the corner of the image
        (np.where(np.arange(640) < 320, np.float32(1), WALL), 319, 240),
    ):
        assert not is_stray(np.ascontiguousarray(depth), u, v)


def test_where_little_is_known_nothing_is_stray():
    depth = disc(5)
    depth[np.random.default_rng(1).random(depth.shape) < 0.8] = 0
    depth[240, 320] = 1.0
    assert not is_stray(depth, 320, 240)
    assert not is_stray(disc(5), 320, 240, NOWHERE)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "bent"])
@pytest.mark.parametrize("moved", [False, True])
def test_what_is_dropped_is_that_of_the_twin(camera, moved):
    rng = np.random.default_rng(4)
    depth = with_specks(np.full((120, 160), 2.0, np.float32), 5)
    depth[rng.random(depth.shape) < 0.1] = 0
    index = np.sort(rng.choice(depth.size, 400, replace=False)).astype(np.int32)
    du, dv = rng.integers(-900, 900, (2, *depth.shape)).astype(np.int16)
    pixels = EdgeImage(index, du, dv, is_fine=True).describe(camera).pixels
    T = se3.exp(np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.03])) if moved else np.eye(4)
    before = depth.ravel()[index]
    found, around = before.copy(), ring(160)
    table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
    kernels.drop_strays(
        pixels, index, depth, table, camera_of(camera), T, moved, around, GAP, found
    )
    expected = twins.drop_strays(pixels, index, depth, camera, T, around, GAP, before)
    np.testing.assert_array_equal(found, expected)
    assert 0.05 < (found[before > 0] == 0).mean() < 0.6


def far_nearer(depths):
    """What is dropped as such."""
    left = depths.copy()
    kernels.drop_far_nearer(left, NEAREST, TIMES)
    np.testing.assert_array_equal(left[left > 0], depths[left > 0])
    return left < depths


@given(
    st.lists(st.floats(4, 10), min_size=150, max_size=300),
    st.lists(st.floats(0.5, 1), max_size=6),
    st.integers(0, 400),
)
def test_what_is_far_nearer_is_told_as_long_as_it_is_a_fiftieth(far, near, missing):
    depths = np.array([*far, *near, *[0.0] * missing], np.float32)
    few = len(near) <= int(0.02 * (len(far) + len(near)))
    np.testing.assert_array_equal(far_nearer(depths), (depths > 0) & (depths <= 1) & few)


def test_five_of_a_thousand_edges_are_far_nearer():
    depths = np.linspace(2.0, 4.0, 1000, dtype=np.float32)
    assert not far_nearer(depths).any()
    depths[100:105] = 0.6
    np.testing.assert_array_equal(np.flatnonzero(far_nearer(depths)), np.arange(100, 105))
    depths[200:300] = 0.7  # so many are a surface
    assert not far_nearer(depths).any()


def left_of(depth, index):
    """The edges whose depth is left."""
    pixels = np.column_stack((index % 640, index // 640)).astype(np.float32)
    depths = depth.ravel()[index].copy()
    drop_strays(pixels, index, depth, WIDE, NO_TABLE, np.eye(4), False, GAP, depths)
    return np.flatnonzero(depths > 0)


def test_a_larger_speck_is_left_out_by_how_near_it_is():
    for z, is_left in ((0.9, False), (1.5, True)):
        depth = disc(30, z)
        index = np.concatenate((np.arange(0, depth.size, 300), [240 * 640 + 350, 240 * 640 + 320]))
        left = left_of(depth, index.astype(np.int32))
        assert (len(index) - 1 in left) == is_left
        assert len(left) > 0.98 * len(index)


def test_what_is_of_small_things_alone_is_left_as_it_is():
    depth = WALL.copy()
    for v in range(60, 480, 120):
        for u in range(60, 640, 120):
            cv2.circle(depth, (u, v), 7, 1.5, -1)
    small, rest = (np.flatnonzero(depth == z).astype(np.int32) for z in (1.5, 3.0))
    assert len(left_of(depth, small)) == len(small)
    both = np.concatenate((small, rest[: len(small) // 4]))
    assert len(left_of(depth, both)) == len(small) // 4


def test_edges_on_specks_are_not_drawn():
    rng = np.random.default_rng(2)
    depth = with_specks(WALL, 3)
    index = np.sort(rng.choice(depth.size, 3000, replace=False)).astype(np.int32)
    du = np.full(depth.shape, 7, np.int16)
    edges, sampling = EdgeImage(index, du, np.zeros_like(du)), SamplingConfig(count=0)

    def off(strays):
        config = EdgesConfig(strays=strays)
        depths = sample_edges(edges, depth, WIDE, sampling, config, 0).depths
        return (abs(depths - 3) > GAP * 3).mean(), len(depths)

    wrong, count = off("kept")
    assert count == 3000
    assert wrong > 0.01
    fewer, left = off("left-out")
    assert fewer < 0.2 * wrong
    assert left > 0.95 * count


def test_specks_are_nothing_that_moves():
    T = se3.exp(np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0]))
    a, b = with_specks(WALL, 6), with_specks(WALL, 7)
    conflicts = []
    for keeps_strays in (True, False):
        witness = Witness(WIDE, "kinect_v1", keeps_strays=keeps_strays)
        conflicts.append(witness.conflict(witness.surface(a), witness.surface(b), T))
    assert conflicts[0] > 0.01
    assert conflicts[1] < 0.2 * conflicts[0]
    # a box half a metre wide is
    tilted = WALL * (1 + np.linspace(0, 0.2, 640, dtype=np.float32))
    box = tilted.copy()
    box[150:350, 200:350] = 2.0
    before, after = (witness.surface(with_specks(each, k)) for k, each in enumerate((tilted, box)))
    assert witness.conflict(before, after, T) > 0.03


@pytest.fixture(scope="module")
def stairs():
    camera, frames, truth = problems.rendered("stairs", 12, seed=3)
    frames = [
        replace(frame, depth=with_specks(frame.depth, 100 + k)) for k, frame in enumerate(frames)
    ]
    return camera, frames, truth


def test_a_camera_is_followed_through_specks(stairs):
    camera, frames, truth = stairs
    worst, statuses = {}, {}
    for how in ((), (OFF,)):
        odometry = Odometry(camera, Config().with_overrides(how))
        results = [odometry.track(frame) for frame in frames]
        statuses[how] = {result.status for result in results}
        worst[how] = max(
            se3.distance(result.T_world_cam, T) for result, T in zip(results, truth, strict=True)
        )
    assert statuses[()] == {Status.TRACKED}
    assert worst[()] < 0.004
    assert worst[OFF,] > 0.02


def test_the_paper_leaves_none_out():
    assert Config.preset("paper").edges.strays == "kept"
