"""The black rim of undistorted images, whose edges move with the camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo.config import Config, EdgesConfig
from edvo.edges import EdgeBuffers, extract_edges
from edvo.odometry import Odometry, Status
from edvo.rim import EVERY, REACH_PX, Rim, find_rim
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


def found_in(grey, depth=None):
    return find_rim(grey, np.zeros(SHAPE, np.float32) if depth is None else depth)


def test_it_is_found():
    np.testing.assert_array_equal(found_in(rimmed(view())), around(RIM_PX + REACH_PX))
    np.testing.assert_array_equal(found_in(rimmed(view(), black=5)), around(RIM_PX + REACH_PX))
    bars = view()
    bars[:, :15] = bars[:, -15:] = 0
    expected = np.zeros(SHAPE, bool)
    expected[:, : 15 + REACH_PX] = expected[:, -15 - REACH_PX :] = True
    np.testing.assert_array_equal(found_in(bars), expected)
    amid = rimmed(view())
    amid[60:90, 200:240] = 0  # dark, and nowhere near it
    np.testing.assert_array_equal(found_in(amid), around(RIM_PX + REACH_PX))


def test_one_that_bends_inwards_is_one():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = (u - 160) / 160, (v - 120) / 120
    inside = (np.abs(x) < 0.93 + 0.05 * y**2) & (np.abs(y) < 0.91 + 0.07 * x**2)
    near = found_in(np.where(inside, view(), 0).astype(np.uint8))
    assert near[~inside].all()
    assert not near[80:160, 100:220].any()


def test_one_at_the_corners_is_one():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    outside = np.hypot((u - 160) / 320, (v - 120) / 240) > 0.62
    near = found_in(np.where(outside, 0, view()).astype(np.uint8))
    assert near[outside].all()
    assert not near[40:200, 60:260].any()


@pytest.mark.parametrize("quality", [90, 40])
@pytest.mark.parametrize("width", [25, 29, 31])
def test_one_that_was_compressed(quality, width):
    data = cv2.imencode(".jpg", rimmed(view(), width), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    near = found_in(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
    assert near[around(width + 2)].all()
    assert not near[~around(width + REACH_PX)].any()


def test_there_is_none_in_an_image_without():
    assert found_in(view()) is None
    assert found_in(np.zeros(SHAPE, np.uint8)) is None
    for dark in (np.s_[150:], np.s_[:, :60], np.s_[:60]):  # a floor, a door, a ceiling
        grey = view()
        grey[dark] = 0
        assert found_in(grey) is None


def test_dark_doors_have_depth():
    depth = np.full(SHAPE, 2.0, np.float32)
    bars = view()
    bars[:, :15] = bars[:, -15:] = 0
    assert found_in(bars, depth) is None
    depth[:, :15] = depth[:, -15:] = 0
    assert found_in(bars, depth) is not None


def test_all_round_it_may_have_depth():
    """As where colour is registered to depth, and depth is seen farther to the sides."""
    depth = np.full(SHAPE, 2.0, np.float32)
    np.testing.assert_array_equal(found_in(rimmed(view()), depth), around(RIM_PX + REACH_PX))


@pytest.mark.parametrize("objects", [[(40, 200, 60, 250)], [(5, 235, 5, 150), (90, 230, 150, 310)]])
def test_what_lies_dark_behind_an_object_is_none(objects):
    """Neither a small object nor an L of two is what a rim surrounds."""
    grey = np.zeros(SHAPE, np.uint8)
    for top, bottom, left, right in objects:
        grey[top:bottom, left:right] = 200
    assert found_in(grey) is None


def test_it_is_looked_for_until_an_image_is_lit():
    dark, nothing = np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.float32)
    rim = Rim()
    for gain in (0.0, 0.06, 0.1, 0.2, 0.3):
        rim.near((gain * rimmed(view())).astype(np.uint8), nothing)
    for _ in range(EVERY):
        rim.near(rimmed(view()), nothing)
    np.testing.assert_array_equal(rim.near(rimmed(view()), nothing), around(RIM_PX + REACH_PX))
    assert rim.near(dark, nothing) is not None  # it has not gone
    rim = Rim()
    assert rim.near(view(), nothing) is None
    assert rim.near(rimmed(view()), nothing) is None  # that was settled


def test_what_has_touched_it_is_seen_again():
    nothing, rim, touched = np.zeros(SHAPE, np.float32), Rim(), rimmed(view())
    touched[90:130, 10:80] = 0
    assert rim.near(touched, nothing)[110, 60]
    for _ in range(EVERY):
        rim.near(rimmed(view()), nothing)
    np.testing.assert_array_equal(rim.near(rimmed(view()), nothing), around(RIM_PX + REACH_PX))


@pytest.mark.parametrize("blur_px", [0, 5, 7])
def test_it_has_no_edges(blur_px):
    config, grey = EdgesConfig(blur_px=blur_px), rimmed(view())
    inner, blind = RIM_PX + REACH_PX, found_in(grey)

    def at_rim(edges):
        v, u = np.divmod(edges.index, SHAPE[1])
        to_border = np.minimum(np.minimum(u, v), np.minimum(319 - u, 239 - v))
        return np.count_nonzero(to_border < inner)

    buffers = EdgeBuffers(*SHAPE)
    edges = extract_edges(grey, config, buffers, blind=blind)
    assert at_rim(edges) == 0
    kept = extract_edges(grey, config, buffers)
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
    """By 8 mm; by 39 till what a search has led to was registered once more."""
    source, frames = cabinet
    kept = "edges.black_rim=kept", "edges.carried=kept"
    given = *kept, "status.torn=ignore", "planes.contours=none"
    off, _ = error(source, frames, Odometry(source.camera, Config().with_overrides(given)))
    assert off > 0.005


def test_whoever_starts_anew_looks_anew(cabinet):
    source, frames = cabinet
    odometry = Odometry(source.camera)
    odometry.track(source.read(0).frame)  # without any
    odometry.reset()
    assert error(source, frames, odometry)[0] < 0.003
