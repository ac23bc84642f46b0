"""A ROS bag: its topics, and its messages one by one in any order.

The package rosbags opens the bag, checks its index and knows which topics it has. Its readers
give messages in order of time and to one thread only, so here each message's place is found
once, and messages are then taken from their places.
"""

import errno
import sqlite3
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from struct import Struct
from typing import Any, NamedTuple
from urllib.parse import quote

from edvo.datasets.ros_files import BoundedPath, Inflating, Recent, SharedFile, inflate
from edvo.datasets.ros_messages import STAMP_BYTES
from edvo.errors import DatasetError, MissingExtraError

_WHOLE_FILE = -1  # in place of a chunk: the offset counts from the start of the file
_RECORD_HEAD = 96  # the header of a message's record in ROS 1 has about 50 bytes; then its data
_ZSTD_BLOCK = (1 << 17) + 64  # nothing comes out before the first block is complete

# What a computer lacks rather than a bag.
_NOT_THE_BAG = (errno.EACCES, errno.EPERM, errno.EIO, errno.ENOSPC, errno.EMFILE)

_UINT32 = Struct("<I")
_MCAP_RECORD = Struct("<BQ")
_MCAP_MESSAGE = Struct("<HIQQ")
_MCAP_CHUNK = Struct("<QQQII")
_MCAP_IS_MESSAGE, _MCAP_IS_CHUNK = 0x05, 0x06


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: its name, its type as ROS 2 writes it, and how many messages it has."""

    name: str
    type: str
    count: int


class Place(NamedTuple):
    """Where a message is: storage, chunk, offset in it, bytes.

    With it when it was recorded (nanoseconds) and its first bytes, which hold its stamp.
    """

    storage: int
    chunk: int
    offset: int
    size: int
    recorded: int
    head: bytes


class Bag:
    """A ROS 1 bag, or a ROS 2 bag of sqlite3 or mcap files.

    Parameters
    ----------
    path : pathlib.Path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.

    Attributes
    ----------
    path : pathlib.Path
        The same.
    ros2 : bool
        Whether messages are CDR.
    kind : str
        For people: ``ROS 1``, ``ROS 2 mcap`` or ``ROS 2 sqlite3``.
    topics : tuple of Topic
        By name.

    Raises
    ------
    DatasetError
        If it is no bag or damaged.
    MissingExtraError
        If rosbags is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ros2 = path.is_dir() or path.suffix.lower() != ".bag"
        self._stack = ExitStack()
        try:
            self._storages = self._open()
        except BaseException:
            self.close()
            raise
        counts: dict[tuple[str, str], int] = {}
        for storage in self._storages:
            for topic in storage.topics():
                key = topic.name, topic.type
                counts[key] = counts.get(key, 0) + topic.count
        self.topics = tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    @property
    def kind(self) -> str:
        """What kind of bag it is, for people."""
        return self._storages[0].kind if self._storages else "ROS 2"

    def places(self, *topics: str) -> list[list[Place]]:
        """Find all messages of some topics, going through the bag once.

        Parameters
        ----------
        *topics : str
            Their names.

        Returns
        -------
        list of list of Place
            Of each topic, in the order in which they were recorded.

        Raises
        ------
        DatasetError
            If the bag is damaged there.
        """
        found: dict[str, list[Place]] = {topic: [] for topic in topics}
        for number, storage in enumerate(self._storages):
            with _OneLine(self.path):
                for topic, place in storage.places(topics):
                    found[topic].append(place._replace(storage=number))
        return [sorted(found[topic], key=lambda place: place.recorded) for topic in topics]

    def first(self, topic: str, count: int) -> list[Place]:
        """Find some messages of a topic, without looking at all.

        Parameters
        ----------
        topic : str
            Its name.
        count : int
            At most so many.

        Returns
        -------
        list of Place
            Those that come first in the file.

        Raises
        ------
        DatasetError
            If the bag is damaged there.
        """
        found: list[Place] = []
        for number, storage in enumerate(self._storages):
            with _OneLine(self.path):
                wanted = islice(storage.places((topic,)), count - len(found))
                found += [place._replace(storage=number) for _, place in wanted]
        return found

    def read(self, place: Place) -> bytes:
        """Read a message.

        Parameters
        ----------
        place : Place
            Of the message.

        Returns
        -------
        bytes
            As it was serialised.

        Raises
        ------
        DatasetError
            If the bag is damaged there.
        """
        with _OneLine(self.path):
            return self._storages[place.storage].read(place)

    def close(self) -> None:
        """Close its files."""
        self._stack.close()

    def _open(self) -> "list[_Storage]":
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
        except ImportError as error:
            raise MissingExtraError(
                f"{self.path}: reading ROS bags needs the extra ros; pip install 'edvo[ros]'"
            ) from error
        if not self.ros2:
            return [self._storage(Reader1(BoundedPath(self.path)))]
        if not self.path.is_dir() or (self.path / "metadata.yaml").exists():
            return self._storages2(Reader2, self.path)
        # A recorder that was killed leaves no metadata; the files may be whole all the same.
        files = [file for end in (".mcap", ".db3") for file in sorted(self.path.glob(f"*{end}"))]
        if not files:
            raise DatasetError(
                f"{self.path}: no .mcap or .db3 file in it; give the folder of a bag"
            )
        return [storage for file in files for storage in self._storages2(Reader2, file)]

    def _storages2(self, reader_type: Any, path: Path) -> "list[_Storage]":
        with _OneLine(path, "repair it with 'ros2 bag reindex' or 'mcap recover'"):
            reader = self._stack.enter_context(reader_type(BoundedPath(path)))
        whole = reader.storage
        packed = getattr(whole.metadata, "compression_mode", None) == "message"
        parts = [_storage2(each) for each in getattr(whole, "storages", [whole])]
        for part in parts:
            self._stack.callback(part.close)
        return [_MessagesPacked(part) for part in parts] if packed else parts

    def _storage(self, reader: Any) -> "_Storage":
        with _OneLine(self.path, "repair it with 'rosbag reindex'"):
            storage = _Ros1(self._stack.enter_context(reader))
        self._stack.callback(storage.close)
        return storage


class _OneLine:
    """Turn whatever a damaged file makes rosbags or SQLite raise into one line that names it."""

    def __init__(self, path: Path, mend: str = "copy or record it again") -> None:
        self.path, self.mend = path, mend

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, DatasetError) or not isinstance(error, Exception):
            return
        if isinstance(error, OSError) and error.errno in _NOT_THE_BAG:
            raise DatasetError(f"cannot read {self.path}: {error.strerror}") from error
        # Only what rosbags raises on purpose is said to people.
        purpose = type(error).__name__ in ("ReaderError", "AnyReaderError")
        reason = " ".join(str(error).split()).rstrip(".") if purpose else ""
        raise DatasetError(
            f"{self.path}: damaged, cut short or no bag{f' ({reason})' if reason else ''}; "
            f"{self.mend}"
        ) from error


class _Storage(ABC):
    """One file of a bag; `read` may be called from several threads."""

    kind: str

    @abstractmethod
    def topics(self) -> list[Topic]: ...

    @abstractmethod
    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Find the messages of topics, with so many of their first bytes."""

    @abstractmethod
    def read(self, place: Place) -> bytes: ...

    @abstractmethod
    def close(self) -> None: ...


class _Connections(_Storage):
    """What is common to those whose reader has a list of connections."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def topics(self) -> list[Topic]:
        return [Topic(c.topic, c.msgtype, c.msgcount) for c in self._reader.connections]

    def _ids(self, topics: Sequence[str]) -> dict[int, str]:
        return {c.id: c.topic for c in self._reader.connections if c.topic in topics}


class _Chunked(_Connections):
    """A file of chunks, each of them compressed or not."""

    def __init__(self, reader: Any) -> None:
        super().__init__(reader)
        self._file = SharedFile(Path(reader.path))
        self._inflated = Recent(self._inflate)
        self._begun: tuple[int, Inflating] | None = None
        # Of each chunk: where its data begin, how many bytes, how packed, how many unpacked.
        self._chunks: dict[int, tuple[int, int, str, int]] = {}

    def read(self, place: Place) -> bytes:
        return self._part(place.chunk, place.offset, place.size, whole=True)

    def close(self) -> None:
        self._file.close()

    def _size(self, chunk: int) -> int:
        return self._file.size if chunk == _WHOLE_FILE else self._chunks[chunk][3]

    def _part(self, chunk: int, offset: int, count: int, *, whole: bool = False) -> bytes:
        """Take some bytes of a chunk as it is unpacked, to there or as a whole.

        Going through a bag one needs the beginnings of its messages: behind the last of them a
        chunk is not unpacked.
        """
        if chunk == _WHOLE_FILE:
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


class _Ros1(_Chunked):
    kind = "ROS 1"

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
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
        header, at, _ = self._record(_WHOLE_FILE, chunk)
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


class _Mcap(_Chunked):
    kind = "ROS 2 mcap"

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Go through all messages, whether the file has an index of them or not."""
        ids = self._ids(topics)
        start, end = self._reader.data_start, self._reader.data_end
        ahead = _MCAP_MESSAGE.size + head
        for kind, offset, size, first in self._records(_WHOLE_FILE, start, end, ahead):
            if kind == _MCAP_IS_MESSAGE:
                yield from self._message(_WHOLE_FILE, offset, size, ids, first)
            elif kind == _MCAP_IS_CHUNK:
                if offset not in self._chunks:
                    self._chunks[offset] = self._chunk(offset)
                unpacked = self._size(offset)
                for inner, at, length, begin in self._records(offset, 0, unpacked, ahead):
                    if inner == _MCAP_IS_MESSAGE:
                        yield from self._message(offset, at, length, ids, begin)

    def _records(
        self, chunk: int, at: int, end: int, ahead: int
    ) -> Iterator[tuple[int, int, int, bytes]]:
        """Go through records; gives kind, place and size of each, and so many of its first bytes.

        They are read with its head, since the bytes count less than how often one asks for some.
        """
        before = _MCAP_RECORD.size
        while at < end:
            data = self._part(chunk, at, max(min(before + ahead, end - at), before))
            kind, size = _MCAP_RECORD.unpack_from(data)
            at += before
            if size > end - at:
                raise DatasetError(f"{self._file.path} is cut short or damaged; record it again")
            yield kind, at, size, data[before : before + size]
            at += size

    def _message(
        self, chunk: int, at: int, size: int, ids: dict[int, str], first: bytes
    ) -> Iterator[tuple[str, Place]]:
        before = _MCAP_MESSAGE.size
        channel, _, recorded, _ = _MCAP_MESSAGE.unpack_from(first)
        if channel in ids:
            place = Place(0, chunk, at + before, size - before, recorded, first[before:])
            yield ids[channel], place

    def _chunk(self, at: int) -> tuple[int, int, str, int]:
        _, _, unpacked, _, length = _MCAP_CHUNK.unpack(self._file.read(at, _MCAP_CHUNK.size))
        at += _MCAP_CHUNK.size
        compression = self._file.read(at, length).decode("ascii")
        stored = int.from_bytes(self._file.read(at + length, 8), "little")
        return at + length + 8, stored, compression, unpacked


class _Sqlite(_Connections):
    kind = "ROS 2 sqlite3"

    def __init__(self, reader: Any) -> None:
        super().__init__(reader)
        self._lock = threading.Lock()
        self._base = sqlite3.connect(
            f"file:{quote(str(reader.path))}?immutable=1", uri=True, check_same_thread=False
        )

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        ids = self._ids(topics)
        marks = ",".join("?" * len(ids))
        query = f"SELECT id, topic_id, timestamp FROM messages WHERE topic_id IN ({marks})"
        with self._lock:
            rows = self._base.execute(query, sorted(ids)).fetchall()
        for row, topic, recorded in rows:
            yield ids[topic], Place(0, int(row), 0, 0, int(recorded), self._blob(row, head))

    def read(self, place: Place) -> bytes:
        return self._blob(place.chunk, None)

    def _blob(self, row: int, count: int | None) -> bytes:
        """Read a message, or so many of its first bytes, which does not load the others."""
        with (
            self._lock,
            closing(self._base.blobopen("messages", "data", row, readonly=True)) as blob,
        ):
            return blob.read(len(blob) if count is None else min(count, len(blob)))

    def close(self) -> None:
        self._base.close()


class _MessagesPacked(_Storage):
    """A storage whose messages are compressed one by one."""

    def __init__(self, storage: _Storage) -> None:
        self._storage = storage
        self.kind = storage.kind

    def topics(self) -> list[Topic]:
        return self._storage.topics()

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        for topic, place in self._storage.places(topics, _ZSTD_BLOCK):
            first = Inflating(place.head, "zstd", "a message").part(0, head)
            yield topic, place._replace(head=first)

    def read(self, place: Place) -> bytes:
        return inflate(self._storage.read(place), "zstd", None, "a message")

    def close(self) -> None:
        self._storage.close()


def _storage2(reader: Any) -> _Storage:
    return _Sqlite(reader) if type(reader).__name__.startswith("Sqlite") else _Mcap(reader)
