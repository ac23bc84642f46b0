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
import os
import re
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.association import MAX_DIFFERENCE_S, associate
from edvo.datasets.images import load_reading
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.source import Reading, Source, describe_timing
from edvo.errors import DatasetError, TrajectoryError
from edvo.trajectory import Trajectory

COLOUR_LIST = "rgb.txt"
DEPTH_LIST = "depth.txt"
PAIR_LISTS = ("associations.txt", "association.txt", "associate.txt")
GROUND_TRUTH = "groundtruth.txt"

INDEX_RATE_HZ = 30.0
"""Frames a second where stamps are frame numbers (ICL-NUIM's rate)."""

# Larger whole numbers are times since 1970.
_INDEX_LIMIT = 1_000_000

# Colour images without depth are usual (4 % in the TUM excerpts at hand) up to about this share.
_USUAL_LOSS = 0.1


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
    """

    line: int
    stamp: str
    time: float
    files: tuple[str, ...]


class TumFormat:
    """The registry's entry for TUM RGB-D folders."""

    name = "tum"
    layout = f"a folder with {COLOUR_LIST} and {DEPTH_LIST}, or {PAIR_LISTS[0]}"

    def recognise(self, path: Path) -> str | None:
        """Say which of the lists are there; one is enough, so that `open` can miss the other."""
        lists = [name for name in (COLOUR_LIST, DEPTH_LIST, *PAIR_LISTS) if (path / name).is_file()]
        return " and ".join(lists) or None

    def open(self, path: Path, *, camera: Camera | str | os.PathLike[str] | None = None) -> Source:
        """Open a folder; see `TumSource`."""
        return TumSource(path, camera=camera)


class TumSource:
    """The frames of a TUM RGB-D folder: colour images that have a depth image.

    Parameters
    ----------
    path : pathlib.Path
        The folder.
    camera : Camera, path-like or str, optional
        Instead of what the folder says.

    Raises
    ------
    DatasetError
        If a list is missing, empty or has a bad row, or no image has a partner, or nothing tells
        the camera.
    CameraError
        If the camera file is wrong.
    """

    format = TumFormat.name

    def __init__(
        self, path: Path, *, camera: Camera | str | os.PathLike[str] | None = None
    ) -> None:
        if not path.is_dir():
            raise DatasetError(f"{path} is not a folder; give {TumFormat.layout}")
        self.path = path
        self.name = path.name
        self._warnings: list[str] = []
        self._without_depth = 0
        rows = self._read_lists()
        self.camera, self.camera_origin = choose_camera(path, camera)
        self.stamps = tuple(row.stamp for row in rows)
        self._by_index = all(is_index(stamp) for stamp in self.stamps)
        times = np.array([row.time for row in rows])
        if self._by_index:
            times = times / INDEX_RATE_HZ
            self._warnings.append(
                f"stamps are frame numbers; taken as {INDEX_RATE_HZ:g} frames a second"
            )
        times.flags.writeable = False
        self.timestamps: NDArray[np.float64] = times
        self._rows = rows

    def __len__(self) -> int:
        return len(self._rows)

    def read(self, index: int) -> Reading:
        """Read a frame, or say what is wrong with it.

        Parameters
        ----------
        index : int
            Which one, from 0.

        Returns
        -------
        Reading
            With a frame or with a problem.
        """
        row = self._rows[index]
        colour, depth = (self.path / file for file in row.files)
        time = float(self.timestamps[index])
        return load_reading(index, row.stamp, time, colour, depth, self.camera)

    @cached_property
    def ground_truth(self) -> Trajectory | None:
        """True poses; None if there is no file, or none that can be read (see `warnings`)."""
        return self._ground_truth[0]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong with the lists and the ground truth, a line each."""
        return (*self._warnings, *self._ground_truth[1])

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the folder, in plain types.

        Returns
        -------
        dict
            ``name``, ``path``, ``format``, ``recognised_by``, ``camera`` (with ``origin``),
            ``colour_images_without_depth``, what `describe_timing` gives, ``ground_truth`` (None,
            or its ``poses``, ``duration_s`` and the ``frames`` it covers) and ``warnings``.
        """
        truth = self.ground_truth
        described: dict[str, Any] = {
            "name": self.name,
            "path": str(self.path),
            "format": self.format,
            "recognised_by": TumFormat().recognise(self.path),
            "camera": {**self.camera.to_dict(), "origin": self.camera_origin},
            "colour_images_without_depth": self._without_depth,
            **describe_timing(self.timestamps),
            "ground_truth": None,
        }
        if truth is not None:
            first, last = truth.timestamps[[0, -1]]
            covered = (self.timestamps >= first) & (self.timestamps <= last)
            described["ground_truth"] = {
                "poses": len(truth),
                "duration_s": float(last - first),
                "frames": int(np.count_nonzero(covered)),
            }
        described["warnings"] = list(self.warnings)
        return described

    def _read_lists(self) -> list[Row]:
        """Rows of a colour and a depth file, in order of time."""
        separate = [name for name in (COLOUR_LIST, DEPTH_LIST) if (self.path / name).is_file()]
        joint = next((name for name in PAIR_LISTS if (self.path / name).is_file()), None)
        if len(separate) == 2:
            colour, depth = (self._in_order(name, read_list(self.path / name)) for name in separate)
            return self._associate(colour, depth)
        if joint is not None:
            return self._in_order(joint, read_pairs(self.path / joint))
        missing = DEPTH_LIST if COLOUR_LIST in separate else COLOUR_LIST
        raise DatasetError(f"{self.path}: {missing} is missing; give {TumFormat.layout}")

    def _associate(self, colour: list[Row], depth: list[Row]) -> list[Row]:
        kept, partners = associate(
            np.array([row.time for row in colour]), np.array([row.time for row in depth])
        )
        self._without_depth = len(colour) - len(kept)
        within = f"within {MAX_DIFFERENCE_S * 1e3:g} ms"
        if not len(kept):
            raise DatasetError(
                f"{self.path}: no colour image has a depth image {within} (colour {colour[0].stamp}"
                f" to {colour[-1].stamp}, depth {depth[0].stamp} to {depth[-1].stamp}); "
                f"check the times in {COLOUR_LIST} and {DEPTH_LIST}"
            )
        if self._without_depth > _USUAL_LOSS * len(colour):
            self._warnings.append(
                f"{self._without_depth} of {len(colour)} colour images have no depth image "
                f"{within}: left out"
            )
        return [
            replace(colour[i], files=colour[i].files + depth[j].files)
            for i, j in zip(kept.tolist(), partners.tolist(), strict=True)
        ]

    def _in_order(self, name: str, rows: list[Row]) -> list[Row]:
        back = [row for before, row in pairwise(rows) if row.time < before.time]
        if back:
            self._warnings.append(
                f"{name}: {len(back)} rows go back in time (first: line {back[0].line}): sorted"
            )
        kept: dict[float, Row] = {}
        again = [row for row in rows if kept.setdefault(row.time, row) is not row]
        if again:
            self._warnings.append(
                f"{name}: {len(again)} rows repeat a time (first: line {again[0].line}): left out"
            )
        return [kept[time] for time in sorted(kept)]

    @cached_property
    def _ground_truth(self) -> tuple[Trajectory | None, tuple[str, ...]]:
        file = self.path / GROUND_TRUTH
        if not file.exists():
            return None, ()
        try:
            truth = Trajectory.read(file)
        except TrajectoryError as error:
            return None, (f"ground truth not used: {error}",)
        if self._by_index and all(is_index(stamp) for stamp in truth.stamps):
            truth = Trajectory(truth.timestamps / INDEX_RATE_HZ, truth.poses, truth.stamps)
        first, last = truth.timestamps[[0, -1]]
        if first > self.timestamps[-1] or last < self.timestamps[0]:
            return truth, (
                f"{GROUND_TRUTH} ({truth.stamps[0]} to {truth.stamps[-1]}) has no time in common "
                f"with the images ({self.stamps[0]} to {self.stamps[-1]})",
            )
        return truth, ()


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
            rows.append(Row(line, other_stamp, _time(other_stamp, file, line), (other_name, name)))
        else:
            rows.append(Row(line, stamp, _time(stamp, file, line), (name, other_name)))
    return rows


def _fields(file: Path, wanted: str) -> list[tuple[int, list[str]]]:
    """Split the rows of a list, with their line numbers; only the last field may hold blanks."""
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DatasetError(f"{file} is no text file; give rows of '{wanted}'") from error
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
    return stamp.isdecimal() and int(stamp) < _INDEX_LIMIT
