"""What is derived from a source and has its recording, camera and truth."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.source import Source
from edvo.trajectory import Trajectory


class Derived:
    """Passes on what a source says of its recording.

    Parameters
    ----------
    source : Source
        Whose frames are given in another way.
    """

    def __init__(self, source: Source) -> None:
        self._source = source

    @property
    def path(self) -> Path:
        """Where the recording lies."""
        return self._source.path

    @property
    def camera(self) -> Camera:
        """Its camera."""
        return self._source.camera

    @property
    def camera_origin(self) -> str:
        """Where the camera's numbers come from."""
        return self._source.camera_origin

    @property
    def ground_truth(self) -> Trajectory | None:
        """Its true poses, if it has any."""
        return self._source.ground_truth


class DerivedFrames(Derived):
    """Passes on which frames there are as well; who derives from it gives ``read``."""

    @property
    def name(self) -> str:
        """Short name of the recording."""
        return self._source.name

    @property
    def format(self) -> str:
        """Format of the source."""
        return self._source.format

    @property
    def stamps(self) -> Sequence[str]:
        """Times of the frames as text."""
        return self._source.stamps

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Times of the frames in seconds, shape (N,)."""
        return self._source.timestamps

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong with the source."""
        return self._source.warnings

    def __len__(self) -> int:
        return len(self._source)

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the source, in plain types."""
        return self._source.describe()
