"""Registrations of a real run, caught to be played again."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import Recording
from edvo.camera import Camera
from edvo.clock import StageClock
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.matching import EdgeIndex
from edvo.odometry import Odometry
from edvo.registration import Alignment, Registration


@dataclass(frozen=True)
class Caught:
    """The arguments of one registration of a run."""

    camera: Camera
    registration: Registration
    reference: EdgeIndex
    samples: EdgePixels
    starts: NDArray[np.float64]
    depth: tuple[Any, ...]
    options: dict[str, Any]

    def align(self) -> Alignment:
        """Register again."""
        return self.registration.align(
            self.reference, self.samples, self.starts, *self.depth, **self.options
        )


@dataclass(frozen=True)
class CaughtRun:
    """A run, seen from inside.

    Parameters
    ----------
    stages : list of dict
        Seconds of each stage, for each frame but the first.
    track : list of float
        Seconds of ``Odometry.track``, for each frame but the first.
    registrations : list of Caught
    """

    stages: list[dict[str, float]]
    track: list[float]
    registrations: list[Caught]


def catch(recording: Recording, config: Config, count: int) -> CaughtRun:
    """Track ``count`` frames and keep what each registration was given."""
    caught: list[Caught] = []
    align = Registration.align

    def keep(
        self: Registration,
        reference: EdgeIndex,
        samples: EdgePixels,
        starts: NDArray[np.float64],
        *depth: Any,
        **options: Any,
    ) -> Alignment:
        given = Caught(recording.camera, self, reference, samples, starts, depth, options)
        caught.append(given)
        return align(self, reference, samples, starts, *depth, **options)

    clock = StageClock()
    odometry = Odometry(recording.camera, config, clock=clock)
    run = CaughtRun([], [], caught)
    with patch.object(Registration, "align", keep):
        for frame in recording.frames[:count]:
            begin = time.perf_counter()
            odometry.track(frame)
            run.track.append(time.perf_counter() - begin)
            run.stages.append(clock.take())
    del run.track[0], run.stages[0]
    return run


def spread(items: Sequence[Any], count: int) -> list[Any]:
    """Choose so many items, evenly spread."""
    step = max(1, len(items) // count)
    return list(items[step // 2 :: step][:count])
