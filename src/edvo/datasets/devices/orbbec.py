"""Orbbec cameras (Gemini 2 and 330, Femto), through pyorbbecsdk 2.

Written against the SDK's interface and tested on stand-ins for it: never run on a device.
"""

from collections.abc import Generator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.association import stamped_delay
from edvo.datasets.devices.driven import Driven
from edvo.datasets.devices.noise import noise_of
from edvo.datasets.devices.package import load_package
from edvo.datasets.devices.waiting import WAIT_MS, images_of
from edvo.datasets.images import decode_image
from edvo.datasets.ros_camera import camera_from_info
from edvo.datasets.ros_messages import CameraInfo, Header
from edvo.datasets.source import Reading
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame

_WIDTH, _RATE = 640, 30


class Orbbec(Driven):
    """An Orbbec camera; fulfils `edvo.datasets.devices.Device`.

    Parameters
    ----------
    serial : str
        Its serial number; the first one there is if empty.
    camera : Camera, optional
        Instead of what the device says.

    Raises
    ------
    DatasetError
        If there is none, or it does not start.
    MissingExtraError
        If pyorbbecsdk is not installed.
    """

    format = "orbbec"

    def __init__(self, serial: str = "", camera: Camera | None = None) -> None:
        self._sdk = sdk = load_package("pyorbbecsdk", "", "pyorbbecsdk2")
        super().__init__(sdk.OBError)
        with self._starting(f"orbbec: {serial or 'the camera'} does not start"):
            devices = sdk.Context().query_devices()
            if not devices.get_count():
                raise DatasetError("orbbec: no camera is connected; plug it into a USB 3 port")
            device = (
                devices.get_device_by_serial_number(serial)
                if serial
                else devices.get_device_by_index(0)
            )
            info = device.get_device_info()
            self.name = f"{info.get_name()} {info.get_serial_number()}"
            self.sensor = noise_of(info.get_name())
            self.path = Path(f"orbbec:{info.get_serial_number()}")
            self._start(device, camera)

    def readings(self) -> Generator[Reading, None, None]:
        """Wait for each pair of images."""
        align = self._sdk.AlignFilter(align_to_stream=self._sdk.OBStreamType.COLOR_STREAM)
        index = 0
        for images in images_of(
            lambda: self._pipeline.wait_for_frames(WAIT_MS), self.name, self._closed
        ):
            aligned = align.process(images)
            both = None if aligned is None else aligned.as_frame_set()
            colour = None if both is None else both.get_color_frame()
            depth = None if both is None else both.get_depth_frame()
            if colour is None or depth is None or not self._count.is_new(colour.get_index()):
                continue
            yield self._reading(index, colour, depth)
            index += 1

    def _start(self, device: Any, camera: Camera | None) -> None:
        sdk = self._sdk
        pipeline, config = sdk.Pipeline(device), sdk.Config()
        colour = self._colour_profile(pipeline)
        sensors = sdk.OBSensorType
        depth = pipeline.get_stream_profile_list(sensors.DEPTH_SENSOR)
        config.enable_stream(colour)
        config.enable_stream(depth.get_default_video_stream_profile())
        config.set_frame_aggregate_output_mode(sdk.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
        self.camera_origin = "given" if camera else "the device"
        self.camera = camera or self._told(colour)
        pipeline.enable_frame_sync()
        pipeline.start(config)
        self._pipeline = pipeline
        self._stops.callback(pipeline.stop)

    def _colour_profile(self, pipeline: Any) -> Any:
        sdk = self._sdk
        profiles = pipeline.get_stream_profile_list(sdk.OBSensorType.COLOR_SENSOR)
        for layout in (sdk.OBFormat.RGB, sdk.OBFormat.BGR, sdk.OBFormat.MJPG):
            with suppress(sdk.OBError):  # it has no such mode
                return profiles.get_video_stream_profile(_WIDTH, 0, layout, _RATE)
        return profiles.get_default_video_stream_profile()

    def _told(self, profile: Any) -> Camera:
        lens, bent = profile.get_intrinsic(), profile.get_distortion()
        info = CameraInfo(
            Header(0, "colour"),
            int(lens.height),
            int(lens.width),
            "rational_polynomial",
            (bent.k1, bent.k2, bent.p1, bent.p2, bent.k3, bent.k4, bent.k5, bent.k6),
            (lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0),
            (),
        )
        return camera_from_info(info, rectified=False, depth_scale=1000.0, name=self.name)

    def _reading(self, index: int, colour: Any, depth: Any) -> Reading:
        seconds = colour.get_timestamp_us() / 1e6
        delay = stamped_delay(seconds, depth.get_timestamp_us() / 1e6)
        frame, problem = None, None
        try:
            image, order = self._image(colour)
            size = depth.get_height(), depth.get_width()
            values = np.frombuffer(depth.get_data(), np.uint16).reshape(size)
            metres = values * np.float32(depth.get_depth_scale() / 1000.0)  # of millimetres
            frame = Frame.from_images(seconds, image, metres, order=order, depth_delay=delay)
        except (FrameError, ValueError) as error:
            problem = f"{self.name}: image {colour.get_index()}: {error}"
        return Reading(index, f"{seconds:.6f}", seconds, frame, problem)

    def _image(self, colour: Any) -> tuple[NDArray[Any], Literal["rgb", "bgr"]]:
        layouts, layout, data = self._sdk.OBFormat, colour.get_format(), colour.get_data()
        if layout == layouts.MJPG:
            return decode_image(bytes(data), "the image"), "bgr"
        if layout not in (layouts.RGB, layouts.BGR):
            raise FrameError(f"colour is {layout}; edvo takes RGB, BGR or MJPG")
        image = np.frombuffer(data, np.uint8).reshape(colour.get_height(), colour.get_width(), 3)
        return image, "rgb" if layout == layouts.RGB else "bgr"
