"""Sources whose frames are known by a list of times: what most readers have in common."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.images import load_frame
from edvo.datasets.source import Reading, check_index, describe_timing
from edvo.errors import FrameError, ImageSizeError
from edvo.frame import Frame
from edvo.trajectory import Trajectory

CameraChoice = Camera | str | os.PathLike[str] | None
"""What a user may say of the camera: itself, its name, its file, or nothing."""

Truth = tuple[Trajectory | None, tuple[str, ...]]
"""True poses, if there are any, and what is wrong with them, a line each."""


@dataclass(frozen=True)
class ImagePair:
    """The two images of a frame.

    Parameters
    ----------
    stamp : str
        Its time as the source writes it, or as it is made up.
    time : float
        Seconds.
    colour, depth : pathlib.Path
        The images.
    depth_delay : float
        Seconds from the stamp of the colour image to that of the depth image.
    """

    stamp: str
    time: float
    colour: Path
    depth: Path
    depth_delay: float = 0.0


class ListedSource:
    """Frames that are loaded one by one; fulfils `edvo.datasets.Source`.

    Parameters
    ----------
    path : pathlib.Path
        Where the recording lies.
    format : str
        Name of its format.
    recognised_by : str or None
        By what the format was recognised; None if it was not, but forced.
    stamps : sequence of str
        Time of each frame, as text.
    times : sequence of float
        The same in seconds, increasing.
    load : callable
        Gives the frame of an index, or raises `FrameError` with a message that names the file;
        called from several threads at once.
    camera : (Camera, str)
        The camera of the frames, and where its numbers come from.
    truth : callable, optional
        Reads the true poses; called once, when they are asked for.
    warnings : sequence of str
        What looks wrong with the recording, a line each.
    facts : mapping, optional
        What else `describe` tells.
    colour_files : sequence of pathlib.Path, optional
        The file of each frame's colour image, where it has one; exports name their images by them.
    """

    def __init__(
        self,
        path: Path,
        *,
        format: str,
        recognised_by: str | None,
        stamps: Sequence[str],
        times: Sequence[float],
        load: Callable[[int], Frame],
        camera: tuple[Camera, str],
        truth: Callable[[], Truth] | None = None,
        warnings: Sequence[str] = (),
        facts: Mapping[str, Any] | None = None,
        colour_files: Sequence[Path] | None = None,
    ) -> None:
        self.path = path
        self.name = path.name
        self.format = format
        self.stamps = tuple(stamps)
        self.timestamps: NDArray[np.float64] = np.array(times, np.float64)
        self.timestamps.flags.writeable = False
        self.camera, self.camera_origin = camera
        self._recognised_by = recognised_by
        self._load = load
        self._truth = truth
        self._warnings = tuple(warnings)
        self._facts = dict(facts or {})
        self.colour_files = None if colour_files is None else tuple(colour_files)

    def __len__(self) -> int:
        return len(self.stamps)

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

        Raises
        ------
        DatasetError
            Where there is no frame of that index.
        """
        check_index(index, self.stamps, self.name)
        frame, problem, size = None, None, None
        try:
            frame = self._load(index)
        except FrameError as error:
            problem = str(error)
            size = error.size if isinstance(error, ImageSizeError) else None
        time = float(self.timestamps[index])
        return Reading(index, self.stamps[index], time, frame, problem, size)

    @cached_property
    def ground_truth(self) -> Trajectory | None:
        """True poses; None if there are none, or none that can be read (see `warnings`)."""
        return self._found_truth[0]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks wrong with the recording and its ground truth, a line each."""
        return (*self._warnings, *self._found_truth[1])

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the recording, in plain types.

        Returns
        -------
        dict
            ``name``, ``path``, ``format``, ``recognised_by``, ``camera`` (with ``origin``),
            what the format adds, what `describe_timing` gives, ``ground_truth`` (None, or its
            ``poses``, ``duration_s`` and the ``frames`` it covers) and ``warnings``.
        """
        truth = self.ground_truth
        described: dict[str, Any] = {
            "name": self.name,
            "path": str(self.path),
            "format": self.format,
            "recognised_by": self._recognised_by,
            "camera": {**self.camera.to_dict(), "origin": self.camera_origin},
            **self._facts,
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

    @cached_property
    def _found_truth(self) -> Truth:
        if self._truth is None:
            return None, ()
        truth, warnings = self._truth()
        if truth is not None:
            first, last = truth.timestamps[[0, -1]]
            if first > self.timestamps[-1] or last < self.timestamps[0]:
                warnings += (
                    f"ground truth ({truth.stamps[0]} to {truth.stamps[-1]}) has no time in "
                    f"common with the images ({self.stamps[0]} to {self.stamps[-1]})",
                )
        return truth, warnings


def pair_source(
    path: Path,
    pairs: Sequence[ImagePair],
    *,
    format: str,
    recognised_by: str | None,
    camera: tuple[Camera, str],
    load: Callable[[float, Path, Path, Camera, float], Frame] = load_frame,
    truth: Callable[[], Truth] | None = None,
    warnings: Sequence[str] = (),
    facts: Mapping[str, Any] | None = None,
) -> ListedSource:
    """Make a source of image files.

    Parameters
    ----------
    path : pathlib.Path
        Where the recording lies.
    pairs : sequence of ImagePair
        Its frames, in order of time.
    load : callable
        Makes a frame of a time, a colour file, a depth file, the camera and the depth's delay.
    format, recognised_by, camera, truth, warnings, facts
        See `ListedSource`.

    Returns
    -------
    ListedSource
        The source.
    """

    def load_pair(index: int) -> Frame:
        pair = pairs[index]
        return load(pair.time, pair.colour, pair.depth, camera[0], pair.depth_delay)

    return ListedSource(
        path,
        format=format,
        recognised_by=recognised_by,
        stamps=[pair.stamp for pair in pairs],
        times=[pair.time for pair in pairs],
        load=load_pair,
        camera=camera,
        truth=truth,
        warnings=warnings,
        facts=facts,
        colour_files=[pair.colour for pair in pairs],
    )
