"""Slack: a camera does not go on as it went, and depth and rows were taken elsewhere by that.

Not in the paper. What was not taken at the instant of an image is moved by the velocity since the
last one. By what an acceleration adds to that one twist is unknown, the same for depth and for all
rows, and solved for together with the pose; docs/theory/slack.md derives it.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.kernels import Lag
from edvo.registration import AS_ONE

LEAST = 2e-4  # m and rad that matter: a tenth of a pixel
LEAST_SLACK = 1e-5  # m and rad, of what is moved most


def bend_of(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Say by how much an acceleration moves what was taken after its image.

    Parameters
    ----------
    share : ndarray of float64
        When, as a share of the period p since the last image.

    Returns
    -------
    ndarray of float64
        As a share of p^2 a, beyond what the mean velocity of that period moves it by.
    """
    return 0.5 * share * (1 + share)


def slackened(
    lag: Lag,
    bend: float,
    bends: NDArray[np.float64],
    period: float,
    acceleration: NDArray[np.float64],
) -> Lag:
    """Say by how much depth and rows may be elsewhere, since a camera does not go on as it went.

    Parameters
    ----------
    lag : Lag
        When the parts of a frame were taken.
    bend : float
        Of depth; see `bend_of`.
    bends : ndarray of float64, shape (N,)
        Of each sample; empty where rows lie where the velocity puts them.
    period : float
        Seconds since the last frame.
    acceleration : ndarray of float64, shape (6,)
        Mean squares along and about the axes, m^2/s^4 and rad^2/s^4; see `Course`.

    Returns
    -------
    Lag
        The same where that makes no difference.
    """
    most = np.abs(bends).max(initial=abs(bend))
    variances = period**4 * acceleration
    if variances.max() * most**2 < LEAST**2:
        return lag
    variances = variances + (LEAST_SLACK / most) ** 2
    to_camera = kernels.adjoint_back(lag.T_ref_last)
    steady = AS_ONE * to_camera.T @ (to_camera / variances[:, None])
    return lag._replace(bend=bend, bends=bends, steady=steady)
