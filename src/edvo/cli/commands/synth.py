"""Arguments and options of `edvo synth`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import CameraFile, Frequency, Jumps, Overwrite, Target


def synth(
    scene: Annotated[
        str | None, typer.Argument(help="Name of a scene, or a YAML file.", metavar="SCENE")
    ] = None,
    target: Target = None,
    frames: Annotated[int, typer.Option(help="How many, at 30 a second.", min=1)] = 300,
    camera: CameraFile = None,
    sensor: Annotated[
        str, typer.Option(help="Depth camera: ideal, kinect_v1, realsense_d435, azure_kinect, ...")
    ] = "kinect_v1",
    trajectory: Annotated[
        str,
        typer.Option(help="handheld, orbit, still, rotation, jerk, or a TUM trajectory file."),
    ] = "handheld",
    speed: Annotated[
        float | None, typer.Option(help="Metres a second; what suits the scene by default.")
    ] = None,
    light: Annotated[
        str,
        typer.Option(help="constant, ambient, diffuse, exposure, fade, or several joined by +."),
    ] = "constant",
    severity: Annotated[
        float, typer.Option(help="How hard the light changes.", min=0.0, max=1.0)
    ] = 0.5,
    frequency: Frequency = None,
    jump: Jumps = None,
    exposure: Annotated[
        float,
        typer.Option(
            help="How long an image gathers light: motion blur.",
            min=0.0,
            max=1 / 30,
            metavar="SECONDS",
        ),
    ] = 0.0,
    readout: Annotated[
        float,
        typer.Option(
            help="From the first row of a colour image to the last: rolling shutter.",
            min=0.0,
            max=1 / 30,
            metavar="SECONDS",
        ),
    ] = 0.0,
    auto_exposure: Annotated[
        bool, typer.Option("--auto-exposure", help="Follow the light, a quarter of a second late.")
    ] = False,
    depth_delay: Annotated[
        float,
        typer.Option(
            help="Take depth so long after colour, and not quite regularly.",
            min=0.0,
            max=0.02,
            metavar="SECONDS",
        ),
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of tremor, light and noise.", min=0)] = 0,
    force: Overwrite = False,
    list_: Annotated[
        bool, typer.Option("--list", help="Show the scenes and write a contact sheet.")
    ] = False,
    sheet: Annotated[
        Path, typer.Option(help="Where --list writes its thumbnails.", metavar="FILE.png")
    ] = Path("edvo-scenes.png"),
) -> None:
    """Make an RGB-D sequence with exact truth, in TUM layout.

    The same options and seed give the same bytes. --list shows what scenes there are.
    """
    from edvo.cli import synth as body

    if list_:
        body.list_scenes(sheet)
        return
    if scene is None or target is None:
        raise typer.BadParameter("give SCENE and DIR, or --list")
    body.synth(
        scene,
        target,
        frames=frames,
        camera=camera,
        sensor=sensor,
        trajectory=trajectory,
        speed=speed,
        light=light,
        severity=severity,
        frequency=frequency,
        jumps=sorted(set(jump)) if jump else None,
        exposure=exposure,
        readout=readout,
        auto_exposure=auto_exposure,
        depth_delay=depth_delay,
        seed=seed,
        force=force,
    )
