"""What a room drawn by a seed holds: walls and what hangs there, furniture, people who walk."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from edvo.synthesis.scene import Box, Material, Panel, Part, Shape, Texture, Walk, load_scene

F64 = NDArray[np.float64]
Span = tuple[float, float]
Pattern = Literal["noise", "tiles", "bricks", "wood", "checker"]
Choice = TypeVar("Choice")

OFFICE, CROWD = load_scene("office"), load_scene("crowd")
MATERIALS = {**CROWD.materials, **OFFICE.materials}
PARTS = {**OFFICE.parts, **CROWD.parts}

KINDS = ("desk", "walk", "wall", "turn")
SIDE_M: Span = (3.5, 8.0)
HEIGHT_M: Span = (2.4, 3.2)
PLAIN_ROOMS, PLAIN_FLOORS, PLAIN_WALLS = 0.5, 0.3, 0.5  # shares; the last of other rooms

SHADE: Span = (0.25, 0.85)  # of a surface: its albedo,
TINT: Span = (0.9, 1.0)  # times so much of red, green and blue
OTHER: Span = (0.6, 1.3)  # the other albedo of a texture over the first
PATTERNS: tuple[Pattern, ...] = ("noise", "tiles", "bricks", "wood", "checker")
PATTERN_M = (0.05, 0.1, 0.2, 0.4)
FLAT: Span = (0.4, 1.0)  # height of a pattern over its width
OCTAVES, PATTERN_SEEDS = (1, 4), 100
CEILING = Material(albedo=(0.85, 0.85, 0.83))

HANGING, HANGING_MANY = (1, 5), (4, 9)  # at each wall, the latter where a camera goes along one
HANGING_M: Span = (0.3, 1.2)
FROM_CORNER_M: Span = (0.3, 1.3)  # of the wall where it begins and ends
OFF_WALL_M = 0.02
DEEP_M: Span = (0.1, 0.5)
FLAT_ONES, TALL_ONES = 0.5, 0.7  # shares: of panels among boxes, and of higher boxes
AT_WALLS = ("poster", "board", "magazine", "paper", "wall", "metal", "spines")

ON_TABLE, TABLE_TOP_M = (0, 9), 0.74
TABLE_X_M: Span = (-0.5, 0.5)
TABLE_Y_M: Span = (-0.3, 0.3)
THINGS = ("monitor", "keyboard", "stack", "mug", "plant", "lamp", "globe")
MIDDLE = 0.3  # of the shorter side; what stands there is within these shares of it
BOXES, BOXES_WITHIN = (1, 8), (-0.6, 0.6)
BOX_M: Span = (0.2, 0.8)
BOX_HEIGHT_M: Span = (0.3, 1.2)
BOX_MATERIALS = ("box", "books", "white", "wall", "fabric", "desk", "metal", "magazine")
CHAIRS, CHAIRS_WITHIN = (0, 4), (-0.8, 0.8)

PEOPLE = (0, 0, 0, 1, 2)
PERSONS = ("person_red", "person_shirt", "person_green")
APART_M = 0.8  # from the camera's way, at least
TRIES = 50  # for a way so far apart, else there is nobody
STEP_M: Span = (-0.8, 0.8)  # between the points of a way, on each axis
FROM_WALL_M = 0.4
PACE_M_S: Span = (0.3, 1.0)
SPIN_DEG_S: Span = (-40.0, 40.0)
AHEAD_M: Span = (0.0, 3.0)  # along their way, at the start


@dataclass(frozen=True)
class Plan:
    """What a room is like before anything stands in it.

    Parameters
    ----------
    kind : str
        One of ``KINDS``: the camera goes about a desk, walks through, goes along a wall, or turns.
    width, length, height : float
        Metres, along x, y and z; the middle of the floor is the origin.
    plain : bool
        Whether all walls are without texture.
    """

    kind: str
    width: float
    length: float
    height: float
    plain: bool


class Wall(NamedTuple):
    """A wall: its material, the corner where it begins, and its way from there, metres."""

    material: str
    corner: F64
    along: F64


def one_of(rng: np.random.Generator, of: Sequence[Choice]) -> Choice:
    """Draw one of several, each as likely."""
    return of[int(rng.integers(len(of)))]


def chance(rng: np.random.Generator, share: float) -> bool:
    """Draw whether it is so, which it is in this share of all cases."""
    return bool(rng.uniform() < share)


def vector(values: F64) -> tuple[float, float, float]:
    """Give three numbers as scenes take them."""
    x, y, z = values.tolist()
    return x, y, z


def draw_plan(rng: np.random.Generator) -> Plan:
    """Draw what the room is like."""
    kind = one_of(rng, KINDS)
    width, length, height = rng.uniform(*SIDE_M), rng.uniform(*SIDE_M), rng.uniform(*HEIGHT_M)
    return Plan(kind, width, length, height, chance(rng, PLAIN_ROOMS))


def surface(rng: np.random.Generator, plain: bool) -> Material:
    """Draw what a floor or a wall is covered with."""
    albedo = np.clip(rng.uniform(*SHADE) * rng.uniform(*TINT, 3), 0, 1)
    if plain:
        return Material(albedo=vector(albedo))
    kind, size = one_of(rng, PATTERNS), one_of(rng, PATTERN_M)
    other = np.clip(albedo * rng.uniform(*OTHER), 0, 1)
    texture = Texture(
        kind=kind,
        size=(size, size * rng.uniform(*FLAT)),
        albedo=vector(other),
        octaves=int(rng.integers(*OCTAVES)),
        seed=int(rng.integers(PATTERN_SEEDS)),
    )
    return Material(albedo=vector(albedo), texture=texture)


def shell(rng: np.random.Generator, plan: Plan) -> tuple[dict[str, Material], list[Shape]]:
    """Draw floor, ceiling and walls, and what hangs or stands at these."""
    materials = {"ground": surface(rng, chance(rng, PLAIN_FLOORS)), "ceiling": CEILING}
    shapes: list[Shape] = [
        Panel(
            shape="panel",
            material=material,
            corner=(-plan.width / 2, -plan.length / 2, z),
            along=(plan.width, 0.0, 0.0),
            up=(0.0, plan.length, 0.0),
        )
        for material, z in (("ground", 0.0), ("ceiling", plan.height))
    ]
    for wall in walls(plan):
        materials[wall.material] = surface(rng, plan.plain or chance(rng, PLAIN_WALLS))
        shapes.append(upright(wall.material, wall.corner, wall.along, plan.height))
        shapes += at_wall(rng, plan, wall)
    return materials, shapes


def walls(plan: Plan) -> list[Wall]:
    """Give the four walls; the first is the one that a camera goes along."""
    x, y = plan.width / 2, plan.length / 2
    across, along = (plan.width, 0.0, 0.0), (0.0, plan.length, 0.0)
    ends = (((-x, y), across), ((-x, -y), across), ((-x, -y), along), ((x, -y), along))
    return [
        Wall(f"side {number}", np.array([*corner, 0.0]), np.array(way))
        for number, (corner, way) in enumerate(ends)
    ]


def upright(material: str, corner: F64, along: F64, height: float) -> Panel:
    """Make an upright panel."""
    return Panel(
        shape="panel",
        material=material,
        corner=vector(corner),
        along=vector(along),
        up=(0.0, 0.0, height),
    )


def at_wall(rng: np.random.Generator, plan: Plan, wall: Wall) -> Iterator[Shape]:
    """Draw what hangs at a wall, or stands there: panels, and boxes on the floor."""
    middle = wall.corner + wall.along / 2
    inward = -np.sign([middle[0], middle[1], 0.0]) * (wall.along == 0) * [1, 1, 0]
    long = float(np.linalg.norm(wall.along))
    way = wall.along / long
    materials = (*AT_WALLS, wall.material)
    for _ in range(int(rng.integers(*(HANGING_MANY if plan.kind == "wall" else HANGING)))):
        place = rng.uniform(FROM_CORNER_M[0], long - FROM_CORNER_M[1])
        width, height = rng.uniform(*HANGING_M), rng.uniform(*HANGING_M)
        bottom = rng.uniform(0, plan.height - height)
        corner = wall.corner + place * way + inward * OFF_WALL_M
        corner[2] = bottom
        material = one_of(rng, materials)
        if chance(rng, FLAT_ONES):
            yield upright(material, corner, way * width, height)
            continue
        deep = rng.uniform(*DEEP_M)
        x, y, _z = vector(corner + way * width / 2 + inward * deep / 2)
        size = (width, deep) if way[0] else (deep, width)
        tall = height + bottom if chance(rng, TALL_ONES) else height
        yield Box(shape="box", material=material, at=(x, y, 0.0), size=(*size, tall))


def middle(rng: np.random.Generator, plan: Plan) -> Iterator[Shape]:
    """Draw what stands in the middle: a desk, boxes and chairs, or nothing."""
    if plan.kind == "desk":
        yield from desk(rng)
    elif plan.kind == "walk":
        yield from clutter(rng, MIDDLE * min(plan.width, plan.length))


def desk(rng: np.random.Generator) -> Iterator[Part]:
    """Draw a desk and what lies on it."""
    yield Part(shape="part", name="desk", yaw=turned(rng))
    for _ in range(int(rng.integers(*ON_TABLE))):
        name = one_of(rng, THINGS)
        at = (rng.uniform(*TABLE_X_M), rng.uniform(*TABLE_Y_M), TABLE_TOP_M)
        yield Part(shape="part", name=name, at=at, yaw=turned(rng))


def clutter(rng: np.random.Generator, radius: float) -> Iterator[Shape]:
    """Draw boxes and chairs within so many metres of the middle."""
    for _ in range(int(rng.integers(*BOXES))):
        material = one_of(rng, BOX_MATERIALS)
        width, deep = rng.uniform(*BOX_M, 2).tolist()
        at = on_floor(rng, BOXES_WITHIN, radius)
        size = (width, deep, rng.uniform(*BOX_HEIGHT_M))
        yield Box(shape="box", material=material, at=at, size=size, yaw=rng.uniform(0, 90))
    for _ in range(int(rng.integers(*CHAIRS))):
        at = on_floor(rng, CHAIRS_WITHIN, radius)
        yield Part(shape="part", name="chair", at=at, yaw=turned(rng))


def on_floor(rng: np.random.Generator, within: Span, radius: float) -> tuple[float, float, float]:
    """Draw a place on the floor."""
    return rng.uniform(*within) * radius, rng.uniform(*within) * radius, 0.0


def turned(rng: np.random.Generator) -> float:
    """Draw a turn, degrees."""
    return rng.uniform(0, 360)


def people(rng: np.random.Generator, plan: Plan, way: F64) -> Iterator[Part]:
    """Draw people who walk to and fro, apart from the camera's way, a closed polyline (N, 3)."""
    for _ in range(one_of(rng, PEOPLE)):
        path = path_apart(rng, plan, way[:, :2])
        if path is None:
            continue
        name = one_of(rng, PERSONS)
        walk = Walk(
            path=tuple((x, y, 0.0) for x, y in path.tolist()),
            speed=rng.uniform(*PACE_M_S),
            turn=rng.uniform(*SPIN_DEG_S),
            start=rng.uniform(*AHEAD_M),
            closed=False,
        )
        yield Part(shape="part", name=name, walk=walk)


def path_apart(rng: np.random.Generator, plan: Plan, way: F64) -> F64 | None:
    """Draw the three points (3, 2) of a walk apart from the camera's way, if one is found."""
    sides = np.array([plan.width, plan.length])
    limit = sides / 2 - FROM_WALL_M
    passed = between(way, 10)
    for _ in range(TRIES):
        start = rng.uniform(-0.5, 0.5, 2) * (sides - 1)
        path: F64 = np.clip(start + np.cumsum(rng.uniform(*STEP_M, (3, 2)), axis=0), -limit, limit)
        gaps = np.linalg.norm(between(path, 20)[:, None] - passed[None], axis=2)
        if gaps.min() > APART_M:
            return path
    return None


def between(points: F64, count: int) -> F64:
    """Give so many points on each straight line between these."""
    return np.vstack([np.linspace(start, end, count) for start, end in pairwise(points)])
