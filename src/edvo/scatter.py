"""How widely edges scatter about their matches of late: light makes new ones, and moves none."""

import math

import numpy as np

from edvo.config import Config
from edvo.registration import FAILURES, Alignment

SHARE = 0.1  # that a frame has in the usual
LEAST_PX = 0.1  # between frames of a camera at rest edges scatter less, and of another not
WIDENING = 1.03  # of the usual, by a frame that is scattered: else a lasting change would stay one
SHARP, TIGHT = 2.0, 3.0  # times the usual: the scale to try; within which an edge is in its place
SHARPEST = 0.5  # of an inlier's residual, what is in its place at most, to tell places apart
RANGE_PX = 3.0  # residuals that tell crowds apart,
BIN_PX = 0.05  # so finely,
CROWDS_PX = np.geomspace(0.1, 1.5, 12)  # by crowds so wide
SHARES = np.arange(0.3, 0.95, 0.1)  # and of so many of the edges
CLEARLY = 10.0  # in log-likelihood: 5 is strong evidence, of edges that do not err side by side
NO_WORSE = 0.95  # times what depth fitted: no less than chance
LEAST_AREA = 0.04  # of the image; less of it on planes says nothing
LEFT = 0.8  # of what lay on planes, where nothing has come before the lens
FEWER = 0.2  # of the samples, that at once fit no longer: it has turned as nobody foresaw
SURE = 0.8  # of the samples fit, or agree: edges are then surer than depth that contradicts them
MILD_SIGMA = 1.5  # times the sensor's noise, up to which depth raises no doubt
AGREEING_SIGMA = 3.0  # times the sensor's noise, at which depth agrees half

_BINS = np.arange(0, RANGE_PX + BIN_PX / 2, BIN_PX)
_RATIO = (_BINS[:-1] + BIN_PX / 2) / CROWDS_PX[:, None]
_CROWD = np.exp(-(_RATIO**2) / 2) * math.sqrt(2 / math.pi) / CROWDS_PX[:, None]
_SPREAD = (1 - SHARES[:, None]) / RANGE_PX
# log-likelihoods of an edge, by share and crowd: of one in each bin, and of one beyond all
_INSIDE = np.log(SHARES[:, None, None] * _CROWD + _SPREAD[:, :, None])
_OUTSIDE = np.log(_SPREAD)


class Scatter:
    """Remembers the usual scale of the residuals, and tells what is unlike it.

    Parameters
    ----------
    config : Config
        Its ``status.edge_jump``, and the bounds that go with it.
    """

    def __init__(self, config: Config) -> None:
        self._status = config.status
        self._usual_px = math.inf  # the mean sigma_px of late
        self._usual_area = 0.0  # how much of the image lay on planes
        self._usual_fit = 0.0  # how many of the samples fitted, as a share

    @property
    def is_known(self) -> bool:
        """Whether there was a registration to be trusted, that others can be held against."""
        return math.isfinite(self._usual_px)

    @property
    def usual_px(self) -> float:
        """Scale of the residuals of late, px; infinite while none is known."""
        return self._usual_px

    @property
    def sharp_px(self) -> float:
        """Scale of the residuals, px, that is hardly exceeded; infinite while none is known."""
        return SHARP * self._usual_px

    def note(self, alignment: Alignment) -> None:
        """Take note of a registration that is to be trusted.

        Parameters
        ----------
        alignment : Alignment
        """
        sigma_px = max(alignment.sigma_px, LEAST_PX)
        fit = _fitting(alignment)
        if math.isinf(self._usual_px):
            self._usual_px, self._usual_area = sigma_px, alignment.plane_area
            self._usual_fit = fit
        self._usual_fit += SHARE * (fit - self._usual_fit)
        self._usual_px += SHARE * (sigma_px - self._usual_px)
        self._usual_area += SHARE * (alignment.plane_area - self._usual_area)

    def widen(self) -> None:
        """Take note of a registration whose edges are scattered."""
        self._usual_px *= WIDENING

    def is_wide(self, alignment: Alignment) -> bool:
        """Whether edges scatter more widely about their matches than of late, and depth does not.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        jump = self._status.edge_jump
        if not jump or alignment.reason in FAILURES:
            return False
        return alignment.sigma_px > jump * self._usual_px and self.has_usual_depth(alignment)

    def fits_less(self, alignment: Alignment) -> bool:
        """Whether far fewer of the samples fit than of late.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        return _fitting(alignment) < self._usual_fit - FEWER

    def in_place(self, alignment: Alignment) -> int:
        """Count the edges that lie where edges that fit do.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        int
        """
        if alignment.reason in FAILURES:
            return 0
        return int(np.count_nonzero(np.abs(alignment.residuals) <= TIGHT * self._usual_px))

    def is_sharp(self, alignment: Alignment) -> bool:
        """Whether so many edges are in their places that light accounts for the others.

        It makes new ones, and turns the gradient of an edge round that is lit from the other side.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        status = self._status
        asked = status.edge_jump > 0 and status.min_agreeing > 0
        if not asked or TIGHT * self._usual_px > SHARPEST * status.inlier_px:
            return False
        enough = status.min_agreeing * len(alignment.matches)
        return self.has_usual_depth(alignment) and self.in_place(alignment) >= enough

    def has_usual_depth(self, alignment: Alignment) -> bool:
        """Whether as much depth lies on planes as did of late: light leaves it, a hand does not.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        known = self._usual_area >= LEAST_AREA
        return known and alignment.plane_area >= LEFT * self._usual_area


def _fitting(alignment: Alignment) -> float:
    return alignment.inliers / max(len(alignment.matches), 1)


def is_sharper(
    alignment: Alignment, other: Alignment, stride: int = 1, thinning: float | None = None
) -> bool:
    """Whether a registration crowds edges more clearly in their places, and depth no worse.

    Light leaves two crowds of edges, and depth as it is; a shutter that rolls, or blur, widens
    the only crowd, and a stamp that is wrong moves depth, too. A crowd that is hardly clearer is
    no reason to leave where the motion led: it may be of another edge.

    Parameters
    ----------
    alignment, other : Alignment
    stride : int, optional
        The first is of one edge in so many.
    thinning : float, optional
        And of one point in so many; as of edges where not given.

    Returns
    -------
    bool
    """
    times = stride if thinning is None else thinning
    no_worse = times * fitting_depth(alignment) > NO_WORSE * fitting_depth(other)
    return no_worse and is_clearer(alignment, other, stride)


def is_clearer(alignment: Alignment, other: Alignment, stride: int = 1) -> bool:
    """Whether a registration crowds edges more clearly in their places, whatever depth does.

    Parameters
    ----------
    alignment, other : Alignment
    stride : int, optional
        The first is of one edge in so many.

    Returns
    -------
    bool
    """
    return clarity(alignment) > clarity(other, stride) + CLEARLY / stride


def clarity(alignment: Alignment, stride: int = 1) -> float:
    """Log-likelihood of the residuals, as a crowd about zero among others spread evenly.

    The crowd is normal, its width and share those that make it likeliest: a narrow one that many
    edges are outside of may say more than a wide one of nearly all, which their median prefers.

    Parameters
    ----------
    alignment : Alignment
    stride : int, optional
        Of one edge in so many, to be held against a registration of these alone.

    Returns
    -------
    float
        The more, the clearer; -inf where the registration failed.
    """
    if alignment.reason in FAILURES:
        return -math.inf
    residuals = np.abs(alignment.residuals[::stride])
    counts, _ = np.histogram(residuals, _BINS)
    outside = len(residuals) - counts.sum()
    return float((_INSIDE @ counts + outside * _OUTSIDE).max())


def fitting_depth(alignment: Alignment) -> float:
    """Count the points on planes, the less the farther off they are.

    Parameters
    ----------
    alignment : Alignment

    Returns
    -------
    float
        Points; half of them where they are off by ``AGREEING_SIGMA`` times the sensor's noise.
    """
    return alignment.plane_points / (1 + alignment.sigma_depth / AGREEING_SIGMA)
