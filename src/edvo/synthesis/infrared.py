"""What becomes of a depth camera's projected pattern on the surfaces that it meets."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.synthesis.depth_effects import correlated_noise

Image = NDArray[np.float32]
_STEEPEST = np.float32(np.radians(80.0))  # as far as slant noise was measured


@dataclass(frozen=True)
class Surface:
    """What is seen, for light that comes from the camera itself and goes back to it.

    Attributes
    ----------
    facing : (H, W) float32
        Cosine of the angle between the surface normal and the ray.
    scattered : (H, W) float32
        Infrared reflectance times ``facing``: Lambert's law.
    mirrored : (H, W) float32
        The glossy part: ``gloss facing^shininess``, Blinn-Phong.
    """

    facing: Image
    scattered: Image
    mirrored: Image


@dataclass(frozen=True)
class Pattern:
    """Where a projected pattern is too faint, or too bright, to be found again.

    Parameters
    ----------
    faint : float
        Light that comes back, ``(scattered + mirrored) / z^2`` in 1/m^2, of which one half of the
        pixels is lost.
    scatter : float
        Standard deviation of the logarithm of this limit from place to place.
    blinding : float
        ``mirrored / z^2`` in 1/m^2 above which the infrared image saturates.
    window : float
        Side of the matched windows in pixels of an image 640 wide.
    blotch : float
        Smoothing radius of the scatter in pixels of an image 640 wide.

    Notes
    -----
    That structured light loses dark, glossy and slanted surfaces is reported by Khoshelham 2012,
    Mallick 2014 and Sarbolandi 2015; none gives a formula. This one is Lambert's and the inverse
    square law, with a limit set by three places of the TUM sequences: the floor of fr3/cabinet and
    fr3/structure_notexture_far (a fifth is lost where ``cos / z^2`` is 0.019, at 75 degrees and
    3.7 m; half at 0.013; 3 % at 0.029; nothing above 0.045), the black glossy screen of fr1/xyz
    (60 % at cosines below 0.8, a tenth above) and the dull dark cabinet of fr3/cabinet (nothing).
    ``blinding`` is chosen, not measured.

    - K. Khoshelham, S. O. Elberink, "Accuracy and resolution of Kinect depth data for indoor
      mapping applications", Sensors 12(2), 2012, doi:10.3390/s120201437.
    - T. Mallick, P. P. Das, A. K. Majumdar, "Characterizations of noise in Kinect depth images: a
      review", IEEE Sensors Journal 14(6), 2014, doi:10.1109/JSEN.2014.2309987.
    - H. Sarbolandi, D. Lefloch, A. Kolb, "Kinect range sensing: structured-light versus
      time-of-flight Kinect", CVIU 139, 2015, doi:10.1016/j.cviu.2015.05.006.
    """

    faint: float = 0.0055
    scatter: float = 0.4
    blinding: float = 0.4
    window: float = 9.0
    blotch: float = 4.0


def lost_pattern(
    depth: Image,
    surface: Surface,
    size: float,
    rng: np.random.Generator,
    pattern: Pattern | None = None,
) -> NDArray[np.bool_]:
    """Find the pixels whose pattern cannot be matched.

    Parameters
    ----------
    depth : (H, W) float32
        Metres, 0 where there is nothing.
    surface : Surface
        What is seen.
    size : float
        Width of the image over 640.
    rng : numpy.random.Generator
        Of the scatter.
    pattern : Pattern, optional
        The limits.

    Returns
    -------
    (H, W) bool
        True where depth is lost.
    """
    pattern = pattern or Pattern()
    square = np.square(np.where(depth > 0, depth, np.float32(1)))
    mirrored = surface.mirrored / square
    returned = surface.scattered / square + mirrored
    side = max(round(pattern.window * size), 1)
    returned = np.asarray(cv2.blur(returned, (side, side)), np.float32)
    lost = mirrored > pattern.blinding
    # Beyond six standard deviations nothing is lost: most of an image needs no closer look.
    faint = returned < pattern.faint * np.exp(6 * pattern.scatter)
    if faint.any():
        places = correlated_noise(depth.shape, pattern.blotch * size, rng)[faint]
        limit = np.float32(pattern.faint) * np.exp(np.float32(pattern.scatter) * places)
        lost[faint] |= returned[faint] < limit
    return np.asarray(lost)


def slant_noise(depth: Image, surface: Surface) -> Image:
    """Give what a slant adds to the axial noise of a Kinect v1.

    Parameters
    ----------
    depth : (H, W) float32
        Metres.
    surface : Surface
        What is seen.

    Returns
    -------
    (H, W) float32
        Standard deviation in metres: ``0.0001 / sqrt(z) theta^2 / (pi / 2 - theta)^2`` with the
        angle theta of the normal to the ray, the second term of Nguyen 2012 (see
        :class:`edvo.synthesis.depth_sensors.StructuredLight`), held beyond its 80 degrees.
    """
    theta = np.minimum(np.arccos(np.clip(surface.facing, 0, 1)), _STEEPEST)
    steep = np.square(theta / (np.float32(np.pi / 2) - theta))
    root = np.sqrt(np.maximum(depth, np.float32(0.1)))
    return np.asarray(np.float32(1e-4) * steep / root, dtype=np.float32)
