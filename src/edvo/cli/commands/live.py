"""Arguments and options of `edvo live`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import (
    CameraFile,
    ConfigFile,
    MaskFile,
    Overrides,
    Preset,
    SaveView,
    Seed,
    View,
)


def live(
    device: Annotated[
        str | None,
        typer.Argument(
            help="A camera, such as realsense or realsense:SERIAL, or replay:RECORDING.",
            metavar="DEVICE",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for results.", metavar="DIR")
    ] = None,
    preset: Preset = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    seed: Seed = None,
    camera: CameraFile = None,
    mask: MaskFile = None,
    max_frames: Annotated[
        int | None, typer.Option(help="End after so many tracked frames.", min=1)
    ] = None,
    view: View = False,
    save_view: SaveView = None,
    list_: Annotated[bool, typer.Option("--list", help="Show what DEVICE can be.")] = False,
) -> None:
    """Track a camera, dropping frames rather than falling behind.

    Goes on until Ctrl-C and then writes to DIR what `edvo run` writes. replay:RECORDING plays a
    recording at its own pace, for who has no camera at hand.
    """
    from edvo.cli import live as body

    if list_:
        body.list_devices()
        return
    if device is None or out is None:
        raise typer.BadParameter("give DEVICE and -o DIR, or --list")
    body.live(
        device,
        out,
        preset=preset,
        config_file=config,
        overrides=overrides or [],
        seed=seed,
        camera=camera,
        mask=mask,
        max_frames=max_frames,
        view=view,
        save_view=save_view,
    )
