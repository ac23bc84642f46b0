"""A frame: what an RGB-D camera delivers at one instant, checked at the door."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import FrameError, NoDepthError

CHANNELS_TO_GREY = {
    ("bgr", 3): cv2.COLOR_BGR2GRAY,
    ("rgb", 3): cv2.COLOR_RGB2GRAY,
    ("bgr", 4): cv2.COLOR_BGRA2GRAY,
    ("rgb", 4): cv2.COLOR_RGBA2GRAY,
}


@dataclass(frozen=True, slots=True)
class Frame:
    """A grey image and a depth image of the same size, taken together.

    The arrays are not copied: whoever makes a frame must not write into them afterwards.

    Attributes
    ----------
    timestamp : float
        Seconds.
    grey : ndarray of uint8, shape (H, W)
    depth : ndarray of float32, shape (H, W)
        Metres along the optical axis, in the camera of the grey image; 0 where missing.

    Raises
    ------
    FrameError
        If a shape, a type or a size is wrong, or the timestamp is not finite.
    NoDepthError
        If not a single pixel has a depth.

    See Also
    --------
    Frame.from_images : for what cameras and image files give.
    """

    timestamp: float
    grey: NDArray[np.uint8]
    depth: NDArray[np.float32]

    def __post_init__(self) -> None:
        if not math.isfinite(self.timestamp):
            raise FrameError(f"timestamp {self.timestamp!r} is not finite; give it in seconds")
        for name, image, dtype in (
            ("grey", self.grey, np.uint8),
            ("depth", self.depth, np.float32),
        ):
            if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != dtype:
                raise FrameError(
                    f"{name} image is {_kind(image)}; give {np.dtype(dtype)} (H, W), "
                    "or use Frame.from_images"
                )
            if not image.flags.c_contiguous:
                object.__setattr__(self, name, np.ascontiguousarray(image))
        if self.grey.shape != self.depth.shape:
            raise FrameError(
                f"grey image is {_size(self.grey)}, depth image is {_size(self.depth)}; "
                "bring the depth into the colour camera by edvo.frame.register_depth"
            )
        if not self.grey.size:
            raise FrameError("images are empty; give at least one pixel")
        # two looks at the image tell all: NaN fails every comparison
        low, high, _, _ = cv2.minMaxLoc(self.depth)
        if not (low >= 0 and high < math.inf) or math.isnan(float(self.depth.sum())):
            raise FrameError(
                "depth image has negative or non-finite values; put 0 where depth is missing, "
                "or use Frame.from_images"
            )
        if high == 0:
            raise NoDepthError("depth image has no valid pixel; is the lens covered?")

    @classmethod
    def from_images(
        cls,
        timestamp: float,
        colour: NDArray[Any],
        depth: NDArray[Any],
        *,
        depth_scale: float = 1000.0,
        order: Literal["bgr", "rgb"] = "bgr",
    ) -> "Frame":
        """Make a frame of what cameras and image files give.

        Parameters
        ----------
        timestamp : float
            Seconds.
        colour : ndarray of uint8, shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4)
            Grey or colour, with or without alpha.
        depth : ndarray of uint16, float32 or float64, shape (H, W)
            Integers are divided by ``depth_scale``, floats are metres; NaN, infinite and
            negative values count as missing.
        depth_scale : float
            Integer value that means one metre: 1000 for millimetres, 5000 for TUM RGB-D.
        order : {"bgr", "rgb"}
            Order of the colour channels; OpenCV reads files as BGR.

        Returns
        -------
        Frame

        Raises
        ------
        FrameError
            If a shape or a type is none of these, or the sizes differ.
        NoDepthError
            If not a single pixel has a depth.
        """
        return cls(timestamp, to_grey(colour, order), to_metres(depth, depth_scale))


def to_grey(colour: NDArray[Any], order: Literal["bgr", "rgb"] = "bgr") -> NDArray[np.uint8]:
    """Grey image of a colour image.

    Parameters
    ----------
    colour : ndarray of uint8, shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4)
    order : {"bgr", "rgb"}

    Returns
    -------
    ndarray of uint8, shape (H, W)

    Raises
    ------
    FrameError
        If it is none of these.
    """
    if order not in ("bgr", "rgb"):
        raise FrameError(f"channel order {order!r}; give 'bgr' or 'rgb'")
    if isinstance(colour, np.ndarray) and colour.dtype == np.uint8:
        if colour.ndim == 2:
            return colour
        if colour.ndim == 3 and colour.shape[2] == 1:
            return colour[..., 0]
        if colour.ndim == 3 and colour.size and (order, colour.shape[2]) in CHANNELS_TO_GREY:
            code = CHANNELS_TO_GREY[order, colour.shape[2]]
            return cv2.cvtColor(np.ascontiguousarray(colour), code)  # type: ignore[return-value]
    raise FrameError(f"colour image is {_kind(colour)}; give uint8 (H, W), (H, W, 3) or (H, W, 4)")


def to_metres(depth: NDArray[Any], depth_scale: float) -> NDArray[np.float32]:
    """Depth image in metres with 0 where it is missing.

    Parameters
    ----------
    depth : ndarray of uint16, float32 or float64, shape (H, W)
        Integers are divided by ``depth_scale``, floats are metres.
    depth_scale : float
        Integer value that means one metre.

    Returns
    -------
    ndarray of float32, shape (H, W)

    Raises
    ------
    FrameError
        If it is none of these, or the scale is not above zero.
    """
    if not (math.isfinite(depth_scale) and depth_scale > 0):
        raise FrameError(f"depth scale {depth_scale!r}; give the image value of one metre")
    if isinstance(depth, np.ndarray) and depth.ndim == 3 and depth.shape[2] == 1:
        depth = depth[..., 0]
    if isinstance(depth, np.ndarray) and depth.ndim == 2:
        if depth.dtype == np.uint16:
            return depth * np.float32(1 / depth_scale)
        if depth.dtype in (np.float32, np.float64):
            with np.errstate(invalid="ignore", over="ignore"):
                metres = depth.astype(np.float32)
                metres[~((metres > 0) & (metres < np.inf))] = 0
            return metres
    raise FrameError(f"depth image is {_kind(depth)}; give uint16, float32 or float64 (H, W)")


def register_depth(
    depth: NDArray[np.float32],
    depth_camera: Camera,
    colour_camera: Camera,
    T_colour_depth: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Depth image as the colour camera sees it, from that of a separate depth camera.

    Each depth pixel is a small square patch; the patch is moved into the colour camera and
    covers all pixels that it lands on, the near one winning, so that a larger colour image gets
    no holes.

    Parameters
    ----------
    depth : ndarray of float32, shape (Hd, Wd)
        Metres in the depth camera, 0 where missing.
    depth_camera, colour_camera : Camera
        Sizes may differ; both may have distortion.
    T_colour_depth : ndarray of float64, shape (4, 4)
        Maps points from the depth camera to the colour camera.

    Returns
    -------
    ndarray of float32, shape (Hc, Wc)
        Metres in the colour camera, 0 where nothing is seen.

    Raises
    ------
    FrameError
        If the depth image does not have the size of its camera.
    """
    if depth.shape != (depth_camera.height, depth_camera.width):
        raise FrameError(
            f"depth image is {_size(depth)}, its camera "
            f"{depth_camera.width} x {depth_camera.height}; give the camera of this image"
        )
    v, u = np.nonzero(depth > 0)
    z = depth[v, u].astype(np.float64)
    corners = []
    for off in (-0.5, 0.5):
        raw = np.stack([u + off, v + off], axis=1)
        points = depth_camera.backproject(raw, z) @ T_colour_depth[:3, :3].T + T_colour_depth[:3, 3]
        front = points[:, 2] > 1e-3
        pixels = np.full((len(points), 2), -10.0)
        pixels[front] = colour_camera.project(points[front])
        corners.append((pixels, points[:, 2]))
    (low, z_low), (high, z_high) = corners
    seen = (0.5 * (z_low + z_high)).astype(np.float32)
    # half-open footprints tile: neighbours do not overlap where nothing is stretched
    first = np.ceil(np.minimum(low, high) - 1e-6).astype(np.int64)
    last = np.ceil(np.maximum(low, high) - 1e-6).astype(np.int64) - 1
    last = np.maximum(last, first)
    last = np.minimum(last, first + 8)  # a patch never covers more: beyond, it is seen edge-on
    result = np.full((colour_camera.height, colour_camera.width), np.inf, np.float32)
    for dv in range(9):
        for du in range(9):
            uu, vv = first[:, 0] + du, first[:, 1] + dv
            ok = (uu <= last[:, 0]) & (vv <= last[:, 1]) & (seen > 0)
            ok &= (uu >= 0) & (uu < colour_camera.width) & (vv >= 0) & (vv < colour_camera.height)
            if ok.any():
                np.minimum.at(result, (vv[ok], uu[ok]), seen[ok])
    result[np.isinf(result)] = 0
    return result


def _kind(image: object) -> str:
    if isinstance(image, np.ndarray):
        return f"{image.dtype} {image.shape}"
    return type(image).__name__


def _size(image: NDArray[Any]) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"
