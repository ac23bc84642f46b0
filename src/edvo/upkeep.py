"""Upkeep of keyframes: when the next one is made, what is added to it, and what is found back by.

A keyframe is made in the time of two frames: its edges and planes are found in that of its own,
and the rest is made of the edges in that of the next, so that neither waits for all of it; planes,
too, where the frame has been registered with an earlier keyframe already. Edges are added to it in
the time of the frame after. What the first frame registered with it tells of it waits for the next.
"""

import logging
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import Course
from edvo.delay import LARGEST_S
from edvo.frame import Frame
from edvo.gathering import gather, may_gather
from edvo.information import Information
from edvo.keyframes import Keyframe, KeyframeStore, is_due
from edvo.kit import Kit
from edvo.last_good import LastGood
from edvo.pieces import Pieces
from edvo.places import is_apart
from edvo.planes import PlaneMap
from edvo.seen import Seen
from edvo.window import KeyframeWindow

logger = logging.getLogger("edvo.odometry")  # one for all that the tracker has to say


@dataclass(frozen=True, slots=True)
class _Due:
    """A frame that is to be the keyframe, or to add to it, once another frame is there."""

    seen: Seen  # its depth is kept; with the edges that a keyframe is to have
    index: int
    velocity: NDArray[np.float64] | None
    telling: int = 0  # how many of its edges, the first ones, tell places
    planes: PlaneMap | None = None  # of its depth; None where they are still to be found
    is_placed: bool = False  # by the window
    T_key_cur: NDArray[np.float64] | None = None  # where the keyframe stays, and gathers its edges


class _Bare(NamedTuple):
    """A keyframe with hardly any edges, and the last one before it that was made of some."""

    keyframe: Keyframe
    before: Keyframe


class Upkeep:
    """Makes the keyframes of a course, adds to them, and stores them.

    Parameters
    ----------
    kit : Kit
    course : Course
        Whose keyframe it sets.
    pieces : Pieces
        Of the path, that keyframes belong to.

    Attributes
    ----------
    store : KeyframeStore
        Keyframes to find back to.
    """

    def __init__(self, kit: Kit, course: Course, pieces: Pieces) -> None:
        self._camera, self._limits, self._clock = kit.camera, kit.config.keyframes, kit.clock
        self._registration, self._fitter = kit.registration, kit.fitter
        self._front_end, self._shared, self._instants = kit.front_end, kit.shared, kit.instants
        self._contours = kit.contours
        self._course, self._pieces = course, pieces
        self.store = KeyframeStore(self._limits.stored)
        self._window = KeyframeWindow(kit.config, kit.registration, kit.uncertainty)
        self._information = Information()
        self._last_good = LastGood()
        self._due: _Due | None = None
        self._bare: _Bare | None = None
        self._left: _Bare | None = None  # where the last one was left for a moment
        self._renewal: NDArray[np.float64] | None = None  # by which velocity, if one is due

    def catch_up(self) -> None:
        """Make the last frame the keyframe, add its edges to it, or renew it, if that is due."""
        self._left = None
        due, self._due = self._due, None
        renewal, self._renewal = self._renewal, None
        if renewal is not None:
            self._renew(renewal)
        if due is not None and due.T_key_cur is not None:
            self._gather(due.seen, due.T_key_cur, due.velocity)
        elif due is not None:
            keyframe = self._finish(due.seen, due.telling, due.planes, due.index, due.velocity)
            if due.is_placed:
                self._window.take(keyframe)

    def attend(
        self,
        seen: Seen,
        index: int,
        share: float,
        covariance: NDArray[np.float64] | None,
        period: float,
        velocity: NDArray[np.float64] | None,
        *,
        is_whole: bool,
        is_tracked: bool,
        tells_more: bool,
        has_time: bool,
    ) -> tuple[NDArray[np.float64], bool]:
        """See to the keyframe after a frame that was registered with it, and noted in the course.

        Parameters
        ----------
        seen : Seen
            The frame.
        index : int
            Its number.
        share : float
            Of the samples that were registered, of those that fit.
        covariance : ndarray of float64, shape (6, 6), or None
            Of ``T_key_cur``; None where it is not known.
        period : float
            Seconds since the last pose.
        velocity : ndarray of float64, shape (6,), or None
            Of the camera; None where it is not known, since the last pose is too old, or a guess.
        is_whole : bool
            Whether all of it was registered, and not only what stands still.
        is_tracked : bool
            Whether there is no doubt.
        tells_more : bool
            Whether its edges tell a motion of which the keyframe tells nothing.
        has_time : bool
            Whether there is time for what may as well wait for the next frame.

        Returns
        -------
        T_key_cur : ndarray of float64, shape (4, 4)
            Where the frame is then: one that is to be the keyframe may be moved.
        is_keyframe : bool
            Whether it is to be that.
        """
        self._left = None
        rule, key, T_key_cur = self._limits, self._course.key, self._course.T_key_last
        age, better = index - key.index, False
        if rule.early_share < 1 and covariance is not None:
            better = self._information.is_better(covariance, period)
        certain = self._course.anchor is None
        close = is_whole and velocity is not None
        # depth that is its own makes the better one, unless it is long in coming
        waits = seen.is_stale and seen.frame.depth_delay > -LARGEST_S
        due = certain and not waits
        wanted = tells_more and age > 1
        bounds = T_key_cur, share, age
        due = due and (wanted or is_due(rule, *bounds, well_placed=better, close=close))
        # one that has gathered the last frame's edges, and serves no better, gives way
        fresh = seen.frame.timestamp - key.gathered_at > 1.5 * period
        gathers = due and fresh and seen.is_near and is_whole
        gathers = gathers and not wanted and self._before_bare is None
        gathers = gathers and may_gather(rule, key, T_key_cur, share)
        together = rule.window > 2 and is_whole and velocity is not None and is_tracked
        if gathers:
            due = False
            self._due = _Due(seen.kept(), index, velocity, T_key_cur=T_key_cur.copy())
        elif due:
            placed_by, is_late = covariance if together else None, False
            if placed_by is not None:
                T_key_cur, is_late = self._place(seen, T_key_cur, placed_by)
            kept, telling = self._with_edges(seen.kept(), velocity)
            planes = None if is_late else self._planes(kept)
            self._due = _Due(kept, index, velocity, telling, planes, placed_by is not None)
        elif velocity is not None:
            if age > 1:
                if has_time:
                    with self._clock("registration"):
                        self._instants.go_on()
                self._renew(self._course.velocity)
            else:  # it has made the keyframe, or, the second of all, been looked at more closely
                self._renewal = self._course.velocity.copy()
        return T_key_cur, due

    def make(self, seen: Seen, index: int, velocity: NDArray[np.float64] | None) -> Keyframe:
        """Make a frame the keyframe, its parts moved by the velocity where that is known.

        Parameters
        ----------
        seen : Seen
            The frame that was seen last, kept.
        index : int
            Its number.
        velocity : ndarray of float64, shape (6,), or None
            Of the camera.

        Returns
        -------
        Keyframe
        """
        kept, telling = self._with_edges(seen, velocity)
        return self._finish(kept, telling, self._planes(kept), index, velocity)

    def make_bare(self, seen: Seen, index: int) -> None:
        """Make a frame the keyframe that has hardly any edges; no place is found again by it.

        Parameters
        ----------
        seen : Seen
            The frame that was seen last, kept.
        index : int
            Its number.
        """
        before, where = self._before_bare or self._course.key, self._course.T_world_last
        with self._clock("keyframe"):
            keyframe = self._front_end.keyframe(seen, index, where, self._pieces.here)
            self.take(keyframe, seen, keep=False)
        self._bare = _Bare(keyframe, before)

    def leave_bare(self) -> None:
        """Compare a frame with the last keyframe that has edges, if the last one has hardly any.

        For one that was lost in darkness, and sees edges again.
        """
        if self._before_bare is not None:
            self._left, before = self._bare, self._before_bare
            self._course.compare_with(before)

    def return_to_bare(self) -> None:
        """Take back `leave_bare`, of a frame that is lost all the same: it may be dark again."""
        left, self._left = self._left, None
        if left is not None and left.before is self._course.key:
            self._course.compare_with(left.keyframe)

    @property
    def _before_bare(self) -> Keyframe | None:
        """The last keyframe with edges, where this one has hardly any; None where it has."""
        bare = self._bare
        return bare.before if bare is not None and bare.keyframe is self._course.key else None

    def _with_edges(self, seen: Seen, velocity: NDArray[np.float64] | None) -> tuple[Seen, int]:
        """Find edges that a keyframe is to have, and how many of them tell places."""
        with self._clock("keyframe"):
            if velocity is not None:  # measured by now, no longer expected
                seen = self._instants.depth.settled(seen, velocity)
            kept, telling = self._front_end.to_keep(seen)
            if velocity is not None and kept.samples is not seen.samples:  # those were by then
                samples = self._instants.rolling.unrolled(kept.samples, velocity)
                kept = replace(kept, samples=samples)
        return kept, telling

    def _planes(self, seen: Seen) -> PlaneMap:
        """Find the planes of a keyframe."""
        with self._clock("keyframe"):
            return self._fitter.planes(seen.frame.depth, seen.T_cam_depth, fine=seen.is_fine)

    def _finish(
        self,
        kept: Seen,
        telling: int,
        planes: PlaneMap | None,
        index: int,
        velocity: NDArray[np.float64] | None,
    ) -> Keyframe:
        """Make the keyframe of what was seen last, and of the edges found for it."""
        with self._clock("keyframe"):
            edges = kept.edges.describe(self._camera)
            keyframe = self._front_end.keyframe(
                kept,
                index,
                self._course.T_world_last,
                self._pieces.here,
                self._instants.unrolled(edges, kept, velocity),
                telling,
                planes,
            )
            self.take(keyframe, kept)
            self._instants.hold(keyframe, kept, edges, velocity)
        return keyframe

    def take(self, keyframe: Keyframe, seen: Seen, *, keep: bool = True) -> None:
        """Register frames with a keyframe from now on, which is where the camera is.

        Parameters
        ----------
        keyframe : Keyframe
        seen : Seen
            What it was made of, its images kept.
        keep : bool
            Whether it is to be found back to.
        """
        self._contours.hold(keyframe, seen)
        self._left = None
        self._course.keyframe, self._course.T_key_last = keyframe, np.eye(4)
        if keep and self._limits.stored:
            self.store.add(keyframe)
        logger.debug("frame %d is a keyframe", keyframe.index)

    def note_good(self, frame: Frame, index: int, share: float) -> None:
        """Take note of a frame that is as it should be, if enough of it fits.

        Parameters
        ----------
        frame : Frame
        index : int
            Its number.
        share : float
            Of its samples that fit.
        """
        if share > self._limits.min_overlap and self._limits.stored:
            self._last_good.note(index, frame, self._course.T_world_last)

    def forget_good(self) -> None:
        """Drop the last good image: where it was taken is doubtful by now."""
        self._last_good.forget()

    def store_last_good(self, index: int) -> None:
        """Make the last good image a place to find back to, if none like it is known.

        Parameters
        ----------
        index : int
            Of the frame that is lost now.
        """
        good = self._last_good.take() if self._limits.stored else None
        if good is None:
            return
        piece = self._pieces.here
        known = [T for number, T in self.store.places(piece) if number < good.index]
        if is_apart(good.T_world_cam, known):
            seen = self._front_end.see(good.frame, index, again=True)
            with self._clock("keyframe"):
                self.store.add(self._front_end.keyframe(seen, good.index, good.T_world_cam, piece))

    def _place(
        self, seen: Seen, T_key_cur: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], bool]:
        """Move a frame that is to be the keyframe to where the last few place it.

        Returns T_key_cur, and whether an earlier keyframe was asked, which takes its time.
        """
        course, last, term = self._course, self._course.key, self._shared.term(self._fitter.term)
        with self._clock("keyframe"):
            place = self._window.place(last, seen, T_key_cur, covariance, term)
            course.T_world_last, is_asked = place
        return se3.inverse(last.T_world_key) @ course.T_world_last, is_asked

    def _gather(
        self, seen: Seen, T_key_cur: NDArray[np.float64], velocity: NDArray[np.float64] | None
    ) -> None:
        """Add to the keyframe the edges of a frame that it does not know."""
        before = self._course.key
        with self._clock("keyframe"):
            edges = self._front_end.edges_with_depth(seen)
            if velocity is not None:
                edges = self._instants.rolling.unrolled(edges, velocity)
            when = seen.frame.timestamp
            more = gather(before, edges, T_key_cur, when, self._registration, self._camera)
            self._instants.exchange(before, more)
            self._exchange(before, more)
        logger.debug("keyframe %d has gathered %d edges", more.index, more.gathered)

    def _renew(self, velocity: NDArray[np.float64]) -> None:
        """Move the parts of the keyframe, where more is known by now of when they were taken."""
        with self._clock("keyframe"):
            keyframe = self._instants.renewed(self._course.key, velocity)
            if keyframe is not None:
                self._contours.move(keyframe, self._instants.T_cam_depth)
                self._exchange(self._course.key, keyframe)

    def _exchange(self, keyframe: Keyframe, by: Keyframe) -> None:
        """Put another in the place of the keyframe, which stays where it is."""
        self.store.replace(keyframe, by)
        self._course.keyframe = by
