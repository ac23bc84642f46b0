"""The renderer's compiled inner loops, and nothing else.

A ray is ``origin + t * direction`` with a direction whose component along the optical axis is 1,
so that ``t`` of the nearest hit is the depth z itself. Everything is float64 inside; each pixel is
computed on its own, so the image does not depend on how rows are shared among threads.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo.kernels import compiled_with

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]

PATCH, TRIANGLE, CYLINDER = 0, 1, 2
PLAIN, CHECKER, NOISE, TILES, BRICKS, BOOKS, WOOD, TEXT = range(8)
LEAF = 1
STACK = 64
BATCH = 256  # rays
MOST = 64  # primitives tried one by one; above it each ray walks the tree


compiled = compiled_with(error_model="numpy")


@compiled
def _whole(i: int) -> int:
    """Make an int64 of an int32 or a literal, for each of which a callee is compiled once more."""
    return np.int64(i)  # type: ignore[return-value]


class Solids(NamedTuple):
    """Everything that can be hit, as arrays over P primitives and M nodes of the tree.

    ``shape`` (P, 12) holds for a patch or triangle the plane ``n . p = d`` and the two dual
    vectors with ``u = a . p - a0``, ``v = b . p - b0``; for a cylinder base, radius, axis, length
    and the vector of angle zero. ``grain`` (P, 8) gives texture coordinates in metres in the same
    way. ``node`` (M, 6) is lower and upper corner, ``link`` (M, 2) is (first, count) of a leaf,
    (left child, 0) of an inner node whose right child follows the left.
    """

    kind: I32
    shape: F64
    grain: F64
    surface: I32
    thing: I32
    material: I32
    node: F64
    link: I32
    order: I32


class Paint(NamedTuple):
    """Materials, as arrays over the materials of the scene."""

    base: F64  # (K, 3) albedo
    other: F64  # (K, 3) albedo that the texture mixes in
    kind: I32  # (K,) texture
    size: F64  # (K, 4) metres along u and v, two parameters
    octaves: I32  # (K,)
    hue: I32  # (K,) 1 where each colour channel is drawn on its own
    seed: I32  # (K,)
    gloss: F64  # (K, 3) strength, exponent, glow


class Lamps(NamedTuple):
    """The light of one instant."""

    ambient: float
    lamp: F64  # (L, 8) kind (0 directional, 1 point), vector, intensity, size, shadows, unused


class Images(NamedTuple):
    """What is rendered, each over the whole image."""

    colour: F32  # (H, W, 3)
    depth: F32  # (H, W)
    normal: F32  # (H, W, 3) camera frame
    albedo: F32  # (H, W, 3)
    thing: I32  # (H, W)
    material: I32  # (H, W)
    key: I32  # (H, W) surface and shadow, to find the pixels to supersample


# --- textures ------------------------------------------------------------------------------------


@compiled
def _random(i: int, j: int, seed: int) -> float:
    """Give a number in [0, 1) for a lattice point."""
    h = np.uint64(np.int64(i) * 0x1F123BB5 + np.int64(j) * 0x5F356495 + np.int64(seed) * 0x6C8E9CF5)
    h = (h ^ (h >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(32))) * np.uint64(0x94D049BB133111EB)
    return float(h >> np.uint64(40)) / 16777216.0


@compiled
def _slope(i: int, j: int, seed: int, x: float, y: float) -> float:
    """Give the Perlin gradient of a lattice point times the offset from it."""
    k = int(_random(i, j, seed) * 8.0)
    if k < 4:
        return (x if k & 1 else -x) + (y if k & 2 else -y)
    s = 1.4142135623730951
    if k < 6:
        return s * (x if k & 1 else -x)
    return s * (y if k & 1 else -y)


@compiled
def _perlin(x: float, y: float, seed: int) -> float:
    """Give Perlin's gradient noise, about -1 to 1 (SIGGRAPH 2002)."""
    i, j = int(np.floor(x)), int(np.floor(y))
    x, y = x - i, y - j
    a = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    b = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    low = (1.0 - a) * _slope(i, j, seed, x, y) + a * _slope(i + 1, j, seed, x - 1.0, y)
    high = (1.0 - a) * _slope(i, j + 1, seed, x, y - 1.0)
    high += a * _slope(i + 1, j + 1, seed, x - 1.0, y - 1.0)
    return (1.0 - b) * low + b * high


@compiled
def _cloud(x: float, y: float, wx: float, wy: float, octaves: int, seed: int) -> float:
    """Sum octaves of noise to 0..1, each faded out before a pixel of width w cannot hold it."""
    total, weight, amplitude = 0.0, 0.0, 1.0
    w = max(wx, wy)
    for k in range(octaves):
        keep = min(max(0.5 / max(w, 1e-9) - 1.0, 0.0), 1.0)
        weight += amplitude * amplitude
        if keep == 0.0:
            break
        total += keep * amplitude * _perlin(x, y, seed + 101 * k)
        x, y, w, amplitude = 2.0 * x + 17.3, 2.0 * y + 5.9, 2.0 * w, 0.5 * amplitude
    return float(min(max(0.5 + 0.6 * total / np.sqrt(weight), 0.0), 1.0))


@compiled
def _wave(x: float, w: float) -> float:
    """Average a square wave of period 2 over a width w."""
    high, low = (x + 0.5 * w) % 2.0, (x - 0.5 * w) % 2.0
    area: float = (high if high < 1.0 else 2.0 - high) - (low if low < 1.0 else 2.0 - low)
    return area / w


@compiled
def _pulse(x: float, w: float, duty: float) -> float:
    """Average over a width w a pulse of period 1 that is 1 during its first ``duty``."""
    high, low = x + 0.5 * w, x - 0.5 * w
    area: float = np.floor(high) * duty + min(high - np.floor(high), duty)
    area -= np.floor(low) * duty + min(low - np.floor(low), duty)
    return area / w


@compiled
def _cells(x: float, y: float, wx: float, wy: float, seed: int) -> float:
    """Average over a pixel the random grey of unit cells."""
    fade = min(max(max(wx, wy) - 1.0, 0.0), 1.0)
    wx, wy = min(wx, 1.0), min(wy, 1.0)
    i, j = int(np.floor(x - 0.5 * wx)), int(np.floor(y - 0.5 * wy))
    a = min(max((x + 0.5 * wx - (i + 1)) / wx, 0.0), 1.0)
    b = min(max((y + 0.5 * wy - (j + 1)) / wy, 0.0), 1.0)
    grey = _random(i, j, seed) * (1.0 - a) * (1.0 - b)
    if a > 0.0:
        grey += _random(i + 1, j, seed) * a * (1.0 - b)
    if b > 0.0:
        grey += _random(i, j + 1, seed) * (1.0 - a) * b
        if a > 0.0:
            grey += _random(i + 1, j + 1, seed) * a * b
    return grey + fade * (0.5 - grey)


@compiled
def _tiles(x: float, y: float, wx: float, wy: float, octaves: int, seed: int) -> float:
    """Sum octaves of random cells to 0..1."""
    total, weight, amplitude = 0.0, 0.0, 1.0
    for k in range(octaves):
        total += amplitude * (_cells(x, y, wx, wy, seed + 211 * k) - 0.5)
        weight += amplitude * amplitude
        x, y, wx, wy = 2.7 * x + 0.31, 2.7 * y + 0.77, 2.7 * wx, 2.7 * wy
        amplitude *= 0.7
    return float(min(max(0.5 + total / np.sqrt(weight), 0.0), 1.0))


@compiled
def _books(x: float, y: float, wx: float, wy: float, seed: int, channel: int) -> float:
    """Draw spines of random width, height and grey, standing in rows of height 1."""
    row = int(np.floor(y))
    seed += 977 * row
    fade = min(max(wx - 1.0, 0.0), 1.0)
    wx = min(wx, 0.5)
    i = int(np.floor(x + 0.5))  # the border between spines i - 1 and i lies near i
    border = i + 0.6 * (_random(i, 7, seed) - 0.5)
    right = min(max((x + 0.5 * wx - border) / wx, 0.0), 1.0)
    grey = 0.0
    for k in range(2):
        share = right if k == 1 else 1.0 - right
        if share > 0.0:
            spine = i - 1 + k
            value = 0.15 + 0.85 * _random(spine, 11 + channel, seed)
            label = 0.25 + 0.4 * _random(spine, 3, seed)
            inside = _step(y - row - label, wy) - _step(y - row - label - 0.12, wy)
            value += inside * (0.95 - value) * (1.0 if _random(spine, 5, seed) > 0.4 else 0.0)
            top = 0.72 + 0.25 * _random(spine, 2, seed)
            grey += share * value * (1.0 - _step(y - row - top, wy))
    return grey + fade * (0.4 - grey)


@compiled
def _step(x: float, w: float) -> float:
    """Average a unit step over a width w."""
    return min(max(x / max(w, 1e-12) + 0.5, 0.0), 1.0)


@compiled
def _text(x: float, y: float, wx: float, wy: float, seed: int) -> float:
    """Draw lines of print: a line has height 1, a letter width 1; 1 is ink."""
    row = int(np.floor(y))
    length = 0.55 + 0.45 * _random(row, 1, seed)
    if (x * 0.01) % 1.0 > length:
        return 0.0
    line = _pulse(y, wy, 0.55)
    ink = _cells(x, row + 0.5, wx, 1e-3, seed)
    word = _cells(x * 0.18, row + 0.5, wx * 0.18, 1e-3, seed + 5)
    return line * (ink * 0.9 if word > 0.15 else 0.0)


@compiled
def _texture(
    kind: int,
    size_u: float,
    size_v: float,
    joint: float,
    octaves: int,
    seed: int,
    channel: int,
    u: float,
    v: float,
    wu: float,
    wv: float,
) -> float:
    """Give the share of the other albedo, averaged over a pixel of wu by wv metres."""
    x, y = u / size_u, v / size_v
    wx, wy = max(wu / size_u, 1e-9), max(wv / size_v, 1e-9)
    if kind == BOOKS:
        return _books(x, y, wx, wy, seed, channel)
    seed += 7919 * channel
    if kind == CHECKER:
        return 0.5 - 0.5 * _wave(x, wx) * _wave(y, wy)
    if kind == NOISE:
        return _cloud(x, y, wx, wy, _whole(octaves), seed)
    if kind == TILES:
        return _tiles(x, y, wx, wy, octaves, seed)
    if kind == BRICKS:
        joint_y = _pulse(y, wy, joint / size_v)
        shift = 0.5 if int(np.floor(y)) & 1 else 0.0
        joint_x = _pulse(x + shift, wx, joint / size_u)
        return 1.0 - (1.0 - joint_x) * (1.0 - joint_y)
    if kind == WOOD:
        bend = _cloud(0.1 * x, 0.25 * y, 0.1 * wx, 0.25 * wy, _whole(2), seed)
        # The bend makes rings up to twice as narrow.
        keep = min(max(0.4 / wy - 0.6, 0.0), 1.0)
        ring: float = 0.5 + 0.5 * keep * np.sin(6.283185307179586 * (y + 3.0 * bend))
        return ring
    return _text(x, y, wx, wy, seed)


# --- hitting things ------------------------------------------------------------------------------


@compiled
def _cylinder(
    shape: F64, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> float:
    """Give the nearest positive t at which a ray meets a closed cylinder, or -1."""
    px, py, pz = ox - shape[i, 0], oy - shape[i, 1], oz - shape[i, 2]
    along_d = dx * shape[i, 4] + dy * shape[i, 5] + dz * shape[i, 6]
    along_p = px * shape[i, 4] + py * shape[i, 5] + pz * shape[i, 6]
    ex, ey, ez = dx - along_d * shape[i, 4], dy - along_d * shape[i, 5], dz - along_d * shape[i, 6]
    fx, fy, fz = px - along_p * shape[i, 4], py - along_p * shape[i, 5], pz - along_p * shape[i, 6]
    a = ex * ex + ey * ey + ez * ez
    b = ex * fx + ey * fy + ez * fz
    c = fx * fx + fy * fy + fz * fz - shape[i, 3] * shape[i, 3]
    best = -1.0
    if a > 0.0:
        root = b * b - a * c
        if root < 0.0:
            return -1.0
        root = np.sqrt(root)
        for sign in range(2):
            t = (-b - root if sign == 0 else -b + root) / a
            h = along_p + t * along_d
            if t > 1e-9 and 0.0 <= h <= shape[i, 7] and (best < 0.0 or t < best):
                best = t
    if along_d != 0.0:
        for end in range(2):
            t = ((shape[i, 7] if end == 1 else 0.0) - along_p) / along_d
            if t > 1e-9 and (best < 0.0 or t < best):
                gx, gy, gz = fx + t * ex, fy + t * ey, fz + t * ez
                if gx * gx + gy * gy + gz * gz <= shape[i, 3] * shape[i, 3]:
                    best = t
    return best


@compiled
def _meet(
    kind: int,
    shape: F64,
    i: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    far: float,
) -> float:
    """Give t at which a ray meets a primitive no further than ``far``, or -1."""
    if kind == CYLINDER:
        t = _cylinder(shape, i, ox, oy, oz, dx, dy, dz)
        return t if t <= far else -1.0
    slant = shape[i, 0] * dx + shape[i, 1] * dy + shape[i, 2] * dz
    if slant == 0.0:
        return -1.0
    t = (shape[i, 3] - shape[i, 0] * ox - shape[i, 1] * oy - shape[i, 2] * oz) / slant
    if not (1e-9 < t <= far):
        return -1.0
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    u = shape[i, 4] * px + shape[i, 5] * py + shape[i, 6] * pz - shape[i, 7]
    if u < 0.0 or u > 1.0:
        return -1.0
    v = shape[i, 8] * px + shape[i, 9] * py + shape[i, 10] * pz - shape[i, 11]
    if v < 0.0 or v > 1.0 or (kind == TRIANGLE and u + v > 1.0):
        return -1.0
    return float(t)


@compiled
def _enter(
    node: F64, at: int, ox: float, oy: float, oz: float, ix: float, iy: float, iz: float, far: float
) -> float:
    """Give t at which a ray enters a box, or infinity if it misses it before ``far``."""
    a, b = (node[at, 0] - ox) * ix, (node[at, 3] - ox) * ix
    near, leave = min(a, b), max(a, b)
    a, b = (node[at, 1] - oy) * iy, (node[at, 4] - oy) * iy
    near, leave = max(near, min(a, b)), min(leave, max(a, b))
    a, b = (node[at, 2] - oz) * iz, (node[at, 5] - oz) * iz
    near, leave = max(near, min(a, b)), min(leave, max(a, b))
    return near if near <= leave and leave >= 0.0 and near <= far else np.inf


@compiled
def _inverse(x: float) -> float:
    """Give 1 / x with a large number in place of infinity, so that 0 * it is no NaN."""
    return 1.0 / x if abs(x) > 1e-300 else 1e300


@compiled
def _nearest(
    solids: Solids,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    guess: int,
    stack: I32,
) -> tuple[float, int]:
    """Give (t, primitive) of the nearest hit; (inf, -1) if there is none.

    ``guess`` is tried first, since neighbouring rays mostly hit the same thing.
    """
    best, hit = np.inf, -1
    if guess >= 0:
        t = _meet(solids.kind[guess], solids.shape, guess, ox, oy, oz, dx, dy, dz, best)
        if t > 0.0:
            best, hit = t, guess
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    top, root = 0, _whole(0)
    if _enter(solids.node, root, ox, oy, oz, ix, iy, iz, best) < np.inf:
        stack[0], top = root, 1
    while top > 0:
        top -= 1
        at = stack[top]
        first, count = _whole(solids.link[at, 0]), solids.link[at, 1]
        if count == 0:
            left = _enter(solids.node, first, ox, oy, oz, ix, iy, iz, best)
            right = _enter(solids.node, first + 1, ox, oy, oz, ix, iy, iz, best)
            near, step = (first, 1) if left <= right else (first + 1, -1)
            if max(left, right) < np.inf:
                stack[top] = near + step
                top += 1
            if min(left, right) < np.inf:
                stack[top] = near
                top += 1
            continue
        for k in range(first, first + count):
            i = _whole(solids.order[k])
            t = _meet(solids.kind[i], solids.shape, i, ox, oy, oz, dx, dy, dz, best)
            # Of two at the same depth the first in the file wins, whatever the guess was.
            if t > 0.0 and (t < best or i < hit):
                best, hit = t, i
    return best, hit


@compiled
def _blocked(
    solids: Solids,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    far: float,
    stack: I32,
) -> bool:
    """Say whether anything stands between the origin and t = far."""
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        at = _whole(stack[top])
        if _enter(solids.node, at, ox, oy, oz, ix, iy, iz, far) == np.inf:
            continue
        first, count = solids.link[at, 0], solids.link[at, 1]
        if count == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for k in range(first, first + count):
            i = _whole(solids.order[k])
            if _meet(solids.kind[i], solids.shape, i, ox, oy, oz, dx, dy, dz, far) > 0.0:
                return True
    return False


# --- batches of rays -----------------------------------------------------------------------------
# A call costs as much as a ray, so rays go through in batches that share their origin: those of a
# tile of the image. What a tile can see at all is gathered once, by its frustum.


class Batch(NamedTuple):
    """Rays of one tile and what they hit; made once per thread and band."""

    a: F64  # (B,) direction on the plane z = 1
    b: F64
    direction: F64  # (3, B) world
    t: F64  # (B,) depth, infinite where nothing is hit
    hit: I32  # (B,) primitive, -1 for none
    out: F64  # (9, B) colour, albedo, normal (world)
    key: I32  # (B,) surface and shadow
    pixel: I32  # (B, 2) row and column
    seen: I32  # (MOST,) primitives in the tile's frustum
    between: I32  # (MOST,) primitives that may stand between the tile and a lamp
    visible: F64  # (L, B) share of each lamp that each hit sees
    beam: F64  # (6, B) shadow rays: from, towards
    to: F64  # (9, B) of each, the middle of the lamp and two sides of its disc
    ray: I32  # (B,) of each, the ray whose hit it leaves
    own: I32  # (B,) of each, the flat primitive that it leaves, or -1
    dark: I32  # (B,) of each, whether it meets something
    lit: I32  # (B,) of each, the points of the lamp that are seen
    stack: I32


@compiled
def _batch(lamps: int) -> Batch:
    """Make room for a batch."""
    return Batch(
        np.empty(BATCH),
        np.empty(BATCH),
        np.empty((3, BATCH)),
        np.empty(BATCH),
        np.empty(BATCH, np.int32),
        np.empty((9, BATCH)),
        np.empty(BATCH, np.int32),
        np.empty((BATCH, 2), np.int32),
        np.empty(MOST, np.int32),
        np.empty(MOST, np.int32),
        np.ones((lamps, BATCH)),
        np.empty((6, BATCH)),
        np.empty((9, BATCH)),
        np.empty(BATCH, np.int32),
        np.empty(BATCH, np.int32),
        np.empty(BATCH, np.int32),
        np.empty(BATCH, np.int32),
        np.empty(STACK, np.int32),
    )


@compiled
def _gather(
    solids: Solids,
    poses: F64,
    row: int,
    left: float,
    right: float,
    up: float,
    down: float,
    batch: Batch,
) -> int:
    """Collect what lies in a frustum; give the number, or -1 if it is more than ``MOST``."""
    # Inward normals of left, right, upper and lower side, and the view direction.
    plane = np.empty((5, 3))
    for c in range(3):
        x, y, z = poses[row, c, 0], poses[row, c, 1], poses[row, c, 2]
        plane[0, c], plane[1, c] = x - left * z, right * z - x
        plane[2, c], plane[3, c], plane[4, c] = y - up * z, down * z - y, z
    stack, node, link = batch.stack, solids.node, solids.link
    stack[0], top, count = 0, 1, 0
    while top > 0:
        top -= 1
        at = stack[top]
        outside = False
        for k in range(5):
            furthest = 0.0
            for c in range(3):
                low = node[at, c] - poses[row, c, 3]
                high = node[at, 3 + c] - poses[row, c, 3]
                furthest += max(plane[k, c] * low, plane[k, c] * high)
            if furthest < 0.0:
                outside = True
                break
        if outside:
            continue
        first, many = link[at, 0], link[at, 1]
        if many == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        if count + many > MOST:
            return -1
        for k in range(first, first + many):
            batch.seen[count] = solids.order[k]
            count += 1
    return count


@compiled
def _hit(solids: Solids, poses: F64, row: int, seen: int, batch: Batch, count: int) -> None:
    """Find the nearest hit of each ray of a batch."""
    a, b, direction, best, hit = batch.a, batch.b, batch.direction, batch.t, batch.hit
    shape = solids.shape
    ox, oy, oz = poses[row, 0, 3], poses[row, 1, 3], poses[row, 2, 3]
    for c in range(3):
        x, y, z = poses[row, c, 0], poses[row, c, 1], poses[row, c, 2]
        for r in range(count):
            direction[c, r] = x * a[r] + y * b[r] + z
    for r in range(count):
        best[r], hit[r] = np.inf, -1
    if seen < 0:
        guess = _whole(-1)
        for r in range(count):
            best[r], guess = _nearest(
                solids,
                ox,
                oy,
                oz,
                direction[0, r],
                direction[1, r],
                direction[2, r],
                guess,
                batch.stack,
            )
            hit[r] = guess
        return
    for k in range(seen):
        i = _whole(batch.seen[k])
        if solids.kind[i] == CYLINDER:
            for r in range(count):
                t = _cylinder(
                    shape, i, ox, oy, oz, direction[0, r], direction[1, r], direction[2, r]
                )
                if t > 0.0 and (t < best[r] or (t == best[r] and i < hit[r])):
                    best[r], hit[r] = t, i
            continue
        nx, ny, nz = shape[i, 0], shape[i, 1], shape[i, 2]
        ax, ay, az = shape[i, 4], shape[i, 5], shape[i, 6]
        bx, by, bz = shape[i, 8], shape[i, 9], shape[i, 10]
        n0 = shape[i, 3] - (nx * ox + ny * oy + nz * oz)
        a0 = ax * ox + ay * oy + az * oz - shape[i, 7]
        b0 = bx * ox + by * oy + bz * oz - shape[i, 11]
        corner = 1.0 if solids.kind[i] == TRIANGLE else 2.0
        for r in range(count):
            x, y, z = direction[0, r], direction[1, r], direction[2, r]
            t = n0 / (nx * x + ny * y + nz * z)
            u = a0 + t * (ax * x + ay * y + az * z)
            v = b0 + t * (bx * x + by * y + bz * z)
            inside = (u >= 0.0) & (v >= 0.0) & (u <= 1.0) & (v <= 1.0) & (u + v <= corner)
            # Of two at the same depth the first in the file wins, in whatever order they come.
            nearer = (t > 1e-9) & ((t < best[r]) | ((t == best[r]) & (i < hit[r])))
            if inside & nearer:
                best[r], hit[r] = t, i


@compiled
def _shaft(
    solids: Solids, poses: F64, row: int, lamp: F64, n: int, batch: Batch, count: int
) -> int:
    """Collect what may stand between a batch's hits and a lamp; -1 if it is more than ``MOST``."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for r in range(count):
        if batch.hit[r] >= 0:
            for c in range(3):
                x = poses[row, c, 3] + batch.t[r] * batch.direction[c, r]
                low[c], high[c] = min(low[c], x), max(high[c], x)
    if not low[0] <= high[0]:
        return 0
    # The box of the hits moves to a near lamp, whose radius it is grown by; towards a far lamp it
    # widens as it goes.
    near_lamp = lamp[n, 0] == 1.0
    far, widening = (1.0, 0.0) if near_lamp else (np.inf, lamp[n, 5])
    middle, half, way = np.empty(3), np.empty(3), np.empty(3)
    for c in range(3):
        middle[c], half[c] = 0.5 * (low[c] + high[c]), 0.5 * (high[c] - low[c]) + 1e-5
        way[c] = -lamp[n, 1 + c]
        if near_lamp:
            half[c] += lamp[n, 5]
            way[c] = -way[c] - middle[c]
    # Where all hits lie on one flat thing, only what rises above it can stand in the way.
    flat = batch.hit[0] if batch.hit[0] >= 0 and solids.kind[batch.hit[0]] != CYLINDER else -1
    for r in range(1, count):
        if batch.hit[r] != flat:
            flat = -1
            break
    above = 1.0
    if flat >= 0:
        facing = 0.0
        for c in range(3):
            facing += solids.shape[flat, c] * way[c]
        above = 1.0 if facing >= 0.0 else -1.0
    node, link, stack = solids.node, solids.link, batch.stack
    stack[0], top, found = 0, 1, 0
    while top > 0:
        top -= 1
        at = stack[top]
        if flat >= 0:
            highest = -above * solids.shape[flat, 3]
            for c in range(3):
                x = above * solids.shape[flat, c]
                highest += max(x * node[at, c], x * node[at, 3 + c])
            if highest <= 1e-6:
                continue
        near, leave = 0.0, far
        for c in range(3):
            # low - half - widening t <= middle + way t <= high + half + widening t
            x = (node[at, c] - half[c] - middle[c]) * _inverse(way[c] + widening)
            near, leave = (max(near, x), leave) if way[c] + widening >= 0 else (near, min(leave, x))
            x = (node[at, 3 + c] + half[c] - middle[c]) * _inverse(way[c] - widening)
            near, leave = (near, min(leave, x)) if way[c] - widening >= 0 else (max(near, x), leave)
        if near > leave:
            continue
        first, many = link[at, 0], link[at, 1]
        if many == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        if found + many > MOST:
            return -1
        for k in range(first, first + many):
            batch.between[found] = solids.order[k]
            found += 1
    return found


@compiled
def _darken(solids: Solids, found: int, far: float, batch: Batch, count: int) -> None:
    """Mark which of the first ``count`` shadow rays meet something before ``far``."""
    beam, dark, own, shape = batch.beam, batch.dark, batch.own, solids.shape
    if found < 0:
        for r in range(count):
            dark[r] = _blocked(
                solids,
                beam[0, r],
                beam[1, r],
                beam[2, r],
                beam[3, r],
                beam[4, r],
                beam[5, r],
                far,
                batch.stack,
            )
        return
    dark[:count] = 0
    for j in range(found):
        i = _whole(batch.between[j])
        if solids.kind[i] == CYLINDER:
            for r in range(count):
                if dark[r] == 0:
                    t = _cylinder(
                        shape,
                        i,
                        beam[0, r],
                        beam[1, r],
                        beam[2, r],
                        beam[3, r],
                        beam[4, r],
                        beam[5, r],
                    )
                    if 0.0 < t <= far:
                        dark[r] = 1
            continue
        nx, ny, nz, n0 = shape[i, 0], shape[i, 1], shape[i, 2], shape[i, 3]
        ax, ay, az, a0 = shape[i, 4], shape[i, 5], shape[i, 6], shape[i, 7]
        bx, by, bz, b0 = shape[i, 8], shape[i, 9], shape[i, 10], shape[i, 11]
        corner = 1.0 if solids.kind[i] == TRIANGLE else 2.0
        for r in range(count):
            ox, oy, oz = beam[0, r], beam[1, r], beam[2, r]
            dx, dy, dz = beam[3, r], beam[4, r], beam[5, r]
            t = (n0 - (nx * ox + ny * oy + nz * oz)) / (nx * dx + ny * dy + nz * dz)
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            u = ax * x + ay * y + az * z - a0
            v = bx * x + by * y + bz * z - b0
            inside = (u >= 0.0) & (v >= 0.0) & (u <= 1.0) & (v <= 1.0) & (u + v <= corner)
            dark[r] |= inside & (t > 1e-9) & (t <= far) & (own[r] != i)


@compiled
def _aim(batch: Batch, disc: F64, k: int, square: int, count: int) -> None:
    """Point the first ``count`` shadow rays at a point of the lamp; or each at one of its own."""
    to, beam, ray = batch.to, batch.beam, batch.ray
    points = disc.shape[0]
    for r in range(count):
        p = k if square == 1 else (ray[r] % square) * points // square
        x, y = disc[p, 0], disc[p, 1]
        for c in range(3):
            beam[3 + c, r] = to[c, r] + x * to[3 + c, r] + y * to[6 + c, r]


@compiled
def _shadows(
    solids: Solids, poses: F64, row: int, lamp: F64, n: int, batch: Batch, count: int, square: int
) -> None:
    """Find the share of a lamp that each hit sees: 16 points of its disc, if 4 disagree.

    Where ``square`` rays share a pixel each looks at one point only: their mean is what counts.
    """
    found = _shaft(solids, poses, row, lamp, n, batch, count)
    visible, to, beam, seen = batch.visible, batch.to, batch.beam, batch.lit
    visible[n, :count] = 1.0
    if found == 0:
        return
    shape, size = solids.shape, lamp[n, 5]
    disc = np.empty((16 if size > 0.0 else 1, 2))
    for k in range(disc.shape[0]):
        # A sunflower: golden angle, equal areas; the outermost four come first.
        radius, turn = size * np.sqrt((15.5 - k) / 16.0), 2.399963229728653 * k
        disc[k, 0], disc[k, 1] = radius * np.cos(turn), radius * np.sin(turn)
    far = 1.0 if lamp[n, 0] == 1.0 else np.inf
    waiting = 0
    for ray in range(count):
        i = batch.hit[ray]
        # A flat thing does not shade itself.
        flat = i >= 0 and solids.kind[i] != CYLINDER
        if i < 0 or (found == 1 and flat and batch.between[0] == i):
            continue
        dx, dy, dz = batch.direction[0, ray], batch.direction[1, ray], batch.direction[2, ray]
        px = poses[row, 0, 3] + batch.t[ray] * dx
        py = poses[row, 1, 3] + batch.t[ray] * dy
        pz = poses[row, 2, 3] + batch.t[ray] * dz
        lx, ly, lz = -lamp[n, 1], -lamp[n, 2], -lamp[n, 3]
        if lamp[n, 0] == 1.0:
            lx, ly, lz = -lx - px, -ly - py, -lz - pz
        if flat:
            away = shape[i, 0] * dx + shape[i, 1] * dy + shape[i, 2] * dz
            if away * (shape[i, 0] * lx + shape[i, 1] * ly + shape[i, 2] * lz) >= 0.0:
                continue  # lit from behind, if at all
        length = np.sqrt(lx * lx + ly * ly + lz * lz)
        # A step towards the lamp, or a surface would shade itself.
        lift = 1e-6 / max(length, 1e-6)
        if abs(lz) < 0.9 * length:
            ax, ay, az = ly, -lx, 0.0
        else:
            ax, ay, az = 0.0, lz, -ly
        norm = max(np.sqrt(ax * ax + ay * ay + az * az), 1e-300)
        ax, ay, az = ax / norm, ay / norm, az / norm
        r = waiting
        beam[0, r], beam[1, r], beam[2, r] = px + lift * lx, py + lift * ly, pz + lift * lz
        to[0, r], to[1, r], to[2, r] = lx, ly, lz
        to[3, r], to[4, r], to[5, r] = ax, ay, az
        to[6, r] = (ly * az - lz * ay) / length
        to[7, r] = (lz * ax - lx * az) / length
        to[8, r] = (lx * ay - ly * ax) / length
        batch.ray[r], batch.own[r], seen[r] = ray, i if flat else -1, 0
        waiting += 1
    points = disc.shape[0]
    first = 4 if points > 1 and square == 1 else 1
    for k in range(first):
        _aim(batch, disc, k, square, waiting)
        _darken(solids, found, far, batch, waiting)
        for r in range(waiting):
            seen[r] += 1 - batch.dark[r]
    unsure = 0
    for r in range(waiting):
        visible[n, batch.ray[r]] = seen[r] / first
        if 0 < seen[r] < first:
            for c in range(9):
                to[c, unsure] = to[c, r]
            for c in range(3):
                beam[c, unsure] = beam[c, r]
            batch.ray[unsure], batch.own[unsure] = batch.ray[r], batch.own[r]
            seen[unsure] = seen[r]
            unsure += 1
    if unsure == 0:
        return
    for k in range(first, points):
        _aim(batch, disc, k, square, unsure)
        _darken(solids, found, far, batch, unsure)
        for r in range(unsure):
            seen[r] += 1 - batch.dark[r]
    for r in range(unsure):
        visible[n, batch.ray[r]] = seen[r] / points


@compiled
def _shade(
    solids: Solids,
    paint: Paint,
    lamps: Lamps,
    poses: F64,
    row: int,
    pixel_x: float,
    pixel_y: float,
    background: F64,
    lit: bool,
    batch: Batch,
    count: int,
    square: int,
) -> None:
    """Write colour, albedo, normal and key of each ray of a batch."""
    s, g, out, lamp = solids.shape, solids.grain, batch.out, lamps.lamp
    if lit:
        for n in range(lamp.shape[0]):
            if lamp[n, 6] != 0.0:
                _shadows(solids, poses, row, lamp, n, batch, count, square)
    ox, oy, oz = poses[row, 0, 3], poses[row, 1, 3], poses[row, 2, 3]
    for ray in range(count):
        i = batch.hit[ray]
        if i < 0:
            batch.key[ray] = -1
            for c in range(3):
                out[c, ray], out[3 + c, ray], out[6 + c, ray] = background[c], 0.0, 0.0
            continue
        t = batch.t[ray]
        dx, dy, dz = batch.direction[0, ray], batch.direction[1, ray], batch.direction[2, ray]
        px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
        if solids.kind[i] == CYLINDER:
            qx, qy, qz = px - s[i, 0], py - s[i, 1], pz - s[i, 2]
            h = qx * s[i, 4] + qy * s[i, 5] + qz * s[i, 6]
            rx, ry, rz = qx - h * s[i, 4], qy - h * s[i, 5], qz - h * s[i, 6]
            radius = np.sqrt(rx * rx + ry * ry + rz * rz)
            cx = s[i, 5] * s[i, 10] - s[i, 6] * s[i, 9]
            cy = s[i, 6] * s[i, 8] - s[i, 4] * s[i, 10]
            cz = s[i, 4] * s[i, 9] - s[i, 5] * s[i, 8]
            u = rx * s[i, 8] + ry * s[i, 9] + rz * s[i, 10]
            v = rx * cx + ry * cy + rz * cz
            edge = 1e-7 * (1.0 + s[i, 7])
            if radius < s[i, 3] - edge and (h < edge or h > s[i, 7] - edge):
                nx, ny, nz = s[i, 4], s[i, 5], s[i, 6]
            else:
                nx, ny, nz = rx / radius, ry / radius, rz / radius
                u, v = s[i, 3] * np.arctan2(v, u), h
        else:
            nx, ny, nz = s[i, 0], s[i, 1], s[i, 2]
            u = g[i, 0] * px + g[i, 1] * py + g[i, 2] * pz - g[i, 3]
            v = g[i, 4] * px + g[i, 5] * py + g[i, 6] * pz - g[i, 7]
        slant = nx * dx + ny * dy + nz * dz
        if slant > 0.0:
            nx, ny, nz, slant = -nx, -ny, -nz, -slant
        out[6, ray], out[7, ray], out[8, ray] = nx, ny, nz
        key = solids.surface[i] * 64
        if not lit:
            batch.key[ray] = key
            continue

        k = solids.material[i]
        red, green, blue = paint.base[k, 0], paint.base[k, 1], paint.base[k, 2]
        kind = paint.kind[k]
        if kind != PLAIN:
            # How far the hit moves on the surface when the ray moves by one pixel.
            wu, wv = 0.0, 0.0
            slant = min(slant, -1e-9)
            for axis in range(2):
                width = pixel_x if axis == 0 else pixel_y
                ex = width * poses[row, 0, axis]
                ey = width * poses[row, 1, axis]
                ez = width * poses[row, 2, axis]
                along = (nx * ex + ny * ey + nz * ez) / slant
                ex, ey, ez = t * (ex - along * dx), t * (ey - along * dy), t * (ez - along * dz)
                if solids.kind[i] == CYLINDER:
                    moved = ex * s[i, 4] + ey * s[i, 5] + ez * s[i, 6]
                    wv += moved * moved
                    wu += max(ex * ex + ey * ey + ez * ez - moved * moved, 0.0)
                else:
                    moved = g[i, 0] * ex + g[i, 1] * ey + g[i, 2] * ez
                    wu += moved * moved
                    moved = g[i, 4] * ex + g[i, 5] * ey + g[i, 6] * ez
                    wv += moved * moved
            wu, wv = np.sqrt(wu), np.sqrt(wv)
            for channel in range(3 if paint.hue[k] == 1 else 1):
                mix = _texture(
                    kind,
                    paint.size[k, 0],
                    paint.size[k, 1],
                    paint.size[k, 2],
                    paint.octaves[k],
                    paint.seed[k],
                    channel,
                    u,
                    v,
                    wu,
                    wv,
                )
                if channel == 0:
                    red += mix * (paint.other[k, 0] - red)
                if channel == 1 or paint.hue[k] == 0:
                    green += mix * (paint.other[k, 1] - green)
                if channel == 2 or paint.hue[k] == 0:
                    blue += mix * (paint.other[k, 2] - blue)

        light, shine = lamps.ambient + paint.gloss[k, 2], 0.0
        for n in range(lamp.shape[0]):
            strength, length = lamp[n, 4], 1.0
            lx, ly, lz = -lamp[n, 1], -lamp[n, 2], -lamp[n, 3]
            if lamp[n, 0] == 1.0:
                lx, ly, lz = -lx - px, -ly - py, -lz - pz
                square = max(lx * lx + ly * ly + lz * lz, 1e-12)
                length = np.sqrt(square)
                strength /= square
            facing = (nx * lx + ny * ly + nz * lz) / length
            if facing <= 0.0 or strength == 0.0:
                continue
            if lamp[n, 6] != 0.0:
                if lamp[n, 5] <= 0.0 and batch.visible[n, ray] == 0.0:
                    key ^= 1 << (n % 6)
                strength *= batch.visible[n, ray]
            light += strength * facing
            if paint.gloss[k, 0] > 0.0:
                # Blinn-Phong
                view = np.sqrt(dx * dx + dy * dy + dz * dz)
                hx = lx / length - dx / view
                hy = ly / length - dy / view
                hz = lz / length - dz / view
                half = np.sqrt(hx * hx + hy * hy + hz * hz)
                if half > 0.0:
                    cosine = max((nx * hx + ny * hy + nz * hz) / half, 0.0)
                    shine += strength * paint.gloss[k, 0] * cosine ** paint.gloss[k, 1]
        out[0, ray], out[1, ray], out[2, ray] = (
            red * light + shine,
            green * light + shine,
            blue * light + shine,
        )
        out[3, ray], out[4, ray], out[5, ray] = red, green, blue
        batch.key[ray] = key


@compiled
def _frustum(
    rays: F64, pixel: F64, first: int, last: int, left: int, right: int
) -> tuple[float, float, float, float]:
    """Give the bounds of a tile on the plane z = 1, a pixel wider."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for y in range(first, last):
        for x in range(left, right):
            low_x, high_x = min(low_x, rays[y, x, 0]), max(high_x, rays[y, x, 0])
            low_y, high_y = min(low_y, rays[y, x, 1]), max(high_y, rays[y, x, 1])
    return low_x - pixel[0], high_x + pixel[0], low_y - pixel[1], high_y + pixel[1]


@compiled
def trace_rows(
    first: int,
    last: int,
    tile: int,
    rays: F64,
    pixel: F64,
    poses: F64,
    solids: Solids,
    paint: Paint,
    lamps: Lamps,
    background: F64,
    lit: bool,
    images: Images,
) -> None:
    """Trace one ray through the centre of each pixel of the rows first..last-1.

    Parameters
    ----------
    first, last : int
        Rows.
    tile : int
        Rows that share a pose: 1, or at most 16.
    rays : (H, W, 2) float64
        Direction of each pixel on the plane z = 1.
    pixel : (2,) float64
        Size of a pixel on that plane.
    poses : (H, 3, 4) float64
        T_world_cam of each row.
    solids, paint, lamps
        The scene.
    background : (3,) float64
        Radiance where nothing is hit.
    lit : bool
        Whether colour and albedo are wanted.
    images : Images
        Written.
    """
    batch = _batch(lamps.lamp.shape[0])
    width = rays.shape[1]
    across = BATCH // tile
    for top in range(first, last, tile):
        bottom = min(top + tile, last)
        for left in range(0, width, across):
            right = min(left + across, width)
            x0, x1, y0, y1 = _frustum(rays, pixel, top, bottom, left, right)
            seen = _gather(solids, poses, top, x0, x1, y0, y1, batch)
            count = _whole(0)
            for y in range(top, bottom):
                for x in range(left, right):
                    batch.a[count], batch.b[count] = rays[y, x, 0], rays[y, x, 1]
                    count += 1
            _hit(solids, poses, top, seen, batch, count)
            _shade(
                solids,
                paint,
                lamps,
                poses,
                top,
                pixel[0],
                pixel[1],
                background,
                lit,
                batch,
                count,
                _whole(1),
            )
            r = 0
            for y in range(top, bottom):
                for x in range(left, right):
                    i = batch.hit[r]
                    images.depth[y, x] = batch.t[r] if i >= 0 else 0.0
                    images.thing[y, x] = solids.thing[i] if i >= 0 else -1
                    images.material[y, x] = solids.material[i] if i >= 0 else -1
                    images.key[y, x] = batch.key[r]
                    for c in range(3):
                        images.normal[y, x, c] = (
                            poses[y, 0, c] * batch.out[6, r]
                            + poses[y, 1, c] * batch.out[7, r]
                            + poses[y, 2, c] * batch.out[8, r]
                        )
                        if lit:
                            images.colour[y, x, c] = batch.out[c, r]
                            images.albedo[y, x, c] = batch.out[3 + c, r]
                    r += 1


@compiled
def _differs(images: Images, y: int, x: int, v: int, u: int) -> bool:
    """Say whether an edge may run between two neighbouring pixels."""
    if images.key[y, x] != images.key[v, u]:
        return True
    if images.key[y, x] < 0:
        return False
    turn = 0.0
    for c in range(3):
        turn += images.normal[y, x, c] * images.normal[v, u, c]
    if turn < 0.97:
        return True
    a, b = images.depth[y, x], images.depth[v, u]
    # Nearly edge-on surfaces change depth fast without an edge.
    return bool(abs(a - b) > 0.1 * min(a, b))


@compiled
def _mark(images: Images, edge: I32, first: int, last: int) -> None:
    """Mark, row by row, the pixels next to which an edge runs."""
    height, width = images.depth.shape
    edge[:] = 0
    for y in range(first, last):
        for x in range(width):
            if x + 1 < width and _differs(images, y, x, y, x + 1):
                edge[y - first, x] = edge[y - first, x + 1] = 1
            if y + 1 < height and _differs(images, y, x, y + 1, x):
                edge[y - first, x] = 1
                if y + 1 < last:
                    edge[y + 1 - first, x] = 1
            if y == first and y > 0 and _differs(images, y, x, y - 1, x):
                edge[0, x] = 1


@compiled
def smooth_rows(
    first: int,
    last: int,
    tile: int,
    rays: F64,
    pixel: F64,
    poses: F64,
    solids: Solids,
    paint: Paint,
    lamps: Lamps,
    background: F64,
    samples: int,
    images: Images,
) -> None:
    """Average samples x samples rays in the pixels of some rows where an edge runs.

    Only colour is averaged: depth, normal and albedo stay those of the pixel's centre. The
    arguments are those of `trace_rows`; samples is at most 8.
    """
    batch = _batch(lamps.lamp.shape[0])
    width = images.depth.shape[1]
    edge = np.empty((last - first, width), np.int32)
    _mark(images, edge, first, last)
    across = BATCH // tile
    square = samples * samples
    room = BATCH // square
    for top in range(first, last, tile):
        bottom = min(top + tile, last)
        for left in range(0, width, across):
            right = min(left + across, width)
            found = 0
            for y in range(top, bottom):
                for x in range(left, right):
                    found += edge[y - first, x]
            if found == 0:
                continue
            x0, x1, y0, y1 = _frustum(rays, pixel, top, bottom, left, right)
            seen = _gather(solids, poses, top, x0, x1, y0, y1, batch)
            waiting = 0
            for y in range(top, bottom):
                for x in range(left, right):
                    if edge[y - first, x] != 0:
                        batch.pixel[waiting, 0], batch.pixel[waiting, 1] = y, x
                        _split(rays, y, x, samples, batch, waiting * square)
                        waiting += 1
                        found -= 1
                    if waiting == room or (waiting > 0 and found == 0):
                        count = waiting * square
                        _hit(solids, poses, top, seen, batch, count)
                        _shade(
                            solids,
                            paint,
                            lamps,
                            poses,
                            top,
                            pixel[0] / samples,
                            pixel[1] / samples,
                            background,
                            samples > 0,
                            batch,
                            count,
                            square,
                        )
                        for k in range(waiting):
                            for c in range(3):
                                total = 0.0
                                for r in range(k * square, (k + 1) * square):
                                    total += batch.out[c, r]
                                v, u = batch.pixel[k, 0], batch.pixel[k, 1]
                                images.colour[v, u, c] = total / square
                        waiting = 0


@compiled
def _split(rays: F64, y: int, x: int, samples: int, batch: Batch, start: int) -> None:
    """Put the rays of a pixel's samples into a batch, lens distortion included."""
    height, width = rays.shape[0], rays.shape[1]
    left, right = max(x - 1, 0), min(x + 1, width - 1)
    up, down = max(y - 1, 0), min(y + 1, height - 1)
    ax = (rays[y, right, 0] - rays[y, left, 0]) / max(right - left, 1)
    ay = (rays[y, right, 1] - rays[y, left, 1]) / max(right - left, 1)
    bx = (rays[down, x, 0] - rays[up, x, 0]) / max(down - up, 1)
    by = (rays[down, x, 1] - rays[up, x, 1]) / max(down - up, 1)
    count = samples * samples
    for k in range(count):
        # A lattice in which no two samples share a row or column: an edge along the pixels then
        # has as many grey levels as one across them.
        ex = (k + 0.5) / count - 0.5
        ey = ((k * (samples + 1)) % count + 0.5) / count - 0.5
        batch.a[start + k] = rays[y, x, 0] + ex * ax + ey * bx
        batch.b[start + k] = rays[y, x, 1] + ex * ay + ey * by


@compiled
def look_back(
    rays: F64,
    normal: F32,
    albedo: F32,
    material: I32,
    infrared: F64,
    gloss: F64,
    facing: F32,
    scattered: F32,
    mirrored: F32,
) -> None:
    """Give what light from the camera itself finds; see `edvo.synthesis.infrared.Surface`.

    Parameters
    ----------
    rays : (H, W, 2) float64
        Direction of each pixel on the plane z = 1.
    normal, albedo, material
        As in `Images`.
    infrared : (K,) float64
        Reflectance of each material; negative for the mean of its albedo.
    gloss : (K, 3) float64
        As in `Paint`.
    facing, scattered, mirrored : (H, W) float32
        Written.
    """
    for y in range(rays.shape[0]):
        for x in range(rays.shape[1]):
            facing[y, x] = scattered[y, x] = mirrored[y, x] = 0.0
            k = material[y, x]
            if k < 0:
                continue
            a, b, n = rays[y, x, 0], rays[y, x, 1], normal[y, x]
            cosine = -(n[0] * a + n[1] * b + n[2]) / np.sqrt(a * a + b * b + 1.0)
            cosine = min(max(cosine, 0.0), 1.0)
            share = infrared[k]
            if share < 0.0:
                c = albedo[y, x]
                share = (c[0] + c[1] + c[2]) / 3.0
            facing[y, x], scattered[y, x] = cosine, share * cosine
            if gloss[k, 0] > 0.0:
                mirrored[y, x] = gloss[k, 0] * cosine ** gloss[k, 1]


# --- the tree ------------------------------------------------------------------------------------


@compiled
def build_tree(low: F64, high: F64, node: F64, link: I32, order: I32) -> int:
    """Build a bounding volume tree by the surface area heuristic over 8 bins.

    Parameters
    ----------
    low, high : (P, 3) float64
        Bounds of the primitives.
    node : (2 P, 6) float64
        Written: bounds.
    link : (2 P, 2) int32
        Written: see `Solids`.
    order : (P,) int32
        Written: the primitives, leaf by leaf.

    Returns
    -------
    int
        The number of nodes.
    """
    bins = 8
    count = low.shape[0]
    for i in range(count):
        order[i] = i
    todo = np.empty((STACK + 2, 4), np.int32)  # node, first, last, level
    todo[0, 0], todo[0, 1], todo[0, 2], todo[0, 3] = 0, 0, count, 0
    waiting, used = 1, 1
    box = np.empty((bins, 6))
    filled = np.empty(bins, np.int32)
    right_cost = np.empty(bins)
    while waiting > 0:
        waiting -= 1
        at, first, last, level = (
            todo[waiting, 0],
            todo[waiting, 1],
            todo[waiting, 2],
            todo[waiting, 3],
        )
        middle_low, middle_high = np.full(3, np.inf), np.full(3, -np.inf)
        for c in range(3):
            node[at, c], node[at, 3 + c] = np.inf, -np.inf
            for k in range(first, last):
                i = order[k]
                node[at, c] = min(node[at, c], low[i, c])
                node[at, 3 + c] = max(node[at, 3 + c], high[i, c])
                middle = 0.5 * (low[i, c] + high[i, c])
                middle_low[c] = min(middle_low[c], middle)
                middle_high[c] = max(middle_high[c], middle)
        split = -1
        if last - first > LEAF and level < STACK - 4:
            best = np.inf
            best_axis, best_bin = -1, -1
            for axis in range(3):
                spread = middle_high[axis] - middle_low[axis]
                if spread <= 0.0:
                    continue
                filled[:] = 0
                box[:, :3], box[:, 3:] = np.inf, -np.inf
                for k in range(first, last):
                    i = order[k]
                    middle = 0.5 * (low[i, axis] + high[i, axis])
                    b = min(int(bins * (middle - middle_low[axis]) / spread), bins - 1)
                    filled[b] += 1
                    for c in range(3):
                        box[b, c] = min(box[b, c], low[i, c])
                        box[b, 3 + c] = max(box[b, 3 + c], high[i, c])
                lx, ly, lz, hx, hy, hz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
                n = 0
                for b in range(bins - 1, 0, -1):
                    lx, ly, lz = min(lx, box[b, 0]), min(ly, box[b, 1]), min(lz, box[b, 2])
                    hx, hy, hz = max(hx, box[b, 3]), max(hy, box[b, 4]), max(hz, box[b, 5])
                    n += filled[b]
                    ex, ey, ez = hx - lx, hy - ly, hz - lz
                    right_cost[b] = n * (ex * ey + ey * ez + ez * ex) if n > 0 else np.inf
                lx, ly, lz, hx, hy, hz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
                n = 0
                for b in range(bins - 1):
                    lx, ly, lz = min(lx, box[b, 0]), min(ly, box[b, 1]), min(lz, box[b, 2])
                    hx, hy, hz = max(hx, box[b, 3]), max(hy, box[b, 4]), max(hz, box[b, 5])
                    n += filled[b]
                    if n == 0:
                        continue
                    ex, ey, ez = hx - lx, hy - ly, hz - lz
                    cost = n * (ex * ey + ey * ez + ez * ex) + right_cost[b + 1]
                    if cost < best:
                        best, best_axis, best_bin = cost, axis, b
            if best_axis >= 0:
                spread = middle_high[best_axis] - middle_low[best_axis]
                split, k = first, last - 1
                while split <= k:
                    i = order[split]
                    middle = 0.5 * (low[i, best_axis] + high[i, best_axis])
                    b = min(int(bins * (middle - middle_low[best_axis]) / spread), bins - 1)
                    if b <= best_bin:
                        split += 1
                    else:
                        order[split], order[k] = order[k], order[split]
                        k -= 1
        if split <= first or split >= last:
            link[at, 0], link[at, 1] = first, last - first
            continue
        link[at, 0], link[at, 1] = used, 0
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = used, first, split
        todo[waiting + 1, 0], todo[waiting + 1, 1], todo[waiting + 1, 2] = used + 1, split, last
        todo[waiting, 3] = todo[waiting + 1, 3] = level + 1
        used, waiting = used + 2, waiting + 2
    return used


@compiled
def refit_tree(low: F64, high: F64, node: F64, link: I32, order: I32) -> None:
    """Fit the bounds of a tree to primitives that moved; a child comes after its parent."""
    for at in range(node.shape[0] - 1, -1, -1):
        first, count = link[at, 0], link[at, 1]
        for c in range(3):
            if count == 0:
                node[at, c] = min(node[first, c], node[first + 1, c])
                node[at, 3 + c] = max(node[first, 3 + c], node[first + 1, 3 + c])
            else:
                node[at, c], node[at, 3 + c] = np.inf, -np.inf
                for k in range(first, first + count):
                    node[at, c] = min(node[at, c], low[order[k], c])
                    node[at, 3 + c] = max(node[at, 3 + c], high[order[k], c])
