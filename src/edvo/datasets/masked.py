"""What of an image is not of the scene: print, a gripper, a part of the robot.

It stays where it is in all images, and says that the camera does. Where a mask leaves out depth,
no edge is taken and no plane.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.derived import DerivedFrames
from edvo.datasets.images import load_colour
from edvo.datasets.source import Reading, Source
from edvo.errors import DatasetError, FrameError


@dataclass(frozen=True, eq=False)
class Mask:
    """What is left out of all images of a camera.

    Parameters
    ----------
    path : pathlib.Path
        Where it was read from.
    left_out : ndarray of bool, shape (H, W)
        True where depth is left out.
    """

    path: Path
    left_out: NDArray[np.bool_]

    def on(self, reading: Reading) -> Reading:
        """Leave out depth of a frame; a problem is passed on.

        Parameters
        ----------
        reading : Reading
            Of images of its size.

        Returns
        -------
        Reading
            The same with another depth image, or the problem that none is left.
        """
        if reading.frame is None:
            return reading
        depth = np.where(self.left_out, np.float32(0), reading.frame.depth)
        try:
            return replace(reading, frame=replace(reading.frame, depth=depth))
        except FrameError as error:
            problem = f"frame {reading.stamp} beyond the mask: {error}"
            return replace(reading, frame=None, problem=problem)

    def describe(self) -> dict[str, Any]:
        """Give its path, and what share of an image it leaves out, in plain types."""
        return {"path": str(self.path), "left_out": round(float(self.left_out.mean()), 4)}


def read_mask(path: Path, camera: Camera) -> Mask:
    """Read a mask.

    Parameters
    ----------
    path : pathlib.Path
        Grey or colour image; black is left out.
    camera : Camera
        Whose images are masked.

    Returns
    -------
    Mask

    Raises
    ------
    DatasetError
        If it cannot be read, is of another size, or leaves all out or nothing.
    """
    try:
        image = load_colour(path)
    except FrameError as error:
        raise DatasetError(f"mask: {error}") from error
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise DatasetError(
            f"mask {path} has {width}x{height} pixels, the images have "
            f"{camera.width}x{camera.height}; give one of their size"
        )
    colours = image.reshape(height, width, -1)[:, :, :3]
    left_out = (colours == 0).all(axis=2)
    if left_out.all() or not left_out.any():
        which = "all" if left_out.all() else "nothing"
        raise DatasetError(f"mask {path} leaves out {which}; make black what is not of the scene")
    return Mask(path, np.asarray(left_out, np.bool_))


class MaskedSource(DerivedFrames):
    """A source whose depth is left out where a mask says so.

    Parameters
    ----------
    source : Source
    mask : Mask
        Of the size of its images.
    """

    def __init__(self, source: Source, mask: Mask) -> None:
        super().__init__(source)
        self._mask = mask

    def read(self, index: int) -> Reading:
        """Read a frame and leave out its depth; a problem is passed on.

        Parameters
        ----------
        index : int
            Which one, from 0.

        Returns
        -------
        Reading
            See `Mask.on`.
        """
        return self._mask.on(self._source.read(index))

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the source, and by what it is masked, in plain types."""
        return {**super().describe(), "mask": self._mask.describe()}
