"""Pictures of a run over time: status, what the registration says of itself, times, errors."""

from collections.abc import Callable, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from edvo.evaluation import Evaluation
from edvo.experiments.drawing import new_figure, tidy, to_png
from edvo.odometry import Status
from edvo.report.plots import ESTIMATE_COLOUR, MOTION_COLOUR, TRUTH_COLOUR, draw_errors
from edvo.report.tracking import FrameRecord, Run

STATUS_COLOURS = {Status.TRACKED: "#2a9d8f", Status.DEGRADED: "#f4a261", Status.LOST: "#d1495b"}
# For as many stages as there may be
STAGE_COLOURS = [
    "#00798c",
    "#edae49",
    "#66a182",
    "#d1495b",
    "#8d6a9f",
    "#2e4057",
    "#a0a0a0",
    "#6ec1e4",
    "#8c5a3c",
    "#e0a3c0",
    "#b5bd4c",
]

_MOST_COLUMNS = 800  # about what the picture has; a long run has more frames
_RANKS = list(STATUS_COLOURS)

Reduction = Callable[[NDArray[np.float64]], float]


def draw_timeline(run: Run) -> bytes:
    """Draw status, share of samples that fit, scale of residuals and number of edges over time.

    Parameters
    ----------
    run : Run
        At least one frame.

    Returns
    -------
    bytes
        PNG. Where several frames share a column the worst of them is drawn, beside the median.
    """
    frames = run.frames
    times = _times(frames, frames[0].timestamp)
    figure = new_figure(11.0, 6.2)
    strip, fit, sigma, edges = figure.subplots(4, 1, sharex=True, height_ratios=(0.5, 2, 2, 2))
    _draw_status(strip, frames, times)
    share = [
        r.registration.inliers / r.samples if r.registration is not None and r.samples else np.nan
        for r in frames
    ]
    scale = [
        r.registration.sigma_px if r.registration is not None and r.registration.matches else np.nan
        for r in frames
    ]
    _draw_curve(fit, times, 100 * np.array(share), "samples that fit (%)", worst=np.min)
    fit.set_ylim(0, 105)
    _draw_curve(sigma, times, np.array(scale), "sigma (px)", worst=np.max)
    sigma.set_ylim(bottom=0)
    counts = np.array([np.nan if r.track_s is None else r.edges for r in frames])
    _draw_curve(edges, times, counts, "edge pixels", worst=np.min)
    edges.set_ylim(bottom=0)
    edges.set_xlabel("time (s)")
    return to_png(figure)


def draw_stages(run: Run) -> bytes | None:
    """Draw what each stage of the track call takes, and the whole call over time.

    Parameters
    ----------
    run : Run
        What was tracked.

    Returns
    -------
    bytes or None
        PNG; None if no frame was tracked.
    """
    frames = [record for record in run.frames if record.track_s is not None]
    if not frames:
        return None
    figure = new_figure(11.0, 3.6)
    bars, curve = figure.subplots(1, 2, width_ratios=(1, 1.6))
    left = 0.0
    for (stage, mean), colour in zip(
        mean_stages(frames).items(), cycle(STAGE_COLOURS), strict=False
    ):
        bars.barh(0, mean, left=left, color=colour, label=f"{stage}: {mean:.2f} ms")
        left += mean
    bars.set_ylim(-0.45, 1.6)
    bars.set_yticks([])
    bars.set_xlabel("mean time of a frame (ms)")
    bars.legend(loc="upper left", frameon=False, fontsize=9, ncols=2)
    bars.set_title("stages")
    tidy(bars)
    whole = 1e3 * np.array([r.track_s for r in frames])
    _draw_curve(curve, _times(frames, run.frames[0].timestamp), whole, "ms", worst=np.max)
    # The first frame of a process, or a pause of the machine, would flatten all the others.
    curve.set_ylim(0, 1.3 * float(np.percentile(whole, 99)))
    curve.set_xlabel("time (s)")
    curve.set_title("the track call")
    return to_png(figure)


def draw_error_curves(evaluation: Evaluation) -> bytes:
    """Draw the errors over time.

    Parameters
    ----------
    evaluation : Evaluation
        Of a run with truth.

    Returns
    -------
    bytes
        PNG.
    """
    figure = new_figure(11.0, 4.0)
    draw_errors(figure.subplots(), evaluation)
    return to_png(figure)


def draw_planes(
    estimate: NDArray[np.float64], truth: NDArray[np.float64], keyframes: NDArray[np.float64]
) -> bytes:
    """Draw a path from above and from the side.

    Parameters
    ----------
    estimate, truth, keyframes : ndarray, shape (N, 3), (M, 3), (K, 3)
        Places in the axes of the first camera, metres; NaN where a line is broken, M and K may
        be 0.

    Returns
    -------
    bytes
        PNG.
    """
    figure = new_figure(11.0, 4.8)
    for axes, up, title in zip(
        figure.subplots(1, 2), (2, 1), ("from above", "from behind"), strict=True
    ):
        if len(truth):
            axes.plot(
                truth[:, 0], truth[:, up], color=TRUTH_COLOUR, lw=3, alpha=0.35, label="truth"
            )
        axes.plot(estimate[:, 0], estimate[:, up], color=ESTIMATE_COLOUR, lw=1.4, label="edvo")
        axes.plot(
            keyframes[:, 0], keyframes[:, up], ".", color=MOTION_COLOUR, ms=4, label="keyframes"
        )
        axes.plot(*estimate[0, [0, up]], "o", color=ESTIMATE_COLOUR, ms=7, label="start")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("right (m)")
        axes.set_ylabel("forward (m)" if up == 2 else "down (m)")
        if up == 1:
            axes.invert_yaxis()
        axes.set_title(title)
        axes.legend(loc="best", frameon=False, fontsize=9)
        tidy(axes)
    return to_png(figure)


def mean_stages(frames: Sequence[FrameRecord]) -> dict[str, float]:
    """Average the time of each stage over frames, those that did not need it too.

    Parameters
    ----------
    frames : sequence of FrameRecord
        At least one; all were tracked.

    Returns
    -------
    dict of str to float
        Milliseconds a frame; ``other`` is the rest of the track call.
    """
    names = list(dict.fromkeys(stage for record in frames for stage in record.stages))
    means = {
        name: 1e3 * sum(record.stages.get(name, 0.0) for record in frames) / len(frames)
        for name in names
    }
    whole = 1e3 * sum(record.track_s or 0.0 for record in frames) / len(frames)
    return {**means, "other": max(0.0, whole - sum(means.values()))}


def _draw_status(axes: Axes, frames: Sequence[FrameRecord], times: NDArray[np.float64]) -> None:
    ranks = np.array([_RANKS.index(record.status) for record in frames], float)
    centres, _, worst = _grouped(times, ranks, np.max)
    # A column reaches half-way to its neighbours.
    reach = float(np.median(np.diff(centres))) if len(centres) > 1 else 1.0
    middles = 0.5 * (centres[1:] + centres[:-1])
    bounds = np.concatenate([[centres[0] - reach / 2], middles, [centres[-1] + reach / 2]])
    colours = ListedColormap(list(STATUS_COLOURS.values()))
    axes.pcolormesh(bounds, [0.0, 1.0], worst[None], cmap=colours, vmin=-0.5, vmax=2.5)
    if len(frames) <= _MOST_COLUMNS:
        keyed = [t for r, t in zip(frames, times.tolist(), strict=True) if r.is_keyframe]
        axes.vlines(keyed, 0.0, 0.35, color="white", lw=0.8)
    axes.set_yticks([])
    for status, colour in STATUS_COLOURS.items():
        count = sum(record.status is status for record in frames)
        axes.plot([], [], "s", color=colour, label=f"{status.value}: {count}")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3, frameon=False, fontsize=9)


def _draw_curve(
    axes: Axes,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    label: str,
    *,
    worst: Reduction,
) -> None:
    centres, medians, extremes = _grouped(times, values, worst)
    if len(values) > _MOST_COLUMNS:
        axes.plot(centres, extremes, color=ESTIMATE_COLOUR, lw=0.8, alpha=0.6)
    axes.plot(centres, medians, color=MOTION_COLOUR, lw=1.2)
    axes.set_ylabel(label, fontsize=9)
    axes.margins(x=0)
    tidy(axes)


def _grouped(
    times: NDArray[np.float64], values: NDArray[np.float64], worst: Reduction
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean time, median and worst value of frames that share a column; of few frames, each one."""
    size = -(-len(values) // _MOST_COLUMNS)
    groups = [slice(begin, begin + size) for begin in range(0, len(values), size)]
    centres = np.array([times[group].mean() for group in groups])
    known = [values[group][np.isfinite(values[group])] for group in groups]
    medians = np.array([np.median(group) if len(group) else np.nan for group in known])
    extremes = np.array([worst(group) if len(group) else np.nan for group in known])
    return centres, medians, extremes


def _times(frames: Sequence[FrameRecord], begin: float) -> NDArray[np.float64]:
    """Seconds since the beginning."""
    return np.array([record.timestamp for record in frames]) - begin
