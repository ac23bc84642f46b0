"""edvo: the pose of an RGB-D camera, frame by frame, from image edges.

The public names are loaded when first used, so that ``import edvo`` is instant. What happens on the
way, as frames that are lost, is told to the logger ``edvo``, and shown only where an application
sets up logging.
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

from edvo._version import __version__

if TYPE_CHECKING:
    from edvo.camera import Camera as Camera
    from edvo.config import Config as Config
    from edvo.datasets import open_source as open_source
    from edvo.errors import EdvoError as EdvoError
    from edvo.frame import Frame as Frame
    from edvo.odometry import Odometry as Odometry
    from edvo.odometry import Status as Status
    from edvo.odometry import TrackedFrame as TrackedFrame
    from edvo.trajectory import Trajectory as Trajectory

logging.getLogger("edvo").addHandler(logging.NullHandler())

_HOME = {
    "Camera": "edvo.camera",
    "Config": "edvo.config",
    "EdvoError": "edvo.errors",
    "Frame": "edvo.frame",
    "Odometry": "edvo.odometry",
    "Status": "edvo.odometry",
    "TrackedFrame": "edvo.odometry",
    "Trajectory": "edvo.trajectory",
    "open_source": "edvo.datasets",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'edvo' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
