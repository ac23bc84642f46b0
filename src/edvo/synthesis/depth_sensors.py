"""Depth cameras: what each of them makes of a perfect depth image."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import SceneError
from edvo.sensor import DEPTH_NOISE, DepthNoise
from edvo.synthesis.depth_effects import correlated_noise, ragged_contours, shadow_mask
from edvo.synthesis.infrared import Pattern, Surface, lost_pattern, slant_noise

Margin = tuple[float, float, float, float]
Depth = NDArray[np.float32]


class DepthSensor(Protocol):
    """What a depth camera is here."""

    def measure(
        self,
        depth: Depth,
        camera: Camera,
        rng: np.random.Generator,
        surface: Surface | None = None,
    ) -> Depth:
        """Give the depth image that the camera delivers.

        Parameters
        ----------
        depth : ndarray of float32, shape (H, W)
            True depth along the optical axis, metres; 0 where there is nothing.
        camera : Camera
            The camera of the image, for its focal length.
        rng : numpy.random.Generator
            Where the noise comes from: the same generator state gives the same bytes.
        surface : Surface, optional
            What the camera's pattern meets; surfaces that face it and scatter well without.

        Returns
        -------
        ndarray of float32, shape (H, W)
            Metres, 0 where missing.
        """
        ...


@dataclass(frozen=True)
class IdealDepth:
    """A depth camera without any error.

    Parameters
    ----------
    near, far : float
        What it sees, metres.
    """

    near: float = 0.0
    far: float = 13.0

    def measure(
        self,
        depth: Depth,
        camera: Camera,
        rng: np.random.Generator,
        surface: Surface | None = None,
    ) -> Depth:
        """Give the true depth within the range; the rest is not used."""
        return _within(depth, self.near, self.far)


@dataclass(frozen=True)
class StructuredLight:
    """A Kinect v1: a projected pattern, matched in an infrared image.

    Parameters
    ----------
    noise : DepthNoise
        Standard deviation of the delivered depth, its quantisation included.
    focal, baseline : float
        Of the infrared camera and its projector, pixels and metres: ``z = focal baseline / d``.
    step : float
        Quantum of the disparity ``d``, pixels.
    lateral : float
        Standard deviation of the contours in pixels of an image 640 wide.
    correlation : float
        Smoothing radius of the noise in pixels of an image 640 wide.
    near, far : float
        Range, metres.
    margin : 4 floats
        Shares of the image at its left, top, right and bottom that have no depth, since the
        infrared camera does not see them.
    pattern : Pattern
        Where the projected pattern is lost.

    Notes
    -----
    Axial and lateral noise, and what a slanted surface adds, as measured by Nguyen 2012 (0.8 px
    laterally for a surface that faces the camera). The depth steps are those of the TUM
    sequences, z^2 / 351 m, and of Handa 2014. The radius of correlation and the margins are
    measured on the TUM fr3 sequences: neighbours two pixels apart correlate by 0.42, and 11, 14,
    32 and 13 pixels are missing at the borders.

    - C. V. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D
      reconstruction and tracking", 3DIMPVT 2012, doi:10.1109/3DIMPVT.2012.84.
    - A. Handa, T. Whelan, J. McDonald, A. J. Davison, "A benchmark for RGB-D visual odometry,
      3D reconstruction and SLAM", ICRA 2014, doi:10.1109/ICRA.2014.6907054.
    """

    noise: DepthNoise = field(default_factory=lambda: DEPTH_NOISE["kinect_v1"])
    focal: float = 585.5
    baseline: float = 0.075
    step: float = 0.125
    lateral: float = 0.8
    correlation: float = 1.1
    near: float = 0.5
    far: float = 5.0
    margin: Margin = (11 / 640, 14 / 480, 32 / 640, 13 / 480)
    pattern: Pattern = field(default_factory=Pattern)

    def measure(
        self,
        depth: Depth,
        camera: Camera,
        rng: np.random.Generator,
        surface: Surface | None = None,
    ) -> Depth:
        """Give the depth image of a Kinect; see :class:`DepthSensor`."""
        size = camera.width / 640
        z = ragged_contours(depth, self.lateral * size, rng)
        hidden = shadow_mask(depth, camera.fx, self.baseline)
        quantum = z * z * np.float32(self.step / (self.focal * self.baseline))
        unit_noise = correlated_noise(z.shape, self.correlation * size, rng)
        sigma = _before_rounding(self.noise, z, quantum)
        if surface is not None:
            sigma += slant_noise(z, surface)
            hidden |= lost_pattern(depth, surface, size, rng, self.pattern)
        noisy = z + sigma * unit_noise
        measured = _quantised_disparity(noisy, self.focal * self.baseline, self.step)
        measured[hidden | (z <= 0)] = 0
        return _without_margin(_within(measured, self.near, self.far), self.margin)


@dataclass(frozen=True)
class Stereo:
    """An active stereo camera such as the RealSense D400 family; depth belongs to its left eye.

    Parameters
    ----------
    noise : DepthNoise
        Standard deviation of the depth.
    baseline : float
        Metres from the left to the right eye.
    unit : float
        Metres that one count of the depth image stands for.
    lateral, correlation : float
        As for :class:`StructuredLight`; chosen, not published.
    near, far : float
        Range, metres.
    """

    noise: DepthNoise
    baseline: float
    unit: float = 0.001
    lateral: float = 1.0
    correlation: float = 1.5
    near: float = 0.3
    far: float = 10.0

    def measure(
        self,
        depth: Depth,
        camera: Camera,
        rng: np.random.Generator,
        surface: Surface | None = None,
    ) -> Depth:
        """Give the depth image of a stereo camera; see :class:`DepthSensor`."""
        size = camera.width / 640
        z = ragged_contours(depth, self.lateral * size, rng)
        hidden = shadow_mask(depth, camera.fx, self.baseline)
        unit_noise = correlated_noise(z.shape, self.correlation * size, rng)
        noisy = z + _before_rounding(self.noise, z, self.unit) * unit_noise
        noisy[hidden | (z <= 0)] = 0
        return _rounded(_within(noisy, self.near, self.far), self.unit)


@dataclass(frozen=True)
class TimeOfFlight:
    """A time-of-flight camera such as the Azure Kinect.

    Parameters
    ----------
    noise : DepthNoise
        Standard deviation of the depth.
    blur : float
        Standard deviation in pixels of the spot that a pixel gathers light from.
    spread : float
        Standard deviation in metres of the depths mixed in one pixel above which it is declared
        invalid.
    unit : float
        Metres that one count of the depth image stands for.
    near, far : float
        Range, metres.

    Notes
    -----
    At a depth edge a pixel gathers light from both sides and measures a depth in between, a
    flying pixel (Toelgyessy 2021); here the mean depth within its spot, weighted by the light that
    comes back (1 / z^2). The Azure Kinect declares pixels whose light is too mixed invalid
    (Microsoft), so small gaps leave flying pixels and wide ones holes with a few flying pixels
    beside them. ``blur`` and ``spread`` are chosen, not published.

    - M. Toelgyessy, M. Dekan, L. Chovanec, P. Hubinsky, "Evaluation of the Azure Kinect and its
      comparison to Kinect V1 and Kinect V2", Sensors 21(2), 2021, doi:10.3390/s21020413.
    - Microsoft, "Azure Kinect DK depth camera", section "Invalidation".
    """

    noise: DepthNoise = field(default_factory=lambda: DEPTH_NOISE["azure_kinect"])
    blur: float = 0.6
    spread: float = 0.2
    unit: float = 0.001
    near: float = 0.5
    far: float = 3.86

    def measure(
        self,
        depth: Depth,
        camera: Camera,
        rng: np.random.Generator,
        surface: Surface | None = None,
    ) -> Depth:
        """Give the depth image of a time-of-flight camera; see :class:`DepthSensor`."""
        seen = depth > 0
        z = np.where(seen, depth, np.float32(1))
        light = np.where(seen, 1 / (z * z), np.float32(0))

        def gathered(image: Depth) -> Depth:
            return np.asarray(
                cv2.GaussianBlur(image, (0, 0), self.blur * camera.width / 640), np.float32
            )

        weight = np.maximum(gathered(light), np.float32(1e-12))
        mean = gathered(light * z) / weight
        variance = np.maximum(gathered(light * z * z) / weight - mean * mean, 0)
        # Within one surface, steep as it may be, the mean is the depth itself: keep it exact.
        mixed = np.sqrt(variance) > np.float32(0.01) * mean
        z = np.where(mixed, mean, z)
        unit_noise = correlated_noise(z.shape, 0.0, rng)
        noisy = z + _before_rounding(self.noise, z, self.unit) * unit_noise
        noisy[~seen | (variance > self.spread**2)] = 0
        return _rounded(_within(noisy, self.near, self.far), self.unit)


#: The depth cameras by name.
DEPTH_SENSORS: Mapping[str, DepthSensor] = MappingProxyType(
    {
        "ideal": IdealDepth(),
        "kinect_v1": StructuredLight(),
        "realsense_d435": Stereo(DEPTH_NOISE["realsense_d435"], baseline=0.050),
        "realsense_d415": Stereo(DEPTH_NOISE["realsense_d415"], baseline=0.055, near=0.45),
        "azure_kinect": TimeOfFlight(),
    }
)


def depth_sensor(name: str) -> DepthSensor:
    """Find a depth camera.

    Parameters
    ----------
    name : str
        A key of ``DEPTH_SENSORS``.

    Returns
    -------
    DepthSensor
        The camera.

    Raises
    ------
    SceneError
        If there is none of that name; the message lists those there are.
    """
    try:
        return DEPTH_SENSORS[name]
    except KeyError:
        raise SceneError(
            f"unknown depth sensor '{name}'; there are: {', '.join(DEPTH_SENSORS)}"
        ) from None


def encode_depth(depth: Depth, depth_scale: float) -> NDArray[np.uint16]:
    """Turn metres into the 16-bit values of a depth image.

    Parameters
    ----------
    depth : ndarray of float32, shape (H, W)
        Metres, 0 where missing.
    depth_scale : float
        Image value of one metre: 5000 in the TUM layout.

    Returns
    -------
    ndarray of uint16, shape (H, W)
        Rounded; a depth too large for 16 bits counts as missing.
    """
    counts = np.rint(depth * np.float32(depth_scale))
    return np.where(counts <= 65535, counts, 0).astype(np.uint16)


def _before_rounding(noise: DepthNoise, depth: Depth, quantum: Depth | float) -> Depth:
    # The published sigma is that of delivered values: it holds their rounding, of variance q^2/12.
    variance = noise.sigma_z(depth).astype(np.float32) ** 2 - np.float32(1 / 12) * quantum * quantum
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _within(depth: Depth, near: float, far: float) -> Depth:
    return np.where((depth >= near) & (depth <= far), depth, np.float32(0)).astype(np.float32)


def _rounded(depth: Depth, unit: float) -> Depth:
    return np.asarray(np.rint(depth / np.float32(unit)) * np.float32(unit))


def _quantised_disparity(depth: Depth, focal_baseline: float, step: float) -> Depth:
    # Noise may throw a point behind the camera: it then falls short of any range.
    at_one_step = np.float32(focal_baseline / step)
    steps = np.rint(at_one_step / np.maximum(depth, np.float32(1e-3)))
    return np.asarray(at_one_step / np.maximum(steps, np.float32(1e-3)), dtype=np.float32)


def _without_margin(depth: Depth, margin: Margin) -> Depth:
    height, width = depth.shape
    left, right = round(margin[0] * width), width - round(margin[2] * width)
    top, bottom = round(margin[1] * height), height - round(margin[3] * height)
    inside = np.zeros_like(depth)
    inside[top:bottom, left:right] = depth[top:bottom, left:right]
    return inside
