"""Each format, read back: by other programs' own readers where they install."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.export.colmap import to_colmap
from edvo.export.edge_map import EdgePoints
from edvo.export.euroc import to_euroc
from edvo.export.kitti import to_kitti
from edvo.export.nerfstudio import T_CAM_GL, to_nerfstudio
from edvo.export.pixels import image_names
from edvo.export.ply import to_ply
from edvo.trajectory import Trajectory

CAMERA = Camera(width=640, height=480, fx=525.0, fy=520.0, cx=319.5, cy=239.25)
STAMPS = ("1305031102.175304", "1305031102.211214", "1305031102.243211", "1305031103.000000")
NAMES = [f"{stamp}.png" for stamp in STAMPS]


@pytest.fixture
def trajectory() -> Trajectory:
    rng = np.random.default_rng(3)
    poses = np.array([se3.exp(rng.normal(size=6)) for _ in STAMPS])
    return Trajectory.from_poses([float(stamp) for stamp in STAMPS], poses, STAMPS)


@pytest.fixture
def points() -> EdgePoints:
    rng = np.random.default_rng(4)
    return EdgePoints(
        rng.normal(size=(50, 3)),
        rng.normal(size=(50, 2)),
        rng.integers(0, 256, 50).astype(np.uint8),
        np.ones(50, np.int64),
    )


def rotation(w: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Rotation of a quaternion, by the formula and not by the package."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_kitti(trajectory: Trajectory) -> None:
    poses, times = to_kitti(trajectory)
    rows = np.array([[float(value) for value in line.split()] for line in poses.splitlines()])
    np.testing.assert_allclose(rows.reshape(-1, 3, 4), trajectory.poses[:, :3], atol=1e-10)
    seconds = [float(line) for line in times.splitlines()]
    assert seconds == pytest.approx([0.0, 0.03591, 0.067907, 0.824696], abs=1e-6)


def test_euroc(trajectory: Trajectory) -> None:
    lines = to_euroc(trajectory).splitlines()
    assert lines[0].startswith("#timestamp [ns]")
    assert [line.split(",")[0] for line in lines[1:]] == [
        stamp.replace(".", "") + "000" for stamp in STAMPS
    ]
    for line, pose in zip(lines[1:], trajectory.poses, strict=True):
        x, y, z, *quaternion = (float(value) for value in line.split(",")[1:])
        np.testing.assert_allclose([x, y, z], pose[:3, 3], atol=1e-10)
        np.testing.assert_allclose(rotation(*quaternion), pose[:3, :3], atol=1e-10)


def test_euroc_counts_time_where_stamps_are_frame_numbers() -> None:
    indexed = Trajectory(np.array([0.1, 0.2]), np.tile(np.eye(4), (2, 1, 1)), ("3", "6"))
    times = [line.split(",")[0] for line in to_euroc(indexed).splitlines()[1:]]
    assert times == ["100000000", "200000000"]


def test_evo_reads_kitti_and_euroc(trajectory: Trajectory, tmp_path: Path) -> None:
    program = shutil.which("evo_traj", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("no evo_traj: pip install evo")
    poses, _ = to_kitti(trajectory)
    (tmp_path / "kitti.txt").write_text(poses)
    (tmp_path / "euroc.csv").write_text(to_euroc(trajectory))
    subprocess.run(
        [program, "euroc", "euroc.csv", "--save_as_tum"],
        cwd=tmp_path,
        env={"HOME": str(tmp_path), "MPLBACKEND": "Agg"},
        check=True,
        capture_output=True,
    )
    again = Trajectory.read(tmp_path / "euroc.tum")
    np.testing.assert_allclose(again.poses, trajectory.poses, atol=1e-8)
    np.testing.assert_allclose(again.timestamps, trajectory.timestamps, atol=1e-6)
    done = subprocess.run(
        [program, "kitti", "kitti.txt", "--full_check"],
        cwd=tmp_path,
        env={"HOME": str(tmp_path), "MPLBACKEND": "Agg"},
        check=True,
        capture_output=True,
        text=True,
    )
    assert re.search(r"SE\(3\) conform\s+yes", done.stdout)
    length = float(re.search(r"path length \(m\)\s+([\d.]+)", done.stdout)[1])
    steps = np.diff(trajectory.poses[:, :3, 3], axis=0)
    assert length == pytest.approx(np.linalg.norm(steps, axis=1).sum())


def test_colmap_by_hand(trajectory: Trajectory, points: EdgePoints) -> None:
    files = to_colmap(trajectory, CAMERA, points, NAMES)
    camera = [row for row in files["cameras.txt"].splitlines() if not row.startswith("#")]
    assert camera == ["1 PINHOLE 640 480 525 520 320 239.75"]
    rows = [row for row in files["images.txt"].splitlines() if not row.startswith("#")]
    assert rows[1::2] == [""] * len(trajectory)
    for row, stamp, T_world_cam in zip(rows[::2], STAMPS, trajectory.poses, strict=True):
        fields = row.split()
        assert fields[8:] == ["1", f"{stamp}.png"]
        values = [float(value) for value in fields[1:8]]
        # The camera's own place must come out at its origin.
        here = rotation(*values[:4]) @ T_world_cam[:3, 3] + values[4:]
        np.testing.assert_allclose(here, 0.0, atol=1e-9)
        np.testing.assert_allclose(rotation(*values[:4]).T, T_world_cam[:3, :3], atol=1e-9)
    places = [row.split() for row in files["points3D.txt"].splitlines()[1:]]
    assert len(places) == 50
    np.testing.assert_allclose(np.array(places)[:, 1:4].astype(float), points.points, atol=1e-6)


@pytest.mark.parametrize(
    ("distortion", "model"),
    [
        ((0.0,) * 5, "PINHOLE"),
        ((0.1, -0.2, 0.001, 0.002, 0.0), "OPENCV"),
        ((0.1, -0.2, 0.001, 0.002, 0.03), "FULL_OPENCV"),
    ],
)
def test_pycolmap_reads_it(
    trajectory: Trajectory,
    points: EdgePoints,
    tmp_path: Path,
    distortion: tuple[float, float, float, float, float],
    model: str,
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    camera = Camera(
        width=640, height=480, fx=525.0, fy=520.0, cx=319.5, cy=239.25, distortion=distortion
    )
    for name, content in to_colmap(trajectory, camera, points, NAMES, Path("/a b/c")).items():
        (tmp_path / name).write_text(content)
    found = pycolmap.Reconstruction(str(tmp_path))
    assert found.num_images() == len(trajectory)
    assert len(found.points3D) == 50
    assert found.cameras[1].model.name == model
    # A point in the world must fall on the same pixel by both.
    ahead = np.array([[0.1, -0.2, 1.5]])
    by_name = {image.name: image for image in found.images.values()}
    for stamp, T_world_cam in zip(STAMPS, trajectory.poses, strict=True):
        world = ahead @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]
        pixel = by_name[f"{stamp}.png"].project_point(world[0])
        np.testing.assert_allclose(pixel, camera.project(ahead)[0] + 0.5, atol=1e-6)


def test_nerfstudio(trajectory: Trajectory) -> None:
    content = json.loads(to_nerfstudio(trajectory, CAMERA, "edges.ply", NAMES))
    assert (content["w"], content["h"], content["fl_x"]) == (640, 480, 525.0)
    assert (content["cx"], content["cy"]) == (320.0, 239.75)
    assert content["ply_file_path"] == "edges.ply"
    assert [frame["file_path"] for frame in content["frames"]] == [
        f"images/{stamp}.png" for stamp in STAMPS
    ]
    for frame, T_world_cam in zip(content["frames"], trajectory.poses, strict=True):
        T = np.array(frame["transform_matrix"])
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_allclose(T[:, 3], T_world_cam[:, 3])
        np.testing.assert_allclose(-T[:, 2], T_world_cam[:, 2])  # it looks along -z
        np.testing.assert_allclose(-T[:, 1], T_world_cam[:, 1])  # its y is up
        np.testing.assert_allclose(T @ T_CAM_GL, T_world_cam)


def test_images_are_named_as_their_files(tmp_path: Path) -> None:
    class Files:
        colour_files = tuple(tmp_path / "rgb" / name for name in ("a.jpg", "b.jpg", "c.jpg"))

    class Split:
        colour_files = (tmp_path / "left/0.png", tmp_path / "right/0.png")

    assert image_names(Files(), [2, 0], STAMPS[:2]) == (["c.jpg", "a.jpg"], tmp_path / "rgb")
    assert image_names(Split(), [1], STAMPS[:1]) == (["right/0.png"], tmp_path)
    assert image_names(object(), [0, 1], STAMPS[:2]) == (NAMES[:2], None)


def test_colmap_says_where_the_images_are(trajectory: Trajectory, points: EdgePoints) -> None:
    files = to_colmap(trajectory, CAMERA, points, NAMES, Path("/data/fr1/rgb"))
    assert "# images: /data/fr1/rgb\n" in files["images.txt"]


def test_open3d_reads_ply(points: EdgePoints, tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    colours = np.random.default_rng(0).integers(0, 256, (50, 3)).astype(np.uint8)
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    (tmp_path / "cloud.ply").write_bytes(to_ply(points.points, colours))
    (tmp_path / "mesh.ply").write_bytes(to_ply(points.points, colours, triangles))
    cloud = open3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    np.testing.assert_allclose(np.asarray(cloud.points), points.points, atol=1e-6)
    np.testing.assert_allclose(np.asarray(cloud.colors), colours / 255, atol=1e-6)
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    np.testing.assert_array_equal(np.asarray(mesh.triangles), triangles)


def test_ply_to_the_byte() -> None:
    data = to_ply(np.array([[1.0, 2.0, -3.0]]), np.array([[1, 2, 255]], np.uint8), comment="edvo")
    header, body = data.split(b"end_header\n")
    assert header.decode().splitlines() == [
        "ply",
        "format binary_little_endian 1.0",
        "comment edvo",
        "element vertex 1",
        "property float x",
        "property float y",
        "property float z",
        "property uchar red",
        "property uchar green",
        "property uchar blue",
    ]
    assert np.frombuffer(body[:12], "<f4").tolist() == [1.0, 2.0, -3.0]
    assert body[12:] == bytes([1, 2, 255])
