"""A sequence on disk under another light: new colour images, everything else as it was."""

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets import tum
from edvo.datasets.images import load_image
from edvo.datasets.incomplete import being_written, refuse_incomplete
from edvo.datasets.known_cameras import choose_camera
from edvo.errors import DatasetError, FrameError, OutputError, SceneError
from edvo.files import output_folder, write_atomically
from edvo.synthesis.relighting import DEFAULT_MODEL, DEFAULT_SEVERITY, Relighter
from edvo.trajectory import nearest_indices

_LISTS = (tum.COLOUR_LIST, tum.DEPTH_LIST, *tum.PAIR_LISTS)
# PNG is written losslessly at zlib's fast end; JPEG at a quality whose own error is below a level.
_CODECS = {
    ".png": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 3]),
    ".jpg": (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 97]),
    ".jpeg": (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 97]),
}


@dataclass(frozen=True)
class RelitFolder:
    """What was written.

    Parameters
    ----------
    path : pathlib.Path
        The new sequence.
    relit : int
        Colour images under the new light.
    problems : tuple of str
        A line for each colour image that could not be relit; such a file is copied as it is, if
        it is there.
    """

    path: Path
    relit: int
    problems: tuple[str, ...]


@dataclass(frozen=True)
class _Colour:
    file: str
    t: float
    depth_file: str | None


def relight_folder(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    model: str = DEFAULT_MODEL,
    *,
    severity: float = DEFAULT_SEVERITY,
    frequency: float | None = None,
    seed: int = 0,
    jumps: Sequence[float] | None = None,
    camera: Camera | str | os.PathLike[str] | None = None,
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> RelitFolder:
    """Write a TUM folder once more under another light.

    Depth images, lists, ground truth and camera are copied byte by byte. Colour images keep
    their names and their kind: PNG is lossless, JPEG is written at quality 97. Until all of it is
    there, ``INCOMPLETE.txt`` keeps every reader from taking the folder for a sequence.

    Parameters
    ----------
    source : path-like
        A folder in the TUM layout.
    target : path-like
        The new folder.
    model, severity, frequency, seed, jumps
        As for :class:`~edvo.synthesis.relighting.Relighter`.
    camera : Camera, path-like or str, optional
        Instead of the folder's own; only the ``diffuse`` model uses it.
    force : bool
        Write into a folder that is not empty.
    progress : callable, optional
        Called with the number of images done and the number of all.

    Returns
    -------
    RelitFolder
        What was written.

    Raises
    ------
    SceneError
        If there is no such model, a number is out of range, or the model needs depth that the
        source does not have.
    DatasetError
        If the source is no TUM folder or was not written to its end, or none of its colour images
        can be read.
    CameraError
        If the model needs a camera and nothing tells it.
    OutputError
        If the target is not empty, is the source, or cannot be written.
    """
    relighter = Relighter(model, severity=severity, frequency=frequency, seed=seed, jumps=jumps)
    source = Path(source)
    refuse_incomplete(source)
    colours, depth_files = _read_lists(source)
    device = None
    if relighter.needs_depth:
        if not depth_files:
            raise SceneError(
                f"{source} has no depth images, and light model '{model}' needs them; "
                "choose a model without 'diffuse'"
            )
        device, _ = choose_camera(source, camera)
    if Path(target).resolve() == source.resolve():
        raise OutputError(f"{target} is the source itself; choose another folder")
    target = output_folder(target, must_be_empty=True, force=force)
    options = {"model": model, "severity": severity, "frequency": frequency, "seed": seed}
    redo = _command(source, target, options, jumps, camera)
    with being_written(target, f"{source} under light model {model!r}", redo):
        problems = _write(relighter, source, target, colours, depth_files, device, progress)
    return RelitFolder(target, len(colours) - len(problems), tuple(problems))


def _write(
    relighter: Relighter,
    source: Path,
    target: Path,
    colours: list[_Colour],
    depth_files: list[str],
    device: Camera | None,
    progress: Callable[[int, int], None] | None,
) -> list[str]:
    """Write all files; say which colour images could not be relit."""
    try:
        for name in _LISTS:
            (target / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot replace {target / name}: {error.strerror or error}") from error
    for file in (*depth_files, *_beside(source)):
        _copy(source, target, file)

    def do(colour: _Colour) -> str | None:
        return _relight_file(relighter, source, target, colour, device)

    problems = []
    with ThreadPoolExecutor(max_workers=2) as pool:
        try:
            for done, problem in enumerate(pool.map(do, colours), start=1):
                if problem is not None:
                    problems.append(problem)
                if progress is not None:
                    progress(done, len(colours))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    if len(problems) == len(colours):
        raise DatasetError(f"{source}: no colour image can be relit; first: {problems[0]}")
    for name in _LISTS:
        _copy(source, target, name)
    return problems


def _command(
    source: Path,
    target: Path,
    options: Mapping[str, object],
    jumps: Sequence[float] | None,
    camera: Camera | str | os.PathLike[str] | None,
) -> str:
    """Say how the same is done in a terminal, wherever that is."""
    words = ["edvo", "relight", str(source.absolute()), str(target.absolute())]
    for name, value in options.items():
        if value is not None:
            words += [f"--{name}", str(value)]
    for instant in jumps or ():
        words += ["--jump", str(instant)]
    if isinstance(camera, str | os.PathLike):
        words += ["--camera", os.fspath(camera)]
    return shlex.join([*words, "--force"])


def _relight_file(
    relighter: Relighter, source: Path, target: Path, colour: _Colour, camera: Camera | None
) -> str | None:
    """Relight one file, or say what is wrong with it."""
    suffix = PurePosixPath(colour.file).suffix.lower()
    try:
        if suffix not in _CODECS:
            raise FrameError(f"{source / colour.file} is neither PNG nor JPEG")
        image = load_image(source / colour.file)
        if image.dtype != np.uint8:
            raise FrameError(f"{source / colour.file} has {image.dtype} values, not 8 bits")
        depth = None
        if camera is not None and colour.depth_file is not None:
            depth = _load_depth(source / colour.depth_file, camera)
        relit = relighter.relight(np.asarray(image, np.uint8), depth, camera, colour.t)
    except FrameError as error:
        _copy(source, target, colour.file)
        return str(error)
    extension, options = _CODECS[suffix]
    path = target / colour.file
    _make_folder(path.parent)
    write_atomically(path, cv2.imencode(extension, relit, options)[1].tobytes())
    return None


def _load_depth(path: Path, camera: Camera) -> NDArray[np.float32]:
    depth = load_image(path)
    if depth.ndim != 2 or depth.dtype != np.uint16:
        raise FrameError(f"{path} is no depth image of one 16-bit value a pixel")
    return depth.astype(np.float32) / np.float32(camera.depth_scale)


def _read_lists(source: Path) -> tuple[list[_Colour], list[str]]:
    """Find the colour images with their times from the first, and all depth images."""
    colour_list = source / tum.COLOUR_LIST
    if colour_list.is_file():
        colours = tum.read_list(colour_list)
        depth_list = source / tum.DEPTH_LIST
        depths = tum.read_list(depth_list) if depth_list.is_file() else []
    else:
        joint = next((source / n for n in tum.PAIR_LISTS if (source / n).is_file()), None)
        if joint is None:
            raise DatasetError(f"{source}: no {tum.COLOUR_LIST}; give {tum.TumFormat.layout}")
        pairs = tum.read_pairs(joint)
        colours = pairs
        depths = [tum.Row(row.line, row.stamp, row.time, row.files[1:]) for row in pairs]
    unit = 1 / tum.INDEX_RATE_HZ if all(tum.is_index(row.stamp) for row in colours) else 1.0
    times = np.array([row.time for row in colours]) * unit
    partner: list[str | None] = [None] * len(colours)
    if depths:
        # Shading needs no depth of the very instant: the nearest one will do for every image.
        ordered = sorted(depths, key=lambda row: row.time)
        nearest = nearest_indices(np.array([row.time for row in ordered]) * unit, times)
        partner = [ordered[i].files[0] for i in nearest]
    found = [
        _Colour(row.files[0], float(t - times.min()), depth)
        for row, t, depth in zip(colours, times, partner, strict=True)
    ]
    depth_files = [row.files[0] for row in depths]
    for file in (*(colour.file for colour in found), *depth_files):
        if PurePosixPath(file).is_absolute() or ".." in PurePosixPath(file).parts:
            raise DatasetError(f"{source}: the lists name {file}, outside of the folder; mend them")
    return found, depth_files


def _beside(source: Path) -> list[str]:
    """List what lies in the folder itself: ground truth, camera, notes."""
    files = (entry.name for entry in source.iterdir() if entry.is_file())
    return sorted(name for name in files if name not in _LISTS and not name.startswith("."))


def _copy(source: Path, target: Path, file: str) -> None:
    """Copy a file if it is there; what the source lacks, its copy lacks too."""
    path = source / file
    if not path.is_file():
        return
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror or error}") from error
    _make_folder((target / file).parent)
    write_atomically(target / file, content)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make {folder}: {error.strerror or error}") from error
