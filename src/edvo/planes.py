"""Planes in depth images, and points that are to lie on them: the point-to-plane term.

Not in the paper, whose edges say little where texture is missing: there depth constrains what
they do not. The inverse depth of a plane is linear in the pixel, and the noise of a disparity
does not depend on the depth, so planes are fitted to inverse depth.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import PlanesConfig
from edvo.edges import NO_TABLE
from edvo.kernels import DepthTerm, PlaneMap, PlanePoints
from edvo.sensor import DEPTH_NOISE

__all__ = ["NO_PLANES", "NO_POINTS", "DepthTerm", "PlaneFitter", "PlaneMap", "PlanePoints"]

NO_PLANES = PlaneMap(np.zeros((0, 3)), np.zeros(0), 0, 0, 1.0)
NO_POINTS = PlanePoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 1.0)

FINER = 2  # times as many pixels and points a line, where a frame is looked at closely


class PlaneFitter:
    """Finds planes in the depth images of one camera.

    Parameters
    ----------
    camera : Camera
        Of the depth images; if its lens distorts, planes are fitted in ideal pixels.
    config : PlanesConfig

    Attributes
    ----------
    term : DepthTerm
        What points and planes count in a registration.
    """

    def __init__(self, camera: Camera, config: PlanesConfig) -> None:
        self._config = config
        self._noise = DEPTH_NOISE[config.sensor]
        self._table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
        self._pinhole = camera_of(camera)
        self._rows = (camera.height - 1) // config.map_step_px + 1
        self._cols = (camera.width - 1) // config.map_step_px + 1
        self._map_nodes = _nodes(camera, 0, config.map_step_px)
        step = config.point_step_px
        steps = step, step // FINER if step % FINER == 0 else step
        self._point_nodes = [_nodes(camera, step // 2, step) for step in steps]
        self.term = DepthTerm(
            weight=config.weight,
            doubt=config.doubt,
            edge_doubt=config.edge_doubt_px,
            most=math.inf,
            min_dot=math.cos(math.radians(config.max_angle_deg)),
            limit=config.max_distance,
            min_points=config.min_points,
        )

    @property
    def is_on(self) -> bool:
        """Whether depth counts at all."""
        return self.term.weight > 0

    def planes(
        self,
        depth: NDArray[np.float32],
        T_cam_depth: NDArray[np.float64] | None = None,
        *,
        fine: bool = False,
    ) -> PlaneMap:
        """Find the planes of a keyframe.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.
        T_cam_depth : ndarray of float64, shape (4, 4), optional
            Maps points of the depth image to the camera at the instant of the grey image; taken to
            be the same where not given.
        fine : bool, optional
            Whether each is fitted to four times as many pixels.

        Returns
        -------
        PlaneMap
            With none in it where the term is left out.
        """
        if not self.is_on:
            return NO_PLANES
        normals, offsets, _, _ = self._fit(depth, self._map_nodes, T_cam_depth, fine, seek=True)
        return PlaneMap(normals, offsets, self._rows, self._cols, float(self._config.map_step_px))

    def points(
        self,
        depth: NDArray[np.float32],
        T_cam_depth: NDArray[np.float64] | None = None,
        *,
        fine: bool = False,
    ) -> PlanePoints:
        """Choose points of a frame, spread evenly over where its depth is flat.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.
        T_cam_depth : ndarray of float64, shape (4, 4), optional
            Maps points of the depth image to the camera at the instant of the grey image; taken to
            be the same where not given.
        fine : bool, optional
            Whether there are four times as many, if their step is even, each fitted to four times
            as many pixels.

        Returns
        -------
        PlanePoints
            M points, each freed of noise by the plane fitted round it; none where the term is
            left out.
        """
        if not self.is_on:
            return NO_POINTS
        nodes = self._point_nodes[fine]
        normals, offsets, centres, sigma = self._fit(depth, nodes, T_cam_depth, fine)
        count = kernels.pack_points(offsets, normals, centres, sigma)
        return PlanePoints(centres[:count], normals[:count], sigma[:count], float(nodes.step))

    def _fit(
        self,
        depth: NDArray[np.float32],
        nodes: "_Nodes",
        T_cam_depth: NDArray[np.float64] | None,
        fine: bool,
        *,
        seek: bool = False,
    ) -> tuple[NDArray[np.float64], ...]:
        """Normals, offsets, centres and noise, one for each node."""
        count = len(nodes.flat)
        pixels = nodes.pixels
        if T_cam_depth is not None and seek:
            pixels = np.empty_like(pixels)
            T = se3.inverse(T_cam_depth)
            kernels.shift_nodes(depth, nodes.pixels, self._table, self._pinhole, T, pixels)
        sigma = self._noise.sigma_z(depth.reshape(-1).take(nodes.flat))
        normals, offsets, centres = np.zeros((count, 3)), np.zeros(count), np.zeros((count, 3))
        config = self._config
        reach, stride = config.reach_px, config.stride_px
        if fine:
            stride = max(stride // FINER, 1)
        in_rows = pixels is nodes.pixels and not self._table.size
        if in_rows and nodes.step % stride == 0:
            kernels.fit_planes_by_row(
                depth,
                nodes.first,
                nodes.step,
                sigma,
                self._pinhole,
                reach,
                stride,
                config.flatness,
                normals,
                offsets,
                centres,
            )
        else:
            kernels.fit_planes(
                depth,
                pixels,
                sigma,
                self._table,
                self._pinhole,
                reach,
                stride,
                config.flatness,
                normals,
                offsets,
                centres,
            )
        if T_cam_depth is not None:
            kernels.move_planes(T_cam_depth, normals, offsets, centres)
        return normals, offsets, centres, sigma


def thinned(points: PlanePoints, step_px: float) -> PlanePoints:
    """Leave as many of points that lie closely as there are usually.

    Parameters
    ----------
    points : PlanePoints
    step_px : float
        Of the usual ones: each stands for a square of that side.

    Returns
    -------
    PlanePoints
        The same object where they do not lie more closely than that.
    """
    every = max(round((step_px / points.step_px) ** 2), 1)
    if every == 1:
        return points
    X, normals, sigma = (np.ascontiguousarray(part[::every]) for part in points[:3])
    return PlanePoints(X, normals, sigma, float(step_px))  # an int would compile kernels anew


def chosen(points: PlanePoints, which: NDArray[np.bool_] | NDArray[np.intp]) -> PlanePoints:
    """Leave some of points.

    Parameters
    ----------
    points : PlanePoints
        N of them.
    which : ndarray of bool, shape (N,), or of intp, shape (M,)

    Returns
    -------
    PlanePoints
    """
    X, normals, sigma = (part[which] for part in points[:3])
    return points._replace(X=X, normals=normals, sigma=sigma)


def move_points(points: PlanePoints, T: NDArray[np.float64]) -> PlanePoints:
    """Move points, and the planes they lie on.

    Parameters
    ----------
    points : PlanePoints
    T : ndarray of float64, shape (4, 4)

    Returns
    -------
    PlanePoints
    """
    X, normals = points.X.copy(), points.normals.copy()
    kernels.move_planes(T, normals, np.zeros(len(X)), X)
    return PlanePoints(X, normals, points.sigma, points.step_px)


def camera_of(camera: Camera) -> kernels.Pinhole:
    """Give the ideal camera that the kernels take."""
    return kernels.Pinhole(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


class _Nodes(NamedTuple):
    """Raw pixels (N, 2), inside the image or not, and the flat indices of those nearest to them.

    Their ideal ones are ``step`` apart from ``first`` on, row by row.
    """

    pixels: NDArray[np.int32]
    flat: NDArray[np.intp]
    first: int
    step: int


def _nodes(camera: Camera, first: int, step: int) -> _Nodes:
    """Nodes over the whole of an image."""
    v, u = np.mgrid[first : camera.height : step, first : camera.width : step]
    ideal = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    raw = camera.distort(ideal) if camera.is_distorted else ideal
    pixels = np.rint(raw).astype(np.int32)
    inside = np.clip(pixels, 0, (camera.width - 1, camera.height - 1))
    flat = (inside[:, 1] * camera.width + inside[:, 0]).astype(np.intp)
    return _Nodes(pixels, flat, first, step)
