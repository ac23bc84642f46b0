"""Parting what the camera carries from what it sees, while the one outweighs the other."""

from dataclasses import replace

import numpy as np

from edvo.carried import STRIDE, Stays
from edvo.course import Course
from edvo.doubt import Doubt
from edvo.kit import Kit
from edvo.locating import Locator
from edvo.planes import thinned
from edvo.registration import FAILURES, Alignment
from edvo.scatter import fitting_depth
from edvo.seen import Seen

STAYING, STILL = 0.1, 0.9  # share of the samples that stay by chance, and where nothing moves
LEAST_LEFT = 80  # samples that do not, to tell where they lead
MANY, FEW = 0.3, 0.05  # of what ought to have moved, for a pose to be doubtful; once one was wrong
FITTING, MORE_FIT = 0.6, 0.2  # of the others fit where they lead, and so many more than before
BETTER, FAR_BETTER = 1.25, 2.0  # times as well depth fits there, and where no more of them do
ASIDE_PX = 2.0  # by which what stays ought to have moved, to be taken from this frame
SOON, RARELY, SELDOM = 4, 4, 32  # frames from one look to the next, from one try, and at most
OPEN = "a part of the view stays in the image: it, or the rest, may be what goes along"
STAYS_OPEN = 3  # tries: so many later ones in a row that do not find it so end it
EARLY, LASTING = 15, 30  # frames each of which is looked at: the first, and once one was right


class Parting:
    """Tells whether edges that stay in the image are the camera's own, by where the others lead.

    Parameters
    ----------
    kit : Kit
    course : Course
    locator : Locator
    doubt : Doubt
        Told of what is left open.

    Attributes
    ----------
    is_trying : bool
        Whether it has tried to, in the last frame: that takes about as long as all else.
    """

    def __init__(self, kit: Kit, course: Course, locator: Locator, doubt: Doubt) -> None:
        self._front_end, self._course, self._clock = kit.front_end, course, kit.clock
        self._depth_alone, self._inlier_px = kit.depth_alone, kit.config.status.inlier_px
        self._locator, self._asks_depth = locator, kit.fitter.is_on
        self._point_step_px = kit.config.planes.point_step_px
        self._doubt, self.is_trying = doubt, False
        self._open = 0  # tries more for which it stays open which of the two is the scene
        self._wait = self._left = 0  # frames from one try to the next, and until that
        self._early, self._hot = EARLY, 0  # frames each of which is still looked at; see there

    def apart(self, seen: Seen) -> Seen | None:
        """Take from a frame the samples that the camera carries, where these outweigh the others.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        Seen or None
            None where all is well.
        """
        carried, self.is_trying = self._front_end.carried, False
        if carried is None or not self._asks_depth:
            return None
        self._left, self._hot = max(self._left - 1, 0), max(self._hot - 1, 0)
        if not carried.has_reference:
            self._open = 0
            return None
        if self._left:
            self._leave_open(seen)
            return None
        few = seen.samples.every(STRIDE)
        if not self._is_doubtful(carried.look(few, self._course.T_world_last)):
            self._early = max(self._early - 1, 0)
            self._left = 0 if self._hot or self._early else SOON
            self._open = 0
            return None
        self.is_trying = True
        with self._clock("search"):
            T_world_key = self._course.key.T_world_key
            found = self._locator.align(seen)
            looked = carried.look(seen.samples, T_world_key @ found.T_ref_cur)
            again = self._without(seen, found, looked)
            if again is None:
                self._leave_open(seen)
                most = RARELY if self._open else SELDOM
                self._wait = 0 if self._hot else min(max(2 * self._wait, RARELY), most)
                self._left = self._wait
                return None
            self._hot, self._open = LASTING, 0
            looked = carried.look(seen.samples, T_world_key @ again.T_ref_cur, ASIDE_PX)
            rest = seen.samples.where(~(looked.stays & looked.moves))
        return replace(seen, samples=rest, is_parted=True)

    def _leave_open(self, seen: Seen) -> None:
        """Doubt the frame while it is open what moves; nothing is learned from it then."""
        if self._open:
            self._doubt.cast(seen.frame.timestamp, OPEN)

    def _is_doubtful(self, looked: Stays) -> bool:
        """Whether some samples stay, and others do not, though by the last pose nothing moves."""
        n, staying = len(looked.stays), int(looked.stays.sum())
        if self._is_right(looked):
            return False
        return STAYING * n < staying < STILL * n and n - staying >= LEAST_LEFT / STRIDE

    def _is_right(self, looked: Stays) -> bool:
        """Whether a pose by which the view has moved is one that most samples confirm."""
        return looked.view_moves and looked.share < (FEW if self._hot else MANY)

    def _without(self, seen: Seen, found: Alignment, looked: Stays) -> Alignment | None:
        """Register what does not stay; None unless all say that the others ought to have moved.

        Where depth does not say, though edges do, that is left open.
        """
        if self._is_right(looked):
            self._open = 0
            return None
        self._open = max(self._open - 1, 0)
        course, rest = self._course, replace(seen, samples=seen.samples.where(~looked.stays))
        n = len(rest.samples)
        with np.errstate(invalid="ignore"):
            near = np.abs(found.residuals[~looked.stays]) < self._inlier_px
        fitted = int(np.count_nonzero(near))
        if looked.view_moves and fitted > FITTING * n:  # these say so already
            return found
        start, usual = course.T_key_last, thinned(rest.points, self._point_step_px)
        by_depth = self._depth_alone.align(course.key, rest.samples, usual, start)
        starts = np.array([by_depth.T_ref_cur, start])
        registrar = self._locator.registrar
        again = registrar.widely(rest, starts, registrar.term(rest.frame.timestamp))
        if again.reason in FAILURES or again.inliers < max(FITTING * n, fitted):
            return None
        is_clear = again.inliers > fitted + MORE_FIT * n
        better = max(fitting_depth(again), 1.0) / max(fitting_depth(found), 1.0)
        if is_clear and better > 1 / BETTER:  # as along a wall, where depth fits wherever they lead
            self._open = STAYS_OPEN
        return again if better > (BETTER if is_clear else FAR_BETTER) else None
