"""What the benchmark of honest states calls a place that was seen before."""

import numpy as np
import pytest
from benchmarks.honesty import POINTS_EVERY, overlap

from edvo import se3
from edvo.frame import Frame

from . import problems

CAMERA = problems.CAMERA
WALL_M = 2.0


def wall(distance=WALL_M):
    shape = (CAMERA.height, CAMERA.width)
    return Frame(0.0, np.zeros(shape, np.uint8), np.full(shape, distance, np.float32))


def moved(x=0.0, y=0.0, z=0.0, yaw=0.0):
    T = se3.exp(np.array([0, 0, 0, 0, yaw, 0.0]))
    T[:3, 3] = x, y, z
    return T


def test_a_frame_from_the_same_place_is_all_in_view():
    assert overlap(CAMERA, wall(), wall(), np.eye(4)) == 1.0


@pytest.mark.parametrize("share", [0.25, 0.5, 0.8])
def test_beside_a_wall_it_is_the_share_that_both_see(share):
    aside = (1 - share) * CAMERA.width * WALL_M / CAMERA.fx
    one = POINTS_EVERY / CAMERA.width
    for x in (aside, -aside):
        assert overlap(CAMERA, wall(), wall(), moved(x=x)) == pytest.approx(share, abs=one)


def test_what_stands_at_another_depth_is_another_place():
    assert overlap(CAMERA, wall(), wall(1.5), np.eye(4)) == 0.0
    # from half a metre farther back the same wall is 2.5 m away
    there = overlap(CAMERA, wall(), wall(2.5), moved(z=-0.5))
    assert there == pytest.approx((WALL_M / 2.5) ** 2, abs=0.08)  # less in view from nearer by


def test_a_depth_may_be_off_by_its_noise():
    assert overlap(CAMERA, wall(), wall(WALL_M + 0.08), np.eye(4)) == 1.0
    assert overlap(CAMERA, wall(), wall(WALL_M + 0.10), np.eye(4)) == 0.0


def test_nothing_is_in_view_of_a_camera_that_has_turned_round():
    assert overlap(CAMERA, wall(), wall(), moved(yaw=np.pi)) == 0.0


def test_where_the_keyframe_has_no_depth_nothing_was_seen():
    depth = wall().depth.copy()
    depth[:, : CAMERA.width // 2] = 0
    half = Frame(0.0, wall().grey, depth)
    assert overlap(CAMERA, half, wall(), np.eye(4)) == pytest.approx(0.5, abs=0.05)
    assert overlap(CAMERA, wall(), half, np.eye(4)) == 1.0  # of what has depth


def test_a_pose_that_is_not_known_overlaps_with_nothing():
    assert overlap(CAMERA, wall(), wall(), np.full((4, 4), np.nan)) == 0.0
