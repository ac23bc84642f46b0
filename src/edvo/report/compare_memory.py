"""How much memory a system takes, each in a process of its own.

``python -m edvo.report.compare_memory`` reads a job from standard input, tracks frames that are
in memory, and prints by how much its own resident memory has grown at most.
"""

import gc
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from edvo.baselines.registry import Tracker, make_tracker
from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import EvaluationError, FrameError
from edvo.frame import Frame
from edvo.odometry import Odometry

MEMORY_FRAMES = 30
"""Frames that are tracked: enough for some keyframes."""

_CAMERA = "the camera that the frames are of"


@contextmanager
def frames_on_disk(frames: Sequence[Frame]) -> Iterator[Path]:
    """Put frames where other processes find them decoded.

    Parameters
    ----------
    frames : sequence of Frame
        At least one.

    Yields
    ------
    pathlib.Path
        A file that is gone afterwards.
    """
    with TemporaryDirectory(prefix="edvo-") as folder:
        path = Path(folder) / "frames.npz"
        np.savez(
            path,
            timestamp=np.array([frame.timestamp for frame in frames]),
            grey=np.array([frame.grey for frame in frames]),
            depth=np.array([frame.depth for frame in frames]),
            depth_delay=np.array([frame.depth_delay for frame in frames]),
        )
        yield path


def peak_megabytes(frames: Path, camera: Camera, system: str | Config, *, seed: int = 0) -> float:
    """Track frames in a process of its own, and say how much memory that takes at most.

    Parameters
    ----------
    frames : pathlib.Path
        See `frames_on_disk`.
    camera : Camera
        Of the frames.
    system : str or Config
        Name of a baseline, or parameters of edvo.
    seed : int
        Of the system.

    Returns
    -------
    float
        Megabytes by which the peak of the resident memory exceeds that of a process that has
        imported edvo and holds the frames: the tracker, its compiled code, and the libraries
        that edvo itself does not need.

    Raises
    ------
    EvaluationError
        If the process failed.
    """
    job = {
        "frames": str(frames),
        "camera": camera.to_dict(),
        "system": system.to_dict() if isinstance(system, Config) else system,
        "seed": seed,
    }
    command = [sys.executable, "-m", __name__]
    done = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise EvaluationError(f"memory not measured: {last}")
    return float(done.stdout.split()[-1])


def _grown(job: dict[str, Any]) -> float:
    """Do a job in this process; megabytes."""
    cv2.setNumThreads(1)
    camera = Camera.from_dict(job["camera"], where=_CAMERA)
    with np.load(job["frames"]) as data:
        columns = [data[name] for name in ("timestamp", "grey", "depth", "depth_delay")]
    frames = [Frame(*each) for each in zip(*columns, strict=True)]
    gc.collect()
    before = _forget_peak()
    tracker = _tracker(job["system"], camera, job["seed"])
    for frame in frames:
        with suppress(FrameError):
            tracker.track(frame)
    return (_peak_kb() - before) / 1024


def _tracker(system: str | dict[str, Any], camera: Camera, seed: int) -> Tracker:
    if isinstance(system, str):
        return make_tracker(system, camera, seed)
    return Odometry(camera, Config.from_dict({**system, "seed": seed}))


def _forget_peak() -> int:
    """Begin the peak anew where that can be done (Linux); what it then is, in kB."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _peak_kb()


def _peak_kb() -> int:
    """Peak of the resident memory of this process.

    ``ru_maxrss`` would not do where the other is to be had: on Linux it remembers the memory of
    the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1])
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // 1024 if sys.platform == "darwin" else peak  # bytes there


if __name__ == "__main__":
    print(_grown(json.load(sys.stdin)))
