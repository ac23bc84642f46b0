"""Sequences tracked under several configurations, and what is said of each run."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.config import Config
from edvo.evaluation import RelativePoseError, coverage
from edvo.experiments.sequences import Sequence
from edvo.odometry import Odometry, TrackedFrame
from edvo.report.compare_rule import judge

CRITERIA = {"normal": "normal", "robust": "robust-then-normal"}
"""The two ways to match that the paper compares (§V-B), and ``matching.criterion`` of each."""


@dataclass(frozen=True, eq=False)
class Run:
    """One sequence, tracked once.

    Parameters
    ----------
    tracked : tuple of TrackedFrame
        Every frame.
    errors : RelativePoseError or None
        Over one second, by the TUM script's formula; None if too few frames have a pose.
    coverage : float
        Share of the frames that have a pose.
    failure : str
        Why it is a failure by the rule of `edvo.report.compare_rule`; empty where it is none.
    seconds, processor_seconds : ndarray, shape (frames,), float64
        Wall and processor time of each call of `Odometry.track`.
    """

    tracked: tuple[TrackedFrame, ...]
    errors: RelativePoseError | None
    coverage: float
    failure: str
    seconds: NDArray[np.float64]
    processor_seconds: NDArray[np.float64]

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Trial steps of each registration, of the lost frames too."""
        found = [t.alignment.iterations for t in self.tracked if t.alignment is not None]
        return np.array(found, np.int64)

    @property
    def rmse(self) -> float:
        """Root mean square of the relative pose error, m/s; NaN without one."""
        return float("nan") if self.errors is None else self.errors.rmse


def track(sequence: Sequence, overrides: Iterable[str] = (), *, preset: str = "paper") -> Run:
    """Track a sequence.

    Parameters
    ----------
    sequence : Sequence
        Which.
    overrides : iterable of str
        What differs from the preset, such as ``sampling.count=900``.
    preset : str
        The paper's by default.

    Returns
    -------
    Run
    """
    config = Config.preset(preset).with_overrides(overrides)
    odometry = Odometry(sequence.camera, config)
    tracked, seconds = [], []
    for frame in sequence.frames:
        begin = time.perf_counter(), time.process_time()
        tracked.append(odometry.track(frame))
        seconds.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    trajectory = odometry.trajectory
    evaluation, failure = judge(sequence.truth, trajectory, len(tracked))
    errors = None if evaluation is None else evaluation.rpe
    share = coverage(len(trajectory), len(tracked))
    wall, processor = np.array(seconds).T
    return Run(tuple(tracked), errors, share, failure, wall, processor)
