"""Fig. 11: the sequences that are used, half a period of the light apart."""

from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from edvo.config import Config
from edvo.edges import extract_edges
from edvo.experiments.accuracy import LIGHT_SEED
from edvo.experiments.bench import Bench
from edvo.experiments.drawing import new_figure, tidy, to_png
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table, Value
from edvo.experiments.sequences import PAPER_SEQUENCES, TEXTURED, Sequence, short_name
from edvo.frame import Frame
from edvo.synthesis.relight_models import find_models
from edvo.synthesis.relighting import DEFAULT_MODEL, DEFAULT_SEVERITY

SAID_HALF_PERIOD_S = 1.0  # caption of Fig. 11
_ACROSS = 6
_SAME_PHASE = 0.07  # of a period: what a frame at 30 Hz is off by 2 Hz
_SEARCHED_HZ = np.arange(0.25, 6.01, 0.05)
_EDGES_OF = 12  # frames of each sequence
_THUMB = 2  # every second pixel is shown


@dataclass(frozen=True)
class Look:
    """A sequence under the light, seen twice.

    Parameters
    ----------
    sequence : Sequence
        As it is.
    frames : tuple of Frame
        Two of it, relit.
    times : ndarray, shape (N,)
        Of all frames, seconds from the first.
    before, after : ndarray, shape (N,)
        Mean grey of all frames, as they are and relit.
    chosen : tuple of int
        Which two.
    edges : float
        Share of pixels that are edges, as it is.
    """

    sequence: Sequence
    frames: tuple[Frame, Frame]
    times: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    chosen: tuple[int, int]
    edges: float


def run(bench: Bench) -> Outcome:
    """Show all sequences, and how their light changes.

    Parameters
    ----------
    bench : Bench
        Gives the sequences.

    Returns
    -------
    Outcome
        A contact sheet, mean brightness over time, a table of both.
    """
    looks = []
    for sequence in bench.sequences():
        bench.advance(sequence.name)
        looks.append(look(sequence, LIGHT_SEED + bench.seed))
    frequency = light_frequency()
    return Outcome(
        "fig11",
        EXPERIMENT.title,
        [_table(looks)],
        [_sheet(looks), _brightness(looks)],
        [_textured(looks), _frequency(looks, frequency), _half_period(frequency)],
        (
            f"Light: {DEFAULT_MODEL}, severity {DEFAULT_SEVERITY}, {frequency:g} Hz, jumps by seed "
            f"{LIGHT_SEED + bench.seed}, as in Table III. The two images of a sequence are as near "
            "to half a period apart as its frames allow, the first one at the brightest instant "
            "of the swing.",
        ),
    )


def light_frequency() -> float:
    """Give the frequency of the paper's light as it is relit here.

    Returns
    -------
    float
        Hz; 2 by section V-A.
    """
    return find_models(DEFAULT_MODEL)[0].frequency


def look(sequence: Sequence, seed: int) -> Look:
    """Relight a sequence and choose two of its frames.

    Parameters
    ----------
    sequence : Sequence
        As it is.
    seed : int
        Of the light.

    Returns
    -------
    Look
        What is shown of it.
    """
    plain = sequence.frames
    relit = sequence.relit(seed=seed).frames
    times = np.array([frame.timestamp for frame in plain])
    times -= times[0]
    chosen = half_a_period_apart(times, 1 / light_frequency())
    config = Config.preset("paper").edges
    some = plain[:: max(1, len(plain) // _EDGES_OF)]
    return Look(
        sequence,
        (relit[chosen[0]], relit[chosen[1]]),
        times,
        np.array([frame.grey.mean() for frame in plain]),
        np.array([frame.grey.mean() for frame in relit]),
        chosen,
        fmean(len(extract_edges(frame.grey, config)) / frame.grey.size for frame in some),
    )


def half_a_period_apart(times: NDArray[np.float64], period: float) -> tuple[int, int]:
    """Choose two frames at opposite swings of the light.

    Parameters
    ----------
    times : ndarray, shape (N,)
        Seconds from the first frame, rising.
    period : float
        Of the light, seconds.

    Returns
    -------
    (int, int)
        The first one at a quarter of a period and the second one at three quarters, of the same
        period where there are such frames; two neighbours where there are none, and both 0 where
        there is one frame only.
    """
    phase = (times / period) % 1.0
    first = _earliest(np.abs(phase - 0.25))
    if first + 1 >= len(times):
        return max(0, first - 1), first
    return first, first + 1 + _earliest(np.abs(phase[first + 1 :] - 0.75))


def _earliest(off: NDArray[np.float64]) -> int:
    """Give the first of those that are about as good as the best."""
    return int(np.flatnonzero(off <= off.min() + _SAME_PHASE)[0])


def dominant_frequency(times: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Find the frequency of the sine that explains most of some values.

    Parameters
    ----------
    times : ndarray, shape (N,)
        Seconds.
    values : ndarray, shape (N,)
        At these times, which need not be regular.

    Returns
    -------
    float
        Hz, between 0.25 and 6.
    """
    left = []
    for frequency in _SEARCHED_HZ:
        angle = 2 * np.pi * frequency * times
        design = np.stack([np.cos(angle), np.sin(angle), np.ones_like(times)], axis=1)
        solution = np.linalg.lstsq(design, values, rcond=None)[0]
        left.append(float(np.sum((values - design @ solution) ** 2)))
    return float(_SEARCHED_HZ[int(np.argmin(left))])


def _table(looks: list[Look]) -> Table:
    rows = []
    records: list[dict[str, Value]] = []
    for seen in looks:
        i, j = seen.chosen
        rows.append(
            (
                short_name(seen.sequence.name),
                seen.sequence.label,
                f"{seen.edges:.1%}",
                f"{seen.times[i]:.3f}",
                f"{seen.after[i]:.0f} ({seen.before[i]:.0f})",
                f"{seen.times[j]:.3f}",
                f"{seen.after[j]:.0f} ({seen.before[j]:.0f})",
                f"{seen.after.min():.0f} to {seen.after.max():.0f}",
                f"{seen.before.min():.0f} to {seen.before.max():.0f}",
            )
        )
        records.append(
            {
                "sequence": seen.sequence.name,
                "data": seen.sequence.label,
                "edges_share": round(seen.edges, 5),
                "first_s": round(float(seen.times[i]), 6),
                "first_mean_grey": round(float(seen.after[i]), 3),
                "first_mean_grey_constant_light": round(float(seen.before[i]), 3),
                "second_s": round(float(seen.times[j]), 6),
                "second_mean_grey": round(float(seen.after[j]), 3),
                "second_mean_grey_constant_light": round(float(seen.before[j]), 3),
                "least_mean_grey": round(float(seen.after.min()), 3),
                "largest_mean_grey": round(float(seen.after.max()), 3),
            }
        )
    header = (
        "sequence",
        "data",
        "edges",
        "first, s",
        "mean grey (constant light)",
        "second, s",
        "mean grey (constant light)",
        "mean grey over all",
        "constant light",
    )
    return Table("sequences", "Sequences and their mean brightness", header, rows, records)


def _sheet(looks: list[Look]) -> Figure:
    across = min(_ACROSS, len(looks))
    blocks = -(-len(looks) // across)
    figure = new_figure(2.4 * across, 4.3 * blocks)
    grid = figure.subplots(2 * blocks, across, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for number, seen in enumerate(looks):
        block, column = divmod(number, across)
        for row, (frame, index) in enumerate(zip(seen.frames, seen.chosen, strict=True)):
            axes = grid[2 * block + row, column]
            axes.imshow(frame.grey[::_THUMB, ::_THUMB], cmap="gray", vmin=0, vmax=255)
            told = f"{seen.times[index]:.2f} s, mean {seen.after[index]:.0f}"
            if row == 0:
                letter = f"({chr(ord('a') + number)}) " if number < len(PAPER_SEQUENCES) else ""
                kind = "real" if seen.sequence.is_real else "synthetic"
                told = f"{letter}{short_name(seen.sequence.name)}\n{kind}; {told}"
            axes.set_title(told, fontsize=8)
    caption = (
        "Sequences used, relit, two images each half a period of the light apart, with their "
        "mean grey value; (a)-(c) with texture, (d)-(f) with little, as in the paper's Fig. 11."
    )
    return Figure("contact_sheet", caption, to_png(figure))


def _brightness(looks: list[Look]) -> Figure:
    across = min(3, len(looks))
    rows = -(-len(looks) // across)
    figure = new_figure(4.2 * across, 2.3 * rows)
    grid = figure.subplots(rows, across, squeeze=False)
    for axes in grid.flat[len(looks) :]:
        axes.set_axis_off()
    for axes, seen in zip(grid.flat, looks, strict=False):
        axes.plot(seen.times, seen.before, color="0.6", label="constant light")
        axes.plot(seen.times, seen.after, color="#d1495b", label="changing light")
        chosen = list(seen.chosen)
        axes.plot(seen.times[chosen], seen.after[chosen], "o", color="k", ms=4, label="shown")
        axes.set_title(short_name(seen.sequence.name), fontsize=9)
        axes.set_ylim(0, 255)
        tidy(axes)
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    grid[0, 0].set_ylabel("mean grey")
    grid[0, 0].legend(frameon=False, fontsize=7)
    return Figure("brightness", "Mean grey value over time.", to_png(figure))


def _textured(looks: list[Look]) -> Finding:
    of = {seen.sequence.name: seen for seen in looks}
    rich = [of[name] for name in TEXTURED if name in of]
    plain = [of[name] for name in PAPER_SEQUENCES if name in of and name not in TEXTURED]
    claim = "(a)-(c) have abundant texture and (d)-(f) little"
    if not rich or not plain:
        return Finding(claim, None, "Only one of both kinds was shown.")
    parts = [f"{short_name(seen.sequence.name)} {seen.edges:.1%}" for seen in (*rich, *plain)]
    return Finding(
        claim,
        min(seen.edges for seen in rich) > max(seen.edges for seen in plain),
        f"Share of pixels that are edges (Canny of the preset paper): {', '.join(parts)}.",
    )


def _frequency(looks: list[Look], frequency: float) -> Finding:
    found, resolution = [], 0.0
    for seen in looks:
        interval = float(np.median(np.diff(seen.times))) if len(seen.times) > 1 else np.inf
        # Too few images a period, or too short for one, say nothing of it.
        if frequency * interval < 0.25 and seen.times[-1] * frequency >= 2:
            ratio = np.log(np.maximum(seen.after, 1) / np.maximum(seen.before, 1))
            found.append(dominant_frequency(seen.times, ratio))
            resolution = max(resolution, 1 / float(seen.times[-1]))
    claim = "The light varies at 2 Hz"
    if not found:
        return Finding(claim, None, "No sequence is long and fast enough to see it.")
    off = max(abs(value - 2.0) for value in found)
    return Finding(
        claim,
        off <= resolution,
        f"The sine that explains most of the brightness, relit over not, has "
        f"{min(found):.2f} to {max(found):.2f} Hz (told apart to {resolution:.2f} Hz).",
    )


def _half_period(frequency: float) -> Finding:
    half = 0.5 / frequency
    agrees = abs(half - SAID_HALF_PERIOD_S) < 0.01
    said = (
        f"At the {frequency:g} Hz of section V-A, which is used here, half a period is {half:g} s"
    )
    if not agrees:
        said += f"; one second would be half a period at {0.5 / SAID_HALF_PERIOD_S:g} Hz"
    claim = "Images one second apart are half a period of the light apart"
    return Finding(claim, agrees, f"{said}.")


EXPERIMENT = Experiment(
    "fig11",
    "The sequences, half a period of the light apart",
    "Representative images of the six relit sequences, two each, one second apart, which it "
    "calls half a period of the light.",
    run,
)
