"""Who takes part in a comparison, by name."""

from collections.abc import Iterable
from functools import partial

from edvo.baselines.registry import (
    EDVO_NAMES,
    ZERO_MOTION,
    Tracker,
    expand,
    find_baseline,
    make_tracker,
)
from edvo.camera import Camera
from edvo.config import Config
from edvo.experiments.variants import variants_of
from edvo.odometry import Odometry
from edvo.report.compare import System


def edvo_and(peers: Iterable[str], *, repeats: int = 1, later: bool = False) -> list[System]:
    """Put edvo's two presets and some baselines beside each other.

    Parameters
    ----------
    peers : iterable of str
        Names of baselines and groups.
    repeats : int
        Runs of each that draws at random, each with another seed.
    later : bool
        Whether each run begins some frames later than the one before.

    Returns
    -------
    list of System
        edvo first. No motion is left out: it is a row of every comparison.

    Raises
    ------
    ConfigError
        If there is no baseline of a name.
    """
    names = dict.fromkeys([*EDVO_NAMES, *expand(peers)])
    return [_named(name, repeats, later) for name in names if name != ZERO_MOTION]


def variant_systems(preset: str, *, repeats: int = 1) -> list[System]:
    """Make a system of each change of one part of edvo.

    Parameters
    ----------
    preset : str
        What is changed, ``paper`` or ``default``.
    repeats : int
        Runs of each, each with another seed and some frames later than the one before.

    Returns
    -------
    list of System
        The unchanged preset first.

    Raises
    ------
    ConfigError
        If there is no such preset.
    """
    unchanged = System(
        f"edvo-{preset}",
        f"edvo, preset {preset}",
        "edvo",
        partial(_configured, config=Config.preset(preset)),
        repeats,
        later=True,
    )
    changed = [
        System(
            name,
            f"edvo, preset {preset}, one part changed",
            "variant",
            partial(_configured, config=config),
            repeats,
            later=True,
        )
        for name, config in variants_of(preset).items()
    ]
    return [unchanged, *changed]


def _named(name: str, repeats: int, later: bool) -> System:
    baseline = find_baseline(name)
    return System(
        name,
        baseline.title,
        "edvo" if name in EDVO_NAMES else "baseline",
        partial(make_tracker, name),
        repeats if baseline.draws else 1,
        later,
    )


def _configured(camera: Camera, seed: int, *, config: Config) -> Tracker:
    return Odometry(camera, config.with_overrides([f"seed={seed}"]))
