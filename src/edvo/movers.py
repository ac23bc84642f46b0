"""What moves by itself in a small part of the view: it is left out of what is registered.

Not in the paper. One who walks slowly through the view lets little stand where nothing was a moment
ago, so that nothing seems to move; but his edges may be most of those that there are, and each
frame is off by a part of his step. In half a second more of him has come to where nothing was.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.course import Course
from edvo.kit import Kit
from edvo.planes import chosen
from edvo.seen import Seen
from edvo.witness import POINTS_EVERY, Surface, Witness, step_px

# Points count that have so many beside them, themselves included, no farther than 1.5 times the
# step from one to the next: a strip that is one point wide is noise.
LEAST, BESIDE = 4, 1.5
MOST = 200  # points: where more have come, much moves, and that is told otherwise
KEPT_S = 0.75  # for so long it is left out
LEFT = 0.4  # of the samples, and of the points, are left at least
LITTLE = 0.2  # of the view moves; where it is more, what stands still is told point by point
CUBE = 0.3  # of the reach, to a side: one point of those in each is kept


class Movers:
    """Leaves out of a frame what stands near to where something moved of late.

    Parameters
    ----------
    kit : Kit
    course : Course
        Says where a frame is expected.
    witness : Witness
        Knows what was seen of late.
    """

    def __init__(self, kit: Kit, course: Course, witness: Witness) -> None:
        self._camera, self._course, self._witness = kit.camera, course, witness
        self._depth_alone, self._clock = kit.depth_alone, kit.clock
        status = kit.config.status
        self._reach_m = status.moving_m if status.moving == "leave-out" else 0.0
        self._beside = BESIDE * POINTS_EVERY * step_px(kit.camera.width) / kit.camera.fx
        self._doubted = -math.inf
        # by the cube: where in it something was first seen that had come there, and when at all
        self._moved: dict[tuple[int, ...], tuple[NDArray[np.float64], set[float]]] = {}

    def forget(self, since: float = -math.inf) -> None:
        """Forget what moved since then: the poses were wrong.

        Parameters
        ----------
        since : float, optional
            Seconds; all where not given.
        """
        self._keep(lambda time: time < since)
        self._doubted = min(self._doubted, since)  # a clock that jumps back: no later than now

    def mind_doubt(self, timestamp: float) -> None:
        """Let nothing that was seen till now tell what moves: its pose may be wrong.

        Parameters
        ----------
        timestamp : float
            Seconds.
        """
        self._doubted = timestamp

    def note(self, timestamp: float, T_world_cam: NDArray[np.float64], surface: Surface) -> None:
        """Note what stands where nothing was.

        Parameters
        ----------
        timestamp : float
            Seconds.
        T_world_cam : ndarray of float64, shape (4, 4)
            A pose that is sure.
        surface : Surface
            Seen from there.
        """
        if not self._reach_m:
            return
        with self._clock("witness"):
            risen = self._witness.risen(timestamp, T_world_cam, surface, self._doubted)
            if not LEAST <= len(risen) <= MOST:
                return
            away = np.linalg.norm(risen - T_world_cam[:3, 3], axis=1)
            between = np.linalg.norm(risen[:, None] - risen, axis=2)
            beside = np.count_nonzero(between < self._beside * away[:, None], axis=1)
            self._forget_old(timestamp)
            for point in risen[beside >= LEAST]:
                cube = np.floor(point / (CUBE * self._reach_m)).astype(int)
                self._moved.setdefault(tuple(cube.tolist()), (point, set()))[1].add(timestamp)

    def apart(self, seen: Seen, most: float = 1 - LEFT) -> Seen | None:
        """Take from a frame what is near to where something moved of late.

        Parameters
        ----------
        seen : Seen
        most : float, optional
            Share of the points of its depth that may be taken.

        Returns
        -------
        Seen or None
            None where there is nothing of that, too little else, or where the frame was taken is
            not foreseen.
        """
        timestamp, samples, points = seen.frame.timestamp, seen.samples, seen.points
        if not self._moved or not self._course.follows(timestamp):
            return None
        with self._clock("witness"):
            self._forget_old(timestamp)
            T_world_cam = self._course.expected(timestamp)
            far_samples = self.are_far(samples.points(self._camera), T_world_cam)
            rest = samples.where(np.flatnonzero(far_samples))
            if len(rest) == len(samples) or len(rest) < LEFT * len(samples):
                return None
            far_points = self.are_far(points.X, T_world_cam)
            if np.count_nonzero(~far_points) > most * len(far_points):
                return None
            if self._depth_alone.has_to_tell(rest):
                return None
            return replace(
                seen, samples=rest, points=chosen(points, far_points), without_movers=True
            )

    def rest_of(self, surface: Surface, T_world_cam: NDArray[np.float64]) -> Surface:
        """Leave out of a surface the points that are near to where something moved of late.

        Parameters
        ----------
        surface : Surface
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was seen from.

        Returns
        -------
        Surface
        """
        return replace(surface, points=surface.points[self.are_far(surface.points, T_world_cam)])

    def are_far(
        self, points: NDArray[np.float64], T_world_cam: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Say which points are near to nothing that moved of late.

        Parameters
        ----------
        points : ndarray of float64, shape (N, 3)
            In the camera, metres.
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was.

        Returns
        -------
        ndarray of bool, shape (N,)
        """
        moved = np.array([point for point, _ in self._moved.values()]).reshape(-1, 3)
        is_far = np.empty(len(points), np.bool_)
        kernels.find_far(points, T_world_cam, moved, self._reach_m, is_far)
        return is_far

    def _forget_old(self, timestamp: float) -> None:
        self._keep(lambda time: 0 <= timestamp - time <= KEPT_S)

    def _keep(self, holds: Callable[[float], bool]) -> None:
        """Keep what was seen at times for which that holds."""
        kept = {
            cube: (point, {time for time in times if holds(time)})
            for cube, (point, times) in self._moved.items()
        }
        self._moved = {cube: seen for cube, seen in kept.items() if seen[1]}
