"""How far a pose that a tracker vouches for is off, frame by frame, as a speed."""

import numpy as np
from numpy.typing import NDArray

SPAN_S = 1.0


def error_speed(
    times: NDArray[np.float64],
    truth: NDArray[np.float64],
    poses: NDArray[np.float64],
    trusted: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Say for each trusted pose how fast the trajectory went wrong up to it.

    Parameters
    ----------
    times : ndarray of float64, shape (N,)
        Seconds, increasing.
    truth : ndarray of float64, shape (N, 4, 4)
        ``T_world_cam`` at these times; NaN where it is not known.
    poses : ndarray of float64, shape (N, 4, 4)
        What the tracker gave; its world may be another.
    trusted : ndarray of bool, shape (N,)
        Where the tracker stands by its pose.

    Returns
    -------
    ndarray of float64, shape (N,)
        Metres a second; NaN where a pose is not trusted, has no truth, or is the first.

    Notes
    -----
    The error is that of the motion ``Q^-1 P`` since the last trusted pose that is at least a
    second older, or since the first trusted one of all. So each pose answers for all that
    happened within the last second, what was drifted in frames that were not trusted included: a
    pose is trusted together with the way that led to it. The error counts per second, and a time
    without trusted poses no longer than one second: who finds back has to find back to where it
    was. A shorter time counts as a second, so that noise does not.
    """
    known = trusted & np.isfinite(truth).all(axis=(1, 2))
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    speed = np.full(len(times), np.nan)
    members = np.flatnonzero(known)
    for place, i in enumerate(members.tolist()):
        if place == 0:
            continue
        older = int(np.searchsorted(times[members[:place]], times[i] - SPAN_S, side="right")) - 1
        j = int(members[max(older, 0)])
        moved = np.linalg.inv(truth[i]) @ truth[j] @ np.linalg.inv(poses[j]) @ poses[i]
        span = min(max(float(times[i] - times[j]), SPAN_S), SPAN_S + usual)
        speed[i] = float(np.linalg.norm(moved[:3, 3])) / span
    return speed
