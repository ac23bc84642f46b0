"""Image files to frames, with each way they can be bad put into one line."""

import struct
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import DatasetError, FrameError, ImageSizeError, NoDepthError
from edvo.frame import Frame

MAX_PIXELS = 1 << 26
"""Images of more pixels are taken for damaged, before memory is spent on them."""

LARGEST_FILE = 8 * MAX_PIXELS
"""Bytes of the largest image file that is read."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
# Markers of JPEG that hold the size: all "start of frame", but for three other things there.
_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def load_image(path: Path) -> NDArray[np.generic]:
    """Decode an image file with the values it holds.

    Parameters
    ----------
    path : pathlib.Path
        PNG, JPEG, or what else OpenCV decodes.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, C)
        Grey as grey, colour as BGR(A), 16-bit values as they are.

    Raises
    ------
    FrameError
        If the file is missing, empty, cut short or damaged; the message names it.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise FrameError(f"{path} has {size} bytes, more than any image")
        data = path.read_bytes()
    except OSError as error:
        raise FrameError(f"cannot read {path}: {error.strerror or error}") from error
    return decode_image(data, path)


def decode_image(data: bytes, name: Path | str) -> NDArray[np.generic]:
    """Decode the bytes of an image file with the values it holds.

    Parameters
    ----------
    data : bytes
        PNG, JPEG, or what else OpenCV decodes.
    name : path or str
        What errors call it.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, C)
        Grey as grey, colour as BGR(A), 16-bit values as they are.

    Raises
    ------
    FrameError
        If the data are empty, cut short, damaged or claim more pixels than `MAX_PIXELS`; the
        message names them.

    Notes
    -----
    The end marker is checked first: OpenCV versions differ in whether an image that is cut short
    is refused or half decoded, and some print to the terminal about it.
    """
    if not data:
        raise FrameError(f"{name} is empty")
    if _is_cut_short(data):
        raise FrameError(f"{name} is cut short")
    size = compressed_size(memoryview(data))
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise FrameError(f"{name} claims {size[0]}x{size[1]} pixels: damaged")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise FrameError(f"{name} cannot be decoded: {error.err}") from error
    if image is None:
        raise FrameError(f"{name} is damaged or no image")
    return np.asarray(image)


def compressed_size(data: memoryview) -> tuple[int, int] | None:
    """Find the size of a PNG or JPEG image without decoding it.

    Parameters
    ----------
    data : memoryview
        The image; its beginning is enough for PNG.

    Returns
    -------
    (int, int) or None
        Width and height; None if it is neither or damaged.
    """
    if bytes(data[:8]) == _PNG and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    at = 2
    if bytes(data[:2]) != b"\xff\xd8":
        return None
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _FRAME_MARKERS:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 1 if marker == 0xFF else 2 + length  # fill bytes may lie before a marker
    return None


def load_colour(path: Path) -> NDArray[np.uint8]:
    """Read a colour or grey image.

    Parameters
    ----------
    path : pathlib.Path
        Image of 8 bits.

    Returns
    -------
    ndarray of uint8, shape (H, W) or (H, W, C)
        Grey as grey, colour as BGR(A).

    Raises
    ------
    FrameError
        If it cannot be read or has other values; the message names it.
    """
    colour = load_image(path)
    if colour.dtype != np.uint8:
        raise FrameError(f"{path} has {colour.dtype} values; colour must have 8 bits")
    return np.asarray(colour, np.uint8)


def load_depth(path: Path) -> NDArray[np.uint16]:
    """Read a depth image.

    Parameters
    ----------
    path : pathlib.Path
        Image of 16 bits.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        The values of the file.

    Raises
    ------
    FrameError
        If it cannot be read or has other values; the message names it.
    """
    depth = load_image(path)
    if depth.dtype != np.uint16 or depth.ndim != 2:
        channels = 1 if depth.ndim == 2 else depth.shape[2]
        raise FrameError(
            f"{path} has {channels} x {depth.dtype} a pixel; depth must be one 16-bit value"
        )
    return np.asarray(depth, np.uint16)


def load_frame(
    timestamp: float,
    colour_path: Path,
    depth_path: Path,
    camera: Camera,
    depth_delay: float = 0.0,
) -> Frame:
    """Read the two images of a frame.

    Parameters
    ----------
    timestamp : float
        Seconds.
    colour_path, depth_path : pathlib.Path
        Colour or grey image, 8 bit; depth image, 16 bit.
    camera : Camera
        Gives the size that both must have and the depth value of one metre.
    depth_delay : float
        See `Frame`.

    Returns
    -------
    Frame
        See `make_frame`.

    Raises
    ------
    FrameError
        If an image is missing, bad, or of another type or size; the message names it.
    NoDepthError
        If no depth value is valid.
    """
    colour, depth = load_colour(colour_path), load_depth(depth_path)
    return make_frame(timestamp, (colour_path, colour), (depth_path, depth), camera, depth_delay)


def make_frame(
    timestamp: float,
    colour: tuple[Path | str, NDArray[np.uint8]],
    depth: tuple[Path | str, NDArray[np.uint16] | NDArray[np.float32]],
    camera: Camera,
    depth_delay: float = 0.0,
) -> Frame:
    """Make a frame of two images.

    Parameters
    ----------
    timestamp : float
        Seconds.
    colour : (path or str, ndarray)
        What errors call the colour image, and its BGR(A) or grey values, not written to any more.
    depth : (path or str, ndarray)
        The same of the depth image: 16-bit values of the camera's ``depth_scale``, or metres.
    camera : Camera
        Gives the size that both must have and the depth value of one metre.
    depth_delay : float
        See `Frame`.

    Returns
    -------
    Frame
        Grey made from colour by OpenCV's weights (decoding straight to grey gives other
        values); depth in metres.

    Raises
    ------
    FrameError
        If the sizes differ from each other; the message names the image.
    ImageSizeError
        If they differ from the camera's.
    NoDepthError
        If no depth value is valid.
    """
    (colour_name, colour_image), (depth_name, depth_image) = colour, depth
    if colour_image.shape[:2] != depth_image.shape:
        raise FrameError(
            f"{colour_name} is {_size(colour_image)} and {depth_name} is {_size(depth_image)}; "
            "depth must be registered to colour"
        )
    if depth_image.shape != (camera.height, camera.width):
        raise ImageSizeError(
            f"{colour_name} is {_size(colour_image)} and the camera is "
            f"{camera.width}x{camera.height}; give the camera of these images",
            (depth_image.shape[1], depth_image.shape[0]),
        )
    try:
        return Frame.from_images(
            timestamp,
            colour_image,
            depth_image,
            depth_scale=camera.depth_scale,
            order="bgr",
            depth_delay=depth_delay,
            is_own=True,
        )
    except NoDepthError as error:
        raise NoDepthError(f"{depth_name} has no valid depth value") from error
    except FrameError as error:
        raise FrameError(f"{colour_name}: {error}") from error


def first_size(paths: Iterable[Path]) -> tuple[int, int]:
    """Find the size of the images of a recording, where nothing else tells it.

    Parameters
    ----------
    paths : iterable of pathlib.Path
        Images of one size.

    Returns
    -------
    (int, int)
        Width and height of the first that can be read.

    Raises
    ------
    DatasetError
        If none of the first ten can be read; the message names the first.
    """
    problem = "there are no images"
    for number, path in enumerate(islice(paths, 10)):
        try:
            image = load_image(path)
        except FrameError as error:
            problem = str(error) if number == 0 else problem
            continue
        return image.shape[1], image.shape[0]
    raise DatasetError(
        f"{problem}, nor can the images after it; give --camera FILE with their size"
    )


def _is_cut_short(data: bytes) -> bool:
    if data.startswith(_PNG[: len(data)]):
        return b"IEND" not in data[-12:] and b"IEND" not in data  # the end first: it is there
    if data.startswith(_JPEG[: len(data)]):
        # The end marker of a thumbnail in the header stands before the image's own scan.
        return data.rfind(b"\xff\xd9") < max(data.rfind(b"\xff\xda"), 0)
    return False


def _size(image: NDArray[np.generic]) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
