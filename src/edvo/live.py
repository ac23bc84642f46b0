"""Tracking what cannot wait: the newest frame counts, older ones are dropped.

A camera delivers whether or not anyone is ready. A thread takes each of its frames; the tracker
gets the newest when it asks, so that its pose is never older than one frame and one track call.
"""

import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from types import TracebackType
from typing import Generic, Self, TypeVar

from edvo.frame import Frame
from edvo.odometry import Odometry, TrackedFrame

T = TypeVar("T")

# How long a wait for the next item may last before `stop` is asked again.
_PATIENCE_S = 0.1
# A source that is in the middle of waiting for its camera is not waited for any longer.
_FAREWELL_S = 2.0


class Latest(Generic[T]):
    """Iterates over the newest of what a thread takes from elsewhere.

    Parameters
    ----------
    items : iterable
        Drawn on in a thread of its own until it ends, as fast as it gives. What it raises is
        raised here, after the last item.
    stop : callable, optional
        Asked ten times a second; once it says yes, the iteration ends.

    Notes
    -----
    Closing it, or leaving its ``with``, ends the thread as soon as `items` gives the next item,
    and closes `items` if it is a generator.

    Examples
    --------
    >>> with Latest([1, 2, 3]) as latest:
    ...     last = list(latest)[-1]
    >>> last
    3
    """

    def __init__(self, items: Iterable[T], stop: Callable[[], bool] | None = None) -> None:
        self._items = items
        self._stop = stop
        self._news = threading.Condition()
        self._slot: list[T] = []  # at most one
        self._dropped = 0
        self._ended = False
        self._closed = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._draw, name="edvo-live", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Items so far that a newer one took the place of."""
        with self._news:
            return self._dropped

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        with self._news:
            while not (self._stop is not None and self._stop()):
                if self._slot:
                    return self._slot.pop()
                if self._ended:
                    error, self._error = self._error, None
                    raise error or StopIteration
                self._news.wait(_PATIENCE_S)
        raise StopIteration

    def close(self) -> None:
        """End the thread."""
        with self._news:
            self._closed = True
        if self._thread is not threading.current_thread():
            self._thread.join(_FAREWELL_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _draw(self) -> None:
        found: BaseException | None = None
        try:
            for item in self._items:
                with self._news:
                    if self._closed:
                        break
                    self._dropped += len(self._slot)
                    self._slot[:] = [item]
                    self._news.notify()
            if isinstance(self._items, Generator):  # which can only end in the thread it runs in
                self._items.close()
        except BaseException as error:
            found = error
        with self._news:
            self._error, self._ended = found, True
            self._news.notify()


class Following:
    """The poses of a camera while it runs; made by `follow`.

    Iterating gives an `edvo.TrackedFrame` for each frame that was tracked.

    Attributes
    ----------
    odometry : Odometry
        What tracks.
    """

    def __init__(
        self, frames: Iterable[Frame], odometry: Odometry, stop: Callable[[], bool] | None
    ) -> None:
        self.odometry = odometry
        self._latest = Latest(frames, stop)

    @property
    def dropped(self) -> int:
        """Frames so far that were left out because a newer one was there."""
        return self._latest.dropped

    def __iter__(self) -> Iterator[TrackedFrame]:
        return self

    def __next__(self) -> TrackedFrame:
        return self.odometry.track(next(self._latest))

    def close(self) -> None:
        """End the thread that takes frames; leaving a ``with`` does it too."""
        self._latest.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def follow(
    frames: Iterable[Frame], odometry: Odometry, *, stop: Callable[[], bool] | None = None
) -> Following:
    """Track frames as they come, and drop those that there is no time for.

    Parameters
    ----------
    frames : iterable of Frame
        A camera: for instance a generator that waits for its next image. It is drawn on in a
        thread of its own.
    odometry : Odometry
        What tracks.
    stop : callable, optional
        Asked ten times a second, also while no frame comes; once it says yes, the iteration ends.

    Returns
    -------
    Following
        To iterate over, best within a ``with``.

    Raises
    ------
    FrameError
        While iterating: if a frame is not of the camera's size. What `frames` raises comes
        through too.

    Examples
    --------
    >>> import numpy as np
    >>> from edvo import Camera, Frame, Odometry
    >>> camera = Camera(width=64, height=48, fx=50, fy=50, cx=31.5, cy=23.5)
    >>> def my_camera():
    ...     for n in range(3):  # wait for an image, then
    ...         grey = np.zeros((48, 64), np.uint8)
    ...         yield Frame(n / 30, grey, np.ones((48, 64), np.float32))
    >>> with follow(my_camera(), Odometry(camera)) as following:
    ...     poses = [tracked.T_world_cam for tracked in following]
    >>> len(poses) + following.dropped
    3
    """
    return Following(frames, odometry, stop)
