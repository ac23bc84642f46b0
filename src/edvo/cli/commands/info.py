"""Arguments and options of `edvo info`."""

from edvo.cli.commands.options import (
    AsJson,
    CameraFile,
    ColourTopic,
    DepthTopic,
    FormatName,
    SourcePath,
)


def info(
    source: SourcePath,
    camera: CameraFile = None,
    format: FormatName = None,
    colour_topic: ColourTopic = None,
    depth_topic: DepthTopic = None,
    as_json: AsJson = False,
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
