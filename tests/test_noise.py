"""How noisy an image is, and that a noisy one is seen as a quiet one is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo import kernels, noise
from edvo.camera import Camera
from edvo.config import Config, EdgesConfig
from edvo.edges import EdgeBuffers, extract_edges
from edvo.frame import Frame
from edvo.noise import image_noise, quieted
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins
from .test_kernels import both

SHAPE = (240, 320)
AS_IT_IS = EdgesConfig(max_noise=0)


def noisy(grey, sigma, seed=0):
    spoiled = grey + np.random.default_rng(seed).normal(0, sigma, grey.shape)
    return spoiled.round().clip(0, 255).astype(np.uint8)


def shaded():
    """What is no noise: a slope, and bright bars across it."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return 60 + 0.3 * u + 0.1 * v + 40 * (u // 32 % 2)


def behind_a_bayer_pattern(grey, sigma):
    colours = cv2.cvtColor(noisy(grey, sigma), cv2.COLOR_BayerBG2BGR)
    return cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)


def gradient_noise(grey, config):
    """Root mean square of what neither a slope nor a bar explains."""
    buffers = EdgeBuffers(*grey.shape)
    extract_edges(grey, config, buffers)
    calm = buffers.dv[20:-20, 20:-20].astype(float) / config.grey_steps  # bars stand upright
    return calm.std()


@pytest.mark.parametrize("sigma", [1.0, 2.0, 5.0, 10.0, 25.0])
def test_white_noise_is_measured(sigma):
    assert image_noise(noisy(shaded(), sigma)) == pytest.approx(sigma, rel=0.25, abs=0.5)


def test_noise_that_is_smoothed_counts_as_far_as_it_reaches_gradients():
    grey = behind_a_bayer_pattern(np.full(SHAPE, 120.0), 10.0)
    as_strong = 10 * gradient_noise(grey, AS_IT_IS)
    as_strong /= gradient_noise(noisy(np.full(SHAPE, 120.0), 10.0), AS_IT_IS)
    assert 6 < as_strong < 9
    assert image_noise(grey) == pytest.approx(as_strong, rel=0.15)


def test_a_dark_quarter_with_less_of_it_hides_none():
    grey = noisy(shaded(), 10.0)
    grey[:60] = noisy(np.full(SHAPE, 20.0), 1.0)[:60]
    assert image_noise(grey) > 6


def test_edges_and_shades_are_none():
    assert image_noise(shaded().astype(np.uint8)) < 1
    drawn = problems.drawn_image(np.random.default_rng(0))
    assert image_noise(drawn) < EdgesConfig().max_noise


def test_what_is_drawn_without_any_has_none():
    grey = np.full(SHAPE, 60, np.uint8)
    cv2.circle(grey, (160, 120), 60, 200, -1)
    assert image_noise(grey) == 0


def test_where_noise_is_cut_off_it_is_not_asked():
    for black, white in ((0, 255), (5, 252)):
        grey = noisy(shaded(), 5.0)
        grey[:150] = black
        grey[150:160] = white
        assert image_noise(grey) == pytest.approx(5.0, rel=0.4)
    assert image_noise(np.zeros(SHAPE, np.uint8)) == 0
    assert image_noise(np.full(SHAPE, 255, np.uint8)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (5, 400), (6, 6), (7, 30), (30, 41)])
def test_small_images(shape):
    grey = noisy(np.full(shape, 120.0), 60.0)
    assert image_noise(grey) >= 0
    assert (image_noise(grey) == 0) == (min(shape) < noise.LEAST_PX)
    assert quieted(grey, 2.5)[0].shape == shape


@pytest.mark.parametrize(("shape", "sigma"), [((50, 66), 60), ((240, 320), 3), ((6, 7), 9)])
def test_roughness_is_that_by_numpy(shape, sigma):
    grey = noisy(np.full(shape, 120.0), sigma)
    grey[10:16, 20:40], grey[30:36, :20] = 0, 255
    found, expected = both(
        "quiet_roughness",
        lambda: kernels.quiet_roughness(grey, 3, 0.25),
        lambda: twins.quiet_roughness(grey, 3, 0.25),
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert min(found) > 1


def test_an_image_is_quieted_to_what_it_may_have():
    most = EdgesConfig().max_noise
    allowed = gradient_noise(noisy(shaded(), most), AS_IT_IS)
    for sigma in (4.0, 8.0, 16.0):
        grey = noisy(shaded(), sigma)
        assert gradient_noise(grey, AS_IT_IS) > 0.9 * sigma / most * allowed
        assert gradient_noise(grey, EdgesConfig()) == pytest.approx(allowed, rel=0.25)


def test_a_quiet_image_stays_as_it_is():
    grey = noisy(shaded(), 1.5)
    image, variance = quieted(grey, 2.5)
    assert image is grey
    assert variance == 0
    loud = noisy(shaded(), 20.0)
    assert quieted(loud, 0.0)[0] is loud
    assert Config.preset("paper").edges.max_noise == 0


@pytest.fixture(scope="module")
def panels():
    recipe = make_recipe("notexture_far", frames=20, camera=problems.CAMERA, seed=3)
    source = SyntheticSource(recipe)
    frames = [source.read(index).frame for index in range(20)]
    spoiled = [
        replace(frame, grey=noisy(frame.grey, 10.0, seed)) for seed, frame in enumerate(frames)
    ]
    return source, spoiled


def test_a_camera_is_followed_in_noise(panels):
    source, frames = panels
    odometry = Odometry(source.camera)
    assert all(odometry.track(frame).status is Status.TRACKED for frame in frames)
    truth, found = source.ground_truth, odometry.trajectory
    start, end = (np.linalg.inv(truth.at(frames[0].timestamp)), truth.at(frames[-1].timestamp))
    way = np.linalg.inv(found.poses[0]) @ found.poses[-1]
    assert np.linalg.norm((start @ end)[:3, 3] - way[:3, 3]) < 0.005


def test_as_it_is_a_noisy_image_leads_nowhere(panels):
    source, frames = panels
    odometry = Odometry(source.camera, Config().with_overrides(["edges.max_noise=0"]))
    statuses = [odometry.track(frame).status for frame in frames[:6]]
    assert Status.TRACKED not in statuses[1:]


def of_fine_texture(count):
    """A camera that goes along a carpet: all that is to be seen is a pixel or two wide."""
    rng = np.random.default_rng(2)
    texture = cv2.GaussianBlur(rng.normal(size=(400, 500)).astype(np.float32), (0, 0), 0.8)
    texture = 128 + 40 * texture / texture.std()
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    camera = Camera(width=SHAPE[1], height=SHAPE[0], fx=260, fy=260, cx=159.5, cy=119.5)
    frames = []
    for k in range(count):
        grey = cv2.remap(texture, u + 1.3 * k + 40, v + 0.7 * k + 40, cv2.INTER_CUBIC)
        frames.append(Frame(k / 30, noisy(grey, 1.0, k), np.full(SHAPE, 2.0, np.float32)))
    return camera, frames, np.array([1.3, 0.7, 0.0]) * (count - 1) * 2.0 / 260


def test_what_is_as_fine_as_noise_is_followed_too():
    camera, frames, way = of_fine_texture(20)
    assert image_noise(frames[0].grey) > 10
    odometry = Odometry(camera)
    assert {odometry.track(frame).status for frame in frames} == {Status.TRACKED}
    np.testing.assert_allclose(odometry.trajectory.poses[-1][:3, 3], way, atol=0.002)
