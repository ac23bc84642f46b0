"""A feature-based odometry made of OpenCV's parts: ORB features and PnP with RANSAC.

References
----------
E. Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011. The guided matching
and the spreading of features over the image are those of R. Mur-Artal, J. D. Tardos, "ORB-SLAM2",
T-RO 2017, without its map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines import kernels
from edvo.baselines.pairwise import KeyframeRule, PairwiseOdometry
from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.edges import depth_at_edges
from edvo.frame import Frame

FEATURES = 1500  # kept in an image
CANDIDATES = 6000  # detected, to choose from
FAST_THRESHOLD = 3  # low, for plain panels: .010 m/s over seeds, .026 with 5, .012 with 2
CELL_PX = 40  # of the grid that spreads features
LEVELS, SCALE = 8, 1.2  # of the pyramid, as ORB-SLAM2
RADIUS_PX = 20.0  # of the search round the predicted position
EVERYWHERE_PX = 1e6
MAX_BITS = 64  # of 256 in which a match may differ
RATIO = 0.85  # best to second best, in bits
REPROJECTION_PX = 2.0  # of an inlier
MIN_INLIERS = 20
MIN_SHARE = 0.3  # of the matches that have to be inliers
RANSAC_ITERATIONS = 500
CONFIDENCE = 0.999


@dataclass(frozen=True, slots=True)
class Features:
    """The features of a frame.

    Attributes
    ----------
    pixels : ndarray of float32, shape (N, 2)
    octaves : ndarray of int32, shape (N,)
        Level of the pyramid.
    descriptors : ndarray of uint64, shape (N, 4)
    depths : ndarray of float32, shape (N,)
        Metres; 0 where missing.
    """

    pixels: NDArray[np.float32]
    octaves: NDArray[np.int32]
    descriptors: NDArray[np.uint64]
    depths: NDArray[np.float32]


class OrbAligner:
    """Registers two frames by their ORB features.

    Parameters
    ----------
    camera : Camera
        Its pinhole part; frames must be free of distortion.
    seed : int
        Of RANSAC.
    """

    def __init__(self, camera: Camera, *, seed: int = 0) -> None:
        self.name = "orb-pnp"
        self._camera = camera
        self._matrix = camera.matrix
        self._depth = EdgesConfig()
        self._orb = cv2.ORB.create(
            nfeatures=CANDIDATES,
            scaleFactor=SCALE,
            nlevels=LEVELS,
            fastThreshold=FAST_THRESHOLD,
        )
        self._ransac = cv2.UsacParams()
        self._ransac.randomGeneratorState = seed
        self._ransac.threshold = REPROJECTION_PX
        self._ransac.maxIterations = RANSAC_ITERATIONS
        self._ransac.confidence = CONFIDENCE
        self._ransac.isParallel = False

    def prepare(self, frame: Frame) -> Features:
        """Detect features, spread over the image, and look up their depths."""
        spread = self._spread(self._orb.detect(frame.grey), frame.grey.shape[1])
        keypoints, descriptors = self._orb.compute(frame.grey, spread)
        if not len(keypoints):
            descriptors = np.empty((0, 32), np.uint8)
        pixels = np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2)
        nearest = np.rint(pixels).astype(np.int32)
        index = nearest[:, 1] * np.int32(frame.grey.shape[1]) + nearest[:, 0]
        return Features(
            pixels,
            np.array([k.octave for k in keypoints], np.int32),
            np.ascontiguousarray(descriptors).view(np.uint64),
            depth_at_edges(frame.depth, index, self._depth),
        )

    def _spread(self, keypoints: Sequence[cv2.KeyPoint], width: int) -> list[cv2.KeyPoint]:
        """Keep the strongest of each cell in turn, until there are enough."""
        if len(keypoints) <= FEATURES:
            return list(keypoints)
        response = np.array([k.response for k in keypoints])
        pixels = np.array([k.pt for k in keypoints])
        cell = (pixels[:, 1] // CELL_PX) * (width // CELL_PX + 1) + pixels[:, 0] // CELL_PX
        order = np.lexsort((-response, cell))
        first = np.concatenate([[True], np.diff(cell[order]) != 0])
        start = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
        rank = np.arange(len(order)) - start
        kept = order[np.argsort(rank, kind="stable")[:FEATURES]]
        return [keypoints[i] for i in np.sort(kept)]

    def align(
        self, reference: Features, current: Features, T_ref_guess: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Give ``T_ref_cur``; None where too few features agree on a motion.

        Matches are sought near where the guess puts them, and in the whole image if that fails.
        """
        with_depth = np.flatnonzero(reference.depths > 0)
        if len(with_depth) < MIN_INLIERS or len(current.pixels) < MIN_INLIERS:
            return None
        depths = reference.depths[with_depth].astype(np.float64)
        rays = (reference.pixels[with_depth] - self._matrix[:2, 2]) / np.diag(self._matrix)[:2]
        points = np.column_stack([rays * depths[:, None], depths])
        guess = se3.inverse(T_ref_guess)
        seen = points @ guess[:3, :3].T + guess[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            predicted = seen[:, :2] / seen[:, 2:] * np.diag(self._matrix)[:2] + self._matrix[:2, 2]
        predicted[~(seen[:, 2] > kernels.MIN_DEPTH)] = np.inf
        for radius in (RADIUS_PX, EVERYWHERE_PX):
            matches = np.empty(len(points), np.int32)
            kernels.match_near(
                predicted.astype(np.float32),
                current.pixels,
                reference.descriptors[with_depth],
                current.descriptors,
                reference.octaves[with_depth],
                current.octaves,
                radius,
                MAX_BITS,
                RATIO,
                matches,
            )
            matched = matches >= 0
            T_cur_ref = self._solve(points[matched], current.pixels[matches[matched]])
            if T_cur_ref is not None:
                return se3.inverse(T_cur_ref)
        return None

    def _solve(
        self, points: NDArray[np.float64], pixels: NDArray[np.float32]
    ) -> NDArray[np.float64] | None:
        """Motion that puts the points on their pixels; None where too few of them agree."""
        if len(points) < MIN_INLIERS:
            return None
        observed = pixels.astype(np.float64)
        found, _, rotation, translation, inliers = cv2.solvePnPRansac(
            points, observed, self._matrix.copy(), None, params=self._ransac
        )
        if not found or inliers is None:
            return None
        chosen = inliers.ravel()
        enough = max(MIN_INLIERS, MIN_SHARE * len(points))
        for _ in range(2):  # inliers of the refined pose, which are more than RANSAC's
            if len(chosen) < enough:
                return None
            rotation, translation = cv2.solvePnPRefineLM(
                points[chosen], observed[chosen], self._matrix, None, rotation, translation
            )
            projected, _ = cv2.projectPoints(points, rotation, translation, self._matrix, None)
            error = np.linalg.norm(projected.reshape(-1, 2) - observed, axis=1)
            chosen = np.flatnonzero(error < REPROJECTION_PX)
        if len(chosen) < enough:
            return None
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(rotation)[0]
        T[:3, 3] = translation.ravel()
        return T


def orb_odometry(
    camera: Camera, *, keyframes: KeyframeRule | None = None, seed: int = 0
) -> PairwiseOdometry:
    """Make a tracker of ORB features and PnP.

    Parameters
    ----------
    camera : Camera
        Of the frames to come; frames of a lens that distorts are undistorted first.
    keyframes : KeyframeRule, optional
        0.10 m or 8 degrees by default; `edvo.baselines.pairwise.FRAME_TO_FRAME` for none.
    seed : int
        Of RANSAC; the same one gives the same trajectory.

    Returns
    -------
    PairwiseOdometry
        With ``track``, ``skip``, ``reset`` and ``trajectory``, as `edvo.Odometry`.
    """
    return PairwiseOdometry(camera, OrbAligner(camera, seed=seed), keyframes=keyframes)
