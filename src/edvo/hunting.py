"""Hunting for a place: which of many starts lead to one, and what of that stands all tests."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.instants import Instants
from edvo.keyframes import Keyframe
from edvo.matching import EdgeIndex
from edvo.places import LEAST_FIT, Hunt, Place, distinct, is_apart
from edvo.planes import PlaneFitter, PlanePoints
from edvo.registration import AGREEING, FAILURES, Alignment, Registration
from edvo.scatter import SURE
from edvo.seen import Seen
from edvo.status import Judge, agreement, speed_of

STRIDE = 4  # a search takes one sample in so many
LOOP_M, LOOP_RAD = 0.03, math.radians(1.5)  # that a frame found again may be off, both ways
DRIFT_M, DRIFT_M_S = 0.1, 0.5  # how far from where it is expected a lost camera may well be
SHARPNESS = 8  # a few more edges explained outweigh much of a way
RIVAL = 0.6  # of the best fit: a place that fits so well cannot be told from it
PLACES, SLIGHT = 6, 0.3  # that are looked at closely, unless few samples fit so much worse
TIMES = 2  # that depth is moved by what it has led to
ASIDE_M = (0.2, 0.4, 0.8)  # steps, shelves, and doors repeat at about such distances
SIDES = [sign * axis for axis in np.eye(3) for sign in (-1, 1)]


class Hunter:
    """Says which places a frame fits, and how well.

    Parameters
    ----------
    camera : Camera
    config : Config
    registration : Registration
    fitter : PlaneFitter
    judge : Judge
    instants : Instants
    """

    def __init__(
        self,
        camera: Camera,
        config: Config,
        registration: Registration,
        fitter: PlaneFitter,
        judge: Judge,
        instants: Instants,
    ) -> None:
        self._camera = camera
        self._config = config
        self._registration = registration
        self._fitter = fitter
        self._judge = judge
        self._instants = instants

    def hunt(self, seen: Seen, expected: Sequence[NDArray[np.float64]], gap_s: float) -> Hunt:
        """Say what is looked for, and where.

        Parameters
        ----------
        seen : Seen
            The frame.
        expected : sequence of ndarray of float64, shape (4, 4)
            Where the camera may be expected, T_world_cam.
        gap_s : float
            For how long it has not been known where it is, seconds.

        Returns
        -------
        Hunt
        """
        return Hunt(
            seen=seen,
            few=seen.samples.every(STRIDE),
            edges=self._registration.index(seen.edges.describe(self._camera)),
            planes=self._fitter.planes(seen.frame.depth, seen.T_cam_depth),
            expected=expected,
            reach=DRIFT_M + DRIFT_M_S * gap_s,
            farthest=self._config.motion.max_speed_m_s * gap_s,
            term=self._fitter.term,
        )

    def promising(
        self,
        hunt: Hunt,
        starts: Sequence[tuple[Keyframe, NDArray[np.float64]]],
        known: Sequence[Place] = (),
    ) -> list[tuple[Keyframe, NDArray[np.float64]]]:
        """Register few samples from each start; where they fit, best first.

        Each place once for each keyframe: one may show enough of it, another not.

        Parameters
        ----------
        hunt : Hunt
        starts : sequence of (Keyframe, ndarray of float64, shape (4, 4))
            And T_key_cur.
        known : sequence of Place
            That are looked at closely already.

        Returns
        -------
        list of (Keyframe, ndarray of float64, shape (4, 4))
            And T_world_cam.
        """
        fits = []
        for key, start in starts:
            tried = self._register(hunt, key, hunt.few, start)
            T_world_cam = key.T_world_key @ tried.T_ref_cur
            fit = agreement(tried, key.planes, hunt.seen.points) * hunt.prior(T_world_cam)
            if fit > 0 and hunt.away(T_world_cam) <= hunt.farthest:
                fits.append((fit, key, T_world_cam))
        fits.sort(key=lambda fit: -fit[0])
        best = max([fit for fit, _, _ in fits] + [place.agreed for place in known], default=0.0)
        chosen: list[tuple[Keyframe, NDArray[np.float64]]] = []
        places = [place.T_world_cam for place in known]
        for fit, key, T_world_cam in fits:
            taken = places + [T for other, T in chosen if other is key]
            if (
                len(chosen) < PLACES
                and fit >= SLIGHT * best
                and is_apart(T_world_cam, taken, *hunt.apart)
            ):
                chosen.append((key, T_world_cam))
        return chosen

    def look_closely(
        self, hunt: Hunt, promising: Sequence[tuple[Keyframe, NDArray[np.float64]]]
    ) -> list[Place]:
        """Register all samples both ways; the places that stand this, the worthiest first.

        Parameters
        ----------
        hunt : Hunt
        promising : sequence of (Keyframe, ndarray of float64, shape (4, 4))
            And T_world_cam.

        Returns
        -------
        list of Place
            Each place once.
        """
        places = [self._place(hunt, key, start) for key, start in promising]
        return distinct([place for place in places if place is not None])

    def with_rivals(self, hunt: Hunt, places: Sequence[Place]) -> list[Place]:
        """Leave the best place and those that cannot be told from it, some of them beside it.

        Parameters
        ----------
        hunt : Hunt
        places : sequence of Place
            The worthiest first.

        Returns
        -------
        list of Place
            Likewise, each place once.
        """
        if not places:
            return []
        best = places[0]
        aside = [
            (best.key, se3.inverse(best.key.T_world_key) @ _moved(best.T_world_cam, side * far))
            for far in ASIDE_M
            if far < 2 * hunt.reach  # else it is worth too little
            for side in SIDES
        ]
        others = self.look_closely(hunt, self.promising(hunt, aside, places))
        places = distinct([*places, *others])
        return [place for place in places if place.worth > RIVAL * places[0].worth]

    def is_shared(
        self, key: Keyframe, found: Alignment, seen: Seen, least_fit: float = LEAST_FIT
    ) -> bool:
        """Whether a registration explains most of what both have in view, and leads back.

        Parameters
        ----------
        key : Keyframe
        found : Alignment
            Of the frame, with that.
        seen : Seen
            The frame.
        least_fit : float, optional
            How much has to be, one way times the other, from 0 to 1; as for a lost camera.

        Returns
        -------
        bool
        """
        back, fit = self._both_ways(self.hunt(seen, (), 0.0), key, found, turned=True)
        return fit >= least_fit and _is_loop(found, back)

    def _place(self, hunt: Hunt, key: Keyframe, T_world_start: NDArray[np.float64]) -> Place | None:
        """Register all samples both ways with a keyframe, if that stands all tests."""
        T_key_start = se3.inverse(key.T_world_key) @ T_world_start
        found = self._all(hunt, key, T_key_start)
        if hunt.before is not None and self._judge.is_sure(found, by_depth=False):
            hunt, found = self._in_step(hunt, hunt.before, key, found)
        seen, T_world_cam = hunt.seen, key.T_world_key @ found.T_ref_cur
        if hunt.must_be_sure and not self._is_sure(hunt, found, seen.points):
            return None
        # those that are sure have been asked how edges are turned
        back, fit = self._both_ways(hunt, key, found, turned=not hunt.must_be_sure)
        if fit < hunt.least_fit or hunt.away(T_world_cam) > hunt.farthest:
            return None
        both_ways, by_edges = _is_loop(found, back), False
        if hunt.must_be_sure:
            both_ways = both_ways and self._is_sure(hunt, back, key.points, seen_only=True)
            by_depth = self._judge.is_sure(found) and self._judge.is_sure(back, seen_only=True)
            by_edges = not by_depth
        worth = fit**SHARPNESS * hunt.prior(T_world_cam)
        agreed = agreement(found, key.planes, seen.points)
        return Place(worth, T_world_cam, key, found, agreed, both_ways, hunt, by_edges)

    def _both_ways(
        self, hunt: Hunt, key: Keyframe, found: Alignment, *, turned: bool
    ) -> tuple[Alignment, float]:
        """Register the keyframe with the frame, from where that was found; and what is explained.

        Of what both have in view, one way times the other; turned alike, if that is asked.
        """
        samples, T_cur_key = hunt.seen.samples, se3.inverse(found.T_ref_cur)
        back = self._registration.align(
            hunt.edges, key.samples, T_cur_key[None], hunt.planes, key.points, hunt.term
        )
        there, here = (key.edges, hunt.edges) if turned else (None, None)
        fit = self._explained(found, samples, there) * self._explained(back, key.samples, here)
        return back, fit

    def _is_sure(
        self, hunt: Hunt, found: Alignment, points: PlanePoints, *, seen_only: bool = False
    ) -> bool:
        """Whether a registration is to be believed; depth may be off as far as it is out of step.

        But only where edges are all but sure.
        """
        if self._judge.is_sure(found, seen_only=seen_only):
            return True
        if not hunt.off_m or found.inliers <= SURE * len(found.matches):
            return False
        off_m = found.sigma_depth * float(np.median(points.sigma))
        by_edges = self._judge.is_sure(found, seen_only=seen_only, by_depth=False)
        return by_edges and off_m < hunt.off_m

    def _in_step(
        self, hunt: Hunt, before: Seen, key: Keyframe, found: Alignment
    ) -> tuple[Hunt, Alignment]:
        """Move depth by what the camera has moved by since the frame before, and register again.

        Once more, where depth then still contradicts: what had led astray tells less of it by then.
        The keyframe's depth may still be out of step.
        """
        asked, then, instants = hunt, before, self._instants
        seconds = asked.seen.frame.timestamp - before.frame.timestamp
        for _ in range(TIMES):
            was = self._all(replace(hunt, seen=then), key, found.T_ref_cur)
            if not self._judge.is_sure(was, by_depth=False):
                break
            T_last_cur = se3.inverse(was.T_ref_cur) @ found.T_ref_cur
            if self._judge.jump(*speed_of(T_last_cur, seconds)):
                break
            seen, then = (
                instants.settled(each, T_last_cur, seconds) for each in (asked.seen, before)
            )
            velocity = se3.log(T_last_cur) / seconds
            edges = instants.unrolled(asked.edges.edges, seen, velocity)
            are_still = edges is asked.edges.edges
            hunt = replace(
                asked,
                seen=seen,
                edges=asked.edges if are_still else self._registration.index(edges),
                planes=self._fitter.planes(seen.frame.depth, seen.T_cam_depth),
                velocity=velocity,
            )
            found = self._all(hunt, key, found.T_ref_cur)
            if self._judge.is_sure(found):
                break
        return hunt, found

    def _all(self, hunt: Hunt, key: Keyframe, T_key_start: NDArray[np.float64]) -> Alignment:
        """Register all samples of the frame."""
        return self._register(hunt, key, hunt.seen.samples, T_key_start)

    def _register(
        self, hunt: Hunt, key: Keyframe, samples: EdgePixels, T_key_start: NDArray[np.float64]
    ) -> Alignment:
        seen, edges = hunt.seen, key.edges_for(near=hunt.seen.is_near)
        return self._registration.align(
            edges, samples, T_key_start[None], key.planes, seen.points, hunt.term
        )

    def _explained(
        self, alignment: Alignment, samples: EdgePixels, turned_as: EdgeIndex | None = None
    ) -> float:
        """Share of the edges which the other camera has in view that it sees.

        Turned as those of its own are, where it is given these.
        """
        camera, T = self._camera, alignment.T_ref_cur
        points = samples.points(camera) @ T[:3, :3].T + T[:3, 3]
        z = np.maximum(points[:, 2], 1e-6)
        u, v = camera.fx * points[:, 0] / z + camera.cx, camera.fy * points[:, 1] / z + camera.cy
        ahead = points[:, 2] > 1e-6
        inside = ahead & (u > 0) & (v > 0) & (u < camera.width - 1) & (v < camera.height - 1)
        fits = np.abs(alignment.residuals) < self._config.status.inlier_px
        if turned_as is not None:
            matched = turned_as.edges.gradients[np.maximum(alignment.matches, 0)]
            fits &= (matched * samples.gradients).sum(axis=1) > AGREEING
        in_view = int(np.count_nonzero(inside))
        if alignment.reason in FAILURES or in_view < self._config.registration.min_matches:
            return 0.0
        return int(np.count_nonzero(fits & inside)) / in_view


def _is_loop(found: Alignment, back: Alignment) -> bool:
    """Whether the keyframe, registered with the frame, leads back to where it came from."""
    T_loop = back.T_ref_cur @ found.T_ref_cur
    apart, turned = math.hypot(*T_loop[:3, 3].tolist()), se3.rotation_angle(T_loop)
    return apart < LOOP_M and turned < LOOP_RAD


def _moved(T: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose of a camera that has been carried along its own axes."""
    moved = T.copy()
    moved[:3, 3] += T[:3, :3] @ way
    return moved
