"""Fig. 8: the share of edges matched correctly, as the camera moves along each of six axes."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from math import cos, degrees, radians, sin

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels, extract_edges
from edvo.evaluation.matching import MatchingSuccess, matching_success
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
from edvo.experiments.selection import spread, texture_and_none, videos
from edvo.experiments.sequences import Sequence
from edvo.experiments.warping import Warped, warp_frame
from edvo.frame import Frame
from edvo.matching import Criterion, EdgeIndex

AXES = ("x, right", "y, down", "z, forward", "pitch, about x", "yaw, about y", "roll, about z")
"""In the order of a twist [v, w]."""
ROLL = 5

TOLERANCES_PX = (1.0, 2.0, 4.0)
TOLERANCE_PX = 2.0  # of the plot and the findings
STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the furthest motion
STEPS_QUICK = (0.02, 0.15, 0.5, 1.0)
FURTHEST = (0.10, 0.10, 0.10, radians(5), radians(5), radians(5))  # metres, radians
LARGE = 0.35  # of the furthest; what counts as large
SMALL = 0.02  # what counts as near zero
SEVERAL = 2.0  # times
NOTHING = 0.01  # a rate at which neither criterion finds its way
METHODS = ("normal", "robust", "turned", "attainable")

HOW = f"""The original image is warped along one axis of the camera by its own depth, so that the
place that each new pixel shows is known exactly. Edges are extracted anew in the warped image and
matched to those of the original as at the start of a registration: without any knowledge of the
motion, and without the limit of 30 px that edvo sets. A match is correct within {TOLERANCE_PX:g}
px of the true place (the CSV has {TOLERANCES_PX[0]:g} and {TOLERANCES_PX[2]:g} px too). N_total
counts every edge of the warped image whose place lies in the original, but none within 5 px of a
hole in its depth, where the warp makes edges of its own. `attainable` is the share that has any
original edge within the tolerance: no criterion can do better. The CSV also has the share matched
to the right line but slid along it by up to 10 px (`line`), which serves Eq. (12) as well."""


@dataclass(frozen=True)
class Point:
    """Matches of one frame against itself, seen from elsewhere.

    Parameters
    ----------
    axis : int
        Position in `AXES`.
    share : float
        Motion over the furthest one, with its sign.
    shift_px : float
        Mean distance that the edges moved in the image; NaN where none is known.
    success : mapping of (str, float) to MatchingSuccess
        By method and tolerance.
    """

    axis: int
    share: float
    shift_px: float
    success: dict[tuple[str, float], MatchingSuccess]


def run(bench: Bench) -> Outcome:
    """Make the figure again.

    Parameters
    ----------
    bench : Bench
        Gives a textured and a plain sequence.

    Returns
    -------
    Outcome
        Success rates along each axis.
    """
    steps = bench.count(STEPS, STEPS_QUICK)
    shares = sorted({0.0, *steps, *(-step for step in steps)})
    tables, figures, findings, notes = [], [], [], [" ".join(HOW.split())]
    chosen = texture_and_none(bench)
    if not bench.quick:
        chosen += [sequence for sequence in videos(bench) if sequence not in chosen]
    for sequence in chosen:
        bench.advance(f"matching in warped images of {sequence.name}")
        frames = spread(sequence.frames, bench.count(3, 1))
        points = measure(sequence.camera, frames, shares)
        rates = {
            (axis, share): pooled(points, axis, share) for axis, share in product(range(6), shares)
        }
        tables.append(make_table(sequence, shares, rates))
        figures.append(draw(sequence, shares, rates))
        findings += judge(sequence, shares, rates)
        notes.append(
            f"{sequence.name}: {sequence.label}; frames warped: {len(frames)}. "
            + compare_turned(shares, rates)
        )
    return Outcome(EXPERIMENT.name, EXPERIMENT.title, tables, figures, findings, tuple(notes))


def measure(camera: Camera, frames: Iterable[Frame], shares: Iterable[float]) -> list[Point]:
    """Warp frames along each axis and match them with the originals.

    Parameters
    ----------
    camera : Camera
        Of the frames.
    frames : iterable of Frame
        The originals.
    shares : iterable of float
        Motions, over the furthest.

    Returns
    -------
    list of Point
        One for each frame, axis and motion; zero motion only once a frame, under the first axis.
    """
    config = Config.preset("paper")
    points = []
    for frame in frames:
        edges = extract_edges(frame.grey, config.edges)
        reference = EdgeIndex(edges.describe(camera))
        for axis, share in product(range(6), shares):
            if share == 0 and axis:
                continue
            twist = np.zeros(6)
            twist[axis] = share * FURTHEST[axis]
            warped = warp_frame(frame, camera, se3.inverse(se3.exp(twist)))
            roll = float(twist[ROLL])
            points.append(_match(camera, config, reference, warped, axis, share, roll))
    return points


def _match(
    camera: Camera,
    config: Config,
    reference: EdgeIndex,
    warped: Warped,
    axis: int,
    share: float,
    roll: float,
) -> Point:
    edges = extract_edges(warped.grey, config.edges)
    origin = warped.origin.reshape(-1, 2)[edges.index]
    known = np.flatnonzero(np.isfinite(origin[:, 0])).astype(np.int32)
    current = edges.describe(camera, known)
    true = camera.undistort(origin[known])
    robust = Criterion(config.matching.gamma, camera.width)
    normal = Criterion(0.0, camera.width)
    queries = {
        "normal": (current.pixels, current.gradients, normal),
        "robust": (current.pixels, current.gradients, robust),
        "turned": (current.pixels, turned(current.gradients, roll), robust),
        "attainable": (true.astype(np.float32), current.gradients, normal),
    }
    success = {}
    for method, query in queries.items():
        matches = reference.match(*query).indices
        for tolerance in TOLERANCES_PX:
            success[method, tolerance] = _success(reference.edges, matches, true, tolerance)
    shift = float(np.hypot(*(true - current.pixels).T).mean()) if len(true) else float("nan")
    return Point(axis, share, shift, success)


def _success(
    edges: EdgePixels, matches: NDArray[np.int32], true: NDArray[np.float64], tolerance: float
) -> MatchingSuccess:
    return matching_success(matches, edges.pixels, edges.gradients, true, tolerance_px=tolerance)


def turned(gradients: NDArray[np.float32], roll: float) -> NDArray[np.float32]:
    """Turn gradients of the current image as a known roll of the camera would.

    Parameters
    ----------
    gradients : ndarray of float32, shape (N, 2)
        Of the current image.
    roll : float
        Radians by which the camera has turned about its axis, from x towards y.

    Returns
    -------
    ndarray of float32, shape (N, 2)
        As they point in the reference image.
    """
    c, s = cos(roll), sin(roll)
    result: NDArray[np.float32] = gradients @ np.array([[c, s], [-s, c]], np.float32)
    return result


@dataclass(frozen=True)
class Rates:
    """Of all frames together, for one motion.

    Parameters
    ----------
    shift_px : float
        Mean distance that the edges moved.
    success : dict
        As in `Point`, summed over frames.
    """

    shift_px: float
    success: dict[tuple[str, float], MatchingSuccess]

    def __getitem__(self, method: str) -> float:
        """Success rate at the tolerance of the plot."""
        return self.success[method, TOLERANCE_PX].rate


def pooled(points: Iterable[Point], axis: int, share: float) -> Rates:
    """Put the frames of one motion together.

    Parameters
    ----------
    points : iterable of Point
        Of all frames.
    axis : int
        Which axis.
    share : float
        Motion over the furthest one.

    Returns
    -------
    Rates
        Each edge pixel counts the same.
    """
    chosen = [p for p in points if p.share == share and (share == 0 or p.axis == axis)]
    success = {}
    for key in product(METHODS, TOLERANCES_PX):
        parts = [point.success[key] for point in chosen]
        success[key] = MatchingSuccess(
            sum(part.total for part in parts),
            sum(part.correct for part in parts),
            sum(part.same_line for part in parts),
            key[1],
        )
    return Rates(float(np.nanmean([point.shift_px for point in chosen])), success)


def _motion(axis: int, share: float) -> str:
    value = share * FURTHEST[axis]
    return f"{value:+.3f} m" if axis < 3 else f"{degrees(value):+.2f}°"


def make_table(
    sequence: Sequence, shares: list[float], rates: dict[tuple[int, float], Rates]
) -> Table:
    """Write the success rates of a sequence.

    Parameters
    ----------
    sequence : Sequence
        Which.
    shares : list of float
        Motions over the furthest.
    rates : dict
        By axis and share.

    Returns
    -------
    Table
        A row for each motion, a column for each axis.
    """
    rows, records = [], []
    for share in shares:
        cells = [f"{_motion(0, share)}, {_motion(3, share)}"]
        for axis in range(6):
            found = rates[axis, share]
            cells.append(f"{found['normal']:.0%} / {found['robust']:.0%}")
            record: dict[str, Value] = {"sequence": sequence.name, "axis": AXES[axis]}
            amount = share * FURTHEST[axis]
            record["motion_m"] = amount if axis < 3 else None
            record["motion_deg"] = None if axis < 3 else degrees(amount)
            record["mean_shift_px"] = found.shift_px
            record["edges"] = found.success["normal", TOLERANCE_PX].total
            for (method, tolerance), success in found.success.items():
                record[f"{method}_{tolerance:g}px"] = success.rate
                record[f"{method}_{tolerance:g}px_line"] = success.line_rate
            records.append(record)
        rows.append(tuple(cells))
    return Table(
        f"fig8_{_file(sequence)}",
        f"Success rate (Eq. 15) on {sequence.name}, normal / robust criterion",
        ("motion", *AXES),
        rows,
        records,
    )


def draw(sequence: Sequence, shares: list[float], rates: dict[tuple[int, float], Rates]) -> Figure:
    """Draw the six curves of a sequence.

    Parameters
    ----------
    sequence : Sequence
        Which.
    shares : list of float
        Motions over the furthest.
    rates : dict
        By axis and share.

    Returns
    -------
    Figure
        In the form of the paper's Fig. 8.
    """
    figure = new_figure(12.0, 6.4)
    figure.suptitle(f"Matching success along six axes: {sequence.name} ({sequence.label})")
    panels = figure.subplots(2, 3, sharey=True)
    for axis, axes in enumerate(panels.flat):
        unit = 1.0 if axis < 3 else degrees(1.0)
        x = [share * FURTHEST[axis] * unit for share in shares]

        def curve(
            method: str,
            colour: str,
            style: str,
            label: str,
            axes: Axes = axes,
            x: list[float] = x,
            axis: int = axis,
        ) -> None:
            y = [100 * rates[axis, share][method] for share in shares]
            axes.plot(x, y, style, color=colour, lw=1.6, ms=3.5, label=label)

        curve("attainable", PUBLISHED_COLOUR, ":", "attainable")
        curve("normal", NORMAL_COLOUR, "o-", "normal criterion")
        if axis == ROLL:
            curve("turned", ROBUST_COLOUR, "--", "robust, gradients turned by the true roll")
        curve("robust", ROBUST_COLOUR, "o-", "robust criterion")
        axes.set_title(AXES[axis], fontsize=10)
        axes.set_xlabel("m" if axis < 3 else "degrees")
        axes.set_ylim(0, 105)
        tidy(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("matched correctly (%)")
    lines, labels = panels[1, 2].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=4, frameon=False)
    caption = (
        f"Share of edge pixels matched within {TOLERANCE_PX:g} px of their true place, against "
        "the motion between the images (Eq. 15)."
    )
    return Figure(f"fig8_{_file(sequence)}", caption, to_png(figure))


def judge(
    sequence: Sequence, shares: list[float], rates: dict[tuple[int, float], Rates]
) -> list[Finding]:
    """Hold the paper's two statements against the rates.

    Parameters
    ----------
    sequence : Sequence
        Which.
    shares : list of float
        Motions over the furthest.
    rates : dict
        By axis and share.

    Returns
    -------
    list of Finding
        On large motions and on those near zero.
    """
    return [_judge_large(sequence, shares, rates), _judge_small(sequence, shares, rates)]


def compare_turned(shares: list[float], rates: dict[tuple[int, float], Rates]) -> str:
    """Say what it would gain to turn the current gradients by the roll, if it were known.

    Parameters
    ----------
    shares : list of float
        Motions over the furthest.
    rates : dict
        By axis and share.

    Returns
    -------
    str
        A sentence. The paper compares gradients as they are (Eq. 6), though roll turns them.
    """
    end = max(shares)
    ends = [share for share in shares if abs(share) == end]
    plain, turned = (_mean(rates, method, [ROLL], ends) for method in ("robust", "turned"))
    return (
        f"With a roll of {degrees(end * FURTHEST[ROLL]):g}° the robust criterion matches "
        f"{plain:.1%}, and {turned:.1%} if the gradients are turned by it first, as they could be "
        "if it were known."
    )


def _judge_large(
    sequence: Sequence, shares: list[float], rates: dict[tuple[int, float], Rates]
) -> Finding:
    large = [share for share in shares if abs(share) >= LARGE]
    gains, lines, lost = [], [], []
    for axis in range(6):
        name = AXES[axis].split(",")[0]
        normal, robust = (_mean(rates, method, [axis], large) for method in ("normal", "robust"))
        if max(normal, robust) < NOTHING:
            lost.append(name)
            continue
        gains.append(robust / normal if normal else float("inf"))
        lines.append(f"{name} {normal:.1%} to {robust:.1%}, {gains[-1]:.1f} times")
    begin, end = (f"{share * 100 * FURTHEST[0]:g} cm or {share * 5:g}°" for share in (LARGE, 1.0))
    text = f"{sequence.name}, motions from {begin} to {end}: {'; '.join(lines)}. "
    if lost:
        text += f"Along {', '.join(lost)} both match less than {NOTHING:.0%}. "
    many = sum(gain >= SEVERAL for gain in gains)
    if not gains:
        text += "There is nothing to compare."
    elif many == len(gains):
        text += f"It is {SEVERAL:g} times as many or more on every axis."
    else:
        better = "all" if min(gains) > 1 else f"{sum(gain > 1 for gain in gains)}"
        text += (
            f"It is {SEVERAL:g} times as many or more on {many} axes of {len(gains)}, and more on "
            f"{better}."
        )
    return Finding(
        "With large motion the robust criterion matches several times as many pixels correctly, "
        "in all cases.",
        many == len(gains) if gains else None,
        text,
    )


def _judge_small(
    sequence: Sequence, shares: list[float], rates: dict[tuple[int, float], Rates]
) -> Finding:
    small = [share for share in shares if 0 < abs(share) <= SMALL]
    normal, robust = (_mean(rates, method, range(6), small) for method in ("normal", "robust"))
    if robust >= normal:
        verdict = "Here it is no worse"
    else:
        verdict = "So it is" if robust >= 0.9 * normal else "Here it is much worse"
    end = f"{SMALL * 1000 * FURTHEST[0]:g} mm or {SMALL * 5:g}°"
    return Finding(
        "Near zero motion the robust criterion is slightly worse than the normal one.",
        0.9 * normal <= robust < normal,
        f"{sequence.name}, motions up to {end}: {normal:.1%} by the normal criterion, "
        f"{robust:.1%} by the robust one. {verdict}.",
    )


def _mean(
    rates: dict[tuple[int, float], Rates], method: str, axes: Iterable[int], shares: list[float]
) -> float:
    return float(np.mean([rates[axis, share][method] for axis in axes for share in shares]))


def _file(sequence: Sequence) -> str:
    return sequence.name.replace("/", "_")


EXPERIMENT = Experiment(
    "fig8",
    "Matching success rate along six axes",
    "Success rates of both criteria along each axis of a warped image (no numbers are given): the "
    "robust criterion several times as high for large motion, slightly lower near zero.",
    run,
)
"""Fig. 8."""
