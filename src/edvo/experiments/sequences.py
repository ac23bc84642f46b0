"""The sequences of the experiments: real ones where they are at hand, else stand-ins."""

import re
from collections import OrderedDict
from collections.abc import Callable, Hashable
from collections.abc import Sequence as Items
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

from edvo.camera import Camera
from edvo.datasets import Source, open_source, read_ahead
from edvo.datasets.incomplete import is_incomplete
from edvo.datasets.registry import recognise
from edvo.errors import DatasetError
from edvo.frame import Frame
from edvo.synthesis.relighting import DEFAULT_MODEL, DEFAULT_SEVERITY, Relighter
from edvo.synthesis.sequence import Recipe, SyntheticSource, write_sequence
from edvo.trajectory import Trajectory

PAPER_SEQUENCES = {
    "fr3/structure_texture_far": "texture_far",
    "fr3/structure_texture_near": "texture_near",
    "fr3/long_office_household": "office",
    "fr3/structure_notexture_far": "notexture_far",
    "fr3/structure_notexture_near": "notexture_near",
    "fr3/cabinet": "cabinet",
}
"""The sequences of the paper (Tables II and III, in their order), and the scene of each kind."""

TEXTURED = tuple(PAPER_SEQUENCES)[:3]
"""Those of them that have texture; the others have little."""

_TUM = re.compile(r"(?:rgbd_dataset_freiburg|(?:tum_)?fr(?:eiburg)?)_?(\d)[_/](.+)")
_WORKERS = 2
_FRAMES_KEPT = 1200  # of VGA size, 1.5 MB each


@dataclass(frozen=True)
class Loaded:
    """Frames in memory.

    Parameters
    ----------
    frames : tuple of Frame
        Those that could be read.
    problems : tuple of str
        A line for each one that could not.
    """

    frames: tuple[Frame, ...]
    problems: tuple[str, ...] = ()


class FrameMemory:
    """Keeps the frames that were used last, and forgets others once there are too many.

    Parameters
    ----------
    most : int
        Frames to keep; what is in use is always kept, even if it is more.
    """

    def __init__(self, most: int = _FRAMES_KEPT) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, Loaded] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Loaded]) -> Loaded:
        """Give what is kept under a key, or make it.

        Parameters
        ----------
        key : hashable
            What it is called.
        make : callable
            Makes it.

        Returns
        -------
        Loaded
            The frames.
        """
        if key not in self._kept:
            made = make()
            self._kept[key] = made
        self._kept.move_to_end(key)
        while len(self._kept) > 1 and sum(len(k.frames) for k in self._kept.values()) > self._most:
            self._kept.popitem(last=False)
        return self._kept[key]

    def clear(self) -> None:
        """Forget all frames."""
        self._kept.clear()


@dataclass(frozen=True, eq=False)
class Sequence:
    """Frames with truth.

    Parameters
    ----------
    name : str
        Such as ``fr3/structure_notexture_far``.
    label : str
        What it really is: ``real, 128 frames`` or ``stand-in: synthetic notexture_far, 90
        frames``.
    is_real : bool
        Whether a camera took it.
    camera : Camera
        Of all frames.
    truth : Trajectory
        True poses, ``T_world_cam``.
    load : callable
        Gives the frames.
    memory : FrameMemory
        Where frames made from these are kept.
    """

    name: str
    label: str
    is_real: bool
    camera: Camera
    truth: Trajectory
    load: Callable[[], Loaded] = field(repr=False)
    memory: FrameMemory = field(repr=False)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The frames, decoded; kept in memory as long as there is room."""
        return self.load().frames

    @property
    def problems(self) -> tuple[str, ...]:
        """A line for each frame that could not be read."""
        return self.load().problems

    def relit(
        self,
        severity: float = DEFAULT_SEVERITY,
        seed: int = 0,
        *,
        model: str = DEFAULT_MODEL,
    ) -> "Sequence":
        """Put the sequence under light that changes (paper, section V-A).

        Parameters
        ----------
        severity : float
            How hard, from 0 to 1.
        seed : int
            Of jumps and paths.
        model : str
            See `edvo.synthesis.relighting.Relighter`; the paper's two at 2 Hz by default.

        Returns
        -------
        Sequence
            The same with other grey images; depth is shared with this one.
        """
        relighter = Relighter(model, severity=severity, seed=seed)

        def light(frame: Frame, begin: float) -> Frame:
            t = frame.timestamp - begin
            grey = relighter.relight(frame.grey, frame.depth, self.camera, t)
            return replace(frame, grey=grey)

        def make() -> Loaded:
            loaded = self.load()
            begin = loaded.frames[0].timestamp if loaded.frames else 0.0
            with ThreadPoolExecutor(_WORKERS) as pool:
                frames = tuple(pool.map(lambda frame: light(frame, begin), loaded.frames))
            return Loaded(frames, loaded.problems)

        key = (self.name, self.label, model, severity, seed)
        label = f"{self.label}, changing light"
        return replace(self, label=label, load=lambda: self.memory.get(key, make))


def real_sequence(name: str, source: Source, limit: int, memory: FrameMemory) -> Sequence:
    """Make a sequence of a recording.

    Parameters
    ----------
    name : str
        What to call it.
    source : Source
        The recording.
    limit : int
        Most frames to use, from its beginning.
    memory : FrameMemory
        Where its frames are kept.

    Returns
    -------
    Sequence
        Nothing of it is decoded yet.

    Raises
    ------
    DatasetError
        If it has no true poses.
    """
    truth = source.ground_truth
    if truth is None:
        raise DatasetError(f"{source.path}: no ground truth; add a groundtruth.txt")
    count = min(limit, len(source))
    label = f"real, {count} frames"
    if count < len(source):
        label = f"real, first {count} of {len(source)} frames"
    key = (name, str(source.path), count)
    return Sequence(
        name,
        label,
        is_real=True,
        camera=source.camera,
        truth=truth,
        load=lambda: memory.get(key, lambda: _read(source, count)),
        memory=memory,
    )


def stand_in(
    name: str,
    recipe: Recipe,
    folder: Path,
    memory: FrameMemory,
    *,
    paper: bool = True,
    again: bool = False,
    advance: Callable[[str], None] | None = None,
) -> Sequence:
    """Make a sequence of a synthetic scene.

    Parameters
    ----------
    name : str
        Of the sequence it stands for.
    recipe : Recipe
        What is rendered, once, when a frame is first asked for.
    folder : pathlib.Path
        Where it is written to in TUM layout; read from there where it is complete already.
    memory : FrameMemory
        Where its frames are kept.
    paper : bool
        Whether it stands for a sequence of the paper.
    again : bool
        Whether to render it even if it is complete.
    advance : callable, optional
        Told how far the rendering is.

    Returns
    -------
    Sequence
        Nothing of it is rendered yet.
    """
    scene = Path(recipe.scene.name).stem
    rendered = False
    kind = "stand-in: synthetic" if paper else "synthetic"

    def report(done: int, of: int) -> None:
        if advance is not None:
            advance(f"rendering {scene}: {done} of {of} frames")

    def make() -> Loaded:
        nonlocal rendered
        whole = (folder / "rgb.txt").exists() and not is_incomplete(folder)
        if not rendered and (again or not whole):
            source = SyntheticSource(recipe)
            write_sequence(source, folder, force=True, workers=_WORKERS, progress=report)
        rendered = True
        return _read(open_source(folder), recipe.frames)

    return Sequence(
        name,
        f"{kind} {scene}, {recipe.frames} frames",
        is_real=False,
        camera=recipe.camera,
        truth=recipe.truth(),
        load=lambda: memory.get(folder, make),
        memory=memory,
    )


def find_recordings(data: Path) -> dict[str, Path]:
    """Find the recordings in a folder.

    Parameters
    ----------
    data : pathlib.Path
        A folder of recordings, or a recording.

    Returns
    -------
    dict of str to pathlib.Path
        By name: ``fr3/cabinet`` for ``rgbd_dataset_freiburg3_cabinet``, ``tum_fr3_cabinet`` or
        ``fr3_cabinet``, the folder's own name for others.

    Raises
    ------
    DatasetError
        If there is no such folder or no recording in it.
    """
    if not data.is_dir():
        raise DatasetError(f"{data}: no such folder; give one that holds recordings")
    places = [data] if recognise(data) else sorted(data.iterdir())
    found: dict[str, Path] = {}
    for place in places:
        if (place.is_dir() or place is data) and recognise(place):
            found.setdefault(paper_name(place.resolve().name), place)
    if not found:
        raise DatasetError(f"{data}: no recording in it; give a folder that holds some")
    return found


def paper_name(folder: str) -> str:
    """Call a recording as the paper does.

    Parameters
    ----------
    folder : str
        Name of its folder.

    Returns
    -------
    str
        ``fr3/cabinet`` for any spelling of TUM's names, others as they are.
    """
    match = _TUM.fullmatch(folder.lower())
    return f"fr{match[1]}/{match[2]}" if match else folder


def short_name(name: str) -> str:
    """Abbreviate a name as the paper's tables do.

    Parameters
    ----------
    name : str
        Such as ``fr3/structure_notexture_far``.

    Returns
    -------
    str
        Such as ``fr3/ntxt/str/far``.
    """
    return _SHORT.get(name, name)


_SHORT = {
    "fr3/structure_texture_far": "fr3/txt/str/far",
    "fr3/structure_texture_near": "fr3/txt/str/near",
    "fr3/long_office_household": "fr3/long",
    "fr3/structure_notexture_far": "fr3/ntxt/str/far",
    "fr3/structure_notexture_near": "fr3/ntxt/str/near",
}


def _read(source: Source, count: int) -> Loaded:
    frames: list[Frame] = []
    problems: list[str] = []
    indices: Items[int] = range(count)
    with closing(read_ahead(source, indices, workers=_WORKERS)) as readings:
        for reading in readings:
            if reading.frame is not None:
                frames.append(reading.frame)
            else:
                problems.append(reading.problem or "no images")
    if not frames:
        raise DatasetError(f"no frame could be read; the first: {problems[0]}")
    return Loaded(tuple(frames), tuple(problems))
