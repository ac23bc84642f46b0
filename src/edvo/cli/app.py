"""What commands there are and what they take; each body is in a module of its own."""

import logging
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from edvo.cli import INTERRUPTED
from edvo.cli.terminal import Notes
from edvo.errors import EdvoError


class Commands(TyperGroup):
    """Turns what goes wrong on purpose into one line and an exit status."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; `EdvoError` exits with 1, Ctrl-C with 130."""
        try:
            return super().invoke(ctx)
        except EdvoError as error:
            typer.echo(f"edvo: {error}", err=True)
            raise typer.Exit(1) from error
        except KeyboardInterrupt as interrupt:
            typer.echo("edvo: interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from interrupt


logging.getLogger("edvo").addHandler(Notes(logging.WARNING))

app = typer.Typer(
    name="edvo",
    cls=Commands,
    help="RGB-D visual odometry from image edges, on a plain CPU.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

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


def _version(wanted: bool) -> None:
    if wanted:
        from edvo import __version__

        typer.echo(f"edvo {__version__}")
        raise typer.Exit


@app.callback()
def edvo(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_version),
    ] = False,
) -> None:
    """RGB-D visual odometry from image edges, on a plain CPU."""


@app.command()
def run(
    source: SourcePath,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for results.", metavar="DIR")],
    preset: Preset = None,
    config: ConfigFile = None,
    overrides: Overrides = None,
    seed: Seed = None,
    camera: CameraFile = None,
    format: FormatName = None,
    colour_topic: ColourTopic = None,
    depth_topic: DepthTopic = None,
    start: Annotated[int, typer.Option(help="First frame, counted from 0.", min=0)] = 0,
    max_frames: Annotated[
        int | None, typer.Option(help="Track at most so many frames.", min=1)
    ] = None,
    stride: Annotated[int, typer.Option(help="Track each n-th frame only.", min=1)] = 1,
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
    view: Annotated[
        bool, typer.Option("--view", help="Watch it in a window (needs edvo[view]).")
    ] = False,
    save_view: Annotated[
        Path | None,
        typer.Option(help="Write what --view shows, to be opened later.", metavar="FILE.rrd"),
    ] = None,
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


@app.command()
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
    max_frames: Annotated[
        int | None, typer.Option(help="End after so many tracked frames.", min=1)
    ] = None,
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
        max_frames=max_frames,
    )


@app.command()
def info(
    source: SourcePath,
    camera: CameraFile = None,
    format: FormatName = None,
    colour_topic: ColourTopic = None,
    depth_topic: DepthTopic = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say what would be assumed about a recording.

    Format, camera, times, ground truth, and what looks wrong.
    """
    from edvo.cli.info import info as body

    body(
        source,
        camera=camera,
        format=format,
        colour_topic=colour_topic,
        depth_topic=depth_topic,
        as_json=as_json,
    )


@app.command()
def evaluate(
    reference: Annotated[Path, typer.Argument(help="True poses, TUM format.")],
    estimate: Annotated[Path, typer.Argument(help="Estimated poses, TUM format.")],
    delta: Annotated[
        float, typer.Option(help="Span of the relative pose error, seconds.", metavar="SECONDS")
    ] = 1.0,
    frames: Annotated[
        Path | None,
        typer.Option(
            help="List of the frames that could have had a pose (rgb.txt, frames.csv), "
            "for the coverage.",
            metavar="FILE",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw both paths and the errors.", metavar="FILE.png")
    ] = None,
) -> None:
    """Compare a trajectory with the truth by the TUM protocol.

    Prints relative pose error, absolute trajectory error and coverage, and beside them the errors
    of an estimate that never moves.
    """
    from edvo.cli.evaluate import evaluate as body

    body(reference, estimate, delta=delta, frames=frames, as_json=as_json, plot=plot)


@app.command()
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
    start: Annotated[int, typer.Option(help="First frame, counted from 0.", min=0)] = 0,
    max_frames: Annotated[
        int | None, typer.Option(help="Track at most so many frames.", min=1)
    ] = None,
    stride: Annotated[int, typer.Option(help="Track each n-th frame only.", min=1)] = 1,
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


@app.command()
def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for results.", metavar="DIR")
    ] = Path("edvo-demo"),
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


@app.command()
def synth(
    scene: Annotated[
        str | None, typer.Argument(help="Name of a scene, or a YAML file.", metavar="SCENE")
    ] = None,
    target: Annotated[Path | None, typer.Argument(help="Folder to write.", metavar="DIR")] = None,
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
    frequency: Annotated[
        float | None, typer.Option(help="Of the light, Hz; the model's own by default.")
    ] = None,
    jump: Annotated[
        list[float] | None,
        typer.Option(
            help="Instant at which the light jumps, seconds; may be repeated. One every 1.5 s at "
            "random by default.",
            metavar="SECONDS",
        ),
    ] = None,
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
            help="From the first row to the last: rolling shutter.",
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
    force: Annotated[bool, typer.Option("--force", help="Write into a filled folder.")] = False,
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


@app.command()
def relight(
    source: Annotated[
        Path | None, typer.Argument(help="A folder in TUM layout.", metavar="SOURCE")
    ] = None,
    target: Annotated[Path | None, typer.Argument(help="Folder to write.", metavar="DIR")] = None,
    model: Annotated[
        str,
        typer.Option(help="Model of light, or several joined by +; --list shows them."),
    ] = "ambient+diffuse",
    severity: Annotated[
        float,
        typer.Option(help="How hard the light changes: 0 leaves it as it is.", min=0.0, max=1.0),
    ] = 0.5,
    frequency: Annotated[
        float | None, typer.Option(help="Of the light, Hz; the model's own by default.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of jumps, paths and noise.", min=0)] = 0,
    jump: Annotated[
        list[float] | None,
        typer.Option(
            help="Instant of a sudden jump, seconds from the first image; may be repeated. "
            "One every 1.5 s at random by default.",
            metavar="SECONDS",
        ),
    ] = None,
    camera: CameraFile = None,
    force: Annotated[bool, typer.Option("--force", help="Write into a filled folder.")] = False,
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


@app.command()
def fetch(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Sequences, such as fr1/xyz; none: list all.", metavar="NAME"),
    ] = None,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Folder for them.", metavar="DIR", envvar="EDVO_DATA"),
    ] = Path("edvo-data"),
    mirror: Annotated[
        str | None,
        typer.Option(help="Server to take archives from instead.", metavar="URL"),
    ] = None,
    checksum: Annotated[
        str | None,
        typer.Option(help="What the archive must have, whatever edvo knows.", metavar="SHA256"),
    ] = None,
    keep_archive: Annotated[
        bool, typer.Option("--keep-archive", help="Leave the archive beside the folder.")
    ] = False,
    list_: Annotated[
        bool, typer.Option("--list", help="Show sequences, sizes and licences.")
    ] = False,
) -> None:
    """Fetch public sequences: TUM RGB-D, ICL-NUIM, Bonn RGB-D Dynamic.

    Prints the folder of each. A download that broke off goes on where it was; what is complete is
    not fetched again.
    """
    from edvo.cli import fetch as body

    if list_ or not names:
        body.list_sequences()
        return
    body.fetch(names, out, mirror=mirror, checksum=checksum, keep_archive=keep_archive)


@app.command()
def reproduce(
    what: Annotated[
        list[str],
        typer.Argument(
            help="table1 table2 table3 fig2 fig3 fig5 fig6 fig7 fig8 fig9 fig10 fig11, or all.",
            metavar="WHAT...",
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for results.", metavar="DIR")
    ] = Path("edvo-reproduce"),
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder of recordings by their TUM names; synthetic scenes stand in for those "
            "that are missing.",
            metavar="DIR",
            envvar="EDVO_DATA",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer frames and repeats: minutes, rough figures.")
    ] = False,
    seed: Annotated[
        int, typer.Option(help="Of light, synthetic scenes and what is drawn.", min=0)
    ] = 0,
    max_frames: Annotated[
        int | None,
        typer.Option(help="Most frames of a recording; 1200, or 90 if quick.", min=45),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Also what is complete in DIR already.")
    ] = False,
) -> None:
    """Make tables and figures of the paper again, and hold its claims against them.

    Writes numbers (CSV) and pictures of each to DIR/NAME, and all of it with the published values
    beside to DIR/index.html and DIR/summary.md. The same command goes on where it was stopped.
    """
    from edvo.cli.reproduce import reproduce as body

    body(
        what,
        out,
        data=data,
        quick=quick,
        seed=seed,
        max_frames=max_frames,
        force=force,
    )


@app.command()
def warmup() -> None:
    """Compile the tracker once, so that later runs start at once."""
    from edvo.cli.warmup import warmup as body

    body()
