"""What depth cameras have in common: occlusion shadows, correlated noise, ragged contours."""

import cv2
import numpy as np
from numpy.typing import NDArray

# Two surfaces whose depths differ by more than this share are two, and not one seen at a slant.
_GAP = 0.03


def shadow_mask(
    depth: NDArray[np.float32], focal: float, baseline: float, *, tolerance: float = 1.5
) -> NDArray[np.bool_]:
    """Find the pixels that the second eye, or the projector, of a depth camera cannot see.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    focal : float
        Horizontal focal length of the image, pixels.
    baseline : float
        Metres from the camera to the second eye along +x: a positive one lies to the right and
        puts the shadow on the left of what casts it.
    tolerance : float
        Pixels of disparity by which the surface in front must be nearer.

    Returns
    -------
    ndarray of bool, shape (H, W)
        True in a shadow, which is ``focal baseline (1 / z_front - 1 / z_behind)`` pixels wide.

    Notes
    -----
    A z-buffer of the second view. What lies outside of the image casts no shadow.
    """
    height, width = depth.shape
    if baseline < 0:
        return shadow_mask(depth[:, ::-1], focal, -baseline, tolerance=tolerance)[:, ::-1]
    with np.errstate(divide="ignore"):
        disparity = np.where(depth > 0, np.float32(focal * baseline) / depth, np.float32(0))
    disparity = np.minimum(disparity, np.float32(width)).astype(np.float32, copy=False)
    seen_at = np.arange(width, dtype=np.float32) - disparity + np.float32(width)
    stride = 2 * width + 2
    rows = (np.arange(height, dtype=np.int32) * stride)[:, None]
    cell = (seen_at.astype(np.int32) + rows).ravel()
    # Repeated indices keep the last value, so that writing from far to near is a z-buffer; 16-bit
    # keys are sorted by radix.
    order = np.argsort((disparity * np.float32(60000.0 / width)).astype(np.uint16), axis=None,
                       kind="stable")  # fmt: skip
    nearest = np.zeros(height * stride, np.float32)
    nearest[cell[order]] = disparity.ravel()[order]
    # A surface that the second eye sees stretched leaves gaps: each pixel covers two cells.
    nearest[1:] = np.maximum(nearest[1:], nearest[:-1])
    in_front = nearest[((seen_at + np.float32(0.5)).astype(np.int32) + rows)]
    return np.asarray((in_front > disparity + np.float32(tolerance)) & (depth > 0))


def correlated_noise(
    shape: tuple[int, int], radius: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw Gaussian noise of unit variance whose neighbours resemble each other.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    radius : float
        Standard deviation of the smoothing in pixels: the correlation between pixels that lie
        ``k`` apart is ``exp(-k^2 / (4 radius^2))``. 0 gives white noise.
    rng : numpy.random.Generator
        Where the numbers come from.

    Returns
    -------
    ndarray of float32, shape ``shape``
        Mean 0, variance 1, up to the border.
    """
    if radius <= 0:
        return rng.standard_normal(shape, dtype=np.float32)
    reach = int(np.ceil(3 * radius))
    white = rng.standard_normal((shape[0] + 2 * reach, shape[1] + 2 * reach), dtype=np.float32)
    kernel = cv2.getGaussianKernel(2 * reach + 1, radius, cv2.CV_32F)
    unit = kernel / np.sqrt((kernel**2).sum())
    smooth = cv2.sepFilter2D(white, cv2.CV_32F, unit, unit)
    return np.ascontiguousarray(smooth[reach:-reach, reach:-reach])


def ragged_contours(
    depth: NDArray[np.float32], sigma: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Move the border between near and far about, as lateral noise does.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    sigma : float
        Standard deviation of the shift along x and along y, pixels.
    rng : numpy.random.Generator
        Where the shifts come from.

    Returns
    -------
    ndarray of float32, shape (H, W)
        As before but near a gap in depth: within a surface the axial noise says it all.
    """
    if sigma <= 0:
        return depth
    height, width = depth.shape
    # Matching by windows moves neighbours together: half the resolution is enough.
    half = ((height + 1) // 2, (width + 1) // 2)
    column, row = (
        cv2.resize(rng.standard_normal(half, dtype=np.float32), (width, height),
                   interpolation=cv2.INTER_NEAREST) * np.float32(sigma)
        for _ in range(2)
    )  # fmt: skip
    column += np.arange(width, dtype=np.float32)
    row += np.arange(height, dtype=np.float32)[:, None]
    moved = cv2.remap(depth, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    across = np.abs(moved - depth) > _GAP * depth
    return np.where(across, moved, depth)
