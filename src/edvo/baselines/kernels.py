"""Compiled inner loops of the baselines that are edvo's own code, and nothing else.

They call nothing of ``edvo.kernels``, since numba's cache does not see an edit in a callee of
another file. A linearised problem is a table of rows ``[r, J]``: a residual and its derivative by
a left perturbation [v, w] of the motion, both in the residual's unit.
"""

import numpy as np
from numpy.typing import NDArray

from edvo.kernels import Pinhole, compiled_with

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

ROW = 7  # columns of a linearised problem
MIN_DEPTH = 0.05  # m; what is nearer after the warp has no usable projection
NO_MATCH = -1

compiled = compiled_with(error_model="numpy")


# ------------------------------------------------------------------------------- robust fitting


@compiled
def student_scale(rows: F32, count: int, nu: float, sigma: float, floor: float) -> float:
    """Scale of a t-distribution of the residuals by fixed-point iteration (Kerl 2013, Eq. 15)."""
    for _ in range(50):
        inverse = 1.0 / (sigma * sigma)
        total = 0.0
        for i in range(count):
            square = np.float64(rows[i, 0]) * rows[i, 0]
            total += square * (nu + 1) / (nu + square * inverse)
        new = max(float(np.sqrt(total / count)), floor)
        if abs(new - sigma) < 1e-3 * sigma:
            return new
        sigma = new
    return sigma


@compiled
def student_cost(rows: F32, count: int, nu: float, sigma: float) -> float:
    """Mean negative logarithm of the t-distribution, without what does not depend on r."""
    inverse = 1.0 / (sigma * sigma)
    total = 0.0
    for i in range(count):
        square = np.float64(rows[i, 0]) * rows[i, 0]
        total += np.log1p(square * inverse / nu)
    return 0.5 * (nu + 1) * total / count


@compiled
def normal_equations(rows: F32, count: int, nu: float, sigma: float, H: F64, b: F64) -> float:
    """Write H = J^T W J and b = J^T W r with the weights of a t; returns their sum."""
    H[:] = 0
    b[:] = 0
    inverse = 1.0 / (sigma * sigma)
    total = 0.0
    for i in range(count):
        r = np.float64(rows[i, 0])
        w = (nu + 1) / (nu + r * r * inverse)
        total += w
        for m in range(6):
            wj = w * rows[i, 1 + m]
            b[m] += wj * r
            for n in range(m + 1):
                H[m, n] += wj * rows[i, 1 + n]
    for m in range(6):
        for n in range(m):
            H[n, m] = H[m, n]
    return total


@compiled
def write_row(
    rows: F32, count: int, r: float, gu: float, gv: float, x: float, y: float, z: float, c: Pinhole
) -> None:
    """Write one row for a residual whose derivative by the pixel is (gu, gv), at a warped point.

    With Y = T x the derivative is [a, Y x a], where a = (d pi / d Y)^T g.
    """
    au = gu * c.fx / z
    av = gv * c.fy / z
    aw = -(au * x + av * y) / z
    rows[count, 0] = r
    rows[count, 1], rows[count, 2], rows[count, 3] = au, av, aw
    rows[count, 4] = y * aw - z * av
    rows[count, 5] = z * au - x * aw
    rows[count, 6] = x * av - y * au


# ------------------------------------------------------------------- edges by distance transform


@compiled
def distance_rows(field: F32, points: F64, T: F64, camera: Pinhole, rows: F32) -> int:
    """Linearise the distances from the warped points to the nearest edge; returns how many rows.

    ``field`` (H, W) is the distance transform in pixels, read bilinearly, and its derivative is
    that of the bilinear patch.
    """
    count = 0
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if z < MIN_DEPTH:
            continue
        u = camera.fx * x / z + camera.cx
        v = camera.fy * y / z + camera.cy
        if not (0 <= u < camera.width - 1 and 0 <= v < camera.height - 1):
            continue
        col, row = int(u), int(v)
        s, t = u - col, v - row
        a, b = np.float64(field[row, col]), np.float64(field[row, col + 1])
        c, d = np.float64(field[row + 1, col]), np.float64(field[row + 1, col + 1])
        top, bottom = a + s * (b - a), c + s * (d - c)
        gu = (b - a) + t * ((d - c) - (b - a))
        write_row(rows, count, top + t * (bottom - top), gu, bottom - top, x, y, z, camera)
        count += 1
    return count


# --------------------------------------------------------------------------------- photometry


@compiled
def halve_depth(depth: F32, gap: float, half: F32) -> None:
    """Write depth at half the size: the mean of four where all are there and agree, else 0.

    ``gap`` is the relative step that separates two surfaces. Stray depths that sensors leave
    before a contour lie near, and would outweigh all others by their lever.
    """
    for row in range(half.shape[0]):
        for col in range(half.shape[1]):
            a, b = depth[2 * row, 2 * col], depth[2 * row, 2 * col + 1]
            c, d = depth[2 * row + 1, 2 * col], depth[2 * row + 1, 2 * col + 1]
            near, far = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
            if near > 0 and far <= near * (1 + gap):
                half[row, col] = (a + b + c + d) / 4
            else:
                half[row, col] = 0


@compiled
def smooth_depth_only(depth: F32, gap: float, kept: F32) -> None:
    """Write depth where all four neighbours have it too and none differs by more than ``gap``.

    The border is left out.
    """
    height, width = depth.shape
    kept[:] = 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            z = depth[v, u]
            a, b, c, d = depth[v - 1, u], depth[v + 1, u], depth[v, u - 1], depth[v, u + 1]
            near, far = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
            near, far = min(near, z), max(far, z)
            if near > 0 and far <= near * (1 + gap):
                kept[v, u] = z


@compiled
def central_differences(grey: F32, image: F32) -> None:
    """Write grey value and its two derivatives per pixel, (H, W, 3); one-sided at the border."""
    height, width = grey.shape
    for v in range(height):
        up, down = max(v - 1, 0), min(v + 1, height - 1)
        for u in range(width):
            left, right = max(u - 1, 0), min(u + 1, width - 1)
            image[v, u, 0] = grey[v, u]
            image[v, u, 1] = (grey[v, right] - grey[v, left]) / np.float32(right - left)
            image[v, u, 2] = (grey[down, u] - grey[up, u]) / np.float32(down - up)


@compiled
def gather_points(image: F32, depth: F32, camera: Pinhole, threshold: float, points: F32) -> int:
    """Write x, y, z, grey and its derivatives of the pixels with depth; returns how many.

    Those whose gradient is not above ``threshold``, grey values a pixel, are left out.
    """
    count = 0
    square = threshold * threshold
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            gu, gv = image[v, u, 1], image[v, u, 2]
            if z > 0 and gu * gu + gv * gv > square:
                points[count, 0] = (u - camera.cx) / camera.fx * z
                points[count, 1] = (v - camera.cy) / camera.fy * z
                points[count, 2] = z
                points[count, 3] = image[v, u, 0]
                points[count, 4], points[count, 5] = gu, gv
                count += 1
    return count


@compiled
def photometric_rows(
    points: F32, image: F32, T: F64, camera: Pinhole, rows: F32, pairs: F32
) -> int:
    """Linearise the differences in brightness, warped point in the image less reference.

    The derivative takes the mean of both images' gradients, which makes the step second order
    (Malis 2004). ``pairs`` gets both brightnesses. Returns the number of rows.
    """
    count = 0
    r00, r01, r02, t0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    r10, r11, r12, t1 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    r20, r21, r22, t2 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    for i in range(points.shape[0]):
        px, py, pz = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        z = r20 * px + r21 * py + r22 * pz + t2
        if z < MIN_DEPTH:
            continue
        x = r00 * px + r01 * py + r02 * pz + t0
        y = r10 * px + r11 * py + r12 * pz + t1
        u = camera.fx * x / z + camera.cx
        v = camera.fy * y / z + camera.cy
        if not (0 <= u < camera.width - 1 and 0 <= v < camera.height - 1):
            continue
        col, row = int(u), int(v)
        s, t = np.float32(u - col), np.float32(v - row)
        w11 = s * t
        w01, w10 = s - w11, t - w11
        w00 = np.float32(1) - s - w10
        a, b = image[row, col], image[row, col + 1]
        c, d = image[row + 1, col], image[row + 1, col + 1]
        grey = w00 * a[0] + w01 * b[0] + w10 * c[0] + w11 * d[0]
        gu = w00 * a[1] + w01 * b[1] + w10 * c[1] + w11 * d[1]
        gv = w00 * a[2] + w01 * b[2] + w10 * c[2] + w11 * d[2]
        gu, gv = (gu + points[i, 4]) / 2, (gv + points[i, 5]) / 2
        pairs[count, 0], pairs[count, 1] = points[i, 3], grey
        write_row(rows, count, grey - points[i, 3], gu, gv, x, y, z, camera)
        count += 1
    return count


# ----------------------------------------------------------------------------------- features


@compiled
def distance_in_bits(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> int:
    """Count the bits in which two descriptors differ."""
    total = np.uint64(0)
    for k in range(a.size):
        x = a[k] ^ b[k]
        x = x - ((x >> np.uint64(1)) & np.uint64(0x5555555555555555))
        x = (x & np.uint64(0x3333333333333333)) + (
            (x >> np.uint64(2)) & np.uint64(0x3333333333333333)
        )
        x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += (x * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return np.int64(total)  # type: ignore[return-value]


@compiled
def match_near(
    predicted: F32,
    pixels: F32,
    descriptors_a: NDArray[np.uint64],
    descriptors_b: NDArray[np.uint64],
    octaves_a: I32,
    octaves_b: I32,
    radius: float,
    max_bits: int,
    ratio: float,
    matches: I32,
) -> int:
    """Match features a to those b within a square of ``radius`` pixels round where a should be.

    A match is the best of both its ends, and better than ``ratio`` times the second best of a.
    Octaves may differ by one. Writes the index of b, or NO_MATCH; returns the number of matches.
    """
    n, m = predicted.shape[0], pixels.shape[0]
    best_of_b = np.full(m, NO_MATCH, np.int32)
    bits_of_b = np.full(m, 257, np.int32)
    for i in range(n):
        best, best_bits, second = NO_MATCH, 257, 257
        for j in range(m):
            if (
                abs(pixels[j, 0] - predicted[i, 0]) > radius
                or abs(pixels[j, 1] - predicted[i, 1]) > radius
                or abs(octaves_a[i] - octaves_b[j]) > 1
            ):
                continue
            bits = distance_in_bits(descriptors_a[i], descriptors_b[j])
            if bits < bits_of_b[j]:
                bits_of_b[j], best_of_b[j] = bits, i
            if bits < best_bits:
                best, best_bits, second = j, bits, best_bits
            elif bits < second:
                second = bits
        matches[i] = best if best_bits <= max_bits and best_bits < ratio * second else NO_MATCH
    count = 0
    for i in range(n):
        if matches[i] != NO_MATCH:
            if best_of_b[matches[i]] == i:
                count += 1
            else:
                matches[i] = NO_MATCH
    return count
