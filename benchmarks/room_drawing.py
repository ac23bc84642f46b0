"""Rooms drawn by a seed: a scene, a camera's way through it, and how it is filmed."""

from dataclasses import dataclass

import numpy as np

from benchmarks.room_camera import Filming, Way, draw_filming, draw_way
from benchmarks.room_things import (
    MATERIALS,
    PARTS,
    Plan,
    Span,
    chance,
    draw_plan,
    middle,
    people,
    shell,
    vector,
)
from edvo.synthesis.scene import CameraPath, Lights, Scene
from edvo.synthesis.sequence import Recipe, make_recipe

STREAM = 11  # of random numbers, beside the seed
BACKGROUND = (0.5, 0.5, 0.5)
AMBIENT: Span = (0.15, 0.5)
LAMPS = (1, 3)
LAMP_XY_M: Span = (-1.0, 1.0)
BELOW_CEILING_M = 0.2
LAMP: Span = (1.0, 3.0)
SHADOWS, SUNNY = 0.5, 0.3  # shares: of lamps that cast shadows, and of rooms with light from afar
SUN: Span = (0.1, 0.3)
SUN_DIRECTION = (0.3, 0.5, -0.8)


@dataclass(frozen=True)
class Room:
    """What a seed gave.

    Parameters
    ----------
    seed : int
    plan : Plan
        Kind and sizes.
    people : int
        Who walk there.
    scene : Scene
        All that is seen, and the camera's way.
    filming : Filming
        Cameras and light.
    """

    seed: int
    plan: Plan
    people: int
    scene: Scene
    filming: Filming

    def recipe(self, frames: int) -> Recipe:
        """Say how to render so many frames; more have the same first ones."""
        filming = self.filming
        return make_recipe(
            self.scene,
            frames=frames,
            camera=filming.camera,
            sensor=filming.sensor,
            trajectory=filming.motion,
            light=filming.light,
            seed=self.seed,
            exposure=filming.exposure,
            shutter=filming.shutter,
            colour_clock=filming.colour_clock,
            depth_clock=filming.depth_clock,
        )


def draw(seed: int) -> Room:
    """Draw a room.

    Parameters
    ----------
    seed : int
        The same one gives the same room, 0 or more.

    Returns
    -------
    Room
        To be rendered by its recipe.
    """
    rng = np.random.default_rng([seed, STREAM])
    plan = draw_plan(rng)
    materials, shapes = shell(rng, plan)
    shapes += middle(rng, plan)
    way = draw_way(rng, plan)
    walking = list(people(rng, plan, way.points))
    lights = draw_lights(rng, plan.height)
    scene = Scene(
        name=f"room {seed}",
        background=BACKGROUND,
        materials={**MATERIALS, **materials},
        parts=PARTS,
        shapes=(*shapes, *walking),
        lights=lights,
        camera=led_along(way),
    )
    return Room(seed, plan, len(walking), scene, draw_filming(rng))


def draw_lights(rng: np.random.Generator, height: float) -> Lights:
    """Draw lamps below the ceiling, and light from afar."""
    ambient = rng.uniform(*AMBIENT)
    lamps = [draw_lamp(rng, height) for _ in range(int(rng.integers(*LAMPS)))]
    afar = []
    if chance(rng, SUNNY):
        afar = [{"direction": SUN_DIRECTION, "intensity": rng.uniform(*SUN)}]
    return Lights.model_validate({"ambient": ambient, "point": lamps, "directional": afar})


def draw_lamp(rng: np.random.Generator, height: float) -> dict[str, object]:
    """Draw a lamp below the ceiling."""
    x, y = rng.uniform(*LAMP_XY_M), rng.uniform(*LAMP_XY_M)
    at = (x, y, height - BELOW_CEILING_M)
    return {"position": at, "intensity": rng.uniform(*LAMP), "shadows": chance(rng, SHADOWS)}


def led_along(way: Way) -> CameraPath:
    """Give a way as scenes take it."""
    points, targets = (tuple(map(vector, ends)) for ends in (way.points, way.targets))
    return CameraPath(points=points, targets=targets, closed=True, speed=way.speed)
