"""What `edvo demo` shows: sequences made on the spot, and the picture of each one tracked."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from edvo.config import Config
from edvo.datasets import Source
from edvo.edges import extract_edges
from edvo.errors import DatasetError
from edvo.evaluation import Evaluation
from edvo.report.plots import Scene
from edvo.report.tracking import Run
from edvo.report.warmup import cache_folder
from edvo.synthesis.relighting import Relighter, RelitSource
from edvo.synthesis.sequence import DEFAULT_CAMERA, SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

SCENES = ("notexture_far", "texture_far")
"""Without texture and with it; the first is the hard one."""

FRAME_RATE_HZ = 30.0
FLICKER_HZ = 2.0

# Small images that show how the light changes: 11 frames apart, which is no multiple of its period.
_VIEWS = 5
_VIEW_STEP = 11


def demo_source(scene: str, *, seconds: float, seed: int = 0) -> Source:
    """Make a short sequence with known truth, under light that swings, moves and jumps.

    Parameters
    ----------
    scene : str
        One of `edvo.synthesis.scene.scene_names`.
    seconds : float
        Its length.
    seed : int
        Of motion, noise and light.

    Returns
    -------
    Source
        Frames of a hand-held Kinect, rendered as they are read, relit by the paper's ambient and
        diffuse models (section V-A).

    Raises
    ------
    SceneError
        If there is no such scene.
    """
    frames = max(2, round(seconds * FRAME_RATE_HZ))
    still_light = SyntheticSource(make_recipe(scene, frames=frames, seed=seed))
    light = Relighter("ambient+diffuse", frequency=FLICKER_HZ, seed=seed)
    return RelitSource(still_light, light)


def render_one() -> None:
    """Render a small frame, which compiles the renderer."""
    small = DEFAULT_CAMERA.scaled(0.1)
    SyntheticSource(make_recipe(SCENES[0], frames=1, camera=small)).read(0)


@contextmanager
def renderer_compiling_aside() -> Iterator[None]:
    """Compile the renderer in a process of its own, while this one compiles something else.

    A process compiles one function at a time, whatever the number of its threads; two processes
    halve the wait of who starts the demo for the first time. What is compiled meets in the cache.
    """
    if cache_folder() is None:
        yield
        return
    command = [sys.executable, "-c", f"from {__name__} import render_one; render_one()"]
    nothing = subprocess.DEVNULL
    # It is a matter of speed only: should it fail, this process compiles the renderer itself.
    with subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing) as aside:
        try:
            yield
        except BaseException:
            aside.kill()
            raise


def picture_of(run: Run, truth: Trajectory, evaluation: Evaluation, config: Config) -> Scene:
    """Choose what to draw of a tracked sequence: its middle frame with edges, path and errors.

    Parameters
    ----------
    run : Run
        The sequence; its source is read once more.
    truth : Trajectory
        True poses.
    evaluation : Evaluation
        The errors.
    config : Config
        How edges are found.

    Returns
    -------
    Scene
        For `edvo.report.plots.draw_scenes`.

    Raises
    ------
    DatasetError
        If that frame cannot be read.
    """
    source = run.source
    reading = source.read(len(source) // 2)
    if reading.frame is None:
        raise DatasetError(f"nothing to draw: {reading.problem}")
    others = [source.read(index).frame for index in range(0, len(source), _VIEW_STEP)[:_VIEWS]]
    edges = extract_edges(reading.frame.grey, config.edges).describe(source.camera)
    return Scene(
        title=source.name,
        grey=reading.frame.grey,
        others=[frame.grey for frame in others if frame is not None],
        pixels=edges.pixels,
        gradients=edges.gradients,
        reference=truth,
        estimate=run.trajectory(),
        evaluation=evaluation,
    )
