"""Space in the viewer: camera, path, truth, keyframes, and the edge map as it grows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import Config
from edvo.export.edge_map import EdgeMap, EdgePoints
from edvo.frame import Frame
from edvo.odometry import Status
from edvo.report.plots import direction_colours
from edvo.report.viewer_library import load_rerun
from edvo.report.viewer_names import CAMERA, KEYFRAMES, MAP, PATH, TRUTH, WORLD
from edvo.report.viewer_recorder import Recorder
from edvo.report.viewer_shot import Shot

VOXEL_M = 0.02
MOST_EDGES = 300_000  # what a window turns without effort
FRUSTUM_M = 0.06  # depth of a keyframe's
COLOURS = {Status.TRACKED: 0x3DDC97FF, Status.DEGRADED: 0xF9C74FFF, Status.LOST: 0xF94144FF}
TRUTH_COLOUR, KEYFRAME_COLOUR = 0xFFFFFF60, 0x8ECAE6C0


class World:
    """Draws where things are.

    Parameters
    ----------
    recorder : Recorder
        Where to.
    camera : Camera
        Of all frames.
    config : Config
        Of the odometry.

    Notes
    -----
    Path, keyframes and map are logged piece by piece, each at its time; the window is laid out to
    show all pieces up to now. So a long run costs no more a frame than a short one.
    """

    def __init__(self, recorder: Recorder, camera: Camera, config: Config) -> None:
        self._recorder, self._camera, self._config = recorder, camera, config
        self._rerun = load_rerun()
        self._last: NDArray[np.float64] | None = None
        self._true: NDArray[np.float64] | None = None
        self._voxels: set[bytes] = set()
        self._frustum = _frustum(camera)
        recorder.log(WORLD, self._rerun.ViewCoordinates.RDF, static=True)

    def draw(self, shot: Shot, T_world_true: NDArray[np.float64] | None) -> None:
        """Draw where a frame was taken.

        Parameters
        ----------
        shot : Shot
        T_world_true : ndarray, shape (4, 4), or None
            Its true pose, where it is known.
        """
        rerun, log, result = self._rerun, self._recorder.log, shot.result
        T = result.T_world_cam
        log(CAMERA, rerun.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        if result.status is not Status.LOST:  # else it is only predicted
            self._lead(PATH, self._last, T, COLOURS[result.status], 1.5)
            self._last = T
        if T_world_true is not None:
            self._lead(TRUTH, self._true, T_world_true, TRUTH_COLOUR, 3.5)
            self._true = T_world_true
        if result.is_keyframe:
            strips = [strip @ T[:3, :3].T + T[:3, 3] for strip in self._frustum]
            thin = rerun.Radius.ui_points(0.8)
            log(KEYFRAMES, rerun.LineStrips3D(strips, colors=KEYFRAME_COLOUR, radii=thin))
            if shot.frame is not None:
                self._add_edges(shot.frame, T)

    def _lead(
        self,
        path: str,
        before: NDArray[np.float64] | None,
        now: NDArray[np.float64],
        colour: int,
        width: float,
    ) -> None:
        if before is not None:
            ends = np.stack([before[:3, 3], now[:3, 3]])[None]
            radius = self._rerun.Radius.ui_points(width)
            self._recorder.log(path, self._rerun.LineStrips3D(ends, colors=colour, radii=radius))

    def _add_edges(self, frame: Frame, T_world_cam: NDArray[np.float64]) -> None:
        """Add to the map what lies where nothing was."""
        if len(self._voxels) >= MOST_EDGES:
            return
        seen = EdgeMap(self._camera, self._config.edges, voxel_m=VOXEL_M)
        seen.add(frame, T_world_cam)
        edges = seen.points()
        places = np.floor(edges.points / VOXEL_M).astype(np.int32)
        fresh = [place.tobytes() not in self._voxels for place in places]
        self._voxels.update(place.tobytes() for place in places[fresh])
        self._recorder.log(MAP, self._points(edges, np.flatnonzero(fresh)))

    def _points(self, edges: EdgePoints, which: NDArray[np.intp]) -> Any:
        colours = np.rint(255 * direction_colours(edges.gradients[which])).astype(np.uint8)
        size = self._rerun.Radius.ui_points(1.3)
        return self._rerun.Points3D(edges.points[which], colors=colours, radii=size)


def _frustum(camera: Camera) -> list[NDArray[np.float64]]:
    """Lines of a small pyramid in the camera's frame."""
    corners = [(0, 0), (camera.width, 0), (camera.width, camera.height), (0, camera.height)]
    points = np.array(
        [((u - 0.5 - camera.cx) / camera.fx, (v - 0.5 - camera.cy) / camera.fy, 1.0)
         for u, v in corners]
    )  # fmt: skip
    a, b, c, d = FRUSTUM_M * points
    tip = np.zeros(3)
    return [np.array([a, b, c, d, a]), np.array([a, tip, c]), np.array([b, tip, d])]
