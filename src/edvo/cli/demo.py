"""`edvo demo`."""

import time
from pathlib import Path

import cv2
import typer

from edvo.cli import INTERRUPTED
from edvo.cli.compiling import compile_now
from edvo.cli.configuration import configure
from edvo.cli.interrupt import stop_on_interrupt
from edvo.cli.scores import score_table, speed_line
from edvo.cli.terminal import note, progress, say
from edvo.clock import StageClock
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.evaluation import evaluate
from edvo.files import output_folder
from edvo.odometry import Odometry
from edvo.report.demo import SCENES, demo_source, picture_of, renderer_compiling_aside
from edvo.report.plots import draw_scenes
from edvo.report.results import TRAJECTORY, write_results
from edvo.report.tracking import Run, track_source

PICTURE = "demo.png"
TRUTH = "groundtruth.txt"


def demo(out: Path, *, seconds: float, preset: str | None, seed: int) -> None:
    """Make sequences with known truth, track and draw them; see `edvo.cli.app.demo`."""
    begin = time.perf_counter()
    config = configure(preset, None, [], seed)
    folder = output_folder(out)
    cv2.setNumThreads(1)
    with renderer_compiling_aside():
        compile_now(config)
    scores, pictures = {}, []
    for scene in SCENES:
        run = _track(scene, config, seconds=seconds, seed=seed)
        truth = run.source.ground_truth
        if truth is None:
            raise EvaluationError(f"{scene}: a made sequence must have truth")
        errors = evaluate(truth, run.trajectory(), len(run.frames))
        # The first one, the hard one, lies in the folder itself.
        place = folder if scene == SCENES[0] else output_folder(folder / scene)
        write_results(run, place, config, errors)
        truth.write(place / TRUTH)
        say(f"{scene}: {speed_line(run)}")
        scores[scene] = errors
        pictures.append(picture_of(run, truth, errors, config))
    say()
    say(score_table(scores))
    title = f"edvo, preset {config.preset_name}: synthetic sequences under light that changes"
    draw_scenes(folder / PICTURE, pictures, title=title)
    say()
    say(f"wrote {folder / PICTURE} and {folder / TRAJECTORY} ({time.perf_counter() - begin:.0f} s)")


def _track(scene: str, config: Config, *, seconds: float, seed: int) -> Run:
    source = demo_source(scene, seconds=seconds, seed=seed)
    clock = StageClock()
    odometry = Odometry(source.camera, config, clock=clock)
    with stop_on_interrupt() as stop, progress(scene, len(source)) as advance:
        run = track_source(
            source, odometry, clock=clock, on_frame=lambda record: advance(), stop=stop
        )
    if run.interrupted:
        note(f"interrupted; nothing is written of {scene}")
        raise typer.Exit(INTERRUPTED)
    return run
