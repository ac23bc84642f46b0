"""Looking for a frame along a motion that hardly any of its edges bears out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.assessing import Assessor
from edvo.course import Course
from edvo.doubt import Doubt
from edvo.evidence import Across
from edvo.kit import Kit
from edvo.planes import DepthTerm
from edvo.registrar import Registrar
from edvo.registration import FAILURES, Alignment
from edvo.scatter import is_sharper
from edvo.seen import Seen
from edvo.status import Status
from edvo.uncertainty import degenerate_directions

NEWS_M, NEWS_SIGMAS = 0.005, 5.0  # that a camera has drifted by, at least


class PutRight(NamedTuple):
    """A frame that was found far from where it was expected, where edges lie nowhere.

    Attributes
    ----------
    alignment : Alignment
    off : float
        How far from where it was expected it was looked for, m.
    T_key_last : ndarray of float64, shape (4, 4)
        Where the camera must have been at the last frame, if as far off.
    velocity : ndarray of float64, shape (6,)
        Of the camera, in its own frame, 1/s: that of late, not what the last pose says.
    """

    alignment: Alignment
    off: float
    T_key_last: NDArray[np.float64]
    velocity: NDArray[np.float64]


class Mender:
    """Puts right where a frame was taken, if edges that tell a motion lie nowhere.

    Parameters
    ----------
    kit : Kit
    course : Course
    doubt : Doubt
        Forgets the last frame's, if that has slid.
    registrar : Registrar
    assessor : Assessor
        Told of what may be far from where it was expected.
    """

    def __init__(
        self, kit: Kit, course: Course, doubt: Doubt, registrar: Registrar, assessor: Assessor
    ) -> None:
        self._config, self._judge = kit.config, kit.judge
        self._uncertainty, self._evidence = kit.uncertainty, kit.uncertainty.evidence
        self._course, self._doubt = course, doubt
        self._registrar, self._assessor = registrar, assessor
        self._put_right: PutRight | None = None

    def amiss(self, seen: Seen, alignment: Alignment, least_px: float = 0.0) -> Across | None:
        """Say along which motion most edges that could tell it are not in their places.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment
        least_px : float, optional
            See `Evidence.amiss`.

        Returns
        -------
        Across or None
            None where there is no such motion, or nobody is to look for it.
        """
        motion = self._config.motion
        if not motion.along_px or not motion.search_deg or not self._registrar.begins_narrow:
            return None  # nobody looks, or there is no wider scale to look by
        return self._evidence.amiss(self._registrar.edges(seen), seen.samples, alignment, least_px)

    def mend(self, seen: Seen, found: Alignment) -> Alignment:
        """Look for such edges along such a motion, and register widely from where they fall.

        Parameters
        ----------
        seen : Seen
        found : Alignment

        Returns
        -------
        Alignment
            What was found, or what is better.
        """
        start = self._start_along(seen, found)
        if start is None:
            return found
        course, timestamp = self._course, seen.frame.timestamp
        term = self._registrar.term(timestamp)
        off = self._assessor.off(start, timestamp)
        if off <= self._assessor.limit(timestamp):
            again = self.weighed(seen, self._registrar.widely(seen, start[None], term))
            return self._assessor.better(found, again, timestamp)
        before = course.whereabouts
        course.leap(start @ se3.inverse(found.T_ref_cur) @ course.T_key_last)
        along = self.weighed(seen, self._registrar.widely(seen, start[None], term))
        fits = is_sharper(along, found)
        fits = fits and self._assessor.assess(along, timestamp)[0] is Status.TRACKED
        T_key_last = course.T_key_last
        course.return_to(before)  # till the frame is accepted
        asked = self._registrar.edges(seen), seen.samples, along
        fits = fits and not len(self._evidence.untold(*asked))
        if not fits or self.amiss(seen, along, self._config.registration.own_scale_px) is not None:
            return found
        # where it has drifted, it was going as it went
        velocity = course.cruise if before.stood is None else course.velocity
        self._assessor.allow(along)
        self._put_right = PutRight(along, off, T_key_last, velocity.copy())
        self._doubt.forget_since(timestamp - course.period(timestamp))
        return along

    def put_right(self, alignment: Alignment) -> PutRight | None:
        """Say how a frame was put right, if it was.

        Parameters
        ----------
        alignment : Alignment
            Of this frame.

        Returns
        -------
        PutRight or None
        """
        put_right = self._put_right
        return put_right if put_right is not None and put_right.alignment is alignment else None

    def last_pose(self, alignment: Alignment) -> NDArray[np.float64]:
        """Say where the camera was at the last frame, as this one tells if it was put right.

        Parameters
        ----------
        alignment : Alignment
            Of this frame.

        Returns
        -------
        ndarray of float64, shape (4, 4)
            T_key_last.
        """
        put_right = self.put_right(alignment)
        return self._course.T_key_last if put_right is None else put_right.T_key_last

    def find_again(
        self, seen: Seen, T_key_cur: NDArray[np.float64], T_last_cur: NDArray[np.float64]
    ) -> tuple[Alignment, float] | None:
        """Register a frame with a keyframe that it was left from, no matter how far by now.

        The last pose of the course is put where it must have been then, if it is found or not.

        Parameters
        ----------
        seen : Seen
        T_key_cur : ndarray of float64, shape (4, 4)
            Where it seems to be.
        T_last_cur : ndarray of float64, shape (4, 4)
            How the camera seems to have moved since the last frame.

        Returns
        -------
        (Alignment, float) or None
            And how far from there it seemed to be, m. None unless each motion is told, nothing is
            in doubt, and that is far more than it may be off there.
        """
        course, term = self._course, self._registrar.term(seen.frame.timestamp)
        T_cur_last = se3.inverse(T_last_cur)
        course.leap(T_key_cur @ T_cur_last)  # by which depth and rows are moved
        found = self._registrar.widely(seen, T_key_cur[None], term)
        start = self._start_along(seen, found)
        start = found.T_ref_cur if start is None else start
        course.leap(start @ T_cur_last)
        found = self._registrar.widely(seen, start[None], term)
        course.leap(found.T_ref_cur @ T_cur_last)
        sound = self._judge.judge(found, 0.0, 0.0)[0] is Status.TRACKED
        sound = sound and self._judge.scatter.has_usual_depth(found)
        asked = self._registrar.edges(seen), seen.samples, found
        sound = sound and self._evidence.amiss(*asked) is None
        sound = sound and len(self._evidence.untold(*asked)) == 0
        off = se3.distance(found.T_ref_cur, T_key_cur)
        is_news = sound and off > NEWS_M and self._is_news(seen, term, found, T_key_cur)
        return (found, off) if is_news else None

    def weighed(self, seen: Seen, found: Alignment) -> Alignment:
        """Register anew where edges across a motion scatter more than all, by their own scale.

        Parameters
        ----------
        seen : Seen
        found : Alignment

        Returns
        -------
        Alignment
            What was found, or one that tells each motion, where edges across it fall clearly
            better than elsewhere along it.
        """
        registrar, timestamp = self._registrar, seen.frame.timestamp
        most_px = self._config.registration.own_scale_px if registrar.begins_narrow else 0.0
        asked, chamfer = (registrar.edges(seen), seen.samples), self._course.key.chamfer
        own = self._evidence.own_scale(*asked, found, most_px) if most_px else None
        if own is None:
            return found
        for twist, samples in own.across:  # where edges are dense, some are near wherever it is
            if not chamfer.stands_out(seen.samples.where(samples), found.T_ref_cur, twist):
                return found
        term = registrar.term(timestamp)
        again = registrar.register(seen, found.T_ref_cur[None], term, factors=own.factors)
        if again.reason in FAILURES or len(self._evidence.untold(*asked, again)):
            return found
        return found if self._assessor.is_lost(again, timestamp) else again

    def _start_along(self, seen: Seen, found: Alignment) -> NDArray[np.float64] | None:
        """Where along such a motion such edges fall clearly better, if there are any."""
        amiss = self.amiss(seen, found)
        if amiss is None:
            return None
        few = seen.samples.where(amiss.samples)
        reach_px = self._config.motion.along_px
        return self._course.key.chamfer.along(few, found.T_ref_cur, amiss.twist, reach_px)

    def _is_news(
        self, seen: Seen, term: DepthTerm, found: Alignment, T_key_cur: NDArray[np.float64]
    ) -> bool:
        """Whether the keyframe tells each motion, and that the frame is not where it seemed."""
        key = self._course.key
        covariance = self._uncertainty.covariance(
            key.edges, seen.samples, key.planes, seen.points, term, found
        )
        if len(degenerate_directions(covariance)):
            return False
        off = se3.log(found.T_ref_cur @ se3.inverse(T_key_cur))
        return float(off @ np.linalg.solve(covariance, off)) > NEWS_SIGMAS**2
