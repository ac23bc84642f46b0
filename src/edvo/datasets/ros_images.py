"""The images in ROS messages, in their many encodings."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.datasets.images import decode_image
from edvo.datasets.ros_messages import CompressedImageMessage, ImageMessage
from edvo.errors import FrameError

# Encoding: channels and what makes it grey; colour is needed for nothing else.
_COLOURS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8uc1": (1, None),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8uc3": (3, cv2.COLOR_BGR2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "8uc4": (4, cv2.COLOR_BGRA2GRAY),
    # The first is the order of ROS 1, by OpenCV's name.
    "yuv422": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2GRAY_YUY2),
    # OpenCV names Bayer patterns by the second row and column, ROS by the first.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
}
_DEPTHS = {"16uc1": "u2", "mono16": "u2", "32fc1": "f4"}

_PNG = b"\x89PNG\r\n\x1a\n"
_DEPTH_HEADER = struct.Struct("<iff")  # of compressedDepth: method, and two parameters


def is_colour(encoding: str) -> bool:
    """Say whether an encoding of ``sensor_msgs/Image`` is a colour or grey image of 8 bits."""
    return encoding.lower() in _COLOURS


def is_depth(encoding: str) -> bool:
    """Say whether an encoding of ``sensor_msgs/Image`` is a depth image."""
    return encoding.lower() in _DEPTHS


def is_compressed_depth(message: CompressedImageMessage) -> bool:
    """Say whether a compressed image is of the transport compressedDepth."""
    return "compresseddepth" in message.format.lower()


def grey_of(message: ImageMessage, where: str) -> NDArray[np.uint8]:
    """Give a colour image as grey.

    Parameters
    ----------
    message : ImageMessage
        Of one of the 8-bit encodings.
    where : str
        Named in errors.

    Returns
    -------
    ndarray of uint8, shape (H, W)
        By OpenCV's weights; of YUV its Y.

    Raises
    ------
    FrameError
        If the encoding is none of them, or the sizes do not fit.
    """
    encoding = message.encoding.lower()
    if encoding not in _COLOURS:
        raise FrameError(
            f"{where} has encoding '{message.encoding}', which is no 8-bit colour that edvo reads"
        )
    channels, code = _COLOURS[encoding]
    image = _rows(message, np.dtype(np.uint8), channels, where)
    if code is None:
        return np.asarray(image, np.uint8)
    try:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), code), np.uint8)
    except cv2.error as error:
        raise FrameError(f"{where} cannot be made grey: {error.err}") from error


def depth_of(message: ImageMessage, where: str) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Give a depth image.

    Parameters
    ----------
    message : ImageMessage
        16UC1 (millimetres) or 32FC1 (metres), of either byte order.
    where : str
        Named in errors.

    Returns
    -------
    ndarray of uint16 or float32, shape (H, W)
        Values as they are.

    Raises
    ------
    FrameError
        If the encoding is another, or the sizes do not fit.
    """
    kind = _DEPTHS.get(message.encoding.lower())
    if kind is None:
        raise FrameError(f"{where} has encoding '{message.encoding}'; depth must be 16UC1 or 32FC1")
    dtype = np.dtype(f"{'>' if message.big_endian else '<'}{kind}")
    image: Any = _rows(message, dtype, 1, where)
    # Native byte order; a copy only where it was the other.
    return np.asarray(image, np.uint16) if kind == "u2" else np.asarray(image, np.float32)


def decompressed_colour(message: CompressedImageMessage, where: str) -> NDArray[np.uint8]:
    """Decode a compressed colour image.

    Parameters
    ----------
    message : CompressedImageMessage
        JPEG or PNG, or what else OpenCV decodes.
    where : str
        Named in errors.

    Returns
    -------
    ndarray of uint8, shape (H, W) or (H, W, C)
        Grey as grey, colour as BGR(A).

    Raises
    ------
    FrameError
        If it is damaged, too large or no image of 8 bits.
    """
    image = _decode(message.data, where)
    if image.dtype != np.uint8:
        raise FrameError(f"{where} has {image.dtype} values; colour must have 8 bits")
    return np.asarray(image, np.uint8)


def decompressed_depth(
    message: CompressedImageMessage, where: str
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Decode a compressed depth image.

    Parameters
    ----------
    message : CompressedImageMessage
        PNG of 16 bits, by itself or as image_transport's compressedDepth writes it, where a
        32FC1 image is stored as its quantised inverse.
    where : str
        Named in errors.

    Returns
    -------
    ndarray of uint16 or float32, shape (H, W)
        Millimetres or metres, 0 or NaN where missing.

    Raises
    ------
    FrameError
        If it is damaged, too large, of RVL compression, or no image of 16 bits.
    """
    data, quantised = message.data, None
    if is_compressed_depth(message):
        if "rvl" in message.format.lower():
            raise FrameError(f"{where} is RVL compressed; republish it raw or as png")
        if len(data) <= _DEPTH_HEADER.size:
            raise FrameError(f"{where} is empty")
        _, a, b = _DEPTH_HEADER.unpack_from(data)
        quantised = (a, b) if "32fc1" in message.format.lower() else None
        data = data[_DEPTH_HEADER.size :]
    image = _decode(data, where)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise FrameError(f"{where} has {image.dtype} values; depth must be one 16-bit value")
    depth = np.asarray(image, np.uint16)
    if quantised is None:
        return depth
    with np.errstate(all="ignore"):
        metres = np.float32(quantised[0]) / (depth.astype(np.float32) - np.float32(quantised[1]))
    metres[depth == 0] = 0.0
    return metres


def is_16_bit_png(data: memoryview) -> bool:
    """Say whether an image is a PNG of one 16-bit value a pixel."""
    return bytes(data[:8]) == _PNG and len(data) > 25 and (data[24], data[25]) == (16, 0)


def _rows(
    message: ImageMessage, dtype: np.dtype[Any], channels: int, where: str
) -> NDArray[np.generic]:
    """View rows of `step` bytes as an image, without a copy."""
    height, width, step = message.height, message.width, message.step
    if not (height and width and len(message.data)):
        raise FrameError(f"{where} is empty")
    used = width * channels * dtype.itemsize
    step = step or used  # some drivers leave it out
    if step < used or (height - 1) * step + used > len(message.data):
        raise FrameError(
            f"{where} claims {width}x{height} {message.encoding} in rows of {step} bytes, and has "
            f"{len(message.data)} bytes"
        )
    shape = (height, width, channels) if channels > 1 else (height, width)
    strides = (step, channels * dtype.itemsize, dtype.itemsize)[: len(shape)]
    return np.ndarray(shape, dtype, message.data, 0, strides)


def _decode(data: memoryview, where: str) -> NDArray[np.generic]:
    return decode_image(bytes(data), where)
