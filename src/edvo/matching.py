"""Edge matching by the robust criterion of Eq. (6), or by distance alone (§III-B).

Costs are kept in squared pixels, which is Eq. (6) times width^2::

    cost = |p_r - p'|^2 + (gamma / 4) width^2 (g_r . g' - 1)^2

so that the normal criterion is the same with gamma = 0, and limits read in pixels.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.edges import EdgePixels

Method = Literal["grid", "tree", "brute"]

GRADIENT_SPREAD_PX = 100.0  # a k-d tree splits a gradient axis when it is wider than this a unit
NEAR_CELL_PX = 8.0  # of the map that tells some edge near each place


@dataclass(frozen=True, slots=True)
class Criterion:
    """What makes one reference edge a better match than another, and what makes it none.

    Attributes
    ----------
    gamma : float
        Weight of the gradient direction in Eq. (6); 0 is the normal criterion.
    width : int
        Image width in pixels, which makes the two terms of Eq. (6) comparable.
    max_distance_px : float
        An edge further from the query than this is no candidate; infinite for none to reject.
    max_angle_deg : float
        Nor is one whose gradient differs by more; 180 rejects nothing.
    """

    gamma: float
    width: int
    max_distance_px: float = math.inf
    max_angle_deg: float = 180.0

    def compile(self) -> kernels.Criterion:
        """Make the form that the kernels take."""
        least = -2.0 if self.max_angle_deg >= 180 else math.cos(math.radians(self.max_angle_deg))
        return kernels.Criterion(
            self.gamma / 4 * float(self.width) ** 2, self.max_distance_px**2, least
        )


@dataclass(frozen=True, slots=True)
class Matches:
    """Matches of a set of queries.

    Attributes
    ----------
    indices : ndarray of int32, shape (N,)
        The reference edge of each query; -1 where there is none.
    costs : ndarray of float64, shape (N,)
        Eq. (6) times width^2, in squared pixels; infinite where there is none.
    """

    indices: NDArray[np.int32]
    costs: NDArray[np.float64]


class EdgeIndex:
    """The edges of a reference image, arranged so that the best match is found quickly.

    Parameters
    ----------
    edges : EdgePixels
        Reference edges; their depth does not matter, so those without depth serve as well.
    method : {"grid", "tree", "brute"}
        A 2-D grid of cells (fast), the balanced 4-D k-d tree of the paper [24], or every pair
        (the definition that the other two are tested against). All give the same matches, ties
        aside.
    cell_px : float
        Cell size of the grid; a matter of speed only.
    when_asked : bool
        Whether the grid is made once it is asked for.
    """

    def __init__(
        self,
        edges: EdgePixels,
        method: Method = "grid",
        cell_px: float = 4.0,
        *,
        when_asked: bool = False,
    ) -> None:
        self.edges = edges
        self.method = method
        self._grid: kernels.Grid | None = None
        self._tree: kernels.Tree | None = None
        self._near: kernels.NearMap | None = None
        self._cell_px = cell_px
        if method == "grid" and not when_asked:
            self._grid = self._built_grid()
        elif method == "tree":
            self._tree = kernels.build_tree(edges.pixels, edges.gradients, GRADIENT_SPREAD_PX)

    def __len__(self) -> int:
        return len(self.edges)

    @property
    def near(self) -> kernels.NearMap:
        """Some edge near each place, which a far registration looks up; made when asked for."""
        if self._near is None:
            self._near = kernels.build_near_map(self.grid, NEAR_CELL_PX)
        return self._near

    @property
    def grid(self) -> kernels.Grid:
        """The cell grid, which registration runs on."""
        if self.method != "grid":
            raise ValueError(f"an index by {self.method!r} holds no grid; make one by 'grid'")
        if self._grid is None:
            self._grid = self._built_grid()
        return self._grid

    def _built_grid(self) -> kernels.Grid:
        return kernels.build_grid(self.edges.pixels, self.edges.gradients, self._cell_px)

    def match(
        self,
        pixels: NDArray[np.float32],
        gradients: NDArray[np.float32],
        criterion: Criterion,
    ) -> Matches:
        """Find the reference edge that minimizes Eq. (6) for each query.

        Parameters
        ----------
        pixels : ndarray of float32, shape (N, 2)
            Warped pixels p' in the reference image.
        gradients : ndarray of float32, shape (N, 2)
            Unit gradients at the current pixels.
        criterion : Criterion

        Returns
        -------
        Matches
        """
        matches = Matches(np.empty(len(pixels), np.int32), np.empty(len(pixels)))
        compiled = criterion.compile()
        if self.method == "grid":
            kernels.match_in_grid(
                self.grid, pixels, gradients, compiled, matches.indices, matches.costs
            )
        elif self._tree is not None:
            kernels.match_in_tree(
                self._tree, pixels, gradients, compiled, matches.indices, matches.costs
            )
        else:
            return match_all_pairs(self.edges, pixels, gradients, criterion)
        return matches


def match_all_pairs(
    edges: EdgePixels,
    pixels: NDArray[np.float32],
    gradients: NDArray[np.float32],
    criterion: Criterion,
) -> Matches:
    """Match by looking at every pair: what the grid and the tree must agree with.

    Parameters
    ----------
    edges : EdgePixels
        M reference edges.
    pixels, gradients : ndarray of float32, shape (N, 2)
        Queries, as for ``EdgeIndex.match``.
    criterion : Criterion

    Returns
    -------
    Matches

    Notes
    -----
    Memory grows as N x M.
    """
    limits = criterion.compile()
    if not len(edges):
        return Matches(np.full(len(pixels), -1, np.int32), np.full(len(pixels), np.inf))
    offset = edges.pixels[None].astype(np.float64) - pixels[:, None]
    distance = (offset**2).sum(axis=2)
    dot = gradients.astype(np.float64) @ edges.gradients.astype(np.float64).T
    cost = distance + limits.direction * (dot - 1) ** 2  # Eq. (6), times width^2
    cost[(distance > limits.limit) | (dot < limits.min_dot)] = np.inf
    indices = cost.argmin(axis=1).astype(np.int32)
    costs = cost[np.arange(len(pixels)), indices]
    indices[np.isinf(costs)] = -1
    return Matches(indices, costs)
