"""Single registrations of a tracked sequence, to be made again under other settings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.config import Config
from edvo.edges import EdgePixels, extract_edges
from edvo.experiments.selection import spread
from edvo.experiments.sequences import Sequence
from edvo.matching import EdgeIndex
from edvo.odometry import Odometry, Status
from edvo.registration import Registration
from edvo.sampling import sample_edges
from edvo.sensor import DEPTH_NOISE


@dataclass(frozen=True, eq=False)
class Pair:
    """A frame and its keyframe, ready to be registered.

    Parameters
    ----------
    reference : EdgeIndex
        Edges of the keyframe.
    samples : EdgePixels
        Edges of the frame, with depth.
    T_ref_last : ndarray of float64, shape (4, 4)
        Pose of the frame before, which the paper starts from.
    T_ref_ahead : ndarray of float64, shape (4, 4)
        Pose to which that frame's motion leads when it goes on.
    """

    reference: EdgeIndex
    samples: EdgePixels
    T_ref_last: NDArray[np.float64]
    T_ref_ahead: NDArray[np.float64]

    @property
    def from_last(self) -> NDArray[np.float64]:
        """The paper's start as `Registration.align` takes it, shape (1, 4, 4)."""
        return self.T_ref_last[None]

    @property
    def starts(self) -> NDArray[np.float64]:
        """Both starts as the odometry has them, shape (2, 4, 4)."""
        return np.array([self.T_ref_ahead, self.T_ref_last])


def registration(sequence: Sequence, config: Config) -> Registration:
    """Make what registers the pairs of a sequence.

    Parameters
    ----------
    sequence : Sequence
        Which.
    config : Config
        How.

    Returns
    -------
    Registration
    """
    return Registration(
        sequence.camera,
        config.matching,
        config.registration,
        inlier_px=config.status.inlier_px,
    )


def pairs(sequence: Sequence, config: Config, count: int) -> list[Pair]:
    """Track a sequence and choose registrations from it, evenly spread.

    Parameters
    ----------
    sequence : Sequence
        Which.
    config : Config
        How it is tracked; edges, samples and the index are made by it.
    count : int
        How many; fewer where the sequence has fewer.

    Returns
    -------
    list of Pair
        Of frames that were not lost, whose two predecessors were not lost either.
    """
    camera = sequence.camera
    odometry = Odometry(camera, config)
    tracked = [odometry.track(frame) for frame in sequence.frames]
    usual = [
        three
        for three in zip(tracked, tracked[1:], tracked[2:], strict=False)
        if all(each.status is not Status.LOST for each in three)
    ]
    align = registration(sequence, config)
    indices: dict[int, EdgeIndex] = {}
    result = []
    for earlier, before, now in spread(usual, count):
        if now.keyframe not in indices:
            grey = sequence.frames[now.keyframe].grey
            indices[now.keyframe] = align.index(extract_edges(grey, config.edges).describe(camera))
        frame = sequence.frames[now.index]
        edges = extract_edges(frame.grey, config.edges)
        samples = sample_edges(
            edges,
            frame.depth,
            camera,
            config.sampling,
            config.edges,
            seed=now.index,
            noise=DEPTH_NOISE[config.planes.sensor],
        )
        T_world_key = tracked[now.keyframe].T_world_cam
        T_ref_last = se3.compose(se3.inverse(T_world_key), before.T_world_cam)
        T_earlier_last = se3.compose(se3.inverse(earlier.T_world_cam), before.T_world_cam)
        T_ref_ahead = se3.compose(T_ref_last, T_earlier_last)
        result.append(Pair(indices[now.keyframe], samples, T_ref_last, T_ref_ahead))
    return result
