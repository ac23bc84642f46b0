"""Compiling the tracker by tracking a little."""

from pathlib import Path
from typing import Any, cast

import numpy as np

from edvo import kernels
from edvo.camera import Camera
from edvo.config import Config
from edvo.frame import Frame, register_depth
from edvo.odometry import Odometry


def cache_folder() -> Path | None:
    """Say where compiled code is kept.

    Returns
    -------
    pathlib.Path or None
        The folder; None if no folder can be written, so that each process compiles anew.
    """
    path = cast(Any, kernels.align).stats.cache_path
    return None if path is None else Path(path)


def warm_up_reading() -> None:
    """Compile what registers depth to colour, which most recordings do without."""
    camera = Camera(width=16, height=12, fx=13.0, fy=13.0, cx=7.5, cy=5.5)
    register_depth(np.full((12, 16), 2.0, np.float32), camera, camera, np.eye(4))


def warm_up(config: Config) -> None:
    """Compile every kernel that a run with these parameters calls, or load it from the cache.

    Parameters
    ----------
    config : Config
        The parameters.
    """
    # Bars across a plane, seen from two places: enough edges of two directions to register.
    width, height = 160, 120
    camera = Camera(width=width, height=height, fx=130.0, fy=130.0, cx=79.5, cy=59.5)
    depth = np.full((height, width), 2.0, np.float32)
    v, u = np.mgrid[:height, :width]
    odometry = Odometry(camera, config)
    for index in range(3):
        bars = ((u + index) // 16 + v // 16) % 2
        # each a little lighter, so that none counts as the same image as before
        grey = np.ascontiguousarray(60 + 2 * index + 120 * bars, dtype=np.uint8)
        odometry.track(Frame(timestamp=index / 30.0, grey=grey, depth=depth))
    # and darkness, where depth alone goes on
    odometry.track(Frame(timestamp=0.1, grey=np.zeros_like(grey), depth=depth))
