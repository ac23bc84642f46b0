from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo import kernels
from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.edges import MASKS, EdgePixels, depth_at_edges, extract_edges

from . import problems
from .test_kernels import both

LENS = problems.LENS
EXTRACTORS = ("canny", *MASKS)


def gradients_of(grey, config):
    """By OpenCV: of whole grey levels to the bit, of finer ones where none lies between two."""
    smooth, steps = grey, config.grey_steps
    if steps > 1:
        smooth = smooth.astype(np.float32) * steps
    if config.blur_px:
        smooth = cv2.GaussianBlur(smooth, (config.blur_px, config.blur_px), 0)
    if steps > 1:
        smooth = np.floor(smooth + 0.5)
    slopes = [cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((1, 0), (0, 1))]
    return smooth, *(slope.astype(np.int16) for slope in slopes)


def pixels_of(edges):
    v, u = np.divmod(edges.index, edges.du.shape[1])
    return np.column_stack((u, v))


def step(angle_deg, shape=(200, 200), low=50, high=180):
    """A smooth step through the centre; grey rises along (cos, sin) of the angle."""
    angle = np.radians(angle_deg)
    v, u = np.mgrid[: shape[0], : shape[1]]
    along = (u - 99.5) * np.cos(angle) + (v - 99.5) * np.sin(angle)
    return (low + (high - low) / (1 + np.exp(-along))).round().astype(np.uint8)


# ----------------------------------------------------------------------------------- extraction


@pytest.mark.parametrize("blur", [0, 3, 5, 9])
@pytest.mark.parametrize("steps", [1, 2, 8])
@pytest.mark.parametrize(
    ("low", "high"), [(20.0, 40.0), (50.9, 100.5), (150.0, 300.0), (100.0, 50.0)]
)
def test_canny_is_that_of_opencv_on_the_same_gradients(blur, steps, low, high):
    grey = problems.drawn_image(np.random.default_rng(0))
    config = EdgesConfig(blur_px=blur, low=low, high=high, strong_share=0, grey_steps=steps)
    edges = extract_edges(grey, config)
    _, du, dv = gradients_of(grey, config)
    np.testing.assert_array_equal(edges.du, du)
    np.testing.assert_array_equal(edges.dv, dv)
    mask = cv2.Canny(du, dv, steps * low, steps * high)
    np.testing.assert_array_equal(edges.index, np.flatnonzero(mask))
    assert edges.index.dtype == np.int32
    assert len(edges) > 100


def marked(du, dv, low, high):
    """By the kernel and by OpenCV; memory that was used before."""
    marks = np.full(du.shape, 77, np.uint8)
    room = np.full(2 * du.size + 65, -1, np.int32)
    given = du, dv, np.int32(low), np.int32(high), marks, room[: 2 * du.size + 1]
    _, expected = both(
        "canny_edges",
        lambda: kernels.canny_edges(*given),
        lambda: cv2.Canny(du, dv, low, high),
    )
    assert (room[2 * du.size + 1 :] == -1).all()
    return marks, expected


@pytest.mark.parametrize(
    "shape", [(48, 64), (37, 49), (5, 7), (2, 9), (9, 2), (1, 8), (8, 1), (1, 1)]
)
@pytest.mark.parametrize("most", [3, 40, 1020, 8188])
def test_edges_are_marked_as_opencv_does_for_any_gradients(shape, most):
    """Few values, many ties; and edges up to the border."""
    rng = np.random.default_rng(most)
    for low, high in ((0, 0), (1, 4), (most / 2, most), (most, most), (most, 5 * most)):
        for _ in range(6):
            du, dv = rng.integers(-most, most + 1, (2, *shape), np.int16)
            np.testing.assert_array_equal(*marked(du, dv, low, high))


def test_points_are_found_once_for_a_camera():
    samples = problems.random_edges(np.random.default_rng(0), 20)
    samples = replace(samples, depths=np.full(20, 2, np.float32))
    camera, other = problems.CAMERA, replace(problems.CAMERA, fx=2 * problems.CAMERA.fx)
    points = samples.points(camera)
    assert samples.points(camera) is points
    np.testing.assert_allclose(samples.points(other)[:, 2], points[:, 2])
    assert np.abs(samples.points(other)[:, 0] - points[:, 0]).max() > 0.01
    np.testing.assert_array_equal(samples.points(camera), points)
    assert len(samples.every(2).points(camera)) == 10


def test_above_a_threshold_that_nothing_reaches_there_is_no_edge():
    grey = problems.drawn_image(np.random.default_rng(0))
    assert len(extract_edges(grey, EdgesConfig(high=1e10, strong_share=0))) == 0


def test_edges_are_followed_as_far_as_they_go():
    """One strong pixel at the end of a weak spiral."""
    du = np.zeros((61, 61), np.int16)
    dv = np.zeros_like(du)
    reach, way, v, u = 58, 0, 1, 1
    while reach > 4:
        across, along = (dv, (0, 1)) if way % 2 == 0 else (du, (1, 0))
        sign = -1 if way % 4 >= 2 else 1
        for _ in range(reach):
            across[v, u] = 20
            v, u = v + sign * along[0], u + sign * along[1]
        reach, way = reach - 4 if way % 2 else reach, way + 1
    weak, expected = marked(du, dv, 10, 30)
    assert not weak.any()
    assert not expected.any()
    du[v, u] = 50
    strong, expected = marked(du, dv, 10, 30)
    np.testing.assert_array_equal(strong, expected)
    assert np.count_nonzero(strong) > 600


@pytest.mark.parametrize("extractor", EXTRACTORS)
@pytest.mark.parametrize("shape", ["square", "disc"])
def test_edges_lie_on_the_contour(extractor, shape):
    grey = np.full((240, 320), 60, np.uint8)
    if shape == "square":
        cv2.rectangle(grey, (100, 60), (219, 179), 200, -1)
        u, v = np.meshgrid(np.arange(320), np.arange(240))
        distance = np.abs(np.maximum(np.abs(u - 159.5) - 60, np.abs(v - 119.5) - 60))
    else:
        cv2.circle(grey, (160, 120), 60, 200, -1)
        u, v = np.meshgrid(np.arange(320), np.arange(240))
        distance = np.abs(np.hypot(u - 160, v - 120) - 60)
    edges = extract_edges(grey, EdgesConfig(extractor=extractor))
    on = pixels_of(edges)
    thickness = 4.5 if extractor == "sobel" else 2.0
    assert distance[on[:, 1], on[:, 0]].max() <= thickness
    # the whole contour is there
    contour = np.argwhere(distance < 0.7)[:, ::-1]
    gap = np.linalg.norm(contour[:, None] - on[None], axis=2).min(axis=1)
    assert gap.max() <= 3
    assert (edges.du.ravel()[edges.index] != 0).any()


def test_thin_and_thick():
    grey = step(0)
    counts = {name: len(extract_edges(grey, EdgesConfig(extractor=name))) for name in EXTRACTORS}
    assert counts["canny"] == pytest.approx(200, abs=4)  # one pixel a row
    assert counts["dog"] == pytest.approx(200, abs=4)
    assert counts["sobel"] > 2 * counts["canny"]


@pytest.mark.parametrize("extractor", EXTRACTORS)
def test_no_edges_on_plain_and_nearly_plain_images(extractor):
    config = EdgesConfig(extractor=extractor)
    assert len(extract_edges(np.full((48, 64), 128, np.uint8), config)) == 0
    ramp = np.repeat(np.arange(64, dtype=np.uint8)[None], 48, axis=0)
    assert len(extract_edges(ramp, config)) == 0


@pytest.mark.parametrize("extractor", EXTRACTORS)
def test_every_edge_has_a_direction(extractor):
    rng = np.random.default_rng(3)
    noisy = cv2.GaussianBlur(rng.integers(0, 256, (120, 160)).astype(np.uint8), (5, 5), 0)
    as_it_is = EdgesConfig(extractor=extractor, max_noise=0)
    for grey in (noisy, problems.drawn_image(rng)):
        camera = Camera(width=grey.shape[1], height=grey.shape[0], fx=100, fy=100, cx=80, cy=60)
        pixels = extract_edges(grey, as_it_is).describe(camera)
        assert len(pixels) > 50
        norms = np.linalg.norm(pixels.gradients, axis=1)
        np.testing.assert_allclose(norms, 1, atol=1e-5)


def test_thresholds_of_sobel_and_dog():
    grey = step(30, low=100, high=130)
    strict = EdgesConfig(extractor="sobel", sobel_threshold=1000)
    assert len(extract_edges(grey, strict)) == 0
    for steps in (1, 8):
        config = EdgesConfig(extractor="sobel", sobel_threshold=30, grey_steps=steps)
        _, du, dv = gradients_of(grey, config)
        expected = np.flatnonzero(np.abs(du.astype(int)) + np.abs(dv) > 30 * steps)
        np.testing.assert_array_equal(extract_edges(grey, config).index, expected)
    faint = EdgesConfig(extractor="dog", dog_contrast=0.5)
    plain = EdgesConfig(extractor="dog", dog_contrast=50)
    assert len(extract_edges(grey, plain)) == 0 < len(extract_edges(grey, faint))


def test_canny_stays_where_the_light_changes_and_sobel_does_not():
    """Fig. 2: two thresholds and non-maximum suppression stand a change of brightness."""
    grey = problems.drawn_image(np.random.default_rng(0))
    dim = (grey * 0.5).astype(np.uint8)

    def kept(name):
        config = EdgesConfig(extractor=name)
        bright, dark = (extract_edges(image, config).index for image in (grey, dim))
        return len(np.intersect1d(bright, dark)) / len(np.union1d(bright, dark))

    assert kept("canny") > kept("sobel") + 0.1
    assert kept("canny") > 0.75


# ----------------------------------------------------------------------------------- directions


@pytest.mark.parametrize("angle", range(0, 360, 15))
def test_the_gradient_points_from_dark_to_bright(angle):
    grey = step(angle)
    camera = Camera(width=200, height=200, fx=200, fy=200, cx=99.5, cy=99.5)
    edges = extract_edges(grey, EdgesConfig())
    pixels = edges.describe(camera)
    assert np.abs(pixels.pixels - pixels_of(edges)).max() <= 1
    inside = np.abs(pixels.pixels - 99.5).max(axis=1) < 90  # the border mirrors the step
    direction = np.degrees(np.arctan2(pixels.gradients[:, 1], pixels.gradients[:, 0]))
    off = (direction - angle + 180) % 360 - 180
    assert np.abs(off[inside]).max() < 2
    assert inside.sum() > 150


def test_some_of_the_edges_with_their_depth():
    edges = extract_edges(problems.drawn_image(np.random.default_rng(0)), EdgesConfig())
    every = edges.describe(problems.VGA)
    which = np.array([5, 3, 100], np.int32)
    depths = np.array([1, 2, 3], np.float32)
    some = edges.describe(problems.VGA, which, depths)
    assert len(some) == 3
    np.testing.assert_array_equal(some.pixels, every.pixels[which])
    np.testing.assert_array_equal(some.gradients, every.gradients[which])
    np.testing.assert_array_equal(some.depths, depths)
    np.testing.assert_array_equal(every.depths, 0)
    for array in (every.pixels, every.gradients, every.depths):
        assert array.dtype == np.float32
        assert array.flags.c_contiguous


def test_points_are_those_of_the_camera():
    rng = np.random.default_rng(0)
    edges = problems.random_edges(rng, 50)
    depths = rng.uniform(0.5, 5, 50).astype(np.float32)
    edges = EdgePixels(edges.pixels, edges.gradients, depths)
    expected = problems.VGA.backproject(edges.pixels, depths)
    np.testing.assert_allclose(edges.points(problems.VGA), expected, atol=1e-6)


# ----------------------------------------------------------------------------------- distortion


def test_distortion_is_taken_out_of_the_pixels():
    image = problems.drawn_image(np.random.default_rng(1))
    edges = extract_edges(image, EdgesConfig(position="pixel"))
    ideal = edges.describe(LENS).pixels
    raw = pixels_of(edges)
    np.testing.assert_allclose(ideal, LENS.undistort(raw), atol=1e-3)
    assert np.abs(ideal - raw).max() > 2


def test_distortion_is_taken_out_of_the_way_to_an_edge_between_pixels():
    edges = extract_edges(problems.drawn_image(np.random.default_rng(1)), EdgesConfig())
    raw = edges.describe(problems.VGA).pixels.astype(np.float64)
    ideal, on_pixels = edges.describe(LENS).pixels, LENS.undistort(pixels_of(edges))
    np.testing.assert_allclose(ideal, LENS.undistort(raw), atol=0.01)
    moved = np.linalg.norm(ideal - on_pixels, axis=1) - np.linalg.norm(
        raw - pixels_of(edges), axis=1
    )
    assert np.abs(moved).max() > 0.03  # else this would not show that the way is bent too


def test_distortion_is_taken_out_of_the_directions():
    """A line in the raw image has, at each pixel, the normal of its undistorted curve."""
    edges = extract_edges(problems.drawn_image(np.random.default_rng(1)), EdgesConfig())
    raw, plain = pixels_of(edges).astype(float), edges.describe(problems.VGA).gradients
    ideal = edges.describe(LENS).gradients
    along = np.column_stack((-plain[:, 1], plain[:, 0])).astype(float)
    h = 0.5
    tangent = LENS.undistort(raw + h * along) - LENS.undistort(raw - h * along)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inside = (np.abs(raw - (319.5, 239.5)) < (318, 238)).all(axis=1)
    assert np.abs((tangent * ideal).sum(axis=1))[inside].max() < 2e-3
    assert (plain * ideal).sum(axis=1).min() > 0.9  # still from dark to bright
    turned = np.degrees(np.arccos(np.clip((plain * ideal).sum(axis=1), -1, 1)))
    assert turned.max() > 1  # else this would show nothing


def test_directions_are_those_of_the_undistorted_image():
    grey = problems.drawn_image(np.random.default_rng(2), polygons=5)
    config = EdgesConfig(blur_px=5, low=50, high=100)
    ours = extract_edges(grey, config).describe(LENS)
    theirs = extract_edges(LENS.undistort_image(grey), config).describe(problems.VGA)
    offset = np.linalg.norm(ours.pixels[:, None] - theirs.pixels[None], axis=2)
    nearest = offset.argmin(axis=1)
    inside = (np.abs(ours.pixels - (319.5, 239.5)) < (290, 210)).all(axis=1)
    assert np.quantile(offset.min(axis=1)[inside], 0.95) < 1.2
    dot = (ours.gradients * theirs.gradients[nearest]).sum(axis=1)[inside]
    off = np.degrees(np.arccos(np.clip(dot, -1, 1)))
    assert np.median(off) < 2


# ---------------------------------------------------------------------------------------- depth


def depth_of(depth, u, v, **config):
    index = np.array([v * depth.shape[1] + u], np.int32)
    result = depth_at_edges(depth.astype(np.float32), index, EdgesConfig(**config))
    assert result.dtype == np.float32
    return float(result[0])


def two_sides(near=1.0, far=2.0):
    depth = np.full((40, 60), far, np.float32)
    depth[:, :30] = near
    return depth


def test_on_a_surface_the_mean():
    v, u = np.mgrid[:40, :60]
    plane = (1 + 0.001 * u + 0.002 * v).astype(np.float32)
    assert depth_of(plane, 20, 10) == pytest.approx(plane[10, 20], rel=1e-6)
    assert depth_of(np.full((40, 60), 1.25), 20, 10) == 1.25


@pytest.mark.parametrize("u", [28, 29, 30, 31])
def test_at_a_step_the_near_side(u):
    assert depth_of(two_sides(), u, 20) == pytest.approx(1.0)
    assert depth_of(two_sides(2.0, 1.0)[:, ::-1], u, 20) == pytest.approx(1.0)
    assert depth_of(two_sides(), u, 20, depth_window_px=1) == pytest.approx(1 if u < 30 else 2)


def test_a_step_smaller_than_the_gap_is_no_step():
    depth = two_sides(1.0, 1.04)
    assert 1.0 < depth_of(depth, 30, 20) < 1.04
    assert depth_of(depth, 30, 20, depth_gap=0.01) == pytest.approx(1.0)


def test_stray_pixels_between_the_sides_are_ignored():
    depth = two_sides()
    depth[:, 30] = np.linspace(1.2, 1.9, 40)
    assert depth_of(depth, 30, 20) == pytest.approx(1.0)


def test_stray_pixels_in_front_are_ignored():
    depth = two_sides()
    depth[19, 29], depth[21, 31] = 0.4, 0.7
    assert depth_of(depth, 30, 20) == pytest.approx(1.0)


def test_holes_are_ignored():
    depth = two_sides()
    depth[18:23, 28:33] = 0
    assert depth_of(depth, 30, 20) == 0  # nothing in the window
    depth[20, 28] = 1.0
    assert depth_of(depth, 30, 20) == 1.0  # one pixel says it
    depth[18:21, 32] = 2.0
    assert depth_of(depth, 30, 20) == 2.0  # one against three: a stray pixel
    depth[18:20, 28] = 1.0
    assert depth_of(depth, 30, 20) == 1.0


def test_where_no_depths_agree_there_is_none():
    depth = np.zeros((40, 60), np.float32)
    depth[18:20, 29:31] = [[1, 2], [3, 4]]
    assert depth_of(depth, 30, 20) == 0


def test_all_missing():
    assert depth_of(np.zeros((40, 60)), 30, 20) == 0


@pytest.mark.parametrize("u", [0, 1, 58, 59])
@pytest.mark.parametrize("v", [0, 1, 38, 39])
@pytest.mark.parametrize("window", [1, 5, 15])
def test_at_the_border_of_the_image(u, v, window):
    depth = np.full((40, 60), 2.0)
    assert depth_of(depth, u, v, depth_window_px=window) == 2.0
    alone = np.zeros((40, 60))
    alone[v, u] = 1.5
    assert depth_of(alone, u, v, depth_window_px=window) == 1.5


def test_no_edges_no_depths():
    none = depth_at_edges(two_sides(), np.empty(0, np.int32), EdgesConfig())
    assert none.shape == (0,)
