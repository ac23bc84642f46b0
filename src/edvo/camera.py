"""The pinhole camera with Brown distortion, and its depth scale (§II-A).

Pixel centres lie at integers; camera axes point x right, y down, z forward. A *raw* pixel is one
of the image as delivered, an *ideal* pixel one of the same camera without distortion.
"""

import contextlib
import functools
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from edvo.errors import CameraError
from edvo.files import write_atomically
from edvo.plain_yaml import read_plain

_POSITIVE = ("width", "height", "fx", "fy", "depth_scale")
_COEFFICIENTS = "k1 k2 p1 p2 k3"
_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "distortion", "depth_scale")
_FIXED_POINT_STEPS = 4  # brings Newton into its basin for strong distortion
_NEWTON_STEPS = 12
_CONVERGED = 1e-12  # of normalised coordinates: 1e-9 px at a focal length of 1000 px


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with Brown distortion (Eq. 1; distortion as in OpenCV).

    Attributes
    ----------
    width, height : int
        Image size, pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels.
    distortion : tuple of float
        k1, k2, p1, p2, k3; four values leave k3 at zero.
    depth_scale : float
        Value of the depth image that stands for one metre: 1000 for millimetres, as most cameras
        have it; 5000 in TUM files.
    name : str
        What to call it in messages and reports.

    Raises
    ------
    CameraError
        If a value is no finite number, a size, focal length or depth scale is not positive, or
        the distortion folds the image over itself.

    Examples
    --------
    >>> camera = Camera(640, 480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
    >>> camera.project([[0.1, 0.0, 1.0]])
    array([[372. , 239.5]])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    depth_scale: float = 1000.0
    name: str = ""

    def __post_init__(self) -> None:
        # Plain Python numbers, so that cameras compare, hash and print alike.
        for field in fields(self):
            value: Any = getattr(self, field.name)
            if field.name == "distortion":
                value = _coefficients(value)
            elif field.name != "name":
                value = _number(field.name, value)
            object.__setattr__(self, field.name, value)
        if self.is_distorted and not _covers_image(self):
            raise CameraError(
                f"distortion {list(self.distortion)} folds the image over itself; "
                f"check the order, {_COEFFICIENTS}"
            )

    @classmethod
    def from_dict(cls, d: Mapping[str, Any], where: str = "camera") -> "Camera":
        """Build a camera from keys and values.

        Parameters
        ----------
        d : mapping
            ``width height fx fy cx cy depth_scale``, with ``distortion`` where the lens has some,
            and ``name`` if wanted.
        where : str
            Named in errors: the file or whatever else the values come from.

        Returns
        -------
        Camera

        Raises
        ------
        CameraError
            If a key is unknown or missing, or a value impossible.
        """
        if not isinstance(d, Mapping):
            raise CameraError(f"{where}: no camera; write one 'key: value' a line: {_list(_KEYS)}")
        unknown = [str(key) for key in d if key not in (*_KEYS, "name")]
        if unknown:
            raise CameraError(
                f"{where}: unknown key {_list(unknown)}; remove it, the keys are {_list(_KEYS)}"
            )
        missing = [key for key in _KEYS if key not in d and key != "distortion"]
        if missing:
            raise CameraError(
                f"{where}: missing key {_list(missing)}; add a line '{missing[0]}: VALUE'"
            )
        try:
            return cls(**{**d, "name": str(d.get("name") or "")})
        except CameraError as error:
            raise CameraError(f"{where}: {error}") from error

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> "Camera":
        """Read a camera file.

        Parameters
        ----------
        path : path-like
            YAML with the keys of `from_dict`.

        Returns
        -------
        Camera

        Raises
        ------
        CameraError
            If the file is missing or no YAML, or the camera in it impossible.
        """
        try:
            data = read_plain(Path(path).read_text(encoding="utf-8-sig"))
        except OSError as error:
            raise CameraError(
                f"cannot read {path}: {error.strerror or error}; give a camera file"
            ) from error
        except UnicodeDecodeError as error:
            raise CameraError(f"{path} is no text file; give a camera file in YAML") from error
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = f" in line {mark.line + 1}" if mark is not None else ""
            problem = getattr(error, "problem", None) or "it cannot be parsed"
            raise CameraError(
                f"{path} is no YAML: {problem}{line}; write one 'key: value' a line"
            ) from error
        return cls.from_dict(data, where=str(path))

    def to_dict(self) -> dict[str, Any]:
        """Give keys and values that `from_dict` takes, all of plain types.

        Returns
        -------
        dict
            ``name`` only where there is one.
        """
        values: dict[str, Any] = {key: getattr(self, key) for key in _KEYS}
        values["distortion"] = list(self.distortion)
        return {**values, "name": self.name} if self.name else values

    def to_yaml(self, path: str | os.PathLike[str]) -> None:
        """Write a camera file, whole or not at all.

        Parameters
        ----------
        path : path-like
            File to write.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        comments = {"distortion": _COEFFICIENTS, "depth_scale": "image value of one metre"}
        lines = []
        for key, value in self.to_dict().items():
            comment = f"  # {comments[key]}" if key in comments else ""
            style = None if isinstance(value, list) else False  # a list in one line
            text = yaml.safe_dump({key: value}, default_flow_style=style, width=1000).strip()
            lines.append(f"{text}{comment}\n")
        write_atomically(path, "".join(lines))

    def scaled(self, factor: float) -> "Camera":
        """Give the camera of the resized image.

        Parameters
        ----------
        factor : float
            Size after over size before; 0.5 halves.

        Returns
        -------
        Camera
            Sizes rounded to whole pixels; the rest follows the sizes as rounded, as
            ``cv2.resize`` to that size does, so both axes can differ a little from ``factor``.

        Raises
        ------
        CameraError
            If no pixel would be left.
        """
        factor = _number("factor", factor)
        width, height = round(self.width * factor), round(self.height * factor)
        if width < 1 or height < 1:
            raise CameraError(
                f"a {self.width}x{self.height} image scaled by {factor} has no pixel left; "
                "take a larger factor"
            )
        sx, sy = width / self.width, height / self.height
        return Camera(
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            # The image spans -0.5 to width - 0.5, since pixel centres lie at integers.
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            distortion=self.distortion,
            depth_scale=self.depth_scale,
            name=self.name,
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Intrinsic matrix, float64 (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return any(self.distortion)

    @property
    def fold(self) -> float:
        """Squared radius, of normalised coordinates, at which distortion turns back inwards."""
        return _fold(self.distortion)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project points of the camera frame, pi of Eq. (1).

        Parameters
        ----------
        points : array_like of float, shape (N, 3)
            Metres, camera frame.

        Returns
        -------
        ndarray of float64, shape (N, 2)
            Raw pixels u, v, inside the image or not; NaN for points that are not in front of
            the camera, or so far out that the distortion would fold them back inwards.
        """
        points = _table(points, 3)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            rays = points[:, :2] / points[:, 2:]
            rays[~(points[:, 2] > 0.0)] = np.nan
            if self.is_distorted:
                fold = _fold(self.distortion)
                rays[(rays * rays).sum(axis=1) >= fold] = np.nan
                rays = _distort(rays, self.distortion)
        return self._pixels(rays)

    def backproject(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Find the points seen at pixels, pi^-1 of Eq. (1).

        Parameters
        ----------
        pixels : array_like of float, shape (N, 2)
            Raw pixels u, v.
        depth : array_like of float, shape (N,)
            Depth along z, metres.

        Returns
        -------
        ndarray of float64, shape (N, 3)
            Metres, camera frame.
        """
        z = np.asarray(depth, dtype=np.float64)
        rays = self._rays(self.undistort(pixels))
        return np.column_stack((rays * z[:, None], z))

    def distort(self, ideal: ArrayLike) -> NDArray[np.float64]:
        """Move ideal pixels to where the lens shows them.

        Parameters
        ----------
        ideal : array_like of float, shape (N, 2)
            Ideal pixels u, v.

        Returns
        -------
        ndarray of float64, shape (N, 2)
            Raw pixels u, v.
        """
        ideal = _table(ideal, 2)
        if not self.is_distorted:
            return ideal.copy()
        return self._pixels(_distort(self._rays(ideal), self.distortion))

    def undistort(self, raw: ArrayLike) -> NDArray[np.float64]:
        """Take the lens distortion out of pixels, the inverse of `distort`.

        Parameters
        ----------
        raw : array_like of float, shape (N, 2)
            Raw pixels u, v.

        Returns
        -------
        ndarray of float64, shape (N, 2)
            Ideal pixels u, v, to 1e-8 px on the whole image; NaN where far outside of the image
            the distortion has no inverse.
        """
        raw = _table(raw, 2)
        if not self.is_distorted:
            return raw.copy()
        return self._pixels(_undistort(self._rays(raw), self.distortion))

    def undistortion_table(self) -> NDArray[np.float32]:
        """Give the ideal pixel of each raw pixel.

        Returns
        -------
        ndarray of float32, shape (H, W, 2)
            Ideal u, v at raw row, column; computed once a camera, shared and read-only.
        """
        return _undistortion_table(self)

    def undistort_image(self, image: NDArray[Any]) -> NDArray[Any]:
        """Make the image that the camera would take without distortion.

        Parameters
        ----------
        image : ndarray, shape (H, W) or (H, W, C)
            Grey or colour.

        Returns
        -------
        ndarray, same shape and type
            Bilinear; what the lens did not see repeats the border, so that no edge appears.
        """
        self._same_size(image)
        if not self.is_distorted:
            return image
        u, v = _distortion_maps(self)
        return cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def undistort_depth(self, depth: NDArray[Any]) -> NDArray[Any]:
        """Make the depth image that the camera would take without distortion.

        Parameters
        ----------
        depth : ndarray, shape (H, W)
            Metres or sensor units, 0 where missing.

        Returns
        -------
        ndarray, same shape and type
            Nearest neighbour, as a mean over an occluding edge is the depth of nothing.
        """
        self._same_size(depth)
        if not self.is_distorted:
            return depth
        u, v = _distortion_maps(self)
        return cv2.remap(depth, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)

    def _rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        pixels = _table(pixels, 2)
        return (pixels - [self.cx, self.cy]) / [self.fx, self.fy]

    def _pixels(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        return rays * [self.fx, self.fy] + [self.cx, self.cy]

    def _same_size(self, image: NDArray[Any]) -> None:
        if image.shape[:2] != (self.height, self.width):
            size = "x".join(str(side) for side in image.shape[1::-1])
            raise CameraError(
                f"image of {size} and camera of {self.width}x{self.height}; "
                "give the camera of this image"
            )


def _distort(
    rays: NDArray[np.float64], coefficients: tuple[float, float, float, float, float]
) -> NDArray[np.float64]:
    """Brown's model on normalised coordinates, as in OpenCV."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = rays[:, 0], rays[:, 1]
    xx, yy, xy = x * x, y * y, x * y
    s = xx + yy
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    return np.column_stack(
        (
            x * radial + 2.0 * p1 * xy + p2 * (s + 2.0 * xx),
            y * radial + p1 * (s + 2.0 * yy) + 2.0 * p2 * xy,
        )
    )


def _jacobian(
    rays: NDArray[np.float64], coefficients: tuple[float, float, float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Derivative of `_distort`: d x'/dx, d x'/dy = d y'/dx, d y'/dy."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = rays[:, 0], rays[:, 1]
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))  # d radial / ds, twice
    return (
        radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
        radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


def _undistort(
    raw: NDArray[np.float64], coefficients: tuple[float, float, float, float, float]
) -> NDArray[np.float64]:
    """Invert `_distort`: a few fixed-point steps, then Newton; NaN where that fails."""
    rays = raw.copy()
    with np.errstate(all="ignore"):
        for _ in range(_FIXED_POINT_STEPS):
            rays = rays + 0.5 * (raw - _distort(rays, coefficients))
        error = _distort(rays, coefficients) - raw
        for _ in range(_NEWTON_STEPS):
            xx, xy, yy = _jacobian(rays, coefficients)
            determinant = xx * yy - xy * xy
            step_x = (yy * error[:, 0] - xy * error[:, 1]) / determinant
            step_y = (xx * error[:, 1] - xy * error[:, 0]) / determinant
            rays = rays - np.column_stack((step_x, step_y))
            error = _distort(rays, coefficients) - raw
            if not (np.abs(error) > _CONVERGED).any():
                break
        failed = ~(np.abs(error).max(axis=1) <= _CONVERGED * (1.0 + np.abs(raw).max(axis=1)))
        failed |= (rays * rays).sum(axis=1) >= _fold(coefficients)
    rays[failed] = np.nan
    return rays


@functools.lru_cache(maxsize=64)
def _fold(coefficients: tuple[float, float, float, float, float]) -> float:
    """Squared normalised radius beyond which the radial distortion turns back inwards."""
    k1, k2, _, _, k3 = coefficients
    # A leading coefficient next to nothing would overflow the quotients that np.roots takes.
    polynomial = [c if abs(c) > 1e-12 else 0.0 for c in (7.0 * k3, 5.0 * k2, 3.0 * k1)]
    roots = np.roots([*polynomial, 1.0])
    turning = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)]
    return float(turning.min()) if len(turning) else math.inf


def _covers_image(camera: Camera) -> bool:
    """Whether each pixel of the image has an ideal one: seen on its outline."""
    along = np.linspace(0.0, 1.0, 17)
    u, v = along * camera.width - 0.5, along * camera.height - 0.5
    outline = np.concatenate(
        [
            np.column_stack((u, np.full(17, -0.5))),
            np.column_stack((u, np.full(17, camera.height - 0.5))),
            np.column_stack((np.full(17, -0.5), v)),
            np.column_stack((np.full(17, camera.width - 0.5), v)),
        ]
    )
    rays = camera._rays(camera.undistort(outline))
    if not np.isfinite(rays).all():
        return False
    # No fold on the way out either, tangential terms included.
    inside = np.concatenate([rays * share for share in np.linspace(0.0, 1.0, 9)])
    xx, xy, yy = _jacobian(inside, camera.distortion)
    return bool((xx * yy > xy * xy).all() and (xx > 0.0).all())


@functools.lru_cache(maxsize=8)
def _undistortion_table(camera: Camera) -> NDArray[np.float32]:
    table = camera.undistort(_grid(camera)).reshape(camera.height, camera.width, 2)
    result = table.astype(np.float32)
    result.flags.writeable = False  # shared by every caller
    return result


@functools.lru_cache(maxsize=8)
def _distortion_maps(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Raw column and row of each ideal pixel, for cv2.remap."""
    raw = camera.distort(_grid(camera)).reshape(camera.height, camera.width, 2)
    u, v = raw[:, :, 0].astype(np.float32), raw[:, :, 1].astype(np.float32)
    u.flags.writeable = v.flags.writeable = False
    return u, v


def _grid(camera: Camera) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.column_stack((u.ravel(), v.ravel())).astype(np.float64)


def _table(values: ArrayLike, columns: int) -> NDArray[np.float64]:
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != columns:
        raise CameraError(f"array of shape {table.shape}; give shape (N, {columns})")
    return table


def _number(key: str, value: Any) -> float | int:
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)  # YAML takes 1e-3 for text, since it has no point
    if isinstance(value, bool | np.bool_) or not isinstance(
        value, int | float | np.integer | np.floating
    ):
        raise CameraError(f"{key} is {value!r}; write a number")
    number = float(value)
    if not math.isfinite(number):
        raise CameraError(f"{key} is {number}; write a finite number")
    if key in (*_POSITIVE, "factor") and number <= 0.0:
        mend = "; for an image whose y axis points up, flip it" if key == "fy" else ""
        raise CameraError(f"{key} is {value}; it must be positive{mend}")
    if key in ("width", "height"):
        if number != int(number):
            raise CameraError(f"{key} is {value}; write whole pixels")
        return int(number)
    return number


def _coefficients(value: Any) -> tuple[float, float, float, float, float]:
    items = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(items, list | tuple) or len(items) not in (4, 5):
        raise CameraError(f"distortion is {items!r}; write five numbers [{_COEFFICIENTS}]")
    k1, k2, p1, p2, k3 = (float(_number("distortion", item)) for item in (*items, 0.0)[:5])
    return k1, k2, p1, p2, k3


def _list(names: "tuple[str, ...] | list[str]") -> str:
    return ", ".join(names)
