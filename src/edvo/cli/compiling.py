"""Compiling the tracker before the first frame, and saying so if it takes a while."""

from collections.abc import Callable, Sequence
from threading import Timer
from typing import Any

from numba.core import event

from edvo.cli.terminal import note
from edvo.config import Config
from edvo.report.elsewhere import helps
from edvo.report.warmup import cache_folder, warm_up_seeing, warm_up_tracking
from edvo.report.warmup_aside import is_registration_here, registration_compiling_aside

_PATIENCE_S = 1.0


def compile_now(*configs: Config) -> None:
    """Compile what runs will need, or load it from the cache.

    Where something has to be compiled, another process does two fifths of it.

    Parameters
    ----------
    *configs : Config
        The parameters of each.
    """
    once = ", once" if cache_folder() else "; set NUMBA_CACHE_DIR to a writable folder to keep it"
    long = "about a minute" if helps() else "a minute or two"
    slow = Timer(_PATIENCE_S, note, [f"compiling for {long}{once}"])
    slow.daemon = True
    aside = registration_compiling_aside()
    calls = [] if is_registration_here() else [aside.start]
    try:
        with aside, event.install_listener("numba:compile", _Beginning([slow.start])):
            for config in configs:
                with event.install_listener("numba:compile", _Beginning(calls)):
                    warm_up_seeing(config)
                aside.wait()
                warm_up_tracking(config)
                calls = []
    finally:
        slow.cancel()


class _Beginning(event.Listener):
    """Calls what is to happen once something is compiled; loading from the cache is no such event.

    Parameters
    ----------
    calls : sequence of callable
    """

    def __init__(self, calls: Sequence[Callable[[], None]]) -> None:
        self._calls = calls

    def on_start(self, event: Any) -> None:
        calls, self._calls = self._calls, []
        for call in calls:
            call()

    def on_end(self, event: Any) -> None:
        pass
