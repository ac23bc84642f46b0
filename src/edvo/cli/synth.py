"""`edvo synth`."""

import os
import shlex
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from edvo.cli.terminal import Advance, progress, say
from edvo.datasets.known_cameras import KNOWN_CAMERAS, find_camera
from edvo.synthesis.clock import Clock
from edvo.synthesis.contact_sheet import contact_sheet
from edvo.synthesis.image_sensor import AutoExposure
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.scene import load_scene, scene_names
from edvo.synthesis.scene_lights import scene_light
from edvo.synthesis.sequence import (
    DEFAULT_CAMERA,
    SyntheticSource,
    make_recipe,
    write_sequence,
)

_BLUR_STEPS = 5  # instants that a blurred image is the mean of
_DEPTH_JITTER = 0.001  # s, as between the cameras of a Kinect


def list_scenes(sheet: Path) -> None:
    """Say which scenes there are, and write a picture of each into a contact sheet.

    Parameters
    ----------
    sheet : path
        A PNG file; written anew.
    """
    names = scene_names()
    with progress("drawing thumbnails", len(names)) as advance:
        contact_sheet(names, sheet, advance)
    width = max(map(len, names))
    for name in names:
        say(f"{name.ljust(width)}  {load_scene(name).about}")
    say(f"wrote {sheet}")


def synth(
    scene: str,
    target: Path,
    *,
    frames: int,
    camera: str | None,
    sensor: str,
    trajectory: str,
    speed: float | None,
    light: str,
    severity: float,
    frequency: float | None,
    jumps: list[float] | None,
    exposure: float,
    readout: float,
    auto_exposure: bool,
    depth_delay: float,
    seed: int,
    force: bool,
) -> None:
    """Write a synthetic sequence; see `edvo.cli.commands.synth`."""
    data = load_scene(scene)
    recipe = make_recipe(
        data,
        frames=frames,
        camera=DEFAULT_CAMERA if camera is None else find_camera(camera),
        sensor=sensor,
        trajectory=trajectory,
        speed=speed,
        light=scene_light(
            light,
            data.lights.state(),
            severity=severity,
            frequency=frequency,
            seed=seed,
            jumps=jumps,
        ),
        seed=seed,
        shutter=Shutter(exposure, _BLUR_STEPS if exposure else 1, readout),
        exposure=AutoExposure() if auto_exposure else None,
        depth_clock=Clock(offset=depth_delay, jitter=_DEPTH_JITTER) if depth_delay else Clock(),
    )
    # The command that an interruption leaves works from anywhere.
    camera_here = camera
    if camera is not None and camera not in KNOWN_CAMERAS:
        camera_here = str(Path(camera).absolute())
    scene_here = scene if scene in scene_names() else str(Path(scene).absolute())
    options: dict[str, object] = {
        "frames": frames,
        "camera": camera,
        "sensor": sensor,
        "trajectory": trajectory,
        "speed": speed,
        "light": light,
        "severity": severity,
        "frequency": frequency,
        "exposure": exposure or None,
        "readout": readout or None,
        "depth-delay": depth_delay or None,
        "seed": seed,
    }
    more = [word for instant in jumps or [] for word in ("--jump", str(instant))]
    if auto_exposure:
        more.append("--auto-exposure")
    words = [*_words(options), *more]
    redo = [*_words({**options, "camera": camera_here}), *more, "--force"]
    # ".." is no name, and a link has its own.
    place = Path(os.path.realpath(target)) if ".." in target.parts else target.absolute()
    with ExitStack() as bars:
        advance: Advance | None = None

        def step(done: int, total: int) -> None:
            nonlocal advance
            if advance is None:
                advance = bars.enter_context(progress(f"rendering {data.name}", total))
            advance()

        folder = write_sequence(
            SyntheticSource(recipe),
            target,
            # What is written is the same wherever that is; what an interruption leaves is not.
            command=shlex.join(["edvo", "synth", scene, place.name, *words]),
            redo=shlex.join(["edvo", "synth", scene_here, str(place), *redo]),
            force=force,
            progress=step,
        )
    say(f"{frames} frames of {data.name} in {folder}")


def _words(options: Mapping[str, object]) -> list[str]:
    given = [(name, value) for name, value in options.items() if value is not None]
    return [word for name, value in given for word in (f"--{name}", str(value))]
