"""ICL-NUIM, Bonn and ETH3D: TUM's lists with cameras and poses of their own."""

import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.datasets import bonn, open_source
from edvo.datasets.known_cameras import KNOWN_CAMERAS
from edvo.errors import CameraError, DatasetError
from edvo.trajectory import Trajectory

from .layouts import (
    FRAMES,
    assert_near,
    assert_same,
    recording,
    track,
    write_image,
    write_poses,
    write_tum,
)

FLIP = np.diag([1.0, -1.0, 1.0, 1.0])


def write_icl(folder, of):
    """As the archives are: numbered files, depth first in the list, no pose for frame 0."""
    rows = []
    for index in range(FRAMES):
        write_image(folder / f"rgb/{index}.png", of.colour[index])
        write_image(folder / f"depth/{index}.png", of.values(index, 5000))
        rows.append(f"{index} depth/{index}.png {index} rgb/{index}.png\n")
    (folder / "associations.txt").write_text("".join(rows))
    lines = []
    for index in range(1, FRAMES):
        t, q = se3.to_quaternion(FLIP @ of.poses[index] @ FLIP)
        lines.append(" ".join([str(index), *(f"{value:.9g}" for value in (*t, *q))]) + "\n")
    (folder / "livingRoom2.gt.freiburg").write_text("".join(lines))
    return folder


def test_icl_is_read_with_y_down(tmp_path):
    of = recording()
    folder = write_icl(tmp_path / "living_room_traj2_frei_png", of)
    source = open_source(folder)
    assert source.format == "icl"
    assert source.camera == KNOWN_CAMERAS["icl-nuim"]
    assert source.camera.fy > 0
    assert list(source.stamps) == [str(index) for index in range(FRAMES)]
    told = source.describe()
    assert told["recognised_by"] == "livingRoom2.gt.freiburg and associations.txt"
    assert told["ground_truth"]["frames"] == FRAMES - 1
    source = open_source(folder, camera=of.camera)
    np.testing.assert_allclose(source.ground_truth.poses, of.poses[1:], atol=1e-7)
    twin = write_tum(tmp_path / "twin", of, truth=False)
    assert_same(source, twin, stamps=False)
    assert_near(track(source), Trajectory.from_poses(source.timestamps, of.poses))


def test_icl_poses_that_are_renamed_are_told_by_their_numbers(tmp_path):
    of = recording()
    folder = write_icl(tmp_path / "living_room_traj2_frei_png", of)
    renamed = folder / "groundtruth.txt"
    (folder / "livingRoom2.gt.freiburg").rename(renamed)
    source = open_source(folder)
    assert source.format == "icl"
    np.testing.assert_allclose(source.ground_truth.poses, of.poses[1:], atol=1e-7)
    # Elsewhere, or with times, they are taken as they are.
    renamed.write_text("# turned\n0.033333" + renamed.read_text()[1:])
    assert open_source(folder).format == "tum"
    (tmp_path / "elsewhere").mkdir()
    other = folder.rename(tmp_path / "elsewhere/mine")
    write_icl(other, of)
    (other / "livingRoom2.gt.freiburg").rename(other / "groundtruth.txt")
    assert open_source(other, camera=of.camera).format == "tum"


def test_icl_published_pose_is_what_the_converted_excerpt_says(real_data):
    """The second pose of office kt3, as published, against the excerpt that others converted."""
    excerpt = open_source(real_data / "icl_office_kt3").ground_truth
    published = se3.from_quaternion(
        (-0.00126362, 0.00400925, -2.49997), (0.00213729, -0.000606835, -0.000311375, 0.999997)
    )
    np.testing.assert_allclose((FLIP @ published @ FLIP), excerpt.poses[1], atol=1e-6)


def write_povray(folder, of, *, names="scene_00_{:04d}", unit=1.0):
    """As POV-Ray writes: distances along rays, and poses with y up, in metres or centimetres."""
    c = of.camera
    pixels = np.stack(np.meshgrid(np.arange(c.width), np.arange(c.height)), axis=-1).reshape(-1, 2)
    lengths = np.linalg.norm(c.backproject(pixels, np.ones(len(pixels))), axis=1)
    for index in range(FRAMES):
        name = names.format(index)
        write_image(folder / f"{name}.png", of.colour[index])
        distances = of.depth[index].ravel() * lengths * unit
        (folder / f"{name}.depth").write_text(" ".join(f"{value:.6f}" for value in distances))
        T = FLIP @ of.poses[index] @ FLIP
        rows = [("cam_pos", T[:3, 3] * unit), ("cam_dir", T[:3, 2]), ("cam_up", T[:3, 1])]
        rows += [("cam_lookat", (0, 0, 1)), ("cam_sky", (0, 1, 0)), ("cam_right", 1.33 * T[:3, 0])]
        lines = [f"{key:13}= [{', '.join(f'{x:.9g}' for x in v)}]';" for key, v in rows]
        (folder / f"{name}.txt").write_text("\n".join([*lines, "cam_angle    = 90;"]) + "\n")
    return folder


@pytest.mark.parametrize(
    ("name", "files", "unit"),
    [
        ("living_room_traj2_loop", "scene_00_{:04d}", 1.0),
        ("office_room_traj0_loop", "scene_{:03d}", 100.0),
    ],
)
def test_icl_as_it_was_rendered(tmp_path, name, files, unit):
    of = recording()
    folder = write_povray(tmp_path / name, of, names=files, unit=unit)
    source = open_source(folder, camera=of.camera)
    assert source.format == "povray"
    assert source.camera.depth_scale == unit
    told = source.describe()
    assert told["recognised_by"] == "scene_*.depth"
    assert told["distances"] == ("metres" if unit == 1 else "centimetres")
    np.testing.assert_allclose(source.ground_truth.poses, of.poses, atol=1e-6)
    twin = open_source(write_tum(tmp_path / "twin", of))
    np.testing.assert_allclose(source.timestamps, twin.timestamps, atol=1e-6)
    for index in range(FRAMES):
        ours, theirs = source.read(index).frame, twin.read(index).frame
        np.testing.assert_array_equal(ours.grey, theirs.grey)
        np.testing.assert_allclose(ours.depth, theirs.depth, atol=1.01e-4)  # its file's rounding
    # as far apart as their depths, and a little
    np.testing.assert_allclose(track(source).poses, track(twin).poses, atol=2e-4)
    assert_near(track(source), source.ground_truth)


def test_icl_as_it_was_rendered_has_its_camera(tmp_path):
    of = recording(KNOWN_CAMERAS["icl-nuim"])
    source = open_source(write_povray(tmp_path / "mine", of))
    assert (source.camera.fx, source.camera.fy) == (481.2, 480.0)
    depth = source.read(3).frame.depth
    np.testing.assert_allclose(depth, of.depth[3], atol=1e-5)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "holds 0 numbers"),
        ("1 2 3", "holds 3 numbers"),
        ("one two", "something else than numbers"),
        ("1 " * 500_000, "more than 19200 numbers"),
        ("0 " * 19200, "no valid depth"),
        ("nan " * 19200, "no valid depth"),
        (None, "holds 3 numbers"),
    ],
)
def test_bad_distances_are_one_line(tmp_path, content, words):
    of = recording()
    folder = write_povray(tmp_path / "mine", of)
    (folder / "scene_00_0000.depth").write_text("1 2 3" if content is None else content)
    if content is not None:
        source = open_source(folder, camera=of.camera)
        problem = source.read(0).problem
        assert source.read(1).problem is None
    else:
        for file in folder.glob("*.depth"):
            file.write_text("1 2 3")
        with pytest.raises(DatasetError) as caught:
            open_source(folder, camera=of.camera)
        problem = str(caught.value)
    assert "scene_00_0000.depth" in problem
    assert words in problem
    assert "\n" not in problem


def test_a_bad_camera_of_a_render_is_a_warning(tmp_path):
    of = recording()
    folder = write_povray(tmp_path / "mine", of)
    (folder / "scene_00_0002.txt").write_text("cam_pos = [1, 2]';\n")
    source = open_source(folder, camera=of.camera)
    assert source.ground_truth is None
    assert "scene_00_0002.txt has no cam_pos" in source.warnings[-1]


def test_bonn_poses_are_the_camera_s(tmp_path):
    of = recording()
    T_m = bonn.of_camera(np.eye(4)[None])[0]  # T_ros is its own inverse
    T_ros = np.array([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    assert np.abs(T_m[:3, :3] - bonn._T_M[:3, :3]).max() < 0.06
    marker = np.array([T_ros @ pose @ np.linalg.inv(T_m) @ T_ros for pose in of.poses])
    folder = write_tum(tmp_path / "rgbd_bonn_balloon", of, truth=False)
    stamps = [f"{index / 30:.6f}" for index in range(FRAMES)]
    write_poses(folder / "groundtruth.txt", stamps, marker)
    source = open_source(folder)
    assert source.format == "bonn"
    assert source.describe()["recognised_by"] == "the name 'rgbd_bonn_balloon' and " + (
        "rgb.txt and depth.txt"
    )
    assert_same(source, write_tum(tmp_path / "twin", of))
    (folder / "camera.yaml").unlink()
    assert open_source(folder).camera == KNOWN_CAMERAS["bonn"]
    # Forced, it is TUM with the poses as they are.
    raw = open_source(folder, format="tum").ground_truth.poses
    np.testing.assert_allclose(raw, marker, atol=1e-9)


def write_eth3d(folder, of, calibration=None):
    write_tum(folder, of)
    (folder / "camera.yaml").unlink()
    c = of.camera
    (folder / "calibration.txt").write_text(calibration or f"{c.fx} {c.fy} {c.cx} {c.cy}\n")
    rgb, depth = ((folder / f"{k}.txt").read_text().splitlines()[1:] for k in ("rgb", "depth"))
    rows = [f"{a} {b}\n" for a, b in zip(rgb, depth, strict=True)]
    (folder / "associated.txt").write_text("".join(rows))
    return folder


def test_eth3d_states_its_camera(tmp_path):
    of = recording()
    folder = write_eth3d(tmp_path / "plant_1", of)
    source = open_source(folder)
    assert source.format == "eth3d"
    assert "calibration.txt" in source.camera_origin
    assert_same(source, write_tum(tmp_path / "twin", of))
    (folder / "rgb.txt").unlink()
    assert len(open_source(folder)) == FRAMES
    assert open_source(folder, camera="bonn").camera == KNOWN_CAMERAS["bonn"]
    Camera(160, 120, 99, 99, 80, 60).to_yaml(folder / "camera.yaml")
    assert open_source(folder).camera.fx == 99


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        ("500 500 320\n", DatasetError, "holds 3 numbers; it must be 'fx fy cx cy'"),
        ("fx fy cx cy\n", DatasetError, "must hold numbers"),
        ("-500 500 320 240\n", CameraError, "calibration.txt: fx"),
    ],
)
def test_a_bad_calibration_is_one_line(tmp_path, content, error, words):
    folder = write_eth3d(tmp_path / "plant_1", recording(), content)
    with pytest.raises(error, match=words) as caught:
        open_source(folder)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bad_trajectory_is_a_warning(tmp_path):
    folder = write_icl(tmp_path / "lr", recording())
    (folder / "livingRoom2.gt.freiburg").write_text("1 2 3\n")
    source = open_source(folder, camera=recording().camera)
    assert source.ground_truth is None
    assert "gt.freiburg:1" in source.warnings[-1]
