"""What edges err by together, as far as the frames of late show it.

Not in the paper. Depth counts against edges as if these scattered by more than they do, since what
they err by together no scatter shows (see `planes`). Where that is little, in textured views, depth
would get more than its due. Residuals of one cell of the image tell: as far as they push the same
way, their errors are shared.
"""

import math

from edvo import kernels
from edvo.camera import Camera
from edvo.config import PlanesConfig
from edvo.edges import EdgePixels
from edvo.planes import DepthTerm
from edvo.registration import Alignment
from edvo.uncertainty import CELLS

MEMORY_S = 0.3  # that the mean is taken over: one frame has too few cells


class SharedErrors:
    """Measures what edges err by together, frame after frame.

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
        self._most = config.edge_doubt_px
        self._is_measured = config.edge_doubt_rule == "measured" and config.weight > 0
        self._solver = solver
        self.forget()

    def forget(self) -> None:
        """Start anew, from the most that is believed."""
        self._factor, self._sigma = math.nan, 0.0

    @property
    def px(self) -> float:
        """What edges err by together, pixels."""
        if math.isnan(self._factor):
            return self._most
        return min(self._sigma * math.sqrt(max(self._factor - 1.0, 0.0)), self._most)

    def note(self, reference: EdgePixels, alignment: Alignment, seconds: float) -> None:
        """Take the residuals of a frame into account.

        Parameters
        ----------
        reference : EdgePixels
            The edges that it was registered with.
        alignment : Alignment
            What the registration found.
        seconds : float
            Since the frame before it.
        """
        if not self._is_measured or not alignment.sigma_px:
            return
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
        if math.isnan(factor):
            return
        self._sigma = alignment.sigma_px
        if math.isnan(self._factor):
            self._factor = factor
        self._factor += (factor - self._factor) * min(seconds / MEMORY_S, 1.0)

    def term(self, term: DepthTerm) -> DepthTerm:
        """Let depth count by what was measured.

        Parameters
        ----------
        term : DepthTerm

        Returns
        -------
        DepthTerm
            The same but for ``edge_doubt``.
        """
        return term._replace(edge_doubt=self.px)
