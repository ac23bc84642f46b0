"""Fits recover what the residuals were drawn from, and agree with SciPy's."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from edvo.experiments.residual_fits import fit_gaussian, fit_student


@pytest.mark.parametrize("nu", [0.7, 2.0, 6.0])
def test_a_t_fit_recovers_the_parameters(nu):
    x = 0.3 + 0.8 * stats.t.rvs(nu, size=20_000, random_state=1)
    fit = fit_student(x)
    assert fit.nu == pytest.approx(nu, rel=0.08)
    assert fit.centre == pytest.approx(0.3, abs=0.03)
    assert fit.scale == pytest.approx(0.8, rel=0.04)


@pytest.mark.parametrize("nu", [1.2, 3.0])
def test_a_t_fit_is_that_of_scipy(nu):
    x = stats.t.rvs(nu, loc=-1, scale=2, size=3000, random_state=2)
    theirs = stats.t.fit(x)
    fit = fit_student(x)
    assert fit.nu == pytest.approx(theirs[0], rel=0.01)
    assert fit.centre == pytest.approx(theirs[1], abs=0.01)
    assert fit.scale == pytest.approx(theirs[2], rel=0.01)
    assert fit.log_likelihood == pytest.approx(stats.t.logpdf(x, *theirs).mean(), abs=1e-5)
    assert fit.log_likelihood >= stats.t.logpdf(x, *theirs).mean() - 1e-6


def test_with_nu_given_only_centre_and_scale_are_fitted():
    x = stats.t.rvs(5, loc=2, scale=0.5, size=3000, random_state=3)
    _, centre, scale = stats.t.fit(x, fdf=2.0)
    fit = fit_student(x, 2.0)
    assert (fit.nu, fit.centre) == (2.0, pytest.approx(centre, abs=1e-3))
    assert fit.scale == pytest.approx(scale, rel=1e-3)
    assert fit.log_likelihood < fit_student(x).log_likelihood


def test_a_gaussian_fit_is_mean_and_deviation():
    x = np.random.default_rng(0).normal(3, 0.2, 5000)
    fit = fit_gaussian(x)
    assert (fit.centre, fit.scale) == (pytest.approx(x.mean()), pytest.approx(x.std()))
    assert fit.log_likelihood == pytest.approx(stats.norm.logpdf(x, x.mean(), x.std()).mean())
    # what is Gaussian looks like a t-distribution of many degrees of freedom, no better
    t = fit_student(x)
    assert t.nu > 30
    assert t.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-3)


@pytest.mark.parametrize("nu", [2.0, None, math.inf])
def test_densities_integrate_to_one(nu):
    x = np.random.default_rng(0).standard_t(3, 500)
    fit = fit_gaussian(x) if nu == math.inf else fit_student(x, nu)
    total, _ = integrate.quad(lambda t: float(fit.density(np.array([t]))[0]), -np.inf, np.inf)
    assert total == pytest.approx(1, abs=1e-4)
