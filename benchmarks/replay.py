"""Registrations of a real run, caught and played again to see what their parts cost.

Matching and the update of the motion run inside one compiled kernel, ``kernels.align``. Its
Python source calls the same compiled parts, so running that source instead gives each warp and
each search with the very arguments it had. The cost of entering compiled code from Python is
taken off: it is that of an empty kernel with the same arguments.
"""

import inspect
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from types import FunctionType
from typing import Any
from unittest.mock import patch

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import Recording
from edvo import kernels
from edvo.camera import Camera
from edvo.clock import StageClock
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.matching import Criterion, EdgeIndex
from edvo.odometry import Odometry
from edvo.registration import Alignment, Registration

WARP, START = "warp_and_match", "best_start"  # the parts of kernels.align that match
SHORTEST_S = 2e-3  # of what is timed at a stretch


@numba.njit
def nothing(*arguments: Any) -> int:
    """Do nothing, with any arguments."""
    return 0


@dataclass(frozen=True)
class Caught:
    """The arguments of one registration of a run."""

    camera: Camera
    registration: Registration
    reference: EdgeIndex
    samples: EdgePixels
    starts: NDArray[np.float64]
    depth: tuple[Any, ...]

    def align(self) -> Alignment:
        """Register again."""
        return self.registration.align(self.reference, self.samples, self.starts, *self.depth)


@dataclass(frozen=True)
class Query:
    """What one warp of a registration asked of the reference edges."""

    pixels: NDArray[np.float32]
    gradients: NDArray[np.float32]
    criterion: Criterion


@dataclass(frozen=True)
class Parts:
    """What one registration is made of, seconds.

    Parameters
    ----------
    whole : float
        ``Registration.align`` as it is.
    matching : float
        Warping and matching in it, matches kept where they provably still hold.
    queries : list of Query
        One for each warp.
    """

    whole: float
    matching: float
    queries: list[Query]


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
    ) -> Alignment:
        caught.append(Caught(recording.camera, self, reference, samples, starts, depth))
        return align(self, reference, samples, starts, *depth)

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


def seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """Time a call: the median of a few, each over enough calls to be long against the clock."""
    begin = time.perf_counter()
    call()
    times = 1 + int(SHORTEST_S / max(time.perf_counter() - begin, 1e-7))
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(times):
            call()
        taken.append((time.perf_counter() - begin) / times)
    return median(taken)


def take_apart(caught: Caught, repeats: int) -> Parts:
    """Time a registration, and what of it is matching."""
    whole = seconds(caught.align, repeats)
    queries: list[Query] = []
    spent: list[float] = []

    def timed(part: Any) -> Callable[..., Any]:
        signature = inspect.signature(part.py_func)

        def call(*arguments: Any) -> Any:
            given = signature.bind(*arguments).arguments
            state = given.get("matches", ())  # what the part changes
            before = [array.copy() for array in state]
            result, taken = None, []
            for _ in range(repeats):
                for array, content in zip(state, before, strict=True):
                    array[...] = content
                begin = time.perf_counter()
                nothing(*arguments)
                middle = time.perf_counter()
                result = part(*arguments)
                taken.append(time.perf_counter() - middle - (middle - begin))
            spent.append(median(taken))
            if state:
                queries.append(_query(given))
            return result

        return call

    parts = {name: timed(getattr(kernels, name)) for name in (WARP, START)}
    source = kernels.align.py_func  # type: ignore[attr-defined]
    replay = FunctionType(source.__code__, vars(kernels) | parts)
    with patch.object(kernels, "align", replay):
        caught.align()  # compiles `nothing` for these arguments
        queries.clear()
        spent.clear()
        again = caught.align()
    if not np.allclose(again.T_ref_cur, caught.align().T_ref_cur, rtol=0, atol=1e-9):
        raise RuntimeError("played again step by step, a registration went another way")
    return Parts(whole, sum(spent), queries)


def _query(given: dict[str, Any]) -> Query:
    """Warp the samples by Eq. (1), as the call did; those that leave the image ask nothing."""
    camera, T = given["camera"], given["T"]
    points = given["points"] @ T[:3, :3].T + T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera.fx * points[:, 0] / points[:, 2] + camera.cx
        v = camera.fy * points[:, 1] / points[:, 2] + camera.cy
    inside = (points[:, 2] > kernels.MIN_DEPTH) & (u >= -0.5) & (v >= -0.5)
    inside &= (u < camera.width - 0.5) & (v < camera.height - 0.5)
    pixels = np.ascontiguousarray(np.column_stack([u, v])[inside], np.float32)
    compiled: kernels.Criterion = given["criterion"]
    criterion = Criterion(
        gamma=4 * compiled.direction / camera.width**2,
        width=camera.width,
        max_distance_px=math.sqrt(compiled.limit),
        max_angle_deg=math.degrees(math.acos(max(compiled.min_dot, -1.0))),
    )
    return Query(pixels, np.ascontiguousarray(given["gradients"][inside]), criterion)
