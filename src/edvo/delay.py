"""When depth images are taken, as against their colour images, and how to make up for it.

Not in the paper. The two cameras of a sensor hardly ever take their images at once: a Kinect's
run freely, and what lies between the instants is not all in the stamps. While the camera moves,
depth then is that of another view, some pixels off at every contour. But how residuals of depth
change with the camera's velocity tells by how much the instants differ, and with that its motion
in between is known.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.kernels import Lag
from edvo.measuring import SHARED, Changes, Equations, Estimate, Moment
from edvo.planes import PlaneFitter, camera_of, move_points
from edvo.registration import AS_ONE, AT_ONCE
from edvo.seen import Seen
from edvo.slack import LEAST

EXPECTED_S = 0.01  # how large a delay is beyond the stamps, before anything is known (one sigma)
LARGEST_S = 0.05  # stamps further apart are those of two clocks
LEAST_S = 5e-4  # that matters
# Of the time since the last frame. Older, depth lies nearer to the last frame than to its image,
# and what that one was off by would come back larger, with its sign turned, from frame to frame.
# What is beyond moves at the velocity that was expected, which errs less: (1 + share)^2 < -share.
LEAST_SHARE = -0.38


class DepthDelay:
    """Measures by what the delay of depth differs from that of its stamps, frame after frame.

    Parameters
    ----------
    camera : Camera
        Of the images.
    fitter : PlaneFitter
    rule, slack : str
        See ``MotionConfig.depth_delay`` and ``depth_slack``.

    Attributes
    ----------
    estimate : Estimate
        Of the rest, seconds.
    """

    def __init__(self, camera: Camera, fitter: PlaneFitter, rule: str, slack: str = "none") -> None:
        self._pinhole, self._fitter = camera_of(camera), fitter
        self._gives = slack != "none"
        self._is_on = rule != "none" and fitter.is_on
        self.estimate = Estimate(EXPECTED_S, wanted=rule == "measured" and fitter.is_on)
        self.forget()

    def forget(self) -> None:
        """Believe the stamps, until there is evidence to the contrary."""
        self.estimate.forget()
        self._changes = Changes()

    @property
    def seconds(self) -> float:
        """What is to be added to the delay that stamps tell."""
        return self.estimate.value

    def motion(self, velocity: NDArray[np.float64], stamped: float) -> NDArray[np.float64] | None:
        """Say where the camera was when a depth image was taken.

        Parameters
        ----------
        velocity : ndarray of float64, shape (6,)
            Of the camera, [v, w] in its own frame, 1/s.
        stamped : float
            From the image to its depth by their stamps, seconds.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            Maps points of the depth image to the camera at the instant of the grey image; None
            where it has hardly moved.
        """
        twist = velocity * self.of(stamped)
        if np.abs(twist).max() < LEAST:
            return None
        return se3.exp(twist)

    def of(self, stamped: float) -> float:
        """Say how long after its image depth was taken.

        Parameters
        ----------
        stamped : float
            The same by their stamps, seconds.

        Returns
        -------
        float
            Seconds.
        """
        if not self._is_on:
            return 0.0
        return min(max(credible(stamped) + self.seconds, -LARGEST_S), LARGEST_S)

    def at_most(self, seen: Seen) -> float:
        """Say by how much the instants of an image and of its depth may differ.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        float
            Seconds, with what is not known of it (one sigma); 0 where it makes no difference.
        """
        if not self.matters(seen):
            return 0.0
        doubt = math.sqrt(self.estimate.variance) if self.estimate.wanted else 0.0
        return abs(self.of(seen.frame.depth_delay)) + doubt

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
        delay = self.of(seen.frame.depth_delay)
        if abs(delay) < LEAST_S or seen.is_stale:
            return AT_ONCE
        share = delay / period
        follows = max(share, LEAST_SHARE)
        expected = np.zeros(6) if seen.T_cam_depth is None else se3.log(seen.T_cam_depth)
        T_depth_cam = se3.exp(-expected * follows / share)
        return AT_ONCE._replace(share=follows, T_ref_last=T_key_last, T_depth_cam=T_depth_cam)

    def bend(self, lag: Lag, seen: Seen, period: float) -> float:
        """Say what depth is off by, of how an acceleration moves the camera in a period.

        Parameters
        ----------
        lag : Lag
            See `lag`.
        seen : Seen
        period : float
            Seconds since the last frame.

        Returns
        -------
        float
            See `edvo.slack.bend_of`; and all of that share which is moved by what was expected.
        """
        if not self._gives or lag.share == 0:
            return 0.0
        share = self.share(seen.frame.depth_delay, period)
        return share * share / 2 + share - lag.share / 2

    def share(self, stamped: float, period: float) -> float:
        """Say when depth was taken after its image.

        Parameters
        ----------
        stamped : float
            From the image to its depth by their stamps, seconds.
        period : float
            Seconds since the last frame.

        Returns
        -------
        float
            As a share of these.
        """
        return self.of(stamped) / period

    def matters(self, seen: Seen) -> bool:
        """Say whether depth was not taken at the instant of its image.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        bool
        """
        return seen.T_cam_depth is not None or abs(self.of(seen.frame.depth_delay)) >= LEAST_S

    def settled(
        self,
        seen: Seen,
        velocity: NDArray[np.float64],
        T_cam_points: NDArray[np.float64] | None = None,
    ) -> Seen:
        """Move depth by what the camera has moved by, no longer by what was expected.

        Parameters
        ----------
        seen : Seen
        velocity : ndarray of float64, shape (6,)
            Of the camera since the last frame, 1/s.
        T_cam_points : ndarray of float64, shape (4, 4), optional
            Where points were found instead; see `Alignment`.

        Returns
        -------
        Seen
            Its samples have the depth they had.
        """
        T_cam_depth = self.motion(velocity, seen.frame.depth_delay)
        if T_cam_points is not None:
            T_cam_depth = T_cam_points
            if seen.T_cam_depth is not None:
                T_cam_depth = T_cam_points @ seen.T_cam_depth
        if T_cam_depth is None and seen.T_cam_depth is None:
            return seen
        now, then = (np.eye(4) if T is None else T for T in (T_cam_depth, seen.T_cam_depth))
        points = move_points(seen.points, now @ se3.inverse(then))
        return replace(seen, points=points, T_cam_depth=T_cam_depth)

    def learn(self, moment: Moment) -> None:
        """Compare how depth's misfit changes with how the velocity does.

        Parameters
        ----------
        moment : Moment
            A frame that is to be trusted.
        """
        alignment, seen = moment.alignment, moment.seen
        if not self.estimate.wanted or not alignment.depth_balance or seen.is_stale:
            return
        T = alignment.T_ref_cur
        as_stamped = se3.exp(moment.velocity * credible(seen.frame.depth_delay))
        if seen.T_cam_depth is not None:
            as_stamped = as_stamped @ se3.inverse(seen.T_cam_depth)
        H, b = self._equations(moment)
        to_reference = se3.adjoint(T)
        twists = np.array([moment.velocity, se3.log(as_stamped)]) @ to_reference.T
        # linear: beside the scale of what is left, depth as it was would be outliers
        gradient = b + H @ twists[1]
        lag = alignment.lag
        if lag.bend:  # of late or early depth a hand's acceleration tells as well
            P = SHARED / AS_ONE * (alignment.sigma_px / lag.bend) ** 2 * lag.steady
            G = np.linalg.solve(H + P, P).T
            H, gradient = G @ H, G @ gradient
        change = self._changes.of(H, twists, gradient, moment.keyframe, moment.period)
        if change is None:
            return
        moves = 1 + alignment.lag.share  # depth, as the pose does
        velocity, unmade = change.twists @ H
        told = Equations(
            float(change.whole @ velocity),
            float(change.whole @ change.gradient),
            moves * velocity,
            moves * unmade,
        )
        self.estimate.learn(told, alignment, moment.period)

    def _equations(self, moment: Moment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Curvature and gradient of the term of depth in px^2."""
        alignment = moment.alignment
        H, b = np.empty((6, 6)), np.empty(6)
        kernels.depth_equations(
            moment.keyframe.planes,
            moment.seen.points,
            self._pinhole,
            alignment.T_ref_cur,
            self._fitter.term,
            alignment.sigma_depth,
            alignment.depth_balance * (alignment.sigma_px / alignment.sigma_depth) ** 2,
            H,
            b,
        )
        return H, b


def credible(stamped: float) -> float:
    """Give the delay that stamps tell, where they make sense.

    Parameters
    ----------
    stamped : float
        From an image to its depth by their stamps, seconds.

    Returns
    -------
    float
        0 where that is so long that they are those of two clocks.
    """
    return stamped if abs(stamped) <= LARGEST_S else 0.0
