"""Evidence that is left out: motions that edges could tell, but those that do fit nowhere.

Not in the paper. Where most edges run along a motion, they fit wherever along it the camera is, and
set the scale of the residuals; the few across it, once they are off by more than that, are left out
as wrong matches, one and all, and the pose stays where it was expected. Off by more still, the
edges nearest to them are some of those along it, which fit any such edge: only by their own
gradients do they tell that they are amiss.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.planes import camera_of
from edvo.registration import FAILURES, Alignment
from edvo.robust import median_scale

TELLING_M, TELLING_RAD = 0.05, np.radians(2.0)  # what tells a motion no better is no evidence
SHARED = 100.0  # edges that err together: so many count as one
_ENOUGH = SHARED / np.array([TELLING_M] * 3 + [TELLING_RAD] * 3) ** 2
NONE = np.empty((0, 6))
IN_PLACE = 3.0  # times the scale of the residuals
ALIKE = 0.7  # cosine between the gradients of an edge and its match: 45 degrees
LOOKED_FOR = 0.5  # of what edges could tell: where less is told, those amiss are looked for
FOUND = 0.7  # of the edges across a motion, if they are to have a scale of their own
RIM_PX = 8.0  # from the border of the reference
# Of what edges tell of a motion, that weaker ones tell than the one that others are held against:
MOST, HALF = 0.9, 0.5  # where these are the ones off, and where they are all
ACROSS = 0.5  # of what that one does: so much an edge across tells at least

#: Points, gradients of their own and of the reference, matches, residuals, trust, camera, pose,
#: and when an edge is in its place.
_Seen = tuple[
    kernels.F64,
    kernels.F32,
    kernels.F32,
    kernels.I32,
    kernels.F64,
    kernels.F64,
    kernels.Pinhole,
    kernels.F64,
    kernels.Places,
]


class Across(NamedTuple):
    """A motion that edges tell by their own gradients, but that is not told.

    Attributes
    ----------
    twist : ndarray of float64, shape (6,)
        [v, w] of the reference camera, by which these edges move by one pixel, in the median.
    samples : ndarray of bool, shape (N,)
        Those that tell it, in their places or not.
    """

    twist: NDArray[np.float64]
    samples: NDArray[np.bool_]


class OwnScale(NamedTuple):
    """What edges count that scatter more than others.

    Attributes
    ----------
    factors : ndarray of float64, shape (N,)
        On the residual and the derivative of each sample.
    across : tuple of Across
        The motions that are not told, and those that have a scale of their own.
    """

    factors: NDArray[np.float64]
    across: tuple[Across, ...]


class Evidence:
    """Finds motions that edges could tell, but hardly any of those that do counts.

    Parameters
    ----------
    camera : Camera
        Of both images.
    solver : kernels.Solver
        Of the registrations that are asked about.
    least : float
        The share of what edges could tell of a motion that has to count; 0 asks nothing.
    """

    def __init__(self, camera: Camera, solver: kernels.Solver, least: float) -> None:
        self._camera, self._pinhole = camera, camera_of(camera)
        self._solver, self._least = solver, least
        self._last: tuple[Alignment | None, NDArray[np.float64]] = None, NONE
        self._last_amiss: tuple[Alignment | None, float, Across | None] = None, 0.0, None

    def _is_asked(self, alignment: Alignment) -> bool:
        failed = not alignment.sigma_px or alignment.reason in FAILURES
        return self._least > 0 and not failed

    def untold(
        self, reference: EdgePixels, samples: EdgePixels, alignment: Alignment
    ) -> NDArray[np.float64]:
        """Find the motions of which less than the least share counts.

        With :math:`H = J^T W J` the curvature of the registration, depth included, and :math:`R =
        J^T (w(0) - W) J` that of what robust weights leave out, these are the eigenvectors of the
        pencil :math:`(H, H + R)` whose eigenvalue is below that share. What tells of a motion to no
        better than 5 cm or 2 degrees counts as if it were told.

        Parameters
        ----------
        reference : EdgePixels
            Edges of the reference.
        samples : EdgePixels
            Of the frame, that were registered.
        alignment : Alignment

        Returns
        -------
        ndarray of float64, shape (K, 6)
            Twists [v, w] of length 1 of the reference camera, K of 0 to 6.
        """
        if not self._is_asked(alignment):
            return NONE
        if self._last[0] is not alignment:  # a frame's is asked about where it is judged, and after
            self._last = alignment, self._untold(reference, samples, alignment)
        return self._last[1]

    def _untold(
        self, reference: EdgePixels, samples: EdgePixels, alignment: Alignment
    ) -> NDArray[np.float64]:
        """Find these motions of a registration that was not asked about yet."""
        sigma = alignment.sigma_px
        told, left = np.empty((6, 6)), np.empty((6, 6))
        if kernels.is_told(
            samples.points(self._camera),
            reference.gradients,
            alignment.matches,
            alignment.residuals,
            alignment.trust,
            self._pinhole,
            alignment.T_ref_cur,
            self._solver,
            sigma,
            alignment.H,
            _ENOUGH,
            1 / self._least - 1,
            told,
            left,
        ):
            return NONE
        times, ways = _pencil(left, told)
        twists = ways[times > 1 / self._least - 1]
        untold: NDArray[np.float64] = twists / np.linalg.norm(twists, axis=1, keepdims=True)
        return untold

    def amiss(
        self,
        reference: EdgePixels,
        samples: EdgePixels,
        alignment: Alignment,
        least_px: float = 0.0,
    ) -> Across | None:
        """Find the motion that edges tell best which are in no place of theirs.

        As `untold`, but R is of all samples in view of the reference whose match is too far off, or
        turned otherwise than they are, by what their own gradients tell.

        Parameters
        ----------
        reference : EdgePixels
            Edges of the reference.
        samples : EdgePixels
            Of the frame, that were registered.
        alignment : Alignment
        least_px : float, optional
            An edge that is off by less is in its place, however closely others fit, and whatever it
            counts.

        Returns
        -------
        Across or None
            None where at least half of what they could tell of each motion is told.
        """
        if not self._is_asked(alignment):
            return None
        if self._last_amiss[0] is not alignment or self._last_amiss[1] != least_px:
            amiss = self._amiss(reference, samples, alignment, least_px)
            self._last_amiss = alignment, least_px, amiss
        return self._last_amiss[2]

    def _amiss(
        self, reference: EdgePixels, samples: EdgePixels, alignment: Alignment, least_px: float
    ) -> Across | None:
        """Find this motion of a registration that was not asked about yet."""
        sigma, times = alignment.sigma_px, 1 / LOOKED_FOR - 1
        told, left = np.empty((6, 6)), np.empty((6, 6))
        alike = replace(alignment, trust=np.ones(len(samples))) if least_px else alignment
        given = self._seen(reference, samples, alike, max(IN_PLACE * sigma, least_px))
        solver, H = self._solver, alignment.H
        if not kernels.is_amiss(*given, solver, sigma, H, _ENOUGH, times, told, left):
            return None
        rows, is_off = _find_amiss(given)
        twist = _pencil(left, told)[1][-1]
        moved = np.abs(rows @ twist)
        across = moved > ACROSS * _strong(moved[is_off], MOST)
        return Across(twist / np.median(moved[across & is_off]), across)

    def _seen(
        self, reference: EdgePixels, samples: EdgePixels, alignment: Alignment, most_px: float
    ) -> _Seen:
        """What the kernels are given that ask which edges are in their places."""
        return (
            samples.points(self._camera),
            samples.gradients,
            reference.gradients,
            alignment.matches,
            alignment.residuals,
            alignment.trust,
            self._pinhole,
            alignment.T_ref_cur,
            kernels.Places(most_px, ALIKE, RIM_PX),
        )

    def own_scale(
        self,
        reference: EdgePixels,
        samples: EdgePixels,
        alignment: Alignment,
        most_px: float,
    ) -> OwnScale | None:
        r"""Say what edges count where a motion is not told since those across it scatter more.

        Where most of these match edges that are turned alike, the median of their residuals gives
        a scale :math:`s` of their own, and they count by :math:`\sigma / s` beside the others,
        whose scale is :math:`\sigma`.

        Parameters
        ----------
        reference : EdgePixels
            Edges of the reference.
        samples : EdgePixels
            Of the frame, that were registered.
        alignment : Alignment
        most_px : float
            A larger scale is that of wrong matches.

        Returns
        -------
        OwnScale or None
            None where each motion is told, or those across one that is not match others, or are
            too far off.
        """
        twists = self.untold(reference, samples, alignment)
        if not len(twists):
            return None
        rows, is_off = _find_amiss(self._seen(reference, samples, alignment, np.inf))
        residuals, sigma = alignment.trust * alignment.residuals, alignment.sigma_px
        factors, crowds = np.ones(len(samples)), []
        for twist in twists:
            moved = np.abs(rows @ twist)
            across = moved > ACROSS * _strong(moved, HALF)
            alike = across & ~is_off
            if not np.count_nonzero(alike) > FOUND * np.count_nonzero(across):
                return None
            scale = median_scale(residuals[alike])
            if scale > most_px:
                return None
            crowds.append(Across(twist / np.median(moved[alike]), across))
            if scale > sigma:
                factors[across] = np.minimum(factors[across], sigma / scale)
        return OwnScale(factors, tuple(crowds)) if (factors < 1).any() else None

    def would_tell(
        self,
        samples: EdgePixels,
        alignment: Alignment,
        motions: NDArray[np.float64],
        times: float,
    ) -> bool:
        """Whether the edges of a frame tell far more of some motions than its registration does.

        As those do that are out of the reference's view.

        Parameters
        ----------
        samples : EdgePixels
            Of the frame, that were registered; each tells by its own gradient, at full weight.
        alignment : Alignment
        motions : ndarray of float64, shape (K, 6)
            Twists [v, w] of the reference camera that span them.
        times : float
            How many times more, of one of them at least: as they would leave less of its variance.

        Returns
        -------
        bool
        """
        if not self._is_asked(alignment) or not len(motions):
            return False
        told, own = np.empty((6, 6)), np.empty((6, 6))
        square, points = alignment.sigma_px**2, samples.points(self._camera)
        if not kernels.add_enough(alignment.H, square, _ENOUGH, told):
            return False
        kernels.add_own_rows(points, samples.gradients, self._pinhole, self._solver, own)
        to_current = se3.adjoint(se3.inverse(alignment.T_ref_cur))
        own = to_current.T @ own @ to_current
        less = motions @ (np.linalg.inv(told) - times * np.linalg.inv(told + own)) @ motions.T
        return bool(np.linalg.eigvalsh(less)[-1] > 0)


def _find_amiss(given: _Seen) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """What each sample tells of a motion, (N, 6), and whether it is in no place of its own."""
    count = len(given[0])
    rows, off = np.empty((count, 6)), np.empty(count, np.uint8)
    kernels.find_amiss(*given, rows, off)
    return rows, off.view(np.bool_)


def _strong(tells: NDArray[np.float64], share: float) -> float:
    """What an edge tells such that weaker ones tell a share of all; most may tell nothing."""
    tells = np.sort(tells)
    told_by = np.cumsum(tells**2)
    return float(tells[np.searchsorted(told_by, share * told_by[-1])])


def _pencil(
    left: NDArray[np.float64], told: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Say how many times what is told, (6, 6), is left: least first, (6,); and of which twists.

    These are the rows of the second array, (6, 6).
    """
    to_unit = np.linalg.inv(np.linalg.cholesky(told))
    times, ways = np.linalg.eigh(to_unit @ left @ to_unit.T)
    return times, (to_unit.T @ ways).T
