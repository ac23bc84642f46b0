"""What COLMAP and nerfstudio share: pixel coordinates from a corner, and names of images."""

import os
from collections.abc import Sequence
from pathlib import Path

from edvo.camera import Camera


def corner_principal_point(camera: Camera) -> tuple[float, float]:
    """Give the principal point counted from the corner of the image.

    Parameters
    ----------
    camera : Camera
        Here pixel centres are whole numbers; there the first one lies at (0.5, 0.5).

    Returns
    -------
    (float, float)
        Pixels.
    """
    return camera.cx + 0.5, camera.cy + 0.5


def image_names(
    source: object, indices: Sequence[int], stamps: Sequence[str]
) -> tuple[list[str], Path | None]:
    """Name the colour image of each frame.

    Parameters
    ----------
    source : object
        What was tracked. Where its images are files it has ``colour_files``, their paths.
    indices : sequence of int, length N
        Frames that are named.
    stamps : sequence of str, length N
        Their times as the source writes them.

    Returns
    -------
    names : list of str
        Of the files, relative to the folder; ``STAMP.png`` where there are none.
    folder : pathlib.Path or None
        The one that all files of the source lie in, if there are files.
    """
    files: Sequence[Path] | None = getattr(source, "colour_files", None)
    if not files:
        return [f"{stamp}.png" for stamp in stamps], None
    folder = Path(os.path.commonpath([file.parent for file in files]))
    return [files[index].relative_to(folder).as_posix() for index in indices], folder
