"""Where an edge lies between pixels: known answers on straight edges as a sensor sees them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo.camera import Camera
from edvo.config import PRESETS, Config, EdgesConfig
from edvo.edges import extract_edges

SIZE = 64
CENTRE = (SIZE - 1) / 2
CAMERA = Camera(width=SIZE, height=SIZE, fx=60, fy=60, cx=CENTRE, cy=CENTRE)
LENS = Camera(
    width=160,
    height=120,
    fx=129.3,
    fy=129.1,
    cx=79.3,
    cy=63.5,
    distortion=(0.26, -0.95, -0.0054, 0.0026, 1.16),
)
INNER = CENTRE - 6  # nearer to the border, the border mirrors the step
ANGLES = range(0, 360, 15)
OFFSETS = np.arange(-0.5, 0.5, 0.125)  # between pixels


def covered(distance, angle):
    """Share of a pixel on the bright side of a line at that distance from its centre."""
    a, b = (max(abs(side), 1e-6) for side in (np.cos(angle), np.sin(angle)))

    def ramp(x):
        return 0.5 * np.maximum(x, 0) ** 2

    far, near = (a + b) / 2, (a - b) / 2
    bits = ramp(distance + far) - ramp(distance + near)
    return (bits - ramp(distance - near) + ramp(distance - far)) / (a * b)


def step(angle, offset, low=50, high=180):
    """A sharp step, so far from the centre of the image; it rises along (cos, sin)."""
    v, u = np.mgrid[:SIZE, :SIZE] - CENTRE
    distance = u * np.cos(angle) + v * np.sin(angle) - offset
    return (low + (high - low) * covered(distance, angle)).round().astype(np.uint8)


def errors(angle, offset, low=50, high=180, **config):
    """Signed distances of the edge pixels from the line, px."""
    grey = step(angle, offset, low, high)
    edges = extract_edges(grey, EdgesConfig(**config)).describe(CAMERA)
    off = edges.pixels.astype(np.float64) - CENTRE
    off = off[(np.abs(off) < INNER).all(axis=1)]
    return off @ (np.cos(angle), np.sin(angle)) - offset


def of_all_offsets(angle, **config):
    return np.concatenate([errors(angle, offset, **config) for offset in OFFSETS])


@pytest.mark.parametrize(("blur", "rms"), [(0, 0.1), (5, 0.05)])
@pytest.mark.parametrize("angle", np.radians(ANGLES), ids=ANGLES)
def test_edges_lie_on_the_line(angle, blur, rms):
    found = of_all_offsets(angle, blur_px=blur)
    assert len(found) > 40 * len(OFFSETS)
    assert np.sqrt(np.mean(found**2)) < rms
    assert np.abs(found).max() < 3 * rms
    assert abs(found.mean()) < 0.01


@pytest.mark.parametrize("offset", OFFSETS)
def test_no_offset_between_pixels_is_favoured(offset):
    """Pixel-locking would show as an error that depends on where between pixels the edge lies."""
    found = np.concatenate([errors(angle, offset) for angle in np.radians(ANGLES)])
    assert abs(found.mean()) < 0.01
    assert np.sqrt(np.mean(found**2)) < 0.05


@settings(max_examples=100)
@given(
    angle=st.floats(0, 2 * np.pi),
    offset=st.floats(-3, 3),
    low=st.integers(0, 100),
    contrast=st.integers(40, 155),
)
def test_any_edge_lies_near_its_line(angle, offset, low, contrast):
    found = errors(angle, offset, low, low + contrast)
    assert len(found) > 40
    # along an axis grey levels round alike for all pixels, at low contrast by up to 0.12
    assert np.sqrt(np.mean(found**2)) < 0.15
    assert np.abs(found).max() < 0.2


@pytest.mark.parametrize("extractor", ["canny", "dog"])
def test_it_is_better_than_the_middle_of_the_pixel(extractor):
    fine, coarse = (
        np.concatenate(
            [
                of_all_offsets(angle, extractor=extractor, position=position)
                for angle in np.radians(ANGLES)
            ]
        )
        for position in ("vertex", "pixel")
    )
    assert np.std(coarse) > 0.2
    assert np.std(fine) < 0.2 * np.std(coarse)


def test_by_pixel_it_is_the_pixel():
    edges = extract_edges(step(0.7, 0.3), EdgesConfig(position="pixel"))
    assert not edges.is_fine
    v, u = np.divmod(edges.index, SIZE)
    np.testing.assert_array_equal(edges.describe(CAMERA).pixels, np.column_stack((u, v)))
    assert extract_edges(step(0.7, 0.3), EdgesConfig()).is_fine


def test_the_paper_places_edges_by_pixel():
    positions = {name: Config.preset(name).edges.position for name in PRESETS}
    assert positions == {"default": "vertex", "paper": "pixel"}


def test_at_the_border_an_edge_is_its_pixel():
    grey = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE)).astype(np.uint8)
    as_it_is = {"blur_px": 0, "max_noise": 0}
    edges = extract_edges(grey, EdgesConfig(extractor="sobel", sobel_threshold=1, **as_it_is))
    v, u = np.divmod(edges.index, SIZE)
    border = (np.minimum(u, v) == 0) | (np.maximum(u, v) == SIZE - 1)
    assert border.sum() > 3 * SIZE
    pixels, raw = edges.describe(CAMERA).pixels, np.column_stack((u, v))
    np.testing.assert_array_equal(pixels[border], raw[border])
    moved = np.abs(pixels - raw)
    assert np.isfinite(pixels).all()
    assert 0.3 < moved.max() <= 1
    assert (moved.min(axis=1) == 0).all()  # along the row or the column


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.6, 1.0, 1.4, 2.5])
def test_through_a_lens_edges_lie_on_the_straight_line(angle):
    """The line is straight in ideal pixels, and bent in those that the sensor has."""
    parts = 6
    u = (np.arange(LENS.width * parts) + 0.5) / parts - 0.5
    v = (np.arange(LENS.height * parts) + 0.5) / parts - 0.5
    ideal = LENS.undistort(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    normal = np.array([np.cos(angle), np.sin(angle)])
    far = 35.0  # from the middle, where a lens bends
    bright = (ideal - (LENS.cx, LENS.cy)) @ normal > far
    share = bright.reshape(LENS.height, parts, LENS.width, parts).mean(axis=(1, 3))
    edges = extract_edges((50 + 130 * share).round().astype(np.uint8), EdgesConfig())
    v, u = np.divmod(edges.index, LENS.width)
    inside = (np.minimum(u, v) > 5) & (u < LENS.width - 6) & (v < LENS.height - 6)
    found = edges.describe(LENS).pixels[inside] - (LENS.cx, LENS.cy)
    assert len(found) > 60
    off = found.astype(np.float64) @ normal - far
    assert np.sqrt(np.mean(off**2)) < 0.06
    assert abs(off.mean()) < 0.02
