"""`edvo warmup`."""

import time

from edvo.cli.compiling import compile_now
from edvo.cli.terminal import say
from edvo.config import Config
from edvo.errors import OutputError
from edvo.report.warmup import cache_folder, warm_up_reading


def warmup() -> None:
    """Compile the tracker for later runs."""
    folder = cache_folder()
    if folder is None:
        raise OutputError(
            "compiled code has nowhere to stay; set NUMBA_CACHE_DIR to a writable folder"
        )
    begin = time.perf_counter()
    compile_now(Config.preset("default"), Config.preset("paper"))
    warm_up_reading()
    say(f"compiled in {time.perf_counter() - begin:.1f} s, kept in {folder}")
