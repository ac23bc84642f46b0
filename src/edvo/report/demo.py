"""What `edvo demo` shows: sequences made on the spot, and the picture of each one tracked."""

from edvo.config import Config
from edvo.datasets import Source
from edvo.edges import extract_edges
from edvo.errors import DatasetError
from edvo.evaluation import Evaluation
from edvo.report.plots import Scene
from edvo.report.tracking import Run
from edvo.synthesis.relighting import Relighter, RelitSource
from edvo.synthesis.sequence import SyntheticSource, make_recipe
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
