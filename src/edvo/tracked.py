"""What comes out for each frame: its pose, and how far it is to be trusted."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.course import Course
from edvo.pieces import Pieces
from edvo.registration import Alignment
from edvo.seen import Seen
from edvo.status import Status
from edvo.trajectory import Trajectory

logger = logging.getLogger("edvo.odometry")  # one for all that the tracker has to say


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """The pose of one frame and its evidence.

    Attributes
    ----------
    timestamp : float
        Seconds, as the frame gave it.
    index : int
        Number of the frame since the last reset, from 0.
    status : Status
    reason : str
        Why it is not ``TRACKED``; empty where it is.
    T_world_cam : ndarray of float64, shape (4, 4)
        Maps points from the camera to the world, which is the first camera. Only predicted
        where the status is ``LOST``.
    T_key_cur : ndarray of float64, shape (4, 4)
        Maps points from the camera to that of the keyframe it was registered with. Where the frame
        becomes a keyframe itself, and is placed by an earlier one, too (``keyframes.window``), or
        where hardly anything constrains it (``planes.contours``, ``motion.inertia``), it is what
        follows from that, and no longer the ``alignment``'s alone.
    keyframe : int
        Index of that keyframe; -1 where there is none yet.
    is_keyframe : bool
        Whether this frame has become the keyframe of those that follow.
    edges : int
        Edge pixels found.
    samples : int
        Edge pixels with depth that were drawn; where something moves, those of them that stand
        still, and far ones whose depth is a guess.
    alignment : Alignment or None
        The registration; None where there was none. The tracker still looks at its arrays when the
        next frame comes: copy what you want to write to.
    covariance : ndarray of float64, shape (6, 6), or None
        Of ``T_key_cur``: of the twist [v, w] (metres, radians) in the keyframe's camera with
        T_true = exp([v, w]) T_key_cur, as the registration alone tells it. Not calibrated for
        frames where something moves. None where there was no registration or it failed, and where
        ``status.covariance`` is ``none``, as in the preset ``paper``, unless depth alone carries
        the frame or has let it drift.
    degenerate : tuple of str
        Motions in the keyframe's camera that neither edges nor depth noticed; the frame is then
        at best ``DEGRADED``. Along them a frame without edges is only predicted, except where its
        reason says that contours of depth tell of them; they are named in its own camera.
    piece : int
        Which piece of the path it belongs to. 0 is that of the first frame; another one has begun
        where the camera was expected after it was lost for a second: poses given for
        one piece belong together, but where it is to another is a guess. Its frames are at best
        ``DEGRADED``. Once it is found what was seen before, those that follow belong to that piece.
    edge_scale : float or None
        By which Canny's thresholds were multiplied, see ``edges.strong_share``; 1 for other
        extractors. None where no edges were looked for.
    edge_passes : int
        Of a blur of 2 px^2 each, beyond the usual, before it was registered; see ``edges.smear``.
    """

    timestamp: float
    index: int
    status: Status
    reason: str
    T_world_cam: NDArray[np.float64]
    T_key_cur: NDArray[np.float64]
    keyframe: int
    is_keyframe: bool
    edges: int
    samples: int
    alignment: Alignment | None
    covariance: NDArray[np.float64] | None = None
    degenerate: tuple[str, ...] = ()
    piece: int = 0
    edge_scale: float | None = None
    edge_passes: int = 0


class Record:
    """Tells what came out for each frame, and counts frames and losses.

    Parameters
    ----------
    course : Course
    pieces : Pieces

    Attributes
    ----------
    count : int
        Frames so far.
    last_kept : int
        Index of the last one that was not lost; -1 where there is none.
    """

    def __init__(self, course: Course, pieces: Pieces) -> None:
        self._course, self._pieces = course, pieces
        self.count, self.last_kept = 0, -1
        self._timestamps: list[float] = []
        self._poses: list[NDArray[np.float64]] = []

    @property
    def trajectory(self) -> Trajectory:
        """Poses so far, by time, without those of frames that were lost."""
        return Trajectory.from_frames(self._timestamps, self._poses)

    def keep(
        self,
        timestamp: float,
        status: Status,
        reason: str,
        T_key_cur: NDArray[np.float64],
        keyframe: int,
        *,
        is_keyframe: bool = False,
        seen: Seen | None = None,
        alignment: Alignment | None = None,
        covariance: NDArray[np.float64] | None = None,
        degenerate: tuple[str, ...] = (),
    ) -> TrackedFrame:
        """Note a pose, now that of the last frame that was not lost.

        Parameters
        ----------
        timestamp, status, reason, T_key_cur, keyframe, is_keyframe
            See `TrackedFrame`.
        seen : Seen, optional
            What was registered.
        alignment, covariance, degenerate : optional
            See `TrackedFrame`.

        Returns
        -------
        TrackedFrame
        """
        course = self._course
        if course.losses:
            logger.info("frame %d: found again", self.count)
        course.losses = 0
        self._timestamps.append(timestamp)
        self._poses.append(course.T_world_last)
        self.last_kept = self.count
        self.count += 1
        return TrackedFrame(
            timestamp=timestamp,
            index=self.last_kept,
            status=status,
            reason=reason,
            T_world_cam=course.T_world_last.copy(),  # the caller may write to them
            T_key_cur=T_key_cur.copy(),
            keyframe=keyframe,
            is_keyframe=is_keyframe,
            edges=len(seen.edges) if seen else 0,
            samples=len(seen.samples) if seen else 0,
            alignment=alignment,
            covariance=covariance,
            degenerate=degenerate,
            piece=self._pieces.here,
            edge_scale=seen.edges.scale if seen else None,
            edge_passes=seen.edges.passes if seen else 0,
        )

    def lose(
        self,
        timestamp: float,
        reason: str,
        seen: Seen | None = None,
        alignment: Alignment | None = None,
    ) -> TrackedFrame:
        """Note a loss, and predict the pose; the next frame tries again from the keyframe.

        Parameters
        ----------
        timestamp : float
            Seconds.
        reason : str
        seen : Seen, optional
        alignment : Alignment, optional
            The registration that failed.

        Returns
        -------
        TrackedFrame
        """
        course = self._course
        log = logger.debug if course.losses else logger.warning
        log("frame %d lost: %s", self.count, reason)
        course.losses += 1
        self.count += 1
        ahead = course.ahead(timestamp)
        return TrackedFrame(
            timestamp=timestamp,
            index=self.count - 1,
            status=Status.LOST,
            reason=reason,
            T_world_cam=se3.compose(course.T_world_last, ahead),
            T_key_cur=se3.compose(course.T_key_last, ahead),
            keyframe=-1 if course.keyframe is None else course.keyframe.index,
            is_keyframe=False,
            edges=len(seen.edges) if seen else 0,
            samples=len(seen.samples) if seen else 0,
            alignment=alignment,
            piece=self._pieces.here,
            edge_scale=seen.edges.scale if seen else None,
            edge_passes=seen.edges.passes if seen else 0,
        )
