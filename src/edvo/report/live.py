"""The loop for a camera: the newest frame through a tracker, until someone says stop."""

import time
from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.clock import StageClock
from edvo.datasets.devices.device import Device
from edvo.datasets.masked import Mask
from edvo.datasets.source import Reading, check_index, describe_timing
from edvo.errors import EdvoError
from edvo.live import Latest
from edvo.report.tracking import FrameRecord, Run, Tracker, measured_by, track_reading
from edvo.trajectory import Trajectory


class Seen:
    """What a camera has shown, as a source whose images are gone; fulfils `edvo.datasets.Source`.

    Parameters
    ----------
    device : Device
        The camera.
    mask : Mask, optional
        What is left out of its images.
    """

    def __init__(self, device: Device, mask: Mask | None = None) -> None:
        self.name: str = device.name
        self.path: Path = device.path
        self.format: str = device.format
        self.camera: Camera = device.camera
        self.camera_origin: str = device.camera_origin
        self.ground_truth: Trajectory | None = device.ground_truth
        self.warnings: tuple[str, ...] = ()
        self._mask = mask
        self.stamps: list[str] = []
        self._timestamps: list[float] = []

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Times of the frames so far, seconds."""
        return np.array(self._timestamps)

    def __len__(self) -> int:
        return len(self.stamps)

    def add(self, reading: Reading) -> None:
        """Take note of a frame."""
        self.stamps.append(reading.stamp)
        self._timestamps.append(reading.timestamp)

    def read(self, index: int) -> Reading:
        """Say that the images are gone."""
        check_index(index, self.stamps, self.name)
        stamp, timestamp = self.stamps[index], self._timestamps[index]
        problem = f"{self.name}: frame {index} was live and is gone"
        return Reading(index, stamp, timestamp, None, problem)

    def describe(self) -> dict[str, Any]:
        """Say what the camera was, in plain types."""
        return {
            "name": self.name,
            "path": str(self.path),
            "format": self.format,
            "camera": {**self.camera.to_dict(), "origin": self.camera_origin},
            **describe_timing(self.timestamps),
            "warnings": [],
            **({} if self._mask is None else {"mask": self._mask.describe()}),
        }


def track_device(
    device: Device,
    tracker: Tracker,
    *,
    mask: Mask | None = None,
    max_frames: int | None = None,
    clock: StageClock | None = None,
    on_frame: Callable[[FrameRecord, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> tuple[Run, EdvoError | None]:
    """Track a camera, and drop the frames that there is no time for.

    Parameters
    ----------
    device : Device
        The camera; it is closed at the end.
    tracker : Tracker
        What tracks; an `edvo.Odometry` for instance.
    mask : Mask, optional
        What is left out of each image.
    max_frames : int, optional
        End after so many tracked frames.
    clock : StageClock, optional
        The clock that the tracker was given.
    on_frame : callable, optional
        Called with each record as it is made, and the number of frames dropped so far.
    stop : callable, optional
        Asked before each frame, and ten times a second while none comes; once it says yes, the
        run ends.

    Returns
    -------
    Run
        The frames tracked. As many are wanted as there are: a camera has no end.
    EdvoError or None
        What ended it, if the camera failed.
    """
    seen, records, failure = Seen(device, mask), list[FrameRecord](), None
    begin = time.perf_counter()
    try:
        with Latest(_shown(device, mask), stop) as latest:
            try:
                for reading in latest:
                    records.append(track_reading(tracker, reading, clock))
                    seen.add(reading)
                    if on_frame is not None:
                        on_frame(records[-1], latest.dropped + device.missed)
                    if len(records) == max_frames:
                        break
            except EdvoError as error:
                failure = error
            dropped = latest.dropped + device.missed
    finally:
        device.close()
    wall_s = time.perf_counter() - begin
    measured = measured_by(tracker)
    return Run(seen, records, len(records), wall_s, dropped, measured), failure


def _shown(device: Device, mask: Mask | None) -> Generator[Reading, None, None]:
    """Give what a camera shows, without what is left out."""
    with closing(device.readings()) as readings:
        for reading in readings:
            yield reading if mask is None else mask.on(reading)
