"""What the tests of the evaluation share."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from edvo import se3
from edvo.trajectory import Trajectory

HERE = Path(__file__).parent


def _load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def script():
    """The plain-loop oracle."""
    return _load(HERE / "tum_script.py")


@pytest.fixture(scope="session")
def golden():
    """The folder of stored trajectories and their numbers."""
    return HERE / "golden"


def _wander(rng, times, step=0.02, turn=0.01):
    """A smooth random walk of poses."""
    velocity = np.zeros(6)
    T, poses = np.eye(4), []
    for _ in times:
        velocity = 0.95 * velocity + rng.normal(size=6) * np.repeat([step, turn], 3) * 0.3
        T = T @ se3.exp(velocity)
        poses.append(T)
    return np.array(poses)


@pytest.fixture(scope="session")
def make_pair():
    """Make a true trajectory and a noisy estimate of it, as a function of seed and shape."""

    def make(seed, *, seconds=4.0, rate=30.0, true_rate=100.0, jitter=0.0, drop=0.0, noise=0.002):
        rng = np.random.default_rng(seed)
        true_times = np.round(np.arange(0.0, seconds, 1 / true_rate) + 100.0, 4)
        true_poses = _wander(rng, true_times, step=0.02 * 30 / true_rate)
        reference = Trajectory.from_poses(true_times, true_poses)
        times = np.arange(0.05, true_times[-1] - 100.05, 1 / rate)
        times = 100.0 + times + rng.uniform(-jitter, jitter, len(times))
        times = np.unique(np.round(times[rng.uniform(size=len(times)) >= drop], 6))
        world = se3.exp(rng.normal(size=6))
        poses = [world @ reference.at(time) @ se3.exp(rng.normal(size=6) * noise) for time in times]
        return reference, Trajectory.from_poses(times, np.array(poses))

    return make


@pytest.fixture(scope="session")
def as_dict():
    """Turn a trajectory into what the oracle takes."""
    return lambda trajectory: dict(
        zip(trajectory.timestamps.tolist(), trajectory.poses, strict=True)
    )
