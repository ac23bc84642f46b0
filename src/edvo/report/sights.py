"""Frames kept to be shown, with what the tracker made of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import extract_edges
from edvo.frame import Frame
from edvo.odometry import TrackedFrame
from edvo.rim import find_rim


@dataclass(frozen=True, slots=True)
class Sight:
    """A frame kept to be drawn.

    Attributes
    ----------
    frame : Frame
    result : TrackedFrame
    """

    frame: Frame
    result: TrackedFrame


@dataclass(frozen=True, slots=True)
class Seen:
    """What is drawn of a sight; pixels are ideal ones.

    Attributes
    ----------
    grey : ndarray, shape (H, W), uint8
        Its image without distortion.
    pixels, gradients : ndarray, shape (N, 2)
        Its edge pixels (u, v) and their unit gradients.
    samples, references : ndarray, shape (M, 2)
        Pixels of the samples with a match, and of the edges of the keyframe that they match.
    residuals : ndarray, shape (M,)
        Distances left, pixels.
    """

    grey: NDArray[np.uint8]
    pixels: NDArray[np.floating]
    gradients: NDArray[np.floating]
    samples: NDArray[np.floating]
    references: NDArray[np.floating]
    residuals: NDArray[np.floating]


def look_again(sight: Sight, camera: Camera, config: Config) -> Seen:
    """Find again, in a frame that is drawn, the edges and samples that the tracker had.

    Parameters
    ----------
    sight : Sight
        What was kept.
    camera : Camera
        Of the frame.
    config : Config
        Of the odometry that gave the result.

    Returns
    -------
    Seen
        Without matches where the frame was not registered.
    """
    return look(sight.frame, sight.result, camera, config)


def look(frame: Frame, result: TrackedFrame, camera: Camera, config: Config) -> Seen:
    """Find again, in a frame, the edges and samples that the tracker had.

    Parameters
    ----------
    frame : Frame
        What was tracked.
    result : TrackedFrame
        What was made of it.
    camera : Camera
        Of the frame.
    config : Config
        Of the odometry that gave the result.

    Returns
    -------
    Seen
        Without matches where the frame was not registered.
    """
    blind = find_rim(frame.grey, frame.depth) if config.edges.black_rim == "ignored" else None
    image = extract_edges(
        frame.grey,
        config.edges,
        scale=result.edge_scale,
        blind=blind,
        passes=result.edge_passes,
    )
    edges = image.describe(camera)
    samples = references = np.empty((0, 2), np.float32)
    residuals = np.empty(0)
    if result.alignment is not None:
        matched = result.alignment.matches >= 0
        samples, references = result.alignment.pixels[matched], result.alignment.references[matched]
        residuals = result.alignment.residuals[matched]
    grey = camera.undistort_image(frame.grey)
    return Seen(grey, edges.pixels, edges.gradients, samples, references, residuals)
