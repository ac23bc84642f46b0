"""Edges and depth that say different things: how either fits, as against how it did of late.

Not in the paper. Both err alone often enough: edges where the camera moves fast while it exposes,
depth where it is late. That both fit far worse at once has one reason as a rule: the pose is off,
led astray by something that moves, or by edges that have no place. And where edges err while depth
is good, the few surfaces that say so are outvoted, and count as outliers.
"""

import math

from edvo.config import Config
from edvo.registration import FAILURES, Alignment
from edvo.scatter import MILD_SIGMA, SHARE, SURE, WIDENING, Scatter

KNOWN = 10  # frames, before which what is usual is not known well enough for a doubt
LEAST_SIGMA = 0.1  # times the sensor's noise, which depth is as good as not off by
WIDER, FARTHER = 1.6, 2.0  # times the usual, that edges scatter and depth is off by, to be torn
DOUBTFUL = 4.0  # times that of depth, which raises doubt; ``MILD_SIGMA`` does so, too
OUTVOTED = 0.04  # more of the points on planes than as a rule, as a share, that are outliers;
SMEARED_PX, OUTVOTED_BY_SMEAR = 5.0, 0.015  # less do where edges are smeared so far
GOOD_SIGMA = 0.6  # times the noise of a sensor, that depth is off by as a rule where it is good
UNSURE_PX = 0.25  # edges that scatter by less, and agree, are not asked
MORE_POINTS, SAME_SIGMA, ENOUGH_EDGES = 1.03, 1.1, 0.8  # times those of the other, to fit better


class Torn:
    """Remembers how edges and depth fit as a rule, and tells where they say different things.

    Parameters
    ----------
    config : Config
        Its ``status.torn`` and ``planes.outvoted``.
    scatter : Scatter
        Knows how widely edges scatter.
    """

    def __init__(self, config: Config, scatter: Scatter) -> None:
        self._doubts = config.status.torn == "doubt"
        self._asks = config.planes.outvoted == "asked"
        self._scatter = scatter
        self._frames = 0
        self._sigma = math.inf  # the mean sigma_depth of late
        self._outliers = math.inf  # and the mean share of points that were outliers

    def note(self, alignment: Alignment) -> None:
        """Take note of a registration that is to be trusted, if its depth says anything.

        Parameters
        ----------
        alignment : Alignment
        """
        if not _tells_depth(alignment):
            return
        sigma = max(alignment.sigma_depth, LEAST_SIGMA)
        if not self._frames:
            self._sigma, self._outliers = sigma, alignment.outliers
        self._frames += 1
        self._sigma += SHARE * (sigma - self._sigma)
        self._outliers += SHARE * (alignment.outliers - self._outliers)

    def is_torn(self, alignment: Alignment) -> bool:
        """Whether edges scatter and depth is off the planes, both more than of late.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        if not self._doubts or not _tells_depth(alignment):
            return False
        is_off = alignment.sigma_depth > FARTHER * self._sigma
        return is_off and alignment.sigma_px > WIDER * self._scatter.usual_px

    def is_in_doubt(self, alignment: Alignment) -> bool:
        """Whether it is torn, and depth so far off that the pose is in doubt.

        Parameters
        ----------
        alignment : Alignment

        Returns
        -------
        bool
        """
        least = min(MILD_SIGMA, DOUBTFUL * self._sigma)
        is_far = self._frames >= KNOWN and alignment.sigma_depth > least
        return is_far and self.is_torn(alignment)

    def widen(self, alignment: Alignment) -> None:
        """Take note of a registration that is in doubt for it: a lasting change becomes the usual.

        Parameters
        ----------
        alignment : Alignment
        """
        self._sigma *= WIDENING
        if not self._scatter.is_wide(alignment):  # else it has been noted as that
            self._scatter.widen()

    def outvotes_depth(self, alignment: Alignment, smeared_px: float = 0.0) -> bool:
        """Whether more points than as a rule are outliers of depth that is good, and edges unsure.

        A wall that alone says how far the camera went to one side is outvoted by all the others.
        Edges are unsure that scatter, or do not agree: dense texture fits sharply beside its place.

        Parameters
        ----------
        alignment : Alignment
        smeared_px : float, optional
            Over so many pixels edges are smeared.

        Returns
        -------
        bool
        """
        if not self._asks or not _tells_depth(alignment):
            return False
        agree = alignment.agreeing >= SURE * len(alignment.matches)
        if agree and alignment.sigma_px < UNSURE_PX:
            return False
        more = OUTVOTED_BY_SMEAR if smeared_px >= SMEARED_PX else OUTVOTED
        return self._sigma < GOOD_SIGMA and alignment.outliers > self._outliers + more

    def fits_more_depth(self, alignment: Alignment, other: Alignment) -> bool:
        """Whether more points fit a registration, as closely, for hardly fewer edges that agree.

        Parameters
        ----------
        alignment, other : Alignment

        Returns
        -------
        bool
            False where the depth of one of them says nothing.
        """
        if not self._asks or not _tells_depth(alignment) or not _tells_depth(other):
            return False
        if alignment.agreeing < ENOUGH_EDGES * other.agreeing:
            return False
        is_as_close = alignment.sigma_depth <= SAME_SIGMA * other.sigma_depth
        return is_as_close and alignment.plane_inliers > MORE_POINTS * other.plane_inliers


def _tells_depth(alignment: Alignment) -> bool:
    """Whether a registration succeeded, and depth of its own frame counted."""
    counts = alignment.depth_balance > 0 and not alignment.is_stale
    return counts and alignment.reason not in FAILURES
