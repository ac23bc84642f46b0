"""How far a pose is to be trusted, and why not further."""

import enum
import math

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.config import Config
from edvo.planes import PlaneMap, PlanePoints
from edvo.registration import FAILURES, Alignment
from edvo.scatter import FEWER, MILD_SIGMA, Scatter, fitting_depth
from edvo.torn import Torn

MILD_PX = 0.5  # of scatter, up to which edges raise no doubt
FIRST_PX = 0.75  # beyond which, if depth is off, too, one of the first is a poor keyframe
FADING = 0.97  # a frame, of the worst fit of depth seen of late
MOST_UNASKED = 2  # frames in a row of the same depth, that what follows is pardoned for
AS_A_WHOLE = 0.7  # of the edges agree: of people who are followed, hardly ever so many
BETTER = 1.25  # times as many samples agree after a frame that a jerk has blurred
TORN = "edges scatter and depth is off the keyframe's, both more than of late"
CHANCE = 0.28  # a quarter of the samples agree by chance where edges are dense


class Status(enum.Enum):
    """How far a pose is to be trusted."""

    TRACKED = "tracked"
    DEGRADED = "degraded"
    LOST = "lost"


class Judge:
    """Judges registrations, and remembers how well edges and depth fitted where all was well.

    Parameters
    ----------
    config : Config
        Its bounds of status and motion.

    Attributes
    ----------
    scatter : Scatter
        How widely edges scatter about their matches.
    torn : Torn
        Whether edges and depth say different things.
    """

    def __init__(self, config: Config) -> None:
        self._status = config.status
        self._motion = config.motion
        self._alone_share = config.planes.alone_share
        self.scatter = Scatter(config)
        self.torn = Torn(config, self.scatter)
        self._usual = math.inf  # the largest sigma_depth of late
        self._unasked = 0  # frames since, whose depth was that of the frame before
        self._agreeing = 1.0  # share of the samples, of the last one

    def note(self, alignment: Alignment, *, is_stale: bool = False) -> None:
        """Take note of a registration that is to be trusted.

        How badly edges and depth fit differs from camera to camera more than it does in time.

        Parameters
        ----------
        alignment : Alignment
        is_stale : bool, optional
            Whether its depth is that of the frame before.
        """
        self.scatter.note(alignment)
        self.torn.note(alignment)
        self._agreeing = alignment.agreeing / len(alignment.matches)
        if is_stale:
            self._unasked = min(self._unasked + 1, MOST_UNASKED)
        elif alignment.depth_balance:
            faded = 0.0 if math.isinf(self._usual) else FADING * self._usual
            self._usual, self._unasked = max(alignment.sigma_depth, faded), 0

    def judge(
        self,
        alignment: Alignment,
        speed: float,
        turn: float,
        *,
        follows: bool = False,
        is_shared: bool = False,
    ) -> tuple[Status, str]:
        """Say how far a registration is to be trusted, and why not further.

        Parameters
        ----------
        alignment : Alignment
        speed : float
            What the camera would have moved by since the last frame, m/s.
        turn : float
            And turned by, degrees a second.
        follows : bool
            Whether it follows closely on the last pose: depth that is as far off as it was there
            contradicts nothing, and fewer edges may fit if enough are in their places.
        is_shared : bool
            Whether those that both images have in view fit, however few these are of all.

        Returns
        -------
        (Status, str)
            The reason is empty where it is ``TRACKED``.
        """
        if alignment.reason in FAILURES:
            return Status.LOST, alignment.reason
        status = self._status
        fitting, agreeing = status.min_inliers, status.min_agreeing
        if follows and self.scatter.is_sharp(alignment):
            fitting, agreeing = min(fitting, agreeing), min(CHANCE, agreeing)
        misfit = _misfit(alignment, fitting, agreeing)
        if misfit and not is_shared:
            return Status.LOST, misfit
        if jump := self.jump(speed, turn):
            return Status.LOST, jump
        doubt = misfit or (self._poor_fit(alignment) if alignment.converged else alignment.reason)
        limit = status.max_depth_sigma
        if follows and not math.isinf(self._usual):
            limit = max(limit, self._usual)
        if doubt and alignment.depth_balance and alignment.sigma_depth > limit:
            return Status.LOST, f"{doubt}, and depth contradicts the edges"
        if not doubt and self.is_off(alignment):
            doubt = self._off(alignment)
        if not doubt and follows and self.torn.is_in_doubt(alignment):
            doubt = TORN
        return (Status.DEGRADED, doubt) if doubt else (Status.TRACKED, "")

    def judge_alone(self, alignment: Alignment, points: int, speed: float, turn: float) -> str:
        """Say why a registration by depth alone is none.

        Parameters
        ----------
        alignment : Alignment
        points : int
            Of the frame.
        speed, turn : float
            See `judge`.

        Returns
        -------
        str
            Empty where its pose may be kept, as that of a degraded frame.
        """
        if alignment.reason in FAILURES:
            return "hardly a plane in its depth"
        fitting = alignment.plane_points / points
        if fitting < self._alone_share:
            return f"only {fitting:.0%} of its depth lies on planes of the keyframe"
        if self.is_off(alignment):
            return self._off(alignment)
        if alignment.sigma_depth > self._status.max_depth_sigma:
            return f"its depth is off the planes by {alignment.sigma_depth:.0f} times the noise"
        return self.jump(speed, turn) or ("" if alignment.converged else alignment.reason)

    def jump(self, speed: float, turn: float) -> str:
        """Say that a motion is none of a camera.

        Parameters
        ----------
        speed, turn : float
            See `judge`.

        Returns
        -------
        str
            Empty where it may be one.
        """
        if speed > self._motion.max_speed_m_s or turn > self._motion.max_turn_deg_s:
            return f"implausible jump: {speed:.1f} m/s, {turn:.0f} deg/s"
        return ""

    def is_off(self, alignment: Alignment) -> bool:
        """Whether depth is farther off the keyframe's than it was of late.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        return alignment.sigma_depth > self._tolerated

    def may_be_off(self, alignment: Alignment) -> bool:
        """Whether depth is off the keyframe's, by what is known of late, or may be.

        It may where nothing is known, and where edges scatter, too.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        limit = MILD_SIGMA if math.isinf(self._usual) else self._tolerated
        return alignment.sigma_depth > limit or self.torn.is_torn(alignment)

    @property
    def _tolerated(self) -> float:
        """The largest sigma_depth that raises no doubt; more after frames that did not tell it."""
        return max(self._status.depth_jump * (1 + self._unasked) * self._usual, MILD_SIGMA)

    def _off(self, alignment: Alignment) -> str:
        times = alignment.sigma_depth / self._usual
        return f"depth is off the keyframe's by {times:.0f} times the usual"

    def fits_better(self, alignment: Alignment) -> bool:
        """Whether far more samples agree than did of the last frame that was to be trusted.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        return alignment.agreeing > BETTER * self._agreeing * len(alignment.matches)

    def agrees_less(self, alignment: Alignment) -> bool:
        """Whether far fewer samples agree than did of the last frame that was to be trusted.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
            While there was none, whether fewer than eight tenths do.
        """
        return alignment.agreeing < (self._agreeing - FEWER) * len(alignment.matches)

    def fits_poorly(self, alignment: Alignment) -> bool:
        """Whether so few samples fit that a pose is in doubt.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        return bool(self._poor_fit(alignment))

    def _poor_fit(self, alignment: Alignment) -> str:
        """Why the fit is in doubt; empty where it is not."""
        return _misfit(alignment, self._status.doubt_inliers, self._status.doubt_agreeing)

    def poor_start(self, alignment: Alignment) -> str:
        """Say that few edges agree and these scatter, or depth is off, for one of the first frames.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        str
            Empty where that is not so.
        """
        misfit = _misfit(alignment, 0.0, self._status.first_agreeing)
        if not misfit:
            return ""
        sigma, sigma_px = alignment.sigma_depth, alignment.sigma_px
        if alignment.depth_balance and sigma > MILD_SIGMA:
            return f"{misfit}, just begun, and depth is off by {sigma:.0f} times its noise"
        if sigma_px > MILD_PX:
            return f"{misfit}, just begun, and these scatter by {sigma_px:.1f} px"
        return ""

    def is_poor_keyframe(self, alignment: Alignment) -> bool:
        """Whether one of the first frames, become a keyframe, makes what follows doubtful.

        Also where edges agree, if they scatter and depth is off.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        is_asked = self._status.first_agreeing > 0 and alignment.depth_balance > 0
        is_off = alignment.sigma_depth > MILD_SIGMA and alignment.sigma_px > FIRST_PX
        return (is_asked and is_off) or bool(self.poor_start(alignment))

    def is_out_of_step(self, alignment: Alignment) -> bool:
        """Whether edges fit as a whole, but depth so badly that it cannot tell what stands still.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        fits = alignment.agreeing >= AS_A_WHOLE * len(alignment.matches)
        return fits and alignment.sigma_depth > self._status.max_depth_sigma

    def is_sure(
        self, alignment: Alignment, *, seen_only: bool = False, by_depth: bool = True
    ) -> bool:
        """Whether a registration is good enough to say where the camera is from nothing.

        Parameters
        ----------
        alignment : Alignment
        seen_only : bool
            Whether samples without a match, such as those out of view, do not count.
        by_depth : bool
            Whether depth must not contradict it.

        Returns
        -------
        bool
        """
        status = self._status
        contradicted = alignment.depth_balance and alignment.sigma_depth > status.max_depth_sigma
        samples = alignment.match_count if seen_only else len(alignment.matches)
        return (
            alignment.converged
            and alignment.reason not in FAILURES
            and alignment.inliers >= status.doubt_inliers * samples
            and alignment.agreeing >= status.doubt_agreeing * samples
            and not (by_depth and contradicted)
        )


def _misfit(alignment: Alignment, least_fitting: float, least_agreeing: float) -> str:
    """Say which share of the samples is below its bound; empty where none is."""
    fitting = alignment.inliers / len(alignment.matches)
    agreeing = alignment.agreeing / len(alignment.matches)
    if fitting < least_fitting:
        return f"only {fitting:.0%} of the samples fit"
    if agreeing < least_agreeing:
        return f"only {agreeing:.0%} of the samples fit edges that are turned alike"
    return ""


def speed_of(T: NDArray[np.float64], seconds: float) -> tuple[float, float]:
    """Say how fast a motion is.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)
    seconds : float
        That it took.

    Returns
    -------
    (float, float)
        Metres and degrees a second.
    """
    distance = math.hypot(*T[:3, 3].tolist())
    return distance / seconds, math.degrees(se3.rotation_angle(T)) / seconds


def agreement(alignment: Alignment, planes: PlaneMap, points: PlanePoints) -> float:
    """Say how well a registration fits: the edges' share, times that of depth.

    Parameters
    ----------
    alignment : Alignment
    planes : PlaneMap
        Of the reference.
    points : PlanePoints
        Of the frame.

    Returns
    -------
    float
        From 0 to 1.
    """
    if alignment.reason in FAILURES:
        return 0.0
    edges = alignment.agreeing / len(alignment.matches)
    if not len(points.sigma) or not planes.offsets.any():
        return edges
    return edges * fitting_depth(alignment) / len(points.sigma)
