"""How far a registration may be off: its covariance, and the directions that nothing constrains.

Not in the paper. Edge pixels do not err independently: neighbours on one edge share their depth,
their rounding and what light does to them, and so do neighbours on one plane. The inverse of
J^T W J takes all of them for independent and is far too small. Here errors are shared within a
cell of the image and independent between cells; docs/theory/covariance.md derives it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.evidence import Evidence
from edvo.matching import EdgeIndex
from edvo.planes import DepthTerm, PlaneMap, PlanePoints, camera_of
from edvo.registration import AS_ONE, Alignment
from edvo.sensor import DEPTH_NOISE

CELLS = 16  # across the image: 40 px at VGA
DOUBT = 1.2  # times the blur of the normals is taken off what they seem to know
PRIOR = np.ones(6)  # 1/m^2 and 1/rad^2: what nothing constrains is off by a metre or a radian
_UNIT, _PRIOR = np.eye(6), np.diag(PRIOR)
# For decisions, errors are taken to be so many times as large: regions hold what they should of
# errors in all scenes together, and less where long edges are parallel and err together.
MARGIN = 1.15
# A direction is degenerate where the pose may be off by 5 cm or 2 degrees: its 90 % interval.
DEGENERATE_M, DEGENERATE_RAD = 0.05 / 1.645 / MARGIN, np.radians(2.0) / 1.645 / MARGIN
BOUNDS = np.array([DEGENERATE_M] * 3 + [DEGENERATE_RAD] * 3)
PRODUCTS = np.outer(BOUNDS, BOUNDS)  # by which a covariance is in units of these
PER_SQUARES = BOUNDS**-2  # of which the sum over variances is below 1 where each motion is told
AXES = ("x", "y", "z")
PURE = 0.1  # share of the smaller part below which a motion is a translation or a rotation alone
AXIAL = np.cos(np.radians(15.0))  # a direction nearer to an axis is named by that


class Shares(NamedTuple):
    """What each source of error counts: fitted to rendered pairs; see docs/theory/covariance.md."""

    edges: float  # of the scores that are observed
    planes: float
    depth: float  # of depths that are off together by the sensor's noise
    tension: float  # of edges against planes


SHARES = Shares(edges=7.0, planes=2.2, depth=0.75, tension=2.3)
_SHARES = np.array(SHARES)


class Parts(NamedTuple):
    """What a covariance is made of; see docs/theory/covariance.md."""

    curvature: NDArray[np.float64]  # H = J^T W J at the pose found, (6, 6), px^2
    blur: NDArray[np.float64]  # what of H is noise of the normals, about, (6, 6), px^2
    parts: NDArray[np.float64]  # of the score J^T W r by each source of `Shares`, (4, 6, 6), px^4
    by_depth: NDArray[np.float64]  # what of H depth tells, (6, 6), px^2


class Uncertainty:
    """Gives the covariance of registrations, by a fixed set of parameters.

    Parameters
    ----------
    camera : Camera
        Of both images.
    config : Config
        Its sections registration, planes and status.
    solver : kernels.Solver
        Of the registration that the alignments come from.

    Attributes
    ----------
    evidence : Evidence
        Tells what edges could tell, and none does that counts.
    """

    def __init__(self, camera: Camera, config: Config, solver: kernels.Solver) -> None:
        self._camera = camera
        self._pinhole = camera_of(camera)
        self._solver = solver
        self._noise = DEPTH_NOISE[config.planes.sensor]
        self.evidence = Evidence(camera, solver, config.status.min_told)

    def parts(
        self,
        reference: EdgeIndex,
        samples: EdgePixels,
        planes: PlaneMap,
        points: PlanePoints,
        term: DepthTerm,
        alignment: Alignment,
    ) -> Parts:
        """Give what the covariance is made of.

        Parameters
        ----------
        reference : EdgeIndex
        samples : EdgePixels
        planes : PlaneMap
        points : PlanePoints
        term : DepthTerm
            What the registration was given.
        alignment : Alignment
            What it found.

        Returns
        -------
        Parts
        """
        H, blur, parts = np.empty((6, 6)), np.empty((6, 6)), np.empty((4, 6, 6))
        by_depth = np.empty((6, 6))
        kernels.score_parts(
            reference.edges.pixels,
            reference.edges.gradients,
            alignment.matches,
            alignment.trust,
            samples.points(self._camera),
            samples.gradients,
            self._noise.sigma_z(samples.depths),
            self._pinhole,
            self._solver,
            _scale(alignment),
            planes,
            points,
            term,
            alignment.sigma_depth,
            alignment.depth_balance,
            alignment.T_ref_cur,
            self._camera.width / CELLS,
            H,
            blur,
            parts,
            by_depth,
        )
        return Parts(H, blur, parts, by_depth)

    def covariance(
        self,
        reference: EdgeIndex,
        samples: EdgePixels,
        planes: PlaneMap,
        points: PlanePoints,
        term: DepthTerm,
        alignment: Alignment,
    ) -> NDArray[np.float64]:
        """Give the covariance of a registration; for the parameters see `parts`.

        Returns
        -------
        ndarray of float64, shape (6, 6)
            See `combine`. What edges could tell, but those that do are left out, is not known,
            either, and has 1 m or 1 rad more.
        """
        return self.spread(reference, samples, planes, points, term, alignment)[0]

    def spread(
        self,
        reference: EdgeIndex,
        samples: EdgePixels,
        planes: PlaneMap,
        points: PlanePoints,
        term: DepthTerm,
        alignment: Alignment,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Give the covariance of a registration, and what depth tells; for the rest see `parts`.

        Returns
        -------
        covariance : ndarray of float64, shape (6, 6)
            See `covariance`.
        by_depth : ndarray of float64, shape (6, 6)
            See `Parts`.
        """
        told = self.parts(reference, samples, planes, points, term, alignment)
        sigma, C = _scale(alignment), np.empty((6, 6))
        lag = alignment.lag
        if lag.bend and alignment.depth_balance:
            told = given_way(told, lag.steady / lag.bend**2, alignment.slack_px2)
        given = told.curvature, told.blur, told.parts
        if not kernels.combine_parts(*given, DOUBT, _SHARES, sigma**4, PRIOR, C):
            C = combine(without_blur(told.curvature, told.blur), told.parts, sigma)
        untold = self.evidence.untold(reference.edges, samples, alignment)
        return (C + untold.T @ untold if len(untold) else C), told.by_depth


def given_way(told: Parts, steady: NDArray[np.float64], square: float) -> Parts:
    """Give what a covariance is made of where depth may be elsewhere, all of it as one.

    With A what depth tells, less what may be noise of the normals, and P what is known of the
    slack, A - A (A + P)^-1 A is left of it, of its scores as much, and those of the slack beside.

    Parameters
    ----------
    told : Parts
        Where it may not.
    steady : ndarray of float64, shape (6, 6)
        See `kernels.Lag`: ``AS_ONE`` times the inverse of the slack's covariance.
    square : float
        Of what edges err by, px^2, by which that counts against them.

    Returns
    -------
    Parts
        Without blur, which is taken off by then.
    """
    P, A = square * steady, told.by_depth
    known = without_blur(A, told.blur)
    hidden = known - (A - DOUBT * told.blur)  # noise, by which more is taken off than A tells
    left = known - known @ np.linalg.solve(known + P, known) - hidden
    G = np.linalg.solve(A + P, P).T
    pull = G @ A
    parts = told.parts.copy()
    parts[1] = G @ parts[1] @ G.T + AS_ONE / SHARES.planes * pull @ np.linalg.solve(steady, pull.T)
    parts[3] = G @ parts[3] @ G.T  # the slack takes up the rest
    H = told.curvature - A + 0.5 * (left + left.T)
    return Parts(H, np.zeros((6, 6)), parts, 0.5 * (pull + pull.T))


def _scale(alignment: Alignment) -> float:
    """What weights and scores are in units of; any will do where no edge has a residual."""
    return alignment.sigma_px or 1.0


def without_blur(H: NDArray[np.float64], blur: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give what is known for sure: H without what may be noise of the normals.

    Parameters
    ----------
    H, blur : ndarray of float64, shape (6, 6)
        See `Uncertainty.parts`.

    Returns
    -------
    ndarray of float64, shape (6, 6)
        Positive semidefinite.
    """
    values, vectors = np.linalg.eigh(H - DOUBT * blur)
    result: NDArray[np.float64] = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return result


def combine(
    known: NDArray[np.float64],
    parts: NDArray[np.float64],
    sigma_px: ArrayLike,
    shares: Shares = SHARES,
) -> NDArray[np.float64]:
    """Put the parts together: (K S^-1 K + prior)^-1, with S the sum of shares times parts.

    Parameters
    ----------
    known : ndarray of float64, shape (..., 6, 6)
        By `without_blur`, of any number of registrations.
    parts : ndarray of float64, shape (..., 4, 6, 6)
        See `Uncertainty.parts`.
    sigma_px : array_like of float, shape (...)
        Scale of the residuals.
    shares : Shares, optional
        What each part counts.

    Returns
    -------
    ndarray of float64, shape (..., 6, 6)
        Of the left perturbation [v, w] of T_ref_cur, metres and radians, in the frame of the
        reference camera: T_true = exp([v, w]) T_ref_cur. Symmetric and positive definite. What
        nothing constrains has a standard deviation of 1 m or 1 rad, which says: unknown.
    """
    floor = np.asarray(sigma_px, np.float64)[..., None, None] ** 4 * _UNIT
    scatter = np.einsum("k,...kij->...ij", np.array(shares), parts) + floor
    information = known @ np.linalg.solve(scatter, known) + _PRIOR
    C: NDArray[np.float64] = np.linalg.inv(information).astype(np.float64, copy=False)
    return 0.5 * (C + np.swapaxes(C, -1, -2))


def in_current_camera(
    covariance: NDArray[np.float64], T_key_cur: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Carry a covariance over to the frame of the current camera.

    Parameters
    ----------
    covariance : ndarray of float64, shape (6, 6)
        Of the left perturbation of ``T_key_cur``, in the keyframe's camera.
    T_key_cur : ndarray of float64, shape (4, 4)

    Returns
    -------
    ndarray of float64, shape (6, 6)
        Of the right perturbation: exp(delta) T = T exp(Ad(T^-1) delta).
    """
    carried = np.empty((6, 6))
    kernels.carry_covariance(kernels.inverted(T_key_cur), covariance, carried)
    return carried


def constrained_directions(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the motions that a registration did notice.

    Parameters
    ----------
    covariance : ndarray of float64, shape (6, 6)

    Returns
    -------
    ndarray of float64, shape (6, K)
        Twists [v, w] as columns, K of 0 to 6: across those of `degenerate_directions`, and each as
        long as there is tolerated.
    """
    values, vectors = np.linalg.eigh(covariance / PRODUCTS)
    basis: NDArray[np.float64] = vectors[:, values <= 1] * BOUNDS[:, None]
    return basis


def degenerate_directions(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the motions that a registration did not notice.

    Parameters
    ----------
    covariance : ndarray of float64, shape (6, 6)

    Returns
    -------
    ndarray of float64, shape (K, 6)
        Twists [v, w], K of 0 to 6, that span the motions whose standard deviation exceeds 26 mm
        or 1.06 degrees (times `MARGIN`, a 90 % interval of 5 cm or 2 degrees): translations
        first, then rotations, then what is both; along the camera's axes as far as can be.
    """
    if covariance.diagonal() @ PER_SQUARES < 1:  # as then is each eigenvalue; none is negative
        return np.empty((0, 6))
    values, vectors = np.linalg.eigh(covariance / PRODUCTS)
    loose = vectors[:, values > 1]
    if not loose.size:
        return np.empty((0, 6))
    # Pure translations in the span have no rotation, and the other way round.
    found: list[NDArray[np.float64]] = []
    for own, other in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        _, sizes, mix = np.linalg.svd(loose[other])
        sizes = np.append(sizes, np.zeros(len(mix) - len(sizes)))
        alone = loose[own] @ mix[sizes < PURE].T
        for axis in _along_axes(alone):
            twist = np.zeros(6)
            twist[own] = axis
            found.append(twist)
        loose = loose @ mix[sizes >= PURE].T
        if not loose.size:
            break
    found += list((loose * BOUNDS[:, None]).T)
    return np.array(found)


def _along_axes(span: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Basis of the columns' span, shape (3, K), that follows the axes as far as it can."""
    basis: list[NDArray[np.float64]] = []
    Q = np.linalg.qr(span)[0] if span.size else span
    for _ in range(Q.shape[1]):
        P = Q @ Q.T - sum((np.outer(b, b) for b in basis), np.zeros((3, 3)))
        best = P[:, int(np.argmax(np.diag(P)))]
        basis.append(best / np.linalg.norm(best))
    return sorted(basis, key=lambda b: int(np.argmax(np.abs(b))))


def describe(direction: NDArray[np.float64]) -> str:
    """Name a motion in words.

    Parameters
    ----------
    direction : ndarray of float64, shape (6,)
        Twist [v, w] of any length.

    Returns
    -------
    str
        Such as ``translation along x`` or ``rotation about (0.00, 0.71, 0.71)``; the camera's x
        is to the right, y down, z forward.

    Examples
    --------
    >>> describe(np.array([0, 0, 0, 0, 0, -2.0]))
    'rotation about z'
    >>> describe(np.array([0, 0.03, 0, 0.02, 0, 0]))
    'translation along y with rotation about x'
    """
    v, w = np.split(np.asarray(direction, np.float64) / BOUNDS, 2)
    size = float(np.hypot(np.linalg.norm(v), np.linalg.norm(w)))
    words = []
    if np.linalg.norm(v) > PURE * size:
        words.append(f"translation along {_axis(v)}")
    if np.linalg.norm(w) > PURE * size:
        words.append(f"rotation about {_axis(w)}")
    return " with ".join(words)


def _axis(vector: NDArray[np.float64]) -> str:
    unit = vector / np.linalg.norm(vector)
    nearest = int(np.argmax(np.abs(unit)))
    if abs(unit[nearest]) > AXIAL:
        return AXES[nearest]
    unit *= np.sign(unit[nearest])
    return "({})".format(", ".join(f"{value + 0.0:.2f}" for value in unit))
