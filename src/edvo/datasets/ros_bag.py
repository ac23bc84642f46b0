"""A ROS bag: its topics, and its messages one by one in any order.

The package rosbags opens the bag, checks its index and knows which topics it has. Its readers
give messages in order of time and to one thread only, so here each message's place is found
once, and messages are then taken from their places.
"""

import errno
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any

from edvo.datasets.ros_bag1 import Ros1
from edvo.datasets.ros_files import BoundedPath
from edvo.datasets.ros_mcap import Mcap
from edvo.datasets.ros_sqlite import Sqlite
from edvo.datasets.ros_storage import MessagesPacked, Place, Storage, Topic
from edvo.datasets.text_files import check_size
from edvo.errors import DatasetError, MissingExtraError

_LARGEST_METADATA = 4_000_000  # bytes; it has some thousand and a hundred for each file

# What a computer lacks rather than a bag.
_NOT_THE_BAG = (errno.EACCES, errno.EPERM, errno.EIO, errno.ENOSPC, errno.EMFILE)


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

    def _open(self) -> list[Storage]:
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
        except ImportError as error:
            raise MissingExtraError(
                f"{self.path}: reading ROS bags needs the extra ros; pip install 'edvo[ros]'"
            ) from error
        if not self.ros2:
            return [self._storage(Reader1(BoundedPath(self.path)))]
        metadata = self.path / "metadata.yaml"
        if not self.path.is_dir() or metadata.exists():
            if metadata.exists():
                check_size(metadata, "make it by 'ros2 bag reindex'", _LARGEST_METADATA)
            return self._storages2(Reader2, self.path)
        # A recorder that was killed leaves no metadata; the files may be whole all the same.
        files = [file for end in (".mcap", ".db3") for file in sorted(self.path.glob(f"*{end}"))]
        if not files:
            raise DatasetError(
                f"{self.path}: no .mcap or .db3 file in it; give the folder of a bag"
            )
        return [storage for file in files for storage in self._storages2(Reader2, file)]

    def _storages2(self, reader_type: Any, path: Path) -> list[Storage]:
        with _OneLine(path, "repair it with 'ros2 bag reindex' or 'mcap recover'"):
            reader = self._stack.enter_context(reader_type(BoundedPath(path)))
        whole = reader.storage
        packed = getattr(whole.metadata, "compression_mode", None) == "message"
        parts = [_storage2(each) for each in getattr(whole, "storages", [whole])]
        for part in parts:
            self._stack.callback(part.close)
        return [MessagesPacked(part) for part in parts] if packed else parts

    def _storage(self, reader: Any) -> Storage:
        with _OneLine(self.path, "repair it with 'rosbag reindex'"):
            storage = Ros1(self._stack.enter_context(reader))
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


def _storage2(reader: Any) -> Storage:
    return Sqlite(reader) if type(reader).__name__.startswith("Sqlite") else Mcap(reader)
