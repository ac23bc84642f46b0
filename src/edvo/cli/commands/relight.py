"""Arguments and options of `edvo relight`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import CameraFile, Frequency, Jumps, Overwrite, Target


def relight(
    source: Annotated[
        Path | None, typer.Argument(help="A folder in TUM layout.", metavar="SOURCE")
    ] = None,
    target: Target = None,
    model: Annotated[
        str,
        typer.Option(help="Model of light, or several joined by +; --list shows them."),
    ] = "ambient+diffuse",
    severity: Annotated[
        float,
        typer.Option(help="How hard the light changes: 0 leaves it as it is.", min=0.0, max=1.0),
    ] = 0.5,
    frequency: Frequency = None,
    seed: Annotated[int, typer.Option(help="Of jumps, paths and noise.", min=0)] = 0,
    jump: Jumps = None,
    camera: CameraFile = None,
    force: Overwrite = False,
    list_: Annotated[bool, typer.Option("--list", help="Show the models of light.")] = False,
) -> None:
    """Write a recording once more under another light.

    Colour images are lit anew; depth, lists and truth are copied byte by byte. The same options
    and seed give the same bytes.
    """
    from edvo.cli import relight as body

    if list_:
        body.list_models()
        return
    if source is None or target is None:
        raise typer.BadParameter("give SOURCE and DIR, or --list")
    body.relight(
        source,
        target,
        model=model,
        severity=severity,
        frequency=frequency,
        seed=seed,
        jumps=sorted(set(jump)) if jump else None,
        camera=camera,
        force=force,
    )
