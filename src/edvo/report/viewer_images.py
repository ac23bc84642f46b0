"""Images in the viewer: edges, samples, matches and residuals, depth."""

import math
from typing import Any

import cv2
import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.config import Config
from edvo.frame import Frame
from edvo.report.plots import direction_colours
from edvo.report.sights import Seen, look
from edvo.report.viewer_library import load_rerun
from edvo.report.viewer_names import DEPTH, EDGES, IMAGE, MATCHES, SAMPLES
from edvo.report.viewer_recorder import Recorder
from edvo.report.viewer_shot import Shot

QUALITY = 85
DEPTH_WIDTH = 320  # pixels; enough to look at, and a fifth of the time of a whole one
WORST_PX = 3.0  # residual of the last colour
DIRECTIONS = 36  # classes of edges
PLANE_M = 0.25  # from the camera to its image in space

_RESIDUALS = LinearSegmentedColormap.from_list("signed", ["#3a86ff", "#3ddc97", "#f94144"])
_CENTRE = 0.5  # there, pixel centres lie half a pixel from the corner


class Images:
    """Draws the images of frames.

    Parameters
    ----------
    recorder : Recorder
        Where to.
    camera : Camera
        Of all frames.
    config : Config
        Of the odometry.
    """

    def __init__(self, recorder: Recorder, camera: Camera, config: Config) -> None:
        self._recorder, self._camera, self._config = recorder, camera, config
        self._rerun = load_rerun()
        self._far_m: float | None = None
        self._stride = max(1, round(camera.width / DEPTH_WIDTH))
        recorder.log(EDGES, self._directions(), static=True)
        recorder.log(IMAGE, self._pinhole(1), static=True)
        recorder.log(DEPTH, self._pinhole(self._stride), static=True)

    def draw(self, shot: Shot) -> None:
        """Draw a frame, if its images are there.

        Parameters
        ----------
        shot : Shot
        """
        frame, result = shot.frame, shot.result
        if frame is None:
            return
        rerun, log = self._rerun, self._recorder.log
        seen = look(frame, result, self._camera, self._config)
        packed = cv2.imencode(".jpg", seen.grey, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        log(IMAGE, rerun.EncodedImage(contents=packed.tobytes(), media_type="image/jpeg"))
        log(EDGES, rerun.SegmentationImage(_edge_image(seen)))
        signed = _RESIDUALS(0.5 + 0.5 * seen.residuals / WORST_PX)[:, :3]
        colours = np.rint(255 * signed).astype(np.uint8)
        samples, references = seen.samples + _CENTRE, seen.references + _CENTRE
        log(SAMPLES, rerun.Points2D(samples, colors=colours, radii=rerun.Radius.ui_points(1.4)))
        strips = np.stack([samples, references], axis=1)
        log(MATCHES, rerun.LineStrips2D(strips, colors=colours, radii=rerun.Radius.ui_points(0.5)))
        log(DEPTH, self._depth(frame))

    def _directions(self) -> Any:
        angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
        colours = np.rint(255 * direction_colours(np.stack([np.cos(angles), np.sin(angles)], 1)))
        classes = [self._rerun.AnnotationInfo(id=0, label="no edge", color=(0, 0, 0, 0))]
        for place, (angle, colour) in enumerate(zip(angles, colours, strict=True), start=1):
            label = f"gradient {math.degrees(angle):.0f} deg"
            color = tuple(colour.astype(int).tolist())
            classes.append(self._rerun.AnnotationInfo(id=place, label=label, color=color))
        return self._rerun.AnnotationContext(classes)

    def _pinhole(self, stride: int) -> Any:
        camera = self._camera
        return self._rerun.Pinhole(
            focal_length=(camera.fx / stride, camera.fy / stride),
            principal_point=(camera.cx / stride + _CENTRE, camera.cy / stride + _CENTRE),
            resolution=(-(-camera.width // stride), -(-camera.height // stride)),
            camera_xyz=self._rerun.ViewCoordinates.RDF,
            image_plane_distance=PLANE_M,
        )

    def _depth(self, frame: Frame) -> Any:
        depth = self._camera.undistort_depth(frame.depth)[:: self._stride, :: self._stride]
        if self._far_m is None:  # one scale of colours for all frames
            self._far_m = 1.2 * float(np.quantile(depth[depth > 0], 0.98)) if depth.any() else 5.0
        millimetres = np.clip(np.rint(1000 * depth), 0, 65535).astype(np.uint16)
        return self._rerun.DepthImage(
            millimetres, meter=1000.0, depth_range=(0.0, 1000 * self._far_m)
        )


def _edge_image(seen: Seen) -> NDArray[np.uint8]:
    """Draw edge pixels as classes, one for each direction; 0 where there is no edge."""
    height, width = seen.grey.shape
    image = np.zeros((height, width), np.uint8)
    turns = np.arctan2(seen.gradients[:, 1], seen.gradients[:, 0]) / (2 * np.pi)
    classes = 1 + np.rint(turns * DIRECTIONS).astype(int) % DIRECTIONS
    u, v = np.rint(seen.pixels).astype(int).T
    # Two pixels wide, to be seen where the image is drawn smaller than it is.
    for du, dv in ((1, 1), (1, 0), (0, 1), (0, 0)):
        image[np.clip(v + dv, 0, height - 1), np.clip(u + du, 0, width - 1)] = classes
    return image
