"""Between the numbers in an image file and the light that made them: the sRGB curve."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

_LEVELS = 65536


def srgb_to_linear(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Undo the sRGB curve (IEC 61966-2-1).

    Parameters
    ----------
    value : ndarray of float64
        Display values from 0 to 1.

    Returns
    -------
    ndarray of float64
        Linear light from 0 to 1.
    """
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply the sRGB curve (IEC 61966-2-1).

    Parameters
    ----------
    light : ndarray of float64
        Linear light from 0 to 1.

    Returns
    -------
    ndarray of float64
        Display values from 0 to 1.
    """
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def decode(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Turn an 8-bit sRGB image into linear light.

    Parameters
    ----------
    image : ndarray of uint8
        Any shape.

    Returns
    -------
    ndarray of float32, shape of ``image``
        0 to 1.
    """
    return np.asarray(_decoding()[image])


def encode(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Turn linear light into an 8-bit sRGB image.

    Parameters
    ----------
    light : ndarray of float32
        1 is white; what lies outside 0 to 1 saturates.

    Returns
    -------
    ndarray of uint8, shape of ``light``
        ``encode(decode(image))`` is ``image``.
    """
    top = np.float32(_LEVELS - 1)
    index = np.clip(light * top + np.float32(0.5), 0, top).astype(np.uint16)
    return np.asarray(_encoding()[index])


@cache
def _decoding() -> NDArray[np.float32]:
    return srgb_to_linear(np.arange(256) / 255).astype(np.float32)


@cache
def _encoding() -> NDArray[np.uint8]:
    light = np.arange(_LEVELS) / (_LEVELS - 1)
    return np.rint(linear_to_srgb(light) * 255).astype(np.uint8)
