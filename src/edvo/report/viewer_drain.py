"""A file that another library writes, without its minding when the disk is full.

The writer of Rerun's library may wait for ever for its own thread once that has failed to write
(seen with 0.41). So it is given a pipe instead, which always takes what comes.
"""

import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

_PIECE = 1 << 20


class Drain:
    """Copies what is written to `inlet` to a file, in a thread.

    Parameters
    ----------
    path : pathlib.Path
        The file; it must not exist.

    Attributes
    ----------
    inlet : str
        Path that can be opened for writing, once.
    failure : OSError or None
        Why the file is not whole.

    Raises
    ------
    OSError
        If the file cannot be made.

    Notes
    -----
    On Windows, where a pipe has no such path, `inlet` is the file itself.
    """

    def __init__(self, path: Path) -> None:
        self.failure: OSError | None = None
        self._path = path
        self._thread: threading.Thread | None = None
        self._write_end = -1
        path.touch(exist_ok=False)
        self.inlet = str(path)
        if sys.platform != "win32":
            read_end, self._write_end = os.pipe()
            self.inlet = f"/dev/fd/{self._write_end}"
            self._thread = threading.Thread(
                target=self._copy, args=(read_end,), name="edvo-drain", daemon=True
            )
            self._thread.start()

    def opened(self) -> None:
        """Take note that `inlet` has been opened; it ends when that is closed."""
        if self._write_end >= 0:
            os.close(self._write_end)
            self._write_end = -1

    def close(self) -> None:
        """Wait for the end, which comes when `inlet` is closed.

        Raises
        ------
        OSError
            If not all could be written.
        """
        self.opened()
        if self._thread is not None:
            self._thread.join()
        if self.failure is not None:
            raise self.failure

    def _copy(self, read_end: int) -> None:
        with open(read_end, "rb", buffering=0) as source:
            try:
                with self._path.open("wb", buffering=0) as target:
                    while piece := source.read(_PIECE):
                        view = memoryview(piece)
                        while view:
                            view = view[target.write(view) :]
            except OSError as error:
                self.failure = error
            with suppress(OSError):
                while source.read(_PIECE):
                    pass
