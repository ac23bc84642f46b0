"""What `edvo demo` shows: sequences made on the spot, and the picture of each one tracked."""

from collections.abc import Mapping, Sequence

import numpy as np

from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets import Source
from edvo.edges import extract_edges
from edvo.evaluation import Evaluation
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.report.animation import DrawnPath, Film, Moment
from edvo.report.elsewhere import Elsewhere
from edvo.report.plots import ESTIMATE_COLOUR, MOTION_COLOUR, Scene
from edvo.report.sights import Sight, look_again
from edvo.report.tracking import FrameRecord, Run
from edvo.synthesis.relighting import Relighter, RelitSource
from edvo.synthesis.sequence import DEFAULT_CAMERA, Recipe, SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

SCENE = "notexture_far"
"""Shown where no other is asked for: plain panels, which little but edges tells apart."""

FRAME_RATE_HZ = 30.0
FLICKER_HZ = 2.0

_MOST_MOMENTS = 50
# Small images that show how the light changes, apart by no multiple of its period.
_VIEWS = 5
_VIEW_STEP = 6


def demo_recipe(scene: str, *, seconds: float, seed: int = 0) -> Recipe:
    """Choose a short sequence with known truth, before anything is compiled for it.

    Parameters
    ----------
    scene : str
        One of `edvo.synthesis.scene.scene_names`, or a YAML file.
    seconds : float
        Its length.
    seed : int
        Of motion and noise.

    Returns
    -------
    Recipe
        A hand-held Kinect's.

    Raises
    ------
    SceneError
        If there is no such scene.
    """
    return make_recipe(scene, frames=max(2, round(seconds * FRAME_RATE_HZ)), seed=seed)


def demo_source(recipe: Recipe) -> Source:
    """Put a sequence under light that swings, moves and jumps.

    Parameters
    ----------
    recipe : Recipe
        See `demo_recipe`; its seed is the light's too.

    Returns
    -------
    Source
        Frames rendered as they are read, relit by the paper's ambient and diffuse models
        (section V-A).
    """
    light = Relighter("ambient+diffuse", frequency=FLICKER_HZ, seed=recipe.seed)
    return RelitSource(SyntheticSource(recipe), light)


def render_one() -> None:
    """Render a small frame, which compiles the renderer."""
    small = DEFAULT_CAMERA.scaled(0.1)
    SyntheticSource(make_recipe(SCENE, frames=1, camera=small)).read(0)


def renderer_compiling_aside() -> Elsewhere:
    """Start to compile the renderer in a process of its own.

    Returns
    -------
    Elsewhere
    """
    aside = Elsewhere(render_one)
    aside.start()
    return aside


class Watched:
    """Hands frames on to edvo, and keeps some of them with what became of them.

    Parameters
    ----------
    odometry : Odometry
        What tracks.
    step : int
        Every so many frames one is kept.

    Attributes
    ----------
    tracker : Odometry
        That one; what it has measured of the camera goes into the summary.
    """

    def __init__(self, odometry: Odometry, step: int) -> None:
        self.sights: list[Sight] = []
        self.tracker = odometry
        self._step = step

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of a frame."""
        result = self.tracker.track(frame)
        if result.index % self._step == 0:
            self.sights.append(Sight(frame, result))
        return result

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be read."""
        return self.tracker.skip(timestamp, reason)


def film_step(frames: int) -> int:
    """Choose every how many frames one is drawn: 15 a second, fewer of a long sequence."""
    return max(2, -(-frames // _MOST_MOMENTS))


def film_of(
    runs: Mapping[str, Run],
    evaluations: Mapping[str, Evaluation],
    sights: Sequence[Sight],
    truth: Trajectory,
    config: Config,
) -> Film:
    """Put together an animation of a demo.

    Parameters
    ----------
    runs : mapping of str to Run
        Of each tracker, edvo first, over the same frames.
    evaluations : mapping of str to Evaluation
        Their errors.
    sights : sequence of Sight
        What was kept of edvo's run; at least one.
    truth : Trajectory
        True poses.
    config : Config
        Of edvo.

    Returns
    -------
    Film
        For `edvo.report.animation.draw_film`.
    """
    first = next(iter(runs.values()))
    colours = (ESTIMATE_COLOUR, MOTION_COLOUR)
    paths = [
        DrawnPath(
            label=_label(name, evaluations[name]),
            colour=colour,
            T_world_cam=np.array([record.T_world_cam for record in run.frames]),
            lost=np.array([record.status is Status.LOST for record in run.frames]),
        )
        for colour, (name, run) in zip(colours, runs.items(), strict=False)
    ]
    return Film(
        title=f"edvo demo: {first.source.name}, light that flickers at {FLICKER_HZ:g} Hz and jumps",
        timestamps=np.array([record.timestamp for record in first.frames]),
        truth=truth,
        paths=paths,
        moments=[_moment(sight, runs, first.source.camera, config) for sight in sights],
        moment_s=min(film_step(len(first.frames)) / FRAME_RATE_HZ, 0.1),
    )


def _moment(sight: Sight, runs: Mapping[str, Run], camera: Camera, config: Config) -> Moment:
    index, seen = sight.result.index, look_again(sight, camera, config)
    return Moment(
        index=index,
        grey=seen.grey,
        pixels=seen.pixels,
        gradients=seen.gradients,
        samples=seen.samples,
        references=seen.references,
        residuals=seen.residuals,
        words=[_words(name, run.frames[index]) for name, run in runs.items()],
    )


def _words(name: str, record: FrameRecord) -> str:
    found = record.registration
    lines = [f"{name}: {record.status.value}"]
    if record.track_s is not None:
        lines[0] += f", {1e3 * record.track_s:.1f} ms"
    if record.is_keyframe:
        lines.append("new keyframe")
    elif record.status is Status.LOST:
        lines.append(record.reason)
    elif found is not None and not found.matches:
        lines.append(f"depth alone: {found.plane_points} points on planes")
    elif found is not None:
        lines.append(
            f"{found.inliers} of {record.samples} samples fit, sigma {found.sigma_px:.2f} px"
        )
    else:
        lines.append(f"keyframe {record.keyframe}")
    return "\n".join(lines)


def _label(name: str, evaluation: Evaluation) -> str:
    if evaluation.rpe is None:
        return name
    return f"{name}: RPE {evaluation.rpe.rmse:.4f} m/s"


def picture_of(
    run: Run,
    sights: Sequence[Sight],
    truth: Trajectory,
    evaluation: Evaluation,
    config: Config,
) -> Scene:
    """Choose what to draw of a tracked sequence: a frame from its middle, path and errors.

    Parameters
    ----------
    run : Run
        The sequence.
    sights : sequence of Sight
        What was kept of it; at least one.
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
    """
    middle = sights[len(sights) // 2]
    grey, result = middle.frame.grey, middle.result
    edges = extract_edges(
        grey, config.edges, scale=result.edge_scale, passes=result.edge_passes
    ).describe(run.source.camera)
    return Scene(
        title=run.source.name,
        grey=grey,
        others=[sight.frame.grey for sight in sights[::_VIEW_STEP][:_VIEWS]],
        pixels=edges.pixels,
        gradients=edges.gradients,
        reference=truth,
        estimate=run.trajectory(),
        evaluation=evaluation,
    )
