"""The edges of all keyframes as points in the world."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.edges import depth_at_edges, extract_edges
from edvo.frame import Frame
from edvo.rim import find_rim

VOXEL_M = 0.01
MAX_POINTS = 500_000
MAX_DEPTH_M = 5.0  # beyond, structured light errs by several voxels

_AXIS_BITS = 21  # three axes in one 63-bit key
_PENDING = 200_000  # points that wait for their voxels: sorting all of them each time costs more


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Edges as points, one for each voxel that holds any.

    Attributes
    ----------
    points : ndarray of float64, shape (N, 3)
        Mean position, metres, world (the first camera).
    gradients : ndarray of float64, shape (N, 2)
        Mean unit gradient (u, v) in the images; shorter where views disagree.
    grey : ndarray of uint8, shape (N,)
        Mean grey value.
    counts : ndarray of int64, shape (N,)
        Edge pixels that were merged.
    """

    points: NDArray[np.float64]
    gradients: NDArray[np.float64]
    grey: NDArray[np.uint8]
    counts: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, most: int) -> "EdgePoints":
        """Take evenly some of the points.

        Parameters
        ----------
        most : int
            How many at most.

        Returns
        -------
        EdgePoints
        """
        if len(self) <= most:
            return self
        which = np.linspace(0, len(self) - 1, most).astype(int)
        return EdgePoints(
            self.points[which], self.gradients[which], self.grey[which], self.counts[which]
        )


class EdgeMap:
    """Collects edges with depth; those that fall into one voxel are merged.

    Memory is bounded: where there are too many voxels, they are made twice as wide.

    Parameters
    ----------
    camera : Camera
        Of all frames.
    config : EdgesConfig
        How edges and their depth are found.
    voxel_m : float
        Width of a voxel to begin with, metres.
    max_points : int
        Most voxels.
    max_depth_m : float
        Edges beyond are left out, metres.
    """

    def __init__(
        self,
        camera: Camera,
        config: EdgesConfig,
        *,
        voxel_m: float = VOXEL_M,
        max_points: int = MAX_POINTS,
        max_depth_m: float = MAX_DEPTH_M,
    ) -> None:
        self.voxel_m = voxel_m
        self._camera, self._config = camera, config
        self._max_points, self._max_depth_m = max_points, max_depth_m
        # Of each voxel: sums of x, y, z, gradient u, v and grey, and how many.
        self._sums = np.empty((0, 7))
        self._pending: list[NDArray[np.float64]] = []

    def add(self, frame: Frame, T_world_cam: NDArray[np.float64]) -> None:
        """Add the edges of a frame.

        Parameters
        ----------
        frame : Frame
            Of the map's camera.
        T_world_cam : ndarray of float64, shape (4, 4)
            Its pose.
        """
        ignored = self._config.black_rim == "ignored"
        blind = find_rim(frame.grey, frame.depth) if ignored else None
        image = extract_edges(frame.grey, self._config, blind=blind)
        depths = depth_at_edges(frame.depth, image.index, self._config)
        near = np.flatnonzero((depths > 0) & (depths <= self._max_depth_m)).astype(np.int32)
        edges = image.describe(self._camera, near, depths[near])
        points = edges.points(self._camera) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]
        grey = frame.grey.ravel()[image.index[near]]
        self._pending.append(np.column_stack([points, edges.gradients, grey, np.ones(len(near))]))
        if sum(map(len, self._pending)) > _PENDING:
            self._merge()

    def points(self) -> EdgePoints:
        """Give what was collected so far.

        Returns
        -------
        EdgePoints
        """
        self._merge()
        counts = self._sums[:, 6]
        means = self._sums[:, :6] / counts[:, None]
        grey = np.rint(means[:, 5]).astype(np.uint8)
        return EdgePoints(means[:, :3], means[:, 3:5], grey, counts.astype(np.int64))

    def _merge(self) -> None:
        rows = np.concatenate([self._sums, *self._pending])
        self._pending.clear()
        self._sums = _sum_by_voxel(rows, self.voxel_m)
        while len(self._sums) > self._max_points:
            self.voxel_m *= 2
            self._sums = _sum_by_voxel(self._sums, self.voxel_m)


def _sum_by_voxel(rows: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    half = 1 << (_AXIS_BITS - 1)
    place = np.floor(rows[:, :3] / rows[:, 6:] / voxel_m)
    cell = np.clip(place, -half, half - 1).astype(np.int64) + half
    key = (cell[:, 0] << 2 * _AXIS_BITS) | (cell[:, 1] << _AXIS_BITS) | cell[:, 2]
    order = np.argsort(key, kind="stable")
    key, rows = key[order], rows[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    return np.add.reduceat(rows, first, axis=0) if len(rows) else rows
