"""Which edges are likely to be observed again: where in the image, and along which lines.

Not in the paper. Edges that tell much are not worth drawing where they come and go, or belong to
what moves: after the re-observation probability of EdgeSLAM (T-RO 2025), told here by how well the
samples of late fitted.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.registration import Alignment
from edvo.robust import TUNING

CELL_PX = 32  # about: whole ones share the image
FADES = 0.8  # of what is known, from one tracked frame to the next
GUESSES = 2.0  # a cell starts as if so many of its samples had fitted
GUESS = 0.8  # as well as that
EMPHASIS = 3  # where edges err, those that seem to fit are not to be trusted fully, either


class Reobserved:
    """Remembers how well edges fitted, by cells of the image and directions of lines.

    Parameters
    ----------
    camera : Camera
        Of the images.
    """

    def __init__(self, camera: Camera) -> None:
        self._size = camera.height, camera.width
        rows, cols = (-(-side // CELL_PX) for side in self._size)
        self._shape = rows, cols, kernels.LINE_DIRECTIONS
        self.forget()

    def forget(self) -> None:
        """Start anew, from the same guess everywhere."""
        self._fitted = np.zeros(np.prod(self._shape))
        self._asked = np.zeros(np.prod(self._shape))

    def note(self, samples: EdgePixels, alignment: Alignment) -> None:
        """Take the residuals of a frame into account.

        Parameters
        ----------
        samples : EdgePixels
            N edges of the frame.
        alignment : Alignment
            What they were registered by.
        """
        if not alignment.sigma_px:
            return
        rows, cols, lines = self._shape
        height, width = self._size
        u, v = samples.pixels.T  # a lens moves edges by little, as against a cell
        row = np.clip(v * (rows / height), 0, rows - 1).astype(np.intp)
        col = np.clip(u * (cols / width), 0, cols - 1).astype(np.intp)
        directions = np.empty(len(samples), np.int32)
        kernels.directions_of(samples.gradients, directions)
        cell = (row * cols + col) * lines + directions % lines
        share = np.nan_to_num(alignment.residuals, nan=np.inf) * alignment.trust
        share /= alignment.sigma_px
        weight = np.maximum(1 - (share / TUNING["tukey"]) ** 2, 0) ** 2
        self._fitted = FADES * self._fitted + np.bincount(cell, weight, self._fitted.size)
        self._asked = FADES * self._asked + np.bincount(cell, minlength=self._asked.size)

    @property
    def worth(self) -> NDArray[np.float32]:
        """What an edge is worth, 0 to 1.

        Returns
        -------
        ndarray of float32, shape (rows, cols, 4)
            By place in the image and by direction of the line, as `kernels.draw_informative` has
            them.
        """
        share = (self._fitted + GUESSES * GUESS) / (self._asked + GUESSES)
        return (share**EMPHASIS).astype(np.float32).reshape(self._shape)
