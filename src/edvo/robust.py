"""Robust weights and the scale of residuals (§IV-B).

The paper fits a t-distribution with nu = 2 and updates its scale by fixed-point iteration, after
Kerl et al., *Robust odometry estimation for RGB-D cameras*, ICRA 2013. The other weight functions
are those of Zhang, *Parameter estimation techniques*, 1997, with the constants that keep 95 % of
a Gaussian's efficiency, over a scale by the median absolute residual.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels

WEIGHTS = {
    "none": kernels.NONE,
    "t": kernels.STUDENT_T,
    "huber": kernels.HUBER,
    "cauchy": kernels.CAUCHY,
    "tukey": kernels.TUKEY,
}
TUNING = {"none": 1.0, "huber": 1.345, "cauchy": 2.3849, "tukey": 4.6851}


def student_scale(
    residuals: NDArray[np.float64], nu: float = 2.0, *, tolerance: float = 1e-3
) -> float:
    """Scale sigma of a t-distribution of zero mean, by fixed-point iteration.

    Parameters
    ----------
    residuals : ndarray of float64, shape (N,)
    nu : float
        Degrees of freedom.
    tolerance : float
        Relative change at which the iteration ends.

    Returns
    -------
    float
        Sigma in the unit of the residuals, the root of
        sigma^2 = mean(r^2 (nu + 1) / (nu + r^2 / sigma^2)).
    """
    sigma = 1.0
    for _ in range(50):
        square = residuals**2
        new = float(np.sqrt(np.mean(square * (nu + 1) / (nu + square / sigma**2))))
        if abs(new - sigma) < tolerance * sigma:
            return new
        sigma = new
    return sigma


def median_scale(residuals: NDArray[np.float64]) -> float:
    """Scale by the median absolute residual, equal to the deviation where it is Gaussian.

    Parameters
    ----------
    residuals : ndarray of float64, shape (N,)

    Returns
    -------
    float
    """
    return float(1.4826 * np.median(np.abs(residuals)))


def weights(normalized: NDArray[np.float64], function: str, tuning: float) -> NDArray[np.float64]:
    """Weights of the iteratively re-weighted least squares, W of Eq. (13).

    Parameters
    ----------
    normalized : ndarray of float64
        Residuals over their scale.
    function : {"t", "huber", "cauchy", "tukey", "none"}
    tuning : float
        Degrees of freedom of ``t``, else the tuning constant (see ``TUNING``).

    Returns
    -------
    ndarray of float64, same shape
    """
    square = normalized**2
    if function == "t":
        return (tuning + 1) / (tuning + square)
    if function == "huber":
        return tuning / np.maximum(np.abs(normalized), tuning)
    if function == "cauchy":
        return 1 / (1 + square / tuning**2)
    if function == "tukey":
        return np.clip(1 - square / tuning**2, 0, None) ** 2
    return np.ones_like(normalized)
