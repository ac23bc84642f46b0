"""Directions at edges: of the gradient, of the edge itself, and how far they differ."""

import cv2
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from edvo.edges import EdgeImage
from edvo.report.plots import edge_picture

RADIUS_PX = 4  # of the window that an edge's direction is taken from
LEAST_PIXELS = 5  # of the edge in that window
STRAIGHT_PX = 0.5  # rms distance from the line, up to which a piece of edge has a direction

_RING = np.ones((3, 3), np.uint8)


def raw_edges(edges: EdgeImage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give edges as the image shows them, with the distortion of the lens.

    Parameters
    ----------
    edges : EdgeImage
        Of N edge pixels.

    Returns
    -------
    tuple of ndarray of float64, shape (N, 2)
        Pixels u, v and unit gradients.
    """
    v, u = np.divmod(edges.index, edges.du.shape[1])
    gradients = np.column_stack((edges.du[v, u], edges.dv[v, u])).astype(np.float64)
    gradients /= np.hypot(gradients[:, 0], gradients[:, 1])[:, None]
    return np.column_stack((u, v)).astype(np.float64), gradients


def edge_normals(edges: EdgeImage) -> NDArray[np.float64]:
    """Find the geometric normal of each edge pixel, from the pixels of its edge alone.

    Parameters
    ----------
    edges : EdgeImage
        Of N edge pixels.

    Returns
    -------
    ndarray of float64, shape (N, 2)
        Unit normals u, v, of either sign; NaN where an edge is too short, or no line: at corners
        and junctions.

    Notes
    -----
    A line is fitted, by least squares of the distances to it, to those edge pixels in a window of
    9 x 9 that are connected with the middle one within the window. Where pixels lie on a grid the
    direction of 9 of them in a row is good to some 3 degrees.
    """
    height, width = edges.du.shape
    r = RADIUS_PX
    mask = np.zeros((height + 2 * r, width + 2 * r), bool)
    v, u = np.divmod(edges.index, width)
    mask[v + r, u + r] = True
    windows = np.lib.stride_tricks.sliding_window_view(mask, (2 * r + 1, 2 * r + 1))[v, u]
    connected = _connected_with_middle(windows)
    dv, du = np.mgrid[-r : r + 1, -r : r + 1].astype(np.float64)
    count = connected.sum(axis=(1, 2))

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        result: NDArray[np.float64] = (connected * values).sum(axis=(1, 2)) / np.maximum(count, 1)
        return result

    mu, mv = mean(du), mean(dv)
    uu, uv, vv = mean(du * du) - mu * mu, mean(du * dv) - mu * mv, mean(dv * dv) - mv * mv
    # the smaller eigenvalue of the covariance is the mean squared distance from the line
    middle, half = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv)
    along = 0.5 * np.arctan2(2 * uv, uu - vv)
    normals = np.column_stack((-np.sin(along), np.cos(along)))
    off_line = np.sqrt(np.maximum(middle - half, 0.0))
    normals[(count < LEAST_PIXELS) | (off_line > STRAIGHT_PX) | (half < 1e-9)] = np.nan
    return normals


def angles_between(
    a: NDArray[np.floating], b: NDArray[np.floating], *, signed: bool = True
) -> NDArray[np.float64]:
    """Angle between unit vectors.

    Parameters
    ----------
    a, b : ndarray, shape (N, 2)
        Unit vectors; NaN where there is none.
    signed : bool
        Whether opposite vectors differ by 180 degrees; else by none, as lines do.

    Returns
    -------
    ndarray of float64, shape (M,)
        Degrees, of those pairs where both vectors are known: in [0, 180], or [0, 90] of lines.
    """
    known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    p, q = a[known].astype(np.float64), b[known].astype(np.float64)
    cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    dot = (p * q).sum(axis=1)
    angles: NDArray[np.float64] = np.degrees(
        np.arctan2(np.abs(cross), dot if signed else np.abs(dot))
    )
    return angles


def common_edges(
    a: NDArray[np.int32], b: NDArray[np.int32], width: int, reach_px: int = 1
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pair edge pixels of two images of the same view.

    Parameters
    ----------
    a, b : ndarray of int32, shape (N,), (M,)
        Flat indices v * width + u of the edge pixels, ascending.
    width : int
        Of the images, pixels.
    reach_px : int
        How many pixels a partner may be off in u and in v.

    Returns
    -------
    tuple of ndarray of int, shape (K,)
        Positions in ``a``, and in ``b`` of their nearest partners; those without one are left out.
    """
    offsets = [
        (du, dv) for dv in range(-reach_px, reach_px + 1) for du in range(-reach_px, reach_px + 1)
    ]
    partner = np.full(len(a), -1, np.intp)
    if len(b):
        for du, dv in sorted(offsets, key=lambda d: d[0] ** 2 + d[1] ** 2):
            u = a % width + du
            wanted = a + dv * width + du
            place = np.minimum(np.searchsorted(b, wanted), len(b) - 1)
            hit = (partner < 0) & (b[place] == wanted) & (u >= 0) & (u < width)
            partner[hit] = place[hit]
    found = np.flatnonzero(partner >= 0)
    return found, partner[found]


def draw_edges(axes: Axes, grey: NDArray[np.uint8], edges: EdgeImage) -> None:
    """Draw edges in colours that tell their gradient directions, and the key to them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    grey : ndarray of uint8, shape (H, W)
        The image.
    edges : EdgeImage
        Its edges.
    """
    axes.imshow(edge_picture(grey, *raw_edges(edges)))
    axes.set_axis_off()
    wheel = axes.inset_axes((0.87, 0.03, 0.11, 0.11 * grey.shape[1] / grey.shape[0]))
    wheel.imshow(colour_wheel())
    wheel.set_axis_off()


def colour_wheel(size: int = 101) -> NDArray[np.float64]:
    """Paint the key to the colours of `edvo.report.plots.edge_picture`.

    Parameters
    ----------
    size : int
        Pixels, odd.

    Returns
    -------
    ndarray of float64, shape (size, size, 4)
        Red, green, blue and opacity: a ring in the colours of the gradients that point outwards.
    """
    middle = size // 2
    v, u = np.mgrid[:size, :size] - middle
    radius = np.hypot(u, v)
    ring = (radius > 0.5 * middle) & (radius < middle)
    outwards = np.column_stack((u[ring], v[ring])).astype(np.float64)
    picture = edge_picture(np.zeros((size, size), np.uint8), outwards + middle, outwards)
    return np.dstack((picture, ring))


def _connected_with_middle(windows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keep those pixels of each window that are reached from its middle by steps of one pixel."""
    size = windows.shape[1]
    # windows below each other with a gap, so that one dilation serves all of them
    sheet = np.zeros((len(windows), size + 1, size), np.uint8)
    allowed = np.zeros_like(sheet)
    allowed[:, :size] = windows
    sheet[:, size // 2, size // 2] = 1
    flat, bound = sheet.reshape(-1, size), allowed.reshape(-1, size)
    if not len(windows):
        return windows
    while True:
        grown = cv2.dilate(flat, _RING, borderType=cv2.BORDER_CONSTANT, borderValue=0) & bound
        if np.array_equal(grown, flat):
            connected: NDArray[np.bool_] = grown.reshape(sheet.shape)[:, :size] > 0
            return connected
        flat = grown
