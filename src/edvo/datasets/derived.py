"""What is derived from a source and has its recording, camera and truth."""

from pathlib import Path

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
