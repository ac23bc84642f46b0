"""What a camera carries with it: dirt on its lens, print in its images, a gripper before it.

Not in the paper. Such edges stay where they are in the image, and say that the camera stands still.
While it moves they are told from others by that: each ought to lie elsewhere by now, across itself.
"""

import logging
import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import NO_TABLE, EdgeBuffers, EdgeImage, EdgePixels
from edvo.planes import camera_of
from edvo.seen import Seen

logger = logging.getLogger(__name__)

APART_PX = 4.0  # along its gradient: so far an edge has moved on for certain
MOVED = 0.3  # of the samples: then the view has moved
STRIDE = 4  # one sample in so many tells that
LONGEST = 10  # frames that a reference serves, if the view moves
SOON, SELDOM = 2, 64  # frames from one look to the next: at first, and where hardly an edge stays
PAUSE = 5  # the same where the view has not moved
LEAST, MANY = 10, 100  # edges that have stayed in most of the looks: some, and not few
MOST = 0.5  # of what ought to have moved: if more stays, it is the pose that is wrong
LEAST_HITS, FULL = 4, 32  # looks that an edge has stayed in; after so many they count half
CHANCE, BESIDE = 1e-4, 2.5  # that an edge is said to stay; how many of them lie beside a pixel
OFTEN, HARDLY = 0.6, 3  # of the looks, and times as often as an edge there has not stayed
NEAR_PX, LEAST_NEAR = 9, 20  # so many of a square are carried, or none is: chance is scattered
GROWS_PX = 12  # from there what else stays is carried, too
REACH_PX = 3  # of an edge to each side
LARGEST = 0.5  # of the image: nobody can see past more


class Stays(NamedTuple):
    """Which samples of a frame lie where the reference had an edge that is turned alike.

    Attributes
    ----------
    stays : ndarray of bool, shape (N,)
    moves : ndarray of bool, shape (N,)
        Which ought to lie elsewhere by now.
    sought : ndarray of bool, shape (N,)
        Which of these were not seen, either, where they ought to have come from.
    """

    stays: NDArray[np.bool_]
    moves: NDArray[np.bool_]
    sought: NDArray[np.bool_]

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which are the camera's, by all that this look tells."""
        return self.stays & self.sought

    @property
    def view_moves(self) -> bool:
        """Whether the view has moved since."""
        return bool(self.moves.sum() >= MOVED * len(self.moves))

    @property
    def share(self) -> float:
        """Of those that ought to lie elsewhere, how many do not, nor were seen there."""
        moved = int(self.moves.sum())
        return int(self.own.sum()) / moved if moved else 0.0


class Carried:
    """Learns which edges stay in the image while the view moves.

    Parameters
    ----------
    camera : Camera
        Of the frames to come.
    buffers : EdgeBuffers
        Told where no edge is to be taken.
    """

    def __init__(self, camera: Camera, buffers: EdgeBuffers) -> None:
        self._pinhole, self._buffers = camera_of(camera), buffers
        self._table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
        self._shape = camera.height, camera.width
        self.forget()

    def forget(self) -> None:
        """Take all edges again."""
        # filled: what is only said to be zero is given its memory by the frame that writes there
        images = np.full((5, *self._shape), 0, np.uint8)
        self._marks, self._room, self._counts = images[0], images[1], images[2:]
        self._looks = 0
        self._by_chance = self._rest = 0.0  # of late
        self._age = self._left = 0  # frames that the reference is old, and until the next look
        self._wait = SOON
        self._buffers.shown = None
        self.forget_view()

    @property
    def shown(self) -> NDArray[np.uint8] | None:
        """0 at the raw pixels where no edge is taken, else 255; None where there are none."""
        return self._buffers.shown

    def forget_view(self) -> None:
        """Drop the reference: where the camera is as against that one is not known."""
        self._T_world_ref: NDArray[np.float64] | None = None
        self._T_world_look: NDArray[np.float64] | None = None  # of the last look
        self._gives_way = False

    @property
    def has_reference(self) -> bool:
        """Whether there is a frame that others can be held against."""
        return self._T_world_ref is not None

    def look(
        self,
        samples: EdgePixels,
        T_world_cam: NDArray[np.float64],
        least_px: float = APART_PX,
    ) -> Stays:
        """Say which samples of a frame stay, if there is a reference.

        Parameters
        ----------
        samples : EdgePixels
            N of them, with depth.
        T_world_cam : ndarray of float64, shape (4, 4)
            Where the frame was taken.
        least_px : float, optional
            Across itself, by which an edge has moved for certain.

        Returns
        -------
        Stays
        """
        assert self._T_world_ref is not None
        return self._look_from(self._T_world_ref, samples, T_world_cam, least_px)

    def _look_from(
        self,
        T_world_ref: NDArray[np.float64],
        samples: EdgePixels,
        T_world_cam: NDArray[np.float64],
        least_px: float = APART_PX,
    ) -> Stays:
        """The same, had the reference been taken elsewhere; its edges are where they were."""
        looked = Stays(*np.empty((3, len(samples)), np.bool_))
        kernels.stay_in_place(
            samples.pixels,
            samples.gradients,
            samples.depths,
            self._pinhole,
            se3.inverse(T_world_ref) @ T_world_cam,
            self._marks,
            least_px,
            *looked,
        )
        return looked

    def note(self, seen: Seen, T_world_cam: NDArray[np.float64]) -> None:
        """Learn from the frame that was seen last, once the view has moved.

        Parameters
        ----------
        seen : Seen
            If samples were taken from it, it is sure that the view has moved.
        T_world_cam : ndarray of float64, shape (4, 4)
            Where it was taken, for certain.
        """
        sure, T_world_ref = seen.is_parted, self._T_world_ref
        self._age += 1
        self._left = max(self._left - 1, 0)
        if T_world_ref is None or self._gives_way:
            self._refer(seen.edges, T_world_cam)
            return
        if self._left and not sure:
            return
        self._left = PAUSE
        few = seen.samples.every(STRIDE)
        stays = self._look_from(T_world_ref, few, T_world_cam)
        if not stays.view_moves:
            return
        if self._T_world_look is not None:  # what stays by chance does so for some pixels
            since = self._look_from(self._T_world_look, few, T_world_cam)
            if not since.view_moves:
                return
        self._T_world_look = T_world_cam
        many = 0
        if sure or stays.share <= MOST:
            T_ref_cur = se3.inverse(T_world_ref) @ T_world_cam
            many = self._count(seen.edges, seen.frame.depth, T_ref_cur, sure=sure)
        self._wait = SOON if many > MANY or sure else min(2 * self._wait, SELDOM)
        self._left = self._wait
        self._gives_way = self._age >= LONGEST  # to the next one: this one has taken its time

    def _every(self, edges: EdgeImage) -> NDArray[np.int32]:
        """Flat indices of the edges of the frame that was seen last, those hidden, too."""
        hidden = self._buffers.hidden
        if self.shown is None or hidden is None:
            return edges.index
        return np.concatenate((edges.index, np.flatnonzero(hidden).astype(np.int32)))

    def _refer(self, edges: EdgeImage, T_world_cam: NDArray[np.float64]) -> None:
        kernels.mark_edges(self._every(edges), edges.du, edges.dv, self._table, self._marks)
        self._T_world_ref, self._age, self._gives_way = T_world_cam, 0, False

    def _count(
        self,
        edges: EdgeImage,
        depth: NDArray[np.float32],
        T_ref_cur: NDArray[np.float64],
        *,
        sure: bool,
    ) -> int:
        """Count which edges have stayed, and see past those that mostly do."""
        self._looks += 1
        often = math.ceil(OFTEN * self._looks)
        found, by_chance, rest = kernels.count_stays(
            self._every(edges),
            edges.du,
            edges.dv,
            self._table,
            depth,
            self._pinhole,
            T_ref_cur,
            self._marks,
            APART_PX,
            self._room,
            self._counts,
            often,
        )
        self._by_chance = self._by_chance / 2 + by_chance
        self._rest = self._rest / 2 + rest
        share = self._by_chance / max(self._by_chance + self._rest, 1.0)
        times = LEAST_HITS if sure else _more_than_chance(share)
        if (self._looks >= times and found >= LEAST) or self.shown is not None:
            self._see_past(max(times, often))
        if self._looks >= FULL:
            self._looks //= 2
            self._counts >>= 1
        return found

    def _see_past(self, times: int) -> None:
        """Take no edges where some have stayed so often, nor where what goes on from there has.

        Where it was so, and edges now come and go, they are taken again: the lens was wiped.
        """
        ought, moved, stayed = self._counts
        hardly = HARDLY * moved
        own = ((ought >= times) & (ought >= hardly)).astype(np.uint8)
        near = cv2.boxFilter(own, cv2.CV_16U, (NEAR_PX, NEAR_PX), normalize=False)
        own[near < LEAST_NEAR] = 0
        beside = cv2.dilate(own, _square(GROWS_PX)) > 0
        own |= beside & (stayed >= times) & (stayed >= hardly)
        own = np.asarray(cv2.dilate(own, _square(REACH_PX)), np.uint8)
        if self.shown is not None:
            gone = ((moved >= LEAST_HITS) & (moved >= HARDLY * stayed)).astype(np.uint8)
            own |= (self.shown == 0) & (cv2.dilate(gone, _square(GROWS_PX)) == 0)
        hides = np.count_nonzero(own)
        if hides < LARGEST * own.size:
            if self.shown is None and hides:
                logger.info("edges stay in the image as the view moves: none is taken of these")
            shown = np.where(own > 0, 0, 255).astype(np.uint8)
            self._buffers.shown = shown if hides else None


def _more_than_chance(share: float) -> int:
    """How often an edge has to stay for that to be no chance, where such a share of all does."""
    return max(
        math.ceil(math.log(CHANCE) / math.log(min(BESIDE * share, 0.9) or CHANCE)), LEAST_HITS
    )


def _square(reach: int) -> NDArray[np.uint8]:
    """All that is no farther in both directions."""
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
