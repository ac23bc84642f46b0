"""OpenCV's odometry follows a known motion, and is lost by edvo's own rules."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.baselines.opencv import KINDS, OpenCvAligner, opencv_odometry
from edvo.baselines.pairwise import FRAME_TO_FRAME, KeyframeRule, PairwiseOdometry
from edvo.errors import ConfigError, FrameError, MissingExtraError
from edvo.frame import Frame
from edvo.odometry import Status

from .conftest import OFFICE, Office

CAMERA = OFFICE
STEP_M = 0.02


def slope() -> NDArray[np.uint8]:
    """Smooth blobs of two sizes, on a slope whose rows lie at depths of their own."""
    rng = np.random.default_rng(3)
    noise = np.zeros((240, 900))
    for sigma in (3, 9):
        noise += sigma * cv2.GaussianBlur(rng.normal(size=noise.shape), (0, 0), sigma)
    return np.asarray(127 + 120 * noise / np.abs(noise).max(), np.uint8)


SLOPE = slope()
TEXEL_M = 0.006
V, U = np.mgrid[: CAMERA.height, : CAMERA.width].astype(np.float32)
DEPTH = 1.2 + 1.5 * (CAMERA.height - 1 - V) / CAMERA.height
# On exact depth the plane, which slides within itself, would outweigh all that is seen on it.
NOISE = np.random.default_rng(4).normal(scale=0.004, size=(40, *DEPTH.shape))


def frame_at(step: int, t: float) -> Frame:
    """Show the slope to a camera that many steps to the right."""
    x = (U - CAMERA.cx) * DEPTH / CAMERA.fx + step * STEP_M
    grey = cv2.remap(SLOPE, (x / TEXEL_M + 350).astype(np.float32), V, cv2.INTER_LINEAR)
    return Frame(
        timestamp=t, grey=np.asarray(grey, np.uint8), depth=(DEPTH + NOISE[step]).astype(np.float32)
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("index", [2, 15])
def test_arrives_from_a_guess_nearby(kind: str, index: int, office: Office) -> None:
    (reference, T_world_ref), (current, T_world_cur) = office(0), office(index)
    T_ref_cur = se3.inverse(T_world_ref) @ T_world_cur
    aligner = OpenCvAligner(CAMERA, kind)
    away = se3.exp(np.array([0.01, -0.01, 0.01, 0.005, -0.005, 0.005]))
    found = aligner.align(aligner.prepare(reference), aligner.prepare(current), T_ref_cur @ away)
    assert found is not None
    error = se3.inverse(T_ref_cur) @ found
    assert np.linalg.norm(error[:3, 3]) < 0.008  # of 0.15 m; the guess is off by 0.017
    assert np.degrees(se3.rotation_angle(error)) < 0.25


@pytest.mark.parametrize("kind", ["depth", "rgbd", "fast-depth"])
def test_without_the_guess_a_large_motion_is_not_found(kind: str, office: Office) -> None:
    (reference, _), (current, _) = office(0), office(30)
    aligner = OpenCvAligner(CAMERA, kind)
    assert aligner.align(aligner.prepare(reference), aligner.prepare(current), np.eye(4)) is None


def test_a_guess_that_sees_nothing_falls_back_on_none(office: Office) -> None:
    (reference, T_world_ref), (current, T_world_cur) = office(0), office(2)
    aligner = OpenCvAligner(CAMERA, "rgbd")
    behind = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.pi, 0.0]))
    found = aligner.align(aligner.prepare(reference), aligner.prepare(current), behind)
    assert found is not None
    np.testing.assert_allclose(found, se3.inverse(T_world_ref) @ T_world_cur, atol=5e-3)


def blank(t: float) -> Frame:
    """Give a frame in which there is nothing to see and hardly a depth."""
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    depth[100, 100] = 2.0
    return Frame(timestamp=t, grey=np.full(depth.shape, 90, np.uint8), depth=depth)


def follow(tracker: PairwiseOdometry, steps: int) -> list[float]:
    """Track a slide to the right; positions across, metres."""
    results = [tracker.track(frame_at(i, i / 30)) for i in range(steps)]
    assert all(result.status is Status.TRACKED for result in results)
    return [float(result.T_world_cam[0, 3]) for result in results]


# A plane slides within itself: depth alone does not see it.
SEEING = ("rgb", "rgbd", "fast-rgbd")


@pytest.mark.parametrize("kind", SEEING)
@pytest.mark.parametrize("rule", [None, FRAME_TO_FRAME])
def test_follows_a_slide(kind: str, rule: KeyframeRule | None) -> None:
    tracker = opencv_odometry(CAMERA, kind, keyframes=rule)
    positions = follow(tracker, 12)
    np.testing.assert_allclose(positions, STEP_M * np.arange(12), atol=0.015)
    assert len(tracker.trajectory) == 12


@pytest.mark.parametrize("kind", KINDS)
def test_name_tells_the_kind(kind: str) -> None:
    assert opencv_odometry(CAMERA, kind).name == f"opencv-{kind}"


def test_keyframes_come_by_distance() -> None:
    tracker = opencv_odometry(CAMERA, "rgb", keyframes=KeyframeRule(2.5 * STEP_M, 8.0))
    results = [tracker.track(frame_at(i, i / 30)) for i in range(8)]
    assert [result.index for result in results if result.is_keyframe] == [0, 3, 6]
    assert [result.keyframe for result in results] == [-1, 0, 0, 0, 3, 3, 3, 6]


def test_each_frame_is_a_keyframe_frame_to_frame() -> None:
    tracker = opencv_odometry(CAMERA, "rgb", keyframes=FRAME_TO_FRAME)
    results = [tracker.track(frame_at(i, i / 30)) for i in range(4)]
    assert [result.keyframe for result in results] == [-1, 0, 1, 2]
    assert all(result.is_keyframe for result in results)


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_that_shows_nothing_is_lost_and_the_next_is_found(kind: str) -> None:
    tracker = opencv_odometry(CAMERA, kind)
    tracker.track(frame_at(0, 0.0))
    tracker.track(frame_at(1, 1 / 30))
    lost = tracker.track(blank(2 / 30))
    found = tracker.track(frame_at(3, 3 / 30))
    assert (lost.status, lost.reason) == (Status.LOST, "registration failed")
    assert found.status is Status.TRACKED
    assert len(tracker.trajectory) == 3


def test_a_jump_no_hand_can_make_is_lost() -> None:
    tracker = opencv_odometry(CAMERA, "rgb")
    tracker.track(frame_at(0, 0.0))
    result = tracker.track(frame_at(1, 1e-3))
    assert result.status is Status.LOST
    assert "implausible jump" in result.reason


def test_a_skipped_frame_is_lost_with_a_prediction() -> None:
    tracker = opencv_odometry(CAMERA, "rgb")
    follow(tracker, 2)
    result = tracker.skip(2 / 30, "no file")
    assert (result.status, result.reason, result.index) == (Status.LOST, "no file", 2)
    assert result.T_world_cam[0, 3] == pytest.approx(2 * STEP_M, abs=4e-3)


def test_reset_starts_where_it_is_told() -> None:
    tracker = opencv_odometry(CAMERA, "rgb")
    follow(tracker, 2)
    start = se3.exp(np.array([1.0, 2.0, 3.0, 0.1, 0.0, 0.0]))
    tracker.reset(start)
    result = tracker.track(frame_at(0, 0.0))
    np.testing.assert_array_equal(result.T_world_cam, start)
    assert (result.index, len(tracker.trajectory)) == (0, 1)


def test_distorted_images_are_straightened_first() -> None:
    bent = replace(CAMERA, distortion=(0.2, -0.3, 0.0, 0.0, 0.0))
    tracker = opencv_odometry(bent, "rgb")
    straight = opencv_odometry(CAMERA, "rgb")
    for step in range(2):
        seen = frame_at(step, step / 30)
        result = tracker.track(seen)
        same = straight.track(
            Frame(seen.timestamp, bent.undistort_image(seen.grey), bent.undistort_depth(seen.depth))
        )
    np.testing.assert_array_equal(result.T_world_cam, same.T_world_cam)


def test_refuses_frames_of_another_size() -> None:
    tracker = opencv_odometry(CAMERA)
    small = np.full((10, 10), 3.0, np.float32)
    with pytest.raises(FrameError, match="10 x 10"):
        tracker.track(Frame(timestamp=0.0, grey=small.astype(np.uint8), depth=small))


def test_unknown_kind() -> None:
    with pytest.raises(ConfigError, match="rgb, depth, rgbd, fast-depth, fast-rgbd"):
        opencv_odometry(CAMERA, "stereo")


def test_another_opencv_package_in_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "Odometry")
    with pytest.raises(MissingExtraError, match="opencv-python-headless"):
        opencv_odometry(CAMERA)
