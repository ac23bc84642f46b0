"""What the parts of a registration cost, by playing it again step by step.

Matching and the update of the motion run inside one compiled kernel, ``kernels.align``. Its
Python source calls the same compiled parts, so running that source instead gives each warp and
each search with the very arguments it had. The cost of entering compiled code from Python is
taken off: it is that of an empty kernel with the same arguments. Times are those of the processor
in this thread, so that what else the machine does is not taken for a part of them.
"""

import inspect
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.errors import EvaluationError
from edvo.matching import Criterion, EdgeIndex
from edvo.registration import Alignment

_WARP, _START = "warp_and_match", "best_start"  # the parts of kernels.align that match
_SHORTEST_S = 1e-3  # of what is timed at a stretch


@numba.njit
def _nothing(*arguments: Any) -> int:
    """Do nothing, with any arguments."""
    return 0


@dataclass(frozen=True, eq=False)
class Query:
    """What one warp of a registration asked of the reference edges.

    Parameters
    ----------
    pixels, gradients : ndarray of float32, shape (N, 2)
        Of the samples, warped into the reference image.
    criterion : Criterion
        How they were matched.
    """

    pixels: NDArray[np.float32]
    gradients: NDArray[np.float32]
    criterion: Criterion


@dataclass(frozen=True, eq=False)
class Parts:
    """What one registration is made of.

    Parameters
    ----------
    whole : float
        Processor seconds of `Registration.align` as it is.
    matching : float
        Processor seconds of warping and matching in it, where a match is kept without a search
        if it provably still is the best.
    queries : list of Query
        One for each warp.
    """

    whole: float
    matching: float
    queries: list[Query]


def seconds(call: Callable[[], object], repeats: int) -> float:
    """Time a call.

    Parameters
    ----------
    call : callable
        What to time.
    repeats : int
        How many times, the first one apart, which may have to compile.

    Returns
    -------
    float
        Median of the processor's seconds, each measured over enough calls to be long against the
        clock.
    """
    begin = time.thread_time()
    call()
    times = 1 + int(_SHORTEST_S / max(time.thread_time() - begin, 1e-7))
    taken = []
    for _ in range(repeats):
        begin = time.thread_time()
        for _ in range(times):
            call()
        taken.append((time.thread_time() - begin) / times)
    return median(taken)


def take_apart(align: Callable[[], Alignment], repeats: int) -> Parts:
    """Time a registration, and what of it is matching.

    Parameters
    ----------
    align : callable
        Does it, by `Registration.align`.
    repeats : int
        How often each part is timed; the median counts.

    Returns
    -------
    Parts

    Raises
    ------
    EvaluationError
        If it goes another way when it is played again.
    """
    whole = seconds(align, repeats)
    queries: list[Query] = []
    spent: list[float] = []

    def timed(part: Any) -> Callable[..., Any]:
        signature = inspect.signature(part.py_func)

        def call(*arguments: Any) -> Any:
            given = signature.bind(*arguments).arguments
            state = (*given["matches"], *given.get("trial", ()))  # what the part changes
            before = [array.copy() for array in state]
            result, taken = None, []
            for _ in range(repeats):
                for array, content in zip(state, before, strict=True):
                    array[...] = content
                begin = time.thread_time()
                _nothing(*arguments)
                middle = time.thread_time()
                result = part(*arguments)
                taken.append(time.thread_time() - middle - (middle - begin))
            spent.append(median(taken))
            if "T" in given:  # of the starts none is known to be the pose
                queries.append(_query(given))
            return result

        return call

    parts = {name: timed(getattr(kernels, name)) for name in (_WARP, _START)}
    source: Any = kernels.align
    replay = FunctionType(source.py_func.__code__, vars(kernels) | parts)
    with _replaced(kernels, "align", replay):
        align()  # compiles the empty kernel for these arguments
        queries.clear()
        spent.clear()
        again = align()
    if not np.allclose(again.T_ref_cur, align().T_ref_cur, rtol=0, atol=1e-9):
        raise EvaluationError(
            "played again step by step, a registration went another way; are the kernels those "
            "of this version?"
        )
    return Parts(whole, sum(spent), queries)


def search_times(grid: EdgeIndex, tree: EdgeIndex, queries: list[Query]) -> tuple[float, float]:
    """Time the search for every warp of a registration, each anew.

    Parameters
    ----------
    grid, tree : EdgeIndex
        The same reference edges, arranged in two ways.
    queries : list of Query
        What is searched for.

    Returns
    -------
    tuple of float
        Processor seconds by grid and by tree, over all queries.

    Raises
    ------
    EvaluationError
        If the two find matches of different cost.
    """
    totals = [0.0, 0.0]
    for query in queries:
        costs = []
        for number, index in enumerate((grid, tree)):
            begin = time.thread_time()
            matches = index.match(query.pixels, query.gradients, query.criterion)
            totals[number] += time.thread_time() - begin
            costs.append(matches.costs)
        if not np.allclose(costs[0], costs[1], rtol=1e-5):
            raise EvaluationError("tree and grid found different matches; one of them is wrong")
    return totals[0], totals[1]


@contextmanager
def _replaced(module: Any, name: str, value: object) -> Iterator[None]:
    """Put something else in the place of a module's function for a while."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


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
