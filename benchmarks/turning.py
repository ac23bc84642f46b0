"""Cameras that turn on random ways before panels, stairs and walls, where few edges tell a motion.

    python -m benchmarks.turning [--only notexture_far] [--docs]

renders ten clips of five seconds and tracks each four times, from two first frames with two seeds:
the preset `default`, and the same without what it makes of evidence that is left out, and of
motions that hardly anything constrains. Printed are root mean squares of the relative pose error
over one second (TUM), and how many frames said *tracked* and were wrong by more than 0.1 m within
the last second, or were lost.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import ROOT
from benchmarks.honesty import WRONG_M_S
from benchmarks.report import document
from benchmarks.section import table
from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.evaluation import evaluate
from edvo.evaluation.honesty import error_speed
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

PAGE = ROOT / "docs" / "theory" / "unconstrained.md"
MARK = "<!-- measured: written by python -m benchmarks.turning --docs -->\n"
FRAMES, STARTS, SEEDS = 150, (0, 9), (0, 1)
INSTANTS = 7  # that an exposure is the mean of
WAVES, FREQUENCIES, SPEED = 6, (0.25, 1.5), 0.3  # sinusoids an axis, Hz, m/s
RULES = {
    "default": (),
    "`min_told=0`": ("status.min_told=0",),
    "`inertia=none`": ("motion.inertia=none",),
    "neither": ("status.min_told=0", "motion.inertia=none"),
}


class Clip(NamedTuple):
    """What is rendered: a scene, how fast the camera turns (rms, deg/s), and by which seed.

    And in what time its rows are read and exposed, seconds.
    """

    scene: str
    turn: float
    seed: int
    readout: float = 0.0
    exposure: float = 0.0


CLIPS = (
    Clip("notexture_near", 40, 5),
    Clip("notexture_near", 30, 16),
    Clip("notexture_near", 55, 33),
    Clip("notexture_far", 60, 7),
    Clip("notexture_far", 40, 8),
    Clip("notexture_far", 35, 34),
    Clip("notexture_far", 30, 36, 0.02),
    Clip("white_wall", 20, 38),
    Clip("stairs", 40, 39),
    Clip("corridor", 60, 40),
)


@dataclass(frozen=True)
class Recorded:
    """Frames in memory, with their truth."""

    camera: Camera
    frames: list[Frame]
    truth: Trajectory


class RandomWay:
    """Sums of sinusoids, each axis by itself.

    Parameters
    ----------
    start : ndarray of float64, shape (4, 4)
        Where it begins.
    turn : float
        Degrees a second, rms.
    seed : int
    """

    duration = float("inf")

    def __init__(self, start: NDArray[np.float64], turn: float, seed: int) -> None:
        random = np.random.default_rng([seed, 7])
        self._omega = 2 * np.pi * random.uniform(*FREQUENCIES, (WAVES, 6))
        self._phase = random.uniform(0, 2 * np.pi, (WAVES, 6))
        sizes = random.uniform(0.5, 1.0, (WAVES, 6)) / self._omega
        rms = np.sqrt(((sizes * self._omega) ** 2).sum(axis=0) / 2)  # of each axis, 1/s
        way, about = np.hypot.reduce(rms[:3]), np.hypot.reduce(rms[3:])
        scale = np.array([SPEED / way] * 3 + [np.radians(turn) / about] * 3)
        self._sizes = sizes * scale
        self._start = start @ se3.inverse(self._at(0.0))

    def at(self, t: float) -> NDArray[np.float64]:
        """Give T_world_cam, shape (4, 4), at ``t`` seconds."""
        T: NDArray[np.float64] = self._start @ self._at(t)
        return T

    def _at(self, t: float) -> NDArray[np.float64]:
        moved = (self._sizes * np.sin(self._omega * t + self._phase)).sum(axis=0)
        T = se3.exp(np.concatenate((np.zeros(3), moved[3:])))
        T[:3, 3] = moved[:3]
        return T


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="names of scenes, joined by commas")
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    measured = tabulate(CLIPS, RULES, given.only)
    if given.docs:
        document(PAGE.parent, measured, page=PAGE, mark=MARK)


def tabulate(
    clips: Sequence[Clip], rules: Mapping[str, tuple[str, ...]], only: str, count: int = FRAMES
) -> str:
    """Render clips, track them by each rule, and print what came out.

    Parameters
    ----------
    clips : sequence of Clip
    rules : mapping of str to tuple of str
        Overrides of the preset `default`, by their names.
    only : str
        Names of the scenes that are wanted, joined by commas; empty for all.
    count : int, optional
        Frames of a clip.

    Returns
    -------
    str
        The table: of errors, mm/s, frames tracked but wrong, and lost.
    """
    exposed = any(clip.exposure for clip in clips)
    rows, scores = [], []
    for clip in clips:
        if only and clip.scene not in only.split(","):
            continue
        recorded = render(clip, count)
        measured = [score(recorded, rule) for rule in rules.values()]
        rolling = f", rows in {1e3 * clip.readout:.0f} ms" if clip.readout else ""
        what = [f"`{clip.scene}`{rolling}", f"{clip.turn:.0f}"]
        what += [f"{1e3 * clip.exposure:.0f}"] * exposed
        rows.append([*what, *map(cell, measured)])
        scores.append(measured)
        print(" | ".join(rows[-1]), flush=True)
    rows.append(["geometric mean, sums", "", *[""] * exposed, *last_row(scores)])
    header = ["rendered", "turned at, deg/s", *["exposed, ms"] * exposed, *rules]
    measured_table = table(header, rows) + "\n"
    print("\nRPE, mm/s; tracked but wrong, lost\n\n" + measured_table)
    return measured_table


def render(clip: Clip, count: int = FRAMES) -> Recorded:
    """Render a clip of so many frames."""
    recipe = make_recipe(clip.scene, frames=count, seed=clip.seed)
    way = RandomWay(recipe.motion.at(0.0), clip.turn, clip.seed)
    steps = INSTANTS if clip.exposure else 1
    shutter = Shutter(exposure=clip.exposure, steps=steps, readout=clip.readout)
    source = SyntheticSource(replace(recipe, motion=way, shutter=shutter))
    readings = read_ahead(source, range(count))
    frames = [reading.frame for reading in readings if reading.frame is not None]
    return Recorded(source.camera, frames, source.ground_truth)


def score(recorded: Recorded, rule: tuple[str, ...]) -> tuple[float, int, int]:
    """Track a clip several times: its error in mm/s, and frames tracked but wrong, and lost."""
    squares, wrong, lost = [], 0, 0
    for start in STARTS:
        frames = recorded.frames[start:]
        times = np.array([frame.timestamp for frame in frames])
        truth = np.array([recorded.truth.at(time) for time in times])
        for seed in SEEDS:
            odometry = Odometry(recorded.camera, Config().with_overrides([f"seed={seed}", *rule]))
            results = [odometry.track(frame) for frame in frames]
            statuses = np.array([result.status for result in results])
            poses = np.array([result.T_world_cam for result in results])
            speed = error_speed(times, truth, poses, statuses != Status.LOST)
            wrong += int(np.count_nonzero((statuses == Status.TRACKED) & (speed > WRONG_M_S)))
            lost += int(np.count_nonzero(statuses == Status.LOST))
            found = evaluate(recorded.truth, odometry.trajectory, len(frames)).rpe
            assert found is not None
            squares.append((1e3 * found.rmse) ** 2)
    return float(np.sqrt(np.mean(squares))), wrong, lost


def last_row(scores: Sequence[Sequence[tuple[float, int, int]]]) -> list[str]:
    """Sum up the scores of clips by each rule: geometric means of errors, and sums."""
    cells = []
    for column in zip(*scores, strict=True):
        errors, wrong, lost = zip(*column, strict=True)
        cells.append(cell((float(np.exp(np.log(errors).mean())), sum(wrong), sum(lost))))
    return cells


def cell(measured: tuple[float, int, int]) -> str:
    """Put a score into a cell."""
    error, wrong, lost = measured
    return f"{error:.{0 if error >= 10 else 1}f}; {wrong}, {lost}"


if __name__ == "__main__":
    main()
