"""The messages of an mcap file."""

from collections.abc import Iterator, Sequence
from struct import Struct

from edvo.datasets.ros_chunks import WHOLE_FILE, Chunked
from edvo.datasets.ros_messages import STAMP_BYTES
from edvo.datasets.ros_storage import Place
from edvo.errors import DatasetError

_RECORD = Struct("<BQ")
_MESSAGE = Struct("<HIQQ")
_CHUNK = Struct("<QQQII")
_IS_MESSAGE, _IS_CHUNK = 0x05, 0x06


class Mcap(Chunked):
    """An mcap file, with an index or without."""

    kind = "ROS 2 mcap"

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Go through all messages, whether the file has an index of them or not."""
        ids = self._ids(topics)
        start, end = self._reader.data_start, self._reader.data_end
        ahead = _MESSAGE.size + head
        for kind, offset, size, first in self._records(WHOLE_FILE, start, end, ahead):
            if kind == _IS_MESSAGE:
                yield from self._message(WHOLE_FILE, offset, size, ids, first)
            elif kind == _IS_CHUNK:
                if offset not in self._chunks:
                    self._chunks[offset] = self._chunk(offset)
                unpacked = self._size(offset)
                for inner, at, length, begin in self._records(offset, 0, unpacked, ahead):
                    if inner == _IS_MESSAGE:
                        yield from self._message(offset, at, length, ids, begin)

    def _records(
        self, chunk: int, at: int, end: int, ahead: int
    ) -> Iterator[tuple[int, int, int, bytes]]:
        """Go through records; gives kind, place and size of each, and so many of its first bytes.

        They are read with its head, since the bytes count less than how often one asks for some.
        """
        before = _RECORD.size
        while at < end:
            data = self._part(chunk, at, max(min(before + ahead, end - at), before))
            kind, size = _RECORD.unpack_from(data)
            at += before
            if size > end - at:
                raise DatasetError(f"{self._file.path} is cut short or damaged; record it again")
            yield kind, at, size, data[before : before + size]
            at += size

    def _message(
        self, chunk: int, at: int, size: int, ids: dict[int, str], first: bytes
    ) -> Iterator[tuple[str, Place]]:
        before = _MESSAGE.size
        channel, _, recorded, _ = _MESSAGE.unpack_from(first)
        if channel in ids:
            place = Place(0, chunk, at + before, size - before, recorded, first[before:])
            yield ids[channel], place

    def _chunk(self, at: int) -> tuple[int, int, str, int]:
        _, _, unpacked, _, length = _CHUNK.unpack(self._file.read(at, _CHUNK.size))
        at += _CHUNK.size
        compression = self._file.read(at, length).decode("ascii")
        stored = int.from_bytes(self._file.read(at + length, 8), "little")
        return at + length + 8, stored, compression, unpacked
