"""`edvo run`."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import typer

from edvo.cli.compiling import compile_now
from edvo.cli.configuration import configure
from edvo.cli.extras import Extras
from edvo.cli.interrupt import stop_on_interrupt
from edvo.cli.recording import open_recording
from edvo.cli.scores import score_table, speed_line
from edvo.cli.terminal import note, progress, say
from edvo.cli.view import View
from edvo.clock import StageClock
from edvo.datasets.inspection.unit import check_unit
from edvo.datasets.masked import MaskedSource, read_mask
from edvo.errors import DatasetError, EvaluationError
from edvo.evaluation import Evaluation, evaluate
from edvo.files import Unwritten, output_folder
from edvo.odometry import Odometry, Status
from edvo.report.more_files import more_files, name_files, settle
from edvo.report.results import FRAMES, RESULTS, TRAJECTORY, write_results
from edvo.report.tracking import FrameRecord, Run, choose_frames, track_source
from edvo.report.viewer_tracker import Shown

_PROBLEMS_SHOWN = 5


def run(
    path: Path,
    out: Path,
    *,
    preset: str | None,
    config_file: Path | None,
    overrides: list[str],
    seed: int | None,
    camera: str | None,
    mask: Path | None,
    format: str | None,
    colour_topic: str | None,
    depth_topic: str | None,
    start: int,
    max_frames: int | None,
    stride: int,
    report: bool,
    exports: list[str],
    view: bool,
    save_view: Path | None,
) -> None:
    """Track a recording and write what came of it; see `edvo.cli.commands.run`."""
    config = configure(preset, config_file, overrides, seed)
    extras = Extras(report, exports)
    viewing = View(view, save_view)
    source = open_recording(
        path, format=format, camera=camera, colour_topic=colour_topic, depth_topic=depth_topic
    )
    if mask is not None:
        source = MaskedSource(source, read_mask(mask, source.camera))
    indices = choose_frames(source, start=start, max_frames=max_frames, stride=stride)
    folder = output_folder(out, files=[*RESULTS, *extras.files()])
    for warning in (*source.warnings, *check_unit(source.timestamps).warnings):
        note(f"warning: {warning}")
    # Decoding and tracking share the cores by frames; OpenCV's own threads would only contend.
    cv2.setNumThreads(1)
    compile_now(config)
    clock = StageClock()
    watch = extras.watch(Odometry(source.camera, config, clock=clock), len(indices))
    with viewing.open(source, config) as viewer:
        shown = Shown(watch, viewer)
        with stop_on_interrupt() as stop, progress(source.name, len(indices)) as advance:

            def after(record: FrameRecord) -> None:
                watch.after(record)
                shown.after(record)
                advance()

            done = track_source(
                source,
                shown,
                indices=indices,
                clock=clock,
                on_frame=after,
                stop=stop,
            )
        errors = errors_of(done)
        unwritten = Unwritten()
        with unwritten.noted():
            write_results(done, folder, config, errors, extras.files())
        whole = not unwritten.any
        with unwritten.noted():
            tell(done, errors)
            if whole:
                tell_files(folder)
        with unwritten.noted():
            extras.write(done, indices, config, errors, watch, folder)
        with unwritten.noted():
            if whole:
                remove_earlier(folder, extras.written)
            else:  # then nothing is removed
                name_files(folder, [*more_files(folder), *extras.written])
        with unwritten.noted():
            if extras.written:
                say(f"wrote {', '.join(extras.written)}")
    unwritten.check()
    if done.interrupted:
        note(
            f"interrupted after {len(done.frames)} of {done.wanted} frames; "
            f"{folder} holds all that was tracked"
        )
        raise typer.Exit(stop.status)
    if not done.track_times.size:
        raise DatasetError(f"no frame could be read; the first: {done.problems[0]}")
    if extras.exports and not len(done.trajectory()):
        raise DatasetError(
            f"{path}: no frame has a pose: nothing to export; {folder / FRAMES} says why"
        )


def errors_of(run: Run) -> Evaluation | None:
    """Evaluate a run if there is truth, and say why if it cannot be."""
    truth = run.source.ground_truth
    if truth is None or not run.frames:
        return None
    try:
        return evaluate(truth, run.trajectory(), len(run.frames))
    except EvaluationError as error:
        note(f"warning: no errors: {error}")
        return None


def tell(run: Run, errors: Evaluation | None) -> None:
    """Print what came of a run."""
    for problem in run.problems[:_PROBLEMS_SHOWN]:
        note(f"skipped: {problem}")
    if len(run.problems) > _PROBLEMS_SHOWN:
        note(f"skipped {len(run.problems)} frames in all; frames.csv names each")
    lost = run.count(Status.LOST)
    if lost > len(run.problems):
        note(f"warning: lost in {lost - len(run.problems)} frames; frames.csv says why")
    say(
        f"{run.source.name}: {len(run.frames)} frames: {run.count(Status.TRACKED)} tracked, "
        f"{run.count(Status.DEGRADED)} degraded, {lost} lost ({len(run.problems)} unreadable)"
    )
    say(speed_line(run))
    if errors is not None:
        say(score_table({"edvo": errors}))
        for line in errors.notes:
            note(line)


def tell_files(folder: Path) -> None:
    """Print where the results of a run are."""
    say(f"wrote {folder / TRAJECTORY}, frames.csv, summary.json, config.yaml")


def remove_earlier(folder: Path, written: Sequence[str] = ()) -> None:
    """Remove what only an earlier run wrote beside its results, and say so."""
    removed: list[str] = []
    try:
        settle(folder, RESULTS, written, removed.append)
    finally:
        if removed:
            note(f"removed what is of an earlier run: {', '.join(removed)}")
