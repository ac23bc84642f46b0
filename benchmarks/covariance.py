"""Whether the covariance of T_key_cur tells the truth: frame-keyframe pairs with known motion.

    python -m benchmarks.covariance [--pairs 720] [--fit]

renders independent pairs (scene, path, light, depth sensor, noise and distance are drawn anew for
each), registers each from a guess nearby, and prints which share of the errors e lies within the
regions e^T C^-1 e < chi^2_6(q). A second table is of pairs by a rolling shutter whose depth comes
late, a third of the real sequences at hand. ``--fit`` first fits the shares of the sources of
error to as many other pairs, and says what that gives on a scene that the fit has not seen.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2

from benchmarks.frames import DATA, REAL
from benchmarks.section import table
from edvo import se3
from edvo.config import Config
from edvo.datasets import open_source
from edvo.datasets.readahead import read_ahead
from edvo.odometry import Odometry, Status
from edvo.synthesis.clock import Clock
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.uncertainty import SHARES, Parts, Shares, Uncertainty, combine, without_blur

SCENES = (
    "texture_far",
    "texture_near",
    "notexture_far",
    "notexture_near",
    "cabinet",
    "office",
    "corridor",
    "stairs",
    "white_wall",
)
LIGHTS = ("constant", "ambient+diffuse")
NEW_LIGHT = "exposure"  # that the fit has not seen
SENSORS = ("kinect_v1", "kinect_v1", "realsense_d435", "azure_kinect")
FIT, CHECK, TIMING = 1, 2, 3  # families of pairs, each with its own random numbers
FRAMES, LAST_KEY = 1800, 1500
FARTHEST_M, FARTHEST_RAD = 0.30, np.radians(15.0)  # where the tracker takes a new keyframe
GUESS = np.array([0.005] * 3 + [np.radians(0.3)] * 3)  # how far the start is off
READOUT_S, DELAY_S = 0.03, 0.01  # a rolling shutter, and depth that is late
LEVELS = (0.5, 0.68, 0.9, 0.95, 0.99)
BOUNDS = chi2.ppf(LEVELS, 6)
TAIL = 6.0  # degrees of freedom of the t-distribution that is fitted: errors have heavy tails
TRUTH_M, TRUTH_RAD = 1.2e-4, np.radians(0.05)  # noise of a pose by motion capture, an axis
OFFSETS_S = np.arange(-0.03, 0.031, 0.0025)
UNIT = 1e3  # mm and mrad condition the fit


@dataclass(frozen=True)
class Outcome:
    """A pair, registered.

    Parameters
    ----------
    scene, light, sensor : str
    status : Status
    degenerate : bool
    error : ndarray, shape (6,)
        log(T_true T_key_cur^-1), metres and radians.
    covariance : ndarray, shape (6, 6)
    known, parts, sigma_px
        What it was made of.
    H : ndarray, shape (6, 6)
        J^T W J, whose inverse would take errors for independent.
    """

    scene: str
    light: str
    sensor: str
    status: Status
    degenerate: bool
    error: NDArray[np.float64]
    covariance: NDArray[np.float64]
    known: NDArray[np.float64]
    parts: NDArray[np.float64]
    sigma_px: float
    H: NDArray[np.float64]

    def square(self, covariance: NDArray[np.float64]) -> float:
        """Give e^T C^-1 e."""
        return float(self.error @ np.linalg.solve(covariance, self.error))


class _Recorder(Uncertainty):
    """Keeps what the last covariance was made of."""

    def parts(self, *given: Any, **named: Any) -> Parts:
        found = super().parts(*given, **named)
        self.last = without_blur(found.curvature, found.blur), found.parts
        return found


def pair(family: int, number: int) -> Outcome | None:
    """Render and register a pair; None where it is lost or has no images."""
    rng = np.random.default_rng([family, number])
    scene = SCENES[number % len(SCENES)]
    light = LIGHTS[int(rng.integers(2))]
    if family == CHECK and light != "constant" and rng.random() < 0.5:
        light = NEW_LIGHT
    sensor = SENSORS[int(rng.integers(4))]
    timing = {}
    if family == TIMING:
        timing = {"shutter": Shutter(readout=READOUT_S), "depth_clock": Clock(offset=DELAY_S)}
    seed = int(rng.integers(1 << 30))
    recipe = make_recipe(scene, frames=FRAMES, sensor=sensor, light=light, seed=seed, **timing)
    source = SyntheticSource(recipe)
    pose, times = recipe.motion.at, recipe.colour_times.tolist()
    key, reach = int(rng.integers(LAST_KEY)), rng.uniform(0.02, 1.0)
    T_key_world = se3.inverse(pose(times[key]))
    for index in range(key + 1, FRAMES):
        T_true = T_key_world @ pose(times[index])
        turned = se3.rotation_angle(T_true)
        if np.linalg.norm(T_true[:3, 3]) > reach * FARTHEST_M or turned > reach * FARTHEST_RAD:
            break
    frames = [source.read(i).frame for i in (key, index)]
    if frames[0] is None or frames[1] is None:
        return None
    config = Config(seed=number).with_overrides(["planes.alone_share=0"])  # of edges, or none
    odometry = Odometry(source.camera, config)
    recorder = _Recorder(source.camera, config, odometry._registration.solver)
    odometry._progress._uncertainty = recorder
    course = odometry._course
    if odometry.track(frames[0]).status is Status.LOST:
        return None
    course.T_key_last = se3.exp(rng.standard_normal(6) * GUESS) @ T_true
    course.T_world_last = course.key.T_world_key @ course.T_key_last
    course.last_time = times[index] - 1 / 30
    found = odometry.track(frames[1])
    if found.status is Status.LOST or found.covariance is None or found.alignment is None:
        return None
    return Outcome(
        scene,
        light,
        sensor,
        found.status,
        bool(found.degenerate),
        se3.log(T_true @ se3.inverse(found.T_key_cur)),
        found.covariance,
        *recorder.last,
        found.alignment.sigma_px,
        found.alignment.H,
    )


def pairs(family: int, count: int) -> tuple[list[Outcome], int]:
    """Render and register pairs on two cores: those with a covariance, and how many were lost."""
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda number: pair(family, number), range(count)))
    kept = [outcome for outcome in found if outcome is not None]
    return kept, count - len(kept)


def fit(outcomes: Sequence[Outcome]) -> Shares:
    """Fit what each source of error counts, the likeliest for a t-distribution.

    All shares then take a common factor, so that the 90 % regions hold 90 %.
    """
    errors = UNIT * np.array([o.error for o in outcomes])
    known = np.array([o.known for o in outcomes])
    parts = np.array([o.parts for o in outcomes])
    sigmas = np.array([o.sigma_px for o in outcomes])

    def squares(shares: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        C = UNIT**2 * combine(known, parts, sigmas, Shares(*shares))
        solved = np.linalg.solve(C, errors[:, :, None])[:, :, 0]
        return np.einsum("ni,ni->n", errors, solved), np.linalg.slogdet(C)[1]

    def loss(logarithms: NDArray[np.float64]) -> float:
        square, volume = squares(np.exp(logarithms))
        return float(np.mean(0.5 * volume + 0.5 * (TAIL + 6) * np.log1p(square / TAIL)))

    start = np.log(np.array(SHARES))
    best = minimize(loss, start, method="L-BFGS-B", bounds=[(-9.0, 5.0)] * len(start))
    shares = np.exp(best.x)
    square, _ = squares(shares)
    return Shares(*(shares * np.quantile(square, 0.9) / BOUNDS[2]).tolist())


def leave_one_out(outcomes: Sequence[Outcome]) -> NDArray[np.float64]:
    """Give e^T C^-1 e of each pair by shares that were fitted without its scene."""
    result = np.empty(len(outcomes))
    for scene in SCENES:
        shares = fit([outcome for outcome in outcomes if outcome.scene != scene])
        for i, o in enumerate(outcomes):
            if o.scene == scene:
                result[i] = o.square(combine(o.known, o.parts, o.sigma_px, shares))
    return result


def held(name: str, squares: NDArray[np.float64]) -> list[str]:
    """Write a row: which share of the errors lies in each region."""
    if not len(squares):
        return [name, "0", *[""] * len(LEVELS)]
    return [name, str(len(squares)), *(f"{np.mean(squares < bound):.1%}" for bound in BOUNDS)]


HEADER = ["", "pairs", *(f"{level:.0%} region" for level in LEVELS)]


def groups(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Give e^T C^-1 e of pairs that have something in common."""
    squares = np.array([outcome.square(outcome.covariance) for outcome in outcomes])
    naive = [o.square(o.sigma_px**2 * np.linalg.inv(o.H)) for o in outcomes]
    yield "**all**", squares
    yield "all, by sigma^2 H^-1", np.array(naive)
    for name in (*SCENES, *LIGHTS, NEW_LIGHT, *sorted(set(SENSORS))):
        own = [name in (o.scene, o.light, o.sensor) for o in outcomes]
        if any(own):
            yield name, squares[own]


def by_axis(outcomes: Sequence[Outcome]) -> str:
    """Write a table of the size of errors, axis by axis, beside what was said of them."""
    errors = np.array([o.error for o in outcomes])
    sigmas = np.array([np.sqrt(np.diag(o.covariance)) for o in outcomes])
    rows = []
    for i, axis in enumerate(("x", "y", "z", "about x", "about y", "about z")):
        unit, size = ("mm", 1e3) if i < 3 else ("deg", np.degrees(1.0))
        error, sigma = size * np.abs(errors[:, i]), size * sigmas[:, i]
        figures = (np.median(error), np.percentile(error, 90), np.median(sigma))
        inside = np.mean(error < 1.645 * sigma)
        rows.append([f"{axis}, {unit}", *(f"{value:.3f}" for value in figures), f"{inside:.1%}"])
    return table(["axis", "median error", "90 % error", "median sigma", "in 90 % interval"], rows)


def report(outcomes: Sequence[Outcome], lost: int) -> str:
    """Write the tables of rendered pairs."""
    judged = [o for o in outcomes if o.status is Status.TRACKED]
    doubtful = [o for o in outcomes if o.status is not Status.TRACKED]
    rows = [held(name, squares) for name, squares in groups(judged)]
    if doubtful:
        squares = np.array([o.square(o.covariance) for o in doubtful])
        rows.append(held("called degraded", squares))
    loose = sum(o.degenerate for o in outcomes)
    said = f"{lost} pairs lost, {len(doubtful)} degraded, {loose} of these not constrained."
    return "\n\n".join((table(HEADER, rows), said, by_axis(judged)))


def real(name: str) -> list[str]:
    """Track a real sequence: errors against its truth, with its noise and clock taken into account.

    The clock offset is the one that makes the median of e^T C^-1 e smallest.
    """
    source = open_source(DATA / name)
    truth = source.ground_truth
    assert truth is not None
    odometry, stamps, found = Odometry(source.camera), [], []
    with closing(read_ahead(source, range(len(source)))) as readings:
        for reading in readings:
            stamps.append(reading.timestamp)
            if reading.frame is None:
                odometry.skip(reading.timestamp, "")
                continue
            result = odometry.track(reading.frame)
            if result.status is Status.TRACKED and result.covariance is not None:
                found.append((stamps[result.keyframe], reading.timestamp, result))
    first, last = truth.timestamps[[0, -1]]
    noise = 2 * np.diag(np.array([TRUTH_M] * 3 + [TRUTH_RAD] * 3) ** 2)

    def errors(offset: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rows = []
        for t_key, t_cur, result in found:
            if first <= t_key + offset and t_cur + offset <= last:
                T = se3.inverse(truth.at(t_key + offset)) @ truth.at(t_cur + offset)
                rows.append((se3.log(T @ se3.inverse(result.T_key_cur)), result.covariance))
        return np.array([e for e, _ in rows]), np.array([C for _, C in rows])

    def squares(error: NDArray[np.float64], C: NDArray[np.float64]) -> NDArray[np.float64]:
        values: NDArray[np.float64] = np.einsum(
            "ni,ni->n", error, np.linalg.solve(C, error[:, :, None])[:, :, 0]
        )
        return values

    as_is, covariances = errors(0.0)
    tried = {}
    for offset in OFFSETS_S.tolist():
        moved, own = errors(offset)
        if len(moved) > 0.8 * len(as_is):
            tried[offset] = moved, squares(moved, own + noise)
    best = min(tried, key=lambda offset: float(np.median(tried[offset][1])))
    shifted, then = tried[best]
    sigma = np.sqrt(np.median(np.diagonal(covariances, 0, 1, 2), axis=0))
    rms = np.sqrt(np.mean(shifted**2, axis=0))

    def size(values: NDArray[np.float64]) -> str:
        v, w = 1e3 * np.linalg.norm(values[:3]), np.degrees(np.linalg.norm(values[3:]))
        return f"{v:.1f} mm, {w:.2f} deg"

    def cells(values: NDArray[np.float64]) -> list[str]:
        return [f"{np.median(values):.1f}", f"{np.mean(values < BOUNDS[2]):.0%}"]

    return [
        name,
        str(len(as_is)),
        size(sigma),
        size(rms),
        *cells(squares(as_is, covariances)),
        *cells(squares(as_is, covariances + noise)),
        f"{1e3 * best:+.1f} ms",
        *cells(then),
    ]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=720, help="that are checked")
    parser.add_argument("--fit", action="store_true", help="fit the shares first")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.fit:
        outcomes, _ = pairs(FIT, arguments.pairs)
        judged = [o for o in outcomes if o.status is Status.TRACKED]
        shares = fit(judged)
        print("SHARES =", Shares(*(round(share, 4) for share in shares)))
        squares = leave_one_out(judged)
        rows = [held("all", squares)]
        for scene in SCENES:
            own = [o.scene == scene for o in judged]
            rows.append(held(scene, squares[own]))
        print("\nBy shares fitted without the scene:\n\n" + table(HEADER, rows), flush=True)
    print("\nOther pairs, by the shares in edvo.uncertainty:\n", flush=True)
    print(report(*pairs(CHECK, arguments.pairs)), flush=True)
    print(f"\nRolling shutter of {1e3 * READOUT_S:g} ms, depth {1e3 * DELAY_S:g} ms late:\n")
    outcomes, _ = pairs(TIMING, arguments.pairs // 6)
    judged = [o for o in outcomes if o.status is Status.TRACKED]
    rows = [held("all", np.array([o.square(o.covariance) for o in judged]))]
    print(table(HEADER, rows), flush=True)
    if DATA.is_dir():
        header = ["sequence", "frames", "median sigma", "rms error", "NEES", "in 90 %"]
        header += ["NEES with truth's noise", "in 90 %", "clock offset", "NEES then", "in 90 %"]
        print("\n" + table(header, [real(name) for name in REAL]))


if __name__ == "__main__":
    main()
