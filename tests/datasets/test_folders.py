"""Replica, Open3D and folders with nothing but images and a camera."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.errors import CameraError, DatasetError

from .layouts import (
    FRAMES,
    RATE,
    assert_same,
    recording,
    write_image,
    write_poses,
    write_tum,
)

# ------------------------------------------------------------------------------------- Replica


def write_replica(folder, of):
    c = of.camera
    values = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    folder.mkdir(parents=True)
    (folder.parent / "cam_params.json").write_text(
        json.dumps({"camera": {**values, "scale": 6553.5}})
    )
    for index in range(FRAMES):
        write_image(folder / f"results/frame{index:06d}.jpg", of.colour[index])
        write_image(folder / f"results/depth{index:06d}.png", of.values(index, 6553.5))
    np.savetxt(folder / "traj.txt", of.poses.reshape(-1, 16))
    return folder


def test_replica(tmp_path):
    of = recording()
    folder = write_replica(tmp_path / "Replica/office0", of)
    source = open_source(folder)
    assert source.format == "replica"
    assert source.camera_origin == "Replica/cam_params.json"
    assert source.stamps[1] == "0.033333"
    assert_same(source, write_tum(tmp_path / "twin", of, scale=6553.5, suffix=".jpg"))


def test_replica_without_its_camera_file_has_the_published_one(tmp_path):
    folder = write_replica(tmp_path / "office0", recording())
    (tmp_path / "cam_params.json").unlink()
    camera = open_source(folder).camera
    assert (camera.width, camera.height, camera.depth_scale) == (1200, 680, 6553.5)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (600, 600, 599.5, 339.5)


def test_replica_with_frames_taken_out_keeps_each_its_pose(tmp_path):
    of = recording()
    folder = write_replica(tmp_path / "office0", of)
    (folder / "results/frame000002.jpg").unlink()
    source = open_source(folder)
    assert len(source) == FRAMES - 1
    kept = [index for index in range(FRAMES) if index != 2]
    np.testing.assert_allclose(source.ground_truth.poses, of.poses[kept], atol=1e-9)
    np.testing.assert_allclose(source.timestamps, np.array(kept) / RATE, atol=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is no JSON"),
        ("[]", "is no camera: it has no keys"),
        ('{"camera": 3}', "camera is 3; it must hold w h fx"),
        ('{"camera": {"w": 1200, "h": 680, "fx": 600}}', "'fy' is missing"),
        (
            '{"camera": {"w": 1200, "h": 680, "fx": 600, "fy": -1, "cx": 1, "cy": 1}}',
            "fy",
        ),
    ],
)
def test_a_bad_camera_file_is_one_line(tmp_path, content, words):
    folder = write_replica(tmp_path / "office0", recording())
    (tmp_path / "cam_params.json").write_text(content)
    with pytest.raises((CameraError, DatasetError), match=words) as caught:
        open_source(folder)
    assert "cam_params.json" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["1 2 3\n", "one two\n", "", b"\xff\xfe"])
def test_a_bad_trajectory_is_a_warning(tmp_path, content):
    folder = write_replica(tmp_path / "office0", recording())
    file = folder / "traj.txt"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    source = open_source(folder)
    assert source.ground_truth is None
    assert "traj.txt" in source.warnings[-1]


# -------------------------------------------------------------------------------------- Open3D


def write_open3d(folder, of, colour="color", names="{:06d}"):
    for index in range(FRAMES):
        name = names.format(index)
        write_image(folder / f"{colour}/{name}.jpg", of.colour[index])
        write_image(folder / f"depth/{name}.png", of.values(index, 1000))
    c = of.camera
    matrix = [c.fx, 0, 0, 0, c.fy, 0, c.cx, c.cy, 1]
    (folder / "camera_intrinsic.json").write_text(
        json.dumps({"width": c.width, "height": c.height, "intrinsic_matrix": matrix}, indent=4)
    )
    rows = []
    for index, pose in enumerate(of.poses):
        rows.append(f"{index} {index} {index + 1}\n")
        rows += [" ".join(f"{value:.8f}" for value in row) + "\n" for row in pose]
    (folder / "trajectory.log").write_text("".join(rows))
    return folder


@pytest.mark.parametrize("colour", ["color", "image", "rgb"])
def test_open3d(tmp_path, colour):
    of = recording()
    source = open_source(write_open3d(tmp_path / "lounge", of, colour))
    assert source.format == "open3d"
    assert source.describe()["recognised_by"] == (
        f"{colour}/ and depth/ and camera_intrinsic.json and trajectory.log"
    )
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000, suffix=".jpg"))


def test_open3d_without_intrinsics_has_open3d_s_default_for_vga_only(tmp_path):
    of = recording()
    folder = write_open3d(tmp_path / "lounge", of)
    (folder / "camera_intrinsic.json").unlink()
    with pytest.raises(DatasetError, match="the camera of 160x120 images is not known"):
        open_source(folder)
    assert (
        open_source(folder, camera=replace(of.camera, depth_scale=1000)).read(0).frame is not None
    )
    for file in (folder / "color").iterdir():
        write_image(file, np.zeros((480, 640, 3), np.uint8))
    source = open_source(folder)
    assert (source.camera.fx, source.camera.depth_scale) == (525, 1000)
    assert "PrimeSense" in source.camera_origin


def test_redwood_scans_have_microseconds_in_their_names(tmp_path):
    of = recording()
    folder = tmp_path / "redwood"
    write_open3d(folder, of, "rgb")
    for index in range(FRAMES):
        time = index * 33369
        (folder / f"rgb/{index:06d}.jpg").rename(folder / f"rgb/{index + 1:07d}-{time:012d}.jpg")
        # Depth has numbers and times of its own.
        name = f"depth/{index + 3:07d}-{time + 5000:012d}.png"
        (folder / f"depth/{index:06d}.png").rename(folder / name)
    source = open_source(folder)
    assert source.stamps[2] == "0.066738"
    assert source.format == "open3d"
    stamps = [f"{index * 0.033369:.6f}" for index in range(FRAMES)]
    twin = write_tum(tmp_path / "twin", of, scale=1000, suffix=".jpg", stamps=stamps, late=0.005)
    assert_same(source, twin)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is no JSON"),
        ('{"width": 640, "intrinsic_matrix": [1, 0, 0, 0, 1, 0, 2, 2, 1]}', "'height' is missing"),
        ('{"width": 6, "height": 4, "intrinsic_matrix": [1, 2]}', "intrinsic_matrix must be"),
        ("[1]", "is no camera: it has no keys"),
        ('{"width": 6, "height": 4, "intrinsic_matrix": [1, 0, 0, 0, 0, 0, 2, 2, 1]}', "fy"),
    ],
)
def test_a_bad_intrinsic_file_is_one_line(tmp_path, content, words):
    folder = write_open3d(tmp_path / "lounge", recording())
    (folder / "camera_intrinsic.json").write_text(content)
    with pytest.raises((CameraError, DatasetError), match=words) as caught:
        open_source(folder)
    assert "camera_intrinsic.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_log_that_does_not_fit_is_told(tmp_path):
    folder = write_open3d(tmp_path / "lounge", recording())
    rows = (folder / "trajectory.log").read_text().splitlines(keepends=True)
    (folder / "trajectory.log").write_text("".join(rows[:20]))
    source = open_source(folder)
    assert len(source.ground_truth) == 4
    assert "4 poses for 8 frames" in source.warnings[-1]
    (folder / "trajectory.log").write_text("".join(rows[:18]))
    assert open_source(folder).ground_truth is None


# ------------------------------------------------------------------------------- any folder


def write_generic(folder, of, colour="rgb", names=None, scale=1000.0):
    names = names or [f"{index:04d}" for index in range(FRAMES)]
    for index, name in enumerate(names):
        write_image(folder / f"{colour}/{name}.png", of.colour[index])
        write_image(folder / f"depth/{name}.png", of.values(index, scale))
    replace(of.camera, depth_scale=scale).to_yaml(folder / "camera.yaml")
    return folder


@pytest.mark.parametrize("colour", ["rgb", "color", "colour", "images", "img", "RGB"])
def test_a_folder_of_images(tmp_path, colour):
    of = recording()
    folder = write_generic(tmp_path / "mine", of, colour)
    stamps = [f"{index / RATE:.6f}" for index in range(FRAMES)]
    write_poses(folder / "groundtruth.txt", stamps, of.poses)
    source = open_source(folder)
    assert source.format == "folder"
    assert source.describe()["recognised_by"] == f"{colour}/ and depth/"
    assert "numbers instead of times" in source.warnings[0]
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000))


START = 1_403_636_579_763_555_584  # ns


@pytest.mark.parametrize(
    ("name", "stamp"),
    [
        (lambda i: f"{1.5 + i / 30:.6f}", lambda i: f"{1.5 + i / 30:.6f}"),
        (lambda i: f"{START + i * 33_000_000}", lambda i: str(START + i * 33_000_000)),
        (lambda i: f"{START // 10**3 + i * 33_000}", lambda i: str(START // 10**3 + i * 33_000)),
        (lambda i: f"{START // 10**6 + i * 33}", lambda i: str(START // 10**6 + i * 33)),
    ],
    ids=["s", "ns", "us", "ms"],
)
def test_names_that_are_times(tmp_path, name, stamp):
    of = recording()
    folder = write_generic(tmp_path / "mine", of, names=[name(i) for i in range(FRAMES)])
    source = open_source(folder)
    assert source.warnings == ()
    for index in range(FRAMES):
        digits = stamp(index)
        if "." not in digits:
            digits = f"{digits[:10]}.{digits[10:]}"
            digits += "0" * (17 - len(digits))
        assert source.stamps[index] == digits
        assert source.timestamps[index] == float(digits)


def test_numbers_match_whatever_stands_around_them(tmp_path):
    of = recording()
    folder = write_generic(tmp_path / "mine", of)
    for index in range(FRAMES):
        (folder / f"rgb/{index:04d}.png").rename(folder / f"rgb/frame-{index + 9}.color.png")
        (folder / f"depth/{index:04d}.png").rename(folder / f"depth/depth_{index + 9:05d}.png")
    (folder / "depth/depth_00011.png").unlink()
    source = open_source(folder)
    assert len(source) == FRAMES - 1
    assert "1 of 8 colour images have no depth image" in source.warnings[-1]
    expected = cv2.cvtColor(of.colour[1], cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(source.read(1).frame.grey, expected)
    assert source.stamps[1] == f"{10 / RATE:.6f}"


def test_names_without_numbers_match_by_name(tmp_path):
    of = recording()
    names = ["alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta"]
    source = open_source(write_generic(tmp_path / "mine", of, names=names))
    assert len(source) == FRAMES
    expected = cv2.cvtColor(of.colour[names.index(sorted(names)[3])], cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(source.read(3).frame.grey, expected)


def test_lists_of_other_names(tmp_path):
    of = recording()
    folder = write_tum(tmp_path / "mine", of, scale=1000)
    (folder / "rgb.txt").rename(folder / "color.txt")
    source = open_source(folder)
    assert source.format == "folder"
    assert source.describe()["recognised_by"] == "color.txt and depth.txt"
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000))


def test_a_user_s_camera_wins_everywhere(tmp_path):
    of = recording()
    mine = Camera(160, 120, 99, 99, 80, 60, depth_scale=2000)
    for write in (write_generic, write_open3d, write_replica):
        source = open_source(write(tmp_path / write.__name__, of), camera=mine)
        assert source.camera == mine
        depth = source.read(0).frame.depth
        written = open_source(tmp_path / write.__name__)
        scale = written.camera.depth_scale / 2000
        np.testing.assert_allclose(depth, written.read(0).frame.depth * scale, rtol=1e-5)


def test_folders_that_lack_a_part_are_one_line(tmp_path):
    of = recording()
    folder = write_generic(tmp_path / "mine", of)
    (folder / "camera.yaml").unlink()
    with pytest.raises(DatasetError, match=r"put a camera\.yaml"):
        open_source(folder)
    for file in (folder / "depth").iterdir():
        file.rename(file.with_name(f"other{1000 + int(file.stem)}.png"))
    with pytest.raises(DatasetError, match="no colour image has a depth image of the same"):
        open_source(folder, camera=of.camera)
    for file in (folder / "depth").iterdir():
        file.unlink()
    with pytest.raises(DatasetError, match="there are no depth images"):
        open_source(folder, camera=of.camera)
    (folder / "depth").rmdir()
    for format in ("folder", "open3d"):
        with pytest.raises(DatasetError, match="depth/"):
            open_source(folder, format=format)
    with pytest.raises(DatasetError, match="no colour images"):
        open_source(folder, format="replica")


def test_numbers_beside_a_truth_with_times_are_a_recording_without_its_lists(tmp_path):
    of = recording()
    folder = write_generic(tmp_path / "mine", of)
    write_poses(folder / "groundtruth.txt", [f"{1000 + i}.5" for i in range(FRAMES)], of.poses)
    with pytest.raises(DatasetError, match=r"give the lists rgb\.txt and depth\.txt"):
        open_source(folder)


def test_a_synthetic_sequence_without_its_lists_is_not_whole(tmp_path):
    of = recording()
    folder = write_generic(tmp_path / "mine", of)
    (folder / "README.txt").write_text(
        "Synthetic.\nTUM RGB-D layout; camera.yaml holds the camera and the depth scale.\n"
    )
    with pytest.raises(DatasetError, match="no known recording"):
        open_source(folder)
    assert len(open_source(folder, format="folder")) == FRAMES


@pytest.mark.parametrize("late", [7, -4])
def test_names_that_are_times_tell_the_delay_of_depth(tmp_path, late):
    folder = write_generic(
        tmp_path / "mine", recording(), names=[f"{START // 10**6 + i * 33}" for i in range(FRAMES)]
    )
    for file in sorted((folder / "depth").iterdir()):
        file.rename(file.with_name(f"{int(file.stem) + late}.png"))
    source = open_source(folder)
    assert len(source) == FRAMES
    for index in range(FRAMES):
        delay = source.read(index).frame.depth_delay
        assert delay == late / 1000


def test_names_that_are_numbers_tell_no_delay(tmp_path):
    source = open_source(write_generic(tmp_path / "mine", recording()))
    assert {source.read(index).frame.depth_delay for index in range(FRAMES)} == {0.0}
