"""Recordings whose depth is seen by another camera than colour."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.images import load_colour, load_depth, make_frame
from edvo.errors import FrameError
from edvo.frame import Frame, register_depth

Named = Path | str

# Pixels, over the whole image, that two cameras may differ by and still count as one.
_SAME_PX = 0.05


@dataclass(frozen=True, eq=False)
class TwoCameras:
    """Makes frames of the images of two cameras: depth carried into the view of colour.

    Parameters
    ----------
    colour, depth : Camera
        Of the images as they are in the files; colour's ``depth_scale`` counts for both.
    T_colour_depth : ndarray, shape (4, 4)
        Maps points from the depth camera to the colour camera, metres.
    missing : int, optional
        A depth value that means "none", besides 0.
    """

    colour: Camera
    depth: Camera
    T_colour_depth: NDArray[np.float64]
    missing: int | None = None

    @cached_property
    def camera(self) -> Camera:
        """The camera of the frames.

        Colour that is finer than depth is made smaller: edges gain nothing where depth is
        interpolated, and cost by the pixel.
        """
        if self.colour.width <= self.depth.width:
            return self.colour
        return self.colour.scaled(self.depth.width / self.colour.width)

    @cached_property
    def is_registered(self) -> bool:
        """Whether depth is in the frames' view already, to a fraction of a pixel."""
        ours, theirs = self.camera, self.depth
        if (ours.width, ours.height) != (theirs.width, theirs.height):
            return False
        if ours.distortion != theirs.distortion or not np.allclose(self.T_colour_depth, np.eye(4)):
            return False
        corners = np.array([[0.0, 0.0], [ours.width - 1.0, ours.height - 1.0]])
        seen = theirs.project(ours.backproject(corners, np.ones(2)))
        return bool(np.abs(seen - corners).max() < _SAME_PX)

    @cached_property
    def _sight(self) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
        """Find the depth pixel of each of the frames' pixels, for cameras at one place.

        Along one ray, depth is the same to both cameras if neither is turned: looking it up is
        exact and takes a hundredth of the time of registration.
        """
        if not np.allclose(self.T_colour_depth, np.eye(4)):
            return None
        ours = self.camera
        u, v = np.meshgrid(np.arange(ours.width), np.arange(ours.height))
        pixels = np.column_stack((u.ravel(), v.ravel()))
        seen = self.depth.project(ours.backproject(pixels, np.ones(len(pixels))))
        map_u, map_v = np.nan_to_num(seen, nan=-9.0).astype(np.float32).T
        return map_u.reshape(u.shape).copy(), map_v.reshape(u.shape).copy()

    def load(
        self,
        timestamp: float,
        colour: Path,
        depth: Path,
        camera: Camera,
        depth_delay: float = 0.0,
    ) -> Frame:
        """Read the two images of a frame; ``camera`` is `TwoCameras.camera`."""
        images = (colour, load_colour(colour)), (depth, load_depth(depth))
        return self.frame(timestamp, *images, camera, depth_delay)

    def frame(
        self,
        timestamp: float,
        colour: tuple[Named, NDArray[np.uint8]],
        depth: tuple[Named, NDArray[np.uint16]],
        camera: Camera,
        depth_delay: float = 0.0,
    ) -> Frame:
        """Make a frame of two images as the files hold them.

        Parameters
        ----------
        timestamp : float
            Seconds.
        colour, depth : (path or str, ndarray)
            What errors call each, and its values.
        camera : Camera
            `TwoCameras.camera`, which is made once.
        depth_delay : float
            See `Frame`.

        Returns
        -------
        Frame
            In the view of the colour camera.

        Raises
        ------
        FrameError
            If an image is not of its camera's size, or holds no depth.
        """
        colour_image, depth_image = colour[1], depth[1]
        if self.missing is not None:
            depth_image = np.where(depth_image == self.missing, 0, depth_image).astype(np.uint16)
        if colour_image.shape[:2] != (camera.height, camera.width):
            _check_size(colour[0], colour_image, self.colour)
            colour_image = np.asarray(
                cv2.resize(
                    colour_image, (camera.width, camera.height), interpolation=cv2.INTER_AREA
                ),
                np.uint8,
            )
        seen = colour[0], colour_image
        if self.is_registered:
            return make_frame(timestamp, seen, (depth[0], depth_image), camera, depth_delay)
        _check_size(depth[0], depth_image, self.depth)
        metres = depth_image.astype(np.float32) / np.float32(camera.depth_scale)
        if self._sight is not None:
            u, v = self._sight
            metres = np.asarray(cv2.remap(metres, u, v, cv2.INTER_NEAREST), np.float32)
        else:
            metres = register_depth(metres, self.depth, camera, self.T_colour_depth)
        return make_frame(timestamp, seen, (depth[0], metres), camera, depth_delay)


def edge_fit(frame: Frame) -> float | None:
    """Measure how well the contours of depth lie on edges of the image.

    Parameters
    ----------
    frame : Frame
        Any.

    Returns
    -------
    float or None
        Share of the contours' pixels that have an edge within two pixels; None where there are
        too few contours to tell.
    """
    depth = frame.depth
    far = np.asarray(cv2.dilate(depth, np.ones((3, 3), np.uint8)), np.float32)
    near = -np.asarray(cv2.dilate(-depth, np.ones((3, 3), np.uint8)), np.float32)
    contours = (near > 0) & (far > 1.1 * near) & (depth < 1.05 * near)
    if contours.sum() < 0.0005 * depth.size:
        return None
    edges = cv2.Canny(cv2.GaussianBlur(frame.grey, (5, 5), 0), 30, 90)
    wide = np.asarray(cv2.dilate(edges, np.ones((5, 5), np.uint8)), np.uint8)
    return float(np.mean(wide[contours] > 0))


def _check_size(name: Named, image: NDArray[np.generic], camera: Camera) -> None:
    if image.shape[:2] != (camera.height, camera.width):
        raise FrameError(
            f"{name} is {image.shape[1]}x{image.shape[0]} and its camera is "
            f"{camera.width}x{camera.height}; give the camera of these images"
        )
