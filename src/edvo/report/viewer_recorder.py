"""Logging the same to several streams of the viewer's library."""

from collections.abc import Sequence
from typing import Any

from edvo.report.viewer_names import FRAME, TIME


class Recorder:
    """What is drawn goes here.

    Parameters
    ----------
    streams : sequence of rerun.RecordingStream
        All of them get the same.
    """

    def __init__(self, streams: Sequence[Any]) -> None:
        self._streams = list(streams)

    def leave(self, stream: Any) -> None:
        """Log to this one no more."""
        self._streams.remove(stream)

    def at(self, seconds: float, index: int) -> None:
        """Say what time it is for all that is logged next by this thread.

        Parameters
        ----------
        seconds : float
            Since the first frame.
        index : int
            Number of the frame.
        """
        for stream in self._streams:
            stream.set_time(TIME, duration=seconds)
            stream.set_time(FRAME, sequence=index)

    def log(self, path: str, *what: Any, static: bool = False) -> None:
        """Log something.

        Parameters
        ----------
        path : str
            The entity.
        *what : rerun.AsComponents
            What there is of it.
        static : bool
            Whether it holds at all times.
        """
        for stream in self._streams:
            stream.log(path, *what, static=static)
