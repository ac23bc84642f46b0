"""The depth of an edge, by planes through what lies to either side of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import EdgesConfig, SamplingConfig
from edvo.edges import NO_TABLE, EdgeImage
from edvo.planes import camera_of
from edvo.sampling import sample_edges
from edvo.sensor import DEPTH_NOISE

from . import twins

CAMERA = Camera(width=160, height=120, fx=140.0, fy=140.0, cx=79.5, cy=59.5)
BENT = Camera(
    width=160, height=120, fx=140, fy=141, cx=78, cy=60, distortion=(0.2, -0.4, 0.001, 0.002, 0.1)
)
SIGMA = 0.01
U, V = np.meshgrid(np.arange(160.0), np.arange(120.0))
angles = st.floats(0, 2 * np.pi)


def across(depth, u=80.3, v=60.2, angle=0.0, sigma=SIGMA):
    """Depth of an edge whose gradient is turned by an angle."""
    depth = depth.astype(np.float32)
    u, v, z = float(u), float(v), float(depth[round(v), round(u)]) or 2.0
    return depth_across(depth, u, v, np.cos(angle), np.sin(angle), sigma, z)


def depth_across(depth, u, v, gu, gv, sigma, z):
    """Depth of one edge."""
    patches, found = np.empty((21, 1), np.float32), np.empty(1)
    u, v, gu, gv, sigma, z = (np.array([each], float) for each in (u, v, gu, gv, sigma, z))
    lines, flat_index = np.empty((4, len(u))), np.empty(len(u), np.int32)
    kernels.copy_patches(depth, u, v, gu, gv, lines, flat_index, patches)
    kernels.depths_across(patches, sigma, z, found)
    return float(found[0])


def distance(u, v, angle):
    """Of each pixel from an edge, positive on the side that the gradient points to."""
    return (U - u) * np.cos(angle) + (V - v) * np.sin(angle)


@given(angles, st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.5, 0.5))
def test_on_a_plane_it_is_that_of_the_plane(angle, a, b, off):
    u, v = 80 + off, 60 - off
    plane = 2 + a * (U - u) + b * (V - v)
    # pixels are those nearest to where they should be
    slack = 0.5 * (abs(a) + abs(b))
    assert across(plane, u, v, angle) == pytest.approx(2, abs=slack + 1e-6)


@given(angles, st.floats(0.01, 0.03), st.sampled_from([-1, 1]))
def test_where_surfaces_meet_it_is_that_of_the_line_between_them(angle, slope, way):
    """The mean of a window is off by more than a pixel's worth of the slope there."""
    roof = 2 + way * slope * abs(distance(80, 60, angle))
    found = across(roof, 80, 60, angle, sigma=0.002)
    index = np.array([60 * 160 + 80], np.int32)
    window = np.empty(1, np.float32)
    kernels.depths_at(roof.astype(np.float32), index, 2, 0.05, window)
    assert abs(window[0] - 2) > 0.9 * slope
    assert abs(found - 2) < 0.35 * slope


@given(angles, st.floats(0.2, 2), st.floats(-0.01, 0.01))
def test_where_a_surface_ends_it_is_that_of_the_nearer_one(angle, step, slope):
    side = distance(80, 60, angle)
    contour = np.where(side > 0, 1.5 + slope * side, 1.5 + step)
    assert across(contour, 80, 60, angle) == pytest.approx(1.5, abs=abs(slope) + 1e-3)


def test_what_lies_in_the_shadow_of_a_contour_needs_no_depth():
    contour = np.where(U < 80.5, 1.5, 0.0)
    assert across(contour, 80.4, 60.0) == pytest.approx(1.5, abs=1e-6)
    assert across(contour[:, ::-1], 78.6, 60.0) == pytest.approx(1.5, abs=1e-6)


def test_a_step_within_the_noise_is_none():
    rng = np.random.default_rng(0)
    found = [across(2 + rng.normal(0, SIGMA, U.shape) + 0.002 * (U > 80)) for _ in range(300)]
    assert np.mean(found) == pytest.approx(2.001, abs=0.001)  # not that of the nearer side
    assert np.std(found) < 0.5 * SIGMA


def test_noise_counts_less_on_a_plane_than_by_one_side_alone():
    rng = np.random.default_rng(1)
    flat = [across(2 + rng.normal(0, SIGMA, U.shape)) for _ in range(300)]
    side = [across(np.where(U < 80.5, 2 + rng.normal(0, SIGMA, U.shape), 0)) for _ in range(300)]
    assert np.std(flat) < 0.7 * np.std(side)


@pytest.mark.parametrize("spoil", ["strays", "nothing", "image ends"])
def test_where_neither_side_is_plane_there_is_none(spoil):
    rng = np.random.default_rng(2)
    if spoil == "image ends":
        assert across(np.full(U.shape, 2.0), 2.0, 60.0) == 0
        assert across(np.full(U.shape, 2.0), 80.0, 117.0) == 0
    elif spoil == "nothing":
        assert across(np.zeros(U.shape)) == 0
    else:
        assert across(rng.uniform(1, 3, U.shape)) == 0


def test_without_a_gradient_there_are_no_sides():
    depth = np.full(U.shape, 2, np.float32)
    for gu, gv in ((np.nan, np.nan), (np.nan, 0.0), (np.inf, 0.0)):
        assert depth_across(depth, 80.0, 60.0, gu, gv, SIGMA, 2.0) == 0


def test_at_the_border_where_its_pixels_would_leave_the_image_there_is_none():
    flat, reach = np.full(U.shape, 2.0), kernels.ACROSS + kernels.HALF_LENGTH
    for first, last, at in (
        (reach, 159 - reach, lambda u: across(flat, u, 60)),
        (reach, 119 - reach, lambda v: across(flat, 80, v)),
    ):
        assert at(first) == at(np.nextafter(last, 0)) == 2
        assert at(np.nextafter(first, 0)) == at(last) == 0


def test_few_pixels_in_line_are_no_plane():
    depth = np.zeros(U.shape)
    depth[60, 70:90] = 2 + 0.3 * np.arange(20)  # fits any plane that turns about the row
    assert across(depth, 80.0, 60.0) == 0


def test_one_side_counts_alone_only_where_the_other_has_few_pixels():
    rng = np.random.default_rng(4)
    depth = np.where(U > 80, 2.0, rng.uniform(2.3, 4, U.shape))
    assert across(depth, 80.0, 60.0) == 0
    depth[:, :81] = 0
    assert across(depth, 80.0, 60.0) == pytest.approx(2, abs=1e-6)
    depth[59:62, 78], depth[59, 77], depth[61, 77] = 1.0, 1.4, 1.0  # five: not seen
    assert across(depth, 80.0, 60.0) == pytest.approx(2, abs=1e-6)
    assert across(depth[:, ::-1], 79.0, 60.0) == pytest.approx(2, abs=1e-6)
    depth[60, 77] = 1.8  # six: seen, and not plane
    assert across(depth, 80.0, 60.0) == 0
    depth[:, :80] = 1.5
    depth[59, 77] = 0  # eight
    assert across(depth, 80.0, 60.0) == pytest.approx(1.5, abs=1e-6)


def test_what_noise_allows_is_as_said():
    """In units of the noise, by hand: the constants are not those that the twin takes, too."""
    for slope, one in ((1.12, True), (1.3, False)):  # a bend, by three standard deviations
        found = across(2 + slope * SIGMA * abs(U - 80), 80, 60)
        assert found == pytest.approx(2 + one * slope * SIGMA * 12 / 7, abs=1e-6)
    for step, apart in ((5.5, False), (7.0, True)):  # by five
        found = across(2 + step * SIGMA * (U > 80), 80, 60)
        assert found == pytest.approx(2, abs=1e-6) if apart else found > 2.02
    chequered = np.where((U + V) % 2 == 0, 1, -1)
    for rough, plane in ((1.4, True), (1.7, True), (2.2, False)):  # rms of a side
        assert (across(2 + rough * SIGMA * chequered, 80, 60) > 0) == plane
    for slope, plane in ((0.035, True), (0.045, False)):  # 2 % of the depth
        assert (across(2 + slope * (U - 80), 80, 60) > 0) == plane


def blocks(seed):
    """Planes of many depths side by side, with noise, and holes."""
    rng = np.random.default_rng(seed)
    depth = np.kron(rng.uniform(1, 3, (12, 16)), np.ones((10, 10)))
    depth += rng.uniform(-0.02, 0.02) * (U - 80) + rng.normal(0, SIGMA / 2, U.shape)
    depth[rng.random(U.shape) < 0.05] = 0
    depth[70:90, 20:50] = 0
    return depth.astype(np.float32)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000), st.sampled_from(["ideal", "distorted"]), st.booleans())
def test_it_equals_its_numpy_twin(seed, lens, delayed):
    rng = np.random.default_rng(seed)
    camera = CAMERA if lens == "ideal" else BENT
    depth = blocks(seed)
    index = np.sort(rng.choice(depth.size, 300, replace=False)).astype(np.int32)
    du, dv = rng.integers(-900, 900, (2, *depth.shape)).astype(np.int16)
    edges = EdgeImage(index, du, dv, is_fine=True).describe(camera)
    T = se3.exp(np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.03])) if delayed else None
    given_depths = np.where(depth.ravel()[index] > 0, depth.ravel()[index], 2).astype(np.float32)
    sigma, found = np.full(300, SIGMA), given_depths.copy()
    table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
    rest = (np.eye(4) if T is None else T), delayed, 2, 0.05, sigma
    kernels.fit_edge_depths(
        edges.pixels, edges.gradients, index, depth, table, camera_of(camera), *rest, found
    )
    expected = twins.fit_edge_depths(
        edges.pixels, edges.gradients, index, depth, camera, T, 2, 0.05, sigma, given_depths
    )
    # where two rules all but tie, or a pixel lies between two, rounding decides
    assert np.isclose(found, expected, rtol=1e-4).mean() > 0.98
    assert (found != given_depths).mean() > 0.5


def drawn(depth, rule, mask, **more):
    index = np.flatnonzero(mask).astype(np.int32)
    du, dv = np.full(depth.shape, 7, np.int16), np.zeros(depth.shape, np.int16)
    edges, config = EdgeImage(index, du, dv), EdgesConfig(depth_rule=rule)
    sampling = SamplingConfig(count=0)
    return sample_edges(edges, depth.astype(np.float32), CAMERA, sampling, config, 0, **more)


def test_samples_have_it():
    roof = 2 - 0.03 * abs(U - 80)
    samples = drawn(roof, "sides", U == 80)
    np.testing.assert_allclose(samples.depths[10:-10], 2, atol=0.01)
    window = drawn(roof, "window", U == 80)
    assert (window.depths < 1.98).all()


def test_samples_without_any_are_left_out():
    """Two depths that differ, in each window, agree with no third one."""
    depth = np.where(V % 9 == 4, np.where(U == 80, 2.0, np.where(U == 82, 3.0, 0.0)), 0.0)
    assert len(drawn(depth, "window", U == 80)) == 0
    assert len(drawn(depth, "sides", U == 80)) == 0
    depth[:40] = 2
    samples = drawn(depth, "sides", U == 80)
    assert 35 < len(samples) < 50
    assert (samples.depths == 2).all()


def test_noise_is_that_of_the_sensor():
    """A step of 3 cm at 2.6 m is none to a Kinect, and one to a better camera."""
    rng = np.random.default_rng(3)
    depth = 2.6 + 0.03 * (U > 80) + rng.normal(0, 0.001, U.shape)
    near = {
        sensor: np.median(drawn(depth, "sides", U == 80, noise=DEPTH_NOISE[sensor]).depths)
        for sensor in ("kinect_v1", "azure_kinect")
    }
    assert near["kinect_v1"] > 2.61
    assert near["azure_kinect"] == pytest.approx(2.6, abs=0.002)
