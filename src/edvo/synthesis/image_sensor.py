"""A colour camera: from the light that falls on the sensor to an 8-bit image."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.synthesis import photometry


@dataclass(frozen=True)
class ImageSensor:
    """Vignette, photon and read noise, sRGB curve and rounding of a small camera.

    Parameters
    ----------
    full_well : float
        Electrons at which a pixel saturates.
    read_noise : float
        Standard deviation in electrons that each reading adds.
    vignette : float
        How much of the natural fall-off of light towards the corners, the cosine of the angle to
        the fourth, is left: 0 none, 1 all of it.

    Notes
    -----
    The number of photons has Poisson statistics, here by their normal limit: with a radiance that
    gives ``e`` electrons the variance is ``e + read_noise^2`` (EMVA standard 1288). The defaults
    give 0.75 grey levels at a bright grey of 170, as measured on the plain panels of the TUM
    sequence fr3/structure_notexture_far.
    """

    full_well: float = 15_000.0
    read_noise: float = 12.0
    vignette: float = 0.3

    def expose(
        self,
        radiance: NDArray[np.float32],
        camera: Camera,
        rng: np.random.Generator | None = None,
        *,
        exposure: float = 1.0,
    ) -> NDArray[np.uint8]:
        """Take an image.

        Parameters
        ----------
        radiance : ndarray of float32, shape (H, W) or (H, W, 3)
            Linear light; 1 saturates at exposure 1.
        camera : Camera
            For the angle of each pixel to the optical axis.
        rng : numpy.random.Generator, optional
            Where the noise comes from; none without it.
        exposure : float
            Factor on the light: exposure time and aperture, before any noise.

        Returns
        -------
        ndarray of uint8, shape of ``radiance``
            The sRGB image.
        """
        gain = np.float32(exposure * self.full_well) * self._fall_off(camera)
        electrons = radiance * (gain[..., None] if radiance.ndim == 3 else gain)
        if rng is not None:
            deviation = np.sqrt(np.maximum(electrons, 0) + np.float32(self.read_noise**2))
            electrons += deviation * rng.standard_normal(radiance.shape, dtype=np.float32)
        electrons *= np.float32(1 / self.full_well)
        return photometry.encode(electrons)

    def _fall_off(self, camera: Camera) -> NDArray[np.float32]:
        x = (np.arange(camera.width, dtype=np.float32) - camera.cx) / camera.fx
        y = (np.arange(camera.height, dtype=np.float32) - camera.cy) / camera.fy
        cosine4 = 1 / (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 2
        return np.asarray(1 - self.vignette * (1 - cosine4), dtype=np.float32)


@dataclass(frozen=True)
class AutoExposure:
    """The control loop that keeps the mean of the image where it should be, a little late.

    Parameters
    ----------
    target : float
        Linear mean that it steers towards; 0.2 is a display value of 124.
    lag : float
        Time constant in seconds of its answer to a step of light.
    shortest, longest : float
        Limits of the exposure.

    Notes
    -----
    A first-order low-pass in the logarithm of the exposure, driven by the frame before: a frame
    cannot be exposed by what it is going to show.
    """

    target: float = 0.2
    lag: float = 0.25
    shortest: float = 1 / 64
    longest: float = 64.0

    def exposures(self, times: Sequence[float], radiances: Sequence[float]) -> NDArray[np.float64]:
        """Give the exposure of each frame of a sequence.

        Parameters
        ----------
        times : sequence of float
            Seconds, in order.
        radiances : sequence of float
            Mean linear radiance of each frame at exposure 1.

        Returns
        -------
        ndarray of float64, shape (N,)
            The first frame is settled.
        """
        exposures = np.empty(len(times))
        for i, t in enumerate(times):
            if i == 0:
                level = self._wanted(radiances[0])
            else:
                answer = 1 - exp(-max(t - times[i - 1], 0.0) / self.lag)
                level += answer * (self._wanted(radiances[i - 1]) - level)
            exposures[i] = exp(level)
        return exposures

    def _wanted(self, radiance: float) -> float:
        wanted = self.target / max(radiance, self.target / self.longest)
        return log(min(max(wanted, self.shortest), self.longest))
