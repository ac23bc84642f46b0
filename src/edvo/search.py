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
SHARPNESS = 4  # a little more agreement outweighs much of a way
RIVAL = 0.6  # of the best fit: a place that fits so well cannot be told from it
RIVALS = 3  # that are followed at most

Fit = tuple[float, NDArray[np.float64], Keyframe, Alignment]  # how well, T_world_cam, to what


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
        angle = math.radians(self._config.motion.search_deg)
        already = 0.0 if found is None else agreement(found, key.planes, points)
        best, most = None, already
        for yaw in (-2, -1, 0, 1, 2):
            for pitch in (-1, 0, 1):
                turn = se3.exp(np.array([0.0, 0.0, 0.0, pitch * angle, yaw * angle, 0.0]))
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
        reach = DRIFT_M + DRIFT_M_S * gap_s
        farthest = self._config.motion.max_speed_m_s * gap_s
        fits: list[Fit] = []
        for key, T_key_start in starts:
            found = self.around(key, T_key_start, seen)
            place = key.T_world_key @ found.T_ref_cur
            away = min(_distance(T_world_cam, place) for T_world_cam in expected)
            if not self._judge.is_sure(found) or away > farthest:
                continue
            fit = agreement(found, key.planes, seen.points) ** SHARPNESS
            fits.append((fit * math.exp(-((away / reach) ** 2) / 2), place, key, found))
        fits.sort(key=lambda candidate: -candidate[0])
        places: list[Fit] = []
        for candidate in fits:
            if all(_distance(candidate[1], other[1]) > APART_M for other in places):
                places.append(candidate)
        if len(places) > 1 and places[1][0] > RIVAL * places[0][0]:
            self._rivals = [(key, found.T_ref_cur) for _, _, key, found in places[:RIVALS]]
            return None
        self._rivals = []
        if not places:
            return None
        _, _, key, found = places[0]
        return (key, found) if self._fits_back(key, found, seen) else None

    def _fits_back(self, key: Keyframe, found: Alignment, seen: Seen) -> bool:
        """Whether the keyframe, registered with the frame, leads back to where it came from."""
        back = self._registration.align(
            self._registration.index(seen.edges.describe(self._camera)),
            key.samples,
            se3.inverse(found.T_ref_cur)[None],
            self._fitter.planes(seen.frame.depth),
            key.points,
            self._fitter.term,
        )
        T_loop = back.T_ref_cur @ found.T_ref_cur
        apart, turned = math.hypot(*T_loop[:3, 3].tolist()), se3.rotation_angle(T_loop)
        return self._judge.is_sure(back, seen_only=True) and apart < LOOP_M and turned < LOOP_RAD

    def _register(
        self, key: Keyframe, samples: EdgePixels, points: PlanePoints, start: NDArray[np.float64]
    ) -> Alignment:
        return self._registration.align(
            key.edges, samples, start[None], key.planes, points, self._fitter.term
        )


def _distance(T_a: NDArray[np.float64], T_b: NDArray[np.float64]) -> float:
    return math.hypot(*(T_a[:3, 3] - T_b[:3, 3]).tolist())
