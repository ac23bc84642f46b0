"""Looking farther afield: for a registration in doubt, and for a place known from before."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.chamfer import Guess
from edvo.config import Config
from edvo.course import FASTEST_M_S
from edvo.edges import EdgePixels
from edvo.instants import Instants
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.look import Look
from edvo.matching import EdgeIndex
from edvo.planes import DepthTerm, PlaneFitter, PlaneMap, PlanePoints, thinned
from edvo.registration import AGREEING, FAILURES, Alignment, Registration
from edvo.seen import Seen
from edvo.status import SURE, Judge, agreement, speed_of

STRIDE = 4  # a search takes one sample in so many
LOOP_M, LOOP_RAD = 0.03, math.radians(1.5)  # that a frame found again may be off, both ways
DRIFT_M, DRIFT_M_S = 0.1, 0.5  # how far from where it is expected a lost camera may well be
APART_M, APART_RAD = 0.1, math.radians(5.0)  # poses nearer to each other are the same place
LIKELY = 3  # guesses taken from each start, of a far step or a lost camera
BEGUN = 2  # of these and of where the camera may be else; registration starts from one
MORE = 6  # guesses taken where a registration is in doubt or a far step has led to nothing
GLANCES = 12  # guesses registered for a lost camera, of all its starts together
ELSE_M, ELSE_RAD = 0.05, math.radians(1.5)  # guesses nearer to each other lead to the same place
DOUBTS = (1.0, 0.3, 0.1)  # times that of depth, where it may be out of step
LEAST_FIT, FAR_FIT = 0.6, 0.15  # of the edges in view, both ways: chance a quarter each way
SHARPNESS = 8  # a few more edges explained outweigh much of a way
RIVAL = 0.6  # of the best fit: a place that fits so well cannot be told from it
RIVALS = 3  # that are followed at most
PLACES, SLIGHT = 6, 0.3  # that are looked at closely, unless few samples fit so much worse
TIMES = 2  # that depth is moved by what it has led to
AS_WELL = 0.96  # of the score of a place: by a glance that cannot be told from it
ASIDE_M = (0.2, 0.4, 0.8)  # steps, shelves, and doors repeat at about such distances
SIDES = [sign * axis for axis in np.eye(3) for sign in (-1, 1)]
ASIDE = np.array([far * side for far in ASIDE_M for side in SIDES])


class Found(NamedTuple):
    """Where a lost camera is.

    Attributes
    ----------
    key : Keyframe
        That its frame fits.
    alignment : Alignment
        With that.
    seen : Seen
        The frame, its parts moved to one instant where it is known how fast the camera goes.
    velocity : ndarray of float64, shape (6,), or None
        Of the camera, in its own frame, 1/s; None where it is not known.
    by_edges : bool
        Whether depth would contradict it, were it taken at the instant of its image.
    """

    key: Keyframe
    alignment: Alignment
    seen: Seen
    velocity: NDArray[np.float64] | None
    by_edges: bool


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
        self._judge = judge
        self._instants = instants
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
            For how long it has been lost.
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
        hunt = self._hunt(seen, expected, gap_s)
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
        promising = self._promising(hunt, starts)
        best_poses = [T_world_cam for _, T_world_cam in promising[:1]]
        for key in (last, *likest):  # what one of them shows too little of another may show
            taken = [T for other, T in promising if other is key]
            promising += [(key, T) for T in best_poses if is_apart(T, taken)]
        rivals = self._with_rivals(hunt, self._look_closely(hunt, promising))
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
        hunt = self._hunt(seen, [T_world_start], gap_s)
        hunt = replace(hunt, must_be_sure=False, least_fit=FAR_FIT, apart=(ELSE_M, ELSE_RAD))
        for doubt in DOUBTS:
            term = self._fitter.term._replace(doubt=self._fitter.term.doubt * doubt)
            hunt = replace(hunt, term=term)
            places = self._look_closely(hunt, self._promising(hunt, starts))
            rivals = self._with_rivals(hunt, places)
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

    def _hunt(self, seen: Seen, expected: Sequence[NDArray[np.float64]], gap_s: float) -> "_Hunt":
        return _Hunt(
            seen=seen,
            few=seen.samples.every(STRIDE),
            edges=self._registration.index(seen.edges.describe(self._camera)),
            planes=self._fitter.planes(seen.frame.depth, seen.T_cam_depth),
            expected=expected,
            reach=DRIFT_M + DRIFT_M_S * gap_s,
            farthest=self._config.motion.max_speed_m_s * gap_s,
            term=self._fitter.term,
        )

    def _with_rivals(self, hunt: "_Hunt", places: Sequence["_Place"]) -> list["_Place"]:
        """Leave the best place and those that cannot be told from it, some of them beside it."""
        if not places:
            return []
        best = places[0]
        aside = [
            (best.key, se3.inverse(best.key.T_world_key) @ _moved(best.T_world_cam, side * far))
            for far in ASIDE_M
            if far < 2 * hunt.reach  # else it is worth too little
            for side in SIDES
        ]
        others = self._look_closely(hunt, self._promising(hunt, aside, places))
        places = _distinct([*places, *others])
        return [place for place in places if place.worth > RIVAL * places[0].worth]

    def _promising(
        self,
        hunt: "_Hunt",
        starts: Sequence[tuple[Keyframe, NDArray[np.float64]]],
        known: Sequence["_Place"] = (),
    ) -> list[tuple[Keyframe, NDArray[np.float64]]]:
        """Register few samples from each start; where they fit, best first.

        Each place once for each keyframe: one may show enough of it, another not.
        """
        fits, near = [], hunt.seen.is_near
        for key, start in starts:
            tried = self._register(key, hunt.few, hunt.seen.points, start, hunt.term, near=near)
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

    def _look_closely(
        self, hunt: "_Hunt", promising: Sequence[tuple[Keyframe, NDArray[np.float64]]]
    ) -> list["_Place"]:
        """Register all samples both ways; the places that stand this, the worthiest first."""
        places = [self._place(hunt, key, start) for key, start in promising]
        return _distinct([place for place in places if place is not None])

    def _place(
        self, hunt: "_Hunt", key: Keyframe, T_world_start: NDArray[np.float64]
    ) -> "_Place | None":
        """Register all samples both ways with a keyframe, if that stands all tests."""
        T_key_start = se3.inverse(key.T_world_key) @ T_world_start
        found = self._all(hunt, key, T_key_start)
        if hunt.before is not None and self._judge.is_sure(found, by_depth=False):
            hunt, found = self._in_step(hunt, hunt.before, key, found)
        seen, T_world_cam = hunt.seen, key.T_world_key @ found.T_ref_cur
        if hunt.must_be_sure and not self._is_sure(hunt, found, seen.points):
            return None
        T_cur_key = se3.inverse(found.T_ref_cur)
        back = self._registration.align(
            hunt.edges, key.samples, T_cur_key[None], hunt.planes, key.points, hunt.term
        )
        # those that are sure have been asked how edges are turned
        there, here = (None, None) if hunt.must_be_sure else (key.edges, hunt.edges)
        fit = self._explained(found, seen.samples, there)
        fit *= self._explained(back, key.samples, here)
        if fit < hunt.least_fit or hunt.away(T_world_cam) > hunt.farthest:
            return None
        both_ways, by_edges = _is_loop(found, back), False
        if hunt.must_be_sure:
            both_ways = both_ways and self._is_sure(hunt, back, key.points, seen_only=True)
            by_depth = self._judge.is_sure(found) and self._judge.is_sure(back, seen_only=True)
            by_edges = not by_depth
        worth = fit**SHARPNESS * hunt.prior(T_world_cam)
        agreed = agreement(found, key.planes, seen.points)
        return _Place(worth, T_world_cam, key, found, agreed, both_ways, hunt, by_edges)

    def _is_sure(
        self, hunt: "_Hunt", found: Alignment, points: PlanePoints, *, seen_only: bool = False
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
        self, hunt: "_Hunt", before: Seen, key: Keyframe, found: Alignment
    ) -> tuple["_Hunt", Alignment]:
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

    def _all(self, hunt: "_Hunt", key: Keyframe, T_key_start: NDArray[np.float64]) -> Alignment:
        """Register all samples of the frame."""
        seen = hunt.seen
        return self._register(
            key, seen.samples, seen.points, T_key_start, hunt.term, near=seen.is_near
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

    def _register(
        self,
        key: Keyframe,
        samples: EdgePixels,
        points: PlanePoints,
        start: NDArray[np.float64],
        term: DepthTerm | None = None,
        *,
        near: bool = False,
    ) -> Alignment:
        edges, term = key.edges_for(near=near), term or self._fitter.term
        return self._registration.align(edges, samples, start[None], key.planes, points, term)


@dataclass(frozen=True, slots=True)
class _Hunt:
    """What is looked for, and where: near the poses expected, within reach, no farther at all."""

    seen: Seen
    few: EdgePixels
    edges: EdgeIndex
    planes: PlaneMap
    expected: Sequence[NDArray[np.float64]]
    reach: float
    farthest: float
    term: DepthTerm
    before: Seen | None = None
    velocity: NDArray[np.float64] | None = None
    off_m: float = 0.0  # by so much depth may be off its image
    must_be_sure: bool = True
    least_fit: float = LEAST_FIT
    apart: tuple[float, float] = (APART_M, APART_RAD)

    def away(self, T_world_cam: NDArray[np.float64]) -> float:
        """Metres from the nearest pose that is expected."""
        return min(se3.distance(T_expected, T_world_cam) for T_expected in self.expected)

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
    hunt: _Hunt
    by_edges: bool


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


def _distinct(places: Sequence[_Place]) -> list[_Place]:
    """Leave the worthiest registration of each place, the worthiest place first."""
    kept: list[_Place] = []
    for place in sorted(places, key=lambda place: -place.worth):
        if is_apart(place.T_world_cam, [other.T_world_cam for other in kept]):
            kept.append(place)
    return kept


def is_apart(
    T: NDArray[np.float64],
    others: Sequence[NDArray[np.float64]],
    metres: float = APART_M,
    radians: float = APART_RAD,
) -> bool:
    """Whether a pose is none of some others.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)
    others : sequence of ndarray of float64, shape (4, 4)
    metres, radians : float
        Poses nearer to each other, by both, are the same.

    Returns
    -------
    bool
    """
    return all(
        se3.distance(T, other) > metres or se3.rotation_angle(se3.inverse(T) @ other) > radians
        for other in others
    )
