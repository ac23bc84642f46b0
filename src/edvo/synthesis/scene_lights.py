"""Changing light inside a scene: its lamps themselves change, and the renderer does the rest."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin
from types import MappingProxyType

from edvo.errors import SceneError
from edvo.synthesis.light import LightSignal, LightState, Vector
from edvo.synthesis.light_signals import Swing
from edvo.synthesis.relight_models import (
    LIGHT_MODELS,
    Settings,
    ambient_gain,
    exposure_gain,
    fade_gain,
)

# What the lamps do at the hardest: turn about the vertical, and move.
_TURN = radians(35.0)
_MOVE = 0.8

_Change = Callable[[Settings, float, LightState], LightState]


def _constant(settings: Settings, t: float, state: LightState) -> LightState:
    return state


def _ambient(settings: Settings, t: float, state: LightState) -> LightState:
    return state.scaled(ambient_gain(settings, t))


def _exposure(settings: Settings, t: float, state: LightState) -> LightState:
    return state.scaled(exposure_gain(settings, t))


def _fade(settings: Settings, t: float, state: LightState) -> LightState:
    return state.scaled(fade_gain(settings, t))


def _diffuse(settings: Settings, t: float, state: LightState) -> LightState:
    severity = settings.severity

    def swing(lamp: int) -> float:
        # Lamps out of step: the light then changes from place to place, not as a whole.
        return Swing(settings.frequency, phase=lamp / 3).at(t)

    def level(lamp: int, intensity: float) -> float:
        return intensity * float(2.0 ** (1.5 * severity * swing(lamp)))

    directional = tuple(
        replace(
            lamp,
            direction=_turned(lamp.direction, _TURN * severity * swing(i)),
            intensity=level(i, lamp.intensity),
        )
        for i, lamp in enumerate(state.directional)
    )
    point = tuple(
        replace(
            lamp,
            position=(
                lamp.position[0] + _MOVE * severity * swing(i),
                lamp.position[1],
                lamp.position[2],
            ),
            intensity=level(i, lamp.intensity),
        )
        for i, lamp in enumerate(state.point, start=len(state.directional))
    )
    return LightState(state.ambient, directional, point)


def _turned(direction: Vector, angle: float) -> Vector:
    x, y, z = direction
    return (cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y, z)


_CHANGES: Mapping[str, _Change] = MappingProxyType(
    {
        "constant": _constant,
        "ambient": _ambient,
        "diffuse": _diffuse,
        "exposure": _exposure,
        "fade": _fade,
    }
)

#: The names that `scene_light` knows, which may be joined by ``+``.
SCENE_LIGHTS: tuple[str, ...] = tuple(_CHANGES)


@dataclass(frozen=True)
class _ChangingLight:
    state: LightState
    changes: tuple[tuple[_Change, Settings], ...]

    def at(self, t: float) -> LightState:
        state = self.state
        for change, settings in self.changes:
            state = change(settings, t, state)
        return state


def scene_light(
    name: str,
    state: LightState,
    *,
    severity: float = 0.5,
    frequency: float | None = None,
    seed: int = 0,
    jumps: Sequence[float] | None = None,
) -> LightSignal:
    """Let the lamps of a scene change.

    Parameters
    ----------
    name : str
        One of ``SCENE_LIGHTS``, or several joined by ``+``, such as ``ambient+diffuse``.
    state : LightState
        The lamps as the scene has them; the vertical of the world is z.
    severity : float
        0 leaves them as they are, 1 is the hardest.
    frequency : float, optional
        Hz; by default that of the light model of the same name in relighting.
    seed : int
        Of the jumps.
    jumps : sequence of float, optional
        Instants of the jumps, seconds; random by default, none if empty.

    Returns
    -------
    LightSignal
        The light at each instant.

    Raises
    ------
    SceneError
        If there is no such name, which lists those there are, or a number is out of range.
    """
    if not 0 <= severity <= 1:
        raise SceneError(f"light severity is {severity}; give a number from 0 to 1")
    if frequency is not None and not 0 < frequency < float("inf"):
        raise SceneError(f"light frequency is {frequency} Hz; give one above 0")
    instants = None if jumps is None else tuple(float(instant) for instant in jumps)
    changes = []
    for part in (part.strip() for part in name.split("+")):
        if part not in _CHANGES:
            raise SceneError(
                f"unknown light '{part}'; there are: {', '.join(SCENE_LIGHTS)}, "
                "or several joined by +"
            )
        own = LIGHT_MODELS[part].frequency if part in LIGHT_MODELS else 1.0
        changes.append((_CHANGES[part], Settings(severity, frequency or own, seed, instants)))
    return _ChangingLight(state, tuple(changes))
