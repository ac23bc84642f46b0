"""What a figure was measured on."""

import datetime
import os
import platform
from pathlib import Path

import cv2
import numba
import numpy as np

import edvo


def cpu_name() -> str:
    """Name the processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def cores() -> int:
    """Count the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def load() -> str:
    """Say how busy the machine was over the last minute, this program included."""
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


def describe() -> dict[str, str]:
    """Say on what, with what and when."""
    return {
        "processor": f"{cpu_name()}, {cores()} cores",
        "system": f"{platform.system()} {platform.release().split('-')[0]}, {platform.machine()}",
        "Python": platform.python_version(),
        "edvo": edvo.__version__,
        "NumPy": np.__version__,
        "OpenCV": cv2.__version__,
        "numba": numba.__version__,
        "date": datetime.date.today().isoformat(),
    }
