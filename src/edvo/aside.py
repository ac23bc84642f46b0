"""A few pixels beside where a frame is expected: dense texture fits almost anywhere.

Not in the paper. Where strokes and gaps are a few pixels wide, as in print, edges that begin two
pixels off find others that look alike, and most of them fit those well enough. From the other side
the same edges may be led to their own. A camera that has just begun, or was knocked, begins there.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo.hunting import STRIDE
from edvo.kit import Kit
from edvo.planes import DepthTerm, thinned
from edvo.registrar import Registrar
from edvo.registration import Alignment
from edvo.scatter import SURE, clarity, is_sharper
from edvo.seen import Seen

SIDES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])


class Aside:
    """Registers frames from beside where they were expected.

    Parameters
    ----------
    kit : Kit
    registrar : Registrar

    Attributes
    ----------
    is_on : bool
        Whether it does.
    """

    def __init__(self, kit: Kit, registrar: Registrar) -> None:
        self._registrar = registrar
        self._point_step_px = kit.config.planes.point_step_px
        px, camera = kit.config.motion.aside_px, kit.camera
        self.is_on = px > 0
        self._ways = px * SIDES / [camera.fx, camera.fy, 1.0]  # for each metre of depth

    def look(
        self, seen: Seen, start: NDArray[np.float64], term: DepthTerm, found: Alignment
    ) -> Alignment:
        """Register a frame from each side, with few samples, and from the clearest with all.

        Parameters
        ----------
        seen : Seen
            The frame.
        start : ndarray of float64, shape (4, 4)
            Where it was expected, relative to the keyframe.
        term : DepthTerm
            How depth counts.
        found : Alignment
            Where that has led.

        Returns
        -------
        Alignment
            ``found``, where eight tenths of the edges agree to that, no side is clearly sharper, or
            there is no depth to be held against.
        """
        is_asked = self.is_on and len(seen.points.sigma) > 0
        if not is_asked or found.agreeing >= SURE * len(found.matches):
            return found
        usual = thinned(seen.points, self._point_step_px)
        few = replace(seen, samples=seen.samples.every(STRIDE), points=usual)
        best = max(
            (
                self._registrar.register(few, T[None], term)
                for T in self._starts(start, float(np.median(few.samples.depths)))
            ),
            key=clarity,
        )
        thinning = len(seen.points.sigma) / max(len(usual.sigma), 1)
        if not is_sharper(best, found, STRIDE, thinning):
            return found
        again = self._registrar.register(seen, best.T_ref_cur[None], term)
        return again if is_sharper(again, found) else found

    def _starts(self, start: NDArray[np.float64], depth: float) -> NDArray[np.float64]:
        """Move a pose to each side, by so much that what is so far away moves in the image."""
        starts = np.tile(start, (len(SIDES), 1, 1))
        starts[:, :3, 3] += depth * self._ways @ start[:3, :3].T
        return starts
