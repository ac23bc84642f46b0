"""Edges as points: where they are, merged where they meet, bounded in number."""

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.config import EdgesConfig
from edvo.export.edge_map import EdgeMap, EdgePoints
from edvo.frame import Frame

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)
DEPTH_M = 2.0


def card(shift_px: int = 0) -> Frame:
    """A bright card before a dark wall, both at 2 m; it moves left as the camera moves right."""
    grey = np.full((120, 160), 60, np.uint8)
    grey[40:80, 60 - shift_px : 100 - shift_px] = 200
    grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    return Frame(0.0, grey, np.full((120, 160), DEPTH_M, np.float32))


def at(shift_px: int) -> np.ndarray:
    return se3.exp(np.array([shift_px * DEPTH_M / CAMERA.fx, 0, 0, 0, 0, 0]))


def test_points_lie_on_the_card() -> None:
    found = EdgeMap(CAMERA, EdgesConfig())
    found.add(card(), np.eye(4))
    edges = found.points()
    assert len(edges) > 80
    np.testing.assert_allclose(edges.points[:, 2], DEPTH_M, rtol=1e-6)
    left = (60 - 79.5) / 150 * DEPTH_M
    assert edges.points[:, 0].min() == pytest.approx(left, abs=2 * DEPTH_M / 150)
    assert 60 < edges.grey.mean() < 200


def test_views_of_one_place_are_merged() -> None:
    one, two = EdgeMap(CAMERA, EdgesConfig()), EdgeMap(CAMERA, EdgesConfig())
    one.add(card(), np.eye(4))
    two.add(card(), np.eye(4))
    two.add(card(15), at(15))
    assert len(two.points()) < 1.3 * len(one.points())
    assert two.points().counts.sum() == 2 * one.points().counts.sum()


def test_memory_is_bounded() -> None:
    found = EdgeMap(CAMERA, EdgesConfig(), max_points=60)
    for shift in range(0, 40, 4):
        found.add(card(shift), at(3 * shift))  # a wrong pose, so that points pile up
    edges = found.points()
    assert len(edges) <= 60
    assert found.voxel_m > 0.01


def test_far_edges_are_left_out() -> None:
    found = EdgeMap(CAMERA, EdgesConfig(), max_depth_m=1.0)
    found.add(card(), np.eye(4))
    assert len(found.points()) == 0
    assert len(EdgeMap(CAMERA, EdgesConfig()).points()) == 0


def test_thinned_evenly() -> None:
    count = 1000
    edges = EdgePoints(
        np.arange(3 * count).reshape(count, 3).astype(float),
        np.ones((count, 2)),
        np.zeros(count, np.uint8),
        np.ones(count, np.int64),
    )
    few = edges.thinned(10)
    assert len(few) == 10
    assert few.points[-1, 0] == edges.points[-1, 0]
    assert edges.thinned(count) is edges
