"""Pictures of light that changes: brightness, error against severity, origin of an error."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.light_runs import SYSTEMS, Clip, Look, Result, median_of
from edvo.evaluation import RelativePoseError
from edvo.odometry import Status
from edvo.report.plots import edge_picture
from edvo.synthesis.photometry import decode
from edvo.synthesis.relight_models import LIGHT_MODELS, Settings, ambient_gain
from edvo.synthesis.relighting import Relighter
from edvo.synthesis.surface import estimate_surface

COLOURS = dict(zip(SYSTEMS, ("#d1495b", "#edae49", "#00798c", "#30638e"), strict=True))
WIDEST = 40.0  # px, of what is drawn as a line from sample to match


def draw_brightness(path: Path, clip: Clip, severity: float, seed: int) -> float:
    """Draw the mean linear light of relit images over that of the images as they were.

    Beside it stands what the model says: the gain of ``ambient``, and with ``diffuse`` the mean of
    light times gain over the pixels, both before the image saturates and is rounded.

    Returns
    -------
    float
        Root mean square difference between image and model for ``ambient``, in stops.
    """
    times = np.array([frame.timestamp for frame in clip.frames]) - clip.frames[0].timestamp
    settings = Settings(severity, 2.0, seed)
    size = clip.frames[0].grey.shape
    measured: dict[str, list[float]] = {"ambient": [], "ambient+diffuse": []}
    model: dict[str, list[float]] = {"ambient": [], "ambient+diffuse": []}
    relighters = {name: Relighter(name, severity=severity, seed=seed) for name in measured}
    for index, (frame, t) in enumerate(zip(clip.frames, times.tolist(), strict=True)):
        light = decode(frame.grey)
        for name, relighter in relighters.items():
            relit = decode(clip.lit(relighter, index).grey)
            measured[name].append(float(relit.mean() / light.mean()))
        surface = estimate_surface(frame.depth, clip.camera)
        lamp = LIGHT_MODELS["diffuse"].effect(settings, t, (size[0], size[1]), surface).gain
        gain = ambient_gain(settings, t)
        model["ambient"].append(gain)
        model["ambient+diffuse"].append(gain * float((light * lamp).mean() / light.mean()))
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    axes: list[Axes] = list(figure.subplots(2, 1, sharex=True))
    for axis, name in zip(axes, measured, strict=True):
        axis.plot(times, model[name], color="0.3", lw=1.2, label="model")
        axis.plot(times, measured[name], ".", color=COLOURS["edvo default"], ms=4, label="images")
        axis.set_ylabel("mean light, relit / unlit")
        axis.set_title(f"{name}, 2 Hz, severity {severity:g}", fontsize="medium")
        axis.grid(alpha=0.3)
        axis.set_ylim(bottom=0)
    axes[0].legend(fontsize="small")
    axes[1].set_xlabel(f"seconds of {clip.name}")
    figure.savefig(path, dpi=80)
    off = np.log2(measured["ambient"]) - np.log2(model["ambient"])
    return float(np.sqrt(np.mean(off**2)))


def draw_curve(path: Path, curves: dict[str, Sequence[Result]]) -> None:
    """Draw the error against the severity, a part for each sequence."""
    figure = Figure(figsize=(5 * len(curves), 4.4), layout="constrained")
    axes: list[Axes] = list(np.atleast_1d(np.asarray(figure.subplots(1, len(curves)))))
    for axis, (name, results) in zip(axes, curves.items(), strict=True):
        for system in SYSTEMS:
            own = [result for result in results if result.system == system]
            severities = sorted({result.severity for result in own})
            chosen = [median_of([r for r in own if r.severity == s]) for s in severities]
            rpe = [result.rpe if np.isfinite(result.rpe) else np.nan for result in chosen]
            axis.plot(severities, rpe, marker="o", ms=4, color=COLOURS[system], label=system)
            for result, value in zip(chosen, rpe, strict=True):
                if result.coverage < 0.995:
                    axis.annotate(
                        f"{result.coverage:.0%}", (result.severity, value), fontsize="x-small"
                    )
        axis.set_yscale("log")
        axis.set_title(name)
        axis.set_xlabel("severity of the light (ambient+diffuse, 2 Hz)")
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("RPE over 1 s, rmse (m/s)")
    lines, names = axes[0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower center", ncols=3, fontsize="small")
    figure.savefig(path, dpi=80)


def draw_miss(
    path: Path, clip: Clip, rpe: RelativePoseError, looks: Sequence[Look], title: str
) -> str:
    """Draw the first frame that is lost, else that with the largest error in the worst second.

    Parameters
    ----------
    path : pathlib.Path
        PNG.
    clip : Clip
    rpe : RelativePoseError
        Of this very run.
    looks : sequence of Look
        Its registrations.
    title : str

    Returns
    -------
    str
        A sentence for the page.
    """
    begin = clip.frames[0].timestamp
    worst = int(np.argmax(rpe.translation))
    start = float(rpe.stamps[worst])
    end = start + rpe.delta + 0.02  # the pair's second pose is the nearest, not later than that
    within = [look for look in looks if start <= look.frame.timestamp <= end]
    lost = [look for look in looks if look.tracked.status is Status.LOST]
    look = lost[0] if lost else max(within or looks, key=lambda x: float(np.linalg.norm(x.error)))
    alignment = look.tracked.alignment
    assert alignment is not None
    figure = Figure(figsize=(13, 7.2), layout="constrained")
    figure.suptitle(title, fontweight="bold")
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 1.3))
    edges = look.samples
    _draw_edges(figure.add_subplot(grid[0, 0]), look)
    _draw_matches(figure.add_subplot(grid[0, 1]), clip, look)
    axis = figure.add_subplot(grid[1, 0])
    axis.plot(rpe.stamps - begin, 1e3 * rpe.translation, color="#00798c", label="RPE over 1 s")
    axis.axvspan(start - begin, start - begin + rpe.delta, color="0.9", label="worst second")
    axis.set(xlabel="seconds", ylabel="mm")
    axis.legend(fontsize="small")
    axis = figure.add_subplot(grid[1, 1])
    times = [each.frame.timestamp - begin for each in looks]
    axis.plot(
        times,
        [1e3 * float(np.linalg.norm(each.error)) for each in looks],
        color="#d1495b",
        label="error since the keyframe (mm)",
    )
    light = [float(each.frame.grey.mean()) / 10 for each in looks]
    axis.plot(times, light, color="#edae49", lw=1, label="mean grey / 10")
    axis.axvline(look.frame.timestamp - begin, color="0.3", lw=0.8)
    axis.set_xlabel("seconds")
    axis.legend(fontsize="small")
    figure.savefig(path, dpi=64)
    x, y, z = (1e3 * look.error).tolist()
    direction, spread = weakest(alignment.H, alignment.sigma_px)
    reasons = Counter(
        re.sub(r"only \d+%", "too few", each.tracked.reason.split(":")[0]) for each in lost
    )
    said = "".join(f"{count} frames lost ({reason}); " for reason, count in reasons.items())
    return (
        f"{said}worst second from {start - begin:.2f} s ({1e3 * rpe.translation[worst]:.0f} mm); "
        f"frame {look.tracked.index} is off its keyframe {look.tracked.keyframe} by "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm, with {alignment.match_count} matches of {len(edges)} "
        f"samples, {alignment.inliers} inliers, sigma {alignment.sigma_px:.2f} px; the edges hold "
        f"it least along ({direction[0]:.2f}, {direction[1]:.2f}, {direction[2]:.2f}): "
        f"{1e3 * spread:.1f} mm by their own scatter"
    )


def weakest(H: NDArray[np.float64], sigma_px: float) -> tuple[NDArray[np.float64], float]:
    """Give the direction in which the position is held least, and its standard deviation, m."""
    covariance = sigma_px**2 * np.linalg.pinv(H)[:3, :3]
    values, vectors = np.linalg.eigh(covariance)
    return vectors[:, -1], float(np.sqrt(max(values[-1], 0.0)))


def _draw_edges(axis: Axes, look: Look) -> None:
    samples = look.samples
    axis.imshow(edge_picture(look.frame.grey, samples.pixels, samples.gradients))
    axis.set_axis_off()
    axis.set_title(f"frame {look.tracked.index}: {len(samples)} samples by gradient direction")


def _draw_matches(axis: Axes, clip: Clip, look: Look) -> None:
    """Draw the samples where the pose found puts them, and what each was matched to."""
    alignment = look.tracked.alignment
    assert alignment is not None
    camera, T = clip.camera, alignment.T_ref_cur
    points = look.samples.points(camera) @ T[:3, :3].T + T[:3, 3]
    warped = points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    matched = alignment.matches >= 0
    partner = alignment.references[matched]
    axis.plot(*look.reference.pixels.T, ",", color="0.75")
    own = warped[matched]
    near = np.linalg.norm(own - partner, axis=1) < WIDEST
    both = np.stack([own, partner, np.full_like(own, np.nan)], axis=1)[near].reshape(-1, 2)
    axis.plot(*both.T, color="#d1495b", lw=0.6)
    shown = axis.scatter(
        *own.T, c=np.abs(alignment.residuals[matched]), s=5, cmap="viridis", vmin=0, vmax=3
    )
    axis.figure.colorbar(shown, ax=axis, label="residual (px)", shrink=0.8)
    axis.set_xlim(0, camera.width)
    axis.set_ylim(camera.height, 0)
    axis.set_aspect("equal")
    axis.set_title(f"matches with keyframe {look.tracked.keyframe}; its edges in grey")
