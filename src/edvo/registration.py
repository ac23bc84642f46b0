"""Registering edges by 2-D edge divergence minimization (§III-C, §IV-B).

The current samples are warped into the reference image (Eq. 1), matched to its edges (Eq. 6),
and the pose is moved until the signed distances along the edges' normals (Eq. 12) vanish, by
iteratively re-weighted least squares (Eq. 13) with Levenberg-Marquardt steps (Eq. 14).
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import MatchingConfig, RegistrationConfig
from edvo.edges import EdgePixels
from edvo.matching import Criterion, EdgeIndex
from edvo.planes import NO_PLANES, NO_POINTS, DepthTerm, PlaneMap, PlanePoints, camera_of
from edvo.robust import TUNING, WEIGHTS

RESIDUALS = {"divergence": kernels.SIGNED, "distance": kernels.DISTANCE}
AGREEING = math.cos(math.radians(45))  # of gradients, even if the camera has rolled a little
NONE = np.empty(0)
AT_ONCE = kernels.Lag(0.0, 0.0, np.eye(4), np.eye(4), NONE, NONE, NONE, np.empty((0, 0)))
# Edges that err together, or by far more than they scatter: so many as one. What is known of by how
# much depth may be elsewhere counts so many times as much against them.
AS_ONE = 40.0
EDGES_ALONE = DepthTerm(
    weight=0.0, doubt=1.0, edge_doubt=0.0, most=math.inf, min_dot=1.0, limit=0.0, min_points=1
)
NOTHING_NEAR = kernels.NearMap(np.empty(0, np.uint32), 0, 0, 0.0, 0.0, 1.0)
COARSE_POINTS = np.int64(3)  # while edges are looked up one point of depth in so many is taken
FIRST_POINT_PX = 18.0  # of points that lie closely one to a square of that side is taken at first
STAGES = {
    "robust-then-normal": (kernels.ROBUST, kernels.NORMAL),
    "robust": (kernels.ROBUST, kernels.ROBUST),
    "normal": (kernels.NORMAL, kernels.NORMAL),
}
REASONS = {
    kernels.CONVERGED: "converged",
    kernels.STALLED: "no step lowers the cost any more",
    kernels.EXHAUSTED: "iterations used up",
    kernels.TOO_FEW: "too few matches",
    kernels.SINGULAR: "edges do not constrain the motion",
}
FAILURES = (REASONS[kernels.TOO_FEW], REASONS[kernels.SINGULAR])


@dataclass(frozen=True, slots=True)
class Iteration:
    """One trial step of a registration.

    Attributes
    ----------
    robust : bool
        Whether the robust criterion matched, else the normal one.
    looked_up : bool
        Whether edges were looked up instead, before either.
    matches : int
    sigma_px : float
        Scale of the residuals.
    cost : float
        Mean robust loss before the step.
    step_px : float
        Change of the residuals (rms) that the step predicts.
    damping : float
        Lambda of Eq. (14).
    accepted : bool
    trial_cost : float
        Mean robust loss after the step; NaN where the step was too small to be tried.
    """

    robust: bool
    looked_up: bool
    matches: int
    sigma_px: float
    cost: float
    step_px: float
    damping: float
    accepted: bool
    trial_cost: float


@dataclass(frozen=True, slots=True)
class Alignment:
    """What a registration found, with its evidence.

    Attributes
    ----------
    T_ref_cur : ndarray of float64, shape (4, 4)
        The motion g^r_{r,n}: maps points from the current to the reference camera.
    H : ndarray of float64, shape (6, 6)
        J^T W J of Eq. (14), over a left perturbation [v, w] of ``T_ref_cur``; px^2. Includes
        what depth adds.
    matches : ndarray of int32, shape (N,)
        Reference edge of each sample; -1 where it has none.
    residuals : ndarray of float64, shape (N,)
        Pixels; NaN where there is no match.
    trust : ndarray of float64, shape (N,)
        What each counts, as a factor on residual and derivative: less than others where an edge
        looks otherwise than its match (``RegistrationConfig.profile_spread``), the mean square of
        some hundreds of one direction being 1; 2 at most. 1 where images tell no profiles, or there
        is no match.
    pixels : ndarray of float32, shape (N, 2)
        Ideal pixel of each sample in the current image.
    references : ndarray of float32, shape (N, 2)
        Ideal pixel of the reference edge of each sample; NaN where it has none.
    inliers : int
        Matches with a residual below ``StatusConfig.inlier_px``.
    agreeing : int
        Inliers whose gradient is that of their match, to 45 degrees: where edges are dense, a
        neighbour is found near any pixel, but one that is turned alike only by chance.
    sigma_px : float
        Scale of the residuals, times their trust; 0 where depth was registered alone.
    plane_points : int
        Points of the depth image that lie near a plane of the reference; of depth alone those
        that fit it.
    plane_inliers : int
        Those of them that are no outliers by Tukey's weights, and the scale before the last step.
    plane_area : float
        Share of the image that all of them stand for.
    sigma_depth : float
        Scale of their distances, in units of the sensor's noise.
    depth_balance : float
        What they counted against the edges; 0 where edges counted alone, 1 where depth did.
    cost : float
        Mean robust loss.
    iterations : int
        Trial steps, the rejected ones too.
    converged : bool
        Whether a step became too small to matter, or none lowered the cost any more.
    reason : str
        Why it stopped.
    history : ndarray of float64, shape (iterations, 8)
        See ``steps``.
    lag : kernels.Lag
        When depth and the rows of the image were taken to be taken; by it depth, as it was
        registered, lies where it was found, with its slack.
    is_stale : bool
        Whether its depth is that of the frame before, and says nothing of it.
    slack : ndarray of float64, shape (6,)
        What an acceleration moves the camera by in the square of the time since the last image: a
        left perturbation [v, w], metres and radians, of which depth and rows lie elsewhere by
        ``lag.bend`` and ``lag.bends``; 0 where that was not asked.
    slack_px2 : float
        What counted of ``lag.steady`` beside the edges: the square of what they err by, px^2.
    """

    T_ref_cur: NDArray[np.float64]
    H: NDArray[np.float64]
    matches: NDArray[np.int32]
    residuals: NDArray[np.float64]
    trust: NDArray[np.float64]
    pixels: NDArray[np.float32]
    references: NDArray[np.float32]
    inliers: int
    agreeing: int
    sigma_px: float
    plane_points: int
    plane_inliers: int
    plane_area: float
    sigma_depth: float
    depth_balance: float
    cost: float
    iterations: int
    converged: bool
    reason: str
    history: NDArray[np.float64]
    lag: kernels.Lag = AT_ONCE
    is_stale: bool = False
    slack: NDArray[np.float64] = field(default_factory=lambda: np.zeros(6))
    slack_px2: float = 0.0

    @property
    def T_cam_points(self) -> NDArray[np.float64] | None:
        """Where points of depth were found, (4, 4): maps those registered to the current camera.

        None where depth has no slack.
        """
        if not self.lag.bend:
            return None
        there = kernels.lagged(self.T_ref_cur, self.lag)
        T: NDArray[np.float64] = se3.inverse(self.T_ref_cur) @ there
        return T

    @property
    def faster(self) -> NDArray[np.float64]:
        """By how much faster the camera goes than since the last image, as rows tell, (6,).

        [v, w] in its own frame, metres and radians a period since then: half of the slack. Zeros
        where rows have none.
        """
        if not self.lag.bends.size:
            return np.zeros(6)
        faster: NDArray[np.float64] = kernels.adjoint_back(self.T_ref_cur) @ self.slack / 2
        return faster

    @property
    def outliers(self) -> float:
        """Share of the points near a plane that Tukey's weights leave out."""
        return 1 - self.plane_inliers / self.plane_points if self.plane_points else 0.0

    @property
    def match_count(self) -> int:
        """Number of samples with a match."""
        return int(np.count_nonzero(self.matches >= 0))

    def steps(self) -> list[Iteration]:
        """Tell what each iteration did."""
        return [
            Iteration(
                stage == kernels.ROBUST,
                stage == kernels.LOOK_UP,
                int(n),
                sigma,
                cost,
                step,
                damping,
                bool(accepted),
                trial,
            )
            for stage, n, sigma, cost, step, damping, accepted, trial in self.history.tolist()
        ]


class Registration:
    """Registers samples with reference edges, by a fixed set of parameters.

    Parameters
    ----------
    camera : Camera
        Of both images. Its distortion plays no role here: edges carry ideal pixels.
    matching : MatchingConfig
    registration : RegistrationConfig
    inlier_px : float
        Bound on the residual of an inlier.
    start_stride : int
        Of several starting poses the best is chosen on one sample in so many.
    """

    def __init__(
        self,
        camera: Camera,
        matching: MatchingConfig,
        registration: RegistrationConfig,
        *,
        inlier_px: float = 2.0,
        start_stride: int = 4,
    ) -> None:
        self._camera = camera
        self._inlier_px = inlier_px
        self._stride = np.int64(start_stride)
        self._leave_px = registration.far_leave_px
        self._cell_px = matching.cell_px
        self._first, self._last = STAGES[matching.criterion]
        self._pinhole = camera_of(camera)
        limits = (camera.width, matching.max_distance_px, matching.max_angle_deg)
        self._robust = Criterion(matching.gamma, *limits).compile()
        self._normal = Criterion(0.0, *limits).compile()
        self._solver = kernels.Solver(
            residual=RESIDUALS[registration.residual],
            weight=WEIGHTS[registration.weight],
            tuning=registration.nu if registration.weight == "t" else TUNING[registration.weight],
            min_sigma=registration.min_sigma_px,
            max_sigma=math.inf,
            first_sigma=registration.first_sigma_px,
            coarse_samples=registration.coarse_samples,
            coarse_points=COARSE_POINTS,
            first_points=np.int64(max(camera.width * camera.height / FIRST_POINT_PX**2, 1)),
            first_samples=registration.first_samples,
            min_matches=registration.min_matches,
            max_iterations=registration.max_iterations,
            switch_px=matching.switch_px,
            stop_px=registration.stop_px,
            stop_share=registration.stop_share,
            leave_px=0.0,
            stop_cost=registration.stop_decrease,
            damping=registration.damping,
            damping_up=registration.damping_up,
            damping_down=registration.damping_down,
            max_rejections=registration.max_rejections,
            max_stretch=registration.max_stretch,
            kept_px=registration.kept_px,
            profile_spread=registration.profile_spread,
        )

    @property
    def solver(self) -> kernels.Solver:
        """Residual, weight function and limits, as the kernels take them."""
        return self._solver

    def index(self, edges: EdgePixels) -> EdgeIndex:
        """Arrange reference edges for the search.

        Parameters
        ----------
        edges : EdgePixels

        Returns
        -------
        EdgeIndex
        """
        return EdgeIndex(edges, "grid", self._cell_px)

    def indices(self, edges: EdgePixels, first: int) -> tuple[EdgeIndex, EdgeIndex]:
        """Arrange reference edges, and the first of them apart, once a search asks for these.

        Parameters
        ----------
        edges : EdgePixels
        first : int
            How many.

        Returns
        -------
        every, some : EdgeIndex
            The same one where the first are all.
        """
        every = self.index(edges)
        if first >= len(edges):
            return every, every
        return every, EdgeIndex(edges.first(first), "grid", self._cell_px, when_asked=True)

    def cost(self, alignment: Alignment, sigma_px: float) -> float:
        """Say what the edges of a registration cost by another scale than its own.

        Parameters
        ----------
        alignment : Alignment
        sigma_px : float
            Scale of the residuals.

        Returns
        -------
        float
            Mean loss over all samples, those without a match too.
        """
        matched = alignment.matches >= 0
        residuals = alignment.residuals[matched] * alignment.trust[matched]
        n, limit = len(matched), self._normal.limit
        return float(kernels.mean_cost(residuals, len(residuals), n, sigma_px, limit, self._solver))

    def align(
        self,
        reference: EdgeIndex,
        samples: EdgePixels,
        starts: NDArray[np.float64],
        planes: PlaneMap = NO_PLANES,
        points: PlanePoints = NO_POINTS,
        term: DepthTerm = EDGES_ALONE,
        lag: kernels.Lag = AT_ONCE,
        max_sigma_px: float = math.inf,
        *,
        far: bool = False,
        first_sigma_px: float = 0.0,
    ) -> Alignment:
        """Find the motion between the reference and the current camera.

        Parameters
        ----------
        reference : EdgeIndex
            Edges of the reference image.
        samples : EdgePixels
            N edges of the current image, with depth.
        starts : ndarray of float64, shape (K, 4, 4)
            Guesses of ``T_ref_cur``; the one with the lowest cost is taken.
        planes : PlaneMap, optional
            Of the reference depth image.
        points : PlanePoints, optional
            Of the current depth image; without them edges count alone.
        term : DepthTerm, optional
            What points and planes count.
        lag : kernels.Lag, optional
            When depth and the rows of the image were taken, if not at once.
        max_sigma_px : float, optional
            Bound on the scale of the residuals, where it is known: else many edges that do not
            belong to the reference make it so large that they count.
        far : bool, optional
            Whether the starts may be far off: then it begins with edges that are looked up, if
            ``RegistrationConfig.coarse_samples`` asks for that, and ends by ``far_leave_px``.
        first_sigma_px : float, optional
            Floor of the scale before the last stage, where the configured one is lower: edges that
            are so far off count then.

        Returns
        -------
        Alignment
        """
        solver = self._solver
        if max_sigma_px < math.inf:
            solver = solver._replace(max_sigma=max_sigma_px)
        if far:
            solver = solver._replace(leave_px=self._leave_px)
        if first_sigma_px > solver.first_sigma:
            solver = solver._replace(first_sigma=first_sigma_px)
        n = len(samples)
        T, H = np.empty((4, 4)), np.zeros((6, 6))
        matches, packed, trust = np.empty(n, np.int32), np.empty(n), np.empty(n)
        history = np.empty((self._solver.max_iterations, kernels.HISTORY))
        slack = np.empty(6)
        code, iterations, _, sigma, cost, on_planes, fitting, sigma_depth, balance = kernels.align(
            reference.grid,
            reference.near if far and solver.coarse_samples else NOTHING_NEAR,
            reference.edges.profiles,
            samples.points(self._camera),
            samples.gradients,
            samples.profiles,
            self._pinhole,
            np.ascontiguousarray(starts, np.float64),
            self._robust,
            self._normal,
            self._first,
            self._last,
            solver,
            self._stride,
            planes,
            points,
            term,
            lag,
            T,
            H,
            matches,
            packed,
            trust,
            history,
            slack,
        )
        residuals, matched = np.empty(n), np.empty((n, 2), np.float32)
        inliers, agreeing = kernels.judge_matches(
            matches,
            packed,
            reference.edges.pixels,
            reference.edges.gradients,
            samples.gradients,
            self._inlier_px,
            AGREEING,
            residuals,
            matched,
        )
        if lag.steady.size:
            there = kernels.lagged(T, lag)
            apart = lag.T_depth_cam @ kernels.inverted(there) @ se3.exp(lag.bend * slack) @ there
            lag = lag._replace(T_depth_cam=apart)
        return Alignment(
            T_ref_cur=T,
            H=H,
            matches=matches,
            residuals=residuals,
            trust=trust,
            pixels=samples.pixels,
            references=matched,
            inliers=inliers,
            agreeing=agreeing,
            sigma_px=sigma,
            plane_points=on_planes,
            plane_inliers=fitting,
            plane_area=on_planes * points.step_px**2 / (self._camera.width * self._camera.height),
            sigma_depth=sigma_depth,
            depth_balance=balance,
            cost=cost,
            iterations=iterations,
            converged=code in (kernels.CONVERGED, kernels.STALLED),
            reason=REASONS[code],
            history=history[:iterations],
            lag=lag,
            slack=slack,
            slack_px2=sigma**2 + term.edge_doubt**2,
        )
