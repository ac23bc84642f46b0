"""RealSense's camera models as edvo's.

The formulas are those of librealsense's ``rsutil.h``.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.ros_camera import fit_brown
from edvo.errors import CameraError, DatasetError

_GRID = 24  # points a side
_NONE, _BROWN, _MODIFIED, _INVERSE = (
    "none",
    "brown conrady",
    "modified brown conrady",
    "inverse brown conrady",
)


def realsense_camera(
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
    *,
    model: str,
    coefficients: Sequence[float],
    depth_scale: float,
    name: str,
) -> Camera:
    """Make a camera of RealSense's intrinsics.

    Parameters
    ----------
    size : (int, int)
        Width and height.
    focal, centre : (float, float)
        ``fx fy`` and ``ppx ppy``, pixels.
    model : str
        Of the distortion, by RealSense's name, such as ``Inverse Brown Conrady``.
    coefficients : sequence of float
        Five of them.
    depth_scale : float
        Depth value of one metre.
    name : str
        Named in errors.

    Returns
    -------
    Camera
        With Brown's distortion; the other two kinds are fitted by it, if that can be done to
        0.3 px.

    Raises
    ------
    DatasetError
        If the camera has no numbers, or a fisheye's distortion.
    """
    try:
        camera = Camera(*size, *focal, *centre, depth_scale=depth_scale)
        if not any(coefficients):
            return camera
        return replace(camera, distortion=_distortion(camera, model, coefficients, name))
    except CameraError as error:
        raise DatasetError(f"{name}: {error}; add --camera FILE") from error


def _distortion(
    camera: Camera, model: str, coefficients: Sequence[float], name: str
) -> tuple[float, float, float, float, float]:
    kind = model.lower().replace("_", " ").removeprefix("distortion.")
    k1, k2, p1, p2, k3 = map(float, coefficients)
    if kind == _BROWN:
        return k1, k2, p1, p2, k3
    u, v = np.meshgrid(
        np.linspace(0, camera.width - 1, _GRID), np.linspace(0, camera.height - 1, _GRID)
    )
    shown = np.column_stack(
        ((u.ravel() - camera.cx) / camera.fx, (v.ravel() - camera.cy) / camera.fy)
    )
    given = k1, k2, p1, p2, k3
    if kind == _INVERSE:  # the polynomial leads from the image to the ray
        return fit_brown(_brown(shown, given, scaled=False), shown, camera, name)
    if kind == _MODIFIED:
        # Brown's, but that the tangential part is of the point already moved.
        ideal = shown.copy()
        for _ in range(50):
            ideal += shown - _brown(ideal, given, scaled=True)
        if not np.abs(shown - _brown(ideal, given, scaled=True)).max() < 1e-6:
            raise DatasetError(f"{name} has distortion that folds the image; add --camera FILE")
        return fit_brown(ideal, shown, camera, name)
    raise DatasetError(
        f"{name} has distortion '{model}', which edvo does not have; use a stream without it, or "
        "rectify the images"
    )


def _brown(
    rays: NDArray[np.float64], coefficients: tuple[float, ...], *, scaled: bool
) -> NDArray[np.float64]:
    k1, k2, p1, p2, k3 = coefficients
    x, y = rays.T
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    moved_x, moved_y = x * radial, y * radial
    if scaled:
        x, y = moved_x, moved_y
    return np.column_stack(
        (
            moved_x + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            moved_y + 2 * p2 * x * y + p1 * (s + 2 * y * y),
        )
    )
