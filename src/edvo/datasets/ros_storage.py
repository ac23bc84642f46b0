"""What each file of a ROS bag offers: its topics, and its messages by their places."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from edvo.datasets.ros_files import Inflating, inflate
from edvo.datasets.ros_messages import STAMP_BYTES

_ZSTD_BLOCK = (1 << 17) + 64  # nothing comes out before the first block is complete


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


class Storage(ABC):
    """One file of a bag; `read` may be called from several threads."""

    kind: str

    @abstractmethod
    def topics(self) -> list[Topic]:
        """Its topics."""

    @abstractmethod
    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Find the messages of topics, with so many of their first bytes."""

    @abstractmethod
    def read(self, place: Place) -> bytes:
        """Read a message."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


class Connections(Storage):
    """What is common to those whose reader has a list of connections."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def topics(self) -> list[Topic]:
        """Its topics."""
        return [Topic(c.topic, c.msgtype, c.msgcount) for c in self._reader.connections]

    def _ids(self, topics: Sequence[str]) -> dict[int, str]:
        return {c.id: c.topic for c in self._reader.connections if c.topic in topics}


class MessagesPacked(Storage):
    """A storage whose messages are compressed one by one."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self.kind = storage.kind

    def topics(self) -> list[Topic]:
        """Its topics."""
        return self._storage.topics()

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Find the messages of topics, with so many of their first bytes."""
        for topic, place in self._storage.places(topics, _ZSTD_BLOCK):
            first = Inflating(place.head, "zstd", "a message").part(0, head)
            yield topic, place._replace(head=first)

    def read(self, place: Place) -> bytes:
        """Read a message."""
        return inflate(self._storage.read(place), "zstd", None, "a message")

    def close(self) -> None:
        """Close the file."""
        self._storage.close()
