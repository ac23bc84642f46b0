"""How noisy an image is, and by how much a blur makes up for it. Not in the paper."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import kernels

LEAST_PX = 6  # side of what tells noise at one place
STEP_PX = 28  # from one such place to the next
PLACES = 16  # along the shorter side of the image, at least, as far as there are so many pixels
QUIET_SHARE = 0.4  # of the places: those without texture, but not the dark alone, with less noise
WITHIN = 0.5244  # so large a share of normal deviates is nearer to zero, over their sigma
SPREAD = 6.0  # of the difference of Laplacians, over the sigma of the white noise of its pixels
# Noise that is smoothed over its neighbours, as by a Bayer pattern, is less in sums of 2 x 2 pixels
# than in gradients; by so much of what is missing in single pixels.
SMOOTHED = 0.5
# Variance, px^2, of the Gaussian whose derivative lets through as much white noise as Sobel's
# operator after the blur of 5 px does, and as the inverse of which noise goes down.
GRADIENT_PX2 = 1.467
LEAST_EXCESS = 0.1  # of noise over what may be: less is not worth a blur


def image_noise(grey: NDArray[np.uint8]) -> float:
    """Measure the noise of an image, as far as it reaches gradients.

    The difference of two Laplacians tells it from edges and shades (Immerkaer 1996). It is taken of
    pixels, and of sums of 2 x 2 of them, where noise that a camera has smoothed shows. Texture
    counts only if it fills three fifths of the image; what is black or white is left out.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)

    Returns
    -------
    float
        Standard deviation of the white noise that is as strong in gradients, in grey levels; 0
        where no place tells.
    """
    if min(grey.shape) < LEAST_PX:
        return 0.0
    step = max(1, min(STEP_PX, min(grey.shape) // PLACES))
    by_pixel, by_sum = kernels.quiet_roughness(grey, step, QUIET_SHARE)
    by_sum /= 2.0  # of four pixels noise is twice as strong
    return (by_sum + SMOOTHED * max(by_sum - by_pixel, 0.0)) / (WITHIN * SPREAD)


def quieted(grey: NDArray[np.uint8], most: float) -> tuple[NDArray[np.uint8], float]:
    """Blur an image until its gradients are no noisier than those of one with so much noise.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    most : float
        Standard deviation in grey levels of the noise that is left as it is; 0 leaves all.

    Returns
    -------
    image : ndarray of uint8, shape (H, W)
        The image itself where it is no noisier.
    variance : float
        Of the Gaussian, px^2; 0 where there was no need.
    """
    excess = image_noise(grey) / most - 1.0 if most else 0.0
    if excess < LEAST_EXCESS:
        return grey, 0.0
    variance = GRADIENT_PX2 * excess
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), math.sqrt(variance)), np.uint8), variance
