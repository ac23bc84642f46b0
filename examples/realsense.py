"""Follow a RealSense camera in a loop of one's own.

    pip install 'edvo[realsense]'
    python realsense.py

`edvo live realsense -o out` does this and more; here is how to build on it. Any other camera works
the same: write a generator that waits for its next two images and yields a frame.
"""

from collections.abc import Iterator

import numpy as np
import pyrealsense2 as rs

import edvo
from edvo.live import follow


def camera_of(profile: rs.pipeline_profile) -> edvo.Camera:
    """Ask the device for the numbers of its colour camera."""
    stream = profile.get_stream(rs.stream.color).as_video_stream_profile()
    seen = stream.get_intrinsics()
    # Colour cameras of the D400 series leave the factory without distortion worth the name; a
    # D455's is small and of the inverse kind: `edvo live` takes that into account.
    return edvo.Camera(
        width=seen.width, height=seen.height, fx=seen.fx, fy=seen.fy, cx=seen.ppx, cy=seen.ppy
    )


def frames(pipeline: rs.pipeline) -> Iterator[edvo.Frame]:
    """Wait for each pair of images; depth is brought into the view of colour."""
    align = rs.align(rs.stream.color)
    while True:
        images = align.process(pipeline.wait_for_frames())
        depth, colour = images.get_depth_frame(), images.get_color_frame()
        if not depth or not colour:
            continue
        metres = np.asarray(depth.get_data()) * np.float32(depth.get_units())
        # A copy, since the driver uses the memory of its images again.
        bgr = np.array(colour.get_data())
        try:
            yield edvo.Frame.from_images(
                colour.get_timestamp() / 1000,
                bgr,
                metres,
                depth_delay=(depth.get_timestamp() - colour.get_timestamp()) / 1000,
            )
        except edvo.EdvoError as error:  # all of the depth is missing: the lens is covered
            print(error)


def main() -> None:
    """Print the position until Ctrl-C, then write the path."""
    pipeline, wanted = rs.pipeline(), rs.config()
    wanted.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    wanted.enable_stream(rs.stream.color, 640, 480, rs.format.bgr8, 30)
    odometry = edvo.Odometry(
        camera_of(pipeline.start(wanted)),
        edvo.Config().with_overrides(["planes.sensor=realsense_d435"]),
    )
    try:
        with follow(frames(pipeline), odometry) as following:
            for tracked in following:
                x, y, z = tracked.T_world_cam[:3, 3]
                line = f"{x:+.3f} {y:+.3f} {z:+.3f} m  {tracked.status.value} {tracked.reason}"
                print(f"{line}  {following.dropped} dropped")
    except KeyboardInterrupt:
        pass
    finally:
        pipeline.stop()
        odometry.trajectory.write("trajectory.txt")
        print(f"trajectory.txt has {len(odometry.trajectory)} poses")


if __name__ == "__main__":
    main()
