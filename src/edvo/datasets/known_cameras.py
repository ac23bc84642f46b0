"""Cameras of public data sets, and the names by which their sequences are recognised.

Numbers: the data sets' own calibration pages. In TUM's and ICL-NUIM's numbers pixel centres lie
at integers, as everywhere here.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from edvo.camera import Camera
from edvo.datasets.images import MAX_PIXELS
from edvo.errors import CameraError, DatasetError

CAMERA_FILE = "camera.yaml"

_ZERO = (0.0, 0.0, 0.0, 0.0, 0.0)


def _vga(
    name: str,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    distortion: tuple[float, float, float, float, float] = _ZERO,
) -> Camera:
    return Camera(
        width=640,
        height=480,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=distortion,
        depth_scale=5000.0,
        name=name,
    )


KNOWN_CAMERAS: dict[str, Camera] = {
    camera.name: camera
    for camera in (
        _vga(
            "tum-fr1",
            517.306,
            516.469,
            318.643,
            255.314,
            (0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
        ),
        # TUM's own files are scaled so that 5000 is right; the 5208 seen elsewhere is a 4 % bias.
        _vga(
            "tum-fr2",
            520.909,
            521.007,
            325.141,
            249.702,
            (0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
        ),
        _vga("tum-fr3", 535.4, 539.2, 320.1, 247.6),
        _vga(
            "bonn",
            542.823,
            542.577,
            315.594,
            237.756,
            (0.039903, -0.099343, -0.00073, -0.000144, 0.0),
        ),
        # Published with fy < 0, for a y axis that points up; here it points down.
        _vga("icl-nuim", 481.2, 480.0, 319.5, 239.5),
    )
}
"""Cameras by name."""

# In this order: "freiburg3_long_office" is TUM, not ICL's office.
_PATTERNS: tuple[tuple[str, str], ...] = (
    (r"(?:freiburg|(?<![a-z0-9])fr)[-_]?1(?![0-9])", "tum-fr1"),
    (r"(?:freiburg|(?<![a-z0-9])fr)[-_]?2(?![0-9])", "tum-fr2"),
    (r"(?:freiburg|(?<![a-z0-9])fr)[-_]?3(?![0-9])", "tum-fr3"),
    (r"(?<![a-z])bonn(?![a-z])", "bonn"),
    (
        r"(?<![a-z])icl(?![a-z])|living[-_]?room|(?<![a-z])(?:office|lr|of)[-_]?(?:traj|kt)[-_]?[0-3]",
        "icl-nuim",
    ),
)


def recognise_camera(path: Path) -> tuple[Camera, str] | None:
    """Tell the camera from the name of a sequence.

    Parameters
    ----------
    path : pathlib.Path
        The sequence's folder; its own name counts, then its parent's (``freiburg1/xyz``).

    Returns
    -------
    (Camera, str) or None
        The camera and the name that told it.
    """
    for name in (path.name, path.parent.name):
        for pattern, camera in _PATTERNS:
            if re.search(pattern, name.lower()):
                return KNOWN_CAMERAS[camera], name
    return None


def find_camera(camera: str | os.PathLike[str]) -> Camera:
    """Find a camera by its name or in a file.

    Parameters
    ----------
    camera : path-like or str
        A name of `KNOWN_CAMERAS`, or a camera file.

    Returns
    -------
    Camera
        The camera.

    Raises
    ------
    CameraError
        If there is no such camera, which lists those there are, or the file is wrong.
    """
    if isinstance(camera, str) and camera in KNOWN_CAMERAS:
        return KNOWN_CAMERAS[camera]
    path = Path(camera)
    if path.suffix or path.exists():
        return Camera.from_yaml(path)
    raise CameraError(f"no camera '{camera}'; there are {', '.join(KNOWN_CAMERAS)}, or give a file")


def choose_camera(
    folder: Path,
    camera: Camera | str | os.PathLike[str] | None = None,
    *,
    stated: Callable[[], tuple[Camera, str]] | None = None,
) -> tuple[Camera, str]:
    """Settle which camera took the images in a folder.

    What the user says wins, then what the folder says (``camera.yaml``, then the format's own
    file), then what its name says: from the most deliberate statement to the least.

    Parameters
    ----------
    folder : pathlib.Path
        The sequence's folder.
    camera : Camera, path-like or str, optional
        A camera, a camera file, or a name of `KNOWN_CAMERAS`.
    stated : callable, optional
        Gives the camera that the format itself states, and where; in place of the name's.

    Returns
    -------
    (Camera, str)
        The camera and where its numbers come from.

    Raises
    ------
    CameraError
        If there is no such camera, its file is wrong or its images are impossibly large.
    DatasetError
        If nothing tells the camera.
    """
    taken, origin = _choose(folder, camera, stated)
    if taken.width * taken.height > MAX_PIXELS:
        raise CameraError(
            f"{folder}: the camera ({origin}) is {taken.width}x{taken.height}, larger than any; "
            "correct it"
        )
    return taken, origin


def _choose(
    folder: Path,
    camera: Camera | str | os.PathLike[str] | None,
    stated: Callable[[], tuple[Camera, str]] | None,
) -> tuple[Camera, str]:
    if isinstance(camera, Camera):
        return camera, "given"
    if camera is not None:
        by = "given by name" if camera in KNOWN_CAMERAS else "given"
        return find_camera(camera), f"{by} ({camera})"
    beside = folder / CAMERA_FILE
    if beside.exists():
        return Camera.from_yaml(beside), f"{CAMERA_FILE} in the folder"
    if stated is not None:
        return stated()
    known = recognise_camera(folder)
    if known is not None:
        return known[0], f"recognised as {known[0].name} by the name '{known[1]}'"
    raise DatasetError(
        f"{folder}: the camera is not known; put a {CAMERA_FILE} in the folder or add "
        f"--camera FILE (or one of {', '.join(KNOWN_CAMERAS)})"
    )
