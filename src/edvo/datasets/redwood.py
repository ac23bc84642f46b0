"""Folders of Open3D's reconstruction system, and the Redwood and Stanford data in its layout.

::

    color/000000.jpg, ...     colour; the folder may be called image or rgb too
    depth/000000.png, ...     depth, 1000 a metre
    camera_intrinsic.json     {"width", "height", "intrinsic_matrix": nine numbers by columns}
    trajectory.log            optional, five rows a frame: three numbers, then the 4x4 pose,
                              camera to world

Redwood's scans have names such as ``0000012-000000367065`` with microseconds; others no times.
"""

from pathlib import Path
from typing import Any

from edvo.camera import Camera
from edvo.datasets.images import first_size
from edvo.datasets.json_files import camera_of
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, Truth, pair_source
from edvo.datasets.matrices import read_numbers, truth_of
from edvo.datasets.names import Paired, find_folders, images_in, pair_by_name
from edvo.datasets.source import Source
from edvo.errors import CameraError, DatasetError

DEPTH_SCALE = 1000.0
COLOUR_FOLDERS = ("color", "colour", "image", "rgb")

_LARGEST_JSON = 100_000  # bytes; a camera has a few hundred
# What Open3D takes where nothing is said.
_PRIMESENSE = Camera(640, 480, 525.0, 525.0, 319.5, 239.5, depth_scale=DEPTH_SCALE)


class RedwoodFormat:
    """The registry's entry for Open3D's folders."""

    name = "open3d"
    layout = "a folder with color/, depth/ and camera_intrinsic.json or a trajectory .log"

    def recognise(self, path: Path) -> str | None:
        """Say which of its files are there."""
        folders = find_folders(path, COLOUR_FOLDERS)
        if folders is None:
            return None
        files = [file for file in (_intrinsic_file(path), _trajectory_file(path)) if file]
        named = [f"{folder.name}/" for folder in folders] + [file.name for file in files]
        return " and ".join(named) if files else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        folders = find_folders(path, COLOUR_FOLDERS)
        if folders is None:
            raise DatasetError(f"{path}: color/ or depth/ is missing; give {self.layout}")
        paired = pair_by_name(images_in(folders[0]), images_in(folders[1]), path)
        trajectory = _trajectory_file(path)
        return pair_source(
            path,
            paired.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera, stated=lambda: _camera(path, paired)),
            truth=None if trajectory is None else lambda: _truth(trajectory, paired),
            warnings=paired.warnings,
            facts=paired.facts,
        )


def _intrinsic_file(path: Path) -> Path | None:
    files = sorted(path.glob("*.json"), key=lambda file: ("intrinsic" not in file.name, file.name))
    for file in files:
        try:
            if file.stat().st_size <= _LARGEST_JSON and b'"intrinsic_matrix"' in file.read_bytes():
                return file
        except OSError:
            continue
    return files[0] if files and "intrinsic" in files[0].name else None


def _trajectory_file(path: Path) -> Path | None:
    # odometry.log is an estimate of a step at a time.
    files = [file for file in sorted(path.glob("*.log")) if "odometry" not in file.name]
    files += sorted(path.glob("*-traj.txt"))
    return next((file for file in files if "traj" in file.name), None)


def _camera(path: Path, paired: Paired) -> tuple[Camera, str]:
    file = _intrinsic_file(path)
    if file is not None:
        return camera_of(file, _of_json), f"{file.name} in the folder"
    size = first_size(pair.colour for pair in paired.pairs)
    if size != (_PRIMESENSE.width, _PRIMESENSE.height):
        raise DatasetError(
            f"{path}: the camera of {size[0]}x{size[1]} images is not known; put a "
            "camera_intrinsic.json or a camera.yaml in the folder or add --camera FILE"
        )
    return _PRIMESENSE, "Open3D's default (PrimeSense), since there is no camera_intrinsic.json"


def _of_json(content: Any) -> Camera:
    matrix = content["intrinsic_matrix"]
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise CameraError("intrinsic_matrix must be nine numbers, by columns")
    fx, _, _, _, fy, _, cx, cy, _ = matrix
    scale = content.get("depth_scale", DEPTH_SCALE)
    return Camera(content["width"], content["height"], fx, fy, cx, cy, depth_scale=scale)


def _truth(file: Path, paired: Paired) -> Truth:
    try:
        numbers = read_numbers(file)
    except DatasetError as error:
        return None, (f"ground truth not used: {error}",)
    if not numbers.size or numbers.size % 19:
        return None, (f"ground truth not used: {file} has not 3 and 16 numbers a frame",)
    poses = numbers.reshape(-1, 19)[:, 3:].reshape(-1, 4, 4)
    count = min(len(poses), len(paired.pairs))
    truth, warnings = truth_of(paired.frames[:count], list(poses[:count]), file)
    if len(poses) != len(paired.pairs):
        warnings += (
            f"{file} has {len(poses)} poses for {len(paired.pairs)} frames; "
            "taken from the first on",
        )
    return truth, warnings
