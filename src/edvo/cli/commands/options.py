"""Arguments and options that several commands take."""

from pathlib import Path
from typing import Annotated

import typer

Preset = Annotated[
    str | None,
    typer.Option(help="Parameters to start from: default, or paper (the method as published)."),
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="YAML file of parameters.", metavar="FILE")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help="One parameter; may be repeated.", metavar="A.B=VALUE"),
]
Seed = Annotated[int | None, typer.Option(help="Seed of what is drawn at random.", min=0)]
SourcePath = Annotated[Path, typer.Argument(help="A recording.", metavar="SOURCE")]
CameraFile = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="Camera file (YAML) or name of a known camera, instead of what the source says.",
        metavar="FILE",
    ),
]
MaskFile = Annotated[
    Path | None,
    typer.Option(
        "--mask",
        help="Image of the size of the camera's, black where it does not show the scene but "
        "print, a gripper, or a part of the robot.",
        metavar="FILE",
    ),
]
FormatName = Annotated[
    str | None, typer.Option("--format", help="Format of the source, if not found out.")
]
ColourTopic = Annotated[
    str | None,
    typer.Option(help="Topic of a ROS bag's colour images, if not found out.", metavar="NAME"),
]
DepthTopic = Annotated[
    str | None,
    typer.Option(help="Topic of its depth images, registered to colour.", metavar="NAME"),
]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for results.", metavar="DIR")]
Start = Annotated[int, typer.Option(help="First frame, counted from 0.", min=0)]
MaxFrames = Annotated[int | None, typer.Option(help="Track at most so many frames.", min=1)]
Stride = Annotated[int, typer.Option(help="Track each n-th frame only.", min=1)]
View = Annotated[bool, typer.Option("--view", help="Watch it in a window (needs edvo[view]).")]
SaveView = Annotated[
    Path | None,
    typer.Option(help="Write what --view shows, to be opened later.", metavar="FILE.rrd"),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Target = Annotated[Path | None, typer.Argument(help="Folder to write.", metavar="DIR")]
Frequency = Annotated[
    float | None, typer.Option(help="Of the light, Hz; the model's own by default.")
]
Jumps = Annotated[
    list[float] | None,
    typer.Option(
        "--jump",
        help="Instant of a sudden jump of the light, seconds from the first image; may be "
        "repeated. One every 1.5 s at random by default.",
        metavar="SECONDS",
    ),
]
Overwrite = Annotated[bool, typer.Option("--force", help="Write into a filled folder.")]
