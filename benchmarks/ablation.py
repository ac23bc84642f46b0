"""The worth of each choice: a preset with one thing changed, over all sequences.

    python -m benchmarks.ablation [--preset default] [--quick]

prints the table of docs/theory, which is of the preset ``paper``. Each figure is the root mean
square over ten runs, each of which starts three frames later and has another seed, so that the luck
of where keyframes fall averages out; in brackets the worst of the ten.
"""

import argparse

import numpy as np

from benchmarks.frames import Recording, recordings
from benchmarks.section import table
from edvo.config import PRESETS, Config
from edvo.evaluation import evaluate
from edvo.experiments.variants import variants_of
from edvo.odometry import Odometry, Status


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two runs instead of ten")
    parser.add_argument("--preset", choices=PRESETS, default="paper", help="what is changed")
    given = parser.parse_args()
    runs = 2 if given.quick else 10
    sequences = recordings(10_000)
    rows = []
    configs = {
        f"preset {given.preset}": Config.preset(given.preset),
        **variants_of(given.preset),
        **{f"preset {name}": Config.preset(name) for name in PRESETS if name != given.preset},
    }
    for name, config in configs.items():
        rows.append([name, *(score(sequence, config, runs) for sequence in sequences)])
        print(" | ".join(rows[-1]), flush=True)
    print("\n" + table(["", *(sequence.name for sequence in sequences)], rows))


def score(recording: Recording, config: Config, runs: int) -> str:
    """Track from several frames on, and put the errors into a cell."""
    truth = recording.source.ground_truth
    assert truth is not None, f"{recording.name} has no ground truth"
    errors, lost = [], 0
    for run in range(runs):
        odometry = Odometry(recording.camera, config.with_overrides([f"seed={run}"]))
        tracked = [odometry.track(frame) for frame in recording.frames[3 * run :]]
        lost += sum(frame.status is Status.LOST for frame in tracked)
        result = evaluate(truth, odometry.trajectory).rpe
        errors.append(float("nan") if result is None else result.rmse)
    cell = f"{np.sqrt(np.mean(np.square(errors))):.4f} ({np.max(errors):.4f})"
    return cell + (f", {lost} lost" if lost else "")


if __name__ == "__main__":
    main()
