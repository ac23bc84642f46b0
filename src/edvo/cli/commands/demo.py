"""Arguments and options of `edvo demo`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import Out, Preset


def demo(
    out: Out = Path("edvo-demo"),
    scene: Annotated[
        str,
        typer.Option(help="Name of a scene, such as texture_far, or a YAML file.", metavar="SCENE"),
    ] = "notexture_far",
    seconds: Annotated[
        float, typer.Option(help="Length of the sequence.", min=1.5, max=60.0)
    ] = 3.0,
    preset: Preset = None,
    seed: Annotated[int, typer.Option(help="Seed of sequence and tracker.", min=0)] = 0,
) -> None:
    """Make a short sequence with known truth; track it, with OpenCV's odometry beside; draw both.

    Needs no data and no network: a scene without texture, under light that flickers at 2 Hz and
    jumps. Writes trajectory.txt and what else `edvo run` writes, the true poses, OpenCV's
    trajectory, demo.png and the animation demo.webp.
    """
    from edvo.cli.demo import demo as body

    body(out, scene=scene, seconds=seconds, preset=preset, seed=seed)
