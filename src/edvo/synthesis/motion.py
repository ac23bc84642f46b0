"""How the camera moves: T_world_cam as a smooth function of time."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from edvo.errors import SceneError
from edvo.se3 import exp, interpolate
from edvo.synthesis.scene import CameraPath
from edvo.synthesis.spline import ClosedSpline
from edvo.trajectory import Trajectory

F64 = NDArray[np.float64]

#: A hand's tremor: band in Hz, RMS per axis of translation (m) and rotation (rad). Measured on the
#: motion capture of TUM RGB-D fr3/structure_notexture_far and fr1/xyz after a slow path was taken
#: out; above 4 Hz reduced by what motion capture itself adds (0.1 mm).
TREMOR = (
    (0.5, 1.0, 4.0e-3, 6.0e-3),
    (1.0, 2.0, 2.0e-3, 4.0e-3),
    (2.0, 4.0, 0.5e-3, 2.6e-3),
    (4.0, 8.0, 0.12e-3, 1.2e-3),
    (8.0, 14.0, 0.04e-3, 0.5e-3),
)
_WAVES = 5  # sinusoids a band and axis
MOTIONS = ("handheld", "orbit", "still", "rotation", "jerk")


class Motion(Protocol):
    """A camera's way through a scene."""

    @property
    def duration(self) -> float:
        """Seconds for which the motion is defined; infinite for most."""
        ...

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds from the start."""
        ...


class _Endless:
    """Mixin of motions that go on for ever."""

    @property
    def duration(self) -> float:
        """Seconds for which the motion is defined: for ever."""
        return float("inf")


def look_at(position: F64, target: F64) -> F64:
    """Give the upright pose that looks at a point.

    Parameters
    ----------
    position, target : (3,) float64
        World, metres; z is up. The target must not be right above or below.

    Returns
    -------
    (4, 4) float64
        T_world_cam, x right, y down, z forward.

    Raises
    ------
    SceneError
        If there is no upright view.
    """
    forward = np.asarray(target, float) - position
    right = np.cross(forward, [0.0, 0.0, 1.0])
    size = np.linalg.norm(right)
    if size < 1e-9:
        raise SceneError("a camera that looks straight up or down has no upright view")
    T = np.eye(4)
    T[:3, 0] = right / size
    T[:3, 2] = forward / np.linalg.norm(forward)
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    T[:3, 3] = position
    return T


class Tremor:
    """The jitter of a hand: sinusoids with random phases in the bands of `TREMOR`.

    Parameters
    ----------
    seed : int
        Another seed, another jitter.
    strength : float
        Factor of all amplitudes.
    """

    def __init__(self, seed: int = 0, strength: float = 1.0) -> None:
        random = np.random.default_rng([seed, 1])
        frequency, amplitude = [], []
        for low, high, shift, turn in TREMOR:
            frequency.append(random.uniform(low, high, (_WAVES, 6)))
            rms = np.array([shift] * 3 + [turn] * 3) * np.sqrt(2.0 / _WAVES) * strength
            amplitude.append(np.broadcast_to(rms, (_WAVES, 6)))
        self._omega = 2.0 * np.pi * np.concatenate(frequency)
        self._amplitude = np.concatenate(amplitude)
        self._phase = random.uniform(0.0, 2.0 * np.pi, self._omega.shape)

    def at(self, t: float) -> F64:
        """Give the twist (6,) of the hand at ``t`` seconds: metres, then radians."""
        waves: F64 = (self._amplitude * np.sin(self._omega * t + self._phase)).sum(axis=0)
        return waves


class HandHeld(_Endless):
    """A person who carries the camera along a path: a smooth curve and a tremor.

    Parameters
    ----------
    path : CameraPath
        Points led along and looked at.
    speed : float
        Metres per second along the path; it breathes by a fifth.
    seed : int
        Of the tremor.
    tremor : float
        Factor of the tremor; 0 carries the camera on a rail.
    """

    def __init__(
        self, path: CameraPath, *, speed: float = 0.2, seed: int = 0, tremor: float = 1.0
    ) -> None:
        self._spline = ClosedSpline(
            np.array(path.points), closed=path.closed, companion=np.array(path.targets)
        )
        self._speed = speed
        self._tremor = Tremor(seed, tremor)
        self._breath = np.random.default_rng([seed, 2]).uniform(0.0, 2.0 * np.pi)

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds."""
        pace = 2.0 * np.pi * 0.3
        travelled = self._speed * (t + 0.2 / pace * np.sin(pace * t + self._breath))
        position, target = self._spline.at(float(travelled))
        return look_at(position, target) @ exp(self._tremor.at(t))


class Orbit(_Endless):
    """A circle round the scene's main thing, looking at it.

    Parameters
    ----------
    path : CameraPath
        Its centre, radius and height.
    speed : float
        Metres per second.
    """

    def __init__(self, path: CameraPath, *, speed: float = 0.3) -> None:
        self._path, self._speed = path, speed
        first = np.array(path.points[0]) - path.centre
        self._start = float(np.arctan2(first[1], first[0]))

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds."""
        path = self._path
        angle = self._start + self._speed * t / path.radius
        centre = np.array(path.centre)
        shift = [path.radius * np.cos(angle), path.radius * np.sin(angle), 0.0]
        position = centre + shift
        position[2] = path.height
        return look_at(position, centre)


class Still(_Endless):
    """A camera that stands perfectly still.

    Parameters
    ----------
    T_world_cam : (4, 4) float64
        Where.
    """

    def __init__(self, T_world_cam: F64) -> None:
        self._pose = np.array(T_world_cam)

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds: always the same."""
        return self._pose.copy()


class PureRotation(_Endless):
    """A camera that only turns: to and fro by 35 degrees, nodding by 8.

    Parameters
    ----------
    T_world_cam : (4, 4) float64
        Where it starts.
    speed : float
        Fastest turn, radians per second.
    """

    def __init__(self, T_world_cam: F64, *, speed: float = 0.5) -> None:
        self._pose, self._speed = np.array(T_world_cam), speed

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds."""
        pan, nod = np.radians(35.0), np.radians(8.0)
        angle = self._speed * t / pan
        pitch = exp(np.array([0, 0, 0, nod * np.sin(0.7 * angle), 0, 0]))
        yaw = exp(np.array([0, 0, 0, 0, pan * np.sin(angle), 0]))
        turned: F64 = self._pose @ yaw @ pitch
        return turned


class Jerk(_Endless):
    """Another motion, with sudden knocks: a fifth of a second, 4 cm and 5 degrees each.

    Parameters
    ----------
    motion : Motion
        What is knocked.
    instants : sequence of float, optional
        Middles of the knocks in seconds; every 2 s from the first second on by default.
    seed : int
        Of their directions.
    """

    def __init__(
        self, motion: Motion, *, instants: tuple[float, ...] | None = None, seed: int = 0
    ) -> None:
        self._motion, self._instants, self._seed = motion, instants, seed

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds."""
        if self._instants is None:
            number = round((t - 1.0) / 2.0)
            instants = {number: 1.0 + 2.0 * number} if number >= 0 else {}
        else:
            instants = dict(enumerate(self._instants))
        twist = np.zeros(6)
        for number, instant in instants.items():
            x = (t - instant) / 0.1
            if abs(x) < 1.0:
                way = np.random.default_rng([self._seed, 3, number]).standard_normal((2, 3))
                way /= np.linalg.norm(way, axis=1, keepdims=True)
                # cos^4: twice differentiable where it ends.
                bump = np.cos(0.5 * np.pi * x) ** 4
                twist += bump * np.concatenate([0.04 * way[0], np.radians(5.0) * way[1]])
        return self._motion.at(t) @ exp(twist)


@dataclass(frozen=True)
class Recorded:
    """The motion of a real camera.

    Parameters
    ----------
    trajectory : Trajectory
        Poses T_world_cam; interpolated between.
    T_scene_world : (4, 4) float64
        Where the recording's world lies in the scene.
    """

    trajectory: Trajectory
    T_scene_world: F64

    @property
    def duration(self) -> float:
        """Seconds that were recorded."""
        return float(self.trajectory.timestamps[-1] - self.trajectory.timestamps[0])

    def at(self, t: float) -> F64:
        """Give T_world_cam (4, 4) at ``t`` seconds from the first pose; held at both ends."""
        stamps = self.trajectory.timestamps
        poses = self.trajectory.poses
        after = int(np.searchsorted(stamps, stamps[0] + t))
        if after == 0 or after == len(stamps):
            pose = poses[min(after, len(stamps) - 1)]
        else:
            before = stamps[after - 1]
            part = (stamps[0] + t - before) / (stamps[after] - before)
            pose = interpolate(poses[after - 1], poses[after], float(part))
        placed: F64 = self.T_scene_world @ pose
        return placed


def make_motion(
    kind: str | os.PathLike[str], path: CameraPath, *, speed: float | None = None, seed: int = 0
) -> Motion:
    """Make a motion by name, or out of a TUM file.

    Parameters
    ----------
    kind : str or path
        One of `MOTIONS`, or a trajectory file; the recording then starts where the scene's path
        does.
    path : CameraPath
        Of the scene.
    speed : float, optional
        Metres per second (radians per second for ``rotation``); what suits the scene by default.
    seed : int
        Of the tremor and the knocks.

    Returns
    -------
    Motion
        The motion.

    Raises
    ------
    SceneError
        For an unknown name (it lists what there is) or a speed that is not above zero.
    TrajectoryError
        For a file that cannot be read.
    """
    if speed is not None and not 0 < speed < float("inf"):
        raise SceneError(f"speed {speed} is not above zero; give metres per second")
    start = look_at(
        *ClosedSpline(
            np.array(path.points), closed=path.closed, companion=np.array(path.targets)
        ).at(0.0)
    )
    pace = path.speed if speed is None else speed
    if kind == "handheld":
        return HandHeld(path, speed=pace, seed=seed)
    if kind == "orbit":
        return Orbit(path, speed=pace)
    if kind == "still":
        return Still(start)
    if kind == "rotation":
        return PureRotation(start, speed=0.5 if speed is None else speed)
    if kind == "jerk":
        return Jerk(HandHeld(path, speed=pace, seed=seed), seed=seed)
    if Path(kind).suffix:
        trajectory = Trajectory.read(kind)
        if len(trajectory) < 2:
            raise SceneError(f"{kind}: too few poses to move along; give at least two")
        return Recorded(trajectory, start @ np.linalg.inv(trajectory.poses[0]))
    raise SceneError(
        f"no trajectory {os.fspath(kind)!r}; there are {', '.join(MOTIONS)}, or give a TUM file"
    )
