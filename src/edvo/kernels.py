"""The tracker's compiled inner loops and that of registering depth to colour, and nothing else.

Each public kernel has a plain NumPy twin in the module that uses it or among the tests, and
`canny_edges` that of OpenCV; a test holds the two equal.
All of them live in this one module, since numba's cache does not see an edit in a callee of
another file. None of them keeps state, and none holds the interpreter lock while it runs.

Matching works in squared pixels: Eq. (6) times width^2, so that one threshold serves both terms::

    cost = |p_r - p'|^2 + (gamma / 4) width^2 (g_r . g' - 1)^2
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
U32 = NDArray[np.uint32]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I16 = NDArray[np.int16]
I32 = NDArray[np.int32]
Function = TypeVar("Function", bound=Callable[..., Any])

NO_MATCH = -1
SLACK = 1e-3  # px; keeps cell bounds safe against rounding
FIRST_REACH = 2.5  # px; first window of a query without a hint, while nothing is known; then it is
REACH, LATEST = 1.5, 0.1  # so many times what such ones need, where the latest has that share,
FARTHEST = 10.0  # px; and counts no more than that
MARGIN = 0.4  # px; how far a window looks past what it needs, so that its answer lasts longer
NEEDED_AT_FIRST = (FIRST_REACH - MARGIN) / REACH
# A match found as one number: its cost, as the bits of a float32, and below it which edge it is
KEY_BITS, KEY_INDEX, NOTHING = np.int64(32), np.int64(2**32 - 1), np.int64(2**63 - 1)
MIN_DEPTH = 0.05  # m; what is nearer after the warp has no usable projection
TAN_22_5 = np.sqrt(2.0) - 1.0  # half of the angle between four directions
TAN_BITS = 15  # of the same behind the point, as OpenCV's Canny takes it; its int32 holds the rest
TAN_22_5_FIXED = round(TAN_22_5 * 2**TAN_BITS)
WEAK, STRONG = np.uint8(1), np.uint8(255)  # marks of edges: above the lower threshold, the upper
PIVOT = 1e-12  # smallest Cholesky pivot, relative to the diagonal

SIGNED, DISTANCE = 0, 1  # residual: Eq. (12), or Eq. (5)
NONE, STUDENT_T, HUBER, CAUCHY, TUKEY = 0, 1, 2, 3, 4  # robust weight functions
CONVERGED, STALLED, EXHAUSTED, TOO_FEW, SINGULAR = 0, 1, 2, 3, 4  # why a registration stopped
ALL = np.int64(1)  # a stride; a plain 1 would have its own compiled variant
HISTORY = 8  # columns of the iteration record
TUKEY_TUNING = 4.685  # 95 % efficient on a Gaussian
DIRECTIONS = 8  # over a full turn: an edge from dark to bright is none from bright to dark
LINE_DIRECTIONS = 4  # of lines, whichever side is bright: as many as `summarise_edges` tells
STRETCHED_PX = 0.1  # steps that change residuals by less (rms) do not tell how they go on
SAME_STEP = 1e-5  # share of a step by which more damping shortens it that does not count yet
SAME_SCALE = 0.1  # by which the scale of residuals may change before rows are coupled anew
ASKED = 8  # one edge in so many tells how many stay by chance
LOOK_UP, ROBUST, NORMAL = -1, 0, 1  # stages of a registration
EDGE_BITS = 21  # of a key of a near map: which edge; the bits above say how far off it is,
NEXT, CORNER = np.uint32(4 << EDGE_BITS), np.uint32(6 << EDGE_BITS)  # in quarters of a cell
NOWHERE = np.uint32(1023 << EDGE_BITS)
# Of an edge that is held against marks: the bits for the counts of `count_stays`, in their order
IS_OWN, HAS_MOVED, IS_STAYING = np.uint8(1), np.uint8(2), np.uint8(4)
LOG_2 = np.float32(np.log(2))
ROOT_OF_HALF = np.int32(np.float32(np.sqrt(0.5)).view(np.int32))  # its bits
SHARED_DEPTH = 0.1  # neighbours that differ by less, of their depth, are of one surface
DARKEST, BRIGHTEST = 8, 247  # grey levels at which noise is cut off, or compressed away
BAND_ROWS = 9  # rows looked at that a slope of light spans: more than an edge along them does
BAND_MARGIN = 1.5  # by so much more is taken off: where light bends in a line its slope is rough
MOST_ROUGH = 2**10 - 1  # noise of 250 grey levels leaves two fifths less rough
MAGNITUDE = np.int32(2**31 - 1)  # the bits of a float32 but for its sign
FLAT = np.float32(1e-6)  # a bend of less than that is none: logarithms are not more exact
PROFILES = 400  # so many tell how profiles usually change,
LEAST_CHANGE = 0.02  # which is by no less: noise of the image;
OF_A_LINE = 20  # of one direction tell how that changes,
MOST_TRUST = 2.0  # and none of them counts more: else a few could hold a direction alone
SMEARED_DOUBT = 1.5  # px^-2: by so much more edges scatter, squared, over that of sharp ones
TURNED_ALIKE = 0.8  # cosine between the gradients of an edge and of its match, or they are others
FLATTEST = 0.01  # px^-2, a bend of less than that is none
# So much is at hand together, and stays in the nearest cache:
PATCHES = 64  # of edges,
BATCH = 1024  # edges, with their gradients and what a lens does to them
ROW_1, ROW_2, ROW_3, ROW_4, ROW_5, ROW_6, ROW_7 = (np.uint64(i * BATCH) for i in range(1, 8))
# The patch that tells the depth of an edge: so many pixels to either side, and half as long;
ACROSS, HALF_LENGTH = 3, 1
LEAST_PIXELS = 6  # of a side, or it is not seen
ONE_SURFACE, ONE_SIDE = 1.5, 2.0  # off by less (rms, in units of the noise) both are plane, or one
BENT, STEPPED = 3.0, 5.0  # so many standard deviations apart it bends there, or ends
STEEP = 0.02  # of the depth, from pixel to pixel: what is turned away farther is no surface
ROUNDING = 1 / 12  # px^2, of a pixel that is the nearest to where it should be
PRIOR = 1e-3  # (m or rad)^2 / px^2; what a motion is known to before the first edge is drawn
MIN_PLANE_SIGMA = 0.02  # floor of the scale of distances to planes, in units of the noise
# What is summed goes to so many sums by turns, which are added last: so a loop runs on vectors,
# and the result does not depend on how wide those are.
LANES = 64
PAIRS = 21  # of six derivatives, below the diagonal and on it
# Rows of a table (TABLE, LANES) that sums are made of: the derivatives come first, and after the
# last of these are a point, and what else is needed on the way
RESIDUAL, WEIGHT, PUSH, SPARE, POINT, BY_DEPTH, BEND, TABLE = 6, 7, 8, 9, 10, 13, 14, 15
# Bins of a histogram of residuals: 64 to an octave, from 2^-10 up; what is less is in the first
SCALE_BINS, SCALE_SHIFT, LEAST_STEP = 1024, np.int32(23 - 6), np.int32((127 - 10) << 6)


def compiled_with(**options: Any) -> Callable[[Function], Function]:
    """Make a decorator that compiles a kernel, which releases the interpreter lock.

    Without a writable cache folder the kernel is compiled anew in each process.

    Parameters
    ----------
    **options
        More options of ``numba.njit``.

    Returns
    -------
    callable
        From a function in the part of Python that numba takes to the compiled one.
    """

    def compile_it(function: Function) -> Function:
        try:
            return cast(Function, numba.njit(nogil=True, cache=True, **options)(function))
        except RuntimeError:  # numba: no locator available for the cache
            return cast(Function, numba.njit(nogil=True, **options)(function))

    return compile_it


compiled = compiled_with()
# An index that is not negative: numba asks a signed one each time whether it counts from the end.
place = np.uint64
# Without counting references to the arrays that it is given, which costs a kernel called for each
# sample some twenty nanoseconds. It may neither make nor return an array, and calls only its like.
COUNTS_NOTHING = {"_nrt": False} if hasattr(numba.core.options.DefaultOptions, "_nrt") else {}
lean = compiled_with(**COUNTS_NOTHING)
lean_float = compiled_with(error_model="numpy", **COUNTS_NOTHING)  # 1 / 0 is infinite: no branch


class Grid(NamedTuple):
    """Reference edges sorted by square cell; cell (row, col) holds points[start[i]:start[i+1]]."""

    points: F32  # (M, 4) u, v, unit gradient u, v
    order: I32  # (M,) index of each sorted point among the edges given
    start: I32  # (rows * cols + 1,)
    rows: int
    cols: int
    left: float  # px, of the first cell
    top: float
    inverse: float  # 1/px, one over the cell size


class NearMap(NamedTuple):
    """For each cell of an image and each direction an edge that is near, if not the nearest."""

    keys: U32  # (rows * cols * DIRECTIONS,) way << EDGE_BITS | sorted index; a frame has none
    rows: int
    cols: int
    left: float  # px, of the first cell inside the frame
    top: float
    inverse: float  # 1/px, one over the cell size


class Tree(NamedTuple):
    """A balanced k-d tree over (u, v, g_u, g_v), nodes in in-order, the median as the root."""

    points: F32  # (M, 4)
    order: I32  # (M,)
    axis: NDArray[np.int8]  # (M,) the axis that splits at each node


class Criterion(NamedTuple):
    """Eq. (6) in squared pixels, and what a match may not exceed."""

    direction: float  # (gamma / 4) width^2, px^2; 0 is the normal criterion
    limit: float  # px^2; the squared distance beyond which nothing is a match
    min_dot: float  # cosine of the widest angle between gradients


class Pinhole(NamedTuple):
    """An ideal camera for the warp, Eq. (1)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class Lens(NamedTuple):
    """Distortion as in OpenCV, in the order of ``Camera.distortion``."""

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float


class Matches(NamedTuple):
    """State of the samples' matches while a registration runs."""

    edge: I32  # (N,) sorted index of the reference edge, or NO_MATCH
    query: F64  # (N, 2) where the sample lay when it was last searched for, px
    bound: F64  # (N,) px; there, no other edge had a lower root of the cost
    Y: F64  # (N, 3) the sample in the reference camera, m
    normal: F64  # (N, 2) what the residual is measured along
    trust: F64  # (N,) what residual and normal were multiplied by
    judged: I32  # (N,) sorted index of the edge that this is for, or NO_MATCH


class Change(NamedTuple):
    """How profiles of samples usually differ from those of their matches; see `write_profiles`."""

    middle: F64  # (LINE_DIRECTIONS, 2) the middle difference of edges of each direction
    per: F64  # (2,) one over what difference from that makes a match half as good
    norm: F64  # (LINE_DIRECTIONS,) makes the mean square of the trust 1, as far as it may


class PlaneMap(NamedTuple):
    """Planes tangent to what a reference depth image shows, at pixels a step apart."""

    normals: F64  # (rows * cols, 3) unit, away from the camera
    offsets: F64  # (rows * cols,) m, n . X = offset; 0 where there is no plane
    rows: int
    cols: int
    step: float  # px


class PlanePoints(NamedTuple):
    """Points on the surfaces of the current depth image."""

    X: F64  # (M, 3) m
    normals: F64  # (M, 3)
    sigma: F64  # (M,) m, noise of the sensor's depth there
    step_px: float  # side of the square of the image that each stands for


class DepthTerm(NamedTuple):
    """How points are compared with planes, and what that counts beside the edges."""

    weight: float  # 0 leaves the term out
    doubt: float  # scale of the residuals at which it counts half
    edge_doubt: float  # px; what edges err by together
    most: float  # that it counts, times the edges
    min_dot: float  # cosine of the widest angle between the normals
    limit: float  # of a residual, in units of the noise
    min_points: int


class Lag(NamedTuple):
    """When the parts of a frame were taken, over the time since the last frame.

    ``steady`` is an inverse covariance, 1/m^2 and 1/rad^2, of what an acceleration that lasts moves
    the camera by in that time squared, a left perturbation [v, w], times what counts of it against
    a single edge.
    """

    share: float  # of depth, as against the image; 0 at once
    bend: float  # what of that motion it is off by
    T_ref_last: F64  # (4, 4) pose of the last image
    T_depth_cam: F64  # (4, 4) takes back what the points were moved by already
    rows: F64  # (N,) of each sample, as against the middle of the image; empty: all at once
    bends: F64  # (N,) what of that motion each sample is off by; empty: none
    sharp: F64  # (N,) what each counts, less where it moved while it was exposed; empty: 1
    steady: F64  # (6, 6) how sure it is that the camera goes on as it went; empty: wholly


class PlaneMatches(NamedTuple):
    """State of the points' planes while a registration runs, packed to the front."""

    Y: F64  # (3, M) the point in the reference camera, m
    normal: F64  # (3, M) of its plane, over the noise across it, 1/m
    residuals: F64  # (M,) distance over that noise
    point: I32  # (M,) which point it is


class Places(NamedTuple):
    """When an edge in view of the reference is in its place there."""

    most_px: float  # from its match, times its trust
    least_dot: float  # of its gradient and that of its match
    rim_px: float  # of the reference: what is nearer to its border may not be in view


class Chamfer(NamedTuple):
    """Edges to be judged by how near they fall to those of a reference image."""

    scores: U8  # (rows * cols * DIRECTIONS,) 255 on an edge, less beside it; 0 all round
    rows: int
    cols: int
    cell: float  # px
    points: F32  # (3, N) the edges in the current camera, m
    directions: I32  # (N,) of their gradients
    camera: Pinhole
    least: float  # such a share counts at least as being in view


class Sums(NamedTuple):
    """Sums over n pixels, at (u, v) from the middle of a window, of w: depth, or its inverse."""

    n: float
    u: float
    v: float
    uu: float
    uv: float
    vv: float
    w: float
    uw: float
    vw: float
    ww: float


class Solver(NamedTuple):
    """What the iteration of Eq. (13)-(14) needs to know."""

    residual: int
    weight: int
    tuning: float  # nu of the t-distribution; the tuning constant of the others
    min_sigma: float  # px
    max_sigma: float  # px
    first_sigma: float  # px, its floor before the last stage
    coarse_samples: int  # while edges are looked up every k-th is taken, and so many at least
    coarse_points: np.int64  # and one point of depth in so many
    first_points: np.int64  # of depth at least, in the first stage
    first_samples: int  # before the last stage every k-th is taken, and so many at least; 0: all
    min_matches: int
    max_iterations: int
    switch_px: float  # rms change of the residuals below which the normal criterion takes over
    stop_px: float  # rms change below which the iteration has converged
    stop_share: float  # of the scale, below which it has to be in the last stage, too; 0: not asked
    leave_px: float  # as soon as steps leave less, or that share of a finer scale; 0: not before
    stop_cost: float  # relative decrease of the cost below which it has converged
    damping: float  # lambda at the start
    damping_up: float
    damping_down: float
    max_rejections: int  # in a row
    max_stretch: float  # times its length that a step may be which goes on as the last; 1: none
    kept_px: float  # rms change below which a step of the last stage leaves points on their planes
    profile_spread: float  # times the usual change of a profile that halves a match; 0: not asked


# --------------------------------------------------------------------------------------- arrays
# Arrays assigned to slices take numba a tenth of a second each to compile, and what sorts or parts
# numbers by numpy several seconds: so this is written out.


@lean
def clear(target: F64) -> None:
    """Overwrite numbers by 0."""
    for i in range(place(target.size)):
        target[i] = 0


@lean
def put(source: NDArray[Any], target: NDArray[Any]) -> None:
    """Overwrite the first numbers of an array by others; nobody checks that it holds as many."""
    for i in range(place(source.size)):
        target[i] = source[i]


@lean
def put_square(source: F64, target: F64) -> None:
    """Overwrite a matrix by another of its size; nobody checks that it is."""
    for i in range(place(source.shape[0])):
        for j in range(place(source.shape[1])):
            target[i, j] = source[i, j]


@lean
def greatest(values: F64) -> float:
    """The largest of some numbers, 0 at least."""
    most = 0.0
    for i in range(place(values.size)):
        most = max(most, values[i])
    return most


@compiled
def select(values: F64, k: int) -> float:
    """The k-th smallest of some numbers, none of them NaN, from 0 on.

    Reorders them: what is before it then is less or equal, and what is after it no less. By Hoare's
    selection, which parts again and again the side that holds it.
    """
    first, last = 0, values.size - 1
    while first < last:
        pivot, i, j = values[(first + last) // 2], first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < k < i:
            break
        first, last = (first, j) if k <= j else (i, last)
    return float(values[k])


# --------------------------------------------------------------------------------------- sensor


@lean
def structured_light_noise(
    depth: F64, floor: float, slope: float, nearest: float, sigma: F64
) -> None:
    """Write the noise, floor + slope (z - nearest)^2, of depths z (N,): m, ``slope`` in 1/m."""
    for i in range(depth.size):
        off = depth[i] - nearest
        sigma[i] = floor + slope * (off * off)


# ---------------------------------------------------------------------------------------- edges


@compiled
def count_strengths(dx: I16, dy: I16, step: int, counts: I32) -> None:
    """Add every step-th pixel to the number of those with its |dx| + |dy|, or more in the last.

    On four lists in turn: of a plain image most go to the same few, each of which would have to
    wait for the one before.
    """
    most, four = np.int32(counts.size - 1), place(4)
    apart = np.zeros((4, counts.size), np.int32)
    strengths = np.empty(dx.shape[1], np.int32)
    turn = place(0)
    for v in range(step // 2, dx.shape[0], step):
        across, down = dx[v], dy[v]
        for u in range(place(strengths.size)):  # of all of them: on vectors
            a, b = np.int32(across[u]), np.int32(down[u])
            strength = np.int32(max(a, np.int32(-a)) + max(b, np.int32(-b)))
            strengths[u] = min(strength, most)
        for u in range(place(step // 2), place(strengths.size), place(step)):
            apart[turn % four, place(strengths[u])] += 1
            turn += place(1)
    for i in range(counts.size):
        counts[i] += apart[0, i] + apart[1, i] + apart[2, i] + apart[3, i]


@lean
def leaning(dv: I16, first: int, end: int, step: int, least: int) -> int:
    """Tell whether three of four gradients in a row are above 0, 1, or below, -1; else 0.

    2 where fewer than ``least`` of those looked at are one or the other.
    """
    down = up = 0
    for u in range(first, end, step):
        down += int(dv[u] > 0)
        up += int(dv[u] < 0)
    if down + up < least:
        return 2
    return int(down >= 3 * up) - int(up >= 3 * down)


@compiled
def one_sided_rows(dv: I16, step_v: int, step_u: int, least: int) -> float:
    """Share of the rows from which all of an image gets darker, or brighter: the lesser of both.

    Of every ``step_v``-th row, by every ``step_u``-th pixel: three of four gradients along columns
    point one way, on the left as on the right, but for a side on which fewer than ``least`` tell.
    """
    rows = falls = rises = 0
    width = dv.shape[1]
    for v in range(step_v // 2, dv.shape[0], step_v):
        left = leaning(dv[v], step_u // 2, width // 2, step_u, least)
        right = leaning(dv[v], width // 2, width, step_u, least)
        left = right if left == 2 else left
        right = left if right == 2 else right
        rows += 1
        falls += int(left == 1 and right == 1)
        rises += int(left == -1 and right == -1)
    return min(falls, rises) / max(rows, 1)


@compiled
def least_of_any(values: F64, side: int, room: F64) -> None:
    """Lower values to the highest at which ``side`` of them in a row stand, an odd number.

    So a peak that is narrower goes, and what is wider stays as it is, its corners too. Beyond
    either end nearly half of them may lie. ``room`` is for as many values.
    """
    n, half = values.size, side // 2
    for k in range(n):
        first = k - half
        room[k] = values[max(first, 0) : min(first + side, n)].min()
    for k in range(n):
        values[k] = room[max(k - half, 0) : min(k + half + 1, n)].max()


@compiled
def row_slopes(grey: U8, dv: I16, step_v: int, step_u: int, least: int, slopes: F64) -> float:
    """Write how light changes along columns, as a share of it, for every ``step_v``-th row.

    The median over every ``step_u``-th pixel that is neither black nor white, 0 where these are
    few; and of that what so many rows have in common as no edge along them is wide. Returns the
    largest, in units of the gradient.
    """
    n, width = slopes.size, grey.shape[1]
    up, down, room, some = np.zeros(n), np.zeros(n), np.empty(n), np.empty(width // step_u + 1)
    means = np.zeros(n)
    for k in range(n):
        v, count, total = k * step_v + step_v // 2, 0, 0
        for u in range(step_u // 2, width, step_u):
            if DARKEST < grey[v, u] < BRIGHTEST:
                some[count] = dv[v, u] / grey[v, u]
                total += grey[v, u]
                count += 1
        if count >= least:
            slope = select(some[:count], count // 2)
            if count % 2 == 0:
                slope = (some[: count // 2].max() + slope) / 2
            up[k], down[k], means[k] = max(slope, 0.0), max(-slope, 0.0), total / count
    slopes[:] = 0
    if n < BAND_ROWS:
        return 0.0
    least_of_any(up, BAND_ROWS, room)
    least_of_any(down, BAND_ROWS, room)
    largest = 0.0
    for k in range(n):
        slopes[k] = up[k] - down[k]
        largest = max(largest, abs(slopes[k]) * means[k])
    return largest


@lean
def lessen_row(grey: U8, slope: float, dv: I16) -> None:
    """Take from gradients of a row what the slope makes of its light, of those along it."""
    share, zero = np.float32(BAND_MARGIN * slope), np.int16(0)
    lowest, highest = np.float32(-32768), np.float32(32767)
    if slope > 0:
        for u in range(dv.size):
            light = np.int16(min(share * np.float32(grey[u]), highest))
            dv[u] -= min(light, max(dv[u], zero))
    else:
        for u in range(dv.size):
            light = np.int16(max(share * np.float32(grey[u]), lowest))
            dv[u] -= max(light, min(dv[u], zero))


@compiled
def take_off_slopes(grey: U8, slopes: F64, step_v: int, dv: I16) -> None:
    """Take from gradients along columns what `row_slopes`, between them in a line, make of light.

    None becomes one of the other sign: where an image is white it has no slope to take off.
    """
    last = slopes.size - 1
    for v in range(dv.shape[0]):
        at = min(max((v - step_v // 2) / step_v, 0.0), float(last))
        k = min(int(at), max(last - 1, 0))
        slope = slopes[k] + (at - k) * (slopes[min(k + 1, last)] - slopes[k])
        if slope != 0:
            lessen_row(grey[v], slope, dv[v])


@lean
def roughness(a: I32, b: I32, c: I32) -> int:
    """Tell the difference of two Laplacians in the middle of three rows of three, unsigned."""
    two, four = np.int32(2), np.int32(4)
    corners, sides = a[0] + a[2] + c[0] + c[2], a[1] + b[0] + b[2] + c[1]
    return abs(int(corners - two * np.int32(sides) + four * b[1]))


@lean
def quantile_of(counts: I32, share: float) -> float:
    """Tell what so many of the places are less rough than, between whole numbers; 0 of none."""
    every, below = 0, 0
    for k in range(counts.size):
        every += counts[k]
    wanted = share * every
    for k in range(counts.size):
        below += counts[k]
        if every > 0 and below >= wanted:
            return max(k + 0.5 - (below - wanted) / counts[k], 0.0)
    return 0.0


@compiled
def quiet_roughness(grey: U8, step: int, share: float) -> tuple[float, float]:
    """Tell what that share of the places is less rough than: of pixels, and sums of 2 x 2 of them.

    Places of which a sum is black or white are left out: noise is cut off there.
    """
    black, white, most = np.int32(4 * DARKEST), np.int32(4 * BRIGHTEST), MOST_ROUGH
    fine, coarse = np.zeros(most + 1, np.int32), np.zeros(most + 1, np.int32)
    pixels, sums = np.empty((6, 6), np.int32), np.empty((3, 3), np.int32)
    for v in range(0, grey.shape[0] - 5, step):
        for u in range(0, grey.shape[1] - 5, step):
            for i in range(6):
                for j in range(6):
                    pixels[i, j] = grey[v + i, u + j]
            inside = True
            for i in range(3):
                for j in range(3):
                    above = np.int32(pixels[2 * i, 2 * j] + pixels[2 * i, 2 * j + 1])
                    below = np.int32(pixels[2 * i + 1, 2 * j] + pixels[2 * i + 1, 2 * j + 1])
                    sums[i, j] = np.int32(above + below)
                    inside &= black < sums[i, j] < white
            if inside:
                by_pixel = roughness(pixels[2, 2:5], pixels[3, 2:5], pixels[4, 2:5])
                fine[place(min(by_pixel, most))] += 1
                by_sum = roughness(sums[0], sums[1], sums[2])
                coarse[place(min(by_sum, most))] += 1
    return quantile_of(fine, share), quantile_of(coarse, share)


@lean
def step_between(one: np.uint8, other: np.uint8, largest: int) -> int:
    """Tell by how many grey levels two pixels differ, at most so many."""
    return min(abs(int(np.int32(one) - np.int32(other))), largest)


@compiled
def mean_steps(grey: U8, apart: int, largest: int) -> tuple[float, float]:
    """Tell mean steps between blocks of 8 x 8 pixels, and between the two pixels amid each.

    Along rows and columns so far ``apart``; a step counts as no more than ``largest``. Of each
    block beyond the first, its border to the one before and the middle of that one.
    """
    between = amid = count = 0
    height, width = grey.shape
    for v in range(apart // 2, height, apart):
        for u in range(8, width, 8):
            between += step_between(grey[v, u], grey[v, u - 1], largest)
            amid += step_between(grey[v, u - 4], grey[v, u - 5], largest)
            count += 1
    for v in range(8, height, 8):
        for u in range(apart // 2, width, apart):
            between += step_between(grey[v, u], grey[v - 1, u], largest)
            amid += step_between(grey[v - 4, u], grey[v - 5, u], largest)
            count += 1
    return between / max(count, 1), amid / max(count, 1)


@compiled
def smallest(values: F32, k: int) -> np.float32:
    """The k-th smallest of some values, none of them NaN, from 0 on.

    Bit by bit, by how many are less: 32 times through all of them on vectors takes a fraction of
    what it takes to sort them, or to part them, by branches that cannot be foretold.
    """
    bits = values.view(np.int32)
    keys = np.empty(bits.size, np.int32)
    for i in range(bits.size):  # of what is negative the bits descend
        keys[i] = np.int32(bits[i] ^ np.int32(np.int32(bits[i] >> np.int32(31)) & MAGNITUDE))
    found = np.int64(-(2**31))
    for bit in range(31, -1, -1):
        tried = np.int64(found + (np.int64(1) << bit))
        bar, less = np.int32(tried), np.int32(0)
        for i in range(keys.size):
            less = np.int32(less + np.int32(keys[i] < bar))
        if less <= k:
            found = tried
    key = np.int32(found)
    return np.int32(key ^ np.int32(np.int32(key >> np.int32(31)) & MAGNITUDE)).view(np.float32)


@compiled
def median(values: F32) -> float:
    """The median of some values, one at least and none of them NaN, as ``np.median`` takes it."""
    upper = np.float64(smallest(values, values.size // 2))
    if values.size % 2 > 0:
        return upper
    return (np.float64(smallest(values, values.size // 2 - 1)) + upper) / 2


@lean
def exceeded(counts: I32, share: float) -> int:
    """Tell which strength this share of the pixels exceeds, at most; see `thresholds.exceeded`."""
    as_strong = np.int64(0)
    for k in range(counts.size):
        as_strong += counts[k]
    most = share * as_strong
    for k in range(counts.size):
        if not as_strong > most:
            return max(k - 1, 0)
        as_strong -= counts[k]
    return counts.size - 1


@lean
def undercut(counts: I32, share: float) -> float:
    """Tell which strength this share of those above 0 stays below; see `thresholds.undercut`."""
    every, as_weak = np.int64(0), np.int64(0)
    for k in range(1, counts.size):
        every += counts[k]
    for k in range(1, counts.size):
        as_weak += counts[k]
        if every > 0 and as_weak >= share * every:
            return k - 0.5
    return 0.0


@lean_float
def sum_columns(a: U8, b: U8, c: U8, d: U8, e: U8, sums: I16) -> None:
    """Write five rows, weighed 1, 4, 6, 4 and 1, behind the first two places."""
    four, six = np.int32(4), np.int32(6)
    for u in range(a.size):
        outer, inner = np.int32(a[u]) + np.int32(e[u]), np.int32(b[u]) + np.int32(d[u])
        sums[u + 2] = np.int16(
            np.int32(outer + np.int32(four * np.int32(inner))) + np.int32(six * np.int32(c[u]))
        )


@lean_float
def blur_row(sums: I16, steps: np.int32, smooth: I16) -> None:
    """Do the same along a row, rounded to so many steps a grey level, behind the first place.

    Sums are 256 a grey level, 16 x 16 x 255 at most, so that 16 bits without a sign hold them. They
    are shifted by a product whose upper half remains: a shift by as much as one likes would be done
    in numbers of which fewer fit into a vector.
    """
    short = np.uint16
    four, six, half = short(4), short(6), short(np.int32(128) // steps)
    times, upper = short(np.int32(256) * steps), np.uint32(16)
    for u in range(smooth.size - 2):
        outer = short(short(sums[u]) + short(sums[u + 4]))
        inner = short(short(sums[u + 1]) + short(sums[u + 3]))
        total = short(outer + short(four * inner))
        total = short(short(total + short(six * short(sums[u + 2]))) + half)
        product = np.uint32(np.uint32(total) * np.uint32(times))
        smooth[u + 1] = np.int16(short(product >> upper))


@lean_float
def slope_row(above: I16, here: I16, below: I16, du: I16, dv: I16) -> None:
    """Write Sobel's gradients of a row, which stands behind the first place of each."""
    for u in range(du.size):
        a, b, c = above[u], above[u + 1], above[u + 2]
        d, f = here[u], here[u + 2]
        g, h, i = below[u], below[u + 1], below[u + 2]
        du[u] = np.int16(
            np.int16(np.int16(c - a) + np.int16(i - g)) + np.int16(np.int16(f - d) * np.int16(2))
        )
        dv[u] = np.int16(
            np.int16(np.int16(g - a) + np.int16(i - c)) + np.int16(np.int16(h - b) * np.int16(2))
        )


@lean
def blur_at(grey: U8, row: int, steps: np.int32, sums: I16, smooth: I16) -> None:
    """Blur a row of an image with 1, 4, 6, 4 and 1 both ways, with one pixel more at either end.

    Beyond the borders the image is mirrored about its outermost pixels.
    """
    height, width = grey.shape
    above, below = abs(row - 1), height - 1 - abs(height - 2 - row)
    top, bottom = abs(row - 2), height - 1 - abs(height - 3 - row)
    sum_columns(grey[top], grey[above], grey[row], grey[below], grey[bottom], sums)
    sums[0], sums[1] = sums[4], sums[3]
    sums[width + 2], sums[width + 3] = sums[width], sums[width - 1]
    blur_row(sums, steps, smooth)
    smooth[0], smooth[width + 1] = smooth[2], smooth[width - 1]


@compiled
def blurred_gradients(grey: U8, steps: np.int32, du: I16, dv: I16) -> None:
    """Blur an image with 1, 4, 6, 4 and 1 along columns and rows, and write Sobel's gradients.

    In one pass, row by row. Of the 256 steps that a grey level then has so many stay, 1, 2, 4 or 8.
    It has three rows and columns at least.
    """
    height, width = grey.shape
    sums, rows = np.empty(width + 4, np.int16), np.empty((3, width + 2), np.int16)
    for row in range(height + 1):
        if row < height:
            blur_at(grey, row, steps, sums, rows[row % 3])
        if row > 0:
            before = abs(row - 2)
            after = row if row < height else height - 2
            slope_row(
                rows[before % 3], rows[(row - 1) % 3], rows[after % 3], du[row - 1], dv[row - 1]
            )


@lean_float
def sum_apart(above: I16, here: I16, below: I16, sums: I16) -> None:
    """Write three rows, weighed 1, 2 and 1, behind the first place."""
    two = np.int16(2)
    for u in range(here.size):
        sums[u + 1] = np.int16(np.int16(above[u] + below[u]) + np.int16(two * here[u]))


@lean_float
def widen_row(sums: I16, wide: I16) -> None:
    """Weigh a row likewise, two pixels apart, and take the mean, behind the first place.

    Sums are at most 4 x 4 x 8 x 255, which 16 bits hold.
    """
    two, half, bits = np.int16(2), np.int16(8), np.int16(4)
    for u in range(wide.size - 2):
        total = np.int16(np.int16(sums[u] + sums[u + 4]) + np.int16(two * sums[u + 2]))
        wide[u + 1] = np.int16(np.int16(total + half) >> bits)


@compiled
def widely_blurred_gradients(
    grey: U8, steps: np.int32, passes: int, here: I16, there: I16, du: I16, dv: I16
) -> None:
    """Blur an image as `blurred_gradients` does, and then with 1, 0, 2, 0 and 1, so many times.

    Each of these ``passes`` adds a variance of 2 px^2. ``here`` and ``there`` (H, W + 2) are room
    for blurred images. Of the steps that a grey level has 8 are left at most.
    """
    height, width = grey.shape
    sums = np.empty(width + 4, np.int16)
    for row in range(height):
        blur_at(grey, row, steps, sums, here[row])
    for _ in range(passes):
        for row in range(height):
            above, below = abs(row - 2), height - 1 - abs(height - 3 - row)
            sum_apart(here[above], here[row], here[below], sums)
            sums[0], sums[width + 3] = sums[4], sums[width - 1]
            widen_row(sums, there[row])
            there[row, 0], there[row, width + 1] = there[row, 2], there[row, width - 1]
        here, there = there, here
    for row in range(height):
        before, after = abs(row - 1), height - 1 - abs(height - 2 - row)
        slope_row(here[before], here[row], here[after], du[row], dv[row])


@lean_float
def row_and_column(flat: np.int64, per_width: float, width: int) -> tuple[int, int]:
    """Tell where a flat index is. To divide by a whole number takes four times as long."""
    v = int((flat + 0.5) * per_width)
    return v, int(flat) - v * width


@lean_float
def sum_magnitudes(du: I16, dv: I16, strengths: I16) -> None:
    """Write |du| + |dv| of a row behind the first place; Sobel leaves room for the sum."""
    for u in range(du.size):
        a, b = du[u], dv[u]
        strengths[u + 1] = np.int16(max(a, np.int16(-a)) + max(b, np.int16(-b)))


@lean_float
def thin_row(
    du: I16, dv: I16, above: I16, here: I16, below: I16, low: np.int32, high: np.int32, marks: U8
) -> None:
    """Mark the pixels of a row that are the strongest of three along their gradient.

    Of a pixel as strong as its neighbour the one to the left, or above, is taken, and along a
    diagonal neither. All pixels are worked out alike, without a branch, on vectors. Gradients are
    8188 at most, so that 16 bits hold 1 + sqrt(2) times as much.
    """
    tangent, one, none = np.uint32(TAN_22_5_FIXED * 2), np.int16(1), np.int16(0)  # 16 bits of it
    most = np.int32(2**15 - 1)
    weakest, strongest = np.int16(min(low, most)), np.int16(min(high, most))
    for u in range(marks.size):
        gu, gv = du[u], dv[u]
        wide, high_up = np.int16(max(gu, np.int16(-gu))), np.int16(max(gv, np.int16(-gv)))
        # turned by 22.5 degrees, cut to a whole number; tan 67.5 is greater by 2
        turned = np.int16(np.uint32(np.uint32(np.uint16(wide)) * tangent) >> np.uint32(16))
        steeper = np.int16(turned + np.int16(wide + wide))
        level, steep = high_up <= turned, high_up > steeper
        falls = np.int16(gu ^ gv) >= none
        strength, left, right = here[u + 1], here[u], here[u + 2]
        over, under = above[u + 1], below[u + 1]
        over_left, under_right = above[u], below[u + 2]
        over_right, under_left = above[u + 2], below[u]
        before = over_left if falls else over_right
        after = under_right if falls else under_left
        after = np.int16(after + one)  # along a diagonal one as strong is too strong
        before, after = over if steep else before, under if steep else after
        before, after = left if level else before, right if level else after
        top = (strength > weakest) & (strength > before) & (strength >= after)
        mark = STRONG if strength > strongest else WEAK
        marks[u] = mark if top else np.uint8(0)


@lean
def list_set(words: NDArray[np.uint64], hits: I32, listed: I32, marks: U8) -> np.int64:
    """Write where bytes of ``marks`` are not 0, in their order; returns how many.

    ``words`` is a view of eight marks each. Those that have any are listed in ``hits`` first: to
    ask word by word, or mark by mark, would cost branches that cannot be foretold.
    """
    one, eight, count, some = place(1), place(8), place(0), place(0)
    for word in range(place(words.size)):
        hits[some] = np.int32(word)
        some += place(words[word] != 0)
    for hit in range(some):
        first = place(hits[hit]) * eight
        bits = words[place(hits[hit])]
        bits |= bits >> place(4)
        bits |= bits >> place(2)
        bits |= bits >> one  # the lowest of each byte that has any is set
        for k in range(eight):
            listed[count] = np.int32(first + k)  # overwritten, unless it counts
            count += (bits >> (k * eight)) & one
    total = np.int64(count)
    for i in range(words.size * 8, marks.size):
        listed[total] = i
        total += int(marks[i] != 0)
    return total


@lean_float
def mark_seeds_within(above: U8, here: U8, below: U8, seeds: U8) -> None:
    """Mark weak pixels with a strong one among their eight neighbours, from the second on.

    Of all rows at once, as if each went on in the next, so that all is done on vectors. Those at
    the ends of rows are not told right.
    """
    for i in range(seeds.size):
        beside = above[i] | above[i + 1] | above[i + 2] | here[i] | here[i + 2]
        beside |= below[i] | below[i + 1] | below[i + 2]
        seeds[i] = np.uint8((here[i + 1] == WEAK) & (beside > WEAK))


@lean_float
def drop_weak(marks: U8) -> None:
    """Leave the strong ones of marks alone."""
    for i in range(marks.size):
        marks[i] = marks[i] if marks[i] == STRONG else np.uint8(0)


@lean
def is_beside_strong(marks: U8, i: np.int64, per_width: float, height: int, width: int) -> bool:
    """Whether one of the eight neighbours of a pixel is marked as strong."""
    v, u = row_and_column(i, per_width, width)
    if 0 < u < width - 1 and 0 < v < height - 1:  # as most are: all at once, without a branch
        marked = marks[place(i - 1)] | marks[place(i + 1)]
        for j in (i - width, i + width):
            marked |= marks[place(j - 1)] | marks[place(j)] | marks[place(j + 1)]
        return bool(marked > WEAK)
    for row in range(max(v - 1, 0), min(v + 2, height)):
        for col in range(max(u - 1, 0), min(u + 2, width)):
            if marks[row * width + col] == STRONG:
                return True
    return False


@lean
def mark_seeds(marks: U8, seeds: U8) -> None:
    """Mark the weak pixels of an image that have a strong one among their eight neighbours."""
    height, width = marks.shape
    flat, out = marks.reshape(-1), seeds.reshape(-1)
    if height > 2:
        inner = (height - 2) * width - 2
        mark_seeds_within(flat, flat[width:], flat[2 * width :], out[width + 1 :][:inner])
    per_width = 1 / width
    for v in range(height):
        step = 1 if v in (0, height - 1) or width < 2 else width - 1
        for u in range(0, width, step):
            i = v * width + u
            out[i] = flat[i] == WEAK and is_beside_strong(flat, i, per_width, height, width)


@lean
def strengthen(marks: U8, k: np.int64, stack: I32, top: np.int64) -> np.int64:
    """Mark a pixel, where weak, as strong, and stack it; without a branch. Returns the top."""
    mark = marks[place(k)]
    marks[place(k)] = STRONG if mark == WEAK else mark
    stack[place(top)] = np.int32(k)  # overwritten, unless it counts
    return top + np.int64(mark == WEAK)


@lean
def strengthen_beside(
    marks: U8, i: np.int64, per_width: float, height: int, width: int, stack: I32, top: np.int64
) -> np.int64:
    """Mark a pixel and its neighbours, where weak, as strong, and stack them; returns the top."""
    v, u = row_and_column(i, per_width, width)
    if 0 < u < width - 1 and 0 < v < height - 1:
        for j in (i - width, i, i + width):
            for k in (j - 1, j, j + 1):
                top = strengthen(marks, np.int64(k), stack, top)
        return top
    for row in range(max(v - 1, 0), min(v + 2, height)):
        for col in range(max(u - 1, 0), min(u + 2, width)):
            top = strengthen(marks, np.int64(row * width + col), stack, top)
    return top


@compiled
def canny_edges(du: I16, dv: I16, low: np.int32, high: np.int32, marks: U8, room: I32) -> None:
    """Mark edges as ``cv2.Canny`` does by the gradients and thresholds given, to the bit.

    In less time, above all where there are many: that one asks pixel by pixel, and starts from
    each strong one; here all are thinned alike, and it starts from weak ones that have a strong one
    beside them, which are few. Gradients are those of an image of eleven bits at most: 8188 either
    way. ``marks`` becomes 255 on edges, else 0; ``room`` to work in is for two entries a pixel, and
    one more.
    """
    height, width = du.shape
    rows = np.zeros((3, width + 2), np.int16)
    sum_magnitudes(du[0], dv[0], rows[0])
    for v in range(height):
        below = rows[(v + 1) % 3]
        if v + 1 < height:
            sum_magnitudes(du[v + 1], dv[v + 1], below)
        else:
            below[:] = 0
        thin_row(du[v], dv[v], rows[(v + 2) % 3], rows[v % 3], below, low, high, marks[v])
    size = marks.size
    begin = size + size % 2  # where eight marks at once are aligned
    seeds = room[begin:].view(np.uint8)[:size].reshape(height, width)
    mark_seeds(marks, seeds)
    flat, seeds_flat = marks.reshape(-1), seeds.reshape(-1)
    words, hits = seeds_flat[: size // 8 * 8].view(np.uint64), room[begin + (size + 3) // 4 :]
    count = list_set(words, hits, room, seeds_flat)
    per_width = 1 / width
    for k in range(count):
        i = np.int64(room[k])
        if flat[place(i)] == WEAK:
            top = strengthen_beside(flat, i, per_width, height, width, room, np.int64(count))
            while top > count:
                top -= 1
                i = np.int64(room[top])
                top = strengthen_beside(flat, i, per_width, height, width, room, top)
    drop_weak(flat)


@compiled
def put_strong_first(
    index: I32,
    du: I16,
    dv: I16,
    low: np.int32,
    high: np.int32,
    marks: U8,
    room: I32,
    order: I32,
) -> int:
    """Write first those edges that Canny finds by higher thresholds, too; returns how many.

    ``index`` are the edges that it has just marked by lower ones; of the same gradients higher
    ones leave some of these, since what links them is among them as well. Marks are used up.
    """
    height, width = du.shape
    flat, du_flat, dv_flat = marks.reshape(-1), du.reshape(-1), dv.reshape(-1)
    for i in index:
        strength = np.abs(np.int32(du_flat[i])) + np.abs(np.int32(dv_flat[i]))
        flat[i] = STRONG if strength > high else WEAK if strength > low else 0
    per_width = 1 / width
    for each in index:
        i = np.int64(each)
        if flat[i] == WEAK and is_beside_strong(flat, i, per_width, height, width):
            top = strengthen_beside(flat, i, per_width, height, width, room, np.int64(0))
            while top > 0:
                top -= 1
                i = np.int64(room[top])
                top = strengthen_beside(flat, i, per_width, height, width, room, top)
    count = 0
    for i in index:
        if flat[i] == STRONG:
            order[count] = i
            count += 1
    last = count
    for i in index:
        if flat[i] != STRONG:
            order[last] = i
            last += 1
    return count


@compiled
def collect_edges(mask: U8, room: I32) -> np.int64:
    """Write the flat indices of the set pixels of a mask, in row order; returns how many.

    ``room`` is for two entries a pixel; they come first.
    """
    flat = mask.reshape(-1)
    words = flat[: flat.size // 8 * 8].view(np.uint64)
    return list_set(words, room[flat.size :], room, flat)


@lean_float
def take_logs(x: F32, bits: I32, exponents: F32) -> None:
    """Take the logarithms of positive normal numbers, to 3e-7 of each; ``bits`` is a view of them.

    That of the power of two, and that of what is left, between the roots of 1/2 and 2, by the
    series of artanh: on vectors, six times as fast as one by one by the library.
    """
    for i in range(x.size):
        exponent = np.int32(np.int32(bits[i] - ROOT_OF_HALF) >> np.int32(23))
        exponents[i] = np.float32(exponent)
        bits[i] = np.int32(bits[i] - np.int32(exponent << np.int32(23)))
    one, two = np.float32(1), np.float32(2)
    c3, c5, c7, c9 = np.float32(1 / 3), np.float32(1 / 5), np.float32(1 / 7), np.float32(1 / 9)
    for i in range(x.size):
        s = (x[i] - one) / (x[i] + one)
        q = s * s
        x[i] = exponents[i] * LOG_2 + two * s * (one + q * (c3 + q * (c5 + q * (c7 + q * c9))))


@lean_float
def find_vertices(before: F32, middle: F32, after: F32, skews: F32, bends: F32, ways: F32) -> None:
    """Where a Gaussian through three neighbours is highest, at most a step from the middle.

    A parabola through their logarithms, that is: exact for a step that a Gaussian has blurred. A
    whole step, since Canny takes the largest of three along a diagonal where an edge is oblique.
    Where one of the three is no gradient at all, a parabola through themselves. ``skews`` and
    ``bends`` are room to work in, for first and second differences.
    """
    zero, one, two = np.float32(0), np.float32(1), np.float32(2)
    for i in range(ways.size):
        b, m, a = before[i], middle[i], after[i]
        rises = (b > zero) & (m > zero) & (a > zero)
        skews[i] = b / a if rises else one
        bends[i] = (b / m) * (a / m) if rises else one
    take_logs(skews, skews.view(np.int32), ways)
    take_logs(bends, bends.view(np.int32), ways)
    for i in range(ways.size):
        b, m, a = before[i], middle[i], after[i]
        rises = (b > zero) & (m > zero) & (a > zero)
        skew = skews[i] if rises else b - a
        bend = bends[i] if rises else b - two * m + a
        way = skew / (two * bend) if bend < -FLAT else zero
        ways[i] = min(max(way, -one), one)


@lean_float
def write_profiles(
    before: F32,
    middle: F32,
    after: F32,
    skews: F32,
    bends: F32,
    ways: F32,
    logs: F32,
    room: F32,
    profiles: F32,
) -> None:
    """Write what edges look like across (N, 2): height and bend of the parabola of `find_vertices`.

    That is the logarithm of the gradient where it is highest, but for a constant, and its second
    difference, which is -1 / sigma^2 for a step that a Gaussian has blurred: light changes neither
    that, nor the difference of heights from edge to edge. (0, 0) where there is no Gaussian.
    """
    zero, half, one = np.float32(0), np.float32(0.5), np.float32(1)
    for i in range(logs.size):
        b, m, a = before[i], middle[i], after[i]
        logs[i] = m if (b > zero) & (m > zero) & (a > zero) else one
    take_logs(logs, logs.view(np.int32), room)
    for i in range(place(logs.size)):
        b, m, a = before[i], middle[i], after[i]
        rises = (b > zero) & (m > zero) & (a > zero)
        bend, way = bends[i], ways[i]
        # each is a gradient times the one in the middle, which itself is a square
        height = half * (logs[i] + way * (way * bend - skews[i]))
        profiles[i, 0], profiles[i, 1] = height if rises else zero, bend if rises else zero


@lean
def three(values: I16, i: np.int64, beside: int) -> np.int64:
    """Sum three values that lie side by side, so far apart."""
    return np.int64(values[place(i - beside)]) + values[place(i)] + values[place(i + beside)]


@compiled
def gather_gradients(index: I32, dx: I16, dy: I16, before: F32, middle: F32, after: F32) -> None:
    """Gradients in the direction of that of each edge, at the pixel before it, there, and after it.

    Along a row or a column, whichever lies nearer to the gradient, and of three pixels side by side
    the sum; 0 on the border of the image. There is room for the first few edges.
    """
    height, width = dx.shape
    per_width = 1 / width
    across, down = dx.ravel(), dy.ravel()
    for k in range(before.size):
        here = np.int64(index[k])
        v, u = row_and_column(here, per_width, width)
        before[k], middle[k], after[k] = 0.0, 0.0, 0.0
        if 0 < u < width - 1 and 0 < v < height - 1:
            gu, gv = np.int64(across[place(here)]), np.int64(down[place(here)])
            level = abs(gu) >= abs(gv)
            along, beside = (1, width) if level else (width, 1)
            i, j = here - along, here + along
            a = three(across, i, beside) * gu + three(down, i, beside) * gv
            b = three(across, here, beside) * gu + three(down, here, beside) * gv
            c = three(across, j, beside) * gu + three(down, j, beside) * gv
            before[k], middle[k], after[k] = a, b, c  # of whole grey levels exact, else to 6e-8


@lean_float
def place_edges(
    index: I32, dx: I16, dy: I16, width: int, ways: F32, pixels: F32, gradients: F32
) -> None:
    """Write N pixels (N, 2), each moved along a row or a column, and unit gradients (N, 2).

    ``ways`` (N,) is by how much, px; ``dx`` and ``dy`` (H W,) are those of the whole image.
    """
    per_width, one = 1 / width, np.float32(1)
    for k in range(place(index.size)):
        i = place(index[k])
        gu, gv, way = np.float32(dx[i]), np.float32(dy[i]), np.float64(ways[k])
        level = abs(gu) >= abs(gv)
        v, u = row_and_column(np.int64(index[k]), per_width, width)
        pixels[k, 0], pixels[k, 1] = u + (way if level else 0.0), v + (0.0 if level else way)
        norm = one / np.sqrt(gu * gu + gv * gv)
        gradients[k, 0], gradients[k, 1] = gu * norm, gv * norm


@lean_float
def gather_lens(
    index: I32, dx: I16, dy: I16, table: F32, width: int, height: int, room: F32
) -> None:
    """Write what a lens does to edges: ideal pixel, how it changes with u and v, and gradient.

    Eight lists, a ``BATCH`` apart in ``room``. ``table`` (2 H W,) is that of `describe_edges`, flat
    as are ``dx`` and ``dy`` (H W,).
    """
    per_width, one, half = 1 / width, np.float32(1), np.float32(0.5)
    for k in range(place(index.size)):
        i = place(index[k])
        v, u = row_and_column(np.int64(index[k]), per_width, width)
        left, right, over, under = u > 0, u < width - 1, v > 0, v < height - 1
        per_u, per_v = half if left & right else one, half if over & under else one
        here, row = i + i, place(width + width)
        before, after = here - place(left + left), here + place(right + right)
        above, below = here - (row if over else place(0)), here + (row if under else place(0))
        room[k], room[k + ROW_1] = table[here], table[here + place(1)]
        room[k + ROW_2] = (table[after] - table[before]) * per_u
        room[k + ROW_3] = (table[after + place(1)] - table[before + place(1)]) * per_u
        room[k + ROW_4] = (table[below] - table[above]) * per_v
        room[k + ROW_5] = (table[below + place(1)] - table[above + place(1)]) * per_v
        room[k + ROW_6], room[k + ROW_7] = np.float32(dx[i]), np.float32(dy[i])


@lean_float
def undo_lens(room: F32, ways: F32) -> None:
    """Put ideal pixel and unit gradient in place of the pixel and gradient of `gather_lens`.

    Edges are moved by ``ways`` first. Of one array at fixed distances: on vectors.
    """
    one = np.float32(1)
    for k in range(place(ways.size)):
        uu, vu, uv, vv = room[k + ROW_2], room[k + ROW_3], room[k + ROW_4], room[k + ROW_5]
        gu, gv, way = room[k + ROW_6], room[k + ROW_7], np.float64(ways[k])
        level = abs(gu) >= abs(gv)
        ou, ov = way if level else 0.0, 0.0 if level else way
        room[k] = room[k] + (uu * ou + uv * ov)
        room[k + ROW_1] = room[k + ROW_1] + (vu * ou + vv * ov)
        # a gradient is a covector: it goes over by the inverse transpose
        du, dv = vv * gu - vu * gv, uu * gv - uv * gu
        norm = one / np.sqrt(du * du + dv * dv)
        room[k + ROW_6], room[k + ROW_7] = du * norm, dv * norm


@lean_float
def pair_up(u: F32, v: F32, pairs: F32) -> None:
    """Write two lists side by side, into a flat array of pairs."""
    for k in range(place(pairs.size // 2)):
        pairs[place(k + k)], pairs[place(k + k) + place(1)] = u[k], v[k]


@compiled
def describe_edges(
    index: I32,
    dx: NDArray[np.int16],
    dy: NDArray[np.int16],
    table: F32,
    finely: bool,
    pixels: F32,
    gradients: F32,
    profiles: F32,
) -> None:
    """Write ideal pixel, unit gradient and profile of each edge given by its flat index.

    ``table`` (H, W, 2) holds the ideal pixel of each raw one, or is empty for an ideal camera.
    If asked to do so ``finely``, an edge is moved along a row or a column, whichever lies nearer
    to its gradient, to the vertex of the Gaussian through three gradients (after Devernay 1995).
    Only then has it a profile, and only if there is room for that.
    """
    height, width = dx.shape
    across, down, flat = dx.ravel(), dy.ravel(), table.ravel()
    most = min(index.size, BATCH)
    room, lens = np.zeros((8, most), np.float32), np.empty((8, BATCH), np.float32)
    for first in range(0, index.size, BATCH):
        last = min(first + BATCH, index.size)
        n, some = last - first, index[first:last]
        ways = room[5][:n]
        if finely:
            before, middle, after = room[0][:n], room[1][:n], room[2][:n]
            gather_gradients(some, dx, dy, before, middle, after)
            skews, bends = room[3][:n], room[4][:n]
            find_vertices(before, middle, after, skews, bends, ways)
            if profiles.size > 0:
                logs, exponents = room[6][:n], room[7][:n]
                to = profiles[first:last]
                write_profiles(before, middle, after, skews, bends, ways, logs, exponents, to)
        if table.size == 0:
            place_edges(some, across, down, width, ways, pixels[first:last], gradients[first:last])
        else:
            gather_lens(some, across, down, flat, width, height, lens.ravel())
            undo_lens(lens.ravel(), ways)
            pair_up(lens[0], lens[1], pixels[first:last].ravel())
            pair_up(lens[6], lens[7], gradients[first:last].ravel())


@lean
def toward(gu: float, gv: float) -> np.uint8:
    """Bits of the direction of a gradient, of ``DIRECTIONS``, and of those beside it."""
    k = direction_of(gu, gv)
    bits = 1 << k | 1 << (k + 1) % DIRECTIONS | 1 << (k + DIRECTIONS - 1) % DIRECTIONS
    return np.uint8(bits)


@lean
def spread_along(marks: U8, wide: U8) -> None:
    """Write the bits of a row of marks, and of those beside them."""
    last = marks.size - 1
    for u in range(last - 1):
        wide[u + 1] = marks[u] | marks[u + 1] | marks[u + 2]
    wide[0] = marks[0] | marks[min(1, last)]
    wide[last] = marks[last] | marks[max(last - 1, 0)]


@lean
def join_rows(above: U8, here: U8, below: U8, marks: U8) -> None:
    """Write the bits of three rows."""
    for u in range(marks.size):
        marks[u] = above[u] | here[u] | below[u]


@compiled
def spread_marks(marks: U8) -> None:
    """Give to each pixel the bits of its eight neighbours, too.

    On vectors: to write those of each mark to nine pixels takes longer as soon as marks are many.
    """
    height, width = marks.shape
    rows = np.zeros((3, width), np.uint8)
    spread_along(marks[0], rows[0])
    for v in range(height):
        below = rows[(v + 1) % 3]
        if v + 1 < height:
            spread_along(marks[v + 1], below)
        else:
            below[:] = 0
        join_rows(rows[(v + 2) % 3], rows[v % 3], below, marks[v])


@compiled
def mark_edges(index: I32, du: I16, dv: I16, table: F32, marks: U8) -> None:
    """Mark in an image the ideal pixels of edges in it, and those beside them, by `toward`."""
    height, width = marks.shape
    per_width = 1 / width
    marks[:] = 0
    for i in range(index.size):
        v, u = row_and_column(index[i], per_width, width)
        bits = toward(float(du[v, u]), float(dv[v, u]))
        x, y = u, v
        if table.size > 0:
            x, y = int(np.floor(table[v, u, 0] + 0.5)), int(np.floor(table[v, u, 1] + 0.5))
        if 0 <= x < width and 0 <= y < height:
            marks[y, x] |= bits
    spread_marks(marks)


@lean_float
def warped(u: float, v: float, z: float, camera: Pinhole, T: F64) -> tuple[np.float64, np.float64]:
    """Where T puts the point of a pixel of that depth, px; far outside if behind the camera."""
    x, y = (u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z
    pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if not pz >= MIN_DEPTH:
        return np.float64(-1e6), np.float64(-1e6)
    px = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / pz
    py = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / pz
    return camera.fx * px + camera.cx, camera.fy * py + camera.cy


@lean
def is_marked(marks: U8, u: float, v: float, bit: np.uint8) -> bool:
    """Whether an edge of that direction was found by `mark_edges` at a pixel, if that is inside."""
    height, width = marks.shape
    if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
        return False
    return marks[place(v + 0.5), place(u + 0.5)] & bit > 0


@compiled
def stay_in_place(
    pixels: F32,
    gradients: F32,
    depths: F32,
    camera: Pinhole,
    T: F64,
    marks: U8,
    least_px: float,
    stays: NDArray[np.bool_],
    moves: NDArray[np.bool_],
    sought: NDArray[np.bool_],
) -> None:
    """Say which samples lie where `mark_edges` has found one, and which ought to have moved on.

    That is by ``least_px`` along the gradient, by the motion T to the camera of the marks. Those
    that ought to, and were not seen where they ought to have come from, are ``sought``.
    """
    for i in range(depths.size):
        u, v = np.float64(pixels[i, 0]), np.float64(pixels[i, 1])
        gu, gv = np.float64(gradients[i, 0]), np.float64(gradients[i, 1])
        bit = np.uint8(1 << direction_of(gu, gv))  # the middle one of the three
        stays[i] = is_marked(marks, u, v, bit)
        there_u, there_v = warped(u, v, np.float64(depths[i]), camera, T)
        moves[i] = abs(gu * (there_u - u) + gv * (there_v - v)) >= least_px
        sought[i] = moves[i] and not is_marked(marks, there_u, there_v, bit)


@compiled
def count_stays(
    index: I32,
    du: I16,
    dv: I16,
    table: F32,
    depth: F32,
    camera: Pinhole,
    T: F64,
    marks: U8,
    least_px: float,
    room: U8,
    counts: U8,
    many: int,
) -> tuple[int, int, int]:
    """Count at which edges `mark_edges` has found one, and whether they ought to have moved on.

    ``counts`` (3, H, W), of raw pixels and of those beside them, are: of edges that have stayed
    though they ought not, nor were seen where they ought to have come from; of those that have not
    stayed; of all that have stayed. ``room`` (H, W) is to work in. Returns how many are of the
    first and were so ``many`` times, this one included; and of some that were less often before,
    how many are of the first, and how many are not. Those that have not stayed count where others
    have.
    """
    width = marks.shape[1]
    per_width = 1 / width
    found = by_chance = rest = 0
    room[:] = 0
    for i in range(index.size):
        v, u = row_and_column(index[i], per_width, width)
        cu, cv = np.float64(u), np.float64(v)
        if table.size > 0:
            cu, cv = np.float64(table[v, u, 0]), np.float64(table[v, u, 1])
        gu, gv, z = np.float64(du[v, u]), np.float64(dv[v, u]), np.float64(depth[v, u])
        square = gu * gu + gv * gv
        if square == 0:
            continue
        bit = np.uint8(1 << direction_of(gu, gv))
        stays, asked, before = is_marked(marks, cu, cv, bit), i % ASKED == 0, counts[0, v, u]
        if stays:
            room[v, u] |= IS_STAYING
        elif not asked and before == 0:
            continue
        if not z >= MIN_DEPTH:
            continue
        there_u, there_v = warped(cu, cv, z, camera, T)
        way = gu * (there_u - cu) + gv * (there_v - cv)
        if not way * way >= least_px * least_px * square:
            continue
        is_own = stays and not is_marked(marks, there_u, there_v, bit)
        if asked and before < many:
            by_chance += is_own
            rest += not is_own
        if is_own:
            room[v, u] |= IS_OWN
            found += before + 1 >= many
        elif not stays:
            room[v, u] |= HAS_MOVED
    spread_marks(room)
    for which in range(3):
        add_bits(room.reshape(-1), np.uint8(which), counts[which].reshape(-1))
    return found, by_chance, rest


@lean
def add_bits(marks: U8, bit: np.uint8, counts: U8) -> None:
    """Count that bit of each mark."""
    for i in range(marks.size):
        counts[i] += (marks[i] >> bit) & np.uint8(1)


@compiled
def back_project(
    pixels: F32, depths: F32, fx: float, fy: float, cx: float, cy: float, points: F64
) -> None:
    """Write the point at each pixel's depth, pi^-1 of Eq. (1), as exact as a float32 is."""
    wide, high = np.float32(fx), np.float32(fy)
    u0, v0 = np.float32(cx), np.float32(cy)
    for i in range(depths.size):
        points[i, 0] = (pixels[i, 0] - u0) / wide * depths[i]
        points[i, 1] = (pixels[i, 1] - v0) / high * depths[i]
        points[i, 2] = depths[i]


@compiled
def summarise_edges(
    pixels: F32, gradients: F32, width: int, height: int, rows: int, cols: int, shares: F64
) -> None:
    """Count edges by cell of the image and by direction, in ``shares``, ``LINE_DIRECTIONS`` a cell.

    Directions are those of lines, which light cannot turn round. The root of each share is
    written, so that the dot product of two is 1 for the same image and less for others.
    """
    shares[:] = 0
    for k in range(pixels.shape[0]):
        gu, gv = gradients[k, 0], gradients[k, 1]
        if gv < 0:
            gu, gv = -gu, -gv
        if gu > abs(gv) * TAN_22_5:
            bin_of = 0 if gv < gu * TAN_22_5 else 1
        elif -gu > abs(gv) * TAN_22_5:
            bin_of = 0 if gv < -gu * TAN_22_5 else 3
        else:
            bin_of = 2
        # an ideal pixel may lie outside the image
        row = min(max(int(pixels[k, 1] * rows / height), 0), rows - 1)
        col = min(max(int(pixels[k, 0] * cols / width), 0), cols - 1)
        shares[(row * cols + col) * LINE_DIRECTIONS + bin_of] += 1
    total = max(pixels.shape[0], 1)
    for i in range(shares.size):
        shares[i] = np.sqrt(shares[i] / total)


@lean_float
def plane_through(sums: Sums) -> tuple[float, float, float, float, float]:
    """Fit w = w0 + a u + b v by least squares: w0, a, b, the mean square of what is off it.

    That is infinite where pixels are too few or in line, and the rest means nothing then. Last
    comes the variance of w0, where each pixel has one of 1.
    """
    share = 1.0 / sums.n
    mu, mv, mw = share * sums.u, share * sums.v, share * sums.w
    cuu, cuv, cvv = share * sums.uu - mu * mu, share * sums.uv - mu * mv, share * sums.vv - mv * mv
    cuw, cvw, cww = share * sums.uw - mu * mw, share * sums.vw - mv * mw, share * sums.ww - mw * mw
    det = cuu * cvv - cuv * cuv
    per_det = 1.0 / det
    a, b = (cuw * cvv - cvw * cuv) * per_det, (cvw * cuu - cuw * cuv) * per_det
    spread = share * (1 + (mu * mu * cvv - 2 * mu * mv * cuv + mv * mv * cuu) * per_det)
    off = cww - a * cuw - b * cvw
    spans = det > 1e-6  # no branch: on vectors
    return mw - a * mu - b * mv, a, b, off if spans else np.inf, spread if spans else np.inf


@compiled
def room_for_window(radius: int) -> F32:
    """Make room for the depths that `depth_at` looks at, shape ((2 * radius + 1)^2,)."""
    return np.empty((2 * radius + 1) ** 2, np.float32)


@lean
def nearest_surface(depths: F32, n: np.uint64, ratio: np.float32, support: int) -> np.float32:
    """Nearest of the first n depths (m) that has ``support`` of them at up to ``ratio`` times it.

    0 where none has. No branch within: which of them are near is not foreseen.
    """
    nearest = np.float32(np.inf)
    for i in range(n):
        near = depths[i]
        bound, count = near * ratio, np.int32(0)
        for j in range(n):  # counted in 32 bits, as depths have: 64 take 1.4 times as long
            count = np.int32(count + np.int32((depths[j] >= near) & (depths[j] <= bound)))
        nearest = min(nearest, near if count >= support else np.float32(np.inf))
    return nearest if nearest < np.inf else np.float32(0)


@lean
def depth_at(depth: F32, u: int, v: int, radius: int, gap: float, window: F32) -> np.float32:
    """Depth (m) of an edge pixel from the window round it; 0 where the window holds none.

    Where the depths span no gap, their mean. Else the mean of the nearest surface: the nearest
    depths of which a fifth of the valid ones (three at the least) lie within the gap, which
    leaves out the stray pixels that sensors put between the two sides of a contour. ``window`` is
    room to work in, by `room_for_window`.
    """
    height, width = depth.shape
    u0, u1 = max(u - radius, 0), min(u + radius, width - 1)
    v0, v1 = max(v - radius, 0), min(v + radius, height - 1)
    near, far, total = np.float32(np.inf), np.float32(0), np.float32(0)
    n = place(0)
    for row in range(v0, v1 + 1):
        for col in range(u0, u1 + 1):
            z = depth[place(row), place(col)]
            window[n] = z
            near, far = min(near, z if z > 0 else np.float32(np.inf)), max(far, z)
            total += z
            n += place(z > 0)
    if n == 0:
        return np.float32(0)
    ratio = np.float32(1 + gap)
    if far > near * ratio:
        near = nearest_surface(window, n, ratio, max(3, (int(n) + 4) // 5))
        total, count = np.float32(0), place(0)
        for i in range(n):
            z = window[i]
            is_near = (z >= near) & (z <= near * ratio)
            total += z if is_near else np.float32(0)
            count += place(is_near)
        n = count
    return total / np.float32(n) if n > 0 else np.float32(0)


@compiled
def depths_at(depth: F32, index: I32, radius: int, gap: float, depths: F32) -> None:
    """Write the depth of each edge given by its flat index."""
    height, width = depth.shape
    per_width, ratio, flat = 1 / width, np.float32(1 + gap), depth.ravel()
    window = room_for_window(radius)
    zero, infinite = np.float32(0), np.float32(np.inf)
    side = 2 * radius + 1
    for i in range(index.size):
        v, u = row_and_column(np.int64(index[i]), per_width, width)
        near, far, total, count = infinite, zero, zero, 0
        if radius <= u < width - radius and radius <= v < height - radius:
            first = place(index[i] - radius * width - radius)
            for _ in range(side):  # without a branch, as most windows span no gap
                for col in range(place(side)):
                    z = flat[first + place(col)]
                    near, far = min(near, z if z > 0 else infinite), max(far, z)
                    total += z
                    count += int(z > 0)
                first += place(width)
        if count > 0 and far <= near * ratio:
            depths[i] = total / np.float32(count)
        else:
            depths[i] = depth_at(depth, u, v, radius, gap, window)


# --------------------------------------------------------------------------------------- planes


@lean_float
def set_plane(
    sums: Sums,
    cu: float,
    cv: float,
    off: float,
    camera: Pinhole,
    k: int,
    normals: F64,
    offsets: F64,
    centres: F64,
) -> None:
    """Fit a plane to the window round the ideal pixel (cu, cv), unless it is ``off`` by more.

    ``off`` (1/m) is a root mean square. The plane becomes the ``k``-th.
    """
    w, a, b, square, _ = plane_through(sums)
    if not (square <= off * off and w > 0):  # nor what is no number
        return
    # 1 / z = w + a (u - cu) + b (v - cv) with u = fx x / z + cx says N . X = 1
    nx, ny = a * camera.fx, b * camera.fy
    nz = w + a * (camera.cx - cu) + b * (camera.cy - cv)
    norm = np.sqrt(nx * nx + ny * ny + nz * nz)
    if norm <= 0:
        return
    offset, z = 1.0 / norm, 1.0 / w
    normals[k, 0], normals[k, 1], normals[k, 2] = nx * offset, ny * offset, nz * offset
    offsets[k] = offset
    centres[k, 0] = (cu - camera.cx) / camera.fx * z
    centres[k, 1] = (cv - camera.cy) / camera.fy * z
    centres[k, 2] = z


@compiled
def fit_planes(
    depth: F32,
    nodes: I32,
    sigma: F64,
    table: F32,
    camera: Pinhole,
    reach: int,
    stride: int,
    flatness: float,
    normals: F64,
    offsets: F64,
    centres: F64,
) -> None:
    """Fit a plane n . X = offset to the depth round each node, a raw pixel (u, v).

    On a plane 1 / z is linear in the ideal pixel, and there the noise of disparities does not
    depend on depth: so it is fitted by least squares, to every ``stride``-th pixel within
    ``reach``. Where a quarter of them has no depth, or they lie off the plane by more than
    ``flatness`` times the noise ``sigma`` (m, at each node), the offset is 0: no plane.
    ``centres`` are the points where the planes meet the rays of the nodes.
    """
    height, width = depth.shape
    for k in range(nodes.shape[0]):
        offsets[k] = 0.0
        u0, v0 = nodes[k, 0], nodes[k, 1]
        if not (0 <= u0 < width and 0 <= v0 < height) or depth[v0, u0] <= 0:
            continue
        cu, cv = np.float64(u0), np.float64(v0)
        if table.size > 0:
            cu, cv = np.float64(table[v0, u0, 0]), np.float64(table[v0, u0, 1])
        n, wanted = 0, 0
        su, sv, sw = 0.0, 0.0, 0.0
        suu, suv, svv, suw, svw, sww = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for v in range(v0 - reach, v0 + reach + 1, stride):
            for u in range(u0 - reach, u0 + reach + 1, stride):
                wanted += 1
                if not (0 <= u < width and 0 <= v < height) or depth[v, u] <= 0:
                    continue
                x, y = np.float64(u - u0), np.float64(v - v0)
                if table.size > 0:
                    x, y = table[v, u, 0] - cu, table[v, u, 1] - cv
                w = 1.0 / depth[v, u]
                n += 1
                su, sv, sw = su + x, sv + y, sw + w
                suu, suv, svv = suu + x * x, suv + x * y, svv + y * y
                suw, svw, sww = suw + x * w, svw + y * w, sww + w * w
        if 4 * n < 3 * wanted:
            continue
        off = flatness * sigma[k] / (np.float64(depth[v0, u0]) * depth[v0, u0])
        sums = Sums(float(n), su, sv, suu, suv, svv, sw, suw, svw, sww)
        set_plane(sums, cu, cv, off, camera, k, normals, offsets, centres)


@lean_float
def inverse_depths(line: F32, first: int, stride: int, w: F64) -> None:
    """Write 1 / z (1/m) of every ``stride``-th pixel of a row, 0 where there is none.

    That of pixel first + (q apart + p) stride to w[p, q], of ``w`` (apart, Q).
    """
    apart, count = w.shape[0], w.shape[1]
    for p in range(apart):
        start, step = first + p * stride, apart * stride
        begin = min(max((step - 1 - start) // step, 0), count)  # inside the image
        end = min(max((line.size - 1 - start) // step + 1, begin), count)
        row = w[p]
        for q in range(begin):
            row[q] = np.inf
        for q in range(end, count):
            row[q] = np.inf
        u = place(start + begin * step)
        for q in range(place(begin), place(end)):
            z = line[u]
            row[q] = z if z > 0 else np.inf
            u += place(step)
        for q in range(count):  # without a branch: on vectors
            row[q] = 1.0 / row[q]


@lean_float
def add_below(a: F64, b: F64, c: F64, v: F64, n: F64, sw: F64, svw: F64, sww: F64) -> None:
    """Add three rows of inverse depths w to sums of 1, w, v w and w w.

    ``v`` (3,) is how far each is from the middle, px; all else (N,), of one length. Three at once:
    sums are read and written a third as often.
    """
    va, vb, vc = v[0], v[1], v[2]
    for k in range(n.size):
        one, two, three = a[k], b[k], c[k]
        total = n[k] + (1.0 if one > 0 else 0.0)
        total += 1.0 if two > 0 else 0.0
        n[k] = total + (1.0 if three > 0 else 0.0)
        sw[k] = sw[k] + one + two + three
        svw[k] = svw[k] + va * one + vb * two + vc * three
        sww[k] = sww[k] + one * one + two * two + three * three


@lean_float
def add_across(n: F64, sw: F64, svw: F64, sww: F64, u: float, sums: F64) -> None:
    """Add columns of windows, at ``u`` from their middles, to ``sums`` of 1, w, u w, v w and w w.

    Of one column of each window: ``sums`` is (5, windows), the others (windows,).
    """
    for k in range(sums.shape[1]):
        sums[0, k] += n[k]
        sums[1, k] += sw[k]
        sums[2, k] += u * sw[k]
        sums[3, k] += svw[k]
        sums[4, k] += sww[k]


@lean_float
def planes_of_row(
    sums: F64,
    moments: Sums,
    first: int,
    step: int,
    cv: float,
    camera: Pinhole,
    fits: F64,
) -> None:
    """Fit planes to windows without a hole, as `plane_through` and `set_plane` do, on vectors.

    ``sums`` are as by `add_across`, ``moments`` those of pixels, the same for all of them. Windows
    are ``step`` px apart from ``first`` on, in the row ``cv``.
    Writes to ``fits`` (6, windows) the unit normal, the offset, the inverse depth in the middle,
    and the mean square of what is off the plane.
    """
    share = 1.0 / moments.n
    mu, mv = share * moments.u, share * moments.v
    cuu, cuv = share * moments.uu - mu * mu, share * moments.uv - mu * mv
    cvv = share * moments.vv - mv * mv
    per_det = 1.0 / (cuu * cvv - cuv * cuv)
    away = camera.cy - cv
    for k in range(sums.shape[1]):
        mw = share * sums[1, k]
        cuw, cvw = share * sums[2, k] - mu * mw, share * sums[3, k] - mv * mw
        cww = share * sums[4, k] - mw * mw
        a, b = (cuw * cvv - cvw * cuv) * per_det, (cvw * cuu - cuw * cuv) * per_det
        w = mw - a * mu - b * mv
        nx, ny = a * camera.fx, b * camera.fy
        nz = w + a * (camera.cx - float(first + k * step)) + b * away
        norm = np.sqrt(nx * nx + ny * ny + nz * nz)
        offset = 1.0 / norm
        fits[0, k], fits[1, k], fits[2, k] = nx * offset, ny * offset, nz * offset
        fits[3, k], fits[4, k] = offset, w
        fits[5, k] = cww - a * cuw - b * cvw


@compiled
def fit_planes_by_row(
    depth: F32,
    first: int,
    step: int,
    sigma: F64,
    camera: Pinhole,
    reach: int,
    stride: int,
    flatness: float,
    normals: F64,
    offsets: F64,
    centres: F64,
) -> None:
    """Fit planes as ``fit_planes`` does, to nodes ``step`` px apart from ``first`` on, row by row.

    Windows side by side share pixels and columns of sums, and those without a hole are fitted on
    vectors: a quarter of the time. For an ideal camera alone; ``step`` is a multiple of ``stride``.
    """
    height, width = depth.shape
    cols, rows = (width - first + step - 1) // step, (height - first + step - 1) // step
    if rows <= 0 or cols <= 0:
        return
    apart, side = step // stride, 2 * reach // stride + 1
    # the rows of one window at a time, each in the place of one no longer needed: new memory for
    # all of them costs more than they do
    lattice = np.zeros((side + 1, apart, cols + (side - 1) // apart))  # the last row stays 0
    below = np.empty((4, apart, lattice.shape[2]))
    flat, total = lattice.reshape(side + 1, -1), below.reshape(4, -1)
    down = np.empty(3)
    sums, fits = np.empty((5, cols)), np.empty((6, cols))
    filled = 0
    along, square = 0.0, 0.0  # the sums of u and u u over a row of a window
    for j in range(side):
        along += float(j * stride - reach)
        square += float(j * stride - reach) ** 2
    su, suu, suv = side * along, side * square, along * along
    whole = Sums(float(side * side), su, su, suu, suv, suu, 0.0, 0.0, 0.0, 0.0)
    for row in range(rows):
        for i in range(max(filled, row * apart), row * apart + side):
            v = first - reach + i * stride
            if 0 <= v < height:
                inverse_depths(depth[v], first - reach, stride, lattice[i % side])
            else:
                lattice[i % side] = 0.0
        filled = row * apart + side
        below[:] = 0.0
        for i in range(0, side, 3):
            for more in range(3):
                down[more] = float((i + more) * stride - reach)
            a = flat[(row * apart + i) % side]
            b = flat[(row * apart + i + 1) % side if i + 1 < side else side]
            c = flat[(row * apart + i + 2) % side if i + 2 < side else side]
            add_below(a, b, c, down, total[0], total[1], total[2], total[3])
        sums[:] = 0.0
        for j in range(side):
            p, q, u = j % apart, j // apart, float(j * stride - reach)
            add_across(
                below[0, p][q : q + cols],
                below[1, p][q : q + cols],
                below[2, p][q : q + cols],
                below[3, p][q : q + cols],
                u,
                sums,
            )
        v0 = first + row * step
        planes_of_row(sums, whole, first, step, float(v0), camera, fits)
        for col in range(cols):
            k, u0, n = row * cols + col, first + col * step, sums[0, col]
            offsets[k] = 0.0
            if depth[v0, u0] <= 0 or 4 * n < 3 * side * side:
                continue
            off = flatness * sigma[k] / (np.float64(depth[v0, u0]) * depth[v0, u0])
            if n < side * side or side == 1:
                su, sv, suu, suv, svv = 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(side):
                    line = lattice[(row * apart + i) % side]
                    for j in range(side):
                        if line[j % apart, col + j // apart] > 0:
                            x, y = float(j * stride - reach), float(i * stride - reach)
                            su, sv = su + x, sv + y
                            suu, suv, svv = suu + x * x, suv + x * y, svv + y * y
                sw, suw, svw, sww = sums[1, col], sums[2, col], sums[3, col], sums[4, col]
                some = Sums(n, su, sv, suu, suv, svv, sw, suw, svw, sww)
                set_plane(some, float(u0), float(v0), off, camera, k, normals, offsets, centres)
                continue
            w = fits[4, col]
            if fits[5, col] > off * off or w <= 0 or not fits[3, col] < np.inf:
                continue
            z = 1.0 / w
            normals[k, 0], normals[k, 1], normals[k, 2] = fits[0, col], fits[1, col], fits[2, col]
            offsets[k] = fits[3, col]
            centres[k, 0] = (float(u0) - camera.cx) / camera.fx * z
            centres[k, 1] = (float(v0) - camera.cy) / camera.fy * z
            centres[k, 2] = z


@compiled
def pack_points(offsets: F64, normals: F64, centres: F64, sigma: F64) -> int:
    """Move what belongs to planes to the front, in order; returns how many there are."""
    count = 0
    for k in range(offsets.size):
        if offsets[k] > 0:
            sigma[count] = sigma[k]
            for i in range(3):
                normals[count, i] = normals[k, i]
                centres[count, i] = centres[k, i]
            count += 1
    return count


@compiled
def new_plane_matches(m: int) -> PlaneMatches:
    """State of the planes of m points, none of them found."""
    return PlaneMatches(np.empty((3, m)), np.empty((3, m)), np.empty(m), np.empty(m, np.int32))


@lean_float
def warp_points(
    X: F64, first: np.uint64, stride: np.uint64, n: np.uint64, T: F64, Y: F64, at: np.uint64
) -> None:
    """Write n of the points X (M, 3), warped by T, into the columns of Y (3, M)."""
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    t20, t21, t22, t23 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    for lane in range(n):
        i = first + lane * stride
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        Y[0, at + lane] = t00 * x + t01 * y + t02 * z + t03
        Y[1, at + lane] = t10 * x + t11 * y + t12 * z + t13
        Y[2, at + lane] = t20 * x + t21 * y + t22 * z + t23


@lean_float
def cells_of_points(
    Y: F64, at: np.uint64, n: np.uint64, camera: Pinhole, planes: PlaneMap, cells: I32
) -> None:
    """Write into which cell of a plane map each of n columns of Y projects, -1 where in none."""
    inverse = 1 / planes.step
    fx, fy = camera.fx * inverse, camera.fy * inverse
    cx, cy = camera.cx * inverse + 0.5, camera.cy * inverse + 0.5
    wide, high, cols = float(planes.cols), float(planes.rows), np.int32(planes.cols)
    for lane in range(n):
        z = Y[2, at + lane]
        u, v = fx * Y[0, at + lane] / z + cx, fy * Y[1, at + lane] / z + cy
        inside = (z >= MIN_DEPTH) & (u >= 0) & (u < wide) & (v >= 0) & (v < high)
        cell = np.int32(v if inside else 0.0) * cols + np.int32(u if inside else 0.0)
        cells[lane] = cell if inside else np.int32(-1)


@lean_float
def keep_on_planes(
    planes: PlaneMap,
    points: PlanePoints,
    first: np.uint64,
    stride: np.uint64,
    n: np.uint64,
    T: F64,
    term: DepthTerm,
    cells: I32,
    matches: PlaneMatches,
    at: np.uint64,
) -> int:
    """Keep those of n points, warped into the columns from ``at`` on, that have a plane.

    They are packed to the front of these columns; returns how many.
    """
    t00, t01, t02 = T[0, 0], T[0, 1], T[0, 2]
    t10, t11, t12 = T[1, 0], T[1, 1], T[1, 2]
    t20, t21, t22 = T[2, 0], T[2, 1], T[2, 2]
    Y, normal = matches.Y, matches.normal
    kept = 0
    for lane in range(n):
        if cells[lane] < 0:
            continue
        k, i = place(cells[lane]), first + lane * stride
        offset = planes.offsets[k]
        if offset == 0:
            continue
        px, py, pz = Y[0, at + lane], Y[1, at + lane], Y[2, at + lane]
        nx, ny, nz = planes.normals[k, 0], planes.normals[k, 1], planes.normals[k, 2]
        mx, my, mz = points.normals[i, 0], points.normals[i, 1], points.normals[i, 2]
        dot = nx * (t00 * mx + t01 * my + t02 * mz)
        dot += ny * (t10 * mx + t11 * my + t12 * mz)
        dot += nz * (t20 * mx + t21 * my + t22 * mz)
        along = nx * px + ny * py + nz * pz
        scale = pz / (points.sigma[i] * max(abs(along), 0.1 * pz))
        r = (along - offset) * scale
        if dot < term.min_dot or abs(r) > term.limit:
            continue
        to = at + place(kept)
        Y[0, to], Y[1, to], Y[2, to] = px, py, pz
        normal[0, to], normal[1, to], normal[2, to] = nx * scale, ny * scale, nz * scale
        matches.residuals[to] = r
        matches.point[to] = np.int32(i)
        kept += 1
    return kept


@compiled
def match_planes(
    planes: PlaneMap,
    points: PlanePoints,
    camera: Pinhole,
    T: F64,
    term: DepthTerm,
    matches: PlaneMatches,
    stride: np.int64 = ALL,
) -> int:
    """Warp every ``stride``-th point by T, and take its distance to the plane it projects onto.

    A distance counts in units of the noise across the plane: that along the ray times the cosine
    between ray and normal, which a grazing view makes no better than a tenth. Returns how many
    points have a plane that is turned alike and near.
    """
    cells = np.empty(LANES, np.int32)
    count, first, step = 0, place(0), place(stride)
    left = place(len(range(0, points.sigma.size, stride)))
    while left > place(0):
        n, at = min(left, place(LANES)), place(count)
        warp_points(points.X, first, step, n, T, matches.Y, at)
        cells_of_points(matches.Y, at, n, camera, planes, cells)
        count += keep_on_planes(planes, points, first, step, n, T, term, cells, matches, at)
        first += n * step
        left -= n
    return count


@lean
def warp_columns(X: F64, n: np.uint64, T: F64, Y: F64) -> None:
    """Write the first n points of X (3, M), warped by T, into Y."""
    for axis in range(3):
        a, b, c, d = T[axis, 0], T[axis, 1], T[axis, 2], T[axis, 3]
        for i in range(n):
            Y[axis, i] = a * X[0, i] + b * X[1, i] + c * X[2, i] + d


@lean
def add_along(normal: F64, before: F64, after: F64, n: np.uint64, residuals: F64) -> None:
    """Add to n distances what a way along one axis makes of them."""
    for i in range(n):
        residuals[i] += normal[i] * (after[i] - before[i])


@compiled
def carry_points(matches: PlaneMatches, count: int, T: F64, carried: PlaneMatches) -> None:
    """Move the first ``count`` points by a small motion T (4, 4) of the reference camera's.

    They keep their planes: nothing that `match_planes` asks is asked again, and distances are in
    units of the noise where they were.
    """
    n = place(count)
    warp_columns(matches.Y, n, T, carried.Y)
    put(matches.residuals[:n], carried.residuals)
    for axis in range(3):
        normal = matches.normal[axis]
        put(normal[:n], carried.normal[axis])
        add_along(normal, matches.Y[axis], carried.Y[axis], n, carried.residuals)
    put(matches.point[:n], carried.point)


@lean
def shift_pixel(
    u: float, v: float, z: float, camera: Pinhole, T: F64
) -> tuple[float, float, float]:
    """How far a pixel moves, and how its depth changes, where its point is moved by T."""
    x, y = (u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z
    px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if pz < MIN_DEPTH:
        return 0.0, 0.0, 0.0
    return camera.fx * px / pz + camera.cx - u, camera.fy * py / pz + camera.cy - v, pz - z


@compiled
def shift_nodes(depth: F32, nodes: I32, table: F32, camera: Pinhole, T: F64, moved: I32) -> None:
    """Write where in a depth image the surface lies that is to be at each node after a motion.

    T maps points from after the motion to before it. Nodes are raw pixels, inside or not.
    """
    height, width = depth.shape
    for k in range(nodes.shape[0]):
        u0, v0 = nodes[k, 0], nodes[k, 1]
        moved[k, 0], moved[k, 1] = u0, v0
        if not (0 <= u0 < width and 0 <= v0 < height):
            continue
        z = np.float64(depth[v0, u0])
        cu, cv = np.float64(u0), np.float64(v0)
        if table.size > 0:
            cu, cv = np.float64(table[v0, u0, 0]), np.float64(table[v0, u0, 1])
        for _ in range(2):
            if z <= 0:
                break
            du, dv, dz = shift_pixel(cu, cv, z, camera, T)
            u, v = int(np.floor(u0 + du + 0.5)), int(np.floor(v0 + dv + 0.5))
            moved[k, 0], moved[k, 1] = u, v
            if not (0 <= u < width and 0 <= v < height):
                break
            z = np.float64(depth[v, u]) - dz if depth[v, u] > 0 else np.float64(0)


@compiled
def move_planes(T: F64, normals: F64, offsets: F64, centres: F64) -> None:
    """Move planes, and the points that they were fitted round, by T, in place."""
    for k in range(offsets.size):
        x, y, z = normals[k, 0], normals[k, 1], normals[k, 2]
        px, py, pz = centres[k, 0], centres[k, 1], centres[k, 2]
        along = 0.0
        for i in range(3):
            normals[k, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            centres[k, i] = T[i, 0] * px + T[i, 1] * py + T[i, 2] * pz + T[i, 3]
            along += normals[k, i] * T[i, 3]
        if offsets[k] > 0:
            offsets[k] += along


@compiled
def depth_equations(
    planes: PlaneMap,
    points: PlanePoints,
    camera: Pinhole,
    T: F64,
    term: DepthTerm,
    sigma: float,
    scale: float,
    H: F64,
    b: F64,
) -> None:
    """Match points with planes at T, and write ``scale`` times what they add to H and b."""
    near = new_plane_matches(points.sigma.size)
    count = match_planes(planes, points, camera, T, term, near)
    plane_equations(near, count, sigma, H, b)
    for i in range(6):
        b[i] *= scale
        for j in range(6):
            H[i, j] *= scale


# ------------------------------------------------------------------------------------- sampling


@lean
def next_random(state: NDArray[np.uint64]) -> np.uint64:
    """Splitmix64: one more number from a state of one word, which it advances."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@lean
def draw(pool: I32, first: np.int64, last: np.int64, state: NDArray[np.uint64]) -> int:
    """Move a random entry of pool[first:last] to its front and return it."""
    k = first + int(next_random(state) % np.uint64(last - first))
    pool[first], pool[k] = pool[k], pool[first]
    return pool[first]


@compiled
def delayed_depths(
    index: I32,
    which: I32,
    depth: F32,
    table: F32,
    camera: Pinhole,
    T_depth_cam: F64,
    radius: int,
    gap: float,
    depths: F32,
) -> None:
    """Overwrite the depths (m) of edges by those that a depth image of another instant shows.

    The depths given are those of the same image at the edges themselves, by `depth_at`. Looked up
    where the edge was at that instant, by the depth given, and once more by the one found. Where
    none is found the last one stays.
    """
    height, width = depth.shape
    window = room_for_window(radius)
    for k in range(which.size):
        v0 = index[which[k]] // width
        u0 = index[which[k]] - v0 * width
        cu, cv = np.float64(u0), np.float64(v0)
        if table.size > 0:
            cu, cv = np.float64(table[v0, u0, 0]), np.float64(table[v0, u0, 1])
        u, v, z = u0, v0, depths[k]
        for _ in range(2):
            before_u, before_v = u, v
            du, dv, dz = shift_pixel(cu, cv, np.float64(depths[k]), camera, T_depth_cam)
            u, v = int(np.floor(u0 + du + 0.5)), int(np.floor(v0 + dv + 0.5))
            if u != before_u or v != before_v:  # else the depth there is known
                if not (0 <= u < width and 0 <= v < height):
                    break
                z = depth_at(depth, u, v, radius, gap, window)
            if z == 0 or not z - dz > MIN_DEPTH:
                break
            depths[k] = z - dz


@lean_float
def add_line(sums: Sums, x: float, z: float, before: float, there: float, after: float) -> Sums:
    """Add the depths, less z, of three pixels at (x, -1), (x, 0) and (x, 1), if they have any.

    No branch, so that it runs on vectors.
    """
    one = 1.0 if before > 0 else 0.0
    two = 1.0 if there > 0 else 0.0
    three = 1.0 if after > 0 else 0.0
    a = before - z if before > 0 else 0.0
    b = there - z if there > 0 else 0.0
    c = after - z if after > 0 else 0.0
    n, v, w = one + two + three, three - one, a + b + c
    return Sums(
        sums.n + n,
        sums.u + n * x,
        sums.v + v,
        sums.uu + n * x * x,
        sums.uv + x * v,
        sums.vv + one + three,
        sums.w + w,
        sums.uw + x * w,
        sums.vw - a + c,
        sums.ww + a * a + b * b + c * c,
    )


@lean
def both(a: Sums, b: Sums) -> Sums:
    """Sums over two patches."""
    return Sums(
        a.n + b.n,
        a.u + b.u,
        a.v + b.v,
        a.uu + b.uu,
        a.uv + b.uv,
        a.vv + b.vv,
        a.w + b.w,
        a.uw + b.uw,
        a.vw + b.vw,
        a.ww + b.ww,
    )


@lean_float
def copy_patches(
    depth: F32, u: F64, v: F64, gu: F64, gv: F64, lines: F64, flat_index: I32, patches: F32
) -> None:
    """Copy the pixels to either side of edges at (u, v), those before it first, line by line.

    Lines lie along the edge, across its gradient (gu, gv). ``patches`` is (pixels, N or more); all
    of them are 0 where the image ends, or where there is no gradient. ``lines`` (4, N or more) and
    ``flat_index`` (N or more,) are room to work in: where pixels are is told on vectors.
    """
    height, width = depth.shape
    flat, n, reach = depth.reshape(-1), place(u.size), ACROSS + HALF_LENGTH
    cu, cv, across, down = lines[0], lines[1], lines[2], lines[3]
    for k in range(n):
        # where there is no gradient it is no number
        ok = (u[k] >= reach) & (u[k] < width - 1 - reach) & (v[k] >= reach)
        ok = ok & (v[k] < height - 1 - reach) & (gu[k] * gu[k] + gv[k] * gv[k] < 2)
        cu[k], cv[k] = u[k] if ok else 0.0, v[k] if ok else 0.0
        across[k], down[k] = gu[k] if ok else 0.0, gv[k] if ok else 0.0
    i = place(0)
    for x in range(-ACROSS, ACROSS + 1):
        for y in range(-HALF_LENGTH, HALF_LENGTH + 1):
            for k in range(n):
                row = np.int32(cv[k] + x * down[k] + 0.5 + y * across[k])
                col = np.int32(cu[k] + x * across[k] + 0.5 - y * down[k])
                flat_index[k] = np.int32(np.int32(row * np.int32(width)) + col)
            for k in range(n):
                patches[i, k] = flat[place(flat_index[k])]
            i += place(1)
    for k in range(n):
        if across[k] == 0 and down[k] == 0:
            for j in range(patches.shape[0]):
                patches[j, k] = 0


@lean_float
def depths_across(patches: F32, sigma: F64, z: F64, found: F64) -> None:
    """Write depths (m) of edges, by what lies to either side of each along its gradient.

    One plane through both sides, unless those end at the edge at other depths than it has there:
    where they meet, the surface bends, and their mean counts; else the nearer one owns the edge.
    One side alone counts where the other has too few pixels with depth. 0 where a side that has
    enough is not plane, or does not tell the depth at the edge to the noise of one pixel, unless
    one plane fits both. ``patches`` (pixels, N or more) are by `copy_patches`, ``sigma`` (m) is the
    noise there, ``z`` (N,) any depth nearby, m. No branch: on vectors.
    """
    # written out for three lines of three pixels to either side: ACROSS and HALF_LENGTH
    p, one_side = patches, ONE_SIDE * ONE_SIDE
    none = Sums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(place(z.size)):
        near = z[k]
        ahead = add_line(none, 1.0, near, p[12, k], p[13, k], p[14, k])
        ahead = add_line(ahead, 2.0, near, p[15, k], p[16, k], p[17, k])
        ahead = add_line(ahead, 3.0, near, p[18, k], p[19, k], p[20, k])
        behind = add_line(none, -3.0, near, p[0, k], p[1, k], p[2, k])
        behind = add_line(behind, -2.0, near, p[3, k], p[4, k], p[5, k])
        behind = add_line(behind, -1.0, near, p[6, k], p[7, k], p[8, k])
        here = add_line(none, 0.0, near, p[9, k], p[10, k], p[11, k])
        a, au, av, a_off, a_spread = plane_through(ahead)
        b, bu, bv, b_off, b_spread = plane_through(behind)
        every = both(both(ahead, behind), here)
        one, u1, v1, off, spread = plane_through(every)
        a_slope, b_slope, one_slope = au * au + av * av, bu * bu + bv * bv, u1 * u1 + v1 * v1
        noise, steep = sigma[k] * sigma[k], STEEP * STEEP * near * near
        a_noise, b_noise = noise + ROUNDING * a_slope, noise + ROUNDING * b_slope
        seen_a, seen_b = ahead.n >= LEAST_PIXELS, behind.n >= LEAST_PIXELS
        a_plane, b_plane = a_off < one_side * a_noise, b_off < one_side * b_noise
        has_a = a_plane & (a_slope < steep) & seen_a & (a_spread < 1)
        has_b = b_plane & (b_slope < steep) & seen_b & (b_spread < 1)
        is_one = (off < ONE_SURFACE * ONE_SURFACE * (noise + ROUNDING * one_slope)) & (spread < 1)
        is_one = is_one & (one_slope < steep) & (every.n >= LEAST_PIXELS)
        a_spread, b_spread = a_noise * a_spread, b_noise * b_spread
        share = b_spread / (a_spread + b_spread)
        mean = share * a + (1 - share) * b
        apart, bent = a - b, mean - one
        ends = apart * apart >= STEPPED * STEPPED * (a_spread + b_spread)
        fits = is_one & (bent * bent < BENT * BENT * share * a_spread)
        nearer = a if a < b else b
        level = one if fits else mean
        two = z[k] + (nearer if ends else level)
        single = z[k] + (one if is_one else (a if has_a else b))
        alone = is_one | (has_a & (not seen_b)) | (has_b & (not seen_a))
        other = single if alone else 0.0
        found[k] = two if has_a & has_b else other


@compiled
def fit_edge_depths(
    pixels: F32,
    gradients: F32,
    index: I32,
    depth: F32,
    table: F32,
    camera: Pinhole,
    T_depth_cam: F64,
    delayed: bool,
    radius: int,
    gap: float,
    sigma: F64,
    depths: F32,
) -> None:
    """Overwrite depths (m) of edges, known roughly, by `depths_across`, else by `depth_at`, else 0.

    ``pixels`` (N, 2) and ``gradients`` (N, 2), of unit length, are ideal, ``index`` (N,) tells
    their raw pixels, ``sigma`` (N,) is the noise of ``depths`` (N,), both in m. ``table`` is that
    of `describe_edges`. Where the depth image is of another instant (``delayed``), it is looked up
    where the edge was then, to which ``T_depth_cam`` takes its points, as `delayed_depths` does;
    where there is none the last one stays, which may be that of a stray pixel.
    """
    height, width = depth.shape
    per_width = 1 / width
    most = min(depths.size, PATCHES)
    patches = np.empty(((2 * ACROSS + 1) * (2 * HALF_LENGTH + 1), most), np.float32)
    # each apart: of rows of one array loops would not know that they do not overlap
    u, v, gu, gv = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    noise, near, found, known = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    asked, shifts = np.empty(most, np.int64), np.zeros((most, 3))
    lines, flat_index = np.empty((4, most)), np.empty(most, np.int32)
    window = room_for_window(radius)
    for first in range(0, depths.size, PATCHES):
        count = min(depths.size - first, PATCHES)
        for i in range(count):
            asked[i], known[i] = i, depths[first + i]
        for turn in range(2 if delayed else 1):
            asking = 0
            for j in range(count):
                i = asked[j]
                k = first + i
                v0, u0 = row_and_column(index[k], per_width, width)
                cu, cv = np.float64(pixels[k, 0]), np.float64(pixels[k, 1])
                u[asking], v[asking] = cu, cv
                if table.size > 0:
                    u[asking] = u0 + cu - table[v0, u0, 0]
                    v[asking] = v0 + cv - table[v0, u0, 1]
                du, dv, dz = 0.0, 0.0, 0.0
                if delayed:
                    du, dv, dz = shift_pixel(cu, cv, known[i], camera, T_depth_cam)
                    off_u, off_v = abs(du - shifts[i, 0]), abs(dv - shifts[i, 1])
                    if turn > 0 and off_u < 0.5 and off_v < 0.5:
                        continue
                shifts[i, 0], shifts[i, 1], shifts[i, 2] = du, dv, dz
                u[asking] += du
                v[asking] += dv
                gu[asking], gv[asking] = gradients[k, 0], gradients[k, 1]
                noise[asking], near[asking] = sigma[k], known[i] + dz
                asked[asking] = i
                asking += 1
            at_u, at_v = u[:asking], v[:asking]
            copy_patches(depth, at_u, at_v, gu, gv, lines, flat_index, patches)
            depths_across(patches, noise, near[:asking], found)
            count = 0
            for j in range(asking):
                i, z = asked[j], found[j]
                if z <= 0:
                    row, col = int(np.floor(v[j] + 0.5)), int(np.floor(u[j] + 0.5))
                    if not (0 <= col < width and 0 <= row < height):
                        continue
                    z = float(depth_at(depth, col, row, radius, gap, window))
                z_there = z - shifts[i, 2]
                if z <= 0 or not z_there > MIN_DEPTH:
                    known[i] = known[i] if delayed else 0.0
                    continue
                known[i] = z_there
                asked[count] = i
                count += 1
        for i in range(min(depths.size - first, PATCHES)):
            depths[first + i] = known[i]


@lean
def is_stray(depth: F32, u: int, v: int, z: float, ring: I32, gap: float) -> bool:
    """Whether depth z (m) at a pixel is a speck's: all round it lies behind.

    ``ring`` (N, 2) are steps to the pixels that are asked, ``gap`` the relative step between two
    surfaces. Where less than half of those inside the image have a depth, none says so. What is
    seen through a gap between nearer things is none: too far, it would do no harm.
    """
    height, width = depth.shape
    inside, seen, behind = 0, 0, (1 + gap) * z
    for i in range(ring.shape[0]):
        col, row = u + ring[i, 0], v + ring[i, 1]
        if 0 <= col < width and 0 <= row < height:
            inside += 1
            there = depth[row, col]
            if there > 0:
                if there <= behind:
                    return False
                seen += 1
    return 2 * seen >= max(inside, 1)


@compiled
def drop_strays(
    pixels: F32,
    index: I32,
    depth: F32,
    table: F32,
    camera: Pinhole,
    T_depth_cam: F64,
    delayed: bool,
    ring: I32,
    gap: float,
    depths: F32,
) -> None:
    """Write 0 for the depths (m) of edges that are stray, each looked up where it was taken from.

    Parameters are those of `fit_edge_depths` and `is_stray`.
    """
    width = depth.shape[1]
    per_width = 1 / width
    for i in range(depths.size):
        z = np.float64(depths[i])
        if z <= 0:
            continue
        v0, u0 = row_and_column(np.int64(index[i]), per_width, width)
        du, dv, dz = 0.0, 0.0, 0.0
        if delayed:
            u, v = np.float64(pixels[i, 0]), np.float64(pixels[i, 1])
            du, dv, dz = shift_pixel(u, v, z, camera, T_depth_cam)
        col, row = int(np.floor(u0 + du + 0.5)), int(np.floor(v0 + dv + 0.5))
        if is_stray(depth, col, row, z + dz, ring, gap):
            depths[i] = np.float32(0)


@compiled
def drop_far_nearer(depths: F32, share: float, times: float) -> None:
    """Write 0 for depths (m) nearer than one over ``times`` of what all but that share are away.

    The share is of those that are known, above 0, and at most so many are dropped.
    """
    known, count = np.empty(depths.size, np.float32), place(0)
    for i in range(place(depths.size)):
        known[count] = depths[i]  # overwritten, unless it counts
        count += place(depths[i] > 0)
    few = int(share * np.int64(count))
    if few == 0:
        return
    bar, so_many = smallest(known[:count], few), np.float32(times)
    for i in range(depths.size):
        depths[i] = np.float32(0) if so_many * depths[i] < bar else depths[i]


@lean
def rough_depth(
    depth: F32, u: int, v: int, radius: int, gap: float, roughly: bool, window: F32
) -> np.float32:
    """Depth (m) of an edge pixel, ``roughly`` its own if it has any; 0 where there is none."""
    z = depth[place(v), place(u)] if roughly else np.float32(0)
    return z if z > MIN_DEPTH else depth_at(depth, u, v, radius, gap, window)


@compiled
def sort_by_cell(index: I32, height: int, width: int, cell_px: int) -> tuple[I32, I32]:
    """Sort edges, which come in row order, by square cells of the image.

    Returns where each cell starts (cells + 1,), and the positions in ``index`` by cell (N,).
    """
    cols, rows = (width + cell_px - 1) // cell_px, (height + cell_px - 1) // cell_px
    n = index.size
    start = np.zeros(rows * cols + 1, np.int32)
    cell_of = np.empty(n, np.int32)
    col_of = np.empty(width, np.int32)
    for u in range(width):
        col_of[u] = u // cell_px
    v, row = 0, 0
    for i in range(n):
        while index[i] >= (v + 1) * width:
            v += 1
            row = (v // cell_px) * cols
        cell = place(row + col_of[place(index[i] - v * width)])
        cell_of[i] = cell
        start[cell + place(1)] += 1
    for c in range(rows * cols):
        start[c + 1] += start[c]
    pool = np.empty(n, np.int32)
    fill = start[:-1].copy()
    for i in range(n):
        cell = place(cell_of[i])
        pool[place(fill[cell])] = i
        fill[cell] += 1
    return start, pool


@lean
def list_drawn(found: F32, samples: I32, depths: F32) -> int:
    """Write which edges have a depth, in ascending order, and these depths; returns how many.

    There is room for one more, which takes what does not count: to ask edge by edge would cost
    branches that cannot be foretold.
    """
    filled = place(0)
    for i in range(place(found.size)):
        samples[filled] = np.int32(i)
        depths[filled] = found[i]
        filled += place(found[i] > 0)
    return int(filled)


@lean
def find_depths(
    drawn: I32,
    index: I32,
    depth: F32,
    radius: int,
    gap: float,
    roughly: bool,
    window: F32,
    found: F32,
) -> int:
    """Look up the depths of edges drawn; returns how many have any.

    One does not wait for the other: depths lie far apart in memory, and are fetched side by side.
    """
    per_width = 1 / depth.shape[1]
    count = 0
    for k in range(drawn.size):
        i = place(drawn[k])
        v, u = row_and_column(index[i], per_width, depth.shape[1])
        found[i] = rough_depth(depth, u, v, radius, gap, roughly, window)
        count += int(found[i] > 0)
    return count


@compiled
def draw_samples(
    index: I32,
    depth: F32,
    cell_px: int,
    per_cell: int,
    count: int,
    radius: int,
    gap: float,
    roughly: bool,
    seed: int,
    samples: I32,
    depths: F32,
) -> int:
    """Draw at most ``count`` edges with depth: some from each cell, then from all of them.

    Depth is looked up for the edges drawn and for no others, ``roughly`` at the pixel itself if
    that has any; an edge without depth is passed over.
    Writes positions in ``index`` in ascending order, and depths, where there is room for one more
    than ``count``; returns how many.
    """
    height, width = depth.shape
    n = index.size
    start, pool = sort_by_cell(index, height, width, cell_px)
    window = room_for_window(radius)
    state = np.empty(1, np.uint64)
    state[0] = np.uint64(seed)
    found = np.full(n, np.float32(-1))  # depth of what was drawn; 0 where it has none
    # cells come in random order, in case there are more of them than count allows
    cells = np.arange(start.size - 1).astype(np.int32)
    undrawn = start[:-1].copy()  # from where on a cell's edges are
    left = np.int64(count)
    rest = np.int64(0)
    for turn in range(cells.size):
        c = draw(cells, np.int64(turn), np.int64(cells.size), state)
        first, last = np.int64(start[c]), np.int64(start[c + 1])
        wanted = min(np.int64(per_cell), left)
        while first < last and wanted > 0:
            end = min(first + wanted, last)
            for k in range(first, end):
                draw(pool, np.int64(k), last, state)
            some = find_depths(pool[first:end], index, depth, radius, gap, roughly, window, found)
            first = end
            wanted -= some
            left -= some
        undrawn[c] = first
    for c in range(undrawn.size):  # what no cell has drawn moves to the front of the pool
        for k in range(place(undrawn[c]), place(start[c + 1])):
            pool[place(rest)] = pool[k]
            rest += 1
    first = np.int64(0)  # a plain 0 would have its own compiled variant
    while first < rest and left > 0:
        end = min(first + left, rest)
        for k in range(first, end):
            draw(pool, np.int64(k), rest, state)
        left -= find_depths(pool[first:end], index, depth, radius, gap, roughly, window, found)
        first = end
    return list_drawn(found, samples, depths)


@compiled
def draw_informative(
    index: I32,
    du: I16,
    dv: I16,
    depth: F32,
    camera: Pinhole,
    worth: F32,
    cell_px: int,
    tried: int,
    count: int,
    radius: int,
    gap: float,
    roughly: bool,
    seed: int,
    samples: I32,
    depths: F32,
) -> int:
    """Draw at most ``count`` edges with depth that tell most of the motion, one a cell in turn.

    Each cell shows so many of its edges as are ``tried``, at random, and gives the one that adds
    most to log det of the information on a small motion of the camera, as far as it is ``worth``
    (rows, cols, LINE_DIRECTIONS), by place and by direction of the line; then the next cell. Depth
    is looked up as by ``draw_samples``. Pixels are taken as they are, and gradients, none of which
    may be 0, are not freed of the lens: that is near enough to choose by.
    Writes positions in ``index`` in ascending order, and depths, where there is room for one more
    than ``count``; returns how many.
    """
    height, width = depth.shape
    per_width = 1 / width
    n = index.size
    start, pool = sort_by_cell(index, height, width, cell_px)
    window = room_for_window(radius)
    state = np.empty(1, np.uint64)
    state[0] = np.uint64(seed)
    found = np.zeros(n, np.float32)
    cells = np.empty(start.size - 1, np.int32)  # those that have edges left, in front
    live = np.int64(0)
    for c in range(start.size - 1):
        if start[c + 1] > start[c]:
            cells[live] = c
            live += 1
    first = start[:-1].copy()  # of the edges that a cell has left
    C = PRIOR * np.eye(6)  # the inverse of the information
    J, best_J, CJ = np.empty(6), np.empty(6), np.empty(6)
    left = count
    while left > 0 and live > 0:
        for turn in range(live):
            c = draw(cells, np.int64(turn), live, state)
            if left == 0:
                break
            gain, best, best_z, best_w = -1.0, np.int64(-1), np.float32(0), 0.0
            at, last = np.int64(first[c]), np.int64(start[c + 1])
            end = at + tried
            while at < min(end, last):
                i = draw(pool, at, last, state)
                v, u = row_and_column(index[i], per_width, width)
                z = rough_depth(depth, u, v, radius, gap, roughly, window)
                if not z > 0:  # it is not asked again; what stood in front takes its place
                    pool[at], pool[first[c]] = pool[first[c]], pool[at]
                    best = at if best == first[c] else best
                    first[c] += 1
                    at, end = at + 1, end + 1
                    continue
                gu, gv, pz = np.float64(du[v, u]), np.float64(dv[v, u]), np.float64(z)
                per_norm = 1 / np.sqrt(gu * gu + gv * gv)
                px, py = (u - camera.cx) / camera.fx * pz, (v - camera.cy) / camera.fy * pz
                au, av = gu * per_norm * camera.fx / pz, gv * per_norm * camera.fy / pz
                write_row(au, av, -(au * px + av * py) / pz, px, py, pz, J)
                line = direction_of(gu, gv) % LINE_DIRECTIONS
                row, col = v * worth.shape[0] // height, u * worth.shape[1] // width
                w = np.float64(worth[row, col, line])
                adds = w * product_in(C, J, J)
                if best < 0 or adds > gain:
                    gain, best, best_z, best_w = adds, at, z, w
                    put(J, best_J)
                at += 1
            if best < 0:
                continue
            pool[best], pool[first[c]] = pool[first[c]], pool[best]
            found[pool[first[c]]] = best_z
            first[c] += 1
            left -= 1
            if not 0 < gain < np.inf:  # of a depth that is no depth nothing is learned
                continue
            for m in range(6):  # (C^-1 + w J J^T)^-1
                CJ[m] = 0.0
                for k in range(6):
                    CJ[m] += C[m, k] * best_J[k]
            for m in range(6):
                for k in range(6):
                    C[m, k] -= best_w / (1 + gain) * CJ[m] * CJ[k]
        still = np.int64(0)
        for turn in range(live):
            if first[cells[turn]] < start[cells[turn] + 1]:
                cells[still] = cells[turn]
                still += 1
        live = still
    return list_drawn(found, samples, depths)


# ------------------------------------------------------------------------------------- matching


@compiled
def build_grid(pixels: F32, gradients: F32, cell: float) -> Grid:
    """Sort edges by cell (a counting sort), so that a row of cells is one run of memory."""
    n = pixels.shape[0]
    left, top = np.float32(np.inf), np.float32(np.inf)
    right, bottom = np.float32(-np.inf), np.float32(-np.inf)
    for i in range(n):
        left, right = min(left, pixels[i, 0]), max(right, pixels[i, 0])
        top, bottom = min(top, pixels[i, 1]), max(bottom, pixels[i, 1])
    if n == 0:
        left, right, top, bottom = (np.float32(0), np.float32(0), np.float32(0), np.float32(0))
    inverse = 1 / cell
    cols = int((right - left) * inverse) + 1
    rows = int((bottom - top) * inverse) + 1
    start = np.zeros(rows * cols + 1, np.int32)
    cell_of = np.empty(n, np.int32)
    for i in range(n):
        col, row = int((pixels[i, 0] - left) * inverse), int((pixels[i, 1] - top) * inverse)
        in_cell = place(row * cols + col)
        cell_of[i] = in_cell
        start[in_cell + place(1)] += 1
    for c in range(rows * cols):
        start[c + 1] += start[c]
    fill = start[:-1].copy()
    points = np.empty((n, 4), np.float32)
    order = np.empty(n, np.int32)
    for i in range(n):
        in_cell = place(cell_of[i])
        k = place(fill[in_cell])
        fill[in_cell] += 1
        order[k] = i
        points[k, 0], points[k, 1] = pixels[i, 0], pixels[i, 1]
        points[k, 2], points[k, 3] = gradients[i, 0], gradients[i, 1]
    return Grid(points, order, start, rows, cols, float(left), float(top), 1 / cell)


@lean
def match_cost(
    points: F32, i: int, u: float, v: float, gu: float, gv: float, criterion: Criterion
) -> float:
    """Cost (px^2) of one pair by Eq. (6); infinite where it may be no match."""
    du, dv = points[i, 0] - u, points[i, 1] - v
    distance = du * du + dv * dv
    dot = points[i, 2] * gu + points[i, 3] * gv
    if distance > criterion.limit or dot < criterion.min_dot:
        return np.inf
    away = dot - 1.0
    return distance + criterion.direction * away * away


@lean
def cost_in(key: np.int64) -> np.float32:
    """The cost (px^2) that a key of `scan_window` begins with."""
    return np.int32(key >> KEY_BITS).view(np.float32)


@lean
def scan_window(
    grid: Grid, u: float, v: float, gu: float, gv: float, criterion: Criterion, reach: float
) -> tuple[int, float, float]:
    """Best match among the edges within ``reach`` pixels, its cost, and the second best cost.

    The second best is at most reach^2, so that it bounds the edges outside the window too.
    """
    wide = reach + SLACK
    # towards 0 instead of down: a window that ends before the first cell may look into it, in vain
    last_row = min(int((v + wide - grid.top) * grid.inverse), grid.rows - 1)
    last_col = min(int((u + wide - grid.left) * grid.inverse), grid.cols - 1)
    first_row = max(int((v - wide - grid.top) * grid.inverse), 0)
    first_col = max(int((u - wide - grid.left) * grid.inverse), 0)
    if last_col < first_col:
        return NO_MATCH, np.inf, reach * reach
    f32 = np.float32
    uf, vf, guf, gvf = f32(u), f32(v), f32(gu), f32(gv)
    square = f32(reach * reach)
    direction, min_dot, one = f32(criterion.direction), f32(criterion.min_dot), f32(1)
    points = grid.points
    # A cost is compared by its bits, which ascend with it; below them is whose it is. So the loop
    # has no branch: what a processor does not foresee costs more than all that is reckoned here.
    best, second = NOTHING, NOTHING
    for row in range(first_row, last_row + 1):
        base = row * grid.cols
        begin, end = grid.start[base + first_col], grid.start[base + last_col + 1]
        for i in range(place(begin), place(end)):
            du, dv = points[i, 0] - uf, points[i, 1] - vf
            distance = du * du + dv * dv
            dot = points[i, 2] * guf + points[i, 3] * gvf
            cost = distance + direction * (dot - one) * (dot - one)
            bits = np.int64(f32(cost).view(np.int32))
            key = bits << KEY_BITS | np.int64(i)
            key = key if (distance <= square) & (dot >= min_dot) else NOTHING
            second = min(second, max(best, key))
            best = min(best, key)
    if best == NOTHING:
        return NO_MATCH, np.inf, float(square)
    other = min(cost_in(second), square) if second < NOTHING else square
    return int(best & KEY_INDEX), float(cost_in(best)), float(other)


@lean
def nearest_in_grid(
    grid: Grid,
    u: float,
    v: float,
    gu: float,
    gv: float,
    criterion: Criterion,
    hint: int,
    reach: float,
) -> tuple[int, float, float]:
    """Sorted index and cost of the reference edge that minimizes Eq. (6), exactly.

    Since cost >= distance^2, a window as wide as the root of the best cost holds the answer.
    ``hint`` is a sorted index that tells how wide (the last match), or NO_MATCH: then, and where
    that may be no match any more, a window of ``reach`` pixels comes first. Third comes a bound: no
    other admissible edge has a lower cost.
    """
    limit = np.sqrt(criterion.limit)
    reach = min(reach, limit)
    if hint >= 0:
        cost = match_cost(grid.points, hint, u, v, gu, gv, criterion)
        if cost < np.inf:
            reach = min(np.sqrt(cost) + MARGIN, limit)
    while True:
        i, best, second = scan_window(grid, u, v, gu, gv, criterion, reach)
        if i < 0:
            all_of_it = (grid.cols + grid.rows) / grid.inverse
            all_of_it += abs(u - grid.left) + abs(v - grid.top)
            if reach >= min(limit, all_of_it):
                return NO_MATCH, np.inf, second
            reach = min(reach * 3, limit)
        else:
            needed = min(np.sqrt(best), limit)
            if needed <= reach:
                return i, best, second
            reach = min(needed + MARGIN, limit)


@lean
def with_latest(needed: float, cost: float) -> float:
    """What searches need on average (px), once one has ended at that cost (px^2)."""
    return needed + LATEST * (min(np.sqrt(cost), FARTHEST) - needed)


@lean
def direction_of(gu: float, gv: float) -> int:
    """Sort a gradient into one of ``DIRECTIONS``, the first from 0 to 45 degrees: no branch."""
    back = (gv < 0) | ((gv == 0) & (gu < 0))
    a, b = -gu if back else gu, -gv if back else gv
    left = a <= 0
    along, across = b if left else a, -a if left else b
    return 4 * int(back) + 2 * int(left) + int(across >= along)


@lean
def nearer_beside(row: U32, beside: U32) -> None:
    """Take for a row of keys, but for its ends, what the row beside it knows to be nearer."""
    one, end = np.uint64(DIRECTIONS), np.uint64(row.size - DIRECTIONS)
    for j in range(one, end):
        far = min(beside[j - one], beside[j + one]) + CORNER
        row[j] = min(row[j], min(beside[j] + NEXT, far))


@lean
def nearer_before(row: U32) -> None:
    """Take for the keys of a row, but for its ends, what the cell before knows to be nearer."""
    one, end = np.uint64(DIRECTIONS), np.uint64(row.size - DIRECTIONS)
    for j in range(one, end):
        row[j] = min(row[j], row[j - one] + NEXT)


@lean
def nearer_behind(row: U32) -> None:
    """Take for the keys of a row, but for its ends, what the next cell knows to be nearer."""
    one = np.uint64(DIRECTIONS)
    for cell in range(row.size // DIRECTIONS - 2, 0, -1):
        for k in range(DIRECTIONS):
            j = np.uint64(cell * DIRECTIONS + k)
            row[j] = min(row[j], row[j + one] + NEXT)


@compiled
def build_near_map(grid: Grid, cell: float) -> NearMap:
    """Find an edge near the middle of each cell, for each direction, as `chamfer_scores` does.

    An edge counts for its own direction and for those beside it. Ways go from middle to middle.
    """
    inverse = 1 / cell
    rows = int(grid.rows / grid.inverse * inverse) + 3
    cols = int(grid.cols / grid.inverse * inverse) + 3
    keys = np.full((rows, cols, DIRECTIONS), NOWHERE, np.uint32)
    for i in range(min(grid.points.shape[0], 1 << EDGE_BITS)):
        x, y = grid.points[i, 0] - grid.left, grid.points[i, 1] - grid.top
        col, row = int(x * inverse), int(y * inverse)
        right, below = x * inverse - col - 0.5, y * inverse - row - 0.5
        way = int(4 * np.sqrt(right * right + below * below))
        key = np.uint32(way << EDGE_BITS | i)
        direction = direction_of(grid.points[i, 2], grid.points[i, 3])
        for beside in range(direction - 1, direction + 2):
            k = beside % DIRECTIONS
            keys[row + 1, col + 1, k] = min(keys[row + 1, col + 1, k], key)
    lanes = keys.reshape(rows, cols * DIRECTIONS)  # a vector holds all directions of a cell
    for row in range(1, rows - 1):
        nearer_beside(lanes[row], lanes[row - 1])
        nearer_before(lanes[row])
    for row in range(rows - 2, 0, -1):
        nearer_beside(lanes[row], lanes[row + 1])
        nearer_behind(lanes[row])
    return NearMap(keys.ravel(), rows, cols, grid.left, grid.top, inverse)


@lean
def near_edge(nearby: NearMap, u: float, v: float, gu: float, gv: float) -> np.int64:
    """Sorted index of an edge near a pixel that is turned alike, or NO_MATCH."""
    col = min(max(int((u - nearby.left) * nearby.inverse), 0), nearby.cols - 3) + 1
    row = min(max(int((v - nearby.top) * nearby.inverse), 0), nearby.rows - 3) + 1
    key = nearby.keys[(row * nearby.cols + col) * DIRECTIONS + direction_of(gu, gv)]
    edge = np.int64(key & np.uint32((1 << EDGE_BITS) - 1))  # signed, or numba makes it a float
    return edge if key < NOWHERE else np.int64(NO_MATCH)


@compiled
def match_in_grid(
    grid: Grid, pixels: F32, gradients: F32, criterion: Criterion, matches: I32, costs: F64
) -> None:
    """Match each query pixel; writes indices among the edges given to the grid, and costs."""
    needed = NEEDED_AT_FIRST
    for k in range(pixels.shape[0]):
        i, cost, _ = nearest_in_grid(
            grid,
            pixels[k, 0],
            pixels[k, 1],
            gradients[k, 0],
            gradients[k, 1],
            criterion,
            NO_MATCH,
            REACH * needed + MARGIN,
        )
        needed = with_latest(needed, cost)
        matches[k] = grid.order[i] if i >= 0 else NO_MATCH
        costs[k] = cost


@compiled
def build_tree(pixels: F32, gradients: F32, weight: float) -> Tree:
    """A balanced k-d tree over four dimensions, split at the median of the widest axis.

    ``weight`` (px) makes a gradient axis comparable to a pixel axis when the widest is chosen;
    it is only a matter of speed.
    """
    n = pixels.shape[0]
    points = np.empty((n, 4), np.float32)
    order = np.arange(n).astype(np.int32)
    axis = np.zeros(n, np.int8)
    for i in range(n):
        points[i, 0], points[i, 1] = pixels[i, 0], pixels[i, 1]
        points[i, 2], points[i, 3] = gradients[i, 0], gradients[i, 1]
    firsts, lasts = np.empty(64, np.int64), np.empty(64, np.int64)
    firsts[0], lasts[0] = 0, n
    depth = 1
    low, high = np.empty(4, np.float32), np.empty(4, np.float32)
    while depth > 0:
        depth -= 1
        first, last = firsts[depth], lasts[depth]
        if last - first < 2:
            continue
        for a in range(4):
            low[a] = high[a] = points[first, a]
        for i in range(first + 1, last):
            for a in range(4):
                low[a] = min(low[a], points[i, a])
                high[a] = max(high[a], points[i, a])
        split, widest = 0, -1.0
        for a in range(4):
            spread = (high[a] - low[a]) * (1.0 if a < 2 else weight)
            if spread > widest:
                split, widest = a, spread
        middle = (first + last) // 2
        left, right = first, last - 1
        while left < right:  # quickselect
            pivot = points[(left + right) // 2, split]
            i, j = left, right
            while i <= j:
                while points[i, split] < pivot:
                    i += 1
                while points[j, split] > pivot:
                    j -= 1
                if i <= j:
                    for a in range(4):
                        points[i, a], points[j, a] = points[j, a], points[i, a]
                    order[i], order[j] = order[j], order[i]
                    i += 1
                    j -= 1
            if middle <= j:
                right = j
            elif middle >= i:
                left = i
            else:
                break
        axis[middle] = split
        firsts[depth], lasts[depth] = first, middle
        firsts[depth + 1], lasts[depth + 1] = middle + 1, last
        depth += 2
    return Tree(points, order, axis)


@compiled
def nearest_in_tree(
    tree: Tree, u: float, v: float, gu: float, gv: float, criterion: Criterion
) -> tuple[int, float]:
    """Sorted index and cost of the reference edge that minimizes Eq. (6), exactly.

    For unit gradients (g.g' - 1)^2 = |g - g'|^4 / 4, so a box at offset (ou, ov, ogu, ogv) from
    the query holds no cost below ou^2 + ov^2 + (direction / 4) (ogu^2 + ogv^2)^2: that bound
    prunes, since a Euclidean one over four dimensions would not be exact.
    """
    points, axes = tree.points, tree.axis
    best_i, best = NO_MATCH, np.inf
    query = (u, v, gu, gv)
    # a stack of subtrees with the offset of their boxes from the query
    firsts, lasts = np.empty(64, np.int64), np.empty(64, np.int64)
    offsets = np.zeros((64, 4), np.float64)
    firsts[0], lasts[0] = 0, points.shape[0]
    depth = 1
    while depth > 0:
        depth -= 1
        first, last = firsts[depth], lasts[depth]
        o0, o1, o2, o3 = offsets[depth]
        while first < last:
            near = o0 * o0 + o1 * o1
            turn = o2 * o2 + o3 * o3
            # unit gradients are so only to float32: a hair of slack keeps the bound below
            bound = near + criterion.direction / 4 * max(0.0, turn - 1e-6) ** 2
            if bound >= best or near > criterion.limit:
                break
            node = (first + last) // 2
            cost = match_cost(points, node, u, v, gu, gv, criterion)
            if cost < best:
                best_i, best = node, cost
            a = axes[node]
            off = query[a] - points[node, a]
            offsets[depth, 0], offsets[depth, 1] = o0, o1
            offsets[depth, 2], offsets[depth, 3] = o2, o3
            offsets[depth, a] = off
            if off < 0:
                firsts[depth], lasts[depth] = node + 1, last
                last = node
            else:
                firsts[depth], lasts[depth] = first, node
                first = node + 1
            depth += 1
    return best_i, best


@compiled
def match_in_tree(
    tree: Tree, pixels: F32, gradients: F32, criterion: Criterion, matches: I32, costs: F64
) -> None:
    """Match each query pixel; writes indices among the edges given to the tree, and costs."""
    for k in range(pixels.shape[0]):
        i, cost = nearest_in_tree(
            tree, pixels[k, 0], pixels[k, 1], gradients[k, 0], gradients[k, 1], criterion
        )
        matches[k] = tree.order[i] if i >= 0 else NO_MATCH
        costs[k] = cost


# --------------------------------------------------------------------------------- robust scale


@compiled
def student_scale(residuals: F64, count: int, nu: float, sigma: float, min_sigma: float) -> float:
    """Scale of a t-distribution by fixed-point iteration (Kerl 2013, Eq. 15)."""
    for _ in range(50):
        inverse = 1.0 / (sigma * sigma)
        total = 0.0
        for i in range(count):
            square = residuals[i] * residuals[i]
            total += square * (nu + 1) / (nu + square * inverse)
        new = max(np.sqrt(total / count), min_sigma)
        if abs(new - sigma) < 1e-3 * sigma:
            return new
        sigma = new
    return sigma


@compiled
def median_scale(residuals: F64, count: int, min_sigma: float) -> float:
    """Scale by the median absolute residual, consistent with a Gaussian.

    A histogram tells which few of them have to be parted for it. Its bins are shares of octaves:
    what a single precision number has for leading bits, which keep the order.
    """
    if count == 0:
        return min_sigma
    leading = np.empty(count, np.float32)
    bins, sizes = np.empty(count, np.int32), np.zeros(SCALE_BINS, np.int32)
    for i in range(place(count)):
        leading[i] = abs(residuals[i])
    bits = leading.view(np.int32)
    for i in range(place(count)):
        step = (bits[i] >> SCALE_SHIFT) - LEAST_STEP
        bins[i] = min(max(step, np.int32(0)), np.int32(SCALE_BINS - 1))
    for i in range(place(count)):
        sizes[place(bins[i])] += np.int32(1)
    half = count // 2
    middle, below = 0, 0  # the bin of the upper median, and how many lie in those below it
    while below + sizes[middle] <= half:
        below += sizes[middle]
        middle += 1
    among, kept, lower = np.empty(sizes[middle]), 0, 0.0
    for i in range(place(count)):
        if bins[i] == middle:
            among[kept] = abs(residuals[i])
            kept += 1
    median = select(among, half - below)
    if count % 2 == 0:
        if half > below:
            lower = greatest(among[: half - below])
        else:
            for i in range(place(count)):
                if bins[i] < middle:
                    lower = max(lower, abs(residuals[i]))
        median = 0.5 * (lower + median)
    return max(1.4826 * median, min_sigma)


@lean
def robust_weight(square: float, weight: int, tuning: float) -> float:
    """Weight of a residual whose square, in units of the scale, is given (Zhang 1997)."""
    if weight == STUDENT_T:
        return (tuning + 1) / (tuning + square)
    if weight == HUBER:
        return 1.0 if square <= tuning * tuning else tuning / np.sqrt(square)
    if weight == CAUCHY:
        return 1 / (1 + square / (tuning * tuning))
    if weight == TUKEY:
        inside = 1 - square / (tuning * tuning)
        return inside * inside if inside > 0 else 0.0
    return 1.0


@lean
def robust_cost(square: float, weight: int, tuning: float) -> float:
    """Loss rho whose derivative over the residual is weight x residual."""
    if weight == STUDENT_T:
        return 0.5 * (tuning + 1) * np.log1p(square / tuning)
    if weight == HUBER:
        if square <= tuning * tuning:
            return 0.5 * square
        return tuning * (np.sqrt(square) - 0.5 * tuning)
    if weight == CAUCHY:
        return 0.5 * tuning * tuning * np.log1p(square / (tuning * tuning))
    if weight == TUKEY:
        inside = max(0.0, 1 - square / (tuning * tuning))
        return tuning * tuning / 6 * (1 - inside * inside * inside)
    return 0.5 * square


@lean
def add_losses(residuals: F64, first: np.uint64, n: np.uint64, inverse: float, sums: F64) -> None:
    """Add of n residuals how far Tukey's losses are from the greatest, as a share of that."""
    for lane in range(n):
        r = residuals[first + lane]
        inside = max(1 - r * r * inverse, 0.0)
        sums[lane] += inside * inside * inside


@compiled
def sum_losses(residuals: F64, count: int, inverse: float, tuning: float) -> float:
    """Sum of Tukey's losses of residuals whose squares are in units of 1 / ``inverse``."""
    sums = np.zeros(LANES)
    for first in range(place(0), place(count), place(LANES)):
        n = min(place(count) - first, place(LANES))
        add_losses(residuals, place(first), n, inverse / (tuning * tuning), sums)
    return tuning * tuning / 6 * (count - sum_lanes(sums))


@compiled
def mean_cost(
    residuals: F64, count: int, samples: int, sigma: float, limit: float, solver: Solver
) -> float:
    """Mean loss over all samples; one without a match costs as much as the worst match may."""
    inverse = 1 / (sigma * sigma)
    total = 0.0
    if solver.weight == STUDENT_T:
        # the sum of logarithms is that of products, short enough not to overflow
        scale = inverse / solver.tuning
        chain, links = 1.0, 0
        for i in range(count):
            chain *= 1 + residuals[i] * residuals[i] * scale
            links += 1
            if links == 16:
                total += np.log(chain)
                chain, links = 1.0, 0
        total = 0.5 * (solver.tuning + 1) * (total + np.log(chain))
    elif solver.weight == TUKEY:
        total = sum_losses(residuals, count, inverse, solver.tuning)
    else:
        for i in range(count):
            square = residuals[i] * residuals[i] * inverse
            total += robust_cost(square, solver.weight, solver.tuning)
    if samples > count:
        total += (samples - count) * robust_cost(limit * inverse, solver.weight, solver.tuning)
    return total / samples if samples > 0 else 0.0


@compiled
def scale_of(residuals: F64, count: int, sigma: float, solver: Solver) -> float:
    """Scale of the residuals by the rule that goes with the weight function."""
    if solver.weight == STUDENT_T:
        return student_scale(residuals, count, solver.tuning, sigma, solver.min_sigma)
    return median_scale(residuals, count, solver.min_sigma)


# --------------------------------------------------------------------------------- registration


@compiled
def exp_se3(xi: F64) -> F64:
    """The rigid motion of a twist [v, w]; twin of se3.exp."""
    w0, w1, w2 = xi[3], xi[4], xi[5]
    square = w0 * w0 + w1 * w1 + w2 * w2
    if square < 1e-8:
        a, b, c = 1 - square / 6, 0.5 - square / 24, 1 / 6 - square / 120
    else:
        angle = np.sqrt(square)
        a = np.sin(angle) / angle
        b = (1 - np.cos(angle)) / square
        c = (1 - a) / square
    T = np.zeros((4, 4))
    hat = np.array([[0.0, -w2, w1], [w2, 0.0, -w0], [-w1, w0, 0.0]])
    for i in range(3):
        for j in range(3):
            hat2 = 0.0
            for k in range(3):
                hat2 += hat[i, k] * hat[k, j]
            one = 1.0 if i == j else 0.0
            T[i, j] = one + a * hat[i, j] + b * hat2
            T[i, 3] += (one + b * hat[i, j] + c * hat2) * xi[j]
    T[3, 3] = 1
    return T


@lean
def multiply(A: F64, B: F64, AB: F64) -> None:
    """Write the product of two rigid motions."""
    for i in range(3):
        for j in range(4):
            AB[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
        AB[i, 3] += A[i, 3]
    AB[3, 0], AB[3, 1], AB[3, 2], AB[3, 3] = 0.0, 0.0, 0.0, 1.0


@compiled
def product(A: F64, B: F64) -> F64:
    """Matrix product of two rigid motions."""
    AB = np.empty((4, 4))
    multiply(A, B, AB)
    return AB


@compiled
def log_se3(T: F64) -> F64:
    """The twist [v, w] of a rigid motion by less than half a turn; twin of se3.log."""
    x, y, z = (T[2, 1] - T[1, 2]) / 2, (T[0, 2] - T[2, 0]) / 2, (T[1, 0] - T[0, 1]) / 2
    sine = np.sqrt(x * x + y * y + z * z)
    angle = np.arctan2(sine, (T[0, 0] + T[1, 1] + T[2, 2] - 1) / 2)
    if angle < 1e-4:
        d = 1 / 12
    else:
        x, y, z = x * angle / sine, y * angle / sine, z * angle / sine
        d = (1 - angle / 2 / np.tan(angle / 2)) / (angle * angle)
    u, v, w = T[0, 3], T[1, 3], T[2, 3]
    pu, pv, pw = y * w - z * v, z * u - x * w, x * v - y * u
    xi = np.empty(6)
    xi[0] = u - pu / 2 + d * (y * pw - z * pv)
    xi[1] = v - pv / 2 + d * (z * pu - x * pw)
    xi[2] = w - pw / 2 + d * (x * pv - y * pu)
    xi[3], xi[4], xi[5] = x, y, z
    return xi


@compiled
def lagged(T: F64, lag: Lag) -> F64:
    """Where the camera was as the depth was taken that belongs to an image taken at T.

    At the velocity since the last image. For points that were moved by an expected velocity.
    """
    if lag.share == 0:
        return T
    twist = log_se3(product(inverted(lag.T_ref_last), T))
    twist *= lag.share
    return product(product(T, exp_se3(twist)), lag.T_depth_cam)


@compiled
def unroll_points(points: F64, T: F64, lag: Lag, slack: F64, moved: F64) -> None:
    """Move samples to the instant of the image, taken at T, each by the lag of its row.

    The camera has not gone on as it went, by a slack (6,) in the reference; see `Lag`.
    """
    a, b, c, p, q, r = log_se3(product(inverted(lag.T_ref_last), T))
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        s = lag.rows[i]
        moved[i, 0] = x + s * (a + q * z - r * y)
        moved[i, 1] = y + s * (b + r * x - p * z)
        moved[i, 2] = z + s * (c + p * y - q * x)
    if lag.bends.size == 0:
        return
    carry, twist = adjoint_back(T), np.zeros(6)
    for i in range(6):
        for j in range(6):
            twist[i] += carry[i, j] * slack[j]
    a, b, c, p, q, r = twist
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        s = lag.bends[i]
        moved[i, 0] += s * (a + q * z - r * y)
        moved[i, 1] += s * (b + r * x - p * z)
        moved[i, 2] += s * (c + p * y - q * x)


@lean
def speed_across(
    u: np.float64,
    v: np.float64,
    gu: np.float64,
    gv: np.float64,
    near: np.float64,
    velocity: F64,
    camera: Pinhole,
) -> np.float64:
    """How fast an edge moves along its gradient, px/s but for the sign, by a camera's velocity.

    ``near`` is one over its depth, 1/m.
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    a, b, c, p, q, r = velocity
    ahead = c * near + p * y - q * x
    du = camera.fx * (a * near + q - r * y - x * ahead)
    dv = camera.fy * (b * near + r * x - p - y * ahead)
    return np.float64(gu * du + gv * dv)


@lean
def nearness(depth: np.float32) -> np.float64:
    """One over a depth, 1/m; 0, as if it were infinite, where there is none."""
    return np.float64(1 / depth if depth >= MIN_DEPTH else 0.0)


@compiled
def write_sharpness(
    pixels: F32,
    gradients: F32,
    depths: F32,
    velocity: F64,
    key_velocity: F64,
    camera: Pinhole,
    squared_s2: float,
    sharp: F64,
) -> None:
    """Write what edges count that were exposed for a time, whose square is given, as `Lag` says.

    One that has moved by w px meanwhile is a ramp, of the variance w^2 / 12; so is its match, where
    the camera went by another velocity.
    """
    for i in range(sharp.size):
        u, v = np.float64(pixels[i, 0]), np.float64(pixels[i, 1])
        gu, gv, near = np.float64(gradients[i, 0]), np.float64(gradients[i, 1]), nearness(depths[i])
        now = speed_across(u, v, gu, gv, near, velocity, camera)
        then = speed_across(u, v, gu, gv, near, key_velocity, camera)
        smeared = squared_s2 * (now * now + then * then) / 12
        sharp[i] = 1 / np.sqrt(1 + SMEARED_DOUBT * smeared)


@compiled
def smear_change(
    pixels: F32,
    depths: F32,
    gradients: F32,
    profiles: F32,
    key_pixels: F32,
    key_gradients: F32,
    key_profiles: F32,
    own: int,
    matches: I32,
    residuals: F64,
    most_px: float,
    most_px2: float,
    velocity: F64,
    key_velocity: F64,
    camera: Pinhole,
) -> tuple[int, float, float]:
    """How much more edges are widened that move the more, as against their matches.

    Of the stronger half of the samples whose match is among the reference's first, its ``own``, no
    farther than ``most_px``, no wider than ``most_px2`` and turned alike: how many they are; then
    of the quarter whose speed along the gradient has risen most over that of the match, less the
    quarter where it has risen least, each with what is even with it: the mean change of its square,
    over 12, px^2/s^2, and the middle change of the variance of the profile, px^2. What one is of
    the other, s^2, is the square of the exposure.
    """
    n = matches.size
    chosen, heights = np.empty(n, np.int64), np.empty(n, np.float32)
    count = 0
    for i in range(n):
        if 0 <= matches[i] < own and abs(residuals[i]) < most_px and depths[i] >= MIN_DEPTH:
            chosen[count], heights[count] = i, profiles[i, 0]
            count += 1
    if count == 0:
        return 0, 0.0, 0.0
    strong = median(heights[:count])
    moved, widened = np.empty(count), np.empty(count, np.float32)
    kept = 0
    for j in range(count):
        i = chosen[j]
        k = matches[i]
        gu, gv = np.float64(gradients[i, 0]), np.float64(gradients[i, 1])
        ku, kv = np.float64(key_gradients[k, 0]), np.float64(key_gradients[k, 1])
        was = -1 / min(key_profiles[k, 1], -FLATTEST)
        if heights[j] < strong or was > most_px2 or gu * ku + gv * kv < TURNED_ALIKE:
            continue
        u, v, near = np.float64(pixels[i, 0]), np.float64(pixels[i, 1]), nearness(depths[i])
        now = speed_across(u, v, gu, gv, near, velocity, camera)
        u, v = np.float64(key_pixels[k, 0]), np.float64(key_pixels[k, 1])
        then = speed_across(u, v, ku, kv, near, key_velocity, camera)
        moved[kept] = (now * now - then * then) / 12
        widened[kept] = -1 / min(profiles[i, 1], -FLATTEST) - was
        kept += 1
    if kept < 4:
        return kept, 0.0, 0.0
    moved, widened, quarter = moved[:kept], widened[:kept], kept // 4
    ranked = moved.astype(np.float32)
    least = ranked <= smallest(ranked, quarter - 1)
    most = ranked >= smallest(ranked, kept - quarter)
    moves = moved[most].mean() - moved[least].mean()
    return kept, moves, median(widened[most]) - median(widened[least])


@lean_float
def unroll_pixels(
    pixels: F32,
    depths: F32,
    typical: np.float32,
    seconds: float,
    velocity: F64,
    camera: Pinhole,
    moved: F32,
    moved_depths: F32,
) -> None:
    """Write where edges would be, had all rows been taken at once, in the middle of the readout.

    From its first row to its last it takes so many ``seconds``. Where an edge has no depth (0) it
    is taken to be at the ``typical`` one. One so near that it would come twice as near, or has no
    usable projection, stays. ``pixels`` and ``moved`` (2 N,) are flat: of rows, whose distance in
    memory it would not know, vectors are not made.
    """
    a, b, c, p, q, r = velocity
    per_fx, per_fy = 1 / camera.fx, 1 / camera.fy
    for i in range(place(depths.size)):
        to_u = place(i + i)
        to_v = to_u + place(1)
        u, v, known = pixels[to_u], pixels[to_v], depths[i]
        z = np.float64(known if known > 0 else typical)
        x, y = (u - camera.cx) * per_fx, (v - camera.cy) * per_fy
        s = (np.float64(v) / camera.height - 0.5) * seconds
        near = 1 / z  # the inverse, so that the depth may be infinite
        w = 1 + s * (c * near + p * y - q * x)
        moves = (z >= MIN_DEPTH) & (w >= 0.5)  # no branch: on vectors
        du = (x + s * (a * near + q - r * y)) / w * camera.fx + camera.cx
        dv = (y + s * (b * near + r * x - p)) / w * camera.fy + camera.cy
        moved[to_u] = du if moves else u
        moved[to_v] = dv if moves else v
        moved_depths[i] = known * w if moves else known


@compiled
def carry_edges(
    pixels: F32,
    gradients: F32,
    depths: F32,
    profiles: F32,
    T: F64,
    camera: Pinhole,
    carried: F32,
    turned: F32,
    moved_depths: F32,
    kept: F32,
) -> int:
    """Write where edges with depth are to be seen from another place, and their unit gradients.

    ``T`` maps points to that camera. A gradient is carried by the line that it stands on, which is
    taken to lie at the depth of the edge; its profile, if it has one, stays. Returns how many are
    in the view; the rest are left out.
    """
    n = 0
    for i in range(depths.size):
        z = np.float64(depths[i])
        if z < MIN_DEPTH:
            continue
        x, y = (
            (pixels[i, 0] - camera.cx) / camera.fx * z,
            (pixels[i, 1] - camera.cy) / camera.fy * z,
        )
        Z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if Z < MIN_DEPTH:
            continue
        X = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / Z
        Y = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / Z
        u, v = camera.fx * X + camera.cx, camera.fy * Y + camera.cy
        if not (0 <= u <= camera.width - 1 and 0 <= v <= camera.height - 1):
            continue
        a, b = -gradients[i, 1] / camera.fx, gradients[i, 0] / camera.fy  # along the line
        c = T[2, 0] * a + T[2, 1] * b
        du = camera.fx * (T[0, 0] * a + T[0, 1] * b - X * c)
        dv = camera.fy * (T[1, 0] * a + T[1, 1] * b - Y * c)
        length = np.sqrt(du * du + dv * dv)
        if length == 0:
            continue
        carried[n, 0], carried[n, 1] = u, v
        turned[n, 0], turned[n, 1] = dv / length, -du / length
        moved_depths[n] = Z
        if profiles.size > 0:
            kept[n, 0], kept[n, 1] = profiles[i, 0], profiles[i, 1]
        n += 1
    return n


@compiled
def inverted(T: F64) -> F64:
    """Give the inverse (4, 4) of a rigid motion; twin of se3.inverse."""
    inverse = np.empty((4, 4))
    for i in range(3):
        inverse[i, 3] = 0.0
        inverse[3, i] = 0.0
        for j in range(3):
            inverse[i, j] = T[j, i]
            inverse[i, 3] -= T[j, i] * T[j, 3]
    inverse[3, 3] = 1.0
    return inverse


@compiled
def adjoint_back(T: F64) -> F64:
    """Give the matrix (6, 6) that carries twists [v, w] back through a rigid motion.

    The adjoint of its inverse; twin of se3.adjoint of se3.inverse.
    """
    Ad = np.empty((6, 6))
    write_adjoint(inverted(T), Ad)
    return Ad


@compiled
def factorize(A: F64, damping: float, L: F64) -> bool:
    """Write the Cholesky factor of A + damping diag A, where that is positive definite."""
    for i in range(A.shape[0]):
        for j in range(i + 1):
            value = A[i, j] * (1 + damping) if i == j else A[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                if not value > PIVOT * A[i, i]:
                    return False
                L[i, i] = np.sqrt(value)
            else:
                L[i, j] = value / L[j, j]
    return True


@lean
def solve_lower(L: F64, x: F64) -> None:
    """Solve L y = x in place."""
    for i in range(x.size):
        value = x[i]
        for k in range(i):
            value -= L[i, k] * x[k]
        x[i] = value / L[i, i]


@lean
def solve_upper(L: F64, x: F64) -> None:
    """Solve L^T y = x in place."""
    for i in range(x.size - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, x.size):
            value -= L[k, i] * x[k]
        x[i] = value / L[i, i]


@compiled
def give_way(C: F64, K: F64, g: F64, room: F64, H: F64, b: F64) -> None:
    """Eliminate a slack (6,) from normal equations of a pose and that.

    K, positive definite, is its curvature, g its gradient, and C what couples it to the pose, a
    column for each part of it. Writes the factor of K, and g, into room, (4, 6, 6), which `yielded`
    is to have.
    """
    L, solved, pull = room[0], room[1], room[2, 0]
    factorize(K, 0.0, L)
    for i in range(6):
        room[2, 1, i] = pull[i] = g[i]
        for j in range(6):
            solved[i, j] = room[3, i, j] = C[i, j]
        solve_lower(L, solved[i])
    solve_lower(L, pull)
    for i in range(6):
        for k in range(6):
            b[i] -= solved[i, k] * pull[k]
        for j in range(6):
            for k in range(6):
                H[i, j] -= solved[i, k] * solved[j, k]


@compiled
def yielded(slack: F64, room: F64, step: F64, now: F64) -> None:
    """Give the slack that goes with a step of the pose; see `give_way`."""
    for i in range(6):
        now[i] = -room[2, 1, i]
        for j in range(6):
            now[i] -= room[3, j, i] * step[j]
    solve_lower(room[0], now)
    solve_upper(room[0], now)
    for i in range(6):
        now[i] += slack[i]


@compiled
def solve_damped(H: F64, b: F64, damping: float, step: F64) -> bool:
    """Solve (H + damping diag H) step = -b, Eq. (14), by Cholesky; False where singular."""
    L = np.empty(H.shape)
    if not factorize(H, damping, L):
        return False
    for i in range(b.size):
        step[i] = -b[i]
    solve_lower(L, step)
    solve_upper(L, step)
    return True


@lean
def write_adjoint(T: F64, Ad: F64) -> None:
    """Write the matrix that carries twists [v, w] through a rigid motion; twin of se3.adjoint."""
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    for j in range(3):
        a, b, c = T[0, j], T[1, j], T[2, j]
        Ad[0, j], Ad[1, j], Ad[2, j] = a, b, c
        Ad[3, 3 + j], Ad[4, 3 + j], Ad[5, 3 + j] = a, b, c
        Ad[0, 3 + j], Ad[1, 3 + j], Ad[2, 3 + j] = y * c - z * b, z * a - x * c, x * b - y * a
        Ad[3, j] = Ad[4, j] = Ad[5, j] = 0.0


@lean
def multiply_six(A: F64, B: F64, AB: F64) -> None:
    """Write the product of two matrices of (6, 6)."""
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += A[i, k] * B[k, j]
            AB[i, j] = total


@compiled
def carry_covariance(T: F64, C: F64, carried: F64) -> None:
    """Write Ad C Ad^T with the adjoint Ad of a rigid motion: what is known of twists beyond it."""
    Ad, half = np.empty((6, 6)), np.empty((6, 6))
    write_adjoint(T, Ad)
    multiply_six(Ad, C, half)
    multiply_six(half, Ad.T, carried)


@compiled
def filter_pose(
    P: F64,
    T_cur_last: F64,
    C: F64,
    acceleration: F64,
    seconds: float,
    off: F64,
    velocity: F64,
    step: F64,
) -> bool:
    """Predict and correct a Kalman filter of constant velocity; False where it cannot be.

    ``P`` (3, 6, 6) holds the covariances of the pose, of the pose with the velocity, and of the
    velocity; ``C`` that of a measurement which is ``off`` (6,) from the pose predicted, which is
    that of the last camera by the inverse of ``T_cur_last``. ``acceleration`` (6,) are variances. P
    and ``velocity`` are corrected, and by what the pose is, is written to ``step``.
    """
    S, Ad, half = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    write_adjoint(T_cur_last, Ad)  # what the pose is off by, to the camera as it moves
    multiply_six(Ad, P[0], half)
    multiply_six(half, Ad.T, P[0])
    multiply_six(Ad, P[1], half)
    put_square(half, P[1])
    A, B, D = P[0], P[1], P[2]
    L, W, V = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    square = seconds * seconds
    for i in range(6):
        for j in range(6):
            W[i, j] = A[i, j] + seconds * (B[i, j] + B[j, i]) + square * D[i, j]
            V[j, i] = B[i, j] + seconds * D[i, j]
        W[i, i] += acceleration[i] * square * square / 4
        V[i, i] += acceleration[i] * square * seconds / 2
        D[i, i] += acceleration[i] * square
    for i in range(6):
        for j in range(6):
            A[i, j], B[j, i] = W[i, j], V[i, j]
            S[i, j] = W[i, j] + C[i, j]
    if not factorize(S, 0.0, L):
        return False
    w = off.copy()
    solve_lower(L, w)
    for i in range(6):
        solve_lower(L, W[i])  # rows that are columns of A, and of B
        solve_lower(L, V[i])
    for i in range(6):
        step[i] = 0.0
        for j in range(6):
            step[i] += W[i, j] * w[j]
            velocity[i] += V[i, j] * w[j]
            for k in range(6):
                A[i, j] -= W[i, k] * W[j, k]
                B[i, j] -= W[i, k] * V[j, k]
                D[i, j] -= V[i, k] * V[j, k]
    return True


@lean
def left_to_go(change: float, before: float) -> float:
    """What is left after a step if each is the same share of the one before it."""
    return change * change / (before - change) if change < before else np.inf


@lean
def product_in(H: F64, a: F64, b: F64) -> float:
    """Dot product of two steps in the metric of H."""
    total = 0.0
    for i in range(a.size):
        for j in range(b.size):
            total += a[i] * H[i, j] * b[j]
    return total


@compiled
def stretch_step(H: F64, step: F64, last: F64, went: F64, most: float, stretched: F64) -> bool:
    """Lengthen a step by what the one before it has left over; False where there is no telling.

    Where matches hold a pose back, each step takes the same share of the way that is left. Of the
    ``last`` step, and of how the pose ``went`` by it, this tells the share, along the direction
    in which steps change (Anderson mixing of depth one, in the metric of H). By that a step that
    turns back becomes shorter.
    """
    for i in range(step.size):
        stretched[i] = step[i] - last[i]
    squares = product_in(H, stretched, stretched)
    if not squares > 0:
        return False
    share = product_in(H, stretched, step) / squares
    for i in range(step.size):
        stretched[i] = step[i] - share * (went[i] + stretched[i])
    if not product_in(H, stretched, step) > 0:  # steps grow
        if product_in(H, last, step) <= 0:
            return False
        for i in range(step.size):
            stretched[i] = most * step[i]
        return True
    excess = product_in(H, stretched, stretched) / (most * most * product_in(H, step, step))
    if excess > 1:
        for i in range(step.size):
            stretched[i] /= np.sqrt(excess)
    return True


@compiled
def orthonormalize(T: F64) -> None:
    """Make the rotation of a rigid motion exact again (Gram-Schmidt), in place."""
    a0, a1, a2 = T[0, 0], T[1, 0], T[2, 0]
    norm = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
    a0, a1, a2 = a0 / norm, a1 / norm, a2 / norm
    b0, b1, b2 = T[0, 1], T[1, 1], T[2, 1]
    dot = a0 * b0 + a1 * b1 + a2 * b2
    b0, b1, b2 = b0 - dot * a0, b1 - dot * a1, b2 - dot * a2
    norm = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    b0, b1, b2 = b0 / norm, b1 / norm, b2 / norm
    T[0, 0], T[1, 0], T[2, 0] = a0, a1, a2
    T[0, 1], T[1, 1], T[2, 1] = b0, b1, b2
    T[0, 2], T[1, 2], T[2, 2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@lean_float
def warp_and_match(
    grid: Grid,
    nearby: NearMap,
    stage: int,
    points: F64,
    gradients: F32,
    stride: np.int64,
    camera: Pinhole,
    T: F64,
    criterion: Criterion,
    residual: int,
    matches: Matches,
    residuals: F64,
) -> int:
    """Warp the samples by T (Eq. 1), match them (Eq. 6) and take residuals (Eq. 10-12).

    Takes every ``stride``-th sample. A match found before is kept without a search where it
    provably still is the best: the root of the cost changes by no more than the query moves. How
    wide to look for the others is told by what the last ones needed.
    Where there is a map of near edges it gives those that had no match a first idea; at the stage
    ``LOOK_UP`` that is the match.
    Residuals of the matched samples are packed to the front; returns their number.
    """
    t00, t01, t02, t03 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    t10, t11, t12, t13 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    t20, t21, t22, t23 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    count, needed = 0, NEEDED_AT_FIRST
    for i in range(place(0), place(points.shape[0]), place(stride)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        px = t00 * x + t01 * y + t02 * z + t03
        py = t10 * x + t11 * y + t12 * z + t13
        pz = t20 * x + t21 * y + t22 * z + t23
        matches.Y[i, 0], matches.Y[i, 1], matches.Y[i, 2] = px, py, pz
        k = matches.edge[i]
        matches.edge[i] = NO_MATCH
        if pz < MIN_DEPTH:
            continue
        u = camera.fx * px / pz + camera.cx
        v = camera.fy * py / pz + camera.cy
        if not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5):
            continue
        gu, gv = gradients[i, 0], gradients[i, 1]
        if nearby.keys.size > 0 and (k < 0 or stage == LOOK_UP):
            k = near_edge(nearby, u, v, gu, gv)
            matches.bound[i] = 0
        kept = False
        if stage == LOOK_UP:
            if k < 0 or match_cost(grid.points, k, u, v, gu, gv, criterion) == np.inf:
                continue
            kept = True
        elif k >= 0:
            cost = match_cost(grid.points, k, u, v, gu, gv, criterion)
            mu, mv = u - matches.query[i, 0], v - matches.query[i, 1]
            moved = np.sqrt(mu * mu + mv * mv)
            kept = np.sqrt(cost) + moved < matches.bound[i]
        if not kept:
            hint, reach = k, REACH * needed + MARGIN
            k, cost, second = nearest_in_grid(grid, u, v, gu, gv, criterion, hint, reach)
            matches.query[i, 0], matches.query[i, 1] = u, v
            matches.bound[i] = np.sqrt(second)
            if k < 0:
                continue
            if hint < 0:
                needed = with_latest(needed, cost)
        matches.edge[i] = k
        to = place(k)
        du, dv = u - grid.points[to, 0], v - grid.points[to, 1]  # Eq. (10)
        if residual == SIGNED:
            nu, nv = np.float64(grid.points[to, 2]), np.float64(grid.points[to, 3])  # Eq. (11)
            r = du * nu + dv * nv  # Eq. (12)
        else:
            r = np.sqrt(du * du + dv * dv)  # Eq. (5)
            nu, nv = (du / r, dv / r) if r > 0 else (np.float64(0), np.float64(0))
        matches.normal[i, 0], matches.normal[i, 1] = nu, nv
        residuals[count] = r
        count += 1
    return count


@lean
def write_row(au: float, av: float, aw: float, px: float, py: float, pz: float, row: F64) -> None:
    """Write the derivative [a, Y x a] of a . Y by a left perturbation [v, w] of Y's pose."""
    row[0], row[1], row[2] = au, av, aw
    row[3] = py * aw - pz * av
    row[4] = pz * au - px * aw
    row[5] = px * av - py * au


@lean
def mirror_lower(M: F64) -> None:
    """Copy what is below the diagonal to above it."""
    for m in range(M.shape[0]):
        for n in range(m):
            M[n, m] = M[m, n]


@lean
def weigh(table: F64, n: np.uint64, inverse: float, weight: int, tuning: float) -> None:
    """Write the weights of the first n residuals of a table, and what they push; the rest is 0."""
    r, w, push = table[RESIDUAL], table[WEIGHT], table[PUSH]
    if weight == TUKEY:
        inverse /= tuning * tuning
        for lane in range(n):
            inside = 1 - r[lane] * r[lane] * inverse
            w[lane] = inside * inside if inside > 0 else 0.0
    else:
        for lane in range(n):
            w[lane] = robust_weight(r[lane] * r[lane] * inverse, weight, tuning)
    for lane in range(n, place(LANES)):
        w[lane] = 0.0
    for lane in range(LANES):
        push[lane] = w[lane] * r[lane]


@lean
def cross_row(y: F64, c: F64, z: F64, b: F64, to: F64) -> None:
    """Write y c - z b, one coordinate of a cross product."""
    for lane in range(place(to.size)):
        to[lane] = y[lane] * c[lane] - z[lane] * b[lane]


@lean
def turn_rows(table: F64, rows: F64) -> None:
    """Write the derivatives Y x a below those, a, by which Y moves; as `write_row` does."""
    px, py, pz = table[POINT], table[POINT + 1], table[POINT + 2]
    au, av, aw = rows[0], rows[1], rows[2]
    cross_row(py, aw, pz, av, rows[3])
    cross_row(pz, au, px, aw, rows[4])
    cross_row(px, av, py, au, rows[5])


@lean
def add_scores(table: F64, sums: F64) -> None:
    """Add what each derivative has of J^T W r, lane by lane."""
    push = table[PUSH]
    for m in range(6):
        row, to = table[m], sums[m]
        for lane in range(place(push.size)):
            to[lane] += push[lane] * row[lane]


@lean
def add_pairs(rows: F64, table: F64, sums: F64) -> None:
    """Add what each pair of derivatives has of J^T W J, lane by lane."""
    w, weighted = table[WEIGHT], table[SPARE]
    k = 0
    for m in range(6):
        row = rows[m]
        for lane in range(place(w.size)):
            weighted[lane] = w[lane] * row[lane]
        for n in range(m + 1):
            other, to = rows[n], sums[k]
            for lane in range(place(w.size)):
                to[lane] += weighted[lane] * other[lane]
            k += 1


@lean
def sum_pairs(sums: F64, factor: float, H: F64) -> None:
    """Add up the lanes of `add_pairs`, times a factor."""
    k = 0
    for m in range(6):
        for n in range(m + 1):
            H[m, n] = factor * sum_lanes(sums[k])
            H[n, m] = H[m, n]
            k += 1


@lean
def sum_lanes(lanes: F64) -> float:
    """Add up the sums that were taken by turns."""
    total = 0.0
    for lane in range(LANES):
        total += lanes[lane]
    return total


@lean_float
def take_edges(
    matches: Matches, residuals: F64, bends: F64, row: np.uint64, i: np.uint64, table: F64
) -> tuple[np.uint64, np.uint64]:
    """Fill a table with matched samples, from i on; returns how many, and where to go on.

    Their residuals begin at ``row``. ``bends`` (N,), if there are any, go into the table as well.
    """
    n, size = place(0), place(matches.edge.size)
    while i < size and n < place(LANES):
        if matches.edge[i] >= 0:
            if bends.size > 0:
                table[BEND, n] = bends[i]
            table[RESIDUAL, n] = residuals[row + n]
            table[0, n], table[1, n] = matches.normal[i, 0], matches.normal[i, 1]
            table[POINT, n], table[POINT + 1, n] = matches.Y[i, 0], matches.Y[i, 1]
            table[POINT + 2, n] = matches.Y[i, 2]
            n += place(1)
        i += place(1)
    return n, i


@lean_float
def project_rows(table: F64, fx: float, fy: float, n: np.uint64) -> None:
    """Turn directions in the image, in the first two rows, into what they are by Y's motion."""
    px, py, pz = table[POINT], table[POINT + 1], table[POINT + 2]
    au, av, aw, per_z = table[0], table[1], table[2], table[SPARE]
    for lane in range(n):
        per_z[lane] = 1 / pz[lane]
    for lane in range(n):
        au[lane] *= fx * per_z[lane]
    for lane in range(n):
        av[lane] *= fy * per_z[lane]
    for lane in range(n):
        aw[lane] = -(au[lane] * px[lane] + av[lane] * py[lane]) * per_z[lane]


@compiled
def normal_equations(
    camera: Pinhole,
    solver: Solver,
    sigma: float,
    matches: Matches,
    residuals: F64,
    bends: F64,
    couples: bool,
    H: F64,
    b: F64,
    C: F64,
    K: F64,
    g: F64,
) -> float:
    """Accumulate H = J^T W J and b = J^T W r; returns the sum of the weights.

    With Y = T x and n the unit vector that the residual is measured along, the derivative by a
    left perturbation [v, w] of T is [a, Y x a], where a = (d pi / d Y)^T n. By a slack that moves
    each sample by a share of that, ``bends`` (N,), it is as much of it: accumulates g, J^T W r
    times these, zeros where there are none, and where it ``couples`` C, J^T W J times these, and K,
    times their squares.
    """
    table, pairs, scores = np.zeros((TABLE, LANES)), np.zeros((PAIRS, LANES)), np.zeros((6, LANES))
    weights = np.zeros(LANES)
    crossed, own, pulls = np.zeros((PAIRS, LANES)), np.zeros((PAIRS, LANES)), np.zeros((6, LANES))
    inverse = 1 / (sigma * sigma)
    row, i = place(0), place(0)
    while i < place(matches.edge.size):
        n, i = take_edges(matches, residuals, bends, row, i, table)
        row += n
        project_rows(table, camera.fx, camera.fy, n)
        turn_rows(table, table)
        weigh(table, n, inverse, solver.weight, solver.tuning)
        add_scores(table, scores)
        add_pairs(table, table, pairs)
        for lane in range(LANES):
            weights[lane] += table[WEIGHT, lane]
        if bends.size > 0:
            if couples:
                multiply_rows(table[WEIGHT], table[BEND], table[WEIGHT])
            multiply_rows(table[PUSH], table[BEND], table[PUSH])
            add_scores(table, pulls)
            if couples:
                add_pairs(table, table, crossed)
                multiply_rows(table[WEIGHT], table[BEND], table[WEIGHT])
                add_pairs(table, table, own)
    sum_pairs(pairs, 1.0, H)
    if couples:
        sum_pairs(crossed, 1.0, C)
        sum_pairs(own, 1.0, K)
    for m in range(6):
        b[m], g[m] = sum_lanes(scores[m]), sum_lanes(pulls[m])
    return sum_lanes(weights)


@compiled
def row_equations(
    pixels: F32,
    depths: F32,
    gradients: F32,
    matches: I32,
    residuals: F64,
    trust: F64,
    camera: Pinhole,
    T: F64,
    weight: int,
    tuning: float,
    sigma: float,
    stride: int,
    H_row: F64,
    H_rows: F64,
    b_row: F64,
) -> None:
    """Accumulate J^T W J times the row and its square, and J^T W r times the row.

    Rows go from -1/2 to 1/2. ``gradients`` are those of the reference, ``residuals`` one for each
    sample, ``matches`` and ``trust`` as `align` gives them. One sample in ``stride`` counts.
    """
    J = np.empty(6)
    inverse = 1 / (sigma * sigma)
    for i in range(0, matches.size, stride):
        k = matches[i]
        if k < 0:
            continue
        z = np.float64(depths[i])
        x, y = (
            (pixels[i, 0] - camera.cx) / camera.fx * z,
            (pixels[i, 1] - camera.cy) / camera.fy * z,
        )
        px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if pz < MIN_DEPTH:
            continue
        per_z = trust[i] / pz
        au, av = gradients[k, 0] * camera.fx * per_z, gradients[k, 1] * camera.fy * per_z
        write_row(au, av, -(au * px + av * py) / pz, px, py, pz, J)
        r = trust[i] * residuals[i]
        row = pixels[i, 1] / camera.height - 0.5
        w = robust_weight(r * r * inverse, weight, tuning) * row
        for m in range(6):
            wj = w * J[m]
            b_row[m] += wj * r
            for n in range(m + 1):
                H_row[m, n] += wj * J[n]
                H_rows[m, n] += row * wj * J[n]
    mirror_lower(H_row)
    mirror_lower(H_rows)


@compiled
def note_change(velocity: F64, share: float, last: F64, changes: F64) -> None:
    """Bring ``changes``, a mean of squares of steps, nearer to that from ``last`` by a share.

    Velocities are (6,), 1/s, and changes (6, 6). Then ``last`` is the velocity.
    """
    for i in range(6):
        for j in range(6):
            square = (velocity[i] - last[i]) * (velocity[j] - last[j])
            changes[i, j] += share * (square - changes[i, j])
    put(velocity, last)


@lean
def add_pushed(
    L: F64,
    pushed: F64,
    apart: F64,
    changes: F64,
    seconds: float,
    variance: float,
    G: F64,
    S: F64,
    GS: F64,
    part: F64,
) -> None:
    """Add G S G^T to the lower half of a part, with G = H^-1 ``pushed`` and H = L L^T.

    S is that of a twist: apart apart^T times a variance, s^2, and changes by twice seconds squared.
    All are (6, 6), but for ``apart`` (6,), 1/s; G, S and GS are room to work in.
    """
    for j in range(6):  # a row of G^T, as H and what is pushed are symmetric
        for i in range(6):
            G[j, i] = pushed[j, i]
            S[j, i] = variance * apart[j] * apart[i] + 2 * seconds * seconds * changes[j, i]
        solve_lower(L, G[j])
        solve_upper(L, G[j])
    for m in range(6):
        for j in range(6):
            total = 0.0
            for n in range(6):
                total += S[m, n] * G[n, j]
            GS[m, j] = total
    for i in range(6):
        for j in range(i + 1):
            for m in range(6):
                part[i, j] += G[m, i] * GS[m, j]


@compiled
def instants_part(
    H: F64,
    by_rows: F64,
    by_depth: F64,
    T: F64,
    own: F64,
    key_velocity: F64,
    own_changes: F64,
    readout: float,
    readout_variance: float,
    delay: float,
    delay_variance: float,
    wrong_s2: float,
    part: F64,
) -> bool:
    """Write what a pose scatters by since its parts were not taken at one instant, (6, 6).

    A readout that is off by a second pushes the pose by H^-1 ``by_rows`` times what two velocities
    differ by, of the camera (its ``own``, 1/s) and its keyframe; a delay of depth by H^-1
    ``by_depth``. So does a velocity that changes within a readout, s, or a delay, of either image:
    by as much, squared, as it does from frame to frame, ``own_changes``. An image that is dated
    wrong is where the camera was then. H and what is pushed are in px^2, (6, 6), as is the part, of
    the twist [v, w] in the reference's camera. False, and zeros, where H is not positive definite.
    """
    part[:] = 0
    L, S, G, GS = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    if not factorize(H, 0.0, L):
        return False
    carry, changes = np.zeros((6, 6)), np.empty((6, 6))
    velocity, apart = np.empty(6), np.empty(6)
    write_adjoint(T, carry)
    multiply_six(carry, own_changes, S)
    for i in range(6):
        for j in range(6):
            changes[i, j] = 0
            for k in range(6):
                changes[i, j] += S[i, k] * carry[j, k]
        velocity[i] = 0
        for k in range(6):
            velocity[i] += carry[i, k] * own[k]
        apart[i] = velocity[i] - key_velocity[i]
    if readout != 0 or readout_variance != 0:
        add_pushed(L, by_rows, apart, changes, readout, readout_variance, G, S, GS, part)
    if delay != 0 or delay_variance != 0:
        add_pushed(L, by_depth, apart, changes, delay, delay_variance, G, S, GS, part)
    for i in range(6):
        for j in range(i + 1):
            squares = velocity[i] * velocity[j] + key_velocity[i] * key_velocity[j]
            part[i, j] += wrong_s2 * squares
    mirror_lower(part)
    return True


@lean
def take_planes(matches: PlaneMatches, first: np.uint64, n: np.uint64, table: F64) -> None:
    """Fill a table with the points of n planes, from ``first`` on."""
    for axis in range(3):
        for lane in range(n):
            table[axis, lane] = matches.normal[axis, first + lane]
        for lane in range(n):
            table[POINT + axis, lane] = matches.Y[axis, first + lane]
    for lane in range(n):
        table[RESIDUAL, lane] = matches.residuals[first + lane]


@compiled
def plane_equations(matches: PlaneMatches, count: int, sigma: float, H: F64, b: F64) -> None:
    """Accumulate H = J^T W J and b = J^T W r of the distances to planes, by Tukey's weights.

    The derivative of n . Y by a left perturbation [v, w] of T is [n, Y x n].
    """
    table, pairs, scores = np.zeros((TABLE, LANES)), np.zeros((PAIRS, LANES)), np.zeros((6, LANES))
    inverse = 1 / (sigma * sigma)
    for first in range(place(0), place(count), place(LANES)):
        n = min(place(count) - first, place(LANES))
        take_planes(matches, place(first), n, table)
        turn_rows(table, table)
        weigh(table, n, inverse, TUKEY, TUKEY_TUNING)
        add_scores(table, scores)
        add_pairs(table, table, pairs)
    sum_pairs(pairs, 1.0, H)
    for m in range(6):
        b[m] = sum_lanes(scores[m])


@compiled
def plane_cost(matches: PlaneMatches, count: int, points: int, sigma: float) -> float:
    """Sum of Tukey's losses over all points; one without a plane costs as much as the worst."""
    total = sum_losses(matches.residuals, count, 1 / (sigma * sigma), TUKEY_TUNING)
    return total + (points - count) * (TUKEY_TUNING * TUKEY_TUNING / 6)


@lean
def count_fitting(residuals: F64, count: int, sigma: float) -> int:
    """Count the residuals that Tukey's weights do not leave out."""
    fitting, bound = 0, TUKEY_TUNING * sigma
    for i in range(place(count)):
        fitting += int(abs(residuals[i]) < bound)
    return fitting


@compiled
def descend_on_planes(
    planes: PlaneMap,
    points: PlanePoints,
    camera: Pinhole,
    term: DepthTerm,
    basis: F64,
    scale: float,
    solver: Solver,
    stop: float,
    T: F64,
) -> tuple[int, int]:
    """Lower the cost of the distances to planes along some directions, by damped steps.

    ``T`` (4, 4), to the reference camera, is where it begins, and is overwritten. The columns of
    ``basis`` (6, K), twists [v, w], are these directions, ``scale`` is the least scale of the
    distances, in units of their noise; a step of less than ``stop`` along each is the last. Returns
    how many steps were tried, and why no more.
    """
    m, ways = points.sigma.size, basis.shape[1]
    near, tried = new_plane_matches(m), new_plane_matches(m)
    count = match_planes(planes, points, camera, T, term, near)
    H, b, half = np.empty((6, 6)), np.empty(6), np.empty((6, ways))
    A, slope, along = np.empty((ways, ways)), np.empty(ways), np.empty(ways)
    twist, trial = np.empty(6), np.empty((4, 4))
    damping, rejections = solver.damping, 0
    for step in range(solver.max_iterations):
        sigma = median_scale(near.residuals, count, scale)
        cost = plane_cost(near, count, m, sigma)
        plane_equations(near, count, sigma, H, b)
        for k in range(ways):
            slope[k] = 0.0
            for i in range(6):
                slope[k] += basis[i, k] * b[i]
                half[i, k] = 0.0
                for j in range(6):
                    half[i, k] += H[i, j] * basis[j, k]
        for k in range(ways):
            for q in range(ways):
                A[k, q] = 0.0
                for i in range(6):
                    A[k, q] += basis[i, k] * half[i, q]
        if not solve_damped(A, slope, damping, along):
            return step, SINGULAR
        for i in range(6):
            twist[i] = 0.0
            for k in range(ways):
                twist[i] += basis[i, k] * along[k]
        multiply(exp_se3(twist), T, trial)
        found = match_planes(planes, points, camera, trial, term, tried)
        if plane_cost(tried, found, m, sigma) < cost:
            put_square(trial, T)
            count, near, tried = found, tried, near
            damping, rejections = damping * solver.damping_down, 0
            if np.abs(along).max() < stop:
                return step + 1, CONVERGED
        else:
            damping, rejections = damping * solver.damping_up, rejections + 1
            if rejections > solver.max_rejections:
                return step + 1, STALLED
    return solver.max_iterations, EXHAUSTED


@compiled
def new_matches(n: int) -> Matches:
    """State of the matches of n samples, none of them matched."""
    return Matches(
        np.full(n, NO_MATCH, np.int32),
        np.empty((n, 2)),
        np.empty(n),
        np.empty((n, 3)),
        np.empty((n, 2)),
        np.ones(n),
        np.full(n, NO_MATCH, np.int32),
    )


@compiled
def copy_matches(source: Matches, target: Matches) -> None:
    """Overwrite the matches of one set by another's; where that puts them is left to the warp."""
    put(source.edge, target.edge)
    for i in range(place(source.edge.size)):
        target.query[i, 0], target.query[i, 1] = source.query[i, 0], source.query[i, 1]
    put(source.bound, target.bound)
    put(source.trust, target.trust)
    put(source.judged, target.judged)


@compiled
def no_change() -> Change:
    """Profiles that are as they were."""
    return Change(np.zeros((LINE_DIRECTIONS, 2)), np.zeros(2), np.ones(LINE_DIRECTIONS))


@compiled
def usual_change(
    order: I32, known: F32, profiles: F32, gradients: F32, matches: Matches, spread: float
) -> Change:
    """How the ``profiles`` of samples differ from those of their matches, ``known`` by ``order``.

    By medians over some hundreds of them: whatever changes all edges alike, as exposure does, or
    all along one direction, as blur does, is no reason to doubt any. What is off these by
    ``spread`` times the usual halves a match. Trust only goes from edge to edge of like direction:
    else blur would leave nothing to hold the pose across it.
    """
    n = profiles.shape[0]
    changes, lines = np.empty((2, n), np.float32), np.empty(n, np.int32)
    count = place(0)
    for i in range(0, n, max(n // PROFILES, 1)):
        k = matches.edge[i]
        if k >= 0:
            edge = place(order[k])
            changes[0, count] = profiles[i, 0] - known[edge, 0]
            changes[1, count] = profiles[i, 1] - known[edge, 1]
            lines[count] = direction_of(gradients[i, 0], gradients[i, 1]) % LINE_DIRECTIONS
            count += place(1)
    change = no_change()
    if count == 0:
        return change
    some = np.empty(count, np.float32)
    for c in range(2):
        values = changes[c, :count]
        of_all = np.nan
        for line in range(LINE_DIRECTIONS):
            among = place(0)
            for i in range(place(count)):
                some[among] = values[i]  # overwritten, unless it counts
                among += place(lines[i] == line)
            if among >= OF_A_LINE:
                change.middle[line, c] = median(some[:among])
                continue
            if np.isnan(of_all):
                of_all = median(values)
            change.middle[line, c] = of_all
        for i in range(place(count)):
            values[i] -= change.middle[lines[i], c]
        change.per[c] = 1 / (spread * max(median(np.abs(values)), LEAST_CHANGE))
    squares, counts = np.zeros(LINE_DIRECTIONS), np.zeros(LINE_DIRECTIONS)
    for i in range(place(count)):
        x, y = changes[0, i] * change.per[0], changes[1, i] * change.per[1]
        squares[lines[i]] += 1 / (1 + x * x + y * y)
        counts[lines[i]] += 1
    for line in range(LINE_DIRECTIONS):
        if counts[line] >= OF_A_LINE:
            norm = np.sqrt(counts[line] / squares[line])
        else:
            norm = np.sqrt(counts.sum() / squares.sum())
        change.norm[line] = min(norm, MOST_TRUST)
    return change


@compiled
def trust_matches(
    order: I32,
    known: F32,
    profiles: F32,
    gradients: F32,
    change: Change,
    sharp: F64,
    matches: Matches,
    residuals: F64,
) -> None:
    """Multiply residuals, packed, and normals by what each match is to be trusted.

    An edge that looks otherwise than its match is elsewhere, too: part of it is shadow, or what
    stands beside it has become brighter. Where one of the two is no Gaussian it hardly counts. That
    of a match which has stayed is not asked for again. ``sharp`` is that of a `Lag`.
    """
    count = place(0)
    for i in range(place(profiles.shape[0])):
        k = matches.edge[i]
        if k < 0:
            continue
        if k != matches.judged[i]:
            edge = place(order[k])
            line = direction_of(gradients[i, 0], gradients[i, 1]) % LINE_DIRECTIONS
            x = (profiles[i, 0] - known[edge, 0] - change.middle[line, 0]) * change.per[0]
            y = (profiles[i, 1] - known[edge, 1] - change.middle[line, 1]) * change.per[1]
            matches.trust[i] = change.norm[line] / np.sqrt(1 + x * x + y * y)
            if sharp.size > 0:
                matches.trust[i] *= sharp[i]
            matches.judged[i] = k
        trust = matches.trust[i]
        matches.normal[i, 0] *= trust
        matches.normal[i, 1] *= trust
        residuals[count] *= trust
        count += place(1)


@compiled
def best_start(
    grid: Grid,
    nearby: NearMap,
    points: F64,
    gradients: F32,
    camera: Pinhole,
    starts: F64,
    criterion: Criterion,
    solver: Solver,
    stride: np.int64,
    matches: Matches,
    trial: Matches,
    residuals: F64,
) -> int:
    """Which of several poses has the lowest cost over every ``stride``-th sample, at unit scale.

    Edges are looked up where there is a map of those nearby. Of several poses the best leaves its
    matches, but not where it puts them; ``trial``, without a match, and ``residuals`` are room.
    """
    best, best_cost = 0, np.inf
    if starts.shape[0] > 1 and points.shape[0] > 0:
        taken = (points.shape[0] + stride - 1) // stride
        for s in range(starts.shape[0]):
            count = warp_and_match(
                grid,
                nearby,
                LOOK_UP if nearby.keys.size > 0 else ROBUST,
                points,
                gradients,
                stride,
                camera,
                starts[s],
                criterion,
                solver.residual,
                trial,
                residuals,
            )
            cost = mean_cost(residuals, count, taken, 1.0, criterion.limit, solver)
            if cost < best_cost:
                best, best_cost = s, cost
                copy_matches(trial, matches)
    return best


@compiled
def align(
    grid: Grid,
    nearby: NearMap,
    known: F32,
    points: F64,
    gradients: F32,
    profiles: F32,
    camera: Pinhole,
    starts: F64,
    robust: Criterion,
    normal: Criterion,
    first_stage: int,
    last_stage: int,
    solver: Solver,
    stride: np.int64,
    planes: PlaneMap,
    surface: PlanePoints,
    term: DepthTerm,
    lag: Lag,
    T: F64,
    H: F64,
    index: I32,
    residuals: F64,
    trust: F64,
    history: F64,
    slack: F64,
) -> tuple[int, int, int, float, float, int, int, float, float]:
    """Register samples (points, gradients) with a reference, Eq. (13)-(14), from the best start.

    Stage 0 matches by the robust criterion until the steps fall below ``switch_px``, stage 1 by
    the normal one until they fall below ``stop_px`` (§V-B) and ``stop_share`` of the scale, or
    leave less than ``leave_px`` to go.
    Where a map of edges nearby is given they are looked up first: few samples, no search; and
    stage 0 follows only if that does not converge. A step counts by the rms change of the
    residuals that it predicts. Writes T, H (weights included), index (of the matches among the
    reference edges, NO_MATCH where none), residuals (packed, in sample order), trust and history, a
    row an iteration: stage, matches, sigma, cost, step, damping, accepted, cost of the trial.
    In the last stage edges whose profile has changed from what is ``known`` of their match, where
    both are given, count less: sigma is that of residuals times their ``trust`` (N,), 1 elsewhere.
    A step all but equal to one that was rejected is not tried again, and has that one's cost.
    A step that goes on as the one before is stretched by what that one has left over, and, where
    there is a map, so is the first that is rejected; rejected itself, it is tried as it was.
    Points of the current depth image pull towards planes of the reference, where there are any:
    their term has a scale of its own, sigma_d, and counts less the more that exceeds the sensor's
    noise, since such errors are not independent of one another. Short steps of the last stage leave
    each point on its plane. H and b stay in px^2. Where depth was not taken at the instant of the
    image it moves with the pose by less, or by more, and so does the row of a sample (``lag``); and
    both may lie elsewhere, by their shares of one slack that the steps are solved for with the
    pose, and which costs the more the surer it is that they do not. Writes slack, (6,); H is what
    edges tell wherever their rows were, and depth as far as it gives way.
    Where profiles are compared, samples count less in the last stage that it says are smeared.
    Returns why it stopped, iterations, number of matches, sigma and cost; then the number of
    points with a plane, how many of them are no outliers by sigma_d, that, and what their term
    counted.
    """
    n = points.shape[0]
    matches, trial = new_matches(n), new_matches(n)
    trial_residuals = np.empty(n)
    b, step, last, went, longer = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    m = surface.sigma.size
    near, near_trial = new_plane_matches(m), new_plane_matches(m)
    H_planes, b_planes = np.zeros((6, 6)), np.zeros(6)
    near_count, sigma_d, balance = 0, 1.0, 0.0
    gives = lag.steady.size > 0  # the camera may not have gone on as it went
    clear(slack)
    slack_trial, room = np.zeros(6), np.zeros((4, 6, 6))
    C, K, g = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    C_rows, K_rows, couples, coupled_at = np.zeros((6, 6)), np.zeros((6, 6)), False, 0.0
    whole, counts, scale = np.zeros((6, 6)), 0.0, 0.0
    best = best_start(
        grid,
        nearby,
        points,
        gradients,
        camera,
        starts,
        robust if first_stage == ROBUST else normal,
        solver,
        stride,
        matches,
        trial,
        residuals,
    )
    put_square(starts[best], T)
    reason, iterations, count = EXHAUSTED, 0, 0
    rolls = lag.rows.size > 0
    moved = np.empty_like(points) if rolls else points
    there, trial_there = np.empty((4, 4)), np.empty((4, 4))
    sigma, cost, total = 1.0, 0.0, 0.0
    moves = 1 + lag.share  # by how much points move with the pose, near the last one
    settled = False  # by looking up: the robust criterion has nothing left to do
    started = False  # the first stage goes on from the matches of the best start, by its criterion
    usual = no_change()
    has_profiles = known.size > 0 and profiles.size > 0 and solver.profile_spread > 0
    for stage in range(LOOK_UP, last_stage + 1):
        if stage < first_stage and (stage > LOOK_UP or nearby.keys.size == 0):
            continue
        if stage == ROBUST and stage < last_stage and settled:
            continue
        criterion = normal if stage == NORMAL else robust
        enough = solver.stop_px if stage == last_stage else solver.switch_px
        every, apart = ALL, ALL
        if stage == LOOK_UP:
            every = max(np.int64(n // solver.coarse_samples), ALL)
            apart = solver.coarse_points
        elif stage < last_stage and solver.first_samples > 0:
            every = max(np.int64(n // solver.first_samples), ALL)
            apart = max(np.int64(m // solver.first_points), ALL)
        taken, asked = (n + every - 1) // every, len(range(0, m, apart))
        for i in range(n):
            if i % every > 0:
                matches.edge[i] = NO_MATCH  # of a stage that took others
        if started:
            clear(matches.bound)  # what held under one criterion need not under another
        started = True
        if rolls:
            unroll_points(points, T, lag, slack, moved)
        count = warp_and_match(
            grid,
            nearby,
            stage,
            moved,
            gradients,
            every,
            camera,
            T,
            criterion,
            solver.residual,
            matches,
            residuals,
        )
        compares = has_profiles and stage == last_stage
        if compares:
            spread = solver.profile_spread
            usual = usual_change(grid.order, known, profiles, gradients, matches, spread)
            trust_matches(
                grid.order, known, profiles, gradients, usual, lag.sharp, matches, residuals
            )
        if m > 0:
            there = product(exp_se3(lag.bend * slack), lagged(T, lag))
            near_count = match_planes(planes, surface, camera, there, term, near, apart)
        damping = solver.damping
        rejections, rejected, its_cost = 0, 0.0, 0.0
        sigma_d, balance, believed = 1.0, 0.0, np.float64(0.0)
        stale, follows, leaps = True, False, False
        coupled_at = 0.0  # the scale; what rows couple hardly changes as long as that does not
        before = 0.0  # what the last step has changed, if it was taken as it was
        reason = EXHAUSTED
        budget = solver.max_iterations
        if stage == LOOK_UP:
            budget //= 2  # exact matches have to follow
        while iterations < budget:
            if count * every < solver.min_matches:
                reason = TOO_FEW
                break
            if stale:
                sigma = scale_of(residuals, count, sigma, solver)
                if stage < last_stage:
                    sigma = max(sigma, solver.first_sigma)
                sigma = min(sigma, solver.max_sigma)
                cost = mean_cost(residuals, count, taken, sigma, criterion.limit, solver)
                couples = lag.bends.size > 0 and abs(sigma - coupled_at) > SAME_SCALE * coupled_at
                coupled_at = sigma if couples else coupled_at
                total = normal_equations(
                    camera,
                    solver,
                    sigma,
                    matches,
                    residuals,
                    lag.bends,
                    couples,
                    H,
                    b,
                    C_rows,
                    K_rows,
                    g,
                )
                put_square(C_rows, C)
                put_square(K_rows, K)
                balance, scale = 0.0, 0.0
                if near_count * apart >= term.min_points:
                    sigma_d = median_scale(near.residuals, near_count, MIN_PLANE_SIGMA)
                    balance = term.weight / (1 + sigma_d / term.doubt)
                    balance *= 1 + (term.edge_doubt / sigma) ** 2
                    balance = min(balance, term.most)
                    cost += apart * balance / n * plane_cost(near, near_count, asked, sigma_d)
                    plane_equations(near, near_count, sigma_d, H_planes, b_planes)
                    scale = apart * balance * (sigma / sigma_d) ** 2 / every
                    for i in range(6):
                        pull = scale * b_planes[i]
                        b[i] += moves * pull
                        g[i] += lag.bend * pull
                        for j in range(6):
                            told = scale * moves * H_planes[i, j]
                            H[i, j] += moves * told
                            C[i, j] += lag.bend * told
                            K[i, j] += lag.bend * lag.bend * scale * H_planes[i, j]
                if gives and balance == 0 and lag.bends.size == 0:
                    clear(slack)  # of a stage whose depth counted
                if gives:
                    counts = (sigma**2 + term.edge_doubt**2) / every
                    for i in range(6):
                        for j in range(6):
                            K[i, j] += counts * lag.steady[i, j]
                            g[i] += counts * lag.steady[i, j] * slack[j]
                    put_square(H, whole)
                    give_way(C, K, g, room, H, b)
                    believed = 0.5 / n * (1 + (term.edge_doubt / sigma) ** 2)
                    cost += believed * product_in(lag.steady, slack, slack)
                stale = False
            if not solve_damped(H, b, damping, step):
                if lag.bends.size > 0 and not couples:  # of weights that are no longer so
                    stale, coupled_at = True, 0.0
                    continue
                reason = SINGULAR
                break
            change = np.sqrt(max(product_in(H, step, step), 0.0) / max(total, 1e-30))
            row = history[iterations]
            row[0], row[1], row[2], row[3] = stage, count, sigma, cost
            row[4], row[5], row[6], row[7] = change, damping, 0, np.nan
            iterations += 1
            trial_T = product(exp_se3(step), T)
            left = max(left_to_go(change, before), change / 2)
            if stage == last_stage and solver.stop_share > 0:
                enough = min(solver.stop_px, solver.stop_share * sigma)
            if change < enough or (stage == last_stage and left < solver.leave_px * min(sigma, 1)):
                # too small a step to be worth a trial
                put_square(trial_T, T)
                if gives:
                    yielded(slack, room, step, slack_trial)
                    put(slack_trial, slack)
                row[6] = 1
                reason = CONVERGED
                break
            stretches = leaps
            if leaps:
                for i in range(6):
                    longer[i] = solver.max_stretch * step[i]
            elif follows and change > STRETCHED_PX:
                stretches = stretch_step(H, step, last, went, solver.max_stretch, longer)
            if stretches:
                trial_T = product(exp_se3(longer), T)
            if rejections > 0 and not stretches and change > (1 - SAME_STEP) * rejected:
                row[7] = its_cost  # the same step would be rejected again
            else:
                copy_matches(matches, trial)
                if gives:
                    yielded(slack, room, longer if stretches else step, slack_trial)
                if rolls:
                    unroll_points(points, trial_T, lag, slack_trial, moved)
                trial_count = warp_and_match(
                    grid,
                    nearby,
                    stage,
                    moved,
                    gradients,
                    every,
                    camera,
                    trial_T,
                    criterion,
                    solver.residual,
                    trial,
                    trial_residuals,
                )
                if compares:
                    trust_matches(
                        grid.order,
                        known,
                        profiles,
                        gradients,
                        usual,
                        lag.sharp,
                        trial,
                        trial_residuals,
                    )
                row[7] = mean_cost(
                    trial_residuals, trial_count, taken, sigma, criterion.limit, solver
                )
                near_trial_count = near_count
                if m > 0:
                    trial_there = lagged(trial_T, lag)
                    if gives:
                        trial_there = product(exp_se3(lag.bend * slack_trial), trial_there)
                    short = change * (solver.max_stretch if stretches else 1.0) < solver.kept_px
                    if stage == last_stage and short:
                        on = product(trial_there, inverted(there))
                        carry_points(near, near_count, on, near_trial)
                    else:
                        near_trial_count = match_planes(
                            planes, surface, camera, trial_there, term, near_trial, apart
                        )
                if balance > 0:
                    off = plane_cost(near_trial, near_trial_count, asked, sigma_d)
                    row[7] += apart * balance / n * off
                if gives:
                    row[7] += believed * product_in(lag.steady, slack_trial, slack_trial)
            if row[7] < cost:
                row[6] = 1
                before = 0.0 if stretches else change
                put(step, last)
                put(longer if stretches else step, went)
                follows = solver.max_stretch > 1
                put_square(trial_T, T)
                count = trial_count
                matches, trial = trial, matches
                put(trial_residuals, residuals)
                near, near_trial = near_trial, near
                near_count = near_trial_count
                if gives:
                    put(slack_trial, slack)
                if m > 0:
                    there = trial_there.copy()  # which may be the pose itself
                damping *= solver.damping_down
                rejections = 0
                stale, leaps = True, False
                if cost - row[7] < solver.stop_cost * cost:
                    reason = CONVERGED
                    break
            elif stretches:
                follows, leaps = False, False
            else:
                rejected, its_cost, before = change, row[7], 0.0
                damping *= solver.damping_up
                rejections += 1
                if lag.bends.size > 0 and not couples:
                    stale, coupled_at = True, 0.0
                leaps = rejections == 1 and nearby.keys.size > 0 and solver.max_stretch > 1
                if rejections > solver.max_rejections:
                    reason = STALLED
                    break
        settled = stage == LOOK_UP and reason == CONVERGED
        if reason in (TOO_FEW, SINGULAR) and stage > LOOK_UP:
            break
        if stage < last_stage and iterations >= solver.max_iterations:
            reason = EXHAUSTED  # the stage that finishes has had no turn
            if every > ALL:
                clear(matches.bound)
                if rolls:
                    unroll_points(points, T, lag, slack, moved)
                count = warp_and_match(
                    grid,
                    nearby,
                    stage,
                    moved,
                    gradients,
                    ALL,
                    camera,
                    T,
                    criterion,
                    solver.residual,
                    matches,
                    residuals,
                )
            if apart > ALL and m > 0:
                there = product(exp_se3(lag.bend * slack), lagged(T, lag))
                near_count = match_planes(planes, surface, camera, there, term, near)
            break
    orthonormalize(T)
    if lag.bends.size > 0 and whole[0, 0] > 0:  # rows tell what they tell, wherever they were
        for i in range(6):
            for j in range(6):
                C[i, j] = moves * lag.bend * scale * H_planes[i, j]
                K[i, j] = lag.bend**2 * scale * H_planes[i, j] + counts * lag.steady[i, j]
        give_way(C, K, g, room, whole, b)
        put_square(whole, H)
    packed = place(0)
    for i in range(n):
        k = matches.edge[i]
        index[i] = grid.order[k] if k >= 0 else NO_MATCH
        trust[i] = matches.trust[i] if k >= 0 else 1.0
        if k >= 0:
            residuals[packed] /= trust[i]
            packed += place(1)
    fitting = count_fitting(near.residuals, near_count, sigma_d)
    return reason, iterations, count, sigma, cost, near_count, fitting, sigma_d, balance


# ------------------------------------------------------------------------------------- chamfer


@compiled
def directions_of(gradients: F32, directions: I32) -> None:
    """Sort gradients into ``DIRECTIONS``."""
    for i in range(gradients.shape[0]):
        directions[i] = direction_of(gradients[i, 0], gradients[i, 1])


@lean
def take_from_beside(row: U8, beside: U8, straight: np.uint8, slant: np.uint8) -> None:
    """Raise a row of scores, but for its ends, to those of the row beside it less the way."""
    one, end = np.uint64(DIRECTIONS), np.uint64(row.size - DIRECTIONS)
    for j in range(one, end):
        near = max(beside[j], straight) - straight
        far = max(max(beside[j - one], beside[j + one]), slant) - slant
        row[j] = max(row[j], np.uint8(max(near, far)))


@lean
def take_from_before(row: U8, away: np.uint64, less: np.uint8, raised: U8) -> None:
    """Write the scores of a row raised to those ``away`` before them, less the way."""
    for j in range(away):
        raised[j] = row[j]
    for j in range(away, np.uint64(row.size)):
        raised[j] = max(row[j], np.uint8(max(row[j - away], less) - less))


@lean
def take_from_behind(row: U8, away: np.uint64, less: np.uint8, raised: U8) -> None:
    """Write the scores of a row raised to those ``away`` behind them, less the way."""
    end = np.uint64(row.size) - away
    for j in range(end):
        raised[j] = max(row[j], np.uint8(max(row[j + away], less) - less))
    for j in range(end, np.uint64(row.size)):
        raised[j] = row[j]


@lean
def take_from_along(row: U8, before: bool, straight: np.uint8, room: U8) -> None:
    """Raise the scores of a row, but for its ends, to those of all cells before, or behind.

    From one cell away, then from two, four and so on, which together is from any: so a vector at a
    time, not one cell after the other. ``room`` is for a row.
    """
    cells, reach = 1, 254 // np.int64(straight)
    last = np.uint64(row.size - DIRECTIONS)
    while cells <= reach and cells * DIRECTIONS < row.size:
        less, away = np.uint8(cells * np.int64(straight)), np.uint64(cells * DIRECTIONS)
        if before:
            take_from_before(row, away, less, room)
        else:
            take_from_behind(row, away, less, room)
        for j in range(np.uint64(DIRECTIONS), last):
            row[j] = room[j]
        cells *= 2


@compiled
def chamfer_scores(
    pixels: F32, gradients: F32, cell: float, straight: np.uint8, slant: np.uint8, scores: U8
) -> None:
    """Say how near an edge of like direction is, by a chamfer distance of two passes.

    ``scores`` (rows, cols, DIRECTIONS) is 0 at first and stays so in its outermost rows and
    columns; a step to the next cell costs ``straight``, one to a corner ``slant``. An edge counts
    for its own direction and for those beside it.
    """
    rows, cols = scores.shape[0], scores.shape[1]
    inverse = 1 / cell
    for i in range(pixels.shape[0]):
        col = min(max(int((pixels[i, 0] + 0.5) * inverse), 0), cols - 3) + 1
        row = min(max(int((pixels[i, 1] + 0.5) * inverse), 0), rows - 3) + 1
        k = direction_of(gradients[i, 0], gradients[i, 1])
        for alike in range(k - 1, k + 2):
            scores[row, col, alike % DIRECTIONS] = 255
    lanes = scores.reshape(rows, cols * DIRECTIONS)  # a vector holds all directions of some cells
    room = np.empty(cols * DIRECTIONS, np.uint8)
    for row in range(1, rows - 1):
        take_from_beside(lanes[row], lanes[row - 1], straight, slant)
        take_from_along(lanes[row], True, straight, room)
    for row in range(rows - 2, 0, -1):
        take_from_beside(lanes[row], lanes[row + 1], straight, slant)
        take_from_along(lanes[row], False, straight, room)


@lean_float
def chamfer_score(chamfer: Chamfer, T: F64, cells: I32) -> float:
    """Mean score, of 255, of the cells that the points fall into under a pose.

    The first ``cells.size`` points are asked, and that is room to work in: the first loop then
    runs on vectors.
    """
    camera, points, directions = chamfer.camera, chamfer.points, chamfer.directions
    high, wide = np.float32(chamfer.rows - 2), np.float32(chamfer.cols - 2)
    inverse = np.float32(1 / chamfer.cell)
    fx, fy = np.float32(camera.fx) * inverse, np.float32(camera.fy) * inverse
    cx, cy = np.float32(camera.cx + 0.5) * inverse, np.float32(camera.cy + 0.5) * inverse
    t00, t01, t02, t03 = (
        np.float32(T[0, 0]),
        np.float32(T[0, 1]),
        np.float32(T[0, 2]),
        np.float32(T[0, 3]),
    )
    t10, t11, t12, t13 = (
        np.float32(T[1, 0]),
        np.float32(T[1, 1]),
        np.float32(T[1, 2]),
        np.float32(T[1, 3]),
    )
    t20, t21, t22, t23 = (
        np.float32(T[2, 0]),
        np.float32(T[2, 1]),
        np.float32(T[2, 2]),
        np.float32(T[2, 3]),
    )
    zero, nearest = np.float32(0), np.float32(MIN_DEPTH)
    cols, in_view, total = np.int32(chamfer.cols), np.int32(0), np.int64(0)
    for i in range(cells.size):
        x, y, z = points[0, i], points[1, i], points[2, i]
        pz = t20 * x + t21 * y + t22 * z + t23
        u = fx * (t00 * x + t01 * y + t02 * z + t03) / pz + cx
        v = fy * (t10 * x + t11 * y + t12 * z + t13) / pz + cy
        inside = (pz > nearest) & (u >= zero) & (u < wide) & (v >= zero) & (v < high)
        row = np.int32(v if inside else zero) + np.int32(1)
        col = np.int32(u if inside else zero) + np.int32(1)
        cell = np.int32(DIRECTIONS) * (row * cols + col) + directions[i]
        cells[i] = cell if inside else np.int32(0)  # of the frame, where nothing is
        in_view += np.int32(inside)
    for i in range(cells.size):
        total += chamfer.scores[np.uint32(cells[i])]
    return float(total) / max(float(in_view), chamfer.least * cells.size, 1.0)


@compiled
def chamfer_sweep(chamfer: Chamfer, T: F64, twist: F64, step: float, scores: F64) -> None:
    """Score a pose and those beside it along a twist (6,) of the reference, ``step`` of it apart.

    ``scores`` (2 N + 1,) are of N poses behind, of ``T`` (4, 4) itself, and of N ahead.
    """
    cells = np.empty(chamfer.directions.size, np.int32)
    there = np.empty((4, 4))
    middle = scores.size // 2
    for k in range(scores.size):
        multiply(exp_se3(step * (k - middle) * twist), T, there)
        scores[k] = chamfer_score(chamfer, there, cells)


@compiled
def chamfer_search(
    chamfer: Chamfer,
    starts: F64,
    most_trace: float,
    apart_m: float,
    asked: int,
    step_m: float,
    step_rad: float,
    halvings: int,
    rounds: int,
    found: F64,
    scores: F64,
) -> int:
    """Climb from the best starts that are apart: by a trace below ``most_trace``, or ``apart_m``.

    The first quarter of the points tells which ``asked`` starts, or more that are as good, all of
    them judge. A climb tries a step to either side along each axis of the camera and about it,
    takes the best, at most ``rounds`` times, and goes on with steps half as long. Writes as many
    poses as ``found`` holds, and their scores, the best start first; returns how many.
    """
    values = np.empty(starts.shape[0])
    cells = np.empty(chamfer.directions.size, np.int32)
    bar = -1.0  # of the few, that is worth a closer look
    if starts.shape[0] > asked:
        few = cells[: (cells.size + 3) // 4]
        for s in range(starts.shape[0]):
            values[s] = chamfer_score(chamfer, starts[s], few)
        bar = select(values.copy(), values.size - asked)
    for s in range(starts.shape[0]):
        if starts.shape[0] <= asked or values[s] >= bar:
            values[s] = chamfer_score(chamfer, starts[s], cells)
        else:
            values[s] = -1.0
    count = 0
    for _ in range(starts.shape[0]):
        if count == found.shape[0]:
            break
        s = int(np.argmax(values))
        if values[s] < 0:
            break
        near = False
        for k in range(count):
            trace = 0.0
            for i in range(3):
                for j in range(3):
                    trace += starts[s, i, j] * found[k, i, j]
            away = 0.0
            for i in range(3):
                away += (starts[s, i, 3] - found[k, i, 3]) ** 2
            near = near or (trace > most_trace and away < apart_m * apart_m)
        if not near:
            put_square(starts[s], found[count])
            scores[count] = values[s]
            count += 1
        values[s] = -1.0
    steps = np.empty((12, 4, 4))
    twist = np.zeros(6)
    here, T = np.empty((4, 4)), np.empty((4, 4))
    for halving in range(halvings):
        for axis in range(6):
            length = (step_m if axis < 3 else step_rad) / 2**halving
            for side in range(2):
                twist[axis] = length if side else -length
                put_square(exp_se3(twist), steps[2 * axis + side])
            twist[axis] = 0
        for k in range(count):
            for _ in range(rounds):
                put_square(found[k], here)
                climbed = False
                for way in range(12):
                    multiply(here, steps[way], T)
                    score = chamfer_score(chamfer, T, cells)
                    if score > scores[k]:
                        scores[k], climbed = score, True
                        put_square(T, found[k])
                if not climbed:
                    break
    return count


# ---------------------------------------------------------------------------------- uncertainty


@compiled
def add_outer(vectors: F64, M: F64) -> None:
    """Add v v^T of each row to the lower triangle of M."""
    n = M.shape[0]
    for c in range(vectors.shape[0]):
        for i in range(n):
            if vectors[c, i] != 0:
                for j in range(i + 1):
                    M[i, j] += vectors[c, i] * vectors[c, j]


@lean
def cells_of_image(
    table: F64, n: np.uint64, camera: Pinhole, per_px: float, cols: int, count: int, cells: I32
) -> None:
    """Write into which square cell of an image each point of a table projects, or the nearest."""
    px, py, pz = table[POINT], table[POINT + 1], table[POINT + 2]
    fx, fy = camera.fx * per_px, camera.fy * per_px
    cx, cy = camera.cx * per_px, camera.cy * per_px
    for lane in range(n):
        u = min(max(fx * px[lane] / pz[lane] + cx, 0.0), float(cols - 1))
        v = min(max(fy * py[lane] / pz[lane] + cy, 0.0), float(count))
        cells[lane] = min(np.int32(v) * np.int32(cols) + np.int32(u), np.int32(count - 1))


@lean
def subtract_normals(
    matches: PlaneMatches, first: np.uint64, n: np.uint64, normals: F64, T: F64, table: F64, D: F64
) -> None:
    """Write what the normals of n planes are more than those of their points, turned by T.

    Both are over the noise.
    """
    x, y, z, size = D[3], D[4], D[5], table[SPARE]
    for lane in range(n):
        k = place(matches.point[first + lane])
        x[lane], y[lane], z[lane] = normals[k, 0], normals[k, 1], normals[k, 2]
    a, b, c = table[0], table[1], table[2]
    for lane in range(n):
        size[lane] = np.sqrt(a[lane] * a[lane] + b[lane] * b[lane] + c[lane] * c[lane])
    for axis in range(3):
        p, q, r = T[axis, 0], T[axis, 1], T[axis, 2]
        row, to = table[axis], D[axis]
        for lane in range(n):
            to[lane] = row[lane] - size[lane] * (p * x[lane] + q * y[lane] + r * z[lane])


@lean
def add_to_cells(table: F64, n: np.uint64, cells: I32, sums: F64) -> None:
    """Add what each of n columns has of a score to the sum (cells, 6) of its cell."""
    push = table[PUSH]
    for lane in range(n):
        c, along = place(cells[lane]), push[lane]
        for m in range(6):
            sums[c, m] += along * table[m, lane]


@lean
def multiply_rows(a: F64, b: F64, to: F64) -> None:
    """Write the products of two rows."""
    for lane in range(place(to.size)):
        to[lane] = a[lane] * b[lane]


@lean
def add_columns(
    table: F64,
    D: F64,
    n: np.uint64,
    inverse: float,
    weight: int,
    tuning: float,
    cells: I32,
    pairs: F64,
    blurs: F64,
    sums: F64,
) -> None:
    """Weigh n columns, and add them to H, to the blur by the differences D, and to their cells."""
    turn_rows(table, table)
    turn_rows(table, D)
    weigh(table, n, inverse, weight, tuning)
    add_pairs(table, table, pairs)
    add_pairs(D, table, blurs)
    add_to_cells(table, n, cells, sums)


@compiled
def score_parts(
    edges: F32,
    normals: F32,
    index: I32,
    trust: F64,
    points: F64,
    gradients: F32,
    noise: F64,
    camera: Pinhole,
    solver: Solver,
    sigma: float,
    planes: PlaneMap,
    surface: PlanePoints,
    term: DepthTerm,
    sigma_d: float,
    balance: float,
    T: F64,
    cell: float,
    H: F64,
    blur: F64,
    parts: F64,
    by_depth: F64,
) -> None:
    """Write the curvature H at T and what scatters the score J^T W r there, parts (4, 6, 6).

    Normals are noisy, and where all of them are parallel that noise alone looks like knowledge of
    what lies across them. ``blur`` is that part of H: the normals of the other image, that of
    ``gradients`` or of ``surface``, have noise of their own, so half of the square of what the two
    make of J differs by is, in the mean, what noise adds.

    Errors are taken to be shared within a square cell of the reference image and independent
    between cells. With s_c the sum over cell c, the parts are: the scores of edges that are
    observed, s(w J r); those of planes; that of depths which are off together by their ``noise``
    (N,), m; and the score of all edges at once, which that of the planes holds in balance. J and r
    of an edge are multiplied by its ``trust`` (N,), as in ``align``. H is in px^2, as is that of
    ``align``, and ``by_depth``, what planes add to it; parts are in px^4.
    """
    parts[:] = 0
    by_depth[:] = 0
    cols = int(camera.width / cell) + 1
    count = cols * (int(camera.height / cell) + 1)
    seen, flat, nearer = np.zeros((count, 6)), np.zeros((count, 6)), np.zeros((count, 6))
    table, D, cells = np.zeros((TABLE, LANES)), np.zeros((6, LANES)), np.empty(LANES, np.int32)
    pairs, blurs = np.zeros((PAIRS, LANES)), np.zeros((PAIRS, LANES))
    lane, last = place(0), index.size - 1
    roll = np.hypot(T[0, 0], T[1, 0])
    cosine, sine = T[0, 0] / roll, T[1, 0] / roll
    inverse = 1 / (sigma * sigma)
    for i in range(index.size):
        k = place(max(index[i], 0))
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        px, py, pz = qx + T[0, 3], qy + T[1, 3], qz + T[2, 3]
        if index[i] >= 0 and pz >= MIN_DEPTH:
            u = camera.fx * px / pz + camera.cx
            v = camera.fy * py / pz + camera.cy
            du, dv = u - edges[k, 0], v - edges[k, 1]
            if solver.residual == SIGNED:
                nu, nv = np.float64(normals[k, 0]), np.float64(normals[k, 1])
                r = du * nu + dv * nv
            else:
                r = np.sqrt(du * du + dv * dv)
                nu, nv = (du / r, dv / r) if r > 0 else (np.float64(0), np.float64(0))
            per_z = trust[i] / pz
            r *= trust[i]
            au, av = nu * camera.fx * per_z, nv * camera.fy * per_z
            aw = -(au * px + av * py) / pz
            gu = cosine * gradients[i, 0] - sine * gradients[i, 1]
            gv = sine * gradients[i, 0] + cosine * gradients[i, 1]
            side = 1.0 if gu * nu + gv * nv >= 0 else -1.0
            bu, bv = (nu - side * gu) * camera.fx * per_z, (nv - side * gv) * camera.fy * per_z
            table[0, lane], table[1, lane], table[2, lane] = au, av, aw
            table[POINT, lane], table[POINT + 1, lane], table[POINT + 2, lane] = px, py, pz
            table[RESIDUAL, lane] = r
            table[BY_DEPTH, lane] = noise[i] / z * (au * qx + av * qy + aw * qz)  # px
            D[0, lane], D[1, lane], D[2, lane] = bu, bv, -(bu * px + bv * py) / pz
            col = min(max(int(u / cell), 0), cols - 1)
            cells[lane] = min(max(int(v / cell), 0) * cols + col, count - 1)
            lane += place(1)
        if lane == place(LANES) or i == last:
            weight, tuning = solver.weight, solver.tuning
            add_columns(table, D, lane, inverse, weight, tuning, cells, pairs, blurs, seen)
            multiply_rows(table[WEIGHT], table[BY_DEPTH], table[PUSH])
            add_to_cells(table, lane, cells, nearer)
            lane = place(0)
    sum_pairs(pairs, 1.0, H)
    sum_pairs(blurs, 0.5, blur)
    if balance > 0:
        matches = new_plane_matches(surface.sigma.size)
        found = match_planes(planes, surface, camera, T, term, matches)
        scale = balance * (sigma / sigma_d) ** 2
        inverse = 1 / (sigma_d * sigma_d)
        pairs[:] = 0
        blurs[:] = 0
        for first in range(place(0), place(found), place(LANES)):
            at = place(first)
            n = min(place(found) - at, place(LANES))
            take_planes(matches, at, n, table)
            subtract_normals(matches, at, n, surface.normals, T, table, D)
            cells_of_image(table, n, camera, 1 / cell, cols, count, cells)
            add_columns(table, D, n, inverse, TUKEY, TUKEY_TUNING, cells, pairs, blurs, flat)
        blur_planes = np.empty((6, 6))
        sum_pairs(pairs, scale, by_depth)
        sum_pairs(blurs, 0.5 * scale, blur_planes)
        H += by_depth
        blur += blur_planes
        flat *= scale
    total = np.zeros((1, 6))
    for c in range(count):
        for m in range(6):
            total[0, m] += seen[c, m]
    add_outer(seen, parts[0])
    add_outer(flat, parts[1])
    add_outer(nearer, parts[2])
    add_outer(total, parts[3])
    for part in range(4):
        mirror_lower(parts[part])


@compiled
def combine_parts(
    H: F64, blur: F64, parts: F64, doubt: float, shares: F64, floor: float, prior: F64, C: F64
) -> bool:
    """Write (K S^-1 K + diag prior)^-1, with K = H - doubt blur and S = sum shares parts + floor.

    False where K is not positive definite: nothing is written then.
    """
    n = H.shape[0]
    L, K, S = np.empty((n, n)), np.empty((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            K[i, j] = H[i, j] - doubt * blur[i, j]
            for part in range(shares.size):
                S[i, j] += shares[part] * parts[part, i, j]
        S[i, i] += floor
    if not factorize(K, 0.0, L) or not factorize(S, 0.0, L):
        return False
    for i in range(n):
        solve_lower(L, K[i])  # a row of K is a column, too: now K holds (L^-1 K)^T
    for i in range(n):
        for j in range(n):
            S[i, j] = prior[i] if i == j else 0.0
            for k in range(n):
                S[i, j] += K[i, k] * K[j, k]
    if not factorize(S, 0.0, L):
        return False
    for i in range(n):
        C[i] = 0
        C[i, i] = 1
        solve_lower(L, C[i])
        solve_upper(L, C[i])
    for i in range(n):
        for j in range(i):
            C[i, j] = C[j, i] = 0.5 * (C[i, j] + C[j, i])
    return True


@lean
def shared_ratio(sums: F64, squares: float, count: float) -> float:
    """Squares of the sums over cells (u, v, how many) over those of what was summed, or NaN."""
    shared, pairs = 0.0, -count
    for c in range(sums.shape[0]):
        shared += sums[c, 0] * sums[c, 0] + sums[c, 1] * sums[c, 1]
        pairs += sums[c, 2] * sums[c, 2]
    if pairs < count or squares == 0:
        return np.nan
    return shared / squares


@compiled
def shared_factors(
    edges: F32,
    normals: F32,
    index: I32,
    residuals: F64,
    trust: F64,
    weight: int,
    tuning: float,
    sigma: float,
    cell: float,
    rows: int,
    cols: int,
    times: int,
) -> tuple[float, float]:
    """By what factor errors that are shared within a cell add to the variance of sums over it.

    ``index`` are the matches among ``edges`` and their ``normals``, ``residuals`` their distances,
    and ``trust`` t what `align` says. With s_c the sum of w t^2 r n over cell c, where w is the
    weight of t r, that is the sum of |s_c|^2 over that of (w t^2 r)^2: 1 where residuals are
    independent of one another, and the number in a cell where they are all the same. NaN where
    there are too few to a cell to tell: less than one pair an edge. The second one is that of cells
    which are so many ``times`` as wide and as high.
    """
    sums = np.zeros((rows * cols, 3))
    inverse, per_px = 1 / (sigma * sigma), 1 / cell
    squares, count = 0.0, 0.0
    for i in range(index.size):
        if index[i] < 0:
            continue
        k = place(index[i])
        r = trust[i] * residuals[i]
        w = robust_weight(r * r * inverse, weight, tuning)
        if w <= 0:
            continue
        push = w * trust[i] * r
        # an ideal pixel may lie outside the image
        row = min(max(int(edges[k, 1] * per_px), 0), rows - 1)
        col = min(max(int(edges[k, 0] * per_px), 0), cols - 1)
        c = place(row * cols + col)
        sums[c, 0] += push * normals[k, 0]
        sums[c, 1] += push * normals[k, 1]
        sums[c, 2] += 1
        squares += push * push
        count += 1
    across = (cols + times - 1) // times
    wide = np.zeros((across * ((rows + times - 1) // times), 3))
    for row in range(rows):
        for col in range(cols):
            to = (row // times) * across + col // times
            for m in range(3):
                wide[to, m] += sums[row * cols + col, m]
    return shared_ratio(sums, squares, count), shared_ratio(wide, squares, count)


@compiled
def shared_depth_factor(
    planes: PlaneMap,
    surface: PlanePoints,
    camera: Pinhole,
    T: F64,
    lag: Lag,
    term: DepthTerm,
    sigma_d: float,
    cell: float,
    rows: int,
    cols: int,
) -> float:
    """As ``shared_factors`` for the distances of points to planes, by Tukey's weights."""
    matches = new_plane_matches(surface.sigma.size)
    count = match_planes(planes, surface, camera, lagged(T, lag), term, matches)
    sums = np.zeros((rows * cols, 3))
    inverse, per_px = 1 / (sigma_d * sigma_d), 1 / cell
    squares, counted = 0.0, 0.0
    for i in range(count):
        r = matches.residuals[i]
        w = robust_weight(r * r * inverse, TUKEY, TUKEY_TUNING)
        if w <= 0:
            continue
        per_z = per_px / matches.Y[2, i]
        u = camera.fx * matches.Y[0, i] * per_z + camera.cx * per_px
        v = camera.fy * matches.Y[1, i] * per_z + camera.cy * per_px
        c = min(max(int(v), 0), rows - 1) * cols + min(max(int(u), 0), cols - 1)
        sums[c, 0] += w * r
        sums[c, 2] += 1
        squares += w * r * w * r
        counted += 1
    return shared_ratio(sums, squares, counted)


# -------------------------------------------------------------------------------------- witness


@compiled
def distorted(x: float, y: float, lens: Lens) -> tuple[float, float]:
    """Brown's model on normalised coordinates, as ``Camera.distort`` has it."""
    xx, yy, xy = x * x, y * y, x * y
    s = xx + yy
    radial = 1.0 + s * (lens.k1 + s * (lens.k2 + s * lens.k3))
    return (
        x * radial + 2.0 * lens.p1 * xy + lens.p2 * (s + 2.0 * xx),
        y * radial + lens.p1 * (s + 2.0 * yy) + 2.0 * lens.p2 * xy,
    )


@compiled
def mirrored(i: int, n: int) -> int:
    """Index of n that i stands for past either end, where the end itself is not repeated."""
    while n > 1 and not 0 <= i < n:
        i = -i if i < 0 else 2 * (n - 1) - i
    return i if n > 1 else 0


@compiled
def least_ahead(values: F32, wide: int, side: int) -> F32:
    """Least of the square that begins at each pixel of an image whose rows are ``wide``, flat.

    Squares that leave the image give anything. Overwrites its input.
    """
    spare = np.empty(values.size, np.float32)
    for stride in (1, wide):
        width = 1
        while width < side:  # the least of so many is that of two half as wide
            shift = min(width, side - width)
            ahead = values[shift * stride :]
            for i in range(ahead.size):
                spare[i] = ahead[i] if ahead[i] < values[i] else values[i]
            values, spare = spare, values
            width += shift
    return values


@compiled
def sum_ahead(values: I16, wide: int, side: int) -> I16:
    """Sum of the square that begins at each pixel; see `least_ahead`."""
    for stride in (1, wide):
        sums = values.copy()
        for k in range(1, side):
            ahead = values[k * stride :]
            for i in range(ahead.size):
                sums[i] += ahead[i]
        values = sums
    return values


@compiled
def surround(depth: F32, step: int, reach: int, kept: F32, near: F32, far: F32) -> None:
    """Keep every step-th depth, and the least and the greatest of the square round each.

    The square reaches ``reach`` of the kept depths to each side. Where a depth is missing itself,
    or in half of its square, the image mirrored at its border, ``near`` and ``far`` are 0.
    """
    rows, cols = kept.shape
    side, wide, high = 2 * reach + 1, cols + 2 * reach, rows + 2 * reach
    # with a margin all round, so that a square is what lies ahead of its first corner
    least = np.full((high, wide), np.float32(np.inf))
    most = np.zeros((high, wide), np.float32)  # depths with a minus, so that it is a least too
    there = np.empty((high, wide), np.int16)
    inside = slice(reach, reach + cols)  # slices: an index that is a sum keeps loops off vectors
    for r in range(rows):
        source = depth[step // 2 + r * step][step // 2 :]
        to, one, other = kept[r], least[r + reach][inside], most[r + reach][inside]
        i = place(0)
        for c in range(place(cols)):
            to[c] = source[i]
            i += place(step)
        for c in range(cols):
            z = to[c]
            one[c] = z if z > 0 else np.float32(np.inf)
            other[c] = -z
    for r in range(high):
        seen, line = kept[mirrored(r - reach, rows)], there[r]
        middle = line[inside]
        for c in range(cols):
            middle[c] = np.int16(1) if seen[c] > 0 else np.int16(0)
        for c in range(reach):
            line[c] = seen[mirrored(c - reach, cols)] > 0
            line[reach + cols + c] = seen[mirrored(cols + c, cols)] > 0
    below = least_ahead(least.reshape(-1), wide, side)
    above = least_ahead(most.reshape(-1), wide, side)
    count = sum_ahead(there.reshape(-1), wide, side)
    half = np.int16(side * side // 2)
    for r in range(rows):
        row = slice(r * wide, r * wide + cols)
        lower, upper, known, to, away = below[row], above[row], count[row], near[r], far[r]
        for c in range(cols):
            is_seen = (known[c] > half) & (kept[r, c] > 0)
            to[c] = lower[c] if is_seen else np.float32(0)
            away[c] = -upper[c] if is_seen else np.float32(0)


@compiled
def fill_gaps(depth: F32, filled: F32) -> None:
    """Copy depth, each gap in a row filled by the farther of the depths beside it.

    A near thing hides what is beside it from a sensor: behind lies what is farther. A gap that
    reaches the end of its row stays 0.
    """
    for r in range(depth.shape[0]):
        line, to = depth[r], filled[r]
        last = np.float32(0)
        for c in range(place(line.size)):
            if line[c] > 0:
                last = line[c]
            to[c] = last
        last = np.float32(0)
        for c in range(line.size - 1, -1, -1):
            if line[c] > 0:
                last = line[c]
            else:
                to[c] = max(to[c], last) if to[c] > 0 and last > 0 else np.float32(0)


@compiled
def nearer_sides(depth: F32, index: I32, reach: int, depths: F32) -> None:
    """Write the least depth of the square round each pixel, whose flat ``index`` is given.

    It reaches ``reach`` pixels to each side. 0 where one is missing, as beyond the border.
    """
    height, width = depth.shape
    for k in range(index.size):
        v, u = index[k] // width, index[k] % width
        inside = reach <= v < height - reach and reach <= u < width - reach
        near = np.float32(np.inf) if inside else np.float32(0)
        if inside:
            for r in range(v - reach, v + reach + 1):
                for c in range(u - reach, u + reach + 1):
                    near = min(near, depth[r, c])
        depths[k] = near


@compiled
def place_points(kept: F32, every: int, rays: F64, ring: I32, points: F64) -> int:
    """Write the points at every so manyth depth, given their rays; returns how many.

    A depth that neither of its neighbours along the row, or along the column, shares is left out:
    at contours sensors see what is not there. So is a stray one, by the ``ring`` of `is_stray`, of
    depths in ``kept``, and the same share between two surfaces.
    """
    count, i = 0, 0
    rows, cols = kept.shape
    for r in range(every // 2, rows, every):
        for c in range(every // 2, cols, every):
            z = np.float64(kept[r, c])
            across = abs(kept[r, max(c - 1, 0)] - z), abs(kept[r, min(c + 1, cols - 1)] - z)
            down = abs(kept[max(r - 1, 0), c] - z), abs(kept[min(r + 1, rows - 1), c] - z)
            is_shared = min(across) < SHARED_DEPTH * z and min(down) < SHARED_DEPTH * z
            if z > 0 and is_shared and not is_stray(kept, c, r, z, ring, SHARED_DEPTH):
                points[count, 0] = rays[i, 0] * z
                points[count, 1] = rays[i, 1] * z
                points[count, 2] = rays[i, 2] * z
                count += 1
            i += 1
    return count


@compiled
def warp_to_cells(
    points: F64,
    T: F64,
    camera: Pinhole,
    lens: Lens,
    step: int,
    rows: int,
    cols: int,
    z: F64,
    cell: I32,
    which: I32,
) -> int:
    """Warp points by T into an image, distorted where the lens does so, of cells ``step`` wide.

    Writes depth, flat cell and number of those that come to lie in one; returns how many.
    """
    bent = lens.k1 != 0 or lens.k2 != 0 or lens.p1 != 0 or lens.p2 != 0 or lens.k3 != 0
    count = 0
    for i in range(points.shape[0]):
        x, y, w = points[i, 0], points[i, 1], points[i, 2]
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * w + T[2, 3]
        if not pz > MIN_DEPTH:
            continue
        u = (T[0, 0] * x + T[0, 1] * y + T[0, 2] * w + T[0, 3]) / pz
        v = (T[1, 0] * x + T[1, 1] * y + T[1, 2] * w + T[1, 3]) / pz
        if bent:
            u, v = distorted(u, v, lens)
        u, v = u * camera.fx + camera.cx, v * camera.fy + camera.cy
        if 0 <= u < cols * step and 0 <= v < rows * step:
            z[count], which[count] = pz, i
            cell[count] = int(v / step) * cols + int(u / step)
            count += 1
    return count


@compiled
def count_in_front(z: F64, slack: F64, cell: I32, near: F32, far: F32) -> tuple[int, int]:
    """Count the points in front of the surface at their cells, and those in front or on it."""
    near, far = near.reshape(-1), far.reshape(-1)
    in_front, together = 0, 0
    for i in range(z.size):
        k = cell[i]
        if z[i] < near[k] - slack[i]:
            in_front += 1
            together += 1
        elif far[k] > 0 and z[i] <= far[k] + slack[i]:
            together += 1
    return in_front, together


@compiled
def find_far(points: F64, T: F64, others: F64, reach: float, is_far: NDArray[np.bool_]) -> None:
    """Say of points, moved by T, which are farther than ``reach`` from each of some others."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        least = np.inf
        for k in range(others.shape[0]):
            dx, dy, dz = px - others[k, 0], py - others[k, 1], pz - others[k, 2]
            least = min(least, dx * dx + dy * dy + dz * dz)
        is_far[i] = least > reach * reach


# ---------------------------------------------------------------------------- depth registration


# a division by zero is to give what the comparisons then drop, not to raise
@compiled_with(error_model="numpy")
def project_row(
    z: F64,
    rays: F64,
    row: int,
    col: int,
    shift: F64,
    camera: Pinhole,
    lens: Lens,
    fold: float,
    to: F64,
) -> None:
    """Write u, v and depth in another camera of points on a row of rays, from a column on.

    Where that camera does not see one, u is NaN; see `splat_depth`.
    """
    # contiguous, which lets the compiler take several at a time
    X, Y, Z = rays[0, row][col:], rays[1, row][col:], rays[2, row][col:]
    U, V, W = to[0], to[1], to[2]
    for c in range(z.size):
        W[c] = Z[c] * z[c] + shift[2]
        U[c] = (X[c] * z[c] + shift[0]) / W[c]
        V[c] = (Y[c] * z[c] + shift[1]) / W[c]
    if lens.k1 != 0 or lens.k2 != 0 or lens.p1 != 0 or lens.p2 != 0 or lens.k3 != 0:
        for c in range(z.size):
            x, y = U[c], V[c]
            bent = distorted(x, y, lens)
            U[c] = np.nan if x * x + y * y >= fold else bent[0]
            V[c] = bent[1]
    for c in range(z.size):
        U[c] = U[c] * camera.fx + camera.cx if W[c] > 0 else np.nan
        V[c] = V[c] * camera.fy + camera.cy


@compiled
def splat_depth(
    depth: F32,
    rays: F64,
    shift: F64,
    camera: Pinhole,
    lens: Lens,
    fold: float,
    largest: int,
    image: F32,
) -> None:
    """Write each depth into the pixels of another camera that it covers; the nearest wins.

    ``rays`` (3, H + 1, W + 1) are points of unit depth at the corners of the pixels, turned to
    that camera, and ``shift`` what they move by. Three corners span a parallelogram; depth goes
    to the pixels with their centres within its bounds, at most ``largest`` to a side. ``fold`` is
    the squared radius beyond which the lens has no image. ``image`` is 0 where none arrives.
    """
    height, width = image.shape
    last_u, last_v = width - 0.5, height - 0.5
    cols = depth.shape[1]
    z = np.empty(cols)
    origin, right, below = np.empty((3, cols)), np.empty((3, cols)), np.empty((3, cols))
    image[:] = np.float32(np.inf)
    for row in range(depth.shape[0]):
        put(depth[row], z)
        project_row(z, rays, row, 0, shift, camera, lens, fold, origin)
        project_row(z, rays, row, 1, shift, camera, lens, fold, right)
        project_row(z, rays, row + 1, 0, shift, camera, lens, fold, below)
        for c in range(cols):
            if not 0 < z[c] < np.inf:
                continue
            u, v = origin[0, c], origin[1, c]
            au, bu, av, bv = right[0, c] - u, below[0, c] - u, right[1, c] - v, below[1, c] - v
            # written so that what is no number stays none, and is then in no pixel
            low_u = u + (0.0 if au > 0 else au) + (0.0 if bu > 0 else bu)
            low_v = v + (0.0 if av > 0 else av) + (0.0 if bv > 0 else bv)
            high_u = u + (0.0 if au < 0 else au) + (0.0 if bu < 0 else bu)
            high_v = v + (0.0 if av < 0 else av) + (0.0 if bv < 0 else bv)
            if not (high_u > -0.5 and high_v > -0.5 and low_u < last_u and low_v < last_v):
                continue
            first_u, first_v = int(np.ceil(max(low_u, -0.5))), int(np.ceil(max(low_v, -0.5)))
            beyond_u = min(int(np.ceil(min(high_u, last_u))), first_u + largest)
            beyond_v = min(int(np.ceil(min(high_v, last_v))), first_v + largest)
            near = np.float32(0.5 * (right[2, c] + below[2, c]))
            for j in range(first_v, beyond_v):
                for i in range(first_u, beyond_u):
                    if near < image[j, i]:
                        image[j, i] = near
    for j in range(height):
        for i in range(width):
            if image[j, i] == np.inf:
                image[j, i] = np.float32(0)


# ------------------------------------------------------------------------------------- evidence


@compiled
def judge_matches(
    matches: I32,
    packed: F64,
    pixels: F32,
    reference: F32,
    gradients: F32,
    inlier: float,
    min_dot: float,
    residuals: F64,
    matched: F32,
) -> tuple[int, int]:
    """Spread the residuals of the matched samples over all, NaN where there is no match.

    So are the ``pixels`` of their matches. Returns how many residuals lie below ``inlier`` px, and
    of these those whose gradient times that of their match, a row of ``reference``, exceeds
    ``min_dot``.
    """
    least = np.float32(min_dot)
    inliers, agreeing, k = 0, 0, 0
    for i in range(matches.size):
        edge = matches[i]
        if edge < 0:
            residuals[i] = matched[i, 0] = matched[i, 1] = np.nan
            continue
        matched[i, 0], matched[i, 1] = pixels[edge, 0], pixels[edge, 1]
        residuals[i] = packed[k]
        k += 1
        if abs(residuals[i]) < inlier:
            inliers += 1
            along = reference[edge, 0] * gradients[i, 0]
            if along + reference[edge, 1] * gradients[i, 1] > least:
                agreeing += 1
    return inliers, agreeing


@compiled
def is_told(
    points: F64,
    gradients: F32,
    matches: I32,
    residuals: F64,
    trust: F64,
    camera: Pinhole,
    T: F64,
    solver: Solver,
    sigma: float,
    H: F64,
    enough: F64,
    times: float,
    told: F64,
    left: F64,
) -> bool:
    """Write what robust weights leave out of the curvature, J^T (w(0) - W) J, px^2.

    ``points`` (N, 3) are those of the samples, ``gradients`` (M, 2) those of the reference; the
    others are as `align` gives them. Writes ``told``, which is H and what is ``enough`` (6,) of
    each motion in units of ``sigma``, too. Returns whether that so many ``times`` is more than is
    left out, along each motion, or is no number; what is ``left`` is not written then.
    """
    square = sigma * sigma
    if not add_enough(H, square, enough, told):
        return True
    table, pairs = np.zeros((TABLE, LANES)), np.zeros((PAIRS, LANES))
    most = robust_weight(0.0, solver.weight, solver.tuning)
    lane, last = place(0), matches.size - 1
    for i in range(matches.size):
        k = place(max(matches[i], 0))
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if matches[i] >= 0 and pz >= MIN_DEPTH:
            table[0, lane], table[1, lane] = trust[i] * gradients[k, 0], trust[i] * gradients[k, 1]
            table[POINT, lane] = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            table[POINT + 1, lane] = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            table[POINT + 2, lane] = pz
            table[RESIDUAL, lane] = trust[i] * residuals[i]
            lane += place(1)
        if lane == place(LANES) or i == last:
            project_rows(table, camera.fx, camera.fy, lane)
            turn_rows(table, table)
            weigh(table, lane, 1 / square, solver.weight, solver.tuning)
            for j in range(lane):
                table[WEIGHT, j] = most - table[WEIGHT, j]
            add_pairs(table, table, pairs)
            lane = place(0)
    sum_pairs(pairs, 1.0, left)
    return is_more(told, times, left)


@lean
def add_enough(H: F64, square: float, enough: F64, told: F64) -> bool:
    """Write H and ``square`` times what is ``enough`` (6,) of each motion; say if all is finite."""
    is_number = True
    for m in range(6):
        for n in range(6):
            told[m, n] = H[m, n] + square * enough[m] if m == n else H[m, n]
            is_number &= np.isfinite(told[m, n])
    return is_number


@compiled
def is_more(told: F64, times: float, left: F64) -> bool:
    """Say whether so many ``times`` what is told is more than is left, along each motion."""
    rest = np.empty((6, 6))
    for m in range(6):
        for n in range(6):
            rest[m, n] = times * told[m, n] - left[m, n]
    return factorize(rest, 0.0, np.empty((6, 6)))


@lean
def rolled(T: F64, gu: float, gv: float) -> tuple[float, float]:
    """Roll a gradient as the camera has, about as those of a surface that it looks at do."""
    u, v = T[0, 0] * gu + T[0, 1] * gv, T[1, 0] * gu + T[1, 1] * gv
    length = np.sqrt(u * u + v * v)
    if not length > 0:
        return 0.0, 0.0
    return u / length, v / length


@lean
def write_own_row(
    x: float,
    y: float,
    z: float,
    gu: float,
    gv: float,
    camera: Pinhole,
    T: F64,
    rim: float,
    row: F64,
) -> bool:
    """Write what an edge tells of a motion by its own gradient, px; not in view it is 0.

    The gradient is that in the reference, which the edge is in view of if it is ``rim`` px from its
    border.
    """
    row[:] = 0
    px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
    if not pz >= MIN_DEPTH or (gu == 0 and gv == 0):
        return False
    u, v = camera.fx * px / pz + camera.cx, camera.fy * py / pz + camera.cy
    if not (rim < u < camera.width - 1 - rim and rim < v < camera.height - 1 - rim):
        return False
    au, av = gu * camera.fx / pz, gv * camera.fy / pz
    write_row(au, av, -(au * px + av * py) / pz, px, py, pz, row)
    return True


@lean
def is_in_place(
    gu: float, gv: float, k: int, gradients: F32, off_px: float, most_px: float, least_dot: float
) -> bool:
    """Say whether an edge has a match ``k``, near it and turned alike."""
    near = k >= 0 and abs(off_px) <= most_px
    return near and gu * gradients[k, 0] + gv * gradients[k, 1] >= least_dot


@compiled
def is_amiss(
    points: F64,
    own: F32,
    gradients: F32,
    matches: I32,
    residuals: F64,
    trust: F64,
    camera: Pinhole,
    T: F64,
    places: Places,
    solver: Solver,
    sigma: float,
    H: F64,
    enough: F64,
    times: float,
    told: F64,
    left: F64,
) -> bool:
    """Say whether edges in no place of theirs could tell more than ``times`` what is told.

    ``own`` (N, 2) are the unit gradients of the samples; for the others and ``told`` see `is_told`.
    Writes what is ``left``, px^2: the curvature of these edges, were they in their places, by their
    own gradients. Nothing is amiss where H is no number.
    """
    if not add_enough(H, sigma * sigma, enough, told):
        return False
    most = robust_weight(0.0, solver.weight, solver.tuning)
    J, count = np.empty(6), 0
    left[:] = 0
    for i in range(matches.size):
        gu, gv = rolled(T, own[i, 0], own[i, 1])
        off = trust[i] * residuals[i]
        if is_in_place(gu, gv, matches[i], gradients, off, places.most_px, places.least_dot):
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not write_own_row(x, y, z, gu, gv, camera, T, places.rim_px, J):
            continue
        count += 1
        for m in range(6):
            for n in range(m + 1):
                left[m, n] += most * J[m] * J[n]
    mirror_lower(left)
    return count > 0 and not is_more(told, times, left)


@compiled
def add_own_rows(points: F64, own: F32, camera: Pinhole, solver: Solver, told: F64) -> None:
    """Write what edges tell of a motion of their own camera, each at full weight, px^2.

    ``points`` (N, 3) and ``own`` (N, 2) are those of the samples, as in `is_amiss`.
    """
    most = robust_weight(0.0, solver.weight, solver.tuning)
    J, T = np.empty(6), np.eye(4)
    told[:] = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not write_own_row(x, y, z, own[i, 0], own[i, 1], camera, T, -np.inf, J):
            continue
        for m in range(6):
            for n in range(m + 1):
                told[m, n] += most * J[m] * J[n]
    mirror_lower(told)


@compiled
def find_amiss(
    points: F64,
    own: F32,
    gradients: F32,
    matches: I32,
    residuals: F64,
    trust: F64,
    camera: Pinhole,
    T: F64,
    places: Places,
    rows: F64,
    amiss: U8,
) -> None:
    """Tell which edges are in no place of theirs; for the parameters see `is_amiss`.

    Writes what each tells of a motion into ``rows`` (N, 6), 0 where it is not in view of the
    reference; and 1 into ``amiss`` (N,) where it is in view and not in its place, else 0.
    """
    for i in range(matches.size):
        gu, gv = rolled(T, own[i, 0], own[i, 1])
        off = trust[i] * residuals[i]
        in_place = is_in_place(gu, gv, matches[i], gradients, off, places.most_px, places.least_dot)
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        in_view = write_own_row(x, y, z, gu, gv, camera, T, places.rim_px, rows[i])
        amiss[i] = in_view and not in_place


# ----------------------------------------------------------------------------- what stands still


@compiled
def weigh_points(
    points: PlanePoints,
    planes: PlaneMap,
    camera: Pinhole,
    T: F64,
    fits: float,
    min_dot: float,
    behind: float,
    held: I32,
    broken: I32,
) -> None:
    """Count for each point whether it lies on what another image shows, or contradicts it.

    Warped by T it is ``held`` where it lies on the plane that it projects onto, within ``fits``
    times the noise and turned alike, and ``broken`` where it does not, unless it is so far behind
    that it was hidden. The warp is that of ``match_planes``, written out: in a function of its own,
    which would take tuples of arrays, it costs three times as much.
    """
    inverse = 1 / planes.step
    for i in range(points.sigma.size):
        x, y, z = points.X[i, 0], points.X[i, 1], points.X[i, 2]
        px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if pz < MIN_DEPTH:
            continue
        col = int(np.floor((camera.fx * px / pz + camera.cx) * inverse + 0.5))
        row = int(np.floor((camera.fy * py / pz + camera.cy) * inverse + 0.5))
        if not (0 <= col < planes.cols and 0 <= row < planes.rows):
            continue
        k = row * planes.cols + col
        if planes.offsets[k] == 0:
            continue
        nx, ny, nz = planes.normals[k, 0], planes.normals[k, 1], planes.normals[k, 2]
        mx, my, mz = points.normals[i, 0], points.normals[i, 1], points.normals[i, 2]
        dot = nx * (T[0, 0] * mx + T[0, 1] * my + T[0, 2] * mz)
        dot += ny * (T[1, 0] * mx + T[1, 1] * my + T[1, 2] * mz)
        dot += nz * (T[2, 0] * mx + T[2, 1] * my + T[2, 2] * mz)
        along = nx * px + ny * py + nz * pz
        slack = fits * points.sigma[i] * max(abs(along) / pz, 0.1)
        if dot >= min_dot and abs(along - planes.offsets[k]) < slack:
            held[i] += 1
        elif along > 0 and pz * planes.offsets[k] / along > pz - behind:
            broken[i] += 1


@compiled
def ask_neighbours(
    points: PlanePoints,
    held: I32,
    broken: I32,
    camera: Pinhole,
    step: float,
    reach: int,
    slack: float,
    slack_sigma: float,
    X: F64,
    still: NDArray[np.bool_],
) -> None:
    """Say which of the places X lie on surfaces that stand still, by the points around them.

    Points within ``reach`` cells of ``step`` px count whose plane X lies on. They stand still
    where more of them were held than broken.
    """
    rows, cols = int(camera.height / step) + 1, int(camera.width / step) + 1
    at = np.full((rows, cols), -1, np.int32)
    for i in range(points.sigma.size):
        z = points.X[i, 2]
        col = int((camera.fx * points.X[i, 0] / z + camera.cx) / step)
        row = int((camera.fy * points.X[i, 1] / z + camera.cy) / step)
        if 0 <= col < cols and 0 <= row < rows:
            at[row, col] = i
    for k in range(X.shape[0]):
        x, y, z = X[k, 0], X[k, 1], X[k, 2]
        col = int((camera.fx * x / z + camera.cx) / step)
        row = int((camera.fy * y / z + camera.cy) / step)
        pro, contra = 0, 0
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            for c in range(max(col - reach, 0), min(col + reach + 1, cols)):
                i = at[r, c]
                if i < 0:
                    continue
                away = points.normals[i, 0] * (x - points.X[i, 0])
                away += points.normals[i, 1] * (y - points.X[i, 1])
                away += points.normals[i, 2] * (z - points.X[i, 2])
                if abs(away) < slack + slack_sigma * points.sigma[i]:
                    pro += held[i]
                    contra += broken[i]
        still[k] = pro > contra


@compiled
def edges_without_depth(
    index: I32, depth: F32, stride: int, reach: int, step: int, chosen: I32
) -> int:
    """Write which edges, of every stride-th, have no depth around; returns how many."""
    height, width = depth.shape
    count = 0
    for k in range(0, index.size, stride):
        v, u = index[k] // width, index[k] % width
        bare = True
        for r in range(max(v - reach, 0), min(v + reach + 1, height), step):
            for c in range(max(u - reach, 0), min(u + reach + 1, width), step):
                if depth[r, c] > 0:
                    bare = False
        if bare:
            chosen[count] = k
            count += 1
    return count


@compiled
def fit_rays(
    grid: Grid,
    rays: F64,
    gradients: F32,
    camera: Pinhole,
    T: F64,
    criterion: Criterion,
    inverse_depths: F64,
    fits_px: float,
    fits: F64,
) -> None:
    """Say of edges of unknown depth how well they fit the reference at several inverse depths.

    From 1 down to 0 at ``fits_px``, by the square; ``criterion`` says how near an edge has to be,
    and how it may be turned. A row of ``fits`` for each inverse depth.
    """
    for k in range(inverse_depths.size):
        t = inverse_depths[k]
        for i in range(rays.shape[0]):
            x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
            px = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3] * t
            py = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3] * t
            pz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3] * t
            fits[k, i] = 0.0
            if pz < MIN_DEPTH:
                continue
            u, v = camera.fx * px / pz + camera.cx, camera.fy * py / pz + camera.cy
            if not (-0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5):
                continue
            gu, gv = gradients[i, 0], gradients[i, 1]
            m, _, _ = nearest_in_grid(grid, u, v, gu, gv, criterion, NO_MATCH, FIRST_REACH)
            if m >= 0:
                r = (u - grid.points[m, 0]) * grid.points[m, 2]
                r += (v - grid.points[m, 1]) * grid.points[m, 3]
                fits[k, i] = max(1.0 - (r / fits_px) ** 2, 0.0)
