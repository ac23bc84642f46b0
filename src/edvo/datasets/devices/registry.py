"""The cameras edvo knows, by name."""

import os
from collections.abc import Callable
from typing import NamedTuple

from edvo.camera import Camera
from edvo.datasets.devices.device import Device
from edvo.datasets.known_cameras import find_camera
from edvo.errors import DatasetError


class DeviceKind(NamedTuple):
    """A make of camera.

    Parameters
    ----------
    name : str
        How a user calls it.
    about : str
        A line for people.
    open : callable
        Opens one of what stands behind the colon ("" for the first one there is) and a camera
        model to take instead of the device's, or None.
    """

    name: str
    about: str
    open: Callable[[str, Camera | None], Device]


def device_kinds() -> tuple[DeviceKind, ...]:
    """List the makes of camera.

    Returns
    -------
    tuple of DeviceKind
        Those that need a package that is not installed too.
    """
    return (DeviceKind("replay", "replay:RECORDING plays a recording in real time", _replay),)


def open_device(device: str, *, camera: Camera | str | os.PathLike[str] | None = None) -> Device:
    """Open a camera.

    Parameters
    ----------
    device : str
        Its make, and behind a colon which one: ``realsense``, ``realsense:SERIAL``,
        ``replay:RECORDING``.
    camera : Camera, path-like or str, optional
        A camera, a camera file or the name of a known camera, instead of what the device says.

    Returns
    -------
    Device
        Running; to be closed.

    Raises
    ------
    DatasetError
        If there is no such make, no camera of it, or it does not start.
    CameraError
        If the camera file is missing or wrong.
    MissingExtraError
        If its package is not installed.

    Examples
    --------
    >>> device = open_device("realsense")  # doctest: +SKIP
    """
    kind, _, which = device.partition(":")
    given = camera if camera is None or isinstance(camera, Camera) else find_camera(camera)
    for known in device_kinds():
        if known.name == kind:
            return known.open(which, given)
    names = ", ".join(known.about.partition(" ")[0] for known in device_kinds())
    raise DatasetError(f"{device}: no such device; give one of {names}")


def _replay(which: str, camera: Camera | None) -> Device:
    from edvo.datasets.devices.replay import Replay
    from edvo.datasets.registry import open_source

    if not which:
        raise DatasetError("replay: which recording? Give replay:PATH")
    return Replay(open_source(which, camera=camera))
