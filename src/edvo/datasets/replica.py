"""Replica as NICE-SLAM renders it (Straub et al. 2019; Zhu et al., CVPR 2022).

::

    cam_params.json                    {"camera": {w h fx fy cx cy scale}}; here or in the parent
    office0/results/frame000000.jpg    colour
    office0/results/depth000000.png    depth, 6553.5 a metre
    office0/traj.txt                   a row of 16 numbers a frame: the 4x4 pose, camera to world

Camera axes are as here (x right, y down, z forward). There are no times.
"""

from pathlib import Path
from typing import Any

from edvo.camera import Camera
from edvo.datasets.json_files import camera_of
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, Truth, pair_source
from edvo.datasets.matrices import read_numbers, truth_of
from edvo.datasets.names import Paired, images_in, number_in, pair_by_name
from edvo.datasets.source import Source
from edvo.errors import CameraError, DatasetError

IMAGES = "results"
TRUTH = "traj.txt"
CAMERA_FILES = ("cam_params.json", "camera_params.json")

_PUBLISHED = Camera(1200, 680, 600.0, 600.0, 599.5, 339.5, depth_scale=6553.5, name="replica")


class ReplicaFormat:
    """The registry's entry for Replica."""

    name = "replica"
    layout = f"a folder with {TRUTH} and {IMAGES}/frame*.jpg and depth*.png"

    def recognise(self, path: Path) -> str | None:
        """Say that the images are there."""
        found = next((path / IMAGES).glob("frame*.*"), None) is not None
        return f"{IMAGES}/frame*" if found else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        images = path / IMAGES
        paired = pair_by_name(images_in(images, "frame*"), images_in(images, "depth*"), images)
        return pair_source(
            path,
            paired.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera, stated=lambda: _camera(path)),
            truth=lambda: _truth(path / TRUTH, paired),
            warnings=paired.warnings,
            facts=paired.facts,
        )


def _camera(path: Path) -> tuple[Camera, str]:
    for folder in (path, path.parent):
        for name in CAMERA_FILES:
            if (folder / name).is_file():
                return camera_of(folder / name, _of_json), f"{folder.name}/{name}"
    return _PUBLISHED, "the render's usual one, since there is no cam_params.json"


def _of_json(content: Any) -> Camera:
    # Converters write the same without the outer key, and call the scale so.
    values: Any = content.get("camera", content)
    if not isinstance(values, dict):
        raise CameraError(f"camera is {values!r}; it must hold w h fx fy cx cy")
    scale: Any = values.get("scale", values.get("png_depth_scale", _PUBLISHED.depth_scale))
    numbers = {key: values[key] for key in ("fx", "fy", "cx", "cy")}
    return Camera(values["w"], values["h"], **numbers, depth_scale=scale, name="replica")


def _truth(file: Path, paired: Paired) -> Truth:
    if not file.exists():
        return None, ()
    try:
        numbers = read_numbers(file)
    except DatasetError as error:
        return None, (f"ground truth not used: {error}",)
    if numbers.size % 16:
        return None, (f"ground truth not used: {file} has not 16 numbers a row",)
    # A row a frame; of a shortened folder maybe only images are gone, then their numbers tell.
    rows, pairs = numbers.reshape(-1, 4, 4), paired.pairs
    numbered = [int(float(number_in(pair.colour) or -1)) for pair in pairs]
    indices = range(len(pairs)) if len(rows) == len(pairs) else numbered
    there = [(row, pair) for row, pair in zip(indices, pairs, strict=True) if 0 <= row < len(rows)]
    frames = [(pair.stamp, pair.time) for _, pair in there]
    truth, warnings = truth_of(frames, [rows[row] for row, _ in there], file)
    if len(there) < len(pairs):
        warnings += (f"{file} has poses for {len(there)} of {len(pairs)} frames only",)
    return truth, warnings
