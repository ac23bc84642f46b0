"""Compiling the tracker before the first frame, and saying so if it takes a while."""

from threading import Timer
from typing import Any

from numba.core import event

from edvo.cli.terminal import note
from edvo.config import Config
from edvo.report.warmup import cache_folder, warm_up

_PATIENCE_S = 1.0


def compile_now(config: Config) -> None:
    """Compile what a run will need, or load it from the cache."""
    once = ", once" if cache_folder() else "; set NUMBA_CACHE_DIR to a writable folder to keep it"
    slow = Timer(_PATIENCE_S, note, [f"compiling for a minute or two{once}"])
    slow.daemon = True
    try:
        with event.install_listener("numba:compile", _Starting(slow)):
            warm_up(config)
    finally:
        slow.cancel()


class _Starting(event.Listener):
    """Starts a timer once something is compiled; loading from the cache is no such event."""

    def __init__(self, timer: Timer) -> None:
        self._timer = timer
        self._started = False

    def on_start(self, event: Any) -> None:
        if not self._started:
            self._started = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        pass
