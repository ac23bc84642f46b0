"""How light changes over time: swings and sudden jumps, each a number for an instant."""

from bisect import bisect_right
from dataclasses import dataclass
from math import floor, inf, pi, sin

from edvo.errors import SceneError
from edvo.synthesis.randomness import generator


@dataclass(frozen=True)
class Swing:
    """A sine.

    Parameters
    ----------
    frequency : float
        Hz.
    phase : float
        Periods by which it is ahead.
    """

    frequency: float
    phase: float = 0.0

    def at(self, t: float) -> float:
        """Give its value, -1 to 1, at ``t`` seconds."""
        return sin(2 * pi * (self.frequency * t + self.phase))


@dataclass(frozen=True)
class Jumps:
    """A level that stays, and jumps at some instants.

    Parameters
    ----------
    seed : int
        Of the levels, and of the instants where none are given.
    instants : tuple of float, optional
        Seconds. By default one in each ``interval``, at a random place in it.
    interval : float
        Seconds.

    Raises
    ------
    SceneError
        If the instants are negative, no numbers or do not rise, or the interval is not above 0.

    Notes
    -----
    The level is 0 before the first jump; from then on it is of changing sign and between 0.6 and
    1 in size, so that each jump is one that is seen. It depends on the seed and on the instant
    alone, never on which instants were asked for before.
    """

    seed: int = 0
    instants: tuple[float, ...] | None = None
    interval: float = 1.5

    def __post_init__(self) -> None:
        """Check the instants."""
        if self.instants is not None and not all(0 <= each < inf for each in self.instants):
            raise SceneError(
                f"jump instants {list(self.instants)}; give seconds from the first image, 0 or more"
            )
        if self.instants is not None and list(self.instants) != sorted(set(self.instants)):
            raise SceneError(f"jump instants {list(self.instants)} do not rise; sort them")
        if not self.interval > 0:
            raise SceneError(f"the interval of jumps is {self.interval} s; give one above 0")

    def at(self, t: float) -> float:
        """Give the level, -1 to 1, at ``t`` seconds."""
        if self.instants is not None:
            latest = bisect_right(self.instants, t) - 1
        else:
            latest = floor(t / self.interval)
            if t < self._instant(latest):
                latest -= 1
        if latest < 0:
            return 0.0
        first = 1.0 if generator(self.seed, "first jump").random() < 0.5 else -1.0
        size = generator(self.seed, "jump size", latest).uniform(0.6, 1.0)
        return first * (-1.0) ** latest * float(size)

    def _instant(self, index: int) -> float:
        place = generator(self.seed, "jump instant", index).uniform(0.2, 0.8)
        return (index + float(place)) * self.interval
