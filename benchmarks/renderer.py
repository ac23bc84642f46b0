"""How many frames a second are rendered, scene by scene.

    python -m benchmarks.renderer [--docs] [--frames 8]

prints the table of docs/scenes, or writes it there. Times are those of the processor, so that other
programs disturb little: what the main thread does alone, and half of what the two threads of the
renderer share.
"""

import argparse
from collections.abc import Callable
from time import process_time, thread_time

import numpy as np

from benchmarks.frames import ROOT
from benchmarks.section import table
from edvo.files import write_atomically
from edvo.synthesis.renderer import Renderer
from edvo.synthesis.scene import Scene, load_scene, scene_names
from edvo.synthesis.sequence import SyntheticSource, make_recipe

PAGE = ROOT / "docs" / "scenes.md"
MARK = "<!-- measured: written by python -m benchmarks.renderer --docs -->\n"
END = "<!-- end of measured -->\n"
CORES = 2
CALLS = 3  # of each frame
LONGEST = 300  # frames of the sequences that frames are taken from
BUSY = ("office", "mesh")  # promised 5 frames a second, all others 15


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    parser.add_argument("--frames", type=int, default=8, help="of each scene")
    given = parser.parse_args()
    scenes = [load_scene(name) for name in scene_names()] + [bumpy_ball()]
    measured = table(
        ["scene", "primitives", "render, ms of one core", "render, fps", "at least", "all, fps"],
        [row(scene, given.frames) for scene in scenes],
    )
    print(measured)
    if given.docs:
        before, rest = PAGE.read_text(encoding="utf-8").split(MARK)
        _, after = rest.split(END)
        write_atomically(PAGE, f"{before}{MARK}\n{measured}\n\n{END}{after}")


def row(scene: Scene, frames: int) -> list[str]:
    """Render some frames of a scene, spread over ten seconds, and make whole images of them."""
    source = SyntheticSource(make_recipe(scene, frames=LONGEST))
    recipe = source.recipe
    renderer = Renderer(scene, recipe.camera, threads=CORES)
    chosen = np.linspace(0, LONGEST - 1, frames).round().astype(int).tolist()

    def render(index: int) -> None:
        t = float(recipe.colour_times[index])
        renderer.expose(recipe.motion.at, t, light=recipe.light)

    alone, shared = times(render, chosen)
    # Whoever reads a sequence ahead has a thread for every frame.
    whole = sum(times(lambda index: source.read(index), chosen))
    promised = 5 if scene.name in BUSY else 15
    return [
        scene.name,
        str(len(renderer.world.at(0.0).kind)),
        f"{1e3 * (alone + shared):.0f}",
        f"{1 / (alone + shared / CORES):.1f}",
        str(promised),
        f"{CORES / whole:.1f}",
    ]


def times(work: Callable[[int], object], chosen: list[int]) -> tuple[float, float]:
    """Give mean seconds of this thread, and of all others: the best of each frame's calls."""
    work(chosen[0])
    found = []
    for index in chosen:
        calls = []
        for _ in range(CALLS):
            start = thread_time(), process_time()
            work(index)
            mine = thread_time() - start[0]
            calls.append((mine, process_time() - start[1] - mine))
        found.append(min(calls, key=sum))
    alone, shared = np.mean(found, axis=0)
    return float(alone), float(shared)


def bumpy_ball(rings: int = 100) -> Scene:
    """Make a scene of one mesh of 2 rings^2 triangles, which fills much of the view."""
    around = np.linspace(0.0, 2 * np.pi, rings, endpoint=False)
    down = np.linspace(1e-3, np.pi - 1e-3, rings + 1)
    phi, theta = np.meshgrid(around, down)
    radius = 1 + 0.05 * np.sin(8 * phi) * np.sin(9 * theta)
    x, y = radius * np.sin(theta) * np.cos(phi), radius * np.sin(theta) * np.sin(phi)
    points = np.stack([x, y, radius * np.cos(theta)], axis=2).reshape(-1, 3)
    faces = []
    for i in range(rings):
        for j in range(rings):
            a, b = i * rings + j, i * rings + (j + 1) % rings
            faces += [[a, b, a + rings], [b, b + rings, a + rings]]
    return Scene.from_dict(
        {
            "about": "one mesh before a wall",
            "materials": {
                "clay": {"albedo": [0.6, 0.5, 0.4], "gloss": 0.1},
                "wall": {"albedo": [0.7, 0.7, 0.7]},
            },
            "shapes": [
                {"shape": "mesh", "material": "clay", "vertices": points.tolist(), "faces": faces},
                {"shape": "panel", "material": "wall", "corner": [-9, 2, -9], "along": [18, 0, 0],
                 "up": [0, 0, 18]},
            ],
            "lights": {
                "ambient": 0.3,
                "directional": [{"direction": [1, 2, -1], "intensity": 0.6, "shadows": True}],
            },
            "camera": {
                "points": [[-0.5, -3, 0.3], [0.5, -3, 0.3]],
                "targets": [[0, 0, 0], [0, 0, 0.1]],
            },
        },
        where="mesh",
    )  # fmt: skip


if __name__ == "__main__":
    main()
