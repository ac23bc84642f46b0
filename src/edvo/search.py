"""Looking farther afield: for a registration in doubt, and for a place known from before."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.chamfer import AS_WELL, Guess
from edvo.config import Config
from edvo.course import FASTEST_M_S
from edvo.edges import EdgePixels
from edvo.hunting import ASIDE_M, SIDES, STRIDE, Hunter
from edvo.instants import Instants
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.look import Look
from edvo.places import LEAST_FIT, Found, is_apart
from edvo.planes import PlaneFitter, PlanePoints, thinned
from edvo.registration import Alignment, Registration
from edvo.seen import Seen
from edvo.status import Judge, agreement

LIKELY = 3  # guesses taken from each start, of a far step or a lost camera
BEGUN = 2  # of these and of where the camera may be else; registration starts from one
MORE = 6  # guesses taken where a registration is in doubt or a far step has led to nothing
GLANCES = 12  # guesses registered for a lost camera, of all its starts together
ELSE_M, ELSE_RAD = 0.05, math.radians(1.5)  # guesses nearer to each other lead to the same place
DOUBTS = (1.0, 0.3, 0.1)  # times that of depth, where it may be out of step
FAR_FIT = 0.15  # of the edges in view, both ways, in a far step: chance a quarter each way
RIVALS = 3  # of places that cannot be told apart so many are followed at most
ASIDE = np.array([far * side for far in ASIDE_M for side in SIDES])


class Search:
    """Finds where a frame belongs, from many starts.

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
        self._instants = instants
        self._hunter = Hunter(camera, config, registration, fitter, judge, instants)
        self._reach = config.motion.search_deg
        self._rivals: list[tuple[Keyframe, NDArray[np.float64]]] = []  # and T_key_cur of each

    def around(
        self,
        key: Keyframe,
        T_key_start: NDArray[np.float64],
        seen: Seen,
        found: Alignment | None = None,
    ) -> Alignment:
        """Look for where both edges and depth agree best, with few samples, from likely places.

        Places are told at a glance, from where edges fall; see `edvo.chamfer`.

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
        samples, points, near = seen.samples, seen.points, seen.is_near
        guesses = key.chamfer.likely(samples, T_key_start, self._reach, MORE)
        already = 0.0
        if found is not None:
            already = agreement(found, key.planes, points)
            known, score = found.T_ref_cur, key.chamfer.score(samples, found.T_ref_cur)
            guesses = [
                guess
                for guess in guesses
                if guess.score > score and is_apart(guess.T_ref_cur, [known], ELSE_M, ELSE_RAD)
            ]
            if not guesses:
                return found  # a glance tells that it is nowhere else
        few = samples.every(STRIDE)
        usual = thinned(points, self._config.planes.point_step_px)
        best, most = None, already
        for guess in guesses:
            tried = self._register(key, few, usual, guess.T_ref_cur, near=near)
            agreed = agreement(tried, key.planes, usual)
            if agreed > most:
                best, most = tried.T_ref_cur, agreed
        if best is None and found is not None:
            return found
        start = T_key_start if best is None else best
        again = self._register(key, samples, points, start, near=near)
        if found is not None and agreement(again, key.planes, points) <= already:
            return found  # what few samples promised, all of them do not keep
        return again

    def likeliest(
        self,
        key: Keyframe,
        T_key_start: NDArray[np.float64],
        seen: Seen,
        others: Sequence[NDArray[np.float64]] = (),
    ) -> list[NDArray[np.float64]]:
        """Tell at a glance where a frame may belong.

        Parameters
        ----------
        key : Keyframe
        T_key_start : ndarray of float64, shape (4, 4)
            Where the camera may have turned from.
        seen : Seen
        others : sequence of ndarray of float64, shape (4, 4)
            Where it may be else.

        Returns
        -------
        list of ndarray of float64, shape (4, 4)
            ``T_key_cur``, the likeliest first; no more than ``BEGUN``.
        """
        samples = seen.samples
        guesses = key.chamfer.likely(samples, T_key_start, self._reach, LIKELY, carried=False)
        guesses += [Guess(key.chamfer.score(samples, T), T) for T in others]
        guesses.sort(key=lambda guess: -guess.score)
        return [guess.T_ref_cur for guess in guesses[:BEGUN]]

    def is_alone(self, key: Keyframe, T_key_cur: NDArray[np.float64], seen: Seen) -> bool:
        """Tell at a glance whether no place beside the one found fits as well, as steps do.

        Parameters
        ----------
        key : Keyframe
        T_key_cur : ndarray of float64, shape (4, 4)
            The pose found.
        seen : Seen

        Returns
        -------
        bool
        """
        starts = np.tile(T_key_cur, (len(ASIDE), 1, 1))
        starts[:, :3, 3] += ASIDE @ T_key_cur[:3, :3].T
        enough = AS_WELL * key.chamfer.score(seen.samples, T_key_cur)
        return not any(
            guess.score > enough and is_apart(guess.T_ref_cur, [T_key_cur])
            for guess in key.chamfer.beside(seen.samples, starts)
        )

    def is_shared(
        self, key: Keyframe, found: Alignment, seen: Seen, least_fit: float = LEAST_FIT
    ) -> bool:
        """Whether of what both have in view most is where a registration says, both ways.

        Parameters
        ----------
        key : Keyframe
        found : Alignment
            Of the frame, with that.
        seen : Seen
            The frame.
        least_fit : float, optional
            How much of it, one way times the other, from 0 to 1; as for a lost camera.

        Returns
        -------
        bool
        """
        return self._hunter.is_shared(key, found, seen, least_fit)

    def everywhere(
        self,
        store: KeyframeStore,
        last: Keyframe,
        seen: Seen,
        expected: Sequence[NDArray[np.float64]],
        gap_s: float,
        sure: tuple[Keyframe, NDArray[np.float64]] | None = None,
        before: Seen | None = None,
        *,
        at_any_speed: bool = False,
    ) -> Found | None:
        """Find the keyframe that the frame of a lost camera fits, beyond doubt and both ways.

        The last keyframe is tried from where the camera is expected, those that look like the
        frame from there, too, and from where they are. A place far from where the camera is
        expected must fit better; and where things repeat, as steps and doors do, and two places
        fit, it is neither.

        Parameters
        ----------
        store : KeyframeStore
        last : Keyframe
            That the camera was lost from.
        seen : Seen
        expected : sequence of ndarray of float64, shape (4, 4)
            Where the camera may be expected, T_world_cam.
        gap_s : float
            For how long it has been lost, seconds.
        sure : (Keyframe, ndarray of float64, shape (4, 4)), optional
            Where it was beyond doubt before it was lost: T_key_cur. What it has followed since, a
            hand for instance, may look liker the frame, and have led it away.
        before : Seen, optional
            The frame before it, if that was lost too: it tells how fast the camera goes, and so how
            far the parts of the frame, which are taken at several instants, are off.
        at_any_speed : bool
            Whether nobody knows how fast it goes, so that depth may be off by what a camera moves
            by from an image to its depth: edges that are sure of a place are then believed.

        Returns
        -------
        Found or None
        """
        if sure is not None:
            expected = [*expected, sure[0].T_world_key @ sure[1]]
        hunt = self._hunter.hunt(seen, expected, gap_s)
        if at_any_speed:
            off_m = FASTEST_M_S * self._instants.depth.at_most(seen)
            hunt = replace(hunt, before=before, off_m=off_m)
        look = Look(hunt.edges.edges, self._camera)
        likest = store.likest(look, self._config.keyframes.tried)
        if sure is not None and all(key.index != sure[0].index for key in likest):
            likest.append(sure[0])
        starts = [(last, se3.inverse(last.T_world_key) @ T_world_cam) for T_world_cam in expected]
        starts += [(key, np.eye(4)) for key in likest]
        starts += self._rivals  # a doubt lasts until one of them no longer fits
        starts += [(key, se3.inverse(key.T_world_key) @ T) for key in likest for T in expected]
        starts = [*self._rivals, *self._glance(starts, seen)]
        promising = self._hunter.promising(hunt, starts)
        best_poses = [T_world_cam for _, T_world_cam in promising[:1]]
        for key in (last, *likest):  # what one of them shows too little of another may show
            taken = [T for other, T in promising if other is key]
            promising += [(key, T) for T in best_poses if is_apart(T, taken)]
        rivals = self._hunter.with_rivals(hunt, self._hunter.look_closely(hunt, promising))
        if not rivals:
            return None  # a doubt outlives a frame that fits nothing
        if len(rivals) > 1:
            self._rivals = [(place.key, place.found.T_ref_cur) for place in rivals[:RIVALS]]
            return None
        self._rivals = []
        best = rivals[0]
        if not best.both_ways:
            return None
        return Found(best.key, best.found, best.hunt.seen, best.hunt.velocity, best.by_edges)

    def forget(self) -> None:
        """Drop doubts: it is known again where the camera is."""
        self._rivals = []

    def farther(
        self, key: Keyframe, T_key_start: NDArray[np.float64], seen: Seen, gap_s: float
    ) -> Alignment | None:
        """Look for a step that is too far for the judge: little may be in view of both.

        Depth counts as it does, and where that finds no place, or several, less: in a fast turn
        it is out of step with the edges. What is found has to explain enough of what both see,
        both ways, and nothing else may that is found in the same way.

        Parameters
        ----------
        key : Keyframe
        T_key_start : ndarray of float64, shape (4, 4)
            Where the camera was.
        seen : Seen
        gap_s : float
            When, seconds ago.

        Returns
        -------
        Alignment or None
        """
        T_world_start = key.T_world_key @ T_key_start
        guesses = key.chamfer.likely(seen.samples, T_key_start, self._reach, MORE)
        starts = [(key, T_key_start)] + [(key, guess.T_ref_cur) for guess in guesses]
        hunt = self._hunter.hunt(seen, [T_world_start], gap_s)
        hunt = replace(hunt, must_be_sure=False, least_fit=FAR_FIT, apart=(ELSE_M, ELSE_RAD))
        for doubt in DOUBTS:
            term = self._fitter.term._replace(doubt=self._fitter.term.doubt * doubt)
            hunt = replace(hunt, term=term)
            places = self._hunter.look_closely(hunt, self._hunter.promising(hunt, starts))
            rivals = self._hunter.with_rivals(hunt, places)
            if len(rivals) == 1 and rivals[0].both_ways:
                return rivals[0].found
        return None

    def _glance(
        self, starts: Sequence[tuple[Keyframe, NDArray[np.float64]]], seen: Seen
    ) -> list[tuple[Keyframe, NDArray[np.float64]]]:
        """Choose the likeliest of all places that a glance tells from several starts."""
        if not self._reach:
            return list(starts)
        guesses = [
            (guess.score, key, guess.T_ref_cur)
            for key, start in starts
            for guess in key.chamfer.likely(seen.samples, start, self._reach, LIKELY)
        ]
        chosen: list[tuple[Keyframe, NDArray[np.float64]]] = []
        for _, key, T_key_cur in sorted(guesses, key=lambda guess: -guess[0]):
            taken = [T for other, T in chosen if other is key]
            if len(chosen) < GLANCES and is_apart(T_key_cur, taken, ELSE_M, ELSE_RAD):
                chosen.append((key, T_key_cur))
        return chosen

    def _register(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        start: NDArray[np.float64],
        *,
        near: bool = False,
    ) -> Alignment:
        edges, term = key.edges_for(near=near), self._fitter.term
        return self._registration.align(edges, samples, start[None], key.planes, points, term)
