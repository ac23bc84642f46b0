"""Locating a frame: registering it with the keyframe, and looking farther afield if in doubt."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.course import FASTEST_M_S, LONGEST_PREDICTION_S, Course
from edvo.doubt import STEPPED, Doubt
from edvo.edges import EdgePixels
from edvo.evidence import Amiss
from edvo.hunting import STRIDE
from edvo.kit import Kit
from edvo.planes import DepthTerm, thinned
from edvo.registration import AT_ONCE, FAILURES, Alignment
from edvo.scatter import clarity, is_clearer, is_sharper
from edvo.seen import Seen
from edvo.status import SURE, Status, agreement, speed_of
from edvo.uncertainty import degenerate_directions

FAR_STEP = "a far step: of what both see enough fits, and nothing else does"
NOT_ALONE = "a far step, and beside where it led the edges fit as well"
WIDE_PX = 2.0  # scale of a second look: of a turn that was not foreseen by so much
LEAP_M_S2 = 30.0  # what pushes a camera harder is a wrong match, more often than not
NEWS_M, NEWS_SIGMAS = 0.005, 5.0  # that a camera has drifted by, at least
LEAPT = "farther from where it was expected than a hand moves a camera"


class PutRight(NamedTuple):
    """A frame that was found far from where it was expected, where edges lie nowhere.

    Attributes
    ----------
    alignment : Alignment
    off : float
        How far from where it was expected it was looked for, m.
    T_key_last : ndarray of float64, shape (4, 4)
        Where the camera must have been at the last frame, if as far off.
    velocity : ndarray of float64, shape (6,)
        Of the camera, in its own frame, 1/s: that of late, not what the last pose says.
    """

    alignment: Alignment
    off: float
    T_key_last: NDArray[np.float64]
    velocity: NDArray[np.float64]


class Locator:
    """Says where a frame was taken, as against the keyframe.

    Parameters
    ----------
    kit : Kit
    course : Course
    doubt : Doubt
        Told of far steps.
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt) -> None:
        self._config, self._clock = kit.config, kit.clock
        self._registration, self._fitter = kit.registration, kit.fitter
        self._depth_alone, self._search, self._judge = kit.depth_alone, kit.search, kit.judge
        self._shared, self._instants = kit.shared, kit.instants
        self._uncertainty, self._evidence = kit.uncertainty, kit.uncertainty.evidence
        two_stages = kit.config.matching.criterion == "robust-then-normal"
        self._begins_narrow = two_stages and kit.config.registration.first_sigma_px < WIDE_PX
        self._asks_scatter = kit.config.status.edge_jump > 0
        self._course, self._doubt = course, doubt
        self._put_right: PutRight | None = None

    def locate(self, seen: Seen) -> tuple[Alignment, Status, str]:
        """Register a frame with the keyframe, and look farther afield where that is in doubt.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        (Alignment, Status, str)
            How far it is to be trusted, and why not further.
        """
        course, key, timestamp = self._course, self._course.key, seen.frame.timestamp
        far = course.is_far_step(timestamp)
        with self._clock("registration"):
            starts = self.starts(seen)
            term = self._term(timestamp)
            alignment = self._register(seen, starts, term, far=far)
        is_off = self._is_off_planes if far else self._judge.may_be_off
        if is_off(alignment):
            with self._clock("search"):
                again = self._on_planes(seen, term, alignment, far=far)
            if far or not self._is_lost(again, timestamp) or self._is_lost(alignment, timestamp):
                alignment = again
        status, reason = self.assess(alignment, timestamp)
        is_wide = not far and self._judge.scatter.is_wide(alignment)
        if is_wide:
            self._judge.scatter.widen()
        if is_wide or (status is Status.LOST and not far and self._asks_depth(seen)):
            with self._clock("search"):
                alignment = self._sharpest(seen, starts, term, alignment)
                status, reason = self.assess(alignment, timestamp)
        if not self._config.motion.search_deg:
            return alignment, status, reason
        unsure = status is not Status.TRACKED or self._judge.scatter.fits_less(alignment)
        unsure = unsure or self._leaves_out(seen, alignment)
        new = not self._judge.scatter.is_known
        if not far and not unsure and not new and self._amiss(seen, alignment) is None:
            return alignment, status, reason
        with self._clock("search"):
            narrow = not far and self._begins_narrow
            if narrow and (unsure or (new and self._promises(seen, starts, term, alignment))):
                alignment = self._widely(seen, starts, term, alignment)
                status, reason = self.assess(alignment, timestamp)
            if status is not Status.TRACKED or new:
                other = self._search.around(key, course.T_key_last, seen, alignment)
                alignment = self._better(alignment, other, timestamp)
                status, reason = self.assess(alignment, timestamp)
            if not far and status is not Status.LOST:
                alignment = self._along(seen, term, alignment)
                status, reason = self.assess(alignment, timestamp)
            if not far or status is Status.DEGRADED:
                return alignment, status, reason
            if status is Status.TRACKED:
                if self._search.is_alone(key, alignment.T_ref_cur, seen):
                    return alignment, status, reason
                found, reason = alignment, NOT_ALONE
            else:
                gap = course.period(timestamp)
                farther = self._search.farther(key, course.T_key_last, seen, gap)
                if farther is None:
                    return alignment, status, reason
                found, reason = farther, FAR_STEP
        self._doubt.cast(timestamp, STEPPED)
        return found, Status.DEGRADED, reason

    def register(self, seen: Seen) -> tuple[Alignment, Status, str]:
        """Register a frame with the keyframe, and look no farther.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        (Alignment, Status, str)
            See `locate`.
        """
        timestamp = seen.frame.timestamp
        alignment = self._register(seen, self.starts(seen), self._term(timestamp))
        return alignment, *self.assess(alignment, timestamp)

    def find_again(
        self, seen: Seen, T_key_cur: NDArray[np.float64], T_last_cur: NDArray[np.float64]
    ) -> tuple[Alignment, float] | None:
        """Register a frame with a keyframe that it was left from, no matter how far by now.

        The last pose of the course is put where it must have been then, if it is found or not.

        Parameters
        ----------
        seen : Seen
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it seems to be.
        T_last_cur : ndarray of float64, shape (4, 4)
            How the camera seems to have moved since the last frame.

        Returns
        -------
        (Alignment, float) or None
            And how far from there it seemed to be, m. None unless each motion is told, nothing is
            in doubt, and that is far more than it may be off there.
        """
        course, term = self._course, self._term(seen.frame.timestamp)
        T_cur_last = se3.inverse(T_last_cur)
        course.leap(T_key_cur @ T_cur_last)  # by which depth and rows are moved
        found = self._register_widely(seen, T_key_cur[None], term)
        start = self._start_along(seen, found)
        start = found.T_ref_cur if start is None else start
        course.leap(start @ T_cur_last)
        found = self._register_widely(seen, start[None], term)
        course.leap(found.T_ref_cur @ T_cur_last)
        sound = self._judge.judge(found, 0.0, 0.0)[0] is Status.TRACKED
        sound = sound and self._judge.scatter.has_usual_depth(found)
        asked = self._edges(seen), seen.samples, found
        sound = sound and self._evidence.amiss(*asked) is None
        sound = sound and len(self._evidence.untold(*asked)) == 0
        off = se3.distance(found.T_ref_cur, T_key_cur)
        is_news = sound and off > NEWS_M and self._is_news(seen, term, found, T_key_cur)
        return (found, off) if is_news else None

    def _is_news(
        self, seen: Seen, term: DepthTerm, found: Alignment, T_key_cur: NDArray[np.float64]
    ) -> bool:
        """Whether the keyframe tells each motion, and that the frame is not where it seemed."""
        key = self._course.key
        covariance = self._uncertainty.covariance(
            key.edges, seen.samples, key.planes, seen.points, term, found
        )
        if len(degenerate_directions(covariance)):
            return False
        off = se3.log(found.T_ref_cur @ se3.inverse(T_key_cur))
        return float(off @ np.linalg.solve(covariance, off)) > NEWS_SIGMAS**2

    def starts(self, seen: Seen) -> NDArray[np.float64]:
        """Poses to start from, relative to the keyframe.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        ndarray of float64, shape (N, 4, 4)
            The likeliest first.
        """
        course, timestamp = self._course, seen.frame.timestamp
        still = course.T_key_last
        starts = [still]
        if self._config.motion.prior == "constant-velocity":
            starts.insert(0, still @ course.ahead(timestamp))
        if course.losses:
            starts.append(np.eye(4))  # the camera may have come back to where the keyframe was
        if self._config.motion.search_deg and course.is_far_step(timestamp):
            starts = self._search.likeliest(course.key, still, seen, starts)
        return np.array(starts)

    def assess(self, alignment: Alignment, timestamp: float) -> tuple[Status, str]:
        """Judge a registration by its evidence, and by how far it is from the last pose.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        (Status, str)
            How far it is to be trusted, and why not further.
        """
        T_last_cur, period = self._course.moved(alignment.T_ref_cur, timestamp)
        follows = self._course.follows(timestamp)
        said = self._judge.judge(alignment, *speed_of(T_last_cur, period), follows=follows)
        # from a doubtful pose, as one that went along with people, it may well come back at once
        sure = self._doubt.is_sure and not self._doubt.lasts(timestamp)
        expected = self._asks_scatter and sure
        if said[0] is Status.LOST or not expected or not self.leaps(alignment, timestamp):
            return said
        return Status.LOST, LEAPT

    def settled(self, seen: Seen, alignment: Alignment) -> Seen:
        """Move depth and rows by what the camera has moved by, no longer by what was expected.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment
            Where it was found.

        Returns
        -------
        Seen
        """
        course, timestamp = self._course, seen.frame.timestamp
        if not course.follows(timestamp):
            return seen
        T_last_cur = se3.inverse(self.last_pose(alignment)) @ alignment.T_ref_cur
        return self._instants.settled(seen, T_last_cur, course.period(timestamp))

    def _lag(self, seen: Seen) -> kernels.Lag:
        """When depth and rows were taken, as shares of the time since the last frame."""
        course, timestamp = self._course, seen.frame.timestamp
        if not course.follows(timestamp):
            return AT_ONCE
        period = course.period(timestamp)
        return self._instants.lag(seen, course.key, course.T_key_last, period, course.velocity)

    def _better(self, found: Alignment, other: Alignment, timestamp: float) -> Alignment:
        """Of two that fit: what is not lost, else whose depth is not off, else the clearer.

        What is tracked is only left for what is tracked, too, and clearly sharper.
        """
        if other is found:
            return found
        if self.assess(found, timestamp)[0] is Status.TRACKED:
            is_tracked = self.assess(other, timestamp)[0] is Status.TRACKED
            return other if is_tracked and is_sharper(other, found) else found
        lost = [self._is_lost(each, timestamp) for each in (found, other)]
        off = [self._judge.is_off(each) for each in (found, other)]
        for fails, other_fails in (lost, off):
            if fails != other_fails:
                return other if fails else found
        return max(found, other, key=clarity)

    def _leaves_out(self, seen: Seen, alignment: Alignment) -> bool:
        """Whether a motion that edges could tell is one that hardly any of them does."""
        if not self._begins_narrow:  # then there is no wider scale to begin with
            return False
        return len(self._evidence.untold(self._edges(seen), seen.samples, alignment)) > 0

    def _edges(self, seen: Seen) -> EdgePixels:
        """Edges of the keyframe that a frame is registered with."""
        return self._course.key.edges_for(near=seen.is_near).edges

    def _amiss(self, seen: Seen, alignment: Alignment) -> Amiss | None:
        """Say along which motion most edges that could tell it are not in their places."""
        motion = self._config.motion
        if not motion.along_px or not motion.search_deg or not self._begins_narrow:
            return None  # nobody looks, or there is no wider scale to look by
        return self._evidence.amiss(self._edges(seen), seen.samples, alignment)

    def _along(self, seen: Seen, term: DepthTerm, found: Alignment) -> Alignment:
        """Look for such edges along such a motion, and register widely from where they fall."""
        start = self._start_along(seen, found)
        if start is None:
            return found
        course, timestamp = self._course, seen.frame.timestamp
        off = self._off(start, timestamp)
        if off <= self._limit(timestamp):
            return self._better(found, self._register_widely(seen, start[None], term), timestamp)
        before = course.whereabouts
        course.leap(start @ se3.inverse(found.T_ref_cur) @ course.T_key_last)
        along = self._register_widely(seen, start[None], term)
        fits = is_sharper(along, found) and self.assess(along, timestamp)[0] is Status.TRACKED
        T_key_last = course.T_key_last
        course.return_to(before)  # till the frame is accepted
        if not fits or self._amiss(seen, along) is not None:
            return found
        # where it has drifted, it was going as it went
        velocity = course.cruise if before.stood is None else course.velocity
        self._put_right = PutRight(along, off, T_key_last, velocity.copy())
        self._doubt.forget_since(timestamp - course.period(timestamp))
        return along

    def _start_along(self, seen: Seen, found: Alignment) -> NDArray[np.float64] | None:
        """Where along such a motion such edges fall clearly better, if there are any."""
        amiss = self._amiss(seen, found)
        if amiss is None:
            return None
        few = seen.samples.where(amiss.across)
        reach_px = self._config.motion.along_px
        return self._course.key.chamfer.along(few, found.T_ref_cur, amiss.twist, reach_px)

    def put_right(self, alignment: Alignment) -> PutRight | None:
        """Say how a frame was put right, if it was.

        Parameters
        ----------
        alignment : Alignment
            Of this frame.

        Returns
        -------
        PutRight or None
        """
        put_right = self._put_right
        return put_right if put_right is not None and put_right.alignment is alignment else None

    def last_pose(self, alignment: Alignment) -> NDArray[np.float64]:
        """Say where the camera was at the last frame, as this one tells if it was put right.

        Parameters
        ----------
        alignment : Alignment
            Of this frame.

        Returns
        -------
        ndarray of float64, shape (4, 4)
            T_key_last.
        """
        put_right = self.put_right(alignment)
        return self._course.T_key_last if put_right is None else put_right.T_key_last

    def leaps(self, alignment: Alignment, timestamp: float) -> bool:
        """Whether a registration is farther from where it was expected than a hand moves a camera.

        Parameters
        ----------
        alignment : Alignment
        timestamp : float
            Of the frame, seconds.

        Returns
        -------
        bool
            False where the last pose is older than a velocity lasts, so that nothing is expected,
            or where it fits better than the last one, and is where it was expected before that, or
            where it was put right.
        """
        off, limit = self._off(alignment.T_ref_cur, timestamp), self._limit(timestamp)
        if off <= limit or self.put_right(alignment) is not None:
            return False
        if not self._judge.fits_better(alignment):
            return True
        course = self._course
        T_expected = course.ahead_of_before(timestamp)  # the last one may have been astray
        T_world_cur = course.key.T_world_key @ alignment.T_ref_cur
        return T_expected is None or se3.distance(T_expected, T_world_cur) > limit

    def _off(self, T_key_cur: NDArray[np.float64], timestamp: float) -> float:
        """How far a pose is from where it was expected, m; 0 where it was nowhere."""
        course = self._course
        if course.period(timestamp) > LONGEST_PREDICTION_S:
            return 0.0
        T_expected = course.T_world_last @ course.ahead(timestamp)
        return se3.distance(T_expected, course.key.T_world_key @ T_key_cur)

    def _limit(self, timestamp: float) -> float:
        """How far from there a hand may move it, m."""
        period = self._course.period(timestamp)
        unknown = 0.0 if self._course.velocity.any() else FASTEST_M_S
        return (unknown + LEAP_M_S2 * period) * period

    def _asks_depth(self, seen: Seen) -> bool:
        """Whether there is depth, to register by a second time."""
        return self._asks_scatter and len(seen.points.sigma) > 0

    def _is_lost(self, alignment: Alignment, timestamp: float) -> bool:
        return self.assess(alignment, timestamp)[0] is Status.LOST

    def _register(
        self,
        seen: Seen,
        starts: NDArray[np.float64],
        term: DepthTerm,
        max_sigma_px: float = math.inf,
        *,
        far: bool = False,
        first_sigma_px: float = 0.0,
    ) -> Alignment:
        """Register with the keyframe; for the parameters see `Registration.align`.

        Depth that repeats lies where the camera is expected: that is one guess, however many points
        it has. How far off the planes it is says nothing of depth.
        """
        key = self._course.key
        if seen.is_stale:
            term = term._replace(weight=term.weight / max(len(seen.points.sigma), 1))
        found = self._registration.align(
            key.edges_for(near=seen.is_near),
            seen.samples,
            starts,
            key.planes,
            seen.points,
            term,
            self._lag(seen),
            max_sigma_px=max_sigma_px,
            far=far,
            first_sigma_px=first_sigma_px,
        )
        if not seen.is_stale:
            return found
        balance = found.depth_balance / found.sigma_depth**2
        return replace(found, sigma_depth=1.0, depth_balance=balance)

    def _widely(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register from the same starts so that edges count which are pixels off; take the better.

        Where most edges run along a motion they fit from the start, wherever along it that is, and
        the few across it, being off by more than these scatter, count as wrong matches.
        """
        wide = self._register_widely(seen, starts, term)
        return self._better(found, wide, seen.frame.timestamp)

    def _register_widely(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm
    ) -> Alignment:
        return self._register(seen, starts, term, first_sigma_px=WIDE_PX)

    def _term(self, timestamp: float) -> DepthTerm:
        """What depth counts."""
        return self._shared.term(self._fitter.term, self._course.period(timestamp))

    def _promises(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> bool:
        """Whether a few edges and points, registered widely, lie more clearly in their places.

        Or so few are there at all that a few of them say nothing.
        """
        if 0 < len(seen.points.sigma) < STRIDE * term.min_points:
            return True
        points = thinned(seen.points, math.sqrt(STRIDE) * seen.points.step_px)
        few = replace(seen, samples=seen.samples.every(STRIDE), points=points)
        wide = self._register_widely(few, starts, term)
        return wide.reason in FAILURES or is_sharper(wide, found, STRIDE)

    def _sharpest(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register with the usual scale, if it is known, and take what crowds edges most clearly.

        Where light makes edges come and go at once, half of them belong to no edge of the
        keyframe: a scale that is taken from all of them lets them count. Depth knows no light, nor
        does it take one step of a stair for the next, so that one more start is where it leads from
        the first. Few samples tell the best start.
        """
        key, scatter = self._course.key, self._judge.scatter

        def align(part: Seen, start: NDArray[np.float64]) -> Alignment:
            return self._register(part, start[None], term, scatter.sharp_px)

        by_depth, _ = self._depth_alone.align(key, seen.samples, seen.points, starts[0])
        usual = thinned(seen.points, self._config.planes.point_step_px)
        few = replace(seen, samples=seen.samples.every(STRIDE), points=usual)
        tried = [align(few, T) for T in (*starts, found.T_ref_cur, by_depth.T_ref_cur)]
        best = align(seen, max(tried, key=clarity).T_ref_cur)
        if is_sharper(best, found):
            return best
        timestamp = seen.frame.timestamp  # how depth fits where no camera can be is no measure
        is_free = self._is_impossible(found, timestamp) and not self._is_lost(best, timestamp)
        fits = is_clearer(best, found) and not self._judge.may_be_off(best)
        return best if is_free and fits else found

    def _is_impossible(self, found: Alignment, timestamp: float) -> bool:
        """Whether it leads where no camera can be, however well it fits."""
        T_last_cur, period = self._course.moved(found.T_ref_cur, timestamp)
        is_jump = bool(self._judge.jump(*speed_of(T_last_cur, period)))
        return is_jump or self.assess(found, timestamp)[1] == LEAPT

    def _is_off_planes(self, found: Alignment) -> bool:
        """Whether depth contradicts where edges lead, and edges are not all but sure of it."""
        unsure = found.inliers < SURE * len(found.matches)
        return unsure and found.sigma_depth > self._config.status.max_depth_sigma

    def _on_planes(self, seen: Seen, term: DepthTerm, found: Alignment, *, far: bool) -> Alignment:
        """Register from where depth alone leads, and take what edges and depth agree on best.

        A turn and a way to the side move edges all but alike; of the planes a turn tilts each.
        """
        key, points = self._course.key, seen.points
        level, _ = self._depth_alone.align(key, seen.samples, points, found.T_ref_cur)
        again = self._register(seen, level.T_ref_cur[None], term, far=far)
        return max((found, again), key=lambda each: agreement(each, key.planes, points))
