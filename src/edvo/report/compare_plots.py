"""Pictures of a comparison: every path from above, and every error over time."""

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from edvo import se3
from edvo.experiments.drawing import new_figure, tidy, to_png
from edvo.report.compare import Comparison, Row, Score
from edvo.report.plots import ESTIMATE_COLOUR, MOTION_COLOUR, TRUTH_COLOUR
from edvo.trajectory import Trajectory

# Those of edvo first, then ones that are told apart by any eye (Okabe and Ito).
_COLOURS = (ESTIMATE_COLOUR, MOTION_COLOUR)
_OTHERS = ("#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#9467bd", "#8c564b", "#7f7f7f")
_LINES = ("-", "--", ":")
_MOST = 16  # beyond that many no line is found again; the first ones by error are drawn
_OUT_OF_VIEW = 2.0  # spans of the true path beyond which an estimate is not followed


def draw_paths(comparison: Comparison) -> bytes | None:
    """Draw the paths of all systems from above, right across and forward up.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    bytes or None
        PNG; None if nobody has a path. Each path is aligned with the truth as for the absolute
        error; without truth all begin alike. What leaves the picture by far is cut off.
    """
    shown = [(row, score) for row, score in _shown(comparison) if len(score.trajectory)]
    if not shown:
        return None
    figure = new_figure(9.0, 7.0)
    axes = figure.subplots()
    T_view_ref, true = _truth(comparison, shown)
    if true is not None:
        axes.plot(true[:, 0], true[:, 2], color=TRUTH_COLOUR, lw=4.0, alpha=0.3, label="truth")
    paths = [_aligned(T_view_ref, score) for _, score in shown]
    low, high = _bounds(paths if true is None else [true])
    for (row, _), path, (colour, line) in zip(shown, paths, _styles(shown), strict=True):
        seen = np.where(((path > low) & (path < high)).all(axis=1, keepdims=True), path, np.nan)
        axes.plot(seen[:, 0], seen[:, 2], color=colour, ls=line, label=_label(row), **_weight(row))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("right (m)")
    axes.set_ylabel("forward (m)")
    axes.set_title(f"{comparison.name}: paths from above")
    _legend(axes)
    return to_png(figure)


def draw_errors(comparison: Comparison) -> bytes | None:
    """Draw the relative pose error of all systems over time.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    bytes or None
        PNG; None if nobody has such an error. The scale is logarithmic, for the best and those
        that fail to be seen in one picture.
    """
    shown = [
        (row, score)
        for row, score in _shown(comparison)
        if score.evaluation is not None and score.evaluation.rpe is not None
    ]
    if not shown:
        return None
    figure = new_figure(11.0, 6.0)
    axes = figure.subplots()
    begin = min(
        score.evaluation.rpe.stamps[0]
        for _, score in shown
        if score.evaluation is not None and score.evaluation.rpe is not None
    )
    still = comparison.rows[-1].score
    if still is not None and still.evaluation is not None and still.evaluation.rpe is not None:
        rpe = still.evaluation.rpe
        axes.plot(
            rpe.stamps - begin,
            1e3 * rpe.translation,
            color=TRUTH_COLOUR,
            lw=3.0,
            alpha=0.3,
            label="zero motion",
        )
    for (row, score), (colour, line) in zip(shown, _styles(shown), strict=True):
        assert score.evaluation is not None
        assert score.evaluation.rpe is not None
        rpe = score.evaluation.rpe
        label = f"{_label(row)}: rmse {1e3 * rpe.rmse:.1f} mm"
        error = 1e3 * rpe.translation
        axes.plot(rpe.stamps - begin, error, color=colour, ls=line, label=label, **_weight(row))
    axes.set_yscale("log")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("error of the motion over 1 s (mm)")
    axes.set_title(f"{comparison.name}: error over time")
    _legend(axes)
    return to_png(figure)


def _shown(comparison: Comparison) -> list[tuple[Row, Score]]:
    """Rows with a run, edvo's first, not more than can be told apart."""
    there = [row for row in comparison.rows if row.kind != "reference"]
    if len(there) > _MOST:
        order = sorted(there, key=lambda row: math.inf if math.isnan(row.rpe) else row.rpe)
        kept = {row.name for row in order[:_MOST]} | {r.name for r in there if r.kind == "edvo"}
        there = [row for row in there if row.name in kept]
    there.sort(key=lambda row: row.kind != "edvo")
    return [(row, row.score) for row in there if row.score is not None]


def _styles(shown: Sequence[tuple[Row, Score]]) -> list[tuple[str, str]]:
    """Choose a colour and a kind of line for each; the colours of edvo are its own."""
    own = iter(_COLOURS)
    others = cycle((colour, line) for line in _LINES for colour in _OTHERS)
    return [
        (next(own, TRUTH_COLOUR), "-") if row.kind == "edvo" else next(others) for row, _ in shown
    ]


def _weight(row: Row) -> dict[str, Any]:
    """Draw edvo above the others."""
    return {"lw": 2.2, "zorder": 3} if row.kind == "edvo" else {"lw": 1.2}


def _label(row: Row) -> str:
    return f"{row.name} (failed)" if row.failure else row.name


def _truth(
    comparison: Comparison, shown: Sequence[tuple[Row, Score]]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Give the view, from the first true camera, and the true positions in it."""
    if comparison.truth is None or not len(comparison.truth):
        return np.eye(4), None
    still = comparison.rows[-1].score
    times = shown[0][1].trajectory.timestamps if still is None else still.trajectory.timestamps
    truth = comparison.truth.between(times[0], times[-1])
    if not len(truth):
        truth = comparison.truth
    T_view_ref = se3.inverse(truth.poses[0])
    return T_view_ref, _positions(T_view_ref, truth)


def _aligned(T_view_ref: NDArray[np.float64], score: Score) -> NDArray[np.float64]:
    trajectory = score.trajectory
    if score.evaluation is not None and score.evaluation.ate is not None:
        return _positions(T_view_ref @ score.evaluation.ate.T_ref_est, trajectory)
    return _positions(se3.inverse(trajectory.poses[0]), trajectory)


def _positions(T_view_world: NDArray[np.float64], trajectory: Trajectory) -> NDArray[np.float64]:
    points: NDArray[np.float64] = (
        trajectory.poses[:, :3, 3] @ T_view_world[:3, :3].T + T_view_world[:3, 3]
    )
    return points


def _bounds(
    paths: Sequence[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give the corners of the space in which a path is drawn."""
    points = np.concatenate(paths)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _OUT_OF_VIEW * max(float((high - low).max()), 0.05)
    return low - margin, high + margin


def _legend(axes: Axes) -> None:
    tidy(axes)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
