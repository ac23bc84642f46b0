"""Frames of a run as a strip of pictures: edges on the left, matches on the right."""

from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import Config
from edvo.report.animation import match_picture
from edvo.report.html import picture
from edvo.report.plots import edge_picture
from edvo.report.sights import Sight, look_again

_WIDTH = 520
_QUALITY = 82


def strip(sights: list[Sight], camera: Camera, config: Config, *, title: str, begin: float) -> str:
    """Show some frames.

    Parameters
    ----------
    sights : list of Sight
        Frames that were kept.
    camera : Camera
        Of all of them.
    config : Config
        Of the odometry.
    title : str
        Above all.
    begin : float
        Time of the first frame of the run, seconds.

    Returns
    -------
    str
        HTML; empty where there are no frames.
    """
    if not sights:
        return ""
    parts = [f"<h3>{escape(title)}</h3>", '<div class="film">']
    for sight in sights:
        image = film_frame(sight, camera, config)
        parts.append(picture(image, caption(sight, begin), kind="jpeg"))
    return "\n".join([*parts, "</div>"])


def film_frame(sight: Sight, camera: Camera, config: Config) -> bytes:
    """Draw edges and matches of a frame beside each other.

    Parameters
    ----------
    sight : Sight
        A frame that was kept.
    camera : Camera
        Its camera.
    config : Config
        Of the odometry.

    Returns
    -------
    bytes
        JPEG.
    """
    seen = look_again(sight, camera, config)
    size = (_WIDTH, round(_WIDTH * camera.height / camera.width))
    painted = np.rint(255 * edge_picture(seen.grey, seen.pixels, seen.gradients)[:, :, ::-1])
    edges = cv2.resize(painted.astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    matches = match_picture(seen.grey, seen.samples, seen.references, seen.residuals, size)
    gap = np.full((size[1], 8, 3), 255, np.uint8)
    both: NDArray[np.uint8] = np.hstack([np.asarray(edges, np.uint8), gap, matches])
    data: bytes = cv2.imencode(".jpg", both, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
    return data


def caption(sight: Sight, begin: float) -> str:
    """Say how a frame fared.

    Parameters
    ----------
    sight : Sight
        A frame that was kept.
    begin : float
        Time of the first frame of the run, seconds.

    Returns
    -------
    str
        A line.
    """
    result = sight.result
    words = [f"frame {result.index}, {result.timestamp - begin:.2f} s: {result.status.value}"]
    if result.reason:
        words.append(result.reason)
    found = result.alignment
    if found is None:
        words.append("the first keyframe" if result.is_keyframe else "not registered")
    elif not found.match_count:
        words.append(f"{found.plane_points} points on planes of keyframe {result.keyframe}")
    else:
        words.append(
            f"{found.inliers} of {len(found.matches)} samples fit keyframe {result.keyframe}, "
            f"sigma {found.sigma_px:.2f} px, {found.iterations} iterations"
        )
    if result.is_keyframe and found is not None:
        words.append("becomes a keyframe")
    return "; ".join(words)
