"""Image files to frames, with each way they can be bad put into one line."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.source import Reading
from edvo.errors import FrameError, NoDepthError
from edvo.frame import Frame

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"


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

    Notes
    -----
    The end marker is checked first: OpenCV versions differ in whether a file that is cut short
    is refused or half decoded, and some print to the terminal about it.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FrameError(f"cannot read {path}: {error.strerror or error}") from error
    if not data:
        raise FrameError(f"{path} is empty")
    if _is_cut_short(data):
        raise FrameError(f"{path} is cut short")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise FrameError(f"{path} cannot be decoded: {error.err}") from error
    if image is None:
        raise FrameError(f"{path} is damaged or no image")
    return np.asarray(image)


def load_frame(timestamp: float, colour_path: Path, depth_path: Path, camera: Camera) -> Frame:
    """Read the two images of a frame.

    Parameters
    ----------
    timestamp : float
        Seconds.
    colour_path, depth_path : pathlib.Path
        Colour or grey image, 8 bit; depth image, 16 bit.
    camera : Camera
        Gives the size that both must have and the depth value of one metre.

    Returns
    -------
    Frame
        Grey made from colour by OpenCV's weights (decoding straight to grey gives other
        values); depth in metres.

    Raises
    ------
    FrameError
        If an image is missing, bad, or of another type or size; the message names it.
    NoDepthError
        If no depth value is valid.
    """
    colour = load_image(colour_path)
    depth = load_image(depth_path)
    if colour.dtype != np.uint8:
        raise FrameError(f"{colour_path} has {colour.dtype} values; colour must have 8 bits")
    if depth.dtype != np.uint16 or depth.ndim != 2:
        channels = 1 if depth.ndim == 2 else depth.shape[2]
        raise FrameError(
            f"{depth_path} has {channels} x {depth.dtype} a pixel; depth must be one 16-bit value"
        )
    if colour.shape[:2] != depth.shape:
        raise FrameError(
            f"{colour_path} is {_size(colour)} and {depth_path} is {_size(depth)}; "
            "depth must be registered to colour"
        )
    if depth.shape != (camera.height, camera.width):
        raise FrameError(
            f"{colour_path} is {_size(colour)} and the camera is "
            f"{camera.width}x{camera.height}; give the camera of these images"
        )
    try:
        return Frame.from_images(
            timestamp, colour, depth, depth_scale=camera.depth_scale, order="bgr"
        )
    except NoDepthError as error:
        raise NoDepthError(f"{depth_path} has no valid depth value") from error
    except FrameError as error:
        raise FrameError(f"{colour_path}: {error}") from error


def load_reading(
    index: int,
    stamp: str,
    timestamp: float,
    colour_path: Path,
    depth_path: Path,
    camera: Camera,
) -> Reading:
    """Read a frame, or what is wrong with it; see `load_frame` for the parameters.

    Returns
    -------
    Reading
        With a frame or with a problem.
    """
    try:
        frame = load_frame(timestamp, colour_path, depth_path, camera)
    except FrameError as error:
        return Reading(index, stamp, timestamp, None, str(error))
    return Reading(index, stamp, timestamp, frame, None)


def _is_cut_short(data: bytes) -> bool:
    if data.startswith(_PNG[: len(data)]):
        return b"IEND" not in data[-12:] and b"IEND" not in data  # the end first: it is there
    if data.startswith(_JPEG[: len(data)]):
        # The end marker of a thumbnail in the header stands before the image's own scan.
        return data.rfind(b"\xff\xd9") < max(data.rfind(b"\xff\xda"), 0)
    return False


def _size(image: NDArray[np.generic]) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
