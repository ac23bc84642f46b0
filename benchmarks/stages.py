"""The time of each stage, in the form of the paper's Table I."""

from dataclasses import dataclass
from functools import partial
from statistics import mean

import numpy as np

from benchmarks.frames import Recording
from benchmarks.replay import Caught, catch, spread
from benchmarks.section import Section, Settings, ms, table
from edvo.config import Config
from edvo.experiments.stage_times import Query, seconds, take_apart
from edvo.matching import EdgeIndex

# Table I: Edge information extraction, build k-d tree, matching, update, total; ms
PAPER = {"all": (2.97, 3.54, 300.95, 31.13, 338.59), "sampled": (2.91, 3.62, 30.84, 3.54, 40.91)}

HOW = """Means over frames, as in the paper, in milliseconds. The paper's column is its Table I, on
fr3/long_office and the authors' machine; `w/o` registers every edge, `w/` 450 samples.

- *Edge information extraction* and *Sub-sampling* (with the depth of what is drawn): the stages
  `edges` and `sampling` of a `StageClock` handed to `Odometry`.
- *Build*: `EdgeIndex` over the reference edges, by `tree` and by `grid`. Edvo builds once a
  keyframe only; the table counts one build a frame, as the paper does.
- *Robust pixel matching, tree* (and *grid*): registrations of the run are played again, and
  `EdgeIndex.match` is timed on the warped samples of every trial step, each searched anew, as the
  paper does. *as run*: what edvo does, which keeps a match without a search where it provably is
  still the best: the compiled warp and search of the same steps, without the entry from Python,
  and with the check of the starting poses.
- *Update motions*: the whole `Registration.align`, less *matching as run*.
- *Total*: the sum of the column; *track in one piece*: `Odometry.track` as it runs.

What is played again is timed by the processor's clock of the thread, the stages and `track` by the
one on the wall."""


@dataclass(frozen=True)
class Column:
    """Mean times of one way to run, seconds."""

    edges: float
    sampling: float
    build_tree: float
    build_grid: float
    match_tree: float
    match_grid: float
    match_run: float
    update: float
    track: float
    steps: float
    samples: float
    reference: float
    keyframes: int
    frames: int


def measure(settings: Settings) -> Section:
    """Make a table for each sequence."""
    parts = [HOW]
    for recording in settings.recordings:
        sampled = column(recording, 450, settings.choose(16, 100), settings.choose(4, 24))
        every = column(recording, 0, settings.choose(4, 20), settings.choose(2, 5))
        parts += [f"### {recording.name}", stage_table(every, sampled)]
    return Section("Stages, as in Table I", "\n\n".join(parts))


def column(recording: Recording, samples: int, frames: int, registrations: int) -> Column:
    """Measure one way to run."""
    config = Config.preset("paper").with_overrides([f"sampling.count={samples}"])
    catch(recording, config, 3)  # whatever has to be compiled
    run = catch(recording, config, frames)
    chosen: list[Caught] = spread(run.registrations, registrations)
    parts = [take_apart(caught.align, 9 if samples else 3) for caught in chosen]
    trees = [EdgeIndex(caught.reference.edges, "tree") for caught in chosen]
    searches = [
        [search(caught.reference, tree, query) for query in part.queries]
        for caught, tree, part in zip(chosen, trees, parts, strict=True)
    ]
    keyframes = sum("keyframe" in stages for stages in run.stages)
    return Column(
        edges=mean(stages["edges"] for stages in run.stages),
        sampling=mean(stages["sampling"] for stages in run.stages),
        build_tree=mean(seconds(partial(EdgeIndex, c.reference.edges, "tree"), 3) for c in chosen),
        build_grid=mean(
            seconds(partial(c.registration.index, c.reference.edges), 3) for c in chosen
        ),
        match_tree=mean(sum(tree for tree, _ in times) for times in searches),
        match_grid=mean(sum(grid for _, grid in times) for times in searches),
        match_run=mean(part.matching for part in parts),
        update=mean(part.whole - part.matching for part in parts),
        track=mean(run.track),
        steps=mean(len(part.queries) for part in parts),
        samples=mean(len(caught.samples) for caught in chosen),
        reference=mean(len(caught.reference) for caught in chosen),
        keyframes=keyframes,
        frames=len(run.track),
    )


def search(grid: EdgeIndex, tree: EdgeIndex, query: Query) -> tuple[float, float]:
    """Time one search of all queries by tree and by grid; they must agree on the cost."""
    given = query.pixels, query.gradients, query.criterion
    costs = [index.match(*given).costs for index in (tree, grid)]
    by_tree, by_grid = (seconds(partial(index.match, *given), 1) for index in (tree, grid))
    if not np.allclose(costs[0], costs[1], rtol=1e-5):
        raise RuntimeError("tree and grid found different matches")
    return by_tree, by_grid


def stage_table(every: Column, sampled: Column) -> str:
    """Write the table of a sequence."""
    without, with_ = PAPER["all"], PAPER["sampled"]
    none = ["", ""]

    def row(name: str, paper: int | None, tree: str, grid: str, run: str) -> list[str]:
        cells = [name]
        cells += none if paper is None else [f"{without[paper]:.2f}", f"{with_[paper]:.2f}"]
        for field in (tree, grid, run):
            cells += [ms(getattr(c, field)) for c in (every, sampled)] if field else none
        return cells

    def total(build: str, match: str) -> list[str]:
        return [
            ms(sum(getattr(c, f) for f in ("edges", "sampling", build, match, "update")))
            for c in (every, sampled)
        ]

    rows = [
        row("Edge information extraction", 0, "edges", "edges", "edges"),
        row("Sub-sampling, depth at edges", None, "sampling", "sampling", "sampling"),
        row("Build k-d tree / grid", 1, "build_tree", "build_grid", "build_grid"),
        row("Robust pixel matching", 2, "match_tree", "match_grid", "match_run"),
        row("Update motions", 3, "update", "update", "update"),
        [
            "**Total**",
            f"{without[4]:.2f}",
            f"{with_[4]:.2f}",
            *total("build_tree", "match_tree"),
            *total("build_grid", "match_grid"),
            *total("build_grid", "match_run"),
        ],
        row("track in one piece", None, "", "", "track"),
    ]
    header = ["", "paper w/o", "paper w/", "4-D tree w/o", "4-D tree w/"]
    header += ["grid w/o", "grid w/", "as run w/o", "as run w/"]
    return (
        table(header, rows)
        + f"\n\n{sampled.reference:.0f} reference edges; w/o: {every.samples:.0f} samples, matched "
        + f"{every.steps:.1f} times a frame; w/: {sampled.samples:.0f}, {sampled.steps:.1f} times; "
        + f"{sampled.keyframes} new keyframes in {sampled.frames} frames."
    )
