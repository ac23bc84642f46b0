"""Make the stored trajectories and their numbers: ``python tests/evaluation/golden/make.py``.

A seeded random walk stands for the truth, at 60 Hz with a hole, rounded as motion capture files
are; the estimate is the walk with drift and noise in a world of its own, at an uneven 30 Hz with
drops and a hole longer than two seconds. The numbers come from the plain loops of
``tum_script.py``. Run it again only if the protocol changes.
"""

import json
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import tum_script  # noqa: E402


def quaternion(rotation_vector):
    angle = np.linalg.norm(rotation_vector)
    return np.append(np.sin(angle / 2) * rotation_vector / angle, np.cos(angle / 2))


def walk(rng, count, step, turn):
    """Positions and rotation vectors of a smooth walk."""
    kick = rng.normal(size=(count, 6)) * np.repeat([step, turn], 3)
    for row in range(1, count):
        kick[row] += 0.97 * kick[row - 1]
    return np.cumsum(kick, axis=0) + np.repeat([1.0, 0.3], 3)


def statistics(errors):
    errors = np.asarray(errors)
    return {
        "rmse": float(np.sqrt(np.mean(errors**2))),
        "median": float(np.median(errors)),
        "mean": float(np.mean(errors)),
        "max": float(np.max(errors)),
    }


def main():
    rng = np.random.default_rng(20120)
    seconds = 9.0
    fine = np.arange(0.0, seconds, 1 / 240)
    path = walk(rng, len(fine), 0.0004, 0.0004)

    def at(times):
        return np.column_stack([np.interp(times, fine, column) for column in path.T])

    true_times = np.arange(0.0, seconds, 1 / 60) + rng.uniform(-0.002, 0.002, int(seconds * 60))
    true_times = true_times[(true_times < 2.0) | (true_times > 2.4)].clip(0)
    start = 1311868164.0
    rows = ["# timestamp tx ty tz qx qy qz qw"]
    for time, pose in zip(true_times, at(true_times), strict=True):
        values = [*pose[:3], *quaternion(pose[3:])]
        rows.append(f"{start + time:.4f} " + " ".join(f"{value:.4f}" for value in values))
    (HERE / "reference.txt").write_text("\n".join(rows) + "\n")

    times = np.arange(0.02, seconds - 0.1, 1 / 30)
    times = times + rng.uniform(-0.006, 0.006, len(times))
    times = times[rng.uniform(size=len(times)) > 0.08]
    times = times[(times < 4.0) | (times > 6.6)]
    drift = walk(rng, len(times), 0.0002, 0.0001) - np.repeat([1.0, 0.3], 3)
    world = tum_script.matrix([0.5, -1.0, 2.0, *quaternion(np.array([0.3, -0.9, 0.4]))])
    rows = []
    for time, pose, off in zip(times, at(times), drift, strict=True):
        off = off + rng.normal(size=6) * np.repeat([0.001, 0.0007], 3)
        true = tum_script.matrix([*pose[:3], *quaternion(pose[3:])])
        noise = tum_script.matrix([*off[:3], *quaternion(off[3:])])
        T = np.linalg.inv(world) @ true @ noise
        w = np.sqrt(1 + np.trace(T[:3, :3])) / 2
        xyz = np.array([T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]]) / (4 * w)
        values = " ".join(f"{value:.9f}" for value in [*T[:3, 3], *xyz, w])
        rows.append(f"{start + time:.6f} {values}")
    rows[3], rows[4] = rows[4], rows[3].replace(" ", ",")
    (HERE / "estimate.txt").write_text("\n".join(rows) + "\n")

    truth = tum_script.read(HERE / "reference.txt")
    estimate = tum_script.read(HERE / "estimate.txt")
    expected = {}
    for formula in ("script", "sturm"):
        _, translation, rotation = zip(
            *tum_script.evaluate_rpe(truth, estimate, formula=formula), strict=True
        )
        expected[f"rpe_{formula}"] = {
            "pairs": len(translation),
            "translation_m": statistics(translation),
            "rotation_deg": statistics(np.rad2deg(rotation)),
        }
    errors, _, _ = tum_script.evaluate_ate(truth, estimate)
    expected["ate"] = {"poses": len(errors), "translation_m": statistics(errors)}
    (HERE / "expected.json").write_text(json.dumps(expected, indent=2) + "\n")


if __name__ == "__main__":
    main()
