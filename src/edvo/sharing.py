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
from edvo.config import PlanesConfig
from edvo.edges import EdgePixels
from edvo.planes import NO_PLANES, NO_POINTS, DepthTerm, PlaneMap, PlanePoints, camera_of
from edvo.registration import EDGES_ALONE, Alignment
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
    config : PlanesConfig
        Its ``edge_doubt_px`` is the most that is believed.
    solver : kernels.Solver
        Of the registration that the alignments come from.
    """

    def __init__(self, camera: Camera, config: PlanesConfig, solver: kernels.Solver) -> None:
        self._cell = camera.width / CELLS
        self._rows = math.ceil(camera.height / self._cell)
        self._camera = camera_of(camera)
        self._most = config.edge_doubt_px
        self._is_measured = config.edge_doubt_rule == "measured" and config.weight > 0
        self._is_capped = config.depth_doubt_rule == "measured" and config.weight > 0
        self._solver = solver
        self.forget()

    def forget(self) -> None:
        """Start anew, from the most that is believed."""
        self._factor, self._sigma = math.nan, 0.0
        self.interrupt()

    def interrupt(self) -> None:
        """Forget what depth errs by together: the next frame is no longer one of these."""
        self._depth_factor, self._seconds = math.nan, 0.0

    @property
    def px(self) -> float:
        """What edges err by together, pixels."""
        if math.isnan(self._factor) or not self._is_measured:
            return self._most
        return min(self._sigma * math.sqrt(max(self._factor - 1.0, 0.0)), self._most)

    @property
    def most(self) -> float:
        """What depth may count at most, times the edges; infinite as long as that is not known."""
        unknown = math.isnan(self._factor) or math.isnan(self._depth_factor)
        if unknown or self._seconds < MEMORY_S:  # one frame has a dozen of the wide cells: too few
            return math.inf
        return FAIR * max(self._factor, 1.0) / max(self._depth_factor, 1.0)

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
        if not alignment.sigma_px:
            return
        share = min(seconds / MEMORY_S, 1.0)
        if self._is_measured or self._is_capped:
            factor = kernels.shared_factor(
                reference.pixels,
                reference.gradients,
                alignment.matches,
                alignment.residuals,
                self._solver.weight,
                self._solver.tuning,
                alignment.sigma_px,
                self._cell,
                self._rows,
                CELLS,
            )
            if not math.isnan(factor):
                self._sigma = alignment.sigma_px
                self._factor = _mean_of_late(self._factor, factor, share)
        if seconds > MEMORY_S:
            self.interrupt()
        elif self._is_capped and alignment.depth_balance > 0:
            factor = kernels.shared_depth_factor(
                planes,
                points,
                self._camera,
                alignment.T_ref_cur,
                alignment.lag,
                term,
                alignment.sigma_depth,
                WIDE * self._cell,
                math.ceil(self._rows / WIDE),
                math.ceil(CELLS / WIDE),
            )
            if not math.isnan(factor):
                self._depth_factor = _mean_of_late(self._depth_factor, factor, share)
                self._seconds += seconds

    def term(self, term: DepthTerm, seconds: float = 0.0) -> DepthTerm:
        """Let depth count by what was measured.

        Parameters
        ----------
        term : DepthTerm
        seconds : float, optional
            Since then.

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
