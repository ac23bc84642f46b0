"""Plain NumPy twins of the tracker's kernels: what each of them computes, without its haste.

Twins of `kernels.student_scale`, `median_scale` and `robust_weight` live in `edvo.robust`, that
of matching in `edvo.matching.match_all_pairs`, that of `exp_se3` in `edvo.se3`.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from edvo import kernels, robust, se3
from edvo.edges import NO_PROFILES

MASK = (1 << 64) - 1
NAMES = {code: name for name, code in robust.WEIGHTS.items()}


# ---------------------------------------------------------------------------------------- edges


def collect_edges(mask):
    return np.flatnonzero(mask).astype(np.int32)


def parabola_at(dx, dy, u, v):
    """Of the Gaussian through three gradients: along which axis, first and second differences.

    And the logarithm of the one in the middle, NaN where there is no Gaussian.
    """
    height, width = dx.shape
    if not (0 < u < width - 1 and 0 < v < height - 1):
        return 0, 0.0, 0.0, np.nan
    g = np.array([dx[v, u], dy[v, u]], np.float64)
    around = np.stack((dx, dy), axis=-1)[v - 1 : v + 2, u - 1 : u + 2].astype(np.float64) @ g
    across = int(abs(g[1]) > abs(g[0]))
    left, middle, right = around.sum(axis=across)
    height = np.nan
    if min(left, middle, right) > 0:
        left, middle, right = np.log([left, middle, right])
        height = middle
    return across, left - right, left - 2 * middle + right, height


def offset_of(dx, dy, u, v):
    """From a pixel to its edge, (2,): the vertex of a Gaussian along the row or the column."""
    across, skew, bend, _ = parabola_at(dx, dy, u, v)
    offset = np.zeros(2)
    if bend < -kernels.FLAT:
        offset[across] = np.clip(skew / (2 * bend), -1, 1)
    return offset


def profile_of(dx, dy, u, v):
    """Logarithm of the gradient where it is highest, and its second difference, (2,).

    The Gaussian is that of gradients times the one in the middle.
    """
    across, skew, bend, height = parabola_at(dx, dy, u, v)
    if np.isnan(height):
        return np.zeros(2)
    way = offset_of(dx, dy, u, v)[across]
    parabola = np.polynomial.Polynomial([height, -skew / 2, bend / 2])
    return np.array([parabola(way) - height / 2, bend])


def describe_edges(index, dx, dy, table=None, finely=False):
    """Ideal pixels, unit gradients, profiles; ``table`` (H, W, 2) or None for an ideal camera."""
    width = dx.shape[1]
    v, u = np.divmod(index.astype(np.int64), width)
    gradients = np.column_stack((dx[v, u], dy[v, u])).astype(np.float64)
    pixels = np.column_stack((u, v)).astype(np.float64)
    offsets = np.zeros_like(pixels)
    for k in range(len(index) if finely else 0):
        offsets[k] = offset_of(dx, dy, u[k], v[k])
    if table is not None:
        table = table.astype(np.float64)
        pixels = table[v, u]
        by_v, by_u = np.gradient(table, axis=(0, 1))
        # d ideal / d raw, rows the ideal axes; a gradient goes over by the inverse transpose
        jacobian = np.stack((by_u[v, u], by_v[v, u]), axis=-1)
        gradients = np.linalg.solve(jacobian.transpose(0, 2, 1), gradients[:, :, None])[:, :, 0]
        offsets = (jacobian @ offsets[:, :, None])[:, :, 0]
    profiles = [profile_of(dx, dy, u[k], v[k]) for k in range(len(index) if finely else 0)]
    unit = gradients / np.linalg.norm(gradients, axis=1, keepdims=True)
    return pixels + offsets, unit, np.array(profiles).reshape(-1, 2)


def depth_at(depth, u, v, radius, gap):
    window = depth[max(v - radius, 0) : v + radius + 1, max(u - radius, 0) : u + radius + 1]
    z = np.sort(window[window > 0]).astype(np.float64)
    if not len(z):
        return 0.0
    if z[-1] <= z[0] * (1 + gap):
        return float(z.mean())
    support = max(3, -(-len(z) // 5))
    for first in range(len(z) - support + 1):
        group = z[first:][z[first:] <= z[first] * (1 + gap)]
        if len(group) >= support:
            return float(group.mean())
    return 0.0


def plane_through(x, y, w):
    """Value at (0, 0), square of the rest, variance of the value, square of the slope."""
    A = np.column_stack([np.ones(len(x)), x, y])
    if len(x) < kernels.LEAST_PIXELS or np.linalg.matrix_rank(A) < 3:
        return 0.0, np.inf, np.inf, 0.0
    found = np.linalg.lstsq(A, w, rcond=None)[0]
    return (
        found[0],
        np.mean((A @ found - w) ** 2),
        np.linalg.inv(A.T @ A)[0, 0],
        found[1:] @ found[1:],
    )


def depth_across(depth, u, v, gu, gv, sigma, rough):
    """Depth of an edge by planes through what lies to either side of it; 0 for none."""
    height, width = depth.shape
    reach = kernels.ACROSS + kernels.HALF_LENGTH
    if not (reach <= u < width - 1 - reach and reach <= v < height - 1 - reach):
        return 0.0
    x, y = np.meshgrid(
        np.arange(-kernels.ACROSS, kernels.ACROSS + 1),
        np.arange(-kernels.HALF_LENGTH, kernels.HALF_LENGTH + 1),
    )
    col, row = np.floor(u + x * gu - y * gv + 0.5), np.floor(v + x * gv + y * gu + 0.5)
    w = depth[row.astype(int), col.astype(int)].astype(np.float64)
    x, y, w = x[w > 0], y[w > 0], w[w > 0]
    fits = [plane_through(x[part], y[part], w[part]) for part in (x > 0, x < 0, x > -9)]
    limits = (kernels.ONE_SIDE, kernels.ONE_SIDE, kernels.ONE_SURFACE)
    noises = [sigma**2 + slope * kernels.ROUNDING for *_, slope in fits]
    good = [
        off < limit**2 * noise and spread < 1 and np.sqrt(slope) < kernels.STEEP * rough
        for (_, off, spread, slope), limit, noise in zip(fits, limits, noises, strict=True)
    ]
    a, b, one = (fit[0] for fit in fits)
    if good[0] and good[1]:
        var_a, var_b = (fit[2] * noise for fit, noise in zip(fits[:2], noises[:2], strict=True))
        mean = (a / var_a + b / var_b) / (1 / var_a + 1 / var_b)
        if abs(a - b) >= kernels.STEPPED * np.sqrt(var_a + var_b):
            return min(a, b)
        bent = abs(mean - one) >= kernels.BENT / np.sqrt(1 / var_a + 1 / var_b)
        return one if good[2] and not bent else mean
    if good[2]:
        return one
    for fits_well, value, others in ((good[0], a, x < 0), (good[1], b, x > 0)):
        if fits_well and others.sum() < kernels.LEAST_PIXELS:
            return value
    return 0.0


def fit_edge_depths(pixels, gradients, index, depth, camera, T, radius, gap, sigma, given):
    """Depths of edges by their sides, else by the window; T is None where depth came at once."""
    found = given.astype(np.float64)
    height, width = depth.shape
    for k, i in enumerate(index):
        raw = np.array([i % width, i // width])
        ideal = np.array(pixels[k], np.float64)
        there = ideal
        if camera.is_distorted:
            there = raw + ideal - camera.undistortion_table()[raw[1], raw[0]]
        last = None
        for _ in range(1 if T is None else 2):
            by, dz = (np.zeros(2), 0.0) if T is None else shift(camera, ideal, found[k], T)
            if last is not None and (abs(by - last) < 0.5).all():
                break
            last = by
            u, v = there + by
            z = depth_across(depth, u, v, *map(float, gradients[k]), sigma[k], found[k] + dz)
            if z <= 0:
                col, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                if not (0 <= col < width and 0 <= row < height):
                    break
                z = depth_at(depth, col, row, radius, gap)
            if z <= 0 or not z - dz > kernels.MIN_DEPTH:
                found[k] = found[k] if T is not None else 0.0
                break
            found[k] = z - dz
    return found


def is_stray(depth, u, v, z, ring, gap):
    """Whether half of a ring, inside the image, has depth at least, and all of it behind z."""
    height, width = depth.shape
    col, row = u + ring[:, 0], v + ring[:, 1]
    inside = (col >= 0) & (col < width) & (row >= 0) & (row < height)
    there = depth[row[inside], col[inside]]
    known = there[there > 0].astype(float)
    return 2 * len(known) >= max(inside.sum(), 1) and (known > (1 + gap) * z).all()


def drop_strays(pixels, index, depth, camera, T, ring, gap, given):
    """Depths of edges, 0 for those that are stray."""
    found = given.copy()
    for k, i in enumerate(index):
        if given[k] > 0:
            by, dz = shift(camera, np.array(pixels[k], np.float64), float(given[k]), T)
            u, v = np.floor(np.array([i % depth.shape[1], i // depth.shape[1]]) + by + 0.5)
            if is_stray(depth, int(u), int(v), given[k] + dz, ring, gap):
                found[k] = 0
    return found


def depths_at(depth, index, radius, gap):
    width = depth.shape[1]
    return np.array([depth_at(depth, int(i) % width, int(i) // width, radius, gap) for i in index])


# ------------------------------------------------------------------------------------- sampling


class Splitmix:
    """Splitmix64 (Steele, Lea, Flood 2014) over Python's integers."""

    def __init__(self, seed):
        self.state = seed & MASK

    def next(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & MASK
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
        return z ^ (z >> 31)

    def pop(self, pool):
        """Swap a random entry to the front, then take it off."""
        self.to_front(pool, 0)
        return pool.pop(0)

    def to_front(self, pool, first):
        """Swap a random entry of those from ``first`` on to their front."""
        k = first + self.next() % (len(pool) - first)
        pool[first], pool[k] = pool[k], pool[first]


def draw_samples(index, depths, shape, cell, per_cell, count, seed):
    """Positions in ``index`` of the samples; ``depths`` (N,) are those of all edges."""
    height, width = shape
    cols, rows = -(-width // cell), -(-height // cell)
    pools = [[] for _ in range(rows * cols)]
    for i, flat in enumerate(index.tolist()):
        pools[flat // width // cell * cols + flat % width // cell].append(i)
    source = Splitmix(seed)
    drawn, seen = [], set()
    cells = list(range(rows * cols))
    left = list(cells)
    while left:
        pool, taken = pools[source.pop(left)], 0
        while pool and taken < per_cell and len(drawn) < count:
            i = source.pop(pool)
            seen.add(i)
            if depths[i] > 0:
                drawn.append(i)
                taken += 1
    rest = [i for pool in pools for i in pool]
    while rest and len(drawn) < count:
        i = source.pop(rest)
        if depths[i] > 0:
            drawn.append(i)
    return np.array(sorted(drawn), np.int32)


def draw_informative(index, du, dv, depths, camera, worth, cell, tried, count, seed):
    """Positions in ``index`` of the samples that tell most; ``depths`` (N,) are those of all."""
    v, u = np.divmod(index.astype(np.int64), camera.width)
    gradients = np.column_stack((du[v, u], dv[v, u])).astype(np.float64)
    normals = gradients / np.linalg.norm(gradients, axis=1, keepdims=True)
    rays = np.column_stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, u * 0 + 1))
    rows, cols, lines = worth.shape
    directions = np.empty(len(index), np.int32)
    kernels.directions_of(gradients.astype(np.float32), directions)
    w = worth[v * rows // camera.height, u * cols // camera.width, directions % lines]
    J = np.zeros((len(index), 6))
    for i in np.flatnonzero(depths > 0):
        X, z = rays[i] * depths[i], depths[i]
        pi = np.array([[camera.fx / z, 0, -camera.fx * X[0] / z**2],
                       [0, camera.fy / z, -camera.fy * X[1] / z**2]])  # fmt: skip
        a = pi.T @ normals[i]
        J[i] = [*a, *np.cross(X, a)]
    wide = -(-camera.width // cell)
    left = {}
    for i, c in enumerate((v // cell * wide + u // cell).tolist()):
        left.setdefault(c, []).append(i)
    source, drawn, known = Splitmix(seed), [], np.eye(6) / kernels.PRIOR
    turns = sorted(left)
    while turns and len(drawn) < count:
        for turn in range(len(turns)):
            source.to_front(turns, turn)
            if len(drawn) == count:
                break
            edges, shown = left[turns[turn]], 0
            while shown < min(tried, len(edges)):
                source.to_front(edges, shown)
                if depths[edges[shown]] > 0:
                    shown += 1
                else:
                    edges[shown] = edges[0]
                    edges.pop(0)
            if shown:
                gains = [np.linalg.slogdet(known + w[i] * np.outer(J[i], J[i]))[1]
                         for i in edges[:shown]]  # fmt: skip
                best = int(np.argmax(gains))
                chosen, edges[best] = edges[best], edges[0]
                edges.pop(0)
                drawn.append(chosen)
                known += w[chosen] * np.outer(J[chosen], J[chosen])
        turns = [c for c in turns if left[c]]
    return np.array(sorted(drawn), np.int32)


# ------------------------------------------------------------------------------------- matching


def check_tree(tree):
    """Assert that each node splits its range at the median, by its axis."""
    todo = [(0, len(tree.points))]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        middle = (first + last) // 2
        axis = tree.axis[middle]
        pivot = tree.points[middle, axis]
        assert (tree.points[first:middle, axis] <= pivot).all()
        assert (tree.points[middle + 1 : last, axis] >= pivot).all()
        todo += [(first, middle), (middle + 1, last)]


# --------------------------------------------------------------------------------- robust costs


def cost(normalized, function, tuning):
    """Loss whose derivative is weight x residual; residuals in units of their scale."""
    square = np.asarray(normalized, np.float64) ** 2
    if function == "t":
        return 0.5 * (tuning + 1) * np.log1p(square / tuning)
    if function == "huber":
        size = np.sqrt(square)
        return np.where(size <= tuning, 0.5 * square, tuning * (size - 0.5 * tuning))
    if function == "cauchy":
        return 0.5 * tuning**2 * np.log1p(square / tuning**2)
    if function == "tukey":
        return tuning**2 / 6 * (1 - np.clip(1 - square / tuning**2, 0, None) ** 3)
    return 0.5 * square


def mean_cost(residuals, samples, sigma, limit, function, tuning):
    """Mean loss; a sample without a match costs as much as the worst match may."""
    total = cost(residuals / sigma, function, tuning).sum()
    missing = samples - len(residuals)
    if missing:
        total += missing * cost(np.sqrt(limit) / sigma, function, tuning)
    return float(total / samples)


# --------------------------------------------------------------------------------- registration


def orthonormal(T):
    """Gram-Schmidt on the first two columns of the rotation, the third by the cross product."""
    x = T[:3, 0] / np.linalg.norm(T[:3, 0])
    y = T[:3, 1] - x * (x @ T[:3, 1])
    y /= np.linalg.norm(y)
    result = T.copy()
    result[:3, :3] = np.column_stack((x, y, np.cross(x, y)))
    return result


def solve_damped(H, b, damping):
    return np.linalg.solve(H + damping * np.diag(np.diag(H)), -b)


@dataclass
class Warped:
    """Samples seen from the reference, and what they match there."""

    points: np.ndarray  # (N, 3) m
    pixels: np.ndarray  # (N, 2)
    matches: np.ndarray  # (N,) reference edge, -1 where none
    costs: np.ndarray  # (N,) px^2
    normals: np.ndarray  # (K, 2) of the matched ones
    residuals: np.ndarray  # (K,)

    @property
    def matched(self):
        return self.matches >= 0


def warp(points, camera, T):
    """Points and pixels in the reference camera (Eq. 1), and which of them it sees."""
    Y = points @ T[:3, :3].T + T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera.fx * Y[:, 0] / Y[:, 2] + camera.cx
        v = camera.fy * Y[:, 1] / Y[:, 2] + camera.cy
    seen = (
        (Y[:, 2] >= kernels.MIN_DEPTH)
        & (u >= -0.5)
        & (u < camera.width - 0.5)
        & (v >= -0.5)
        & (v < camera.height - 0.5)
    )
    return Y, np.column_stack((u, v)), seen


PAIRED = 16  # samples at a time: their pairs with every edge stay in the cache of a processor


def warp_and_match(edges, points, gradients, camera, T, criterion, signed=True):
    """Warp (Eq. 1), match by every pair (Eq. 6), take residuals (Eq. 10-12)."""
    Y, pixels, seen = warp(points, camera, T)
    matches, least = np.empty(len(points), np.int64), np.empty(len(points))
    x, y = edges.pixels.T.astype(np.float64)
    turned, known = gradients.astype(np.float64), edges.gradients.T.astype(np.float64)
    for first in range(0, len(points), PAIRED):
        some = np.s_[first : first + PAIRED]
        distance = (pixels[some, :1] - x) ** 2 + (pixels[some, 1:] - y) ** 2
        dot = turned[some] @ known
        costs = distance + criterion.direction * (dot - 1) ** 2
        costs[(distance > criterion.limit) | (dot < criterion.min_dot)] = np.inf
        costs[~seen[some]] = np.inf
        matches[some], least[some] = costs.argmin(axis=1), costs.min(axis=1)
    matches[np.isinf(least)] = -1
    matched = matches >= 0
    F = pixels[matched] - edges.pixels[matches[matched]]
    normals = edges.gradients[matches[matched]].astype(np.float64)
    if signed:
        residuals = (F * normals).sum(axis=1)
    else:
        residuals = np.linalg.norm(F, axis=1)
        normals = F / np.maximum(residuals, 1e-300)[:, None]
    return Warped(Y, pixels, matches, least, normals, residuals)


def jacobian(warped, camera):
    """Derivative of the residuals by a left perturbation of T, (K, 6)."""
    rows = []
    for Y, n in zip(warped.points[warped.matched], warped.normals, strict=True):
        x, y, z = Y
        project = np.array(
            [[camera.fx / z, 0, -camera.fx * x / z**2], [0, camera.fy / z, -camera.fy * y / z**2]]
        )
        rows.append(n @ project @ np.column_stack((np.eye(3), -se3.hat(Y))))
    return np.array(rows).reshape(-1, 6)


def scale(residuals, sigma, solver):
    """Scale by the rule that goes with the weight function, from the last one."""
    if NAMES[solver.weight] != "t":
        return max(robust.median_scale(residuals), solver.min_sigma)
    for _ in range(50):
        square = residuals**2
        weighted = square * (solver.tuning + 1) / (solver.tuning + square / sigma**2)
        new = max(float(np.sqrt(weighted.mean())), solver.min_sigma)
        if abs(new - sigma) < 1e-3 * sigma:
            return new
        sigma = new
    return sigma


def stretch_step(H, step, last, went, most):
    """Lengthen a step by what the one before it has left over; None: there is no telling."""
    change = step - last
    if not change @ H @ change > 0:
        return None
    mixed = step - (change @ H @ step) / (change @ H @ change) * (went + change)
    if mixed @ H @ step > 0:
        return mixed * min(1.0, most * np.sqrt((step @ H @ step) / (mixed @ H @ mixed)))
    return most * step if last @ H @ step > 0 else None


def usual_change(known, profiles, gradients, matches, spread):
    """By what profiles differ in the middle (4, 2), and by what more they halve a match (2,).

    The middle is that of edges of each direction, where some tell. Then the factor that makes the
    mean square of the trust 1, for each direction.
    """
    some = np.arange(0, len(profiles), max(len(profiles) // kernels.PROFILES, 1))
    some = some[matches[some] >= 0]
    change = profiles[some].astype(np.float64) - known[matches[some]]
    lines = directions_of(gradients[some]) % kernels.LINE_DIRECTIONS
    of_line = [lines == line for line in range(kernels.LINE_DIRECTIONS)]
    of_line = [which if which.sum() >= kernels.OF_A_LINE else lines >= 0 for which in of_line]
    middle = np.array([np.median(change[which], axis=0) for which in of_line])
    change = change - middle[lines]
    wide = spread * np.maximum(np.median(abs(change), axis=0), kernels.LEAST_CHANGE)
    squares = 1 / (1 + ((change / wide) ** 2).sum(axis=1))
    norm = np.array([1 / np.sqrt(squares[which].mean()) for which in of_line])
    return middle, wide, np.minimum(norm, kernels.MOST_TRUST)


def trust(known, profiles, gradients, matches, middle, wide, norm):
    """What each match is to be trusted, (N,); 1 where there is none."""
    lines = directions_of(gradients) % kernels.LINE_DIRECTIONS
    change = (profiles.astype(np.float64) - known[matches] - middle[lines]) / wide
    return np.where(matches >= 0, norm[lines] / np.sqrt(1 + (change**2).sum(axis=1)), 1.0)


def align(
    edges,
    points,
    gradients,
    camera,
    T,
    robust_criterion,
    normal_criterion,
    solver,
    profiles=NO_PROFILES,
    sharp=1.0,
):
    """Iterate Eq. (13)-(14) from T, through both stages; returns T, iterations and Warped."""
    function = NAMES[solver.weight]
    iterations, sigma = 0, 1.0
    first = len(points) // solver.first_samples if solver.first_samples else 1
    for criterion, enough, least, floor, every in (
        (robust_criterion, solver.switch_px, 0.0, solver.first_sigma, max(first, 1)),
        (normal_criterion, solver.stop_px, solver.stop_share, 0.0, 1),
    ):
        few, turned = points[::every], gradients[::every]

        compares = least > 0 and len(profiles) and solver.profile_spread
        change = []

        def look(
            pose, criterion=criterion, few=few, turned=turned, compares=compares, change=change
        ):
            signed = solver.residual == kernels.SIGNED
            seen = warp_and_match(edges, few, turned, camera, pose, criterion, signed)
            if compares:
                given = edges.profiles, profiles, gradients, seen.matches
                if not change:
                    change[:] = usual_change(*given, solver.profile_spread)
                counts = (sharp * trust(*given, *change))[seen.matched]
                seen.residuals = seen.residuals * counts
                seen.normals = seen.normals * counts[:, None]
            return seen

        def loss(seen, sigma, limit=criterion.limit, few=few):
            return mean_cost(seen.residuals, len(few), sigma, limit, function, solver.tuning)

        now, damping, rejections, accepted, way = look(T), solver.damping, 0, True, None
        while iterations < solver.max_iterations:
            if accepted:
                sigma = max(scale(now.residuals, sigma, solver), floor)
                sigma = min(sigma, solver.max_sigma)
                J = jacobian(now, camera)
                W = robust.weights(now.residuals / sigma, function, solver.tuning)
                H, b = J.T @ (W[:, None] * J), J.T @ (W * now.residuals)
            step = solve_damped(H, b, damping)
            change = np.sqrt(step @ H @ step / W.sum())
            iterations += 1
            if change < (min(enough, least * sigma) if least else enough):
                T = se3.exp(step) @ T
                break
            longer = None
            if way is not None and change > kernels.STRETCHED_PX:
                longer = stretch_step(H, step, *way, solver.max_stretch)
            taken = step if longer is None else longer
            trial_T = se3.exp(taken) @ T
            trial = look(trial_T)
            before, after = loss(now, sigma), loss(trial, sigma)
            accepted = after < before
            if accepted:
                T, now = trial_T, trial
                way = (step, taken) if solver.max_stretch > 1 else None
                damping, rejections = damping * solver.damping_down, 0
                if before - after < solver.stop_cost * before:
                    break
            elif longer is not None:
                way = None
            else:
                damping, rejections = damping * solver.damping_up, rejections + 1
                if rejections > solver.max_rejections:
                    break
    return T, iterations, now


# ----------------------------------------------------------------------------------- thresholds


def exceeded(counts, share):
    """Strength that this share of the pixels exceeds, at most."""
    as_strong = counts[::-1].cumsum()[::-1]
    return max(np.count_nonzero(as_strong > share * as_strong[0]) - 1, 0)


def undercut(counts, share):
    """Strength that this share of those above 0 stays below; 0 where there are none."""
    as_weak = counts[1:].cumsum()
    return np.searchsorted(as_weak, share * as_weak[-1]) + 0.5 if as_weak[-1] else 0.0


# -------------------------------------------------------------------------------- shared errors


def shared_factor(edges, normals, index, residuals, trust, weight, tuning, sigma, cell, rows, cols):
    """Sum of |s_c|^2 over that of (w r)^2, s_c the sum of w r n over a cell; NaN: too few."""
    given = index >= 0
    r, k = residuals[given], index[given]
    w = robust.weights(trust[given] * r / sigma, NAMES[weight], tuning) * trust[given] ** 2
    r, k, w = r[w > 0], k[w > 0], w[w > 0]
    cells = np.clip(edges[k].astype(float) // cell, 0, (cols - 1, rows - 1))
    _, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(counts), 2))
    np.add.at(sums, cell_of.ravel(), (w * r)[:, None] * normals[k])
    if (counts**2).sum() < 2 * len(k) or not (w * r).any():
        return np.nan
    return (sums**2).sum() / ((w * r) ** 2).sum()


def shared_factors(*arguments):
    """That of cells of so many pixels, and that of others so many times as wide."""
    *given, cell, rows, cols, times = arguments
    wide = -(-rows // times), -(-cols // times)
    return (
        shared_factor(*given, cell, rows, cols),
        shared_factor(*given, times * cell, *wide),
    )


def shared_depth_factor(planes, points, camera, T, term, sigma_d, cell, rows, cols):
    """Sum of s_c^2 over that of (w r)^2, s_c the sum of w r over a cell; NaN: too few."""
    _, Y, r = match_planes(planes, points, camera, T, term)
    w = robust.weights(r / sigma_d, "tukey", kernels.TUKEY_TUNING)
    Y, r, w = Y[w > 0], r[w > 0], w[w > 0]
    pixels = Y[:, :2] / Y[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    cells = np.clip(pixels // cell, 0, (cols - 1, rows - 1))
    _, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    if (counts**2).sum() < 2 * len(r) or not (w * r).any():
        return np.nan
    return (np.bincount(cell_of.ravel(), w * r) ** 2).sum() / ((w * r) ** 2).sum()


# -------------------------------------------------------------------------------------- witness


def least_ahead(image, side):
    """Least of the square that begins at each pixel, where the image holds all of it."""
    return np.lib.stride_tricks.sliding_window_view(image, (side, side)).min(axis=(2, 3))


def sum_ahead(image, side):
    return np.lib.stride_tricks.sliding_window_view(image, (side, side)).sum(axis=(2, 3))


def quiet_roughness(grey, step, share):
    """Quantiles of how rough pixels and sums of 2 x 2 pixels are, as if each had its whole bin."""
    weights = np.outer([1, -2, 1], [1, -2, 1])
    windows = np.lib.stride_tricks.sliding_window_view(grey.astype(int), (6, 6))[::step, ::step]
    sums = windows.reshape(*windows.shape[:2], 3, 2, 3, 2).sum(axis=(3, 5))
    asked = (sums > 4 * kernels.DARKEST) & (sums < 4 * kernels.BRIGHTEST)
    asked = asked.all(axis=(2, 3))
    found = []
    for each in (windows[..., 2:5, 2:5], sums):
        rough = np.minimum(np.abs((each * weights).sum(axis=(2, 3)))[asked], kernels.MOST_ROUGH)
        ends = np.concatenate(([0], np.bincount(rough).cumsum()))
        found.append(max(np.interp(share * len(rough), ends, np.arange(len(ends)) - 0.5), 0.0))
    return tuple(found)


def mean_steps(grey, apart, largest):
    """Mean steps between blocks of 8 x 8 pixels, and in the middle of those before them."""
    between, amid = [], []
    for image in (grey.astype(int), grey.astype(int).T):
        steps = np.minimum(np.abs(np.diff(image[apart // 2 :: apart], axis=1)), largest)
        between.append(steps[:, 7::8].ravel())
        amid.append(steps[:, 3::8][:, : steps[:, 7::8].shape[1]].ravel())
    return np.concatenate(between).mean(), np.concatenate(amid).mean()


def surround(depth, step, reach):
    """Every step-th depth, and least and greatest round it, where it is known and most of these."""
    side = 2 * reach + 1
    kept = np.ascontiguousarray(depth[step // 2 :: step, step // 2 :: step])
    there, window = kept > 0, np.ones((side, side), np.uint8)
    near = cv2.erode(np.where(there, kept, np.float32(np.inf)), window)
    far = cv2.dilate(kept, window)
    known = there & (cv2.boxFilter(there.astype(np.float32), -1, (side, side)) > 0.5)
    return kept, np.where(known, near, 0), np.where(known, far, 0)


def fill_gaps(depth):
    """Each row between its first depth and its last, gaps at the farther end of both."""
    filled = np.zeros_like(depth)
    for line, to in zip(depth, filled, strict=True):
        known = np.flatnonzero(line)
        for c in range(known.min(initial=len(line)), known.max(initial=-1) + 1):
            sides = line[known[known <= c].max()], line[known[known >= c].min()]
            to[c] = max(sides)
    return filled


def nearer_sides(depth, index, reach):
    beyond = np.pad(depth, reach)
    side = 2 * reach + 1
    pixels = zip(*np.unravel_index(index, depth.shape), strict=True)
    return np.array([beyond[v : v + side, u : u + side].min() for v, u in pixels], np.float32)


def place_points(kept, every, rays, ring):
    kept = kept.astype(float)
    around = np.pad(kept, 1, mode="edge")
    shares = [
        np.abs(side - kept) < kernels.SHARED_DEPTH * kept
        for side in (around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1])
    ]
    taken = (kept > 0) & (shares[0] | shares[1]) & (shares[2] | shares[3])
    for row, col in zip(*np.nonzero(taken), strict=True):
        taken[row, col] = not is_stray(kept, col, row, kept[row, col], ring, kernels.SHARED_DEPTH)
    taken, z = (image[every // 2 :: every, every // 2 :: every].ravel() for image in (taken, kept))
    return rays[taken] * z[taken, None]


def warp_to_cells(points, T, camera, step, rows, cols):
    X = points @ T[:3, :3].T + T[:3, 3]
    which = np.flatnonzero(X[:, 2] > kernels.MIN_DEPTH)
    X = X[which]
    z = X[:, 2]
    ideal = X[:, :2] / z[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    col, row = np.floor(camera.distort(ideal).T / step)
    inside = (col >= 0) & (row >= 0) & (col < cols) & (row < rows)
    return z[inside], (row * cols + col)[inside].astype(np.int32), which[inside]


def find_far(points, T, others, reach):
    moved = points @ T[:3, :3].T + T[:3, 3]
    away = np.linalg.norm(moved[:, None] - others, axis=-1)
    return away.min(axis=1, initial=np.inf) > reach


def count_in_front(z, slack, cell, near, far):
    near, far = near.ravel()[cell], far.ravel()[cell]
    in_front = z < near - slack
    hit = in_front | ((far > 0) & (z <= far + slack))
    return np.count_nonzero(in_front), np.count_nonzero(hit)


# ---------------------------------------------------------------------------- depth registration


def project_row(z, rays, shift, camera):
    """Pixels and depths in another camera of a row of points, (3, W), NaN where it sees none."""
    points = rays.T * z[:, None] + shift
    return np.column_stack((camera.project(points), points[:, 2])).T


def splat_depth(depth, rays, shift, camera, largest):
    """Depth in the view of another camera, to whose axes ``rays`` (3, H + 1, W + 1) are turned."""
    rows, columns = np.nonzero(np.isfinite(depth) & (depth > 0.0))
    z = depth[rows, columns].astype(np.float64)
    rays = np.moveaxis(rays, 0, 2)
    corners = np.stack((rays[rows, columns], rays[rows, columns + 1], rays[rows + 1, columns]))
    points = corners * z[:, None] + shift
    origin, right, below = camera.project(points.reshape(-1, 3)).reshape(3, -1, 2)
    along_u, along_v = right - origin, below - origin
    low = origin + np.minimum(along_u, 0.0) + np.minimum(along_v, 0.0)
    high = origin + np.maximum(along_u, 0.0) + np.maximum(along_v, 0.0)
    last = np.array([camera.width, camera.height]) - 0.5
    visible = ((high > -0.5) & (low < last)).all(axis=1)
    near = (0.5 * (points[1, :, 2] + points[2, :, 2]))[visible].astype(np.float32)
    first = np.ceil(np.maximum(low[visible], -0.5))
    beyond = np.ceil(np.minimum(high[visible], last))
    u, v = first.astype(np.intp).T
    count_u, count_v = np.minimum(beyond - first, largest).astype(np.intp).T
    image = np.full((camera.height, camera.width), np.inf, np.float32)
    for step_v in range(count_v.max(initial=0)):
        for step_u in range(count_u.max(initial=0)):
            hit = (step_u < count_u) & (step_v < count_v)
            np.minimum.at(image, (v[hit] + step_v, u[hit] + step_u), near[hit])
    image[np.isinf(image)] = 0.0
    return image


# ------------------------------------------------------------------------------------- evidence


def judge_matches(matches, packed, pixels, reference, gradients, inlier, min_dot):
    residuals, matched = np.full(len(matches), np.nan), np.full((len(matches), 2), np.nan)
    residuals[matches >= 0] = packed
    matched[matches >= 0] = pixels[matches[matches >= 0]]
    fits = np.abs(residuals) < inlier
    cosines = (reference[matches[fits]] * gradients[fits]).sum(axis=1)
    return np.count_nonzero(fits), np.count_nonzero(cosines > min_dot), residuals, matched


# ----------------------------------------------------------------------------- what stands still


def _project(camera, Y):
    return np.column_stack(
        [camera.fx * Y[:, 0] / Y[:, 2] + camera.cx, camera.fy * Y[:, 1] / Y[:, 2] + camera.cy]
    )


def weigh_points(points, planes, camera, T, fits, min_dot, behind):
    """Which points lie on the planes that they project onto, and which contradict them."""
    Y = points.X @ T[:3, :3].T + T[:3, 3]
    turned = points.normals @ T[:3, :3].T
    col, row = np.floor(_project(camera, Y) / planes.step + 0.5).astype(int).T
    inside = (Y[:, 2] > 0) & (col >= 0) & (row >= 0) & (col < planes.cols) & (row < planes.rows)
    k = np.where(inside, row * planes.cols + col, 0)
    inside &= planes.offsets[k] > 0
    along = (planes.normals[k] * Y).sum(axis=1)
    alike = (planes.normals[k] * turned).sum(axis=1) >= min_dot
    slack = fits * points.sigma * np.maximum(np.abs(along) / Y[:, 2], 0.1)
    held = inside & alike & (np.abs(along - planes.offsets[k]) < slack)
    ahead = np.where(along > 0, along, np.inf)
    near = (along > 0) & (Y[:, 2] * planes.offsets[k] / ahead > Y[:, 2] - behind)
    return held, inside & ~held & near


def ask_neighbours(points, held, broken, camera, step, reach, slack, slack_sigma, X):
    """Whether more of the points around each place, on whose plane it lies, are held."""
    cells = (_project(camera, points.X) / step).astype(int)
    still = []
    for x, cell in zip(X, (_project(camera, X) / step).astype(int), strict=True):
        around = (np.abs(cells - cell) <= reach).all(axis=1)
        away = np.abs(((x - points.X) * points.normals).sum(axis=1))
        around &= away < slack + slack_sigma * points.sigma
        still.append(held[around].sum() > broken[around].sum())
    return np.array(still)


def edges_without_depth(index, depth, stride, reach, step):
    """Which of every stride-th edges see no depth on a lattice around them."""
    height, width = depth.shape
    chosen = []
    for k in range(0, len(index), stride):
        v, u = divmod(int(index[k]), width)
        rows = np.arange(max(v - reach, 0), min(v + reach + 1, height), step)
        cols = np.arange(max(u - reach, 0), min(u + reach + 1, width), step)
        if not depth[np.ix_(rows, cols)].any():
            chosen.append(k)
    return np.array(chosen)


def fit_rays(edges, rays, gradients, camera, T, near_px, angle_deg, inverse_depths, fits_px):
    """How well each ray fits the nearest edge that is turned alike, at each inverse depth."""
    fits = np.zeros((len(inverse_depths), len(rays)))
    pixels, normals = edges.pixels.astype(np.float64), edges.gradients.astype(np.float64)
    alike = gradients.astype(np.float64) @ normals.T >= np.cos(np.radians(angle_deg))
    for row, nearness in zip(fits, inverse_depths, strict=True):
        Y = rays @ T[:3, :3].T + T[:3, 3] * nearness
        at = _project(camera, Y)
        inside = (Y[:, 2] > 0) & (at >= -0.5).all(axis=1)
        inside &= (at[:, 0] < camera.width - 0.5) & (at[:, 1] < camera.height - 0.5)
        away = np.linalg.norm(at[:, None] - pixels, axis=2)
        away[~alike | (away > near_px)] = np.inf
        best = away.argmin(axis=1)
        found = inside & np.isfinite(away.min(axis=1))
        r = ((at - pixels[best]) * normals[best]).sum(axis=1)
        row[found] = np.maximum(1 - (r[found] / fits_px) ** 2, 0)
    return fits


# ------------------------------------------------------------------------------------- chamfer


def directions_of(gradients):
    """Sort gradients into eighths of a full turn."""
    turns = np.arctan2(*gradients.T[::-1].astype(np.float64)) * (8 / (2 * np.pi))
    return np.floor(turns).astype(int) % 8


def mark_edges(pixels, gradients, shape):
    """For each pixel and direction, whether such an edge, or one beside it, is there or next to it.

    ``pixels`` are whole ones.
    """
    marks = np.zeros((*shape, kernels.DIRECTIONS), bool)
    for (x, y), k in zip(pixels, directions_of(gradients), strict=True):
        rows, cols = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        for beside in (-1, 0, 1):
            marks[rows, cols, (k + beside) % kernels.DIRECTIONS] = True
    return marks


def is_marked(marks, pixels, gradients):
    """Whether pixels that are inside have a mark of their direction."""
    x, y = np.floor(pixels.T + 0.5).astype(int)
    height, width, _ = marks.shape
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return inside & marks[y.clip(0, height - 1), x.clip(0, width - 1), directions_of(gradients)]


def stay_in_place(pixels, gradients, depths, camera, T, marks, least_px):
    """Which samples lie on a mark of their direction, which ought to have moved, or are sought."""
    Y = camera.backproject(pixels.astype(np.float64), depths.astype(np.float64))
    Y = Y @ T[:3, :3].T + T[:3, 3]
    there = camera.project(np.where(Y[:, 2:] < kernels.MIN_DEPTH, 1, Y))
    there[Y[:, 2] < kernels.MIN_DEPTH] = -1e6
    moves = abs(((there - pixels) * gradients).sum(axis=1)) >= least_px
    stays = is_marked(marks, pixels, gradients)
    return stays, moves, moves & ~is_marked(marks, there, gradients)


def count_stays(pixels, gradients, depths, camera, T, marks, least_px, counts, many):
    """Add to the counts (3, H, W) about edges at whole pixels, in their order."""
    stays, moves, sought = stay_in_place(pixels, gradients, depths, camera, T, marks, least_px)
    found, some, added = 0, [], np.zeros(counts.shape, bool)
    for i, (x, y) in enumerate(pixels.astype(int)):
        square = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        asked = i % kernels.ASKED == 0
        before = counts[0, y, x]
        if stays[i]:
            added[2][square] = True
        elif not asked and not before:
            continue
        if not moves[i] or depths[i] < kernels.MIN_DEPTH:
            continue
        own = stays[i] and sought[i]
        if asked and before < many:
            some.append(own)
        if own:
            added[0][square] = True
            found += before + 1 >= many
        elif not stays[i]:
            added[1][square] = True
    counts += added
    return found, sum(some), len(some) - sum(some)


def chamfer_scores(pixels, gradients, cell, straight, slant, shape):
    """Scores that no longer rise when each cell takes its neighbours' less the way."""
    rows, cols, _ = shape
    scores = np.zeros(shape, int)
    col, row = np.floor((pixels.T.astype(np.float64) + 0.5) / cell).astype(int)
    for beside in (-1, 0, 1):
        k = (directions_of(gradients) + beside) % 8
        scores[row.clip(0, rows - 3) + 1, col.clip(0, cols - 3) + 1, k] = 255
    while True:
        raised = scores.copy()
        for dv, du in [(dv, du) for dv in (-1, 0, 1) for du in (-1, 0, 1)]:
            cost = int(slant) if dv and du else int(straight) if dv or du else 0
            raised = np.maximum(raised, np.roll(scores, (dv, du), (0, 1)) - cost)
        raised[0], raised[-1], raised[:, 0], raised[:, -1] = 0, 0, 0, 0
        if (raised == scores).all():
            return scores
        scores = raised


def near_ways(pixels, gradients, corner, cell, shape):
    """Ways in quarters of a cell that no longer fall when each cell takes its neighbours'."""
    ways = np.full(shape, 1023)
    at = (pixels.astype(np.float64) - corner) / cell
    col, row = np.floor(at.T).astype(int)
    own = (4 * np.hypot(*(at - np.floor(at) - 0.5).T)).astype(int)
    for beside in (-1, 0, 1):
        k = (directions_of(gradients) + beside) % 8
        np.minimum.at(ways, (row + 1, col + 1, k), own)
    inside = np.zeros(shape, bool)
    inside[1:-1, 1:-1] = True
    while True:
        fallen = ways.copy()
        for dv, du in [(dv, du) for dv in (-1, 0, 1) for du in (-1, 0, 1)]:
            step = (0, 4, 6)[abs(dv) + abs(du)]
            fallen = np.minimum(fallen, np.roll(ways, (dv, du), (0, 1)) + step)
        fallen[~inside] = 1023
        if (fallen == ways).all():
            return ways
        ways = fallen


def chamfer_score(chamfer, T):
    """Mean score of the cells that the points fall into, in double precision."""
    Y = chamfer.points.T.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    ahead = Y[:, 2] > kernels.MIN_DEPTH
    u, v = np.floor((_project(chamfer.camera, Y[ahead]) + 0.5) / chamfer.cell).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < chamfer.cols - 2) & (v < chamfer.rows - 2)
    scores = chamfer.scores.reshape(chamfer.rows, chamfer.cols, -1)
    found = scores[v[inside] + 1, u[inside] + 1, chamfer.directions[ahead][inside]]
    return found.sum() / max(inside.sum(), chamfer.least * len(Y), 1)


def chamfer_search(
    glance, score, starts, most_trace, apart_m, asked, step_m, step_rad, halvings, rounds, count
):
    """The best starts that are apart, climbed from; poses and scores.

    ``score`` judges a pose, of those that ``glance`` finds best.
    """
    if len(starts) > asked:
        first = [glance(T) for T in starts]
        starts = starts[np.array(first) >= np.sort(first)[-asked]]
    found = []
    for s in np.argsort([-score(T) for T in starts], kind="stable"):
        near = [
            np.trace(starts[s][:3, :3].T @ T[:3, :3]) > most_trace
            and np.linalg.norm(starts[s][:3, 3] - T[:3, 3]) < apart_m
            for T in found
        ]
        if len(found) < count and not any(near):
            found.append(starts[s])
    sizes = np.repeat([step_m, step_rad], 3)
    for k, T in enumerate(found):
        for halving in range(halvings):
            steps = [se3.exp(sign * row) for row in np.diag(sizes) / 2**halving for sign in (-1, 1)]
            for _ in range(rounds):
                ways = [T, *(T @ step for step in steps)]
                T = ways[int(np.argmax([score(way) for way in ways]))]
        found[k] = T
    return found, [score(T) for T in found]


# --------------------------------------------------------------------- depth of another instant


def move_planes(T, normals, offsets, centres):
    """Planes and the points they were fitted round, moved by T; 0 stays no plane."""
    turned = normals @ T[:3, :3].T
    along = np.where(offsets > 0, turned @ T[:3, 3], 0.0)
    return turned, offsets + along, centres @ T[:3, :3].T + T[:3, 3]


def _shift(camera, raw, z, T):
    """By how much a raw pixel, (2,), moves, and its depth changes."""
    ideal = camera.undistortion_table()[raw[1], raw[0]] if camera.is_distorted else raw
    return shift(camera, ideal, z, T)


def shift(camera, ideal, z, T):
    """By how much an ideal pixel, (2,), moves, and its depth changes."""
    ray = np.array([(ideal[0] - camera.cx) / camera.fx, (ideal[1] - camera.cy) / camera.fy, 1.0])
    X = T[:3, :3] @ (ray * z) + T[:3, 3]
    there = np.array([camera.fx, camera.fy]) * X[:2] / X[2] + (camera.cx, camera.cy)
    return there - ideal, X[2] - z


def shift_nodes(depth, nodes, camera, T):
    """Where the surface lies that comes to each node."""
    moved = nodes.copy()
    height, width = depth.shape
    for k, (u0, v0) in enumerate(nodes):
        if not (0 <= u0 < width and 0 <= v0 < height):
            continue
        z = float(depth[v0, u0])
        for _ in range(2):
            if z <= 0:
                break
            by, dz = _shift(camera, nodes[k], z, T)
            u, v = np.floor(nodes[k] + by + 0.5).astype(int)
            moved[k] = u, v
            if not (0 <= u < width and 0 <= v < height):
                break
            z = float(depth[v, u]) - dz if depth[v, u] > 0 else 0.0
    return moved


def delayed_depths(index, depth, camera, T, radius, gap, given):
    """Depth of edges at flat indices, looked up where they were."""
    found = given.copy()
    height, width = depth.shape
    for k, i in enumerate(index):
        raw = np.array([i % width, i // width])
        for _ in range(2):
            by, dz = _shift(camera, raw, float(found[k]), T)
            u, v = np.floor(raw + by + 0.5).astype(int)
            if not (0 <= u < width and 0 <= v < height):
                break
            z = depth_at(depth, u, v, radius, gap)
            if z == 0 or not z - dz > kernels.MIN_DEPTH:
                break
            found[k] = z - dz
    return found


def match_planes(planes, points, camera, T, term):
    """Normals over noise, points in the reference camera, and distances over noise."""
    Y = points.X @ T[:3, :3].T + T[:3, 3]
    pixel = Y[:, :2] / Y[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    pixel[~np.isfinite(pixel)] = -1e6  # nowhere
    col, row = np.floor(pixel / planes.step + 0.5).astype(int).T
    inside = (col >= 0) & (col < planes.cols) & (row >= 0) & (row < planes.rows)
    k = np.where(inside, row * planes.cols + col, 0)
    normal = planes.normals[k]
    turned = points.normals @ T[:3, :3].T
    along = np.einsum("ij,ij->i", normal, Y)
    noise = points.sigma * np.maximum(np.abs(along) / Y[:, 2], 0.1)
    r = (along - planes.offsets[k]) / noise
    kept = inside & (planes.offsets[k] > 0) & (Y[:, 2] > kernels.MIN_DEPTH)
    kept &= (np.einsum("ij,ij->i", normal, turned) >= term.min_dot) & (np.abs(r) <= term.limit)
    return normal[kept] / noise[kept, None], Y[kept], r[kept]


def _derivative(Y, direction):
    """Of ``direction . Y`` by a left perturbation [v, w] of the pose, (N, 6)."""
    return np.hstack((direction, np.cross(Y, direction)))


def depth_equations(planes, points, camera, T, term, sigma, scale):
    normal, Y, r = match_planes(planes, points, camera, T, term)
    J = _derivative(Y, normal)
    w = robust.weights(r / sigma, "tukey", kernels.TUKEY_TUNING)
    return scale * J.T @ (w[:, None] * J), scale * J.T @ (w * r)


def descend_on_planes(planes, points, camera, term, basis, scale, solver, stop, T):
    """The pose at the end, how many steps were tried, and whether one was short enough to end."""

    def at(T):
        normal, Y, r = match_planes(planes, points, camera, T, term)
        return _derivative(Y, normal), r

    def total(r, sigma):
        losses = cost(r / sigma, "tukey", kernels.TUKEY_TUNING)
        return losses.sum() + (len(points.sigma) - len(r)) * kernels.TUKEY_TUNING**2 / 6

    damping, rejections = solver.damping, 0
    J, r = at(T)
    for step in range(solver.max_iterations):
        sigma = max(1.4826 * np.median(np.abs(r)), scale)
        w = robust.weights(r / sigma, "tukey", kernels.TUKEY_TUNING)
        A = J @ basis
        H = A.T @ (w[:, None] * A)
        along = -np.linalg.solve(H + damping * np.diag(np.diag(H)), A.T @ (w * r))
        trial = se3.exp(basis @ along) @ T
        its_J, its_r = at(trial)
        if total(its_r, sigma) < total(r, sigma):
            T, J, r = trial, its_J, its_r
            damping, rejections = damping * solver.damping_down, 0
            if np.abs(along).max() < stop:
                return T, step + 1, True
        else:
            damping, rejections = damping * solver.damping_up, rejections + 1
            if rejections > solver.max_rejections:
                return T, step + 1, False
    return T, solver.max_iterations, False


# --------------------------------------------------------------------------------------- blur


def blurred_gradients(grey, steps, passes=0):
    """Sobel's gradients of an image blurred by binomials, rounded to so many steps a grey level.

    Then it is blurred again, so many times, by weights two pixels apart.
    """
    wide = np.pad(grey.astype(int), 2, mode="reflect")
    weights, (height, width) = (1, 4, 6, 4, 1), grey.shape
    sums = sum(w * wide[i : i + height] for i, w in enumerate(weights))
    total = sum(w * sums[:, i : i + width] for i, w in enumerate(weights))
    image = np.floor(total * steps / 256 + 0.5).astype(int)
    for _ in range(passes):
        wide = np.pad(image, 2, mode="reflect")
        sums = wide[:-4] + 2 * wide[2:-2] + wide[4:]
        image = np.floor((sums[:, :-4] + 2 * sums[:, 2:-2] + sums[:, 4:]) / 16 + 0.5).astype(int)
    smooth = np.pad(image, 1, mode="reflect")
    across, down = smooth[:, 2:] - smooth[:, :-2], smooth[2:] - smooth[:-2]
    du = across[:-2] + 2 * across[1:-1] + across[2:]
    return du, down[:, :-2] + 2 * down[:, 1:-1] + down[:, 2:]


# -------------------------------------------------------------------------------- other places


def carry_edges(pixels, gradients, depths, profiles, T, camera):
    """Where edges are seen from another place, by the line that each stands on."""
    X = camera.backproject(pixels.astype(np.float64), depths.astype(np.float64))
    along = np.column_stack((-gradients[:, 1] / camera.fx, gradients[:, 0] / camera.fy))
    along = np.column_stack((along, np.zeros(len(along)))) * depths[:, None]
    Y, turned = X @ T[:3, :3].T + T[:3, 3], along @ T[:3, :3].T
    usable = (depths >= kernels.MIN_DEPTH) & (Y[:, 2] >= kernels.MIN_DEPTH)
    Y, turned = Y[usable], turned[usable]
    there = _project(camera, Y)
    seen = ((there >= 0) & (there <= (camera.width - 1, camera.height - 1))).all(axis=1)
    f = np.array([camera.fx, camera.fy])
    line = f * (turned[:, :2] - Y[:, :2] / Y[:, 2:] * turned[:, 2:]) / Y[:, 2:]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    across = np.column_stack((line[:, 1], -line[:, 0]))
    return there[seen], across[seen], Y[seen, 2], profiles[usable][seen]


# ------------------------------------------------------------------------------ rolling shutters


def roll(points, rows, twist, bends=0.0, slack=None):
    """Points moved by so much of one twist and of another, each its own shares, to first order."""
    moved = points + rows[:, None] * (twist[:3] + np.cross(twist[3:], points))
    if slack is not None:
        moved += bends[:, None] * (slack[:3] + np.cross(slack[3:], points))
    return moved


def unroll_pixels(pixels, depths, typical, rows, velocity, camera):
    """Pixels and depths of edges at the instant of the image."""
    z = np.where(depths > 0, depths, typical).astype(np.float64)
    rays = camera.backproject(pixels.astype(np.float64), np.ones(len(pixels)))
    rates = velocity[:3] / z[:, None] + np.cross(velocity[3:], rays)
    moved = rays + rows[:, None] * rates  # over the depth, which may be infinite
    near = (z < kernels.MIN_DEPTH) | (moved[:, 2] < 0.5)
    there, nearer = _project(camera, moved), depths * moved[:, 2]
    return np.where(near[:, None], pixels, there), np.where(near, depths, nearer)


def speeds_across(pixels, gradients, depths, velocity, camera):
    """How fast edges move along their gradients, px/s; without depth they are infinitely far."""
    rays = camera.backproject(pixels.astype(np.float64), np.ones(len(pixels)))
    far = depths < kernels.MIN_DEPTH
    nearness = np.where(far, 0.0, 1 / np.where(far, 1.0, depths.astype(np.float64)))
    moved = nearness[:, None] * velocity[:3] + np.cross(velocity[3:], rays)
    flow = (moved[:, :2] - rays[:, :2] * moved[:, 2:]) * (camera.fx, camera.fy)
    return (gradients * flow).sum(axis=1)


def smear_change(
    pixels,
    depths,
    gradients,
    profiles,
    key,
    own,
    matches,
    residuals,
    most_px,
    most_px2,
    velocity,
    key_velocity,
    camera,
):
    """How many edges tell, and by how much more those move and are wide that move the more."""
    found = (matches >= 0) & (matches < own) & (depths >= kernels.MIN_DEPTH)
    found &= abs(np.nan_to_num(residuals, nan=np.inf)) < most_px
    of = matches[found]
    strong = profiles[found, 0] >= np.median(profiles[found, 0])
    was = -1 / np.minimum(key.profiles[of, 1], -kernels.FLATTEST)
    strong &= was <= most_px2
    strong &= (gradients[found] * key.gradients[of]).sum(axis=1) >= kernels.TURNED_ALIKE
    z = depths[found]
    now = speeds_across(pixels[found], gradients[found], z, velocity, camera)
    then = speeds_across(key.pixels[of], key.gradients[of], z, key_velocity, camera)
    moves = ((now**2 - then**2) / 12)[strong]
    widens = (-1 / np.minimum(profiles[found, 1], -kernels.FLATTEST) - was)[strong]
    order, quarter = np.argsort(moves), len(moves) // 4
    least, most = order[:quarter], order[len(moves) - quarter :]
    return (
        len(moves),
        moves[most].mean() - moves[least].mean(),
        np.median(widens[most]) - np.median(widens[least]),
    )


def row_equations(
    pixels, depths, gradients, matches, residuals, trust, camera, T, weight, tuning, sigma
):
    """J^T W J times the row and times its square, and J^T W r times the row."""
    kept = matches >= 0
    Y = camera.backproject(pixels[kept].astype(np.float64), depths[kept].astype(np.float64))
    Y = Y @ T[:3, :3].T + T[:3, 3]
    (x, y, z), (nu, nv) = Y.T, gradients[matches[kept]].astype(np.float64).T
    along = np.column_stack(
        (nu * camera.fx / z, nv * camera.fy / z, -(nu * camera.fx * x + nv * camera.fy * y) / z**2)
    )
    J, r = _derivative(Y, along), residuals[kept]
    w = robust.weights(trust[kept] * r / sigma, weight, tuning) * trust[kept] ** 2
    row = pixels[kept, 1].astype(np.float64) / camera.height - 0.5
    H_row, H_rows = (J.T @ ((w * row**k)[:, None] * J) for k in (1, 2))
    return H_row, H_rows, J.T @ (w * row * r)


def filter_pose(P, T_cur_last, C, acceleration, seconds, off, velocity):
    """A Kalman filter of pose and velocity; P (12, 12). Gives P, the velocity, and the step."""
    one, none = np.eye(6), np.zeros((6, 6))
    carry = np.block([[se3.adjoint(T_cur_last), none], [none, one]])
    P = carry @ P @ carry.T
    F = np.block([[one, seconds * one], [none, one]])
    push = np.vstack((seconds**2 / 2 * one, seconds * one))
    P = F @ P @ F.T + push @ np.diag(acceleration) @ push.T
    gain = P[:, :6] @ np.linalg.inv(P[:6, :6] + C)
    step = gain @ off
    return P - gain @ P[:6], velocity + step[6:], step[:6]


def amiss(points, own, gradients, matches, off, camera, T, most_px, least_dot, rim):
    """Rows of the Jacobian by the samples' own gradients, and which are in no place of theirs."""
    rows, found = np.zeros((len(points), 6)), np.zeros(len(points), bool)
    for i, point in enumerate(points):
        P = T[:3, :3] @ point + T[:3, 3]
        g = T[:2, :2] @ own[i]
        if P[2] < kernels.MIN_DEPTH or not g.any():
            continue
        u, v = camera.fx * P[0] / P[2] + camera.cx, camera.fy * P[1] / P[2] + camera.cy
        if not (rim < u < camera.width - 1 - rim and rim < v < camera.height - 1 - rim):
            continue
        g = g / np.linalg.norm(g)
        by_pixel = np.array([[camera.fx, 0, -camera.fx * P[0] / P[2]]]) / P[2]
        by_pixel = np.concatenate(
            (by_pixel, np.array([[0, camera.fy, -camera.fy * P[1] / P[2]]]) / P[2])
        )
        rows[i] = g @ by_pixel @ np.hstack((np.eye(3), -se3.hat(P)))
        k = matches[i]
        found[i] = k < 0 or abs(off[i]) > most_px or g @ gradients[k] < least_dot
    return rows, found


def left_out(seen, camera, residuals, trust, weight, sigma):
    """What robust weights leave out of the curvature, J^T (w(0) - W) J."""
    J = trust[:, None] * jacobian(seen, camera)
    left = weight(np.zeros(1)) - weight(trust * residuals / sigma)
    return (J * left[:, None]).T @ J


def one_sided_rows(dv, step_v, step_u, least):
    """The lesser share of rows whose halves both lean down, or both up, as far as they tell."""
    half = dv.shape[1] // 2
    ways = []
    for row in dv[step_v // 2 :: step_v]:
        sides = []
        for side in (row[step_u // 2 : half : step_u], row[half::step_u]):
            down, up = np.count_nonzero(side > 0), np.count_nonzero(side < 0)
            if down + up >= least:
                sides.append((down >= 3 * up, up >= 3 * down))
        ways.append(np.all(sides, axis=0) if sides else (False, False))
    return np.mean(ways, axis=0).min() if ways else 0.0


def least_of_any(values, side):
    """A morphological opening."""
    window = np.ones((1, side), np.uint8)
    return cv2.dilate(cv2.erode(values[None], window), window)[0]


def row_slopes(grey, dv, step_v, step_u, least, n):
    raw, means = np.zeros(n), np.zeros(n)
    for k in range(n):
        v = k * step_v + step_v // 2
        light, gradient = (a[v, step_u // 2 :: step_u].astype(float) for a in (grey, dv))
        tells = (light > kernels.DARKEST) & (light < kernels.BRIGHTEST)
        if tells.sum() >= least:
            raw[k] = np.median(gradient[tells] / light[tells])
            means[k] = light[tells].mean()
    if n < kernels.BAND_ROWS:
        return np.zeros(n), 0.0
    up, down = (least_of_any(np.maximum(s * raw, 0), kernels.BAND_ROWS) for s in (1, -1))
    return up - down, (np.abs(up - down) * means).max()


def take_off_slopes(grey, slopes, step_v, dv):
    last = len(slopes) - 1
    at = ((np.arange(len(dv)) - step_v // 2) / step_v).clip(0, last)
    k = np.minimum(at.astype(int), max(last - 1, 0))
    rows = slopes[k] + (at - k) * (slopes[np.minimum(k + 1, last)] - slopes[k])
    share = np.float32(kernels.BAND_MARGIN * rows)[:, None]
    light = np.trunc(share * grey.astype(np.float32)).astype(int)
    less = np.where(share > 0, np.minimum(light, np.maximum(dv, 0)), 0)
    more = np.where(share < 0, np.maximum(light, np.minimum(dv, 0)), 0)
    return dv - less - more


def instants_part(
    H,
    by_rows,
    by_depth,
    T,
    own,
    key_velocity,
    own_changes,
    readout,
    readout_variance,
    delay,
    delay_variance,
    wrong_s2,
):
    """What instants add to a covariance: responses of the pose, times what these are off by."""
    carry = se3.adjoint(T)
    velocity, changes = carry @ own, carry @ own_changes @ carry.T
    apart, part = velocity - key_velocity, np.zeros((6, 6))
    for pushed, seconds, variance in (
        (by_rows, readout, readout_variance),
        (by_depth, delay, delay_variance),
    ):
        response = np.linalg.solve(H, pushed)
        twist = variance * np.outer(apart, apart) + 2 * seconds**2 * changes
        part += response @ twist @ response.T
    return part + wrong_s2 * (np.outer(velocity, velocity) + np.outer(key_velocity, key_velocity))
