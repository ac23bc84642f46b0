"""The main loop: one frame in, one pose out (§III-§V)."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo.assessing import LEAPT
from edvo.blind import Blind
from edvo.camera import Camera
from edvo.clock import Clock, StageClock, no_clock
from edvo.config import Config
from edvo.contours import Contours
from edvo.course import (
    LONG_LOST_S,
    LONGEST_PREDICTION_S,
    NOMINAL_PERIOD_S,
    SHORTEST_PERIOD_S,
    Course,
)
from edvo.depth_alone import DepthAlone
from edvo.detail import Detail, usual_detail, worthwhile_detail
from edvo.doubt import ASTRAY, Doubt
from edvo.earlier import EarlierKeyframes
from edvo.errors import CameraError, ConfigError, FrameError
from edvo.exposure import Exposure
from edvo.frame import Frame, finite_seconds
from edvo.freeze import FREEZE_S, Freeze
from edvo.front_end import FrontEnd
from edvo.instants import Instants
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.parting import Parting
from edvo.pieces import Pieces
from edvo.places import Found
from edvo.placing import Placed, Placer
from edvo.planes import PlaneFitter
from edvo.progress import Progress
from edvo.recovery import Recovery
from edvo.registration import Alignment, Registration
from edvo.search import Search
from edvo.seen import Seen
from edvo.sharing import SharedErrors
from edvo.stale import StaleDepth
from edvo.stamps import Stamps
from edvo.standing import Standing
from edvo.status import Judge, Status
from edvo.tracked import Record, TrackedFrame
from edvo.trajectory import Trajectory
from edvo.uncertainty import Uncertainty, describe
from edvo.upkeep import Upkeep

__all__ = ["Odometry", "StageClock", "Status", "TrackedFrame"]

logger = logging.getLogger(__name__)

NOWHERE = "lost; looks like no place seen before"
UNSURE = "after a stretch without edges they fit no place for sure"
ANEW = "begun anew where it was expected; what was seen before has not been seen since"
SAME_DEPTH = "hardly any edges, and the same depth as before"
# Where depth alone says where it is, what it errs by comes back with the velocity that moves the
# next depth, and grows if that was taken so much later than its image, over the time between two.
FED_BACK = 0.4


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

    Raises
    ------
    CameraError
        If the camera is none.
    ConfigError
        If the configuration is none.

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
        if not isinstance(camera, Camera):
            raise CameraError(
                f"camera is {camera!r:.40}; give a Camera, as Camera.from_yaml('camera.yaml')"
            )
        if config is not None and not isinstance(config, Config):
            raise ConfigError(f"config is {config!r:.40}; give a Config, as Config.preset('paper')")
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
        solver, exposure = self._registration.solver, Exposure(camera, self.config)
        self._front_end = FrontEnd(
            camera, self.config, self._registration, self._fitter, self._clock, exposure
        )
        self._uncertainty = Uncertainty(camera, self.config, solver)
        self._shared = SharedErrors(camera, self.config, solver)
        self._instants = Instants(camera, self.config, self._registration, self._fitter, exposure)
        self._depth_alone = DepthAlone(camera, solver, self._fitter.term, self._uncertainty)
        self._contours = Contours(
            camera, self.config, self._registration, self._fitter, self._uncertainty
        )
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
        self._course = course = Course(T_world_cam)
        self._judge = Judge(self.config)
        self._search = Search(
            self.camera,
            self.config,
            self._registration,
            self._fitter,
            self._judge,
            self._instants,
        )
        self._front_end.reset()
        self._shared.forget()
        self._instants.forget()
        self._contours.forget()
        kit = Kit(
            self.camera,
            self.config,
            self._clock,
            self._registration,
            self._fitter,
            self._front_end,
            self._uncertainty,
            self._depth_alone,
            self._contours,
            self._shared,
            self._instants,
            self._judge,
            self._search,
        )
        self._freeze, self._stale, self._stamps = Freeze(), StaleDepth(), Stamps()
        self._fresh = 0  # index of the last new image
        self._is_fine = False  # whether its depth was looked at closely
        self._pieces = pieces = Pieces()
        self._record = Record(course, pieces)
        self._doubt = doubt = Doubt(kit, course)
        self._locator = locator = Locator(kit, course, doubt)
        self._parting = parting = Parting(kit, course, locator, doubt)
        self._standing = standing = Standing(kit, course, doubt, locator)
        self._upkeep = upkeep = Upkeep(kit, course, pieces)
        self._recovery = Recovery(kit, course, pieces, doubt, standing, upkeep)
        self._earlier = earlier = EarlierKeyframes(kit, course, pieces, locator, upkeep.store)
        self._placer = Placer(
            kit, course, pieces, doubt, locator, standing, parting, earlier, upkeep
        )
        self._progress = Progress(kit, course, doubt, locator, standing, upkeep)
        self._blind = Blind(kit, course, doubt)

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames tracked so far, by time, without those that were lost.

        Of frames with the same stamp it holds the first. The path jumps where a piece begins, and
        where it is joined to another (see ``TrackedFrame.piece``): poses stay as they were given.
        """
        return self._record.trajectory

    @property
    def depth_delay(self) -> float:
        """Delay of depth beyond what stamps tell, as measured so far, seconds."""
        return self._instants.depth.seconds

    @property
    def readout(self) -> float:
        """From the first row of an image to the last, as known, or measured so far, seconds."""
        return self._instants.rolling.seconds

    @property
    def exposure(self) -> float:
        """For how long a pixel is exposed, as known, or measured so far, seconds; 0 below 10 ms."""
        return self._instants.exposure.seconds

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
            If it is no frame, or not of the camera's size.
        """
        self._check_frame(frame)
        self._stamps.note(frame.timestamp)
        self._upkeep.catch_up()
        self._rewind(frame.timestamp)
        if self._freeze.repeats(frame):
            return self._hold(frame.timestamp)
        seen = self._see(frame)
        if few := self._too_few(seen):
            return self._give_up(seen, few)
        if self._course.keyframe is None:
            return self._begin(seen)
        if self._course.losses and not self._depth_alone.has_to_tell(seen.samples):
            self._upkeep.leave_bare()
        if self._recovery.is_adrift(frame.timestamp):
            return self._find(seen, UNSURE)
        if self._recovery.is_long_lost(frame.timestamp):
            return self._find(seen, NOWHERE)
        placed = self._placer.place(seen, self._record.count)
        if placed.is_lost and self._pieces.here:  # it may be where it was before
            return self._find(placed.seen, placed.reason, placed.alignment)
        if placed.is_lost:
            return self._give_up(placed.seen, placed.reason, placed.alignment)
        placed = self._placer.confirm(placed)
        if placed.is_lost:
            return self._lose_sight(placed.seen, placed.reason, placed.alignment)
        if placed.is_back:
            self._progress.forget_way()
        return self._accept(self._joined(placed))

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

        Raises
        ------
        FrameError
            If the timestamp is no finite number.
        """
        timestamp = finite_seconds("timestamp", timestamp)
        self._upkeep.catch_up()
        self._rewind(timestamp)
        return self._lose(timestamp, reason)

    def _see(self, frame: Frame) -> Seen:
        """Find the edges of a new image, and points of its depth."""
        self._fresh = self._record.count
        is_stale = False
        if self.config.motion.repeated_depth == "recognised":
            frame, is_stale = self._stale.dated(frame, self._course.T_world_last)
        detail = self._detail(frame.timestamp)
        seen = self._front_end.see(frame, self._record.count, self._lead(frame), detail)
        self._is_fine = seen.is_fine
        return self._stale_seen(seen) if is_stale else seen

    def _too_few(self, seen: Seen) -> str:
        """Say that a frame has not enough edges to be registered by; empty where it has."""
        least = self.config.registration.min_matches
        few = len(seen.samples) < least
        return f"{len(seen.samples)} edges with depth; {least} needed" if few else ""

    def _stale_seen(self, seen: Seen) -> Seen:
        """Let depth that repeats count once; but not where it alone tells, or something moves."""
        timestamp = seen.frame.timestamp
        if self._depth_alone.has_to_tell(seen.samples) or self._standing.is_moving(timestamp):
            return seen
        age = self._stale.frozen_for(timestamp, self._course.T_world_last)
        if age:
            self._doubt.cast(timestamp, f"depth stayed the same image for {age:.1f} s")
        return replace(seen, is_stale=True)

    def _find(self, seen: Seen, reason: str, alignment: Alignment | None = None) -> TrackedFrame:
        """Go on from where a lost camera is found, among places seen before."""
        found = self._recovery.find(seen)
        if found is None:
            return self._give_up(seen, reason, alignment)
        place, status, reason = found
        self._progress.forget_way()
        self._earlier.forget()
        return self._accept(Placed(place.seen, place.alignment, status, reason), place)

    def _joined(self, placed: Placed) -> Placed:
        """Place a frame by what was seen before it began anew, if that is in view."""
        seen, alignment = placed.seen, placed.alignment
        if not self._pieces.here or self._locator.mender.put_right(alignment) is not None:
            return placed
        joined = self._recovery.join(seen, alignment)
        if joined is None:
            return placed
        self._progress.forget_way()
        self._earlier.forget()
        return Placed(seen, joined, Status.DEGRADED, ASTRAY)

    def _give_up(self, seen: Seen, reason: str, alignment: Alignment | None = None) -> TrackedFrame:
        """Go on by depth where there are hardly any edges, or begin anew; else it is lost.

        Where depth is still that of the last frame, so is the pose.
        """
        bare = self._depth_alone.has_to_tell(seen.samples)
        if bare and not self._blind.may_tell(seen.frame):
            timestamp, course = seen.frame.timestamp, self._course
            if not self._blind.may_wait(timestamp):
                return self._lose_sight(seen, reason, alignment)
            where = course.T_key_last, course.key.index
            return self._record.keep(timestamp, Status.DEGRADED, SAME_DEPTH, *where, seen=seen)
        if bare and self._course.period(seen.frame.timestamp) <= LONGEST_PREDICTION_S:
            return self._follow_depth(seen, reason)
        return self._give_in(seen, reason, alignment)

    def _follow_depth(self, seen: Seen, few: str) -> TrackedFrame:
        """Go on by depth alone, where it fits the keyframe's; the frame is degraded, or lost."""
        followed = self._blind.follow(seen, few)
        if followed.status is Status.LOST:
            return self._give_in(seen, followed.reason, followed.alignment)
        key = self._course.key.index
        if followed.is_due:
            self._upkeep.make_bare(seen.kept(), self._record.count)
        return self._record.keep(
            seen.frame.timestamp,
            followed.status,
            followed.reason,
            followed.alignment.T_ref_cur,
            key,
            is_keyframe=followed.is_due,
            seen=seen,
            alignment=followed.alignment,
            covariance=followed.covariance,
            degenerate=followed.degenerate,
        )

    def _give_in(self, seen: Seen, reason: str, alignment: Alignment | None) -> TrackedFrame:
        """Begin anew, if it has been lost for long and images fit one another; else it is lost."""
        timestamp, index = seen.frame.timestamp, self._record.count
        wanted = self._recovery.is_expected_nowhere(timestamp)
        if wanted and self._recovery.begin_anew(seen, index):
            logger.info("frame %d: begun anew", index)
            self._progress.forget_way()
            return self._record.keep(
                timestamp, Status.DEGRADED, ANEW, np.eye(4), -1, is_keyframe=True, seen=seen
            )
        return self._lose_sight(seen, reason, alignment)

    def _rewind(self, timestamp: float) -> None:
        """Begin to count anew where a clock has jumped back, as a recording that starts over."""
        if self._course.rewind(timestamp):
            self._doubt.rewind()
            self._earlier.forget()
            self._recovery.rewind(timestamp)
            self._standing.forget()
            self._instants.interrupt()
            self._progress.forget_way()

    def _hold(self, timestamp: float) -> TrackedFrame:
        """Stay at the last pose while an image repeats, but not for long: the camera may move."""
        age = self._freeze.age(timestamp, SHORTEST_PERIOD_S, NOMINAL_PERIOD_S)
        keyframe, reason = self._course.keyframe, "the same image as before"
        if age > FREEZE_S:
            reason = f"the same image for {age:.2f} s: the stream is frozen"
        elif keyframe is None or self._record.last_kept < self._fresh:
            reason += ", which had no pose"
        else:
            T_key_cur = self._course.T_key_last
            return self._record.keep(timestamp, Status.DEGRADED, reason, T_key_cur, keyframe.index)
        return self._lose(timestamp, reason)

    def _check_frame(self, frame: Frame) -> None:
        if not isinstance(frame, Frame):
            kind = type(frame).__name__
            raise FrameError(f"frame is {kind}; give a Frame, as Frame.from_images makes it")
        height, width = frame.grey.shape
        if (width, height) != (self.camera.width, self.camera.height):
            raise FrameError(
                f"frame is {width} x {height}, the camera "
                f"{self.camera.width} x {self.camera.height}; give the camera of these images"
            )

    def _begin(self, seen: Seen) -> TrackedFrame:
        """Take the first usable frame as the first keyframe."""
        keyframe = self._upkeep.make(seen.kept(), self._record.count, None)
        if self.config.motion.search_deg:
            with self._clock("keyframe"):
                keyframe.chamfer.prepare()  # as the next frame will ask for it
        self._course.last_time = timestamp = seen.frame.timestamp
        self._standing.remember(seen)
        self._doubt.begin(seen)
        return self._record.keep(
            timestamp, Status.TRACKED, "", np.eye(4), -1, is_keyframe=True, seen=seen
        )

    def _accept(self, placed: Placed, found: Found | None = None) -> TrackedFrame:
        """Move on to where a frame was placed, learn from it, and see to the keyframe."""
        course, doubt, timestamp = self._course, self._doubt, placed.seen.frame.timestamp
        key, seen, alignment = course.key, placed.seen, placed.alignment
        is_whole = placed.still is None
        # of a camera that is found again nobody has asked whether it carries anything
        has_time = found is not None or not self._parting.is_trying
        step = self._progress.step(placed, found)
        doubt.mind_leap(timestamp, is_proven=found is not None)
        if step.follows and is_whole and placed.status is Status.DEGRADED:
            doubt.mind_torn(alignment, timestamp)
        self._recovery.note()
        status, reason = placed.status, placed.reason
        if status is Status.TRACKED and doubt.lasts(timestamp):
            status, reason = Status.DEGRADED, doubt.reason
        doubted = not doubt.is_sure or doubt.is_way_loose(timestamp - step.period)
        doubt.is_sure = status is Status.TRACKED
        self._progress.learn(placed, step, has_time=has_time)
        degenerate = tuple(describe(way) for way in step.loose)
        if not degenerate:  # else it may still be off along those
            self._regain_place(timestamp)
        course.last_time = timestamp
        self._standing.remember(seen)
        self._progress.learn_carried(placed)
        if status is Status.TRACKED:
            reason = self._reservation(timestamp, degenerate)
            status = Status.DEGRADED if reason else Status.TRACKED
        share = alignment.inliers / len(step.registered.samples)
        is_good = status is Status.TRACKED or reason == ANEW
        if is_good and not seen.is_stale:
            self._upkeep.note_good(seen.frame, self._record.count, share)
        tells_more = is_whole and self._tells_more(seen, alignment, step.loose)
        T_key_cur, is_keyframe = self._upkeep.attend(
            seen,
            self._record.count,
            share,
            step.covariance,
            step.period,
            step.velocity,
            is_whole=is_whole,
            is_tracked=status is Status.TRACKED,
            tells_more=tells_more,
            has_time=has_time,
        )
        if is_keyframe:
            if step.follows:
                doubt.mind_start(alignment, timestamp)
            if self._progress.is_adrift or (degenerate and doubted and not step.is_held):
                doubt.cast_on_way(timestamp)
            if self._progress.is_adrift or tells_more:
                self._earlier.leave(timestamp)
        return self._record.keep(
            timestamp,
            status,
            reason,
            T_key_cur,
            key.index,
            is_keyframe=is_keyframe,
            seen=step.registered,
            alignment=alignment,
            covariance=step.told,
            degenerate=degenerate,
        )

    def _regain_place(self, timestamp: float) -> None:
        """Know by itself again where it is, if depth alone had let it drift."""
        course = self._course
        if course.anchor is not None and course.unseen(timestamp) > LONG_LOST_S:
            self._doubt.cast(timestamp, ASTRAY)
        course.anchor = None

    def _reservation(self, timestamp: float, degenerate: tuple[str, ...]) -> str:
        """Say why a pose that fits as it should is not to be trusted; empty where it is."""
        if degenerate:
            return f"not constrained: {', '.join(degenerate)}"
        if self._doubt.lasts(timestamp):
            return self._doubt.reason
        if self._doubt.is_way_loose(timestamp):
            return self._doubt.way_reason
        return ANEW if self._pieces.here else ""

    def _tells_more(self, seen: Seen, alignment: Alignment, motions: NDArray[np.float64]) -> bool:
        """Whether its edges, out of the keyframe's view, tell what its registration does not."""
        rule, evidence = self.config.keyframes, self._uncertainty.evidence
        if rule.rule != "motion" or not rule.tells_times or not len(motions):
            return False
        edges = self._course.key.edges_for(near=seen.is_near).edges
        if evidence.amiss(edges, seen.samples, alignment) is not None:
            return False  # edges in its view, but nowhere, say that the pose is off
        return evidence.would_tell(seen.samples, alignment, motions, rule.tells_times)

    def _lose_sight(self, seen: Seen, reason: str, alignment: Alignment | None) -> TrackedFrame:
        """Lose a frame whose edges are known."""
        return self._lose(seen.frame.timestamp, reason, seen, alignment)

    def _lose(
        self,
        timestamp: float,
        reason: str,
        seen: Seen | None = None,
        alignment: Alignment | None = None,
    ) -> TrackedFrame:
        """Leave the state as it was, so that the next frame tries again from the keyframe."""
        self._instants.interrupt()
        self._doubt.note_loss(leapt=reason.startswith(LEAPT))
        self._recovery.note_lost(seen)
        if not self._course.losses:
            self._upkeep.store_last_good(self._record.count)
        lost = self._record.lose(timestamp, reason, seen, alignment)
        self._upkeep.return_to_bare()
        return lost

    def _detail(self, timestamp: float) -> Detail:
        """How much to take from a frame: the usual where places, or what moves, are told apart."""
        course = self._course
        apart = course.anchor is not None or self._pieces.here
        if apart or self._standing.is_moving(timestamp) or not course.follows(timestamp):
            return usual_detail(self.config)
        faint = course.keyframe is not None and course.keyframe.is_faint
        if course.is_blind:  # faint edges may be all that there are
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
        course, depth = self._course, self._instants.depth
        period = course.period(frame.timestamp)
        if not course.follows(frame.timestamp):
            return None
        if course.is_blind and depth.share(frame.depth_delay, period) > FED_BACK:
            return None
        return depth.motion(course.velocity, frame.depth_delay)
