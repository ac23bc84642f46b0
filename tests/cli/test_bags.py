"""`edvo run` and `edvo info` on ROS bags."""

import json
from pathlib import Path

import numpy as np
import pytest

from edvo.datasets import open_source
from edvo.trajectory import Trajectory

from ..datasets.ros_bags import camera_info, image, write_bag  # noqa: TID252 - as in datasets/
from .conftest import Command

COLOUR, DEPTH = "/camera/rgb/image_raw", "/camera/depth_registered/image_raw"


def bag_of(folder: Path, path: Path, kind: str) -> Path:
    """Write the frames of a folder into a bag, with metres for depth."""
    source = open_source(folder)
    camera = source.camera
    k = (camera.fx, camera.fy, camera.cx, camera.cy)
    size = {"width": camera.width, "height": camera.height}
    messages = []
    for index in range(len(source)):
        frame = source.read(index).frame
        assert frame is not None
        messages += [
            camera_info("/camera/rgb/camera_info", frame.timestamp, k=k, **size),
            image(COLOUR, frame.timestamp, frame.grey, "mono8"),
            image(DEPTH, frame.timestamp, frame.depth, "32FC1"),
        ]
    return write_bag(path, kind, messages)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_bag_is_tracked_as_the_folder_it_was_made_from(
    edvo: Command, whole_sequence: Path, tmp_path: Path, kind: str
) -> None:
    bag = bag_of(whole_sequence, tmp_path / "bag", kind)
    for source, out in ((bag, tmp_path / "a"), (whole_sequence, tmp_path / "b")):
        done = edvo("run", source, "-o", out, "--max-frames", 12)
        assert done.status == 0, done.err
    ours, theirs = (Trajectory.read(tmp_path / out / "trajectory.txt") for out in "ab")
    np.testing.assert_array_equal(ours.timestamps, theirs.timestamps)
    np.testing.assert_array_equal(ours.poses, theirs.poses)


def test_topics_may_be_chosen(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    bag = bag_of(whole_sequence, tmp_path / "bag", "mcap")
    topics = ("--colour-topic", COLOUR, "--depth-topic", DEPTH)
    told = json.loads(edvo("info", bag, *topics, "--json").out)
    assert told["format"] == "ros"
    assert told["camera"]["depth_scale"] == 1.0
    done = edvo("run", bag, "-o", tmp_path / "a", *topics, "--max-frames", 3)
    assert done.status == 0, done.err
    for command in (("info", bag), ("run", bag, "-o", tmp_path / "b")):
        done = edvo(*command, "--depth-topic", "/nothing")
        assert done.status == 1
        assert done.err.startswith("edvo: ")
        assert DEPTH in done.err
    assert not (tmp_path / "b").exists()
    done = edvo("info", whole_sequence, *topics, "--format", "tum")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert "--format ros, not tum" in done.err


@pytest.mark.parametrize("command", ["info", "run"])
def test_a_bag_cut_short_is_one_line(
    edvo: Command, whole_sequence: Path, tmp_path: Path, command: str
) -> None:
    bag = bag_of(whole_sequence, tmp_path / "bag", "ros1")
    bag.write_bytes(bag.read_bytes()[:100_000])
    out = ("-o", tmp_path / "out") if command == "run" else ()
    done = edvo(command, bag, *out)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert str(bag) in done.err
    assert "rosbag reindex" in done.err


def two_cameras(folder: Path, path: Path) -> Path:
    """Write a bag of two cameras side by side, that nothing tells apart."""
    source = open_source(folder)
    camera = source.camera
    k = (camera.fx, camera.fy, camera.cx, camera.cy)
    size = {"width": camera.width, "height": camera.height}
    messages = []
    for index in range(6):
        frame = source.read(index).frame
        assert frame is not None
        for side in ("left", "right"):
            more = {"frame": side}
            messages += [
                camera_info(f"/{side}/rgb/camera_info", frame.timestamp, k=k, **size, **more),
                image(f"/{side}/rgb/image_raw", frame.timestamp, frame.grey, "mono8", **more),
                image(f"/{side}/depth/image_raw", frame.timestamp, frame.depth, "32FC1", **more),
            ]
    return write_bag(path, "mcap", messages)


@pytest.mark.parametrize("command", ["info", "run", "compare"])
def test_two_cameras_are_told_apart_by_their_topics(
    edvo: Command, whole_sequence: Path, tmp_path: Path, command: str
) -> None:
    bag = two_cameras(whole_sequence, tmp_path / "bag")
    out = ("-o", tmp_path / "out") if command == "run" else ()
    done = edvo(command, bag, *out)
    assert (done.status, done.out, done.err.count("\n")) == (1, "", 1)
    assert "choose by --colour-topic and --depth-topic" in done.err
    done = edvo(command, bag, *out, "--colour-topic", "/right/rgb/image_raw")
    assert done.status == 0, done.err
    done = edvo(command, bag, *out, "--depth-topic", "/left/rgb/image_raw")
    assert (done.status, done.err.count("\n")) == (1, 1)
    assert "holds colour" in done.err


@pytest.mark.parametrize("what", ["frame", "camera", "size"])
@pytest.mark.parametrize("command", ["info", "run"])
def test_depth_that_is_not_registered_is_said(
    edvo: Command, whole_sequence: Path, tmp_path: Path, command: str, what: str
) -> None:
    source = open_source(whole_sequence)
    camera = source.camera
    k = (camera.fx, camera.fy, camera.cx, camera.cy)
    size = {"width": camera.width, "height": camera.height}
    messages = [camera_info("/camera/rgb/camera_info", 1.0, k=k, **size)]
    if what == "camera":
        other = (1.2 * camera.fx, 1.2 * camera.fy, camera.cx, camera.cy)
        messages.append(camera_info("/camera/depth/camera_info", 1.0, k=other, **size))
    for index in range(5):
        frame = source.read(index).frame
        assert frame is not None
        depth = frame.depth[::2, ::2].copy() if what == "size" else frame.depth
        messages += [
            image(COLOUR, frame.timestamp, frame.grey, "mono8"),
            image(
                "/camera/depth/image_rect_raw",
                frame.timestamp,
                depth,
                "32FC1",
                frame="depth_optical" if what == "frame" else "camera",
            ),
        ]
    bag = write_bag(tmp_path / "bag", "mcap", messages)
    done = edvo(command, bag, *(("-o", tmp_path / "out") if command == "run" else ()))
    assert done.status == (1 if what == "size" else 0), done.err
    told = done.out if command == "info" and what != "size" else done.err
    (line,) = [line for line in told.splitlines() if "registered to colour" in line]
    assert "aligned_depth_to_color" in line
    assert what == "size" or "warning: " in line
