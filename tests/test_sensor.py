import numpy as np
import pytest

from edvo.sensor import DEPTH_NOISE, StereoNoise, StructuredLightNoise, TimeOfFlightNoise


def test_the_kinect_formula_is_that_of_nguyen() -> None:
    assert StructuredLightNoise().sigma_z(2.4) == pytest.approx(0.0012 + 0.0019 * 4.0)


def test_stereo_noise_is_the_propagated_disparity_noise() -> None:
    noise = StereoNoise(focal=424.0, baseline=0.05, subpixel=0.08)
    z, step = 3.0, 1e-5
    disparity = 424.0 * 0.05 / z
    slope = (424.0 * 0.05 / (disparity - step) - 424.0 * 0.05 / (disparity + step)) / (2 * step)
    assert noise.sigma_z(z) == pytest.approx(abs(slope) * 0.08, rel=1e-6)


def test_time_of_flight_noise_is_the_phase_noise_of_four_samples() -> None:
    # Four photon counts B + A cos(phase + k pi / 2), each with Poisson noise, demodulated.
    noise, z = TimeOfFlightNoise(), 2.0
    rng = np.random.default_rng(1)
    offset = noise.signal / z**2 + noise.background
    amplitude = noise.contrast * noise.signal / z**2
    phase = 4 * np.pi * noise.frequency * z / 299_792_458.0
    taps = [
        rng.poisson(offset + amplitude * np.cos(phase + k * np.pi / 2), 400_000) for k in range(4)
    ]
    measured = np.unwrap(np.arctan2(taps[3] - taps[1], taps[0] - taps[2]))
    sigma = measured.std() * 299_792_458.0 / (4 * np.pi * noise.frequency)
    assert noise.sigma_z(z) == pytest.approx(sigma, rel=0.02)


def test_the_azure_kinect_stays_within_its_data_sheet() -> None:
    noise = DEPTH_NOISE["azure_kinect"]
    assert noise.sigma_z([1.0, 3.0]) == pytest.approx([0.0010, 0.0036], rel=0.02)
    assert noise.sigma_z(3.86) < 0.017


@pytest.mark.parametrize("name", sorted(DEPTH_NOISE))
def test_noise_grows_with_depth_and_keeps_the_shape(name: str) -> None:
    depth = np.linspace(0.5, 5.0, 60, dtype=np.float32).reshape(6, 10)
    sigma = DEPTH_NOISE[name].sigma_z(depth)
    assert sigma.shape == depth.shape
    assert sigma.dtype == np.float64
    assert (sigma > 0).all()
    assert (np.diff(sigma.ravel()) > 0).all()


def test_the_kinect_formula_holds_for_depths_of_any_layout() -> None:
    depth = np.linspace(0.5, 5.0, 60, dtype=np.float32).reshape(6, 10)
    expected = 0.0012 + 0.0019 * (depth.astype(np.float64) - 0.4) ** 2
    for part in (np.s_[:], np.s_[1::2, ::3], np.s_[2], np.s_[3, 4]):
        sigma = StructuredLightNoise().sigma_z(depth[part])
        np.testing.assert_array_equal(sigma, expected[part])
        assert sigma.shape == expected[part].shape
    np.testing.assert_array_equal(StructuredLightNoise().sigma_z(depth.T), expected.T)
