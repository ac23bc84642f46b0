"""ETH3D's SLAM sequences (Schoeps et al., CVPR 2019): TUM's layout and a calibration.

::

    rgb.txt, depth.txt, groundtruth.txt, rgb/, depth/    as TUM; 5000 a metre
    associated.txt                                       the pairs of both lists
    calibration.txt                                      "fx fy cx cy"

Pixel centres lie at integers in the calibration, as here; the images have no distortion.
"""

from pathlib import Path

from edvo.camera import Camera
from edvo.datasets.images import first_size
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, pair_source
from edvo.datasets.matrices import read_numbers
from edvo.datasets.source import Source
from edvo.datasets.tum import GROUND_TRUTH, Listed, lists_in, read_lists, read_truth
from edvo.errors import CameraError, DatasetError

CALIBRATION = "calibration.txt"
DEPTH_SCALE = 5000.0


class Eth3dFormat:
    """The registry's entry for ETH3D SLAM."""

    name = "eth3d"
    layout = f"a folder with rgb.txt, depth.txt and {CALIBRATION}"

    def recognise(self, path: Path) -> str | None:
        """Say which of its files are there; the calibration tells it from TUM."""
        lists = lists_in(path)
        return f"{CALIBRATION} and {lists}" if lists and (path / CALIBRATION).is_file() else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        listed = read_lists(path)
        return pair_source(
            path,
            listed.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera, stated=lambda: _calibration(path, listed)),
            truth=lambda: read_truth(path / GROUND_TRUTH, listed),
            warnings=listed.warnings,
            facts=listed.facts,
        )


def _calibration(path: Path, listed: Listed) -> tuple[Camera, str]:
    file = path / CALIBRATION
    numbers = read_numbers(file)
    if numbers.size != 4:
        raise DatasetError(f"{file} holds {numbers.size} numbers; it must be 'fx fy cx cy'")
    width, height = first_size(pair.colour for pair in listed.pairs)
    try:
        fx, fy, cx, cy = numbers.tolist()
        camera = Camera(width, height, fx, fy, cx, cy, depth_scale=DEPTH_SCALE)
    except CameraError as error:
        raise CameraError(f"{file}: {error}") from error
    return camera, f"{CALIBRATION} in the folder, {DEPTH_SCALE:g} a metre"
