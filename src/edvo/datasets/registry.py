"""The formats edvo reads, and which of them a path is.

Another package adds a format by an entry point in the group ``edvo.datasets`` that names a
`Format` object; it is asked after the built-in ones.
"""

import logging
import os
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol

from edvo.camera import Camera
from edvo.datasets.bonn import BonnFormat
from edvo.datasets.eth3d import Eth3dFormat
from edvo.datasets.generic import GenericFormat
from edvo.datasets.icl import IclFormat
from edvo.datasets.incomplete import refuse_incomplete
from edvo.datasets.povray import PovRayFormat
from edvo.datasets.realsense_recording import RealSenseFormat
from edvo.datasets.redwood import RedwoodFormat
from edvo.datasets.replica import ReplicaFormat
from edvo.datasets.ros import RosFormat
from edvo.datasets.scannet import ScanNetFormat
from edvo.datasets.sens import SensFormat
from edvo.datasets.sevenscenes import SevenScenesFormat
from edvo.datasets.source import Source
from edvo.datasets.tum import TumFormat
from edvo.errors import DatasetError

ENTRY_POINTS = "edvo.datasets"

_log = logging.getLogger(__name__)


class Format(Protocol):
    """A way in which recordings are laid out."""

    @property
    def name(self) -> str:
        """What ``--format`` calls it."""
        ...

    @property
    def layout(self) -> str:
        """What makes a path one of this format, for people."""
        ...

    def recognise(self, path: Path) -> str | None:
        """Say by what the path is of this format, or None if it is not; quick, no decoding."""
        ...

    def open(self, path: Path, *, camera: Camera | str | os.PathLike[str] | None) -> Source:
        """Open it; raise `DatasetError` or `CameraError` if that cannot be."""
        ...


BUILT_IN: tuple[Format, ...] = (
    # TUM's kin first: they have its lists and something more.
    IclFormat(),
    BonnFormat(),
    Eth3dFormat(),
    TumFormat(),
    RealSenseFormat(),  # a ROS bag with topics of its own
    RosFormat(),
    PovRayFormat(),
    SevenScenesFormat(),
    ScanNetFormat(),
    SensFormat(),
    ReplicaFormat(),
    RedwoodFormat(),
    GenericFormat(),
)
"""The formats of edvo itself, in the order in which they are asked: the most special first."""


def formats() -> tuple[Format, ...]:
    """List all formats, in the order in which they are asked.

    Returns
    -------
    tuple of Format
        The built-in ones, then those of other packages by name. One that does not load is
        logged and left out.
    """
    return tuple(_each())


def _each() -> Iterator[Format]:
    yield from BUILT_IN
    # Only now, since it takes longer to look into all installed packages than to open a recording.
    for entry in sorted(entry_points(group=ENTRY_POINTS), key=lambda entry: entry.name):
        try:
            yield entry.load()
        except Exception:  # another package's code may raise anything
            _log.warning("format %s does not load and is left out", entry.name, exc_info=True)


def recognise(path: Path) -> tuple[Format, str] | None:
    """Find the format of a path.

    Parameters
    ----------
    path : pathlib.Path
        A file or folder that exists.

    Returns
    -------
    (Format, str) or None
        The first format that knows it and by what.
    """
    for candidate in _each():
        reason = candidate.recognise(path)
        if reason is not None:
            return candidate, reason
    return None


def open_source(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    camera: Camera | str | os.PathLike[str] | None = None,
) -> Source:
    """Open a recording, whatever its format.

    Parameters
    ----------
    path : path-like
        The recording.
    format : str, optional
        Name of its format; found out by default.
    camera : Camera, path-like or str, optional
        A camera, a camera file or the name of a known camera, instead of what the recording
        says.

    Returns
    -------
    Source
        Its frames.

    Raises
    ------
    DatasetError
        If there is nothing there, it was not written to its end, no format knows it, or it lacks
        a part.
    CameraError
        If the camera file is missing or wrong.

    Examples
    --------
    >>> source = open_source("rgbd_dataset_freiburg1_xyz")  # doctest: +SKIP
    >>> source.read(0).frame.depth.shape  # doctest: +SKIP
    (480, 640)
    """
    # Absolute, for "." to have a name; links are kept, since the name may tell the camera.
    place = Path(os.path.abspath(path))  # noqa: PTH100
    if not place.exists():
        raise DatasetError(f"{path}: no such file or folder; check the path")
    refuse_incomplete(place)
    if format is not None:
        for candidate in _each():
            if candidate.name == format:
                return candidate.open(place, camera=camera)
        names = ", ".join(candidate.name for candidate in formats())
        raise DatasetError(f"unknown format {format!r}; choose one of {names}")
    found = recognise(place)
    if found is None:
        layouts = "; ".join(f"{candidate.name}: {candidate.layout}" for candidate in formats())
        raise DatasetError(f"{path}: no known recording; known formats are {layouts}")
    return found[0].open(place, camera=camera)
