"""The messages of a ROS 1 bag."""

from collections.abc import Iterator, Sequence
from io import BytesIO
from struct import Struct
from typing import Any

from edvo.datasets.ros_chunks import WHOLE_FILE, Chunked
from edvo.datasets.ros_messages import STAMP_BYTES
from edvo.datasets.ros_storage import Place
from edvo.errors import DatasetError

_RECORD_HEAD = 96  # the header of a message's record in ROS 1 has about 50 bytes; then its data

_UINT32 = Struct("<I")


class Ros1(Chunked):
    """A ROS 1 bag."""

    kind = "ROS 1"

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Find the messages of topics, with so many of their first bytes."""
        # By place, so that each compressed chunk is unpacked once.
        for chunk, start, recorded, topic in sorted(
            (entry.chunk_pos, entry.offset, entry.time, topic)
            for connection, topic in self._ids(topics).items()
            for entry in self._reader.indexes[connection]
        ):
            if chunk not in self._chunks:
                self._chunks[chunk] = self._chunk(chunk)
            offset, size, first = self._message(chunk, start, head)
            yield topic, Place(0, chunk, offset, size, recorded, first)

    def _chunk(self, chunk: int) -> tuple[int, int, str, int]:
        header, at, _ = self._record(WHOLE_FILE, chunk)
        (stored,) = _UINT32.unpack(self._file.read(at, 4))
        compression = header.get_string("compression")
        compression = "" if compression == "none" else compression
        return at + 4, stored, compression, header.get_uint32("size")

    def _message(self, chunk: int, offset: int, head: int) -> tuple[int, int, bytes]:
        """Find the data of a message's record; descriptions of its connection may lie before."""
        while True:
            header, at, behind = self._record(chunk, offset)
            (size,) = _UINT32.unpack(behind[:4] if len(behind) >= 4 else self._part(chunk, at, 4))
            if header.get_uint8("op") == 2:
                first = behind[4 : 4 + min(head, size)]
                if len(first) < min(head, size):
                    first = self._part(chunk, at + 4, min(head, size))
                return at + 4, size, first
            if header.get_uint8("op") != 7:
                raise DatasetError(f"{self._file.path}: no message where the index says one is")
            offset = at + 4 + size

    def _record(self, chunk: int, offset: int) -> tuple[Any, int, bytes]:
        """Read a record's header; returns it, where it ends, and what was read behind it."""
        from rosbags.rosbag1.reader import Header

        ahead = min(_RECORD_HEAD, self._size(chunk) - offset)
        data = self._part(chunk, offset, ahead)
        (length,) = _UINT32.unpack_from(data)
        if length + 4 > ahead:
            data = self._part(chunk, offset, length + 4)
        return Header.read(BytesIO(data)), offset + 4 + length, data[4 + length :]
