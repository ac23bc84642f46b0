"""To begin anew: when the images of a lost camera fit one another, though no place seen before.

Not in the paper. A camera that was carried on while its lens was covered sees what it has not seen
before. It cannot know where that is, but it can know how it moves from there on. So once each
image fits the one before it for a while, and the search has found no place in that time, a piece
of the path may begin.
"""

import math

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.depth_alone import DepthAlone
from edvo.keyframes import Keyframe
from edvo.planes import PlaneFitter
from edvo.registration import Registration
from edvo.search import Search
from edvo.seen import Seen
from edvo.status import Judge, Status, speed_of

SETTLED_S = 0.5  # for so long images fit one another: the search has looked three times by then
CLOSE_S = 1.0  # images farther apart do not speak for one another
NEAR_S = 0.2  # those farther apart are searched for
REST_S = 0.1  # after an image that did not follow, which takes long to tell


class Chain:
    """Holds each image of a lost camera against the one before it.

    Parameters
    ----------
    registration : Registration
    fitter : PlaneFitter
    depth_alone : DepthAlone
        For images with hardly any edges.
    search : Search
        For frames that are far apart.
    judge : Judge
    """

    def __init__(
        self,
        registration: Registration,
        fitter: PlaneFitter,
        depth_alone: DepthAlone,
        search: Search,
        judge: Judge,
    ) -> None:
        self._registration, self._fitter, self._depth_alone = registration, fitter, depth_alone
        self._search, self._judge = search, judge
        self.forget()

    def forget(self) -> None:
        """Begin to wait anew."""
        self._last: Keyframe | None = None
        self._velocity: NDArray[np.float64] | None = None
        self._since, self._broken = math.inf, -math.inf

    def rests(self, timestamp: float) -> bool:
        """Whether an image has not followed only just now.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        return abs(timestamp - self._broken) < REST_S

    def join(self, seen: Seen, this: Keyframe) -> NDArray[np.float64] | None:
        """Take the next image.

        Parameters
        ----------
        seen : Seen
            The frame, and
        this : Keyframe
            made of it.

        Returns
        -------
        ndarray of float64, shape (6,), or None
            The camera's velocity, in its own frame, 1/s, once images have fitted one another for
            long enough.
        """
        last, self._last = self._last, this
        velocity = None if last is None else self._follows(last, seen)
        self._velocity = velocity
        if velocity is None:
            self._since = this.timestamp
            self._broken = -math.inf if last is None else this.timestamp
        settled = this.timestamp - self._since >= SETTLED_S
        return velocity if settled else None

    def _follows(self, last: Keyframe, seen: Seen) -> NDArray[np.float64] | None:
        """Velocity since an image, if there is no doubt that this one was taken after it."""
        period = seen.frame.timestamp - last.timestamp
        if not 0 < period < CLOSE_S:
            return None
        if self._depth_alone.has_to_tell(seen.samples):
            if period > NEAR_S:
                return None  # nor would depth alone follow it
            found = self._depth_alone.align(last, seen.samples, seen.points, np.eye(4))
            speed = speed_of(found.T_ref_cur, period)
            if self._judge.judge_alone(found, len(seen.points.sigma), *speed):
                return None
            return np.zeros(6)  # a wall does not say how a camera moves along it
        starts = [np.eye(4)]
        if self._velocity is not None and period <= NEAR_S:  # for so long it is kept
            starts.append(se3.exp(self._velocity * period))
        found = self._registration.align(
            last.edges,
            seen.samples,
            np.stack(starts),
            last.planes,
            seen.points,
            self._fitter.term,
        )
        if period > NEAR_S:
            found = self._search.around(last, np.eye(4), seen, found)
        status, _ = self._judge.judge(found, *speed_of(found.T_ref_cur, period))
        return None if status is Status.LOST else se3.log(found.T_ref_cur) / period
