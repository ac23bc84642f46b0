"""Keyframes that gather edges: what another light shows of a place that they have seen.

Not in the paper. A lamp that moves makes edges and takes others away, so that soon few of a frame
fit a keyframe that the camera has hardly left. A new one would hand its own error on, and be of no
more use once light has changed again. So the old one gathers the edges that it does not know.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.config import KeyframesConfig
from edvo.edges import EdgePixels
from edvo.keyframes import Keyframe, is_beyond
from edvo.matching import Criterion, EdgeIndex
from edvo.planes import camera_of
from edvo.registration import Registration

KNOWN_PX, KNOWN_DEG = 3.0, 45.0  # an edge is known where one lies so near and is turned alike


def carried(edges: EdgePixels, T: NDArray[np.float64], camera: Camera) -> EdgePixels:
    """Put edges where they are seen from another place.

    Parameters
    ----------
    edges : EdgePixels
        With depth; those without are left out.
    T : ndarray of float64, shape (4, 4)
        Maps points to the camera there.
    camera : Camera
        Of both images.

    Returns
    -------
    EdgePixels
        Those in its view, with the depth there.
    """
    n = len(edges)
    there = EdgePixels(
        np.empty((n, 2), np.float32),
        np.empty((n, 2), np.float32),
        np.empty(n, np.float32),
        np.empty_like(edges.profiles),
    )
    count = kernels.carry_edges(
        edges.pixels,
        edges.gradients,
        edges.depths,
        edges.profiles,
        np.ascontiguousarray(T, np.float64),
        camera_of(camera),
        there.pixels,
        there.gradients,
        there.depths,
        there.profiles,
    )
    return there.first(count)


def unknown(known: EdgeIndex, edges: EdgePixels, camera: Camera) -> EdgePixels:
    """Choose the edges near which no known one is turned alike.

    Parameters
    ----------
    known : EdgeIndex
    edges : EdgePixels
        Of the same view.
    camera : Camera

    Returns
    -------
    EdgePixels
    """
    near = Criterion(0.0, camera.width, KNOWN_PX, KNOWN_DEG)
    new = known.match(edges.pixels, edges.gradients, near).indices < 0
    return edges.where(new)


def gather(
    keyframe: Keyframe,
    edges: EdgePixels,
    T_key_cur: NDArray[np.float64],
    timestamp: float,
    registration: Registration,
    camera: Camera,
) -> Keyframe:
    """Add to a keyframe the edges of a frame that it does not know.

    Parameters
    ----------
    keyframe : Keyframe
    edges : EdgePixels
        Of the frame, with depth, where they were at one instant.
    T_key_cur : ndarray of float64, shape (4, 4)
        Where the frame was taken.
    timestamp : float
        When; seconds.
    registration : Registration
    camera : Camera
        Of both.

    Returns
    -------
    Keyframe
    """
    known = keyframe.edges
    new = unknown(known, carried(edges, T_key_cur, camera), camera)
    index = registration.index(known.edges.joined(new))
    gathered = keyframe.gathered + len(new)
    return replace(keyframe, edges=index, gathered=gathered, gathered_at=timestamp)


def may_gather(
    config: KeyframesConfig, keyframe: Keyframe, T_key_cur: NDArray[np.float64], overlap: float
) -> bool:
    """Whether a keyframe is to gather edges in place of giving way to a new one.

    Parameters
    ----------
    config : KeyframesConfig
    keyframe : Keyframe
        It has gathered no more than it has seen itself, and
    T_key_cur : ndarray of float64, shape (4, 4)
        the camera has hardly left it,
    overlap : float
        but too small a share of the frame's samples fit it.

    Returns
    -------
    bool
    """
    if config.rule != "motion" or not config.gather_share or overlap >= config.min_overlap:
        return False
    own = len(keyframe.edges) - keyframe.gathered
    return keyframe.gathered <= own and not is_beyond(config, T_key_cur, config.gather_share)
