"""The background: what stands still, where much of the view moves by itself.

Not in the paper. Where people fill the view, edges and depth fit *them*, and the pose goes along.
Which surfaces stand still is told by what was seen before: they lie where the keyframe, and images
of the last second, saw a surface. What moves by a few centimetres leaves the planes that it was
on, whatever the pose says. Far walls have no depth, but edges: under the true motion these fit at
some depth beyond the reach of the sensor, under another's they do not.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.frame import Frame
from edvo.keyframes import Keyframe
from edvo.matching import Criterion
from edvo.places import is_apart
from edvo.planes import PlaneFitter, PlaneMap, camera_of, chosen
from edvo.registration import Alignment
from edvo.seen import Seen

YOUNG_S = 0.09  # in less hardly anything has moved by more than its noise
APART_S, AGES_S = 0.1, (0.15, 0.3, 0.6, 1.0)  # of the images that are kept, and that are asked
OLDEST_S = AGES_S[-1] + APART_S
FITS, BEHIND_M = 2.5, 0.25  # times the noise; and what is so far behind may have been hidden
REACH, SLACK_M, SLACK_SIGMA = 2, 0.01, 2.0  # of the neighbours that speak for a place, in cells
ROUNDS = 2  # of telling what stands still, and registering it
MIN_SAMPLES = 60  # that stand still: fewer are no background
MIN_WORTH = 0.05  # of what hangs on edges without depth alone: they fit wherever they are led
SAME_M, SAME_RAD = 0.02, math.radians(0.4)  # nearer to each other, poses are the same
DRIFT_M, DRIFT_M_S, DRIFT_S = 0.05, 0.5, 0.3  # how far from where it was going, so long after
REACHED = 99.5  # percent of the depths: as far as the sensor reaches
MIN_BARE = 0.25  # of the view without depth, for it to be far: less may be dark hair
BARE_PX, BARE_STEP = 8, 4  # around a far edge, every such pixel has no depth
FAR_POOL, FAR_EDGES, MIN_FAR = 4000, 400, 100  # looked at, taken at most, and at least
FAR_LEFT = 6  # one in so many is left in the end: their depths are guesses
FAR_LOSS = 0.9  # of their fit, that leaving them out may cost
FAR_POWER = 3  # of their fit: it tells more than that of what has depth
FAR_FITS_PX, FAR_NEAR_PX, FAR_ANGLE_DEG = 1.0, 2.0, 45.0
NEARNESS = np.array([0.0, 0.25, 0.5, 0.7, 0.85, 1.0])  # inverse depths, of that of the reach
BLOCKS, SPREAD = 4, 1  # to the width of the image, each about as far as all, by so many of these
AS_GOOD = 0.9  # of the best fit

# Registers a frame with the keyframe of the course, from a T_key_cur, shape (4, 4)
Align: TypeAlias = Callable[[Seen, NDArray[np.float64]], Alignment]


@dataclass(frozen=True, slots=True)
class Still:
    """What was found to stand still, registered.

    Attributes
    ----------
    seen : Seen
        The frame, with the samples and points that stand still alone.
    alignment : Alignment
    worth : float
        To compare with what other starts lead to.
    is_far : bool
        Whether hardly anything but edges without depth stands still.
    """

    seen: Seen
    alignment: Alignment
    worth: float
    is_far: bool

    @property
    def found(self) -> tuple[Seen, Alignment]:
        """What stands still, and where."""
        return self.seen, self.alignment


@dataclass(slots=True)
class _Past:
    """A depth image of the last second, and its planes once they are asked for."""

    timestamp: float
    T_world_cam: NDArray[np.float64]
    depth: NDArray[np.float32]
    planes: PlaneMap | None = None


@dataclass(frozen=True, slots=True)
class _Far:
    """Edges of unknown depth."""

    edges: EdgePixels
    rays: NDArray[np.float64]
    block: NDArray[np.intp]
    inverse_depths: NDArray[np.float64]
    bare: float  # share of the view


@dataclass(frozen=True, slots=True)
class _View:
    """A frame, what it is held against, and how what is left of it is registered.

    That is a keyframe, other images (pose, planes), and far edges.
    """

    key: Keyframe
    seen: Seen
    asked: Sequence[tuple[NDArray[np.float64], PlaneMap]]
    far: _Far | None
    align: Align

    def registered(self, kept: Seen, T_key_start: NDArray[np.float64]) -> Alignment | None:
        """Register what is left of the frame, if that is enough."""
        return self.align(kept, T_key_start) if len(kept.samples) >= MIN_SAMPLES else None


class Background:
    """Registers with a keyframe what stands still of a frame.

    Parameters
    ----------
    camera : Camera
    fitter : PlaneFitter
    """

    def __init__(self, camera: Camera, fitter: PlaneFitter) -> None:
        self._camera, self._fitter = camera, fitter
        self._pinhole = camera_of(camera)
        self._criterion = Criterion(0.0, camera.width, FAR_NEAR_PX, FAR_ANGLE_DEG).compile()
        self._past: deque[_Past] = deque()

    def forget(self, since: float = -np.inf) -> None:
        """Forget what was seen since then: its poses are not to be trusted.

        Parameters
        ----------
        since : float, optional
            Seconds; all where not given.
        """
        while self._past and self._past[-1].timestamp >= since:
            self._past.pop()

    def remember(self, frame: Frame, T_world_cam: NDArray[np.float64]) -> None:
        """Take a depth image to hold later ones against; not all of them are kept.

        Parameters
        ----------
        frame : Frame
        T_world_cam : ndarray of float64, shape (4, 4)
            Where its depth was taken.
        """
        timestamp = frame.timestamp
        if self._past and timestamp < self._past[-1].timestamp - OLDEST_S:
            self._past.clear()  # the clock has started over
        if self._past and timestamp - self._past[-1].timestamp < APART_S:
            return
        while self._past and timestamp - self._past[0].timestamp > OLDEST_S:
            self._past.popleft()
        self._past.append(_Past(timestamp, T_world_cam, frame.kept().depth))

    def reaches(self, timestamp: float) -> bool:
        """Whether an image is kept from before a time.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return len(self._past) > 0 and self._past[0].timestamp < timestamp

    def last_pose(self) -> NDArray[np.float64] | None:
        """Give the pose of the last image kept.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            T_world_cam.
        """
        return self._past[-1].T_world_cam if self._past else None

    def register(
        self,
        key: Keyframe,
        seen: Seen,
        starts: Sequence[NDArray[np.float64]],
        velocity: NDArray[np.float64],
        align: Align,
    ) -> Still | None:
        """Register what stands still of a frame.

        Parameters
        ----------
        key : Keyframe
        seen : Seen
        starts : sequence of ndarray of float64, shape (4, 4)
            Guesses of T_key_cur; what each leads to is compared.
        velocity : ndarray of float64, shape (6,)
            That the camera may be expected to keep, in its own frame, 1/s.
        align : callable
            Registers a `Seen`, of which only what stands still is left, with that keyframe, from a
            guess of T_key_cur (4, 4).

        Returns
        -------
        Still or None
            None where hardly anything stands still, or edges without depth alone, far from where
            the camera was bound for.
        """
        asked = self._asked(key, seen.frame.timestamp)
        if not asked:
            return None
        view = _View(key, seen, asked, self._far(seen), align)
        near = [self._approach(view, start) for start in _distinct(starts)]
        places = _distinct([T for T in near if T is not None])
        expected, reach = self._expected(key, seen.frame.timestamp, velocity)
        found = []
        for place in places:
            still = self._settle(view, place)
            if still is not None:
                T_world_cam = key.T_world_key @ still.alignment.T_ref_cur
                away = se3.distance(T_world_cam, expected) / reach
                found.append(replace(still, worth=still.worth * math.exp(-(away**2) / 2)))
        best = max(found, key=lambda still: still.worth, default=None)
        return None if best is None or (best.is_far and best.worth < MIN_WORTH) else best

    def _expected(
        self, key: Keyframe, timestamp: float, velocity: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Where the camera may be expected, T_world_cam, and to how many metres."""
        old = [past for past in self._past if timestamp - past.timestamp >= DRIFT_S]
        time, T_world_then = key.timestamp, key.T_world_key
        if old:
            time, T_world_then = old[-1].timestamp, old[-1].T_world_cam
        elif self._past and self._past[0].timestamp > time:
            time, T_world_then = self._past[0].timestamp, self._past[0].T_world_cam
        age = min(max(timestamp - time, 0.0), AGES_S[-1])
        return T_world_then @ se3.exp(velocity * age), DRIFT_M + DRIFT_M_S * age

    def _approach(
        self, view: "_View", T_key_cur: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Come near by what is far, which stands still for sure, and by depth that seems to."""
        kept = self._standing(view, T_key_cur)
        if view.far:
            kept = replace(kept, samples=self._placed(view, T_key_cur)[0])
        alignment = view.registered(kept, T_key_cur)
        return None if alignment is None else alignment.T_ref_cur

    def _settle(self, view: "_View", T_key_cur: NDArray[np.float64]) -> Still | None:
        """Take turns: tell what stands still at a pose, and register it."""
        kept, alignment, share, is_far = view.seen, None, 1.0, False
        for _ in range(ROUNDS):
            kept = self._standing(view, T_key_cur)
            if view.far:
                placed, _ = self._placed(view, T_key_cur)
                kept = replace(kept, samples=kept.samples.joined(placed))
            alignment = view.registered(kept, T_key_cur)
            if alignment is None:
                return None
            T_key_cur = alignment.T_ref_cur
        if view.far:
            placed, share = self._placed(view, T_key_cur)
            near = self._standing(view, T_key_cur)
            is_far = len(near.samples) < MIN_SAMPLES
            near = replace(near, samples=near.samples.joined(placed.every(FAR_LEFT)))
            again = None if is_far else view.registered(near, T_key_cur)
            if again is not None:
                share_near = self._placed(view, again.T_ref_cur)[1]
                if share_near > FAR_LOSS * share:
                    kept, alignment, share = near, again, share_near
        assert alignment is not None
        bare = view.far.bare if view.far else 0.0
        lying = alignment.plane_points / max(len(view.seen.points.sigma), 1)
        fitting = alignment.agreeing / len(kept.samples)
        worth = bare * share**FAR_POWER + (1 - bare) * lying * fitting
        return Still(kept, alignment, worth, is_far)

    def _asked(self, key: Keyframe, timestamp: float) -> list[tuple[NDArray[np.float64], PlaneMap]]:
        """Images to be held against: the keyframe and some of the last second; poses, planes."""
        chosen: list[_Past] = []
        recent = [past for past in self._past if timestamp - past.timestamp <= OLDEST_S]
        for age in AGES_S:
            old = [past for past in recent if timestamp - past.timestamp >= age - APART_S / 2]
            if old and all(old[-1] is not past for past in chosen):
                chosen.append(old[-1])
        if len(chosen) > 2:
            del chosen[0]  # the longer ago, the more has moved
        asked = []
        if timestamp - key.timestamp >= YOUNG_S:
            asked.append((key.T_world_key, key.planes))
        for past in chosen:
            if past.planes is None:
                past.planes = self._fitter.planes(past.depth)
            asked.append((past.T_world_cam, past.planes))
        return asked

    def _standing(self, view: "_View", T_key_cur: NDArray[np.float64]) -> Seen:
        """Leave of a frame what stands still, if it was taken from there."""
        seen, term = view.seen, self._fitter.term
        points, samples, T_world_cam = seen.points, seen.samples, view.key.T_world_key @ T_key_cur
        held, broken = np.zeros((2, len(points.sigma)), np.int32)
        for T_world_then, planes in view.asked:
            T = se3.inverse(T_world_then) @ T_world_cam
            kernels.weigh_points(
                points, planes, self._pinhole, T, FITS, term.min_dot, BEHIND_M, held, broken
            )
        still = []
        for X in (points.X, samples.points(self._camera)):
            still.append(np.empty(len(X), np.bool_))
            kernels.ask_neighbours(
                points,
                held,
                broken,
                self._pinhole,
                points.step_px,
                REACH,
                SLACK_M,
                SLACK_SIGMA,
                X,
                still[-1],
            )
        good = np.flatnonzero(still[0] & (held > 0) & (held >= broken))
        which = np.flatnonzero(still[1])
        return replace(
            seen,
            samples=samples.where(which),
            points=chosen(points, good),
        )

    def _far(self, seen: Seen) -> _Far | None:
        """Choose edges with no depth around."""
        edges, depth, camera = seen.edges, seen.frame.depth, self._camera
        coarse = np.ascontiguousarray(depth[::BARE_STEP, ::BARE_STEP])
        bare = 1 - np.count_nonzero(coarse) / coarse.size
        if bare < MIN_BARE:
            return None
        stride = max(len(edges) // FAR_POOL, 1)
        which = np.empty(len(edges) // stride + 1, np.int32)
        count = kernels.edges_without_depth(edges.index, depth, stride, BARE_PX, BARE_STEP, which)
        if count < MIN_FAR:
            return None
        which = which[:count]
        if count > FAR_EDGES:
            which = which[np.linspace(0, count - 1, FAR_EDGES).astype(np.intp)]
        far = edges.describe(camera, which)
        rays = replace(far, depths=np.ones(len(far), np.float32)).points(camera)
        side = camera.width / BLOCKS
        column = np.clip(far.pixels[:, 0] // side, 0, BLOCKS - 1).astype(np.intp)
        row = np.clip(far.pixels[:, 1] // side, 0, None).astype(np.intp)
        there = coarse[coarse > 0]  # but for stray ones
        reach = max(float(np.percentile(there, REACHED)) if there.size else 0.0, 1.0)
        return _Far(far, rays, row * BLOCKS + column, NEARNESS / reach, bare)

    def _placed(self, view: "_View", T_key_cur: NDArray[np.float64]) -> tuple[EdgePixels, float]:
        """Put far edges, block by block, where most of them fit; and the share that does."""
        far = view.far
        assert far is not None
        fits = np.empty((len(far.inverse_depths), len(far.edges)))
        kernels.fit_rays(
            view.key.edges_for(near=view.seen.is_near).grid,
            far.rays,
            far.edges.gradients,
            self._pinhole,
            T_key_cur,
            self._criterion,
            far.inverse_depths,
            FAR_FITS_PX,
            fits,
        )
        blocks = int(far.block.max()) + 1
        count = np.array([np.bincount(far.block, weights=fit, minlength=blocks) for fit in fits])
        usual = int(count.sum(axis=1).argmax())
        count[: max(usual - SPREAD, 0)] = 0
        count[usual + SPREAD + 1 :] = 0
        most = count.max(axis=0)
        weight = np.maximum(count - AS_GOOD * most, 0) + 1e-9
        nearness = (weight * far.inverse_depths[:, None]).sum(axis=0) / weight.sum(axis=0)
        depths = 1 / np.maximum(nearness, 1e-3)
        placed = replace(far.edges, depths=depths[far.block].astype(np.float32))
        return placed, float(most.sum()) / len(far.edges)


def _distinct(poses: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Leave of poses that are all but the same the first."""
    kept: list[NDArray[np.float64]] = []
    for T in poses:
        if is_apart(T, kept, SAME_M, SAME_RAD):
            kept.append(T)
    return kept
