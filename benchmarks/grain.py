"""Scenes whose edges run one way, but for a few: what looking for these, and new ones, is worth.

    python -m benchmarks.grain [--only slats] [--docs]

renders four seconds of walls of slats, boards and bricks, of a floor of planks and of the grain of
a wooden one, along two ways each, by an ideal camera and by one whose rows are read in 25 ms and
exposed for 20, and whose depth is 14 ms later than its stamps tell; and tracks each four times,
from two first frames with two seeds. Printed is what `benchmarks.turning` prints.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import cv2

from benchmarks.frames import ROOT
from benchmarks.instants import EXPOSURE_S, LATER_S, READOUT_S, STEPS
from benchmarks.report import document
from benchmarks.section import table
from benchmarks.turning import Recorded, cell, last_row, score
from edvo.datasets import read_ahead
from edvo.synthesis.clock import Clock
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.scene import load_scene
from edvo.synthesis.sequence import Recipe, SyntheticSource, make_recipe

PAGE = ROOT / "docs" / "theory" / "across.md"
MARK = "<!-- measured: written by python -m benchmarks.grain --docs -->\n"
SCENES = Path(__file__).with_name("scenes")
NAMES, SEEDS = ("slats", "boards", "bricks", "planks", "grain"), (1, 2)
FRAMES, SPEED = 120, 0.4  # m/s
RULES = {
    "default": (),
    "`along_px=0`": ("motion.along_px=0",),
    "`tells_times=0`": ("keyframes.tells_times=0",),
    "`own_scale_px=0`": ("registration.own_scale_px=0",),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(NAMES), help="scenes, joined by commas")
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    rows, scores = [], []
    for name in given.only.split(","):
        for seed in SEEDS:
            for camera, recipe in cameras(name, seed).items():
                clip = render(recipe)
                measured = [score(clip, rule) for rule in RULES.values()]
                rows.append([f"`{name}`, way {seed}", camera, *map(cell, measured)])
                scores.append(measured)
                print(" | ".join(rows[-1]), flush=True)
    rows.append(["geometric mean, sums", "", *last_row(scores)])
    measured_table = table(["rendered", "camera", *RULES], rows) + "\n"
    print("\nRPE, mm/s; tracked but wrong, lost\n\n" + measured_table)
    if given.docs:
        document(PAGE.parent, measured_table, page=PAGE, mark=MARK)


def cameras(name: str, seed: int) -> dict[str, Recipe]:
    """Say how a scene is recorded by an ideal camera, and by one as real ones are."""
    scene = load_scene(SCENES / f"{name}.yaml")
    ideal = make_recipe(scene, frames=FRAMES, speed=SPEED, seed=seed)
    shutter = Shutter(EXPOSURE_S, STEPS, READOUT_S)
    clock = Clock(30.0, offset=LATER_S, jitter=0.001)
    return {"ideal": ideal, "as real ones": replace(ideal, shutter=shutter, depth_clock=clock)}


def render(recipe: Recipe) -> Recorded:
    """Render a clip, whose stamps say nothing of depth."""
    source = SyntheticSource(recipe)
    readings = read_ahead(source, range(FRAMES))
    frames = [reading.frame for reading in readings if reading.frame is not None]
    frames = [replace(frame, depth_delay=0.0) for frame in frames]
    return Recorded(source.camera, frames, source.ground_truth)


if __name__ == "__main__":
    main()
