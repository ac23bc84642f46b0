"""`edvo live`."""

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import cv2

from edvo.cli.compiling import compile_now
from edvo.cli.configuration import configure
from edvo.cli.interrupt import stop_on_interrupt
from edvo.cli.run import errors_of, remove_earlier, tell, tell_files
from edvo.cli.terminal import note, say, status_line
from edvo.cli.view import View
from edvo.clock import StageClock
from edvo.datasets.devices import Device, device_kinds, open_device
from edvo.datasets.masked import Mask, read_mask
from edvo.errors import DatasetError, EdvoError
from edvo.files import Unwritten, output_folder
from edvo.odometry import Odometry, Status
from edvo.report.live import Seen, track_device
from edvo.report.results import RESULTS, write_results
from edvo.report.tracking import FrameRecord, Run
from edvo.report.viewer_tracker import Shown

_TELL_EVERY_S = 0.1


def list_devices() -> None:
    """Print what can be given for DEVICE."""
    for kind in device_kinds():
        say(f"{kind.name:10} {kind.about}")


def live(
    which: str,
    out: Path,
    *,
    preset: str | None,
    config_file: Path | None,
    overrides: list[str],
    seed: int | None,
    camera: str | None,
    mask: Path | None,
    max_frames: int | None,
    view: bool,
    save_view: Path | None,
) -> None:
    """Track a camera until Ctrl-C and write what came of it; see `edvo.cli.commands.live`."""
    config = configure(preset, config_file, overrides, seed)
    viewing = View(view, save_view)
    with closing(open_device(which, camera=camera)) as device:
        left_out = None if mask is None else read_mask(mask, device.camera)
        if device.sensor is not None and not _names_sensor(config_file, overrides):
            config = config.with_overrides([f"planes.sensor={device.sensor}"])
            note(f"{device.name}: depth is taken to be as noisy as a {device.sensor}'s")
        folder = output_folder(out, files=RESULTS)
        cv2.setNumThreads(1)
        compile_now(config)
        clock = StageClock()
        odometry = Odometry(device.camera, config, clock=clock)
        note(f"{device.name}: tracking; Ctrl-C ends it and keeps the results")
        with viewing.open(Seen(device, left_out), config) as viewer:
            done, failure = _track(device, left_out, Shown(odometry, viewer), max_frames, clock)
            if not done.frames:
                raise failure or DatasetError(f"{device.name}: no frame came before the end")
            errors = errors_of(done)
            unwritten = Unwritten()
            with unwritten.noted():
                write_results(done, folder, config, errors)
                remove_earlier(folder)
            total = len(done.frames) + done.dropped
            note(f"dropped {done.dropped} of {total} frames to keep up with the camera")
            with unwritten.noted():
                tell(done, errors)
                if not unwritten.any:
                    tell_files(folder)
    unwritten.check()
    if failure is not None:
        raise DatasetError(f"{failure}; {folder} holds all that was tracked")
    if not done.track_times.size:
        raise DatasetError(f"no frame could be used; the first: {done.problems[0]}")


def _names_sensor(config_file: Path | None, overrides: list[str]) -> bool:
    """Say whether the user chose whose depth noise it is; the files that edvo writes name all."""
    return config_file is not None or any(
        each.partition("=")[0].strip() == "planes.sensor" for each in overrides
    )


def _track(
    device: Device, mask: Mask | None, shown: Shown, max_frames: int | None, clock: StageClock
) -> tuple[Run, EdvoError | None]:
    with (
        stop_on_interrupt() as stop,
        status_line(f"{device.name}: waiting for a frame") as show,
    ):
        line = _Line(show)

        def after(record: FrameRecord, dropped: int) -> None:
            shown.after(record)
            line.after(record, dropped)

        return track_device(
            device,
            shown,
            mask=mask,
            max_frames=max_frames,
            clock=clock,
            on_frame=after,
            stop=stop,
        )


class _Line:
    """What the terminal shows while the camera runs."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._last = -math.inf
        self._times: deque[float] = deque(maxlen=30)
        self._frames = 0

    def after(self, record: FrameRecord, dropped: int) -> None:
        """Tell of a frame, but not of each."""
        now = time.monotonic()
        self._frames += 1
        self._times.append(now)
        if now - self._last < _TELL_EVERY_S:
            return
        self._last = now
        rate = (len(self._times) - 1) / max(now - self._times[0], 1e-9)
        x, y, z = record.T_world_cam[:3, 3].tolist()
        status = record.status.value
        if record.status is not Status.TRACKED:
            status += f" ({record.reason})"
        self._show(
            f"{self._frames} frames, {rate:.0f} a second, {dropped} dropped; "
            f"x {x:+.3f} y {y:+.3f} z {z:+.3f} m; {status}"
        )
