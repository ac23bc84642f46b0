"""Many systems on many sequences: the errors of Tables II and III, and what is said of them."""

from collections.abc import Mapping
from collections.abc import Sequence as Items
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from math import inf, isnan
from threading import Event

from edvo.baselines.registry import EDVO_NAMES, ZERO_MOTION, Tracker, make_tracker
from edvo.errors import FrameError, MissingExtraError
from edvo.experiments.bench import Bench
from edvo.experiments.drawing import PUBLISHED_COLOUR, new_figure, tidy, to_png
from edvo.experiments.experiment import Figure, Table, Value
from edvo.experiments.sequences import PAPER_SEQUENCES, Sequence, short_name
from edvo.frame import Frame
from edvo.report.compare_rule import judge, middle, raised
from edvo.trajectory import Trajectory

OURS, BEST_OURS = "edvo-paper", "edvo-default"
QUICK = (OURS, BEST_OURS, "opencv-rgb", "orb-pnp", ZERO_MOTION)
FULL = (
    *QUICK[:-1],
    "opencv-rgbd",
    "direct-t",
    "edge-dt",
    "open3d-hybrid",
    ZERO_MOTION,
)
LIGHT_SEED = 1  # as in docs/light.md
LOW_TEXTURE = tuple(PAPER_SEQUENCES)[3:]

FAILED = "x"
_DRAWS = (*EDVO_NAMES, "orb-pnp")  # whose result depends on a seed
_SEEDS = (3, 1)
_WORKERS = 2

Published = Mapping[str, tuple[float | None, ...]]
"""By sequence: an error in m/s of each of the `SYSTEMS`, None where it failed."""

SYSTEMS = ("SVO", "ORB", "DVO", "DSO", "Ours")
"""Columns of the paper's Tables II and III."""


@dataclass(frozen=True)
class Score:
    """A system on a sequence.

    Parameters
    ----------
    sequence, system : str
        Their names.
    label : str
        What the sequence really is.
    seed : int
        Of what the system draws; of several the one in the middle.
    frames, poses : int
        Frames of the sequence, and those with a pose.
    rmse, median : float
        Relative pose error over one second, m/s; no number where there is none.
    reason : str
        Why it is a failure; empty where it is none.
    """

    sequence: str
    system: str
    label: str
    seed: int
    frames: int
    poses: int
    rmse: float
    median: float
    reason: str

    @property
    def failed(self) -> bool:
        """Whether it is a failure by the rule of `edvo.report.compare_rule.failed`."""
        return bool(self.reason)


@dataclass(frozen=True)
class Scores:
    """All scores under one light.

    Parameters
    ----------
    of : mapping of (str, str) to Score
        By sequence and system.
    sequences, systems : sequence of str
        Their names, in the order of rows and columns.
    missing : tuple of str
        A line for each system that is not installed.
    """

    of: Mapping[tuple[str, str], Score]
    sequences: Items[str]
    systems: Items[str]
    missing: tuple[str, ...]


def measure(bench: Bench, *, severity: float, systems: Items[str] | None = None) -> Scores:
    """Track all sequences with all systems, under one light.

    Parameters
    ----------
    bench : Bench
        Gives the sequences.
    severity : float
        Of the paper's light; 0 is constant light.
    systems : sequence of str, optional
        Names of baselines; those of a quick or full run by default.

    Returns
    -------
    Scores
        Accuracy alone: two of them run at a time, so that no time of theirs would be fair.
    """
    wanted = bench.count(FULL, QUICK) if systems is None else systems
    return bench.remember(
        ("accuracy", severity, tuple(wanted)), lambda: _measure(bench, severity, wanted)
    )


def _measure(bench: Bench, severity: float, wanted: Items[str]) -> Scores:
    sequences = bench.sequences()
    systems, missing = _installed(wanted, sequences[0])
    seeds = range(bench.count(*_SEEDS))
    found: dict[tuple[str, str], Score] = {}
    light = "changing" if severity else "constant"
    for number, plain in enumerate(sequences, start=1):
        bench.advance(f"{light} light: {plain.name}, {number} of {len(sequences)}")
        sequence = plain.relit(severity, LIGHT_SEED + bench.seed) if severity else plain
        jobs = [
            (system, bench.seed + seed)
            for system, seed in product(systems, seeds)
            if seed == 0 or system in _DRAWS
        ]
        scores = _run(sequence, jobs)
        for system in systems:
            found[plain.name, system] = _middle([s for s in scores if s.system == system])
    return Scores(found, [s.name for s in sequences], systems, missing)


def _installed(wanted: Items[str], sequence: Sequence) -> tuple[tuple[str, ...], tuple[str, ...]]:
    systems, missing = [], []
    for name in wanted:
        try:
            make_tracker(name, sequence.camera)
        except MissingExtraError as error:
            missing.append(f"{name} is left out: {error}")
        else:
            systems.append(name)
    return tuple(systems), tuple(missing)


def _run(sequence: Sequence, jobs: Items[tuple[str, int]]) -> list[Score]:
    sequence.load()  # once, before several threads want it
    stop = Event()
    pool = ThreadPoolExecutor(_WORKERS)
    try:
        waiting = [pool.submit(follow, sequence, name, seed, stop) for name, seed in jobs]
        return [one.result() for one in waiting]
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


def follow(sequence: Sequence, system: str, seed: int, stop: Event | None = None) -> Score:
    """Track a sequence with a system.

    Parameters
    ----------
    sequence : Sequence
        What is tracked.
    system : str
        Name of a baseline.
    seed : int
        Of what it draws.
    stop : threading.Event, optional
        Once set, the rest of the frames is left out.

    Returns
    -------
    Score
        A tracker that raises has failed, with what it said as the reason.
    """
    frames, problems = sequence.frames, sequence.problems
    count = len(frames) + len(problems)
    try:
        path = _tracked(make_tracker(system, sequence.camera, seed), frames, stop)
    except Exception as error:  # a library of others may raise anything, and this is a finding
        evaluation, poses, reason = None, 0, raised(error)
    else:
        poses = len(path)
        evaluation, reason = judge(sequence.truth, path, count)
    errors = None if evaluation is None else evaluation.rpe
    nothing = float("nan")
    return Score(
        sequence.name,
        system,
        sequence.label,
        seed,
        count,
        poses,
        nothing if errors is None else errors.rmse,
        nothing if errors is None else errors.median,
        # Not moving is the measure of failure, not one itself.
        "" if system == ZERO_MOTION else reason,
    )


def _tracked(tracker: Tracker, frames: Items[Frame], stop: Event | None) -> Trajectory:
    for frame in frames:
        if stop is not None and stop.is_set():
            break
        try:
            tracker.track(frame)
        except FrameError as error:
            tracker.skip(frame.timestamp, str(error))
    return tracker.trajectory


def _middle(scores: Items[Score]) -> Score:
    return middle(scores, lambda score: inf if score.failed else score.rmse)


def make_table(scores: Scores, published: Published, what: str, *, name: str, title: str) -> Table:
    """Lay out one error of all systems, with the published ones beside.

    Parameters
    ----------
    scores : Scores
        What was measured.
    published : mapping
        The paper's table.
    what : str
        ``rmse`` or ``median``.
    name, title : str
        Of the table.

    Returns
    -------
    Table
        A row a sequence; failures are ``x``, the best of a row is bold.
    """
    header = (
        "sequence",
        "data",
        *(f"{system} [paper]" for system in SYSTEMS),
        *scores.systems,
    )
    rows = []
    records: list[dict[str, Value]] = []
    for sequence in scores.sequences:
        line = [scores.of[sequence, system] for system in scores.systems]
        label = line[0].label
        best = min((_error(s, what) for s in line if not s.failed), default=float("nan"))
        paper = published.get(sequence)
        cells = ["-"] * len(SYSTEMS) if paper is None else [_published(error) for error in paper]
        cells += [_cell(score, what, best) for score in line]
        rows.append((short_name(sequence), label, *cells))
        records += _records(sequence, label, line, paper, what)
    return Table(name, title, header, rows, records)


def _records(
    sequence: str,
    label: str,
    line: Items[Score],
    paper: tuple[float | None, ...] | None,
    what: str,
) -> list[dict[str, Value]]:
    found: list[dict[str, Value]] = [
        {
            "sequence": sequence,
            "data": "published",
            "system": system,
            f"rpe_{what}_m_s": error,
            "failed": "failed in the paper" if error is None else "",
        }
        for system, error in zip(SYSTEMS, paper or (), strict=False)
    ]
    for score in line:
        error = _error(score, what)
        found.append(
            {
                "sequence": sequence,
                "data": label,
                "system": score.system,
                f"rpe_{what}_m_s": None if isnan(error) else round(error, 6),
                "failed": score.reason,
                "frames": score.frames,
                "poses": score.poses,
                "seed": score.seed,
            }
        )
    return found


def failures_table(scores: Scores, *, name: str, title: str) -> Table:
    """List what failed, and why.

    Parameters
    ----------
    scores : Scores
        What was measured.
    name, title : str
        Of the table.

    Returns
    -------
    Table
        A row a failure.
    """
    rows = [
        (short_name(score.sequence), score.system, f"{score.poses} of {score.frames}", score.reason)
        for score in scores.of.values()
        if score.failed
    ]
    return Table(name, title, ("sequence", "system", "poses", "why it is marked x"), rows)


def draw_scores(
    scores: Scores, published: Published, *, name: str, caption: str, title: str
) -> Figure:
    """Draw the errors of all systems, a column a sequence.

    Parameters
    ----------
    scores : Scores
        What was measured.
    published : mapping
        The paper's RMSE.
    name, caption, title : str
        Of the figure.

    Returns
    -------
    Figure
        Failures lie on a line at the top.
    """
    figure = new_figure(11.0, 5.0)
    axes = figure.subplots()
    errors = [score.rmse for score in scores.of.values() if not score.failed and score.rmse > 0]
    top = 1.6 * max([*errors, 0.1])
    places = range(len(scores.sequences))
    width = 0.7 / max(1, len(scores.systems) - 1)
    for number, system in enumerate(scores.systems):
        line = [scores.of[sequence, system] for sequence in scores.sequences]
        shift = (number - (len(scores.systems) - 1) / 2) * width
        done = [(place + shift, s.rmse) for place, s in enumerate(line) if not s.failed]
        lost = [(place + shift, top) for place, s in enumerate(line) if s.failed]
        (dots,) = axes.plot(*_columns(done), "o", ms=6, label=system)
        axes.plot(*_columns(lost), "X", ms=9, color=dots.get_color())
    ours = [published.get(sequence, (None,) * 5)[-1] for sequence in scores.sequences]
    for place, error in zip(places, ours, strict=True):
        if error is not None:
            axes.hlines(error, place - 0.42, place + 0.42, color=PUBLISHED_COLOUR, lw=1.5)
    axes.plot([], [], color=PUBLISHED_COLOUR, lw=1.5, label="published, the paper's own")
    axes.set_yscale("log")
    axes.set_ylabel("RPE RMSE (m/s); crosses: failed")
    names = [short_name(sequence) for sequence in scores.sequences]
    axes.set_xticks(list(places), names, rotation=20, ha="right")
    axes.set_title(title)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    tidy(axes)
    return Figure(name, caption, to_png(figure))


def _columns(points: Items[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def said(score: Score) -> str:
    """Say a score in a few words.

    Parameters
    ----------
    score : Score
        What was measured.

    Returns
    -------
    str
        Such as ``0.012`` or ``failed``.
    """
    return "failed" if score.failed else f"{score.rmse:.4f}"


def _error(score: Score, what: str) -> float:
    return score.rmse if what == "rmse" else score.median


def _cell(score: Score, what: str, best: float) -> str:
    if score.failed:
        return FAILED
    error = _error(score, what)
    if isnan(error):
        return "-"
    text = f"{error:.4f}"
    return f"**{text}**" if error == best else text


def _published(error: float | None) -> str:
    return FAILED if error is None else f"{error:.3f}"
