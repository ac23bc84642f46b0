"""Models of changing light: what each of them does to the linear light of an image.

With the severity ``s`` from 0 to 1 and a :class:`~edvo.synthesis.light_signals.Swing` or
:class:`~edvo.synthesis.light_signals.Jumps` over time, all of them leave the light as it is at
``s = 0`` and go further from that, at every instant and pixel, the larger ``s`` is.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, pi, sin
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from edvo.errors import SceneError
from edvo.synthesis.light_signals import Jumps, Swing
from edvo.synthesis.randomness import generator
from edvo.synthesis.surface import Surface

Field = NDArray[np.float32]

# A lamp in the camera frame: it swings by this much to the left and right, above the camera.
_LAMP_SWING = 2.0
_LAMP_HEIGHT = 1.0
_LAMP_JUMP = 1.0
_LAMP_REACH = 2.0
_LAMP_POWER = 2.0

# Exposure and read-out of a rolling shutter under mains light, seconds.
_EXPOSURE_TIME = 1 / 250
_READ_OUT_TIME = 1 / 45


@dataclass(frozen=True)
class Settings:
    """How a model of light is to change an image.

    Parameters
    ----------
    severity : float
        0 leaves it as it is, 1 is the hardest.
    frequency : float
        Hz.
    seed : int
        Of jumps, paths and noise.
    jumps : tuple of float, optional
        Instants of the sudden jumps, seconds; random ones by default, none if empty.
    """

    severity: float
    frequency: float
    seed: int
    jumps: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Refuse jumps that cannot be before any image is read."""
        Jumps(self.seed, self.jumps)


@dataclass(frozen=True)
class Effect:
    """``light -> gain light^exponent + offset``, and photon and read noise on top.

    Parameters
    ----------
    gain, offset : float or ndarray of float32, shape (H, W), (H, 1) or (1, 1)
        Numbers mean the whole image.
    exponent : float
        Of the linear light, 1 for white.
    noise : float
        Share of the noise of a sensor that saturates at 2,000 electrons and adds 5 on reading.
    """

    gain: float | Field = 1.0
    offset: float | Field = 0.0
    exponent: float = 1.0
    noise: float = 0.0

    @property
    def is_global(self) -> bool:
        """Whether a pixel's value alone says what becomes of it."""
        return np.ndim(self.gain) == 0 and np.ndim(self.offset) == 0 and self.noise == 0


@dataclass(frozen=True)
class LightModel:
    """A model of changing light.

    Parameters
    ----------
    name : str
        What ``--model`` calls it.
    summary : str
        What it does, in a line.
    frequency : float
        Hz, where none is asked for.
    effect : callable
        From settings, seconds, size (rows, columns) and surface to an :class:`Effect`.
    needs_depth : bool
        Whether it needs the surface, which is None otherwise.
    """

    name: str
    summary: str
    frequency: float
    effect: Callable[[Settings, float, tuple[int, int], Surface | None], Effect]
    needs_depth: bool = False


def ambient_gain(settings: Settings, t: float) -> float:
    """Give the factor on all light at an instant, of the paper's ambient model.

    Parameters
    ----------
    settings : Settings
        Severity, frequency, seed and jumps.
    t : float
        Seconds.

    Returns
    -------
    float
        Its logarithm swings between -2.5 and +0.25 photographic stops at the hardest, and jumps
        by at most one stop. Images are mostly exposed as bright as they can be: much more light
        would only make them white.
    """
    stops = -1.125 + 1.375 * Swing(settings.frequency).at(t)
    stops += 0.5 * Jumps(settings.seed, settings.jumps).at(t)
    return float(2.0 ** (settings.severity * stops))


def exposure_gain(settings: Settings, t: float) -> float:
    """Give the factor on all light at an instant, of steps as large as two stops either way.

    Parameters
    ----------
    settings : Settings
        Severity, steps a second, seed and jumps.
    t : float
        Seconds.

    Returns
    -------
    float
        Constant between the steps.
    """
    steps = Jumps(settings.seed, settings.jumps, interval=1 / settings.frequency)
    return float(2.0 ** (2.0 * settings.severity * steps.at(t)))


def fade_gain(settings: Settings, t: float) -> float:
    """Give the factor on all light at an instant, of a slow fall by up to six stops and back.

    Parameters
    ----------
    settings : Settings
        Severity and frequency.
    t : float
        Seconds.

    Returns
    -------
    float
        1 at the start.
    """
    dark = 0.5 - 0.5 * cos(2 * pi * settings.frequency * t)
    return float(2.0 ** (-6.0 * settings.severity * dark))


def _ambient(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    return Effect(gain=ambient_gain(settings, t))


def _diffuse(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    assert surface is not None
    x = _LAMP_SWING * Swing(settings.frequency).at(t)
    x += _LAMP_JUMP * Jumps(settings.seed, settings.jumps).at(t)
    to_lamp = np.array([x, -_LAMP_HEIGHT, 0.0], np.float32) - surface.points
    squared = (to_lamp * to_lamp).sum(axis=-1)
    cosine = (surface.normals * to_lamp).sum(axis=-1) / np.sqrt(squared)
    # Lambert's n . l, and a fall-off with distance that stays finite at the lamp.
    lit = _LAMP_POWER * np.maximum(cosine, 0) / (1 + squared / np.float32(_LAMP_REACH**2))
    share = np.float32(0.85 * settings.severity)
    return Effect(gain=np.maximum(surface.spread(1 + share * (lit - 1)), 0))


def _quadrants(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    x, y = _image_coordinates(size)
    # Light has no hard border: the quadrants go over into each other within a tenth of the width.
    right, below = _step(x / np.float32(0.1)), _step(y / np.float32(0.1))
    shares = ((1 - right) * (1 - below), right * (1 - below), right * below, (1 - right) * below)
    gain, offset = np.zeros(size, np.float32), np.zeros(size, np.float32)
    for i, share in enumerate(shares):
        swing = Swing(settings.frequency, phase=i / 4).at(t)
        gain += share * np.float32(2.0 ** (1.5 * settings.severity * swing))
        offset += share * np.float32(0.05 * settings.severity * (1 + swing))
    return Effect(gain=gain, offset=offset)


def _exposure(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    return Effect(gain=exposure_gain(settings, t))


def _gamma(settings: Settings, t: float, size: tuple[int, int], surface: Surface | None) -> Effect:
    return Effect(exponent=float(2.0 ** (settings.severity * Swing(settings.frequency).at(t))))


def _flicker(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    frequency = settings.frequency
    row_time = t + np.arange(size[0]) * (_READ_OUT_TIME / size[0])
    # The mean of a cosine over the exposure: sinc, with the phase of its middle.
    contrast = 0.95 * settings.severity * np.sinc(frequency * _EXPOSURE_TIME)
    wave = np.cos(2 * pi * frequency * (row_time + _EXPOSURE_TIME / 2))
    return Effect(gain=(1 + contrast * wave).astype(np.float32)[:, None])


def _spotlight(
    settings: Settings, t: float, size: tuple[int, int], surface: Surface | None
) -> Effect:
    x, y = _image_coordinates(size)
    phase_x, phase_y = generator(settings.seed, "spotlight path").uniform(0, 2 * pi, 2)
    angle = 2 * pi * settings.frequency * t
    # A Lissajous figure that takes the spot to every side of the image.
    at_x, at_y = 0.4 * sin(angle + phase_x), 0.3 * cos(1.5 * angle + phase_y)
    distance2 = (x - np.float32(at_x)) ** 2 + (y - np.float32(at_y)) ** 2
    lit = 0.1 + 2.4 * np.exp(-distance2 / np.float32(2 * 0.2**2))
    return Effect(gain=(1 + settings.severity * (lit - 1)).astype(np.float32))


def _fade(settings: Settings, t: float, size: tuple[int, int], surface: Surface | None) -> Effect:
    return Effect(gain=fade_gain(settings, t), noise=settings.severity)


def _image_coordinates(size: tuple[int, int]) -> tuple[Field, Field]:
    """Give columns and rows from the centre of the image, in widths."""
    height, width = size
    x = (np.arange(width, dtype=np.float32) - np.float32((width - 1) / 2)) / np.float32(width)
    y = (np.arange(height, dtype=np.float32) - np.float32((height - 1) / 2)) / np.float32(width)
    return x[None, :], y[:, None]


def _step(x: Field) -> Field:
    """Go smoothly from 0 at -0.5 to 1 at 0.5."""
    u = np.clip(x + np.float32(0.5), 0, 1)
    return np.asarray(u * u * (3 - 2 * u))


#: The models by name; names joined by ``+`` work one after the other.
LIGHT_MODELS: Mapping[str, LightModel] = MappingProxyType(
    {
        model.name: model
        for model in (
            LightModel("ambient", "all light swings and jumps (paper)", 2.0, _ambient),
            LightModel(
                "diffuse",
                "a lamp swings beside the camera (paper)",
                2.0,
                _diffuse,
                needs_depth=True,
            ),
            LightModel("quadrants", "a gain and an offset for each quarter", 2.0, _quadrants),
            LightModel("exposure", "steps, as of an auto-exposure that hunts", 1.0, _exposure),
            LightModel("gamma", "the contrast curve swings", 2.0, _gamma),
            LightModel("flicker", "mains light, row by row (100 or 120 Hz)", 100.0, _flicker),
            LightModel("spotlight", "a spot wanders over a dim image", 0.5, _spotlight),
            LightModel("fade", "down to near dark and back, with noise", 0.1, _fade),
        )
    }
)


def find_models(name: str) -> tuple[LightModel, ...]:
    """Find the models that a name stands for.

    Parameters
    ----------
    name : str
        One of ``LIGHT_MODELS``, or several joined by ``+``, such as ``ambient+diffuse``.

    Returns
    -------
    tuple of LightModel
        In the order of the name.

    Raises
    ------
    SceneError
        If there is none of that name; the message lists those there are.
    """
    parts = [part.strip() for part in name.split("+")]
    for part in parts:
        if part not in LIGHT_MODELS:
            raise SceneError(
                f"unknown light model '{part}'; there are: {', '.join(LIGHT_MODELS)}, "
                "or several joined by +"
            )
    return tuple(LIGHT_MODELS[part] for part in parts)
