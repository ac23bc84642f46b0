"""Table I: the time that each stage takes, without and with sub-sampling."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from edvo.clock import StageClock
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.experiments.bench import Bench
from edvo.experiments.drawing import (
    NORMAL_COLOUR,
    PUBLISHED_COLOUR,
    ROBUST_COLOUR,
    new_figure,
    tidy,
    to_png,
)
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table, Value
from edvo.experiments.registrations import pairs, registration
from edvo.experiments.selection import LONG, videos
from edvo.experiments.sequences import Sequence
from edvo.experiments.stage_times import search_times, seconds, take_apart
from edvo.matching import EdgeIndex
from edvo.odometry import Odometry

STAGES = (
    "Edge information extraction",
    "Sub-sampling, depth at edges",
    "Build k-d tree or grid",
    "Robust pixel matching",
    "Update motions",
)
PAPER = {
    "all": (2.97, None, 3.54, 300.95, 31.13, 338.59),
    "sampled": (2.91, None, 3.62, 30.84, 3.54, 40.91),
}
"""Table I, on fr3/long with an i7-7500U at 2.7 GHz: stages and total in ms."""
SAMPLES = {"all": 0, "sampled": 450}
TITLES = {"all": "without", "sampled": "with"}
SEARCHES = {"tree": "4-D k-d tree", "grid": "grid", "run": "as edvo runs"}
REAL_TIME_MS = 40.0  # 25 Hz

HOW = """Medians over frames, in milliseconds, on the machine at hand and in one thread (the paper
gives averages on an i7-7500U). `Without` registers every edge with depth, `with` 450 samples. Edges
and sub-sampling, which includes the depth of what is drawn, are timed inside `Odometry.track`. The
index is built once a keyframe only; as in the paper the table counts one build a frame.
Registrations of the run are then played again, and timed by the processor (edges, sub-sampling
and `track` by the clock on the wall). By the 4-D k-d tree and by the grid, every warp of
every trial step searches all its samples anew, as the paper does. `As edvo runs` is the compiled
warp and search of those same steps, which keep a match without a search where it provably is still
the best, and the check of the starting poses. Updating is the whole registration less that. The
total is the sum of the column; `track` is `Odometry.track` in one piece."""


@dataclass(frozen=True, eq=False)
class Column:
    """One way to run: without or with sub-sampling.

    Parameters
    ----------
    edges, sampling, update : float
        Stages that do not depend on the search, ms.
    build, match : dict of str to float
        By a key of `SEARCHES`, ms.
    track : float
        `Odometry.track` in one piece, ms.
    samples, reference, warps : float
        Samples, edges of the keyframe, and warps of a registration, on average.
    """

    edges: float
    sampling: float
    update: float
    build: dict[str, float]
    match: dict[str, float]
    track: float
    samples: float
    reference: float
    warps: float

    def stages(self, search: str) -> tuple[float, ...]:
        """Times in the order of `STAGES`, and their sum.

        Parameters
        ----------
        search : str
            A key of `SEARCHES`.

        Returns
        -------
        tuple of float
            Milliseconds.
        """
        parts = self.edges, self.sampling, self.build[search], self.match[search], self.update
        return (*parts, sum(parts))


def run(bench: Bench) -> Outcome:
    """Make the table again.

    Parameters
    ----------
    bench : Bench
        Gives fr3/long or its stand-in, and what is real.

    Returns
    -------
    Outcome
        Times of each stage.
    """
    chosen = [bench.sequence(LONG)] if bench.quick else videos(bench)
    tables, figures, findings, notes = [], [], [], [" ".join(HOW.split())]
    for sequence in chosen:
        columns = {}
        for name, count in SAMPLES.items():
            bench.advance(f"stages {TITLES[name]} sub-sampling on {sequence.name}")
            few = bench.count(6, 2) if count == 0 else bench.count(24, 10)
            columns[name] = measure(sequence, count, few)
        tables.append(make_table(sequence, columns))
        if sequence is chosen[0]:
            figures.append(draw(sequence, columns))
        findings += judge(sequence, columns)
        notes.append(f"{sequence.name}: {sequence.label}; " + describe(columns))
    return Outcome(EXPERIMENT.name, EXPERIMENT.title, tables, figures, findings, tuple(notes))


def measure(sequence: Sequence, samples: int, count: int) -> Column:
    """Measure one way to run.

    Parameters
    ----------
    sequence : Sequence
        Which.
    samples : int
        N; 0 for all edges.
    count : int
        How many registrations are taken apart; five times as many frames are tracked.

    Returns
    -------
    Column

    Raises
    ------
    EvaluationError
        If no three frames in a row are tracked.
    """
    config = Config.preset("paper").with_overrides([f"sampling.count={samples}"])
    clock = StageClock()
    odometry = Odometry(sequence.camera, config, clock=clock)
    stages, track = [], []
    for frame in sequence.frames[: 2 + 5 * count]:
        begin = time.perf_counter()
        odometry.track(frame)
        track.append(time.perf_counter() - begin)
        stages.append(clock.take())
    chosen = pairs(sequence, config, count)
    if not chosen:
        raise EvaluationError(f"{sequence.name}: no three frames in a row are tracked; use more")
    align = registration(sequence, config)
    repeats = 7 if samples else 5
    parts = [
        take_apart(partial(align.align, pair.reference, pair.samples, pair.starts), repeats)
        for pair in chosen
    ]
    edges = [pair.reference.edges for pair in chosen]
    trees = [EdgeIndex(each, "tree") for each in edges]
    searches = np.array(
        [
            search_times(pair.reference, tree, part.queries)
            for pair, tree, part in zip(chosen, trees, parts, strict=True)
        ]
    )
    grid = _ms([seconds(partial(align.index, each), 3) for each in edges])
    return Column(
        # the first frame compiles or fills caches, and has nothing to register with
        edges=_ms([each["edges"] for each in stages[1:]]),
        sampling=_ms([each["sampling"] for each in stages[1:]]),
        update=_ms([part.whole - part.matching for part in parts]),
        build={
            "tree": _ms([seconds(partial(EdgeIndex, each, "tree"), 2) for each in edges]),
            "grid": grid,
            "run": grid,
        },
        match={
            "tree": _ms(searches[:, 1]),
            "grid": _ms(searches[:, 0]),
            "run": _ms([part.matching for part in parts]),
        },
        track=_ms(track[1:]),
        samples=float(np.mean([len(pair.samples) for pair in chosen])),
        reference=float(np.mean([len(each) for each in edges])),
        warps=float(np.mean([len(part.queries) for part in parts])),
    )


def _ms(values: Iterable[float]) -> float:
    return 1e3 * float(np.median(list(values)))


def make_table(sequence: Sequence, columns: dict[str, Column]) -> Table:
    """Write the times of a sequence.

    Parameters
    ----------
    sequence : Sequence
        Which.
    columns : dict of str to Column
        Without and with sub-sampling, by a key of `SAMPLES`.

    Returns
    -------
    Table
        A row for each stage, the published times in front.
    """
    header = ["", *(f"paper, {TITLES[name]}" for name in SAMPLES)]
    header += [f"{title}, {TITLES[name]}" for title in SEARCHES.values() for name in SAMPLES]
    rows, records = [], []
    for row, stage in enumerate((*STAGES, "Total")):
        published = [PAPER[name][row] for name in SAMPLES]
        times = [columns[name].stages(search)[row] for search in SEARCHES for name in SAMPLES]
        cells = ["" if value is None else f"{value:.2f}" for value in published]
        rows.append((stage, *cells, *(f"{value:.2f}" for value in times)))
        records.append(_record(sequence, stage, header, [*published, *times]))
    track = [columns[name].track for name in SAMPLES]
    empty = [""] * (len(header) - 3)
    rows.append(("track in one piece", *empty, *(f"{value:.2f}" for value in track)))
    nothing: list[float | None] = [None] * (len(header) - 3)
    records.append(_record(sequence, "track in one piece", header, [*nothing, *track]))
    return Table(
        f"table1_{sequence.name.replace('/', '_')}",
        f"Time of each stage (ms), without and with sub-sampling, on {sequence.name}",
        tuple(header),
        rows,
        records,
    )


def _record(
    sequence: Sequence, stage: str, header: list[str], values: list[float | None]
) -> dict[str, Value]:
    record: dict[str, Value] = {"sequence": sequence.name, "stage": stage}
    for name, value in zip(header[1:], values, strict=True):
        record[name.replace(",", "").replace(" ", "_") + "_ms"] = value
    return record


def draw(sequence: Sequence, columns: dict[str, Column]) -> Figure:
    """Draw the stages of each way as a bar.

    Parameters
    ----------
    sequence : Sequence
        Which.
    columns : dict of str to Column
        By a key of `SAMPLES`.

    Returns
    -------
    Figure
        The total in its stages; each half has a scale of its own.
    """
    figure = new_figure(11.0, 4.0)
    figure.suptitle(f"{sequence.name} ({sequence.label})")
    colours = (PUBLISHED_COLOUR, "0.7", "#f08c00", ROBUST_COLOUR, NORMAL_COLOUR)
    for axes, name in zip(figure.subplots(1, 2), SAMPLES, strict=True):
        bars = {"paper": [value or 0.0 for value in PAPER[name][:-1]]}
        bars |= {SEARCHES[search]: list(columns[name].stages(search)[:-1]) for search in SEARCHES}
        left = np.zeros(len(bars))
        for stage, colour, values in zip(
            STAGES, colours, zip(*bars.values(), strict=True), strict=True
        ):
            axes.barh(list(bars), values, left=left, color=colour, label=stage)
            left += values
        for y, total in enumerate(left):
            axes.text(total, y, f" {total:.1f}", va="center", fontsize=9)
        axes.set_xlim(0, 1.15 * float(left.max()))
        axes.invert_yaxis()
        axes.set_xlabel("ms a frame")
        axes.set_title(f"{TITLES[name]} sub-sampling", fontsize=10)
        tidy(axes)
    lines, labels = axes.get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return Figure("table1", "What each stage takes of a frame's time.", to_png(figure))


def describe(columns: dict[str, Column]) -> str:
    """Say how much is matched, which times depend on.

    Parameters
    ----------
    columns : dict of str to Column
        By a key of `SAMPLES`.

    Returns
    -------
    str
        Numbers of edges, samples and warps.
    """
    text = f"{columns['sampled'].reference:.0f} edges in a keyframe"
    for name, column in columns.items():
        text += (
            f"; {TITLES[name]} sub-sampling {column.samples:.0f} samples, matched "
            f"{column.warps:.1f} times a frame"
        )
    return text


def judge(sequence: Sequence, columns: dict[str, Column]) -> list[Finding]:
    """Hold the paper's two statements against the times.

    Parameters
    ----------
    sequence : Sequence
        Which.
    columns : dict of str to Column
        By a key of `SAMPLES`.

    Returns
    -------
    list of Finding
        On the bottleneck, and on what sub-sampling gains.
    """
    every, sampled = columns["all"], columns["sampled"]
    match, total = every.match["tree"], every.stages("tree")[-1]
    bottleneck = Finding(
        "Without sub-sampling, pixel matching is the very bottleneck.",
        match > 0.5 * total,
        f"{sequence.name}: by the 4-D k-d tree matching takes {match:.0f} of {total:.0f} ms "
        f"({match / total:.0%}; paper 301 of 339, 89 %); by the grid "
        f"{every.match['grid']:.0f} ms, and {every.match['run']:.0f} ms as edvo runs.",
    )
    after = {search: sampled.stages(search)[-1] for search in SEARCHES}
    gain = total / after["tree"]
    real_time = Finding(
        "Sub-sampling makes it run at 25 Hz.",
        after["tree"] <= REAL_TIME_MS,
        f"{sequence.name}: {total:.0f} to {after['tree']:.1f} ms by the tree, {gain:.1f} times "
        f"faster (paper: 338.6 to 40.9, 8.3 times); {after['grid']:.1f} ms by the grid and "
        f"{after['run']:.1f} ms as edvo runs, {1e3 / after['run']:.0f} frames a second. On another "
        "machine than the paper's.",
    )
    return [bottleneck, real_time]


EXPERIMENT = Experiment(
    "table1",
    "Time of each stage, without and with sub-sampling",
    "338.59 ms a frame without and 40.91 ms with sub-sampling on fr3/long, of which matching takes "
    "300.95 and 30.84 ms (i7-7500U).",
    run,
)
"""Table I."""
