"""Recordings as RealSense's SDK writes them."""

import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer

from edvo import se3
from edvo.camera import Camera

from .ros_bags import TYPES, Message, camera_info, image, serialise, write_bag

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass
class Device:
    """What the camera says of itself; the images are all of the cameras' size."""

    colour: Camera
    depth: Camera
    T_colour_depth: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    model: str = "Inverse Brown Conrady"
    coefficients: Sequence[float] = ZERO
    units: float = 0.001

    def streams(self) -> tuple[tuple[Camera, str, Sequence[float]], ...]:
        """Depth's and colour's, as the SDK numbers them."""
        return (self.depth, "Brown Conrady", ZERO), (self.colour, self.model, self.coefficients)


def load_sdk() -> Any:
    """The SDK, which does not load where the system has no libusb; the test is then skipped."""
    reason = "pip install 'edvo[realsense]', which needs libusb-1.0"
    return pytest.importorskip("pyrealsense2", reason=reason, exc_type=ImportError)


Images = Sequence[tuple[float, NDArray[np.uint8], NDArray[np.uint16]]]
"""Seconds, colour (RGB), depth."""


def write_old(
    path: Path, device: Device, images: Images, *, late: float = 0.0, **changes: Any
) -> Path:
    """Write a .bag: version 2.57 of the SDK and before.

    Depth is stamped `late` seconds after colour. `changes` puts another message in the place of
    those of a topic, or None for none.
    """
    info, kinds = "realsense_msgs/msg/StreamInfo", ("Depth_0", "Color_0")
    if info not in TYPES[False].types:
        from rosbags.typesys import get_types_from_msg

        text = "uint32 fps\nstring encoding\nbool is_recommended\n"
        TYPES[False].register(get_types_from_msg(text, info))
    messages = [Message("/file_version", "std_msgs/msg/UInt32", 0.0, raw=struct.pack("<I", 4))]
    pair = "diagnostic_msgs/msg/KeyValue"
    messages.append(Message("/device_0/info", pair, 0.0, raw=_texts("Name", "Fake D435")))
    T = (np.eye(4), device.T_colour_depth)  # of each stream and the reference, which is depth
    for number, (camera, model, coefficients) in enumerate(device.streams()):
        sensor = f"/device_0/sensor_{number}"
        base, encoding = f"{sensor}/{kinds[number]}", ("mono16", "rgb8")[number]
        told = camera_info(
            f"{base}/info/camera_info",
            0.0,
            width=camera.width,
            height=camera.height,
            k=(camera.fx, camera.fy, camera.cx, camera.cy),
            d=coefficients,
            model=model,
            frame="",
        )
        told.recorded = 0.0
        translation, quaternion = se3.to_quaternion(T[number])
        stream = struct.pack("<I", 30) + _texts(encoding) + b"\0"
        place = struct.pack("<7d", *translation, *quaternion)
        messages += [
            Message(f"{base}/info", info, 0.0, raw=stream),
            told,
            Message(f"{sensor}/info", pair, 0.0, raw=_texts("Name", f"Sensor {number}")),
            Message(f"{base}/tf/1", "geometry_msgs/msg/Transform", 0.0, raw=place),
        ]
        for index, (seconds, colour, depth) in enumerate(images):
            shown = depth if number == 0 else colour
            recorded = 0.01 + (seconds - images[0][0]) + 0.001 * number
            time = seconds if number else seconds + late
            made = image(f"{base}/image/data", time, shown, encoding, frame="1")
            # The SDK's images end with their depth unit, which ROS's do not have.
            unit = struct.pack("<f", 0.0 if number else device.units)
            raw = bytes(serialise(made, False)) + unit
            messages.append(Message(made.topic, made.type, recorded, raw=raw))
            numbers = {"Frame number": index, "timestamp_domain": "System Time"}
            for key, value in numbers.items():
                name = f"{base}/image/metadata"
                messages.append(Message(name, pair, recorded, raw=_texts(key, str(value))))
    units = struct.pack("<f", device.units)
    name = "/device_0/sensor_0/option/Depth_Units"
    messages.append(Message(f"{name}/value", "std_msgs/msg/Float32", 0.0, raw=units))
    messages.append(Message(f"{name}/description", "std_msgs/msg/String", 0.0, raw=_texts("units")))
    for topic, change in changes.items():
        kept = [message for message in messages if not message.topic.endswith(topic)]
        if change is not None:
            old = next(message for message in messages if message.topic.endswith(topic))
            kept.append(Message(old.topic, old.type, old.recorded, raw=change))
        messages = kept
    path = path.with_suffix(".bag")
    with Writer(path) as writer:
        connections: dict[str, Any] = {}
        for message in sorted(messages, key=lambda message: message.recorded):
            topic, kind = message.topic, message.type
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES[False])
            data = message.raw if message.raw is not None else serialise(message, False)
            # What does not change is written at the first instant that ROS has: 1 ns.
            writer.write(connections[topic], max(round(1e9 * message.recorded), 1), data)
    return path


def write_new(path: Path, device: Device, images: Images) -> Path:
    """Have the SDK itself write a .db3, of its software device: version 2.58 and after."""
    rs = load_sdk()
    software = rs.software_device()
    streams = add_streams(software, device)
    recorder = rs.recorder(str(path), software)
    recording = recorder.query_sensors()
    for sensor, stream in zip(recording, streams, strict=True):
        sensor.open(stream.profile)
        sensor.start(lambda frame: None)
    for index, (seconds, colour, depth) in enumerate(images):
        for stream, shown in zip(streams, (depth, colour), strict=True):
            stream.send(shown, index, seconds)
        time.sleep(0.03)  # the recorder writes in a thread and drops what it is too slow for
    for sensor in recording:
        sensor.stop()
        sensor.close()
    return path


@dataclass
class Stream:
    """A stream of the SDK's software device; `units` are metres, of depth alone."""

    sensor: Any
    profile: Any
    units: float | None

    def send(self, shown: NDArray[Any], index: int, seconds: float) -> None:
        """Show an image."""
        import pyrealsense2 as rs

        frame = rs.software_video_frame()
        frame.pixels = np.ascontiguousarray(shown)
        frame.bpp = 3 if self.units is None else 2
        frame.stride = shown.shape[1] * frame.bpp
        frame.timestamp, frame.frame_number = 1000 * seconds, index
        frame.domain = rs.timestamp_domain.system_time
        frame.profile = self.profile.as_video_stream_profile()
        if self.units is not None:
            frame.depth_units = self.units
        self.sensor.on_video_frame(frame)


def add_streams(software: Any, device: Device, *, colour: bool = True) -> list[Stream]:
    """Give the SDK's software device a sensor for depth, and one for colour."""
    import pyrealsense2 as rs

    kinds = (
        ("Stereo Module", rs.stream.depth, rs.format.z16, 2),
        ("RGB Camera", rs.stream.color, rs.format.rgb8, 3),
    )
    made = []
    for number, told in enumerate(device.streams()[: 1 + colour]):
        name, *kind = kinds[number]
        sensor, stream = software.add_sensor(name), rs.video_stream()
        stream.type, stream.fmt, stream.bpp = kind
        stream.index, stream.uid, stream.fps = 0, number + 1, 30
        stream.width, stream.height = told[0].width, told[0].height
        stream.intrinsics = intrinsics(*told)
        made.append(
            Stream(sensor, sensor.add_video_stream(stream), None if number else device.units)
        )
    made[0].sensor.add_read_only_option(rs.option.depth_units, device.units)
    if colour:
        place = rs.extrinsics()
        place.rotation = device.T_colour_depth[:3, :3].T.ravel().tolist()
        place.translation = device.T_colour_depth[:3, 3].tolist()
        made[0].profile.register_extrinsics_to(made[1].profile, place)
    return made


def intrinsics(camera: Camera, model: str, coefficients: Sequence[float]) -> Any:
    """Make the SDK's object of a camera."""
    import pyrealsense2 as rs

    made = rs.intrinsics()
    made.width, made.height = camera.width, camera.height
    made.fx, made.fy, made.ppx, made.ppy = camera.fx, camera.fy, camera.cx, camera.cy
    made.model = getattr(rs.distortion, model.lower().replace(" ", "_"))
    made.coeffs = list(coefficients)
    return made


def _texts(*texts: str) -> bytes:
    return b"".join(struct.pack("<I", len(text)) + text.encode() for text in texts)


def write_plain(
    path: Path, device: Device, images: Images, *, late: float, untold: Sequence[str] = ()
) -> Path:
    """Write a .db3 without the SDK; the streams `untold` ("Depth_0") have no times of their own."""
    text, messages = "std_msgs/msg/String", list[Message]()

    def say(topic: str, words: str, recorded: float = 0.001) -> None:
        data = words.encode() + b"\0"
        raw = b"\0\1\0\0" + struct.pack("<I", len(data)) + data
        messages.append(Message(topic, text, recorded, raw=raw))

    say("/device_0/sensor_0/option/Depth_Units/value", str(device.units))
    for number, (camera, model, coefficients) in enumerate(device.streams()):
        kind, encoding = (("Depth_0", "mono16"), ("Color_0", "rgb8"))[number]
        base = f"/device_0/sensor_{number}/{kind}"
        told = f"fx={camera.fx};fy={camera.fy};ppx={camera.cx};ppy={camera.cy}"
        told += f";width={camera.width};height={camera.height};model={model}"
        say(f"{base}/camera_info", told + ";coeffs=" + ",".join(map(str, coefficients)))
        say(f"{base}/tf/1", "rotation=1,0,0,0,1,0,0,0,1;translation=0,0,0")
        for index, (seconds, colour, depth) in enumerate(images):
            shown, time = (depth, seconds + late) if number == 0 else (colour, seconds)
            recorded = 1.0 + index / 30 + 0.009 * number  # by the writer's own clock
            data = f"{base}/image/data"
            messages.append(image(data, recorded, shown, encoding, recorded=recorded))
            if kind not in untold:
                say(f"{base}/image/metadata", f"timestamp={1000 * time:.6f}", recorded)
    folder = write_bag(path, "sqlite3", messages)
    (file,) = folder.glob("*.db3")
    return file
