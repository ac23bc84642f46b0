"""Fig. 10: drift and iterations against the gap between keyframes, for both criteria."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from edvo.experiments.bench import Bench
from edvo.experiments.drawing import NORMAL_COLOUR, ROBUST_COLOUR, new_figure, tidy, to_png
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table, Value
from edvo.experiments.runs import CRITERIA, track
from edvo.experiments.selection import videos
from edvo.experiments.sequences import Loaded, Sequence, short_name

GAPS = (1, 2, 5, 10, 15, 20, 30, 45)
GAPS_QUICK = (1, 2, 5, 15, 30)
LARGE = 10  # frames; from here on a gap is called large
FURTHEST = {"tracked": 1000, "skipped": 5}  # frames; up to where iterations are judged
SURGE = 1.2  # times the iterations at the smallest gap
ALIKE = 0.97  # times: a smaller difference in drift is none

READINGS = {"tracked": "every frame tracked", "skipped": "frames between left out"}
"""Two ways to read `frame gap`, and what they are called."""

HOW = """Every frame is registered with a keyframe that is replaced every so many frames
(`keyframes.rule=gap`), by the preset `paper`, from a constant velocity or the last pose,
whichever fits better. Since that start is near, however far the keyframe is, a second reading
is shown as well: the frames between are left out, so that each frame is registered with one
that is so many frames away, from no motion at all; it is judged up to a gap of 5, since beyond
it both criteria mostly end in wrong minima, soon or late, as the drift in the table shows. The
error is the RMSE of the relative pose error over 1 s, the mean over seeds of the sampling. Lost
frames have no pose: their share stands beside. Where a run has poses for fewer than half of the
frames, or does no better than standing still, it has failed (x), whatever its error: its drift
counts as higher than any, and its iterations are not judged. The paper does not say which sequence
its figure shows, and gives no numbers."""


@dataclass(frozen=True, eq=False)
class Cell:
    """Runs of one sequence at one gap by one criterion.

    Parameters
    ----------
    rmse : float
        Mean over seeds, m/s; NaN without any.
    iterations : ndarray of int64
        Of all registrations.
    coverage : float
        Share of the frames that have a pose.
    failures : int
        Runs that failed by the rule of `edvo.report.compare_rule`.
    """

    rmse: float
    iterations: NDArray[np.int64]
    coverage: float
    failures: int = 0

    @property
    def drift(self) -> float:
        """Error that is judged, m/s: infinite if a run failed, NaN where none is known."""
        return float("inf") if self.failures else self.rmse

    @property
    def steps(self) -> float:
        """Mean number of iterations; NaN without any."""
        return float(np.mean(self.iterations)) if len(self.iterations) else float("nan")

    @property
    def deviation(self) -> float:
        """Standard deviation of the iterations; NaN without any."""
        return float(np.std(self.iterations)) if len(self.iterations) else float("nan")


Grid = dict[tuple[str, str, int], Cell]
"""By reading, criterion and gap."""


def run(bench: Bench) -> Outcome:
    """Make the figure again.

    Parameters
    ----------
    bench : Bench
        Gives the sequences.

    Returns
    -------
    Outcome
        Drift and iterations of each sequence.
    """
    gaps = bench.count(GAPS, GAPS_QUICK)
    seeds = range(bench.seed, bench.seed + bench.count(3, 1))
    grids: dict[str, Grid] = {}
    chosen = videos(bench)
    for sequence in chosen:
        bench.advance(f"keyframe gaps on {sequence.name}")
        grids[sequence.name] = {
            key: measure(sequence, *key, seeds) for key in product(READINGS, CRITERIA, gaps)
        }
    findings = [_judge_gap(grids), _judge_drift(grids)]
    findings += [_judge_steps(grids, reading) for reading in READINGS]
    return Outcome(
        EXPERIMENT.name,
        EXPERIMENT.title,
        [make_table(name, grid) for name, grid in grids.items()],
        [draw(grids)],
        findings,
        (" ".join(HOW.split()), *(f"{s.name}: {s.label}" for s in chosen)),
    )


def measure(sequence: Sequence, reading: str, criterion: str, gap: int, seeds: range) -> Cell:
    """Track a sequence with keyframes so many frames apart.

    Parameters
    ----------
    sequence : Sequence
        Which.
    reading : str
        A key of `READINGS`.
    criterion : str
        A key of `CRITERIA`.
    gap : int
        Frames a keyframe.
    seeds : range
        Of the sampling, a run each.

    Returns
    -------
    Cell
    """
    overrides = [f"matching.criterion={CRITERIA[criterion]}", "keyframes.rule=gap"]
    if reading == "skipped":
        sequence = thinned(sequence, gap)
        overrides += ["keyframes.gap_frames=1", "motion.prior=still"]
    else:
        overrides.append(f"keyframes.gap_frames={gap}")
    runs = [track(sequence, [*overrides, f"seed={seed}"]) for seed in seeds]
    return Cell(
        float(np.mean([run.rmse for run in runs])),
        np.concatenate([run.iterations for run in runs]),
        float(np.mean([run.coverage for run in runs])),
        sum(bool(run.failure) for run in runs),
    )


def make_table(name: str, grid: Grid) -> Table:
    """Write drift and iterations of a sequence.

    Parameters
    ----------
    name : str
        Of the sequence.
    grid : dict
        By criterion and gap.

    Returns
    -------
    Table
        A row for each gap.
    """
    rows, records = [], []
    for reading, gap in product(READINGS, _gaps(grid)):
        cells = [grid[reading, criterion, gap] for criterion in CRITERIA]
        rows.append(
            (
                READINGS[reading],
                str(gap),
                *(_drift(cell) for cell in cells),
                *(f"{cell.steps:.1f} ± {cell.deviation:.1f}" for cell in cells),
                " / ".join(f"{1 - cell.coverage:.0%}" for cell in cells),
            )
        )
        record: dict[str, Value] = {
            "sequence": name,
            "reading": READINGS[reading],
            "gap_frames": gap,
        }
        for criterion, cell in zip(CRITERIA, cells, strict=True):
            record[f"{criterion}_rpe_rmse_m_s"] = cell.rmse
            record[f"{criterion}_iterations_mean"] = cell.steps
            record[f"{criterion}_iterations_std"] = cell.deviation
            record[f"{criterion}_coverage"] = cell.coverage
            record[f"{criterion}_failed_runs"] = cell.failures
        records.append(record)
    return Table(
        f"fig10_{name.replace('/', '_')}",
        f"Drift (RPE RMSE over 1 s, mm/s) and iterations a frame on {name}",
        (
            "reading",
            "gap",
            "drift, normal",
            "drift, robust",
            "iterations, normal",
            "iterations, robust",
            "lost, normal / robust",
        ),
        rows,
        records,
    )


def _drift(cell: Cell) -> str:
    """Write the drift: bare if it counts, marked if a run failed."""
    number = f"{1e3 * cell.rmse:.1f}" if np.isfinite(cell.rmse) else "-"
    return f"x ({number})" if cell.failures else number


def draw(grids: dict[str, Grid]) -> Figure:
    """Draw drift above iterations, for each sequence.

    Parameters
    ----------
    grids : dict of str to dict
        By sequence, then by criterion and gap.

    Returns
    -------
    Figure
        In the form of the paper's Fig. 10.
    """
    figure = new_figure(3.6 * max(2, len(grids)), 5.6)
    panels = figure.subplots(2, len(grids), squeeze=False, sharex=True)
    colours = {"normal": NORMAL_COLOUR, "robust": ROBUST_COLOUR}
    for (name, grid), (top, bottom) in zip(grids.items(), panels.T, strict=True):
        gaps = _gaps(grid)
        for (criterion, colour), reading in product(colours.items(), READINGS):
            cells = [grid[reading, criterion, gap] for gap in gaps]
            label = f"{criterion} criterion, {READINGS[reading]}"
            style = "o-" if reading == "tracked" else "o:"
            mean = np.array([cell.steps for cell in cells])
            bottom.plot(gaps, mean, style, color=colour, lw=1.4, ms=3, label=label)
            if reading == "tracked":
                drift = [1e3 * cell.rmse for cell in cells]
                top.plot(gaps, drift, style, color=colour, lw=1.4, ms=3)
                lost = [
                    (gap, d)
                    for gap, d, cell in zip(gaps, drift, cells, strict=True)
                    if cell.failures
                ]
                top.plot([gap for gap, _ in lost], [d for _, d in lost], "X", color=colour, ms=8)
                std = np.array([cell.deviation for cell in cells])
                bottom.fill_between(gaps, mean - std, mean + std, color=colour, alpha=0.12, lw=0)
        top.set_title(short_name(name), fontsize=10)
        bottom.set_xlabel("frames between keyframes")
        for axes in (top, bottom):
            axes.set_ylim(bottom=0)
            tidy(axes)
    panels[0, 0].set_ylabel("drift (mm/s)")
    panels[1, 0].set_ylabel("iterations a frame")
    lines, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return Figure(
        "fig10",
        "Above: drift against the gap between keyframes, every frame tracked; crosses: failed. "
        "Below: iterations; the band is one standard deviation.",
        to_png(figure),
    )


def thinned(sequence: Sequence, step: int) -> Sequence:
    """Leave out frames.

    Parameters
    ----------
    sequence : Sequence
        Which.
    step : int
        One frame in so many stays.

    Returns
    -------
    Sequence
    """
    return replace(sequence, load=lambda: Loaded(sequence.frames[::step]))


def _gaps(grid: Grid) -> list[int]:
    return sorted({gap for _, _, gap in grid})


def _large_gaps(grid: Grid) -> list[int]:
    return [gap for gap in _gaps(grid) if gap >= LARGE] or _gaps(grid)[-1:]


def _large(grid: Grid) -> dict[str, float]:
    """Mean drift over the large gaps at which not both criteria fail, m/s, by criterion."""
    cells = [
        [grid["tracked", criterion, gap] for criterion in CRITERIA] for gap in _large_gaps(grid)
    ]
    judged = [pair for pair in cells if not all(cell.failures for cell in pair)] or cells
    drifts = np.mean([[cell.drift for cell in pair] for pair in judged], axis=0)
    return dict(zip(CRITERIA, drifts.tolist(), strict=True))


def _less(lower: float, higher: float) -> bool | None:
    """Compare two drifts; None where one is not known or both failed."""
    if np.isnan([lower, higher]).any() or (np.isinf(lower) and np.isinf(higher)):
        return None
    return lower < higher


def _said(drift: float) -> str:
    if np.isnan(drift):
        return "not known"
    return "failed" if np.isinf(drift) else f"{1e3 * drift:.1f} mm/s"


def _finding(claim: str, said: dict[str, tuple[bool | None, str]]) -> Finding:
    """Put together what is said of each sequence: whether it holds there, and the numbers."""
    holding = [name for name, (holds, _) in said.items() if holds]
    unknown = [name for name, (holds, _) in said.items() if holds is None]
    text = "; ".join(f"{short_name(name)}: {numbers}" for name, (_, numbers) in said.items())
    if len(holding) == len(said):
        verdict = "It holds on all of them."
    elif holding:
        verdict = f"It holds on {len(holding)} of {len(said)}: {_names(holding)}."
    elif len(unknown) == len(said):
        verdict = "It cannot be said of any."
    else:
        verdict = "It holds on none of them."
    if 0 < len(unknown) < len(said):
        verdict += f" It cannot be said of {_names(unknown)}."
    denied = len(holding) + len(unknown) < len(said)
    return Finding(claim, False if denied else None if unknown else True, f"{text}. {verdict}")


def _names(sequences: list[str]) -> str:
    return ", ".join(short_name(name) for name in sequences)


def _judge_gap(grids: dict[str, Grid]) -> Finding:
    said = {}
    for name, grid in grids.items():
        gaps = _gaps(grid)
        drift = {gap: grid["tracked", "robust", gap].drift for gap in gaps}
        end = float(np.mean([drift[gap] for gap in _large_gaps(grid)]))
        best = min(gaps, key=lambda gap: np.nan_to_num(drift[gap], nan=np.inf))
        numbers = (
            f"{_said(drift[gaps[0]])} at a gap of {gaps[0]}, {_said(end)} at large ones, the "
            f"lowest {_said(drift[best])} at {best}"
        )
        said[name] = (_less(end, drift[gaps[0]]), numbers)
    return _finding(
        "The larger the gap between keyframes, the lower the drift (robust criterion; large is "
        f"the mean over gaps from {LARGE} frames on).",
        said,
    )


def _judge_drift(grids: dict[str, Grid]) -> Finding:
    said = {}
    for name, grid in grids.items():
        large = _large(grid)
        normal, robust = large["normal"], large["robust"]
        numbers = f"{_said(normal)} against {_said(robust)}"
        if np.isfinite([normal, robust]).all():
            numbers += f" ({100 * (robust / normal - 1):+.0f} %)"
        said[name] = (_less(robust, ALIKE * normal), numbers)
    return _finding(
        f"At large gaps (from {LARGE} frames on) drift is higher with the normal criterion than "
        f"with the robust one, by more than {100 * (1 - ALIKE):.0f} %.",
        said,
    )


def _judge_steps(grids: dict[str, Grid], reading: str) -> Finding:
    said: dict[str, tuple[bool | None, str]] = {}
    for name, grid in grids.items():
        # where too few frames are left there may be no registration, or only lost ones
        gaps = [
            gap
            for gap in _gaps(grid)
            if gap <= FURTHEST[reading]
            and all(_has_steps(grid[reading, criterion, gap]) for criterion in CRITERIA)
        ]
        if len(gaps) < 2:
            said[name] = (None, "fewer than two gaps at which both criteria can follow")
            continue
        (n1, n2), (r1, r2) = (
            [grid[reading, criterion, gap].steps for gap in (gaps[0], gaps[-1])]
            for criterion in ("normal", "robust")
        )
        numbers = (
            f"normal {n1:.1f} to {n2:.1f} ({100 * (n2 / n1 - 1):+.0f} %), robust {r1:.1f} to "
            f"{r2:.1f} ({100 * (r2 / r1 - 1):+.0f} %) from a gap of {gaps[0]} to {gaps[-1]}"
        )
        said[name] = (n2 >= SURGE * n1 and r2 < n2 and r2 - r1 < n2 - n1, numbers)
    return _finding(
        "With the gap the iterations of the normal criterion surge, those of the robust one stay "
        f"fewer and rise less ({READINGS[reading]}).",
        said,
    )


def _has_steps(cell: Cell) -> bool:
    return not cell.failures and len(cell.iterations) > 0


EXPERIMENT = Experiment(
    "fig10",
    "Drift and iterations against the keyframe gap",
    "Larger gaps between keyframes give lower drift; with the normal criterion drift falls less "
    "and iterations surge, with the robust one they stay few (no numbers are given).",
    run,
)
"""Fig. 10."""
