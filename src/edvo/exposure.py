"""For how long an image is exposed, and what its edges count for it.

Not in the paper. What moves while an image is exposed becomes a ramp, as wide as it has moved along
the gradient of its edge: those that move along themselves stay sharp. What is soft by itself is so
in the keyframe, too; so how much wider an edge is than its match, over how much faster it moves,
tells the exposure. Along a ramp noise decides where its middle is, so that such edges count less.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.measuring import Estimate, Moment
from edvo.planes import camera_of
from edvo.registration import AT_ONCE

EXPECTED_S = 0.03  # for how long an image is exposed, before anything is known (one sigma)
LARGEST_S = 0.05  # that is believed: of more, a camera would blur whatever it shows
LEAST_S = 0.01  # that matters,
LASTING = 0.7  # or of that, once it does
KNOWN = 0.3  # of its square, or of the least that matters, that it is known to (one sigma)
WIDTH_PX2 = 0.4  # by so much the widths of two quarters of the edges differ by chance,
LARGE = 5000.0  # px^2/s^2: and by more the more both move apart, as the most smeared are not found
SHARED = 3.0  # frames that err together, as they have one keyframe
ENOUGH = 100  # edges that tell
AGREEING_PX = 2.0  # from its match, an edge farther away is another
SOFT_PX2 = 4.0  # wider than a sharp edge, a match is soft by itself: more so from nearer
STILL = np.zeros(6)
SOBEL_PX2 = 0.45  # variance that Sobel's operator and the pixels themselves give to a step


class Exposure:
    """Measures how long images are exposed, frame after frame.

    Parameters
    ----------
    camera : Camera
        Of the images.
    config : Config
        ``motion.exposure`` says whether it is measured, or known; without
        ``registration.profile_spread`` no profiles are compared, and nobody asks.

    Attributes
    ----------
    is_on : bool
        Whether it is measured or known.
    seconds : float
        For how long each pixel is exposed; 0 where that does not matter.
    estimate : Estimate
        Of its square, s^2, where it is measured.
    """

    def __init__(self, camera: Camera, config: Config) -> None:
        rule, known = config.motion.exposure, config.motion.exposure_s
        self.is_on = rule != "none" and config.registration.profile_spread > 0
        self._known = known if self.is_on and known > LEAST_S else 0.0
        self._pinhole = camera_of(camera)
        self._sharp = sharp_variance(config.edges.blur_px)
        wanted = rule == "measured" and self.is_on
        self.estimate = Estimate(EXPECTED_S**2, wanted=wanted, shared=SHARED)
        self.forget()

    def forget(self) -> None:
        """Take images as instantaneous, until there is evidence to the contrary."""
        self.estimate.forget()
        self.seconds = self._known

    @property
    def is_known(self) -> bool:
        """Whether it is so certain that a frame now and then keeps it up, or nobody asks."""
        return self.estimate.is_known(KNOWN * max(self.estimate.value, LEAST_S**2))

    @property
    def squared(self) -> float:
        """Its square, s^2: the likeliest one, also where nobody can tell it from none yet."""
        return min(max(self.estimate.likely, self.seconds**2), LARGEST_S**2)

    def learn(
        self, moment: Moment, key_velocity: NDArray[np.float64], seconds: float | None = None
    ) -> None:
        """Compare how much wider edges are than their matches with how much faster they move.

        Parameters
        ----------
        moment : Moment
            A frame that is to be trusted.
        key_velocity : ndarray of float64, shape (6,)
            Of the camera at its keyframe, [v, w] in its own frame, 1/s.
        seconds : float, optional
            Since the frame that was learned from before it; its period where not given.
        """
        samples, keyframe, alignment = moment.seen.samples, moment.keyframe, moment.alignment
        key = keyframe.edges.edges
        if not self.estimate.wanted or not len(samples.profiles) or not len(key.profiles):
            return
        count, moves, widens = kernels.smear_change(
            alignment.pixels,
            samples.depths,
            samples.gradients,
            samples.profiles,
            key.pixels,
            key.gradients,
            key.profiles,
            len(key) - keyframe.gathered,  # what it has gathered was seen at other velocities
            alignment.matches,
            alignment.residuals,
            AGREEING_PX,
            self._sharp + moment.seen.edges.blur_px2 + SOFT_PX2,
            moment.velocity,
            key_velocity,
            self._pinhole,
        )
        certain = 1 / (WIDTH_PX2**2 * (1 + (moves / LARGE) ** 2)) if count >= ENOUGH else 0.0
        age = moment.period if seconds is None else seconds
        self.estimate.note(certain * moves * moves, certain * moves * widens, age)
        seconds = min(math.sqrt(max(self.estimate.value, 0.0)), LARGEST_S)
        self.seconds = seconds if seconds > (LASTING if self.seconds else 1.0) * LEAST_S else 0.0

    def smeared_px(self, velocity: NDArray[np.float64]) -> float:
        """Say over how many pixels what is far away is smeared.

        Parameters
        ----------
        velocity : ndarray of float64, shape (6,)
            Of the camera, [v, w] in its own frame, 1/s.

        Returns
        -------
        float
            At the centre of the image; 0 where it is exposed for an instant.
        """
        return self._pinhole.fx * self.seconds * math.hypot(velocity[3], velocity[4])

    def sharpness(
        self,
        samples: EdgePixels,
        velocity: NDArray[np.float64],
        key_velocity: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Say what edges count, as a factor on residual and derivative.

        Parameters
        ----------
        samples : EdgePixels
            With depth.
        velocity : ndarray of float64, shape (6,)
            Of the camera, as it is expected, [v, w] in its own frame, 1/s.
        key_velocity : ndarray of float64, shape (6,), optional
            The same of their keyframe's, which is taken to have been sharp where not given.

        Returns
        -------
        ndarray of float64, shape (N,)
            Up to 1; empty where all count alike.
        """
        seconds = self.seconds
        if not seconds:
            return AT_ONCE.sharp
        sharp = np.empty(len(samples))
        kernels.write_sharpness(
            samples.pixels,
            samples.gradients,
            samples.depths,
            velocity,
            STILL if key_velocity is None else key_velocity,
            self._pinhole,
            seconds * seconds,
            sharp,
        )
        return sharp


def sharp_variance(blur_px: int) -> float:
    """Tell how wide the gradient of a sharp edge is.

    Parameters
    ----------
    blur_px : int
        See ``EdgesConfig.blur_px``.

    Returns
    -------
    float
        Variance, px^2, of the Gaussian that it falls off by.
    """
    if not blur_px:
        return SOBEL_PX2
    weights = cv2.getGaussianKernel(blur_px, 0).ravel()
    return SOBEL_PX2 + float(weights @ (np.arange(blur_px) - blur_px // 2) ** 2)
