"""What a figure was measured on."""

import datetime
import os
import platform
from pathlib import Path

import cv2
import numba
import numpy as np

import edvo
from edvo.cores import usable_cores


def cpu_name() -> str:
    """Name the processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


class Others:
    """How much of the machine other programs take from now on, which is noise in what we measure.

    Of the processor time of all cores, as Linux counts it; what another machine on the same host
    takes ("steal") counts too.
    """

    def __init__(self) -> None:
        self._begin = self._now()

    def share(self) -> str:
        """Say it in per cent of all cores."""
        (total, busy, own), (total_0, busy_0, own_0) = self._now(), self._begin
        if total <= total_0:
            return "unknown"
        return f"{max(0.0, busy - busy_0 - (own - own_0)) / (total - total_0):.0%}"

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """Seconds of all cores, busy ones, and those of this process and its children."""
        times = os.times()
        own = times.user + times.system + times.children_user + times.children_system
        file = Path("/proc/stat")
        if not file.exists():
            return 0.0, 0.0, own
        ticks = os.sysconf("SC_CLK_TCK")
        spent = [
            int(x) / ticks for x in file.read_text(encoding="ascii").split("\n")[0].split()[1:9]
        ]
        idle = spent[3] + spent[4]
        return sum(spent), sum(spent) - idle, own


def describe() -> dict[str, str]:
    """Say on what, with what and when."""
    return {
        "processor": f"{cpu_name()}, {usable_cores()} cores",
        "system": f"{platform.system()} {platform.release().split('-')[0]}, {platform.machine()}",
        "Python": platform.python_version(),
        "edvo": edvo.__version__,
        "NumPy": np.__version__,
        "OpenCV": cv2.__version__,
        "numba": numba.__version__,
        "date": datetime.date.today().isoformat(),
    }
