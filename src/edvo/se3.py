"""Rigid motions SE(3) as 4x4 matrices, and their twists (§II-A).

Conventions, said here once and kept everywhere:

- ``T_a_b`` maps the coordinates of a point in frame b to frame a, ``p_a = T_a_b @ p_b``, so names
  cancel: ``T_a_b @ T_b_c = T_a_c``. The pose of a camera in the world is ``T_world_cam``.
- A twist is ``[v, w]``: translation part first (metres), then rotation part (radians).
- Updates are left perturbations: ``T <- exp(delta) @ T``.
- Quaternions are ``[x, y, z, w]``, as in TUM files; their sign is chosen so that w >= 0.

Closed forms: Barfoot, State Estimation for Robotics, ch. 7. The rotation part of `log` goes
through the quaternion, whose half angle is well conditioned everywhere, at 0 and at pi too.

Examples
--------
>>> import numpy as np
>>> T_a_b = exp(np.array([1.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2]))
>>> bool(np.allclose(log(T_a_b), [1.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2]))
True
>>> bool(np.allclose(compose(T_a_b, inverse(T_a_b)), np.eye(4)))
True
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edvo.errors import TrajectoryError

# Below this angle (radians) the two coefficients that cancel are summed as series of five terms,
# whose first missing term is below 1e-14 of the sum; above it the closed forms lose two digits.
_SMALL = 0.3


def exp(xi: ArrayLike) -> NDArray[np.float64]:
    """Give the rigid motion of a twist.

    Parameters
    ----------
    xi : array_like of float, shape (6,)
        Twist [v, w], metres and radians; any angle.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        R = I + a W + b W^2 and t = (I + b W + c W^2) v with W = hat(w) (Rodrigues).
    """
    v1, v2, v3, x, y, z = np.asarray(xi, dtype=np.float64).tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    a, b, c = _exp_coefficients(angle)
    # W^2 = w w^T - |w|^2 I, written out: a third of the time of matrix products this small.
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    # t = v + b (w x v) + c w x (w x v)
    p1, p2, p3 = y * v3 - z * v2, z * v1 - x * v3, x * v2 - y * v1
    q1, q2, q3 = y * p3 - z * p2, z * p1 - x * p3, x * p2 - y * p1
    return np.array(
        [
            [1 - b * (yy + zz), b * xy - a * z, b * xz + a * y, v1 + b * p1 + c * q1],
            [b * xy + a * z, 1 - b * (xx + zz), b * yz - a * x, v2 + b * p2 + c * q2],
            [b * xz - a * y, b * yz + a * x, 1 - b * (xx + yy), v3 + b * p3 + c * q3],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def log(T: ArrayLike) -> NDArray[np.float64]:
    """Give the twist of a rigid motion, the inverse of `exp`.

    Parameters
    ----------
    T : array_like of float, shape (4, 4)
        Rigid motion.

    Returns
    -------
    ndarray of float64, shape (6,)
        Twist [v, w], w no longer than pi. At exactly pi both signs of w are right; one is given.
    """
    T = np.asarray(T, dtype=np.float64)
    qx, qy, qz, qw = _quaternion(T)
    sine = math.sqrt(qx * qx + qy * qy + qz * qz)
    half = math.atan2(sine, qw)
    scale = 2.0 * half / sine if sine > 0.0 else 2.0
    x, y, z = scale * qx, scale * qy, scale * qz
    # v = t - (w x t) / 2 + d w x (w x t), d = (1 - h cot h) / angle^2 with h the half angle.
    angle = 2.0 * half
    if angle < _SMALL:
        s = angle * angle
        d = 1 / 12 + s * (1 / 720 + s * (1 / 30240 + s * (1 / 1209600 + s / 47900160)))
    else:
        d = (1.0 - half * math.cos(half) / math.sin(half)) / (angle * angle)
    t1, t2, t3 = float(T[0, 3]), float(T[1, 3]), float(T[2, 3])
    p1, p2, p3 = y * t3 - z * t2, z * t1 - x * t3, x * t2 - y * t1
    q1, q2, q3 = y * p3 - z * p2, z * p1 - x * p3, x * p2 - y * p1
    return np.array(
        [
            t1 - 0.5 * p1 + d * q1,
            t2 - 0.5 * p2 + d * q2,
            t3 - 0.5 * p3 + d * q3,
            x,
            y,
            z,
        ]
    )


def inverse(T: ArrayLike) -> NDArray[np.float64]:
    """Invert a rigid motion: ``inverse(T_a_b)`` is ``T_b_a``.

    Parameters
    ----------
    T : array_like of float, shape (4, 4)
        Rigid motion.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        R^T and -R^T t.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = np.asarray(T, dtype=np.float64).tolist()
    # written out: the last bit of a product is the library's
    return np.array(
        [
            [a, d, g, -(a * x + d * y + g * z)],
            [b, e, h, -(b * x + e * y + h * z)],
            [c, f, i, -(c * x + f * y + i * z)],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def checked(T: ArrayLike) -> NDArray[np.float64] | None:
    """Take a matrix that came from outside for a rigid motion, if it is one.

    Parameters
    ----------
    T : array_like

    Returns
    -------
    ndarray of float64, shape (4, 4), or None
        The same numbers; None where it has another shape, is not finite, or is no rotation (to
        1e-3) and translation.
    """
    try:
        T = np.asarray(T, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    if T.shape != (4, 4) or not np.isfinite(T).all() or (T[3] != (0, 0, 0, 1)).any():
        return None
    R = T[:3, :3]
    turns = np.abs(R @ R.T - np.eye(3)).max() < 1e-3 and np.linalg.det(R) > 0
    return T if turns else None


def compose(*motions: ArrayLike) -> NDArray[np.float64]:
    """Chain rigid motions: ``compose(T_a_b, T_b_c)`` is ``T_a_c``.

    Parameters
    ----------
    *motions : array_like of float, shape (4, 4)
        Rigid motions, the outermost first; none gives the identity.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        Their product.
    """
    result = np.eye(4)
    for motion in motions:
        result = result @ np.asarray(motion, dtype=np.float64)
    return result


def interpolate(T_a: ArrayLike, T_b: ArrayLike, alpha: float) -> NDArray[np.float64]:
    """Move from one pose to another along the screw that joins them.

    Parameters
    ----------
    T_a, T_b : array_like of float, shape (4, 4)
        Poses of one thing in one frame, such as T_world_cam at two instants.
    alpha : float
        0 gives ``T_a``, 1 gives ``T_b``; values outside extrapolate.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        The geodesic T_a exp(alpha log(T_a^-1 T_b)).
    """
    T_a = np.asarray(T_a, dtype=np.float64)
    return T_a @ exp(alpha * log(inverse(T_a) @ np.asarray(T_b, dtype=np.float64)))


def adjoint(T: ArrayLike) -> NDArray[np.float64]:
    """Give the matrix that carries twists through a rigid motion.

    Parameters
    ----------
    T : array_like of float, shape (4, 4)
        Rigid motion T_a_b.

    Returns
    -------
    ndarray of float64, shape (6, 6)
        Ad with ``T @ exp(xi) == exp(Ad @ xi) @ T``: it maps twists of frame b to frame a.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = np.asarray(T, dtype=np.float64).tolist()
    # hat(t) R beside R, written out as in `inverse`
    return np.array(
        [
            [a, b, c, y * g - z * d, y * h - z * e, y * i - z * f],
            [d, e, f, z * a - x * g, z * b - x * h, z * c - x * i],
            [g, h, i, x * d - y * a, x * e - y * b, x * f - y * c],
            [0.0, 0.0, 0.0, a, b, c],
            [0.0, 0.0, 0.0, d, e, f],
            [0.0, 0.0, 0.0, g, h, i],
        ]
    )


def hat(w: ArrayLike) -> NDArray[np.float64]:
    """Give the skew-symmetric matrix of a vector, ``hat(w) @ p == cross(w, p)``.

    Parameters
    ----------
    w : array_like of float, shape (3,)
        Vector.

    Returns
    -------
    ndarray of float64, shape (3, 3)
        Skew-symmetric matrix.
    """
    x, y, z = (float(value) for value in np.asarray(w, dtype=np.float64))
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def from_quaternion(translation: ArrayLike, quaternion_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Build a rigid motion from translation and quaternion.

    Parameters
    ----------
    translation : array_like of float, shape (3,)
        Metres.
    quaternion_xyzw : array_like of float, shape (4,)
        [x, y, z, w] of any length but zero; it is normalised.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        Rigid motion.

    Raises
    ------
    TrajectoryError
        If the quaternion is zero or not finite.
    """
    x, y, z, w = (float(value) for value in np.asarray(quaternion_xyzw, dtype=np.float64))
    largest = max(abs(x), abs(y), abs(z), abs(w))
    if not (math.isfinite(x + y + z + w) and largest > 0.0):
        raise TrajectoryError(f"quaternion [{x}, {y}, {z}, {w}] is no rotation; give a unit one")
    x, y, z, w = x / largest, y / largest, z / largest, w / largest  # no over- or underflow
    s = 2.0 / (x * x + y * y + z * z + w * w)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
    ]
    T[:3, 3] = translation
    return T


def to_quaternion(T: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Split a rigid motion into translation and unit quaternion.

    Parameters
    ----------
    T : array_like of float, shape (4, 4)
        Rigid motion.

    Returns
    -------
    translation : ndarray of float64, shape (3,)
        Metres.
    quaternion : ndarray of float64, shape (4,)
        [x, y, z, w] with w >= 0.
    """
    T = np.asarray(T, dtype=np.float64)
    quaternion = np.array(_quaternion(T))
    return T[:3, 3].copy(), quaternion / math.sqrt(float(quaternion @ quaternion))


def distance(T_a: NDArray[np.float64], T_b: NDArray[np.float64]) -> float:
    """Say how far two cameras are apart.

    Parameters
    ----------
    T_a, T_b : ndarray of float64, shape (4, 4)
        Their poses, in one frame.

    Returns
    -------
    float
        Metres.
    """
    return math.hypot(*(T_a[:3, 3] - T_b[:3, 3]).tolist())


def rotation_angle(T: ArrayLike) -> float:
    """Give the angle of a rotation, accurate near 0 and near pi.

    Parameters
    ----------
    T : array_like of float, shape (4, 4) or (3, 3)
        Rigid motion or rotation.

    Returns
    -------
    float
        Radians in [0, pi].
    """
    x, y, z, w = _quaternion(np.asarray(T, dtype=np.float64))
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)


def _exp_coefficients(angle: float) -> tuple[float, float, float]:
    """Give sin(x)/x, (1 - cos x)/x^2 and (x - sin x)/x^3."""
    if angle == 0.0:
        return 1.0, 0.5, 1 / 6
    half_sinc = math.sin(0.5 * angle) / (0.5 * angle)
    s = angle * angle
    if angle < _SMALL:
        c = 1 / 6 - s * (1 / 120 - s * (1 / 5040 - s * (1 / 362880 - s / 39916800)))
    else:
        c = (angle - math.sin(angle)) / (s * angle)
    return math.sin(angle) / angle, 0.5 * half_sinc * half_sinc, c


def _quaternion(T: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Give [x, y, z, w], w >= 0, from the largest of the four (Shepperd 1978): no cancellation."""
    (a, b, c), (d, e, f), (g, h, i) = T[:3, :3].tolist()
    trace = a + e + i
    if trace >= max(a, e, i):
        w = 0.5 * math.sqrt(1.0 + trace)
        s = 0.25 / w
        return (h - f) * s, (c - g) * s, (d - b) * s, w
    if a >= max(e, i):
        x = 0.5 * math.sqrt(1.0 + a - e - i)
        s = 0.25 / x
        y, z, w = (b + d) * s, (c + g) * s, (h - f) * s
    elif e >= i:
        y = 0.5 * math.sqrt(1.0 + e - a - i)
        s = 0.25 / y
        x, z, w = (b + d) * s, (f + h) * s, (c - g) * s
    else:
        z = 0.5 * math.sqrt(1.0 + i - a - e)
        s = 0.25 / z
        x, y, w = (c + g) * s, (f + h) * s, (d - b) * s
    return (-x, -y, -z, -w) if w < 0.0 else (x, y, z, w)
