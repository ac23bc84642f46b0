"""Pairs on which the covariance is calibrated: nearly all are registered, and as it says."""

import numpy as np
from benchmarks import covariance

from edvo.odometry import Status

PAIRS = 27  # three of each scene


def test_errors_of_pairs_lie_in_their_regions() -> None:
    scenes = covariance.SCENES
    edged = [n for n in range(PAIRS) if scenes[n % len(scenes)] != "white_wall"]
    found = [covariance.pair(covariance.CHECK, number) for number in edged]
    tracked = [o for o in found if o is not None and o.status is Status.TRACKED]
    assert len(tracked) > 0.8 * len(edged)
    squares = np.array([outcome.square(outcome.covariance) for outcome in tracked])
    assert 2.7 < np.median(squares) < 8  # 5.3 by chance
    assert np.mean(squares < covariance.BOUNDS[2]) > 0.75
    naive = [o.square(o.sigma_px**2 * np.linalg.inv(o.H)) < covariance.BOUNDS[2] for o in tracked]
    assert np.mean(naive) < 0.3
