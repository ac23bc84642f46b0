"""Microsoft's 7-Scenes (Shotton et al., CVPR 2013).

::

    chess/seq-01/frame-000000.color.png    colour
                 frame-000000.depth.png    depth in millimetres, 65535 where missing
                 frame-000000.pose.txt     4x4, depth camera to world

A sequence is given, not a scene. The data set has no calibration: for depth, KinectFusion's
defaults were used (585 585 320 240); for colour, 525 px and the Kinect's nominal offset to the
depth camera are in general use (LIRIS's calibration, as in DSAC*). Depth is not registered to
colour, so the reader does that, and carries the poses over to the colour camera. Copies that are
registered already are about: where depth fits colour clearly better as it is, it is left so.
There are no times.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.images import first_size
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ImagePair, pair_source
from edvo.datasets.matrices import nearest_rotation, truth_of_files
from edvo.datasets.names import images_in, pair_by_name
from edvo.datasets.source import Source
from edvo.datasets.two_cameras import TwoCameras, edge_fit
from edvo.errors import DatasetError, FrameError

DEPTH_CAMERA = Camera(
    640, 480, 585.0, 585.0, 320.0, 240.0, depth_scale=1000.0, name="7-scenes depth"
)
COLOUR_CAMERA = Camera(
    640, 480, 525.0, 525.0, 320.0, 240.0, depth_scale=1000.0, name="7-scenes colour"
)
MISSING = 65535

_T_COLOUR_DEPTH = np.array(
    [
        [9.9996518012567637e-01, 2.6765126468950343e-03, -7.9041012313000904e-03, -2.555894e-02],
        [-2.7409311281316700e-03, 9.9996302803027592e-01, -8.1504520778013286e-03, 1.010964e-04],
        [7.8819942130445332e-03, 8.1718328771890631e-03, 9.9993554558014031e-01, 2.031832e-03],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_T_COLOUR_DEPTH[:3, :3] = nearest_rotation(_T_COLOUR_DEPTH[:3, :3])
_T_COLOUR_DEPTH.flags.writeable = False

_LOOKS = 3  # frames that are looked at
_CLEARLY = 1.15  # times better


class SevenScenesFormat:
    """The registry's entry for 7-Scenes."""

    name = "7scenes"
    layout = "a folder with frame-000000.color.png, .depth.png and .pose.txt"

    def recognise(self, path: Path) -> str | None:
        """Say that the images are there."""
        found = next(path.glob("frame-*.color.png"), None) is not None
        return "frame-*.color.png" if found else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a sequence."""
        colour, depth = (images_in(path, f"frame-*.{kind}.png") for kind in ("color", "depth"))
        if not colour and any(path.glob("seq-*")):
            raise DatasetError(f"{path} is a scene; give one of its sequences, such as seq-01")
        paired = pair_by_name(colour, depth, path)
        pairs = paired.pairs
        depth_camera, nominal = _of_size(pairs)
        # A user's camera is that of colour, wherever depth is.
        kinds = choose_camera(
            path, camera, stated=lambda: (nominal, "nominal, as the data set has none")
        )
        both = TwoCameras(kinds[0], depth_camera, _T_COLOUR_DEPTH, MISSING)
        told = "depth is registered to colour by the Kinect's nominal calibration"
        if _fits_as_it_is(both, pairs):
            if kinds[0] is nominal:
                kinds = depth_camera, "KinectFusion's default, the depth camera's"
            both = TwoCameras(kinds[0], kinds[0], np.eye(4), MISSING)
            told = "depth fits colour as it is, so it is not registered again"
        T_depth_colour = se3.inverse(both.T_colour_depth)
        return pair_source(
            path,
            pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=(both.camera, kinds[1]),
            load=both.load,
            truth=lambda: truth_of_files(
                paired.frames,
                [_pose_file(pair) for pair in pairs],
                path,
                T_depth_colour,
            ),
            warnings=paired.warnings,
            facts={**paired.facts, "registration": told},
        )


def _of_size(pairs: Sequence[ImagePair]) -> tuple[Camera, Camera]:
    """Scale the cameras of depth and colour to the images: small copies are about."""
    width, _ = first_size(pair.depth for pair in pairs)
    factor = width / DEPTH_CAMERA.width
    if factor == 1.0:
        return DEPTH_CAMERA, COLOUR_CAMERA
    return DEPTH_CAMERA.scaled(factor), COLOUR_CAMERA.scaled(factor)


def _pose_file(pair: ImagePair) -> Path:
    return pair.colour.with_name(pair.colour.name.replace(".color.png", ".pose.txt"))


def _fits_as_it_is(both: TwoCameras, pairs: Sequence[ImagePair]) -> bool:
    """Say whether depth fits colour clearly better without registration."""
    as_it_is = TwoCameras(both.colour, both.colour, np.eye(4), both.missing)
    scores = []
    for index in np.unique(np.linspace(0, len(pairs) - 1, _LOOKS).astype(int)):
        pair = pairs[int(index)]
        try:
            frames = [
                cameras.load(pair.time, pair.colour, pair.depth, both.colour)
                for cameras in (as_it_is, both)
            ]
        except FrameError:
            continue
        fits = [edge_fit(frame) for frame in frames]
        if None not in fits:
            scores.append(fits)
    if not scores:
        return False
    bare, registered = np.array(scores, np.float64).mean(axis=0)
    return bool(bare > _CLEARLY * registered)
