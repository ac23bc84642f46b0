"""Cost against the number of edges and against the resolution, with a plot."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.frames import Recording, busiest
from benchmarks.peers import EdgeDetector
from benchmarks.replay import Caught, catch, spread
from benchmarks.section import Section, Settings, ms, table
from benchmarks.speed import Call, interleave
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.experiments.stage_times import seconds
from edvo.matching import Criterion, EdgeIndex
from edvo.odometry import Odometry

COUNTS = (100, 200, 450, 1000, 2000, 5000, 10_000, 20_000)
SIZES = {"QVGA": (320, 240), "VGA": (640, 480), "720p": (1280, 720), "1080p": (1920, 1080)}
PLOT = "cost.png"


@dataclass(frozen=True)
class Point:
    """Median seconds of some parts at one size of the problem."""

    size: float
    parts: dict[str, float]


def measure(settings: Settings) -> Section:
    """Make three tables and a plot of them."""
    recording = busiest(settings.recordings)
    samples = against_samples(recording, settings)
    reference = against_reference(recording, settings)
    sizes = against_resolution(recording, settings)
    pixels = [f"{name}, {w}x{h}" for name, (w, h) in SIZES.items()]
    plot(samples, reference, sizes, settings.out / PLOT)
    return Section(
        "Cost against the number of edges and the resolution",
        "\n\n".join(
            [
                f"Medians in milliseconds, preset `paper` but for what is varied, {recording.name} "
                f"({len(recording.frames)} frames).",
                f"![Milliseconds against samples, reference edges and pixels]({PLOT})",
                "### Samples of the current frame (`sampling.count`)",
                _table("samples", [f"{p.size:.0f}" for p in samples], samples),
                "### Edges of the reference frame",
                "A random part of the keyframe's edges, with the same 450 samples; *search* is one "
                "search of all samples by the robust criterion, at the pose found.",
                _table("reference edges", [f"{p.size:.0f}" for p in reference], reference),
                "### Resolution",
                "The same frames made larger or smaller (`cv2.resize`, depth by nearest neighbour) "
                "with the camera scaled alike; the wide formats are cut out of the middle. What is "
                "enlarged is smoother than a larger sensor's image.",
                _table("size", pixels, sizes),
            ]
        ),
    )


def against_samples(recording: Recording, settings: Settings) -> list[Point]:
    """Track with more and more samples, as many as the frames have edges with depth."""
    points: list[Point] = []
    for count in COUNTS:
        config = Config.preset("paper").with_overrides([f"sampling.count={count}"])
        run = catch(recording, config, settings.choose(8, 60))
        used = float(np.median([len(caught.samples) for caught in run.registrations]))
        parts = {"track": float(np.median(run.track))}
        for stage in ("sampling", "registration"):
            parts[stage] = float(np.median([stages[stage] for stages in run.stages]))
        points.append(Point(used, parts))
        if used < count:
            break
    return points


def against_reference(recording: Recording, settings: Settings) -> list[Point]:
    """Register the same samples with more and more reference edges."""
    config = Config.preset("paper")
    run = catch(recording, config, settings.choose(12, 60))
    chosen: list[Caught] = spread(run.registrations, settings.choose(3, 12))
    rng = np.random.default_rng(0)
    most = min(len(caught.reference) for caught in chosen)
    points = []
    for count in [count for count in COUNTS if count < most] + [most]:
        each = [_with_reference(caught, count, config, rng) for caught in chosen]
        points.append(
            Point(count, {name: float(np.median([p[name] for p in each])) for name in each[0]})
        )
    return points


def _with_reference(
    caught: Caught, count: int, config: Config, rng: np.random.Generator
) -> dict[str, float]:
    every, samples = caught.reference.edges, caught.samples
    camera = caught.camera
    kept = np.sort(rng.permutation(len(every))[:count])
    edges = EdgePixels(every.pixels[kept], every.gradients[kept], every.depths[kept])
    grid, tree = caught.registration.index(edges), EdgeIndex(edges, "tree")
    T_ref_cur = caught.align().T_ref_cur
    warped = samples.points(camera) @ T_ref_cur[:3, :3].T + T_ref_cur[:3, 3]
    ideal = replace(camera, distortion=(0.0,) * 5)
    pixels = ideal.project(warped).astype(np.float32)
    matching = config.matching
    criterion = Criterion(
        matching.gamma, camera.width, matching.max_distance_px, matching.max_angle_deg
    )
    thinned = replace(caught, reference=grid)
    calls: dict[str, Callable[[], object]] = {
        "build tree": lambda: EdgeIndex(edges, "tree"),
        "build grid": lambda: caught.registration.index(edges),
        "search, tree": lambda: tree.match(pixels, samples.gradients, criterion),
        "search, grid": lambda: grid.match(pixels, samples.gradients, criterion),
        "registration": thinned.align,
    }
    return {name: seconds(call, 3) for name, call in calls.items()}


def against_resolution(recording: Recording, settings: Settings) -> list[Point]:
    """Track frames of several sizes, beside the edge detector."""
    points = []
    for width, height in SIZES.values():
        scaled = resized(recording, width, height, settings.choose(6, 40))
        config = Config.preset("paper")

        def make(scaled: Recording = scaled, config: Config = config) -> dict[str, Call]:
            return {
                "edge detector": EdgeDetector(scaled.camera, config.edges).detect,
                "track": Odometry(scaled.camera, config).track,
            }

        times = interleave(scaled.frames, make, settings.choose(1, 3))
        points.append(
            Point(width * height, {name: float(np.median(t)) for name, t in times.items()})
        )
    return points


def resized(recording: Recording, width: int, height: int, count: int) -> Recording:
    """Frames of another size: scaled to the width, then cut to the height about the middle."""
    factor = width / recording.camera.width
    camera = recording.camera.scaled(factor)
    top = (camera.height - height) // 2
    size = (camera.width, camera.height)
    frames = [
        replace(
            frame,
            grey=np.ascontiguousarray(_resize(frame.grey, size, factor)[top : top + height]),
            depth=np.ascontiguousarray(
                cv2.resize(frame.depth, size, interpolation=cv2.INTER_NEAREST)[top : top + height]
            ),
        )
        for frame in recording.frames[:count]
    ]
    camera = replace(camera, height=height, cy=camera.cy - top)
    return replace(recording, camera=camera, frames=tuple(frames))


def _resize(grey: np.ndarray, size: tuple[int, int], factor: float) -> np.ndarray:
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)


def _table(first: str, names: list[str], points: list[Point]) -> str:
    header = [first, *points[0].parts]
    rows = [
        [name, *(ms(value) for value in point.parts.values())]
        for name, point in zip(names, points, strict=True)
    ]
    return table(header, rows)


def plot(samples: list[Point], reference: list[Point], sizes: list[Point], path: Path) -> None:
    """Draw the three tables beside each other, on logarithmic scales."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    axes: list[Axes] = list(figure.subplots(1, 3))
    draw(axes[0], samples, "samples of the current frame")
    draw(axes[1], reference, "edges of the reference frame")
    draw(axes[2], sizes, "pixels")
    axes[2].set_xticks([p.size for p in sizes], list(SIZES))
    axes[2].minorticks_off()
    axes[0].set_ylabel("milliseconds")
    figure.savefig(path, dpi=100)


def draw(axes: Axes, points: list[Point], label: str) -> None:
    """Draw a table."""
    for name in points[0].parts:
        values = [1e3 * point.parts[name] for point in points]
        axes.plot([point.size for point in points], values, marker="o", markersize=3, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
