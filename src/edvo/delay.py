"""When depth images are taken, as against their colour images, and how to make up for it.

Not in the paper. The two cameras of a sensor hardly ever take their images at once: a Kinect's
run freely, and what lies between the instants is not all in the stamps. While the camera moves,
depth then is that of another view, some pixels off at every contour. But how residuals of depth
change with the camera's velocity tells by how much the instants differ, and with that its motion
in between is known.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.frame import Frame
from edvo.kernels import Lag
from edvo.keyframes import Keyframe
from edvo.planes import PlaneFitter, PlanePoints, camera_of, move_points
from edvo.registration import AT_ONCE, Alignment
from edvo.search import Seen

MEMORY_S = 5.0  # that the delay is taken from: clocks wander
EXPECTED_S = 0.01  # how large it is beyond the stamps, before anything is known (one sigma)
SHARED = 100.0  # points of a depth image that err together: so many count as one
LARGEST_S = 0.05  # stamps further apart are those of two clocks
GATE = 3.0  # sigmas, that a frame may be off by
LONGEST_S = 0.2  # between frames, for the velocity to be known
LEAST_S = 5e-4  # that matters
LEAST = 2e-4  # m and rad: a tenth of a pixel
NEWS = 1e-3  # m and rad, by which a keyframe's depth must be off to be fitted anew
SETTLING_S = 1.0  # that depth's misfit is averaged over, which its changes are taken from


@dataclass(frozen=True, slots=True)
class _Noted:
    """A frame whose velocity is known once the next one is there."""

    keyframe: Keyframe
    depth_delay: float
    points: PlanePoints
    alignment: Alignment
    T_cam_depth: NDArray[np.float64] | None
    period: float
    moves: float  # by how much depth moved with the pose


@dataclass(slots=True)
class _Held:
    """A keyframe, what it was made of, and what its planes were moved by."""

    keyframe: Keyframe
    frame: Frame
    T_cam_depth: NDArray[np.float64] | None
    velocity: NDArray[np.float64] | None


class DepthDelay:
    """Measures by what the delay of depth differs from that of its stamps, frame after frame.

    Parameters
    ----------
    camera : Camera
        Of the images.
    fitter : PlaneFitter
    rule : str
        See ``MotionConfig.depth_delay``.
    """

    def __init__(self, camera: Camera, fitter: PlaneFitter, rule: str) -> None:
        self._pinhole, self._fitter = camera_of(camera), fitter
        self._is_on = rule != "none" and fitter.is_on
        self._is_measured = rule == "measured" and fitter.is_on
        self.forget()

    def forget(self) -> None:
        """Believe the stamps, until there is evidence to the contrary."""
        self._information, self._sum = 0.0, 0.0
        self._held: _Held | None = None
        self._interrupt()

    def _interrupt(self) -> None:
        self._noted: _Noted | None = None
        self._T_before: NDArray[np.float64] | None = None  # of the frame before that
        self._keyframe: Keyframe | None = None
        self._mean: NDArray[np.float64] | None = None
        self._age = 0.0

    @property
    def seconds(self) -> float:
        """What is to be added to the delay that stamps tell."""
        return self._sum / (self._information + 1 / EXPECTED_S**2)

    def motion(self, velocity: NDArray[np.float64], frame: Frame) -> NDArray[np.float64] | None:
        """Say where the camera was when a depth image was taken.

        Parameters
        ----------
        velocity : ndarray of float64, shape (6,)
            Of the camera, [v, w] in its own frame, 1/s.
        frame : Frame
            With the depth image.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            Maps points of the depth image to the camera at the instant of the grey image; None
            where it has hardly moved.
        """
        twist = velocity * self._of(frame)
        if np.abs(twist).max() < LEAST:
            return None
        return se3.exp(twist)

    def _of(self, frame: Frame) -> float:
        """From the instant of the image to that of depth, seconds."""
        if not self._is_on:
            return 0.0
        return min(max(_stamped(frame) + self.seconds, -LARGEST_S), LARGEST_S)

    def lag(self, seen: Seen, T_key_last: NDArray[np.float64], period: float) -> Lag:
        """Say when depth was taken, for a registration to move it along with the pose.

        Parameters
        ----------
        seen : Seen
        T_key_last : ndarray of float64, shape (4, 4)
            Where the camera was at the last frame.
        period : float
            Seconds since then.

        Returns
        -------
        Lag
        """
        delay = self._of(seen.frame)
        if abs(delay) < LEAST_S:
            return AT_ONCE
        T = np.eye(4) if seen.T_cam_depth is None else se3.inverse(seen.T_cam_depth)
        return Lag(max(delay / period, -1.0), T_key_last, T)

    def settled(self, seen: Seen, T_last_cur: NDArray[np.float64], period: float) -> Seen:
        """Move depth by what the camera has moved by, no longer by what was expected.

        Parameters
        ----------
        seen : Seen
        T_last_cur : ndarray of float64, shape (4, 4)
            What it has moved by since the last frame.
        period : float
            Seconds that this took.

        Returns
        -------
        Seen
            Its samples have the depth they had.
        """
        T_cam_depth = self.motion(se3.log(T_last_cur) / period, seen.frame)
        if T_cam_depth is None and seen.T_cam_depth is None:
            return seen
        now, then = (np.eye(4) if T is None else T for T in (T_cam_depth, seen.T_cam_depth))
        points = move_points(seen.points, now @ se3.inverse(then))
        return replace(seen, points=points, T_cam_depth=T_cam_depth)

    def hold(self, keyframe: Keyframe, seen: Seen, velocity: NDArray[np.float64] | None) -> None:
        """Remember what a keyframe was made of, to move its depth once more is known.

        Parameters
        ----------
        keyframe : Keyframe
        seen : Seen
            What it was made of.
        velocity : ndarray of float64, shape (6,), or None
            Of the camera then; None where that of the next frame has to do.
        """
        self._held = _Held(keyframe, seen.frame, seen.T_cam_depth, velocity)

    def renewed(self, keyframe: Keyframe, velocity: NDArray[np.float64]) -> Keyframe | None:
        """Fit the planes of a keyframe anew, if its depth was taken elsewhere than was thought.

        Parameters
        ----------
        keyframe : Keyframe
            That a frame was registered with.
        velocity : ndarray of float64, shape (6,)
            Of the camera at the frame.

        Returns
        -------
        Keyframe or None
            None if it is as good as before.
        """
        held = self._held
        if held is None or held.keyframe is not keyframe:
            return None
        if held.velocity is None:
            held.velocity = velocity
        T_cam_depth = self.motion(held.velocity, held.frame)
        now, then = (np.eye(4) if T is None else T for T in (T_cam_depth, held.T_cam_depth))
        if np.abs(se3.log(se3.inverse(then) @ now)).max() < NEWS:
            return None
        held.T_cam_depth = T_cam_depth
        held.keyframe = replace(keyframe, planes=self._fitter.planes(held.frame.depth, T_cam_depth))
        return held.keyframe

    def note(
        self,
        keyframe: Keyframe,
        seen: Seen,
        alignment: Alignment,
        period: float,
    ) -> None:
        """Take the residuals of a frame into account, once the next one is there.

        Parameters
        ----------
        keyframe : Keyframe
            That it was registered with.
        seen : Seen
            The frame.
        alignment : Alignment
            What the registration found.
        period : float
            Seconds since the frame before it.
        """
        if not self._is_measured:
            return
        last, self._noted = self._noted, None
        if not alignment.depth_balance or period > LONGEST_S:
            self._interrupt()
            return
        if last is not None and last.keyframe is keyframe:
            if self._T_before is not None:
                T_before_next = se3.inverse(self._T_before) @ alignment.T_ref_cur
                # of both steps, so that an error of the pose between them is none of the velocity
                self._learn(last, se3.log(T_before_next) / (last.period + period), period)
            self._T_before = last.alignment.T_ref_cur
        else:
            self._T_before = None
        delay = _stamped(seen.frame)
        moves = 1 + max(self._of(seen.frame) / period, -1.0)
        self._noted = _Noted(
            keyframe, delay, seen.points, alignment, seen.T_cam_depth, period, moves
        )

    def _learn(self, noted: _Noted, velocity: NDArray[np.float64], period: float) -> None:
        """Compare how depth's misfit changes with how the velocity does."""
        T, sigma = noted.alignment.T_ref_cur, noted.alignment.sigma_px
        as_stamped = T @ se3.exp(velocity * noted.depth_delay)
        if noted.T_cam_depth is not None:
            as_stamped = as_stamped @ se3.inverse(noted.T_cam_depth)
        H_planes, b_used = self._equations(noted, T)
        _, b_stamped = self._equations(noted, as_stamped)
        now = np.array([se3.adjoint(T) @ velocity, b_stamped, noted.moves * b_used])
        if noted.keyframe is not self._keyframe:
            self._keyframe, self._mean, self._age = noted.keyframe, now, 0.0
            return
        assert self._mean is not None
        change, stamped, used = now - self._mean
        self._age += period
        self._mean += (now - self._mean) * max(period / SETTLING_S, period / (period + self._age))
        # What the pose would take up of a delay tells nothing.
        h = H_planes @ change
        taken = np.linalg.solve(noted.alignment.H, h)
        scale = 1 / (SHARED * sigma * sigma)
        information = max(float(change @ h - h @ taken), 0.0) * scale
        gradient = float(change @ stamped - taken @ (stamped - used)) * scale
        # Where edges and depth contradict each other it is not the delay that does it.
        doubt = (gradient + information * self.seconds) ** 2
        if doubt > GATE * GATE * information * (1 + information * EXPECTED_S**2):
            return
        fade = math.exp(-period / MEMORY_S)
        self._information = fade * self._information + information
        self._sum = fade * self._sum - gradient

    def _equations(
        self, noted: _Noted, T: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Curvature and gradient of the term of depth in px^2."""
        alignment, keyframe = noted.alignment, noted.keyframe
        H, b = np.empty((6, 6)), np.empty(6)
        kernels.depth_equations(
            keyframe.planes,
            noted.points,
            self._pinhole,
            T,
            self._fitter.term,
            alignment.sigma_depth,
            alignment.depth_balance * (alignment.sigma_px / alignment.sigma_depth) ** 2,
            H,
            b,
        )
        return H, b


def _stamped(frame: Frame) -> float:
    """The delay that stamps tell, where they make sense."""
    return frame.depth_delay if abs(frame.depth_delay) <= LARGEST_S else 0.0
