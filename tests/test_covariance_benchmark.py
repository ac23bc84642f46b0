"""Pairs on which the covariance is calibrated: nearly all are registered, and as it says."""

import numpy as np
from benchmarks import covariance

from edvo.odometry import Status

PAIRS = 27  # three of each scene


def test_errors_of_pairs_lie_in_their_regions() -> None:
    found = [covariance.pair(covariance.CHECK, number) for number in range(PAIRS)]
    tracked = [o for o in found if o is not None and o.status is Status.TRACKED]
    assert len(tracked) >= 0.85 * PAIRS
    inside = [outcome.square(outcome.covariance) < covariance.BOUNDS[2] for outcome in tracked]
    assert np.mean(inside) > 0.75
    naive = [o.square(o.sigma_px**2 * np.linalg.inv(o.H)) < covariance.BOUNDS[2] for o in tracked]
    assert np.mean(naive) < 0.3
