"""Depth as a witness: whether a pose lets surfaces stand where another depth image saw through.

Not in the paper. Where much of the view moves by itself, edges and planes fit the larger part of
it, and fit well: nothing in a registration tells. But what was empty a moment ago cannot be filled
in a scene that stands still. Each of two depth images is held against the other: a point of one
that lies in front of all that the other saw around its place contradicts. A point behind says
nothing, since a moving camera hides and shows.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.planes import camera_of
from edvo.sensor import DEPTH_NOISE
from edvo.strays import NOWHERE, ring

STEP_PX, POINTS_EVERY = 4, 4  # a depth is kept at every such pixel; a point at every such depth
USUAL_WIDTH = 640  # in wider ones they are as many
WINDOW = 7  # depths to a side: what lies so near a contour may be shifted, with colour out of step
SLACK_M, SLACK_SIGMA = 0.02, 6.0  # by which a point must be in front: for the pose, and for noise
MIN_POINTS = 50  # fewer say nothing
AGE_S, MAX_AGE_S = 0.15, 1.0  # of the depth image that is asked: what moves slowly needs time
RISEN_S = 0.5  # of the one that is asked which part of the view moves: that takes longer
LEAST_TIME = 0.5  # of that age: what is seen of motion in less is mostly noise


def step_px(width: int) -> int:
    """Say how far apart the depths are that are kept of an image so many pixels wide."""
    return max(STEP_PX, round(STEP_PX * width / USUAL_WIDTH))


@dataclass(frozen=True, slots=True)
class Surface:
    """What a depth image shows, coarsely.

    Attributes
    ----------
    points : ndarray of float64, shape (N, 3)
        In the camera, metres.
    near, far : ndarray of float32, shape (rows, columns)
        Least and greatest depth around, metres; both 0 where it is missing, or most of it around:
        what lies beyond the border of what was seen may well be nearer.
    """

    points: NDArray[np.float64]
    near: NDArray[np.float32]
    far: NDArray[np.float32]


# when it was seen, from where, and what
_Seen: TypeAlias = tuple[float, NDArray[np.float64], Surface]
# what counts of a surface that was seen from there
Rest: TypeAlias = Callable[[Surface, NDArray[np.float64]], Surface]


class Witness:
    """Remembers the surfaces of the last second.

    Parameters
    ----------
    camera : Camera
        Of the depth images.
    sensor : str
        Key of ``DEPTH_NOISE``.
    keeps_strays : bool, optional
        Whether points of stray depth, see `edvo.strays`, are asked like any others.
    """

    def __init__(self, camera: Camera, sensor: str, *, keeps_strays: bool = False) -> None:
        self._pinhole, self._lens = camera_of(camera), kernels.Lens(*camera.distortion)
        self._noise = DEPTH_NOISE[sensor]
        self._step = step = step_px(camera.width)
        first = step // 2
        v, u = np.mgrid[first : camera.height : step, first : camera.width : step]
        ends = slice(POINTS_EVERY // 2, None, POINTS_EVERY)
        raw = np.stack([u[ends, ends].ravel(), v[ends, ends].ravel()], axis=1).astype(np.float64)
        ideal = camera.undistort(raw) if camera.is_distorted else raw
        ray = (ideal - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        self._rays = np.column_stack([ray, np.ones(len(ray))])
        self._rows, self._cols = u.shape
        self._ring = NOWHERE if keeps_strays else ring(self._cols)
        self._seen: deque[_Seen] = deque()
        self._asked: _Seen | None = None  # the last that was asked

    def forget(self, since: float = -np.inf) -> None:
        """Forget what was seen since then.

        Parameters
        ----------
        since : float, optional
            Seconds; all where not given.
        """
        while self._seen and self._seen[-1][0] >= since:
            self._seen.pop()

    def surface(self, depth: NDArray[np.float32]) -> Surface:
        """Keep of a depth image what can be held against others.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            Metres, 0 where missing.

        Returns
        -------
        Surface
        """
        kept, near, far = np.empty((3, self._rows, self._cols), np.float32)
        kernels.surround(depth, self._step, WINDOW // 2, kept, near, far)
        points = np.empty_like(self._rays)
        count = kernels.place_points(kept, POINTS_EVERY, self._rays, self._ring, points)
        return Surface(points[:count], near, far)

    def conflict(
        self, a: Surface, b: Surface, T_a_b: NDArray[np.float64], unknown: float = 0.0
    ) -> float:
        """Say how much of two surfaces cannot be, if neither has moved.

        Parameters
        ----------
        a, b : Surface
        T_a_b : ndarray of float64, shape (4, 4)
            Maps points from the camera of ``b`` to that of ``a``.
        unknown : float, optional
            What is given where they see hardly anything together.

        Returns
        -------
        float
            Share, of the points that both see, of those that stand in front of the other's
            surface.
        """
        there = self._compare(a, b.points, T_a_b)
        back = self._compare(b, a.points, se3.inverse(T_a_b))
        together = there[1] + back[1]
        return (there[0] + back[0]) / together if together >= MIN_POINTS else unknown

    def remember(
        self, timestamp: float, T_world_cam: NDArray[np.float64], surface: Surface
    ) -> None:
        """Take a surface to hold later ones against.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was seen from.
        surface : Surface
        """
        self._seen.append((timestamp, T_world_cam, surface))

    def question(
        self, timestamp: float, T_world_cam: NDArray[np.float64], surface: Surface
    ) -> float:
        """Hold a surface against one of a moment ago.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray of float64, shape (4, 4)
            The pose in question.
        surface : Surface
            Seen from there.

        Returns
        -------
        float
            See ``conflict``; 0 where nothing was seen of late, and more where that was only
            just now, since what moves has then had less time to show.
        """
        while self._seen and not 0 <= timestamp - self._seen[0][0] <= MAX_AGE_S:
            self._seen.popleft()
        while len(self._seen) > 1 and timestamp - self._seen[1][0] >= RISEN_S:
            self._seen.popleft()
        since = self._asked[0] if self._asked else -np.inf
        if timestamp < since:  # the clock has jumped back
            self._asked, since = None, -np.inf
        young = [seen for seen in self._seen if seen[0] >= since]  # none again from before
        if not young:
            return 0.0
        aged = self._aged(timestamp, AGE_S)
        self._asked = aged if aged and aged[0] >= since else young[0]
        return self._scaled(self._asked, (timestamp, T_world_cam, surface))

    def question_apart(
        self, timestamp: float, T_world_cam: NDArray[np.float64], rest: Surface, rest_of: Rest
    ) -> float:
        """Hold what counts of a surface against what counts of the one that was asked.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray of float64, shape (4, 4)
            As `question` was given them, and found something to ask.
        rest : Surface
            What counts of the one that `question` was given.
        rest_of : callable
            Gives what counts of a surface, told where it was seen from, T_world_cam (4, 4).

        Returns
        -------
        float
            See `question`; infinite where they see hardly anything together.
        """
        if self._asked is None:
            return np.inf
        time, T_world_then, surface = self._asked
        then = time, T_world_then, rest_of(surface, T_world_then)
        return self._scaled(then, (timestamp, T_world_cam, rest), unknown=np.inf)

    def risen(
        self, timestamp: float, T_world_cam: NDArray[np.float64], surface: Surface, since: float
    ) -> NDArray[np.float64]:
        """Give what stands where half a second ago nothing was.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray of float64, shape (4, 4)
        surface : Surface
            Seen from there.
        since : float
            What was seen by then is not asked, seconds.

        Returns
        -------
        ndarray of float64, shape (N, 3)
            In the world, metres; none where nothing was seen so long ago.
        """
        old = self._aged(timestamp, RISEN_S)
        if old is None or old[0] <= since:
            return np.empty((0, 3))
        _, T_world_then, then = old
        T_then_cam = se3.inverse(T_world_then) @ T_world_cam
        z, slack, cell, which = self._warped(then, surface.points, T_then_cam)
        in_front = z < then.near.reshape(-1)[cell] - slack
        risen = surface.points[which[in_front]]
        return risen @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]

    def _scaled(self, then: _Seen, now: _Seen, unknown: float = 0.0) -> float:
        """How much of two surfaces cannot be, as if so long lay between them as is usual."""
        conflict = self.conflict(then[2], now[2], se3.inverse(then[1]) @ now[1], unknown)
        return conflict / min(max((now[0] - then[0]) / AGE_S, LEAST_TIME), 1.0)

    def _aged(self, timestamp: float, age: float) -> _Seen | None:
        """Give the last that was seen so many seconds ago, or longer."""
        return next((seen for seen in reversed(self._seen) if timestamp - seen[0] >= age), None)

    def _compare(
        self, surface: Surface, points: NDArray[np.float64], T: NDArray[np.float64]
    ) -> tuple[int, int]:
        """Count the points in front of a surface, and those in front of it or on it."""
        z, slack, cell, _ = self._warped(surface, points, T)
        return kernels.count_in_front(z, slack, cell, surface.near, surface.far)

    def _warped(
        self, surface: Surface, points: NDArray[np.float64], T: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
        """Depths, what these may be off by, cells and numbers of points that a surface shows."""
        rows, cols = surface.near.shape
        z, (cell, which) = np.empty(len(points)), np.empty((2, len(points)), np.int32)
        count = kernels.warp_to_cells(
            points, T, self._pinhole, self._lens, self._step, rows, cols, z, cell, which
        )
        z = z[:count]
        return z, SLACK_M + SLACK_SIGMA * self._noise.sigma_z(z), cell[:count], which[:count]
