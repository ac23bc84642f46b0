"""Accuracy on the sequences at hand: both presets over five seeds, and OpenCV on the same frames.

    python -m benchmarks.accuracy

prints the table of the README. Relative pose error over one second by the TUM script.
"""

import argparse
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from benchmarks.frames import Recording, recordings
from benchmarks.section import ms, table
from edvo.baselines.opencv import opencv_odometry
from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule, PairwiseOdometry
from edvo.config import Config
from edvo.evaluation import Evaluation, evaluate
from edvo.frame import Frame
from edvo.odometry import Odometry, TrackedFrame
from edvo.trajectory import Trajectory

SEEDS = range(5)
HEADER = ["", "RPE m/s", "worst seed", "median", "deg/s", "ATE m", "coverage", "ms a frame"]


def main() -> None:
    """Print a table for each sequence, and the one of the README."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    cv2.setNumThreads(1)
    sequences = recordings(10_000)
    short: dict[str, list[str]] = {}
    for sequence in sequences:
        print(f"\n**{sequence.name}**, {len(sequence.frames)} frames, {sequence.origin}\n")
        rows = list(rows_of(sequence))
        print(table(HEADER, rows), flush=True)
        for cells in rows:
            time_taken = f", {cells[-1]} ms" if cells[-1] else ""
            short.setdefault(cells[0], []).append(cells[1] + time_taken)
    print(
        "\n" + table(["RPE m/s", *(s.name for s in sequences)], [[k, *v] for k, v in short.items()])
    )


def rows_of(sequence: Recording) -> Iterator[list[str]]:
    """Give a row for each system."""
    for preset in ("paper", "default"):
        config = Config.preset(preset)
        Odometry(sequence.camera, config).track(sequence.frames[0])  # compiled before timed
        runs = [
            follow(sequence, edvo(sequence, config.with_overrides([f"seed={seed}"])))
            for seed in SEEDS
        ]
        yield row(f"edvo, preset {preset}", runs)
    for kind, name in (("rgbd", "OpenCV RGB-D"), ("rgb", "OpenCV RGB")):
        for rule, reference in ((KeyframeRule(), "to keyframe"), (FRAME_TO_FRAME, "to last frame")):
            peer = opencv_odometry(sequence.camera, kind, keyframes=rule)
            yield row(f"{name} {reference}", [follow(sequence, (peer.track, peer))])
    still = follow(sequence, edvo(sequence, Config.preset("paper")))[0].rpe_zero_motion
    if still is not None:
        yield ["no motion at all", f"{still.rmse:.4f}", *[""] * 6]


Follower = tuple[Callable[[Frame], TrackedFrame], Odometry | PairwiseOdometry]
Outcome = tuple[Evaluation, float]


def edvo(sequence: Recording, config: Config) -> Follower:
    """Make a tracker."""
    odometry = Odometry(sequence.camera, config)
    return odometry.track, odometry


def follow(sequence: Recording, follower: Follower) -> Outcome:
    """Track a sequence; its errors, and the median time of a frame in seconds."""
    track, tracker = follower
    times = []
    for frame in sequence.frames:
        start = time.perf_counter()
        track(frame)
        times.append(time.perf_counter() - start)
    truth = sequence.source.ground_truth
    assert isinstance(truth, Trajectory), f"{sequence.name} has no ground truth"
    return evaluate(truth, tracker.trajectory, len(sequence.frames)), float(np.median(times))


def row(name: str, runs: list[Outcome]) -> list[str]:
    """Put runs with several seeds into a row: the median of each figure."""
    rpe = [result.rpe for result, _ in runs if result.rpe is not None]
    ate = [result.ate.rmse for result, _ in runs if result.ate is not None]
    if not rpe:
        return [name, "x", *[""] * 6]
    return [
        name,
        f"{np.median([error.rmse for error in rpe]):.4f}",
        f"{max(error.rmse for error in rpe):.4f}" if len(runs) > 1 else "",
        f"{np.median([error.median for error in rpe]):.4f}",
        f"{np.median([np.degrees(error.rotation_rmse) for error in rpe]):.3f}",
        f"{np.median(ate):.4f}" if ate else "",
        f"{min(result.coverage or 0 for result, _ in runs):.0%}",
        ms(float(np.median([seconds for _, seconds in runs]))),
    ]


if __name__ == "__main__":
    main()
