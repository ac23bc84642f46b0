"""The main loop: one frame in, one pose out (§III-§V)."""

import logging
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.anew import SETTLED_S, Chain
from edvo.background import YOUNG_S, Background, Still
from edvo.camera import Camera
from edvo.clock import Clock, StageClock, no_clock
from edvo.config import Config
from edvo.depth_alone import DepthAlone
from edvo.detail import Detail, usual_detail, worthwhile_detail
from edvo.errors import FrameError, TrajectoryError
from edvo.frame import Frame
from edvo.freeze import FREEZE_S, Freeze, glimpse
from edvo.front_end import FrontEnd, rigid
from edvo.gathering import gather, may_gather
from edvo.information import Information
from edvo.instants import Instants
from edvo.keyframes import Keyframe, KeyframeStore, is_due
from edvo.last_good import LastGood
from edvo.pieces import Pieces
from edvo.planes import DepthTerm, PlaneFitter, thinned
from edvo.registration import AT_ONCE, Alignment, Registration
from edvo.scatter import clarity, is_sharper
from edvo.search import STRIDE, Search, Seen, is_apart
from edvo.sharing import SharedErrors
from edvo.status import Judge, Status, agreement, speed_of
from edvo.tracked import TrackedFrame
from edvo.trajectory import Trajectory
from edvo.uncertainty import Uncertainty, degenerate_directions, describe, in_current_camera
from edvo.window import KeyframeWindow
from edvo.witness import Surface, Witness

__all__ = ["Odometry", "StageClock", "Status", "TrackedFrame"]

logger = logging.getLogger(__name__)

LONGEST_PREDICTION_S = 0.2  # beyond it a constant velocity says nothing about a hand
CRUISE_S = 0.5  # that the velocity is averaged over which a lost camera is expected to keep
LONGEST_GAP_S = 1.0  # for so long
LONG_SURE_S = 3.0  # after so long in doubt a pose that was sure tells nothing
SHORTEST_PERIOD_S = 1e-3  # closer stamps are no more than a clock's jitter
RECOVERY_PERIOD_S = 0.15  # then it is held against the stored keyframes no more often than that
# Lost for longer, by time and by frames, a frame may show any place that was seen before.
LONG_LOST_S, LONG_LOST_FRAMES = 0.3, 3
DOUBTFUL_S = 1.0  # after what raises doubt, a pose is no better than the way that led to it
MOVED, ASTRAY = "something moved less than a second ago", "found again, lost from a doubtful pose"
FAR_STEP = "a far step: of what both see enough fits, and nothing else does"
NOT_ALONE = "a far step, and beside where it led the edges fit as well"
STEPPED = "a far step less than a second ago"
SURE = 0.8  # of the samples in place: depth that contradicts a far step then leads nowhere else
# Motion alone does not change a view so much in so short a time: light does, or a hand that comes.
JUST_NOW_S = 0.1
CHANGED = "less than a second ago the view had changed at once"
NOWHERE = "lost; looks like no place seen before"
UNSURE = "after a stretch without edges they fit no place for sure"
ANEW = "begun anew where it was expected; what was seen before has not been seen since"
BACK_S = 1.0  # a clock that jumps back so far has begun anew
FADING_S = 0.5  # that a velocity lasts which nothing confirms, where depth alone goes on
# Where depth alone says where it is, what it errs by comes back with the velocity that moves the
# next depth, and grows if that was taken so much later than its image, over the time between two.
FED_BACK = 0.4
NOMINAL_PERIOD_S = 1 / 30  # stands in where stamps repeat, all but repeat, or go back


@dataclass(frozen=True, slots=True)
class _Due:
    """A frame that is to be the keyframe, or to add to it, once another frame is there."""

    seen: Seen  # its depth is kept
    index: int
    velocity: NDArray[np.float64] | None
    is_placed: bool = False  # by the window
    T_key_cur: NDArray[np.float64] | None = None  # where the keyframe stays, and gathers its edges


class Odometry:
    """Follows a camera by the edges of its images.

    An instance holds all of its state, so that several may run in several threads; one of them
    must not be used by two threads at once.

    Parameters
    ----------
    camera : Camera
        Of the frames to come.
    config : Config, optional
        The preset ``default`` where not given.
    clock : Clock, optional
        Told which stage runs; see ``edvo.clock.StageClock``.

    Examples
    --------
    >>> camera = Camera(width=640, height=480, fx=525, fy=525, cx=319.5, cy=239.5)
    >>> odometry = Odometry(camera)
    >>> len(odometry.trajectory)
    0
    """

    def __init__(
        self, camera: Camera, config: Config | None = None, *, clock: Clock | None = None
    ) -> None:
        self.camera = camera
        self.config = config or Config()
        self._clock = clock or no_clock
        if camera.is_distorted:
            camera.undistortion_table()  # a fifth of a second that the first frame need not wait
        self._registration = Registration(
            camera,
            self.config.matching,
            self.config.registration,
            inlier_px=self.config.status.inlier_px,
            start_stride=self.config.motion.prior_stride,
        )
        self._fitter = PlaneFitter(camera, self.config.planes)
        self._front_end = FrontEnd(
            camera, self.config, self._registration, self._fitter, self._clock
        )
        self._uncertainty = Uncertainty(camera, self.config, self._registration.solver)
        self._shared = SharedErrors(camera, self.config, self._registration.solver)
        self._instants = Instants(camera, self.config, self._registration, self._fitter)
        self._depth_alone = DepthAlone(camera, self.config, self._fitter.term, self._uncertainty)
        self._witness = Witness(camera, self.config.planes.sensor)
        self._background = Background(camera, self._registration, self._fitter)
        self._last_good = LastGood()
        self.reset()

    def reset(self, T_world_cam: NDArray[np.float64] | None = None) -> None:
        """Forget everything and start anew.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4), optional
            Pose of the next frame; the origin where not given.

        Raises
        ------
        TrajectoryError
            If it is no rigid motion.
        """
        start = np.eye(4) if T_world_cam is None else _checked(T_world_cam)
        self._keyframe: Keyframe | None = None
        self._due: _Due | None = None
        self._store = KeyframeStore(self.config.keyframes.stored)
        self._T_world_last = start  # of the last frame that was not lost
        self._T_key_last = np.eye(4)
        self._velocity = np.zeros(6)  # of the camera, in its own frame, 1/s
        self._cruise = np.zeros(6)  # the same of the last half second, where it was tracked
        self._last_time: float | None = None
        self._last_recovery = -math.inf
        self._losses = 0  # frames in a row
        self._blind = False  # whether depth alone gave the last pose
        # When and where it was last known where it is, if depth alone has let it drift since.
        self._anchor: tuple[float, NDArray[np.float64]] | None = None
        self._bare_depth = np.empty((0, 0), np.float32)  # of the last frame without edges
        self._freeze = Freeze()
        self._sight_found = False  # whether the last new image has got a pose
        self._is_fine = False  # whether its depth was looked at closely
        self._judge = Judge(self.config)
        self._window = KeyframeWindow(self.config, self._registration, self._uncertainty)
        self._information = Information()
        self._search = Search(
            self.camera, self.config, self._registration, self._fitter, self._judge
        )
        self._shared.forget()
        self._instants.forget()
        self._chain = Chain(
            self._registration,
            self._fitter,
            self._depth_alone,
            self._search,
            self._judge,
        )
        self._pieces = Pieces()
        self._moving_time = -math.inf  # when something was last seen to move by itself
        self._doubt_time, self._doubt = -math.inf, MOVED
        self._sure = True  # whether the last pose was tracked
        # When one was last, and by which keyframe where.
        self._last_sure: tuple[float, Keyframe, NDArray[np.float64]] | None = None
        self._forget_the_way()
        self._count = 0
        self._timestamps: list[float] = []
        self._poses: list[NDArray[np.float64]] = []

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames tracked so far, by time, without those that were lost.

        Of frames with the same stamp it holds the first. The path jumps where a piece begins, and
        where it is joined to another (see ``TrackedFrame.piece``): poses stay as they were given.
        """
        return Trajectory.from_frames(self._timestamps, self._poses)

    @property
    def depth_delay(self) -> float:
        """Delay of depth beyond what stamps tell, as measured so far, seconds."""
        return self._instants.depth.seconds

    @property
    def readout(self) -> float:
        """From the first row of an image to the last, as measured so far, seconds."""
        return self._instants.rolling.seconds

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of the next frame.

        Parameters
        ----------
        frame : Frame
            Of the size of the camera.

        Returns
        -------
        TrackedFrame
            ``LOST`` where the registration failed; the frame is then left out of the trajectory
            and the next one is registered with the same keyframe again. ``DEGRADED`` where it has
            hardly any edges and depth alone said where it is.

        Raises
        ------
        FrameError
            If the frame is not of the camera's size.
        """
        self._check_size(frame)
        self._make_due_keyframe()
        self._rewind(frame.timestamp)
        if self._freeze.repeats(frame):
            return self._hold(frame.timestamp)
        self._sight_found = False
        detail = self._detail(frame.timestamp)
        seen = self._front_end.see(frame, self._count, self._lead(frame), detail)
        self._is_fine = seen.is_fine
        least = self.config.registration.min_matches
        if len(seen.samples) < least:
            few = f"{len(seen.samples)} edges with depth; {least} needed"
            return self._give_up(seen, few, None)
        if self._keyframe is None:
            return self._begin(seen)
        adrift = self._is_adrift(frame.timestamp)
        if adrift or self._is_long_lost(frame.timestamp):
            with self._clock("recovery"):
                recovered = self._recover(seen)
            return recovered or self._give_up(seen, UNSURE if adrift else NOWHERE, None)
        alignment, status, reason, still = self._register(seen)
        if status is Status.LOST:
            found = None
            if self._pieces.here:  # it may be where it was before
                with self._clock("recovery"):
                    found = self._recover(seen)
            return found or self._give_up(seen, reason, alignment)
        if still is None:
            seen = self._settled(seen, alignment)
        alignment, status, reason, still = self._confirm(seen, alignment, status, reason, still)
        if status is Status.LOST:
            return self._lose_sight(seen, reason, alignment)
        if status is Status.DEGRADED and still is None:
            self._mind_change(alignment, frame.timestamp)
        joined = self._join(seen, alignment) if self._pieces.here else None
        if joined is not None:
            return self._accept(seen, Status.DEGRADED, ASTRAY, joined)
        return self._accept(seen, status, reason, alignment, still)

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be had, for instance since its file is broken.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str
            For the result and the log.

        Returns
        -------
        TrackedFrame
            ``LOST``, with a predicted pose.
        """
        self._make_due_keyframe()
        self._rewind(timestamp)
        return self._lose(timestamp, reason)

    def _register(self, seen: Seen) -> tuple[Alignment, Status, str, Still | None]:
        """Register a frame with the keyframe: what stands still, where much moves, or all of it."""
        timestamp = seen.frame.timestamp
        moving = self._is_moving(timestamp)
        still = self._stand_still(seen) if moving else None
        if still is None or (_is_little(still, seen) and self._follows(timestamp)):
            alignment, status, reason = self._locate(seen)
            if status is not Status.LOST and self._judge.is_out_of_step(alignment):
                still = None
            if status is Status.LOST and not moving:
                still = self._stand_out(seen)
            if still is None:
                return alignment, status, reason, None
        return still.alignment, Status.DEGRADED, MOVED, still

    def _confirm(
        self,
        seen: Seen,
        alignment: Alignment,
        status: Status,
        reason: str,
        still: Still | None,
    ) -> tuple[Alignment, Status, str, Still | None]:
        """Ask the depth of a moment ago, and register anew what stands still if something moves."""
        if not self.config.status.max_conflict:
            return alignment, status, reason, still
        status, reason = self._question(seen, alignment, status, reason)
        doubted = status is Status.LOST or not self._judge.is_out_of_step(alignment)
        if still is None and doubted and self._is_noticed(seen.frame.timestamp):
            still = self._go_back(seen)
            if still is not None:
                alignment = still.alignment
                status, reason = self._question(seen, alignment, Status.DEGRADED, MOVED)
        return alignment, status, reason, still

    def _locate(self, seen: Seen) -> tuple[Alignment, Status, str]:
        """Register a frame with the keyframe, and look farther afield where that is in doubt."""
        assert self._keyframe is not None
        key, timestamp = self._keyframe, seen.frame.timestamp
        far = self._is_far_step(timestamp)
        with self._clock("registration"):
            starts = self._starts(timestamp, seen)
            term = self._shared.term(self._fitter.term, self._period(timestamp))
            lag = self._lag(seen)
            edges = key.edges_for(near=seen.is_near)
            alignment = self._registration.align(
                edges, seen.samples, starts, key.planes, seen.points, term, lag, far=far
            )
        is_off = self._is_off_planes if far else self._judge.is_off
        if is_off(alignment):
            with self._clock("search"):
                again = self._on_planes(seen, term, alignment, far=far)
            if far or not self._is_lost(again, timestamp) or self._is_lost(alignment, timestamp):
                alignment = again
        if not far and self._judge.scatter.is_wide(alignment):
            self._judge.scatter.widen()
            with self._clock("search"):
                alignment = self._sharpest(seen, starts, term, alignment)
        status, reason = self._assess(alignment, timestamp)
        if not self.config.motion.search_deg or (status is Status.TRACKED and not far):
            return alignment, status, reason
        with self._clock("search"):
            if status is not Status.TRACKED:
                other = self._search.around(key, self._T_key_last, seen, alignment)
                alignment = self._better(alignment, other, timestamp)
                status, reason = self._assess(alignment, timestamp)
            if not far or status is Status.DEGRADED:
                return alignment, status, reason
            if status is Status.TRACKED:
                if self._search.is_alone(key, alignment.T_ref_cur, seen):
                    return alignment, status, reason
                found, reason = alignment, NOT_ALONE
            else:
                gap = self._period(timestamp)
                farther = self._search.farther(key, self._T_key_last, seen, gap)
                if farther is None:
                    return alignment, status, reason
                found, reason = farther, FAR_STEP
        self._doubt_time, self._doubt = timestamp, STEPPED
        return found, Status.DEGRADED, reason

    def _better(self, found: Alignment, other: Alignment, timestamp: float) -> Alignment:
        """Of two that fit: what is not lost, else whose depth is not off, else the clearer."""
        if other is found:
            return found
        lost = [self._is_lost(each, timestamp) for each in (found, other)]
        off = [self._judge.is_off(each) for each in (found, other)]
        for fails, other_fails in (lost, off):
            if fails != other_fails:
                return other if fails else found
        return max(found, other, key=clarity)

    def _is_lost(self, alignment: Alignment, timestamp: float) -> bool:
        return self._assess(alignment, timestamp)[0] is Status.LOST

    def _sharpest(
        self, seen: Seen, starts: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register with a scale that is known, and take what crowds edges most clearly.

        Where light makes edges come and go at once, half of them belong to no edge of the
        keyframe: a scale that is taken from all of them lets them count. Depth knows no light, so
        that one more start is where it leads from the first. Few samples tell the best start.
        """
        assert self._keyframe is not None
        key, scatter = self._keyframe, self._judge.scatter

        def align(part: Seen, start: NDArray[np.float64]) -> Alignment:
            return self._registration.align(
                key.edges_for(near=part.is_near),
                part.samples,
                start[None],
                key.planes,
                part.points,
                term,
                self._lag(part),
                scatter.sharp_px,
            )

        by_depth, _ = self._depth_alone.align(key, seen.samples, seen.points, starts[0])
        usual = thinned(seen.points, self.config.planes.point_step_px)
        few = replace(seen, samples=seen.samples.every(STRIDE), points=usual)
        tried = [align(few, T) for T in (*starts, found.T_ref_cur, by_depth.T_ref_cur)]
        best = align(seen, max(tried, key=clarity).T_ref_cur)
        return best if is_sharper(best, found) else found

    def _is_off_planes(self, found: Alignment) -> bool:
        """Whether depth contradicts where edges lead, and edges are not all but sure of it."""
        unsure = found.inliers < SURE * len(found.matches)
        return unsure and found.sigma_depth > self.config.status.max_depth_sigma

    def _on_planes(self, seen: Seen, term: DepthTerm, found: Alignment, *, far: bool) -> Alignment:
        """Register from where depth alone leads, and take what edges and depth agree on best.

        A turn and a way to the side move edges all but alike; of the planes a turn tilts each.
        """
        assert self._keyframe is not None
        key, points = self._keyframe, seen.points
        level, _ = self._depth_alone.align(key, seen.samples, points, found.T_ref_cur)
        start = level.T_ref_cur[None]
        edges, lag = key.edges_for(near=seen.is_near), self._lag(seen)
        again = self._registration.align(
            edges, seen.samples, start, key.planes, points, term, lag, far=far
        )
        return max((found, again), key=lambda each: agreement(each, key.planes, points))

    @property
    def _leaves_out(self) -> bool:
        """Whether what moves is left out: depth has to tell it from what does not."""
        status = self.config.status
        return status.moving == "leave-out" and status.max_conflict > 0 and self._fitter.is_on

    def _is_moving(self, timestamp: float) -> bool:
        """Whether something moved by itself of late, and is to be left out."""
        return self._leaves_out and 0 <= timestamp - self._moving_time < DOUBTFUL_S

    def _is_noticed(self, timestamp: float) -> bool:
        """Whether this frame shows that something moves."""
        return self._is_moving(timestamp) and self._moving_time == timestamp

    def _stand_still(self, seen: Seen) -> Still | None:
        """Register what stands still of a frame, if that is enough to be trusted."""
        assert self._keyframe is not None
        with self._clock("background"):
            starts = list(self._starts(seen.frame.timestamp, seen))
            then = self._background.last_pose()
            if then is not None:
                starts.append(se3.inverse(self._keyframe.T_world_key) @ then)
            still = self._background.register(self._keyframe, seen, starts, self._cruise)
        if still is None:
            return None
        status, _ = self._assess(still.alignment, seen.frame.timestamp)
        return None if status is Status.LOST else still

    def _stand_out(self, seen: Seen) -> Still | None:
        """Of a frame that fits as a whole nowhere, what stands still, if the rest moves past it."""
        timestamp, limits = seen.frame.timestamp, self.config.status
        if not self._leaves_out or self._period(timestamp) > LONGEST_PREDICTION_S:
            return None
        still = self._stand_still(seen)
        if still is None:
            return None
        with self._clock("witness"):
            conflict = self._conflict(seen, still.alignment)[0]
        return still if limits.max_conflict < conflict <= limits.lost_conflict else None

    def _go_back(self, seen: Seen) -> Still | None:
        """Register again what stands still, from where the camera was before anything moved."""
        since = seen.frame.timestamp - YOUNG_S
        if not self._background.reaches(since):
            return None  # in a moment it will
        self._background.forget(since)
        self._witness.forget(since)
        return self._stand_still(seen)

    def _give_up(self, seen: Seen, reason: str, alignment: Alignment | None) -> TrackedFrame:
        """Go on by depth where there are hardly any edges, or begin anew; else it is lost."""
        bare = self._depth_alone.has_to_tell(seen.samples)
        if bare and not self._tells_by_depth(seen.frame):
            return self._lose_sight(seen, reason, alignment)
        if bare and self._period(seen.frame.timestamp) <= LONGEST_PREDICTION_S:
            return self._follow_depth(seen, reason)
        return self._give_in(seen, reason, alignment)

    def _give_in(self, seen: Seen, reason: str, alignment: Alignment | None) -> TrackedFrame:
        """Begin anew, if it has been lost for long and images fit one another; else it is lost."""
        if self._is_expected_nowhere(seen.frame.timestamp):
            with self._clock("recovery"):
                anew = self._begin_anew(seen)
            if anew is not None:
                return anew
        return self._lose_sight(seen, reason, alignment)

    def _lose_sight(self, seen: Seen, reason: str, alignment: Alignment | None) -> TrackedFrame:
        """Lose a frame whose edges are known."""
        return self._lose(seen.frame.timestamp, reason, seen, alignment)

    def _rewind(self, timestamp: float) -> None:
        """Begin to count anew where a clock has jumped back, as a recording that starts over."""
        if self._last_time is not None and timestamp < self._last_time - BACK_S:
            self._last_time, self._last_recovery = timestamp, -math.inf
            self._last_sure = None
            self._doubt_time = self._moving_time = -math.inf
            self._pieces.rewind(timestamp)
            self._chain.forget()
            self._background.forget()
            self._instants.interrupt()
            if self._anchor is not None:
                self._anchor = timestamp, self._anchor[1]

    def _hold(self, timestamp: float) -> TrackedFrame:
        """Stay at the last pose while an image repeats, but not for long: the camera may move."""
        age = self._freeze.age(timestamp, SHORTEST_PERIOD_S, NOMINAL_PERIOD_S)
        reason = "the same image as before"
        if age > FREEZE_S:
            reason = f"the same image for {age:.2f} s: the stream is frozen"
        elif self._keyframe is None or not self._sight_found:
            reason += ", which had no pose"
        else:
            index, T_key_cur = self._keyframe.index, self._T_key_last
            return self._keep(timestamp, Status.DEGRADED, reason, T_key_cur, index)
        return self._lose(timestamp, reason)

    def _tells_by_depth(self, frame: Frame) -> bool:
        """Whether depth alone may say how a camera moves."""
        sight = glimpse(frame.depth)
        fresh = not np.array_equal(sight, self._bare_depth)  # to the bit: depth is frozen
        self._bare_depth = sight
        planes = self.config.planes
        wanted = self._fitter.is_on and planes.alone_share > 0 and self._keyframe is not None
        return wanted and fresh

    def _follow_depth(self, seen: Seen, few: str) -> TrackedFrame:
        """Go on by depth alone, where it fits the keyframe's; the frame is degraded, or lost."""
        assert self._keyframe is not None
        key, timestamp = self._keyframe, seen.frame.timestamp
        period = self._period(timestamp)
        with self._clock("registration"):
            start = self._T_key_last
            if self.config.motion.prior == "constant-velocity":
                # That of the last frames with edges is poor where they had few, as walls do.
                velocity = self._velocity if self._blind else self._cruise
                start = start @ se3.exp(velocity * math.exp(-period / FADING_S) * period)
            alignment, covariance = self._depth_alone.align(key, seen.samples, seen.points, start)
        T_last_cur = se3.inverse(self._T_key_last) @ alignment.T_ref_cur
        own = in_current_camera(covariance, alignment.T_ref_cur)  # in which it was held still
        loose = tuple(describe(way) for way in degenerate_directions(own))
        misfit = self._judge.judge_alone(
            alignment, len(seen.points.sigma), *speed_of(T_last_cur, period)
        )
        if len(loose) == 6 and misfit in ("", alignment.reason):
            misfit = "depth constrains nothing"
        reason = f"depth alone: {few}"
        if loose:
            reason += f"; not constrained: {', '.join(loose)}"
        status = Status.LOST if misfit else Status.DEGRADED
        # Where it may have drifted there is nothing to hold against the depth of a moment ago.
        if not misfit and not loose and self.config.status.max_conflict:
            status, reason = self._question(seen, alignment, status, reason)
        if status is Status.LOST:
            return self._give_in(seen, f"{few}; {misfit or reason}", alignment)
        if loose:
            self._sure = False
            if self._anchor is None:
                self._anchor = timestamp - period, self._T_world_last
        self._blind, self._last_time = True, timestamp
        self._instants.interrupt()
        self._velocity = se3.log(T_last_cur) / period
        self._T_key_last = alignment.T_ref_cur
        self._T_world_last = key.T_world_key @ alignment.T_ref_cur
        return self._keep(
            timestamp,
            status,
            reason,
            alignment.T_ref_cur,
            key.index,
            seen=seen,
            alignment=alignment,
            covariance=covariance,
            degenerate=loose,
        )

    def _unseen(self, timestamp: float) -> float:
        """Seconds since it was last known where it is."""
        period = self._period(timestamp)
        return period if self._anchor is None else max(period, timestamp - self._anchor[0])

    def _is_adrift(self, timestamp: float) -> bool:
        """Whether depth alone has let it drift for so long that edges must find it again."""
        drifting = self._blind and self._anchor is not None
        return drifting and self._unseen(timestamp) > LONG_LOST_S

    def _is_long_lost(self, timestamp: float) -> bool:
        """Whether it has been lost for so long that it may be anywhere it was before."""
        enough = LONG_LOST_FRAMES if self._anchor is None else 1
        long = self._losses >= enough and self._unseen(timestamp) > LONG_LOST_S
        return long and len(self._store) > 0

    def _is_far_step(self, timestamp: float) -> bool:
        """Whether so few frames come that the camera may be far from where the last one was."""
        few = self._losses < LONG_LOST_FRAMES
        return few and self._period(timestamp) > LONGEST_PREDICTION_S * (self._losses + 1)

    def _recover(self, seen: Seen) -> TrackedFrame | None:
        """Go on from a stored keyframe, if the frame is sure to fit one."""
        assert self._keyframe is not None
        timestamp = seen.frame.timestamp
        if abs(timestamp - self._last_recovery) >= RECOVERY_PERIOD_S:
            self._last_recovery = timestamp
            apart = self._pieces.here
            gap = self._pieces.gap(timestamp) if apart else self._unseen(timestamp)
            T_world_known = self._T_world_last if self._anchor is None else self._anchor[1]
            last, seen_last = min(self._period(timestamp), LONGEST_GAP_S), min(gap, LONGEST_GAP_S)
            expected = [
                self._T_world_last @ se3.exp(self._velocity * last),
                T_world_known @ se3.exp(self._cruise * seen_last),
            ]
            recovered = self._search.everywhere(
                self._store, self._keyframe, seen, expected, gap, self._before_doubt(timestamp)
            )
            if recovered is not None:
                self._keyframe, alignment = recovered
                self._blind, self._T_key_last = False, alignment.T_ref_cur  # not moved, but found
                self._forget_the_way()
                self._pieces.enter(self._keyframe.piece, timestamp - self._unseen(timestamp))
                sure = self._sure and not apart and not self._pieces.here
                if sure:
                    return self._accept(seen, Status.TRACKED, "", alignment)
                self._doubt_time, self._doubt = timestamp, ASTRAY
                return self._accept(seen, Status.DEGRADED, ASTRAY, alignment)
        return None

    def _forget_the_way(self) -> None:
        """Drop what was seen on the way here: from poses that are doubtful by now, or of a hand."""
        self._witness.forget()
        self._background.forget()
        self._last_good.forget()
        self._last_sure = None

    def _before_doubt(self, timestamp: float) -> tuple[Keyframe, NDArray[np.float64]] | None:
        """Where it was when it was last sure, if it was lost from a doubtful pose soon after."""
        if self._sure or self._last_sure is None or timestamp - self._last_sure[0] > LONG_SURE_S:
            return None
        return self._last_sure[1:]

    def _is_expected_nowhere(self, timestamp: float) -> bool:
        """Whether it is lost for so long that it may begin anew, once images have settled."""
        wanted = self.config.status.lost == "begin-anew" and len(self._store) > 0
        return wanted and self._unseen(timestamp) > LONGEST_GAP_S - SETTLED_S

    def _begin_anew(self, seen: Seen) -> TrackedFrame | None:
        """Go on from where it was expected, once images fit one another."""
        timestamp = seen.frame.timestamp
        if self._chain.rests(timestamp):
            return None
        T_world_cam = self._T_world_last @ se3.exp(self._cruise * FADING_S)  # till it has faded
        keyframe = self._front_end.keyframe(seen, self._count, T_world_cam, self._pieces.following)
        velocity = self._chain.join(seen, keyframe)
        if velocity is None or self._unseen(timestamp) <= LONGEST_GAP_S:
            return None
        bare = self._depth_alone.has_to_tell(seen.samples)
        self._pieces.begin(timestamp, timestamp - self._unseen(timestamp))
        self._T_world_last, self._velocity = T_world_cam, velocity
        self._blind = bare  # edges that come back then are none that it knows
        self._anchor = (self._pieces.since, T_world_cam) if bare else None
        self._take_keyframe(keyframe, keep=not bare)
        self._shared.forget()
        self._chain.forget()
        self._search.forget()
        self._forget_the_way()
        self._doubt_time = self._moving_time = -math.inf
        self._last_time = timestamp
        self._remember(seen)
        logger.info("frame %d: begun anew", self._count)
        return self._keep(
            timestamp, Status.DEGRADED, ANEW, np.eye(4), -1, is_keyframe=True, seen=seen
        )

    def _join(self, seen: Seen, alignment: Alignment) -> Alignment | None:
        """Look for what was seen before it began anew; where it is found, the piece is moved."""
        timestamp = seen.frame.timestamp
        if not self._pieces.may_ask(timestamp):
            return None
        piece, gap = self._pieces.here, self._pieces.gap(timestamp)
        earlier = self._store.before(piece)
        if not len(earlier):
            return None
        assert self._keyframe is not None
        T_world_cam = self._keyframe.T_world_key @ alignment.T_ref_cur
        with self._clock("recovery"):
            found = self._search.everywhere(earlier, earlier.newest(), seen, [T_world_cam], gap)
        if found is None:
            return None
        T_last_cur = se3.inverse(self._T_key_last) @ alignment.T_ref_cur
        self._keyframe, joined = found
        T = self._keyframe.T_world_key @ joined.T_ref_cur @ se3.inverse(T_world_cam)
        self._store.move(piece, self._keyframe.piece, T)
        if self._anchor is not None:
            self._anchor = self._anchor[0], T @ self._anchor[1]
        self._pieces.here = self._keyframe.piece
        self._forget_the_way()
        self._T_key_last = joined.T_ref_cur @ se3.inverse(T_last_cur)
        self._doubt_time, self._doubt = timestamp, ASTRAY
        return joined

    def _check_size(self, frame: Frame) -> None:
        height, width = frame.grey.shape
        if (width, height) != (self.camera.width, self.camera.height):
            raise FrameError(
                f"frame is {width} x {height}, the camera "
                f"{self.camera.width} x {self.camera.height}; give the camera of these images"
            )

    def _begin(self, seen: Seen) -> TrackedFrame:
        """Take the first usable frame as the first keyframe."""
        self._set_keyframe(self._front_end.keep(seen), self._count, None)
        self._last_time = timestamp = seen.frame.timestamp
        self._remember(seen)
        if self.config.status.max_conflict:
            with self._clock("witness"):
                surface = self._witness.surface(seen.frame.depth)
                self._witness.remember(timestamp, self._T_world_last, surface)
        return self._keep(timestamp, Status.TRACKED, "", np.eye(4), -1, is_keyframe=True, seen=seen)

    def _accept(
        self,
        seen: Seen,
        status: Status,
        reason: str,
        alignment: Alignment,
        still: Still | None = None,
    ) -> TrackedFrame:
        """Move on to the pose found, and to a new keyframe where one is due."""
        assert self._keyframe is not None
        registered = seen if still is None else still.seen
        keyframe, T_key_cur = self._keyframe, alignment.T_ref_cur
        timestamp = seen.frame.timestamp
        T_last_cur, period = self._moved(T_key_cur, timestamp)
        follows = self._follows(timestamp)
        self._velocity = se3.log(T_last_cur) / period
        self._T_key_last = T_key_cur
        self._blind = False
        if not self._pieces.here:  # else a doubt lasts where it is to what was before
            self._search.forget()
        self._chain.forget()
        if status is Status.TRACKED and self._is_doubtful(timestamp):
            status, reason = Status.DEGRADED, self._doubt
        self._sure = status is Status.TRACKED
        if self._sure:
            self._last_sure = timestamp, keyframe, T_key_cur.copy()
            self._judge.note(alignment)
            compared = keyframe.planes, registered.points, self._fitter.term
            self._shared.note(keyframe.edges.edges, alignment, period, *compared)
            self._instants.note(keyframe, registered, alignment, period)
            self._cruise += (self._velocity - self._cruise) * min(period / CRUISE_S, 1.0)
        else:
            self._shared.interrupt()
            self._instants.interrupt()
        self._T_world_last = keyframe.T_world_key @ T_key_cur
        covariance: NDArray[np.float64] | None = None
        degenerate: tuple[str, ...] = ()
        if self.config.status.covariance != "none" or self._anchor is not None:
            with self._clock("uncertainty"):
                covariance = self._covariance(keyframe, registered, alignment)
                degenerate = tuple(describe(way) for way in degenerate_directions(covariance))
        if self._anchor is not None and not degenerate:  # else it may still be off along those
            if self._unseen(timestamp) > LONG_LOST_S:
                self._doubt_time, self._doubt = timestamp, ASTRAY
            self._anchor = None
        self._last_time = timestamp
        self._remember(seen)
        if status is Status.TRACKED:
            if degenerate:
                status, reason = Status.DEGRADED, f"not constrained: {', '.join(degenerate)}"
            elif self._is_doubtful(timestamp):
                status, reason = Status.DEGRADED, self._doubt
            elif self._pieces.here:
                status, reason = Status.DEGRADED, ANEW
        share = alignment.inliers / len(registered.samples)
        good = status is Status.TRACKED or (self._sure and reason == ANEW)
        if good and share > self.config.keyframes.min_overlap and self.config.keyframes.stored:
            self._last_good.note(self._count, seen.frame, self._T_world_last)
        age = self._count - keyframe.index
        rule, better = self.config.keyframes, False
        if rule.early_share < 1 and covariance is not None:
            better = self._information.is_better(covariance, period)
        due = self._anchor is None and is_due(rule, T_key_cur, share, age, well_placed=better)
        # one that has gathered the last frame's edges, and serves no better, gives way
        fresh = timestamp - keyframe.gathered_at > 1.5 * period
        gathers = due and fresh and seen.is_near and still is None
        gathers = gathers and may_gather(rule, keyframe, T_key_cur, share)
        together = rule.window > 2 and still is None and follows and status is Status.TRACKED
        velocity = self._velocity if follows else None
        if gathers:
            kept, due = self._front_end.keep(seen, aside=True), False
            self._due = _Due(kept, self._count, velocity, T_key_cur=T_key_cur.copy())
        elif due:
            placed_by = covariance if together else None
            if placed_by is not None:
                T_key_cur = self._place(seen, T_key_cur, placed_by)
            kept = self._front_end.keep(seen)
            self._due = _Due(kept, self._count, velocity, placed_by is not None)
        elif follows:
            self._renew_keyframe()
        return self._keep(
            timestamp,
            status,
            reason,
            T_key_cur,
            keyframe.index,
            is_keyframe=due,
            seen=registered,
            alignment=alignment,
            covariance=covariance,
            degenerate=degenerate,
        )

    def _remember(self, seen: Seen) -> None:
        """Keep the depth of a frame whose pose is known, to tell later what has moved."""
        if self._leaves_out:
            T_world_depth = _of_depth(seen, self._T_world_last)
            self._background.remember(seen.frame.timestamp, T_world_depth, seen.frame.depth)

    def _covariance(self, key: Keyframe, seen: Seen, alignment: Alignment) -> NDArray[np.float64]:
        """Of the motion found."""
        return self._uncertainty.covariance(
            key.edges, seen.samples, key.planes, seen.points, self._fitter.term, alignment
        )

    def _keep(
        self,
        timestamp: float,
        status: Status,
        reason: str,
        T_key_cur: NDArray[np.float64],
        keyframe: int,
        *,
        is_keyframe: bool = False,
        seen: Seen | None = None,
        alignment: Alignment | None = None,
        covariance: NDArray[np.float64] | None = None,
        degenerate: tuple[str, ...] = (),
    ) -> TrackedFrame:
        """Note the pose, now of the last frame that was not lost."""
        if self._losses:
            logger.info("frame %d: found again", self._count)
        self._losses = 0
        self._sight_found = True
        self._timestamps.append(timestamp)
        self._poses.append(self._T_world_last)
        self._count += 1
        return TrackedFrame(
            timestamp=timestamp,
            index=self._count - 1,
            status=status,
            reason=reason,
            T_world_cam=self._T_world_last,
            T_key_cur=T_key_cur,
            keyframe=keyframe,
            is_keyframe=is_keyframe,
            edges=len(seen.edges) if seen else 0,
            samples=len(seen.samples) if seen else 0,
            alignment=alignment,
            covariance=covariance,
            degenerate=degenerate,
            piece=self._pieces.here,
            edge_scale=seen.edges.scale if seen else None,
        )

    def _lose(
        self,
        timestamp: float,
        reason: str,
        seen: Seen | None = None,
        alignment: Alignment | None = None,
    ) -> TrackedFrame:
        """Leave the state as it was, so that the next frame tries again from the keyframe."""
        log = logger.debug if self._losses else logger.warning
        log("frame %d lost: %s", self._count, reason)
        self._instants.interrupt()
        if not self._losses and self.config.keyframes.stored:
            self._store_last_good()
        self._losses += 1
        self._count += 1
        ahead = self._ahead(timestamp)
        return TrackedFrame(
            timestamp=timestamp,
            index=self._count - 1,
            status=Status.LOST,
            reason=reason,
            T_world_cam=se3.compose(self._T_world_last, ahead),
            T_key_cur=se3.compose(self._T_key_last, ahead),
            keyframe=-1 if self._keyframe is None else self._keyframe.index,
            is_keyframe=False,
            edges=len(seen.edges) if seen else 0,
            samples=len(seen.samples) if seen else 0,
            alignment=alignment,
            piece=self._pieces.here,
            edge_scale=seen.edges.scale if seen else None,
        )

    def _store_last_good(self) -> None:
        """Make the last good image a place to find back to, if none like it is known."""
        good = self._last_good.take()
        if good is None:
            return
        piece = self._pieces.here
        known = [T for index, T in self._store.places(piece) if index < good.index]
        if is_apart(good.T_world_cam, known):
            seen = self._front_end.see(good.frame, self._count)
            with self._clock("keyframe"):
                self._store.add(self._front_end.keyframe(seen, good.index, good.T_world_cam, piece))

    def _place(
        self, seen: Seen, T_key_cur: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Move a frame that is to be the keyframe to where the last few place it: T_key_cur."""
        assert self._keyframe is not None
        last, term = self._keyframe, self._shared.term(self._fitter.term)
        with self._clock("keyframe"):
            self._T_world_last = self._window.place(last, seen, T_key_cur, covariance, term)
        return se3.inverse(last.T_world_key) @ self._T_world_last

    def _make_due_keyframe(self) -> None:
        """Make the last frame the keyframe, or add its edges to it, if that is due."""
        due, self._due = self._due, None
        if due is not None and due.T_key_cur is not None:
            self._gather(due.seen, due.T_key_cur, due.velocity)
        elif due is not None:
            keyframe = self._set_keyframe(due.seen, due.index, due.velocity)
            if due.is_placed:
                self._window.take(keyframe)

    def _set_keyframe(
        self, seen: Seen, index: int, velocity: NDArray[np.float64] | None
    ) -> Keyframe:
        """Make a frame the keyframe, its parts moved by the velocity where that is known."""
        with self._clock("keyframe"):
            if velocity is not None:  # measured by now, no longer expected
                T_cam_depth = self._instants.depth.motion(velocity, seen.frame.depth_delay)
                seen = replace(seen, T_cam_depth=T_cam_depth)
            kept, telling = self._front_end.to_keep(seen)
            if velocity is not None and kept.samples is not seen.samples:  # those were by then
                samples = self._instants.rolling.unrolled(kept.samples, velocity)
                kept = replace(kept, samples=samples)
            edges = kept.edges.describe(self.camera)
            keyframe = self._front_end.keyframe(
                kept,
                index,
                self._T_world_last,
                self._pieces.here,
                self._instants.unrolled(edges, kept, velocity),
                telling,
            )
            self._take_keyframe(keyframe)
            self._instants.hold(keyframe, kept, edges, velocity)
        return keyframe

    def _gather(
        self, seen: Seen, T_key_cur: NDArray[np.float64], velocity: NDArray[np.float64] | None
    ) -> None:
        """Add to the keyframe the edges of a frame that it does not know."""
        assert self._keyframe is not None
        before = self._keyframe
        with self._clock("keyframe"):
            edges = self._front_end.edges_with_depth(seen)
            if velocity is not None:
                edges = self._instants.rolling.unrolled(edges, velocity)
            when = seen.frame.timestamp
            more = gather(before, edges, T_key_cur, when, self._registration, self.camera)
            self._store.replace(before, more)
            self._instants.exchange(before, more)
            self._keyframe = more
        logger.debug("keyframe %d has gathered %d edges", more.index, more.gathered)

    def _renew_keyframe(self) -> None:
        """Move the parts of the keyframe, where more is known by now of when they were taken."""
        assert self._keyframe is not None
        with self._clock("keyframe"):
            keyframe = self._instants.renewed(self._keyframe, self._velocity)
            if keyframe is not None:
                self._store.replace(self._keyframe, keyframe)
                self._keyframe = keyframe

    def _take_keyframe(self, keyframe: Keyframe, *, keep: bool = True) -> None:
        self._keyframe, self._T_key_last = keyframe, np.eye(4)
        if keep and self.config.keyframes.stored:
            self._store.add(keyframe)
        logger.debug("frame %d is a keyframe", keyframe.index)

    def _period(self, timestamp: float) -> float:
        """Seconds since the last frame that was not lost; the usual where stamps make no sense."""
        if self._last_time is None or timestamp - self._last_time < SHORTEST_PERIOD_S:
            return NOMINAL_PERIOD_S
        return timestamp - self._last_time

    def _detail(self, timestamp: float) -> Detail:
        """How much to take from a frame: the usual where places, or what moves, are told apart."""
        apart = self._anchor is not None or self._pieces.here or self._is_moving(timestamp)
        if apart or not self._follows(timestamp):
            return usual_detail(self.config)
        faint = self._keyframe is not None and self._keyframe.is_faint
        if self._blind:  # faint edges may be all that there are
            return usual_detail(self.config)._replace(is_near=True, is_faint=faint)
        return worthwhile_detail(
            self.config,
            self.camera,
            self._shared,
            was_fine=self._is_fine,
            shows_faint=faint,
        )

    def _lead(self, frame: Frame) -> NDArray[np.float64] | None:
        """Where the camera was when the depth of the next frame was taken, as against its image."""
        depth, period = self._instants.depth, self._period(frame.timestamp)
        if not self._follows(frame.timestamp):
            return None
        if self._blind and depth.share(frame.depth_delay, period) > FED_BACK:
            return None
        return depth.motion(self._velocity, frame.depth_delay)

    def _follows(self, timestamp: float) -> bool:
        """Whether the last pose is that of a moment ago."""
        return not self._losses and self._period(timestamp) <= LONGEST_PREDICTION_S

    def _lag(self, seen: Seen) -> kernels.Lag:
        """When depth and rows were taken, as shares of the time since the last frame."""
        timestamp = seen.frame.timestamp
        if not self._follows(timestamp):
            return AT_ONCE
        return self._instants.lag(seen, self._T_key_last, self._period(timestamp))

    def _settled(self, seen: Seen, alignment: Alignment) -> Seen:
        """Move depth and rows by what the camera has moved by, no longer by what was expected."""
        timestamp = seen.frame.timestamp
        if not self._follows(timestamp):
            return seen
        T_last_cur = se3.inverse(self._T_key_last) @ alignment.T_ref_cur
        return self._instants.settled(seen, T_last_cur, self._period(timestamp))

    def _ahead(self, timestamp: float) -> NDArray[np.float64]:
        """Motion since the last pose, at constant velocity."""
        return se3.exp(self._velocity * min(self._period(timestamp), LONGEST_PREDICTION_S))

    def _starts(self, timestamp: float, seen: Seen) -> NDArray[np.float64]:
        """Poses to start from, relative to the keyframe."""
        assert self._keyframe is not None
        still = self._T_key_last
        starts = [still]
        if self.config.motion.prior == "constant-velocity":
            starts.insert(0, still @ self._ahead(timestamp))
        if self._losses:
            starts.append(np.eye(4))  # the camera may have come back to where the keyframe was
        if self.config.motion.search_deg and self._is_far_step(timestamp):
            starts = self._search.likeliest(self._keyframe, still, seen, starts)
        return np.array(starts)

    def _question(
        self, seen: Seen, alignment: Alignment, status: Status, reason: str
    ) -> tuple[Status, str]:
        """Hold a pose against the depth of a moment ago: what was empty cannot be filled."""
        timestamp, limits = seen.frame.timestamp, self.config.status
        with self._clock("witness"):
            conflict, T_world_cam, surface = self._conflict(seen, alignment)
        if conflict > limits.max_conflict:
            self._doubt_time, self._doubt = timestamp, MOVED
            self._moving_time = timestamp
            reason = f"{conflict:.0%} of the view stands where nothing was: something moves"
            if conflict > limits.lost_conflict:
                return Status.LOST, reason
            status = Status.DEGRADED
        self._witness.remember(timestamp, T_world_cam, surface)
        return status, reason

    def _mind_change(self, alignment: Alignment, timestamp: float) -> None:
        """Doubt what follows a frame that fits poorly what was seen just now."""
        if self.config.status.sudden_change == "ignore":
            return
        assert self._keyframe is not None
        key = self._keyframe
        age = timestamp - (key.gathered_at if key.gathered else key.timestamp)
        if 0 <= age < JUST_NOW_S and self._judge.fits_poorly(alignment):
            self._doubt_time, self._doubt = timestamp, CHANGED

    def _conflict(
        self, seen: Seen, alignment: Alignment
    ) -> tuple[float, NDArray[np.float64], Surface]:
        """How much of a frame contradicts a pose; that of its depth, and what was asked."""
        assert self._keyframe is not None
        timestamp = seen.frame.timestamp
        T = _of_depth(seen, self._keyframe.T_world_key @ alignment.T_ref_cur)
        self._witness.forget(timestamp)  # what it was told of this frame by another pose
        surface = self._witness.surface(seen.frame.depth)
        return self._witness.question(timestamp, T, surface), T, surface

    def _is_doubtful(self, timestamp: float) -> bool:
        """Whether something of late makes a pose no better than the way that led to it."""
        return 0 <= timestamp - self._doubt_time < DOUBTFUL_S

    def _assess(self, alignment: Alignment, timestamp: float) -> tuple[Status, str]:
        """Judge a registration by its evidence, and by how far it is from the last pose."""
        T_last_cur, period = self._moved(alignment.T_ref_cur, timestamp)
        follows = self._follows(timestamp)
        return self._judge.judge(alignment, *speed_of(T_last_cur, period), follows=follows)

    def _moved(
        self, T_key_cur: NDArray[np.float64], timestamp: float
    ) -> tuple[NDArray[np.float64], float]:
        """Motion since the last pose that is not a guess, and the seconds that it took."""
        if not self._blind or self._anchor is None:
            return se3.inverse(self._T_key_last) @ T_key_cur, self._period(timestamp)
        assert self._keyframe is not None
        T_world_cur = self._keyframe.T_world_key @ T_key_cur
        return se3.inverse(self._anchor[1]) @ T_world_cur, self._unseen(timestamp)


def _is_little(still: Still, seen: Seen) -> bool:
    """Whether less than half of a frame is said to stand still."""
    return 2 * len(still.seen.samples) < len(seen.samples)


def _of_depth(seen: Seen, T_world_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the camera was as the depth was taken that belongs to an image taken there."""
    return T_world_cam if seen.T_cam_depth is None else T_world_cam @ seen.T_cam_depth


def _checked(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Copy of a pose that came from outside, or an error."""
    T = np.asarray(T, np.float64)
    if T.shape == (4, 4) and np.isfinite(T).all():
        R = T[:3, :3]
        turns = np.abs(R @ R.T - np.eye(3)).max() < 1e-3 and np.linalg.det(R) > 0
        if turns and (T[3] == (0, 0, 0, 1)).all():
            return rigid(T)
    raise TrajectoryError(
        f"T_world_cam is no rigid motion: {T.shape} {T.ravel().tolist()!s:.60}; give a 4 x 4 "
        "matrix of a rotation and a translation"
    )
