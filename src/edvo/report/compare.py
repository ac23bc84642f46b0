"""edvo and what it is compared with, on the same frames: rows of a table, ranked.

`compare_source` makes a `Comparison`; `edvo.report.compare_tables` and
`edvo.report.compare_plots` show it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from edvo.baselines.registry import ZERO_MOTION, Tracker
from edvo.camera import Camera
from edvo.datasets import Reading, Source
from edvo.errors import MissingExtraError
from edvo.evaluation import Evaluation
from edvo.odometry import Status
from edvo.report.compare_rule import failed, judge, middle
from edvo.report.compare_run import CHUNK_FRAMES, Entrant, Followed, follow_together
from edvo.trajectory import Trajectory, nearest_indices

__all__ = ["Comparison", "Row", "Score", "System", "compare_source", "failed"]

_PAIRING_S = 0.02  # between a frame and a pose of an external trajectory, as the TUM tools allow
_LEAST_TIMED = 3  # frames; the first one has nothing to be registered with
_SKIPPED = 3  # frames by which a repeat begins later than the one before, if it is to

Kind = Literal["edvo", "variant", "baseline", "trajectory", "reference"]


@dataclass(frozen=True)
class System:
    """An odometry that takes part in a comparison.

    Attributes
    ----------
    name : str
        For tables and file names.
    title : str
        What it is, in a line.
    kind : str
        ``edvo``, ``variant`` or ``baseline``.
    make : callable
        Gives a tracker for a camera and a seed.
    repeats : int
        Runs, each with another seed.
    later : bool
        Whether each run begins a few frames later than the one before, so that it does not depend
        on the luck of where keyframes fall.
    """

    name: str
    title: str
    kind: Kind
    make: Callable[[Camera, int], Tracker]
    repeats: int = 1
    later: bool = False


@dataclass(frozen=True, eq=False)
class Score:
    """One run of one system.

    Attributes
    ----------
    seed : int or None
        None for poses that were made elsewhere.
    begin : int
        Frames that passed before its first.
    frames : int
        Frames that could have had a pose.
    tracked, degraded : int
        Frames of that status; all poses of an external trajectory count as tracked.
    trajectory : Trajectory
        Poses of those.
    evaluation : Evaluation or None
        Errors; None without truth or where there is nothing to compare.
    wall_s, cpu_s : ndarray of float64, shape (N,)
        Times of the track calls, seconds; empty where they are not known.
    failure : str
        Why it counts as failed; empty if it does not.
    """

    seed: int | None
    begin: int
    frames: int
    tracked: int
    degraded: int
    trajectory: Trajectory
    evaluation: Evaluation | None
    wall_s: NDArray[np.float64]
    cpu_s: NDArray[np.float64]
    failure: str

    @property
    def rpe(self) -> float:
        """Root mean square of the relative pose error, m/s; infinite where it failed."""
        if self.failure:
            return math.inf
        found = None if self.evaluation is None else self.evaluation.rpe
        return math.nan if found is None else found.rmse

    @property
    def coverage(self) -> float:
        """Share of the frames that have a pose."""
        return len(self.trajectory) / self.frames if self.frames else 0.0


@dataclass(frozen=True, eq=False)
class Row:
    """All runs of one system over one sequence.

    Attributes
    ----------
    name, title, kind
        As of the `System`; ``trajectory`` for one made elsewhere, ``reference`` for no motion.
    runs : tuple of Score
        Empty if it could not be made.
    missing : str
        Why it could not; empty if it could.
    memory_mb : float or None
        See `edvo.report.compare_memory`; None if not measured.
    """

    name: str
    title: str
    kind: Kind
    runs: tuple[Score, ...]
    missing: str = ""
    memory_mb: float | None = None

    @property
    def score(self) -> Score | None:
        """The run in the middle by its error, whose figures are shown; None without runs.

        Of an even number it is the worse of the two in the middle.
        """
        if not self.runs:
            return None
        return middle(self.runs, lambda run: run.rpe)

    @property
    def failure(self) -> str:
        """Why it has no error to show; empty if it has."""
        return self.missing if self.score is None else self.score.failure

    @property
    def rpe(self) -> float:
        """Error of the run in the middle, m/s: infinite if it failed, nan without truth."""
        return math.inf if self.score is None else self.score.rpe

    @property
    def worst_rpe(self) -> float:
        """Largest error of all runs that have one, m/s; infinite if any failed, nan if none has."""
        if not self.runs:
            return math.inf
        return max((run.rpe for run in self.runs if not math.isnan(run.rpe)), default=math.nan)

    @property
    def failed_runs(self) -> int:
        """Runs that failed."""
        return sum(bool(run.failure) for run in self.runs)

    @property
    def wall_s(self) -> NDArray[np.float64]:
        """Wall times of the track calls of all runs, seconds."""
        return np.concatenate([np.empty(0), *(run.wall_s for run in self.runs)])

    @property
    def cpu_s(self) -> NDArray[np.float64]:
        """Processor times of the same, seconds."""
        return np.concatenate([np.empty(0), *(run.cpu_s for run in self.runs)])

    @property
    def is_timed(self) -> bool:
        """Whether each run has frames enough for its times to be compared with others'."""
        return bool(self.runs) and min(run.wall_s.size for run in self.runs) >= _LEAST_TIMED

    @property
    def median_s(self) -> float:
        """Median wall time of a frame, seconds; nan where it is not known."""
        return float(np.median(self.wall_s)) if self.wall_s.size else math.nan

    @property
    def median_cpu_s(self) -> float:
        """Median processor time of a frame, seconds; nan where it is not known."""
        return float(np.median(self.cpu_s)) if self.cpu_s.size else math.nan

    def times_as_long_as(self, other: "Row") -> tuple[float, float]:
        """Give the ratios of wall and processor time of a frame; nan where one is not timed."""
        if not (self.is_timed and other.is_timed):
            return math.nan, math.nan
        return self.median_s / other.median_s, self.median_cpu_s / other.median_cpu_s


@dataclass(frozen=True, eq=False)
class Comparison:
    """Systems over the same frames of one sequence.

    Attributes
    ----------
    name : str
        Of the sequence.
    frames, wanted : int
        Frames that all were given; fewer than were to be if it was interrupted.
    unreadable : tuple of str
        A line for each frame that could not be read.
    truth : Trajectory or None
        True poses.
    rows : tuple of Row
        In the order in which they were named; no motion last.
    base : str
        Name of the row that times, and the errors of variants, are given in ratio to.
    """

    name: str
    frames: int
    wanted: int
    unreadable: tuple[str, ...]
    truth: Trajectory | None
    rows: tuple[Row, ...]
    base: str

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its end."""
        return self.frames < self.wanted

    def row(self, name: str) -> Row | None:
        """Look a row up; None if there is none of that name."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def ranked(self) -> tuple[Row, ...]:
        """Rows by their error, those that failed last.

        Without standing still, changes of one part, and what could not be made.
        """
        there = [row for row in self.rows if row.runs and row.kind not in ("reference", "variant")]
        errors = [row.rpe for row in there]
        if any(map(math.isnan, errors)) and not any(map(math.isfinite, errors)):
            return ()  # no truth, or too few frames for a relative error
        return tuple(sorted(there, key=lambda row: math.inf if math.isnan(row.rpe) else row.rpe))

    def rank(self, row: Row) -> int | None:
        """Give the place of a row by its error, from 1; None if it failed or has none."""
        if not math.isfinite(row.rpe):
            return None
        return next((i for i, each in enumerate(self.ranked, 1) if each is row), None)

    def time_ratio(self, row: Row) -> float:
        """Say how many times as long a row takes for a frame as the base; nan if not known."""
        base = self.row(self.base)
        return math.nan if base is None else row.times_as_long_as(base)[0]

    def cpu_ratio(self, row: Row) -> float:
        """Say how many times as much processor time it takes; nan if not known."""
        base = self.row(self.base)
        return math.nan if base is None else row.times_as_long_as(base)[1]

    def error_ratio(self, row: Row) -> float:
        """Say how many times as large the error of a row is as that of the base."""
        base = self.row(self.base)
        return math.nan if base is None else row.rpe / base.rpe


def compare_source(
    source: Source,
    systems: Sequence[System],
    *,
    trajectories: Mapping[str, Trajectory] | None = None,
    indices: Sequence[int] | None = None,
    seed: int = 0,
    base: str = "edvo-default",
    chunk: int = CHUNK_FRAMES,
    on_frame: Callable[[], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Comparison:
    """Track a sequence by several systems and evaluate each, beside those that ran elsewhere.

    Parameters
    ----------
    source : Source
        Where the frames come from.
    systems : sequence of System
        Who tracks them. One whose package is not installed becomes a row that says so.
    trajectories : mapping of str to Trajectory, optional
        Poses made elsewhere; those at the frames chosen are evaluated.
    indices : sequence of int, optional
        Which frames; all by default.
    seed : int
        Of the first run of each system; each further run has the next one.
    base : str
        Name of the row for ratios.
    chunk : int
        Frames that are decoded before they are tracked.
    on_frame : callable, optional
        Called after each frame.
    stop : callable, optional
        Asked before each call; once it says yes, the comparison ends with what there is.

    Returns
    -------
    Comparison
        A row for each, and one of standing still.
    """
    wanted = range(len(source)) if indices is None else indices
    runnable, missing = _runnable(systems, source.camera, seed)
    plan = [(system, k) for system in runnable for k in range(system.repeats)]
    entrants = [
        Entrant(
            partial(system.make, source.camera, seed + k), begin=_SKIPPED * k * int(system.later)
        )
        for system, k in plan
    ]
    unreadable: list[str] = []

    def after(reading: Reading) -> None:
        if reading.frame is None:
            unreadable.append(reading.problem or f"{reading.stamp}: no images")
        if on_frame is not None:
            on_frame()

    followed = follow_together(
        source, entrants, indices=wanted, chunk=chunk, on_frame=after, stop=stop
    )
    done = max((run.frames for run in followed), default=len(wanted))
    truth = source.ground_truth
    scores: dict[str, list[Score]] = {system.name: [] for system in runnable}
    for (system, k), entrant, run in zip(plan, entrants, followed, strict=True):
        scores[system.name].append(_score(run, entrant.begin, seed + k, truth))
    rows = [
        Row(system.name, system.title, system.kind, tuple(scores.get(system.name, ())), why)
        for system in systems
        for why in [missing.get(system.name, "")]
    ]
    times = source.timestamps[list(wanted[:done])]
    for name, poses in (trajectories or {}).items():
        score = _external(poses, times, truth)
        rows.append(Row(name, "poses made elsewhere", "trajectory", (score,)))
    rows.append(Row(ZERO_MOTION, "no motion at all", "reference", (_still(times, truth),)))
    return Comparison(source.name, done, len(wanted), tuple(unreadable), truth, tuple(rows), base)


def _runnable(
    systems: Sequence[System], camera: Camera, seed: int
) -> tuple[list[System], dict[str, str]]:
    """Part those that can be made from those whose package is not installed."""
    there, missing = [], {}
    for system in systems:
        try:
            system.make(camera, seed)
        except MissingExtraError as error:
            missing[system.name] = f"not installed: {error}"
        else:
            there.append(system)
    return there, missing


def _score(run: Followed, begin: int, seed: int, truth: Trajectory | None) -> Score:
    trajectory = run.trajectory()
    evaluation, failure = judge(truth, trajectory, run.frames)
    timed = np.isfinite(run.wall_s)
    return Score(
        seed=seed,
        begin=begin,
        frames=run.frames,
        tracked=run.count(Status.TRACKED),
        degraded=run.count(Status.DEGRADED),
        trajectory=trajectory,
        evaluation=evaluation,
        wall_s=np.array(run.wall_s)[timed],
        cpu_s=np.array(run.cpu_s)[timed],
        failure=run.stopped or failure,
    )


def _external(poses: Trajectory, times: NDArray[np.float64], truth: Trajectory | None) -> Score:
    """Take of a trajectory the poses nearest to the frames, each once."""
    kept: NDArray[np.intp] = np.empty(0, np.intp)
    if len(poses) and len(times):
        nearest = nearest_indices(poses.timestamps, times)
        near = np.abs(poses.timestamps[nearest] - times) < _PAIRING_S
        kept = np.unique(nearest[near])
    trajectory = Trajectory(
        poses.timestamps[kept], poses.poses[kept], tuple(poses.stamps[i] for i in kept)
    )
    evaluation, failure = judge(truth, trajectory, len(times))
    if not len(trajectory) and len(times):
        failure = _no_overlap(poses, times)
    return _untimed(trajectory, len(times), evaluation, failure)


def _no_overlap(poses: Trajectory, times: NDArray[np.float64]) -> str:
    if not len(poses):
        return "no poses"
    return (
        f"no pose within {1e3 * _PAIRING_S:g} ms of a frame: its times are "
        f"{poses.timestamps[0]:.3f} to {poses.timestamps[-1]:.3f} s, "
        f"those of the frames {times[0]:.3f} to {times[-1]:.3f} s"
    )


def _still(times: NDArray[np.float64], truth: Trajectory | None) -> Score:
    """Score who does not move, which is no failure but the bar that others must clear."""
    poses = Trajectory.from_frames(times, [np.eye(4)] * len(times))
    evaluation, _ = judge(truth, poses, len(times))
    return _untimed(poses, len(times), evaluation, "")


def _untimed(poses: Trajectory, frames: int, evaluation: Evaluation | None, failure: str) -> Score:
    """Score poses that no tracker of this comparison has made."""
    return Score(
        seed=None,
        begin=0,
        frames=frames,
        tracked=len(poses),
        degraded=0,
        trajectory=poses,
        evaluation=evaluation,
        wall_s=np.empty(0),
        cpu_s=np.empty(0),
        failure=failure,
    )
