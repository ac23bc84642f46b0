"""ScanNet's frames as its SensReader extracts them (Dai et al., CVPR 2017).

::

    scene0000_00/frames/color/0.jpg       colour, 1296x968; frames/ may be left out
                 frames/depth/0.png       depth in millimetres, 640x480
                 frames/pose/0.txt        4x4, camera to world; -inf where tracking was lost
                 frames/intrinsic/intrinsic_color.txt, intrinsic_depth.txt    4x4
                                  extrinsic_color.txt, extrinsic_depth.txt    4x4, to the camera

Colour is finer than depth, so it is made as small, and depth is carried into its view. There are
no times: frame N is N thirtieths of a second, also where only some frames were extracted.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.images import first_size
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ImagePair, pair_source
from edvo.datasets.matrices import read_matrix, rigid, truth_of_files
from edvo.datasets.names import images_in, pair_by_name
from edvo.datasets.source import Source
from edvo.datasets.two_cameras import TwoCameras
from edvo.errors import CameraError, DatasetError

DEPTH_SCALE = 1000.0

_FOLDERS = ("color", "depth", "pose", "intrinsic")


class ScanNetFormat:
    """The registry's entry for ScanNet's extracted frames."""

    name = "scannet"
    layout = "a folder with frames/color, depth, pose and intrinsic (or these alone)"

    def recognise(self, path: Path) -> str | None:
        """Say which of its folders are there."""
        frames = _frames_in(path)
        if frames is None:
            return None
        prefix = "" if frames == path else "frames/"
        return " and ".join(f"{prefix}{name}/" for name in _FOLDERS)

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a scene."""
        frames = _frames_in(path)
        if frames is None:
            raise DatasetError(f"{path}: color/, depth/ or intrinsic/ is missing; {self.layout}")
        paired = pair_by_name(images_in(frames / "color"), images_in(frames / "depth"), frames)
        pairs = paired.pairs
        colour, origin = choose_camera(path, camera, stated=lambda: _colour_camera(frames, pairs))
        both, T_rig_colour = _cameras(frames, pairs, colour)
        return pair_source(
            path,
            pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=(both.camera, origin),
            load=both.load,
            truth=lambda: truth_of_files(
                paired.frames,
                [frames / "pose" / f"{pair.colour.stem}.txt" for pair in pairs],
                frames / "pose",
                T_rig_colour,
            ),
            warnings=paired.warnings,
            facts=paired.facts,
        )


def camera_of_matrix(matrix: NDArray[np.float64], size: tuple[int, int], scale: float) -> Camera:
    """Make a camera of an intrinsic matrix.

    Parameters
    ----------
    matrix : ndarray of float64, shape (4, 4)
        Focal lengths and principal point where they always stand.
    size : (int, int)
        Width and height, pixels.
    scale : float
        Depth value of one metre.

    Returns
    -------
    Camera
        Without distortion.

    Raises
    ------
    CameraError
        If a value cannot be.
    """
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Camera(*size, fx=fx, fy=fy, cx=cx, cy=cy, depth_scale=scale)


def _frames_in(path: Path) -> Path | None:
    for folder in (path / "frames", path):
        # Poses may be missing: test scenes have none.
        if all((folder / name).is_dir() for name in ("color", "depth", "intrinsic")):
            return folder
    return None


def _camera(file: Path, size: tuple[int, int]) -> Camera:
    try:
        return camera_of_matrix(read_matrix(file), size, DEPTH_SCALE)
    except CameraError as error:
        raise CameraError(f"{file}: {error}") from error


def _colour_camera(frames: Path, pairs: Sequence[ImagePair]) -> tuple[Camera, str]:
    file = frames / "intrinsic" / "intrinsic_color.txt"
    return _camera(file, first_size(pair.colour for pair in pairs)), "intrinsic/intrinsic_color.txt"


def _cameras(
    frames: Path, pairs: Sequence[ImagePair], colour: Camera
) -> tuple[TwoCameras, NDArray[np.float64]]:
    file = frames / "intrinsic" / "intrinsic_depth.txt"
    depth = _camera(file, first_size(pair.depth for pair in pairs))
    T_colour_rig, T_depth_rig = (_extrinsic(frames, kind) for kind in ("color", "depth"))
    both = TwoCameras(colour, depth, T_colour_rig @ se3.inverse(T_depth_rig))
    return both, se3.inverse(T_colour_rig)


def _extrinsic(frames: Path, kind: str) -> NDArray[np.float64]:
    file = frames / "intrinsic" / f"extrinsic_{kind}.txt"
    if not file.is_file():
        return np.eye(4)
    T_camera_rig = rigid(read_matrix(file))
    if T_camera_rig is None:
        raise DatasetError(f"{file} is no rigid motion; correct it, or remove it if it is none")
    return T_camera_rig
