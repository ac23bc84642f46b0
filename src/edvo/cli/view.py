"""`--view` and `--save-view`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from edvo.cli.terminal import note, say
from edvo.config import Config
from edvo.datasets import Source
from edvo.errors import OutputError

if TYPE_CHECKING:
    from edvo.report.viewer import Viewer


class View:
    """What was asked for, refused at once where it cannot be.

    Parameters
    ----------
    window : bool
        Open a window.
    file : pathlib.Path or None
        Write a file.

    Raises
    ------
    MissingExtraError
        If rerun-sdk is not installed.
    OutputError
        If there is no display, or the viewer would not know such a file.
    """

    def __init__(self, window: bool, file: Path | None) -> None:
        self._window, self._file = window, file
        if window or file is not None:
            from edvo.report.viewer_library import load_rerun
            from edvo.report.viewer_outputs import check_display

            load_rerun()
            if window:
                check_display()
        if file is not None and file.suffix != ".rrd":
            raise OutputError(f"{file}: the viewer knows its files by their ending; name it *.rrd")

    @contextmanager
    def open(self, source: Source, config: Config) -> Iterator["Viewer | None"]:
        """Show what happens within; a file is written at the end, if that is reached.

        Parameters
        ----------
        source : Source
            What is tracked.
        config : Config
            Of the odometry.

        Yields
        ------
        Viewer or None
            None where nothing is to be shown.

        Raises
        ------
        OutputError
            If the window does not open, or the file cannot be written.
        """
        if not self._window and self._file is None:
            yield None
            return
        from edvo.report.viewer import Viewer

        with Viewer(
            source.camera,
            config,
            window=self._window,
            file=self._file,
            truth=source.ground_truth,
            title=source.name,
        ) as viewer:
            yield viewer
        if viewer.problem is not None:
            note(f"warning: {viewer.problem}")
        if viewer.dropped_pictures:
            note(
                f"the viewer left out the images of {viewer.dropped_pictures} of {viewer.frames} "
                "frames, for the tracker does not wait for it; poses and numbers are all there"
            )
        if self._file is not None:
            say(f"wrote {self._file}")
