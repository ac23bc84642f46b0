"""Light: what shines on a scene at one instant, and how that changes over time.

Everything is linear. A white Lambertian surface (albedo 1) under ``ambient = 1`` alone has
radiance 1, which is where a sensor at exposure 1 saturates; a light adds
``albedo * intensity * max(n . l, 0)``. Vectors are in the world frame of the scene.
"""

from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DirectionalLight:
    """A light so far away that its rays are parallel, such as the sun.

    Parameters
    ----------
    direction : 3 floats
        The way the light travels, in the world frame; of any length but zero.
    intensity : float
        Radiance that it gives a white surface which faces it.
    angle : float
        Half the angle it is seen under, radians: above 0 its shadows are soft.
    shadows : bool
        Whether things stand in its way.
    """

    direction: Vector
    intensity: float
    angle: float = 0.0
    shadows: bool = False


@dataclass(frozen=True)
class PointLight:
    """A lamp.

    Parameters
    ----------
    position : 3 floats
        World frame, metres.
    intensity : float
        Radiance that it gives a white surface which faces it at a distance of 1 m; it falls with
        the square of the distance.
    radius : float
        Radius of the lamp in metres: above 0 its shadows are soft.
    shadows : bool
        Whether things stand in its way.
    """

    position: Vector
    intensity: float
    radius: float = 0.0
    shadows: bool = False


@dataclass(frozen=True)
class LightState:
    """All the light of one instant.

    Parameters
    ----------
    ambient : float
        Radiance that a white surface has from all around, without any lamp.
    directional, point : tuples
        The lamps.
    """

    ambient: float = 1.0
    directional: tuple[DirectionalLight, ...] = field(default=())
    point: tuple[PointLight, ...] = field(default=())

    def scaled(self, factor: float, *, ambient: float | None = None) -> "LightState":
        """Multiply the light.

        Parameters
        ----------
        factor : float
            Of the lamps, and of the ambient light too where ``ambient`` is not given.
        ambient : float, optional
            Factor of the ambient light.

        Returns
        -------
        LightState
            The same lamps at other intensities.
        """
        return LightState(
            self.ambient * (factor if ambient is None else ambient),
            tuple(replace(lamp, intensity=lamp.intensity * factor) for lamp in self.directional),
            tuple(replace(lamp, intensity=lamp.intensity * factor) for lamp in self.point),
        )


@runtime_checkable
class LightSignal(Protocol):
    """Light over time."""

    def at(self, t: float) -> LightState:
        """Give the light at ``t`` seconds from the start of the sequence."""
        ...


@dataclass(frozen=True)
class ConstantLight:
    """Light that stays.

    Parameters
    ----------
    state : LightState
        The light at every instant.
    """

    state: LightState

    def at(self, t: float) -> LightState:
        """Give the light at ``t`` seconds: always the same."""
        return self.state
