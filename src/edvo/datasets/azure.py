"""Azure Kinect recordings: the .mkv files of k4arecorder, and of Orbbec's wrapper of it.

A track COLOR (MJPEG, NV12, YUY2 or BGRA), a track DEPTH (16 bits, big-endian, millimetres) and an
attached ``calibration.json``. Its cameras are given for the whole sensor; which part of it a mode
shows is known for each size of image. Their distortion (a rational one, up to 120 degrees wide) is
taken out of the images, since edvo's cameras do not have it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.association import MAX_DIFFERENCE_S, associate
from edvo.datasets.images import decode_image
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ListedSource
from edvo.datasets.matrices import rigid
from edvo.datasets.matroska import MAGIC, Block, Matroska, Track, read_matroska
from edvo.datasets.ros_stamped import seconds, stamp_text
from edvo.datasets.source import Source
from edvo.datasets.two_cameras import TwoCameras
from edvo.errors import CameraError, DatasetError, FrameError
from edvo.frame import Frame

MILLIMETRES = 1000.0

_CALIBRATION = "calibration.json"
_DEPTH_FOURCC = "b16g"
_MEND = (
    "extract its images into rgb/ and depth/ (ffmpeg -i FILE -map 0:0 rgb/%06d.png -map 0:1 "
    "depth/%06d.png) with depth registered to colour, and add camera.yaml"
)


@dataclass(frozen=True)
class _Mode:
    """Which part of the sensor an image shows: the sensor's size, binned, and what is cut off."""

    sensor: tuple[int, int]
    cut: tuple[int, int]


# By width and height; k4a's mode_specific_calibration.c has the same table by mode.
_DEPTH_MODES = {
    (320, 288): _Mode((512, 512), (96, 90)),
    (640, 576): _Mode((1024, 1024), (192, 180)),
    (512, 512): _Mode((512, 512), (0, 0)),
    (1024, 1024): _Mode((1024, 1024), (0, 0)),
}
_COLOUR_MODES = {
    (1280, 720): _Mode((1280, 960), (0, 120)),
    (1920, 1080): _Mode((1920, 1440), (0, 180)),
    (2560, 1440): _Mode((2560, 1920), (0, 240)),
    (2048, 1536): _Mode((2048, 1536), (0, 0)),
    (3840, 2160): _Mode((3840, 2880), (0, 360)),
    (4096, 3072): _Mode((4096, 3072), (0, 0)),
}


@dataclass(frozen=True, eq=False)
class _Lens:
    """A camera without distortion, and how its images are made of those with it."""

    camera: Camera
    distortion: tuple[float, ...]

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Say which pixel with distortion each one without it shows."""
        camera = self.camera
        given = np.array(self.distortion)
        size = camera.width, camera.height
        matrix = camera.matrix
        map_u, map_v = cv2.initUndistortRectifyMap(
            matrix, given, np.eye(3), matrix, size, cv2.CV_32FC1
        )
        return np.asarray(map_u, np.float32), np.asarray(map_v, np.float32)

    def rectify(self, image: NDArray[Any], interpolation: int) -> NDArray[Any]:
        """Take the distortion out; colour goes on beyond its border, depth is missing there."""
        is_depth = interpolation == cv2.INTER_NEAREST
        border = cv2.BORDER_CONSTANT if is_depth else cv2.BORDER_REPLICATE
        return np.asarray(cv2.remap(image, *self._maps, interpolation, borderMode=border))


class AzureFormat:
    """The registry's entry for Azure Kinect recordings."""

    name = "azure"
    layout = "an .mkv file of an Azure Kinect"

    def recognise(self, path: Path) -> str | None:
        """Say that it is a Matroska file."""
        if not path.is_file() or path.suffix.lower() != ".mkv":
            return None
        try:
            with path.open("rb") as stream:
                return "a Matroska file" if stream.read(4) == MAGIC else "the name ends in .mkv"
        except OSError:
            return None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a recording."""
        file = read_matroska(path)
        colour, depth = _tracks(file)
        (colour_lens, depth_lens), T_colour_depth = _calibration(file, colour, depth)
        stated = colour_lens.camera
        taken, origin = choose_camera(path.parent, camera, stated=lambda: (stated, _CALIBRATION))
        is_own = taken is stated  # of another one, nothing is known but what it says
        both = TwoCameras(taken, depth_lens.camera, T_colour_depth)
        colours, depths = (_sorted(file, track) for track in (colour, depth))
        kept, partners = associate(_times(colours), _times(depths))
        if not len(kept):
            raise DatasetError(
                f"{path}: no colour image has a depth image within {MAX_DIFFERENCE_S * 1e3:g} ms; "
                "record both, with a depth delay below that"
            )
        stamps = [stamp_text(colours[index].time) for index in kept]
        pairs = [(colours[i], depths[j]) for i, j in zip(kept, partners, strict=True)]
        delays = _times(depths)[partners] - _times(colours)[kept]
        frame_camera = both.camera

        def load(index: int) -> Frame:
            at = f"at {stamps[index]} in {path}"
            first, second = f"{colour.name} {at}", f"{depth.name} {at}"
            grey = _colour(file.read(pairs[index][0], first), colour, first)
            if is_own and grey.shape[:2] == (colour.height, colour.width):
                grey = np.asarray(colour_lens.rectify(grey, cv2.INTER_LINEAR), np.uint8)
            raw = _depth(file.read(pairs[index][1], second), depth, second)
            metric = np.asarray(depth_lens.rectify(raw, cv2.INTER_NEAREST), np.uint16)
            time = float(stamps[index])
            return both.frame(
                time, (first, grey), (second, metric), frame_camera, float(delays[index])
            )

        return ListedSource(
            path,
            format=self.name,
            recognised_by=self.recognise(path),
            stamps=stamps,
            times=[float(stamp) for stamp in stamps],
            load=load,
            camera=(frame_camera, origin),
            warnings=[f"{path.name} is cut short: what is whole is read"] if file.cut_short else [],
            facts={
                "colour": f"{colour.fourcc or colour.codec} {colour.width}x{colour.height}",
                "depth": f"{depth.width}x{depth.height}",
                "colour_images_without_depth": len(colours) - len(kept),
            },
        )


def _tracks(file: Matroska) -> tuple[Track, Track]:
    """Find colour and depth."""
    by_name = {track.name.upper(): track for track in file.tracks if file.blocks.get(track.number)}
    colour, depth = by_name.get("COLOR"), by_name.get("DEPTH")
    if colour is None or depth is None or depth.fourcc.lower() != _DEPTH_FOURCC:
        there = ", ".join(sorted(by_name)) or "none with images"
        raise DatasetError(
            f"{file.path}: an Azure Kinect's tracks are COLOR and DEPTH (16 bits), these are "
            f"{there}; record both, or {_MEND}"
        )
    if _CALIBRATION not in file.attachments:
        raise DatasetError(f"{file.path}: no {_CALIBRATION} is attached; {_MEND}")
    return colour, depth


def _calibration(
    file: Matroska, colour: Track, depth: Track
) -> tuple[tuple[_Lens, _Lens], NDArray[np.float64]]:
    """Give the lenses of colour and depth, and ``T_colour_depth``."""
    where = f"{file.path}: {_CALIBRATION}"
    try:
        data = json.loads(file.attachments[_CALIBRATION].rstrip(b"\0"))
        told = {camera["Purpose"]: camera for camera in data["CalibrationInformation"]["Cameras"]}
        parts = told["CALIBRATION_CameraPurposePhotoVideo"], told["CALIBRATION_CameraPurposeDepth"]
        places = [_place(part["Rt"]) for part in parts]
        lenses = (
            _lens(parts[0], _COLOUR_MODES, colour, where),
            _lens(parts[1], _DEPTH_MODES, depth, where),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{where} cannot be read ({error!r}); {_MEND}") from error
    # Each maps points from the sensor's reference to its camera.
    T_colour_reference, T_depth_reference = places
    return lenses, T_colour_reference @ se3.inverse(T_depth_reference)


def _place(told: dict[str, Any]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = np.array(told["Rotation"], np.float64).reshape(3, 3)
    T[:3, 3] = np.array(told["Translation"], np.float64)
    placed = rigid(T)
    if placed is None:
        raise ValueError("Rt is no rigid motion")
    return placed


def _lens(
    told: dict[str, Any], modes: dict[tuple[int, int], _Mode], track: Track, where: str
) -> _Lens:
    size = track.width, track.height
    if size not in modes:
        raise DatasetError(
            f"{where}: there is no mode with images of {size[0]}x{size[1]} ({track.name}); {_MEND}"
        )
    kind = str(told["Intrinsics"]["ModelType"])
    if not kind.endswith(("BrownConrady", "Rational6KT")):
        raise DatasetError(f"{where}: {track.name} has distortion {kind}; {_MEND}")
    values = [float(value) for value in told["Intrinsics"]["ModelParameters"]]
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1, *_ = values
    wide, high = int(told["SensorWidth"]), int(told["SensorHeight"])
    if modes is _COLOUR_MODES and wide * 9 == high * 16:
        # Early devices were calibrated in 16:9, which is the middle of the sensor's 4:3.
        cy, fy = (cy * 2304 + 384) / 3072, fy * 2304 / 3072
    sensor, cut = modes[size].sensor, modes[size].cut
    # Shares of the sensor, from its corner; here pixel centres are at integers.
    fx, cx = fx * sensor[0], cx * sensor[0] - cut[0] - 0.5
    fy, cy = fy * sensor[1], cy * sensor[1] - cut[1] - 0.5
    try:
        camera = Camera(track.width, track.height, fx, fy, cx, cy, depth_scale=MILLIMETRES)
    except CameraError as error:
        raise DatasetError(f"{where}: {track.name}: {error}; {_MEND}") from error
    return _Lens(camera, (k1, k2, p1, p2, k3, k4, k5, k6))


def _sorted(file: Matroska, track: Track) -> list[Block]:
    """Give the frames of a track by time, one a time."""
    by_time = {block.time: block for block in file.blocks[track.number]}
    return [by_time[time] for time in sorted(by_time)]


def _times(blocks: Sequence[Block]) -> NDArray[np.float64]:
    return seconds(np.array([block.time for block in blocks], np.int64), 0)


def _colour(data: bytes, track: Track, name: str) -> NDArray[np.uint8]:
    """Decode a colour image; grey of what holds brightness by itself."""
    kind, width, height = track.fourcc.upper(), track.width, track.height
    if kind == "MJPG" or track.codec == "V_MJPEG":
        image = decode_image(data, name)
        if image.dtype != np.uint8:
            raise FrameError(f"{name} has {image.dtype} values; colour must have 8 bits")
        return np.asarray(image, np.uint8)
    shapes = {
        "NV12": (height * 3 // 2, width),
        "YUY2": (height, width, 2),
        "BGRA": (height, width, 4),
    }
    if kind not in shapes:
        raise FrameError(f"{name} is coded as {kind or track.codec}; record MJPG, NV12 or YUY2")
    shape = shapes[kind]
    if len(data) != np.prod(shape):
        raise FrameError(f"{name} has {len(data)} bytes, not {np.prod(shape)}")
    image = np.frombuffer(data, np.uint8).reshape(shape)
    if kind == "YUY2":
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_YUV2GRAY_YUY2), np.uint8)
    return image[:height].copy() if kind == "NV12" else image


def _depth(data: bytes, track: Track, name: str) -> NDArray[np.uint16]:
    if len(data) != 2 * track.width * track.height:
        raise FrameError(f"{name} has not {track.width}x{track.height} values of 16 bits")
    return np.frombuffer(data, ">u2").reshape(track.height, track.width).astype(np.uint16)
