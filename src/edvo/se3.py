"""Rigid motions: SE(3) and its Lie algebra (§II-A).

Conventions, said once:

* A motion is a 4 x 4 float64 matrix ``T_a_b`` that maps points from frame b to frame a, so that
  names cancel: ``T_key_cur @ T_cur_x = T_key_x``.
* A twist is ``[v, w]``: translation first (metres), then rotation (radians).
* A small change is applied from the left: ``T <- exp(delta) @ T``.
"""

import math

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_SMALL = 1e-4  # rad; below it the series are exact to rounding, and the closed forms are not


def hat(w: Matrix) -> Matrix:
    """Skew matrix of a vector, ``hat(w) @ x = cross(w, x)``.

    Parameters
    ----------
    w : ndarray of float64, shape (3,)

    Returns
    -------
    ndarray of float64, shape (3, 3)
    """
    x, y, z = (float(value) for value in w)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(xi: Matrix) -> Matrix:
    """Rigid motion of a twist.

    Parameters
    ----------
    xi : ndarray of float64, shape (6,)
        ``[v, w]``, metres and radians.

    Returns
    -------
    ndarray of float64, shape (4, 4)

    Examples
    --------
    >>> exp(np.zeros(6)).tolist() == np.eye(4).tolist()
    True
    """
    xi = np.asarray(xi, np.float64)
    w = xi[3:]
    angle = float(np.linalg.norm(w))
    if angle < _SMALL:
        a, b, c = 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    else:
        half = math.sin(angle / 2) / angle
        a, b = math.sin(angle) / angle, 2 * half * half
        c = (1 - a) / angle**2
    W = hat(w)
    W2 = W @ W
    T = np.eye(4)
    T[:3, :3] += a * W + b * W2
    T[:3, 3] = xi[:3] + b * (W @ xi[:3]) + c * (W2 @ xi[:3])
    return T


def log(T: Matrix) -> Matrix:
    """Twist of a rigid motion, with a rotation angle in [0, pi].

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)

    Returns
    -------
    ndarray of float64, shape (6,)
        ``[v, w]``, metres and radians. At an angle of exactly pi either axis is right; one is
        returned.
    """
    x, y, z, w = _quaternion(T[:3, :3])
    sine = math.sqrt(x * x + y * y + z * z)  # of half the angle
    # near zero the half angle over its sine is 1 + sine^2 / 6
    scale = 2 * math.atan2(sine, w) / sine if sine > _SMALL else 2 + sine * sine / 3
    rotation = scale * np.array([x, y, z])
    angle = float(np.linalg.norm(rotation))
    if angle < 1e-2:
        # (1 - (angle/2) cot(angle/2)) / angle^2
        factor = 1 / 12 + angle**2 / 720 + angle**4 / 30240
    else:
        factor = (1 - angle / 2 * w / sine) / angle**2
    W = hat(rotation)
    t = T[:3, 3]
    return np.concatenate([t - 0.5 * (W @ t) + factor * (W @ (W @ t)), rotation])


def inverse(T: Matrix) -> Matrix:
    """Inverse of a rigid motion, ``T_b_a`` from ``T_a_b``.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4) or (N, 4, 4)

    Returns
    -------
    ndarray of float64, same shape
    """
    result = np.zeros_like(T, dtype=np.float64)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R
    result[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1
    return result


def compose(*motions: Matrix) -> Matrix:
    """Product of rigid motions, first on the left, with its rotation made exact again.

    Long chains of products drift off the group, and predictions made from them amplify the
    drift; this does not.

    Parameters
    ----------
    *motions : ndarray of float64, shape (4, 4)

    Returns
    -------
    ndarray of float64, shape (4, 4)
    """
    T = np.eye(4)
    for motion in motions:
        T = T @ motion
    return orthonormalized(T)


def orthonormalized(T: Matrix) -> Matrix:
    """Copy of a motion whose rotation is exact to rounding again (Gram-Schmidt).

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)
        Nearly rigid.

    Returns
    -------
    ndarray of float64, shape (4, 4)
    """
    result = np.array(T, np.float64)
    x, y = result[:3, 0], result[:3, 1]
    x = x / math.sqrt(x @ x)
    y = y - (x @ y) * x
    y = y / math.sqrt(y @ y)
    z = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    result[:3, 0], result[:3, 1], result[:3, 2] = x, y, z
    result[3] = (0, 0, 0, 1)
    return result


def interpolate(T_a: Matrix, T_b: Matrix, alpha: float) -> Matrix:
    """Motion on the geodesic between two, at constant twist.

    Parameters
    ----------
    T_a, T_b : ndarray of float64, shape (4, 4)
    alpha : float
        0 gives ``T_a``, 1 gives ``T_b``; beyond them it extrapolates.

    Returns
    -------
    ndarray of float64, shape (4, 4)
    """
    return compose(T_a, exp(alpha * log(inverse(T_a) @ T_b)))


def adjoint(T: Matrix) -> Matrix:
    """Adjoint of a motion: ``T exp(xi) T^-1 = exp(adjoint(T) xi)``.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)

    Returns
    -------
    ndarray of float64, shape (6, 6)
    """
    R = T[:3, :3]
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = R
    A[:3, 3:] = hat(T[:3, 3]) @ R
    return A


def rotation_angle(T: Matrix) -> float:
    """Angle of the rotation, exact near zero and near pi.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4) or (3, 3)

    Returns
    -------
    float
        Radians, in [0, pi].
    """
    x, y, z, w = _quaternion(T[:3, :3])
    return 2 * math.atan2(math.sqrt(x * x + y * y + z * z), w)


def from_quaternion(translation: Matrix, quaternion: Matrix) -> Matrix:
    """Motion of a translation and a quaternion, as in a TUM trajectory file.

    Parameters
    ----------
    translation : ndarray of float64, shape (3,)
        Metres.
    quaternion : ndarray of float64, shape (4,)
        x, y, z, w; of any length but zero.

    Returns
    -------
    ndarray of float64, shape (4, 4)
    """
    q = np.asarray(quaternion, np.float64)
    x, y, z, w = (float(value) for value in q / np.linalg.norm(q))
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = translation
    return T


def to_quaternion(T: Matrix) -> tuple[Matrix, Matrix]:
    """Translation and unit quaternion of a motion.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)

    Returns
    -------
    translation : ndarray of float64, shape (3,)
    quaternion : ndarray of float64, shape (4,)
        x, y, z, w with w >= 0.
    """
    return np.array(T[:3, 3], np.float64), np.array(_quaternion(T[:3, :3]))


def _quaternion(R: Matrix) -> tuple[float, float, float, float]:
    """Unit quaternion x, y, z, w >= 0 of a rotation, from its largest component (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    trace = a + e + i
    largest = max(a, e, i, trace)
    if largest == trace:
        q = (h - f, c - g, d - b, 1 + trace)
    elif largest == a:
        q = (1 + a - e - i, b + d, c + g, h - f)
    elif largest == e:
        q = (b + d, 1 - a + e - i, f + h, c - g)
    else:
        q = (c + g, f + h, 1 - a - e + i, d - b)
    norm = math.copysign(math.hypot(*q), q[3])
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm
