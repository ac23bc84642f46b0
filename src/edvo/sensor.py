"""How noisy a depth camera is: the standard deviation of its depth as a function of depth."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, sqrt
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edvo import kernels

SPEED_OF_LIGHT = 299_792_458.0
"""Metres a second."""


class DepthNoise(Protocol):
    """What a depth-noise model is: a standard deviation for each depth."""

    def sigma_z(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Give the standard deviation of a measured depth.

        Parameters
        ----------
        depth : array_like
            True depth along the optical axis, metres.

        Returns
        -------
        ndarray of float64, shape of ``depth``
            Metres.
        """
        ...


@dataclass(frozen=True)
class StructuredLightNoise:
    """Axial noise of a Kinect v1: ``sigma_z = floor + slope (z - nearest)^2``.

    Parameters
    ----------
    floor : float
        Metres, at the depth ``nearest``.
    slope : float
        1/m.
    nearest : float
        Metres.

    Notes
    -----
    The defaults are the axial model of Nguyen 2012, fitted to a plane that is turned less than 60
    degrees away from the camera. They hold the quantisation of the disparity.

    - C. V. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D
      reconstruction and tracking", 3DIMPVT 2012, doi:10.1109/3DIMPVT.2012.84.
    """

    floor: float = 0.0012
    slope: float = 0.0019
    nearest: float = 0.4

    def sigma_z(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Give the standard deviation in metres of depths in metres."""
        z = np.asarray(depth, dtype=np.float64, order="C")
        sigma = np.empty_like(z)
        kernels.structured_light_noise(
            z.reshape(-1), self.floor, self.slope, self.nearest, sigma.reshape(-1)
        )
        return sigma


@dataclass(frozen=True)
class StereoNoise:
    """Axial noise of a stereo camera: ``sigma_z = z^2 subpixel / (focal baseline)``.

    Parameters
    ----------
    focal : float
        Focal length in pixels of the pair.
    baseline : float
        Metres between the two cameras.
    subpixel : float
        Standard deviation of a matched disparity, pixels.

    Notes
    -----
    The first-order propagation of ``z = focal baseline / disparity``; the maker of the RealSense
    D400 gives it as the depth RMS error of its cameras, with a subpixel of 0.08 for a well
    textured (or projected) pattern (Grunnet-Jepsen 2018).

    - A. Grunnet-Jepsen, J. N. Sweetser, J. Woodfill, "Best-known-methods for tuning Intel
      RealSense D400 depth cameras for best performance", Intel, 2018.
    """

    focal: float
    baseline: float
    subpixel: float = 0.08

    def sigma_z(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Give the standard deviation in metres of depths in metres."""
        z = np.asarray(depth, dtype=np.float64)
        return np.asarray(z**2 * (self.subpixel / (self.focal * self.baseline)))


@dataclass(frozen=True)
class TimeOfFlightNoise:
    """Noise of a continuous-wave time-of-flight camera, limited by the photons that come back.

    Parameters
    ----------
    frequency : float
        Modulation frequency, Hz.
    contrast : float
        Demodulation contrast, 0 to 1.
    signal : float
        Electrons that a wall at 1 m gives a pixel; they fall with the square of the depth.
    background : float
        Electrons of ambient light and dark current, and the variance of the read noise.

    Notes
    -----
    ``sigma_z = c / (4 sqrt(2) pi frequency) sqrt(B) / A`` with the offset
    ``B = signal / z^2 + background`` and the amplitude ``A = contrast signal / z^2`` of the
    demodulated light (Lange 2001). Frequency and contrast are those published for the image sensor
    of the Azure Kinect (Bamji 2018); the two electron counts are chosen here so that sigma is
    1.0 mm at 1 m and 3.6 mm at 3 m, which stays below Bamji's 0.2 % and the 17 mm of the camera's
    data sheet.

    - R. Lange, P. Seitz, "Solid-state time-of-flight range camera", IEEE Journal of Quantum
      Electronics 37(3), 2001, doi:10.1109/3.910448.
    - C. S. Bamji et al., "1Mpixel 65nm BSI 320MHz demodulated TOF image sensor with 3um
      global shutter pixels and analog binning", ISSCC 2018.
    """

    frequency: float = 200e6
    contrast: float = 0.87
    signal: float = 1e4
    background: float = 600.0

    def sigma_z(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Give the standard deviation in metres of depths in metres."""
        z2 = np.asarray(depth, dtype=np.float64) ** 2
        # sqrt(B) / A written with z^2 on top, so that a depth of 0 gives 0 and not a division.
        variance = z2 / self.signal + self.background * (z2 / self.signal) ** 2
        scale = SPEED_OF_LIGHT / (4.0 * sqrt(2.0) * pi * self.frequency * self.contrast)
        return np.asarray(scale * np.sqrt(variance))


#: The noise of each depth camera that has a name here.
DEPTH_NOISE: Mapping[str, DepthNoise] = MappingProxyType(
    {
        "kinect_v1": StructuredLightNoise(),
        # 848 x 480 over 90 degrees, and 1280 x 720 over 65 degrees: the maker's best resolutions.
        "realsense_d435": StereoNoise(focal=424.0, baseline=0.050),
        "realsense_d415": StereoNoise(focal=1005.0, baseline=0.055),
        "azure_kinect": TimeOfFlightNoise(),
    }
)
