"""Inertia: along what hardly anything constrains, a camera goes on as it was going.

Not in the paper. Where only edges of one direction are in view, a registration leaves the camera
anywhere along them, and what it finds there, taken for its velocity, leads the next frame farther
astray. So a Kalman filter stands by, of a velocity that fades; where a registration is less sure
than a hand is steady, it says where the camera is, along each motion by as much as it is surer.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.config import Config
from edvo.course import FADING_S, HAND
from edvo.uncertainty import BOUNDS, MARGIN, PER_SQUARES, PRODUCTS, in_current_camera

PRIOR_ALONE = 100.0  # times the variance that is called not constrained: 0.26 m or 11 degrees
NOTHING = 1e4  # the same, of what no registration has told
UNKNOWN = np.array([0.5] * 3 + [1.0] * 3)  # velocity at first, m/s and rad/s (one sigma)
LOOSE = 1 / 3  # of what is called not constrained; a registration that is surer stands as it is
LASTING_S = 0.15  # after so long without one that stands, what the filter is sure of is doubtful
_HAND = (HAND / MARGIN) ** 2  # in the unit of covariances, by which errors are that much smaller
_PER_BOUNDS = 1 / PRODUCTS


class Inertia:
    """Follows the motion of a camera, and says where it is along what is hardly constrained.

    Parameters
    ----------
    config : Config
        Its ``motion.inertia``.

    Attributes
    ----------
    velocity : ndarray of float64, shape (6,)
        That it is expected to go on with, [v, w] in its own frame, 1/s.
    """

    def __init__(self, config: Config) -> None:
        self._is_on = config.motion.inertia == "loose" and config.status.covariance != "none"
        self.forget()

    def forget(self) -> None:
        """Begin anew with the next registration."""
        self._index: int | None = None  # of the keyframe
        self.velocity = np.zeros(6)
        # of the pose, of the pose with the velocity, and of the velocity
        self._P = np.zeros((3, 6, 6))
        self._loose_s = 0.0  # since a registration stood

    @property
    def is_adrift(self) -> bool:
        """Whether the last pose may be off so far that a motion counts as not constrained."""
        return self._loose_s > LASTING_S or _largest(self._P[0]) > 1

    def settle(
        self,
        index: int,
        T_key_last: NDArray[np.float64],
        T_key_cur: NDArray[np.float64],
        covariance: NDArray[np.float64],
        seconds: float,
        *,
        follows: bool,
    ) -> NDArray[np.float64] | None:
        """Take a registration into account.

        Parameters
        ----------
        index : int
            Of the keyframe.
        T_key_last : ndarray of float64, shape (4, 4)
            Where the camera was at the last frame.
        T_key_cur : ndarray of float64, shape (4, 4)
            What was registered, and
        covariance : ndarray of float64, shape (6, 6)
            of that; see `Uncertainty`.
        seconds : float
            Since the last frame.
        follows : bool
            Whether the last pose is that of a moment ago; else it begins anew.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            Where the camera is; None where the registration stands.
        """
        if not self._is_on:
            return None
        own = in_current_camera(covariance, T_key_cur)
        if not follows or self._index is None:
            self.forget()
            self._index = index
            self._P[0], self._P[2] = own, np.diag((UNKNOWN / MARGIN) ** 2)
            return None
        if index != self._index:  # the last frame is the keyframe, and where it is, by definition
            self._index = index
            self._P[:2] = 0
        largest = _largest(own)
        if largest > PRIOR_ALONE:
            own = _without_prior(own)
        T_last_ahead = se3.exp(self.velocity * seconds)
        T_key_ahead, T_ahead_last = T_key_last @ T_last_ahead, kernels.inverted(T_last_ahead)
        off, step = se3.log(kernels.inverted(T_key_ahead) @ T_key_cur), np.empty(6)
        if not kernels.filter_pose(
            self._P, T_ahead_last, own, _HAND, seconds, off, self.velocity, step
        ):
            self.forget()
            return None
        self.velocity *= math.exp(-seconds / FADING_S)  # as a hand does, which turns back
        if largest < LOOSE**2:
            self._loose_s = 0.0
            return None
        self._loose_s += seconds
        T: NDArray[np.float64] = T_key_ahead @ se3.exp(step)
        return T


def _largest(covariance: NDArray[np.float64]) -> float:
    """The largest variance of a motion, in units of what is called not constrained; 0 if small."""
    most = float(covariance.diagonal() @ PER_SQUARES)
    if most < LOOSE**2:  # as then is each
        return 0.0
    return float(np.linalg.eigvalsh(covariance * _PER_BOUNDS)[-1])


def _without_prior(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take what the prior alone says of a motion for nothing: it would pull where nothing tells."""
    values, ways = np.linalg.eigh(covariance * _PER_BOUNDS)
    loose = ways[:, values > PRIOR_ALONE] * BOUNDS[:, None]
    wide: NDArray[np.float64] = covariance + NOTHING * loose @ loose.T
    return wide
