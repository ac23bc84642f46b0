"""What moves by itself in a small part of the view: it is left out of what is registered.

Not in the paper. One who walks slowly through the view lets little stand where nothing was a moment
ago, so that nothing seems to move; but his edges may be most of those that there are, and each
frame is off by a part of his step. In half a second more of him has come to where nothing was.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.course import Course
from edvo.kit import Kit
from edvo.seen import Seen
from edvo.witness import POINTS_EVERY, Surface, Witness, step_px

BESIDE, LEAST = 1.5, 4  # of the step from one point to the next; so many of them are no noise
KEPT_S = 0.75  # for so long it is left out
LEFT = 0.4  # of the samples are left, at least
THIN = 0.2  # of the reach: of points so near to each other one will do


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
        status = kit.config.status
        self._reach_m = status.moving_m if status.moving == "leave-out" else 0.0
        self._beside = BESIDE * POINTS_EVERY * step_px(kit.camera.width) / kit.camera.fx
        self._least = kit.config.registration.min_matches
        self._sure_since = -math.inf
        self._moved: deque[tuple[float, NDArray[np.float64]]] = deque()

    def forget(self, since: float = -math.inf) -> None:
        """Forget what moved since then: the poses were wrong.

        Parameters
        ----------
        since : float, optional
            Seconds; all where not given.
        """
        while self._moved and self._moved[-1][0] >= since:
            self._moved.pop()

    def mind_doubt(self, timestamp: float) -> None:
        """Let nothing that was seen till now tell what moves: its pose may be wrong.

        Parameters
        ----------
        timestamp : float
            Seconds.
        """
        self._sure_since = timestamp

    def note(self, timestamp: float, T_world_cam: NDArray[np.float64], surface: Surface) -> None:
        """Note what stands where nothing was; told before the witness is to remember it.

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
        risen = self._witness.risen(timestamp, T_world_cam, surface, self._sure_since)
        if len(risen) < LEAST:
            return
        away = np.linalg.norm(risen - T_world_cam[:3, 3], axis=1)
        apart = np.linalg.norm(risen[:, None] - risen, axis=2)
        risen = risen[np.count_nonzero(apart < self._beside * away, axis=0) >= LEAST]
        if len(risen):
            self._moved.append((timestamp, risen))

    def apart(self, seen: Seen, most: float = 1.0) -> Seen | None:
        """Take from a frame what is near to where something moved of late.

        Parameters
        ----------
        seen : Seen
        most : float, optional
            Share of the points of its depth that may be taken.

        Returns
        -------
        Seen or None
            None where there is nothing of that, or too little else.
        """
        timestamp, samples, points = seen.frame.timestamp, seen.samples, seen.points
        while self._moved and not 0 <= timestamp - self._moved[0][0] <= KEPT_S:
            self._moved.popleft()
        if not self._moved:
            return None
        moved = _thinned(np.concatenate([risen for _, risen in self._moved]), THIN * self._reach_m)
        T = self._course.T_world_last @ self._course.ahead(timestamp)
        rest, good = np.empty(len(samples), np.bool_), np.empty(len(points.X), np.bool_)
        kernels.find_far(samples.points(self._camera), T, moved, self._reach_m, rest)
        count = np.count_nonzero(rest)
        if count == len(rest) or count < max(LEFT * len(rest), self._least):
            return None
        kernels.find_far(points.X, T, moved, self._reach_m, good)
        if np.count_nonzero(~good) > most * len(good):
            return None
        points = points._replace(
            X=points.X[good], normals=points.normals[good], sigma=points.sigma[good]
        )
        return replace(
            seen, samples=samples.where(np.flatnonzero(rest)), points=points, is_rid=True
        )


def _thinned(X: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Leave one point of those in each cube."""
    return X[np.unique(np.floor(X / side), axis=0, return_index=True)[1]]
