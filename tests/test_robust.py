import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, optimize, stats

from edvo import robust

from . import twins


def maximum_likelihood(residuals, nu):
    """Scale of a t-distribution about zero, by looking for the highest likelihood."""

    def loss(log_sigma):
        return -stats.t.logpdf(residuals, nu, scale=np.exp(log_sigma)).sum()

    return float(np.exp(optimize.minimize_scalar(loss, bracket=(-3, 3), tol=1e-10).x))


@pytest.mark.parametrize("nu", [1.0, 2.0, 5.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_student_scale_is_the_most_likely(nu, seed):
    residuals = stats.t.rvs(nu, scale=0.4, size=450, random_state=seed)
    sigma = robust.student_scale(residuals, nu, tolerance=1e-10)
    assert sigma == pytest.approx(maximum_likelihood(residuals, nu), rel=1e-4)
    assert sigma == pytest.approx(0.4, rel=0.15)
    assert robust.student_scale(residuals, nu) == pytest.approx(sigma, rel=5e-3)


@settings(max_examples=50)
@given(factor=st.floats(1e-3, 1e3), seed=st.integers(0, 1000))
def test_scales_go_with_the_residuals(factor, seed):
    residuals = np.random.default_rng(seed).standard_t(2, 200)
    for scale in (lambda r: robust.student_scale(r, tolerance=1e-9), robust.median_scale):
        assert scale(residuals * factor) == pytest.approx(factor * scale(residuals), rel=1e-5)


def test_median_scale_is_the_deviation_of_a_gaussian():
    residuals = np.random.default_rng(0).normal(0, 0.3, 100_000)
    assert robust.median_scale(residuals) == pytest.approx(0.3, rel=0.02)


def test_scales_stand_outliers():
    rng = np.random.default_rng(0)
    residuals = rng.normal(0, 0.3, 500)
    residuals[:100] = rng.uniform(-30, 30, 100)
    assert robust.median_scale(residuals) < 0.6
    assert robust.student_scale(residuals) < 0.6
    assert residuals.std() > 5


@pytest.mark.parametrize("name", robust.WEIGHTS)
def test_weight_times_residual_is_the_slope_of_the_cost(name):
    tuning = robust.TUNING.get(name, 2.0)
    r = np.linspace(-9, 9, 1000)  # even: misses 0 and the tuning constants
    h = 1e-6
    slope = (twins.cost(r + h, name, tuning) - twins.cost(r - h, name, tuning)) / (2 * h)
    np.testing.assert_allclose(robust.weights(r, name, tuning) * r, slope, atol=1e-6)


@pytest.mark.parametrize("name", robust.WEIGHTS)
def test_weights_fall_with_the_residual(name):
    tuning = robust.TUNING.get(name, 2.0)
    r = np.linspace(0, 20, 200)
    weight = robust.weights(r, name, tuning)
    assert (np.diff(weight) <= 0).all()
    assert (weight >= 0).all()
    np.testing.assert_array_equal(weight, robust.weights(-r, name, tuning))
    assert (weight[-1] < 0.15) == (name != "none")


@pytest.mark.parametrize("name", robust.TUNING)
def test_tuning_keeps_95_percent_of_a_gaussians_efficiency(name):
    if name == "none":
        return
    tuning = robust.TUNING[name]

    def psi(r):
        return float(robust.weights(np.array([r]), name, tuning)[0]) * r

    def slope(r, h=1e-5):
        return (psi(r + h) - psi(r - h)) / (2 * h)

    def expect(function):
        kinks = [-tuning, tuning]
        density = stats.norm.pdf
        return integrate.quad(lambda r: function(r) * density(r), -9, 9, points=kinks, limit=200)[0]

    efficiency = expect(slope) ** 2 / expect(lambda r: psi(r) ** 2)
    assert efficiency == pytest.approx(0.95, abs=2e-3)
