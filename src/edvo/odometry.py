"""The main loop: one frame in, one pose out (§III-§V)."""

import enum
import logging
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.clock import Clock, StageClock, no_clock
from edvo.config import Config
from edvo.edges import EdgeBuffers, EdgeImage, EdgePixels, extract_edges
from edvo.errors import FrameError, TrajectoryError
from edvo.frame import Frame
from edvo.keyframes import Keyframe, is_due
from edvo.planes import PlaneFitter, PlanePoints
from edvo.registration import Alignment, Registration
from edvo.sampling import sample_edges
from edvo.trajectory import Trajectory

__all__ = ["Odometry", "StageClock", "Status", "TrackedFrame"]

logger = logging.getLogger(__name__)

SEED_STRIDE = 1_000_003  # frames that seeds keep apart
LONGEST_PREDICTION_S = 0.2  # beyond it a constant velocity says nothing about a hand
SHORTEST_PERIOD_S = 1e-3  # closer stamps are no more than a clock's jitter
SEARCH_STRIDE = 4  # a search far afield takes one sample in so many
AGREEING_SIGMA = 3.0  # times the sensor's noise, at which depth agrees half
NOMINAL_PERIOD_S = 1 / 30  # stands in where stamps repeat, all but repeat, or go back


class Status(enum.Enum):
    """How far a pose is to be trusted."""

    TRACKED = "tracked"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """The pose of one frame and its evidence.

    Attributes
    ----------
    timestamp : float
        Seconds, as the frame gave it.
    index : int
        Number of the frame since the last reset, from 0.
    status : Status
    reason : str
        Why it is not ``TRACKED``; empty where it is.
    T_world_cam : ndarray of float64, shape (4, 4)
        Maps points from the camera to the world, which is the first camera. Only predicted
        where the status is ``LOST``.
    T_key_cur : ndarray of float64, shape (4, 4)
        Maps points from the camera to that of the keyframe it was registered with.
    keyframe : int
        Index of that keyframe; -1 where there is none yet.
    is_keyframe : bool
        Whether this frame has become the keyframe of those that follow.
    edges : int
        Edge pixels found.
    samples : int
        Edge pixels with depth that were drawn.
    alignment : Alignment or None
        The registration; None where there was none.
    """

    timestamp: float
    index: int
    status: Status
    reason: str
    T_world_cam: NDArray[np.float64]
    T_key_cur: NDArray[np.float64]
    keyframe: int
    is_keyframe: bool
    edges: int
    samples: int
    alignment: Alignment | None


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
        self._buffers = EdgeBuffers(camera.height, camera.width)
        self._registration = Registration(
            camera,
            self.config.matching,
            self.config.registration,
            inlier_px=self.config.status.inlier_px,
            start_stride=self.config.motion.prior_stride,
        )
        self._fitter = PlaneFitter(camera, self.config.planes)
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
        self._T_world_last = start  # of the last frame that was not lost
        self._T_key_last = np.eye(4)
        self._velocity = np.zeros(6)  # of the camera, in its own frame, 1/s
        self._last_time: float | None = None
        self._lost = False
        self._count = 0
        self._timestamps: list[float] = []
        self._poses: list[NDArray[np.float64]] = []

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames tracked so far, by time, without those that were lost.

        Of frames with the same stamp it holds the first.
        """
        times, first = np.unique(self._timestamps, return_index=True)
        return Trajectory.from_poses(times.tolist(), [self._poses[i] for i in first])

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
            and the next one is registered with the same keyframe again.

        Raises
        ------
        FrameError
            If the frame is not of the camera's size.
        """
        self._check_size(frame)
        config, clock = self.config, self._clock
        with clock("edges"):
            edges = extract_edges(frame.grey, config.edges, self._buffers)
        with clock("sampling"):
            seed = config.seed * SEED_STRIDE + self._count
            samples = sample_edges(
                edges, frame.depth, self.camera, config.sampling, config.edges, seed
            )
        if len(samples) < config.registration.min_matches:
            reason = f"{len(samples)} edges with depth; {config.registration.min_matches} needed"
            return self._lose(frame.timestamp, reason, len(edges), len(samples), None)
        if self._keyframe is None:
            return self._begin(frame, edges, samples)
        with clock("planes"):
            points = self._fitter.points(frame.depth)
        with clock("registration"):
            alignment = self._register(samples, points, self._starts(frame.timestamp))
        status, reason = self._judge(alignment, frame.timestamp)
        if status is not Status.TRACKED and config.motion.search_deg:
            with clock("search"):
                starts = self._search(samples, points, alignment)
                alignment = self._register(samples, points, starts)
            status, reason = self._judge(alignment, frame.timestamp)
        if status is Status.LOST:
            return self._lose(frame.timestamp, reason, len(edges), len(samples), alignment)
        return self._accept(frame, status, reason, edges, samples, alignment)

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
        return self._lose(timestamp, reason, 0, 0, None)

    def _register(
        self, samples: EdgePixels, points: PlanePoints, starts: NDArray[np.float64]
    ) -> Alignment:
        """Register with the keyframe."""
        assert self._keyframe is not None
        key = self._keyframe
        return self._registration.align(
            key.edges, samples, starts, key.planes, points, self._fitter.term
        )

    def _search(
        self, samples: EdgePixels, points: PlanePoints, found: Alignment
    ) -> NDArray[np.float64]:
        """Look farther afield, with few samples, for where both edges and depth agree best.

        A hand turns a camera faster than it carries it, so what an image moves by is mostly yaw
        and pitch.
        """
        few = samples.every(SEARCH_STRIDE)
        angle = math.radians(self.config.motion.search_deg)
        best, most = found.T_ref_cur, _agreement(found, points)
        for yaw in (-2, -1, 0, 1, 2):
            for pitch in (-1, 0, 1):
                turn = se3.exp(np.array([0.0, 0.0, 0.0, pitch * angle, yaw * angle, 0.0]))
                tried = self._register(few, points, (turn @ self._T_key_last)[None])
                agreement = _agreement(tried, points)
                if agreement > most:
                    best, most = tried.T_ref_cur, agreement
        return best[None]

    def _check_size(self, frame: Frame) -> None:
        height, width = frame.grey.shape
        if (width, height) != (self.camera.width, self.camera.height):
            raise FrameError(
                f"frame is {width} x {height}, the camera "
                f"{self.camera.width} x {self.camera.height}; give the camera of these images"
            )

    def _begin(self, frame: Frame, edges: EdgeImage, samples: EdgePixels) -> TrackedFrame:
        """Take the first usable frame as the first keyframe."""
        self._set_keyframe(edges, frame)
        return self._keep(
            frame.timestamp, Status.TRACKED, "", np.eye(4), -1, True, edges, samples, None
        )

    def _accept(
        self,
        frame: Frame,
        status: Status,
        reason: str,
        edges: EdgeImage,
        samples: EdgePixels,
        alignment: Alignment,
    ) -> TrackedFrame:
        """Move on to the pose found, and to a new keyframe where one is due."""
        assert self._keyframe is not None
        keyframe, T_key_cur = self._keyframe, alignment.T_ref_cur
        period = self._period(frame.timestamp)
        self._velocity = se3.log(se3.inverse(self._T_key_last) @ T_key_cur) / period
        self._T_key_last = T_key_cur
        self._T_world_last = keyframe.T_world_key @ T_key_cur
        share = alignment.inliers / len(samples)
        due = is_due(self.config.keyframes, T_key_cur, share, self._count - keyframe.index)
        if due:
            self._set_keyframe(edges, frame)
        index, timestamp = keyframe.index, frame.timestamp
        return self._keep(
            timestamp, status, reason, T_key_cur, index, due, edges, samples, alignment
        )

    def _keep(
        self,
        timestamp: float,
        status: Status,
        reason: str,
        T_key_cur: NDArray[np.float64],
        keyframe: int,
        is_keyframe: bool,
        edges: EdgeImage,
        samples: EdgePixels,
        alignment: Alignment | None,
    ) -> TrackedFrame:
        if self._lost:
            logger.info("frame %d: found again", self._count)
        self._lost = False
        self._last_time = timestamp
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
            edges=len(edges),
            samples=len(samples),
            alignment=alignment,
        )

    def _lose(
        self, timestamp: float, reason: str, edges: int, samples: int, alignment: Alignment | None
    ) -> TrackedFrame:
        """Leave the state as it was, so that the next frame tries again from the keyframe."""
        log = logger.debug if self._lost else logger.warning
        log("frame %d lost: %s", self._count, reason)
        self._lost = True
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
            edges=edges,
            samples=samples,
            alignment=alignment,
        )

    def _set_keyframe(self, edges: EdgeImage, frame: Frame) -> None:
        with self._clock("keyframe"):
            index = self._registration.index(edges.describe(self.camera))
            T_world_key = _rigid(self._T_world_last)
            planes = self._fitter.planes(frame.depth)
            self._keyframe = Keyframe(self._count, T_world_key, index, planes)
            self._T_key_last = np.eye(4)
        logger.debug("frame %d is a keyframe with %d edges", self._count, len(edges))

    def _period(self, timestamp: float) -> float:
        """Seconds since the last frame that was not lost; the usual where stamps make no sense."""
        if self._last_time is None or timestamp - self._last_time < SHORTEST_PERIOD_S:
            return NOMINAL_PERIOD_S
        return timestamp - self._last_time

    def _ahead(self, timestamp: float) -> NDArray[np.float64]:
        """Motion since the last pose, at constant velocity."""
        return se3.exp(self._velocity * min(self._period(timestamp), LONGEST_PREDICTION_S))

    def _starts(self, timestamp: float) -> NDArray[np.float64]:
        """Poses to start from, relative to the keyframe."""
        still = self._T_key_last
        starts = [still]
        if self.config.motion.prior == "constant-velocity":
            starts.insert(0, still @ self._ahead(timestamp))
        if self._lost:
            starts.append(np.eye(4))  # the camera may have come back to where the keyframe was
        return np.array(starts)

    def _judge(self, alignment: Alignment, timestamp: float) -> tuple[Status, str]:
        """Say how far a registration is to be trusted, and why not further."""
        if alignment.reason in FAILURES:
            return Status.LOST, alignment.reason
        status, motion = self.config.status, self.config.motion
        share = alignment.inliers / len(alignment.matches)
        if share < status.min_inliers:
            return Status.LOST, f"only {share:.0%} of the samples fit"
        T_last_cur = se3.inverse(self._T_key_last) @ alignment.T_ref_cur
        period = self._period(timestamp)
        speed = math.hypot(*T_last_cur[:3, 3].tolist()) / period
        turn = math.degrees(se3.rotation_angle(T_last_cur)) / period
        if speed > motion.max_speed_m_s or turn > motion.max_turn_deg_s:
            return Status.LOST, f"implausible jump: {speed:.1f} m/s, {turn:.0f} deg/s"
        doubt = ""
        if not alignment.converged:
            doubt = alignment.reason
        elif share < status.doubt_inliers:
            doubt = f"only {share:.0%} of the samples fit"
        if doubt and alignment.depth_balance and alignment.sigma_depth > status.max_depth_sigma:
            return Status.LOST, f"{doubt}, and depth contradicts the edges"
        return (Status.DEGRADED, doubt) if doubt else (Status.TRACKED, "")


def _agreement(alignment: Alignment, points: PlanePoints) -> float:
    """Say how well a registration fits, from 0 to 1: the edges' share, times that of depth."""
    if alignment.reason in FAILURES:
        return 0.0
    edges = alignment.inliers / len(alignment.matches)
    if not len(points.sigma):
        return edges
    near = alignment.plane_points / len(points.sigma)
    return edges * near / (1 + alignment.sigma_depth / AGREEING_SIGMA)


FAILURES = ("too few matches", "edges do not constrain the motion")


def _checked(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Copy of a pose that came from outside, or an error."""
    T = np.asarray(T, np.float64)
    if T.shape == (4, 4) and np.isfinite(T).all():
        R = T[:3, :3]
        rigid = np.abs(R @ R.T - np.eye(3)).max() < 1e-3 and np.linalg.det(R) > 0
        if rigid and (T[3] == (0, 0, 0, 1)).all():
            return _rigid(T)
    raise TrajectoryError(
        f"T_world_cam is no rigid motion: {T.shape} {T.ravel().tolist()!s:.60}; give a 4 x 4 "
        "matrix of a rotation and a translation"
    )


def _rigid(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Copy with an exact rotation: products drift off the group, and predictions amplify that."""
    result = np.array(T, np.float64)
    kernels.orthonormalize(result)
    return result
