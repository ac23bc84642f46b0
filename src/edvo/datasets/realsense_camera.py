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
_BROWN = "brown conrady"
# The SDK projects by the same formula for both, and inverts it by iteration.
_MOVED_FIRST = ("modified brown conrady", "inverse brown conrady")


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
    if kind in _MOVED_FIRST:
        ideal = shown.copy()
        for _ in range(50):
            ideal += shown - _project(ideal, given)
        if not np.abs(shown - _project(ideal, given)).max() < 1e-6:
            raise DatasetError(f"{name} has distortion that folds the image; add --camera FILE")
        return fit_brown(ideal, shown, camera, name)
    raise DatasetError(
        f"{name} has distortion '{model}', which edvo does not have; use a stream without it, or "
        "rectify the images"
    )


def _project(rays: NDArray[np.float64], coefficients: tuple[float, ...]) -> NDArray[np.float64]:
    """Brown's model, but that the tangential part is of the point that was moved radially."""
    k1, k2, p1, p2, k3 = coefficients
    s = (rays * rays).sum(axis=1)
    x, y = (rays * (1 + s * (k1 + s * (k2 + s * k3)))[:, None]).T
    return np.column_stack(
        (
            x + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y + 2 * p2 * x * y + p1 * (s + 2 * y * y),
        )
    )
