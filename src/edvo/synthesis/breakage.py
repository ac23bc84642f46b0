"""Streams that break: what cameras deliver when something goes wrong, put into good frames.

A tracker that is honest says lost, or degraded, for as long as it cannot know where it is. Stamps
stay as they were: the camera moves on while its images tell nothing.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import SceneError
from edvo.frame import Frame
from edvo.synthesis.randomness import generator

BLACK = 4  # grey level of a sensor that sees nothing, and
READ_NOISE = 1.0  # its noise
PALM_M = (0.046, 0.058)  # half the width and half the height of a palm
FINGERS = (-0.036, -0.013, 0.011, 0.034)  # across the palm, metres
FINGER_M, FINGER_WIDTH_M, ARM_M = 0.085, 0.019, 0.036  # length, width; half the width of an arm
NEAREST_DEPTH_M = 0.28  # that a depth camera measures
TREMOR_M, TREMOR_HZ = 0.008, 2.3


@dataclass(frozen=True)
class Shown:
    """What is delivered at one instant.

    Parameters
    ----------
    timestamp : float
        Seconds.
    frame : Frame or None
        None where there is no frame to be had, as without any depth.
    fault : str
        What is wrong with it; empty where it is as it was.
    """

    timestamp: float
    frame: Frame | None
    fault: str = ""


@dataclass(frozen=True)
class Moment:
    """Where in a breakage a frame lies, and what else is at hand.

    Parameters
    ----------
    camera : Camera
        Of all frames.
    seen : Frame
        What the camera sees now.
    last : Frame
        What it saw last before the breakage.
    foreign : Frame
        What another camera sees elsewhere.
    progress : float
        From 0 to 1.
    rng : numpy.random.Generator
        Of this frame alone.
    """

    camera: Camera
    seen: Frame
    last: Frame
    foreign: Frame
    progress: float
    rng: np.random.Generator


def black(moment: Moment) -> Frame:
    """Show a black image, with noise; depth is measured on."""
    noise = moment.rng.normal(BLACK, READ_NOISE, moment.seen.grey.shape)
    grey = np.clip(np.rint(noise), 0, 255).astype(np.uint8)
    return replace(moment.seen, grey=grey)


def frozen(moment: Moment) -> Frame:
    """Show the last image and the last depth again, to the bit, with new stamps."""
    return replace(moment.last, timestamp=moment.seen.timestamp)


def stale_depth(moment: Moment) -> Frame:
    """Show the last depth again, to the bit, behind new images."""
    return replace(moment.seen, depth=moment.last.depth)


def swapped(moment: Moment) -> Frame:
    """Show what another camera sees."""
    return replace(moment.foreign, timestamp=moment.seen.timestamp)


def without_depth(moment: Moment) -> None:
    """Deliver no depth at all, of which no frame can be made."""


def hand(moment: Moment) -> Frame:
    """Hold a hand before the lens, too near for the depth camera to measure: most is covered."""
    return _with_hand(moment, distance_m=0.10, blur_px=15)


def arm(moment: Moment) -> Frame:
    """Reach into the view, with depth: up to a third of it is something else that moves."""
    return _with_hand(moment, distance_m=0.32, blur_px=3)


BREAKAGES: dict[str, Callable[[Moment], Frame | None]] = {
    "black": black,
    "frozen": frozen,
    "swapped": swapped,
    "without_depth": without_depth,
    "stale_depth": stale_depth,
    "hand": hand,
    "arm": arm,
}


def broken(
    kind: str,
    frames: Sequence[Frame],
    start: int,
    end: int,
    *,
    camera: Camera,
    foreign: Sequence[Frame],
    seed: int = 0,
) -> list[Shown]:
    """Break a stream for a while.

    Parameters
    ----------
    kind : str
        A key of ``BREAKAGES``.
    frames : sequence of Frame
        The good ones, which are not changed.
    start, end : int
        The first broken one, and the first good one after it.
    camera : Camera
        Of all frames.
    foreign : sequence of Frame
        From elsewhere, of the same size; shown from the first on, and again if they are few.
    seed : int
        Of noise and of the way a hand takes.

    Returns
    -------
    list of Shown
        As many as there are frames, with their stamps.

    Raises
    ------
    SceneError
        If there is no such kind, no good frame before the breakage, or no foreign frame.
    """
    if kind not in BREAKAGES:
        raise SceneError(f"no breakage {kind!r}; there are {', '.join(BREAKAGES)}")
    if not 0 < start <= end <= len(frames):
        raise SceneError(
            f"frames {start} to {end} of {len(frames)} cannot break; leave a good one before them"
        )
    if not foreign:
        raise SceneError("no foreign frames; give one at least")
    shown = [Shown(frame.timestamp, frame) for frame in frames]
    for index in range(start, end):
        moment = Moment(
            camera=camera,
            seen=frames[index],
            last=frames[start - 1],
            foreign=foreign[(index - start) % len(foreign)],
            progress=(index - start) / max(end - start - 1, 1),
            rng=generator(seed, kind, index),
        )
        shown[index] = Shown(frames[index].timestamp, BREAKAGES[kind](moment), kind)
    return shown


def _with_hand(moment: Moment, *, distance_m: float, blur_px: int) -> Frame:
    """Put a hand over a frame that comes in from the right, trembles and leaves again."""
    seen, camera = moment.seen, moment.camera
    inside = math.sin(math.pi * min(max(moment.progress, 0.02), 0.98)) ** 0.5
    across = (camera.width / 2 / camera.fx) * distance_m + PALM_M[0] + FINGER_M
    phase = 2 * math.pi * TREMOR_HZ * seen.timestamp
    centre = (
        (1 - inside) * across + TREMOR_M * math.sin(phase),
        0.02 + TREMOR_M * math.cos(1.7 * phase),
    )
    mask, light = _draw_hand(camera, centre, distance_m)
    light = np.asarray(cv2.GaussianBlur(light, (blur_px, blur_px), 0), np.float32)
    opaque = cv2.GaussianBlur(mask.astype(np.float32), (blur_px, blur_px), 0)
    noisy = light + moment.rng.normal(0, 2.0, light.shape).astype(np.float32)
    grey = opaque * noisy + (1 - opaque) * seen.grey
    depth = seen.depth.copy()
    if distance_m < NEAREST_DEPTH_M:
        depth[mask] = 0
    else:
        noise = moment.rng.normal(0, 0.001, depth.shape)
        depth[mask] = (distance_m + 0.02 * (1 - light / 190) + noise)[mask]
    if not depth.any():
        depth[0, 0] = 10.0  # what shines through between the fingers
    return replace(seen, grey=np.clip(np.rint(grey), 0, 255).astype(np.uint8), depth=depth)


def _draw_hand(
    camera: Camera, centre: tuple[float, float], distance_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Say where it covers the view, and how grey: fingers to the left, arm to the right."""
    scale = camera.fx / distance_m
    u0 = round(camera.cx + scale * centre[0])
    v0 = round(camera.cy + scale * centre[1])
    light = np.zeros((camera.height, camera.width), np.float32)

    def length(metres: float) -> int:
        return max(1, round(scale * metres))

    def bar(dv: float, reach: float, half: float, level: float) -> None:
        # Outside first and darker, so that what lies side by side shows an edge.
        for shrink, shade in ((1.0, 0.55), (0.85, 1.0)):
            thick = length(2 * half * shrink)
            end = (u0 + round(scale * reach), v0 + length(dv) if dv > 0 else v0 - length(-dv))
            cv2.line(light, (u0, end[1]), end, level * shade, thick)

    bar(0.001, 0.6, ARM_M, 150.0)
    for dv in FINGERS:
        bar(dv, -(PALM_M[0] + FINGER_M), FINGER_WIDTH_M / 2, 160.0)
    axes = (length(PALM_M[0]), length(PALM_M[1]))
    cv2.ellipse(light, (u0, v0), axes, 0, 0, 360, 165.0, -1)
    cv2.ellipse(light, (u0, v0), (axes[0] * 2 // 3, axes[1] * 2 // 3), 0, 200, 320, 120.0, 3)
    return light > 0, light
