"""Depth apart from colour and rolling shutters: what making up for them is worth.

    python -m benchmarks.instants [--only office,tum_fr1_xyz] [--runs 6]

tracks rendered scenes whose rows are read one after the other (25 ms) and whose depth is 14 ms
later than colour, with stamps that tell so and without; the same scenes with an ideal camera; and
the real sequences that there are. Each several times, from another start and with another seed;
printed are root mean squares of the relative pose error over one second (TUM), frames lost, and
what was measured by the end (medians).
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.frames import DATA, REAL
from benchmarks.section import table
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets import Source, open_source
from edvo.evaluation import evaluate
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.clock import Clock
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

SCENES = ("office", "texture_near", "texture_far", "cabinet")
FRAMES, SPEED, SEED = 100, 0.5, 1
EXPOSURE_S, STEPS, READOUT_S, LATER_S = 0.02, 5, 0.025, 0.014
RULES = {
    "at once": ("motion.depth_delay=none", "motion.readout=none"),
    "depth by stamps": ("motion.depth_delay=stamps", "motion.readout=none"),
    "depth measured": ("motion.depth_delay=measured", "motion.readout=none"),
    "rows measured": ("motion.depth_delay=none", "motion.readout=measured"),
    "both": ("motion.depth_delay=measured", "motion.readout=measured"),
}


@dataclass(frozen=True)
class Clip:
    """Frames in memory, with their truth."""

    name: str
    camera: Camera
    frames: tuple[Frame, ...]
    truth: Trajectory

    def unstamped(self) -> "Clip":
        """Forget what stamps tell of depth."""
        frames = tuple(replace(frame, depth_delay=0.0) for frame in self.frames)
        return replace(self, name=f"{self.name}, no stamps", frames=frames)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help="names, with commas between them")
    parser.add_argument("--runs", type=int, default=6)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for clip in clips(given.only.split(",") if given.only else None):
        results = [run(clip, rule, given.runs) for rule in RULES.values()]
        delay, readout = results[-1][1:]
        rows.append([clip.name, *(cell for cell, _, _ in results), f"{delay:.0f}, {readout:.0f}"])
        print(rows[-1], flush=True)
    print()
    print(table(["RPE, mm/s", *RULES, "delay beyond stamps, readout (ms)"], rows))


def clips(only: list[str] | None) -> Iterator[Clip]:
    """Give the sequences one by one."""
    for name in REAL:
        if (DATA / name).is_dir() and (only is None or name in only):
            yield read(name, open_source(DATA / name))
    for scene in SCENES:
        if only is None or scene in only:
            ideal = make_recipe(scene, frames=FRAMES, speed=SPEED, seed=SEED)
            yield read(f"{scene}, ideal", SyntheticSource(ideal))
            shutter = Shutter(EXPOSURE_S, STEPS, READOUT_S)
            later = Clock(30.0, offset=LATER_S, jitter=0.001)
            rough = read(scene, SyntheticSource(replace(ideal, shutter=shutter, depth_clock=later)))
            yield rough
            yield rough.unstamped()


def read(name: str, source: Source) -> Clip:
    """Read a sequence; images that have no partner are left out."""
    frames = tuple(f for i in range(len(source)) if (f := source.read(i).frame) is not None)
    truth = source.ground_truth
    assert isinstance(truth, Trajectory), f"{name} has no ground truth"
    return Clip(name, source.camera, frames, truth)


def run(clip: Clip, rule: tuple[str, ...], runs: int) -> tuple[str, float, float]:
    """Track a clip several times: its cell, and the delay and the readout measured, ms."""
    squares, measured, lost = [], [], 0
    for k in range(runs):
        frames = clip.frames[7 * k % max(len(clip.frames) // 4, 1) :]
        config = Config().with_overrides([f"seed={k}", *rule])
        odometry = Odometry(clip.camera, config)
        lost += sum(odometry.track(frame).status is Status.LOST for frame in frames)
        found = evaluate(clip.truth, odometry.trajectory, len(frames))
        assert found.rpe is not None
        squares.append(found.rpe.rmse**2)
        measured.append((odometry.depth_delay, odometry.readout))
    delay, readout = np.median(1e3 * np.array(measured), axis=0)
    cell = f"{1e3 * np.sqrt(np.mean(squares)):.2f}"
    return cell + (f", {lost} lost" if lost else ""), float(delay), float(readout)


if __name__ == "__main__":
    main()
