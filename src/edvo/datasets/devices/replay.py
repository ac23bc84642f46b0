"""A recording that is played as if it were a camera."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing

from edvo.datasets.derived import Derived
from edvo.datasets.readahead import read_ahead
from edvo.datasets.source import Reading, Source
from edvo.errors import DatasetError

# A frame that is so late already is not decoded any more: a camera would not have waited.
_LATE_S = 0.05
_WORKERS = 2
_AHEAD = 4


class Replay(Derived):
    """Delivers the frames of a recording at the pace at which they were taken.

    Parameters
    ----------
    source : Source
        What is played.
    rate : float
        Seconds of the recording a second.
    now, wait : callable
        The clock and the waiting, seconds.

    Raises
    ------
    DatasetError
        If the rate is not positive.
    """

    format = "replay"
    sensor = None

    def __init__(
        self,
        source: Source,
        *,
        rate: float = 1.0,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        if not rate > 0.0:
            raise DatasetError(f"{source.path}: rate is {rate}; give seconds a second, above 0")
        super().__init__(source)
        self._now, self._wait = now, wait
        self._due = (source.timestamps - source.timestamps[0]) / rate
        self._missed = 0

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self._source.name

    @property
    def missed(self) -> int:
        """Frames so far that were due before they could be decoded."""
        return self._missed

    def readings(self) -> Generator[Reading, None, None]:
        """Give each frame at its time."""
        begin = self._now()

        def in_time() -> Iterator[int]:
            for index in range(len(self._source)):
                if self._now() - begin > self._due[index] + _LATE_S:
                    self._missed += 1
                else:
                    yield index

        with closing(
            read_ahead(self._source, in_time(), workers=_WORKERS, ahead=_AHEAD)
        ) as readings:
            for reading in readings:
                left = begin + float(self._due[reading.index]) - self._now()
                if left > 0.0:
                    self._wait(left)
                yield reading

    def close(self) -> None:
        """Nothing is held."""
