"""A camera from a ``sensor_msgs/CameraInfo``."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.ros_messages import CameraInfo
from edvo.errors import CameraError, DatasetError

_BROWN = ("", "plumb_bob", "brown_conrady")
_RATIONAL = "rational_polynomial"
_FIT_GRID = 24  # points a side
# A tenth of a pixel is what edges are located to; more would show in the poses.
_LARGEST_MISFIT_PX = 0.3

_MEND = "rectify the images (image_proc) or add --camera FILE"


def camera_from_info(info: CameraInfo, *, rectified: bool, depth_scale: float, name: str) -> Camera:
    """Make the camera that a driver described.

    Parameters
    ----------
    info : CameraInfo
        What it published.
    rectified : bool
        Whether the images are rectified, so that P holds and not K and D.
    depth_scale : float
        Depth value of one metre.
    name : str
        The topic, named in errors.

    Returns
    -------
    Camera
        With Brown distortion; a rational model is fitted by it, if that can be done to 0.3 px.

    Raises
    ------
    DatasetError
        If the camera was not calibrated, or has a distortion that edvo does not have.
    """
    if not (info.width and info.height):
        raise DatasetError(f"{name} has no image size; add --camera FILE")
    values = info.projection if rectified else info.intrinsics
    fx, cx, fy, cy = (values[i] for i in ((0, 2, 5, 6) if rectified else (0, 2, 4, 5)))
    if not (fx > 0.0 and fy > 0.0 and all(map(math.isfinite, values))):
        matrix = "P" if rectified else "K"
        raise DatasetError(f"{name} is not calibrated (fx {fx:g} in {matrix}); add --camera FILE")
    try:
        camera = Camera(
            width=info.width,
            height=info.height,
            fx=fx,
            fy=fy,
            cx=cx,
            cy=cy,
            depth_scale=depth_scale,
        )
        if rectified or not any(info.distortion):
            return camera
        return replace(camera, distortion=_distortion(info, camera, name))
    except CameraError as error:
        raise DatasetError(f"{name}: {error}; add --camera FILE") from error


def _distortion(
    info: CameraInfo, camera: Camera, name: str
) -> tuple[float, float, float, float, float]:
    given = info.distortion
    model = info.model.lower()
    if not all(map(math.isfinite, given)):
        raise DatasetError(f"{name} has distortion that is no number; {_MEND}")
    if model in _BROWN and len(given) in (4, 5):
        k1, k2, p1, p2, k3 = (*given, 0.0)[:5]
        return k1, k2, p1, p2, k3
    if model not in (*_BROWN, _RATIONAL) or len(given) < 8 or any(given[8:]):
        raise DatasetError(
            f"{name} has distortion '{info.model}' with {len(given)} coefficients, which edvo "
            f"does not have; {_MEND}"
        )
    if not any(given[5:8]):
        return given[0], given[1], given[2], given[3], given[4]
    return _fit(given, camera, name)


def _fit(
    rational: tuple[float, ...], camera: Camera, name: str
) -> tuple[float, float, float, float, float]:
    """Fit Brown's model to a rational one over the image, by linear least squares."""
    u, v = np.meshgrid(
        np.linspace(0, camera.width - 1, _FIT_GRID), np.linspace(0, camera.height - 1, _FIT_GRID)
    )
    shown = np.column_stack(
        ((u.ravel() - camera.cx) / camera.fx, (v.ravel() - camera.cy) / camera.fy)
    )
    ideal = shown.copy()
    with np.errstate(all="ignore"):
        for _ in range(100):
            ideal += 0.7 * (shown - _rational(ideal, rational))
        left = np.abs(shown - _rational(ideal, rational)).max()
    if not left < 1e-6:
        raise DatasetError(f"{name} has distortion that folds the image; {_MEND}")
    return fit_brown(ideal, shown, camera, name)


def fit_brown(
    ideal: NDArray[np.float64], shown: NDArray[np.float64], camera: Camera, name: str
) -> tuple[float, float, float, float, float]:
    """Fit Brown's model to what another one does, by linear least squares.

    Parameters
    ----------
    ideal, shown : ndarray of float64, shape (N, 2)
        Normalised coordinates without distortion and with it.
    camera : Camera
        Gives the focal lengths.
    name : str
        Named in errors.

    Returns
    -------
    tuple of float
        k1 k2 p1 p2 k3.

    Raises
    ------
    DatasetError
        If it misses by more than 0.3 px.
    """
    x, y = ideal.T
    s = x * x + y * y
    # Both rows of Brown's model are linear in k1 k2 p1 p2 k3.
    system = np.concatenate(
        [
            np.column_stack((x * s, x * s**2, 2 * x * y, s + 2 * x * x, x * s**3)) * camera.fx,
            np.column_stack((y * s, y * s**2, s + 2 * y * y, 2 * x * y, y * s**3)) * camera.fy,
        ]
    )
    target = np.concatenate([(shown - ideal)[:, 0] * camera.fx, (shown - ideal)[:, 1] * camera.fy])
    found = np.linalg.lstsq(system, target, rcond=None)[0]
    misfit = float(np.abs(system @ found - target).max())
    if misfit > _LARGEST_MISFIT_PX:
        raise DatasetError(
            f"{name} has a distortion that Brown's misses by {misfit:.1f} px; {_MEND}"
        )
    k1, k2, p1, p2, k3 = map(float, found)
    return k1, k2, p1, p2, k3


def _rational(rays: NDArray[np.float64], coefficients: tuple[float, ...]) -> NDArray[np.float64]:
    """OpenCV's rational model on normalised coordinates."""
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients[:8]
    x, y = rays.T
    s = x * x + y * y
    radial = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
    return np.column_stack(
        (
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        )
    )
