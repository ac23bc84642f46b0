"""Closed smooth curves: what cameras and moving things follow."""

import numpy as np
from numpy.typing import NDArray

from edvo.errors import SceneError

Vectors = NDArray[np.float64]
_STEPS = 64  # per piece, to tabulate the length


class ClosedSpline:
    """A closed uniform cubic B-spline, travelled by arc length.

    It is twice continuously differentiable and stays inside the hull of its control points, so a
    camera led through free space meets no wall. An open path goes there and back.

    Parameters
    ----------
    points : (N, 3) array
        Control points, metres.
    closed : bool
        False leads back over the same points.
    companion : (N, D) array, optional
        Values that run along, such as the point looked at.

    Raises
    ------
    SceneError
        For fewer than two points, or a companion of another length.
    """

    def __init__(
        self, points: Vectors, *, closed: bool = True, companion: Vectors | None = None
    ) -> None:
        points = np.asarray(points, float)
        companion = points if companion is None else np.asarray(companion, float)
        if len(points) < 2 or len(points) != len(companion):
            raise SceneError(
                f"a path of {len(points)} points with {len(companion)} targets; "
                "give at least two points and one target each"
            )
        if not closed:
            points = np.concatenate([points, points[-2:0:-1]])
            companion = np.concatenate([companion, companion[-2:0:-1]])
        self._points, self._companion = points, companion
        at = np.linspace(0.0, len(points), _STEPS * len(points) + 1)
        places = np.array([_blend(points, u) for u in at])
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        self._at, self._travelled = at, np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length of one round in metres."""
        return float(self._travelled[-1])

    def at(self, travelled: float) -> tuple[Vectors, Vectors]:
        """Give the place after some way.

        Parameters
        ----------
        travelled : float
            Metres along the curve; of any sign and size.

        Returns
        -------
        place : (3,) float64
            Metres.
        companion : (D,) float64
            What runs along, there.
        """
        if self.length == 0.0:
            return _blend(self._points, 0.0), _blend(self._companion, 0.0)
        u = float(np.interp(travelled % self.length, self._travelled, self._at))
        return _blend(self._points, u), _blend(self._companion, u)


def _blend(points: Vectors, u: float) -> Vectors:
    """Give the closed uniform cubic B-spline at parameter u in [0, N]."""
    i = int(np.floor(u))
    x = u - i
    weights = np.array(
        [(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3]
    )
    index = np.arange(i - 1, i + 3) % len(points)
    result: Vectors = weights @ points[index] / 6.0
    return result
