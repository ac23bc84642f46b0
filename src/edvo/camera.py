"""The pinhole camera with lens distortion, and the scale of its depth images (§II-A)."""

import functools
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from edvo.errors import CameraError
from edvo.files import write_atomically

Image = TypeVar("Image", bound=NDArray[Any])

REQUIRED = ("width", "height", "fx", "fy", "cx", "cy")
OPTIONAL = ("distortion", "depth_scale", "name")


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera with Brown distortion.

    A *raw* pixel is one of the image as delivered, an *ideal* one where it would lie without
    distortion. Pixel centres are at integers.

    Attributes
    ----------
    width, height : int
        Image size in pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels.
    distortion : tuple of 5 float
        k1, k2, p1, p2, k3 in OpenCV's order; zeros for none.
    depth_scale : float
        Value of an integer depth image that means one metre.
    name : str
        For messages.

    Raises
    ------
    CameraError
        If a number is missing, not finite or impossible.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    depth_scale: float = 5000.0
    name: str = ""

    def __post_init__(self) -> None:
        where = f"camera {self.name}".strip()
        for key in ("width", "height", "fx", "fy", "depth_scale"):
            value = getattr(self, key)
            if not (_is_number(value) and math.isfinite(value) and value > 0):
                raise CameraError(f"{where}: {key} = {value!r}; give a number above zero")
        for key in ("width", "height"):
            if getattr(self, key) != int(getattr(self, key)):
                raise CameraError(f"{where}: {key} = {getattr(self, key)!r}; give whole pixels")
            object.__setattr__(self, key, int(getattr(self, key)))
        for key in ("cx", "cy"):
            value = getattr(self, key)
            if not (_is_number(value) and math.isfinite(value)):
                raise CameraError(f"{where}: {key} = {value!r}; give a number of pixels")
        for key in ("fx", "fy", "cx", "cy", "depth_scale"):
            object.__setattr__(self, key, float(getattr(self, key)))
        k = tuple(self.distortion)
        if len(k) not in (4, 5) or not all(_is_number(c) and math.isfinite(c) for c in k):
            raise CameraError(f"{where}: distortion = {list(k)!r}; give [k1, k2, p1, p2, k3]")
        object.__setattr__(self, "distortion", (*map(float, k), 0.0)[:5])

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> "Camera":
        """Read a camera file.

        Parameters
        ----------
        path : path-like
            YAML with the keys width, height, fx, fy, cx, cy and, where they differ from the
            defaults, distortion, depth_scale and name.

        Returns
        -------
        Camera

        Raises
        ------
        CameraError
            If the file cannot be read, or a key is missing, unknown or no number.
        """
        try:
            values = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise CameraError(f"cannot read {path}: {error.strerror or error}") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise CameraError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
        if not isinstance(values, dict):
            raise CameraError(f"{path}: expected lines such as 'fx: 525.0'")
        return cls.from_dict(values, where=str(path))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], *, where: str = "camera") -> "Camera":
        """Make a camera from named values.

        Parameters
        ----------
        values : mapping
            Keys as the attributes.
        where : str
            What to call them in an error.

        Returns
        -------
        Camera

        Raises
        ------
        CameraError
            If a key is missing, unknown or no number.
        """
        missing = [key for key in REQUIRED if key not in values]
        if missing:
            raise CameraError(f"{where}: no {missing[0]!r}; add a line '{missing[0]}: NUMBER'")
        unknown = [str(key) for key in values if key not in REQUIRED + OPTIONAL]
        if unknown:
            raise CameraError(
                f"{where}: unknown key {unknown[0]!r}; known are {', '.join(REQUIRED + OPTIONAL)}"
            )
        given = dict(values)
        if not isinstance(given.get("distortion", ()), list | tuple):
            raise CameraError(
                f"{where}: distortion = {given['distortion']!r}; give [k1, k2, p1, p2, k3]"
            )
        try:
            return cls(**given)
        except CameraError as error:
            raise CameraError(f"{where}: {str(error).partition(': ')[2]}") from None

    def to_dict(self) -> dict[str, Any]:
        """Plain values by key, as ``from_dict`` takes them."""
        return {**asdict(self), "distortion": list(self.distortion)}

    def to_yaml(self, path: str | os.PathLike[str]) -> None:
        """Write a camera file.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_atomically(path, yaml.safe_dump(self.to_dict(), sort_keys=False))

    def scaled(self, factor: float) -> "Camera":
        """Make the camera of the same image at another size.

        Parameters
        ----------
        factor : float
            Size of the new image over the old; the new size is rounded to whole pixels.

        Returns
        -------
        Camera
        """
        if not (math.isfinite(factor) and factor > 0):
            raise CameraError(f"camera {self.name}: cannot be scaled by {factor!r}".strip())
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        su, sv = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * su,
            fy=self.fy * sv,
            cx=(self.cx + 0.5) * su - 0.5,  # pixel centres are at integers
            cy=(self.cy + 0.5) * sv - 0.5,
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Intrinsic matrix, (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def is_distorted(self) -> bool:
        """Whether raw and ideal pixels differ."""
        return any(self.distortion)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points to raw pixels, pi of §II-A.

        Parameters
        ----------
        points : ndarray of float64, shape (N, 3)
            In the camera frame, metres; z > 0.

        Returns
        -------
        ndarray of float64, shape (N, 2)
        """
        points = np.asarray(points, np.float64)
        xy = points[:, :2] / points[:, 2:]
        return self.distort(xy * (self.fx, self.fy) + (self.cx, self.cy))

    def backproject(
        self, pixels: NDArray[np.floating[Any]], depth: NDArray[np.floating[Any]]
    ) -> NDArray[np.float64]:
        """Back-project raw pixels of known depth, pi^-1 of §II-A.

        Parameters
        ----------
        pixels : ndarray, shape (N, 2)
        depth : ndarray, shape (N,)
            Metres along the optical axis.

        Returns
        -------
        ndarray of float64, shape (N, 3)
            In the camera frame, metres.
        """
        xy = (self.undistort(pixels) - (self.cx, self.cy)) / (self.fx, self.fy)
        z = np.asarray(depth, np.float64)[:, None]
        return np.hstack([xy * z, z])

    def distort(self, ideal: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Where ideal pixels lie in the raw image.

        Parameters
        ----------
        ideal : ndarray, shape (N, 2)

        Returns
        -------
        ndarray of float64, shape (N, 2)
        """
        ideal = np.asarray(ideal, np.float64)
        if not self.is_distorted:
            return ideal.copy()
        centre, focal = (self.cx, self.cy), (self.fx, self.fy)
        bent, _ = self._bend((ideal - centre) / focal)
        return bent * focal + centre

    def undistort(self, raw: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Where raw pixels would lie without distortion, to 1e-9 pixels.

        Parameters
        ----------
        raw : ndarray, shape (N, 2)

        Returns
        -------
        ndarray of float64, shape (N, 2)
        """
        raw = np.asarray(raw, np.float64)
        if not self.is_distorted:
            return raw.copy()
        centre, focal = (self.cx, self.cy), (self.fx, self.fy)
        target = (raw - centre) / focal
        xy = target.copy()
        for _ in range(50):  # Newton; strong lenses take about eight
            bent, J = self._bend(xy)
            error = bent - target
            a, b, c, d = J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1]
            determinant = a * d - b * c
            xy[:, 0] -= (d * error[:, 0] - b * error[:, 1]) / determinant
            xy[:, 1] -= (a * error[:, 1] - c * error[:, 0]) / determinant
            if np.abs(error).max(initial=0) * max(focal) < 1e-9:
                break
        return xy * focal + centre

    def undistortion_table(self) -> NDArray[np.float32]:
        """Ideal pixel of each raw one.

        Returns
        -------
        ndarray of float32, shape (H, W, 2), read-only
            Computed once for each camera.
        """
        return _undistortion_table(self)

    def undistort_image(self, image: Image) -> Image:
        """Resample an image as an ideal camera would see it, by bilinear interpolation.

        Parameters
        ----------
        image : ndarray, shape (H, W) or (H, W, C)

        Returns
        -------
        ndarray, same shape and dtype
            Black where the raw image does not reach.
        """
        if not self.is_distorted:
            return image
        u, v = _resampling_maps(self)
        return cv2.remap(image, u, v, cv2.INTER_LINEAR)  # type: ignore[return-value]

    def undistort_depth(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Resample a depth image likewise, by nearest neighbour: depths must not be mixed.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.

        Returns
        -------
        ndarray of float32, shape (H, W)
        """
        if not self.is_distorted:
            return depth
        u, v = _resampling_maps(self)
        return cv2.remap(depth, u, v, cv2.INTER_NEAREST)  # type: ignore[return-value]

    def _bend(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Brown's model on normalized coordinates (N, 2), and its Jacobian (N, 2, 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = xy[:, 0], xy[:, 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2 * k2 + r2 * 3 * k3)  # d radial / d r2
        bent = np.empty_like(xy)
        bent[:, 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        bent[:, 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        J = np.empty((len(xy), 2, 2))
        J[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        J[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        J[:, 0, 1] = J[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        return bent, J


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _pixel_grid(camera: Camera) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)


@functools.lru_cache(maxsize=8)
def _undistortion_table(camera: Camera) -> NDArray[np.float32]:
    table = camera.undistort(_pixel_grid(camera)).astype(np.float32)
    table = table.reshape(camera.height, camera.width, 2)
    table.setflags(write=False)
    return table


@functools.lru_cache(maxsize=8)
def _resampling_maps(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    raw = camera.distort(_pixel_grid(camera)).astype(np.float32)
    maps = raw.reshape(camera.height, camera.width, 2)
    return np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])
