"""Edge extraction: which pixels are edges, their gradient direction, their depth (§III-A).

The paper takes Canny, because non-maximum suppression and two thresholds find the same edges
under different light; the two extractors that it is compared with are here as well, by name.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.banding import Bands
from edvo.camera import Camera
from edvo.compression import blockiness
from edvo.config import EdgesConfig
from edvo.noise import quieted
from edvo.thresholds import STRONGEST, Scales, threshold_scales

DOG_RATIO = 1.6  # of the two Gaussians: nearest to the Laplacian of a Gaussian (Marr 1980)
BINOMIAL_PX = 5  # the blur that a kernel does
PASS_PX2 = 2.0  # variance of a pass that blurs an image by more
_Grey = TypeVar("_Grey", np.uint8, np.float32)
NO_TABLE = np.empty((0, 0, 2), np.float32)
NO_TABLE.setflags(write=False)  # as Camera.undistortion_table: else its kernel compiles twice
NO_PROFILES = np.empty((0, 2), np.float32)


@dataclass(frozen=True, slots=True)
class EdgePixels:
    """Edge pixels as a structure of arrays.

    Attributes
    ----------
    pixels : ndarray of float32, shape (N, 2)
        Ideal (undistorted) pixel u, v.
    gradients : ndarray of float32, shape (N, 2)
        Unit gradient u, v, which points from dark to bright; it stands for the normal of the
        edge (Eq. 11).
    depths : ndarray of float32, shape (N,)
        Depth in metres; 0 where there is none, or where it was not asked for.
    profiles : ndarray of float32, shape (N, 2) or (0, 2), optional
        What they look like across: the logarithm of the gradient's magnitude where it is highest,
        but for a constant, and the second difference of that logarithm from pixel to pixel; (0, 0)
        of an edge beside which it does not fall off, which is like none. Empty where edges lie on
        pixels, or that is not known of all of them.
    """

    pixels: NDArray[np.float32]
    gradients: NDArray[np.float32]
    depths: NDArray[np.float32]
    profiles: NDArray[np.float32] = field(default_factory=lambda: NO_PROFILES)
    _points: list[tuple[Camera, NDArray[np.float64]]] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    def __len__(self) -> int:
        return len(self.pixels)

    def every(self, stride: int) -> "EdgePixels":
        """Take each n-th one only.

        Parameters
        ----------
        stride : int

        Returns
        -------
        EdgePixels
        """
        return EdgePixels(
            np.ascontiguousarray(self.pixels[::stride]),
            np.ascontiguousarray(self.gradients[::stride]),
            np.ascontiguousarray(self.depths[::stride]),
            np.ascontiguousarray(self.profiles[::stride]),
        )

    def first(self, count: int) -> "EdgePixels":
        """Take the first ones.

        Parameters
        ----------
        count : int

        Returns
        -------
        EdgePixels
        """
        return EdgePixels(
            self.pixels[:count],
            self.gradients[:count],
            self.depths[:count],
            self.profiles[:count],
        )

    def where(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "EdgePixels":
        """Take some of them.

        Parameters
        ----------
        chosen : ndarray of bool, shape (N,), or of int, shape (M,)
            Which, or their positions.

        Returns
        -------
        EdgePixels
        """
        # ten times as fast as rows by a mask, five times as by positions in brackets
        which = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        return EdgePixels(
            self.pixels.take(which, axis=0),
            self.gradients.take(which, axis=0),
            self.depths.take(which),
            self.profiles.take(which, axis=0) if len(self.profiles) else NO_PROFILES,
        )

    def joined(self, others: "EdgePixels") -> "EdgePixels":
        """Put others behind them.

        Parameters
        ----------
        others : EdgePixels

        Returns
        -------
        EdgePixels
        """
        known = len(self.profiles) == len(self) and len(others.profiles) == len(others)
        return EdgePixels(
            np.concatenate((self.pixels, others.pixels)),
            np.concatenate((self.gradients, others.gradients)),
            np.concatenate((self.depths, others.depths)),
            np.concatenate((self.profiles, others.profiles)) if known else NO_PROFILES,
        )

    def points(self, camera: Camera) -> NDArray[np.float64]:
        """Back-project into the camera frame, pi^-1 of Eq. (1).

        Parameters
        ----------
        camera : Camera

        Returns
        -------
        ndarray of float64, shape (N, 3)
            Metres; the same array each time, as it is asked for several times a frame: copy what
            you want to write to.
        """
        for known, points in self._points:
            if known is camera:
                return points
        points = np.empty((len(self.depths), 3))
        kernels.back_project(
            self.pixels, self.depths, camera.fx, camera.fy, camera.cx, camera.cy, points
        )
        self._points[:] = [(camera, points)]
        return points


@dataclass(frozen=True, slots=True)
class EdgeImage:
    """The edges of one image, before anything is computed for each of them.

    Attributes
    ----------
    index : ndarray of int32, shape (N,)
        Flat indices v * width + u of the edge pixels, ascending where they are to be sampled.
    du, dv : ndarray of int16, shape (H, W)
        Sobel gradients, in ``EdgesConfig.grey_steps``-ths of a grey level.
    is_fine : bool
        Whether edges are placed between pixels.
    scale : float
        By which the thresholds of ``EdgesConfig`` were multiplied.
    passes : int
        Of a blur beyond the usual, as asked for, and
    blur_px2 : float
        the variance, px^2, of all that the image was blurred by beyond the usual.
    scales : Scales, optional
        By which they may be, for this image; None where that was not asked.
    """

    index: NDArray[np.int32]
    du: NDArray[np.int16]
    dv: NDArray[np.int16]
    is_fine: bool = False
    scale: float = 1.0
    passes: int = 0
    blur_px2: float = 0.0
    scales: Scales | None = None

    def __len__(self) -> int:
        return len(self.index)

    @property
    def is_faint(self) -> bool:
        """Whether faint edges are among them, as far as that was asked."""
        return self.scales is not None and self.scale < self.scales.usual

    def describe(
        self,
        camera: Camera,
        which: NDArray[np.int32] | None = None,
        depths: NDArray[np.float32] | None = None,
    ) -> EdgePixels:
        """Pixel and unit gradient of the edges, with the lens distortion taken out of both.

        And profiles, as the lens leaves them.

        Parameters
        ----------
        camera : Camera
            Of the image; only its distortion matters.
        which : ndarray of int32, shape (M,), optional
            Positions in ``index``; all edges where not given.
        depths : ndarray of float32, shape (M,), optional
            Their depths in metres, if known.

        Returns
        -------
        EdgePixels
        """
        index = self.index if which is None else self.index[which]
        table = camera.undistortion_table() if camera.is_distorted else NO_TABLE
        pixels = np.empty((len(index), 2), np.float32)
        gradients = np.empty((len(index), 2), np.float32)
        profiles = np.empty((len(index) if self.is_fine else 0, 2), np.float32)
        if depths is None:
            depths = np.zeros(len(index), np.float32)
        kernels.describe_edges(
            index, self.du, self.dv, table, self.is_fine, pixels, gradients, profiles
        )
        return EdgePixels(pixels, gradients, depths, profiles)


class EdgeBuffers:
    """Memory that the images on the way to edges are written to, frame after frame.

    Fresh arrays of this size come from the operating system page by page, which at times costs
    more than the edges themselves.

    Parameters
    ----------
    height, width : int
        Size of the images in pixels.

    Attributes
    ----------
    bands : Bands
        What is known of such in the images so far.
    shown : ndarray of uint8, shape (H, W), or None
        255 where edges are taken, 0 where none is; all over where it is None.
    hidden : ndarray of uint8, shape (H, W), or None
        Where there was an edge that was not taken.
    """

    def __init__(self, height: int, width: int) -> None:
        self.du = np.empty((height, width), np.int16)
        self.dv = np.empty((height, width), np.int16)
        self.mask = np.empty((height, width), np.uint8)
        self.room = np.empty(2 * height * width + 1, np.int32)  # for lists of pixels
        self.wide = np.empty((2, height, width + 2), np.int16)  # for images blurred by more
        self.bands = Bands()
        self.shown: NDArray[np.uint8] | None = None
        self.hidden: NDArray[np.uint8] | None = None


def extract_edges(
    grey: NDArray[np.uint8],
    config: EdgesConfig,
    buffers: EdgeBuffers | None = None,
    *,
    faint: bool = False,
    scale: float | None = None,
    blind: NDArray[np.bool_] | None = None,
    passes: int = 0,
) -> EdgeImage:
    """Find the edge pixels of an image.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    config : EdgesConfig
        The extractor by name, and its thresholds.
    buffers : EdgeBuffers, optional
        Of the size of the image, to be used again for the next one, which then overwrites the
        gradients of the result.
    faint : bool, optional
        Whether Canny's thresholds may sink as far as the noise of the image allows.
    scale : float, optional
        By which they are multiplied; what the image calls for where not given.
    blind : ndarray of bool, shape (H, W), optional
        Where no edges are taken.
    passes : int, optional
        Of a blur of 2 px^2 each, beyond the usual one, before gradients are taken.

    Returns
    -------
    EdgeImage
    """
    buffers = buffers or EdgeBuffers(*grey.shape)
    grey = _sealed(grey)
    quiet, variance = quieted(grey, config.max_noise)
    quiet = _sealed(quiet)
    slopes(quiet, config, buffers, blind, passes)
    if config.bands == "removed" and not passes:  # else edges are as wide as bands
        buffers.bands.remove(quiet, buffers.dv, config.grey_steps)
    as_blurred = partial(replace, passes=passes, blur_px2=variance + PASS_PX2 * passes)
    if config.extractor != "canny":
        MASKS[config.extractor](quiet, config, buffers)
        _hide(buffers)
        return as_blurred(_collected(config, buffers))
    if scale is not None:
        return as_blurred(_canny_edges(config, buffers, scale))
    scales = threshold_scales(buffers.du, buffers.dv, config)
    if scales.faint < scales.usual and blockiness(grey) > config.max_blockiness:
        scales = scales._replace(faint=scales.usual)
    image = _canny_edges(config, buffers, scales.faint if faint else scales.usual)
    return as_blurred(image, scales=scales)


def _sealed(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """View an image as one that nobody may write to, as a frame's: to numba that is another type.

    So each kernel is compiled once, for whatever image of shape (H, W) and dtype uint8 is given.
    """
    view = image.view()
    view.flags.writeable = False
    return view


def edges_to_keep(
    image: EdgeImage, config: EdgesConfig, buffers: EdgeBuffers, share: float
) -> tuple[EdgeImage, int]:
    """Find all edges of an image that other light may show, those first that tell places.

    Parameters
    ----------
    image : EdgeImage
        The last that was written to the buffers.
    config : EdgesConfig
        As for `extract_edges`; only Canny tells what is faint, by thresholds that follow the image.
    buffers : EdgeBuffers
    share : float
        By which thresholds that have sunk as far as noise allows are multiplied.

    Returns
    -------
    edges : EdgeImage
    telling : int
        How many of them tell places: all that `extract_edges` finds without faint ones.
    """
    if config.extractor != "canny" or not config.strong_share:
        return image, len(image)
    scales = image.scales or threshold_scales(buffers.du, buffers.dv, config)
    scale = share * scales.faint
    if scale == scales.usual:
        every = image if scale == image.scale else _canny_edges(config, buffers, scale)
        return every, len(every)
    if image.scale == scales.usual:  # lower thresholds find all of these, and fainter ones
        _mark(config, buffers, scale)
        buffers.mask.reshape(-1)[image.index] = 0
        faint = _collected(config, buffers, scale)
        return replace(faint, index=np.concatenate((image.index, faint.index))), len(image)
    every = image if scale == image.scale else _canny_edges(config, buffers, scale)
    order = np.empty_like(every.index)
    count = kernels.put_strong_first(
        every.index,
        buffers.du,
        buffers.dv,
        *_bounds(config, scales.usual),
        buffers.mask,
        buffers.room,
        order,
    )
    return replace(every, index=order), count


def _bounds(config: EdgesConfig, scale: float) -> tuple[np.int32, np.int32]:
    """Canny's thresholds on ``|du| + |dv|``, the lower one first."""
    bounds = sorted(scale * config.grey_steps * each for each in (config.low, config.high))
    low, high = (np.int32(min(bound, STRONGEST)) for bound in bounds)
    return low, high


def _canny_edges(config: EdgesConfig, buffers: EdgeBuffers, scale: float) -> EdgeImage:
    """Edges by Canny: non-maximum suppression and two thresholds on ``|du| + |dv|``."""
    _mark(config, buffers, scale)
    return _collected(config, buffers, scale)


def _mark(config: EdgesConfig, buffers: EdgeBuffers, scale: float) -> None:
    """Mark the edges that Canny finds."""
    low, high = _bounds(config, scale)
    kernels.canny_edges(buffers.du, buffers.dv, low, high, buffers.mask, buffers.room)
    _hide(buffers)


def _hide(buffers: EdgeBuffers) -> None:
    """Take no edges where none are to be taken; to flatten the image there would make others."""
    if buffers.shown is None:
        return
    if buffers.hidden is None:
        buffers.hidden = np.empty_like(buffers.mask)
    np.greater(buffers.mask, buffers.shown, out=buffers.hidden, casting="unsafe")
    np.bitwise_and(buffers.mask, buffers.shown, out=buffers.mask)


def _collected(config: EdgesConfig, buffers: EdgeBuffers, scale: float = 1.0) -> EdgeImage:
    """List the edges of a mask."""
    index = buffers.room[: kernels.collect_edges(buffers.mask, buffers.room)].copy()
    return EdgeImage(index, buffers.du, buffers.dv, config.position == "vertex", scale)


def depth_at_edges(
    depth: NDArray[np.float32], index: NDArray[np.int32], config: EdgesConfig
) -> NDArray[np.float32]:
    """Depth of edge pixels, from the near side where depth is discontinuous.

    A contour belongs to the nearer surface, and depth sensors err most right there: structured
    light leaves stray pixels between the two sides. So the depths in a window are sorted; where
    they span no gap, their mean is taken, else the mean of the nearest group that a fifth of the
    window supports.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    index : ndarray of int32, shape (N,)
        Flat indices of the edge pixels.
    config : EdgesConfig
        ``depth_window_px`` and ``depth_gap``.

    Returns
    -------
    ndarray of float32, shape (N,)
        Metres; 0 where the window holds no depth, or no group of it agrees.
    """
    result = np.empty(len(index), np.float32)
    kernels.depths_at(depth, index, config.depth_window_px // 2, config.depth_gap, result)
    return result


def _blurred(image: NDArray[_Grey], config: EdgesConfig, passes: int = 0) -> NDArray[_Grey]:
    """Blur an image by OpenCV, as wide as ``config.blur_px`` says and more, of its own type."""
    if passes:
        image = cast(NDArray[_Grey], cv2.GaussianBlur(image, (0, 0), math.sqrt(PASS_PX2 * passes)))
    if not config.blur_px:
        return image
    return cast(NDArray[_Grey], cv2.GaussianBlur(image, (config.blur_px, config.blur_px), 0))


def slopes(
    grey: NDArray[np.uint8],
    config: EdgesConfig,
    buffers: EdgeBuffers,
    blind: NDArray[np.bool_] | None = None,
    passes: int = 0,
) -> None:
    """Blur an image by a Gaussian, and write Sobel's gradients of that.

    A blurred image is finer than whole grey levels; rounded to these, faint edges are displaced.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    config : EdgesConfig
        ``blur_px``, and ``grey_steps``, in units of which gradients are written.
    buffers : EdgeBuffers
        ``du`` and ``dv`` are written.
    blind : ndarray of bool, shape (H, W), optional
        Where they are 0.
    passes : int, optional
        Of a blur of 2 px^2 each, beyond that; the default is none.
    """
    steps = config.grey_steps
    if config.blur_px == BINOMIAL_PX and min(grey.shape) > 2:
        if passes:
            here, there = buffers.wide
            kernels.widely_blurred_gradients(
                grey, np.int32(steps), passes, here, there, buffers.du, buffers.dv
            )
        else:
            kernels.blurred_gradients(grey, np.int32(steps), buffers.du, buffers.dv)
    elif steps == 1:
        cv2.spatialGradient(_blurred(grey, config, passes), buffers.du, buffers.dv)
    else:
        fine = np.floor(_blurred(grey.astype(np.float32) * steps, config, passes) + 0.5)
        buffers.du[:], buffers.dv[:] = (
            cv2.Sobel(fine, cv2.CV_32F, *order) for order in ((1, 0), (0, 1))
        )
    if blind is not None:
        buffers.du[blind] = buffers.dv[blind] = 0


def sobel(grey: NDArray[np.uint8], config: EdgesConfig, buffers: EdgeBuffers) -> None:
    """Edge mask by one threshold on ``|du| + |dv|``: thick edges that come and go."""
    strength = np.abs(buffers.du) + np.abs(buffers.dv)  # at most 8 x 8 x 255: no overflow
    buffers.mask[:] = strength > config.grey_steps * config.sobel_threshold


def difference_of_gaussians(
    grey: NDArray[np.uint8], config: EdgesConfig, buffers: EdgeBuffers
) -> None:
    """Edge mask by zero crossings of a difference of two Gaussians.

    A pixel is an edge where the difference changes its sign towards the right or the lower
    neighbour by at least ``dog_contrast``, and lies nearer to zero than that neighbour does.
    """
    image = _blurred(grey, config).astype(np.float32)
    narrow = cv2.GaussianBlur(image, (0, 0), config.dog_sigma_px)
    wide = cv2.GaussianBlur(image, (0, 0), config.dog_sigma_px * DOG_RATIO)
    dog = narrow - wide
    mask = buffers.mask
    mask[:] = 0
    for here, there, near, far in (
        (dog[:, :-1], dog[:, 1:], mask[:, :-1], mask[:, 1:]),
        (dog[:-1], dog[1:], mask[:-1], mask[1:]),
    ):
        crossing = ((here > 0) != (there > 0)) & (np.abs(here - there) >= config.dog_contrast)
        first = np.abs(here) <= np.abs(there)
        near[crossing & first] = 1
        far[crossing & ~first] = 1
    # without a gradient there is no direction to match
    mask[(buffers.du == 0) & (buffers.dv == 0)] = 0


MASKS: dict[str, Callable[[NDArray[np.uint8], EdgesConfig, EdgeBuffers], None]] = {
    "sobel": sobel,
    "dog": difference_of_gaussians,
}
