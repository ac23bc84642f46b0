"""What frames are seen, registered and judged with, together."""

from dataclasses import dataclass

from edvo.camera import Camera
from edvo.clock import Clock
from edvo.config import Config
from edvo.contours import Contours
from edvo.depth_alone import DepthAlone
from edvo.front_end import FrontEnd
from edvo.instants import Instants
from edvo.planes import PlaneFitter
from edvo.registration import Registration
from edvo.search import Search
from edvo.sharing import SharedErrors
from edvo.status import Judge
from edvo.uncertainty import Uncertainty


@dataclass(frozen=True, slots=True)
class Kit:
    """The tools of a tracker, for its parts to take those that they need.

    Attributes
    ----------
    camera : Camera
    config : Config
    clock : Clock
        Told which stage runs.
    registration : Registration
    fitter : PlaneFitter
    front_end : FrontEnd
    uncertainty : Uncertainty
    depth_alone : DepthAlone
    contours : Contours
    shared : SharedErrors
    instants : Instants
    judge : Judge
    search : Search
    """

    camera: Camera
    config: Config
    clock: Clock
    registration: Registration
    fitter: PlaneFitter
    front_end: FrontEnd
    uncertainty: Uncertainty
    depth_alone: DepthAlone
    contours: Contours
    shared: SharedErrors
    instants: Instants
    judge: Judge
    search: Search
