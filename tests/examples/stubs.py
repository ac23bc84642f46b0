"""Stand-ins for what the examples import: as strict as the real thing in what they are used for."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def load(name: str) -> dict[str, Any]:
    """Execute an example, but for its main; gives its names."""
    file = EXAMPLES / name
    module = ModuleType(file.stem)
    exec(compile(file.read_text(encoding="utf-8"), str(file), "exec"), module.__dict__)
    return module.__dict__


def put(monkeypatch: pytest.MonkeyPatch, name: str, **contents: Any) -> None:
    """Make a module that can be imported, with its parents."""
    module = ModuleType(name)
    module.__dict__.update(contents)
    monkeypatch.setitem(sys.modules, name, module)
    parent, _, child = name.rpartition(".")
    if parent:
        if parent not in sys.modules:
            put(monkeypatch, parent)
        monkeypatch.setattr(sys.modules[parent], child, module, raising=False)


# ROS messages: slots refuse what the message does not have, setters what its field cannot hold.
@dataclass(slots=True)
class Time:
    sec: int = 0
    nanosec: int = 0


@dataclass(slots=True)
class RosHeader:
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass(slots=True)
class Vector:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def __setattr__(self, name: str, value: object) -> None:
        assert type(value) is float
        object.__setattr__(self, name, value)


@dataclass(slots=True)
class Quaternion(Vector):
    w: float = 1.0


@dataclass(slots=True)
class Pose:
    position: Vector = field(default_factory=Vector)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class Twist:
    linear: Vector = field(default_factory=Vector)
    angular: Vector = field(default_factory=Vector)


@dataclass(slots=True)
class _WithCovariance:
    covariance: Any = field(default_factory=lambda: np.zeros(36))

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "covariance":
            assert value.dtype == np.float64
            assert value.shape == (36,)
        object.__setattr__(self, name, value)


@dataclass(slots=True)
class PoseWithCovariance(_WithCovariance):
    pose: Pose = field(default_factory=Pose)


@dataclass(slots=True)
class TwistWithCovariance(_WithCovariance):
    twist: Twist = field(default_factory=Twist)


@dataclass(slots=True)
class OdometryMessage:
    header: RosHeader = field(default_factory=RosHeader)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(slots=True)
class Transform:
    translation: Vector = field(default_factory=Vector)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class TransformStamped:
    header: RosHeader = field(default_factory=RosHeader)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass(slots=True)
class Image:
    header: RosHeader = field(default_factory=RosHeader)
    height: int = 0
    width: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    step: int = 0
    data: Any = b""


@dataclass(slots=True)
class CameraInfo:
    header: RosHeader = field(default_factory=RosHeader)
    height: int = 0
    width: int = 0
    distortion_model: str = ""
    d: Any = ()
    k: Any = field(default_factory=lambda: np.zeros(9))
    r: Any = field(default_factory=lambda: np.zeros(9))
    p: Any = field(default_factory=lambda: np.zeros(12))


@dataclass
class Parameter:
    value: Any


@dataclass
class Publisher:
    kind: type
    topic: str
    sent: list[Any] = field(default_factory=list)

    def publish(self, message: Any) -> None:
        assert isinstance(message, self.kind)
        self.sent.append(message)


@dataclass
class Logger:
    lines: list[str] = field(default_factory=list)

    def error(self, line: str, *, throttle_duration_sec: float = 0.0) -> None:
        self.lines.append(line)

    warning = error


class Node:
    """What a node needs of its base class; `given` are the parameters from outside."""

    given: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.publishers: list[Publisher] = []
        self.logger = Logger()

    def declare_parameter(self, name: str, default: Any) -> Parameter:
        return Parameter(self.given.get(name, default))

    def create_publisher(self, kind: type, topic: str, depth: int) -> Publisher:
        self.publishers.append(Publisher(kind, topic))
        return self.publishers[-1]

    def get_logger(self) -> Logger:
        return self.logger


class Broadcaster:
    def __init__(self, node: Node) -> None:
        self.sent: list[TransformStamped] = []

    def sendTransform(self, transform: TransformStamped) -> None:
        self.sent.append(transform)


@dataclass
class Subscriber:
    node: Node
    kind: type
    topic: str
    qos_profile: object


@dataclass
class Synchronizer:
    subscribers: list[Subscriber]
    queue: int
    slop: float
    callback: Callable[..., None] | None = None

    def registerCallback(self, callback: Callable[..., None]) -> None:
        self.callback = callback


def put_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the ROS packages importable that the node uses."""
    put(monkeypatch, "rclpy")
    put(monkeypatch, "rclpy.node", Node=Node)
    put(monkeypatch, "rclpy.qos", qos_profile_sensor_data=object())
    put(monkeypatch, "message_filters", Subscriber=Subscriber)
    sys.modules["message_filters"].__dict__["ApproximateTimeSynchronizer"] = Synchronizer
    put(monkeypatch, "tf2_ros", TransformBroadcaster=Broadcaster)
    put(monkeypatch, "geometry_msgs.msg", TransformStamped=TransformStamped)
    put(monkeypatch, "nav_msgs.msg", Odometry=OdometryMessage)
    put(monkeypatch, "sensor_msgs.msg", Image=Image, CameraInfo=CameraInfo)
