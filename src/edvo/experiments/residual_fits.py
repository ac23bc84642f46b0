"""Maximum-likelihood fits of a Gaussian and of a t-distribution to residuals (§IV-B)."""

from dataclasses import dataclass
from math import exp, lgamma, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

_NU = (0.2, 200.0)  # where the best nu is looked for; beyond the upper end it is a Gaussian
_GOLDEN = (sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Fit:
    """A distribution fitted to residuals.

    Parameters
    ----------
    nu : float
        Degrees of freedom of the t-distribution; infinite for the Gaussian.
    centre, scale : float
        Location and scale, in the unit of the residuals.
    log_likelihood : float
        Mean over the residuals, natural logarithm.
    """

    nu: float
    centre: float
    scale: float
    log_likelihood: float

    def density(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probability density.

        Parameters
        ----------
        x : ndarray of float64
            In the unit of the residuals.

        Returns
        -------
        ndarray of float64
            Of the same shape, one over that unit.
        """
        return np.exp(_log_density(x, self.nu, self.centre, self.scale))


def fit_gaussian(residuals: NDArray[np.float64]) -> Fit:
    """Fit a Gaussian: mean and standard deviation.

    Parameters
    ----------
    residuals : ndarray of float64, shape (N,)
        Not all the same.

    Returns
    -------
    Fit
    """
    return _fit(residuals, float("inf"), float(residuals.mean()), float(residuals.std()))


def fit_student(residuals: NDArray[np.float64], nu: float | None = None) -> Fit:
    """Fit a t-distribution.

    Parameters
    ----------
    residuals : ndarray of float64, shape (N,)
        Not all the same.
    nu : float, optional
        Degrees of freedom; the most likely ones where not given, between 0.2 and 200.

    Returns
    -------
    Fit
        The likelihood has one maximum over centre and scale for a given ``nu``, which expectation
        maximization climbs; the best ``nu`` is found by golden-section search over its logarithm.
    """
    if nu is not None:
        return _fit(residuals, nu, *_centre_and_scale(residuals, nu))
    low, high = log(_NU[0]), log(_NU[1])
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = fit_student(residuals, exp(left)), fit_student(residuals, exp(right))
    while high - low > 1e-3:
        if at_left.log_likelihood > at_right.log_likelihood:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = fit_student(residuals, exp(left))
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = fit_student(residuals, exp(right))
    return max(at_left, at_right, key=lambda fit: fit.log_likelihood)


def _fit(residuals: NDArray[np.float64], nu: float, centre: float, scale: float) -> Fit:
    return Fit(nu, centre, scale, float(_log_density(residuals, nu, centre, scale).mean()))


def _centre_and_scale(residuals: NDArray[np.float64], nu: float) -> tuple[float, float]:
    """Expectation maximization; over the sum of weights, not N, it is faster (Kent et al. 1994)."""
    centre = float(np.median(residuals))
    scale = 1.4826 * float(np.median(np.abs(residuals - centre))) or float(residuals.std())
    for _ in range(200):
        weight = (nu + 1) / (nu + ((residuals - centre) / scale) ** 2)
        total = float(weight.sum())
        new_centre = float((weight * residuals).sum()) / total
        new_scale = sqrt(float((weight * (residuals - new_centre) ** 2).sum()) / total)
        change = abs(new_scale - scale) + abs(new_centre - centre)
        centre, scale = new_centre, new_scale
        if change < 1e-6 * scale:
            break
    return centre, scale


def _log_density(
    x: NDArray[np.float64], nu: float, centre: float, scale: float
) -> NDArray[np.float64]:
    square = ((x - centre) / scale) ** 2
    if nu == float("inf"):
        gaussian: NDArray[np.float64] = -0.5 * (square + log(2 * pi)) - log(scale)
        return gaussian
    norm = lgamma((nu + 1) / 2) - lgamma(nu / 2) - 0.5 * log(nu * pi) - log(scale)
    return norm - (nu + 1) / 2 * np.log1p(square / nu)
