"""The viewer: a window of Rerun's, or a file for it, that shows a run as it goes (``edvo[view]``).

The tracker never waits for it: frames are handed to a thread that draws what it finds the time
for. What it leaves out is pictures; poses, status and numbers of all frames are kept.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import ConfigError, OutputError
from edvo.frame import Frame
from edvo.odometry import Status, TrackedFrame
from edvo.report.tracking import Registration
from edvo.report.viewer_backlog import Backlog
from edvo.report.viewer_images import Images
from edvo.report.viewer_layout import layout
from edvo.report.viewer_outputs import RrdFile, Window
from edvo.report.viewer_plots import Plots
from edvo.report.viewer_recorder import Recorder
from edvo.report.viewer_shot import Shot
from edvo.report.viewer_truth import Truth
from edvo.report.viewer_world import World
from edvo.trajectory import Trajectory

WINDOW_PICTURES = 4  # that may wait: what a window shows is to be new
FILE_BYTES = 256 << 20  # of images that may wait for a file: what a file holds is to be whole
FLUSH_FRAMES = 16
CLOSING_S = 10.0  # for a window alone; a file is finished however long it takes


class Viewer:
    """Shows frames and what the tracker made of them.

    Parameters
    ----------
    camera : Camera
        Of all frames.
    config : Config, optional
        Of the odometry; the preset ``default`` where not given, as there.
    window : bool
        Open a window.
    file : path-like, optional
        An ``.rrd`` file to write; it appears when `close` is called.
    truth : Trajectory, optional
        True poses, to be shown beside.
    title : str
        Name of the recording.

    Attributes
    ----------
    problem : OutputError or None
        Why the window shows no more; what goes wrong with the file is raised by `close`.

    Raises
    ------
    ConfigError
        If there is neither window nor file.
    MissingExtraError
        If rerun-sdk is not installed: ``pip install "edvo[view]"``.
    OutputError
        If there is no display, or the file's folder takes no files.

    Notes
    -----
    The arrays of a frame must not be written into after it is shown.

    Examples
    --------
    In a loop of your own::

        odometry = edvo.Odometry(camera)
        with Viewer(camera, odometry.config, window=True) as viewer:
            for frame in frames:
                viewer.show(frame, odometry.track(frame))
    """

    def __init__(
        self,
        camera: Camera,
        config: Config | None = None,
        *,
        window: bool = False,
        file: Path | str | None = None,
        truth: Trajectory | None = None,
        title: str = "",
    ) -> None:
        if not window and file is None:
            raise ConfigError("a viewer shows nothing without window=True or file=...")
        config = config or Config()
        self.problem: OutputError | None = None
        self._file_problem: OutputError | None = None
        self._file = None if file is None else RrdFile(Path(file))
        try:
            self._window = Window() if window else None
        except BaseException:
            if self._file is not None:
                self._file.discard()
            raise
        self._outputs = [each for each in (self._file, self._window) if each is not None]
        for output in self._outputs:
            following = output is self._window
            output.stream.send_blueprint(layout(truth=truth is not None, following=following))
            output.stream.send_recording_name(title or camera.name or "edvo")
        self._recorder = Recorder([output.stream for output in self._outputs])
        self._images = Images(self._recorder, camera, config)
        self._world = World(self._recorder, camera, config)
        self._plots = Plots(self._recorder, _headline(title, camera))
        self._truth = None if truth is None else Truth(truth)
        self._begin: float | None = None
        self._drawn = 0
        pictures = max(WINDOW_PICTURES, FILE_BYTES // (5 * camera.width * camera.height))
        self._backlog = Backlog(self._draw, pictures if file is not None else WINDOW_PICTURES)

    def show(
        self,
        frame: Frame | None,
        result: TrackedFrame,
        *,
        track_s: float | None = None,
        stages: Mapping[str, float] | None = None,
    ) -> None:
        """Hand in a frame; returns at once.

        Parameters
        ----------
        frame : Frame or None
            What was tracked; None where it could not be read.
        result : TrackedFrame
            What was made of it.
        track_s : float, optional
            Wall time of ``track``, seconds.
        stages : mapping of str to float, optional
            Seconds of each stage, as `edvo.clock.StageClock` gives them.
        """
        found = result.alignment
        numbers = None if found is None else Registration.of(found)
        self._backlog.put(Shot(result, numbers, track_s, stages or {}, frame))

    @property
    def frames(self) -> int:
        """Frames handed in so far."""
        return self._backlog.put_count

    @property
    def dropped_pictures(self) -> int:
        """Frames among them whose images were left out, for there was no time to draw them."""
        return self._backlog.dropped_pictures

    def close(self) -> None:
        """Draw what waits, and finish the file; the window stays open.

        Raises
        ------
        OutputError
            If the file cannot be written whole; there is none then.
        """
        file = self._file
        try:
            self._backlog.close(CLOSING_S if file is None else None)
            failure = self._backlog.failure
            if failure is not None and not isinstance(failure, OutputError):
                raise OutputError(f"the viewer cannot draw this: {failure!r}") from failure
            for output in list(self._outputs):
                self._try(output, output.close)
            if self._file_problem is not None:
                raise self._file_problem
        finally:
            self.discard()

    def discard(self) -> None:
        """End without a file; nothing where it is closed already."""
        self._backlog.give_up()
        for output in self._outputs:
            output.discard()
        self._outputs.clear()

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _draw(self, shot: Shot) -> None:
        result = shot.result
        if self._begin is None:
            self._begin = result.timestamp
        self._recorder.at(result.timestamp - self._begin, result.index)
        true, error = None, None
        if self._truth is not None:
            T_world_cam = None if result.status is Status.LOST else result.T_world_cam
            true = self._truth.at(result.timestamp, T_world_cam)
            error = self._truth.error(result.timestamp, T_world_cam)
        self._world.draw(shot, true)
        self._images.draw(shot)
        self._plots.draw(shot, error)
        self._drawn += 1
        for output in list(self._outputs):
            if output is self._window or self._drawn % FLUSH_FRAMES == 0:
                self._try(output, output.flush)
        if not self._outputs:
            raise self._file_problem or self.problem or OutputError("nothing to draw on")

    def _try(self, output: RrdFile | Window, act: Callable[[], None]) -> None:
        """Let one output fail without the other."""
        try:
            act()
        except OutputError as error:
            if output is self._window:
                self.problem = error
            else:
                self._file_problem = error
            self._outputs.remove(output)
            self._recorder.leave(output.stream)
            output.discard()


def _headline(title: str, camera: Camera) -> str:
    size = f"{camera.width} x {camera.height}, fx {camera.fx:g}, fy {camera.fy:g}"
    return f"{title}: {size}" if title else size
