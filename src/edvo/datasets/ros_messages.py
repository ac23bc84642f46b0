"""The three ROS messages that matter, taken from their bytes.

Their layout has been the same in every ROS since the first, but for the serialisation: ROS 1
packs without gaps and little-endian; ROS 2 writes CDR, where numbers are aligned to their size
and the byte order is in the first four bytes. Parsed here and not by generated code, so that a
declared size is checked against what is there before anything is allocated, and an image is a
view and not a copy.
"""

import struct
from dataclasses import dataclass

from edvo.errors import DatasetError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

STAMP_BYTES = 16
"""So many bytes of a message hold its header's stamp."""


@dataclass(frozen=True)
class Header:
    """``std_msgs/Header``.

    Attributes
    ----------
    stamp : int
        Nanoseconds; 0 where the driver wrote none.
    frame_id : str
        Of what the message is; without the slash that ROS 1 puts before.
    """

    stamp: int
    frame_id: str


@dataclass(frozen=True)
class ImageMessage:
    """``sensor_msgs/Image``; `data` is a view of the message, rows of `step` bytes."""

    header: Header
    height: int
    width: int
    encoding: str
    big_endian: bool
    step: int
    data: memoryview


@dataclass(frozen=True)
class CompressedImageMessage:
    """``sensor_msgs/CompressedImage``; `data` is a view of the message."""

    header: Header
    format: str
    data: memoryview


@dataclass(frozen=True)
class CameraInfo:
    """``sensor_msgs/CameraInfo``: D, K and P as ROS names them, row by row."""

    header: Header
    height: int
    width: int
    model: str
    distortion: tuple[float, ...]
    intrinsics: tuple[float, ...]
    projection: tuple[float, ...]


_SIZES = {code: struct.calcsize(f"<{code}") for code in "BIid"}


class _Cursor:
    """Reads one value after the other."""

    def __init__(self, data: bytes, ros2: bool) -> None:
        self.view = memoryview(data)
        self.ros2 = ros2
        self.order = "<"
        self.at = self.start = 0
        if ros2:
            kind = bytes(self.view[:2])
            if kind not in (b"\x00\x00", b"\x00\x01"):
                raise DatasetError("the message is no CDR")
            self.order = "<" if kind[1] else ">"
            self.at = self.start = 4  # alignment counts from behind these

    def number(self, code: str) -> int:
        return int(self.numbers(code, 1)[0])

    def numbers(self, code: str, count: int) -> tuple[float, ...]:
        size = _SIZES[code]
        if self.ros2 and count:
            self.at += (self.start - self.at) % size
        data = self.take(size * count)
        # `struct` keeps the formats it has compiled.
        return struct.unpack(f"{self.order}{count}{code}", data)

    def take(self, count: int) -> memoryview:
        if self.at + count > len(self.view):
            raise DatasetError("the message is shorter than it claims")
        self.at += count
        return self.view[self.at - count : self.at]

    def sequence(self) -> memoryview:
        return self.take(self.number("I"))

    def text(self) -> str:
        return bytes(self.sequence()).rstrip(b"\x00").decode("utf-8", "replace")

    def header(self) -> Header:
        if not self.ros2:
            self.number("I")  # seq
        seconds, nanoseconds = self.number("i" if self.ros2 else "I"), self.number("I")
        return Header(seconds * 10**9 + nanoseconds, self.text().lstrip("/"))


def parse_stamp(head: bytes, ros2: bool) -> int:
    """Take the header's stamp from the first bytes of a message.

    Parameters
    ----------
    head : bytes
        At least the first `STAMP_BYTES` of the message.
    ros2 : bool
        Whether it is CDR.

    Returns
    -------
    int
        Nanoseconds.

    Raises
    ------
    DatasetError
        If there are fewer bytes.
    """
    cursor = _Cursor(head, ros2)
    if not ros2:
        cursor.number("I")
    return cursor.number("i" if ros2 else "I") * 10**9 + cursor.number("I")


def parse_image(data: bytes, ros2: bool) -> ImageMessage:
    """Take apart a ``sensor_msgs/Image``.

    Parameters
    ----------
    data : bytes
        The message.
    ros2 : bool
        Whether it is CDR.

    Returns
    -------
    ImageMessage
        As it is written; sizes are not checked against each other yet.

    Raises
    ------
    DatasetError
        If the bytes end before.
    """
    cursor = _Cursor(data, ros2)
    header = cursor.header()
    height, width = cursor.number("I"), cursor.number("I")
    encoding, big_endian, step = cursor.text(), cursor.number("B"), cursor.number("I")
    return ImageMessage(header, height, width, encoding, bool(big_endian), step, cursor.sequence())


def parse_compressed_image(data: bytes, ros2: bool) -> CompressedImageMessage:
    """Take apart a ``sensor_msgs/CompressedImage``; parameters as `parse_image`.

    Returns
    -------
    CompressedImageMessage
        As it is written.

    Raises
    ------
    DatasetError
        If the bytes end before.
    """
    cursor = _Cursor(data, ros2)
    return CompressedImageMessage(cursor.header(), cursor.text(), cursor.sequence())


def parse_camera_info(data: bytes, ros2: bool) -> CameraInfo:
    """Take apart a ``sensor_msgs/CameraInfo``; parameters as `parse_image`.

    Returns
    -------
    CameraInfo
        As it is written.

    Raises
    ------
    DatasetError
        If the bytes end before.
    """
    cursor = _Cursor(data, ros2)
    header = cursor.header()
    height, width, model = cursor.number("I"), cursor.number("I"), cursor.text()
    distortion = cursor.numbers("d", cursor.number("I"))
    intrinsics, _, projection = (cursor.numbers("d", count) for count in (9, 9, 12))
    return CameraInfo(header, height, width, model, distortion, intrinsics, projection)
