"""Directional chamfer matching: where a frame may belong, told at a glance from its edges alone.

After Liu, Tuzel, Veeraraghavan and Chellappa, *Fast Directional Chamfer Matching*, CVPR 2010: how
near an edge of like direction is stands in a small image, for each direction, so that a pose is
judged by one look-up an edge and hundreds of poses cost no more than one registration. Poses that
score well are climbed from; where that leads is where registration starts.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.planes import camera_of

CELL_PX = 4.0  # of the small images
REACH_CELLS = 6.0  # an edge so far away is none
# What a step to the next cell takes of 255, and one to a corner: those of OpenCV's 3 x 3 mask.
STRAIGHT, SLANT = (np.uint8(round(255 / REACH_CELLS * step)) for step in (0.955, 1.3693))
STEP_DEG = 3.0  # of the turns that are tried first; half the reach of an edge, or less
ROLL_DEG = 5.0  # one roll to either side; edges of the next direction count, too
TRIED_EDGES = 250  # a pose is judged by so many edges, at least
IN_VIEW = 0.5  # share of these that counts as being in view, at least
LONGEST_M = 0.4  # no longer way is tried
ASKED = 64  # poses that all of these edges judge, after a quarter of them has judged all
CLIMBED = 8  # poses that are climbed from
APART_DEG = 3.0  # between them, or a way that moves the image as far
BESIDE = 4  # poses that are climbed from beside a place that is known
ANYWHERE = 1e3  # m; a bound that leaves poses to be told apart by their turns alone
CLIMB_M, CLIMB_DEG = 0.1, 1.5  # first steps of a climb
HALVINGS, ROUNDS = 3, 2  # lengths of step, each half the last; steps of each length, at most
ALONG_PX = 2.0  # between places along a motion, by how far edges move
CHANCE_PX = 40.0  # that edges are looked at to either side of where they are
CLEARER = 20.0  # of 255: by so much they fall better there than where they are
ELSEWHERE_PX = 12.0  # farther than that it is another place
AS_WELL = 0.96  # of the score of a place: by a glance that cannot be told from it


class Guess(NamedTuple):
    """A pose that registration may start from.

    Attributes
    ----------
    score : float
        Mean score of the edges, up to 255.
    T_ref_cur : ndarray of float64, shape (4, 4)
    """

    score: float
    T_ref_cur: NDArray[np.float64]


class ChamferMap:
    """How near each place of an image is to an edge of each direction.

    It is worked out when it is first asked for.

    Parameters
    ----------
    edges : EdgePixels
        Of the reference image; their depth does not matter.
    camera : Camera
        Of both images.
    """

    def __init__(self, edges: EdgePixels, camera: Camera) -> None:
        self._edges = edges
        self._camera = camera
        self._scores: NDArray[np.uint8] | None = None
        self._asked: tuple[EdgePixels, kernels.Chamfer] | None = None  # last, as it is asked again

    def prepare(self) -> NDArray[np.uint8]:
        """Work it out, unless it is already: as early as in a frame that has time to spare.

        Returns
        -------
        ndarray of uint8, shape (rows + 2, cols + 2, DIRECTIONS)
            By `score_image`.
        """
        if self._scores is None:
            self._scores = score_image(self._edges, self._camera.width, self._camera.height)
        return self._scores

    def likely(
        self,
        samples: EdgePixels,
        T_ref_start: NDArray[np.float64],
        reach_deg: float,
        count: int,
        *,
        carried: bool = True,
    ) -> list[Guess]:
        """Find poses whose edges fall near edges of like direction.

        Parameters
        ----------
        samples : EdgePixels
            Of the current image, with depth.
        T_ref_start : ndarray of float64, shape (4, 4)
            Turns of the camera are tried about its axes from here.
        reach_deg : float
            How far it may have turned by yaw, and half as far by pitch.
        count : int
            How many poses at most; no more than ``CLIMBED`` are found.
        carried : bool
            Whether ways that move the image as far are tried, too.

        Returns
        -------
        list of Guess
            The likeliest first.
        """
        starts = T_ref_start @ _turns(reach_deg)
        middle = 0.0
        if carried and len(samples):
            middle = float(np.median(samples.depths))
            ways = middle * _shifts(reach_deg)
            ways = ways[np.hypot(*ways[:, :2].T) <= LONGEST_M]
            shifted = np.tile(T_ref_start, (len(ways), 1, 1))
            shifted[:, :3, 3] += ways @ T_ref_start[:3, :3].T
            starts = np.concatenate([starts, shifted])
        apart = math.radians(APART_DEG)
        return self._climb(samples, starts, CLIMBED, apart, apart * middle or ANYWHERE)[:count]

    def beside(self, samples: EdgePixels, T_ref_starts: NDArray[np.float64]) -> list[Guess]:
        """Find where edges fall best, beside the best of some poses.

        Parameters
        ----------
        samples : EdgePixels
            Of the current image, with depth.
        T_ref_starts : ndarray of float64, shape (K, 4, 4)

        Returns
        -------
        list of Guess
            At most ``BESIDE``, the likeliest first.
        """
        return self._climb(samples, T_ref_starts, min(BESIDE, len(T_ref_starts)), 0.0, 0.0)

    def along(
        self,
        samples: EdgePixels,
        T_ref_cur: NDArray[np.float64],
        twist: NDArray[np.float64],
        reach_px: float,
    ) -> NDArray[np.float64] | None:
        """Find where along a motion edges fall clearly better, and nowhere else as well.

        Parameters
        ----------
        samples : EdgePixels
            Of the current image, with depth, that tell of the motion.
        T_ref_cur : ndarray of float64, shape (4, 4)
            Where it begins.
        twist : ndarray of float64, shape (6,)
            [v, w] of the reference camera, by which they move by a pixel.
        reach_px : float
            How far to either side.

        Returns
        -------
        ndarray of float64, shape (4, 4), or None
            None where they fall no better elsewhere, or as well in two places.
        """
        ways, scores = self._sweep(samples, T_ref_cur, twist, reach_px)
        best = int(np.argmax(scores))
        if scores[best] < scores[len(ways) // 2] + CLEARER:
            return None
        elsewhere = np.abs(ways - ways[best]) > ELSEWHERE_PX
        is_alone = scores[elsewhere].max(initial=0.0) <= AS_WELL * scores[best]
        return se3.exp(ways[best] * twist) @ T_ref_cur if is_alone else None

    def stands_out(
        self, samples: EdgePixels, T_ref_cur: NDArray[np.float64], twist: NDArray[np.float64]
    ) -> bool:
        """Whether edges fall clearly better where they are than elsewhere along a motion.

        Parameters
        ----------
        samples : EdgePixels
            Of the current image, with depth, that tell of the motion.
        T_ref_cur : ndarray of float64, shape (4, 4)
        twist : ndarray of float64, shape (6,)
            [v, w] of the reference camera, by which they move by a pixel.

        Returns
        -------
        bool
            Than in the median, beyond what is next to it.
        """
        ways, scores = self._sweep(samples, T_ref_cur, twist, CHANCE_PX)
        elsewhere = np.abs(ways) > ELSEWHERE_PX
        return bool(scores[len(ways) // 2] > np.median(scores[elsewhere]) + CLEARER)

    def _sweep(
        self,
        samples: EdgePixels,
        T_ref_cur: NDArray[np.float64],
        twist: NDArray[np.float64],
        reach_px: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How well edges fall along a motion: how far, px, and their scores."""
        steps = int(reach_px / ALONG_PX)
        ways = ALONG_PX * np.arange(-steps, steps + 1, dtype=np.float64)
        scores = np.empty(2 * steps + 1)
        kernels.chamfer_sweep(self._problem(samples), T_ref_cur, twist, ALONG_PX, scores)
        return ways, scores

    def score(self, samples: EdgePixels, T_ref_cur: NDArray[np.float64]) -> float:
        """Say how near edges fall to edges of like direction.

        Parameters
        ----------
        samples : EdgePixels
            Of the current image, with depth.
        T_ref_cur : ndarray of float64, shape (4, 4)

        Returns
        -------
        float
            Up to 255, as that of a `Guess`.
        """
        problem = self._problem(samples)
        return kernels.chamfer_score(problem, T_ref_cur, np.empty_like(problem.directions))

    def _climb(
        self,
        samples: EdgePixels,
        starts: NDArray[np.float64],
        count: int,
        apart_rad: float,
        apart_m: float,
    ) -> list[Guess]:
        """Climb from the best starts that are so far apart, by turn or way."""
        found, scores = np.empty((count, 4, 4)), np.empty(count)
        n = kernels.chamfer_search(
            self._problem(samples),
            starts,
            1 + 2 * math.cos(apart_rad),
            apart_m,
            ASKED,
            CLIMB_M,
            math.radians(CLIMB_DEG),
            HALVINGS,
            ROUNDS,
            found,
            scores,
        )
        order = np.argsort(-scores[:n], kind="stable")
        return [Guess(float(scores[i]), found[i]) for i in order]

    def _problem(self, samples: EdgePixels) -> kernels.Chamfer:
        if self._asked is not None and self._asked[0] is samples:
            return self._asked[1]
        scores = self.prepare()
        few = samples.every(max(len(samples) // TRIED_EDGES, 1))
        directions = np.empty(len(few), np.int32)
        kernels.directions_of(few.gradients, directions)
        rows, cols, _ = scores.shape
        spread = np.argsort(np.arange(len(few)) % 4, kind="stable")  # the first quarter: all over
        problem = kernels.Chamfer(
            scores.ravel(),
            rows,
            cols,
            CELL_PX,
            np.ascontiguousarray(few.points(self._camera)[spread].T, np.float32),
            directions[spread],
            camera_of(self._camera),
            IN_VIEW,
        )
        self._asked = samples, problem
        return problem


def score_image(edges: EdgePixels, width: int, height: int) -> NDArray[np.uint8]:
    """Say for each cell and direction how near an edge is that is turned alike, or nearly so.

    Parameters
    ----------
    edges : EdgePixels
    width, height : int
        Of the image, px.

    Returns
    -------
    ndarray of uint8, shape (rows + 2, cols + 2, DIRECTIONS)
        255 on an edge of this direction or of one beside it, next to 0 from ``REACH_CELLS`` on, and
        0 in the first and last row and column, which lie beside the image.
    """
    rows, cols = math.ceil(height / CELL_PX), math.ceil(width / CELL_PX)
    scores = np.zeros((rows + 2, cols + 2, kernels.DIRECTIONS), np.uint8)
    kernels.chamfer_scores(edges.pixels, edges.gradients, CELL_PX, STRAIGHT, SLANT, scores)
    return scores


@functools.lru_cache(4)
def _turns(reach_deg: float) -> NDArray[np.float64]:
    """Turns of a camera about its own axes: a hand turns it faster than it carries it."""
    yaws, pitches = int(reach_deg / STEP_DEG), int(reach_deg / 2 / STEP_DEG)
    turns = np.array(
        [
            se3.exp(np.radians([0.0, 0.0, 0.0, STEP_DEG * pitch, STEP_DEG * yaw, ROLL_DEG * roll]))
            for yaw in range(-yaws, yaws + 1)
            for pitch in range(-pitches, pitches + 1)
            for roll in (-1, 0, 1)
        ]
    )
    turns.setflags(write=False)
    return turns


@functools.lru_cache(4)
def _shifts(reach_deg: float) -> NDArray[np.float64]:
    """Ways of a camera that move the image as turns do, for each metre that it is away."""
    yaws, pitches = int(reach_deg / STEP_DEG), int(reach_deg / 2 / STEP_DEG)
    shifts = np.array(
        [
            [math.tan(math.radians(STEP_DEG * yaw)), -math.tan(math.radians(STEP_DEG * pitch)), 0.0]
            for yaw in range(-yaws, yaws + 1)
            for pitch in range(-pitches, pitches + 1)
        ]
    )
    shifts.setflags(write=False)
    return shifts
