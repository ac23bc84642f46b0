"""A ROS 2 node: RGB-D images in, nav_msgs/Odometry with covariance and TF out.

    pip install edvo
    python3 ros2_node.py --ros-args \
        -r colour/image:=/camera/color/image_raw \
        -r colour/camera_info:=/camera/color/camera_info \
        -r depth/image:=/camera/aligned_depth_to_color/image_raw

Depth must be registered to colour (RealSense: align_depth.enable:=true). Parameters: odom_frame,
base_frame, base_from_camera (x y z qx qy qz qw of the colour camera's optical frame in the base),
publish_tf, rectified (images are image_rect, so that P of camera_info holds), sensor (whose depth
noise it is: realsense_d435, kinect_v1, ..., as planes.sensor of edvo).

A lost frame publishes nothing: a filter had better coast than be told something wrong.
"""

from typing import NamedTuple

import message_filters
import numpy as np
import rclpy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry as OdometryMessage
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo as CameraInfoMessage
from sensor_msgs.msg import Image

import edvo
from edvo import se3
from edvo.datasets.ros_camera import camera_from_info
from edvo.datasets.ros_images import depth_of, grey_of
from edvo.datasets.ros_messages import CameraInfo, Header, ImageMessage

Matrix = NDArray[np.float64]

# x forward, y left, z up from x right, y down, z forward (REP 103).
OPTICAL_IN_BODY = [0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5]
SLOP_S = 0.02
KEYFRAMES_KEPT = 1000


class Uncertainty:
    """What covariances of poses against keyframes come to in the world.

    A keyframe's own error is shared by all that is registered to it, so it adds up from keyframe
    to keyframe, as drift does.
    """

    def __init__(self) -> None:
        self._of_keyframes: dict[int, Matrix] = {}

    def of(self, tracked: edvo.TrackedFrame) -> Matrix:
        """Give the covariance of ``T_world_cam`` of the next frame.

        Parameters
        ----------
        tracked : edvo.TrackedFrame
            Not lost.

        Returns
        -------
        ndarray, shape (6, 6)
            Of delta = [v, w] in ``exp(delta) T_world_cam``.
        """
        total = self._of_keyframes.get(tracked.keyframe, np.zeros((6, 6)))
        if tracked.covariance is not None:
            # T_world_key exp(delta) T_key_cur = exp(Ad delta) T_world_key T_key_cur
            carry = se3.adjoint(tracked.T_world_cam @ se3.inverse(tracked.T_key_cur))
            total = total + carry @ tracked.covariance @ carry.T
        if tracked.is_keyframe:
            self._of_keyframes[tracked.index] = total
            if len(self._of_keyframes) > KEYFRAMES_KEPT:
                del self._of_keyframes[next(iter(self._of_keyframes))]
        return total


def ros_pose_covariance(covariance: Matrix, T: Matrix) -> Matrix:
    """Turn the covariance of a left perturbation into ROS's.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of delta = [v, w] in ``exp(delta) T``.
    T : ndarray, shape (4, 4)
        The pose.

    Returns
    -------
    ndarray, shape (6, 6)
        Of position and of rotation about the fixed axes of the header's frame
        (geometry_msgs/PoseWithCovariance). A turn about the origin also moves the position: to
        first order by v + w x t.
    """
    change = np.eye(6)
    change[:3, 3:] = -se3.hat(T[:3, 3])
    return change @ covariance @ change.T


def ros_twist(
    T_before: Matrix, T_now: Matrix, seconds: float, before: Matrix, now: Matrix
) -> tuple[Matrix, Matrix]:
    """Give the velocity between two poses in the moving frame, which is what ROS wants of a twist.

    Parameters
    ----------
    T_before, T_now : ndarray, shape (4, 4)
        Poses of the moving frame.
    seconds : float
        Between them.
    before, now : ndarray, shape (6, 6)
        Covariances of either, of left perturbations, but for what they have in common.

    Returns
    -------
    ndarray, shape (6,)
        Linear then angular velocity, m/s and rad/s.
    ndarray, shape (6, 6)
        Its covariance.
    """
    T_change = se3.inverse(T_before) @ T_now
    # The same perturbations from the right: in the moving frame.
    first, second = se3.adjoint(se3.inverse(T_before)), se3.adjoint(se3.inverse(T_now))
    back = se3.adjoint(se3.inverse(T_change))
    first = back @ first
    covariance = first @ before @ first.T + second @ now @ second.T
    return se3.log(T_change) / seconds, covariance / seconds**2


class Published(NamedTuple):
    """What the next twist needs of a frame; `own` is its covariance against its keyframe."""

    time: float
    index: int
    T_odom_base: Matrix
    own: Matrix


class EdvoNode(Node):
    """Tracks the camera and publishes where the base is."""

    def __init__(self) -> None:
        super().__init__("edvo")
        self._odom_frame = self.declare_parameter("odom_frame", "odom").value
        self._base_frame = self.declare_parameter("base_frame", "camera_link").value
        mounting = self.declare_parameter("base_from_camera", OPTICAL_IN_BODY).value
        self._T_base_cam = se3.from_quaternion(mounting[:3], mounting[3:])
        self._publish_tf = self.declare_parameter("publish_tf", True).value
        self._rectified = self.declare_parameter("rectified", False).value
        sensor = self.declare_parameter("sensor", "realsense_d435").value
        self._config = edvo.Config().with_overrides([f"planes.sensor={sensor}"])
        self._odometry: edvo.Odometry | None = None
        self._uncertainty = Uncertainty()
        self._last: Published | None = None
        self._publisher = self.create_publisher(OdometryMessage, "odometry", 10)
        self._broadcaster = tf2_ros.TransformBroadcaster(self)
        topics = (
            (Image, "colour/image"),
            (Image, "depth/image"),
            (CameraInfoMessage, "colour/camera_info"),
        )
        subscribers = [
            message_filters.Subscriber(self, kind, name, qos_profile=qos_profile_sensor_data)
            for kind, name in topics
        ]
        # A queue of two: what there is no time for is dropped, not kept for later.
        self._pairs = message_filters.ApproximateTimeSynchronizer(subscribers, 2, SLOP_S)
        self._pairs.registerCallback(self.on_images)

    def on_images(self, colour: Image, depth: Image, info: CameraInfoMessage) -> None:
        """Track a pair of images and publish what came of it."""
        try:
            if self._odometry is None:
                self._odometry = edvo.Odometry(self._camera(info), self._config)
            tracked = self._odometry.track(frame_of(colour, depth))
        except edvo.EdvoError as error:
            self.get_logger().error(str(error), throttle_duration_sec=2.0)
            return
        if tracked.status is edvo.Status.LOST:
            self.get_logger().warning(f"lost: {tracked.reason}", throttle_duration_sec=2.0)
            return
        self._publish(tracked, colour.header.stamp)

    def _camera(self, info: CameraInfoMessage) -> edvo.Camera:
        read = CameraInfo(
            Header(0, info.header.frame_id),
            info.height,
            info.width,
            info.distortion_model,
            tuple(info.d),
            tuple(info.k),
            tuple(info.p),
        )
        name = "colour/camera_info"
        return camera_from_info(read, rectified=self._rectified, depth_scale=1000.0, name=name)

    def _publish(self, tracked: edvo.TrackedFrame, stamp: object) -> None:
        # The world of the tracker is the first camera; odom is where the base was then.
        T_base_cam = self._T_base_cam
        T_odom_base = T_base_cam @ tracked.T_world_cam @ se3.inverse(T_base_cam)
        turn = se3.adjoint(T_base_cam)
        covariance = turn @ self._uncertainty.of(tracked) @ turn.T
        message = OdometryMessage()
        message.header.stamp = stamp
        message.header.frame_id = self._odom_frame
        message.child_frame_id = self._base_frame
        position, quaternion = se3.to_quaternion(T_odom_base)
        _fill(message.pose.pose.position, position, "xyz")
        _fill(message.pose.pose.orientation, quaternion, "xyzw")
        message.pose.covariance = ros_pose_covariance(covariance, T_odom_base).ravel()
        own = np.zeros((6, 6))  # of this frame against its keyframe, without the keyframe's error
        if tracked.covariance is not None:
            T_base_key = T_base_cam @ tracked.T_world_cam @ se3.inverse(tracked.T_key_cur)
            carry = se3.adjoint(T_base_key)
            own = carry @ tracked.covariance @ carry.T
        if self._last is not None and tracked.timestamp > self._last.time:
            last = self._last
            seconds = tracked.timestamp - last.time
            # Registered to that very frame, it has nothing of that one's error.
            before = np.zeros((6, 6)) if tracked.keyframe == last.index else last.own
            velocity, spread = ros_twist(last.T_odom_base, T_odom_base, seconds, before, own)
            _fill(message.twist.twist.linear, velocity[:3], "xyz")
            _fill(message.twist.twist.angular, velocity[3:], "xyz")
            message.twist.covariance = spread.ravel()
        self._last = Published(tracked.timestamp, tracked.index, T_odom_base, own)
        self._publisher.publish(message)
        if self._publish_tf:
            transform = TransformStamped()
            transform.header.stamp = stamp
            transform.header.frame_id = self._odom_frame
            transform.child_frame_id = self._base_frame
            _fill(transform.transform.translation, position, "xyz")
            _fill(transform.transform.rotation, quaternion, "xyzw")
            self._broadcaster.sendTransform(transform)


def frame_of(colour: Image, depth: Image) -> edvo.Frame:
    """Make a frame of two messages, without cv_bridge.

    Parameters
    ----------
    colour : sensor_msgs.msg.Image
        Any 8-bit encoding.
    depth : sensor_msgs.msg.Image
        16UC1 (millimetres) or 32FC1 (metres), registered to colour.

    Returns
    -------
    edvo.Frame
        With the time of the colour image, and how much later depth is.
    """
    stamp, late = colour.header.stamp, depth.header.stamp
    return edvo.Frame.from_images(
        stamp.sec + 1e-9 * stamp.nanosec,
        grey_of(_read(colour), "colour/image"),
        depth_of(_read(depth), "depth/image"),
        depth_scale=1000.0,
        depth_delay=late.sec - stamp.sec + 1e-9 * (late.nanosec - stamp.nanosec),
    )


def _read(image: Image) -> ImageMessage:
    return ImageMessage(
        Header(0, image.header.frame_id),
        image.height,
        image.width,
        image.encoding,
        bool(image.is_bigendian),
        image.step,
        memoryview(image.data),
    )


def _fill(target: object, values: Matrix, names: str) -> None:
    for name, value in zip(names, values, strict=True):
        setattr(target, name, float(value))


def main() -> None:
    """Run the node until ROS says stop."""
    rclpy.init()
    node = EdvoNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
