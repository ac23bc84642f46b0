"""The share of edge pixels that are matched correctly, Eq. (15)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.errors import EvaluationError


@dataclass(frozen=True)
class MatchingSuccess:
    """How many of a set of matches are right.

    Parameters
    ----------
    total : int
        ``N_total``: pixels whose true place is known, matched or not.
    correct : int
        ``N_correct``: those matched to an edge pixel at their true place.
    same_line : int
        Those matched to an edge line through their true place: slid along it at most. For the
        residual of Eq. (12), which only knows the direction across the line, they are as good.
    tolerance_px : float
        How near counts as the same.
    """

    total: int
    correct: int
    same_line: int
    tolerance_px: float

    @property
    def rate(self) -> float:
        """Eq. (15); NaN where there was nothing to match."""
        return self.correct / self.total if self.total else float("nan")

    @property
    def line_rate(self) -> float:
        """Share of matches to the right line; NaN where there was nothing to match."""
        return self.same_line / self.total if self.total else float("nan")


def matching_success(
    matches: NDArray[np.int32],
    pixels: NDArray[np.floating],
    normals: NDArray[np.floating],
    true_pixels: NDArray[np.floating],
    *,
    tolerance_px: float = 2.0,
    slide_px: float = 10.0,
) -> MatchingSuccess:
    """Count correct matches.

    Parameters
    ----------
    matches : ndarray of int32, shape (N,)
        The reference edge that each of N current edges was matched to; -1 for none, which is
        never correct.
    pixels : ndarray, shape (M, 2)
        Pixels u, v of the reference edges.
    normals : ndarray, shape (M, 2)
        Their unit normals.
    true_pixels : ndarray, shape (N, 2)
        Where each current edge really is in the reference image; NaN where that is unknown or
        outside: such edges are not counted.
    tolerance_px : float
        A match is correct if its pixel lies no further than this from the true place. Edges are
        found to a pixel in both images, so that even a perfect match is off by one and a bit.
    slide_px : float
        On the same line is a match that is off across the edge by ``tolerance_px`` at most, and
        by this at most in all.

    Returns
    -------
    MatchingSuccess

    Raises
    ------
    EvaluationError
        If lengths differ, a match names no reference edge, or a tolerance is not positive.
    """
    if len(matches) != len(true_pixels) or len(pixels) != len(normals):
        raise EvaluationError(
            f"{len(matches)} matches of {len(true_pixels)} edges, {len(pixels)} reference pixels "
            f"with {len(normals)} normals; give one for each"
        )
    if len(matches) and int(matches.max()) >= len(pixels):
        raise EvaluationError(
            f"match {int(matches.max())} of {len(pixels)} reference edges; give their indices"
        )
    if not (tolerance_px > 0 and slide_px > 0):
        raise EvaluationError(
            f"tolerances of {tolerance_px} and {slide_px} pixels; give positive ones"
        )
    known = np.isfinite(true_pixels).all(axis=1)
    matched = known & (matches >= 0)
    chosen = matches[matched]
    offset = pixels[chosen].astype(np.float64) - true_pixels[matched]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    across = np.abs((offset * normals[chosen]).sum(axis=1))
    correct = distance <= tolerance_px
    same_line = correct | ((across <= tolerance_px) & (distance <= slide_px))
    return MatchingSuccess(
        total=int(np.count_nonzero(known)),
        correct=int(np.count_nonzero(correct)),
        same_line=int(np.count_nonzero(same_line)),
        tolerance_px=tolerance_px,
    )
