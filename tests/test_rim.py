"""The black rim of undistorted images, whose edges move with the camera."""

from dataclasses import replace

import numpy as np
import pytest

from edvo.config import Config, EdgesConfig
from edvo.edges import EdgeBuffers, extract_edges
from edvo.odometry import Odometry, Status
from edvo.rim import REACH_PX, Rim
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

SHAPE = (240, 320)
RIM_PX = 20


def view(seed=0):
    return problems.drawn_image(np.random.default_rng(seed), SHAPE).clip(20, 255)


def rimmed(grey, width=RIM_PX, black=0):
    result = np.full_like(grey, black)
    inside = slice(width, -width)
    result[inside, inside] = grey[inside, inside]
    return result


def around(width):
    """All that is nearer to the border than that."""
    expected = np.ones(SHAPE, bool)
    inside = slice(width, -width)
    expected[inside, inside] = False
    return expected


def test_it_is_what_is_black_in_all_images_and_hangs_together_with_the_border():
    rim, first = Rim(), rimmed(view(), black=3)
    first[100:120, 20:60] = 0  # dark, in this one
    first[60:90, 200:240] = 0  # dark, and nowhere near the border
    near = rim.near(first)
    assert near[around(RIM_PX + REACH_PX)].all()
    assert near[110, 50]
    assert not near[75, 220]
    near = rim.near(rimmed(view(1)))
    np.testing.assert_array_equal(near, around(RIM_PX + REACH_PX))


def test_one_that_bends_inwards_is_one():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = (u - 160) / 160, (v - 120) / 120
    inside = (np.abs(x) < 0.93 + 0.05 * y**2) & (np.abs(y) < 0.91 + 0.07 * x**2)
    near = Rim().near(np.where(inside, view(), 0).astype(np.uint8))
    assert near[~inside].all()
    assert not near[80:160, 100:220].any()


def test_images_without_one_are_told_at_the_first():
    rim = Rim()
    assert rim.near(view()) is None
    assert rim.near(rimmed(view())) is None  # black comes too late to be one
    rim.forget()
    assert rim.near(rimmed(view())) is not None


def test_darkness_is_none():
    rim = Rim()
    assert rim.near(np.zeros(SHAPE, np.uint8)) is None
    assert rim.near(view()) is None
    assert rim.near(rimmed(view())) is None
    rim.forget()
    rim.near(np.zeros(SHAPE, np.uint8))  # and then it is light
    np.testing.assert_array_equal(rim.near(rimmed(view())), around(RIM_PX + REACH_PX))


@pytest.mark.parametrize(
    "objects", [[(40, 200, 60, 250)], [(10, 230, 5, 150), (90, 230, 150, 310)]]
)
def test_what_lies_dark_behind_an_object_is_none(objects):
    """Neither a small object nor an L of two is what a rim surrounds."""
    grey = np.zeros(SHAPE, np.uint8)
    for top, bottom, left, right in objects:
        grey[top:bottom, left:right] = 200
    assert Rim().near(grey) is None


def test_what_gives_way_was_none():
    rim, grey = Rim(), np.zeros(SHAPE, np.uint8)
    grey[5:235, 20:280] = 200
    assert rim.near(grey) is not None
    assert rim.near(np.roll(grey, 5, axis=1)) is not None
    assert rim.near(np.roll(grey, 15, axis=1)) is None
    assert rim.near(grey) is None


@pytest.mark.parametrize("blur_px", [0, 5, 7])
def test_it_has_no_edges(blur_px):
    config, grey = EdgesConfig(blur_px=blur_px), rimmed(view())
    inner = RIM_PX + REACH_PX

    def at_rim(edges):
        v, u = np.divmod(edges.index, SHAPE[1])
        to_border = np.minimum(np.minimum(u, v), np.minimum(319 - u, 239 - v))
        return np.count_nonzero(to_border < inner)

    buffers = EdgeBuffers(*SHAPE)
    edges = extract_edges(grey, config, buffers)
    assert at_rim(edges) == 0
    kept = extract_edges(grey, EdgesConfig(blur_px=blur_px, black_rim="kept"), buffers)
    assert at_rim(kept) > 500
    assert len(edges) > 0.6 * (len(kept) - at_rim(kept))


@pytest.fixture(scope="module")
def cabinet():
    source = SyntheticSource(make_recipe("cabinet", frames=30, seed=3))
    frames = [source.read(index).frame for index in range(30)]
    return source, [
        replace(frame, grey=rimmed(frame.grey, 60), depth=rimmed(frame.depth, 60))
        for frame in frames
    ]


def error(source, frames, odometry):
    statuses = [odometry.track(frame).status for frame in frames]
    truth, found = source.ground_truth, odometry.trajectory
    start, end = np.linalg.inv(truth.at(frames[0].timestamp)), truth.at(frames[-1].timestamp)
    way = np.linalg.inv(found.poses[0]) @ found.poses[-1]
    return np.linalg.norm((start @ end)[:3, 3] - way[:3, 3]), statuses


def test_it_does_not_hold_the_camera(cabinet):
    source, frames = cabinet
    off, statuses = error(source, frames, Odometry(source.camera))
    assert off < 0.003
    assert set(statuses) == {Status.TRACKED}


def test_kept_it_drags_it_along(cabinet):
    source, frames = cabinet
    config = Config().with_overrides(["edges.black_rim=kept"])
    off, _ = error(source, frames, Odometry(source.camera, config))
    assert off > 0.01


def test_whoever_starts_anew_knows_of_none(cabinet):
    source, frames = cabinet
    odometry = Odometry(source.camera)
    dark = replace(frames[0], grey=np.zeros_like(frames[0].grey))
    odometry.track(dark)
    odometry.reset()
    assert error(source, frames, odometry)[0] < 0.003
