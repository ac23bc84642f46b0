"""What a camera delivers at one instant, checked at the door, and depth registered to colour.

Arrays are kept as they are given, not copied: do not write into them while the frame is in use.
`Odometry.track` copies what it needs beyond its return, but of frames that are their own
(``Frame.is_own``): never write into those, nor put other images into them by
``dataclasses.replace`` without saying whose they are.
"""

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.errors import FrameError, NoDepthError
from edvo.numeric import NO_NUMBERS

_GREY_CODES = {
    ("bgr", 3): cv2.COLOR_BGR2GRAY,
    ("rgb", 3): cv2.COLOR_RGB2GRAY,
    ("bgr", 4): cv2.COLOR_BGRA2GRAY,
    ("rgb", 4): cv2.COLOR_RGBA2GRAY,
}
# Of a depth pixel's image, per side, pixels: a point that nearly touches the colour camera would
# otherwise cover all of it.
_LARGEST_FOOTPRINT = 16
LEAST_SCALE = 1e-3  # by less the largest depth value would be 65,000 km


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A grey image and the depth image registered to it.

    Attributes
    ----------
    timestamp : float
        Seconds.
    grey : ndarray of uint8, shape (H, W)
        C-contiguous; a read-only view, not a copy.
    depth : ndarray of float32, shape (H, W)
        Depth along z in metres, 0 where missing; C-contiguous; a read-only view, not a copy.
    depth_delay : float
        Seconds from the instant of the grey image to that of the depth image, as far as their
        stamps tell; negative where depth is the older one. 0 where they are taken at once.
    is_own : bool
        Whether nobody writes to the memory of the images any more; else they are copied before
        they are kept longer than till the next frame.

    Raises
    ------
    FrameError
        If type, shape, size or values are not these; `Frame.from_images` takes more kinds.
    NoDepthError
        If no depth value is above zero.
    """

    timestamp: float
    grey: NDArray[np.uint8]
    depth: NDArray[np.float32]
    depth_delay: float = 0.0
    is_own: bool = False
    _copy: "Frame | None" = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("timestamp", "depth_delay"):
            object.__setattr__(self, name, finite_seconds(name, getattr(self, name)))
        _check_image("grey", self.grey, np.dtype(np.uint8))
        _check_image("depth", self.depth, np.dtype(np.float32))
        _check_same_size("grey", self.grey, self.depth)
        # Minimum and maximum carry NaN along: two passes see everything that can be wrong.
        low, high = float(self.depth.min()), float(self.depth.max())
        if not (low >= 0.0 and high < math.inf):
            raise FrameError(
                f"depth has values from {low} to {high}; "
                "give metres with 0 where missing, or use Frame.from_images"
            )
        if high == 0.0:
            raise NoDepthError("depth has no valid value; all pixels are missing")
        self._close()

    def __setstate__(self, state: Sequence[Any]) -> None:
        for each, value in zip(fields(self), state, strict=True):
            object.__setattr__(self, each.name, value)
        self._close()

    def _close(self) -> None:
        """Let nobody write; always, as compiled code takes a writable array for another type."""
        for name in ("grey", "depth"):
            image = getattr(self, name)
            if image.flags.writeable:
                view = image.view()
                view.setflags(write=False)
                object.__setattr__(self, name, view)

    @classmethod
    def from_images(
        cls,
        timestamp: float,
        colour: NDArray[Any],
        depth: NDArray[Any],
        *,
        depth_scale: float = 1000.0,
        order: Literal["bgr", "rgb"] = "bgr",
        depth_delay: float = 0.0,
        is_own: bool = False,
    ) -> "Frame":
        """Build a frame from the images that cameras and files deliver.

        Parameters
        ----------
        timestamp : float
            Seconds.
        colour : ndarray of uint8, shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4)
            Grey, colour, or colour with alpha, which is left out.
        depth : ndarray of uint16, float32 or float64, shape (H, W) or (H, W, 1)
            Registered to ``colour``. uint16 in units of ``depth_scale``, floats in metres; NaN,
            infinite and negative values are missing.
        depth_scale : float
            uint16 value of one metre: 1000 for millimetres, 5000 for TUM files.
        order : {"bgr", "rgb"}
            Order of the colour channels; OpenCV delivers BGR.
        depth_delay : float
            Seconds from the instant of ``colour`` to that of ``depth``.
        is_own : bool
            Whether the memory of the images given is not written to any more. Where none of it is
            taken, as of BGR and uint16 images, that does not matter.

        Returns
        -------
        Frame
            Grey contiguous input and clean float32 depth are taken without a copy; the input is
            never changed.

        Raises
        ------
        FrameError
            If an image is none of these, or their sizes differ.
        NoDepthError
            If no depth value is valid.

        Examples
        --------
        >>> colour = np.full((480, 640, 3), 128, np.uint8)
        >>> depth = np.full((480, 640), 1500, np.uint16)
        >>> float(Frame.from_images(0.0, colour, depth, depth_scale=1000.0).depth[0, 0])
        1.5
        """
        _check_same_size("colour", _array("colour", colour), _array("depth", depth))
        grey, metres = _to_grey(colour, order), _to_metres(depth, depth_scale)
        taken = np.may_share_memory(grey, colour) or np.may_share_memory(metres, depth)
        return cls(timestamp, grey, metres, depth_delay, is_own or not taken)

    def delayed(self, seconds: float) -> "Frame":
        """Give the frame with another instant of its depth.

        Parameters
        ----------
        seconds : float
            ``depth_delay``.

        Returns
        -------
        Frame
            Of the same images.

        Raises
        ------
        FrameError
            If they are not finite.
        """
        other = copy.copy(self)  # not looked through again
        object.__setattr__(other, "depth_delay", finite_seconds("depth_delay", seconds))
        object.__setattr__(other, "_copy", None)
        return other

    def kept(self) -> "Frame":
        """Give the frame with images that nobody writes to.

        Returns
        -------
        Frame
            The same one if its images are such; else with copies of them, made once.
        """
        if self.is_own:
            return self
        if self._copy is not None:
            return self._copy
        other = copy.copy(self)  # not looked through again
        for name in ("grey", "depth"):
            object.__setattr__(other, name, getattr(self, name).copy())
        other._close()
        object.__setattr__(other, "is_own", True)
        object.__setattr__(self, "_copy", other)
        return other


def finite_seconds(name: str, given: object) -> float:
    """Read a time that was given.

    Parameters
    ----------
    name : str
        What to call it in an error.
    given : object
        Seconds.

    Returns
    -------
    float

    Raises
    ------
    FrameError
        If it is no finite number.
    """
    seconds = _number(given)
    if not math.isfinite(seconds):
        raise FrameError(f"{name} is {given!r:.60}; give finite seconds")
    return seconds


def _number(given: object) -> float:
    """What was given as one, or NaN."""
    if isinstance(given, np.ndarray) and not given.ndim:
        given = given[()]  # a scalar of its type
    if isinstance(given, NO_NUMBERS):
        return math.nan
    try:
        return float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def register_depth(
    depth: NDArray[Any], depth_camera: Camera, colour_camera: Camera, T_colour_depth: ArrayLike
) -> NDArray[np.float32]:
    """Carry a depth image into the view of the colour camera.

    Each depth pixel is moved to the colour camera and covers there the pixels whose centres lie
    in its footprint, so that no holes open where the colour image is finer; the nearer surface
    wins where two meet.

    Parameters
    ----------
    depth : ndarray of float, shape (depth_camera.height, depth_camera.width)
        Metres, 0 or NaN where missing.
    depth_camera, colour_camera : Camera
        Of the two images as they are, with their distortion.
    T_colour_depth : array_like of float, shape (4, 4)
        Maps points from the depth camera to the colour camera, metres.

    Returns
    -------
    ndarray of float32, shape (colour_camera.height, colour_camera.width)
        Depth along z of the colour camera, metres, 0 where nothing was seen.

    Raises
    ------
    FrameError
        If the depth image has another shape or type, or the motion is no rigid one.
    """
    depth = _array("depth", depth)
    if depth.dtype.kind != "f" or depth.shape != (depth_camera.height, depth_camera.width):
        raise FrameError(
            f"depth is {depth.dtype} {_size(depth)}; register_depth wants metres (float32) of "
            f"the depth camera's {depth_camera.width}x{depth_camera.height}"
        )
    T = se3.checked(T_colour_depth)
    if T is None:
        raise FrameError(
            "T_colour_depth is no rigid motion; give a 4x4 matrix of a rotation and a translation"
        )

    from edvo import kernels  # the reader of a single camera need not wait for the compiler

    # Two types are enough for compiled code, which takes a writable array for another one.
    depth = np.ascontiguousarray(depth, np.float32 if depth.dtype == np.float32 else np.float64)
    depth = depth.view()
    depth.setflags(write=False)
    to = colour_camera
    image = np.empty((to.height, to.width), np.float32)
    kernels.splat_depth(
        depth,
        _turned_rays(depth_camera, T[:3, :3].tobytes()),
        T[:3, 3].copy(),
        kernels.Pinhole(to.fx, to.fy, to.cx, to.cy, to.width, to.height),
        kernels.Lens(*to.distortion),
        to.fold,
        _LARGEST_FOOTPRINT,
        image,
    )
    return image


@functools.lru_cache(maxsize=4)
def _turned_rays(camera: Camera, rotation: bytes) -> NDArray[np.float64]:
    """Corner rays in the axes of the other camera, shape (3, H + 1, W + 1); once a rig."""
    R = np.frombuffer(rotation).reshape(3, 3)
    rays = np.ascontiguousarray(np.moveaxis(_corner_rays(camera) @ R.T, 2, 0))
    rays.flags.writeable = False
    return rays


@functools.lru_cache(maxsize=4)
def _corner_rays(camera: Camera) -> NDArray[np.float64]:
    """Points of unit depth at the corners of the pixels, shape (H + 1, W + 1, 3)."""
    u, v = np.meshgrid(np.arange(camera.width + 1) - 0.5, np.arange(camera.height + 1) - 0.5)
    rays = camera.backproject(np.column_stack((u.ravel(), v.ravel())), np.ones(u.size))
    rays.flags.writeable = False  # shared by every caller
    return rays.reshape(*u.shape, 3)


def _to_grey(colour: NDArray[Any], order: str) -> NDArray[np.uint8]:
    if colour.dtype != np.uint8:
        raise FrameError(f"colour is {colour.dtype}; give uint8, 0 to 255")
    if order not in ("bgr", "rgb"):
        raise FrameError(f"order is {order!r}; give 'bgr' or 'rgb'")
    if colour.ndim == 2:
        return np.ascontiguousarray(colour)
    channels = colour.shape[2] if colour.ndim == 3 else 0
    if channels == 1:
        return np.ascontiguousarray(colour[:, :, 0])
    if (order, channels) not in _GREY_CODES:
        raise FrameError(f"colour has shape {colour.shape}; give (H, W), (H, W, 3) or (H, W, 4)")
    # OpenCV's weights, as every image in the paper's comparisons was made grey.
    grey = cv2.cvtColor(np.ascontiguousarray(colour), _GREY_CODES[order, channels])
    return np.asarray(grey, dtype=np.uint8)


def _to_metres(depth: NDArray[Any], depth_scale: float) -> NDArray[np.float32]:
    if depth.ndim == 3 and depth.shape[2] == 1:
        depth = depth[:, :, 0]
    if depth.ndim != 2:
        raise FrameError(f"depth has shape {depth.shape}; give (H, W)")
    kind, size = depth.dtype.kind, depth.dtype.itemsize  # whatever the byte order
    if kind == "u" and size == 2:
        scale = _number(depth_scale)
        if not LEAST_SCALE < scale < math.inf:
            raise FrameError(f"depth_scale is {depth_scale!r}; give the depth value of one metre")
        metres = depth.astype(np.float32, order="C")  # the image may be a turned one
        metres /= np.float32(scale)
        return metres
    if kind != "f" or size not in (4, 8):
        raise FrameError(f"depth is {depth.dtype}; give uint16 with depth_scale, or float32 metres")
    with np.errstate(over="ignore"):
        metres = np.ascontiguousarray(depth, dtype=np.float32)
    if not (metres.min() >= 0.0 and metres.max() < np.inf):
        metres = np.where((metres > 0.0) & (metres < np.inf), metres, np.float32(0.0))
    return metres


def _array(name: str, image: Any) -> NDArray[Any]:
    if not isinstance(image, np.ndarray):
        raise FrameError(
            f"{name} is {type(image).__name__}; give a NumPy array (None: the file was not read)"
        )
    if isinstance(image, np.ma.MaskedArray):
        raise FrameError(f"{name} is a masked array; give {name}.filled(0), or a plain one")
    if image.size == 0:
        raise FrameError(f"{name} has shape {image.shape}; give an image with pixels")
    return image


def _check_image(name: str, image: Any, dtype: "np.dtype[Any]") -> None:
    image = _array(name, image)
    if image.dtype != dtype or image.ndim != 2:
        raise FrameError(
            f"{name} is {image.dtype} of shape {image.shape}; give {dtype} of shape (H, W), "
            "or use Frame.from_images"
        )
    if not image.flags.c_contiguous:
        raise FrameError(f"{name} is not C-contiguous; use Frame.from_images, or a copy of it")


def _check_same_size(name: str, colour: NDArray[Any], depth: NDArray[Any]) -> None:
    if colour.shape[:2] != depth.shape[:2]:
        raise FrameError(
            f"{name} is {_size(colour)} and depth {_size(depth)}; "
            "register depth to colour first (edvo.frame.register_depth)"
        )


def _size(image: NDArray[Any]) -> str:
    return "x".join(str(side) for side in image.shape[1::-1]) or "a single value"
