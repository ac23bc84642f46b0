"""Compiling the tracker before the first frame, and saying so if it takes a while."""

from threading import Timer

from edvo.cli.terminal import note
from edvo.config import Config
from edvo.report.warmup import cache_folder, warm_up

_PATIENCE_S = 1.0


def compile_now(config: Config) -> None:
    """Compile what a run will need, or load it from the cache."""
    once = ", once" if cache_folder() else "; set NUMBA_CACHE_DIR to a writable folder to keep it"
    slow = Timer(_PATIENCE_S, note, [f"compiling{once}"])
    slow.daemon = True
    slow.start()
    try:
        warm_up(config)
    finally:
        slow.cancel()
