"""A tracked sequence as an animated picture: edges, matches, paths and errors as they grow.

The plots' frames are drawn once; of each moment only images, curves and words are drawn anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from edvo import se3
from edvo.errors import OutputError
from edvo.files import write_atomically
from edvo.report.plots import TRUTH_COLOUR, edge_picture
from edvo.trajectory import Trajectory

_WIDTH, _HEIGHT = 1040, 680
_PANEL = (30, 64, 480, 360)  # of the left image: column, row, width, height
_PANELS_APART = 500
_LAST_S = 2.5  # how long the last moment stays
_QUALITY = 55
_WORST_PX = 3.0  # residual of the last colour
_RESIDUALS = LinearSegmentedColormap.from_list("residuals", ["#3ddc97", "#f9c74f", "#f94144"])


@dataclass(frozen=True, eq=False)
class DrawnPath:
    """What one tracker made of the sequence.

    Parameters
    ----------
    label : str
        For the legend.
    colour : str
        Of its curves.
    T_world_cam : ndarray, shape (F, 4, 4), float64
        Its pose at each frame.
    lost : ndarray, shape (F,), bool
        Where that is only a prediction; not drawn.
    """

    label: str
    colour: str
    T_world_cam: NDArray[np.float64]
    lost: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Moment:
    """What is drawn of one frame.

    Parameters
    ----------
    index : int
        Of the frame.
    grey : ndarray, shape (H, W), uint8
        Its image.
    pixels, gradients : ndarray, shape (N, 2)
        Its edge pixels (u, v) and their unit gradients.
    samples, references : ndarray, shape (M, 2)
        Pixels of the samples with a match, and of the edges of the keyframe that they match.
    residuals : ndarray, shape (M,)
        Distances left, pixels.
    words : sequence of str
        A line for each tracker: how it fares.
    """

    index: int
    grey: NDArray[np.uint8]
    pixels: NDArray[np.floating]
    gradients: NDArray[np.floating]
    samples: NDArray[np.floating]
    references: NDArray[np.floating]
    residuals: NDArray[np.floating]
    words: Sequence[str]


@dataclass(frozen=True, eq=False)
class Film:
    """All that an animation shows.

    Parameters
    ----------
    title : str
        Above all.
    timestamps : ndarray, shape (F,), float64
        Times of all frames, seconds.
    truth : Trajectory
        True poses.
    paths : sequence of DrawnPath
        One for each tracker.
    moments : sequence of Moment
        The frames that are drawn, in order.
    moment_s : float
        How long each is shown, seconds.
    """

    title: str
    timestamps: NDArray[np.float64]
    truth: Trajectory
    paths: Sequence[DrawnPath]
    moments: Sequence[Moment]
    moment_s: float


def draw_film(path: Path, film: Film) -> None:
    """Write an animation that repeats for ever.

    Parameters
    ----------
    path : pathlib.Path
        A .webp or .gif file.
    film : Film
        What it shows; at least one moment.

    Raises
    ------
    OutputError
        If it cannot be written, or OpenCV cannot make a file of that kind.
    """
    canvas = _Canvas(film)
    shown = [round(1e3 * film.moment_s)] * len(film.moments)
    shown[-1] = round(1e3 * _LAST_S)
    # OpenCV's stubs do not know it yet.
    animation = cast(Any, cv2).Animation()
    animation.frames = [canvas.draw(moment) for moment in film.moments]
    animation.durations = np.array(shown, np.int32)
    animation.loop_count = 0
    options = [cv2.IMWRITE_WEBP_QUALITY, _QUALITY] if path.suffix == ".webp" else []
    try:
        done, data = cast(Any, cv2).imencodeanimation(path.suffix, animation, options)
    except cv2.error:
        done = False
    if not done:
        raise OutputError(f"{path}: cannot make an animation of that kind; name it *.webp")
    write_atomically(path, data.tobytes())


def match_picture(
    grey: NDArray[np.uint8],
    samples: NDArray[np.floating],
    references: NDArray[np.floating],
    residuals: NDArray[np.floating],
    size: tuple[int, int],
) -> NDArray[np.uint8]:
    """Paint matches over a dimmed image, in colours that tell their residuals.

    Parameters
    ----------
    grey : ndarray, shape (H, W), uint8
        The image.
    samples, references : ndarray, shape (M, 2)
        Pixels (u, v) of samples, drawn as dots, and of what they match, at the ends of lines.
    residuals : ndarray, shape (M,)
        Pixels; green is 0, red 3 and more.
    size : (int, int)
        Width and height of the picture.

    Returns
    -------
    ndarray, shape (height, width, 3), uint8
        In OpenCV's order of colours.
    """
    dim = cv2.cvtColor(cv2.convertScaleAbs(grey, alpha=0.7), cv2.COLOR_GRAY2BGR)
    picture = np.asarray(cv2.resize(dim, size, interpolation=cv2.INTER_AREA), np.uint8)
    height, width = grey.shape
    # To the picture, in sixteenths of a pixel.
    scale = np.array([size[0] / width, size[1] / height])
    ends = [
        np.rint(16 * ((pixels + 0.5) * scale - 0.5)).astype(int).tolist()
        for pixels in (samples, references)
    ]
    colours = 255 * _RESIDUALS(np.abs(residuals) / _WORST_PX)[:, 2::-1]
    for here, there, colour in zip(*ends, colours.tolist(), strict=True):
        cv2.line(picture, here, there, colour, 1, cv2.LINE_AA, 4)
        cv2.circle(picture, here, 28, colour, -1, cv2.LINE_AA, 4)
    return picture


class _Canvas:
    """A figure whose constant part is drawn once."""

    def __init__(self, film: Film) -> None:
        self._film = film
        self._places, self._errors, self._true = _curves(film)
        self._figure = Figure(figsize=(_WIDTH / 100, _HEIGHT / 100), dpi=100)
        self._backend = cast(Any, FigureCanvasAgg(self._figure))  # untyped
        self._figure.text(0.03, 0.965, film.title, fontsize=12, fontweight="bold", va="center")
        top = 1 - (_PANEL[1] - 11) / _HEIGHT
        titles = (
            "edges, coloured by the direction of their gradient",
            "matches: samples and edges of the keyframe",
        )
        for panel, title in enumerate(titles):
            left = (_PANEL[0] + panel * _PANELS_APART) / _WIDTH
            self._figure.text(left, top, title, fontsize=9.5, va="center")
        right = (_PANEL[0] + _PANELS_APART + _PANEL[2]) / _WIDTH
        for x, words in ((right - 0.1, "residual  0"), (right, f"{_WORST_PX:g} px")):
            self._figure.text(x, top, words, fontsize=8.5, va="center", ha="right")
        bar = self._figure.add_axes((right - 0.093, top - 0.007, 0.055, 0.014))
        bar.imshow(np.linspace(0, 1, 64)[None], cmap=_RESIDUALS, aspect="auto")
        bar.set_axis_off()
        self._changing: list[Line2D | Text] = []
        self._path_lines = self._make_paths(self._figure.add_axes((0.085, 0.075, 0.25, 0.24)))
        self._error_lines = self._make_errors(self._figure.add_axes((0.41, 0.075, 0.26, 0.24)))
        self._words = [
            self._text(0.70, y, colour)
            for y, colour in zip(
                (0.345, 0.305, 0.24), ["0.15", *(path.colour for path in film.paths)], strict=False
            )
        ]
        self._backend.draw()
        self._still = self._backend.copy_from_bbox(self._figure.bbox)

    def draw(self, moment: Moment) -> NDArray[np.uint8]:
        """Draw a moment; (H, W, 3) in OpenCV's order of colours."""
        index, film = moment.index, self._film
        until = slice(0, index + 1)
        times = film.timestamps - film.timestamps[0]
        self._backend.restore_region(self._still)
        truth, *others = self._path_lines
        truth[0].set_data(*self._true[until].T)
        truth[1].set_data(*self._true[index : index + 1].T)
        for (line, dot), place in zip(others, self._places, strict=True):
            line.set_data(*place[until].T)
            dot.set_data(*place[index : index + 1].T)
        for line, error in zip(self._error_lines, self._errors, strict=True):
            line.set_data(times[until], error[until])
        head = f"{times[index]:.2f} s   frame {index + 1} of {len(times)}"
        for text, words in zip(self._words, (head, *moment.words), strict=True):
            text.set_text(words)
        for artist in self._changing:
            self._figure.draw_artist(artist)
        picture = np.array(self._backend.buffer_rgba())[:, :, 2::-1]
        for panel, image in enumerate((_edges(moment), _matches(moment))):
            left, top, width, height = _PANEL
            left += panel * _PANELS_APART
            picture[top : top + height, left : left + width] = image
        return np.ascontiguousarray(picture)

    def _make_paths(self, axes: Axes) -> list[tuple[Line2D, Line2D]]:
        axis = ("right", "down", "forward")
        seen = np.concatenate([self._true, *self._places])
        low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
        # One scale for both axes, filling the frame.
        frame = axes.get_window_extent()
        shape = np.array([frame.width, frame.height])
        half = 0.55 * shape * float(np.max((high - low) / shape)) + 1e-3
        (left, right), (bottom, top) = np.transpose(
            (0.5 * (low + high) - half, 0.5 * (low + high) + half)
        )
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        across, up = self._plane
        axes.set_xlabel(f"{axis[across]} (m)", fontsize=8)
        axes.set_ylabel(f"{axis[up]} (m)", fontsize=8)
        if axis[up] == "down":
            axes.invert_yaxis()
        _tidy(axes, "path")
        looks = [(TRUTH_COLOUR, 3.5, 0.35), *((path.colour, 1.6, 1.0) for path in self._film.paths)]
        pairs = []
        for colour, width, alpha in looks:
            (line,) = axes.plot([], [], color=colour, lw=width, alpha=alpha, animated=True)
            (dot,) = axes.plot([], [], "o", color=colour, ms=4, animated=True)
            pairs.append((line, dot))
            self._changing += [line, dot]
        labels = ["truth", *(path.label for path in self._film.paths)]
        keys = [Line2D([], [], color=c, lw=w, alpha=a) for c, w, a in looks]
        self._figure.legend(
            keys,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.69, 0.045),
            frameon=False,
            fontsize=8.5,
        )
        return pairs

    def _make_errors(self, axes: Axes) -> list[Line2D]:
        film = self._film
        worst = max((float(np.nanmax(error, initial=1.0)) for error in self._errors), default=1.0)
        axes.set_xlim(0.0, float(film.timestamps[-1] - film.timestamps[0]) or 1.0)
        axes.set_ylim(0.0, 1.08 * worst)
        axes.set_xlabel("time (s)", fontsize=8)
        _tidy(axes, "distance from truth (mm)")
        lines = [axes.plot([], [], color=p.colour, lw=1.6, animated=True)[0] for p in film.paths]
        self._changing += lines
        return lines

    def _text(self, x: float, y: float, colour: str) -> Text:
        text = self._figure.text(
            x, y, "", fontsize=9, color=colour, va="top", linespacing=1.35, animated=True
        )
        self._changing.append(text)
        return text

    @property
    def _plane(self) -> tuple[int, int]:
        return _plane(self._film.truth)


def _curves(
    film: Film,
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]], NDArray[np.float64]]:
    """Give places (F, 2) and errors (F,) in mm of each path, and the true places."""
    true = np.array([_true_pose(film.truth, t) for t in film.timestamps])
    T_first_ref = se3.inverse(true[0])
    axes = _plane(film.truth)
    places, errors = [], []
    for path in film.paths:
        # Each starts where the truth does: how it drifts off is what there is to see.
        T_ref_est = true[0] @ se3.inverse(path.T_world_cam[0])
        found = (T_ref_est @ path.T_world_cam)[:, :3, 3]
        found[path.lost] = np.nan
        errors.append(1e3 * np.linalg.norm(found - true[:, :3, 3], axis=1))
        places.append((found @ T_first_ref[:3, :3].T + T_first_ref[:3, 3])[:, axes])
    return places, errors, (T_first_ref @ true)[:, :3, 3][:, axes]


def _plane(truth: Trajectory) -> tuple[int, int]:
    """Choose the two axes of the first camera along which it moves most; right comes first."""
    local = (se3.inverse(truth.poses[0]) @ truth.poses)[:, :3, 3]
    least = int(np.argmin(np.ptp(local, axis=0)))
    across, up = (axis for axis in range(3) if axis != least)
    return across, up


def _true_pose(truth: Trajectory, t: float) -> NDArray[np.float64]:
    inside = min(max(t, float(truth.timestamps[0])), float(truth.timestamps[-1]))
    return truth.at(inside)


def _edges(moment: Moment) -> NDArray[np.uint8]:
    picture = edge_picture(moment.grey, moment.pixels, moment.gradients)
    colours = np.asarray(np.rint(255 * picture[:, :, ::-1]), np.uint8)
    return np.asarray(cv2.resize(colours, _PANEL[2:], interpolation=cv2.INTER_AREA), np.uint8)


def _matches(moment: Moment) -> NDArray[np.uint8]:
    return match_picture(
        moment.grey, moment.samples, moment.references, moment.residuals, _PANEL[2:]
    )


def _tidy(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9.5, loc="left")
    axes.tick_params(labelsize=7.5)
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
