"""Errors and speed as lines for people."""

from collections.abc import Mapping
from math import degrees

import numpy as np

from edvo.cli.terminal import table
from edvo.evaluation import AbsoluteTrajectoryError, Evaluation, RelativePoseError
from edvo.report.tracking import Run

_NONE = "-"


def score_table(
    evaluations: Mapping[str, Evaluation], runs: Mapping[str, Run] | None = None
) -> str:
    """Lay out errors, a row an estimate, and below each the errors of standing still.

    The relative pose error is the benchmark script's; beside it stands that of Sturm's formula.
    With the runs that gave the estimates, all on the same frames, the time that each took a frame
    is another column, and one row of standing still serves for all.
    """
    some = next((e.rpe for e in evaluations.values() if e.rpe is not None), None)
    unit = "m/s" if some is None or some.delta == 1.0 else f"m/{some.delta:g}s"
    angle = unit.replace("m", "deg", 1)
    header = [
        "",
        f"RPE rmse {unit}",
        "median",
        "Sturm's",
        f"rotation {angle}",
        "ATE rmse m",
        "coverage",
    ]
    if runs is not None:
        header.append("ms a frame")
    rows: list[list[str]] = []
    for name, evaluation in evaluations.items():
        rows.append(
            [
                name,
                *_relative(evaluation.rpe, evaluation.rpe_sturm),
                _absolute(evaluation.ate),
                _coverage(evaluation),
            ]
        )
        if runs is None:
            rows.append(["  zero motion", *_standing_still(evaluation)])
        else:
            rows[-1].append(_track_ms(runs[name]))
    if runs is not None:
        first = next(iter(evaluations.values()))
        rows.append(["zero motion", *_standing_still(first), ""])
    return table(header, rows)


def speed_line(run: Run) -> str:
    """Say how fast a run was."""
    line = f"{len(run.frames)} frames in {run.wall_s:.1f} s"
    if run.track_times.size:
        median = float(np.median(run.track_times))
        line += f", of which tracking {1e3 * median:.2f} ms a frame ({1 / median:.0f} frames/s)"
    return line


def _standing_still(evaluation: Evaluation) -> list[str]:
    relative = _relative(evaluation.rpe_zero_motion, None)
    return [*relative, _absolute(evaluation.ate_zero_motion), ""]


def _track_ms(run: Run) -> str:
    return f"{1e3 * float(np.median(run.track_times)):.1f}" if run.track_times.size else _NONE


def _relative(error: RelativePoseError | None, sturm: RelativePoseError | None) -> list[str]:
    other = _NONE if sturm is None else f"{sturm.rmse:.4f}"
    if error is None:
        return [_NONE, _NONE, other, _NONE]
    return [
        f"{error.rmse:.4f}",
        f"{error.median:.4f}",
        other,
        f"{degrees(error.rotation_rmse):.3f}",
    ]


def _absolute(error: AbsoluteTrajectoryError | None) -> str:
    return _NONE if error is None else f"{error.rmse:.4f}"


def _coverage(evaluation: Evaluation) -> str:
    if evaluation.coverage is None:
        return f"{evaluation.span_coverage:.1%} of truth"
    return f"{evaluation.coverage:.1%}"
