"""RealSense cameras, through pyrealsense2 (extra ``edvo[realsense]``).

Depth is aligned to colour by the SDK; the camera's numbers are the device's own.
"""

from collections.abc import Generator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from edvo.camera import Camera
from edvo.datasets.association import stamped_delay
from edvo.datasets.devices.driven import Driven
from edvo.datasets.devices.noise import noise_of
from edvo.datasets.devices.package import load_package
from edvo.datasets.devices.waiting import WAIT_MS, images_of
from edvo.datasets.realsense_camera import realsense_camera
from edvo.datasets.source import Reading
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame

# What the tracker's thresholds were found with; what a camera has nearest to it is taken.
_WIDTH, _HEIGHT, _RATE = 640, 480, 30


def open_realsense(serial: str, camera: Camera | None) -> "RealSense":
    """Open a camera that is connected.

    Parameters
    ----------
    serial : str
        Its serial number; the first one there is if empty.
    camera : Camera or None
        Instead of what the device says.

    Returns
    -------
    RealSense
        Running.

    Raises
    ------
    DatasetError
        If there is none, or it does not start.
    MissingExtraError
        If pyrealsense2 is not installed.
    """
    sdk = load_package("pyrealsense2", "realsense")
    devices = list(sdk.context().query_devices())
    serials = [device.get_info(sdk.camera_info.serial_number) for device in devices]
    if not devices:
        raise DatasetError(
            "realsense: no camera is connected; plug it into a USB 3 port, and on Linux install "
            "RealSense's udev rules"
        )
    if serial and serial not in serials:
        raise DatasetError(f"realsense: no camera {serial}; connected are {', '.join(serials)}")
    return RealSense(devices[serials.index(serial) if serial else 0], camera=camera)


class RealSense(Driven):
    """A RealSense camera; fulfils `edvo.datasets.devices.Device`.

    Parameters
    ----------
    device : pyrealsense2.device
        The camera.
    camera : Camera, optional
        Instead of what the device says.

    Raises
    ------
    DatasetError
        If it has no depth or no colour, or does not start.
    """

    format = "realsense"

    def __init__(self, device: Any, *, camera: Camera | None = None) -> None:
        super().__init__(RuntimeError)
        self._sdk = load_package("pyrealsense2", "realsense")
        info = self._sdk.camera_info
        parts = [
            device.get_info(kind)
            for kind in (info.name, info.serial_number)
            if device.supports(kind)
        ]
        self.name = " ".join(parts) or "RealSense"
        self.sensor = noise_of(parts[0] if parts else "")
        self.path = Path("realsense" + (f":{parts[1]}" if len(parts) > 1 else ""))
        self._device = device  # its sensors live as long as it does
        with self._starting(f"{self.name} does not start", "; see that no other program has it"):
            self._start(camera)

    def readings(self) -> Generator[Reading, None, None]:
        """Wait for each pair of images."""
        align = self._sdk.align(self._sdk.stream.color)
        index = 0
        for images in images_of(self._take, self.name, self._closed):
            if not images.get_depth_frame() or not images.get_color_frame():
                continue  # the one without the other
            if not self._count.is_new(images.get_color_frame().get_frame_number()):
                continue  # the same image beside the next depth image
            yield self._reading(index, align.process(images))
            index += 1

    def _take(self) -> Any:
        came, images = self._syncer.try_wait_for_frames(WAIT_MS)
        return images if came else None

    def _start(self, camera: Camera | None) -> None:
        sdk = self._sdk
        chosen = []
        for stream, formats in (
            (sdk.stream.depth, (sdk.format.z16,)),
            (sdk.stream.color, (sdk.format.bgr8, sdk.format.rgb8)),
        ):
            found = [
                (formats.index(profile.format()), *_distance(profile), number, profile, sensor)
                for sensor in self._device.query_sensors()
                for number, profile in enumerate(sensor.get_stream_profiles())
                if profile.stream_type() == stream and profile.format() in formats
            ]
            if not found:
                kind = str(stream).rpartition(".")[2]
                raise DatasetError(
                    f"{self.name} has no {kind} images; use one with depth and colour"
                )
            chosen.append(min(found, key=lambda each: each[:-2])[-2:])
        (depth, depth_sensor), (colour, colour_sensor) = chosen
        self._is_rgb = colour.format() == sdk.format.rgb8
        told = colour.as_video_stream_profile().get_intrinsics()
        self.camera_origin = "given" if camera else "the device"
        self.camera = camera or realsense_camera(
            (told.width, told.height),
            (told.fx, told.fy),
            (told.ppx, told.ppy),
            model=str(told.model),
            coefficients=list(told.coeffs),
            depth_scale=1000.0,
            name=self.name,
        )
        self._syncer = sdk.syncer()
        names = [sensor.get_info(sdk.camera_info.name) for sensor in (depth_sensor, colour_sensor)]
        if names[0] == names[1]:  # as a D405 has it: one sensor gives both
            self._run(depth_sensor, [depth, colour])
        else:
            self._run(depth_sensor, [depth])
            self._run(colour_sensor, [colour])

    def _run(self, sensor: Any, profiles: list[Any]) -> None:
        sensor.open(profiles)
        self._stops.callback(sensor.close)
        self._stops.callback(sensor.stop)
        sensor.start(self._syncer)

    def _reading(self, index: int, images: Any) -> Reading:
        depth, colour = images.get_depth_frame(), images.get_color_frame()
        seconds = colour.get_timestamp() / 1000
        delay = stamped_delay(seconds, depth.get_timestamp() / 1000)
        metres = np.asarray(depth.get_data()) * np.float32(depth.get_units())
        order: Literal["rgb", "bgr"] = "rgb" if self._is_rgb else "bgr"
        frame, problem = None, None
        try:
            # Makes new images: the SDK uses the memory of its own again.
            frame = Frame.from_images(
                seconds, np.asarray(colour.get_data()), metres, order=order, depth_delay=delay
            )
        except FrameError as error:
            problem = f"{self.name}: image {colour.get_frame_number()}: {error}"
        return Reading(index, f"{seconds:.6f}", seconds, frame, problem)


def _distance(profile: Any) -> tuple[int, int]:
    """Say how far a stream is from what is wanted, in pixels and in images a second."""
    video = profile.as_video_stream_profile()
    return abs(video.width() - _WIDTH) + abs(video.height() - _HEIGHT), abs(profile.fps() - _RATE)
