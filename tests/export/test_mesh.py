"""A mesh of a wall, by Open3D where it is installed."""

import re
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.datasets import Reading, Source
from edvo.export.mesh import apart, fuse
from edvo.frame import Frame

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)


class Wall:
    """A wall 2 m ahead of a camera that moves right by 1 cm a frame; one frame is broken."""

    camera = CAMERA
    name = "wall"

    def read(self, index: int) -> Reading:
        if index == 12:
            return Reading(index, "12", 1.2, None, "12.png is broken")
        grey = np.full((120, 160), 130, np.uint8)
        frame = Frame(index / 10, grey, np.full((120, 160), 2.0, np.float32))
        return Reading(index, str(index), index / 10, frame, None)


def slide(count: int) -> np.ndarray:
    return np.array([se3.exp(np.array([0.01 * i, 0, 0, 0, 0, 0])) for i in range(count)])


def test_wall(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    data = fuse(cast(Source, Wall()), range(8, 18), slide(10))
    (tmp_path / "mesh.ply").write_bytes(data)
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    places = np.asarray(mesh.vertices)
    assert len(mesh.triangles) > 1000
    np.testing.assert_allclose(places[:, 2], 2.0, atol=2e-3)
    # Two images see as far as the first one does, right of it only the last.
    assert places[:, 0].max() == pytest.approx(79.5 / 150 * 2.0, abs=0.02)
    assert places[:, 0].min() == pytest.approx(-79.5 / 150 * 2.0 + 0.08, abs=0.02)
    np.testing.assert_allclose(np.asarray(mesh.vertex_colors), 130 / 255, atol=0.02)


def test_a_single_image_is_enough(tmp_path: Path) -> None:
    pytest.importorskip("open3d")
    data = fuse(cast(Source, Wall()), [3], slide(1))
    count = re.search(rb"element face (\d+)", data)
    assert count is not None
    assert int(count[1]) > 1000


def test_frames_apart() -> None:
    assert apart(slide(10)) == [0, 4, 8]
    turns = np.array([se3.exp(np.array([0, 0, 0, 0, np.radians(3 * i), 0])) for i in range(5)])
    assert apart(turns) == [0, 2, 4]
