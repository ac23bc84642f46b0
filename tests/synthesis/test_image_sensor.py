import numpy as np
import pytest

from edvo.camera import Camera
from edvo.synthesis import photometry
from edvo.synthesis.clock import Clock
from edvo.synthesis.image_sensor import AutoExposure, ImageSensor
from edvo.synthesis.randomness import generator

CAMERA = Camera(width=640, height=480, fx=535.4, fy=539.2, cx=320.1, cy=247.6)


def test_encoding_undoes_decoding_for_every_level() -> None:
    levels = np.arange(256, dtype=np.uint8)
    assert (photometry.encode(photometry.decode(levels)) == levels).all()


def test_the_curve_is_that_of_the_standard() -> None:
    light = np.array([0.0, 0.0031308, 0.2140411, 1.0])
    assert photometry.linear_to_srgb(light) == pytest.approx([0.0, 0.04045, 0.5, 1.0], abs=1e-5)
    value = np.linspace(0, 1, 1001)
    assert photometry.linear_to_srgb(photometry.srgb_to_linear(value)) == pytest.approx(value)


def test_light_out_of_range_saturates() -> None:
    light = np.array([-1.0, 0.0, 1.0, 7.0], np.float32)
    assert photometry.encode(light).tolist() == [0, 0, 255, 255]


@pytest.mark.parametrize("level", [0.05, 0.2, 0.6])
def test_noise_is_that_of_photons_and_of_the_read_out(level: float) -> None:
    sensor = ImageSensor(full_well=800.0, read_noise=6.0, vignette=0.0)
    image = sensor.expose(np.full((480, 640), level, np.float32), CAMERA, generator(0, "image"))
    electrons = photometry.decode(image).astype(np.float64) * 800.0
    expected = np.sqrt(level * 800.0 + 6.0**2)
    assert electrons.mean() == pytest.approx(level * 800.0, rel=0.01)
    assert electrons.std() == pytest.approx(expected, rel=0.05)


def test_the_corners_are_darker_by_the_fourth_power_of_the_cosine() -> None:
    flat = np.full((480, 640), 0.5, np.float32)
    light = photometry.decode(ImageSensor(vignette=1.0).expose(flat, CAMERA))
    x, y = -CAMERA.cx / CAMERA.fx, -CAMERA.cy / CAMERA.fy
    assert light[247, 320] == pytest.approx(0.5, rel=0.01)
    assert light[0, 0] / light[247, 320] == pytest.approx((1 + x**2 + y**2) ** -2, rel=0.02)


def test_exposure_multiplies_the_light_and_saturates() -> None:
    flat = np.full((480, 640, 3), 0.1, np.float32)
    sensor = ImageSensor(vignette=0.0)
    assert photometry.decode(sensor.expose(flat, CAMERA, exposure=4.0)).mean() == pytest.approx(
        0.4, rel=0.01
    )
    assert (sensor.expose(flat, CAMERA, exposure=20.0) == 255).all()


def test_the_same_generator_gives_the_same_image_and_leaves_the_radiance_alone() -> None:
    radiance = np.full((480, 640, 3), 0.3, np.float32)
    first = ImageSensor().expose(radiance, CAMERA, generator(1, "image", 2))
    assert (first == ImageSensor().expose(radiance, CAMERA, generator(1, "image", 2))).all()
    assert (first != ImageSensor().expose(radiance, CAMERA, generator(1, "image", 3))).any()
    assert (radiance == np.float32(0.3)).all()


def test_auto_exposure_answers_a_step_with_its_time_constant() -> None:
    times = np.arange(120) / 30
    light = np.where(times < 1.0, 0.2, 0.8)
    exposures = AutoExposure(target=0.2, lag=0.25).exposures(list(times), list(light))
    assert exposures[:31] == pytest.approx(1.0)
    # The first bright frame comes as a surprise; after one lag, 63 % of the logarithm is done.
    after = np.log(exposures[(times >= 1.0)]) / np.log(0.25)
    assert after[0] == pytest.approx(0.0)
    assert np.interp(0.25, times[: len(after)], after) == pytest.approx(0.632, abs=0.02)
    assert exposures[-1] == pytest.approx(0.25, rel=0.01)


def test_auto_exposure_keeps_within_its_limits() -> None:
    exposures = AutoExposure(shortest=0.5, longest=4.0, lag=0.01).exposures(
        [0.0, 1.0, 2.0, 3.0], [0.2, 0.0, 100.0, 100.0]
    )
    assert exposures == pytest.approx([1.0, 1.0, 4.0, 0.5], rel=1e-3)


def test_two_clocks_of_one_device_do_not_agree() -> None:
    colour = Clock(30.0).times(300)
    depth = Clock(30.0, offset=0.012, jitter=0.001).times(300, generator(0, "depth clock"))
    assert np.diff(colour) == pytest.approx(1 / 30)
    assert (np.diff(depth) > 0).all()
    assert (depth - colour).mean() == pytest.approx(0.012, abs=2e-4)
    assert (depth - colour).std() == pytest.approx(0.001, rel=0.15)


def test_wild_jitter_never_changes_the_order() -> None:
    assert (np.diff(Clock(30.0, jitter=1.0).times(1000, generator(0, "clock"))) > 0).all()
