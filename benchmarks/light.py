"""Tracking while the light changes: ``python -m benchmarks.light -o bench``.

Rendered scenes, those of the paper and two more, and the real sequences at hand, each as it is
and with the paper's light changes (``ambient+diffuse``, 2 Hz, sudden jumps), by edvo and by
OpenCV's odometry on the same frames in turns. Writes light.md, light.csv and the pictures that it
shows.
"""

import argparse
import csv
import gc
import io
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.frames import DATA, REAL, ROOT
from benchmarks.light_plots import draw_brightness, draw_curve, draw_miss
from benchmarks.light_runs import (
    SEEDS,
    SYSTEMS,
    Clip,
    Result,
    follow,
    load,
    look_closely,
    median_of,
)
from benchmarks.machine import Others, describe
from benchmarks.report import document
from benchmarks.section import Bound, table
from edvo.config import Config
from edvo.datasets import open_source
from edvo.files import output_folder, write_atomically
from edvo.synthesis.relighting import Relighter
from edvo.synthesis.sequence import SyntheticSource, make_recipe

PAPER = ("texture_far", "texture_near", "office", "notexture_far", "notexture_near", "cabinet")
SCENES = (*PAPER, "corridor", "stairs")
LIMITS = {"notexture_far": 0.015, "notexture_near": 0.015}
TEXTURED, TEXTURED_LIMIT = ("texture_far", "texture_near", "office"), 0.010
MOST_WORSE = 1.1  # error under changing light over that under constant light
DRAWN = 1.5  # the same, beyond which it is looked at where that comes from
SEVERITIES = (0.5, 1.0)
SEVERITY = SEVERITIES[0]  # what brightness over time is drawn of
CURVE = (0.0, 0.25, 0.5, 0.75, 1.0)
CURVE_OF = ("texture_far", "tum_fr1_xyz")
BRIGHTNESS_OF = "tum_fr1_xyz"
LIGHT_SEED = 1
OURS = "edvo default"
COLUMNS = (
    *("sequence", "system", "severity", "seed", "frames", "poses", "tracked"),
    *("rpe_rmse_m", "rpe_median_m", "rpe_rmse_deg", "ate_rmse_m", "zero_motion_rpe_m"),
)
FILE, TABLE, CURVE_PLOT, BRIGHTNESS_PLOT = "light.md", "light.csv", "severity.png", "brightness.png"
PAGE = ROOT / "docs" / "light.md"
MARK = "<!-- measured: written by python -m benchmarks.light --docs -->\n"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.light", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("bench"), help="folder to write to")
    parser.add_argument("--quick", action="store_true", help="2 s each; figures not to quote")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each rendered scene")
    parser.add_argument("--only", help="some of the sequences, by comma")
    parser.add_argument("--docs", action="store_true", help="put the result into docs/ as well")
    given = parser.parse_args()
    if given.docs and (given.quick or given.only):
        parser.error("--docs wants all sequences, and not a quick run")
    seconds = 2.0 if given.quick else given.seconds
    if seconds < 2.0:
        parser.error("--seconds: 2 at least, for errors over one second")
    out = output_folder(given.out)
    cv2.setNumThreads(1)
    others = Others()
    results: list[Result] = []
    misses: list[str] = []
    notes: list[str] = []
    for clip in clips(seconds, given.only):
        severities = CURVE if clip.name in CURVE_OF else (0.0, *SEVERITIES)
        relighters = {s: Relighter(severity=s, seed=LIGHT_SEED) for s in severities}
        results += follow(clip, relighters)
        misses += show_misses(clip, results, relighters, out)
        if clip.name == BRIGHTNESS_OF:
            off = draw_brightness(out / BRIGHTNESS_PLOT, clip, SEVERITY, LIGHT_SEED)
            notes.append(
                f"![Mean light of relit images over time, and of the model]({BRIGHTNESS_PLOT})\n\n"
                f"`ambient` alone: the images' mean light is {off:.3f} stops (rms) from the "
                "model's; what is missing is lost where images saturate."
            )
        write_csv(out / TABLE, results)
        measured = compose(results, misses, notes, others, out, quick=given.quick)
        write_atomically(out / FILE, f"# Light that changes\n\n{measured}")
        del clip
        gc.collect()
    print(f"wrote {out / FILE}")
    if given.docs:
        document(out, measured, page=PAGE, mark=MARK)


def clips(seconds: float, only: str | None) -> Iterator[Clip]:
    """Render or read one sequence after the other."""
    real = [folder.name for folder in sorted(DATA.glob("*")) if folder.is_dir()]
    wanted = only.split(",") if only else [*SCENES, *real]
    for name in wanted:
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        if name in SCENES:
            frames = round(30 * seconds)
            yield load(SyntheticSource(make_recipe(name, frames=frames)))
        else:
            yield load(open_source(DATA / name))


def show_misses(
    clip: Clip, results: Sequence[Result], relighters: dict[float, Relighter], out: Path
) -> list[str]:
    """Draw where the errors come from, in light that makes them much greater, or loses poses."""
    before = median_of(pick(results, clip.name, OURS, 0.0))
    parts = []
    for severity in SEVERITIES:
        run = median_of(pick(results, clip.name, OURS, severity))
        much = run.rpe > DRAWN * before.rpe or run.coverage < before.coverage
        if not much or run.errors is None or run.errors.rpe is None:
            continue
        config = Config.preset("default").with_overrides([f"seed={run.seed}"])
        looks = look_closely(clip, relighters[severity], config)
        name = f"miss_{clip.name}_{severity:g}.png"
        title = f"{clip.name}, {light_name(severity)}, {OURS}"
        said = draw_miss(out / name, clip, run.errors.rpe, looks, title)
        parts.append(
            f"**{clip.name}, {light_name(severity)}**: {said}.\n\n"
            f"![Edges, matches and errors of the worst registration]({name})"
        )
    return parts


def pick(results: Sequence[Result], name: str, system: str, severity: float) -> list[Result]:
    """Choose the runs of one cell."""
    return [r for r in results if (r.sequence, r.system, r.severity) == (name, system, severity)]


def light_name(severity: float) -> str:
    """Name a light."""
    return f"changing, {severity:g}" if severity else "constant"


def bounds(results: Sequence[Result]) -> list[Bound]:
    """Hold edvo's default preset to what was promised."""
    found = []
    for name in dict.fromkeys(result.sequence for result in results):
        runs = {s: pick(results, name, OURS, s) for s in (0.0, *SEVERITIES)}
        middle = {severity: median_of(own) for severity, own in runs.items()}
        if name in SCENES:
            lost = max(1 - run.coverage for run in middle.values())
            found.append(Bound(f"{name}: frames without a pose", 0.0, 100 * lost, " %"))
            limit = TEXTURED_LIMIT if name in TEXTURED else LIMITS.get(name)
            if limit is not None:
                found += [
                    Bound(f"{name}: RPE, {light_name(severity)}", limit, run.rpe, " m/s")
                    for severity, run in middle.items()
                ]
        for severity in SEVERITIES:
            light = light_name(severity)
            if name not in SCENES:
                # An error counts only beside its coverage: giving up where it is hard looks good.
                before, after = (np.mean([r.coverage for r in runs[s]]) for s in (0.0, severity))
                more = 100 * max(0.0, float(before - after))
                found.append(Bound(f"{name}: poses lost, {light}", 0.0, more, " %"))
            ratio = middle[severity].rpe / middle[0.0].rpe
            found.append(Bound(f"{name}: RPE, {light} over constant", MOST_WORSE, ratio))
    return found


def compose(
    results: Sequence[Result],
    misses: Sequence[str],
    notes: Sequence[str],
    others: Others,
    out: Path,
    *,
    quick: bool,
) -> str:
    """Put the page together."""
    names = list(dict.fromkeys(result.sequence for result in results))
    made = [name for name in names if name in SCENES]
    real = [name for name in names if name not in SCENES]
    machine = describe()
    parts = [
        f"Relative pose error over one second, rmse (and median), m/s, by the TUM script; the "
        f"coverage where not every frame has a pose. edvo: the median of {SEEDS} seeds. OpenCV "
        f"{machine['OpenCV']}: each frame registered with a keyframe (0.10 m, 8 degrees). "
        f"Changing light: `ambient+diffuse`, 2 Hz, seed {LIGHT_SEED}, a jump every 1.5 s, at the "
        f"severity given. edvo {machine['edvo']}, {machine['date']}."
    ]
    if quick:
        parts.append("**Quick run: too few frames for figures to be quoted.**")
    if made:
        parts += ["### Rendered scenes", errors_table(results, made)]
    if real:
        parts += ["### Real sequences", errors_table(results, real)]
        absent = [name for name in REAL if name not in real]
        if absent:
            parts.append(f"Not measured: {', '.join(absent)}.")
    parts += ["### Changing over constant light", ratio_table(results, names)]
    curves = {
        name: [r for r in results if r.sequence == name] for name in CURVE_OF if name in names
    }
    if curves:
        draw_curve(out / CURVE_PLOT, curves)
        parts += [
            "### Error against severity",
            f"![Error of each method against the severity of the light]({CURVE_PLOT})",
            "Numbers beside points are coverages; a point that is missing has no pose to compare.",
        ]
        parts += [curve_table(name, own) for name, own in curves.items()]
    if notes:
        parts += ["### Brightness over time", *notes]
    rows = [bound.row() for bound in bounds(results)]
    parts += ["### What was promised", table(["promise", "at most", "measured", "kept"], rows)]
    if misses:
        parts += ["### Where light makes much worse what it was", *misses]
    return "\n\n".join(parts) + "\n"


def cell(runs: Sequence[Result]) -> str:
    """Write the median run."""
    if not runs:
        return ""
    run = median_of(runs)
    if not np.isfinite(run.rpe):
        return f"x, {run.coverage:.0%}"
    share = f", {run.coverage:.1%}" if run.coverage < 1 else ""
    return f"{run.rpe:.4f} ({run.rpe_median:.4f}){share}"


def errors_table(results: Sequence[Result], names: Sequence[str]) -> str:
    """Write a row for each sequence and light."""
    rows = []
    for name in names:
        for severity in (0.0, *SEVERITIES):
            cells = [cell(pick(results, name, system, severity)) for system in SYSTEMS]
            still = median_of(pick(results, name, OURS, severity)).errors
            zero = None if still is None else still.rpe_zero_motion
            rows.append(
                [name, light_name(severity), *cells, "" if zero is None else f"{zero.rmse:.3f}"]
            )
    return table(["sequence", "light", *SYSTEMS, "no motion"], rows)


def ratio_table(results: Sequence[Result], names: Sequence[str]) -> str:
    """Write how much worse each method gets."""
    rows = []
    for name in names:
        for severity in SEVERITIES:
            row = [name, light_name(severity)]
            for system in SYSTEMS:
                before, after = (
                    median_of(pick(results, name, system, s)).rpe for s in (0.0, severity)
                )
                row.append(f"{after / before:.2f}" if np.isfinite(after / before) else "x")
            rows.append(row)
    return table(["sequence", "light", *SYSTEMS], rows)


def curve_table(name: str, results: Sequence[Result]) -> str:
    """Write the error at each severity."""
    rows = [
        [system, *(cell(pick(results, name, system, severity)) for severity in CURVE)]
        for system in SYSTEMS
    ]
    return table([name, *(f"severity {severity:g}" for severity in CURVE)], rows)


def write_csv(path: Path, results: Sequence[Result]) -> None:
    """Write a row for each run."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for run in results:
        errors = run.errors
        rpe = None if errors is None else errors.rpe
        still = None if errors is None else errors.rpe_zero_motion
        ate = None if errors is None else errors.ate
        figures = [
            None if rpe is None else rpe.rmse,
            None if rpe is None else rpe.median,
            None if rpe is None else float(np.degrees(rpe.rotation_rmse)),
            None if ate is None else ate.rmse,
            None if still is None else still.rmse,
        ]
        poses = 0 if errors is None else errors.poses
        cells = ["" if value is None else f"{value:.6g}" for value in figures]
        what = [run.sequence, run.system, f"{run.severity:g}", run.seed]
        writer.writerow([*what, run.frames, poses, run.tracked, *cells])
    write_atomically(path, text.getvalue())


if __name__ == "__main__":
    main()
