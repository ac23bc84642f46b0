"""What every camera offers."""

from collections.abc import Generator
from pathlib import Path
from typing import Protocol

from edvo.camera import Camera
from edvo.datasets.source import Reading
from edvo.trajectory import Trajectory


class Device(Protocol):
    """A camera that delivers frames as time goes by.

    `readings` is drawn on by one thread; `close` is called when that has ended.
    """

    @property
    def name(self) -> str:
        """What it is called: make, model, serial number."""
        ...

    @property
    def path(self) -> Path:
        """What the user called it."""
        ...

    @property
    def format(self) -> str:
        """Its kind in the registry."""
        ...

    @property
    def camera(self) -> Camera:
        """The camera that both images of each frame belong to."""
        ...

    @property
    def camera_origin(self) -> str:
        """Where the camera's numbers come from, for people."""
        ...

    @property
    def ground_truth(self) -> Trajectory | None:
        """True poses, where there are any."""
        ...

    @property
    def sensor(self) -> str | None:
        """Whose depth noise is its own, as `planes.sensor` names it; None where not known."""
        ...

    @property
    def missed(self) -> int:
        """Frames so far that never reached the program, as far as the driver tells."""
        ...

    def readings(self) -> Generator[Reading, None, None]:
        """Give each frame when it is there; end where there are no more.

        Raises `DatasetError` if the camera fails. A single bad frame is a `Reading` with a
        problem.
        """
        ...

    def close(self) -> None:
        """Let go of the camera; harmless the second time."""
        ...
