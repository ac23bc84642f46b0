"""Rendering: what a camera at a pose sees of a scene, exactly."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.cores import usable_cores
from edvo.errors import SceneError
from edvo.synthesis import kernels
from edvo.synthesis.geometry import World
from edvo.synthesis.infrared import Surface
from edvo.synthesis.light import ConstantLight, LightSignal, LightState
from edvo.synthesis.scene import Scene

F64 = NDArray[np.float64]
_BAND = 16  # rows that a thread takes at a time


@dataclass(frozen=True)
class Rendering:
    """One view of a scene, without any noise.

    Attributes
    ----------
    colour : (H, W, 3) float32
        Radiance, red, green, blue, linear; 1 is what a white surface has in full light.
    depth : (H, W) float32
        Metres along the optical axis at the pixel's centre; 0 where nothing is hit.
    normals : (H, W, 3) float32
        Unit vectors out of the surface, towards the camera, in the camera frame; 0 where nothing
        is hit.
    albedo : (H, W, 3) float32
        Share of light that the surface gives back.
    things : (H, W) int32
        Number of the thing seen (an index of `World.things`), -1 where nothing is hit.
    materials : (H, W) int32
        Number of its material, in the order of the scene, -1 where nothing is hit.
    """

    colour: NDArray[np.float32]
    depth: NDArray[np.float32]
    normals: NDArray[np.float32]
    albedo: NDArray[np.float32]
    things: NDArray[np.int32]
    materials: NDArray[np.int32]


@dataclass(frozen=True)
class Shutter:
    """How a camera gathers light over time.

    Parameters
    ----------
    exposure : float
        Seconds that a row gathers light, centred on its instant; 0 freezes motion.
    steps : int
        Instants averaged over the exposure.
    readout : float
        Seconds from the instant of the first row to that of the last, centred on the frame's
        stamp; 0 is a global shutter.
    """

    exposure: float = 0.0
    steps: int = 1
    readout: float = 0.0

    def __post_init__(self) -> None:
        if self.exposure < 0 or self.readout < 0 or self.steps < 1:
            raise SceneError(
                f"shutter with exposure {self.exposure}, steps {self.steps}, readout "
                f"{self.readout}; times must not be negative and steps at least 1"
            )


class Renderer:
    """Renders views of one scene through one camera.

    Each pixel is computed by itself, so the same view gives the same bytes for any number of
    threads. Moving things stand, during one view, where they are at its stamp.

    Parameters
    ----------
    scene : Scene or World
        What is seen.
    camera : Camera
        Pinhole with Brown distortion: rays leave through the raw pixels.
    samples : int
        A pixel across which an edge runs is averaged over samples x samples rays; 1 turns
        anti-aliasing off.
    threads : int, optional
        As many as the process may use by default.
    """

    def __init__(
        self,
        scene: Scene | World,
        camera: Camera,
        *,
        samples: int = 4,
        threads: int | None = None,
    ) -> None:
        if not 1 <= samples <= 8 or (threads is not None and threads < 1):
            raise SceneError(
                f"samples {samples}, threads {threads}; samples must be 1 to 8, threads at least 1"
            )
        self.world = scene if isinstance(scene, World) else World(scene)
        self.camera = camera
        self.light: LightState = self.world.scene.lights.state()
        self._samples = samples
        self._threads = threads or usable_cores()
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._rays = _rays(camera)
        self._pixel = np.array([1.0 / camera.fx, 1.0 / camera.fy])
        self._background = np.array(self.world.scene.background, float)

    def render(
        self,
        T_world_cam: F64,
        *,
        t: float = 0.0,
        light: LightState | None = None,
        lit: bool = True,
    ) -> Rendering:
        """Render one instant.

        Parameters
        ----------
        T_world_cam : (4, 4) float64
            Pose of the camera.
        t : float
            Seconds; where moving things are.
        light : LightState, optional
            The scene's own lamps by default.
        lit : bool
            False leaves colour and albedo black, which costs less where only depth is wanted.

        Returns
        -------
        Rendering
            The view.
        """
        poses = np.broadcast_to(np.asarray(T_world_cam, float)[:3], (self.camera.height, 3, 4))
        return self._trace(np.ascontiguousarray(poses), self.world.at(t), light or self.light, lit)

    def expose(
        self,
        motion: Callable[[float], F64],
        t: float,
        *,
        light: LightSignal | None = None,
        shutter: Shutter | None = None,
    ) -> Rendering:
        """Render what a moving camera gathers: motion blur and rolling shutter.

        Depth, normals and albedo are those of the middle of the exposure, row by row.

        Parameters
        ----------
        motion : callable
            T_world_cam (4, 4) of a time in seconds.
        t : float
            Seconds; the instant of the middle row.
        light : LightSignal, optional
            The scene's own lamps by default. It is read once per step, at its middle.
        shutter : Shutter, optional
            Instantaneous by default.

        Returns
        -------
        Rendering
            The view.
        """
        shutter = shutter or Shutter()
        signal = light or ConstantLight(self.light)
        height = self.camera.height
        rows = shutter.readout * ((np.arange(height) + 0.5) / height - 0.5)
        offsets = shutter.exposure * ((np.arange(shutter.steps) + 0.5) / shutter.steps - 0.5)
        solids = self.world.at(t)

        def poses(offset: float) -> F64:
            if shutter.readout == 0.0:
                one = np.asarray(motion(t + offset), float)[:3]
                return np.ascontiguousarray(np.broadcast_to(one, (height, 3, 4)))
            return np.array([motion(t + offset + float(row))[:3] for row in rows], float)

        if shutter.steps == 1 or shutter.exposure == 0.0:
            return self._trace(poses(0.0), solids, signal.at(t), True)
        middle = self._trace(poses(0.0), solids, signal.at(t), False)
        total = np.zeros(middle.colour.shape, np.float64)
        for offset in offsets:
            at = float(offset)
            total += self._trace(poses(at), solids, signal.at(t + at), True).colour
        colour = (total / shutter.steps).astype(np.float32)
        albedo = self._trace(poses(0.0), solids, signal.at(t), True, smooth=False).albedo
        return replace(middle, colour=colour, albedo=albedo)

    def surface(self, view: Rendering) -> Surface:
        """Give what a depth camera's pattern meets in a view.

        Parameters
        ----------
        view : Rendering
            By this renderer, lit.

        Returns
        -------
        Surface
            Its pixels.
        """
        found = Surface(*(np.empty(view.depth.shape, np.float32) for _ in range(3)))
        kernels.look_back(
            self._rays,
            view.normals,
            view.albedo,
            view.materials,
            self.world.infrared,
            self.world.paint.gloss,
            found.facing,
            found.scattered,
            found.mirrored,
        )
        return found

    def _trace(
        self, poses: F64, solids: kernels.Solids, light: LightState, lit: bool, smooth: bool = True
    ) -> Rendering:
        """Trace all rows, then supersample the edges."""
        size = (self.camera.height, self.camera.width)
        fill = np.empty if lit else np.zeros
        images = kernels.Images(
            fill((*size, 3), np.float32),
            np.empty(size, np.float32),
            np.empty((*size, 3), np.float32),
            fill((*size, 3), np.float32),
            np.empty(size, np.int32),
            np.empty(size, np.int32),
            np.empty(size, np.int32),
        )
        lamps, paint = _lamps(light), self.world.paint
        tile = _BAND if bool((poses[1:] == poses[:-1]).all()) else 1
        view = tile, self._rays, self._pixel, poses, solids, paint, lamps, self._background

        def trace(first: int) -> None:
            kernels.trace_rows(first, min(first + _BAND, size[0]), *view, lit, images)

        def supersample(first: int) -> None:
            last = min(first + _BAND, size[0])
            kernels.smooth_rows(first, last, *view, self._samples, images)

        self._share(trace)
        if lit and smooth and self._samples > 1:
            self._share(supersample)
        return Rendering(
            images.colour,
            images.depth,
            images.normal,
            images.albedo,
            images.thing,
            images.material,
        )

    def _share(self, work: Callable[[int], None]) -> None:
        """Do all bands of rows, in threads."""
        bands = range(0, self.camera.height, _BAND)
        if self._pool is None:
            for first in bands:
                work(first)
        else:
            list(self._pool.map(work, bands))


def _rays(camera: Camera) -> F64:
    """Give the direction of each raw pixel's centre on the plane z = 1, (H, W, 2)."""
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    raw = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    ideal = camera.undistort(raw) if camera.is_distorted else raw
    rays = (ideal - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.ascontiguousarray(rays.reshape(camera.height, camera.width, 2))


def _lamps(light: LightState) -> kernels.Lamps:
    """Give the light as arrays."""
    rows = []
    for far in light.directional:
        direction = np.array(far.direction, float)
        length = float(np.linalg.norm(direction))
        if length == 0.0:
            raise SceneError("a directional light without direction; give it one")
        rows.append(
            [0.0, *(direction / length), far.intensity, np.tan(far.angle), far.shadows, 0.0]
        )
    for near in light.point:
        rows.append([1.0, *near.position, near.intensity, near.radius, near.shadows, 0.0])
    return kernels.Lamps(float(light.ambient), np.array(rows, float).reshape(-1, 8))
