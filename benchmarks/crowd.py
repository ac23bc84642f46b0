"""What moves by itself: how far people take the pose along, followed or left out.

    python -m benchmarks.crowd [--frames 150] [--only 0,3] [--set KEY=VALUE]

renders crowds of three kinds: the scene ``crowd``, whose walls are beyond the reach of depth; the
same hall with other people, walking other ways; and a small hall, whose walls are within it.
Prints, for each value of ``status.moving``, the error of the last second in m/s (rms and largest,
of frames that have a pose), frames lost, and frames tracked that are wrong by more than 0.1 m/s.
"""

import argparse

import cv2
import numpy as np

from benchmarks.section import table
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.evaluation.honesty import error_speed
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.scene import Part, Scene, Walk, load_scene
from edvo.synthesis.sequence import SyntheticSource, make_recipe

WRONG_M_S = 0.1
NEARER_M = 1.2  # by so much the walls of the small hall are: then 4.5 m away
PEOPLE = ("person_red", "person_shirt", "person_green", "person_red")


def small_hall() -> Scene:
    """Bring the walls of ``crowd`` within the reach of depth, and leave out who walks behind."""
    hall = load_scene("crowd")
    shapes = []
    for shape in hall.shapes:
        if shape.shape == "panel" and shape.corner[1] > 3.9:
            x, y, z = shape.corner
            shape = shape.model_copy(update={"corner": (x, y - NEARER_M, z)})
        if shape.shape == "cylinder":
            shape = shape.model_copy(update={"at": (shape.at[0], 2.2, 0.0)})
        if shape.walk is None or shape.at[1] < 1.5:
            shapes.append(shape)
    return hall.model_copy(update={"shapes": tuple(shapes)})


def other_people(seed: int) -> Scene:
    """Let four people walk other ways through ``crowd``."""
    rng, hall = np.random.default_rng(seed), load_scene("crowd")
    shapes = [shape for shape in hall.shapes if shape.walk is None]
    for name in PEOPLE:
        path = [(*rng.uniform((-2, -0.3), (2, 0.3)).tolist(), 0.0) for _ in range(4)]
        walk = Walk(
            path=tuple(path),
            speed=rng.uniform(0.3, 1.0),
            turn=rng.uniform(-40, 40),
            start=rng.uniform(0, 4),
        )
        at = (0.0, rng.uniform(-0.2, 1.8), 0.0)
        shapes.append(Part(shape="part", name=name, at=at, walk=walk))
    return hall.model_copy(update={"shapes": tuple(shapes)})


#: Name, scene, seed of tremor and noise, first frame, speed of the camera in m/s.
CROWDS = (
    ("crowd", "crowd", 3, 0, None),
    ("crowd", "crowd", 1, 0, None),
    ("crowd, 5 s later", "crowd", 2, 150, None),
    ("crowd, fast, 10 s later", "crowd", 5, 300, 0.45),
    *(("other people", other_people(seed), seed, 0, None) for seed in range(1, 10)),
    ("small hall", small_hall(), 3, 0, None),
    ("small hall, fast, 7 s later", small_hall(), 4, 200, 0.35),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--only", default="", help="rows, from 0, joined by commas")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    chosen = (
        [int(row) for row in arguments.only.split(",")] if arguments.only else range(len(CROWDS))
    )
    rows = []
    for name, scene, seed, first, speed in (CROWDS[row] for row in chosen):
        recipe = make_recipe(scene, frames=first + arguments.frames, seed=seed, speed=speed)
        source = SyntheticSource(recipe)
        readings = read_ahead(source, range(first, first + arguments.frames))
        frames = [reading.frame for reading in readings if reading.frame is not None]
        cells = [
            outcome(source, frames, [f"status.moving={moving}", *arguments.set])
            for moving in ("follow", "leave-out")
        ]
        rows.append([f"{name} (seed {seed})", *cells])
        print(" | ".join(rows[-1]), flush=True)
    print(
        "\nError of the last second, rms (largest), m/s; frames lost; frames tracked and wrong.\n"
    )
    print(table(["crowd", "follow", "leave-out"], rows))


def outcome(source: SyntheticSource, frames: list[Frame], changes: list[str]) -> str:
    """Track frames and hold them against the truth."""
    odometry = Odometry(source.camera, Config().with_overrides(changes))
    results = [odometry.track(frame) for frame in frames]
    times = np.array([frame.timestamp for frame in frames])
    truth = np.array([source.recipe.motion.at(float(time)) for time in times])
    poses = np.array([result.T_world_cam for result in results])
    given = np.array([result.status is not Status.LOST for result in results])
    tracked = np.array([result.status is Status.TRACKED for result in results])
    speed = error_speed(times, truth, poses, given)
    known = speed[given & np.isfinite(speed)]
    errors = f"{np.sqrt(np.mean(known**2)):.3f} ({known.max():.3f})" if len(known) else "none"
    wrong = np.count_nonzero(tracked & (speed > WRONG_M_S))
    return f"{errors}; {np.count_nonzero(~given)}; {wrong}"


if __name__ == "__main__":
    main()
