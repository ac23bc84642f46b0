"""The renderer's compiled inner loops, and nothing else.

A ray is ``origin + t * direction`` with a direction whose component along the optical axis is 1,
so that ``t`` of the nearest hit is the depth z itself. Everything is float64 inside; each pixel is
computed on its own, so the image does not depend on how rows are shared among threads.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
_Function = TypeVar("_Function", bound=Callable[..., Any])

PATCH, TRIANGLE, CYLINDER = 0, 1, 2
PLAIN, CHECKER, NOISE, TILES, BRICKS, BOOKS, WOOD, TEXT = range(8)
LEAF = 2
STACK = 64


def compiled(function: _Function) -> _Function:
    """Compile a kernel, kept on disk where there is a folder for it.

    Parameters
    ----------
    function : callable
        In the part of Python that numba takes.

    Returns
    -------
    callable
        The compiled function; it releases the interpreter lock.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        kernel: _Function = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no folder it may write: read-only install without a home
        kernel = numba.njit(**options)(function)
    return kernel


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
    key: I32  # (H, W) surface and shadow, to find the pixels to supersample


# --- textures ------------------------------------------------------------------------------------


@compiled
def _random(i: int, j: int, seed: int) -> float:
    """Give a number in [0, 1) for a lattice point."""
    h = np.uint64(np.int64(i) * 73856093 ^ np.int64(j) * 19349663 ^ np.int64(seed) * 83492791)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
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
        weight += amplitude
        if keep == 0.0:
            break
        total += keep * amplitude * _perlin(x, y, seed + 101 * k)
        x, y, w, amplitude = 2.0 * x + 17.3, 2.0 * y + 5.9, 2.0 * w, 0.5 * amplitude
    return min(max(0.5 + 0.6 * total / weight, 0.0), 1.0)


@compiled
def _wave(x: float, w: float) -> float:
    """Average a square wave of period 2 over a width w."""
    high, low = (x + 0.5 * w) % 2.0, (x - 0.5 * w) % 2.0
    area = (high if high < 1.0 else 2.0 - high) - (low if low < 1.0 else 2.0 - low)
    return area / w


@compiled
def _pulse(x: float, w: float, duty: float) -> float:
    """Average over a width w a pulse of period 1 that is 1 during its first ``duty``."""
    high, low = x + 0.5 * w, x - 0.5 * w
    a = np.floor(high) * duty + min(high - np.floor(high), duty)
    return (a - np.floor(low) * duty - min(low - np.floor(low), duty)) / w


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
        total += amplitude * _cells(x, y, wx, wy, seed + 211 * k)
        weight += amplitude
        x, y, wx, wy = 2.7 * x + 0.31, 2.7 * y + 0.77, 2.7 * wx, 2.7 * wy
        amplitude *= 0.7
    return total / weight


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
def _texture(paint: Paint, k: int, channel: int, u: float, v: float, wu: float, wv: float) -> float:
    """Give the share of the other albedo, averaged over a pixel of wu by wv metres."""
    kind = paint.kind[k]
    seed = paint.seed[k] + 7919 * channel
    x, y = u / paint.size[k, 0], v / paint.size[k, 1]
    wx, wy = max(wu / paint.size[k, 0], 1e-9), max(wv / paint.size[k, 1], 1e-9)
    if kind == CHECKER:
        return 0.5 - 0.5 * _wave(x, wx) * _wave(y, wy)
    if kind == NOISE:
        return _cloud(x, y, wx, wy, paint.octaves[k], seed)
    if kind == TILES:
        return _tiles(x, y, wx, wy, paint.octaves[k], seed)
    if kind == BRICKS:
        joint_y = _pulse(y, wy, paint.size[k, 2] / paint.size[k, 1])
        shift = 0.5 if int(np.floor(y)) & 1 else 0.0
        joint_x = _pulse(x + shift, wx, paint.size[k, 2] / paint.size[k, 0])
        return 1.0 - (1.0 - joint_x) * (1.0 - joint_y)
    if kind == BOOKS:
        return _books(x, y, wx, wy, paint.seed[k], channel)
    if kind == WOOD:
        bend = _cloud(0.15 * x, y, 0.15 * wx, wy, 2, seed)
        ring = y + 3.0 * bend
        keep = min(max(0.5 / wy - 1.0, 0.0), 1.0)
        return 0.5 + 0.5 * keep * np.sin(6.283185307179586 * ring)
    return _text(x, y, wx, wy, seed)


# --- hitting things ------------------------------------------------------------------------------


@compiled
def _cylinder(s: F64, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Give the nearest positive t at which a ray meets a closed cylinder, or -1."""
    px, py, pz = ox - s[0], oy - s[1], oz - s[2]
    along_d = dx * s[4] + dy * s[5] + dz * s[6]
    along_p = px * s[4] + py * s[5] + pz * s[6]
    ex, ey, ez = dx - along_d * s[4], dy - along_d * s[5], dz - along_d * s[6]
    fx, fy, fz = px - along_p * s[4], py - along_p * s[5], pz - along_p * s[6]
    a = ex * ex + ey * ey + ez * ez
    b = ex * fx + ey * fy + ez * fz
    c = fx * fx + fy * fy + fz * fz - s[3] * s[3]
    best = -1.0
    if a > 0.0:
        root = b * b - a * c
        if root < 0.0:
            return -1.0
        root = np.sqrt(root)
        for sign in range(2):
            t = (-b - root if sign == 0 else -b + root) / a
            h = along_p + t * along_d
            if t > 1e-9 and 0.0 <= h <= s[7] and (best < 0.0 or t < best):
                best = t
    if along_d != 0.0:
        for end in range(2):
            t = ((s[7] if end == 1 else 0.0) - along_p) / along_d
            if t > 1e-9 and (best < 0.0 or t < best):
                gx, gy, gz = fx + t * ex, fy + t * ey, fz + t * ez
                if gx * gx + gy * gy + gz * gz <= s[3] * s[3]:
                    best = t
    return best


@compiled
def _meet(
    kind: int, s: F64, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, far: float
) -> float:
    """Give t at which a ray meets a primitive no further than ``far``, or -1."""
    if kind == CYLINDER:
        t = _cylinder(s, ox, oy, oz, dx, dy, dz)
        return t if t <= far else -1.0
    slant = s[0] * dx + s[1] * dy + s[2] * dz
    if slant == 0.0:
        return -1.0
    t = (s[3] - s[0] * ox - s[1] * oy - s[2] * oz) / slant
    if not (1e-9 < t <= far):
        return -1.0
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    u = s[4] * px + s[5] * py + s[6] * pz - s[7]
    if u < 0.0 or u > 1.0:
        return -1.0
    v = s[8] * px + s[9] * py + s[10] * pz - s[11]
    if v < 0.0 or v > 1.0 or (kind == TRIANGLE and u + v > 1.0):
        return -1.0
    return t


@compiled
def _enter(
    box: F64, ox: float, oy: float, oz: float, ix: float, iy: float, iz: float, far: float
) -> float:
    """Give t at which a ray enters a box, or infinity if it misses it before ``far``."""
    a, b = (box[0] - ox) * ix, (box[3] - ox) * ix
    near, leave = min(a, b), max(a, b)
    a, b = (box[1] - oy) * iy, (box[4] - oy) * iy
    near, leave = max(near, min(a, b)), min(leave, max(a, b))
    a, b = (box[2] - oz) * iz, (box[5] - oz) * iz
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
        t = _meet(solids.kind[guess], solids.shape[guess], ox, oy, oz, dx, dy, dz, best)
        if t > 0.0:
            best, hit = t, guess
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    top = 0
    if _enter(solids.node[0], ox, oy, oz, ix, iy, iz, best) < np.inf:
        stack[0], top = 0, 1
    while top > 0:
        top -= 1
        at = stack[top]
        first, count = solids.link[at, 0], solids.link[at, 1]
        if count == 0:
            left = _enter(solids.node[first], ox, oy, oz, ix, iy, iz, best)
            right = _enter(solids.node[first + 1], ox, oy, oz, ix, iy, iz, best)
            near, step = (first, 1) if left <= right else (first + 1, -1)
            if max(left, right) < np.inf:
                stack[top] = near + step
                top += 1
            if min(left, right) < np.inf:
                stack[top] = near
                top += 1
            continue
        for k in range(first, first + count):
            i = solids.order[k]
            t = _meet(solids.kind[i], solids.shape[i], ox, oy, oz, dx, dy, dz, best)
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
        at = stack[top]
        if _enter(solids.node[at], ox, oy, oz, ix, iy, iz, far) == np.inf:
            continue
        first, count = solids.link[at, 0], solids.link[at, 1]
        if count == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for k in range(first, first + count):
            i = solids.order[k]
            if _meet(solids.kind[i], solids.shape[i], ox, oy, oz, dx, dy, dz, far) > 0.0:
                return True
    return False


@compiled
def _unshadowed(
    solids: Solids,
    px: float,
    py: float,
    pz: float,
    lx: float,
    ly: float,
    lz: float,
    size: float,
    far: float,
    stack: I32,
) -> float:
    """Give the share of a lamp that is seen from a point; 16 points on its disc, if 4 disagree."""
    if size <= 0.0:
        return 0.0 if _blocked(solids, px, py, pz, lx, ly, lz, far, stack) else 1.0
    length = np.sqrt(lx * lx + ly * ly + lz * lz)
    if abs(lz) < 0.9 * length:
        ax, ay, az = ly, -lx, 0.0
    else:
        ax, ay, az = 0.0, lz, -ly
    norm = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / norm, ay / norm, az / norm
    bx, by, bz = (
        (ly * az - lz * ay) / length,
        (lz * ax - lx * az) / length,
        (lx * ay - ly * ax) / length,
    )
    seen, tried = 0, 0
    for k in range(16):
        # A sunflower: golden angle, equal areas; the outermost four come first.
        radius = size * np.sqrt((15.5 - k) / 16.0)
        turn = 2.399963229728653 * k
        c, s = radius * np.cos(turn), radius * np.sin(turn)
        tried += 1
        if not _blocked(
            solids,
            px,
            py,
            pz,
            lx + c * ax + s * bx,
            ly + c * ay + s * by,
            lz + c * az + s * bz,
            far,
            stack,
        ):
            seen += 1
        if k == 3 and (seen == 0 or seen == 4):
            break
    return seen / tried


# --- light ---------------------------------------------------------------------------------------


@compiled
def _shade(
    solids: Solids,
    paint: Paint,
    lamps: Lamps,
    i: int,
    t: float,
    pose: F64,
    dx: float,
    dy: float,
    dz: float,
    pixel_x: float,
    pixel_y: float,
    lit: bool,
    stack: I32,
    out: F64,
) -> int:
    """Write colour, albedo and normal (world) of a hit into ``out`` (9,); give its key."""
    ox, oy, oz = pose[0, 3], pose[1, 3], pose[2, 3]
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    s = solids.shape[i]
    g = solids.grain[i]
    if solids.kind[i] == CYLINDER:
        qx, qy, qz = px - s[0], py - s[1], pz - s[2]
        h = qx * s[4] + qy * s[5] + qz * s[6]
        rx, ry, rz = qx - h * s[4], qy - h * s[5], qz - h * s[6]
        r = np.sqrt(rx * rx + ry * ry + rz * rz)
        cx, cy, cz = (
            s[5] * s[10] - s[6] * s[9],
            s[6] * s[8] - s[4] * s[10],
            s[4] * s[9] - s[5] * s[8],
        )
        a, b = rx * s[8] + ry * s[9] + rz * s[10], rx * cx + ry * cy + rz * cz
        edge = 1e-7 * (1.0 + s[7])
        if r < s[3] - edge and (h < edge or h > s[7] - edge):
            nx, ny, nz = s[4], s[5], s[6]
            u, v = a, b
        else:
            nx, ny, nz = rx / r, ry / r, rz / r
            u, v = s[3] * np.arctan2(b, a), h
    else:
        nx, ny, nz = s[0], s[1], s[2]
        u = g[0] * px + g[1] * py + g[2] * pz - g[3]
        v = g[4] * px + g[5] * py + g[6] * pz - g[7]
    slant = nx * dx + ny * dy + nz * dz
    if slant > 0.0:
        nx, ny, nz, slant = -nx, -ny, -nz, -slant
    out[6], out[7], out[8] = nx, ny, nz
    key = solids.surface[i] * 64
    if not lit:
        return key

    k = solids.material[i]
    if paint.kind[k] == PLAIN:
        out[3], out[4], out[5] = paint.base[k, 0], paint.base[k, 1], paint.base[k, 2]
    else:
        # How far the hit moves on the surface when the ray moves by one pixel.
        wu, wv = 0.0, 0.0
        slant = min(slant, -1e-9)
        for axis in range(2):
            size = pixel_x if axis == 0 else pixel_y
            ex, ey, ez = size * pose[0, axis], size * pose[1, axis], size * pose[2, axis]
            along = (nx * ex + ny * ey + nz * ez) / slant
            ex, ey, ez = t * (ex - along * dx), t * (ey - along * dy), t * (ez - along * dz)
            if solids.kind[i] == CYLINDER:
                turned = ex * s[4] + ey * s[5] + ez * s[6]
                wv += turned * turned
                wu += max(ex * ex + ey * ey + ez * ez - turned * turned, 0.0)
            else:
                turned = g[0] * ex + g[1] * ey + g[2] * ez
                wu += turned * turned
                turned = g[4] * ex + g[5] * ey + g[6] * ez
                wv += turned * turned
        wu, wv = np.sqrt(wu), np.sqrt(wv)
        mix = _texture(paint, k, 0, u, v, wu, wv)
        for channel in range(3):
            if channel > 0 and paint.hue[k] == 1:
                mix = _texture(paint, k, channel, u, v, wu, wv)
            base = paint.base[k, channel]
            out[3 + channel] = base + mix * (paint.other[k, channel] - base)

    light, shine = lamps.ambient + paint.gloss[k, 2], 0.0
    for lamp in range(lamps.lamp.shape[0]):
        data = lamps.lamp[lamp]
        lx, ly, lz, far = -data[1], -data[2], -data[3], np.inf
        strength = data[4]
        if data[0] == 1.0:
            lx, ly, lz, far = data[1] - px, data[2] - py, data[3] - pz, 1.0
        square = max(lx * lx + ly * ly + lz * lz, 1e-12)
        length = np.sqrt(square)
        facing = (nx * lx + ny * ly + nz * lz) / length
        if facing <= 0.0 or strength == 0.0:
            continue
        if data[0] == 1.0:
            strength /= square
        if data[6] != 0.0:
            # Lifted off the surface, or it would shade itself.
            lift = 1e-6 * (1.0 + t)
            seen = _unshadowed(
                solids,
                px + lift * nx,
                py + lift * ny,
                pz + lift * nz,
                lx,
                ly,
                lz,
                data[5],
                far,
                stack,
            )
            if data[5] <= 0.0 and seen == 0.0:
                key ^= 1 << (lamp % 6)
            strength *= seen
        light += strength * facing
        if paint.gloss[k, 0] > 0.0:
            # Blinn-Phong
            view = np.sqrt(dx * dx + dy * dy + dz * dz)
            hx, hy, hz = lx / length - dx / view, ly / length - dy / view, lz / length - dz / view
            half = np.sqrt(hx * hx + hy * hy + hz * hz)
            if half > 0.0:
                cosine = max((nx * hx + ny * hy + nz * hz) / half, 0.0)
                shine += strength * paint.gloss[k, 0] * cosine ** paint.gloss[k, 1]
    for channel in range(3):
        out[channel] = out[3 + channel] * light + shine
    return key


@compiled
def trace_rows(
    first: int,
    last: int,
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
    stack = np.empty(STACK, np.int32)
    out = np.zeros(9)
    for y in range(first, last):
        pose = poses[y]
        guess = -1
        for x in range(rays.shape[1]):
            a, b = rays[y, x, 0], rays[y, x, 1]
            dx = pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]
            dy = pose[1, 0] * a + pose[1, 1] * b + pose[1, 2]
            dz = pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]
            t, i = _nearest(
                solids, pose[0, 3], pose[1, 3], pose[2, 3], dx, dy, dz, guess, stack
            )
            guess = i
            if i < 0:
                images.depth[y, x] = 0.0
                images.thing[y, x] = -1
                images.key[y, x] = -1
                for c in range(3):
                    images.normal[y, x, c] = 0.0
                    images.albedo[y, x, c] = 0.0
                    images.colour[y, x, c] = background[c]
                continue
            key = _shade(
                solids, paint, lamps, i, t, pose, dx, dy, dz, pixel[0], pixel[1], lit, stack, out
            )
            images.depth[y, x] = t
            images.thing[y, x] = solids.thing[i]
            images.key[y, x] = key
            for c in range(3):
                images.normal[y, x, c] = (
                    pose[0, c] * out[6] + pose[1, c] * out[7] + pose[2, c] * out[8]
                )
                if lit:
                    images.colour[y, x, c] = out[c]
                    images.albedo[y, x, c] = out[3 + c]


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
    return abs(a - b) > 0.1 * min(a, b)


@compiled
def smooth_rows(
    first: int,
    last: int,
    rays: F64,
    pixel: F64,
    poses: F64,
    solids: Solids,
    paint: Paint,
    lamps: Lamps,
    background: F64,
    samples: int,
    images: Images,
) -> int:
    """Average samples x samples rays in the pixels of some rows where an edge runs.

    Only colour is averaged: depth, normal and albedo stay those of the pixel's centre. The
    arguments are those of `trace_rows`; what is given back is the number of such pixels.
    """
    stack = np.empty(STACK, np.int32)
    out = np.zeros(9)
    height, width = images.depth.shape
    found = 0
    for y in range(first, last):
        pose = poses[y]
        for x in range(width):
            edge = (
                (x > 0 and _differs(images, y, x, y, x - 1))
                or (x + 1 < width and _differs(images, y, x, y, x + 1))
                or (y > 0 and _differs(images, y, x, y - 1, x))
                or (y + 1 < height and _differs(images, y, x, y + 1, x))
            )
            if not edge:
                continue
            found += 1
            # How the ray turns within this pixel, lens distortion included.
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            up, down = max(y - 1, 0), min(y + 1, height - 1)
            ax = (rays[y, right, 0] - rays[y, left, 0]) / max(right - left, 1)
            ay = (rays[y, right, 1] - rays[y, left, 1]) / max(right - left, 1)
            bx = (rays[down, x, 0] - rays[up, x, 0]) / max(down - up, 1)
            by = (rays[down, x, 1] - rays[up, x, 1]) / max(down - up, 1)
            red, green, blue = 0.0, 0.0, 0.0
            guess = -1
            for k in range(samples * samples):
                ex = (k % samples + 0.5) / samples - 0.5
                ey = (k // samples + 0.5) / samples - 0.5
                a = rays[y, x, 0] + ex * ax + ey * bx
                b = rays[y, x, 1] + ex * ay + ey * by
                dx = pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]
                dy = pose[1, 0] * a + pose[1, 1] * b + pose[1, 2]
                dz = pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]
                t, i = _nearest(
                    solids, pose[0, 3], pose[1, 3], pose[2, 3], dx, dy, dz, guess, stack
                )
                guess = i
                if i < 0:
                    red, green, blue = (
                        red + background[0],
                        green + background[1],
                        blue + background[2],
                    )
                    continue
                _shade(
                    solids,
                    paint,
                    lamps,
                    i,
                    t,
                    pose,
                    dx,
                    dy,
                    dz,
                    pixel[0] / samples,
                    pixel[1] / samples,
                    True,
                    stack,
                    out,
                )
                red, green, blue = red + out[0], green + out[1], blue + out[2]
            count = samples * samples
            images.colour[y, x, 0] = red / count
            images.colour[y, x, 1] = green / count
            images.colour[y, x, 2] = blue / count
    return found


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
