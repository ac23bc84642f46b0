"""ICL-NUIM's own folders (Handa et al., ICRA 2014).

::

    rgb/0.png, rgb/1.png, ...      colour
    depth/0.png, depth/1.png, ...  depth, 5000 a metre
    associations.txt               "index depth/N.png index rgb/N.png"
    livingRoom0.gt.freiburg        "index tx ty tz qx qy qz qw"; traj0.gt.freiburg for the office

Many rename the last to groundtruth.txt; its frame numbers and the folder's name tell it then.

The camera is published with a negative fy: its y axis points up, and so does the world's, which
makes both left-handed. The reader turns both y axes down; fy is positive then, the images stay as
they are, and a pose T becomes S T S with S = diag(1, -1, 1, 1).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera, recognise_camera
from edvo.datasets.listed import CameraChoice, pair_source
from edvo.datasets.source import Source
from edvo.datasets.tum import GROUND_TRUTH, is_index, lists_in, read_lists, read_truth

TRUTH = "*.gt.freiburg"

_FLIP = np.diag([1.0, -1.0, 1.0, 1.0])


class IclFormat:
    """The registry's entry for ICL-NUIM."""

    name = "icl"
    layout = f"a folder with associations.txt and {TRUTH}"

    def recognise(self, path: Path) -> str | None:
        """Say which of its files are there; the trajectory tells it from TUM."""
        truth, lists = _truth_file(path), lists_in(path)
        return f"{truth.name} and {lists}" if truth and lists else None

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        listed = read_lists(path)
        truth = _truth_file(path)
        published = KNOWN_CAMERAS["icl-nuim"], "the data set's, with y down"
        return pair_source(
            path,
            listed.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera, stated=lambda: published),
            truth=None if truth is None else lambda: read_truth(truth, listed, y_down),
            warnings=listed.warnings,
            facts=listed.facts,
        )


def y_down(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn the y axes of camera and world.

    Parameters
    ----------
    poses : ndarray of float64, shape (N, 4, 4)
        Camera to world, both with y up.

    Returns
    -------
    ndarray of float64, shape (N, 4, 4)
        ``T_world_cam``, both with y down.
    """
    return np.asarray(_FLIP @ poses @ _FLIP)


def _truth_file(path: Path) -> Path | None:
    published = min(path.glob(TRUTH), default=None)
    if published is not None:
        return published
    renamed, known = path / GROUND_TRUTH, recognise_camera(path)
    if known is None or known[0] is not KNOWN_CAMERAS["icl-nuim"] or not renamed.is_file():
        return None
    # Poses that someone has turned come with times instead of numbers.
    with renamed.open(encoding="utf-8", errors="replace") as lines:
        rows = (line.split() for line in lines)
        first = next((row for row in rows if row and not row[0].startswith("#")), None)
    return renamed if first is not None and is_index(first[0]) else None
