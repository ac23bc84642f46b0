"""Which odometry there is to compare with, by name.

A baseline registers each frame with a keyframe; with `FRAME_TO_FRAME_SUFFIX` behind its name,
with the frame before. What it is made of is imported when one is made.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule
from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import ConfigError
from edvo.frame import Frame
from edvo.odometry import Odometry, TrackedFrame
from edvo.trajectory import Trajectory

FRAME_TO_FRAME_SUFFIX = "-f2f"
"""Behind a name: each frame is registered with the one before it."""

EDVO_NAMES = ("edvo-default", "edvo-paper")
"""The presets of edvo itself."""

ZERO_MOTION = "zero-motion"
"""Who does not move at all."""


class Tracker(Protocol):
    """What edvo and its baselines have in common."""

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of a frame."""
        ...

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be read."""
        ...

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the frames tracked so far, without those that were lost."""
        ...


@dataclass(frozen=True, slots=True)
class Baseline:
    """An odometry that can be made by its name.

    Attributes
    ----------
    name : str
        For the command line and tables.
    title : str
        What it is, in a line.
    group : str
        What else names it, together with others; empty for none.
    extra : str or None
        The extra of the package that it needs; None for the base install.
    make : callable
        Gives a tracker for a camera and a seed. Raises `MissingExtraError` where the extra is
        not installed.
    draws : bool
        Whether it draws at random, so that another seed gives another result.
    """

    name: str
    title: str
    group: str
    extra: str | None
    make: Callable[[Camera, int], Tracker]
    draws: bool = False


def baseline_names() -> tuple[str, ...]:
    """List every name there is, edvo's presets first.

    Returns
    -------
    tuple of str
        Groups are not among them.
    """
    return tuple(_ALL)


def group_names() -> tuple[str, ...]:
    """List the names that stand for several.

    Returns
    -------
    tuple of str
        ``all`` last: every baseline that registers with a keyframe. The suffix gives the same
        ones from frame to frame.
    """
    return tuple(_GROUPS)


def find_baseline(name: str) -> Baseline:
    """Look up a baseline.

    Parameters
    ----------
    name : str
        One of `baseline_names`.

    Returns
    -------
    Baseline
        Nothing is imported or made yet.

    Raises
    ------
    ConfigError
        If there is none of that name; the message lists those there are.
    """
    if name not in _ALL:
        kept = [name for name in _ALL if not name.endswith(FRAME_TO_FRAME_SUFFIX)]
        raise ConfigError(
            f"no baseline '{name}'; there are {', '.join(kept)}, most also with "
            f"'{FRAME_TO_FRAME_SUFFIX}' behind, and the groups {', '.join(_GROUPS)}"
        )
    return _ALL[name]


def make_tracker(name: str, camera: Camera, seed: int = 0) -> Tracker:
    """Make an odometry.

    Parameters
    ----------
    name : str
        One of `baseline_names`.
    camera : Camera
        Of the frames to come.
    seed : int
        Of what it draws at random, if anything.

    Returns
    -------
    Tracker
        At its beginning.

    Raises
    ------
    ConfigError
        If there is none of that name.
    MissingExtraError
        If its package is not installed; the message says how to install it.
    """
    return find_baseline(name).make(camera, seed)


def expand(names: Iterable[str]) -> tuple[str, ...]:
    """Put the members of groups in place of the groups.

    Parameters
    ----------
    names : iterable of str
        Baselines and groups.

    Returns
    -------
    tuple of str
        Names of baselines, each once, in the order given.

    Raises
    ------
    ConfigError
        If there is neither a baseline nor a group of a name.
    """
    found: list[str] = []
    for name in names:
        found += _members(name) or [find_baseline(name).name]
    return tuple(dict.fromkeys(found))


def _members(name: str) -> list[str]:
    """Members of a group, frame to frame where the suffix says so; none if it is no group."""
    group = name.removesuffix(FRAME_TO_FRAME_SUFFIX)
    suffix = name[len(group) :]
    return [member + suffix for member in _GROUPS.get(group, ()) if member + suffix in _ALL]


def _edvo(camera: Camera, seed: int, *, preset: str) -> Tracker:
    return Odometry(camera, Config.preset(preset).with_overrides([f"seed={seed}"]))


def _still(camera: Camera, seed: int) -> Tracker:
    from edvo.baselines.zero_motion import ZeroMotion

    return ZeroMotion(camera)


def _opencv(rule: KeyframeRule | None, camera: Camera, seed: int, *, kind: str) -> Tracker:
    from edvo.baselines.opencv import opencv_odometry

    return opencv_odometry(camera, kind, keyframes=rule)


def _open3d(rule: KeyframeRule | None, camera: Camera, seed: int, *, kind: str) -> Tracker:
    from edvo.baselines.open3d import open3d_odometry

    return open3d_odometry(camera, kind, keyframes=rule)


def _orb(rule: KeyframeRule | None, camera: Camera, seed: int) -> Tracker:
    from edvo.baselines.orb import orb_odometry

    return orb_odometry(camera, keyframes=rule, seed=seed)


def _direct(rule: KeyframeRule | None, camera: Camera, seed: int) -> Tracker:
    from edvo.baselines.direct import direct_odometry

    return direct_odometry(camera, keyframes=rule)


def _edge_distance(rule: KeyframeRule | None, camera: Camera, seed: int) -> Tracker:
    from edvo.baselines.edge_distance import edge_distance_odometry

    return edge_distance_odometry(camera, keyframes=rule)


_Pairwise = Callable[[KeyframeRule | None, Camera, int], Tracker]
_PAIRWISE: tuple[tuple[str, str, str, str | None, _Pairwise], ...] = (
    (
        "opencv-rgb",
        "OpenCV, brightness alone (Steinbruecker 2011, the paper's DVO)",
        "opencv",
        None,
        partial(_opencv, kind="rgb"),
    ),
    (
        "opencv-depth",
        "OpenCV, depth alone (ICP)",
        "opencv",
        None,
        partial(_opencv, kind="depth"),
    ),
    (
        "opencv-rgbd",
        "OpenCV, brightness and depth",
        "opencv",
        None,
        partial(_opencv, kind="rgbd"),
    ),
    (
        "opencv-fast-depth",
        "OpenCV, depth alone, FAST algorithm",
        "opencv",
        None,
        partial(_opencv, kind="fast-depth"),
    ),
    (
        "opencv-fast-rgbd",
        "OpenCV, brightness and depth, FAST algorithm",
        "opencv",
        None,
        partial(_opencv, kind="fast-rgbd"),
    ),
    (
        "open3d-hybrid",
        "Open3D tensor, brightness and depth, 40/30/20 iterations",
        "open3d",
        "open3d",
        partial(_open3d, kind="hybrid"),
    ),
    (
        "open3d-intensity",
        "Open3D tensor, brightness alone, 40/30/20 iterations",
        "open3d",
        "open3d",
        partial(_open3d, kind="intensity"),
    ),
    (
        "open3d-plane",
        "Open3D tensor, depth alone (point to plane), 40/30/20 iterations",
        "open3d",
        "open3d",
        partial(_open3d, kind="plane"),
    ),
    (
        "open3d-legacy-hybrid",
        "Open3D legacy, brightness and depth",
        "open3d",
        "open3d",
        partial(_open3d, kind="legacy-hybrid"),
    ),
    (
        "open3d-legacy-colour",
        "Open3D legacy, brightness alone",
        "open3d",
        "open3d",
        partial(_open3d, kind="legacy-colour"),
    ),
    ("orb-pnp", "ORB features, ratio test, PnP with RANSAC", "", None, _orb),
    ("direct-t", "direct, t-distribution (Kerl 2013)", "", None, _direct),
    ("edge-dt", "edges, distance transform, unsigned residual", "", None, _edge_distance),
)


def _of_the_table() -> dict[str, Baseline]:
    found = {
        name: Baseline(
            name,
            f"edvo, preset {name.removeprefix('edvo-')}",
            "",
            None,
            partial(_edvo, preset=name.removeprefix("edvo-")),
            draws=True,
        )
        for name in EDVO_NAMES
    }
    found[ZERO_MOTION] = Baseline(ZERO_MOTION, "no motion at all", "", None, _still)
    for name, title, group, extra, make in _PAIRWISE:
        found[name] = Baseline(name, title, group, extra, partial(make, None), draws=make is _orb)
    for name, title, _, _, make in _PAIRWISE:
        found[name + FRAME_TO_FRAME_SUFFIX] = replace(
            found[name],
            name=name + FRAME_TO_FRAME_SUFFIX,
            title=f"{title}; frame to frame",
            make=partial(make, FRAME_TO_FRAME),
        )
    return found


_ALL = _of_the_table()
_GROUPS: dict[str, tuple[str, ...]] = {
    "opencv": tuple(name for name, _, group, *_ in _PAIRWISE if group == "opencv"),
    "open3d": tuple(name for name, _, group, *_ in _PAIRWISE if group == "open3d"),
    "all": tuple(name for name, *_ in _PAIRWISE),
}
