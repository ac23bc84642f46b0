"""7-Scenes and ScanNet: depth is seen by a camera of its own."""

import struct
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.sevenscenes import _T_COLOUR_DEPTH, COLOUR_CAMERA, DEPTH_CAMERA
from edvo.datasets.two_cameras import TwoCameras, edge_fit
from edvo.errors import CameraError, DatasetError

from .. import problems  # noqa: TID252 - tests is no package to import by name
from .layouts import (
    CAMERA,
    FRAMES,
    assert_near,
    assert_same,
    recording,
    track,
    write_image,
    write_matrix,
    write_tum,
)


def assert_same_path(source, twin, metres=0.006, degrees=0.25):
    """Tracks agree as far as registering depth, which rounds to pixels, lets them."""
    for ours, theirs in zip(track(source).poses, track(twin).poses, strict=True):
        distance, angle = problems.error(theirs, ours)
        assert distance < metres
        assert angle < degrees


# ------------------------------------------------------------------------------------ 7-Scenes


def write_7scenes(folder, of, T_world_depth):
    for index, pose in enumerate(T_world_depth):
        name = f"frame-{index:06d}"
        write_image(folder / f"{name}.color.png", of.colour[index])
        write_image(folder / f"{name}.depth.png", of.values(index, 1000, missing=65535))
        rows = ["\t".join(f"{value: .7e}" for value in row) for row in pose]
        (folder / f"{name}.pose.txt").write_text("\t\n".join(rows) + "\t\n")
    return folder


T = tuple(_T_COLOUR_DEPTH.ravel().tolist())


def test_7scenes_depth_is_registered_and_the_poses_carried_over(tmp_path):
    of = recording(COLOUR_CAMERA, DEPTH_CAMERA, T)
    folder = write_7scenes(tmp_path / "chess/seq-01", of, of.poses @ _T_COLOUR_DEPTH)
    source = open_source(folder)
    assert source.format == "7scenes"
    assert source.camera is COLOUR_CAMERA
    told = source.describe()
    assert "registered to colour by" in told["registration"]
    assert told["recognised_by"] == "frame-*.color.png"
    assert told["warnings"] == []
    assert source.stamps[1] == "0.033333"
    np.testing.assert_allclose(source.ground_truth.poses, of.poses, atol=1e-6)
    frame = source.read(3).frame
    true = recording(COLOUR_CAMERA).depth[3]
    both = (frame.depth > 0) & (true > 0)
    assert both.mean() > 0.8
    assert np.mean(np.abs(frame.depth - true)[both] < 0.01) > 0.97
    assert_near(track(source), source.ground_truth)
    assert_same_path(source, open_source(write_tum(tmp_path / "twin", recording(COLOUR_CAMERA))))


def test_7scenes_that_is_registered_already_is_left_so(tmp_path):
    camera = DEPTH_CAMERA.scaled(0.25)
    of = recording(camera)
    folder = write_7scenes(tmp_path / "seq-01", of, of.poses)
    source = open_source(folder)
    assert "not registered again" in source.describe()["registration"]
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000))
    # Also if the camera is given.
    mine = replace(camera, name="")
    assert_same(open_source(folder, camera=mine), tmp_path / "twin")


def test_7scenes_lost_poses_are_left_out(tmp_path):
    of = recording(DEPTH_CAMERA.scaled(0.25))
    folder = write_7scenes(tmp_path / "seq-01", of, of.poses)
    (folder / "frame-000001.pose.txt").write_text("nan " * 16)
    (folder / "frame-000003.pose.txt").unlink()
    source = open_source(folder)
    assert len(source.ground_truth) == FRAMES - 2
    assert "1 of 7 poses" in source.warnings[-1]
    (folder / "frame-000002.pose.txt").write_text("1 2 3")
    source = open_source(folder)
    assert source.ground_truth is None
    assert "frame-000002.pose.txt holds 3 numbers" in source.warnings[-1]


def test_a_scene_of_7scenes_is_told_to_hold_sequences(tmp_path):
    (tmp_path / "chess/seq-01").mkdir(parents=True)
    with pytest.raises(DatasetError, match="give one of its sequences"):
        open_source(tmp_path / "chess", format="7scenes")


def test_the_fit_of_edges_tells_registered_depth():
    bare = recording(COLOUR_CAMERA.scaled(0.5), DEPTH_CAMERA.scaled(0.5), T)
    right = recording(COLOUR_CAMERA.scaled(0.5))
    fits = []
    for of in (bare, right):
        frame = problems.Frame(0.0, cv2.cvtColor(of.colour[0], cv2.COLOR_BGR2GRAY), of.depth[0])
        fits.append(edge_fit(frame))
    assert fits[1] > 1.3 * fits[0]
    flat = problems.Frame(0.0, frame.grey, np.full_like(frame.depth, 2.0))
    assert edge_fit(flat) is None


# ------------------------------------------------------------------------------------- ScanNet


def intrinsic(camera):
    matrix = np.eye(4)
    matrix[:3, :3] = camera.matrix
    return matrix


def write_scannet(folder, of, depth_camera, T_colour_depth=None, suffix=".jpg", step=1):
    """The poses are those of the depth camera, as its extrinsic is the identity."""
    T_colour_depth = np.eye(4) if T_colour_depth is None else T_colour_depth
    for index in range(FRAMES):
        number = index * step
        write_image(folder / f"color/{number}{suffix}", of.colour[index])
        write_image(folder / f"depth/{number}.png", of.values(index, 1000))
        write_matrix(folder / f"pose/{number}.txt", of.poses[index] @ T_colour_depth)
    write_matrix(folder / "intrinsic/intrinsic_color.txt", intrinsic(of.camera))
    write_matrix(folder / "intrinsic/extrinsic_color.txt", T_colour_depth)
    write_matrix(folder / "intrinsic/intrinsic_depth.txt", intrinsic(depth_camera))
    write_matrix(folder / "intrinsic/extrinsic_depth.txt", np.eye(4))
    return folder


@pytest.mark.parametrize("inside", ["frames", "."])
def test_scannet_with_cameras_alike(tmp_path, inside):
    of = recording()
    write_scannet(tmp_path / "scene0000_00" / inside, of, CAMERA)
    source = open_source(tmp_path / "scene0000_00")
    assert source.format == "scannet"
    prefix = "" if inside == "." else "frames/"
    assert source.describe()["recognised_by"].startswith(f"{prefix}color/ and {prefix}depth/")
    twin = write_tum(tmp_path / "twin", of, scale=1000, suffix=".jpg")
    assert_same(source, twin, poses=2e-6)


FINE = Camera(324, 242, fx=292.0, fy=291.0, cx=161.0, cy=122.0)
OFFSET = se3.exp(np.array([0.02, -0.01, 0.005, 0.01, -0.01, 0.005]))


@pytest.mark.parametrize("T_colour_depth", [np.eye(4), OFFSET], ids=["as ScanNet", "offset"])
def test_scannet_with_finer_colour(tmp_path, T_colour_depth):
    depth_camera = replace(CAMERA, fx=145.0, fy=145.0)
    of = recording(FINE, depth_camera, tuple(T_colour_depth.ravel().tolist()))
    folder = write_scannet(tmp_path / "scene", of, depth_camera, T_colour_depth, step=20)
    source = open_source(folder)
    assert replace(source.camera, name="") == replace(FINE.scaled(160 / 324), depth_scale=1000)
    np.testing.assert_allclose(source.timestamps, np.arange(FRAMES) * 20 / 30, atol=1e-6)
    np.testing.assert_allclose(source.ground_truth.poses, of.poses, atol=3e-6)
    assert_near(track(source), source.ground_truth)
    seen = recording(source.camera)
    frame = source.read(2).frame
    both = (frame.depth > 0) & (seen.depth[2] > 0)
    assert both.mean() > 0.8
    assert np.mean(np.abs(frame.depth - seen.depth[2])[both] < 0.02) > 0.95
    small = tuple(cv2.resize(c, (160, 120), interpolation=cv2.INTER_AREA) for c in of.colour)
    twin = write_tum(tmp_path / "twin", replace(seen, colour=small), stamps=list(source.stamps))
    assert_same_path(source, open_source(twin))


def test_scannet_lost_frames_have_no_true_pose(tmp_path):
    of = recording()
    folder = write_scannet(tmp_path / "scene", of, CAMERA)
    write_matrix(folder / "pose/2.txt", np.full((4, 4), -np.inf))
    source = open_source(folder)
    assert len(source) == FRAMES
    assert len(source.ground_truth) == FRAMES - 1
    assert "1 of 8 poses are no rigid motions" in source.warnings[-1]
    for file in (folder / "pose").iterdir():
        file.unlink()
    assert open_source(folder).ground_truth is None


@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("intrinsic_color.txt", None, "cannot read"),
        ("intrinsic_color.txt", "1 2 3", "holds 3 numbers"),
        ("intrinsic_depth.txt", "0 " * 16, "fx"),
        ("extrinsic_color.txt", "0 " * 16, "no rigid motion"),
    ],
)
def test_scannet_with_a_bad_calibration_is_one_line(tmp_path, file, content, words):
    folder = write_scannet(tmp_path / "scene", recording(), CAMERA)
    (folder / "intrinsic" / file).unlink()
    if content is not None:
        (folder / "intrinsic" / file).write_text(content)
    with pytest.raises((CameraError, DatasetError), match=words) as caught:
        open_source(folder)
    assert file in str(caught.value)
    assert "\n" not in str(caught.value)


def test_images_of_another_size_are_problems(tmp_path):
    of = recording(FINE, CAMERA)
    folder = write_scannet(tmp_path / "scene", of, CAMERA)
    write_image(folder / "color/1.jpg", np.zeros((50, 60, 3), np.uint8))
    write_image(folder / "depth/2.png", np.ones((50, 60), np.uint16))
    source = open_source(folder)
    assert "1.jpg is 60x50 and its camera is 324x242" in source.read(1).problem
    assert "2.png is 60x50 and its camera is 160x120" in source.read(2).problem


def test_two_cameras_that_are_one_need_no_registration():
    assert TwoCameras(CAMERA, replace(CAMERA, fx=131.2501), np.eye(4)).is_registered
    assert not TwoCameras(CAMERA, replace(CAMERA, fx=132.0), np.eye(4)).is_registered
    assert not TwoCameras(CAMERA, CAMERA, OFFSET).is_registered
    assert not TwoCameras(FINE, CAMERA, np.eye(4)).is_registered


# --------------------------------------------------------------------------------------- .sens


def write_sens(file, of, *, colour="jpg", depth="zlib", times=True, late=0, **header):
    """As ScanNet's C++ writes it; depth is so many microseconds later."""
    c = of.camera
    values = {"version": 4, "name": 8, "size": (c.width, c.height), "depth_size": None}
    values |= {"frames": FRAMES, "kinds": ({"raw": 0, "png": 1, "jpg": 2}[colour], 1)}
    values |= header
    width, height = values["size"]
    if depth == "raw":
        values["kinds"] = (values["kinds"][0], 0)
    out = struct.pack("<IQ", values["version"], values["name"]) + b"StructIO"
    for matrix in (intrinsic(c), np.eye(4), intrinsic(c), np.eye(4)):
        out += matrix.astype("<f4").tobytes()
    out += struct.pack(
        "<2i4IfQ",
        *values["kinds"],
        width,
        height,
        *of.depth[0].shape[::-1],
        1000.0,
        values["frames"],
    )
    for index in range(FRAMES):
        image = of.colour[index]
        if colour == "raw":
            first = image[:, :, ::-1].tobytes()
        else:
            first = cv2.imencode(f".{colour}", image)[1].tobytes()
        second = of.values(index, 1000).astype("<u2").tobytes()
        second = zlib.compress(second) if depth == "zlib" else second
        out += of.poses[index].astype("<f4").tobytes()
        time = 5_000_000 + index * 33_333 if times else 0
        out += struct.pack("<4Q", time, time + late, len(first), len(second)) + first + second
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(out + struct.pack("<Q", 0))
    return file


@pytest.mark.parametrize(
    ("colour", "depth", "late"), [("jpg", "zlib", 0), ("png", "raw", 4000), ("raw", "zlib", -9000)]
)
def test_sens(tmp_path, colour, depth, late):
    of = recording()
    file = tmp_path / "scene0000_00/scene0000_00.sens"
    write_sens(file, of, colour=colour, depth=depth, late=late)
    stamps = [f"{5 + index * 0.033333:.6f}" for index in range(FRAMES)]
    suffix = ".jpg" if colour == "jpg" else ".png"
    twin = write_tum(
        tmp_path / "twin", of, scale=1000, suffix=suffix, stamps=stamps, late=late / 1e6
    )
    for path in (file, file.parent):
        source = open_source(path)
        assert source.format == "sens"
        assert source.describe()["recognised_by"] == "the name 'scene0000_00.sens'"
        # The file's numbers are float32.
        camera = replace(source.camera, fx=CAMERA.fx, cy=CAMERA.cy)
        assert replace(camera, depth_scale=5000.0) == CAMERA
        assert_same(source, twin, poses=1e-6)


@pytest.mark.parametrize(
    "changes", [{"late": 20_001}, {"late": -5_000_000}, {"times": False, "late": 3000}]
)
def test_sens_whose_stamps_tell_no_delay(tmp_path, changes):
    """Of another clock, without those of depth, and without those of colour."""
    source = open_source(write_sens(tmp_path / "a.sens", recording(), **changes))
    assert {source.read(index).frame.depth_delay for index in range(FRAMES)} == {0.0}


def test_sens_without_times(tmp_path):
    source = open_source(write_sens(tmp_path / "a.sens", recording(), times=False))
    assert source.stamps[1] == "0.033333"
    assert "numbers instead of times" in source.describe()["times"]
    assert source.warnings == ()


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_a_sens_file_cut_short_gives_the_frames_it_has(tmp_path, share):
    file = write_sens(tmp_path / "a.sens", recording())
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    source = open_source(file)
    assert 0 < len(source) < FRAMES
    assert f"has {len(source)} of {FRAMES} frames" in source.warnings[-1]
    assert source.read(len(source) - 1).problem is None


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: b"", "cut short within its header"),
        (lambda data: data[:100], "cut short within its header"),
        (lambda data: data[:500], "no whole frame"),
        (lambda data: b"\x89PNG" + data, "no .sens file of version 4"),
        (lambda data: data[:4] + b"\xff" * 8 + data[12:], "sensor's name"),
    ],
)
def test_a_sens_file_that_is_none_is_one_line(tmp_path, spoil, words):
    file = write_sens(tmp_path / "a.sens", recording())
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(DatasetError, match=words) as caught:
        open_source(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"kinds": (2, 2)}, "extract it with ScanNet's SensReader"),
        ({"size": (0, 120)}, "is damaged: images of 0x120"),
        ({"size": (2**31, 120)}, "is damaged"),
    ],
)
def test_a_sens_header_that_cannot_be_is_one_line(tmp_path, header, words):
    file = write_sens(tmp_path / "a.sens", recording(), **header)
    with pytest.raises(DatasetError, match=words):
        open_source(file)


def test_declared_sizes_cost_no_memory(tmp_path):
    file = write_sens(tmp_path / "a.sens", recording(), frames=2**63)
    source = open_source(file)
    assert len(source) == FRAMES
    assert "8 of 9223372036854775808" in source.warnings[-1]
    # Depth that swells: ten million zeros in ten kilobytes.
    bomb = zlib.compress(bytes(10_000_000))
    data = bytearray(file.read_bytes())
    at = 4 + 8 + 8 + 4 * 64 + struct.calcsize("<2i4IfQ")
    colour_size, depth_size = struct.unpack_from("<2Q", data, at + 80)
    start = at + 96 + colour_size
    struct.pack_into("<Q", data, at + 88, len(bomb))
    data[start : start + depth_size] = bomb
    file.write_bytes(data)
    source = open_source(file)
    assert "frame 0 depth has not 160x120 values" in source.read(0).problem
    assert source.read(1).problem is None


def test_sens_images_that_are_damaged_are_problems(tmp_path):
    file = write_sens(tmp_path / "a.sens", recording())
    data = bytearray(file.read_bytes())
    at = 4 + 8 + 8 + 4 * 64 + struct.calcsize("<2i4IfQ")
    colour_size, depth_size = struct.unpack_from("<2Q", data, at + 80)
    data[at + 96 + colour_size : at + 96 + colour_size + depth_size] = bytes(depth_size)
    file.write_bytes(data)
    source = open_source(file)
    assert "a.sens frame 0 depth is damaged" in source.read(0).problem
    data[at + 96 : at + 96 + colour_size] = bytes(colour_size)
    file.write_bytes(data)
    assert "a.sens frame 0 colour" in open_source(file).read(0).problem
