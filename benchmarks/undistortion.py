"""Undistort whole images by precomputed maps, or the edge pixels alone by a table: what each costs.

Run it with ``python benchmarks/undistortion.py``; it prints a Markdown table. VGA, one OpenCV
thread, the strongly distorted lens of TUM's fr1. Rounds are interleaved, so that whatever else
the machine does hits all candidates alike.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera

CAMERA = Camera(
    width=640,
    height=480,
    fx=517.306,
    fy=516.469,
    cx=318.643,
    cy=255.314,
    distortion=(0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
)
ROUNDS = 300
WARM_UP = 20


def measure(candidates: dict[str, Callable[[], object]]) -> dict[str, NDArray[np.float64]]:
    """Time each candidate once a round; milliseconds."""
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(WARM_UP + ROUNDS):
        for name, run in candidates.items():
            start = time.perf_counter()
            run()
            times[name].append(1e3 * (time.perf_counter() - start))
    return {name: np.array(values[WARM_UP:]) for name, values in times.items()}


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, (CAMERA.height, CAMERA.width), dtype=np.uint8)
    depth = rng.uniform(0.5, 5.0, grey.shape).astype(np.float32)
    table = CAMERA.undistortion_table().reshape(-1, 2)
    candidates: dict[str, Callable[[], object]] = {
        "images: remap grey, bilinear": lambda: CAMERA.undistort_image(grey),
        "images: remap depth, nearest": lambda: CAMERA.undistort_depth(depth),
    }
    for count in (5_000, 20_000):
        # Row by row, as edges are collected from an image.
        index = np.sort(rng.choice(grey.size, count, replace=False))
        candidates[f"pixels: look up {count:,} edges"] = lambda index=index: table.take(
            index, axis=0
        )
    times = measure(candidates)
    images = [values for name, values in times.items() if name.startswith("images")]
    times["images: both"] = np.sum(images, axis=0)

    print(
        f"| undistortion, VGA, median of {ROUNDS} interleaved rounds | ms | 90th percentile, ms |"
    )
    print("|---|---|---|")
    for name in sorted(times):
        print(f"| {name} | {np.median(times[name]):.3f} | {np.percentile(times[name], 90):.3f} |")


if __name__ == "__main__":
    main()
