"""TUM RGB-D folders, and what shares their layout: ICL-NUIM's "TUM compatible" files, Bonn.

::

    rgb.txt           rows of "timestamp filename", colour or grey images, 8 bit, PNG or JPEG
    depth.txt         the same for 16-bit depth images, registered to colour
    associations.txt  instead of both: "timestamp filename timestamp filename", either order
    groundtruth.txt   optional, "timestamp tx ty tz qx qy qz qw", camera to world
    camera.yaml       optional, see `edvo.datasets.known_cameras.choose_camera`

ICL-NUIM numbers its frames instead of timing them. Such stamps stay as they are in text, and
count as thirtieths of a second.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.association import MAX_DIFFERENCE_S, associate, stamped_delay
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ImagePair, Truth, pair_source
from edvo.datasets.names import number_in
from edvo.datasets.source import Source
from edvo.datasets.text_files import check_size, read_text
from edvo.errors import DatasetError, TrajectoryError
from edvo.trajectory import Trajectory

COLOUR_LIST = "rgb.txt"
DEPTH_LIST = "depth.txt"
PAIR_LISTS = ("associations.txt", "association.txt", "associate.txt", "associated.txt")
GROUND_TRUTH = "groundtruth.txt"

OTHER_COLOUR_LISTS = ("color.txt", "colour.txt", "images.txt", "image.txt")
"""What others call the list of colour images; see `edvo.datasets.generic`."""

INDEX_RATE_HZ = 30.0
"""Frames a second where stamps are frame numbers (ICL-NUIM's rate)."""

# Larger whole numbers are times since 1970.
_INDEX_LIMIT = 1_000_000

# Colour images without depth are usual (4 % in the TUM excerpts at hand) up to about this share.
_USUAL_LOSS = 0.1

# Names in another order than times mean something only where nearly all of many are in order.
_FEWEST_NAMED = 10
_FEW_MISNAMED = 0.1

_WITHIN = f"within {MAX_DIFFERENCE_S * 1e3:g} ms"


@dataclass(frozen=True)
class Row:
    """A row of a list of images.

    Parameters
    ----------
    line : int
        Where it stands in its file, from 1.
    stamp : str
        Its time as it is written.
    time : float
        The same as a number.
    files : tuple of str
        Names relative to the folder: one, or colour and depth.
    depth_delay : float
        From the time of colour to that of depth, where there are both.
    """

    line: int
    stamp: str
    time: float
    files: tuple[str, ...]
    depth_delay: float = 0.0


class TumFormat:
    """The registry's entry for TUM RGB-D folders."""

    name = "tum"
    layout = f"a folder with {COLOUR_LIST} and {DEPTH_LIST}, or {PAIR_LISTS[0]}"

    def recognise(self, path: Path) -> str | None:
        """Say which of the lists are there; one is enough, so that `open` can miss the other."""
        lists = lists_in(path)
        other = any((path / name).is_file() for name in OTHER_COLOUR_LISTS)
        return None if lists == DEPTH_LIST and other else lists

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder: its colour images that have a depth image."""
        listed = read_lists(path)
        return pair_source(
            path,
            listed.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera),
            truth=lambda: read_truth(path / GROUND_TRUTH, listed),
            warnings=listed.warnings,
            facts=listed.facts,
        )


@dataclass(frozen=True)
class Listed:
    """What the lists of a folder hold.

    Parameters
    ----------
    pairs : tuple of ImagePair
        The frames, in order of time.
    by_index : bool
        Whether the stamps are frame numbers.
    without_depth : int
        Colour images that are left out.
    warnings : tuple of str
        What looks wrong with the lists, a line each.
    """

    pairs: tuple[ImagePair, ...]
    by_index: bool
    without_depth: int
    warnings: tuple[str, ...]

    @property
    def facts(self) -> dict[str, Any]:
        """What a source tells of its lists."""
        return {"colour_images_without_depth": self.without_depth}


def lists_in(folder: Path) -> str | None:
    """Say which of the lists are in a folder.

    Parameters
    ----------
    folder : pathlib.Path
        Where to look.

    Returns
    -------
    str or None
        Their names, for people; None if there is none.
    """
    names = (COLOUR_LIST, DEPTH_LIST, *PAIR_LISTS)
    return " and ".join(name for name in names if (folder / name).is_file()) or None


def read_lists(
    folder: Path, *, colour_list: str = COLOUR_LIST, depth_list: str = DEPTH_LIST
) -> Listed:
    """Read which images a folder holds, and which belong together.

    Parameters
    ----------
    folder : pathlib.Path
        With a colour and a depth list, or a list of pairs.
    colour_list, depth_list : str
        Their names.

    Returns
    -------
    Listed
        The colour images that have a depth image.

    Raises
    ------
    DatasetError
        If a list is missing, empty or has a bad row, or no image has a partner.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder} is not a folder; give {TumFormat.layout}")
    warnings: list[str] = []

    def in_order(name: str, rows: list[Row]) -> list[Row]:
        rows, told = _in_order(name, rows)
        warnings.extend(told)
        return rows

    without_depth = 0
    separate = [name for name in (colour_list, depth_list) if (folder / name).is_file()]
    joint = next((name for name in PAIR_LISTS if (folder / name).is_file()), None)
    if len(separate) == 2:
        colour, depth = (in_order(name, read_list(folder / name)) for name in separate)
        rows = _associate(folder, separate, colour, depth)
        without_depth = len(colour) - len(rows)
        if without_depth > _USUAL_LOSS * len(colour):
            warnings.append(
                f"{without_depth} of {len(colour)} colour images have no depth image "
                f"{_WITHIN}: left out"
            )
    elif joint is not None:
        rows = in_order(joint, read_pairs(folder / joint))
    else:
        missing = depth_list if colour_list in separate else colour_list
        raise DatasetError(f"{folder}: {missing} is missing; give {TumFormat.layout}")

    by_index = all(is_index(row.stamp) for row in rows)
    if by_index:
        warnings.append(f"stamps are frame numbers; taken as {INDEX_RATE_HZ:g} frames a second")
    unit = 1.0 / INDEX_RATE_HZ if by_index else 1.0
    pairs = tuple(
        ImagePair(
            row.stamp,
            row.time * unit,
            folder / row.files[0],
            folder / row.files[1],
            row.depth_delay * unit,
        )
        for row in rows
    )
    return Listed(pairs, by_index, without_depth, tuple(warnings))


def read_truth(
    file: Path,
    listed: Listed,
    correct: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> Truth:
    """Read the true poses of a folder.

    Parameters
    ----------
    file : pathlib.Path
        TUM trajectory; it need not exist.
    listed : Listed
        The images; where they are numbered, poses with numbers are numbered alike.
    correct : callable, optional
        Makes of the file's poses, (N, 4, 4), those of the camera, ``T_world_cam``.

    Returns
    -------
    (Trajectory or None, tuple of str)
        The poses if they can be read, and what is wrong.
    """
    if not file.exists():
        return None, ()
    try:
        check_size(file, "it must hold poses")
        truth = Trajectory.read(file)
    except (DatasetError, TrajectoryError) as error:
        return None, (f"ground truth not used: {error}",)
    times, poses = truth.timestamps, truth.poses
    if listed.by_index and all(is_index(stamp) for stamp in truth.stamps):
        times = times / INDEX_RATE_HZ
    if correct is not None:
        poses = correct(poses)
    return Trajectory(times, poses, truth.stamps), ()


def _associate(
    folder: Path, lists: Sequence[str], colour: list[Row], depth: list[Row]
) -> list[Row]:
    kept, partners = associate(
        np.array([row.time for row in colour]), np.array([row.time for row in depth])
    )
    if not len(kept):
        raise DatasetError(
            f"{folder}: no colour image has a depth image {_WITHIN} (colour {colour[0].stamp}"
            f" to {colour[-1].stamp}, depth {depth[0].stamp} to {depth[-1].stamp}); "
            f"check the times in {' and '.join(lists)}"
        )
    return [
        replace(
            colour[i],
            files=colour[i].files + depth[j].files,
            depth_delay=stamped_delay(colour[i].time, depth[j].time),
        )
        for i, j in zip(kept.tolist(), partners.tolist(), strict=True)
    ]


def _in_order(name: str, rows: list[Row]) -> tuple[list[Row], list[str]]:
    """Sort rows by time, each time once; and tell what was wrong."""
    warnings = []
    back = [row for before, row in pairwise(rows) if row.time < before.time]
    if back:
        warnings.append(
            f"{name}: {len(back)} rows go back in time (first: line {back[0].line}): sorted"
        )
    warnings += [] if back else _misnamed(name, rows)
    kept: dict[float, Row] = {}
    again = [row for row in rows if kept.setdefault(row.time, row) is not row]
    if again:
        warnings.append(
            f"{name}: {len(again)} rows repeat a time (first: line {again[0].line}): left out"
        )
    return [kept[time] for time in sorted(kept)], warnings


def _misnamed(name: str, rows: list[Row]) -> list[str]:
    """Tell of a few files whose numbers are not in the order of their times."""
    if len(rows) < _FEWEST_NAMED:
        return []
    warnings = []
    for files in zip(*(row.files for row in rows), strict=True):
        numbers = [number_in(Path(file)) for file in files]
        values = [float(number) for number in numbers if number is not None]
        odd = [i for i, (before, value) in enumerate(pairwise(values), 1) if value < before]
        if len(values) == len(rows) and 0 < len(odd) <= _FEW_MISNAMED * len(rows):
            warnings.append(
                f"{name}: {len(odd)} file names are not in the order of their times (first: line "
                f"{rows[odd[0]].line}, {files[odd[0]]}): check which time is whose"
            )
    return warnings


def read_list(file: Path) -> list[Row]:
    """Read a list of images, with rows of ``timestamp filename``.

    Parameters
    ----------
    file : pathlib.Path
        Such as ``rgb.txt``.

    Returns
    -------
    list of Row
        In the order of the file, each with one file name.

    Raises
    ------
    DatasetError
        If the file cannot be read, is empty or has a bad row; the message names the line.
    """
    return [
        Row(line, stamp, _time(stamp, file, line), (name,))
        for line, (stamp, name) in _fields(file, "timestamp filename")
    ]


def read_pairs(file: Path) -> list[Row]:
    """Read a list of pairs, with rows of ``timestamp filename timestamp filename``.

    Parameters
    ----------
    file : pathlib.Path
        Such as ``associations.txt``; colour or depth may come first.

    Returns
    -------
    list of Row
        In the order of the file, with the time of the colour image; its name, then the depth's.

    Raises
    ------
    DatasetError
        If the file cannot be read, is empty or has a bad row; the message names the line.
    """
    rows = []
    for line, (stamp, name, other_stamp, other_name) in _fields(
        file, "timestamp filename timestamp filename"
    ):
        # ICL-NUIM writes depth first, TUM's tool whatever it is given: the folders tell.
        if name.lower().startswith("depth"):
            stamp, other_stamp, name, other_name = other_stamp, stamp, other_name, name
        time = _time(stamp, file, line)
        try:
            delay = stamped_delay(time, _time(other_stamp, file, line))
        except DatasetError:  # the time of depth is not needed
            delay = 0.0
        rows.append(Row(line, stamp, time, (name, other_name), delay))
    return rows


def _fields(file: Path, wanted: str) -> list[tuple[int, list[str]]]:
    """Split the rows of a list, with their line numbers; only the last field may hold blanks."""
    text = read_text(file, f"give rows of '{wanted}'")
    rows = []
    for line, content in enumerate(text.split("\n"), start=1):
        row = content.strip()
        if not row or row.startswith("#"):
            continue
        count = len(wanted.split())
        fields = re.split(r"\s*,\s*|\s+", row, maxsplit=count - 1)
        if len(fields) != count or not all(fields):
            raise DatasetError(
                f"{file}:{line}: '{row}' is no '{wanted}'; correct or remove the row"
            )
        rows.append((line, fields))
    if not rows:
        raise DatasetError(f"{file}: the list is empty; give rows of '{wanted}'")
    return rows


def _time(stamp: str, file: Path, line: int) -> float:
    try:
        time = float(stamp)
    except ValueError:
        time = math.nan
    if not math.isfinite(time):
        raise DatasetError(f"{file}:{line}: '{stamp}' is no time; correct or remove the row")
    return time


def is_index(stamp: str) -> bool:
    """Say whether a stamp is a frame number rather than a time.

    Parameters
    ----------
    stamp : str
        As it is written.

    Returns
    -------
    bool
        True for whole numbers too small to be times since 1970.
    """
    # A number of thousands of digits is damage, and Python refuses to read it as an integer.
    return stamp.isdecimal() and float(stamp) < _INDEX_LIMIT
