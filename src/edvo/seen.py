"""A frame, and what is made of it before its pose is known."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo.edges import EdgeImage, EdgePixels
from edvo.frame import Frame
from edvo.planes import PlanePoints


@dataclass(frozen=True, slots=True)
class Seen:
    """A frame, and what was made of it.

    Attributes
    ----------
    frame : Frame
    edges : EdgeImage
        All of its edges.
    samples : EdgePixels
        N of them with depth, metres.
    points : PlanePoints
        M points of its depth image.
    T_cam_depth : ndarray of float64, shape (4, 4), or None
        Maps points of the depth image to the camera at the instant of the grey image; the points
        were moved by it already. None where both were taken at once.
    is_fine : bool
        Whether its points lie closely.
    is_near : bool
        Whether all edges of the keyframe may count.
    is_stale : bool
        Whether its depth is that of a frame before, moved by what the camera was expected to.
    is_parted : bool
        Whether samples were taken from it that the camera carries with it.
    without_movers : bool
        Whether what is near to where something moved was taken from it.
    """

    frame: Frame
    edges: EdgeImage
    samples: EdgePixels
    points: PlanePoints
    T_cam_depth: NDArray[np.float64] | None = None
    is_fine: bool = False
    is_near: bool = False
    is_stale: bool = False
    is_parted: bool = False
    without_movers: bool = False

    def kept(self) -> "Seen":
        """Give the same with images that nobody writes to, as the next frame may to those it has.

        Returns
        -------
        Seen
        """
        return replace(self, frame=self.frame.kept())

    def T_world_depth(self, T_world_cam: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the camera was as the depth was taken that belongs to an image taken there.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4)
            Of the image.

        Returns
        -------
        ndarray of float64, shape (4, 4)
        """
        return T_world_cam if self.T_cam_depth is None else T_world_cam @ self.T_cam_depth
