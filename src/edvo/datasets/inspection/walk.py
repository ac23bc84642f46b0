"""How the camera moved between frames, by their edges alone.

Depth counts only by where edges lie, so that a wrong depth scale scales the motion and does
nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels, extract_edges
from edvo.frame import Frame
from edvo.matching import EdgeIndex
from edvo.registration import Alignment, Registration
from edvo.sampling import sample_edges

Pose = NDArray[np.float64]

# Its own, on which the bounds of the checks were measured: a better default shall not move them.
CONFIG = Config().with_overrides(
    [
        "sampling.count=800",
        "edges.position=pixel",
        "edges.grey_steps=1",
        "edges.max_noise=0",
        "edges.depth_rule=window",
        "planes.doubt=0.7",
        "planes.edge_doubt_px=0",
        "planes.finer=none",
        "sampling.max_growth=1",
        "registration.max_stretch=1",
        "registration.kept_px=0",
    ]
)
FIT = 0.65  # share of the edges that fit, with which a motion is believed
TURN_DEG = 6.0  # between the turns that a registration starts from
UNMATCHED_PX = 3.0  # what an edge counts at most


@dataclass(frozen=True)
class Step:
    """One frame of a walk.

    Parameters
    ----------
    timestamp : float
        Seconds.
    index : EdgeIndex
        Its edges, to register with.
    samples : EdgePixels
        Some of them with depth, to be registered.
    T_first_cur : ndarray of float64, shape (4, 4)
        Its pose in the first frame of its chain.
    chain : int
        Frames of one chain are linked by motions that can be believed.
    """

    timestamp: float
    index: EdgeIndex
    samples: EdgePixels
    T_first_cur: Pose
    chain: int


def registration(camera: Camera, factor: float = 1.0) -> Registration:
    """Make what registers steps of a camera, with a focal length so many times as long.

    Parameters
    ----------
    camera : Camera
        As assumed; the distortion that it takes out of the edges stays as it is.
    factor : float
        Of both focal lengths.

    Returns
    -------
    Registration
    """
    changed = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)
    return Registration(changed, CONFIG.matching, CONFIG.registration)


def mean_residual(alignment: Alignment) -> float:
    """Say how well edges lie on each other: the mean distance, px; 3 at most for each."""
    absolute = np.nan_to_num(np.abs(alignment.residuals), nan=UNMATCHED_PX)
    return float(np.minimum(absolute, UNMATCHED_PX).mean()) if len(absolute) else UNMATCHED_PX


def walk(frames: Sequence[Frame], camera: Camera, first_chain: int = 0) -> list[Step]:
    """Register each frame with the one before.

    Parameters
    ----------
    frames : sequence of Frame
        In order, not too far apart.
    camera : Camera
    first_chain : int
        Number of the first chain.

    Returns
    -------
    list of Step
    """
    register = registration(camera)
    turns = _turns()
    steps: list[Step] = []
    T_before_last, chain = np.eye(4), first_chain
    for frame in frames:
        image = extract_edges(frame.grey, CONFIG.edges)
        index = register.index(image.describe(camera))
        samples = sample_edges(
            image, frame.depth, camera, CONFIG.sampling, CONFIG.edges, CONFIG.seed
        )
        T_first_cur = np.eye(4)
        if steps:
            last = steps[-1]
            found = register.align(last.index, samples, np.array([T_before_last, *turns]))
            if _is_good(found):
                T_before_last = found.T_ref_cur
                T_first_cur = last.T_first_cur @ found.T_ref_cur
            else:
                T_before_last, chain = np.eye(4), chain + 1
        steps.append(Step(frame.timestamp, index, samples, T_first_cur, chain))
    return steps


def walk_all(walks: Sequence[Sequence[Frame]], camera: Camera) -> list[Step]:
    """Walk several runs of frames; chains do not go from one to the next."""
    steps: list[Step] = []
    for frames in walks:
        steps += walk(frames, camera, steps[-1].chain + 1 if steps else 0)
    return steps


def pairs_within(steps: Sequence[Step], farthest: int) -> list[tuple[Step, Step]]:
    """Pairs of steps of one chain, so many frames apart at most."""
    pairs = []
    for apart in range(1, farthest + 1):
        pairs += [(a, b) for a, b in zip(steps, steps[apart:], strict=False) if a.chain == b.chain]
    return pairs


def motion(a: Step, b: Step) -> Pose:
    """T_a_b of two steps of one chain."""
    return np.asarray(se3.inverse(a.T_first_cur) @ b.T_first_cur)


def _is_good(alignment: Alignment) -> bool:
    enough = alignment.inliers >= FIT * max(len(alignment.matches), 1)
    return alignment.converged and enough and len(alignment.matches) >= 50


def _turns() -> list[Pose]:
    angle = np.deg2rad(TURN_DEG)
    turns = [(pitch * angle, yaw * angle) for yaw in (-2, -1, 0, 1, 2) for pitch in (-1, 0, 1)]
    turns.sort(key=lambda turn: abs(turn[0]) + abs(turn[1]))
    return [se3.exp(np.array([0, 0, 0, pitch, yaw, 0])) for pitch, yaw in turns]
