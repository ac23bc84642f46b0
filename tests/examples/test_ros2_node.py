"""The ROS 2 node, on stand-ins for ROS: poses, covariances and frames come out by its rules."""

import array
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import stubs

B = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    stubs.put_ros(monkeypatch)
    return stubs.load("ros2_node.py")


@pytest.fixture(scope="module")
def source() -> SyntheticSource:
    return SyntheticSource(make_recipe("texture_near", frames=8, speed=0.4))


def image(values: NDArray[Any], encoding: str, time: float) -> stubs.Image:
    seconds = int(time)
    stamp = stubs.Time(seconds, round(1e9 * (time - seconds)))
    return stubs.Image(
        stubs.RosHeader(stamp, "camera_optical"),
        values.shape[0],
        values.shape[1],
        encoding,
        0,
        values.strides[0],
        array.array("B", values.tobytes()),
    )


def messages(source: SyntheticSource, index: int) -> tuple[Any, Any, Any]:
    frame, camera = source.read(index).frame, source.camera
    assert frame is not None
    millimetres = np.round(1000 * frame.depth).astype(np.uint16)
    info = stubs.CameraInfo(
        stubs.RosHeader(),
        camera.height,
        camera.width,
        "plumb_bob",
        array.array("d", [0.0] * 5),
        camera.matrix.ravel(),
    )
    time = 1_700_000_000 + frame.timestamp
    bgr = np.repeat(frame.grey[:, :, None], 3, axis=2)
    return image(bgr, "bgr8", time), image(millimetres, "16UC1", time), info


def matrix(position: stubs.Vector, q: stubs.Quaternion) -> NDArray[np.float64]:
    return se3.from_quaternion([position.x, position.y, position.z], [q.x, q.y, q.z, q.w])


def spread(seed: int, size: float) -> NDArray[np.float64]:
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return size**2 * root @ root.T


def sampled(of: Any, covariances: list[NDArray[np.float64]], count: int = 40_000) -> Any:
    """Covariance of what `of` makes of random perturbations."""
    rng = np.random.default_rng(3)
    draws = [rng.multivariate_normal(np.zeros(6), each, count) for each in covariances]
    return np.cov(np.array([of(*each) for each in zip(*draws, strict=True)]).T)


def assert_close(found: Any, expected: Any, share: float = 0.04) -> None:
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_array_less(np.abs(found - expected) / scale, share)


def test_publishes_where_the_camera_went(node: dict[str, Any], source: SyntheticSource) -> None:
    tracker = node["EdvoNode"]()
    for index in range(len(source)):
        tracker.on_images(*messages(source, index))
    assert tracker.logger.lines == []
    sent, transforms = tracker.publishers[0].sent, tracker._broadcaster.sent
    assert tracker.publishers[0].topic == "odometry"
    assert len(sent) == len(transforms) == len(source)
    truth = source.ground_truth
    T_world_first = truth.at(source.timestamps[0])
    for index, (message, transform) in enumerate(zip(sent, transforms, strict=True)):
        T_first_cam = se3.inverse(T_world_first) @ truth.at(source.timestamps[index])
        expected = B @ T_first_cam @ B.T  # forward, left, up
        found = matrix(message.pose.pose.position, message.pose.pose.orientation)
        np.testing.assert_allclose(found, expected, atol=0.01)
        moved = transform.transform
        np.testing.assert_array_equal(found, matrix(moved.translation, moved.rotation))
        assert message.header.stamp.sec == transform.header.stamp.sec == 1_700_000_000
        assert message.header.frame_id == transform.header.frame_id == "odom"
        assert message.child_frame_id == transform.child_frame_id == "camera_link"
    # The twist is how it moves in its own axes.
    last, before = sent[-1], sent[-2]
    T_a = matrix(before.pose.pose.position, before.pose.pose.orientation)
    T_b = matrix(last.pose.pose.position, last.pose.pose.orientation)
    period = source.timestamps[-1] - source.timestamps[-2]
    linear = last.twist.twist.linear
    step = T_a[:3, :3].T @ (T_b[:3, 3] - T_a[:3, 3]) / period
    np.testing.assert_allclose([linear.x, linear.y, linear.z], step, atol=0.02)


def test_a_lost_frame_publishes_nothing(node: dict[str, Any], source: SyntheticSource) -> None:
    tracker = node["EdvoNode"]()
    colour, depth, info = messages(source, 0)
    tracker.on_images(colour, depth, info)
    blank = image(np.zeros((480, 640), np.uint8), "mono8", 1_700_000_000.1)
    noise = np.random.default_rng(0).integers(1000, 4000, (480, 640), dtype=np.uint16)
    tracker.on_images(blank, image(noise, "16UC1", 1_700_000_000.1), info)
    assert len(tracker.publishers[0].sent) == 1
    assert "lost" in tracker.logger.lines[0]


def test_bad_messages_are_logged_and_survived(
    node: dict[str, Any], source: SyntheticSource
) -> None:
    tracker = node["EdvoNode"]()
    colour, depth, info = messages(source, 0)
    half = image(np.full((240, 320), 1000, np.uint16), "16UC1", 1_700_000_000.0)
    tracker.on_images(colour, depth, stubs.CameraInfo())
    tracker.on_images(colour, half, info)
    assert tracker.publishers[0].sent == []
    assert len(tracker.logger.lines) == 2
    tracker.on_images(colour, depth, info)
    assert len(tracker.publishers[0].sent) == 1


def test_the_base_may_be_elsewhere(
    node: dict[str, Any], source: SyntheticSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    T_base_cam = se3.exp(np.array([0.3, -0.1, 0.5, 0.2, 0.4, -1.0]))
    translation, quaternion = se3.to_quaternion(T_base_cam)
    mounting = [*translation.tolist(), *quaternion.tolist()]
    given = {"base_from_camera": mounting, "publish_tf": False, "base_frame": "base_link"}
    monkeypatch.setattr(stubs.Node, "given", given)
    tracker = node["EdvoNode"]()
    for index in range(8):
        tracker.on_images(*messages(source, index))
    message = tracker.publishers[0].sent[-1]
    truth = source.ground_truth
    ends = [truth.at(source.timestamps[index]) for index in (0, 7)]
    expected = T_base_cam @ se3.inverse(ends[0]) @ ends[1] @ se3.inverse(T_base_cam)
    found = matrix(message.pose.pose.position, message.pose.pose.orientation)
    np.testing.assert_allclose(found, expected, atol=0.01)
    assert message.child_frame_id == "base_link"
    assert tracker._broadcaster.sent == []


@pytest.mark.parametrize(
    ("given", "sensor"), [({}, "realsense_d435"), ({"sensor": "azure_kinect"}, "azure_kinect")]
)
def test_the_depth_camera_may_be_named(
    node: dict[str, Any],
    source: SyntheticSource,
    monkeypatch: pytest.MonkeyPatch,
    given: dict[str, str],
    sensor: str,
) -> None:
    monkeypatch.setattr(stubs.Node, "given", given)
    tracker = node["EdvoNode"]()
    tracker.on_images(*messages(source, 0))
    assert tracker._odometry.config.planes.sensor == sensor


def test_pose_covariance_is_of_position_and_of_fixed_axes(node: dict[str, Any]) -> None:
    T = se3.exp(np.array([2.0, -1.0, 0.5, 0.3, -0.8, 0.4]))
    covariance = spread(1, 0.002)

    def error(delta: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = se3.exp(delta) @ T
        turn = np.eye(4)
        turn[:3, :3] = moved[:3, :3] @ T[:3, :3].T
        return np.concatenate([moved[:3, 3] - T[:3, 3], se3.log(turn)[3:]])

    found = node["ros_pose_covariance"](covariance, T)
    assert_close(found, sampled(error, [covariance]))


def test_twist_is_of_the_moving_frame(node: dict[str, Any]) -> None:
    T_before = se3.exp(np.array([2.0, -1.0, 0.5, 0.3, -0.8, 0.4]))
    T_now = T_before @ se3.exp(np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.5]))
    before, now = spread(1, 0.0005), spread(2, 0.0005)
    velocity, found = node["ros_twist"](T_before, T_now, 0.1, before, now)
    np.testing.assert_allclose(velocity, np.array([3.0, 1, -2, 1, 2, 5]), atol=1e-9)

    def change(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
        T_change = se3.inverse(se3.exp(first) @ T_before) @ se3.exp(second) @ T_now
        return se3.log(se3.exp(-velocity / 10) @ T_change) / 0.1

    assert_close(found, sampled(change, [before, now]))


class Told:
    """A frame as the tracker tells of it."""

    def __init__(self, index: int, keyframe: int, T_world_key: Any, T_key_cur: Any, **more: Any):
        self.index, self.keyframe = index, keyframe
        self.T_key_cur, self.T_world_cam = T_key_cur, T_world_key @ T_key_cur
        self.is_keyframe = bool(more.get("is_keyframe"))
        self.covariance = more.get("covariance")


def test_uncertainty_adds_up_from_keyframe_to_keyframe(node: dict[str, Any]) -> None:
    steps = [se3.exp(np.random.default_rng(n).normal(size=6) * 0.5) for n in range(2)]
    covariances = [spread(5, 0.001), spread(6, 0.001)]
    eye = np.eye(4)
    uncertainty = node["Uncertainty"]()
    assert not uncertainty.of(Told(0, -1, eye, eye, is_keyframe=True)).any()
    second = Told(1, 0, eye, steps[0], covariance=covariances[0], is_keyframe=True)
    np.testing.assert_allclose(uncertainty.of(second), covariances[0])
    third = Told(2, 1, steps[0], steps[1], covariance=covariances[1])
    found = uncertainty.of(third)

    def error(first: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = se3.exp(first) @ steps[0] @ se3.exp(other) @ steps[1]
        return se3.log(moved @ se3.inverse(third.T_world_cam))

    assert_close(found, sampled(error, covariances))


def test_stubs_do_not_stay() -> None:
    assert "tf2_ros" not in sys.modules


@pytest.mark.parametrize("late", [0.012, -0.015])
def test_a_frame_has_both_stamps(node: dict[str, Any], late: float) -> None:
    grey, depth = np.full((4, 6), 90, np.uint8), np.full((4, 6), 1500, np.uint16)
    frame = node["frame_of"](image(grey, "mono8", 17.99), image(depth, "16UC1", 18.0 - 0.01 + late))
    assert frame.timestamp == pytest.approx(17.99)
    assert frame.depth_delay == pytest.approx(late, abs=1e-8)
