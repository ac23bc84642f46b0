"""Edges registered by their distance transform: what the paper argues against.

Edges at whole pixels, their depth and sub-sampling are edvo's own, so that a comparison shows what
the matching and the residual are worth: here the nearest edge whatever its direction, looked up in
a distance image, and the unsigned distance to it.

References
----------
M. Kuse, S. Shen, "Robust camera motion estimation using direct edge alignment and sub-gradient
method", ICRA 2016. F. Schenk, F. Fraundorfer, "Robust edge-based visual odometry using
machine-learned edges", IROS 2017 (REVO).
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.baselines import kernels
from edvo.baselines.least_squares import Robust, fit
from edvo.baselines.pairwise import KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import extract_edges
from edvo.frame import Frame
from edvo.kernels import Pinhole
from edvo.sampling import sample_edges
from edvo.sensor import DEPTH_NOISE

FINE = Robust(nu=2.0, floor=1e-3, min_rows=30, max_iterations=50, stop=0.03)
WIDE = replace(FINE, floor=2.0, stop=0.1)  # px; far edges pull first, as in a coarse image
MIN_GAIN = 0.45  # share of inliers beyond what chance gives, over what it leaves to gain
# edvo's own; better on two of three sequences than 0.10 m, 8 deg
KEYFRAMES = KeyframeRule(0.30, 15.0)
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PreparedEdges:
    """The edges of a frame, to be registered and to be registered with.

    Attributes
    ----------
    field : ndarray of float32, shape (H, W)
        Distance to the nearest edge, pixels.
    points : ndarray of float64, shape (N, 3)
        Sampled edges in the camera frame, metres.
    edges : int
        Edge pixels in the image.
    chance : float
        Share of the image's pixels that lie near an edge, as an inlier does.
    """

    field: NDArray[np.float32]
    points: NDArray[np.float64]
    edges: int
    chance: float


class EdgeDistanceAligner:
    """Registers two frames by the distances of one's edges from the other's.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    config : Config, optional
        Edges, sub-sampling and what counts as an inlier; edvo's own where not given. Given or not,
        edges lie in the middle of their pixels: a distance transform knows them no better.
    stages : tuple of Robust
        Weights and stopping, residuals in pixels; each starts where the one before ends.
    """

    def __init__(
        self,
        camera: Camera,
        config: Config | None = None,
        stages: tuple[Robust, ...] = (WIDE, FINE),
    ) -> None:
        self.name = "edge-dt"
        self._camera = replace(camera, distortion=NO_DISTORTION)
        self._config = (config or Config()).with_overrides(["edges.position=pixel"])
        self._stages = stages
        self._pinhole = Pinhole(
            camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
        )

    def prepare(self, frame: Frame) -> PreparedEdges:
        """Extract the edges of a frame, sample them and compute its distance transform."""
        config = self._config
        edges = extract_edges(frame.grey, config.edges)
        samples = sample_edges(
            edges,
            frame.depth,
            self._camera,
            config.sampling,
            config.edges,
            config.seed,
            noise=DEPTH_NOISE[config.planes.sensor],
        )
        holes = np.full(frame.grey.size, 255, np.uint8)
        holes[edges.index] = 0
        field = cv2.distanceTransform(
            holes.reshape(frame.grey.shape), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
        )
        near = np.count_nonzero(field < config.status.inlier_px) / field.size
        return PreparedEdges(
            np.asarray(field, np.float32), samples.points(self._camera), len(edges), near
        )

    def align(
        self,
        reference: PreparedEdges,
        current: PreparedEdges,
        T_ref_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur``; None where edges are few, or too few of them come to lie on edges.

        In an image full of edges any pose puts many samples near one, so chance is taken off.
        """
        if not reference.edges or not len(current.points):
            return None

        def linearise(T: NDArray[np.float64], rows: NDArray[np.float32]) -> int:
            return kernels.distance_rows(reference.field, current.points, T, self._pinhole, rows)

        T = T_ref_guess
        for robust in self._stages:
            found = fit(linearise, T, len(current.points), robust)
            if found is None:
                return None
            T = found.T
        rows = np.empty((len(current.points), kernels.ROW), np.float32)
        count = linearise(T, rows)
        inliers = np.count_nonzero(rows[:count, 0] < self._config.status.inlier_px)
        gain = inliers / len(current.points) - reference.chance
        return T if gain >= MIN_GAIN * (1 - reference.chance) else None


def edge_distance_odometry(
    camera: Camera, *, keyframes: KeyframeRule | None = None
) -> PairwiseOdometry:
    """Make a tracker of edges, distance transform and unsigned residual.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    keyframes : KeyframeRule, optional
        0.30 m or 15 degrees by default; `edvo.baselines.pairwise.FRAME_TO_FRAME` for none.

    Returns
    -------
    PairwiseOdometry
        With ``track``, ``skip``, ``reset`` and ``trajectory``, as `edvo.Odometry`.
    """
    return PairwiseOdometry(camera, EdgeDistanceAligner(camera), keyframes=keyframes or KEYFRAMES)
