"""Locating a frame: registering it with the keyframe, and looking farther afield if in doubt."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.apart import LEAD_APART, Apart
from edvo.aside import Aside
from edvo.assessing import Assessor
from edvo.course import Course
from edvo.doubt import STEPPED, Doubt
from edvo.hunting import STRIDE
from edvo.keyframes import Keyframe
from edvo.kit import Kit
from edvo.mending import Mender
from edvo.planes import DepthTerm, thinned
from edvo.registrar import Registrar
from edvo.registration import FAILURES, Alignment
from edvo.scatter import SURE, clarity, is_clearer, is_sharper
from edvo.seen import Seen
from edvo.status import Status, agreement

FAR_STEP = "a far step: of what both see enough fits, and nothing else does"
NOT_ALONE = "a far step, and beside where it led the edges fit as well"


class Aligned(NamedTuple):
    """A registration that may serve again.

    Attributes
    ----------
    seen : Seen
        The frame.
    key : Keyframe
        That it was registered with.
    starts : ndarray of float64, shape (N, 4, 4)
        Poses relative to the keyframe that it began with.
    found : Alignment
    """

    seen: Seen
    key: Keyframe
    starts: NDArray[np.float64]
    found: Alignment


class Locator:
    """Says where a frame was taken, as against the keyframe.

    Parameters
    ----------
    kit : Kit
    course : Course
    doubt : Doubt
        Told of far steps.

    Attributes
    ----------
    registrar : Registrar
        By which it registers.
    assessor : Assessor
        Of what is found.
    mender : Mender
        Of what is found where edges lie nowhere.
    """

    def __init__(self, kit: Kit, course: Course, doubt: Doubt) -> None:
        self._config, self._clock = kit.config, kit.clock
        self._depth_alone, self._search, self._judge = kit.depth_alone, kit.search, kit.judge
        self._instants, self._evidence = kit.instants, kit.uncertainty.evidence
        self._asks_scatter = kit.config.status.edge_jump > 0
        self._aligned: Aligned | None = None
        self._course, self._doubt = course, doubt
        self.registrar = registrar = Registrar(kit, course)
        self._aside = Aside(kit, registrar)
        self._apart = Apart(kit, course, doubt, registrar)
        self.assessor = Assessor(kit, course, doubt)
        self.mender = Mender(kit, course, doubt, registrar, self.assessor)

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
            term = self.registrar.term(timestamp)
            alignment = None if far else self._known(seen, starts)
            if alignment is None:
                alignment = self.registrar.register(seen, starts, term, far=far)
        apart = alignment if far else self._apart.look(seen, starts[0], term, alignment)
        if apart is not alignment and not self.assessor.is_impossible(apart, timestamp):
            return apart, Status.DEGRADED, LEAD_APART  # however few agree: most are on what moves
        is_off = self._is_off_planes if far else self._judge.may_be_off
        is_lost, led = self.assessor.is_lost, None
        if is_off(alignment):
            with self._clock("search"):
                again = self._on_planes(seen, term, alignment, far=far)
            if far or not is_lost(again, timestamp) or is_lost(alignment, timestamp):
                alignment = again
        elif not far and self._judge.torn.outvotes_depth(alignment, self._smeared_px()):
            with self._clock("search"):
                led = self._by_outvoted_depth(seen, starts[0], term, alignment)
            if led is not None:
                alignment = led
        first, (status, reason) = alignment, self.assessor.assess(alignment, timestamp)
        is_wide = not far and self._judge.scatter.is_wide(alignment)
        if is_wide:
            self._judge.scatter.widen()
        if is_wide or (status is Status.LOST and not far and self._asks_depth(seen)):
            with self._clock("search"):
                alignment = self._kept(led, self._sharpest(seen, starts, term, alignment))
                first = alignment = self._kept(led, self._once_more(seen, term, first, alignment))
                status, reason = self.assessor.assess(alignment, timestamp)
        if not self._config.motion.search_deg:
            return alignment, status, reason
        unsure = status is not Status.TRACKED or self._judge.scatter.fits_less(alignment)
        unsure = unsure or self._leaves_out(seen, alignment)
        aside = unsure or (self._aside.is_on and self._judge.agrees_less(alignment))
        new = not self._judge.scatter.is_known
        if not far and not aside and not new and self.mender.amiss(seen, alignment) is None:
            return alignment, status, reason
        with self._clock("search"):
            narrow = not far and self.registrar.begins_narrow
            if narrow and (unsure or (new and self._promises(seen, starts, term, alignment))):
                alignment = self._kept(led, self._widely(seen, starts, term, alignment))
                status, reason = self.assessor.assess(alignment, timestamp)
            if status is not Status.TRACKED or new:
                other = self._search.around(key, course.T_key_last, seen, alignment)
                alignment = self._kept(led, self.assessor.better(alignment, other, timestamp))
                status, reason = self.assessor.assess(alignment, timestamp)
            if not far and aside:
                beside = self._aside.look(seen, starts[0], term, alignment)
                alignment = self._kept(led, self.assessor.better(alignment, beside, timestamp))
            if not far:
                alignment = self._kept(led, self._once_more(seen, term, first, alignment))
                status, reason = self.assessor.assess(alignment, timestamp)
            if not far and status is not Status.LOST:
                alignment = self.mender.mend(seen, alignment)
                alignment = self.mender.weighed(seen, alignment)
                status, reason = self.assessor.assess(alignment, timestamp)
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
        alignment = self.align(seen)
        return alignment, *self.assessor.assess(alignment, seen.frame.timestamp)

    def align(self, seen: Seen) -> Alignment:
        """Register a frame with the keyframe, and remember that for `locate`.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        Alignment
            With which `locate` begins, if nothing has changed by then.
        """
        starts, term = self.starts(seen), self.registrar.term(seen.frame.timestamp)
        alignment = self.registrar.register(seen, starts, term)
        self._aligned = Aligned(seen, self._course.key, starts, alignment)
        return alignment

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
        if self._config.motion.prior == "constant-velocity" and course.velocity.any():
            starts.insert(0, still @ course.ahead(timestamp))
        if course.losses:
            starts.append(np.eye(4))  # the camera may have come back to where the keyframe was
        if self._config.motion.search_deg and course.is_far_step(timestamp):
            starts = self._search.likeliest(course.key, still, seen, starts)
        return np.array(starts)

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
        T_last_cur = kernels.inverted(self.mender.last_pose(alignment)) @ alignment.T_ref_cur
        period = course.period(timestamp)
        return self._instants.settled(seen, T_last_cur, period, alignment)

    def _smeared_px(self) -> float:
        """Over how many pixels edges are smeared where it goes on as it went."""
        return self._instants.exposure.smeared_px(self._course.velocity)

    def _known(self, seen: Seen, starts: NDArray[np.float64]) -> Alignment | None:
        """What `align` has found of that frame, from the same starts."""
        last, self._aligned = self._aligned, None
        if last is None or last.seen is not seen or last.key is not self._course.key:
            return None
        return last.found if np.array_equal(last.starts, starts) else None

    def _leaves_out(self, seen: Seen, alignment: Alignment) -> bool:
        """Whether a motion that edges could tell is one that hardly any of them does."""
        if not self.registrar.begins_narrow:  # then there is no wider scale to begin with
            return False
        return len(self._evidence.untold(self.registrar.edges(seen), seen.samples, alignment)) > 0

    def _asks_depth(self, seen: Seen) -> bool:
        """Whether there is depth, to register by a second time."""
        return self._asks_scatter and len(seen.points.sigma) > 0

    def _widely(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register from the same starts so that edges count which are pixels off; take the better.

        Where most edges run along a motion they fit from the start, wherever along it that is, and
        the few across it, being off by more than these scatter, count as wrong matches.
        """
        wide = self.registrar.widely(seen, starts, term)
        return self.assessor.better(found, wide, seen.frame.timestamp)

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
        wide = self.registrar.widely(few, starts, term)
        return wide.reason in FAILURES or is_sharper(wide, found, STRIDE)

    def _once_more(
        self, seen: Seen, term: DepthTerm, first: Alignment, found: Alignment
    ) -> Alignment:
        """Register by all that counts from where few samples, or another scale, have led.

        Kept where that is clearly sharper, or beyond doubt where the other is not.
        """
        if found is first or not len(seen.points.sigma):
            return found
        again = self.registrar.register(seen, found.T_ref_cur[None], term)
        timestamp = seen.frame.timestamp
        if self.assessor.better(found, again, timestamp) is found:
            return found
        # depth that is late fits a knocked frame worse in its right place
        is_tracked = self.assessor.assess(again, timestamp)[0] is Status.TRACKED
        return again if is_tracked or is_sharper(again, found) else found

    def _sharpest(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register with the usual scale, if it is known, and take what crowds edges most clearly.

        Where light makes edges come and go at once, half of them belong to no edge of the
        keyframe: a scale that is taken from all of them lets them count. Depth knows no light, nor
        does it take one step of a stair for the next, so that one more start is where it leads from
        the first. Few samples tell the best start. Where nearly all edges fit what was found, it
        is not lost, and they are sharper from there, no other is tried.
        """
        key, scatter, assessor = self._course.key, self._judge.scatter, self.assessor
        timestamp = seen.frame.timestamp

        def align(part: Seen, start: NDArray[np.float64]) -> Alignment:
            return self.registrar.register(part, start[None], term, scatter.sharp_px)

        usual = thinned(seen.points, self._config.planes.point_step_px)
        few = replace(seen, samples=seen.samples.every(STRIDE), points=usual)
        here = best = align(few, found.T_ref_cur)
        thinning = len(seen.points.sigma) / max(len(usual.sigma), 1)
        unsure = found.inliers < SURE * len(found.matches) or assessor.is_lost(found, timestamp)
        if unsure or not is_sharper(here, found, STRIDE, thinning):
            by_depth = self._depth_alone.align(key, seen.samples, seen.points, starts[0])
            begun = [align(few, T) for T in starts]
            best = max((*begun, here, align(few, by_depth.T_ref_cur)), key=clarity)
        best = align(seen, best.T_ref_cur)
        if is_sharper(best, found):
            return best
        # how depth fits where no camera can be is no measure
        is_free = assessor.is_impossible(found, timestamp) and not assessor.is_lost(best, timestamp)
        fits = is_clearer(best, found) and not self._judge.may_be_off(best)
        return best if is_free and fits else found

    def _by_outvoted_depth(
        self, seen: Seen, start: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment | None:
        """Register from where all of depth leads, if that leaves no motion open and more fits it.

        None where it does not, or the frame would be lost.
        """
        parts, begun = (self._course.key, seen.samples, seen.points), (found.T_ref_cur, start)
        level = self._depth_alone.lead(*parts, begun)
        if level is None:
            return None
        sharp_px = self._judge.scatter.sharp_px
        again = self.registrar.register(seen, level.T_ref_cur[None], term, sharp_px)
        lost = self.assessor.is_lost(again, seen.frame.timestamp)
        return again if not lost and self._judge.torn.fits_more_depth(again, found) else None

    def _kept(self, led: Alignment | None, other: Alignment) -> Alignment:
        """What depth has led to, if any, unless as much of depth fits what is clearer."""
        if led is None or not self._judge.torn.fits_more_depth(led, other):
            return other
        return led

    def _is_off_planes(self, found: Alignment) -> bool:
        """Whether depth contradicts where edges lead, and edges are not all but sure of it."""
        unsure = found.inliers < SURE * len(found.matches)
        return unsure and found.sigma_depth > self._config.status.max_depth_sigma

    def _on_planes(self, seen: Seen, term: DepthTerm, found: Alignment, *, far: bool) -> Alignment:
        """Register from where depth alone leads, and take what edges and depth agree on best.

        A turn and a way to the side move edges all but alike; of the planes a turn tilts each.
        """
        key, points = self._course.key, seen.points
        level = self._depth_alone.align(key, seen.samples, points, found.T_ref_cur)
        again = self.registrar.register(seen, level.T_ref_cur[None], term, far=far)
        return max((found, again), key=lambda each: agreement(each, key.planes, points))
