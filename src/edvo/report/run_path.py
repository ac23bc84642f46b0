"""The path of a run in its own world: lines to be drawn, and a view of them that can be turned."""

import json
from base64 import b64encode
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.evaluation import Evaluation
from edvo.export.edge_map import EdgePoints
from edvo.odometry import Status
from edvo.report.plots import direction_colours
from edvo.report.tracking import Run
from edvo.trajectory import Trajectory

_MOST_PLACES = 4000
_MOST_KEYFRAMES = 300
_MOST_EDGES = 12_000
_RANK = {Status.TRACKED: 0, Status.DEGRADED: 1, Status.LOST: 2}

_BODY = """
<p class="tools"><button id="view-3d">3-D</button><button id="view-top">top</button>
<button id="view-side">side</button><button id="view-behind">behind</button>
<label><input type="checkbox" id="show-map" checked> edges</label>
<label><input type="checkbox" id="show-truth" checked{truth}> truth</label>
<label><input type="checkbox" id="show-keyframes" checked> keyframes</label>
<span class="note">drag to turn, shift-drag to move, wheel to zoom</span></p>
<canvas id="path-view">This browser draws no canvas; the pictures below show the same.</canvas>
"""


@dataclass(frozen=True, eq=False)
class Path3D:
    """What is drawn of a path; places are in metres, in the world of the estimate.

    Attributes
    ----------
    places : ndarray of float64, shape (F, 3)
        Of each frame, NaN where it was lost.
    ranks : ndarray of int64, shape (F,)
        0 tracked, 1 degraded, 2 lost.
    truth : ndarray of float64, shape (M, 3)
        True places, aligned as for the absolute error; none where there is no truth.
    keyframes : ndarray of float64, shape (K, 4, 4)
        Poses of the keyframes.
    """

    places: NDArray[np.float64]
    ranks: NDArray[np.int64]
    truth: NDArray[np.float64]
    keyframes: NDArray[np.float64]


def path_of(run: Run, evaluation: Evaluation | None) -> Path3D | None:
    """Collect the lines of a run.

    Parameters
    ----------
    run : Run
        What was tracked.
    evaluation : Evaluation, optional
        Its errors, where there is truth.

    Returns
    -------
    Path3D or None
        None if no frame has a pose.
    """
    estimate = run.trajectory()
    if not len(estimate):
        return None
    places = np.array([record.T_world_cam[:3, 3] for record in run.frames])
    ranks = np.array([_RANK[record.status] for record in run.frames])
    places[ranks == _RANK[Status.LOST]] = np.nan
    keyframes = [record.T_world_cam for record in run.frames if record.is_keyframe]
    truth = np.empty((0, 3))
    if evaluation is not None and run.source.ground_truth is not None:
        truth = _truth(run.source.ground_truth, estimate, evaluation)
    return Path3D(places, ranks, truth, np.array(keyframes).reshape(-1, 4, 4))


def turning_view(path: Path3D, edges: EdgePoints) -> str:
    """Make a view that can be turned.

    Parameters
    ----------
    path : Path3D
        The lines.
    edges : EdgePoints
        The edge map; a part of a large one is drawn.

    Returns
    -------
    str
        HTML: buttons, canvas, data and script.
    """
    few = edges.thinned(_MOST_EDGES)
    known = path.places[np.isfinite(path.places[:, 0])]
    lines = np.concatenate([known, path.truth])
    # The farthest edges may leave the picture: the path must not shrink to a dot.
    seen = np.percentile(few.points, (10, 90), axis=0) if len(few) else known[:1]
    farthest = float(np.abs(few.points).max(initial=1e-3))
    unit = farthest / 32_000
    colours = np.rint(255 * 0.85 * direction_colours(few.gradients)).astype(np.uint8)
    data = {
        "scene": _ball(np.concatenate([lines, seen])),
        "path": _ball(lines),
        "estimate": _rows(path.places, path.ranks),
        "truth": np.round(path.truth[:: _step(path.truth, _MOST_PLACES)], 4).tolist(),
        "keyframes": [
            [np.round(T[:3, 3], 4).tolist(), np.round(T[:3, :3].ravel(), 3).tolist()]
            for T in path.keyframes[:: _step(path.keyframes, _MOST_KEYFRAMES)]
        ],
        "map": {
            "unit": unit,
            "places": _base64(np.rint(few.points / unit).astype("<i2")),
            "colours": _base64(colours),
        },
    }
    script = files("edvo.report").joinpath("path_view.js").read_text(encoding="utf-8")
    return (
        _BODY.format(truth="" if len(path.truth) else " disabled")
        + f'<script type="application/json" id="path-data">{json.dumps(data)}</script>\n'
        + f"<script>\n{script}</script>"
    )


def _truth(
    reference: Trajectory, estimate: Trajectory, evaluation: Evaluation
) -> NDArray[np.float64]:
    truth = reference.between(estimate.timestamps[0], estimate.timestamps[-1])
    if not len(truth):
        return np.empty((0, 3))
    if evaluation.ate is not None:
        T_est_ref = se3.inverse(evaluation.ate.T_ref_est)
    else:
        T_est_ref = estimate.poses[0] @ se3.inverse(truth.poses[0])
    places: NDArray[np.float64] = truth.poses[:, :3, 3] @ T_est_ref[:3, :3].T + T_est_ref[:3, 3]
    return places


def _rows(places: NDArray[np.float64], ranks: NDArray[np.int64]) -> list[list[float] | None]:
    """Place and rank of frames; None wherever some were lost, be it between those drawn."""
    step = _step(places, _MOST_PLACES)
    lost = ranks == _RANK[Status.LOST]
    rows: list[list[float] | None] = []
    for begin in range(0, len(places), step):
        group = slice(begin, begin + step)
        kept = np.flatnonzero(~lost[group])
        if len(kept):
            rank = int(ranks[group][kept].max())
            rows.append([*np.round(places[begin + kept[0]], 4).tolist(), rank])
        if lost[group].any() and rows and rows[-1] is not None:
            rows.append(None)
    return rows


def _ball(places: NDArray[np.float64]) -> dict[str, object]:
    """Centre and radius of a ball around places, never quite a point."""
    low, high = places.min(axis=0), places.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2 + 1e-3
    return {"centre": np.round(0.5 * (low + high), 4).tolist(), "radius": round(radius, 4)}


def _step(rows: NDArray[np.float64], most: int) -> int:
    return max(1, -(-len(rows) // most))


def _base64(values: NDArray[np.generic]) -> str:
    return b64encode(values.tobytes()).decode()
