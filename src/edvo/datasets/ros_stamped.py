"""Messages of a bag's image topics: their times, and the images in them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.ros_bag import Bag
from edvo.datasets.ros_images import decompressed_colour, decompressed_depth, depth_of, grey_of
from edvo.datasets.ros_messages import parse_compressed_image, parse_image, parse_stamp
from edvo.datasets.ros_storage import Place
from edvo.errors import DatasetError, FrameError

_NANOSECONDS = 10**9


@dataclass(frozen=True)
class Stamped:
    """The messages of a topic, with their times.

    Parameters
    ----------
    name : str
        The topic.
    places : sequence of Place
        Where the messages are.
    stamps : ndarray of int64, shape (N,)
        Their times, nanoseconds.
    warnings : tuple of str
        What is wrong with them, a line each.
    """

    name: str
    places: Sequence[Place]
    stamps: NDArray[np.int64]
    warnings: tuple[str, ...] = ()

    @property
    def has_stamps(self) -> bool:
        """Whether any of them has a time."""
        return bool(self.stamps.any())

    @property
    def span(self) -> str:
        """From when to when they go, for people."""
        return f"{stamp_text(self.stamps[0])} to {stamp_text(self.stamps[-1])}"

    def by_recording(self) -> "Stamped":
        """Take the times at which they were recorded instead."""
        recorded = np.array([place.recorded for place in self.places], np.int64)
        return replace(self, stamps=recorded)

    def in_order(self, warnings: list[str]) -> "Stamped":
        """Sort them by time, leave out repeated times, and add what was wrong to `warnings`."""
        back = int(np.count_nonzero(np.diff(self.stamps) < 0))
        if back:
            warnings.append(f"{self.name}: {back} images go back in time: sorted")
        stamps, order = np.unique(self.stamps, return_index=True)
        again = len(self.stamps) - len(stamps)
        if again:
            warnings.append(f"{self.name}: {again} images repeat a time: left out")
        return replace(self, stamps=stamps, places=[self.places[i] for i in order])


def stamp_topic(bag: Bag, topic: str, places: Sequence[Place]) -> Stamped:
    """Take the header's stamps of all messages of a topic.

    Parameters
    ----------
    bag : Bag
        Whose.
    topic : str
        Its name.
    places : sequence of Place
        Its messages.

    Returns
    -------
    Stamped
        Without those whose stamp cannot be read.

    Raises
    ------
    DatasetError
        If none can.
    """
    good: list[Place] = []
    stamps: list[int] = []
    problems: list[str] = []
    for place in places:
        try:
            stamps.append(parse_stamp(place.head, bag.ros2))
            good.append(place)
        except DatasetError as error:
            problems.append(str(error))
    if not good:
        reason = "; ".join(problems[:1]) or "there is none"
        raise DatasetError(f"{bag.path}: no message of {topic} can be read: {reason}")
    count = f"{len(problems)} of {len(places)}"
    return Stamped(
        topic,
        good,
        np.array(stamps, np.int64),
        tuple(f"{topic}: {count} messages cannot be read: {text}" for text in problems[:1]),
    )


def load_colour(bag: Bag, place: Place, raw: bool, where: str) -> NDArray[np.uint8]:
    """Read a colour image.

    Parameters
    ----------
    bag : Bag
        Where it is.
    place : Place
        Of its message.
    raw : bool
        Whether that is a ``sensor_msgs/Image``, or else a ``CompressedImage``.
    where : str
        Named in errors.

    Returns
    -------
    ndarray of uint8, shape (H, W) or (H, W, C)
        Grey if it was raw; else as it was compressed.

    Raises
    ------
    FrameError
        If it is damaged or no colour image.
    """
    with _naming(where):
        data = bag.read(place)
        if raw:
            return grey_of(parse_image(data, bag.ros2), where)
        return decompressed_colour(parse_compressed_image(data, bag.ros2), where)


def load_depth(
    bag: Bag, place: Place, raw: bool, where: str
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Read a depth image; parameters as `load_colour`.

    Returns
    -------
    ndarray of uint16 or float32, shape (H, W)
        Values as they are.

    Raises
    ------
    FrameError
        If it is damaged or no depth image.
    """
    with _naming(where):
        data = bag.read(place)
        if raw:
            return depth_of(parse_image(data, bag.ros2), where)
        return decompressed_depth(parse_compressed_image(data, bag.ros2), where)


@contextmanager
def _naming(where: str) -> Iterator[None]:
    """Make a message that cannot be read a matter of its frame alone."""
    try:
        yield
    except DatasetError as error:
        raise FrameError(f"{where}: {error}") from error


def seconds(stamps: NDArray[np.int64], base: int) -> NDArray[np.float64]:
    """Convert nanoseconds to seconds from a near origin, where a double has nanoseconds."""
    return np.asarray((stamps - base) / _NANOSECONDS, np.float64)


def stamp_text(stamp: int | np.int64) -> str:
    """Write nanoseconds as seconds with nine decimals."""
    return f"{int(stamp) // _NANOSECONDS}.{int(stamp) % _NANOSECONDS:09d}"
