"""Arguments and options of `edvo compare`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import (
    CameraFile,
    ColourTopic,
    DepthTopic,
    FormatName,
    MaxFrames,
    Start,
    Stride,
)


def compare(
    sources: Annotated[
        list[str],
        typer.Argument(
            help="Recordings, folders of recordings, or synth:SCENE for a rendered scene.",
            metavar="SOURCE",
        ),
    ],
    peers: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            help="Baselines and groups (opencv, open3d, all), joined by commas; with -f2f behind "
            "frame to frame. opencv-rgbd,opencv-rgb by default.",
            metavar="NAME,...",
        ),
    ] = None,
    trajectories: Annotated[
        list[str] | None,
        typer.Option(
            "--trajectory",
            help="Poses of a system that ran elsewhere (TUM format); may be repeated. {name} in "
            "FILE is the name of the sequence.",
            metavar="NAME=FILE",
        ),
    ] = None,
    variants: Annotated[
        bool, typer.Option("--variants", help="Also change edvo, one part at a time.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for tables, pictures, paths.", metavar="DIR"),
    ] = None,
    preset: Annotated[
        str | None, typer.Option(help="What --variants changes: paper (by default) or default.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is drawn at random.", min=0)] = 0,
    repeats: Annotated[
        int,
        typer.Option(help="Runs of what draws at random, each with another seed.", min=1),
    ] = 1,
    camera: CameraFile = None,
    format: FormatName = None,
    colour_topic: ColourTopic = None,
    depth_topic: DepthTopic = None,
    light: Annotated[
        str | None,
        typer.Option(
            help="Put changing light on the images: a model of edvo relight.", metavar="MODEL"
        ),
    ] = None,
    severity: Annotated[
        float | None, typer.Option(help="How hard it changes; 0.5 by default.", min=0.0, max=1.0)
    ] = None,
    start: Start = 0,
    max_frames: MaxFrames = None,
    stride: Stride = 1,
    memory: Annotated[
        bool, typer.Option("--memory", help="Measure memory too, in a process for each system.")
    ] = False,
) -> None:
    """Compare edvo with other odometry on the same frames.

    Tracks each frame by all of them in turn. Prints errors, coverage and times, beside those of
    standing still, and where edvo stands; DIR gets them as Markdown, CSV and JSON, with pictures
    of the paths and of the errors over time.
    """
    from edvo.cli.compare import compare as body

    body(
        sources,
        peers=[name.strip() for each in peers or [] for name in each.split(",") if name.strip()],
        trajectories=trajectories or [],
        variants=variants,
        out=out,
        preset=preset,
        seed=seed,
        repeats=repeats,
        camera=camera,
        format=format,
        colour_topic=colour_topic,
        depth_topic=depth_topic,
        light=light,
        severity=severity,
        start=start,
        max_frames=max_frames,
        stride=stride,
        memory=memory,
    )
