"""What is made of an image before its pose is known, and of that a keyframe."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from edvo import kernels
from edvo.camera import Camera
from edvo.carried import Carried
from edvo.chamfer import ChamferMap
from edvo.clock import Clock
from edvo.config import Config, SamplingConfig
from edvo.detail import Detail, usual_detail
from edvo.edges import EdgeBuffers, EdgeImage, EdgePixels, edges_to_keep, extract_edges
from edvo.exposure import Exposure
from edvo.frame import Frame
from edvo.keyframes import Keyframe
from edvo.look import Look
from edvo.planes import PlaneFitter, PlaneMap, thinned
from edvo.registration import Alignment, Registration
from edvo.reobservation import Reobserved
from edvo.rim import Rim
from edvo.sampling import sample_edges
from edvo.seen import Seen
from edvo.sensor import DEPTH_NOISE
from edvo.smear import Smear

SEED_STRIDE = 1_000_003  # frames that seeds keep apart
FEW = 300  # edges: an image that is blurred by more, and shows fewer, is not
GATHERED = 6000  # edges that a keyframe is shown of another light: more would delay a frame


class FrontEnd:
    """Sees frames, and makes keyframes of what it has seen.

    Parameters
    ----------
    camera : Camera
        Of the frames to come.
    config : Config
    registration : Registration
        Which the keyframes are for.
    fitter : PlaneFitter
    clock : Clock
        Told which stage runs.
    exposure : Exposure
        Of the images.

    Attributes
    ----------
    carried : Carried or None
        What of the images is the camera's own; None where nobody asks.
    """

    def __init__(
        self,
        camera: Camera,
        config: Config,
        registration: Registration,
        fitter: PlaneFitter,
        clock: Clock,
        exposure: Exposure,
    ) -> None:
        self._camera, self._config, self._clock = camera, config, clock
        self._registration, self._fitter = registration, fitter
        self._buffers = EdgeBuffers(camera.height, camera.width)
        self._rim = Rim()
        self._smear = Smear(config.edges, exposure)
        self._blind: NDArray[np.bool_] | None = None
        is_asked = config.edges.carried == "left-out"
        self.carried = Carried(camera, self._buffers) if is_asked else None
        self._reobserved = Reobserved(camera)
        self._chooses = config.sampling.selection == "informative"

    def see(
        self,
        frame: Frame,
        index: int,
        T_cam_depth: NDArray[np.float64] | None = None,
        detail: Detail | None = None,
        *,
        again: bool = False,
    ) -> Seen:
        """Find edges, draw some of them, and ask the depth image for planes.

        Parameters
        ----------
        frame : Frame
            Of the size of the camera.
        index : int
            Number of the frame, which decides what is drawn.
        T_cam_depth : ndarray of float64, shape (4, 4), optional
            Maps points of the depth image to the camera at the instant of the grey image; taken to
            be the same where not given.
        detail : Detail, optional
            How much is taken from it; the usual where not given.
        again : bool, optional
            Whether it was seen before: how smeared it is tells nothing new.

        Returns
        -------
        Seen
            Its gradients last until the next frame is seen, or this one is to be kept.
        """
        config = self._config
        count, fine, near, faint = usual_detail(config) if detail is None else detail
        with self._clock("edges"):
            ignored = config.edges.black_rim == "ignored"
            self._blind = self._rim.near(frame.grey, frame.depth) if ignored else None
            edges = self._edges(frame, faint=faint)
        with self._clock("planes"):
            points = self._fitter.points(frame.depth, T_cam_depth, fine=fine)
        with self._clock("sampling"):
            seed = config.seed * SEED_STRIDE + index
            samples = self._drawn(edges, frame, T_cam_depth, count, seed)
            if not again:
                self._smear.note(edges, samples.profiles, frame.timestamp)
        return Seen(frame, edges, samples, points, T_cam_depth, fine, near)

    def _edges(self, frame: Frame, *, faint: bool) -> EdgeImage:
        """Find the edges of a frame, blurred by as much as those before it call for."""
        found = self._edges_after(frame, self._smear.passes, faint=faint)
        return self._as_usual(frame, faint=faint) if found.passes and len(found) < FEW else found

    def _as_usual(self, frame: Frame, *, faint: bool) -> EdgeImage:
        """Find the edges of a frame that shows too few where it is blurred by more."""
        self._smear.forget()
        return self._edges_after(frame, 0, faint=faint)

    def _edges_after(self, frame: Frame, passes: int, *, faint: bool) -> EdgeImage:
        """Find the edges of a frame after so many passes of a blur beyond the usual."""
        return extract_edges(
            frame.grey,
            self._config.edges,
            self._buffers,
            faint=faint,
            blind=self._blind,
            passes=passes,
        )

    def to_keep(self, seen: Seen) -> tuple[Seen, int]:
        """Find the edges that a keyframe is to have: those that tell places, and fainter ones.

        Parameters
        ----------
        seen : Seen
            The frame that was seen last.

        Returns
        -------
        seen : Seen
            With those edges; samples are of the ones that tell places alone.
        telling : int
            How many of them, the first ones, do.
        """
        config, share = self._config.edges, self._config.keyframes.edge_scale
        found, faint = seen.edges, seen.edges.is_faint
        if self._smear.settle() != found.passes:
            found = self._edges(seen.frame, faint=faint)
        edges, telling = edges_to_keep(found, config, self._buffers, share)
        if found.passes and telling < FEW:
            found = self._as_usual(seen.frame, faint=faint)
            edges, telling = edges_to_keep(found, config, self._buffers, share)
        samples = seen.samples
        if found is not seen.edges or telling < len(found):  # some of these are of faint ones
            first = replace(edges, index=edges.index[:telling])
            samples = self._drawn(first, seen.frame, seen.T_cam_depth, self._config.sampling.count)
        return replace(seen, edges=edges, samples=samples), telling

    def edges_with_depth(self, seen: Seen) -> EdgePixels:
        """Describe edges of what was seen last that have depth, at most ``GATHERED`` of them.

        Parameters
        ----------
        seen : Seen

        Returns
        -------
        EdgePixels
        """
        at_random = self._config.sampling.model_copy(update={"selection": "random"})
        return self._drawn(seen.edges, seen.frame, seen.T_cam_depth, GATHERED, sampling=at_random)

    def _drawn(
        self,
        edges: EdgeImage,
        frame: Frame,
        T_cam_depth: NDArray[np.float64] | None,
        count: int,
        seed: int | None = None,
        sampling: SamplingConfig | None = None,
    ) -> EdgePixels:
        """Draw so many of the edges that have depth, or all."""
        config = self._config
        return sample_edges(
            edges,
            frame.depth,
            self._camera,
            sampling or config.sampling,
            config.edges,
            config.seed if seed is None else seed,
            T_cam_depth,
            count,
            DEPTH_NOISE[config.planes.sensor],
            self._reobserved.worth if self._chooses else None,
        )

    def note(self, seen: Seen, alignment: Alignment) -> None:
        """Learn which edges are observed again, where samples are chosen by that.

        Parameters
        ----------
        seen : Seen
        alignment : Alignment
            Of its samples, where it is *tracked*.
        """
        if self._chooses:
            self._reobserved.note(seen.samples, alignment)

    def forget(self) -> None:
        """Start anew: nothing is known of which edges are observed again."""
        self._reobserved.forget()

    def reset(self) -> None:
        """Forget what is known of the camera's images as well."""
        self.forget()
        self._rim = Rim()
        if self.carried is not None:
            self.carried.forget()
        self._smear.forget()

    def keyframe(
        self,
        seen: Seen,
        index: int,
        T_world_key: NDArray[np.float64],
        piece: int,
        edges: EdgePixels | None = None,
        telling: int | None = None,
        planes: PlaneMap | None = None,
    ) -> Keyframe:
        """Make a keyframe.

        Parameters
        ----------
        seen : Seen
            The frame that was seen last.
        index : int
            Its number.
        T_world_key : ndarray of float64, shape (4, 4)
        piece : int
            Of the path.
        edges : EdgePixels, optional
            Of the frame; described anew where not given.
        telling : int, optional
            How many of them, the first ones, tell places; all of them where not given.
        planes : PlaneMap, optional
            Of its depth image; found anew where not given.

        Returns
        -------
        Keyframe
        """
        edges = seen.edges.describe(self._camera) if edges is None else edges
        samples, usual = seen.samples, self._config.sampling.count
        if usual:
            samples = samples.every(max(math.ceil(len(samples) / usual), 1))
        first = len(edges) if telling is None else telling
        every, tells = self._registration.indices(edges, first)
        if planes is None:
            planes = self._fitter.planes(seen.frame.depth, seen.T_cam_depth, fine=seen.is_fine)
        return Keyframe(
            index=index,
            T_world_key=rigid(T_world_key),
            edges=every,
            telling=tells,
            planes=planes,
            samples=samples,
            points=thinned(seen.points, self._config.planes.point_step_px),
            look=Look(tells.edges, self._camera),
            chamfer=ChamferMap(tells.edges, self._camera),
            timestamp=seen.frame.timestamp,
            piece=piece,
            is_faint=tells is not every,
        )


def rigid(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make a rotation exact: products drift off the group, and predictions amplify that.

    Parameters
    ----------
    T : ndarray of float64, shape (4, 4)

    Returns
    -------
    ndarray of float64, shape (4, 4)
        A copy.
    """
    result = np.array(T, np.float64)
    kernels.orthonormalize(result)
    return result
