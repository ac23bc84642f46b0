"""The messages of an SQLite file of a ROS 2 bag."""

import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any
from urllib.parse import quote

from edvo.datasets.ros_messages import STAMP_BYTES
from edvo.datasets.ros_storage import Connections, Place


class Sqlite(Connections):
    """A database of messages."""

    kind = "ROS 2 sqlite3"

    def __init__(self, reader: Any) -> None:
        super().__init__(reader)
        self._lock = threading.Lock()
        self._base = sqlite3.connect(
            f"file:{quote(str(reader.path))}?immutable=1", uri=True, check_same_thread=False
        )

    def places(self, topics: Sequence[str], head: int = STAMP_BYTES) -> Iterator[tuple[str, Place]]:
        """Find the messages of topics, with so many of their first bytes."""
        ids = self._ids(topics)
        marks = ",".join("?" * len(ids))
        query = f"SELECT id, topic_id, timestamp FROM messages WHERE topic_id IN ({marks})"
        with self._lock:
            rows = self._base.execute(query, sorted(ids)).fetchall()
        for row, topic, recorded in rows:
            yield ids[topic], Place(0, int(row), 0, 0, int(recorded), self._blob(row, head))

    def read(self, place: Place) -> bytes:
        """Read a message."""
        return self._blob(place.chunk, None)

    def _blob(self, row: int, count: int | None) -> bytes:
        """Read a message, or so many of its first bytes, which does not load the others."""
        with (
            self._lock,
            closing(self._base.blobopen("messages", "data", row, readonly=True)) as blob,
        ):
            return blob.read(len(blob) if count is None else min(count, len(blob)))

    def close(self) -> None:
        """Close the file."""
        self._base.close()
