"""How closely a frame is looked at: more of what errs each by itself is worth its time.

Not in the paper. Noise of its own averages out over more samples; what they err by together stays
(see `sharing`). Where little is shared more edges are drawn, if they are sharp, and planes and
their points are taken from more pixels.
"""

from typing import NamedTuple

from edvo.camera import Camera
from edvo.config import Config
from edvo.planes import FINER
from edvo.sharing import SharedErrors

# Once what is shared is so many times what each errs by alone, more of them tell little:
EDGES_ENOUGH = 1.0  # of the usual samples,
DEPTH_ENOUGH = 3.0  # of the usual points of depth, if they were all over the image
STAY = 1.5  # times that where they are fine already, of which a little more or less is measured
BLURRED_PX = 0.8  # edges that scatter so widely are smeared: more of those tell nothing new
# Planes say nothing along themselves: where few edges are left, those alone do, and have to count.
EDGES_A_POINT = 0.16  # matched, for each fine point that an image has room for


class Detail(NamedTuple):
    """How much is taken from a frame.

    Attributes
    ----------
    samples : int
        Edges that are drawn at most; 0 for all.
    is_fine : bool
        Whether points lie closely, and planes are fitted to more pixels; see `PlaneFitter`.
    is_near : bool
        Whether all edges of the keyframe may count: neither places nor what moves are told apart.
    is_faint : bool
        Whether faint edges are taken, too; see `thresholds`.
    """

    samples: int
    is_fine: bool
    is_near: bool
    is_faint: bool


def usual_detail(config: Config) -> Detail:
    """Give what is taken where nothing is known.

    Parameters
    ----------
    config : Config

    Returns
    -------
    Detail
    """
    return Detail(config.sampling.count, is_fine=False, is_near=False, is_faint=False)


def worthwhile_detail(
    config: Config,
    camera: Camera,
    shared: SharedErrors,
    *,
    was_fine: bool = False,
    shows_faint: bool = False,
) -> Detail:
    """Choose how much is worth taking, by what the frames of late share.

    Parameters
    ----------
    config : Config
        Its ``sampling.max_growth`` says how many more samples there may be, ``planes.finer``
        whether planes may be fine.
    camera : Camera
    shared : SharedErrors
    was_fine : bool, optional
        Of the last frame.
    shows_faint : bool, optional
        Whether the keyframe has faint edges that those of the frame may be.

    Returns
    -------
    Detail
    """
    count, growth = config.sampling.count, 1.0
    pays = shared.edge_share * count <= EDGES_ENOUGH  # no, where nothing is known
    if pays and shared.scatter_px < BLURRED_PX:
        growth = config.sampling.max_growth
    points = camera.width * camera.height / config.planes.point_step_px**2
    is_fine = bool(
        config.planes.finer == "measured"
        and shared.matches >= EDGES_A_POINT * FINER**2 * points
        and shared.depth_share * points < (STAY if was_fine else 1.0) * DEPTH_ENOUGH
    )
    return Detail(int(count * growth), is_fine, is_near=True, is_faint=shows_faint)
