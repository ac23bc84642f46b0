"""`edvo demo`."""

import time
from pathlib import Path

import cv2
import typer

from edvo.baselines.opencv import opencv_odometry
from edvo.camera import Camera
from edvo.cli.compiling import compile_now
from edvo.cli.configuration import configure
from edvo.cli.interrupt import stop_on_interrupt
from edvo.cli.run import remove_earlier
from edvo.cli.scores import score_table, speed_line
from edvo.cli.terminal import note, progress, say
from edvo.clock import StageClock
from edvo.errors import MissingExtraError
from edvo.evaluation import evaluate
from edvo.files import output_folder
from edvo.odometry import Odometry
from edvo.report.animation import draw_film
from edvo.report.demo import (
    Watched,
    demo_recipe,
    demo_source,
    film_of,
    film_step,
    picture_of,
    renderer_compiling_aside,
)
from edvo.report.plots import draw_scenes
from edvo.report.results import RESULTS, TRAJECTORY, write_results
from edvo.report.tracking import Tracker, track_together

ANIMATION = "demo.webp"
PICTURE = "demo.png"
TRUTH = "groundtruth.txt"
EDVO = "edvo"


def demo(out: Path, *, scene: str, seconds: float, preset: str | None, seed: int) -> None:
    """Make a sequence with known truth, track and draw it; see `edvo.cli.commands.demo`."""
    begin = time.perf_counter()
    config = configure(preset, None, [], seed)
    recipe = demo_recipe(scene, seconds=seconds, seed=seed)
    truth = recipe.truth()
    folder = output_folder(out, files=[*RESULTS, TRUTH, PICTURE, ANIMATION])
    cv2.setNumThreads(1)
    with renderer_compiling_aside():
        compile_now(config)
    source = demo_source(recipe)
    clock = StageClock()
    edvo = Watched(Odometry(source.camera, config, clock=clock), film_step(len(source)))
    trackers: dict[str, Tracker] = {EDVO: edvo, **_opencv(source.camera)}
    clocks = [clock, *[None] * (len(trackers) - 1)]
    with stop_on_interrupt() as stop, progress(source.name, len(source)) as advance:
        tracked = track_together(
            source, [*trackers.values()], clocks=clocks, on_frame=lambda _: advance(), stop=stop
        )
    runs = dict(zip(trackers, tracked, strict=True))
    if runs[EDVO].interrupted:
        note("interrupted; nothing is written")
        raise typer.Exit(stop.status)
    scores = {
        name: evaluate(truth, run.trajectory(), len(run.frames)) for name, run in runs.items()
    }
    write_results(runs[EDVO], folder, config, scores[EDVO])
    truth.write(folder / TRUTH)
    for name, run in runs.items():
        if name != EDVO:
            run.trajectory().write(folder / f"{name}.txt")
    say(f"{source.name}: {speed_line(runs[EDVO])}")
    say()
    say(score_table(scores, runs))
    title = f"edvo, preset {config.preset_name}: a synthetic sequence under light that changes"
    picture = picture_of(runs[EDVO], edvo.sights, truth, scores[EDVO], config)
    draw_scenes(folder / PICTURE, [picture], title=title)
    draw_film(folder / ANIMATION, film_of(runs, scores, edvo.sights, truth, config))
    remove_earlier(folder)
    say()
    files = f"{folder / ANIMATION}, {PICTURE} and {TRAJECTORY}"
    say(f"wrote {files} ({time.perf_counter() - begin:.0f} s)")


def _opencv(camera: Camera) -> dict[str, Tracker]:
    """Give OpenCV's odometry, if the OpenCV that is installed has it."""
    try:
        odometry = opencv_odometry(camera, "rgbd")
    except MissingExtraError as error:
        note(str(error))
        return {}
    return {odometry.name: odometry}
