"""A tracker made of anything that registers one frame with another."""

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import MotionConfig
from edvo.course import LONGEST_PREDICTION_S, NOMINAL_PERIOD_S
from edvo.errors import FrameError
from edvo.frame import Frame
from edvo.odometry import Status, TrackedFrame
from edvo.trajectory import Trajectory


class Aligner(Protocol):
    """Registers one frame with another."""

    name: str

    def prepare(self, frame: Frame) -> Any:
        """Make of a frame, without lens distortion, whatever ``align`` takes."""
        ...

    def align(
        self, reference: Any, current: Any, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur``, shape (4, 4), of two prepared frames; None where it fails.

        ``T_ref_guess`` is what it would be at the velocity of the last frame.
        """
        ...


@dataclass(frozen=True, slots=True)
class KeyframeRule:
    """When a frame becomes the one that the next ones are registered with.

    Attributes
    ----------
    max_translation_m : float
        It does once the camera is farther than this from the last keyframe, metres.
    max_rotation_deg : float
        Or turned by more than this, degrees.
    """

    max_translation_m: float = 0.10
    max_rotation_deg: float = 8.0

    def is_due(self, T_key_cur: NDArray[np.float64]) -> bool:
        """Whether that motion since the keyframe is enough for another one."""
        x, y, z = T_key_cur[:3, 3].tolist()
        return (
            math.hypot(x, y, z) > self.max_translation_m
            or math.degrees(se3.rotation_angle(T_key_cur)) > self.max_rotation_deg
        )


FRAME_TO_FRAME = KeyframeRule(-1.0, -1.0)
"""Each frame is registered with the one before it."""


@dataclass(frozen=True, slots=True)
class _Reference:
    index: int
    T_world_ref: NDArray[np.float64]
    prepared: Any


class PairwiseOdometry:
    """Follows a camera by registering each frame with a keyframe.

    A frame is lost by the same rule as in `edvo.Odometry`: where the registration fails or gives
    a motion faster than a hand. It is tried with the keyframe first and then, which
    helps methods that start at no motion at all, with the last frame that was tracked.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; if its lens distorts, they are undistorted first.
    aligner : Aligner
        The method.
    keyframes : KeyframeRule
        0.10 m or 8 degrees by default; `FRAME_TO_FRAME` for none.
    limits : MotionConfig, optional
        Fastest motion that is believed; edvo's own by default.
    """

    def __init__(
        self,
        camera: Camera,
        aligner: Aligner,
        *,
        keyframes: KeyframeRule | None = None,
        limits: MotionConfig | None = None,
    ) -> None:
        self.camera = camera
        self.name = aligner.name
        self._aligner = aligner
        self._rule = keyframes or KeyframeRule()
        self._limits = limits or MotionConfig()
        self.reset()

    def reset(self, T_world_cam: NDArray[np.float64] | None = None) -> None:
        """Forget everything and start anew.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4), optional
            Pose of the next frame; the origin where not given.
        """
        start = np.eye(4) if T_world_cam is None else np.array(T_world_cam, np.float64)
        self._keyframe: _Reference | None = None
        self._last: _Reference | None = None
        self._T_world_last = start
        self._velocity = np.zeros(6)
        self._last_time: float | None = None
        self._count = 0
        self._timestamps: list[float] = []
        self._poses: list[NDArray[np.float64]] = []

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames tracked so far, by time, without those that were lost.

        Of frames with the same stamp it holds the first.
        """
        return Trajectory.from_frames(self._timestamps, self._poses)

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of the next frame.

        Parameters
        ----------
        frame : Frame
            Of the size of the camera.

        Returns
        -------
        TrackedFrame
            Without edges, samples and alignment; ``LOST`` where the registration failed.

        Raises
        ------
        FrameError
            If the frame is not of the camera's size.
        """
        current = self._aligner.prepare(self._undistorted(frame))
        if self._keyframe is None or self._last is None:
            self._keyframe = _Reference(self._count, self._T_world_last, current)
            return self._keep(frame.timestamp, np.eye(4), -1, current)
        tried = [self._keyframe]
        if self._last.index != self._keyframe.index:
            tried.append(self._last)
        reason = ""
        T_world_guess = self._predicted(frame.timestamp)
        for reference in tried:
            T_ref_guess = se3.inverse(reference.T_world_ref) @ T_world_guess
            T_ref_cur = self._aligner.align(reference.prepared, current, T_ref_guess)
            reason = self._problem(reference, T_ref_cur, frame.timestamp)
            if T_ref_cur is not None and not reason:
                return self._accept(frame.timestamp, reference, _rigid(T_ref_cur), current)
        return self.skip(frame.timestamp, reason)

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be had or followed.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str
            For the result.

        Returns
        -------
        TrackedFrame
            ``LOST``, with a predicted pose.
        """
        T_world_cam = self._predicted(timestamp)
        keyframe = -1 if self._keyframe is None else self._keyframe.index
        T_key_cur = (
            np.eye(4)
            if self._keyframe is None
            else se3.inverse(self._keyframe.T_world_ref) @ T_world_cam
        )
        self._count += 1
        return self._result(
            timestamp, Status.LOST, reason, T_world_cam, T_key_cur, keyframe, is_keyframe=False
        )

    def _predicted(self, timestamp: float) -> NDArray[np.float64]:
        ahead = self._velocity * min(self._period(timestamp), LONGEST_PREDICTION_S)
        return self._T_world_last @ se3.exp(ahead)

    def _accept(
        self, timestamp: float, reference: _Reference, T_ref_cur: NDArray[np.float64], current: Any
    ) -> TrackedFrame:
        T_world_cam = reference.T_world_ref @ T_ref_cur
        T_last_cur = se3.inverse(self._T_world_last) @ T_world_cam
        self._velocity = se3.log(T_last_cur) / self._period(timestamp)
        self._T_world_last = T_world_cam
        self._keyframe = reference
        if self._rule.is_due(T_ref_cur):
            self._keyframe = _Reference(self._count, T_world_cam, current)
        return self._keep(timestamp, T_ref_cur, reference.index, current)

    def _keep(
        self, timestamp: float, T_key_cur: NDArray[np.float64], keyframe: int, current: Any
    ) -> TrackedFrame:
        assert self._keyframe is not None
        self._last = _Reference(self._count, self._T_world_last, current)
        self._last_time = timestamp
        self._timestamps.append(timestamp)
        self._poses.append(self._T_world_last)
        is_keyframe = self._keyframe.index == self._count
        self._count += 1
        return self._result(
            timestamp, Status.TRACKED, "", self._T_world_last, T_key_cur, keyframe, is_keyframe
        )

    def _result(
        self,
        timestamp: float,
        status: Status,
        reason: str,
        T_world_cam: NDArray[np.float64],
        T_key_cur: NDArray[np.float64],
        keyframe: int,
        is_keyframe: bool,
    ) -> TrackedFrame:
        return TrackedFrame(
            timestamp=timestamp,
            index=self._count - 1,
            status=status,
            reason=reason,
            T_world_cam=T_world_cam,
            T_key_cur=T_key_cur,
            keyframe=keyframe,
            is_keyframe=is_keyframe,
            edges=0,
            samples=0,
            alignment=None,
        )

    def _problem(
        self, reference: _Reference, T_ref_cur: NDArray[np.float64] | None, timestamp: float
    ) -> str:
        """Say why a registration is not to be believed; nothing where it is."""
        if T_ref_cur is None or not np.isfinite(T_ref_cur).all():
            return "registration failed"
        T_last_cur = se3.inverse(self._T_world_last) @ reference.T_world_ref @ T_ref_cur
        period = self._period(timestamp)
        speed = math.hypot(*T_last_cur[:3, 3].tolist()) / period
        turn = math.degrees(se3.rotation_angle(T_last_cur)) / period
        if speed > self._limits.max_speed_m_s or turn > self._limits.max_turn_deg_s:
            return f"implausible jump: {speed:.1f} m/s, {turn:.0f} deg/s"
        return ""

    def _period(self, timestamp: float) -> float:
        """Seconds since the last frame that was tracked; the usual where stamps make no sense."""
        if self._last_time is None or not timestamp > self._last_time:
            return NOMINAL_PERIOD_S
        return timestamp - self._last_time

    def _undistorted(self, frame: Frame) -> Frame:
        camera = self.camera
        height, width = frame.grey.shape
        if (width, height) != (camera.width, camera.height):
            raise FrameError(
                f"frame is {width} x {height}, the camera {camera.width} x {camera.height}; "
                "give the camera of these images"
            )
        if not camera.is_distorted:
            return frame
        return replace(
            frame,
            grey=camera.undistort_image(frame.grey),
            depth=camera.undistort_depth(frame.depth),
        )


def _rigid(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give the nearest rigid motion: what single precision leaves grows from guess to guess."""
    left, _, right = np.linalg.svd(T[:3, :3])
    rigid = T.copy()
    rigid[:3, :3] = left @ right
    return rigid
