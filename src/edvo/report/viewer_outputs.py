"""Where a viewer's data goes: a file that appears when it is whole, or a window."""

import os
import secrets
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from edvo.errors import OutputError
from edvo.report.viewer_library import load_rerun

APPLICATION = "edvo"
MEMORY = "25%"  # of the machine's, for the window; it then forgets the oldest frames
OPENING_S = 30.0
SETTLING_S = 1.0  # a viewer without graphics ends shortly after it listens
FLUSH_S = 3.0  # a window that takes nothing for so long is taken for closed


class RrdFile:
    """A recording of the viewer's, written aside and then renamed.

    Parameters
    ----------
    path : pathlib.Path
        The ``.rrd`` file; its folder must exist.

    Raises
    ------
    MissingExtraError
        If rerun-sdk is not installed.
    OutputError
        If the folder takes no files.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._aside = path.parent / f".{path.name}.{secrets.token_hex(8)}"
        self.stream = _new_stream()
        check_writable(path)
        try:
            self.stream.save(str(self._aside))
        except (OSError, RuntimeError) as error:
            self.discard()
            raise self._refusal(error) from error

    def flush(self) -> None:
        """See that all is on the disk.

        Raises
        ------
        OutputError
            If the disk is full, for instance.
        """
        try:
            self.stream.flush()
        except (OSError, RuntimeError) as error:
            raise self._refusal(error) from error

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises
        ------
        OutputError
            If it cannot be written whole; what stood there before is then untouched.
        """
        try:
            self.flush()
            before = self._aside.stat().st_size
            self.stream.disconnect()
            # The index at its end is written by the last call, which does not say if it fails.
            if self._aside.stat().st_size <= before:
                raise OutputError(f"cannot write {self.path}: its end is missing; make room")
            self._aside.replace(self.path)
        except OSError as error:
            raise self._refusal(error) from error
        finally:
            self.discard()

    def discard(self) -> None:
        """Leave nothing behind but a file that was closed."""
        self.stream.disconnect()
        with suppress(OSError):
            self._aside.unlink(missing_ok=True)

    def _refusal(self, error: Exception) -> OutputError:
        why = getattr(error, "strerror", None) or str(error).rsplit(": ", 1)[-1]
        return OutputError(f"cannot write {self.path}: {why}; choose a folder with room and rights")


class Window:
    """A viewer in a process of its own, which stays open when the run is over.

    It listens on this machine only.

    Raises
    ------
    MissingExtraError
        If rerun-sdk is not installed.
    OutputError
        If no window can be opened.
    """

    def __init__(self) -> None:
        check_display()
        self.stream = _new_stream()
        port = _free_port()
        with tempfile.TemporaryFile() as log:
            _wait_for(_start_viewer(port, log), port, log)
        self.stream.connect_grpc(f"rerun+http://127.0.0.1:{port}/proxy")

    def flush(self) -> None:
        """See that all has arrived.

        Raises
        ------
        OutputError
            If the window is closed.
        """
        try:
            self.stream.flush(timeout_sec=FLUSH_S)
        except (OSError, RuntimeError) as error:
            raise OutputError("the viewer was closed or takes no more") from error

    def close(self) -> None:
        """Send the rest; the window stays.

        Raises
        ------
        OutputError
            If it is closed.
        """
        try:
            self.flush()
        finally:
            self.discard()

    def discard(self) -> None:
        """Send no more."""
        self.stream.disconnect()


def check_display() -> None:
    """See that there is a screen to open a window on.

    Raises
    ------
    OutputError
        If there is none.
    """
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise OutputError(
            "no display to open the viewer on (neither DISPLAY nor WAYLAND_DISPLAY is set); "
            "use --save-view FILE.rrd and open that where there is a screen"
        )


def check_writable(path: Path) -> None:
    """See that a file can be made.

    Parameters
    ----------
    path : pathlib.Path
        Which.

    Raises
    ------
    OutputError
        If its folder is missing or takes no files, or if it is a folder itself.
    """
    try:
        if path.is_dir():
            raise OutputError(f"cannot write {path}: it is a folder; name a file")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OutputError(
            f"cannot write {path}: {error.strerror or error}; choose a folder with room and rights"
        ) from error


def _new_stream() -> Any:
    rerun = load_rerun()
    stream = rerun.RecordingStream(APPLICATION, recording_id=secrets.token_hex(16))
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _start_viewer(port: int, log: IO[bytes]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--memory-limit", MEMORY, "--hide-welcome-screen", "--expect-data-soon"]
    # A session of its own: Ctrl-C ends the run, and not the window on what it has shown.
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=True,
        # As rerun.spawn has it: no word about itself on a terminal that is not its own.
        env={**os.environ, "RERUN_APP_ONLY": "true"},
    )


def _wait_for(viewer: subprocess.Popen[bytes], port: int, log: IO[bytes]) -> None:
    deadline = time.monotonic() + OPENING_S
    while viewer.poll() is None and time.monotonic() < deadline:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
            break
        time.sleep(0.05)
    with suppress(subprocess.TimeoutExpired):
        viewer.wait(SETTLING_S)
    if viewer.poll() is not None:
        log.seek(0)
        raise OutputError(
            f"the viewer does not open a window ({_why(log.read().decode(errors='replace'))}); "
            "use --save-view FILE.rrd and open that where there is a screen"
        )


def _why(log: str) -> str:
    """Find the line of a log that says why a viewer ended."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    told = [line for line in lines if "rror" in line] or lines or ["it ended at once"]
    return told[-1].rsplit(": ", 1)[-1][-200:]
