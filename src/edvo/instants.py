"""When the parts of a frame were taken: rows one after the other, for some time, depth apart."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config, EdgesConfig
from edvo.delay import DepthDelay
from edvo.edges import EdgePixels, depth_at_edges
from edvo.exposure import Exposure
from edvo.kernels import Lag
from edvo.keyframes import Keyframe
from edvo.measuring import Moment, Moments
from edvo.planes import PlaneFitter, move_points
from edvo.registration import Alignment, Registration
from edvo.rolling import RollingShutter
from edvo.seen import Seen
from edvo.slack import slackened
from edvo.trial import ReadoutTrial, Rolled

NEWS = 1e-3  # m and rad, by which a part of a keyframe must be off to be moved anew
SOON_S = 1e-3  # instants that are one
KNOWN_S = 4e-3  # to so much (one sigma), and one frame in so many is enough to keep them up
RARELY = 4
SURELY_S, SELDOM = 2e-3, 16  # the same of frames that readouts are tried on;
NEWS_SHARE = 0.2  # until then on those that tell so much of what is known
HASTY_S, TELLING_S = 8e-3, 12e-3  # one sigma of what a frame tells: at once, or by and by
ROUGH_PX = 3  # window of depths that tell how far a shutter's readout moves an edge


@dataclass(slots=True)
class _Held:
    """A keyframe, what it was made of, and for what its parts were moved."""

    keyframe: Keyframe
    depth: NDArray[np.float32]
    depth_delay: float
    index: NDArray[np.int32]
    edges: EdgePixels
    T_cam_depth: NDArray[np.float64] | None
    is_fine: bool
    rolled: NDArray[np.float64]  # by that from the middle row to the last
    velocity: NDArray[np.float64] | None
    known: tuple[float, float] | None = None  # delay and readout that its parts were last held to
    rough: NDArray[np.float32] | None = None

    def depths(self, config: EdgesConfig) -> NDArray[np.float32]:
        """Depth of its edges, looked up once."""
        if self.rough is None:
            self.rough = depth_at_edges(self.depth, self.index, config)
        return self.rough


class Instants:
    """Measures when the parts of frames are taken, and moves them to one instant.

    Parameters
    ----------
    camera : Camera
    config : Config
    registration : Registration
    fitter : PlaneFitter
    exposure : Exposure

    Attributes
    ----------
    depth : DepthDelay
    rolling : RollingShutter
    exposure : Exposure
    is_trying : bool
        Whether readouts were tried at once in the last frame, which takes long.
    """

    def __init__(
        self,
        camera: Camera,
        config: Config,
        registration: Registration,
        fitter: PlaneFitter,
        exposure: Exposure,
    ) -> None:
        self._camera, self._config = camera, config
        motion = config.motion
        self._is_on = exposure.is_on or motion.depth_delay != "none" or motion.readout != "none"
        self.exposure = exposure
        self._registration, self._fitter = registration, fitter
        self._rough = config.edges.model_copy(
            update={"depth_window_px": min(ROUGH_PX, config.edges.depth_window_px)}
        )
        self.depth = DepthDelay(camera, fitter, motion.depth_delay, motion.depth_slack)
        shutter = motion.readout, motion.readout_s, motion.row_slack
        self.rolling = RollingShutter(camera, registration.solver, *shutter)
        self._trial = ReadoutTrial(camera, registration, fitter)
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self.depth.forget()
        self.rolling.forget()
        self.exposure.forget()
        self._moments = Moments()
        self._trial.forget()
        self._held: _Held | None = None
        self._count, self.is_trying = 0, False

    def lag(
        self,
        seen: Seen,
        keyframe: Keyframe,
        T_key_last: NDArray[np.float64],
        period: float,
        velocity: NDArray[np.float64],
    ) -> Lag:
        """Say when the parts of a frame were taken, for a registration to move them.

        Parameters
        ----------
        seen : Seen
        keyframe : Keyframe
            That it is registered with.
        T_key_last : ndarray of float64, shape (4, 4)
            Where the camera was at the last frame.
        period : float
            Seconds since then.
        velocity : ndarray of float64, shape (6,)
            Of the camera then, in its own frame, 1/s.

        Returns
        -------
        Lag
        """
        lag = self.depth.lag(seen, T_key_last, period)
        sharp = self.exposure.sharpness(seen.samples, velocity, self.velocity_of(keyframe))
        if len(sharp):
            lag = lag._replace(sharp=sharp)
        rows = self.rolling.rows(seen.samples.pixels)
        return lag._replace(T_ref_last=T_key_last, rows=rows / period) if len(rows) else lag

    def slackened(
        self, lag: Lag, seen: Seen, period: float, acceleration: NDArray[np.float64]
    ) -> Lag:
        """Say by how much parts may be elsewhere, since a camera does not go on as it went.

        Parameters
        ----------
        lag : Lag
            See `lag`.
        seen : Seen
        period : float
            Seconds since the last frame.
        acceleration : ndarray of float64, shape (6,)
            See `Course`.

        Returns
        -------
        Lag
        """
        bend, bends = self.depth.bend(lag, seen, period), self.rolling.bends(lag)
        if not bend and not len(bends):
            return lag
        return slackened(lag, bend, bends, period, acceleration)

    @property
    def T_cam_depth(self) -> NDArray[np.float64] | None:
        """Where depth of the last keyframe was taken, as known by now; see `edvo.seen.Seen`."""
        return None if self._held is None else self._held.T_cam_depth

    def velocity_of(self, keyframe: Keyframe) -> NDArray[np.float64] | None:
        """Give the velocity of the camera at a keyframe.

        Parameters
        ----------
        keyframe : Keyframe

        Returns
        -------
        ndarray of float64, shape (6,), or None
            In its own frame, 1/s; None where it is not known.
        """
        held = self._held
        return held.velocity if held is not None and held.keyframe is keyframe else None

    def matter(self, seen: Seen) -> bool:
        """Say whether parts of a frame were taken at other instants than the frame.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        bool
        """
        return self.depth.matters(seen) or self.rolling.seconds != 0

    def settled(
        self,
        seen: Seen,
        T_last_cur: NDArray[np.float64],
        period: float,
        alignment: Alignment | None = None,
    ) -> Seen:
        """Move the parts of a frame to its instant, by what the camera has moved by.

        Parameters
        ----------
        seen : Seen
            Its depth was moved by what was expected.
        T_last_cur : ndarray of float64, shape (4, 4)
            What the camera has moved by since the last frame.
        period : float
            Seconds that this took.
        alignment : Alignment, optional
            That tells of what is off by an acceleration, where it does.

        Returns
        -------
        Seen
        """
        if not self.matter(seen):
            return seen
        velocity = se3.log(T_last_cur) / period
        if alignment is None:
            seen = self.depth.settled(seen, velocity)
        else:
            seen = self.depth.settled(seen, velocity, alignment.T_cam_points)
            velocity = velocity + alignment.faster / period
        return replace(seen, samples=self.rolling.unrolled(seen.samples, velocity))

    def note(
        self,
        keyframe: Keyframe,
        seen: Seen,
        alignment: Alignment,
        period: float,
        *,
        has_time: bool = True,
    ) -> None:
        """Take a frame that is to be trusted into account, once the next one is there.

        Parameters
        ----------
        keyframe : Keyframe
            That it was registered with.
        seen : Seen
        alignment : Alignment
        period : float
            Seconds since the frame before it.
        has_time : bool, optional
            Whether there is time for what may as well wait for the next frame.
        """
        self.is_trying = False
        if not self._is_on:
            return
        self._count += 1
        wanted = self._count % RARELY == 0 or not self._are_known
        frames = RARELY if self.exposure.is_known else 1
        exposed = self._count % frames == 0
        age = seen.frame.timestamp - keyframe.timestamp
        is_second = abs(age - period) < SOON_S
        moment = self._moments.note(
            keyframe, seen, alignment, period, wanted=wanted or exposed, is_second=is_second
        )
        if moment is None:
            return
        velocity = self.velocity_of(moment.keyframe)
        if exposed and velocity is not None:
            self.exposure.learn(moment, velocity, frames * moment.period)
        if wanted:
            self.depth.learn(moment)
            self._learn_readout(moment, has_time=has_time)

    def _learn_readout(self, moment: Moment, *, has_time: bool = True) -> None:
        """Learn from how a frame misfits, and, where that is much, by trying what fits better."""
        held = self._held
        if held is None or held.keyframe is not moment.keyframe or held.velocity is None:
            self.rolling.learn(moment)
            return
        certainty, estimate = self.rolling.learn(moment, held.velocity), self.rolling.estimate
        hasty = certainty * HASTY_S**2 > 1 and not estimate.is_known(KNOWN_S)
        if certainty * TELLING_S**2 < 1 or not has_time or (self._trial.is_on and not hasty):
            return
        is_news = certainty * estimate.variance > NEWS_SHARE
        if (is_news and not estimate.is_known(SURELY_S)) or self._count % SELDOM == 0:
            key = Rolled(held.edges, held.depths(self._rough), held.velocity)
            self._trial.begin(moment, key, self.rolling.seconds)
        self.is_trying = hasty and self._trial.is_on
        while hasty and self._trial.is_on:  # until it ends each frame is off by pixels
            self.go_on()

    def go_on(self) -> None:
        """Do a part of what takes too long for one frame, where there is time for it."""
        measured = self._trial.go_on()
        if measured is not None:
            self.rolling.estimate.take(measured)

    @property
    def _are_known(self) -> bool:
        return all(part.estimate.is_known(KNOWN_S) for part in (self.depth, self.rolling))

    def interrupt(self) -> None:
        """Take note that a frame is not to be trusted."""
        self.is_trying = False
        self._moments.interrupt()

    def unrolled(
        self, edges: EdgePixels, seen: Seen, velocity: NDArray[np.float64] | None
    ) -> EdgePixels:
        """Put the edges of a frame where they would be, had all rows been taken at once.

        Parameters
        ----------
        edges : EdgePixels
            All of the frame.
        seen : Seen
        velocity : ndarray of float64, shape (6,), or None
            Of the camera; None where it is not known.

        Returns
        -------
        EdgePixels
        """
        if velocity is None or not self.rolling.seconds:
            return edges
        depths = depth_at_edges(seen.frame.depth, seen.edges.index, self._rough)
        return self.rolling.unrolled(edges, velocity, depths)

    def hold(
        self,
        keyframe: Keyframe,
        seen: Seen,
        edges: EdgePixels,
        velocity: NDArray[np.float64] | None,
    ) -> None:
        """Remember what a keyframe was made of, to move its parts once more is known.

        Parameters
        ----------
        keyframe : Keyframe
        seen : Seen
            What it was made of, its depth kept, and
        edges : EdgePixels
            where its edges were seen.
        velocity : ndarray of float64, shape (6,), or None
            Of the camera then; None where that of the next frame has to do.
        """
        if not self._is_on:
            return
        rolled = np.zeros(6) if velocity is None else velocity * self.rolling.seconds / 2
        self._held = _Held(
            keyframe,
            seen.frame.depth,
            seen.frame.depth_delay,
            seen.edges.index,
            edges,
            seen.T_cam_depth,
            seen.is_fine,
            rolled,
            velocity,
        )

    def exchange(self, keyframe: Keyframe, by: Keyframe) -> None:
        """Take note that a keyframe has got more edges.

        Parameters
        ----------
        keyframe, by : Keyframe
            As it was, and as it is now.
        """
        if self._held is not None and self._held.keyframe is keyframe:
            self._held.keyframe = by

    def renewed(self, keyframe: Keyframe, velocity: NDArray[np.float64]) -> Keyframe | None:
        """Move the parts of a keyframe anew, if they were taken at other instants than thought.

        Parameters
        ----------
        keyframe : Keyframe
            That a frame was registered with.
        velocity : ndarray of float64, shape (6,)
            Of the camera at the frame.

        Returns
        -------
        Keyframe or None
            None if it is as good as before.
        """
        held = self._held
        if held is None or held.keyframe is not keyframe:
            return None
        if held.velocity is None:
            held.velocity = velocity
        known = self.depth.seconds, self.rolling.seconds
        if held.known == known:
            return None
        changed, held.known = keyframe, known
        T_cam_depth = self.depth.motion(held.velocity, held.depth_delay)
        now, then = (np.eye(4) if T is None else T for T in (T_cam_depth, held.T_cam_depth))
        if np.abs(se3.log(se3.inverse(then) @ now)).max() > NEWS:
            planes = self._fitter.planes(held.depth, T_cam_depth, fine=held.is_fine)
            # its samples keep the depth they had, which moves far less
            points = move_points(keyframe.points, now @ se3.inverse(then))
            changed = replace(changed, planes=planes, points=points)
            held.T_cam_depth = T_cam_depth
        rolled = held.velocity * self.rolling.seconds / 2
        if np.abs(rolled - held.rolled).max() > NEWS:
            depths = held.depths(self._rough)
            edges = self.rolling.unrolled(held.edges, held.velocity, depths)
            # what it has gathered was put where its edges were thought to be, and is off by as much
            every, telling = self._registration.indices(edges, len(keyframe.telling))
            changed = changed.moved(every, telling, self._camera)
            held.rolled = rolled
        if changed is keyframe:
            return None
        held.keyframe = changed
        return changed
