"""Places where a frame may have been taken: what each is worth, and when two are the same."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.edges import EdgePixels
from edvo.keyframes import Keyframe
from edvo.matching import EdgeIndex
from edvo.planes import DepthTerm, PlaneMap
from edvo.registration import Alignment
from edvo.seen import Seen

APART_M, APART_RAD = 0.1, math.radians(5.0)  # poses nearer to each other are the same place
LEAST_FIT = 0.6  # of the edges in view, both ways: chance a quarter each way


@dataclass(frozen=True, slots=True)
class Hunt:
    """What is looked for, and where: near the poses expected, within reach, no farther at all.

    Attributes
    ----------
    seen : Seen
        The frame.
    few : EdgePixels
        Some of its samples.
    edges : EdgeIndex
        Its edges, for keyframes to be registered with.
    planes : PlaneMap
        Its depth, likewise.
    expected : sequence of ndarray of float64, shape (4, 4)
        Where the camera may be expected, T_world_cam.
    reach : float
        How far from there it may well be, metres.
    farthest : float
        How far from there it may be at all, metres.
    term : DepthTerm
        How depth counts.
    before : Seen or None
        The frame before it, if depth is to be moved by how fast the camera goes.
    velocity : ndarray of float64, shape (6,), or None
        Of the camera, in its own frame, 1/s; None where it is not known.
    off_m : float
        By so much depth may be off its image, metres.
    must_be_sure : bool
        Whether a registration has to be beyond doubt.
    least_fit : float
        Share of the edges in view that must be explained, one way times the other.
    apart : (float, float)
        Metres and radians: poses nearer to each other, by both, are the same place.
    """

    seen: Seen
    few: EdgePixels
    edges: EdgeIndex
    planes: PlaneMap
    expected: Sequence[NDArray[np.float64]]
    reach: float
    farthest: float
    term: DepthTerm
    before: Seen | None = None
    velocity: NDArray[np.float64] | None = None
    off_m: float = 0.0
    must_be_sure: bool = True
    least_fit: float = LEAST_FIT
    apart: tuple[float, float] = (APART_M, APART_RAD)

    def away(self, T_world_cam: NDArray[np.float64]) -> float:
        """Tell how far a pose is from the nearest that is expected.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4)

        Returns
        -------
        float
            Metres.
        """
        return min(se3.distance(T_expected, T_world_cam) for T_expected in self.expected)

    def prior(self, T_world_cam: NDArray[np.float64]) -> float:
        """Tell what a place is worth before it is looked at.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4)

        Returns
        -------
        float
            Up to 1.
        """
        return math.exp(-((self.away(T_world_cam) / self.reach) ** 2) / 2)


@dataclass(frozen=True, slots=True)
class Place:
    """Where a frame may have been taken: its worth, and the registration that says so.

    Attributes
    ----------
    worth : float
        By how much of both it explains, and how far it is from where the camera is expected.
    T_world_cam : ndarray of float64, shape (4, 4)
    key : Keyframe
    found : Alignment
        Of the frame with that.
    agreed : float
        See `edvo.status.agreement`.
    both_ways : bool
        Whether the keyframe, registered with the frame, says the same.
    hunt : Hunt
        That it was found in; its frame may have been moved to one instant.
    by_edges : bool
        Whether depth would contradict it, were it taken at the instant of its image.
    """

    worth: float
    T_world_cam: NDArray[np.float64]
    key: Keyframe
    found: Alignment
    agreed: float
    both_ways: bool
    hunt: Hunt
    by_edges: bool


class Found(NamedTuple):
    """Where a lost camera is.

    Attributes
    ----------
    key : Keyframe
        That its frame fits.
    alignment : Alignment
        With that.
    seen : Seen
        The frame, its parts moved to one instant where it is known how fast the camera goes.
    velocity : ndarray of float64, shape (6,), or None
        Of the camera, in its own frame, 1/s; None where it is not known.
    by_edges : bool
        Whether depth would contradict it, were it taken at the instant of its image.
    """

    key: Keyframe
    alignment: Alignment
    seen: Seen
    velocity: NDArray[np.float64] | None
    by_edges: bool


def is_apart(
    T: NDArray[np.float64],
    others: Sequence[NDArray[np.float64]],
    metres: float = APART_M,
    radians: float = APART_RAD,
) -> bool:
    """Whether a pose is none of some others.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)
    others : sequence of ndarray of float64, shape (4, 4)
    metres, radians : float
        Poses nearer to each other, by both, are the same.

    Returns
    -------
    bool
    """
    return all(
        se3.distance(T, other) > metres or se3.rotation_angle(se3.inverse(T) @ other) > radians
        for other in others
    )


def distinct(places: Sequence[Place]) -> list[Place]:
    """Leave the worthiest registration of each place, the worthiest place first.

    Parameters
    ----------
    places : sequence of Place

    Returns
    -------
    list of Place
    """
    kept: list[Place] = []
    for place in sorted(places, key=lambda place: -place.worth):
        if is_apart(place.T_world_cam, [other.T_world_cam for other in kept]):
            kept.append(place)
    return kept
