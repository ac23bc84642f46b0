"""Warped frames, where each pixel's true place is known by other means."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.experiments.warping import warp_frame
from edvo.frame import Frame

CAMERA = Camera(width=160, height=120, fx=130.0, fy=130.0, cx=79.5, cy=59.5)
TEXTURE = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
WALL = Frame(0.0, TEXTURE, np.full((120, 160), 2.0, np.float32))


def test_without_motion_nothing_changes() -> None:
    warped = warp_frame(WALL, CAMERA, np.eye(4))
    np.testing.assert_array_equal(warped.grey, TEXTURE)
    v, u = np.mgrid[:120, :160]
    np.testing.assert_allclose(warped.origin, np.dstack((u, v)), atol=1e-4)


def test_a_wall_shifts_by_focal_length_over_distance() -> None:
    # the camera moves 4 px to the right at 2 m: what it sees comes from 4 px further right
    warped = warp_frame(WALL, CAMERA, se3.inverse(se3.exp(np.array([4 * 2 / 130, 0, 0, 0, 0, 0]))))
    np.testing.assert_allclose(warped.origin[60, 70], (74, 60), atol=1e-4)
    np.testing.assert_array_equal(warped.grey[10:110, 10:140], TEXTURE[10:110, 14:144])
    assert np.isnan(warped.origin[:, -4:]).all()  # nothing is known of what comes in


def test_what_is_near_hides_what_is_behind_and_the_gap_it_leaves_is_unknown() -> None:
    depth = np.full((120, 160), 4.0, np.float32)
    depth[40:80, 60:100] = 1.0
    frame = Frame(0.0, TEXTURE, depth)
    shift = 16 * 1.0 / 130  # 16 px at 1 m, 4 px at 4 m
    warped = warp_frame(frame, CAMERA, se3.inverse(se3.exp(np.array([shift, 0, 0, 0, 0, 0]))))
    np.testing.assert_allclose(warped.origin[60, 60], (76, 60), atol=1e-3)  # the near one
    np.testing.assert_allclose(warped.origin[60, 30], (34, 60), atol=1e-3)  # what it now hides
    assert np.isnan(warped.origin[60, 90]).all()  # what it leaves
    assert warped.grey[60, 90] == 0


@pytest.mark.parametrize(
    "twist", [(0, 0, 0.1, 0, 0, 0), (0, 0, 0, 0, 0, 0.1), (0, 0, 0, 0, 0.05, 0)]
)
def test_places_lead_back_through_depth(twist: tuple[float, ...]) -> None:
    T_frame_view = se3.exp(np.array(twist))
    warped = warp_frame(WALL, CAMERA, se3.inverse(T_frame_view))
    known = np.isfinite(warped.origin[:, :, 0])
    assert 0.5 < known.mean() <= 1
    points = CAMERA.backproject(warped.origin[known], np.full(known.sum(), 2.0))
    T_view_frame = se3.inverse(T_frame_view)
    seen = CAMERA.project(points @ T_view_frame[:3, :3].T + T_view_frame[:3, 3])
    v, u = np.nonzero(known)
    np.testing.assert_allclose(seen, np.column_stack((u, v)), atol=0.05)


def test_single_missing_pixels_are_closed_and_holes_kept() -> None:
    depth = WALL.depth.copy()
    depth[60, 80] = 0
    depth[20:30, 20:30] = 0
    warped = warp_frame(replace(WALL, depth=depth), CAMERA, np.eye(4))
    assert np.isfinite(warped.origin[60, 80]).all()
    assert np.isnan(warped.origin[15:35, 15:35]).all()
    assert np.isfinite(warped.origin[40:, 40:]).all()
