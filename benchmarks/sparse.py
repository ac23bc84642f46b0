"""Large steps between frames: the share of pairs, and of a run, that is where it says it is.

    python -m benchmarks.sparse [--data FOLDER] [--only tum_fr3_cabinet_sparse]

tracks a sequence of few frames a second twice: each two consecutive frames by themselves, and all
of them in a row. A pair is within if its motion is within 5 cm and 2 degrees of the truth; a step
of the run is the motion between two consecutive frames that both have a pose. Printed are how many
are within, how many of the others say ``tracked`` or ``degraded``, and how many are lost.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import DATA
from benchmarks.section import table
from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets import open_source
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame

NEAR_M, NEAR_DEG = 0.05, 2.0
NAMES = "tum_fr3_cabinet_sparse"


@dataclass(frozen=True)
class Step:
    """A motion between two consecutive frames: what was said of it, and how far off it is."""

    status: Status
    metres: float
    degrees: float

    @property
    def is_within(self) -> bool:
        """Whether it has a pose, and a right one."""
        near = self.metres < NEAR_M and self.degrees < NEAR_DEG
        return near and self.status is not Status.LOST


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the sequences")
    parser.add_argument("--only", default=NAMES, help="names of sequences, joined by commas")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--every", type=int, default=1, help="take one frame in so many")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    config = Config.preset(arguments.preset).with_overrides(arguments.set)
    rows = []
    for name in arguments.only.split(","):
        source = open_source(arguments.data / name)
        readings = [source.read(i) for i in range(0, len(source), arguments.every)]
        reference = source.ground_truth
        assert reference is not None, f"{name} has no ground truth"
        span = reference.timestamps[0], reference.timestamps[-1]
        read = [reading.frame for reading in readings if reading.frame is not None]
        frames = [frame for frame in read if span[0] <= frame.timestamp <= span[1]]
        truth = [reference.at(frame.timestamp) for frame in frames]
        for kind, steps in (
            ("pairs", pairs(source.camera, config, frames, truth)),
            ("run", run(source.camera, config, frames, truth)),
        ):
            rows.append([name, kind, *counted(steps)])
    print(table(["sequence", "", "within", "tracked, not", "degraded, not", "lost"], rows))


def pairs(
    camera: Camera, config: Config, frames: Sequence[Frame], truth: Sequence[NDArray[np.float64]]
) -> list[Step]:
    """Register each frame with the one before it, and know nothing else."""
    steps = []
    odometry = Odometry(camera, config)
    for i in range(1, len(frames)):
        odometry.reset()
        first, second = (odometry.track(frame) for frame in frames[i - 1 : i + 1])
        steps.append(step(first, second, truth[i - 1], truth[i]))
    return steps


def run(
    camera: Camera, config: Config, frames: Sequence[Frame], truth: Sequence[NDArray[np.float64]]
) -> list[Step]:
    """Track all frames in a row."""
    odometry = Odometry(camera, config)
    results = [odometry.track(frame) for frame in frames]
    return [step(results[i - 1], results[i], truth[i - 1], truth[i]) for i in range(1, len(frames))]


def step(
    before: TrackedFrame,
    after: TrackedFrame,
    T_true_before: NDArray[np.float64],
    T_true_after: NDArray[np.float64],
) -> Step:
    """Hold the motion from one frame to the next against the truth."""
    T_true = se3.inverse(T_true_before) @ T_true_after
    T_off = se3.inverse(T_true) @ se3.inverse(before.T_world_cam) @ after.T_world_cam
    status = Status.LOST if before.status is Status.LOST else after.status
    metres = float(np.linalg.norm(T_off[:3, 3]))
    return Step(status, metres, math.degrees(se3.rotation_angle(T_off)))


def counted(steps: Sequence[Step]) -> list[str]:
    """Count what is where it says it is, what is not, and what says nothing."""
    within = sum(one.is_within for one in steps)
    wrong = [one.status for one in steps if not one.is_within]
    return [
        f"{within} of {len(steps)} ({within / len(steps):.0%})",
        *(str(wrong.count(status)) for status in (Status.TRACKED, Status.DEGRADED, Status.LOST)),
    ]


if __name__ == "__main__":
    main()
