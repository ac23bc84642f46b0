"""Files of ROS bags that hold messages in chunks."""

from pathlib import Path
from typing import Any

from edvo.datasets.ros_files import Inflating, Recent, SharedFile, inflate
from edvo.datasets.ros_storage import Connections, Place
from edvo.errors import DatasetError

WHOLE_FILE = -1  # in place of a chunk: the offset counts from the start of the file


class Chunked(Connections):
    """A file of chunks, each of them compressed or not."""

    def __init__(self, reader: Any) -> None:
        super().__init__(reader)
        self._file = SharedFile(Path(reader.path))
        self._inflated = Recent(self._inflate)
        self._begun: tuple[int, Inflating] | None = None
        # Of each chunk: where its data begin, how many bytes, how packed, how many unpacked.
        self._chunks: dict[int, tuple[int, int, str, int]] = {}

    def read(self, place: Place) -> bytes:
        """Read a message."""
        return self._part(place.chunk, place.offset, place.size, whole=True)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _size(self, chunk: int) -> int:
        return self._file.size if chunk == WHOLE_FILE else self._chunks[chunk][3]

    def _part(self, chunk: int, offset: int, count: int, *, whole: bool = False) -> bytes:
        """Take some bytes of a chunk as it is unpacked, to there or as a whole.

        Going through a bag one needs the beginnings of its messages: behind the last of them a
        chunk is not unpacked.
        """
        if chunk == WHOLE_FILE:
            return self._file.read(offset, count)
        start, size, compression, unpacked = self._chunks[chunk]
        if offset + count > unpacked:
            raise DatasetError(f"{self._file.path}: a message is longer than its chunk")
        if not compression:
            return self._file.read(start + offset, count)
        if whole:
            data = self._inflated(chunk)[offset : offset + count]
        else:
            begun = self._begun
            if begun is None or begun[0] != chunk:
                packed = self._file.read(start, size)
                begun = self._begun = chunk, Inflating(packed, compression, self._name(chunk))
            data = begun[1].part(offset, count)
        if len(data) != count:
            raise DatasetError(f"{self._file.path}: a message is longer than its chunk")
        return data

    def _name(self, chunk: int) -> str:
        return f"{self._file.path}, chunk at byte {chunk}"

    def _inflate(self, chunk: int) -> bytes:
        start, size, compression, unpacked = self._chunks[chunk]
        return inflate(self._file.read(start, size), compression, unpacked, self._name(chunk))
