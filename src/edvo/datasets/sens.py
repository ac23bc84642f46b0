"""ScanNet's .sens files: a scan in one file (version 4), read frame by frame.

Little-endian: version uint32; name uint64 + bytes; four 4x4 float32 matrices (intrinsic and
extrinsic of colour, then of depth); compression of colour and of depth, int32 each; widths and
heights of both, uint32; depth value of one metre, float32; count of frames uint64. A frame: pose
4x4 float32, camera to world; microseconds of colour and of depth, uint64; sizes of colour and
depth, uint64; both images. What follows the frames is not needed.

A folder that holds a single .sens file stands for it.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.datasets.association import stamped_delay
from edvo.datasets.images import decode_image
from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, ListedSource, Truth
from edvo.datasets.matrices import rigid, truth_of
from edvo.datasets.names import NO_TIMES, stamp_of_index
from edvo.datasets.scannet import camera_of_matrix
from edvo.datasets.source import Source
from edvo.datasets.two_cameras import TwoCameras
from edvo.errors import CameraError, DatasetError, FrameError
from edvo.frame import Frame

SUFFIX = ".sens"

_VERSION = 4
_LONGEST_NAME = 4096
_LARGEST_SIDE = 16384  # pixels: beyond that a size is damage
_RAW, _PNG, _JPEG = 0, 1, 2
_RAW_DEPTH, _ZLIB_DEPTH = 0, 1
_TAIL = struct.Struct("<2i4IfQ")
_FRAME = struct.Struct("<16f4Q")


class SensFormat:
    """The registry's entry for .sens files."""

    name = "sens"
    layout = f"a {SUFFIX} file of ScanNet"

    def recognise(self, path: Path) -> str | None:
        """Say which file it is."""
        file = _file(path)
        return None if file is None else f"the name '{file.name}'"

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a scan."""
        file = _file(path)
        if file is None:
            raise DatasetError(f"{path}: there is no {SUFFIX} file; give {self.layout}")
        scan = _read_index(file)
        colour, origin = choose_camera(
            file.parent,
            camera,
            stated=lambda: (
                camera_of_matrix(scan.intrinsics[0], scan.colour_size, scan.depth_scale),
                "the .sens file",
            ),
        )
        depth = camera_of_matrix(scan.intrinsics[1], scan.depth_size, scan.depth_scale)
        T_colour_rig, T_depth_rig = scan.extrinsics
        both = TwoCameras(colour, depth, T_colour_rig @ se3.inverse(T_depth_rig))
        frames, told = _times(scan)
        warnings = []
        if len(scan.frames) < scan.declared:
            warnings.append(
                f"{file.name} is cut short: it has {len(scan.frames)} of {scan.declared} frames"
            )

        def truth() -> Truth:
            T_rig_colour = se3.inverse(T_colour_rig)
            with np.errstate(invalid="ignore"):  # lost frames are infinite
                poses = [entry.T_world_rig @ T_rig_colour for entry in scan.frames]
            return truth_of(frames, poses, file)

        delays = [entry.depth_delay if told != NO_TIMES else 0.0 for entry in scan.frames]
        frame_camera = both.camera

        def load(index: int) -> Frame:
            return scan.load(index, frames[index][1], both, frame_camera, delays[index])

        return ListedSource(
            path,
            format=self.name,
            recognised_by=self.recognise(path),
            stamps=[stamp for stamp, _ in frames],
            times=[time for _, time in frames],
            load=load,
            camera=(frame_camera, origin),
            truth=truth,
            warnings=warnings,
            facts={"times": told},
        )


@dataclass(frozen=True, eq=False)
class _Entry:
    """Where a frame lies in the file, and what is said of it."""

    T_world_rig: NDArray[np.float64]
    microseconds: int
    depth_microseconds: int
    at: int
    colour_bytes: int
    depth_bytes: int

    @property
    def depth_delay(self) -> float:
        return stamped_delay(0.0, (self.depth_microseconds - self.microseconds) / 1e6)


@dataclass(frozen=True, eq=False)
class _Scan:
    """What the file says before its images are read; pairs are colour and depth."""

    file: Path
    intrinsics: tuple[NDArray[np.float64], NDArray[np.float64]]
    extrinsics: tuple[NDArray[np.float64], NDArray[np.float64]]
    compressions: tuple[int, int]
    colour_size: tuple[int, int]
    depth_size: tuple[int, int]
    depth_scale: float
    declared: int
    frames: tuple[_Entry, ...]

    def load(
        self, index: int, time: float, both: TwoCameras, camera: Camera, depth_delay: float
    ) -> Frame:
        entry = self.frames[index]
        name = f"{self.file} frame {index}"
        try:
            with self.file.open("rb") as stream:
                stream.seek(entry.at)
                colour, depth = stream.read(entry.colour_bytes), stream.read(entry.depth_bytes)
        except OSError as error:
            raise FrameError(f"cannot read {self.file}: {error.strerror or error}") from error
        return both.frame(
            time,
            (f"{name} colour", self._colour(colour, f"{name} colour")),
            (f"{name} depth", self._depth(depth, f"{name} depth")),
            camera,
            depth_delay,
        )

    def _colour(self, data: bytes, name: str) -> NDArray[np.uint8]:
        if self.compressions[0] != _RAW:
            image = decode_image(data, name)
            if image.dtype != np.uint8:
                raise FrameError(f"{name} has {image.dtype} values; colour must have 8 bits")
            return np.asarray(image, np.uint8)
        width, height = self.colour_size
        if len(data) != 3 * width * height:
            raise FrameError(f"{name} has {len(data)} bytes, not {width}x{height}x3")
        rgb = np.frombuffer(data, np.uint8).reshape(height, width, 3)
        return np.ascontiguousarray(rgb[:, :, ::-1])

    def _depth(self, data: bytes, name: str) -> NDArray[np.uint16]:
        width, height = self.depth_size
        size = 2 * width * height
        if self.compressions[1] == _ZLIB_DEPTH:
            try:
                # One byte more than there should be tells of too many, whatever it swells to.
                data = zlib.decompressobj().decompress(data, size + 1)
            except zlib.error as error:
                raise FrameError(f"{name} is damaged: {error}") from error
        if len(data) != size:
            raise FrameError(f"{name} has not {width}x{height} values of 16 bits")
        return np.frombuffer(data, "<u2").reshape(height, width).astype(np.uint16)


def _file(path: Path) -> Path | None:
    if path.is_dir():
        files = list(path.glob(f"*{SUFFIX}"))
        return files[0] if len(files) == 1 else None
    return path if path.suffix == SUFFIX else None


def _read_index(file: Path) -> _Scan:
    """Read all of a file but its images."""
    try:
        with file.open("rb") as stream:
            return _scan(file, stream, os.fstat(stream.fileno()).st_size)
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}") from error
    except struct.error as error:
        raise DatasetError(f"{file} is cut short within its header; fetch it again") from error
    except CameraError as error:
        raise CameraError(f"{file}: {error}") from error


def _scan(file: Path, stream: BinaryIO, size: int) -> _Scan:
    (version,) = struct.unpack("<I", stream.read(4))
    if version != _VERSION:
        raise DatasetError(f"{file} is no {SUFFIX} file of version {_VERSION} (it says {version})")
    (length,) = struct.unpack("<Q", stream.read(8))
    if length > _LONGEST_NAME:
        raise DatasetError(f"{file} is damaged: its sensor's name has {length} letters")
    stream.seek(length, os.SEEK_CUR)
    matrices = [
        np.array(struct.unpack("<16f", stream.read(64)), np.float64).reshape(4, 4) for _ in range(4)
    ]
    tail = _TAIL.unpack(stream.read(_TAIL.size))
    colour_kind, depth_kind, colour_w, colour_h, depth_w, depth_h, scale, declared = tail
    if not all(0 < side <= _LARGEST_SIDE for side in (colour_w, colour_h, depth_w, depth_h)):
        raise DatasetError(
            f"{file} is damaged: images of {colour_w}x{colour_h} and {depth_w}x{depth_h}"
        )
    if colour_kind not in (_RAW, _PNG, _JPEG) or depth_kind not in (_RAW_DEPTH, _ZLIB_DEPTH):
        raise DatasetError(
            f"{file}: compression {colour_kind} of colour or {depth_kind} of depth is not known; "
            "extract it with ScanNet's SensReader and give that folder"
        )
    extrinsics = [rigid(matrix) for matrix in matrices[1::2]]
    if extrinsics[0] is None or extrinsics[1] is None:
        raise DatasetError(f"{file} is damaged: an extrinsic is no rigid motion")
    frames = tuple(_entries(stream, size, declared))
    if not frames:
        raise DatasetError(f"{file} holds no whole frame; fetch it again")
    return _Scan(
        file,
        (matrices[0], matrices[2]),
        (extrinsics[0], extrinsics[1]),
        (colour_kind, depth_kind),
        (colour_w, colour_h),
        (depth_w, depth_h),
        scale,
        declared,
        frames,
    )


def _entries(stream: BinaryIO, size: int, declared: int) -> Iterator[_Entry]:
    """Find the frames that lie whole within the file; never more than it has bytes for."""
    for _ in range(declared):
        header = stream.read(_FRAME.size)
        if len(header) < _FRAME.size:
            return
        *pose, colour_time, depth_time, colour_bytes, depth_bytes = _FRAME.unpack(header)
        at = stream.tell()
        if at + colour_bytes + depth_bytes > size:
            return
        stream.seek(at + colour_bytes + depth_bytes)
        T_world_rig = np.array(pose, np.float64).reshape(4, 4)
        yield _Entry(T_world_rig, colour_time, depth_time, at, colour_bytes, depth_bytes)


def _times(scan: _Scan) -> tuple[list[tuple[str, float]], str]:
    times = [entry.microseconds for entry in scan.frames]
    # Some scans have no times, all 0.
    if all(before < after for before, after in pairwise(times)) and times[-1]:
        stamps = [f"{time // 10**6}.{time % 10**6:06d}" for time in times]
        return [(stamp, float(stamp)) for stamp in stamps], "the file's"
    return [stamp_of_index(index) for index in range(len(times))], NO_TIMES
