"""ICL-NUIM as POV-Ray rendered it (Handa et al., ICRA 2014), before anybody converted it.

::

    scene_00_0000.png, ...      colour; of the office scene_000.png
    scene_00_0000.depth, ...    text: a number a pixel, the distance along its ray; metres, and
                                centimetres of the office
    scene_00_0000.txt, ...      "cam_pos = [x, y, z]';", cam_dir, cam_up, in the same unit

The world and the camera are left-handed with y up, as in `edvo.datasets.icl`, and turned like it.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.icl import y_down
from edvo.datasets.images import load_colour, make_frame
from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera
from edvo.datasets.listed import CameraChoice, ImagePair, Truth, pair_source
from edvo.datasets.matrices import truth_of
from edvo.datasets.names import images_in, number_in, pair_by_name
from edvo.datasets.source import Source
from edvo.errors import DatasetError, FrameError
from edvo.frame import Frame

DEPTHS = "scene_*.depth"

_METRES, _CENTIMETRES = 1.0, 100.0
_ROOM = 30.0  # no room is so many metres long, and none so few centimetres
_LONGEST_NUMBER = 32  # characters
_TRIED = 10
_LARGEST_TEXT = 10_000  # bytes of a pose; it has some 300
_VECTOR = re.compile(r"^\s*(cam_(?:pos|dir|up))\s*=\s*\[([^\]]*)\]", re.MULTILINE)


class PovRayFormat:
    """The registry's entry for ICL-NUIM's original renders."""

    name = "povray"
    layout = f"a folder with scene_*.png, {DEPTHS} and scene_*.txt"

    def recognise(self, path: Path) -> str | None:
        """Say that distances are there; nothing else has them."""
        return DEPTHS if next(path.glob(DEPTHS), None) is not None else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        depth = sorted(path.glob(DEPTHS), key=lambda file: (float(number_in(file) or -1), file))
        paired = pair_by_name(images_in(path, "scene_*.png"), depth, path)
        published = KNOWN_CAMERAS["icl-nuim"], "the data set's, with y down"
        taken, origin = choose_camera(path, camera, stated=lambda: published)
        unit = _unit(paired.pairs, taken)
        # Distances have a unit of their own, whatever the camera's other files have.
        taken = replace(taken, depth_scale=unit)
        to_depth = _of_rays(taken)

        def load(
            timestamp: float, colour: Path, depth: Path, camera: Camera, depth_delay: float
        ) -> Frame:
            distances = read_distances(depth, camera)
            grey = load_colour(colour)
            metres = distances * to_depth
            return make_frame(timestamp, (colour, grey), (depth, metres), camera, depth_delay)

        return pair_source(
            path,
            paired.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=(taken, origin),
            load=load,
            truth=lambda: _truth(path, paired.pairs, unit),
            warnings=paired.warnings,
            facts={**paired.facts, "distances": "metres" if unit == _METRES else "centimetres"},
        )


def read_distances(file: Path, camera: Camera) -> NDArray[np.float32]:
    """Read distances as they are written.

    Parameters
    ----------
    file : pathlib.Path
        Text.
    camera : Camera
        Of its size.

    Returns
    -------
    ndarray of float32, shape (H, W)
        Along the ray of each pixel, in the file's unit.

    Raises
    ------
    FrameError
        If it cannot be read or holds something else; the message names it.
    """
    wanted = camera.width * camera.height
    try:
        if file.stat().st_size > _LONGEST_NUMBER * wanted:
            raise FrameError(f"{file} has more than {wanted} numbers, which the camera's image has")
        numbers = np.fromstring(file.read_bytes(), sep=" ")
    except OSError as error:
        raise FrameError(f"cannot read {file}: {error.strerror or error}") from error
    except ValueError as error:
        raise FrameError(f"{file} holds something else than numbers") from error
    if numbers.size != wanted:
        raise FrameError(
            f"{file} holds {numbers.size} numbers; the camera is {camera.width}x{camera.height}"
        )
    with np.errstate(over="ignore"):
        return np.asarray(numbers.reshape(camera.height, camera.width), np.float32)


def _unit(pairs: Sequence[ImagePair], camera: Camera) -> float:
    """Tell metres from centimetres by the first image that can be read."""
    problem = ""
    for pair in pairs[:_TRIED]:
        try:
            distances = read_distances(pair.depth, camera)
        except FrameError as error:
            problem = problem or str(error)
            continue
        valid = distances[(distances > 0) & np.isfinite(distances)]
        if valid.size:
            return _METRES if np.median(valid) < _ROOM else _CENTIMETRES
        problem = problem or f"{pair.depth} has no valid distance"
    raise DatasetError(f"{problem}, nor can the files after it be used; download them again")


def _of_rays(camera: Camera) -> NDArray[np.float32]:
    """Give what makes depth along z in metres of a distance along a pixel's ray."""
    v, u = np.indices((camera.height, camera.width))
    pixels = np.column_stack((u.ravel(), v.ravel())).astype(np.float64)
    lengths = np.linalg.norm(camera.backproject(pixels, np.ones(len(pixels))), axis=1)
    metres = 1.0 / (lengths * camera.depth_scale)
    return np.asarray(metres.reshape(camera.height, camera.width), np.float32)


def _truth(path: Path, pairs: Sequence[ImagePair], unit: float) -> Truth:
    there = [(pair, file) for pair in pairs if (file := pair.depth.with_suffix(".txt")).is_file()]
    if not there:
        return None, ()
    try:
        poses = y_down(np.array([_pose(file, unit) for _, file in there]))
    except DatasetError as error:
        return None, (f"ground truth not used: {error}",)
    return truth_of([(pair.stamp, pair.time) for pair, _ in there], list(poses), path)


def _pose(file: Path, unit: float) -> NDArray[np.float64]:
    """Read a camera: its axes are right, up and forward."""
    try:
        with file.open(encoding="utf-8", errors="replace") as opened:
            text = opened.read(_LARGEST_TEXT)
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}") from error
    try:
        found = {
            name: np.array([float(word) for word in values.split(",")]).reshape(3)
            for name, values in _VECTOR.findall(text)
        }
        forward = found["cam_dir"] / np.linalg.norm(found["cam_dir"])
        right = np.cross(found["cam_up"], forward)
        right /= np.linalg.norm(right)
        position = found["cam_pos"] / unit
    except (KeyError, ValueError) as error:
        raise DatasetError(f"{file} has no cam_pos, cam_dir and cam_up of three numbers") from error
    T = np.eye(4)
    T[:3] = np.column_stack((right, np.cross(forward, right), forward, position))
    return T
