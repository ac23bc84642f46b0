"""A smooth guess at the surfaces behind a noisy depth image, for light to fall on."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera

Field = NDArray[np.float32]

# All lengths in cells; a cell is 4 pixels of an image 640 wide.
_CELL = 4.0 / 640.0
_LAG = 2
_SMOOTH = 6.0
_FAR = 16.0
# Over two lags, more than this share of the depth is a gap between surfaces, not a slope: a plane
# is taken up to about 80 degrees at the focal length of a Kinect.
_GAP = 0.12
# Weight of a guess from further away against what is near.
_DOUBT = 0.05


@dataclass(frozen=True)
class Surface:
    """Points and normals on a coarse grid over an image.

    Parameters
    ----------
    points : ndarray of float32, shape (h, w, 3)
        Camera frame, metres.
    normals : ndarray of float32, shape (h, w, 3)
        Unit length, towards the camera.
    size : (int, int)
        Rows and columns of the image.
    """

    points: Field
    normals: Field
    size: tuple[int, int]

    def spread(self, field: Field) -> Field:
        """Bring a field on the grid to the size of the image.

        Parameters
        ----------
        field : ndarray of float32, shape (h, w)
            A value a cell.

        Returns
        -------
        ndarray of float32, shape (H, W)
            Smooth between the cells.
        """
        height, width = self.size
        return np.asarray(
            cv2.resize(field, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32
        )


def estimate_surface(depth: NDArray[np.float32], camera: Camera) -> Surface:
    """Guess points and normals that vary smoothly, whatever the noise and the holes.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing; not a single valid pixel is fine.
    camera : Camera
        Its focal lengths and principal point. Lens distortion bends no surface enough to be seen
        in its shading, and is not used.

    Returns
    -------
    Surface
        Holes continue what is round them; far from any surface it faces the camera.

    Notes
    -----
    A plane ``n . X = 1`` has the inverse depth ``n . (x, y, 1)``, which is linear in the image:
    averages and differences of inverse depth are exact on planes. Normals are taken across a
    distance at which the noise is small, not across gaps in depth, and then averaged. What is
    lit by them therefore has no edge where the depth has noise or a hole; nor a sharp one where
    a wall meets another, since a shading whose edge is a little off would mislead more.
    """
    height, width = depth.shape
    size = (max(round(height / (_CELL * width)), 2), max(round(1 / _CELL), 2))
    known = (depth > 0).astype(np.float32)
    inverse = np.divide(known, depth, out=np.zeros_like(depth), where=depth > 0)
    weight = _shrunk(known, size)
    rho = np.asarray(_shrunk(inverse, size) / np.maximum(weight, np.float32(1e-6)), np.float32)
    weight = (weight > 0.25).astype(np.float32)

    # The centre of a cell in normalised coordinates, and the step to the next one.
    step_x, step_y = width / size[1] / camera.fx, height / size[0] / camera.fy
    x = (((np.arange(size[1]) + 0.5) * width / size[1] - 0.5) - camera.cx) / camera.fx
    y = (((np.arange(size[0]) + 0.5) * height / size[0] - 0.5) - camera.cy) / camera.fy
    rays = np.ones((*size, 3), np.float32)
    rays[..., 0], rays[..., 1] = x[None, :], y[:, None]

    rho_x, known_x = _slope(rho, weight, axis=1)
    rho_y, known_y = _slope(rho, weight, axis=0)
    normals = np.empty((*size, 3), np.float32)
    normals[..., 0] = rho_x / step_x
    normals[..., 1] = rho_y / step_y
    normals[..., 2] = rho - rays[..., 0] * normals[..., 0] - rays[..., 1] * normals[..., 1]
    normals = -_unit(normals)
    normals = _unit(_flow(normals, weight * known_x * known_y, -_unit(rays), (_FAR, _SMOOTH)))
    usual = float((rho * weight).sum() / max(float(weight.sum()), 1e-6))
    everywhere = np.full_like(rho, max(usual, 0.1))
    # Distances matter little to the light, but a step in them would ring round each object.
    smooth_rho = _flow(rho, weight, everywhere, (_FAR,))
    points = np.asarray(rays / smooth_rho[..., None], np.float32)
    return Surface(points, normals, (height, width))


def _shrunk(image: Field, size: tuple[int, int]) -> Field:
    return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA), np.float32)


def _flow(image: Field, weight: Field, beyond: Field, radii: tuple[float, ...]) -> Field:
    """Smooth what has weight and let it flow into the holes; far from anything, give `beyond`."""
    value = beyond
    weight = weight if image.ndim == 2 else weight[..., None]
    for radius in radii:
        mass = _blurred(weight, radius).reshape(weight.shape)
        share = mass / (mass + np.float32(_DOUBT))
        mean = _blurred(image * weight, radius) / np.maximum(mass, np.float32(1e-6))
        value = np.asarray(share * mean + (1 - share) * value, np.float32)
    return value


def _blurred(image: Field, radius: float) -> Field:
    blurred = cv2.GaussianBlur(image, (0, 0), radius, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred, np.float32)


def _slope(rho: Field, weight: Field, axis: int) -> tuple[Field, Field]:
    """Differentiate per cell where both neighbours are known and on one surface."""
    before = np.roll(rho, _LAG, axis)
    after = np.roll(rho, -_LAG, axis)
    known = weight * np.roll(weight, _LAG, axis) * np.roll(weight, -_LAG, axis)
    # Half of the gap either side, so that a step in the middle is not taken for a slope.
    limit = np.float32(_GAP / 2) * rho
    known = known * (np.abs(after - rho) < limit) * (np.abs(before - rho) < limit)
    ends: tuple[slice | int, ...] = (slice(None),) * axis
    known[(*ends, slice(0, _LAG))] = 0
    known[(*ends, slice(-_LAG, None))] = 0
    return (after - before) / np.float32(2 * _LAG), known.astype(np.float32)


def _unit(vectors: Field) -> Field:
    length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return np.asarray(vectors / np.maximum(length, np.float32(1e-12)))
