"""Arguments and options of `edvo run`."""

from typing import Annotated

import typer

from edvo.cli.commands.options import (
    CameraFile,
    ColourTopic,
    ConfigFile,
    DepthTopic,
    FormatName,
    MaskFile,
    MaxFrames,
    Out,
    Overrides,
    Preset,
    SaveView,
    Seed,
    SourcePath,
    Start,
    Stride,
    View,
)


def run(
    source: SourcePath,
    out: Out,
    preset: Preset = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    seed: Seed = None,
    camera: CameraFile = None,
    mask: MaskFile = None,
    format: FormatName = None,
    colour_topic: ColourTopic = None,
    depth_topic: DepthTopic = None,
    start: Start = 0,
    max_frames: MaxFrames = None,
    stride: Stride = 1,
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html, a page that needs no other file.")
    ] = False,
    exports: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            help="Also write edges (3-D edge map), kitti, euroc, colmap, nerfstudio (poses), or "
            "mesh; may be repeated.",
            metavar="KIND",
        ),
    ] = None,
    view: View = False,
    save_view: SaveView = None,
) -> None:
    """Track a recording.

    Finds out what SOURCE is and writes trajectory.txt (TUM format), frames.csv (a row a frame),
    summary.json and config.yaml to DIR. Prints errors where the source has ground truth.
    """
    from edvo.cli.run import run as body

    body(
        source,
        out,
        preset=preset,
        config_file=config,
        overrides=overrides or [],
        seed=seed,
        camera=camera,
        mask=mask,
        format=format,
        colour_topic=colour_topic,
        depth_topic=depth_topic,
        start=start,
        max_frames=max_frames,
        stride=stride,
        report=report,
        exports=exports or [],
        view=view,
        save_view=save_view,
    )
