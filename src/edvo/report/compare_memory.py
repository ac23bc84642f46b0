"""How much memory a system takes, each in a process of its own.

``python -m edvo.report.compare_memory`` reads a job from standard input, tracks some frames, and
prints the peak of its own resident memory.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2

from edvo.baselines.registry import Tracker, make_tracker
from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import FrameError
from edvo.odometry import Odometry
from edvo.report.compare_sources import SourceSpec

MEMORY_FRAMES = 30
"""Frames that are tracked: enough for some keyframes."""


def peak_megabytes(
    spec: SourceSpec, indices: Sequence[int], system: str | Config | None, *, seed: int = 0
) -> float | None:
    """Decode frames, track them, and give the peak of the resident memory of it all.

    Parameters
    ----------
    spec : SourceSpec
        Where the frames come from.
    indices : sequence of int
        Which frames; `MEMORY_FRAMES` of them will do.
    system : str or Config or None
        Name of a baseline, or parameters of edvo; None decodes alone.
    seed : int
        Of the system.

    Returns
    -------
    float or None
        Megabytes; None if the process failed or the operating system does not tell.
    """
    job = {
        "source": asdict(spec),
        "indices": list(indices),
        "system": system.to_dict() if isinstance(system, Config) else system,
        "seed": seed,
    }
    done = subprocess.run(
        [sys.executable, "-m", __name__], input=json.dumps(job), capture_output=True, text=True
    )
    try:
        return float(done.stdout.split()[-1])
    except (IndexError, ValueError):
        return None


def _track(job: dict[str, Any]) -> None:
    cv2.setNumThreads(1)
    source = SourceSpec(**job["source"]).open()
    tracker = _tracker(job["system"], source.camera, job["seed"])
    for index in job["indices"]:
        frame = source.read(index).frame
        if frame is not None and tracker is not None:
            with suppress(FrameError):
                tracker.track(frame)


def _tracker(system: str | dict[str, Any] | None, camera: Camera, seed: int) -> Tracker | None:
    if system is None:
        return None
    if isinstance(system, str):
        return make_tracker(system, camera, seed)
    return Odometry(camera, Config.from_dict({**system, "seed": seed}))


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
    _track(json.load(sys.stdin))
    print(_peak_kb() / 1024)
