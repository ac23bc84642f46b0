"""Recordings of RealSense's own: what its Viewer and ``rs.recorder`` write.

Up to version 2.57 of the SDK that is a ROS 1 bag, from 2.58 on an SQLite file of ROS 2; both with
topics of their own, such as ``/device_0/sensor_1/Color_0/image/data``. Depth lies in them as the
depth camera saw it, so it is carried into the view of colour here. They are read by rosbags,
image by image and by any thread, so that RealSense's SDK is not needed.
"""

import os
import re
import sqlite3
import struct
import weakref
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.association import MAX_DIFFERENCE_S, associate
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ListedSource
from edvo.datasets.realsense_camera import realsense_camera
from edvo.datasets.ros_bag import Bag
from edvo.datasets.ros_messages import IMAGE, parse_camera_info
from edvo.datasets.ros_stamped import (
    Stamped,
    load_colour,
    load_depth,
    seconds,
    stamp_text,
    stamp_topic,
)
from edvo.datasets.ros_storage import Place
from edvo.datasets.source import Source
from edvo.datasets.two_cameras import TwoCameras
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame

METRES_PER_UNIT = 0.001
"""Metres of one depth value, where a recording does not say."""

_TOPIC = b"/device_0/sensor_"
_IMAGES = re.compile(r"(/device_0/sensor_\d+)/((Depth|Color|Infrared)_\d+)/image/data(/.*)?")
_BEGINNING = 1 << 18  # bytes in which the topics of a bag are found


class RealSenseFormat:
    """The registry's entry for recordings of RealSense's SDK."""

    name = "realsense"
    layout = "a .bag or .db3 file of RealSense's SDK"

    def recognise(self, path: Path) -> str | None:
        """Say by what topics it is one."""
        suffix = path.suffix.lower()
        if not path.is_file() or suffix not in (".bag", ".db3"):
            return None
        found = _in_bag(path) if suffix == ".bag" else _in_database(path)
        return f"topics {_TOPIC.decode()}..." if found else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a recording."""
        bag = Bag(path)
        try:
            source = _open(bag, camera)
        except BaseException:
            bag.close()
            raise
        weakref.finalize(source, bag.close)
        return source


@dataclass(frozen=True)
class _Stream:
    """Images of one camera of the device.

    Parameters
    ----------
    topic : str
        Of its images.
    raw : bool
        Whether they are not compressed.
    sensor, base : str
        What the other topics of its sensor, and its own, begin with.
    kind : str
        Depth, Color or Infrared.
    """

    topic: str
    raw: bool
    sensor: str
    base: str
    kind: str


def _open(bag: Bag, camera: CameraChoice) -> ListedSource:
    streams = [
        _Stream(topic.name, topic.type == IMAGE, match[1], f"{match[1]}/{match[2]}", match[3])
        for topic in bag.topics
        if topic.count and (match := _IMAGES.fullmatch(topic.name))
    ]
    depth = _one(bag, streams, "Depth")
    # Without colour the left infrared image does, which depth is registered to as it is.
    colour = _one(bag, streams, "Color", "Infrared")
    scale, warnings = _depth_scale(bag, depth)
    if colour.kind == "Infrared":
        warnings.append(
            "there are no colour images: infrared is tracked, where dots of the projector are edges"
        )
    depth_camera = _camera(bag, depth, scale)
    colour_camera, origin = choose_camera(
        bag.path.parent,
        camera,
        stated=lambda: (_camera(bag, colour, scale), "the recording"),
    )
    colour_camera = replace(colour_camera, depth_scale=scale)
    T_colour_depth = _from_reference(bag, colour) @ se3.inverse(_from_reference(bag, depth))
    both = TwoCameras(colour_camera, depth_camera, T_colour_depth)
    found = bag.places(colour.topic, depth.topic)
    (colours, colour_stamped), (depths, depth_stamped) = (
        _times(bag, stream, places, warnings)
        for stream, places in zip((colour, depth), found, strict=True)
    )
    base = int(colours.stamps[0])
    kept, partners = associate(seconds(colours.stamps, base), seconds(depths.stamps, base))
    if not len(kept):
        raise DatasetError(
            f"{bag.path}: no colour image ({colours.span}) has a depth image ({depths.span}) "
            f"within {MAX_DIFFERENCE_S * 1e3:g} ms; record both with the clocks of one device"
        )
    stamps = [stamp_text(stamp) for stamp in colours.stamps[kept]]
    pairs = [(colours.places[i], depths.places[j]) for i, j in zip(kept, partners, strict=True)]
    delays = seconds(depths.stamps[partners] - colours.stamps[kept], 0)
    delays *= colour_stamped and depth_stamped
    frame_camera = both.camera

    def load(index: int) -> Frame:
        at = f"at {stamps[index]} in {bag.path}"
        first, second = f"{colour.topic} {at}", f"{depth.topic} {at}"
        grey = load_colour(bag, pairs[index][0], colour.raw, first)
        metric = load_depth(bag, pairs[index][1], depth.raw, second)
        if metric.dtype != np.uint16:
            raise FrameError(f"{second} has {metric.dtype} values; depth must have 16 bits")
        named = (second, np.asarray(metric, np.uint16))
        time, delay = float(stamps[index]), float(delays[index])
        return both.frame(time, (first, grey), named, frame_camera, delay)

    return ListedSource(
        bag.path,
        format=RealSenseFormat.name,
        recognised_by=RealSenseFormat().recognise(bag.path),
        stamps=stamps,
        times=[float(stamp) for stamp in stamps],
        load=load,
        camera=(frame_camera, origin),
        warnings=warnings,
        facts={
            "colour_topic": colour.topic,
            "depth_topic": depth.topic,
            "colour_images_without_depth": len(colours.stamps) - len(kept),
        },
    )


def _one(bag: Bag, streams: Sequence[_Stream], *kinds: str) -> _Stream:
    """Choose the first stream of the first kind that there is."""
    for kind in kinds:
        for stream in streams:
            if stream.kind == kind:
                return stream
    there = ", ".join(stream.base for stream in streams) or "no images"
    raise DatasetError(
        f"{bag.path}: no {kinds[0].lower()} stream among {there}; record depth and colour"
    )


def _times(
    bag: Bag, stream: _Stream, places: Sequence[Place], warnings: list[str]
) -> tuple[Stamped, bool]:
    """Give when the images of a stream were taken, and whether it was the device that told."""
    stamped, is_told = stamp_topic(bag, stream.topic, places), True
    if bag.ros2:  # headers have the time of recording there; the images' own is beside them
        taken = _metadata_times(bag, stream)
        if taken is not None and len(taken) == len(places) == len(stamped.places):
            stamped = replace(stamped, stamps=taken)
        else:
            warnings.append(f"{stream.topic}: times are those of recording")
            is_told = False
    return stamped.in_order(warnings), is_told


def _metadata_times(bag: Bag, stream: _Stream) -> NDArray[np.int64] | None:
    topic = f"{stream.base}/image/metadata"
    if topic not in {each.name for each in bag.topics}:
        return None
    times = []
    for place in bag.places(topic)[0]:
        try:
            times.append(round(1e6 * float(_words(bag.read(place))["timestamp"])))
        except (KeyError, ValueError):
            return None
    return np.array(times, np.int64)


def _camera(bag: Bag, stream: _Stream, scale: float) -> Camera:
    name = f"{stream.base}/info/camera_info" if not bag.ros2 else f"{stream.base}/camera_info"
    data, where = _first(bag, name), f"{bag.path}: {name}"
    if data is None:
        raise DatasetError(f"{where} is missing; record it again with RealSense's SDK")
    if not bag.ros2:
        info = parse_camera_info(data, False)
        fx, _, cx, _, fy, cy, *_ = info.intrinsics
        size, model, coefficients = (info.width, info.height), info.model, info.distortion
    else:
        words = _words(data)
        try:
            fx, fy, cx, cy = (float(words[key]) for key in ("fx", "fy", "ppx", "ppy"))
            size, model = (int(words["width"]), int(words["height"])), words["model"]
            coefficients = tuple(float(value) for value in words["coeffs"].split(","))
        except (KeyError, ValueError) as error:
            raise DatasetError(f"{where} cannot be read ({error}); record it again") from error
    if len(coefficients) != 5:
        raise DatasetError(f"{where} has {len(coefficients)} coefficients, not 5; record it again")
    return realsense_camera(
        size,
        (fx, fy),
        (cx, cy),
        model=model,
        coefficients=coefficients,
        depth_scale=scale,
        name=where,
    )


def _from_reference(bag: Bag, stream: _Stream) -> NDArray[np.float64]:
    """Read ``T_stream_reference``, where all streams of a device have the same reference."""
    names = [each.name for each in bag.topics if each.name.startswith(f"{stream.base}/tf/")]
    data = _first(bag, names[0]) if names else None
    if data is None:
        raise DatasetError(
            f"{bag.path}: {stream.base}/tf is missing, which says where the camera is in the "
            "device; record it again with RealSense's SDK"
        )
    try:
        if not bag.ros2:
            values = struct.unpack("<7d", data)
            return se3.from_quaternion(values[:3], values[3:])
        words = _words(data)
        T = np.eye(4)
        # By columns, as in the SDK; six decimals, so that it is made a rotation again.
        rotation = np.array([float(value) for value in words["rotation"].split(",")])
        left, _, right = np.linalg.svd(rotation.reshape(3, 3).T)
        T[:3, :3] = left @ right
        T[:3, 3] = [float(value) for value in words["translation"].split(",")]
    except (struct.error, KeyError, ValueError, np.linalg.LinAlgError) as error:
        raise DatasetError(f"{bag.path}: {names[0]} cannot be read ({error})") from error
    return T


def _depth_scale(bag: Bag, depth: _Stream) -> tuple[float, list[str]]:
    """Find the depth value of one metre, and what to warn of."""
    data = _first(bag, f"{depth.sensor}/option/Depth_Units/value")
    unit = 0.0
    if data is not None:
        try:
            unit = float(_string(data)) if bag.ros2 else struct.unpack("<f", data)[0]
        except (struct.error, ValueError):
            unit = 0.0
    if 0.0 < unit < 1.0:
        return float(f"{1.0 / unit:.6g}"), []  # of a float32
    return 1.0 / METRES_PER_UNIT, ["the recording does not say its depth units: 1 mm is assumed"]


def _first(bag: Bag, topic: str) -> bytes | None:
    if topic not in {each.name for each in bag.topics}:
        return None
    places = bag.first(topic, 1)
    return bag.read(places[0]) if places else None


def _string(data: bytes) -> str:
    """Take a ``std_msgs/String`` of ROS 2 apart."""
    return data[8:].rstrip(b"\x00").decode("utf-8", "replace")


def _words(data: bytes) -> dict[str, str]:
    pairs = (word.partition("=") for word in _string(data).split(";"))
    return {key.strip(): value for key, _, value in pairs}


def _in_bag(path: Path) -> bool:
    """Say whether the connections of a ROS 1 bag are RealSense's, without rosbags."""
    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
            at = start.find(b"index_pos=")
            if at < 0:
                return False
            (index,) = struct.unpack_from("<Q", start, at + 10)
            # Of a bag that was not closed, the index is 0: then what was recorded first tells.
            stream.seek(min(index, os.fstat(stream.fileno()).st_size))
            return b"topic=" + _TOPIC in stream.read(_BEGINNING)
    except (OSError, struct.error):
        return False


def _in_database(path: Path) -> bool:
    try:
        uri = f"{path.absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            names = database.execute("SELECT name FROM topics LIMIT 1000").fetchall()
    except (sqlite3.Error, OSError):
        return False
    return any(str(name).startswith(_TOPIC.decode()) for (name,) in names)
