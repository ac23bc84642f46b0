"""A run as one HTML file that needs no other: what `edvo run --report` writes."""

from collections.abc import Sequence
from html import escape
from itertools import groupby
from math import degrees
from typing import Any

import numpy as np
import yaml

from edvo import __version__
from edvo.config import Config
from edvo.evaluation import Evaluation
from edvo.export.edge_map import EdgePoints
from edvo.odometry import Status
from edvo.report.html import document, notes, picture, table
from edvo.report.run_film import strip
from edvo.report.run_path import Path3D, path_of, turning_view
from edvo.report.run_plots import draw_error_curves, draw_planes, draw_stages, draw_timeline
from edvo.report.tracking import FrameRecord, Run
from edvo.report.watch import Watch

PAGE = "report.html"

_MOST_GAPS = 25
_STYLE = """
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr));
  gap: .7rem; margin: 1.2rem 0; }
.tile { background: #f5f7f8; border-radius: .5rem; padding: .6rem .8rem; }
.tile b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.tile span { color: #555; font-size: .85rem; }
.warning { background: #fdf0d5; border-left: 4px solid #f4a261; padding: .5rem .8rem;
  margin: .5rem 0; border-radius: .2rem; }
.good { background: #d7ecd9; color: #14501c; }
.poor { background: #fdf0d5; color: #7a4a00; }
.bad { background: #f9d9d3; color: #7c1f0e; }
#path-view { display: block; width: 100%; height: 32rem; border: 1px solid #ddd;
  border-radius: .4rem; touch-action: none; cursor: grab; }
.tools { margin: .4rem 0; } .tools button { font: inherit; margin-right: .2rem; }
.tools label { margin: 0 .5rem; }
.film figure { margin: .8rem 0; }
pre { background: #f5f7f8; padding: .8rem; overflow-x: auto; font-size: .85rem; }
"""


def page(
    run: Run,
    config: Config,
    evaluation: Evaluation | None,
    watch: Watch,
    edges: EdgePoints,
    warnings: Sequence[str],
) -> str:
    """Write all that is worth seeing of a run.

    Parameters
    ----------
    run : Run
        At least one frame.
    config : Config
        Its parameters.
    evaluation : Evaluation or None
        Its errors, where there is truth.
    watch : Watch
        The frames that were kept of it.
    edges : EdgePoints
        Its 3-D edge map.
    warnings : sequence of str
        What looks wrong with the source, a line each.

    Returns
    -------
    str
        The document; pictures, data and script lie within it.
    """
    name = run.source.name
    title = f"edvo run: {name}"
    body = [
        f"<h1>{escape(name)}</h1>",
        f'<p class="made">{escape(str(run.source.path))}, tracked by edvo {__version__}</p>',
        _verdict(run),
        _tiles(run, evaluation),
        *(f'<p class="warning">{escape(warning)}</p>' for warning in warnings),
        *_path(path_of(run, evaluation), edges),
        *_errors(evaluation),
        '<h2 id="status">Status</h2>',
        picture(draw_timeline(run), "White ticks are keyframes; of a long run, red is the worst."),
        _gaps(run.frames),
        *_times(run),
        *_film(run, config, watch),
        *_setting(run, config),
    ]
    return document(title, body, style=_STYLE)


def _verdict(run: Run) -> str:
    frames = len(run.frames)
    lost, degraded = run.count(Status.LOST), run.count(Status.DEGRADED)
    if run.interrupted:
        style, words = "poor", f"interrupted after {frames} of {run.wanted} frames"
    elif lost == frames:
        style, words = "bad", "lost throughout"
    elif lost:
        style, words = "bad" if lost > frames / 20 else "poor", f"lost in {lost} of {frames} frames"
    elif degraded:
        style, words = "poor", f"never lost, {degraded} of {frames} poses to be taken with care"
    else:
        style, words = "good", f"tracked in all {frames} frames"
    return f'<p><span class="sign {style}">{escape(words)}</span></p>'


def _tiles(run: Run, evaluation: Evaluation | None) -> str:
    frames, count = run.frames, len(run.frames)
    span = frames[-1].timestamp - frames[0].timestamp
    places = run.trajectory().poses[:, :3, 3]
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    tiles = [
        (f"{count}", f"frames in {span:.1f} s"),
        (f"{run.count(Status.TRACKED) / count:.1%}", "tracked"),
        (f"{run.count(Status.DEGRADED) / count:.1%}", "degraded"),
        (f"{run.count(Status.LOST) / count:.1%}", "lost"),
        (f"{sum(record.is_keyframe for record in frames)}", "keyframes"),
        (f"{length:.2f} m", "path length"),
    ]
    if run.track_times.size:
        median = 1e3 * float(np.median(run.track_times))
        tiles.append((f"{median:.2f} ms", f"median track call; {run.frames_per_s:.0f} frames/s"))
    if evaluation is not None and evaluation.rpe is not None:
        rpe = evaluation.rpe
        words = f"RPE rmse over {rpe.delta:g} {rpe.unit}; {degrees(rpe.rotation_rmse):.2f}°"
        tiles.append((f"{1e3 * rpe.rmse:.1f} mm", words))
    if evaluation is not None and evaluation.ate is not None:
        tiles.append((f"{1e3 * evaluation.ate.rmse:.1f} mm", "ATE rmse"))
    inner = "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(words)}</span></div>'
        for value, words in tiles
    )
    return f'<div class="tiles">{inner}</div>'


def _path(path: Path3D | None, edges: EdgePoints) -> list[str]:
    heading = '<h2 id="path">Path</h2>'
    if path is None:
        return [heading, "<p>No frame has a pose.</p>"]
    flat = draw_planes(path.places, path.truth, path.keyframes[:, :3, 3])
    words = "In the axes of the first camera; the truth is aligned as for the ATE."
    return [heading, turning_view(path, edges), picture(flat, words)]


def _errors(evaluation: Evaluation | None) -> list[str]:
    if evaluation is None:
        return []
    rows = [
        _error_row("motion over 1 s, mm", evaluation.rpe, evaluation.rpe_zero_motion),
        _error_row("position, mm", evaluation.ate, evaluation.ate_zero_motion),
    ]
    header = ("", "rmse", "median", "mean", "max", "rmse of standing still")
    return [
        '<h2 id="errors">Errors</h2>',
        picture(draw_error_curves(evaluation), "Against the truth that the source has."),
        table(header, rows, numeric=[False, *[True] * 5]),
        notes(evaluation.notes),
    ]


def _error_row(label: str, error: Any, still: Any) -> list[str]:
    if error is None:
        return [label, *["-"] * 5]
    values = (error.rmse, error.median, error.mean, error.max)
    return [
        label,
        *(f"{1e3 * value:.1f}" for value in values),
        "-" if still is None else f"{1e3 * still.rmse:.1f}",
    ]


def _gaps(frames: Sequence[FrameRecord]) -> str:
    """Stretches of frames that were not tracked, with the reason of each first one."""
    begin = frames[0].timestamp
    rows, number = [], 0
    for status, group in groupby(frames, key=lambda record: record.status):
        stretch = list(group)
        if status is not Status.TRACKED:
            times = [record.timestamp - begin for record in (stretch[0], stretch[-1])]
            span = " to ".join(f"{time:.2f}" for time in dict.fromkeys(times))
            rows.append([f"{number}", span, f"{len(stretch)}", status.value, stretch[0].reason])
        number += len(stretch)
    if not rows:
        return ""
    header = ("first frame", "time (s)", "frames", "status", "why, to begin with")
    more = len(rows) - _MOST_GAPS
    shown = table(header, rows[:_MOST_GAPS], numeric=[True, True, True, False, False])
    return shown + (notes([f"and {more} more; frames.csv names each"]) if more > 0 else "")


def _times(run: Run) -> list[str]:
    drawn = draw_stages(run)
    if drawn is None:
        return []
    values = 1e3 * run.track_times
    words = (
        f"The track call without decoding: median {np.median(values):.2f} ms, 95 % below "
        f"{np.percentile(values, 95):.2f} ms, at most {values.max():.2f} ms; "
        f"the whole run took {run.wall_s:.1f} s."
    )
    return ['<h2 id="times">Times</h2>', picture(drawn, words)]


def _film(run: Run, config: Config, watch: Watch) -> list[str]:
    worst, typical = watch.worst(), watch.typical(run.frames)
    if not worst and not typical:
        return []
    camera, begin = run.source.camera, run.frames[0].timestamp
    return [
        '<h2 id="frames">Frames</h2>',
        "<p>Left: edge pixels, coloured by the direction of their gradients. Right: dots are "
        "samples, lines lead to the edges of the keyframe that they match; green fits, red is "
        "3 px off or more.</p>",
        strip(worst, camera, config, title="Worst", begin=begin),
        strip(typical, camera, config, title="Typical", begin=begin),
    ]


def _setting(run: Run, config: Config) -> list[str]:
    source = run.source
    described = source.camera.to_dict()
    camera = [[key, str(value)] for key, value in described.items()]
    rows = [["format", source.format], ["camera from", source.camera_origin], *camera]
    changed = changes(config)
    said = f"Preset {config.preset_name}" + ("." if not changed else ", but for:")
    text = yaml.safe_dump(config.to_dict(), sort_keys=False)
    return [
        '<h2 id="setting">Camera and parameters</h2>',
        table(("", "source and camera"), rows),
        f"<p>{escape(said)}</p>",
        notes(changed),
        f"<details><summary>All parameters</summary><pre>{escape(text)}</pre></details>",
    ]


def changes(config: Config) -> list[str]:
    """Say which parameters are not those of their preset.

    Parameters
    ----------
    config : Config
        The parameters.

    Returns
    -------
    list of str
        ``section.name=value (preset: value)`` each.
    """
    preset, used = (_flat(each.to_dict()) for each in (Config.preset(config.preset_name), config))
    return [
        f"{key}={value} (preset: {preset.get(key)})"
        for key, value in used.items()
        if value != preset.get(key)
    ]


def _flat(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{before}{key}."))
        else:
            flat[before + key] = value
    return flat
