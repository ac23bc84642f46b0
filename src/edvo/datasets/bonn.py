"""Bonn RGB-D Dynamic (Palazzolo et al., IROS 2019): TUM's layout, with poses of a marker frame.

::

    rgbd_bonn_NAME/rgb.txt, depth.txt, groundtruth.txt, rgb/, depth/    as TUM; 5000 a metre

The true poses are those of the markers that the motion capture sees. The data set's page gives
the camera's as ``T_ros T_truth T_ros T_m``. The rotation in its T_m is none, by 6 %; the nearest
one is taken.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera, recognise_camera
from edvo.datasets.listed import CameraChoice, pair_source
from edvo.datasets.matrices import nearest_rotation
from edvo.datasets.source import Source
from edvo.datasets.tum import GROUND_TRUTH, lists_in, read_lists, read_truth

_T_ROS = np.array(
    [[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
_T_M = np.array(
    [
        [1.0157, 0.1828, -0.2389, 0.0113],
        [0.0009, -0.8431, -0.6413, -0.0098],
        [-0.3009, 0.6147, -0.8085, 0.0111],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


class BonnFormat:
    """The registry's entry for Bonn RGB-D Dynamic."""

    name = "bonn"
    layout = "a folder in TUM's layout with 'bonn' in its name"

    def recognise(self, path: Path) -> str | None:
        """Say that the name and the lists are there: nothing else tells it from TUM."""
        known, lists = recognise_camera(path), lists_in(path)
        if lists is None or known is None or known[0] is not KNOWN_CAMERAS["bonn"]:
            return None
        return f"the name '{known[1]}' and {lists}"

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        listed = read_lists(path)
        published = KNOWN_CAMERAS["bonn"], "the data set's"
        return pair_source(
            path,
            listed.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera, stated=lambda: published),
            truth=lambda: read_truth(path / GROUND_TRUTH, listed, of_camera),
            warnings=listed.warnings,
            facts=listed.facts,
        )


def of_camera(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make poses of the camera of those of the markers.

    Parameters
    ----------
    poses : ndarray of float64, shape (N, 4, 4)
        As the data set writes them.

    Returns
    -------
    ndarray of float64, shape (N, 4, 4)
        ``T_world_cam``.
    """
    T_marker_cam = _T_M.copy()
    T_marker_cam[:3, :3] = nearest_rotation(_T_M[:3, :3])
    return np.asarray(_T_ROS @ poses @ _T_ROS @ T_marker_cam)
