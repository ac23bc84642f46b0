"""Lost and found: the lens is covered for two seconds and uncovered where the camera was before.

    python -m benchmarks.recovery [--trials 7]

prints a row for each rendered scene: how many trials found back within a second to 2 cm, how long
it took, and frames that were tracked more than 5 cm from where the camera was.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.section import table
from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets.readahead import read_ahead
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

SCENES = (
    "notexture_far",
    "notexture_near",
    "cabinet",
    "corridor",
    "stairs",
    "texture_far",
    "texture_near",
    "office",
)
FRAMES, PERIOD, COVERED_S, SECOND = 120, 1 / 30, 2.0, 30


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=7, help="for each scene")
    trials = parser.parse_args().trials
    cv2.setNumThreads(1)
    rng = np.random.default_rng(0)
    rows, found_all = [], 0
    for scene in SCENES:
        source = SyntheticSource(make_recipe(scene, frames=FRAMES, seed=3))
        readings = read_ahead(source, range(FRAMES))
        frames = [reading.frame for reading in readings if reading.frame is not None]
        assert len(frames) == FRAMES
        truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
        outcomes = [trial(source.camera, frames, truth, rng) for _ in range(trials)]
        found = [frames_taken for frames_taken, _ in outcomes if frames_taken is not None]
        found_all += len(found)
        taken = f"{np.median(found) * PERIOD:.2f} s" if found else "-"
        wrong = sum(wrong for _, wrong in outcomes)
        rows.append([scene, f"{len(found)} of {trials}", taken, str(wrong)])
        print(" | ".join(rows[-1]), flush=True)
    header = ["scene", "found to 2 cm within 1 s", "median time", "frames tracked > 5 cm off"]
    print("\n" + table(header, rows))
    print(f"\n{found_all} of {trials * len(SCENES)} trials.")


def trial(
    camera: Camera,
    frames: Sequence[Frame],
    truth: Sequence[NDArray[np.float64]],
    rng: np.random.Generator,
) -> tuple[int | None, int]:
    """Walk, cover, go on from an earlier frame: frames until found, and frames tracked wrongly."""
    walked = int(rng.integers(50, 80))
    back = int(rng.integers(0, walked - SECOND - 2))
    odometry = Odometry(camera, Config())
    for frame in frames[:walked]:
        odometry.track(frame)
    t = frames[walked - 1].timestamp
    for _ in range(5):
        t += COVERED_S / 5
        odometry.track(replace(frames[0], timestamp=t, grey=np.full_like(frames[0].grey, 6)))
    found, wrong = None, 0
    for k in range(SECOND):
        t += PERIOD
        frame = frames[back + k]
        result = odometry.track(replace(frame, timestamp=t))
        if result.status is Status.LOST:
            continue
        T_true = se3.inverse(truth[0]) @ truth[back + k]
        off = float(np.linalg.norm((se3.inverse(T_true) @ result.T_world_cam)[:3, 3]))
        wrong += off > 0.05
        if found is None and off < 0.02:
            found = k + 1
    return found, wrong


if __name__ == "__main__":
    main()
