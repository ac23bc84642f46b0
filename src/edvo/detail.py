"""How closely a frame is looked at: more of what errs each by itself is worth its time.

Not in the paper. Noise of its own averages out over more samples; what they err by together stays
(see `sharing`). Where little is shared more edges are drawn, and planes and their points are taken
from more pixels.
"""

import math
from typing import NamedTuple

from edvo.camera import Camera
from edvo.config import Config
from edvo.sharing import SharedErrors

# Once what is shared is so many times what each errs by alone, more of them tell little:
EDGES_ENOUGH = 6.0  # of the samples,
DEPTH_ENOUGH = 3.0  # of the usual points of depth, if they were all over the image
# Planes say nothing along themselves: where few edges are left, those alone do, and have to count.
EDGES_LEFT = 0.5  # of the usual samples in their places


class Detail(NamedTuple):
    """How much is taken from a frame.

    Attributes
    ----------
    samples : int
        Edges that are drawn at most; 0 for all.
    is_fine : bool
        Whether planes and points lie closely; see `PlaneFitter`.
    """

    samples: int
    is_fine: bool


def usual_detail(config: Config) -> Detail:
    """Give what is taken where nothing is known.

    Parameters
    ----------
    config : Config

    Returns
    -------
    Detail
    """
    return Detail(config.sampling.count, is_fine=False)


def worthwhile_detail(config: Config, camera: Camera, shared: SharedErrors) -> Detail:
    """Choose how much is worth taking, by what the frames of late share.

    Parameters
    ----------
    config : Config
        Its ``sampling.max_growth`` bounds the samples; ``planes.finer`` says whether planes may be
        fine.
    camera : Camera
    shared : SharedErrors

    Returns
    -------
    Detail
    """
    count, growth = config.sampling.count, 1.0
    together = shared.edge_share * count  # that the usual samples have, in times of their own
    if not math.isnan(together):
        growth = EDGES_ENOUGH / max(together, EDGES_ENOUGH / config.sampling.max_growth)
    points = camera.width * camera.height / config.planes.point_step_px**2
    is_fine = bool(
        config.planes.finer == "measured"
        and shared.matches >= EDGES_LEFT * count
        and shared.depth_share * points < DEPTH_ENOUGH
    )
    return Detail(int(count * max(growth, 1.0)), is_fine)
