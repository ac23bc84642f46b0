"""Fig. 2: which edges are found again when the light or the view changes, by extractor."""

from collections.abc import Mapping
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace
from statistics import fmean

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config, EdgesConfig
from edvo.edges import depth_at_edges, extract_edges
from edvo.errors import DatasetError
from edvo.experiments.bench import Bench
from edvo.experiments.drawing import new_figure, tidy, to_png
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table, Value
from edvo.experiments.sequences import PAPER_SEQUENCES, TEXTURED, Sequence, short_name
from edvo.frame import Frame
from edvo.synthesis.relighting import DEFAULT_MODEL, DEFAULT_SEVERITY, Relighter

EXTRACTORS = {"sobel": "Sobel", "dog": "DoG", "canny": "Canny"}
"""In the order of the paper's figure, all with as many edges as Canny's."""

AS_PRESET = {"sobel-preset": "Sobel, preset threshold", "dog-preset": "DoG, preset threshold"}
"""The same with the thresholds of the preset, and far fewer or more edges."""

_TITLES = {**EXTRACTORS, **AS_PRESET}

_THRESHOLDS = {"sobel": "sobel_threshold", "dog": "dog_contrast"}
_SEARCHED = (1e-2, 2040.0)  # up to the strongest gradient
_HALVINGS = 16

RADII = (1, 2)  # pixels within which an edge counts as found again
GAP_S = 0.2  # between the two views
_DARKEST_S = 0.375  # three quarters of a period of 2 Hz
_SAME_DEPTH = 0.03  # relative: a point further behind what is seen there is hidden
_QUICK = ("fr3/structure_texture_far", "fr3/structure_notexture_far")
_FRAMES = (12, 4)  # of each sequence

RELIT, HARDER, WARPED, BOTH = (
    "relit",
    "relit, hardest",
    "another view",
    "another view, relit",
)
CONDITIONS = (RELIT, HARDER, WARPED, BOTH)

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Recurrence:
    """How many edges of one image are found again in another.

    Parameters
    ----------
    edges : float
        Share of the first image's pixels that are edges.
    count_ratio : float
        Edges of the second image over those of the first.
    found : tuple of float
        Share of the edges that have one of the second image within each of `RADII`.
    chance : tuple of float
        The same for pixels anywhere in the image: what any thick set of edges scores.
    """

    edges: float
    count_ratio: float
    found: tuple[float, ...]
    chance: tuple[float, ...]

    @property
    def beyond_chance(self) -> float:
        """Share found again within one pixel, 0 for chance and 1 for all."""
        return (self.found[0] - self.chance[0]) / (1 - self.chance[0])

    @property
    def same_count(self) -> float:
        """Smaller of both counts over the larger one."""
        return min(self.count_ratio, 1 / self.count_ratio) if self.count_ratio else 0.0


def run(bench: Bench) -> Outcome:
    """Measure how stable the edges of three extractors are.

    Parameters
    ----------
    bench : Bench
        Gives the sequences.

    Returns
    -------
    Outcome
        A table, pictures in the form of the paper's, a plot.
    """
    sequences = bench.sequences(bench.count(tuple(PAPER_SEQUENCES), _QUICK))
    results: dict[tuple[str, str, str], Recurrence] = {}
    figures = []
    for sequence in sequences:
        bench.advance(sequence.name)
        chosen = choose(sequence, bench.count(*_FRAMES))
        configs = calibrated([frame.grey for frame, _ in chosen])
        for name, config in configs.items():
            for condition, found in measure(sequence, chosen, config).items():
                results[sequence.name, name, condition] = found
        if sequence.name in _QUICK:
            figures.append(_pictures(sequence, chosen[len(chosen) // 2][0], configs))
    labels = {sequence.name: sequence.label for sequence in sequences}
    return Outcome(
        "fig2",
        EXPERIMENT.title,
        [_table(results, labels)],
        [*figures, _plot(results)],
        [
            _most_recurring(results, (RELIT, HARDER), "when the light changes"),
            _steadiest(results),
            _most_recurring(results, (WARPED, BOTH), "when the view changes"),
        ],
        (
            f"Relit: the image as it is and at the darkest instant of {DEFAULT_MODEL} at 2 Hz, "
            f"severity {DEFAULT_SEVERITY} (hardest: 1). Another view: {GAP_S:g} s later, edges "
            "warped by measured depth and true pose; those that leave the image or are hidden do "
            "not count.",
            "Within a pixel of a thick band of edges lies much of the image, so that chance finds "
            "many of them again; 'beyond chance' takes that out: (found - chance) / (1 - chance).",
            "Canny's thresholds are those of the preset paper; the single one of each other "
            "extractor is such that it marks as many pixels as Canny does, over the images of a "
            "sequence as they are, and beside it that of the preset. The paper names none.",
            "Relighting keeps the noise of an image, so that edges made of noise are found again "
            "too; another view has noise of its own.",
        ),
    )


def choose(sequence: Sequence, most: int) -> list[tuple[Frame, Frame]]:
    """Choose frames all over a sequence, each with one some time later.

    Parameters
    ----------
    sequence : Sequence
        Whose frames.
    most : int
        How many at most.

    Returns
    -------
    list of (Frame, Frame)
        `GAP_S` apart, or the next frame where they are further apart than that.

    Raises
    ------
    DatasetError
        If no two frames have a true pose.
    """
    begin, end = sequence.truth.timestamps[[0, -1]]
    frames = [frame for frame in sequence.frames if begin <= frame.timestamp <= end]
    times = np.array([frame.timestamp for frame in frames])
    if len(frames) < 2:
        raise DatasetError(f"{sequence.name}: no two frames with truth; give a longer one")
    pairs = []
    for start in np.unique(np.linspace(0, len(frames) - 2, most).astype(int)).tolist():
        later = int(np.argmin(np.abs(times - times[start] - GAP_S)))
        pairs.append((frames[start], frames[max(later, start + 1)]))
    return pairs


def measure(
    sequence: Sequence, pairs: list[tuple[Frame, Frame]], config: EdgesConfig
) -> dict[str, Recurrence]:
    """Measure how stable the edges of an extractor are on some frames.

    Parameters
    ----------
    sequence : Sequence
        Whose frames they are.
    pairs : list of (Frame, Frame)
        See `choose`.
    config : EdgesConfig
        The extractor.

    Returns
    -------
    dict of str to Recurrence
        Means over the frames, by condition.
    """
    camera = sequence.camera
    found: dict[str, list[Recurrence]] = {condition: [] for condition in CONDITIONS}
    for frame, later in pairs:
        first = edge_mask(frame.grey, config)
        found[RELIT].append(recurrence(first, edge_mask(dark(frame, camera), config)))
        found[HARDER].append(recurrence(first, edge_mask(dark(frame, camera, 1.0), config)))
        T_world_first, T_world_later = (
            sequence.truth.at(each.timestamp) for each in (frame, later)
        )
        T_later_first = se3.inverse(T_world_later) @ T_world_first
        pixels = warp(np.flatnonzero(first), frame, later, T_later_first, camera, config)
        for condition, grey in ((WARPED, later.grey), (BOTH, dark(later, camera))):
            second = edge_mask(grey, config)
            found[condition].append(recurrence(first, second, pixels))
    return {condition: _mean(each) for condition, each in found.items()}


def calibrated(images: Items[NDArray[np.uint8]]) -> dict[str, EdgesConfig]:
    """Give all extractors thresholds by which they mark equally many pixels, and the preset's.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (H, W)
        In which they do so together.

    Returns
    -------
    dict of str to EdgesConfig
        By `EXTRACTORS` and `AS_PRESET`; Canny's thresholds are those of the preset paper.
    """
    canny = Config.preset("paper").edges
    wanted = _count(images, canny)
    found = {}
    for name in EXTRACTORS:
        key = _THRESHOLDS.get(name)
        if key is None:
            found[name] = canny
            continue
        low, high = _SEARCHED
        for _ in range(_HALVINGS):
            middle = (low * high) ** 0.5
            config = canny.model_copy(update={"extractor": name, key: middle})
            if _count(images, config) > wanted:
                low = middle
            else:
                high = middle
        found[name] = canny.model_copy(update={"extractor": name, key: high})
    for name in AS_PRESET:
        extractor = name.removesuffix("-preset")
        found[name] = canny.model_copy(update={"extractor": extractor})
    return found


def _count(images: Items[NDArray[np.uint8]], config: EdgesConfig) -> int:
    return sum(len(extract_edges(image, config)) for image in images)


def edge_mask(grey: NDArray[np.uint8], config: EdgesConfig) -> Mask:
    """Tell edges from the rest.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
        An image.
    config : EdgesConfig
        The extractor.

    Returns
    -------
    ndarray of bool, shape (H, W)
        True at edges.
    """
    mask = np.zeros(grey.size, bool)
    mask[extract_edges(grey, config).index] = True
    return mask.reshape(grey.shape)


def dark(frame: Frame, camera: Camera, severity: float = DEFAULT_SEVERITY) -> NDArray[np.uint8]:
    """Give the image at the darkest instant of the paper's light, without jumps.

    Parameters
    ----------
    frame : Frame
        The image as it is, and its depth.
    camera : Camera
        Of both.
    severity : float
        Of the light.

    Returns
    -------
    ndarray of uint8, shape (H, W)
        The image relit.
    """
    light = Relighter(DEFAULT_MODEL, severity=severity, jumps=())
    return light.relight(frame.grey, frame.depth, camera, _DARKEST_S)


def warp(
    index: NDArray[np.integer],
    frame: Frame,
    later: Frame,
    T_later_first: NDArray[np.float64],
    camera: Camera,
    config: EdgesConfig,
) -> NDArray[np.intp]:
    """Say where edges are seen in another view, Eq. (1).

    Parameters
    ----------
    index : ndarray of int, shape (N,)
        Flat indices of the edge pixels.
    frame, later : Frame
        Theirs, and the other view.
    T_later_first : ndarray of float64, shape (4, 4)
        True motion.
    camera : Camera
        Of both.
    config : EdgesConfig
        How the depth of an edge is taken.

    Returns
    -------
    ndarray of int, shape (M, 2)
        Nearest pixel (u, v) of those that are in the other image and not hidden there.
    """
    depths = depth_at_edges(frame.depth, index.astype(np.int32), config)
    known = depths > 0
    v, u = np.divmod(index[known], camera.width)
    points = camera.backproject(np.stack([u, v], axis=1).astype(np.float64), depths[known])
    points = points @ T_later_first[:3, :3].T + T_later_first[:3, 3]
    points = points[points[:, 2] > 0]
    pixels = np.rint(camera.project(points)).astype(np.intp)
    inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    pixels, z = pixels[inside], points[inside, 2]
    seen = later.depth[pixels[:, 1], pixels[:, 0]]
    return np.asarray(pixels[(seen == 0) | (z < (1 + _SAME_DEPTH) * seen)])


def recurrence(first: Mask, second: Mask, pixels: NDArray[np.intp] | None = None) -> Recurrence:
    """Count edges that are found again.

    Parameters
    ----------
    first, second : ndarray of bool, shape (H, W)
        True at the edges of both images.
    pixels : ndarray of int, shape (M, 2), optional
        Where the edges of the first image are in the second one; at the same place by default.

    Returns
    -------
    Recurrence
        All nought where there is nothing to find.
    """
    if pixels is None:
        v, u = np.nonzero(first)
        pixels = np.stack([u, v], axis=1)
    count = np.count_nonzero(first)
    if not len(pixels) or not second.any():
        nothing = (0.0,) * len(RADII)
        return Recurrence(count / first.size, 0.0, nothing, nothing)
    distance = cv2.distanceTransform((~second).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # A diagonal neighbour is a neighbour.
    at_edges = distance[pixels[:, 1], pixels[:, 0]]
    return Recurrence(
        count / first.size,
        np.count_nonzero(second) / count,
        tuple(float(np.mean(at_edges < radius + 0.5)) for radius in RADII),
        tuple(float(np.mean(distance < radius + 0.5)) for radius in RADII),
    )


def _mean(each: list[Recurrence]) -> Recurrence:
    return Recurrence(
        fmean(one.edges for one in each),
        fmean(one.count_ratio for one in each),
        tuple(fmean(one.found[k] for one in each) for k in range(len(RADII))),
        tuple(fmean(one.chance[k] for one in each) for k in range(len(RADII))),
    )


Results = Mapping[tuple[str, str, str], Recurrence]


def _table(results: Results, labels: Mapping[str, str]) -> Table:
    rows = []
    records: list[dict[str, Value]] = []
    for (sequence, extractor, condition), found in results.items():
        rows.append(
            (
                short_name(sequence),
                labels[sequence],
                _TITLES[extractor],
                condition,
                f"{found.edges:.1%}",
                f"{found.count_ratio:.2f}",
                *(f"{share:.1%}" for share in found.found),
                f"{found.chance[0]:.1%}",
                f"{found.beyond_chance:.1%}",
            )
        )
        records.append(
            {
                "sequence": sequence,
                "data": labels[sequence],
                "extractor": extractor,
                "condition": condition,
                "edges_share": round(found.edges, 5),
                "count_ratio": round(found.count_ratio, 4),
                **{f"found_{r}px": round(s, 5) for r, s in zip(RADII, found.found, strict=True)},
                **{f"chance_{r}px": round(s, 5) for r, s in zip(RADII, found.chance, strict=True)},
                "beyond_chance_1px": round(found.beyond_chance, 5),
            }
        )
    header = (
        "sequence",
        "data",
        "extractor",
        "condition",
        "edges",
        "edges after / before",
        "found within 1 px",
        "within 2 px",
        "chance, 1 px",
        "beyond chance, 1 px",
    )
    return Table("repeatability", "Edges that are found again", header, rows, records)


def _pictures(sequence: Sequence, frame: Frame, configs: Mapping[str, EdgesConfig]) -> Figure:
    figure = new_figure(13.0, 5.4)
    rows = figure.subplots(2, 4)
    lit = replace(frame, grey=dark(frame, sequence.camera))
    titles = ("(a) image", "(b) Sobel", "(c) DoG", "(d) Canny")
    for axes, image in zip(rows, (frame.grey, lit.grey), strict=True):
        masks = [edge_mask(image, configs[name]) for name in EXTRACTORS]
        axes[0].imshow(image, cmap="gray", vmin=0, vmax=255)
        for place, mask in zip(axes[1:], masks, strict=True):
            place.imshow(mask, cmap="gray_r", interpolation="antialiased")
    for axes, title in zip(rows[0], titles, strict=True):
        axes.set_title(title)
    for axes in rows.flat:
        axes.set_xticks([])
        axes.set_yticks([])
    figure.suptitle(f"{sequence.name} ({sequence.label})")
    name = sequence.name.replace("/", "_")
    caption = (
        f"Edges of {sequence.name} ({sequence.label}) as it is and relit, in the form of the "
        "paper's Fig. 2."
    )
    return Figure(f"edges_{name}", caption, to_png(figure))


def _plot(results: Results) -> Figure:
    figure = new_figure(10.0, 4.2)
    kinds = _kinds(results)
    panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    places = np.arange(len(CONDITIONS))
    for axes, (kind, names) in zip(panels, kinds.items(), strict=True):
        for number, (extractor, title) in enumerate(EXTRACTORS.items()):
            shares = [
                100 * fmean(results[name, extractor, condition].beyond_chance for name in names)
                for condition in CONDITIONS
            ]
            axes.bar(places + 0.27 * (number - 1), shares, 0.25, label=title)
        axes.set_xticks(places, CONDITIONS, rotation=15)
        axes.set_title(f"{kind} ({', '.join(map(short_name, names))})", fontsize=9)
        tidy(axes)
    panels[0].set_ylabel("edges found again within 1 px, beyond chance (%)", fontsize=8)
    handles, titles = panels[0].get_legend_handles_labels()
    figure.legend(handles, titles, loc="outside lower center", ncols=3, frameon=False)
    caption = "Share of edge pixels found again within one pixel, beyond chance, by extractor."
    return Figure("repeatability", caption, to_png(figure))


def _kinds(results: Results) -> dict[str, list[str]]:
    """Sort the sequences by whether they have texture; only kinds that there are."""
    names = dict.fromkeys(name for name, _, _ in results)
    kinds = {
        "texture": [name for name in names if name in TEXTURED],
        "little texture": [name for name in names if name not in TEXTURED],
    }
    return {kind: those for kind, those in kinds.items() if those}


def _most_recurring(results: Results, conditions: tuple[str, ...], when: str) -> Finding:
    won, parts = [], []
    for kind, names in _kinds(results).items():
        means = {
            extractor: fmean(
                results[name, extractor, condition].beyond_chance
                for name in names
                for condition in conditions
            )
            for extractor in _TITLES
        }
        won.append(_best(means) == "canny")
        parts.append(f"{kind}: {_list(means, '.0%')}")
    return Finding(
        f"Of the three extractors Canny's edges are the most reliable {when}",
        all(won),
        f"Found again within 1 px, beyond chance; {'. '.join(parts)}.",
    )


def _steadiest(results: Results) -> Finding:
    means = {
        extractor: fmean(
            found.same_count
            for (_, name, condition), found in results.items()
            if name == extractor and condition in (RELIT, HARDER)
        )
        for extractor in _TITLES
    }
    return Finding(
        "Two thresholds make the amount of edges depend less on the light than one does",
        _best(means) == "canny",
        "Fewer edges over more, before and after relighting (1: no change): "
        f"{_list(means, '.2f')}.",
    )


def _best(means: Mapping[str, float]) -> str:
    """Name the best of those with equally many edges."""
    return max(EXTRACTORS, key=lambda name: means[name])


def _list(means: Mapping[str, float], how: str) -> str:
    equal, preset = (
        ", ".join(f"{_TITLES[name]} {format(means[name], how)}" for name in names)
        for names in (EXTRACTORS, AS_PRESET)
    )
    return f"{equal}, with equally many edges; {preset}"


EXPERIMENT = Experiment(
    "fig2",
    "Edge extractors under two lights",
    "Sobel, zero-crossing DoG and Canny edges of two images of different brightness: Canny's are "
    "the most reliable, the others, with a single threshold, are not consistent.",
    run,
)
