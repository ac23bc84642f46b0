"""A short window over keyframe poses: a new one is placed by more than the one before it.

Not in the paper, which takes each keyframe's pose from the one before. A hand goes to and fro, so
that an earlier one is often as near. The frame that is to be a keyframe is registered with it,
too, and the poses of the last few keyframes are solved for together from all such registrations,
each weighed by its covariance; the oldest stays where it is. Poses that were given stay.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.config import Config
from edvo.keyframes import Keyframe
from edvo.planes import DepthTerm
from edvo.registration import Registration
from edvo.seen import Seen
from edvo.uncertainty import MARGIN, Uncertainty

REACH = 1.5  # times how far a keyframe is used: one farther from the new one shows too little of it
LEAST_FIT = 0.6  # of the samples, in place and turned alike
# Squared difference to what is known, over its covariance: 99 % of them by chance, of errors that
# are as large as decisions take them to be.
LARGEST = 16.8 * MARGIN**2
JUMP_M, JUMP_RAD = 0.02, 0.02  # more at once would look as if something moved: not believed
STEPS = 2  # Gauss-Newton; poses are millimetres off
STRIDE, MOST = 2, 750  # one sample in so many, and so few: a keyframe must not cost a hitch


@dataclass(frozen=True, slots=True)
class Link:
    """A registration of one keyframe with another.

    Attributes
    ----------
    first, second : int
        Positions in the window.
    T_first_second : ndarray of float64, shape (4, 4)
    covariance : ndarray of float64, shape (6, 6)
        Of the left perturbation of ``T_first_second``; see `Uncertainty`.
    """

    first: int
    second: int
    T_first_second: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def misfit(self, T: NDArray[np.float64]) -> NDArray[np.float64]:
        """Say how far a motion is from what was registered.

        Parameters
        ----------
        T : ndarray of float64, shape (4, 4)
            From the second to the first.

        Returns
        -------
        ndarray of float64, shape (6,)
            A twist in the camera of the first.
        """
        return se3.log(T @ se3.inverse(self.T_first_second))


class KeyframeWindow:
    """Places new keyframes by the last few, all together.

    Parameters
    ----------
    config : Config
    registration : Registration
    uncertainty : Uncertainty
    """

    def __init__(
        self, config: Config, registration: Registration, uncertainty: Uncertainty
    ) -> None:
        self._limits = config.keyframes
        self._registration = registration
        self._uncertainty = uncertainty
        self._keyframes: list[Keyframe] = []
        self._poses: list[NDArray[np.float64]] = []
        self._links: list[Link] = []

    def place(
        self,
        last: Keyframe,
        seen: Seen,
        T_last_cur: NDArray[np.float64],
        covariance: NDArray[np.float64],
        term: DepthTerm,
    ) -> tuple[NDArray[np.float64], bool]:
        """Say where a frame is that is to be the next keyframe.

        Parameters
        ----------
        last : Keyframe
            The one before.
        seen : Seen
            The frame, its parts moved to its instant.
        T_last_cur : ndarray of float64, shape (4, 4)
            How it was registered with the last one, and
        covariance : ndarray of float64, shape (6, 6)
            of that motion.
        term : DepthTerm
            What depth counts.

        Returns
        -------
        T_world_cam : ndarray of float64, shape (4, 4)
        is_asked : bool
            Whether an earlier one was asked, too, which takes its time.
        """
        self._resume(last)
        new = len(self._keyframes)
        self._poses.append(self._poses[-1] @ T_last_cur)
        self._links.append(Link(new - 1, new, T_last_cur, covariance))
        nearest = self._nearest()
        if nearest is not None:
            link = self._register(nearest, seen, term)
            if link is not None and self._surprise(link) < LARGEST:
                self._join(link)
        return self._poses[-1], nearest is not None

    def take(self, keyframe: Keyframe) -> None:
        """Note the keyframe that was made of the frame placed last.

        Parameters
        ----------
        keyframe : Keyframe
        """
        self._keyframes.append(keyframe)
        self._poses[-1] = keyframe.T_world_key
        while len(self._keyframes) >= self._limits.window:
            del self._keyframes[0], self._poses[0]
            self._links = [
                Link(each.first - 1, each.second - 1, each.T_first_second, each.covariance)
                for each in self._links
                if each.first > 0
            ]

    def _resume(self, last: Keyframe) -> None:
        """Go on from a keyframe, or begin with it where it is not the one taken last."""
        known = bool(self._keyframes) and self._keyframes[-1].index == last.index
        if known and np.array_equal(self._poses[-1], last.T_world_key):  # else its piece was moved
            self._keyframes[-1] = last  # its parts may have been
        else:
            self._keyframes, self._poses, self._links = [last], [last.T_world_key], []

    def _nearest(self) -> int | None:
        """Position of the nearest keyframe before the last one; a radian counts as a metre."""
        bound_m = REACH * self._limits.max_translation_m
        bound_rad = REACH * np.radians(self._limits.max_rotation_deg)
        best, least = None, np.inf
        for i in range(len(self._poses) - 2):
            T = self._between(i, -1)
            away, turned = float(np.linalg.norm(T[:3, 3])), se3.rotation_angle(T)
            if away < bound_m and turned < bound_rad and away + turned < least:
                best, least = i, away + turned
        return best

    def _register(self, i: int, seen: Seen, term: DepthTerm) -> Link | None:
        """Register the new one with an earlier one, if they show the same for the most part."""
        key, points = self._keyframes[i], seen.points
        stride = max(math.ceil(len(seen.samples) / MOST), STRIDE)
        samples = seen.samples.every(stride)
        term = term._replace(weight=term.weight / stride)  # of all points, beside these edges
        start = self._between(i, -1)[None]
        edges = key.edges_for(near=seen.is_near)
        found = self._registration.align(edges, samples, start, key.planes, points, term)
        if not found.converged or found.agreeing < LEAST_FIT * len(samples):
            return None
        covariance = self._uncertainty.covariance(edges, samples, key.planes, points, term, found)
        return Link(i, len(self._poses) - 1, found.T_ref_cur, covariance)

    def _surprise(self, link: Link) -> float:
        """How far a registration is from what those from keyframe to keyframe say, squared.

        Over the covariance of both, as if the path were known by these alone: images that repeat,
        or things that move, contradict by more than chance does.
        """
        away = link.misfit(self._between(link.first, link.second))
        covariance = link.covariance.copy()
        for each in self._links:
            if link.first <= each.first and each.second == each.first + 1:
                carry = se3.adjoint(self._between(link.first, each.first))
                covariance += carry @ each.covariance @ carry.T
        return float(away @ np.linalg.solve(covariance, away))

    def _join(self, link: Link) -> None:
        """Solve for the poses with one more registration, unless that makes the new one jump."""
        before, known = list(self._poses), list(self._links)
        self._links.append(link)
        self._solve()
        T = se3.inverse(before[-1]) @ self._poses[-1]
        if np.linalg.norm(T[:3, 3]) > JUMP_M or se3.rotation_angle(T) > JUMP_RAD:
            self._poses, self._links = before, known

    def _solve(self) -> None:
        """Move the poses but the first to where they agree best with all registrations."""
        n = len(self._poses)
        weights = np.linalg.inv([link.covariance for link in self._links])
        for _ in range(STEPS):
            H, b = np.zeros((n, n, 6, 6)), np.zeros((n, 6))
            for link, W in zip(self._links, weights, strict=True):
                i, j = link.first, link.second
                T = self._between(i, j)
                away = link.misfit(T)
                carry = se3.adjoint(T)  # d away / d pose j; by pose i it is -1
                across = W @ carry
                H[i, i] += W
                H[j, j] += carry.T @ across
                H[i, j] -= across
                H[j, i] -= across.T
                b[i] -= W @ away
                b[j] += across.T @ away
            free = H[1:, 1:].transpose(0, 2, 1, 3).reshape(6 * n - 6, 6 * n - 6)
            steps = -np.linalg.solve(free, b[1:].ravel()).reshape(-1, 6)
            for k, step in enumerate(steps, 1):
                self._poses[k] = self._poses[k] @ se3.exp(step)

    def _between(self, i: int, j: int) -> NDArray[np.float64]:
        """Motion between two poses, from the second to the first."""
        return se3.inverse(self._poses[i]) @ self._poses[j]
