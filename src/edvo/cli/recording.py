"""Opening what a command was given."""

from pathlib import Path

from edvo.datasets import Source, open_source
from edvo.errors import DatasetError


def open_recording(
    path: Path,
    *,
    format: str | None,
    camera: str | None,
    colour_topic: str | None,
    depth_topic: str | None,
) -> Source:
    """Open a recording by the options of a command.

    Parameters
    ----------
    path : pathlib.Path
        The recording.
    format, camera : str or None
        See `edvo.datasets.open_source`.
    colour_topic, depth_topic : str or None
        Topics of a bag; either says that it is one.

    Returns
    -------
    Source
        Its frames.

    Raises
    ------
    DatasetError
        If it cannot be opened, or topics are given for another format.
    """
    if colour_topic is None and depth_topic is None:
        return open_source(path, format=format, camera=camera)
    from edvo.datasets.ros import RosFormat, open_bag

    if format not in (None, RosFormat.name):
        raise DatasetError(
            f"{path}: --colour-topic and --depth-topic are of --format {RosFormat.name}, not "
            f"{format}; leave them or the format out"
        )
    return open_bag(path, camera=camera, colour_topic=colour_topic, depth_topic=depth_topic)
