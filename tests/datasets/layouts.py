"""A short rendered recording, and writers of it in the layout of each data set.

Each writer comes with the TUM folder of the same images: what is read and tracked must be the same.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.odometry import Odometry, Status
from edvo.trajectory import Trajectory

from .. import problems  # noqa: TID252 - tests is no package to import by name

CAMERA = Camera(160, 120, fx=131.25, fy=130.0, cx=79.5, cy=60.25, depth_scale=5000.0)
FRAMES = 8
RATE = 30.0


@dataclass(frozen=True)
class Recording:
    """Colour (BGR) and depth (metres) images of a camera, and their true poses."""

    camera: Camera
    colour: tuple[np.ndarray, ...]
    depth: tuple[np.ndarray, ...]
    poses: np.ndarray

    def values(self, index: int, scale: float, missing: int = 0) -> np.ndarray:
        """A depth image as a file holds it."""
        depth = self.depth[index]
        return np.where(depth > 0, np.round(depth * scale), missing).astype(np.uint16)


@cache
def recording(camera: Camera = CAMERA, depth_camera: Camera | None = None, T_colour_depth=None):
    """Render a walk through the room; depth by a camera of its own, if it has one."""
    colour, depth = [], []
    poses = problems.path(3 * FRAMES)[::3]
    T = np.eye(4) if T_colour_depth is None else np.array(T_colour_depth).reshape(4, 4)
    for pose in poses:
        frame = problems.render(pose, 0.0, camera)
        # Three channels that differ: grey by any other weights would show.
        grey = frame.grey.astype(np.float32)
        image = np.stack([grey * 0.8, grey, np.minimum(grey * 1.1, 255)], axis=-1)
        colour.append(image.round().astype(np.uint8))
        if depth_camera is not None:
            frame = problems.render(pose @ T, 0.0, depth_camera)
        depth.append(frame.depth)
    return Recording(camera, tuple(colour), tuple(depth), poses)


def write_image(file: Path, image: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(file), image)


def write_poses(file: Path, stamps, poses) -> None:
    Trajectory.from_poses([float(stamp) for stamp in stamps], poses, stamps).write(file)


def write_matrix(file: Path, matrix: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(file, matrix, fmt="%f")  # as ScanNet's and Microsoft's tools do


def stamp(index: int) -> str:
    return f"{index / RATE:.6f}"


def write_tum(
    folder: Path,
    of: Recording,
    *,
    scale: float = 5000.0,
    suffix: str = ".png",
    camera: Camera | None = None,
    stamps=None,
    truth: bool = True,
    late: float = 0.0,
) -> Path:
    """The twin in TUM's layout; `late` is the delay of depth, seconds."""
    stamps = stamps or [stamp(index) for index in range(FRAMES)]
    rows: dict[str, list[str]] = {"rgb": [], "depth": []}
    for index, text in enumerate(stamps):
        write_image(folder / f"rgb/{text}{suffix}", of.colour[index])
        write_image(folder / f"depth/{text}.png", of.values(index, scale))
        rows["rgb"].append(f"{text} rgb/{text}{suffix}\n")
        rows["depth"].append(f"{float(text) + late:.6f} depth/{text}.png\n")
    for kind, lines in rows.items():
        (folder / f"{kind}.txt").write_text("# timestamp filename\n" + "".join(lines))
    if truth:
        write_poses(folder / "groundtruth.txt", stamps, of.poses)
    (camera or replace(of.camera, depth_scale=scale)).to_yaml(folder / "camera.yaml")
    return folder


def track(source) -> Trajectory:
    odometry = Odometry(source.camera)
    for index in range(len(source)):
        reading = source.read(index)
        assert reading.problem is None, reading.problem
        assert odometry.track(reading.frame).status is not Status.LOST
    return odometry.trajectory


def assert_same(source, twin_folder: Path, *, stamps: bool = True, poses: float = 1e-6) -> None:
    """Frames and camera are the twin's to the last bit; times, truth and track to rounding."""
    twin = open_source(twin_folder, format="tum")
    assert replace(source.camera, name="") == replace(twin.camera, name="")
    if stamps:
        assert tuple(source.stamps) == tuple(twin.stamps)
    np.testing.assert_allclose(source.timestamps, twin.timestamps, atol=1e-6)
    for index in range(len(twin)):
        ours, theirs = source.read(index), twin.read(index)
        assert ours.problem is None, ours.problem
        assert ours.stamp == source.stamps[index]
        np.testing.assert_array_equal(ours.frame.grey, theirs.frame.grey)
        np.testing.assert_array_equal(ours.frame.depth, theirs.frame.depth)
        np.testing.assert_allclose(ours.frame.depth_delay, theirs.frame.depth_delay, atol=1e-6)
    # Times of seven digits or of nine: the tracker foresees its motion by them.
    np.testing.assert_allclose(track(source).poses, track(twin).poses, atol=2e-5)
    if twin.ground_truth is not None:
        assert len(source.ground_truth) == len(twin.ground_truth)
        np.testing.assert_allclose(source.ground_truth.poses, twin.ground_truth.poses, atol=poses)
        np.testing.assert_allclose(
            source.ground_truth.timestamps, twin.ground_truth.timestamps, atol=1e-6
        )
        assert_near(track(source), source.ground_truth)


def assert_near(found: Trajectory, truth: Trajectory, *, metres: float = 0.03) -> None:
    """A track is the truth, seen from the first frame: wrong axes or units would be far off."""
    start = np.linalg.inv(truth.at(found.timestamps[0]))
    length = 0.0
    for time, pose in zip(found.timestamps, found.poses, strict=True):
        true = start @ truth.poses[truth.nearest(time)]
        length = max(length, float(np.linalg.norm(true[:3, 3])))
        distance, angle = problems.error(true, pose)
        assert distance < metres
        assert angle < 1.0
    assert length > 2 * metres  # it did move
