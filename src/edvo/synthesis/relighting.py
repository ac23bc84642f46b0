"""Another light on images that are there already (paper, section V-A).

The image is taken back to linear light by the sRGB curve, lit anew, and saturated and rounded to
8 bits again, as a camera at fixed exposure would have shown it. Each image depends on the seed
and on its time alone, never on which images were relit before.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.derived import DerivedFrames
from edvo.datasets.source import Reading, Source
from edvo.errors import FrameError, SceneError
from edvo.synthesis import photometry
from edvo.synthesis.randomness import generator
from edvo.synthesis.relight_models import Effect, LightModel, Settings, find_models
from edvo.synthesis.surface import estimate_surface

_FULL_WELL = 2000.0
_READ_NOISE = 5.0

DEFAULT_MODEL = "ambient+diffuse"
DEFAULT_SEVERITY = 0.5


class Relighter:
    """A light model with its settings, checked once and used for many images.

    Parameters
    ----------
    model : str
        See :func:`~edvo.synthesis.relight_models.find_models`.
    severity : float
        From 0, which leaves the image as it is to the byte, to 1.
    frequency : float, optional
        Hz; the model's own by default (2 Hz for the two of the paper, whose Fig. 11 shows
        0.5 Hz).
    seed : int
        Of jumps, paths and noise.
    jumps : sequence of float, optional
        Instants of the sudden jumps, seconds; one every 1.5 s at random by default; none if
        empty.

    Raises
    ------
    SceneError
        If there is no such model or a number is out of range.
    """

    def __init__(
        self,
        model: str = DEFAULT_MODEL,
        *,
        severity: float = DEFAULT_SEVERITY,
        frequency: float | None = None,
        seed: int = 0,
        jumps: Sequence[float] | None = None,
    ) -> None:
        if not 0 <= severity <= 1:
            raise SceneError(f"light severity is {severity}; give a number from 0 to 1")
        if frequency is not None and not 0 < frequency < float("inf"):
            raise SceneError(f"light frequency is {frequency} Hz; give one above 0")
        if seed < 0:
            raise SceneError(f"light seed is {seed}; give 0 or more")
        self.models: tuple[LightModel, ...] = find_models(model)
        self.name = model
        self.severity = severity
        self.seed = seed
        instants = None if jumps is None else tuple(float(instant) for instant in jumps)
        self._settings = tuple(
            Settings(severity, frequency or part.frequency, seed, instants) for part in self.models
        )

    @property
    def needs_depth(self) -> bool:
        """Whether an image can only be relit together with its depth."""
        return self.severity > 0 and any(model.needs_depth for model in self.models)

    def relight(
        self,
        image: NDArray[np.uint8],
        depth: NDArray[np.float32] | None,
        camera: Camera | None,
        t: float,
    ) -> NDArray[np.uint8]:
        """Relight one image; see :func:`relight`."""
        if image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise FrameError(f"an image of {image.dtype} {image.shape}; relight 8-bit images")
        if self.severity == 0:
            return image.copy()
        effects = self._effects(image.shape[:2], depth, camera, t)
        if all(effect.is_global for effect in effects):
            # Any image is then relit by the 256 levels it can have.
            levels = np.arange(256, dtype=np.uint8)
            table = photometry.encode(_apply(effects, photometry.decode(levels), None))
            return np.asarray(cv2.LUT(image, table), dtype=np.uint8)
        rng = generator(self.seed, "light noise", float(t))
        # The rest is done for (rows, columns, channels).
        light = photometry.decode(image.reshape(*image.shape[:2], -1))
        return photometry.encode(_apply(effects, light, rng)).reshape(image.shape)

    def _effects(
        self,
        size: tuple[int, ...],
        depth: NDArray[np.float32] | None,
        camera: Camera | None,
        t: float,
    ) -> list[Effect]:
        surface = None
        if self.needs_depth:
            if depth is None or camera is None:
                raise SceneError(
                    f"light model '{self.name}' needs depth images and a camera; "
                    "choose a model without 'diffuse'"
                )
            if depth.shape != size:
                raise FrameError(
                    f"an image of {size[1]}x{size[0]} with a depth image of "
                    f"{depth.shape[1]}x{depth.shape[0]}; depth must be registered to colour"
                )
            surface = estimate_surface(depth, camera)
        return [
            model.effect(settings, t, (size[0], size[1]), surface)
            for model, settings in zip(self.models, self._settings, strict=True)
        ]


def relight(
    image: NDArray[np.uint8],
    depth: NDArray[np.float32] | None,
    camera: Camera | None,
    t: float,
    model: str = DEFAULT_MODEL,
    *,
    severity: float = DEFAULT_SEVERITY,
    frequency: float | None = None,
    seed: int = 0,
    jumps: Sequence[float] | None = None,
) -> NDArray[np.uint8]:
    """Show an image as it would look in another light.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W) or (H, W, C)
        Grey or colour in any order of channels, sRGB.
    depth : ndarray of float32, shape (H, W), or None
        Metres, 0 where missing. Only the ``diffuse`` model needs it.
    camera : Camera or None
        Of both images; needed with depth.
    t : float
        Seconds since the start of the sequence.
    model, severity, frequency, seed, jumps
        As for :class:`Relighter`.

    Returns
    -------
    ndarray of uint8, shape of ``image``
        The same for the same arguments.

    Raises
    ------
    SceneError
        If there is no such model, a number is out of range, or depth is missing and needed.
    FrameError
        If the image is not of 8 bits or the depth of another size.
    """
    relighter = Relighter(model, severity=severity, frequency=frequency, seed=seed, jumps=jumps)
    return relighter.relight(image, depth, camera, t)


class RelitSource(DerivedFrames):
    """A source whose images are relit as they are read.

    Parameters
    ----------
    source : Source
        Where the frames come from; depth, truth and stamps are passed on as they are.
    relighter : Relighter
        The light. Time 0 is the first frame of the source.

    Notes
    -----
    A frame holds grey, so grey is relit here; a folder made by ``relight_folder`` holds relit
    colour, whose grey differs by a level or two where channels saturate.
    """

    def __init__(self, source: Source, relighter: Relighter) -> None:
        super().__init__(source)
        self._relighter = relighter

    @property
    def name(self) -> str:
        """Name of the source and of the light."""
        return f"{self._source.name}+{self._relighter.name}"

    def read(self, index: int) -> Reading:
        """Read a frame and relight it; a problem is passed on.

        Parameters
        ----------
        index : int
            Which one, from 0.

        Returns
        -------
        Reading
            The source's, with another grey image.
        """
        reading = self._source.read(index)
        frame = reading.frame
        if frame is None:
            return reading
        t = reading.timestamp - float(self._source.timestamps[0])
        grey = self._relighter.relight(frame.grey, frame.depth, self._source.camera, t)
        return replace(reading, frame=replace(frame, grey=grey))

    def describe(self) -> dict[str, Any]:
        """Say what is assumed about the source, and which light is on it, in plain types."""
        light = {"model": self._relighter.name, "severity": self._relighter.severity}
        return {**self._source.describe(), "name": self.name, "light": light}


def _apply(
    effects: Sequence[Effect], light: NDArray[np.float32], rng: np.random.Generator | None
) -> NDArray[np.float32]:
    for effect in effects:
        if effect.exponent != 1:
            light = light ** np.float32(effect.exponent)
        light = light * _per_channel(effect.gain) + _per_channel(effect.offset)
        if effect.noise and rng is not None:
            electrons = np.maximum(light, 0) * np.float32(_FULL_WELL) + np.float32(_READ_NOISE**2)
            scale = np.sqrt(electrons) * np.float32(effect.noise / _FULL_WELL)
            light += scale * rng.standard_normal(light.shape, dtype=np.float32)
    return light


def _per_channel(field: float | NDArray[np.float32]) -> np.float32 | NDArray[np.float32]:
    return field[..., None] if isinstance(field, np.ndarray) else np.float32(field)
