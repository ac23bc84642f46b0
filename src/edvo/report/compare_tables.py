"""A comparison as a table for people, as Markdown, CSV and JSON."""

import csv
import io
import json
import math
import os
import platform
from collections.abc import Sequence
from math import degrees
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from edvo import __version__
from edvo.report.compare import Comparison, Row, Score
from edvo.report.compare_rank import summary_verdicts, verdicts
from edvo.report.markdown_table import markdown_table

FAILED = "x"
"""Stands for the error of a system that failed."""

_NONE = "-"
Cells = tuple[list[str], list[list[str]]]


def cells(comparison: Comparison) -> Cells:
    """Lay out a comparison: a row a system, every figure of one run.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    (list of str, list of list of str)
        The header and the rows. Of several runs the one in the middle by its error is shown, with
        the largest error of all beside; times are of all runs.
    """
    rows = comparison.rows
    repeated = any(len(row.runs) > 1 for row in rows)
    measured = any(row.memory_mb is not None for row in rows)
    changed = any(row.kind == "variant" for row in rows)
    failures = any(row.failure for row in rows if row.kind != "reference")
    header = ["", "rank", "RPE rmse m/s"]
    header += ["worst"] * repeated + [f"to {comparison.base}"] * changed
    header += ["median", "Sturm's", "deg/s", "ATE rmse m", "coverage"]
    header += (
        ["wall ms (p95)", "CPU ms (p95)", "time (CPU)"] + ["MB"] * measured + ["why"] * failures
    )
    lines = []
    for row in rows:
        rank = comparison.rank(row)
        line = [row.name, _NONE if rank is None else str(rank), _error(row)]
        line += [_worst(row)] * repeated
        line += [_ratio(comparison.error_ratio(row))] * changed
        line += [*_errors(row), _coverage(row)]
        line += [_spread(row.wall_s), _spread(row.cpu_s), _time_ratios(comparison, row)]
        line += [_megabytes(row)] * measured + [_why(row)] * failures
        lines.append(line)
    return header, lines


def summary_cells(comparisons: Sequence[Comparison]) -> Cells:
    """Lay out several sequences side by side: error and time of each system in each.

    Parameters
    ----------
    comparisons : sequence of Comparison
        Of the same systems.

    Returns
    -------
    (list of str, list of list of str)
        The header and the rows. With variants there is the ratio of the error to the unchanged
        one in brackets, and its geometric mean over the sequences in the last column.
    """
    changed = any(row.kind == "variant" for each in comparisons for row in each.rows)
    names = dict.fromkeys(row.name for each in comparisons for row in each.rows)
    header = ["RPE rmse m/s", *(each.name for each in comparisons)]
    header += ["mean ratio"] * changed
    lines = []
    for name in names:
        found = [(each, each.row(name)) for each in comparisons]
        line = [name, *(_brief(each, row, changed) for each, row in found)]
        if changed:
            ratios = [each.error_ratio(row) for each, row in found if row is not None]
            line.append(_ratio(_geometric_mean(ratios)))
        lines.append(line)
    return header, lines


def describe(comparison: Comparison) -> str:
    """Say how many frames there were, and whether there is truth.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    str
        A line.
    """
    line = f"{comparison.frames} frame{'' if comparison.frames == 1 else 's'}"
    if comparison.interrupted:
        line += f" of {comparison.wanted}, then interrupted"
    if comparison.unreadable:
        line += f", {len(comparison.unreadable)} of them unreadable"
    if comparison.truth is None:
        line += "; no ground truth, so no errors"
    return line


def markdown(
    comparisons: Sequence[Comparison], *, command: str, pictures: Sequence[Sequence[str]] = ()
) -> str:
    """Write the whole comparison as a page.

    Parameters
    ----------
    comparisons : sequence of Comparison
        A section each.
    command : str
        What gave it.
    pictures : sequence of sequence of str, optional
        File names of the pictures of each sequence.

    Returns
    -------
    str
        Markdown, its headings of the third level so that it fits into a page of the docs.
    """
    parts = [f"Made by `{command}` with edvo {__version__}."]
    if len(comparisons) > 1:
        parts += ["### All sequences", markdown_table(*summary_cells(comparisons))]
        parts += ["\n".join(f"- {line}" for line in summary_verdicts(comparisons))]
    for number, comparison in enumerate(comparisons):
        parts += [f"### {comparison.name}", f"{describe(comparison)}."]
        parts += [markdown_table(*cells(comparison))]
        parts += ["\n".join(f"- {line}" for line in verdicts(comparison))]
        shown = pictures[number] if number < len(pictures) else ()
        parts += [f"![{comparison.name}]({name})" for name in shown]
    return "\n\n".join(part for part in parts if part) + "\n"


def records(comparison: Comparison) -> list[dict[str, Any]]:
    """Give each row in plain types with units in the names, numbers unrounded.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    list of dict
        One for each row, all with the same keys; None for what there is not. The errors of a
        system that failed are given as they are, beside the reason.
    """
    return [_record(comparison, row) for row in comparison.rows]


def to_csv(comparisons: Sequence[Comparison]) -> str:
    """Write all sequences into one table, a line for each system in each.

    Parameters
    ----------
    comparisons : sequence of Comparison
        At least one.

    Returns
    -------
    str
        CSV with a header; empty for what there is not.
    """
    lines = [record for comparison in comparisons for record in records(comparison)]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def to_json(comparisons: Sequence[Comparison], *, command: str, files: Sequence[str] = ()) -> str:
    """Write everything: rows, each single run, sentences, and the machine.

    Parameters
    ----------
    comparisons : sequence of Comparison
        A member of ``sequences`` each.
    command : str
        What gave them.
    files : sequence of str
        Pictures and trajectories that belong to it, from its folder.

    Returns
    -------
    str
        JSON.
    """
    whole = {
        "edvo": __version__,
        "command": command,
        "machine": {
            "platform": platform.platform(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "numba": numba.__version__,
        },
        "sequences": [
            {
                "name": comparison.name,
                "frames": comparison.frames,
                "wanted": comparison.wanted,
                "interrupted": comparison.interrupted,
                "unreadable": list(comparison.unreadable),
                "base": comparison.base,
                "rows": [
                    {**record, "runs": [_run(score) for score in row.runs]}
                    for record, row in zip(records(comparison), comparison.rows, strict=True)
                ],
                "verdicts": verdicts(comparison),
            }
            for comparison in comparisons
        ],
        "verdicts": summary_verdicts(comparisons),
        "files": list(files),
    }
    return json.dumps(whole, indent=2, allow_nan=False) + "\n"


def _record(comparison: Comparison, row: Row) -> dict[str, Any]:
    score = row.score
    return {
        "sequence": comparison.name,
        "system": row.name,
        "title": row.title,
        "kind": row.kind,
        "rank": comparison.rank(row),
        "failure": row.failure if row.kind != "reference" else "",
        **_figures(score),
        "runs_done": len(row.runs),
        "runs_failed": row.failed_runs,
        "worst_rpe_rmse_m_s": _number(row.worst_rpe),
        "error_ratio": _number(comparison.error_ratio(row)),
        **_time("wall_ms", row.wall_s),
        **_time("cpu_ms", row.cpu_s),
        "time_ratio": _number(comparison.time_ratio(row)),
        "cpu_ratio": _number(comparison.cpu_ratio(row)),
        "memory_mb": None if row.memory_mb is None else _number(row.memory_mb),
    }


def _run(score: Score) -> dict[str, Any]:
    return {
        "seed": score.seed,
        "begin": score.begin,
        "failure": score.failure,
        **_figures(score),
        **_time("wall_ms", score.wall_s),
        **_time("cpu_ms", score.cpu_s),
    }


def _figures(score: Score | None) -> dict[str, Any]:
    evaluation = None if score is None else score.evaluation
    rpe = None if evaluation is None else evaluation.rpe
    sturm = None if evaluation is None else evaluation.rpe_sturm
    ate = None if evaluation is None else evaluation.ate
    return {
        "frames": None if score is None else score.frames,
        "tracked": None if score is None else score.tracked,
        "degraded": None if score is None else score.degraded,
        "coverage": None if score is None else score.coverage,
        "rpe_pairs": None if rpe is None else len(rpe),
        "rpe_rmse_m_s": None if rpe is None else _number(rpe.rmse),
        "rpe_median_m_s": None if rpe is None else _number(rpe.median),
        "rpe_sturm_rmse_m_s": None if sturm is None else _number(sturm.rmse),
        "rpe_rotation_rmse_deg_s": None if rpe is None else _number(degrees(rpe.rotation_rmse)),
        "ate_rmse_m": None if ate is None else _number(ate.rmse),
    }


def _time(name: str, seconds: NDArray[np.float64]) -> dict[str, float | None]:
    some = seconds.size > 0
    return {
        f"{name}_median": 1e3 * float(np.median(seconds)) if some else None,
        f"{name}_p95": 1e3 * float(np.percentile(seconds, 95)) if some else None,
    }


def _number(value: float) -> float | None:
    """JSON has neither infinity nor what is no number."""
    return value if math.isfinite(value) else None


def _error(row: Row) -> str:
    if row.failure and row.kind != "reference":
        return FAILED
    return _decimals(row.rpe)


def _worst(row: Row) -> str:
    if row.failed_runs and row.kind != "reference":
        return f"{FAILED} ({row.failed_runs} of {len(row.runs)})"
    return _decimals(row.worst_rpe) if len(row.runs) > 1 else _NONE


def _errors(row: Row) -> list[str]:
    score = row.score
    if score is None or score.evaluation is None or (row.failure and row.kind != "reference"):
        return [_NONE] * 4
    rpe, sturm, ate = score.evaluation.rpe, score.evaluation.rpe_sturm, score.evaluation.ate
    return [
        _NONE if rpe is None else _decimals(rpe.median),
        _NONE if sturm is None else _decimals(sturm.rmse),
        _NONE if rpe is None else f"{degrees(rpe.rotation_rmse):.3f}",
        _NONE if ate is None else _decimals(ate.rmse),
    ]


def _decimals(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else _NONE


def _coverage(row: Row) -> str:
    return _NONE if row.score is None else f"{row.score.coverage:.1%}"


def _spread(seconds: NDArray[np.float64]) -> str:
    if not seconds.size:
        return _NONE
    return f"{_ms(float(np.median(seconds)))} ({_ms(float(np.percentile(seconds, 95)))})"


def _ms(seconds: float) -> str:
    value = 1e3 * seconds
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}"


def _ratio(value: float) -> str:
    if not math.isfinite(value):
        return _NONE
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}x"


def _time_ratios(comparison: Comparison, row: Row) -> str:
    wall, cpu = comparison.time_ratio(row), comparison.cpu_ratio(row)
    return f"{_ratio(wall)} ({_ratio(cpu)})" if math.isfinite(wall) else _NONE


def _megabytes(row: Row) -> str:
    return _NONE if row.memory_mb is None else f"{row.memory_mb:.0f}"


def _why(row: Row) -> str:
    return "" if row.kind == "reference" else row.failure


def _brief(comparison: Comparison, row: Row | None, changed: bool) -> str:
    if row is None:
        return _NONE
    error = _error(row)
    if changed:
        ratio = comparison.error_ratio(row)
        return f"{error} ({_ratio(ratio)})" if math.isfinite(ratio) else error
    return f"{error}, {_ms(row.median_s)} ms" if math.isfinite(row.median_s) else error


def _geometric_mean(ratios: Sequence[float]) -> float:
    if not ratios or not all(math.isfinite(ratio) and ratio > 0 for ratio in ratios):
        return math.nan
    return math.exp(sum(map(math.log, ratios)) / len(ratios))
