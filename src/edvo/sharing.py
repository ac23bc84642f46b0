"""What edges err by together, and depth, as far as the frames of late show it.

Not in the paper. Depth counts against edges as if these scattered by more than they do, since what
they err by together no scatter shows (see `planes`). Where that is little, in textured views, depth
would get more than its due. Residuals of one cell of the image tell: as far as they push the same
way, their errors are shared. Depth errs over wider stretches than edges, so that its cells are
wider; where much of it is shared, depth gets less than that.
"""

import math

from edvo import kernels
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.planes import (
    NO_PLANES,
    NO_POINTS,
    DepthTerm,
    PlaneMap,
    PlanePoints,
    camera_of,
    thinned,
)
from edvo.registration import AT_ONCE, EDGES_ALONE, Alignment
from edvo.uncertainty import CELLS

MEMORY_S = 0.3  # that the mean is taken over: one frame has too few cells
WIDE = 4  # cells of depth are so many times as wide as those of edges, and as high,
FAIR = 4.0  # and hold more of what is shared: so many times their ratio is fair


class SharedErrors:
    """Measures what edges err by together, and what depth does, frame after frame.

    Parameters
    ----------
    camera : Camera
        Of the images.
    config : Config
        Its ``planes.edge_doubt_px`` is the most that is believed of edges; what is measured at all
        is what its rules ask for.
    solver : kernels.Solver
        Of the registration that the alignments come from.
    """

    def __init__(self, camera: Camera, config: Config, solver: kernels.Solver) -> None:
        self._cell = camera.width / CELLS
        self._rows = math.ceil(camera.height / self._cell)
        self._camera = camera_of(camera)
        self._step_px = config.planes.point_step_px
        planes, sampling = config.planes, config.sampling
        self._most = planes.edge_doubt_px
        self._is_measured = planes.edge_doubt_rule == "measured" and planes.weight > 0
        self._is_capped = planes.depth_doubt_rule == "measured" and planes.weight > 0
        self._asks_depth = self._is_capped or (planes.finer == "measured" and planes.weight > 0)
        self._asks_edges = self._is_measured or self._asks_depth or sampling.max_growth > 1
        self._solver = solver
        self.forget()

    def forget(self) -> None:
        """Start anew, from the most that is believed."""
        self._share, self._count, self._sigma = math.nan, 0, 0.0
        self._wide_share, self._matches = math.nan, 0
        self.interrupt()

    def interrupt(self) -> None:
        """Forget what depth errs by together: the next frame is no longer one of these."""
        self._depth_share, self._depth_count, self._seconds = math.nan, 0, 0.0

    @property
    def px(self) -> float:
        """What edges err by together, pixels."""
        if math.isnan(self._share) or not self._is_measured:
            return self._most
        return min(self._sigma * math.sqrt(max(self._share, 0.0) * self._count), self._most)

    @property
    def most(self) -> float:
        """What depth may count at most, times the edges; infinite as long as that is not known."""
        if not self._is_capped or math.isnan(self._share) or math.isnan(self.depth_share):
            return math.inf
        factor = 1.0 + max(self._share, 0.0) * self._count
        return FAIR * factor / (1.0 + max(self._depth_share, 0.0) * self._depth_count)

    @property
    def matches(self) -> int:
        """How many samples of the last frame had a match."""
        return self._matches

    @property
    def scatter_px(self) -> float:
        """By how much edges scattered, pixels, in the last frame that told; 0 where none did."""
        return self._sigma

    @property
    def edge_share(self) -> float:
        """What each sample adds to the ratio of wide cells; NaN where that is not known."""
        return self._wide_share

    @property
    def depth_share(self) -> float:
        """What each point of depth adds to the ratio of wide cells; NaN where it is not known."""
        # One frame has a dozen of them: too few.
        return self._depth_share if self._seconds >= MEMORY_S else math.nan

    def note(
        self,
        reference: EdgePixels,
        alignment: Alignment,
        seconds: float,
        planes: PlaneMap = NO_PLANES,
        points: PlanePoints = NO_POINTS,
        term: DepthTerm = EDGES_ALONE,
    ) -> None:
        """Take the residuals of a frame into account.

        Parameters
        ----------
        reference : EdgePixels
            The edges that it was registered with.
        alignment : Alignment
            What the registration found.
        seconds : float
            Since the frame before it.
        planes : PlaneMap, optional
            The planes that it was registered with.
        points : PlanePoints, optional
            The points that were.
        term : DepthTerm, optional
            How they are compared.
        """
        self._matches = alignment.match_count
        if not alignment.sigma_px:
            return
        share = min(seconds / MEMORY_S, 1.0)
        if self._asks_edges:
            factor, wide = self._edge_factors(reference, alignment)
            if not math.isnan(factor):
                self._sigma, self._count = alignment.sigma_px, self._matches
                each, each_wide = (factor - 1.0) / self._count, (wide - 1.0) / self._count
                self._share = _mean_of_late(self._share, each, share)
                self._wide_share = _mean_of_late(self._wide_share, each_wide, share)
        if seconds > MEMORY_S:
            self.interrupt()
        elif self._asks_depth and alignment.depth_balance > 0:
            few = thinned(points, self._step_px)  # as many as usual tell enough
            factor = kernels.shared_depth_factor(
                planes,
                few,
                self._camera,
                alignment.T_ref_cur,
                AT_ONCE,  # they lie where the camera was by now
                term,
                alignment.sigma_depth,
                WIDE * self._cell,
                math.ceil(self._rows / WIDE),
                math.ceil(CELLS / WIDE),
            )
            if not math.isnan(factor):
                self._depth_count = alignment.plane_points
                asked = self._depth_count * (points.step_px / few.step_px) ** 2
                each = (factor - 1.0) / asked
                self._depth_share = _mean_of_late(self._depth_share, each, share)
                self._seconds += seconds

    def _edge_factors(self, reference: EdgePixels, alignment: Alignment) -> tuple[float, float]:
        """By what cells add to the variance: the usual ones, and wide ones."""
        return kernels.shared_factors(
            reference.pixels,
            reference.gradients,
            alignment.matches,
            alignment.residuals,
            alignment.trust,
            self._solver.weight,
            self._solver.tuning,
            alignment.sigma_px,
            self._cell,
            self._rows,
            CELLS,
            WIDE,
        )

    def term(self, term: DepthTerm, seconds: float = 0.0) -> DepthTerm:
        """Let depth count by what was measured.

        Parameters
        ----------
        term : DepthTerm
        seconds : float, optional
            Since the frame that was noted last.

        Returns
        -------
        DepthTerm
            The same but for ``edge_doubt`` and ``most``.
        """
        most = self.most if seconds <= MEMORY_S else math.inf
        return term._replace(edge_doubt=self.px, most=most)


def _mean_of_late(mean: float, value: float, share: float) -> float:
    """Move a mean by a share of the way to a value; the first one is taken whole."""
    return value if math.isnan(mean) else mean + (value - mean) * share
