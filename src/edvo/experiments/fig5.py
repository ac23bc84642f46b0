"""Fig. 5: gradients stand almost at right angles to the edges that they lie on."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.config import Config
from edvo.edges import EdgeImage, extract_edges
from edvo.experiments.bench import Bench
from edvo.experiments.directions import angles_between, draw_edges, edge_normals, raw_edges
from edvo.experiments.drawing import PUBLISHED_COLOUR, ROBUST_COLOUR, new_figure, tidy, to_png
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table, Value
from edvo.experiments.selection import spread, texture_and_none
from edvo.experiments.sequences import Sequence
from edvo.frame import Frame

NEAR_DEG = (10.0, 20.0)
ENOUGH = 0.9  # of the edges within the larger angle, for the claim to hold

HOW = """The geometric normal of an edge pixel is that of a line fitted to the edge pixels
connected with it in a window of 9 x 9, without any use of gradients; where fewer than 5 are, or
where they lie more than 0.5 px (rms) off the line, as at corners and junctions, there is none.
The angle is that between two lines, at most 90 degrees. The fit on a pixel grid is good to some 3
degrees itself. Gradients that had nothing to do with the edges would be within 10 degrees in 11 %
and within 20 in 22 % of all cases."""


@dataclass(frozen=True, eq=False)
class Angles:
    """Angles between gradients and normals in one sequence.

    Parameters
    ----------
    values : ndarray of float64, shape (K,)
        Degrees, of the edge pixels that have a normal.
    edges : int
        All edge pixels.
    """

    values: NDArray[np.float64]
    edges: int

    @property
    def shares(self) -> tuple[float, ...]:
        """Share within each of `NEAR_DEG`; NaN without any."""
        if not len(self.values):
            return (float("nan"),) * len(NEAR_DEG)
        return tuple(float(np.mean(self.values <= near)) for near in NEAR_DEG)


def run(bench: Bench) -> Outcome:
    """Make the figure again.

    Parameters
    ----------
    bench : Bench
        Gives all sequences.

    Returns
    -------
    Outcome
        Edges in colours, and histograms of the angles.
    """
    found: dict[str, Angles] = {}
    chosen = bench.sequences()
    for sequence in chosen:
        bench.advance(f"gradients and normals on {sequence.name}")
        found[sequence.name] = measure(spread(sequence.frames, bench.count(40, 8)))
    shown = texture_and_none(bench)[::-1]
    return Outcome(
        EXPERIMENT.name,
        EXPERIMENT.title,
        [make_table(found)],
        [draw(shown, found)],
        [judge(found)],
        (" ".join(HOW.split()), *(f"{s.name}: {s.label}" for s in chosen)),
    )


def measure(frames: Iterable[Frame]) -> Angles:
    """Compare gradients and normals.

    Parameters
    ----------
    frames : iterable of Frame
        Some of a sequence.

    Returns
    -------
    Angles
        Of all these frames.
    """
    values, count = [np.empty(0)], 0
    for frame in frames:
        edges = _edges(frame)
        gradients = raw_edges(edges)[1]
        values.append(angles_between(gradients, edge_normals(edges), signed=False))
        count += len(edges)
    return Angles(np.concatenate(values), count)


def _edges(frame: Frame) -> EdgeImage:
    return extract_edges(frame.grey, Config.preset("paper").edges)


def make_table(found: dict[str, Angles]) -> Table:
    """Write how far gradients and normals differ.

    Parameters
    ----------
    found : dict of str to Angles
        By sequence.

    Returns
    -------
    Table
        A row for each sequence.
    """
    rows, records = [], []
    for name, angles in found.items():
        have = len(angles.values) / angles.edges if angles.edges else float("nan")
        middle = float(np.median(angles.values)) if len(angles.values) else float("nan")
        rows.append(
            (
                name,
                str(angles.edges),
                f"{have:.0%}",
                f"{middle:.1f}",
                *(f"{share:.1%}" for share in angles.shares),
            )
        )
        record: dict[str, Value] = {
            "sequence": name,
            "edges": angles.edges,
            "with_normal_share": have,
            "median_angle_deg": middle,
        }
        for limit, share in zip(NEAR_DEG, angles.shares, strict=True):
            record[f"within_{limit:g}_deg"] = share
        records.append(record)
    return Table(
        "fig5",
        "Angle between the gradient and the edge's geometric normal",
        (
            "sequence",
            "edge pixels",
            "with a normal",
            "median angle (°)",
            *(f"within {limit:g}°" for limit in NEAR_DEG),
        ),
        rows,
        records,
    )


def draw(shown: list[Sequence], found: dict[str, Angles]) -> Figure:
    """Draw edges of some sequences, and the histograms of their angles.

    Parameters
    ----------
    shown : list of Sequence
        Which.
    found : dict of str to Angles
        By sequence.

    Returns
    -------
    Figure
        In the form of the paper's Fig. 5, with the angles below.
    """
    figure = new_figure(5.6 * len(shown), 7.0)
    panels = figure.subplots(2, len(shown), squeeze=False, height_ratios=(1.5, 1.0))
    for sequence, (top, bottom) in zip(shown, panels.T, strict=True):
        frame = sequence.frames[len(sequence.frames) // 2]
        draw_edges(top, frame.grey, _edges(frame))
        top.set_title(f"{sequence.name}\n{sequence.label}", fontsize=10)
        angles = found[sequence.name]
        weights = np.full(len(angles.values), 100 / max(1, len(angles.values)))
        bottom.hist(angles.values, np.arange(0, 91, 2), weights=weights, color=ROBUST_COLOUR)
        bottom.axhline(100 * 2 / 90, color=PUBLISHED_COLOUR, ls=":", label="directions at random")
        bottom.set_xlabel("angle between gradient and normal of the edge (°)")
        bottom.set_ylabel("edge pixels (%)")
        bottom.legend(frameon=False, fontsize=8)
        tidy(bottom)
    return Figure(
        "fig5",
        "Above: edges in the colours of their gradient directions (key in the corner). Below: the "
        "angle between the gradient and the normal of a line fitted to the edge.",
        to_png(figure),
    )


def judge(found: dict[str, Angles]) -> Finding:
    """Hold the paper's statement against all sequences.

    Parameters
    ----------
    found : dict of str to Angles
        By sequence.

    Returns
    -------
    Finding
        On whether gradients are normal to edges.
    """
    shares = {name: angles.shares for name, angles in found.items()}
    failing = [name for name, share in shares.items() if not share[1] >= ENOUGH]
    text = "; ".join(f"{name} {a:.0%} and {b:.0%}" for name, (a, b) in shares.items())
    verdict = "It holds on all"
    if failing:
        verdict = f"It holds on {len(shares) - len(failing)} of {len(shares)}, not on "
        verdict += ", ".join(failing)
    return Finding(
        "Image gradients are almost orthogonal to the streak of edge pixels.",
        not failing,
        f"Gradients within {NEAR_DEG[0]:g}° and {NEAR_DEG[1]:g}° of the normal: {text}. {verdict} "
        f"(at least {ENOUGH:.0%} within {NEAR_DEG[1]:g}° is asked for).",
    )


EXPERIMENT = Experiment(
    "fig5",
    "Gradient directions against the normals of edges",
    "Gradients drawn on edges of a low-textured and of a textured scene: they are almost "
    "orthogonal to the streaks of edge pixels (no numbers are given).",
    run,
)
"""Fig. 5."""
