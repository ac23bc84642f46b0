"""What reading a ROS bag costs, against decoding the same images and nothing else.

Run it with ``python -m benchmarks.bags FOLDER``, where the folder is a recording of images in TUM's
layout, such as fr1/xyz; it writes the images into bags of each kind, in a temporary folder, and
prints a Markdown table. *Reading* is opening the bag and reading every frame through the source, in
one thread. *Decoding* has the images in memory as the messages hold them and makes frames of them:
`cv2.imdecode` where they are compressed, grey of colour, metres of depth. *With the file* is the
same after reading the bag file from front to back in pieces of a megabyte. All take turns, so that
whatever else the machine does hits all alike; processor time, the middle of the rounds.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.tum import read_lists
from edvo.frame import Frame

COLOUR, DEPTH, INFO = (
    "/camera/rgb/image_raw",
    "/camera/depth_registered/image_raw",
    "/camera/rgb/camera_info",
)
ROUNDS = 7
PIECE = 1 << 20


@dataclass(frozen=True)
class Kind:
    """A kind of bag: its container, how it is compressed, and whether its images are."""

    name: str
    container: str
    compression: str | None
    packed: bool


KINDS = (
    Kind("PNG images, ROS 1", "ros1", None, True),
    Kind("PNG images, mcap", "mcap", None, True),
    Kind("PNG images, mcap in zstd chunks", "mcap", "storage", True),
    Kind("PNG images, sqlite3", "sqlite3", None, True),
    Kind("raw images, ROS 1", "ros1", None, False),
    Kind("raw images, mcap", "mcap", None, False),
    Kind("raw images, sqlite3", "sqlite3", None, False),
    Kind("raw images, ROS 1 in lz4 chunks", "ros1", "lz4", False),
    Kind("raw images, mcap in zstd chunks", "mcap", "storage", False),
)


@dataclass(frozen=True)
class Shot:
    """The two images of a frame, as files hold them and as they are."""

    stamp: int
    files: tuple[bytes, bytes]
    colour: NDArray[np.uint8]
    depth: NDArray[np.uint16]


def shots_of(folder: Path, count: int) -> list[Shot]:
    """Read the first frames of a folder in TUM's layout."""
    shots = []
    for pair in read_lists(folder).pairs[:count]:
        files = pair.colour.read_bytes(), pair.depth.read_bytes()
        colour, depth = (
            cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_UNCHANGED) for file in files
        )
        stamp = round(pair.time * 1e6) * 1000
        shots.append(Shot(stamp, files, np.asarray(colour, np.uint8), np.asarray(depth, np.uint16)))
    return shots


def write(path: Path, kind: Kind, shots: Sequence[Shot], camera: Camera) -> Path:
    """Write a bag of a kind, as a recorder does."""
    ros2 = kind.container != "ros1"
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    types = store.types
    writer: Any
    if ros2:
        plugin = StoragePlugin.MCAP if kind.container == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if kind.compression:
            writer.set_compression(
                CompressionMode[kind.compression.upper()], CompressionFormat.ZSTD
            )
    else:
        path = path.with_suffix(".bag")
        writer = Writer1(path)
        if kind.compression:
            writer.set_compression(Writer1.CompressionFormat[kind.compression.upper()])
    sequence = () if ros2 else (0,)

    def header(stamp: int) -> Any:
        time_type = types["builtin_interfaces/msg/Time"]
        at = time_type(stamp // 10**9, stamp % 10**9)
        return types["std_msgs/msg/Header"](*sequence, stamp=at, frame_id="camera")

    def image(stamp: int, array: NDArray[Any], encoding: str) -> Any:
        return types["sensor_msgs/msg/Image"](
            header=header(stamp),
            height=array.shape[0],
            width=array.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=array.strides[0],
            data=np.frombuffer(array.tobytes(), np.uint8),
        )

    def packed(stamp: int, data: bytes, format: str) -> Any:
        return types["sensor_msgs/msg/CompressedImage"](
            header=header(stamp), format=format, data=np.frombuffer(data, np.uint8)
        )

    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    values = {
        "d": np.array(camera.distortion),
        "k": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]),
        "r": np.eye(3).ravel(),
        "p": np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0]),
    }
    info = types["sensor_msgs/msg/CameraInfo"](
        header=header(shots[0].stamp),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        **(values if ros2 else {key.upper(): value for key, value in values.items()}),
        binning_x=0,
        binning_y=0,
        roi=types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    )
    ending = "/compressed" if kind.packed else ""
    with writer:
        connections = {
            topic: writer.add_connection(topic, message, typestore=store)
            for topic, message in (
                (INFO, info.__msgtype__),
                (COLOUR + ending, _type(kind)),
                (DEPTH + ending, _type(kind)),
            )
        }

        def add(topic: str, stamp: int, message: Any) -> None:
            serialise = store.serialize_cdr if ros2 else store.serialize_ros1
            writer.write(connections[topic], stamp, serialise(message, message.__msgtype__))

        add(INFO, shots[0].stamp, info)
        for shot in shots:
            if kind.packed:
                colour = packed(shot.stamp, shot.files[0], "bgr8; png compressed bgr8")
                depth = packed(shot.stamp, shot.files[1], "16UC1; png compressed ")
            else:
                colour = image(shot.stamp, shot.colour, "bgr8")
                depth = image(shot.stamp, shot.depth, "16UC1")
            add(COLOUR + ending, shot.stamp, colour)
            add(DEPTH + ending, shot.stamp, depth)
    return path


def _type(kind: Kind) -> str:
    return f"sensor_msgs/msg/{'CompressedImage' if kind.packed else 'Image'}"


def read(path: Path) -> None:
    """Open a bag and read all of it."""
    source = open_source(path)
    for index in range(len(source)):
        reading = source.read(index)
        if reading.frame is None:
            raise RuntimeError(reading.problem)


def read_plainly(path: Path) -> None:
    """Read the bytes of a bag and do nothing with them."""
    for file in path.iterdir() if path.is_dir() else (path,):
        with file.open("rb", buffering=0) as opened:
            while opened.read(PIECE):
                pass


def decode(shots: Sequence[Shot], packed: bool) -> None:
    """Make frames of images that are in memory."""
    for shot in shots:
        colour: NDArray[Any] = shot.colour
        depth: NDArray[Any] = shot.depth
        if packed:
            colour, depth = (
                np.asarray(cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_UNCHANGED))
                for file in shot.files
            )
        Frame.from_images(0.0, colour, depth, depth_scale=1000.0)


def seconds(run: Callable[[], object]) -> float:
    """Take the processor time of a call."""
    start = time.process_time()
    run()
    return time.process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    camera = open_source(given.folder).camera
    shots = shots_of(given.folder, given.frames)
    print(
        "| bag | reading, a frame | of which opening | decoding, a frame | ratio | "
        "with the file, a frame | ratio |\n|---|---|---|---|---|---|---|"
    )
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            bag = write(Path(folder) / "recording", kind, shots, camera)
            times = [one_round(bag, kind.packed, shots) for _ in range(given.rounds + 1)]
        ours, opening, decoding, plain = np.array(times[1:]).T * 1e3 / len(shots)
        cells = [
            kind.name,
            f"{np.median(ours):.2f} ms",
            f"{np.median(opening):.2f} ms",
            f"{np.median(decoding):.2f} ms",
            f"{np.median(ours / decoding):.2f}",
            f"{np.median(decoding + plain):.2f} ms",
            f"{np.median(ours / (decoding + plain)):.2f}",
        ]
        print(f"| {' | '.join(cells)} |", flush=True)


def one_round(bag: Path, packed: bool, shots: Sequence[Shot]) -> tuple[float, float, float, float]:
    """Time each once: reading, opening alone, decoding, and the file's bytes."""
    return (
        seconds(lambda: read(bag)),
        seconds(lambda: open_source(bag)),
        seconds(lambda: decode(shots, packed)),
        seconds(lambda: read_plainly(bag)),
    )


if __name__ == "__main__":
    main()
