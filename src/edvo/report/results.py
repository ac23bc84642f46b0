"""The files of a run: trajectory.txt, frames.csv, summary.json, config.yaml."""

import csv
import io
import json
import math
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from edvo import __version__, se3
from edvo.config import Config
from edvo.evaluation import Evaluation
from edvo.files import Unwritten, write_atomically
from edvo.odometry import Status
from edvo.report.more_files import MORE_FILES, SUMMARY, names_to_be
from edvo.report.tracking import FrameRecord, Run

TRAJECTORY = "trajectory.txt"
FRAMES = "frames.csv"
CONFIG = "config.yaml"
RESULTS = (TRAJECTORY, FRAMES, SUMMARY, CONFIG)

_POSE_COLUMNS = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
_TWIST = ("x", "y", "z", "rx", "ry", "rz")
_UPPER = np.triu_indices(len(_TWIST))
_COVARIANCE_COLUMNS = tuple(f"cov_{_TWIST[i]}_{_TWIST[j]}" for i, j in zip(*_UPPER, strict=True))


def write_results(
    run: Run,
    folder: Path,
    config: Config,
    evaluation: Evaluation | None = None,
    more: Sequence[str] = (),
) -> None:
    """Write all the files of a run, each whole or not at all, the summary last.

    What an earlier run wrote beside its own stays, and named: `edvo.report.more_files.settle` is
    for when all is written.

    Parameters
    ----------
    run : Run
        What was tracked.
    folder : pathlib.Path
        Where to; it must exist.
    config : Config
        The parameters it was tracked with.
    evaluation : Evaluation, optional
        Its errors, for the summary.
    more : sequence of str
        What will be written beside them, relative to the folder, for the summary.

    Raises
    ------
    OutputError
        If a file cannot be written; the others are.
    """
    unwritten = Unwritten()
    names = names_to_be(folder, more)
    with unwritten.noted():
        run.trajectory().write(folder / TRAJECTORY)
    with unwritten.noted():
        write_atomically(folder / FRAMES, frames_csv(run.frames))
    with unwritten.noted():
        config.to_yaml(folder / CONFIG)
    with unwritten.noted():
        summary = {**summarise(run, config, evaluation), MORE_FILES: names}
        write_atomically(folder / SUMMARY, json.dumps(summary, indent=2) + "\n")
    unwritten.check()


def frames_csv(frames: Sequence[FrameRecord]) -> str:
    """Make a table with a row for each frame.

    Parameters
    ----------
    frames : sequence of FrameRecord
        In order.

    Returns
    -------
    str
        CSV. The pose is ``T_world_cam`` in metres; for a lost frame it is a prediction. What a
        frame does not have is empty. ``track_ms`` is the wall time of the track call, and each
        other ``..._ms`` a stage of it. Columns ``cov_...`` hold the upper triangle of the
        covariance of the motion since the keyframe, row by row, in metres and radians.
    """
    stages = list(dict.fromkeys(stage for record in frames for stage in record.stages))
    header = [
        "timestamp",
        "status",
        "reason",
        "keyframe",
        "is_keyframe",
        "piece",
        "edges",
        "samples",
        "iterations",
        "matches",
        "inliers",
        "agreeing",
        "sigma_px",
        "plane_points",
        "sigma_depth",
        "depth_balance",
        "track_ms",
        *_POSE_COLUMNS,
        *(f"{stage}_ms" for stage in stages),
        *_COVARIANCE_COLUMNS,
    ]
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(header)
    for record in frames:
        found = record.registration
        rows.writerow(
            [
                record.stamp,
                record.status.value,
                record.reason,
                record.keyframe,
                int(record.is_keyframe),
                record.piece,
                record.edges,
                record.samples,
                "" if found is None else found.iterations,
                "" if found is None else found.matches,
                "" if found is None else found.inliers,
                "" if found is None else found.agreeing,
                "" if found is None or not found.matches else _number(found.sigma_px),
                "" if found is None else found.plane_points,
                "" if found is None or not found.plane_points else _number(found.sigma_depth),
                "" if found is None else _number(found.depth_balance),
                _milliseconds(record.track_s),
                *_pose(record.T_world_cam),
                *(_milliseconds(record.stages.get(stage)) for stage in stages),
                *_covariance(record.covariance),
            ]
        )
    return text.getvalue()


def summarise(run: Run, config: Config, evaluation: Evaluation | None = None) -> dict[str, Any]:
    """Say in plain types what was tracked, with what, how fast and how well.

    Parameters
    ----------
    run : Run
        What was tracked.
    config : Config
        Its parameters.
    evaluation : Evaluation, optional
        Its errors.

    Returns
    -------
    dict
        Made of what JSON knows; a number that does not exist is None.
    """
    source = run.source
    tracked, degraded, lost = (
        run.count(status) for status in (Status.TRACKED, Status.DEGRADED, Status.LOST)
    )
    times = 1e3 * run.track_times
    summary = {
        "edvo": __version__,
        "source": {
            "name": source.name,
            "path": str(source.path),
            "format": source.format,
            "frames": len(source),
            **{key: value for key, value in source.describe().items() if key == "mask"},
        },
        "camera": {**source.camera.to_dict(), "origin": source.camera_origin},
        "frames": {
            "wanted": run.wanted,
            "processed": len(run.frames),
            "tracked": tracked,
            "degraded": degraded,
            "lost": lost,
            "unreadable": len(run.problems),
            "dropped": run.dropped,
            "keyframes": sum(record.is_keyframe for record in run.frames),
        },
        "coverage": (tracked + degraded) / len(run.frames) if run.frames else 0.0,
        "measured": dict(run.measured),
        "interrupted": run.interrupted,
        "problems": run.problems,
        "wall_s": run.wall_s,
        "frames_per_s": run.frames_per_s,
        "track_ms": _spread(times),
        "stage_ms": _stage_medians(run),
        "evaluation": None if evaluation is None else evaluation.to_dict(),
        "config": config.to_dict(),
        "machine": {
            "platform": platform.platform(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "numba": numba.__version__,
        },
    }
    finite: dict[str, Any] = _only_finite(summary)
    return finite


def _stage_medians(run: Run) -> dict[str, float]:
    by_stage: dict[str, list[float]] = {}
    for record in run.frames:
        for stage, seconds in record.stages.items():
            by_stage.setdefault(stage, []).append(1e3 * seconds)
    return {stage: float(np.median(values)) for stage, values in by_stage.items()}


def _spread(values: NDArray[np.float64]) -> dict[str, float] | None:
    if not values.size:
        return None
    return {
        "median": float(np.median(values)),
        "mean": float(np.mean(values)),
        "p95": float(np.percentile(values, 95)),
        "max": float(np.max(values)),
    }


def _pose(T_world_cam: NDArray[np.float64]) -> list[str]:
    translation, quaternion = se3.to_quaternion(T_world_cam)
    return [f"{value + 0.0:#.12g}" for value in (*translation.tolist(), *quaternion.tolist())]


def _covariance(covariance: NDArray[np.float64] | None) -> list[str]:
    if covariance is None:
        return [""] * len(_COVARIANCE_COLUMNS)
    return [_number(value) for value in covariance[_UPPER].tolist()]


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.4f}"


def _number(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else ""


def _only_finite(value: Any) -> Any:
    """Replace what JSON cannot hold by None."""
    if isinstance(value, dict):
        return {key: _only_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_only_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
