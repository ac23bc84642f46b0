"""Bags for the tests, written by rosbags' own writers."""

import struct
from dataclasses import dataclass, field

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

TYPES = {True: get_typestore(Stores.ROS2_HUMBLE), False: get_typestore(Stores.ROS1_NOETIC)}

KINDS = ("ros1", "sqlite3", "mcap")
"""Of bags."""

INFO = {"width": 64, "height": 48, "k": (50.0, 51.0, 31.5, 23.5), "d": (), "model": "plumb_bob"}


@dataclass
class Message:
    """A message to be written: its topic, its type, when it is recorded (s), and its fields."""

    topic: str
    type: str
    recorded: float
    fields: dict = field(default_factory=dict)
    raw: bytes | None = None  # in place of the fields


def stamp_of(seconds: float) -> int:
    return round(seconds * 1e6) * 1000  # a double has no more of the times since 1970


def image(topic, stamp, array, encoding, *, step=None, big_endian=False, frame="camera", **more):
    """Make an Image message; `step` pads rows."""
    array = np.asarray(array)
    if big_endian:
        array = array.astype(array.dtype.newbyteorder(">"))
    rows = array.reshape(array.shape[0], -1).view(np.uint8)
    if step is not None:
        rows = np.pad(rows, ((0, 0), (0, step - rows.shape[1])), constant_values=77)
    fields = {
        "stamp": stamp,
        "frame_id": frame,
        "height": array.shape[0],
        "width": array.shape[1],
        "encoding": encoding,
        "is_bigendian": int(big_endian),
        "step": rows.shape[1],
        "data": rows.ravel(),
    }
    recorded = more.pop("recorded", stamp + 0.01)
    return Message(topic, "sensor_msgs/msg/Image", recorded, {**fields, **more})


def compressed(topic, stamp, array, format, *, suffix=".png", header=b"", frame="camera", **more):
    """Make a CompressedImage message."""
    good, data = cv2.imencode(suffix, array)
    assert good
    fields = {
        "stamp": stamp,
        "frame_id": frame,
        "format": format,
        "data": np.frombuffer(header + data.tobytes(), np.uint8),
    }
    return Message(topic, "sensor_msgs/msg/CompressedImage", stamp + 0.01, {**fields, **more})


def camera_info(topic, stamp, *, frame="camera", **info):
    """Make a CameraInfo message."""
    values = {**INFO, **info}
    fx, fy, cx, cy = values["k"]
    pfx, pfy, pcx, pcy = values.get("p", values["k"])
    fields = {
        "stamp": stamp,
        "frame_id": frame,
        "height": values["height"],
        "width": values["width"],
        "distortion_model": values["model"],
        "d": np.array(values["d"], np.float64),
        "k": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        "r": np.eye(3).ravel(),
        "p": np.array([pfx, 0, pcx, 0, 0, pfy, pcy, 0, 0, 0, 1, 0], np.float64),
    }
    return Message(topic, "sensor_msgs/msg/CameraInfo", stamp + 0.001, fields)


def depth_header(a: float = 0.0, b: float = 0.0) -> bytes:
    """Make the header of compressedDepth."""
    return struct.pack("<iff", 0, a, b)


def write_bag(path, kind, messages, *, compression=None):
    """Write a bag of a kind; returns the path to open."""
    ros2 = kind != "ros1"
    if kind == "ros1":
        path = path.with_suffix(".bag")
        writer = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    types = TYPES[ros2]
    with writer:
        connections = {}
        for message in sorted(messages, key=lambda message: message.recorded):
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(
                    message.topic, message.type, typestore=types
                )
            data = message.raw if message.raw is not None else serialise(message, ros2)
            writer.write(connections[message.topic], stamp_of(message.recorded), data)
    return path


def serialise(message, ros2):
    """Serialise a message's fields."""
    types = TYPES[ros2].types
    fields = dict(message.fields)
    time, frame = stamp_of(fields.pop("stamp", 0.0)), fields.pop("frame_id", "")
    stamp = types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)
    number = () if ros2 else (0,)
    header = types["std_msgs/msg/Header"](*number, stamp=stamp, frame_id=frame)
    if message.type == "sensor_msgs/msg/CameraInfo":
        region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        fields |= {"binning_x": 0, "binning_y": 0, "roi": region}
        if not ros2:
            fields = {key.upper() if len(key) == 1 else key: fields[key] for key in fields}
    made = types[message.type](header=header, **fields)
    if ros2:
        return TYPES[True].serialize_cdr(made, message.type)
    return TYPES[False].serialize_ros1(made, message.type)
