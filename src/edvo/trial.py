"""Readouts tried out: which of them lets a frame and its keyframe fit each other best.

Not in the paper. Where a camera turns fast, misfits by rows are pixels wide: edges find wrong
partners, robust weights leave out what says most, and the equations of `edvo.rolling` tell half of
what is missing, too late. So both images are straightened by three readouts, and registered anew.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.measuring import Measured, Moment
from edvo.planes import PlaneFitter, camera_of
from edvo.registration import FAILURES, Alignment, Registration
from edvo.rolling import SHARP_PX, unroll

STEP_S = 0.012  # that the readouts tried are apart
STEPS = (0, -1, 1)  # of the three, from the one believed
FARTHEST = 1.5  # steps, that a readout is looked for beyond the one believed
SAMPLES = 750  # about so many are enough to tell


class Rolled(NamedTuple):
    """The edges of a keyframe, as they were seen."""

    edges: EdgePixels
    depths: NDArray[np.float32]  # (N,) of them, m; 0 where missing
    velocity: NDArray[np.float64]  # (6,) of the camera, [v, w] in its own frame, 1/s


class ReadoutTrial:
    """Tries readouts on a frame, one in the time of each frame that follows.

    Parameters
    ----------
    camera : Camera
        Of the images.
    registration : Registration
    fitter : PlaneFitter
        Its term of depth says what edges alone would be wrong about.
    """

    def __init__(self, camera: Camera, registration: Registration, fitter: PlaneFitter) -> None:
        self._pinhole = camera_of(camera)
        self._registration, self._term = registration, fitter.term
        self.forget()

    def forget(self) -> None:
        """Drop what is being tried."""
        self._moment: Moment | None = None
        self._tried: list[Alignment] = []

    @property
    def is_on(self) -> bool:
        """Whether one has begun, and not ended."""
        return self._moment is not None

    def begin(self, moment: Moment, key: Rolled, seconds: float) -> None:
        """Take a frame to try readouts on.

        Parameters
        ----------
        moment : Moment
            That is to be trusted.
        key : Rolled
            The keyframe that it was registered with.
        seconds : float
            The readout that is believed so far.
        """
        samples = moment.seen.samples
        self._stride = max(round(len(samples) / SAMPLES), 1)
        seen = replace(samples, pixels=moment.alignment.pixels)  # where they were seen
        self._moment, self._key, self._samples = moment, key, seen.every(self._stride)
        self._believed, self._tried = seconds, []

    def go_on(self) -> Measured | None:
        """Try the next of the three readouts.

        Returns
        -------
        Measured or None
            After the last of them, that which fits best by a parabola through what they cost; of
            no ``information`` where no other fits better, nor worse, or one could not be tried.
        """
        if self._moment is None:
            return None
        readout = self._believed + STEPS[len(self._tried)] * STEP_S
        self._tried.append(self._register(self._moment, readout))
        if len(self._tried) < len(STEPS):
            return None
        here, before, after = self._costs(self._moment)
        fails = any(tried.reason in FAILURES for tried in self._tried)
        self.forget()
        if fails:
            return Measured(readout, 0.0, 0.0)
        bend = (before - 2 * here + after) / STEP_S**2
        off = (before - after) / (2 * STEP_S * bend) if bend > 0 else math.inf
        if abs(off) > FARTHEST * STEP_S:  # no parabola reaches farther than its points for sure
            off = math.copysign(FARTHEST * STEP_S, before - after)
            bend = 2 * max(here - min(before, after), 0.0) / off**2
        return Measured(self._believed + off, bend, off)

    def _register(self, moment: Moment, readout: float) -> Alignment:
        """Register both images, straightened."""
        key, term = self._key, self._term
        edges = self._straightened(key.edges, readout, key.velocity, key.depths)
        return self._registration.align(
            self._registration.index(edges),
            self._straightened(self._samples, readout, moment.velocity),
            moment.alignment.T_ref_cur[None],
            moment.keyframe.planes,
            moment.seen.points,
            term._replace(weight=term.weight / self._stride),  # beside fewer edges
        )

    def _costs(self, moment: Moment) -> list[float]:
        """What is left of the misfit by each readout, in units of the scales by the first."""
        planes, points, first = moment.keyframe.planes, moment.seen.points, self._tried[0]
        sigma = max(first.sigma_px, SHARP_PX)
        near, costs = kernels.new_plane_matches(len(points.sigma)), []
        for tried in self._tried:
            cost = len(self._samples) * self._registration.cost(tried, sigma)
            if first.depth_balance:
                T = tried.T_ref_cur
                count = kernels.match_planes(planes, points, self._pinhole, T, self._term, near)
                off = kernels.plane_cost(near, count, len(points.sigma), first.sigma_depth)
                cost += first.depth_balance * off
            costs.append(self._stride * cost)
        return costs

    def _straightened(
        self,
        edges: EdgePixels,
        readout: float,
        velocity: NDArray[np.float64],
        depths: NDArray[np.float32] | None = None,
    ) -> EdgePixels:
        """Put edges where they would be, had all rows been taken at once."""
        return unroll(edges, readout, velocity, self._pinhole, depths)
