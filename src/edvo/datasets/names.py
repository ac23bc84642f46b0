"""Images without a list: what the names of the files tell of their times and partners."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edvo.datasets.association import MAX_DIFFERENCE_S, associate, stamped_delay
from edvo.datasets.listed import ImagePair
from edvo.errors import DatasetError

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".tif", ".tiff", ".bmp"})
"""Of files that are taken for images."""

DEPTH_FOLDERS = ("depth", "depths", "depth_image", "depth_images", "aligned_depth", "depth_aligned")
"""What a folder of depth images may be called."""

RATE_HZ = 30.0
"""Frames a second where nothing tells."""

NO_TIMES = f"the frames have numbers instead of times; taken as {RATE_HZ:g} a second"

# Whole numbers that are times since 1970, from 2001 on: seconds, and parts of them.
_UNITS = ((10**9, 1), (10**12, 10**3), (10**15, 10**6), (10**18, 10**9))
_LATEST = 4  # times the lower bound: the year 2096

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
# Redwood's scans: the number of the frame, then microseconds.
_REDWOOD = re.compile(r"\d{7}-(\d{12})")


@dataclass(frozen=True)
class Paired:
    """Images that belong together.

    Parameters
    ----------
    pairs : tuple of ImagePair
        In order of time, at least one.
    alone : int
        Colour images without a depth image, which are left out.
    timed : bool
        Whether the names are times; the times are made up otherwise.
    """

    pairs: tuple[ImagePair, ...]
    alone: int
    timed: bool

    @property
    def frames(self) -> list[tuple[str, float]]:
        """Stamp and time of each pair."""
        return [(pair.stamp, pair.time) for pair in self.pairs]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong, a line each."""
        if not self.alone:
            return ()
        count = self.alone + len(self.pairs)
        return (f"{self.alone} of {count} colour images have no depth image: left out",)

    @property
    def facts(self) -> dict[str, str]:
        """What a source tells of its times."""
        return {"times": "in the names of the images" if self.timed else NO_TIMES}


def find_folders(path: Path, colour: Sequence[str]) -> tuple[Path, Path] | None:
    """Find the folders of colour and depth images in a recording.

    Parameters
    ----------
    path : pathlib.Path
        The recording.
    colour : sequence of str
        What the colour folder may be called, in order of preference, whatever the case.

    Returns
    -------
    (pathlib.Path, pathlib.Path) or None
        Both, if both are there.
    """
    try:
        there = {entry.name.lower(): entry for entry in sorted(path.iterdir()) if entry.is_dir()}
    except OSError:  # no folder, or none that may be read
        return None
    ours = next((there[name] for name in colour if name in there), None)
    theirs = next((there[name] for name in DEPTH_FOLDERS if name in there), None)
    return None if ours is None or theirs is None else (ours, theirs)


def images_in(folder: Path, pattern: str = "*") -> list[Path]:
    """List the images in a folder.

    Parameters
    ----------
    folder : pathlib.Path
        Where to look; not below it.
    pattern : str
        What their names look like.

    Returns
    -------
    list of pathlib.Path
        In order of the last number in their names, then of the names.
    """
    files = [
        file
        for file in folder.glob(pattern)
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
    ]
    return sorted(files, key=lambda file: (float(number_in(file) or -1), file.name))


def number_in(file: Path) -> str | None:
    """Find the last number in a file's name.

    Parameters
    ----------
    file : pathlib.Path
        Such as ``frame-000012.color.png``.

    Returns
    -------
    str or None
        Such as ``000012``.
    """
    numbers = _NUMBER.findall(file.stem)
    return numbers[-1] if numbers else None


def stamp_of_index(index: int) -> tuple[str, float]:
    """Make up the time of a frame that has a number only.

    Parameters
    ----------
    index : int
        Its number.

    Returns
    -------
    (str, float)
        The time at `RATE_HZ` frames a second, to the microsecond.
    """
    stamp = f"{index / RATE_HZ:.6f}"
    return stamp, float(stamp)


def time_in(file: Path) -> tuple[str, float] | None:
    """Find the time in a file's name, if its number is one.

    Parameters
    ----------
    file : pathlib.Path
        Such as ``1305031102.175304.png`` or ``1403636579763555584.png`` (nanoseconds).

    Returns
    -------
    (str, float) or None
        Seconds, as text with all digits, and as a number.
    """
    redwood = _REDWOOD.fullmatch(file.stem)
    number = redwood.group(1) if redwood else number_in(file)
    if number is None:
        return None
    if "." in number:
        return number, float(number)
    units = (unit for least, unit in _UNITS if least <= int(number) < _LATEST * least)
    unit = 10**6 if redwood else next(units, None)
    if unit is None:
        return None
    decimals = max(len(str(unit)) - 1, 6)
    scaled = int(number) * 10**decimals // unit
    stamp = f"{scaled // 10**decimals}.{scaled % 10**decimals:0{decimals}d}"
    return stamp, float(stamp)


def pair_by_name(colour: Sequence[Path], depth: Sequence[Path], where: Path) -> Paired:
    """Find which colour image belongs to which depth image.

    Parameters
    ----------
    colour, depth : sequence of pathlib.Path
        Images as `images_in` lists them.
    where : pathlib.Path
        Named in errors.

    Returns
    -------
    Paired
        Where all names are times, colour and depth belong together within 20 ms; else names with
        the same last number, or the same names, do.

    Raises
    ------
    DatasetError
        If there is no pair.
    """
    if not colour or not depth:
        kind = "depth" if colour else "colour"
        raise DatasetError(f"{where}: there are no {kind} images; put them beside the others")
    times = [time_in(file) for file in (*colour, *depth)]
    stamped = [time for time in times if time is not None]
    timed = len(stamped) == len(times)
    if timed:
        pairs = _by_time(colour, depth, stamped)
    else:
        pairs = _by_number(colour, depth) or _by_stem(colour, depth)
    if not pairs:
        raise DatasetError(
            f"{where}: no colour image has a depth image of the same name, number or time "
            f"(colour {colour[0].name} to {colour[-1].name}, depth {depth[0].name} to "
            f"{depth[-1].name}); name them alike"
        )
    return Paired(tuple(pairs), len(colour) - len(pairs), timed)


def _by_time(
    colour: Sequence[Path], depth: Sequence[Path], stamped: list[tuple[str, float]]
) -> list[ImagePair]:
    # Of files with one time, which only numbers of too many digits can have, one is enough.
    first = {time: (stamp, file) for (stamp, time), file in zip(stamped, colour, strict=False)}
    second = dict(zip((time for _, time in stamped[len(colour) :]), depth, strict=True))
    ours, theirs = sorted(first), sorted(second)
    kept, partners = associate(np.array(ours), np.array(theirs), max_difference=MAX_DIFFERENCE_S)
    return [
        ImagePair(
            first[ours[i]][0],
            ours[i],
            first[ours[i]][1],
            second[theirs[j]],
            stamped_delay(ours[i], theirs[j]),
        )
        for i, j in zip(kept.tolist(), partners.tolist(), strict=True)
    ]


def _by_number(colour: Sequence[Path], depth: Sequence[Path]) -> list[ImagePair]:
    first = {number: file for file in colour if (number := number_in(file)) is not None}
    second = {number: file for file in depth if (number := number_in(file)) is not None}
    if len(first) < len(colour) or len(second) < len(depth):
        return []  # a number twice, or none
    numbered = {int(float(number)): file for number, file in second.items()}
    pairs = []
    for number, file in first.items():
        index = int(float(number))
        if index in numbered:
            pairs.append(ImagePair(*stamp_of_index(index), file, numbered[index]))
    return pairs


def _by_stem(colour: Sequence[Path], depth: Sequence[Path]) -> list[ImagePair]:
    partners = {file.stem: file for file in depth}
    both = [file for file in colour if file.stem in partners]
    return [
        ImagePair(*stamp_of_index(index), file, partners[file.stem])
        for index, file in enumerate(both)
    ]
