"""How far each pose of a tracker is off, as a speed: that at which the way to it went wrong."""

import numpy as np
from numpy.typing import NDArray

SPAN_S = 1.0


def error_speed(
    times: NDArray[np.float64],
    truth: NDArray[np.float64],
    poses: NDArray[np.float64],
    given: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Say for each pose how fast the trajectory went wrong up to it.

    Parameters
    ----------
    times : ndarray of float64, shape (N,)
        Seconds, increasing.
    truth : ndarray of float64, shape (N, 4, 4)
        ``T_world_cam`` at these times; NaN where it is not known.
    poses : ndarray of float64, shape (N, 4, 4)
        What the tracker gave; its world may be another.
    given : ndarray of bool, shape (N,)
        Where there is a pose: those of lost frames are none.

    Returns
    -------
    ndarray of float64, shape (N,)
        Metres a second; NaN where there is no pose or no truth, and for the first pose.

    Notes
    -----
    The error is that of the motion ``Q^-1 P`` since the last pose that is at least a second older,
    or since the first of all: each pose answers for the second before it. It counts per second,
    and a time without poses no longer than one second: who finds back has to find back to where
    it was. A shorter time counts as a second, so that noise does not.
    """
    known = given & np.isfinite(truth).all(axis=(1, 2))
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
