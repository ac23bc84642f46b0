"""What the baselines of edvo's own code have to do alike, on rendered frames of known motion."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.baselines.direct import direct_odometry
from edvo.baselines.edge_distance import EdgeDistanceAligner, edge_distance_odometry
from edvo.baselines.orb import orb_odometry
from edvo.baselines.pairwise import FRAME_TO_FRAME, PairwiseOdometry
from edvo.config import Config
from edvo.frame import Frame
from edvo.odometry import Status

from .conftest import Rendered

METHODS = {"direct-t": direct_odometry, "edge-dt": edge_distance_odometry, "orb-pnp": orb_odometry}
Make = Callable[..., PairwiseOdometry]


@pytest.fixture(params=METHODS)
def make(request: pytest.FixtureRequest) -> Make:
    """Each of the methods."""
    method: Make = METHODS[request.param]
    return method


@pytest.mark.parametrize("rule", [None, FRAME_TO_FRAME])
def test_follows_a_known_motion(make: Make, rendered: Rendered, rule: object) -> None:
    tracker = make(rendered.camera, keyframes=rule)
    for index, frame in enumerate(rendered.frames):
        result = tracker.track(frame)
        assert result.status is Status.TRACKED
        error = se3.inverse(rendered.motion(0, index)) @ result.T_world_cam
        moved = np.linalg.norm(rendered.motion(0, index)[:3, 3])
        assert np.linalg.norm(error[:3, 3]) < 0.004 + 0.1 * moved
        assert np.degrees(se3.rotation_angle(error)) < 0.2


def test_orb_counts_the_inliers_of_the_last_refinement(
    rendered: Rendered, monkeypatch: pytest.MonkeyPatch
) -> None:
    refine, calls = cv2.solvePnPRefineLM, 0

    def astray(*given: Any) -> Any:
        nonlocal calls
        calls += 1
        rotation, translation = refine(*given)
        return rotation, translation + (calls % 2 == 0) * 1.0

    monkeypatch.setattr(cv2, "solvePnPRefineLM", astray)
    aligner = orb_odometry(rendered.camera)._aligner
    reference, current = map(aligner.prepare, rendered.frames[:2])
    assert aligner.align(reference, current, np.eye(4)) is None
    assert calls == 4  # near the guess, then everywhere


@pytest.mark.parametrize("config", [None, Config(), Config.preset("paper")])
def test_a_distance_transform_gets_edges_at_whole_pixels(
    config: Config | None, rendered: Rendered
) -> None:
    assert Config().edges.position == "vertex"
    points = EdgeDistanceAligner(rendered.camera, config).prepare(rendered.frames[0]).points
    pixels = rendered.camera.project(points)
    assert len(pixels) > 100
    np.testing.assert_allclose(pixels, np.round(pixels), atol=1e-3)


def test_depth_of_edges_by_the_noise_of_the_sensor(rendered: Rendered) -> None:
    """A step of 3 cm at 2.6 m is none to a Kinect, and one to a better camera."""
    camera, right = rendered.camera, np.zeros((rendered.camera.height, rendered.camera.width), bool)
    right[:, camera.width // 2 :] = True
    depth = 2.6 + 0.03 * right + np.random.default_rng(3).normal(0, 0.001, right.shape)
    grey = np.where(right, 200, 50).astype(np.uint8)
    frame = Frame(0.0, grey, depth.astype(np.float32))
    near = {}
    for sensor in ("kinect_v1", "azure_kinect"):
        config = Config().with_overrides([f"planes.sensor={sensor}"])
        points = EdgeDistanceAligner(camera, config).prepare(frame).points
        near[sensor] = np.median(points[:, 2])
    assert near["kinect_v1"] > 2.608
    assert near["azure_kinect"] == pytest.approx(2.6, abs=0.002)


def test_the_guess_carries_a_large_motion(make: Make, rendered: Rendered) -> None:
    aligner = make(rendered.camera)._aligner
    reference, current = map(aligner.prepare, (rendered.frames[0], rendered.frames[-1]))
    true = rendered.motion(0, len(rendered.frames) - 1)
    guess = se3.exp(np.array([0.005, -0.005, 0.005, 0.004, -0.004, 0.004])) @ true
    found = aligner.align(reference, current, guess)
    assert found is not None
    assert np.linalg.norm((se3.inverse(true) @ found)[:3, 3]) < 0.006


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
def test_a_wall_without_texture_is_lost(make: Make, rendered: Rendered, noise: float) -> None:
    tracker = make(rendered.camera)
    tracker.track(rendered.empty(0.0, noise=noise))
    result = tracker.track(rendered.empty(1 / 30, noise=noise))
    assert (result.status, result.reason) == (Status.LOST, "registration failed")
    assert len(tracker.trajectory) == 1


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_lost_before_a_wall_and_found_behind_it(
    make: Make, rendered: Rendered, noise: float
) -> None:
    tracker = make(rendered.camera)
    tracker.track(rendered.frames[0])
    wall = tracker.track(rendered.empty(rendered.frames[1].timestamp, noise=noise))
    found = tracker.track(rendered.frames[2])
    assert wall.status is Status.LOST
    assert found.status is Status.TRACKED


def test_views_that_have_nothing_in_common_are_lost(make: Make, rendered: Rendered) -> None:
    tracker = make(rendered.camera)
    tracker.track(rendered.frames[0])
    frame = rendered.frames[1]
    upside_down = type(frame)(
        frame.timestamp,
        np.ascontiguousarray(frame.grey[::-1, ::-1]),
        np.ascontiguousarray(frame.depth[::-1, ::-1]),
    )
    assert tracker.track(upside_down).status is Status.LOST


def test_same_frames_same_bits(make: Make, rendered: Rendered) -> None:
    runs = []
    for _ in range(2):
        tracker = make(rendered.camera)
        for frame in rendered.frames:
            tracker.track(frame)
        runs.append(tracker.trajectory.poses)
    np.testing.assert_array_equal(*runs)


def test_name(make: Make, rendered: Rendered) -> None:
    assert METHODS[make(rendered.camera).name] is make
