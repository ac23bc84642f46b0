"""Looking farther afield: for a registration in doubt, and for a place known from before."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgeImage, EdgePixels
from edvo.frame import Frame
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.planes import PlaneFitter, PlanePoints
from edvo.registration import Alignment, Registration
from edvo.status import Judge, agreement

STRIDE = 4  # a search takes one sample in so many
LOOP_M, LOOP_RAD = 0.03, math.radians(1.5)  # that a frame found again may be off, both ways
DRIFT_M, DRIFT_M_S = 0.1, 0.5  # how far from where it is expected a lost camera may well be
APART_M = 0.1  # poses nearer to each other are the same place
LEAST_FIT = 0.6  # of the edges in view, one way times the other: less is no place at all
SHARPNESS = 8  # a few more edges explained outweigh much of a way
RIVAL = 0.6  # of the best fit: a place that fits so well cannot be told from it
RIVALS = 3  # that are followed at most
PLACES, SLIGHT = 6, 0.3  # that are looked at closely, unless few samples fit so much worse
ASIDE_M = (0.2, 0.4, 0.8)  # steps, shelves, and doors repeat at about such distances
SIDES = [sign * axis for axis in np.eye(3) for sign in (-1, 1)]


@dataclass(frozen=True, slots=True)
class Seen:
    """A frame, and what was made of it."""

    frame: Frame
    edges: EdgeImage
    samples: EdgePixels
    points: PlanePoints


class Search:
    """Finds where a frame belongs, from many starts.

    Parameters
    ----------
    camera : Camera
    config : Config
    registration : Registration
    fitter : PlaneFitter
    judge : Judge
    """

    def __init__(
        self,
        camera: Camera,
        config: Config,
        registration: Registration,
        fitter: PlaneFitter,
        judge: Judge,
    ) -> None:
        self._camera = camera
        self._config = config
        self._registration = registration
        self._fitter = fitter
        self._judge = judge
        self._rivals: list[tuple[Keyframe, NDArray[np.float64]]] = []  # and T_key_cur of each

    def around(
        self,
        key: Keyframe,
        T_key_start: NDArray[np.float64],
        seen: Seen,
        found: Alignment | None = None,
    ) -> Alignment:
        """Look for where both edges and depth agree best, with few samples, from many turns.

        A hand turns a camera faster than it carries it, so what an image moves by is mostly yaw
        and pitch.

        Parameters
        ----------
        key : Keyframe
        T_key_start : ndarray of float64, shape (4, 4)
            The middle of the starts.
        seen : Seen
        found : Alignment, optional
            What is to be improved on.

        Returns
        -------
        Alignment
            ``found``, if nothing agrees better.
        """
        few, points = seen.samples.every(STRIDE), seen.points
        already = 0.0 if found is None else agreement(found, key.planes, points)
        best, most = None, already
        for turn in self._turns():
            tried = self._register(key, few, points, T_key_start @ turn)
            agreed = agreement(tried, key.planes, points)
            if agreed > most:
                best, most = tried.T_ref_cur, agreed
        if best is None and found is not None:
            return found
        again = self._register(key, seen.samples, points, T_key_start if best is None else best)
        if found is not None and agreement(again, key.planes, points) <= already:
            return found  # what few samples promised, all of them do not keep
        return again

    def everywhere(
        self,
        store: KeyframeStore,
        last: Keyframe,
        seen: Seen,
        expected: Sequence[NDArray[np.float64]],
        gap_s: float,
    ) -> tuple[Keyframe, Alignment] | None:
        """Find the keyframe that the frame of a lost camera fits, beyond doubt and both ways.

        The last keyframe is tried from where the camera is expected, those that look like the
        frame from where they are. A place far from where the camera is expected must fit better;
        and where things repeat, as steps and doors do, and two places fit, it is neither.

        Parameters
        ----------
        store : KeyframeStore
        last : Keyframe
            That the camera was lost from.
        seen : Seen
        expected : sequence of ndarray of float64, shape (4, 4)
            Where the camera may be expected, T_world_cam.
        gap_s : float
            For how long it has been lost.

        Returns
        -------
        (Keyframe, Alignment) or None
        """
        starts = [(last, se3.inverse(last.T_world_key) @ T_world_cam) for T_world_cam in expected]
        likest = store.likest(seen.edges.view(), self._config.keyframes.tried)
        starts += [(key, np.eye(4)) for key in likest]
        starts += self._rivals  # a doubt lasts until one of them no longer fits
        turned = [(key, start @ turn) for key, start in starts for turn in self._turns()]
        few = seen.samples.every(STRIDE)
        farthest = self._config.motion.max_speed_m_s * gap_s
        bound = _Bound(expected, DRIFT_M + DRIFT_M_S * gap_s, farthest)
        places = self._look_closely(self._promising(turned, few, seen, bound, []), seen, bound)
        if places:
            best = places[0]
            aside = [
                (best.key, se3.inverse(best.key.T_world_key) @ _moved(best.T_world_cam, side * far))
                for far in ASIDE_M
                if far < 2 * bound.reach  # else it is worth too little
                for side in SIDES
            ]
            others = self._promising(aside, few, seen, bound, places)
            places = _distinct(places + self._look_closely(others, seen, bound))
        rivals = [place for place in places if place.worth > RIVAL * places[0].worth]
        self._rivals = [(place.key, place.found.T_ref_cur) for place in rivals[:RIVALS]]
        if len(rivals) != 1:
            return None
        self._rivals = []
        best = places[0]
        return (best.key, best.found) if best.both_ways else None

    def _turns(self) -> list[NDArray[np.float64]]:
        """What a camera may have turned by, in its own frame."""
        angle = math.radians(self._config.motion.search_deg)
        return [
            se3.exp(np.array([0.0, 0.0, 0.0, pitch * angle, yaw * angle, 0.0]))
            for yaw in (-2, -1, 0, 1, 2)
            for pitch in (-1, 0, 1)
        ]

    def _promising(
        self,
        starts: Sequence[tuple[Keyframe, NDArray[np.float64]]],
        few: EdgePixels,
        seen: Seen,
        bound: "_Bound",
        known: Sequence["_Place"],
    ) -> list[tuple[Keyframe, NDArray[np.float64]]]:
        """Register few samples from each start; where they fit, best first, each place once."""
        fits = []
        for key, start in starts:
            tried = self._register(key, few, seen.points, start)
            T_world_cam = key.T_world_key @ tried.T_ref_cur
            fit = agreement(tried, key.planes, seen.points) * bound.prior(T_world_cam)
            if fit > 0 and bound.away(T_world_cam) <= bound.farthest:
                fits.append((fit, key, T_world_cam))
        fits.sort(key=lambda fit: -fit[0])
        chosen: list[tuple[Keyframe, NDArray[np.float64]]] = []
        taken = [place.T_world_cam for place in known]
        least = SLIGHT * max(
            [fit for fit, _, _ in fits] + [place.agreed for place in known], default=0
        )
        for fit, key, T_world_cam in fits:
            if len(chosen) < PLACES and fit >= least and _is_apart(T_world_cam, taken):
                taken.append(T_world_cam)
                chosen.append((key, T_world_cam))
        return chosen

    def _look_closely(
        self,
        promising: Sequence[tuple[Keyframe, NDArray[np.float64]]],
        seen: Seen,
        bound: "_Bound",
    ) -> list["_Place"]:
        """Register all samples both ways; the places that stand this, the worthiest first."""
        if not promising:
            return []
        edges = self._registration.index(seen.edges.describe(self._camera))
        planes = self._fitter.planes(seen.frame.depth)
        places: list[_Place] = []
        for key, start in promising:
            T_key_start = se3.inverse(key.T_world_key) @ start
            found = self._register(key, seen.samples, seen.points, T_key_start)
            T_world_cam = key.T_world_key @ found.T_ref_cur
            if not self._judge.is_sure(found) or bound.away(T_world_cam) > bound.farthest:
                continue
            T_cur_key = se3.inverse(found.T_ref_cur)
            back = self._registration.align(
                edges, key.samples, T_cur_key[None], planes, key.points, self._fitter.term
            )
            fit = self._explained(found, seen.samples) * self._explained(back, key.samples)
            if fit < LEAST_FIT:
                continue
            worth = fit**SHARPNESS * bound.prior(T_world_cam)
            agreed = agreement(found, key.planes, seen.points)
            loop = self._is_loop(found, back)
            places.append(_Place(worth, T_world_cam, key, found, agreed, loop))
        return _distinct(places)

    def _explained(self, alignment: Alignment, samples: EdgePixels) -> float:
        """Share of the edges which the other camera has in view that it sees, too."""
        camera, T = self._camera, alignment.T_ref_cur
        points = samples.points(camera) @ T[:3, :3].T + T[:3, 3]
        z = np.maximum(points[:, 2], 1e-6)
        u, v = camera.fx * points[:, 0] / z + camera.cx, camera.fy * points[:, 1] / z + camera.cy
        ahead = points[:, 2] > 1e-6
        inside = ahead & (u > 0) & (v > 0) & (u < camera.width - 1) & (v < camera.height - 1)
        fits = np.abs(alignment.residuals) < self._config.status.inlier_px
        return float(np.count_nonzero(fits & inside) / max(np.count_nonzero(inside), 1))

    def _is_loop(self, found: Alignment, back: Alignment) -> bool:
        """Whether the keyframe, registered with the frame, leads back to where it came from."""
        T_loop = back.T_ref_cur @ found.T_ref_cur
        apart, turned = math.hypot(*T_loop[:3, 3].tolist()), se3.rotation_angle(T_loop)
        return self._judge.is_sure(back, seen_only=True) and apart < LOOP_M and turned < LOOP_RAD

    def _register(
        self, key: Keyframe, samples: EdgePixels, points: PlanePoints, start: NDArray[np.float64]
    ) -> Alignment:
        return self._registration.align(
            key.edges, samples, start[None], key.planes, points, self._fitter.term
        )


@dataclass(frozen=True, slots=True)
class _Bound:
    """Where a lost camera may be: the poses expected, how far off it may well be, and at all."""

    expected: Sequence[NDArray[np.float64]]
    reach: float
    farthest: float

    def away(self, T_world_cam: NDArray[np.float64]) -> float:
        """Metres from the nearest pose that is expected."""
        return min(_distance(T_expected, T_world_cam) for T_expected in self.expected)

    def prior(self, T_world_cam: NDArray[np.float64]) -> float:
        """What a place is worth before it is looked at, up to 1."""
        return math.exp(-((self.away(T_world_cam) / self.reach) ** 2) / 2)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a frame may have been taken: its worth, and the registration that says so."""

    worth: float
    T_world_cam: NDArray[np.float64]
    key: Keyframe
    found: Alignment
    agreed: float
    both_ways: bool


def _moved(T: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose of a camera that has been carried along its own axes."""
    moved = T.copy()
    moved[:3, 3] += T[:3, :3] @ way
    return moved


def _distinct(places: Sequence[_Place]) -> list[_Place]:
    """Leave the worthiest registration of each place, the worthiest place first."""
    kept: list[_Place] = []
    for place in sorted(places, key=lambda place: -place.worth):
        if _is_apart(place.T_world_cam, [other.T_world_cam for other in kept]):
            kept.append(place)
    return kept


def _is_apart(T: NDArray[np.float64], others: Sequence[NDArray[np.float64]]) -> bool:
    return all(_distance(T, other) > APART_M for other in others)


def _distance(T_a: NDArray[np.float64], T_b: NDArray[np.float64]) -> float:
    return math.hypot(*(T_a[:3, 3] - T_b[:3, 3]).tolist())
