"""What an image looks like, to know a place again by: where in it edges of which direction lie."""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.edges import EdgePixels

ROWS, COLS = 4, 6  # cells that an image is summed up by,
ENOUGH = 8000  # and so many edges at least, where there are as many


class Look:
    """The look of an image; it is worked out when it is first asked for.

    Parameters
    ----------
    edges : EdgePixels
        Of the image; their depth does not matter.
    camera : Camera
    """

    def __init__(self, edges: EdgePixels, camera: Camera) -> None:
        self._edges = edges
        self._camera = camera
        self._shares: NDArray[np.float64] | None = None

    @property
    def shares(self) -> NDArray[np.float64]:
        """Roots of the shares of edges, by cell and direction of lines, shape (96,)."""
        if self._shares is None:
            few = self._edges.every(max(len(self._edges) // ENOUGH, 1))
            self._shares = np.empty(ROWS * COLS * kernels.LINE_DIRECTIONS)
            kernels.summarise_edges(
                few.pixels,
                few.gradients,
                self._camera.width,
                self._camera.height,
                ROWS,
                COLS,
                self._shares,
            )
        return self._shares

    def likeness(self, other: "Look") -> float:
        """Say how much two images look alike.

        Parameters
        ----------
        other : Look

        Returns
        -------
        float
            From 0 to 1, which it is where they are the same.
        """
        return float(self.shares @ other.shares)
