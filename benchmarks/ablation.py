"""The worth of each choice: the preset ``paper`` with one thing changed, over all sequences.

    python -m benchmarks.ablation [--quick]

prints the table of docs/theory. Each figure is the root mean square over ten runs, each of which
starts three frames later and has another seed, so that the luck of where keyframes fall averages
out; in brackets the worst of the ten.
"""

import argparse

import numpy as np

from benchmarks.frames import Recording, recordings
from benchmarks.section import table
from edvo.config import Config
from edvo.evaluation import evaluate
from edvo.odometry import Odometry, Status

ROWS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("preset paper", ()),
    ("edges: Sobel threshold", ("edges.extractor=sobel",)),
    ("edges: difference of Gaussians", ("edges.extractor=dog",)),
    ("edges: Canny 30/60", ("edges.low=30", "edges.high=60")),
    ("edges: Canny 50/100", ("edges.low=50", "edges.high=100")),
    ("edges: no blur", ("edges.blur_px=0",)),
    ("depth: the pixel's own", ("edges.depth_window_px=1",)),
    ("depth: 3 x 3 window", ("edges.depth_window_px=3",)),
    ("depth: 7 x 7 window", ("edges.depth_window_px=7",)),
    ("samples: 250", ("sampling.count=250",)),
    ("samples: 1000", ("sampling.count=1000",)),
    ("samples: 1500", ("sampling.count=1500",)),
    ("samples: cells of 40 px", ("sampling.cell_px=40",)),
    ("samples: cells of 160 px", ("sampling.cell_px=160",)),
    ("samples: at random, no cells", ("sampling.per_cell=0",)),
    ("matching: normal criterion alone", ("matching.criterion=normal",)),
    ("matching: robust criterion alone", ("matching.criterion=robust",)),
    ("matching: switch at 0.25 px", ("matching.switch_px=0.25",)),
    ("matching: switch at 2 px", ("matching.switch_px=2",)),
    ("matching: none beyond 10 px", ("matching.max_distance_px=10",)),
    ("matching: none beyond 60 degrees", ("matching.max_angle_deg=60",)),
    ("residual: distance, Eq. (5)", ("registration.residual=distance",)),
    ("weights: none", ("registration.weight=none",)),
    ("weights: t, nu = 5", ("registration.nu=5",)),
    ("weights: Huber", ("registration.weight=huber",)),
    ("weights: Cauchy", ("registration.weight=cauchy",)),
    ("weights: Tukey", ("registration.weight=tukey",)),
    ("keyframe: every frame", ("keyframes.rule=gap", "keyframes.gap_frames=1")),
    ("keyframe: every 5 frames", ("keyframes.rule=gap", "keyframes.gap_frames=5")),
    ("keyframe: every 10 frames", ("keyframes.rule=gap", "keyframes.gap_frames=10")),
    ("keyframe: every 20 frames", ("keyframes.rule=gap", "keyframes.gap_frames=20")),
    (
        "keyframe: after 0.1 m or 8 degrees",
        ("keyframes.max_translation_m=0.1", "keyframes.max_rotation_deg=8"),
    ),
    ("start: where the camera was", ("motion.prior=still",)),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two runs instead of ten")
    runs = 2 if parser.parse_args().quick else 10
    sequences = recordings(10_000)
    rows = []
    for name, changes in (*ROWS, ("preset default", None)):
        preset = "default" if changes is None else "paper"
        config = Config.preset(preset).with_overrides(changes or ())
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
