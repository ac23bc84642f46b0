"""Keyframes: the references that frames are registered with, and when to take a new one (§V-C)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.config import KeyframesConfig
from edvo.matching import EdgeIndex
from edvo.planes import PlaneMap


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A frame that others are registered with.

    Attributes
    ----------
    index : int
        Of the frame in the sequence.
    T_world_key : ndarray of float64, shape (4, 4)
    edges : EdgeIndex
        All its edges; those without depth serve too.
    planes : PlaneMap
        The planes that its depth image shows; none where the term is left out.
    """

    index: int
    T_world_key: NDArray[np.float64]
    edges: EdgeIndex
    planes: PlaneMap


def is_due(
    config: KeyframesConfig, T_key_cur: NDArray[np.float64], overlap: float, age: int
) -> bool:
    """Whether the frame just tracked should become the next keyframe.

    Parameters
    ----------
    config : KeyframesConfig
    T_key_cur : ndarray of float64, shape (4, 4)
        Motion since the keyframe.
    overlap : float
        Share of the frame's samples that fit the keyframe.
    age : int
        Frames since the keyframe.

    Returns
    -------
    bool
    """
    if config.rule == "gap":
        return age >= config.gap_frames
    x, y, z = T_key_cur[:3, 3].tolist()
    return (
        math.hypot(x, y, z) > config.max_translation_m
        or se3.rotation_angle(T_key_cur) > math.radians(config.max_rotation_deg)
        or overlap < config.min_overlap
    )
