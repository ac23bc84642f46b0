"""Sequences with known truth: in memory as a source, or written in TUM layout."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.cores import usable_cores
from edvo.datasets.association import stamped_delay
from edvo.datasets.incomplete import being_written
from edvo.datasets.source import Reading, check_index, describe_timing
from edvo.errors import FrameError, OutputError, SceneError
from edvo.files import output_folder, write_atomically
from edvo.frame import Frame
from edvo.synthesis.clock import Clock
from edvo.synthesis.depth_sensors import DepthSensor, depth_sensor, encode_depth
from edvo.synthesis.geometry import World
from edvo.synthesis.image_sensor import AutoExposure, ImageSensor
from edvo.synthesis.light import LightSignal, LightState
from edvo.synthesis.motion import Motion, make_motion
from edvo.synthesis.randomness import generator
from edvo.synthesis.renderer import Renderer, Rendering, Shutter
from edvo.synthesis.scene import Scene, load_scene
from edvo.synthesis.scene_lights import scene_light
from edvo.trajectory import Trajectory

TRUTH_RATE = 100.0  # Hz, as the motion capture of the TUM sequences
#: The camera of the TUM fr3 sequences.
DEFAULT_CAMERA = Camera(640, 480, 535.4, 539.2, 320.1, 247.6, depth_scale=5000.0)
_PAIRING = 0.02  # s between colour and depth, as the TUM tools allow
_METER = 8  # the light meter looks at every eighth pixel
_LISTS = ("rgb.txt", "depth.txt", "groundtruth.txt")


@dataclass(frozen=True)
class Recipe:
    """All that decides what a synthetic sequence looks like.

    Parameters
    ----------
    scene : Scene
        What is seen.
    motion : Motion
        The camera's way.
    frames : int
        How many images of each kind.
    camera : Camera
        Both of colour and of depth.
    depth : DepthSensor
        What is made of the true depth.
    image : ImageSensor
        What is made of the light.
    noise : bool
        False takes images without photon and read noise.
    exposure : AutoExposure, optional
        Fixed at 1 without.
    light : LightSignal, optional
        The scene's own constant lamps without.
    shutter : Shutter
        Motion blur and rolling shutter.
    colour_clock, depth_clock : Clock
        When images are taken.
    seed : int
        Of all noise.

    Raises
    ------
    SceneError
        If there are no frames, or the motion ends before the frames do.
    """

    scene: Scene
    motion: Motion
    frames: int = 300
    camera: Camera = DEFAULT_CAMERA
    depth: DepthSensor = field(default_factory=lambda: depth_sensor("kinect_v1"))
    image: ImageSensor = field(default_factory=ImageSensor)
    noise: bool = True
    exposure: AutoExposure | None = None
    light: LightSignal | None = None
    shutter: Shutter = field(default_factory=Shutter)
    colour_clock: Clock = field(default_factory=Clock)
    depth_clock: Clock = field(default_factory=Clock)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise SceneError(f"{self.frames} frames; ask for at least 1")
        if self.seed < 0:
            raise SceneError(f"seed {self.seed}; give 0 or more")
        last = max(float(self.colour_times[-1]), float(self.depth_times[-1]))
        if last > self.motion.duration:
            raise SceneError(
                f"{self.frames} frames last {last:.2f} s but the trajectory ends after "
                f"{self.motion.duration:.2f} s; ask for fewer frames"
            )

    @cached_property
    def colour_times(self) -> NDArray[np.float64]:
        """Seconds of the colour images, shape (frames,), to the microsecond."""
        rng = generator(self.seed, "colour clock")
        return np.round(self.colour_clock.times(self.frames, rng), 6)

    @cached_property
    def depth_times(self) -> NDArray[np.float64]:
        """Seconds of the depth images, shape (frames,), to the microsecond."""
        rng = generator(self.seed, "depth clock")
        return np.round(self.depth_clock.times(self.frames, rng), 6)

    def truth(self) -> Trajectory:
        """Give the true poses: 100 Hz from the first to the last image, and each colour stamp."""
        first = min(self.colour_times[0], self.depth_times[0])
        last = max(self.colour_times[-1], self.depth_times[-1])
        regular = first + np.arange(int(np.floor((last - first) * TRUTH_RATE)) + 1) / TRUTH_RATE
        times = np.unique(np.round(np.concatenate([regular, self.colour_times]), 6))
        poses = np.array([self.motion.at(float(t)) for t in times])
        return Trajectory(times, poses, tuple(_stamp(t) for t in times))


def make_recipe(
    scene: str | Path | Scene,
    *,
    frames: int = 300,
    camera: Camera = DEFAULT_CAMERA,
    sensor: str = "kinect_v1",
    trajectory: str | Path = "handheld",
    speed: float | None = None,
    light: str | LightSignal | None = None,
    seed: int = 0,
    **more: Any,
) -> Recipe:
    """Put a recipe together by names.

    Parameters
    ----------
    scene : str, path or Scene
        See `edvo.synthesis.scene.load_scene`.
    frames : int
        How many.
    camera : Camera
        Pinhole with distortion.
    sensor : str
        See `edvo.synthesis.depth_sensors.depth_sensor`.
    trajectory : str or path
        See `edvo.synthesis.motion.make_motion`.
    speed : float, optional
        Metres per second; what suits the scene by default.
    light : str or LightSignal, optional
        See `edvo.synthesis.scene_lights.scene_light`; the scene's own constant lamps by default.
    seed : int
        Of tremor, light and noise.
    **more
        The other fields of `Recipe`.

    Returns
    -------
    Recipe
        The recipe.

    Raises
    ------
    SceneError
        For names that do not exist, naming those that do, and values that cannot be.
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    if seed < 0:
        raise SceneError(f"seed {seed}; give 0 or more")
    motion = make_motion(trajectory, scene.camera, speed=speed, seed=seed)
    if isinstance(light, str):
        light = scene_light(light, scene.lights.state(), seed=seed)
    depth = depth_sensor(sensor)
    return Recipe(scene, motion, frames, camera, depth, light=light, seed=seed, **more)


class SyntheticSource:
    """A synthetic sequence as a source of frames, rendered when asked for.

    Any frame can be read at any time, from several threads at once, and is the same each time; it
    is also the same as after writing the sequence and reading it from the files.

    Parameters
    ----------
    recipe : Recipe
        What to make.
    threads : int
        Threads that render one frame; one by default, since whoever reads ahead has several.
    """

    format = "synthetic"
    camera_origin = "synthetic"
    warnings: tuple[str, ...] = ()

    def __init__(self, recipe: Recipe, *, threads: int = 1) -> None:
        self.recipe = recipe
        self.camera = recipe.camera
        self._renderer = Renderer(World(recipe.scene), recipe.camera, threads=threads)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return Path(self.recipe.scene.name).stem

    @property
    def path(self) -> Path:
        """Where it would lie: there are no files."""
        return Path(self.recipe.scene.name)

    @cached_property
    def ground_truth(self) -> Trajectory:
        """True poses, T_world_cam."""
        return self.recipe.truth()

    @cached_property
    def stamps(self) -> tuple[str, ...]:
        """Time of each colour image."""
        return tuple(_stamp(t) for t in self.recipe.colour_times)

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Time of each colour image in seconds."""
        return self.recipe.colour_times

    @cached_property
    def exposures(self) -> NDArray[np.float64]:
        """Exposure of each frame, shape (N,): 1 without automatic exposure."""
        recipe = self.recipe
        if recipe.exposure is None:
            return np.ones(recipe.frames)
        meter = Renderer(
            self._renderer.world, recipe.camera.scaled(1.0 / _METER), samples=1, threads=1
        )
        times = [float(t) for t in recipe.colour_times]
        levels = []
        for t in times:
            light = None if recipe.light is None else recipe.light.at(t)
            view = meter.render(recipe.motion.at(t), t=t, light=light)
            levels.append(float(view.colour.mean(dtype=np.float64)))
        return recipe.exposure.exposures(times, levels)

    def __len__(self) -> int:
        """Count the frames."""
        return self.recipe.frames

    def render(self, index: int) -> Rendering:
        """Render what the colour camera sees, before any sensor.

        Parameters
        ----------
        index : int
            Which frame.

        Returns
        -------
        Rendering
            The view at its stamp.
        """
        recipe = self.recipe
        t = float(recipe.colour_times[index])
        return self._renderer.expose(
            recipe.motion.at, t, light=recipe.light, shutter=recipe.shutter
        )

    def colour(self, index: int, rendering: Rendering | None = None) -> NDArray[np.uint8]:
        """Take a colour image.

        Parameters
        ----------
        index : int
            Which frame.
        rendering : Rendering, optional
            Of this frame, if it is at hand.

        Returns
        -------
        (H, W, 3) uint8
            Red, green, blue.
        """
        recipe = self.recipe
        rng = generator(recipe.seed, "image noise", index) if recipe.noise else None
        view = rendering or self.render(index)
        exposure = float(self.exposures[index])
        return recipe.image.expose(view.colour, recipe.camera, rng, exposure=exposure)

    def depth(self, index: int, rendering: Rendering | None = None) -> NDArray[np.uint16]:
        """Take a depth image.

        Parameters
        ----------
        index : int
            Which depth image; it has its own stamp.
        rendering : Rendering, optional
            Of the colour frame with this index: used where both are taken at one instant, and all
            rows of the colour image, too. Depth is always taken at once.

        Returns
        -------
        (H, W) uint16
            The camera's ``depth_scale`` is one metre; 0 is missing.
        """
        recipe = self.recipe
        t = float(recipe.depth_times[index])
        apart = recipe.shutter.readout > 0 or t != recipe.colour_times[index]
        if rendering is None or apart:
            rendering = self._renderer.render(recipe.motion.at(t), t=t, light=LightState(0.0))
        rng = generator(recipe.seed, "depth noise", index)
        surface = self._renderer.surface(rendering)
        measured = recipe.depth.measure(rendering.depth, recipe.camera, rng, surface)
        return encode_depth(measured, recipe.camera.depth_scale)

    def read(self, index: int) -> Reading:
        """Take one frame: a colour image and the depth image nearest in time.

        Parameters
        ----------
        index : int
            Which frame.

        Returns
        -------
        Reading
            With a problem in place of the frame where no depth image is within 20 ms.

        Raises
        ------
        DatasetError
            Where there is no frame of that index.
        """
        check_index(index, self.stamps, self.name)
        recipe = self.recipe
        t = float(recipe.colour_times[index])
        partner = int(np.argmin(np.abs(recipe.depth_times - t)))
        stamp = self.stamps[index]
        if abs(recipe.depth_times[partner] - t) > _PAIRING:
            problem = f"{self.name} at {stamp}: no depth image within 20 ms"
            return Reading(index, stamp, t, None, problem)
        view = self.render(index)
        depth = self.depth(partner, view if partner == index else None)
        try:
            frame = Frame.from_images(
                t,
                self.colour(index, view),
                depth,
                depth_scale=recipe.camera.depth_scale,
                order="rgb",
                depth_delay=stamped_delay(t, float(recipe.depth_times[partner])),
            )
        except FrameError as error:
            return Reading(index, stamp, t, None, f"{self.name} at {stamp}: {error}")
        return Reading(index, stamp, t, frame, None)

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the sequence, in plain types."""
        return {
            "name": self.name,
            "format": self.format,
            "about": self.recipe.scene.about,
            "camera": self.camera.to_dict(),
            "camera_origin": self.camera_origin,
            "seed": self.recipe.seed,
            **describe_timing(self.timestamps),
        }


def write_sequence(
    source: SyntheticSource,
    folder: str | os.PathLike[str],
    *,
    command: str = "",
    redo: str = "",
    force: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a synthetic sequence in TUM layout: the same recipe gives the same bytes.

    Parameters
    ----------
    source : SyntheticSource
        What to write.
    folder : path-like
        Gets ``rgb/``, ``depth/``, ``camera.yaml``, ``README.txt`` and, when all images are there,
        ``groundtruth.txt``, ``depth.txt`` and ``rgb.txt``. Until then ``INCOMPLETE.txt`` keeps
        every reader from taking it for a whole one.
    command : str
        What the README says it was made with.
    redo : str
        What ``INCOMPLETE.txt`` says to do; the command again where not given.
    force : bool
        Write into a folder that is not empty.
    workers : int, optional
        Threads, each with a frame of its own; as many as the process may use by default.
    progress : callable, optional
        Called with frames done and frames in all.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    OutputError
        If the folder is not empty (without ``force``) or cannot be written.
    """
    target = output_folder(folder, must_be_empty=True, force=force)
    what = f"synthetic sequence {source.recipe.scene.name!r}"
    if not redo:
        redo = f"{command} --force" if command else "write_sequence(..., force=True)"
    with being_written(target, what, redo):
        _write(source, target, command, workers, progress)
    return target


def _write(
    source: SyntheticSource,
    target: Path,
    command: str,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> None:
    recipe = source.recipe
    try:
        for name in _LISTS:
            (target / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot replace {target / name}: {error.strerror}") from error
    output_folder(target / "rgb")
    output_folder(target / "depth")

    def write(index: int) -> None:
        view = source.render(index)
        colour = source.colour(index, view)[:, :, ::-1]
        _write_png(target / _file("rgb", recipe.colour_times[index]), colour)
        depth = source.depth(index, view)
        _write_png(target / _file("depth", recipe.depth_times[index]), depth)

    _ = source.exposures  # once, before several threads want it
    pool = ThreadPoolExecutor(workers or usable_cores())
    try:
        for done, _nothing in enumerate(pool.map(write, range(len(source))), start=1):
            if progress is not None:
                progress(done, len(source))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)

    recipe.camera.to_yaml(target / "camera.yaml")
    write_atomically(target / "README.txt", _readme(recipe, command))
    source.ground_truth.write(target / "groundtruth.txt")
    write_atomically(target / "depth.txt", _list("depth", recipe.depth_times))
    write_atomically(target / "rgb.txt", _list("rgb", recipe.colour_times))


def _stamp(t: float) -> str:
    return f"{t:.6f}"


def _file(kind: str, t: float) -> str:
    return f"{kind}/{_stamp(t)}.png"


def _list(kind: str, times: Sequence[float] | NDArray[np.float64]) -> str:
    rows = [f"# {'colour' if kind == 'rgb' else 'depth'} images", "# timestamp filename"]
    rows += [f"{_stamp(t)} {_file(kind, t)}" for t in times]
    return "\n".join(rows) + "\n"


def _write_png(path: Path, image: NDArray[Any]) -> None:
    done, data = cv2.imencode(".png", np.ascontiguousarray(image), [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise OutputError(f"cannot encode {path}; this is no image size for PNG")
    write_atomically(path, data.tobytes())


def _readme(recipe: Recipe, command: str) -> str:
    lines = [
        f"Synthetic RGB-D sequence {recipe.scene.name!r}: {recipe.scene.about}.",
        f"{recipe.frames} frames, seed {recipe.seed}, ground truth T_world_cam at "
        f"{TRUTH_RATE:.0f} Hz and at each colour stamp, exact.",
        "TUM RGB-D layout; camera.yaml holds the camera and the depth scale.",
    ]
    if command:
        lines.append(f"Made by: {command}")
    return "\n".join(lines) + "\n"
