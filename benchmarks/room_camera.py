"""How a room drawn by a seed is filmed: the camera's way, its sensor, shutter, clocks and light."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.room_things import F64, Plan, Span, chance, one_of
from edvo.camera import Camera
from edvo.synthesis.clock import Clock
from edvo.synthesis.image_sensor import AutoExposure
from edvo.synthesis.renderer import Shutter


class Heights(NamedTuple):
    """Between which heights a camera is, and what it looks at, metres."""

    camera: Span
    target: Span


POINTS = 6  # of a way there; as many less two lead back, somewhat beside it:
BACK_M, BACK_TARGET_M = 0.05, 0.1  # one sigma

DESK = Heights(camera=(1.0, 1.5), target=(0.7, 1.0))
DESK_RADIUS_M: Span = (0.8, 1.4)
DESK_RAD: Span = (0.5, 2.5)
DESK_M_S: Span = (0.1, 0.5)
DESK_TARGET_M: Span = (-0.3, 0.3)

WALK = Heights(camera=(1.1, 1.6), target=(0.4, 1.4))
WALK_RADIUS = 0.36  # of the shorter side
WALK_RAD: Span = (1.0, 4.0)
WALK_M_S: Span = (0.2, 0.9)
OUTWARD, INWARD, AHEAD_RAD = 2.0, -0.3, 0.5  # it looks so many radii away, and so far ahead
LOOKS_OUT = 0.5  # share

WALL = Heights(camera=(1.0, 1.6), target=(0.8, 1.6))
WALL_M: Span = (0.8, 2.2)  # from it
WALL_WAVER_M: Span = (-0.15, 0.15)
WALL_END_M = 0.6
WALL_M_S: Span = (0.1, 0.6)
WALL_TARGET_M: Span = (-0.5, 0.5)  # beside the camera

TURN = Heights(camera=(1.2, 1.6), target=(0.6, 1.6))
TURN_M: Span = (-0.3, 0.3)
TURN_RAD: Span = (1.0, 4.0)
TURN_S: Span = (4.0, 9.0)
TURN_TARGET_M = 3.0


class Image(NamedTuple):
    """Width and height in pixels, and the focal length over that of a full image."""

    width: int
    height: int
    scale: float


# What is there several times is drawn so much more often.
SENSORS = ("kinect_v1", "kinect_v1", "realsense_d435", "realsense_d415", "azure_kinect")
FOCAL_PX = (525.0, 525.0, 610.0, 430.0)  # of a full image
IMAGES = (Image(640, 480, 1.0), Image(640, 480, 1.0), Image(848, 480, 1.0), Image(320, 240, 0.5))
OFF_CENTRE_PX: Span = (-8.0, 8.0)
RATE_HZ = 30.0
EXPOSURE_S = (0.0, 0.005, 0.015, 0.025)
INSTANTS = 4  # that an exposure is the mean of
READOUT_S = (0.0, 0.0, 0.015, 0.03)
DEPTH_LATE_S = (0.0, 0.0, 0.008, 0.016)
JITTER_S = (0.0, 0.001)
ADAPTIVE = 0.4  # share of the cameras that adapt their exposure
# Constant lamps in four cases of six. Lamps on the mains are not among the others: they flicker
# within an image, and `edvo.synthesis` has that for images that are relit alone.
LIGHTS = (None, None, None, "ambient+diffuse", "exposure", None)
MOTIONS = ("handheld", "handheld", "handheld", "jerk")


@dataclass(frozen=True)
class Way:
    """Where a camera goes, (N, 3), and what it looks at there, (N, 3), metres; and its m/s."""

    points: F64
    targets: F64
    speed: float


@dataclass(frozen=True)
class Filming:
    """What takes the images, and in what light.

    Parameters
    ----------
    sensor : str
        Of depth; see `edvo.synthesis.depth_sensors`.
    camera : Camera
        Both of colour and of depth.
    shutter : Shutter
    colour_clock, depth_clock : Clock
    exposure : AutoExposure or None
        None keeps it fixed.
    light : str or None
        How the lamps change; None leaves them as they are.
    motion : str
        How the camera is carried along its way; see `edvo.synthesis.motion`.
    """

    sensor: str
    camera: Camera
    shutter: Shutter
    colour_clock: Clock
    depth_clock: Clock
    exposure: AutoExposure | None
    light: str | None
    motion: str


def draw_way(rng: np.random.Generator, plan: Plan) -> Way:
    """Draw a closed way that suits the room: there, and back beside it."""
    phase = rng.uniform(0, 2 * np.pi)
    there = WAYS[plan.kind](rng, plan, phase)
    points = there_and_back(rng, there.points, BACK_M)
    return Way(points, there_and_back(rng, there.targets, BACK_TARGET_M), there.speed)


def there_and_back(rng: np.random.Generator, points: F64, sigma: float) -> F64:
    """Lead back past all points but the ends, so far beside them."""
    back = points[-2:0:-1]
    return np.vstack([points, back + rng.normal(0, sigma, back.shape)])


def round_desk(rng: np.random.Generator, plan: Plan, phase: float) -> Way:
    """Go round the desk, looking at it."""
    radius = rng.uniform(*DESK_RADIUS_M)
    angles = phase + np.linspace(0, rng.uniform(*DESK_RAD), POINTS)
    points = ring(radius, angles, rng.uniform(*DESK.camera, POINTS))
    beside = rng.uniform(*DESK_TARGET_M, (POINTS, 2))
    targets = np.column_stack([beside, rng.uniform(*DESK.target, POINTS)])
    return Way(points, targets, rng.uniform(*DESK_M_S))


def through(rng: np.random.Generator, plan: Plan, phase: float) -> Way:
    """Walk round what stands in the middle, looking there or at the walls."""
    radius = WALK_RADIUS * min(plan.width, plan.length)
    angles = phase + np.linspace(0, rng.uniform(*WALK_RAD), POINTS)
    points = ring(radius, angles, rng.uniform(*WALK.camera, POINTS))
    looks = OUTWARD if chance(rng, LOOKS_OUT) else INWARD
    targets = ring(looks * radius, angles + AHEAD_RAD, rng.uniform(*WALK.target, POINTS))
    return Way(points, targets, rng.uniform(*WALK_M_S))


def along_wall(rng: np.random.Generator, plan: Plan, phase: float) -> Way:
    """Go along the first wall, looking at it."""
    wall = plan.length / 2
    y = wall - rng.uniform(*WALL_M)
    end = plan.width / 2 - WALL_END_M
    x = np.linspace(-end, end, POINTS)[:: one_of(rng, (-1, 1))]
    off = y + rng.uniform(*WALL_WAVER_M, POINTS)
    points = np.column_stack([x, off, rng.uniform(*WALL.camera, POINTS)])
    seen = x + rng.uniform(*WALL_TARGET_M, POINTS)
    targets = np.column_stack([seen, np.full(POINTS, wall), rng.uniform(*WALL.target, POINTS)])
    return Way(points, targets, rng.uniform(*WALL_M_S))


def on_the_spot(rng: np.random.Generator, plan: Plan, phase: float) -> Way:
    """Turn, and hardly go."""
    points = np.column_stack([rng.uniform(*TURN_M, (POINTS, 2)), rng.uniform(*TURN.camera, POINTS)])
    angles = phase + np.linspace(0, rng.uniform(*TURN_RAD), POINTS)
    targets = ring(TURN_TARGET_M, angles, rng.uniform(*TURN.target, POINTS))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return Way(points, targets, length / rng.uniform(*TURN_S))


def ring(radius: float, angles: F64, heights: F64) -> F64:
    """Give points round the middle of the room, (N, 3)."""
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), heights])


WAYS: dict[str, Callable[[np.random.Generator, Plan, float], Way]] = {
    "desk": round_desk,
    "walk": through,
    "wall": along_wall,
    "turn": on_the_spot,
}


def draw_filming(rng: np.random.Generator) -> Filming:
    """Draw cameras and light."""
    sensor = one_of(rng, SENSORS)
    camera = draw_camera(rng)
    exposed, readout = one_of(rng, EXPOSURE_S), one_of(rng, READOUT_S)
    late, jitter = one_of(rng, DEPTH_LATE_S), one_of(rng, JITTER_S)
    adaptive = chance(rng, ADAPTIVE)
    return Filming(
        sensor=sensor,
        camera=camera,
        shutter=Shutter(exposed, steps=INSTANTS if exposed else 1, readout=readout),
        colour_clock=Clock(RATE_HZ, jitter=jitter),
        depth_clock=Clock(RATE_HZ, offset=late, jitter=jitter),
        exposure=AutoExposure() if adaptive else None,
        light=one_of(rng, LIGHTS),
        motion=one_of(rng, MOTIONS),
    )


def draw_camera(rng: np.random.Generator) -> Camera:
    """Draw a pinhole camera whose centre is somewhat off that of its image."""
    focal, image = one_of(rng, FOCAL_PX), one_of(rng, IMAGES)
    cx = image.width / 2 - 0.5 + rng.uniform(*OFF_CENTRE_PX)
    cy = image.height / 2 - 0.5 + rng.uniform(*OFF_CENTRE_PX)
    focal *= image.scale
    return Camera(image.width, image.height, focal, focal, cx, cy, depth_scale=5000.0)
