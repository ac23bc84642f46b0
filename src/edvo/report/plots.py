"""Pictures of a result: the path from above, the error over time, the edges.

Drawn off-screen; no figure outlives its call.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from edvo import se3
from edvo.errors import OutputError
from edvo.evaluation import Evaluation
from edvo.files import write_atomically
from edvo.trajectory import Trajectory

TRUTH_COLOUR = "0.15"
ESTIMATE_COLOUR = "#d1495b"
MOTION_COLOUR = "#00798c"

_DPI = 120
_FORMATS = (".png", ".svg", ".pdf")


@dataclass(frozen=True, eq=False)
class Scene:
    """What is drawn of one tracked sequence.

    Parameters
    ----------
    title : str
        Its name.
    grey : ndarray, shape (H, W), uint8
        One of its images.
    others : sequence of ndarray, shape (H, W), uint8
        Some more of them, to show how the light changes.
    pixels : ndarray, shape (N, 2)
        The edge pixels (u, v) of that image.
    gradients : ndarray, shape (N, 2)
        Their unit gradients.
    reference, estimate : Trajectory
        True and estimated poses.
    evaluation : Evaluation
        The errors.
    """

    title: str
    grey: NDArray[np.uint8]
    others: Sequence[NDArray[np.uint8]]
    pixels: NDArray[np.floating]
    gradients: NDArray[np.floating]
    reference: Trajectory
    estimate: Trajectory
    evaluation: Evaluation


def draw_scenes(path: Path, scenes: Sequence[Scene], *, title: str) -> None:
    """Draw a row for each sequence: edges, path from above, error over time.

    Parameters
    ----------
    path : pathlib.Path
        The picture: .png, .svg or .pdf.
    scenes : sequence of Scene
        At least one.
    title : str
        Above all.

    Raises
    ------
    OutputError
        If the picture cannot be written or has another ending.
    """
    figure = _figure(16.0, 5.0 * len(scenes) + 0.5)
    figure.suptitle(title, fontsize=15, fontweight="bold")
    parts = figure.subfigures(len(scenes), 1, squeeze=False).flat
    for part, scene in zip(parts, scenes, strict=True):
        part.suptitle(scene.title, fontsize=12, fontweight="bold")
        grid = part.add_gridspec(2, 3, height_ratios=(5.0, 1.0), width_ratios=(1.2, 1.0, 1.1))
        _draw_edges(part.add_subplot(grid[0, 0]), scene)
        _draw_light(part.add_subplot(grid[1, 0]), scene.others)
        path_axes, error_axes = (part.add_subplot(grid[:, column]) for column in (1, 2))
        _draw_path(path_axes, scene.reference, scene.estimate, scene.evaluation)
        draw_errors(error_axes, scene.evaluation)
    _save(figure, path)


def draw_evaluation(
    path: Path, reference: Trajectory, estimate: Trajectory, evaluation: Evaluation, *, title: str
) -> None:
    """Draw both paths from above, and the error over time.

    Parameters
    ----------
    path : pathlib.Path
        The picture: .png, .svg or .pdf.
    reference, estimate : Trajectory
        True and estimated poses.
    evaluation : Evaluation
        Their comparison.
    title : str
        Above all.

    Raises
    ------
    OutputError
        If the picture cannot be written or has another ending.
    """
    figure = _figure(12.0, 5.2)
    figure.suptitle(title, fontsize=14, fontweight="bold")
    left, right = figure.subplots(1, 2)
    _draw_path(left, reference, estimate, evaluation)
    draw_errors(right, evaluation)
    _save(figure, path)


def direction_colours(gradients: NDArray[np.floating]) -> NDArray[np.float64]:
    """Give colours that tell directions of gradients.

    Parameters
    ----------
    gradients : ndarray, shape (N, 2)
        Gradients (u, v) of any length.

    Returns
    -------
    ndarray, shape (N, 3), float64
        Red, green, blue in [0, 1]. Hue 0 (red) is a gradient to the right, and hue grows
        clockwise in the image.
    """
    hue = (np.arctan2(gradients[:, 1], gradients[:, 0]) / (2 * np.pi)) % 1.0
    colours = hsv_to_rgb(np.stack([hue, np.full_like(hue, 0.75), np.ones_like(hue)], axis=1))
    return np.asarray(colours, np.float64)


def edge_picture(
    grey: NDArray[np.uint8], pixels: NDArray[np.floating], gradients: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Paint edge pixels over a dimmed image, in colours that tell their gradient directions.

    Parameters
    ----------
    grey : ndarray, shape (H, W), uint8
        The image.
    pixels : ndarray, shape (N, 2)
        Edge pixels (u, v).
    gradients : ndarray, shape (N, 2)
        Their gradients, of any length.

    Returns
    -------
    ndarray, shape (H, W, 3), float64
        Red, green, blue in [0, 1]; see `direction_colours`.
    """
    picture = np.repeat(0.45 * grey[:, :, None] / 255.0, 3, axis=2)
    height, width = grey.shape
    colours = direction_colours(gradients)
    corner = np.rint(pixels).astype(int)
    # Two pixels wide, to be seen where the picture is drawn smaller than the image.
    for du, dv in ((1, 1), (1, 0), (0, 1), (0, 0)):
        u = np.clip(corner[:, 0] + du, 0, width - 1)
        v = np.clip(corner[:, 1] + dv, 0, height - 1)
        picture[v, u] = colours
    return picture


def _draw_edges(axes: Axes, scene: Scene) -> None:
    grey = scene.grey
    axes.imshow(edge_picture(grey, scene.pixels, scene.gradients))
    axes.set_axis_off()
    axes.set_title(f"{len(scene.pixels)} edge pixels, coloured by gradient direction")
    # The key: a wheel of the same colours.
    wheel = axes.inset_axes((0.87, 0.03, 0.11, 0.11 * grey.shape[1] / grey.shape[0]))
    y, x = np.mgrid[-1:1:101j, -1:1:101j]
    radius = np.hypot(x, y)
    hue = (np.arctan2(y, x) / (2 * np.pi)) % 1.0
    colours = hsv_to_rgb(np.stack([hue, np.full_like(hue, 0.75), np.ones_like(hue)], axis=-1))
    ring = np.dstack([colours, (radius < 1.0) & (radius > 0.5)])
    wheel.imshow(ring)
    wheel.set_axis_off()


def _draw_light(axes: Axes, images: Sequence[NDArray[np.uint8]]) -> None:
    """Draw images beside each other, as they are."""
    gap = np.full((images[0].shape[0], images[0].shape[1] // 20), 255, np.uint8)
    strip = [image for each in images for image in (gap, each)][1:]
    axes.imshow(np.hstack(strip), cmap="gray", vmin=0, vmax=255)
    axes.set_axis_off()


def _draw_path(
    axes: Axes, reference: Trajectory, estimate: Trajectory, evaluation: Evaluation
) -> None:
    """Draw positions as the first true camera sees them: right across, forward up."""
    truth = reference.between(estimate.timestamps[0], estimate.timestamps[-1])
    if not len(truth):
        truth = reference
    T_first_ref = se3.inverse(truth.poses[0])
    if evaluation.ate is not None:
        T_ref_est = evaluation.ate.T_ref_est
    else:
        T_ref_est = truth.poses[0] @ se3.inverse(estimate.poses[0])
    true = _positions(T_first_ref, truth)
    estimated = _positions(T_first_ref @ T_ref_est, estimate)
    axes.plot(true[:, 0], true[:, 2], color=TRUTH_COLOUR, lw=3.0, alpha=0.35, label="truth")
    axes.plot(estimated[:, 0], estimated[:, 2], color=ESTIMATE_COLOUR, lw=1.4, label="estimate")
    axes.plot(*true[0, [0, 2]], "o", color=TRUTH_COLOUR, ms=6, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("right (m)")
    axes.set_ylabel("forward (m)")
    axes.set_title("path from above")
    axes.legend(loc="best", frameon=False)
    _tidy(axes)


def draw_errors(axes: Axes, evaluation: Evaluation) -> None:
    """Draw the errors over time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to.
    evaluation : Evaluation
        At least one of its errors.
    """
    starts = [e.stamps[0] for e in (evaluation.rpe, evaluation.ate) if e is not None]
    begin = min(starts)
    if evaluation.ate is not None:
        axes.plot(
            evaluation.ate.stamps - begin,
            1e3 * evaluation.ate.errors,
            color=ESTIMATE_COLOUR,
            lw=1.4,
            label=f"position (ATE): rmse {1e3 * evaluation.ate.rmse:.1f} mm",
        )
    if evaluation.rpe is not None:
        rpe = evaluation.rpe
        axes.plot(
            rpe.stamps - begin,
            1e3 * rpe.translation,
            color=MOTION_COLOUR,
            lw=1.4,
            label=f"motion over {rpe.delta:g} {rpe.unit} (RPE): rmse {1e3 * rpe.rmse:.1f} mm, "
            f"{degrees(rpe.rotation_rmse):.2f}°",
        )
    if evaluation.rpe_zero_motion is not None:
        # Named, not drawn: on its scale the others would be flat.
        axes.plot(
            [],
            [],
            " ",
            label=f"zero motion (RPE): rmse {1e3 * evaluation.rpe_zero_motion.rmse:.0f} mm",
        )
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.02)
    axes.set_ylim(top=1.35 * axes.get_ylim()[1])
    axes.set_xlabel("time (s)")
    axes.set_ylabel("error (mm)")
    axes.set_title("error over time")
    axes.legend(loc="upper left", frameon=False, fontsize=9)
    _tidy(axes)


def _positions(T_view_world: NDArray[np.float64], trajectory: Trajectory) -> NDArray[np.float64]:
    points: NDArray[np.float64] = (
        trajectory.poses[:, :3, 3] @ T_view_world[:3, :3].T + T_view_world[:3, 3]
    )
    return points


def _tidy(axes: Axes) -> None:
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Figure, path: Path) -> None:
    if path.suffix.lower() not in _FORMATS:
        raise OutputError(f"{path}: cannot draw {path.suffix or 'that'}; name it *{_FORMATS[0]}")
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix.lower()[1:])
    write_atomically(path, picture.getvalue())
