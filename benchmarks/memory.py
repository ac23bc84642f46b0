"""Memory while thousands of frames are tracked: flat, but for the trajectory itself.

``python -m benchmarks.memory FRAMES`` runs in a process of its own, where nothing else grows, and
prints what it saw as JSON.
"""

import gc
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.frames import ROOT, available, recording
from benchmarks.section import Bound, Section, Settings, table
from edvo.config import Config
from edvo.odometry import Odometry, Status

SLACK_KB = 2048  # a page here and there is no leak: 0.2 kB a frame would show
SHOWN = 120  # frames that are shown back and forth


def measure(settings: Settings) -> Section:
    """Track in a process of its own and compare its memory after a tenth and at the end."""
    count = settings.choose(2000, 10_000)
    command = [sys.executable, "-m", "benchmarks.memory", str(count)]
    seen = json.loads(
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    )
    rows = [[f"{frames}", f"{kb / 1024:.2f}"] for frames, kb in seen["resident_kb"]]
    resident = dict(map(tuple, seen["resident_kb"]))
    early, late = resident[count // 10], resident[count]
    kept = seen["poses_kb"]
    grown = (late - early) - kept
    body = (
        f"{seen['name']}: {SHOWN} frames in memory, shown back and forth {count} times; "
        f"{seen['lost']} lost, {seen['keyframes']} keyframes. Resident memory of the process:\n\n"
        + table(["frames tracked", "MB"], rows)
        + f"\n\nFrom {count // 10} to {count} frames it grows by {late - early} kB. The poses of "
        f"these frames, which `Odometry.trajectory` gives back, take {kept:.0f} kB, "
        f"{seen['pose_bytes']} bytes a frame; a smaller growth than theirs means that memory freed "
        "before was used again."
    )
    bound = Bound("memory grown beyond the trajectory", SLACK_KB, grown, " kB")
    return Section("Memory", body, [bound])


def resident_kb() -> int:
    """Resident memory of this process now; its peak where the system does not say."""
    status = Path("/proc/self/statm")
    if status.exists():
        pages = int(status.read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") // 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def track(count: int) -> dict[str, object]:
    """Track so many frames."""
    shown = recording(available()[0], SHOWN)
    odometry = Odometry(shown.camera, Config.preset("paper"))
    seen: list[tuple[int, int]] = []
    lost = keyframes = 0
    pose_bytes = 0
    for index, frame in zip(range(1, count + 1), shown.endless(), strict=False):
        result = odometry.track(frame)
        lost += result.status is Status.LOST
        keyframes += result.is_keyframe
        pose_bytes = _bytes_of(result.T_world_cam)
        if index % (count // 10) == 0:
            gc.collect()
            seen.append((index, resident_kb()))
    return {
        "name": shown.name,
        "resident_kb": seen,
        "lost": lost,
        "keyframes": keyframes,
        "pose_bytes": pose_bytes,
        "poses_kb": pose_bytes * (count - count // 10 - lost * 9 // 10) / 1024,
    }


def _bytes_of(pose: np.ndarray) -> int:
    """What the tracker keeps of a frame: the pose, its stamp, and a place for each in a list."""
    return sys.getsizeof(pose) + sys.getsizeof(0.0) + 2 * 8


if __name__ == "__main__":
    print(json.dumps(track(int(sys.argv[1]))))
