"""Between the tracker, which never waits, and the viewer, which takes the time it needs."""

import threading
from collections import deque
from collections.abc import Callable

from edvo.datasets.readahead import give_way
from edvo.report.viewer_shot import Shot

MOST_SHOTS = 20_000  # frames that wait, most of them as numbers alone


class Backlog:
    """Frames that wait to be drawn, and the thread that draws them.

    Parameters
    ----------
    draw : callable
        Draws one; called in a thread of its own. What it raises ends the drawing, see `failure`.
    most_pictures : int
        So many frames may wait with their images. Once there are more, images are left out: of
        the newest frame, or, where that is a keyframe, of the oldest one that is none, since
        the map is made of keyframes.

    Attributes
    ----------
    put_count : int
        Frames handed in.
    dropped_pictures : int
        Those whose images were left out.
    dropped : int
        Those that were left out altogether: the thread is more than `MOST_SHOTS` behind, or has
        ended.
    failure : Exception or None
        What drawing has failed with.
    """

    def __init__(self, draw: Callable[[Shot], None], most_pictures: int) -> None:
        self.put_count = self.dropped_pictures = self.dropped = 0
        self.failure: Exception | None = None
        self._draw, self._most = draw, most_pictures
        self._waiting: deque[Shot] = deque()
        self._pictures = 0  # of those that wait
        self._closed = self._given_up = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="edvo-view", daemon=True)
        self._thread.start()

    def put(self, shot: Shot) -> None:
        """Hand in a frame; returns at once."""
        with self._changed:
            self.put_count += 1
            if self.failure is not None or len(self._waiting) >= MOST_SHOTS:
                self.dropped += 1
                return
            if shot.frame is not None and self._pictures >= self._most:
                self.dropped_pictures += 1
                if not (shot.result.is_keyframe and self._spare_one()):
                    shot = shot.without_picture()
            self._pictures += shot.frame is not None
            self._waiting.append(shot)
            self._changed.notify()

    def close(self, timeout_s: float | None = None) -> bool:
        """Draw what waits, and end.

        Parameters
        ----------
        timeout_s : float, optional
            Give up after so many seconds; never by default.

        Returns
        -------
        bool
            Whether all was drawn.
        """
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self.give_up()
            return False
        return self.failure is None

    def give_up(self) -> None:
        """Draw no more than what is being drawn."""
        with self._changed:
            self._given_up = True
            self.dropped += len(self._waiting)
            self._waiting.clear()
            self._changed.notify()

    def _spare_one(self) -> bool:
        """Leave out the images of the oldest frame that is no keyframe."""
        for place, shot in enumerate(self._waiting):
            if shot.frame is not None and not shot.result.is_keyframe:
                self._waiting[place] = shot.without_picture()
                self._pictures -= 1
                return True
        return False

    def _work(self) -> None:
        give_way()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed or self._given_up)
                if not self._waiting:
                    return
                shot = self._waiting.popleft()
                self._pictures -= shot.frame is not None
            try:
                self._draw(shot)
            except Exception as error:  # a viewer that fails must not end the run
                with self._changed:
                    self.failure = error
                    self.dropped += len(self._waiting)
                    self._waiting.clear()
                return
