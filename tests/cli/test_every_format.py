"""`edvo run` on a sample of each format, without any flag, against its twin in TUM's layout."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets import open_source, registry
from edvo.datasets.known_cameras import KNOWN_CAMERAS
from edvo.datasets.sevenscenes import _T_COLOUR_DEPTH, COLOUR_CAMERA, DEPTH_CAMERA
from edvo.datasets.tum import read_lists
from edvo.trajectory import Trajectory

from ..datasets.layouts import CAMERA, FRAMES, RATE, Recording, recording, write_tum  # noqa: TID252
from ..datasets.ros_bags import (  # noqa: TID252 - as in datasets/
    camera_info,
    compressed,
    image,
    write_bag,
)
from ..datasets.test_folders import write_generic, write_open3d, write_replica  # noqa: TID252
from ..datasets.test_tum_kin import write_eth3d, write_icl, write_povray  # noqa: TID252
from ..datasets.test_two_cameras import write_7scenes, write_scannet, write_sens  # noqa: TID252
from .conftest import Command

ICL, FR3, BONN = (KNOWN_CAMERAS[name] for name in ("icl-nuim", "tum-fr3", "bonn"))
SMALL_KINECT = DEPTH_CAMERA.scaled(0.25)


@dataclass(frozen=True)
class Sample:
    """How a recording is written in a layout, and what it must be read as.

    Attributes
    ----------
    format : str
        That it is recognised as.
    write : callable
        Writes it below a folder; returns the path to give.
    camera : Camera
        Of its images, and that must be found out, with the depth scale.
    suffix : str
        Of the twin's colour images.
    start, step : float
        Seconds, of the stamps.
    metres : float
        How far the track may be from the twin's: more than rounding only where the twin's images
        are rounded or registered otherwise.
    """

    format: str
    write: Callable[[Path, Recording], Path]
    camera: Camera
    suffix: str = ".png"
    start: float = 0.0
    step: float = 1 / RATE
    metres: float = 2e-6


def numbered(stamp: Callable[[int], str]) -> list[str]:
    return [stamp(index) for index in range(FRAMES)]


def without_camera(folder: Path) -> Path:
    (folder / "camera.yaml").unlink()
    return folder


def joined(folder: Path) -> Path:
    """Put both lists into one, as ICL-NUIM, ETH3D and ORB-SLAM have them."""
    rows = [(folder / f"{kind}.txt").read_text().splitlines()[1:] for kind in ("rgb", "depth")]
    (folder / "associations.txt").write_text("".join(f"{a} {b}\n" for a, b in zip(*rows, strict=1)))
    for kind in ("rgb", "depth"):
        (folder / f"{kind}.txt").unlink()
    return folder


def lists(folder: Path) -> Path:
    (folder / "rgb.txt").rename(folder / "color.txt")
    return folder


def bag(kind: str, *, packed: bool = False, metres: bool = False, compression: str | None = None):
    """Write a bag of a kind: raw or compressed images, depth in millimetres or metres."""

    def write(folder: Path, of: Recording) -> Path:
        c = of.camera
        size = {"width": c.width, "height": c.height, "k": (c.fx, c.fy, c.cx, c.cy)}
        messages = [camera_info("/camera/color/camera_info", 100.0, **size)]
        colour, depth = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
        for index in range(FRAMES):
            time = 100 + index / 20
            values: NDArray[np.generic] = of.values(index, 1000.0)
            if packed:
                messages += [
                    compressed(f"{colour}/compressed", time, of.colour[index], "bgr8; png"),
                    compressed(f"{depth}/compressed", time, values, "16UC1; png"),
                ]
            else:
                shown = values.astype(np.float32) / np.float32(1000) if metres else values
                messages += [
                    image(colour, time, of.colour[index], "bgr8"),
                    image(depth, time, shown, "32FC1" if metres else "16UC1"),
                ]
        folder.mkdir()
        return write_bag(folder / "recording", kind, messages, compression=compression)

    return write


def in_millimetres(camera: Camera) -> Camera:
    return replace(camera, depth_scale=1000.0)


SAMPLES = {
    "tum": Sample(
        "tum",
        lambda to, of: without_camera(write_tum(to / "rgbd_dataset_freiburg3_room", of)),
        FR3,
    ),
    "tum, one list, JPEG": Sample(
        "tum", lambda to, of: joined(write_tum(to / "mine", of, suffix=".jpg")), CAMERA, ".jpg"
    ),
    "icl": Sample("icl", lambda to, of: write_icl(to / "living_room_traj2_frei_png", of), ICL),
    "icl as rendered, living room": Sample(
        "povray",
        lambda to, of: write_povray(to / "living_room_traj0_loop", of),
        replace(ICL, depth_scale=1.0),
        metres=2e-4,
    ),
    "icl as rendered, office": Sample(
        "povray",
        lambda to, of: write_povray(to / "office", of, names="scene_{:03d}", unit=100.0),
        replace(ICL, depth_scale=100.0),
        metres=2e-4,
    ),
    "bonn": Sample(
        "bonn", lambda to, of: without_camera(write_tum(to / "rgbd_bonn_crowd", of)), BONN
    ),
    "eth3d": Sample("eth3d", lambda to, of: write_eth3d(to / "plant_1", of), CAMERA),
    "7scenes": Sample(
        "7scenes",
        lambda to, of: write_7scenes(to / "chess/seq-01", of, of.poses @ _T_COLOUR_DEPTH),
        COLOUR_CAMERA,
        metres=0.006,
    ),
    "7scenes, registered already": Sample(
        "7scenes", lambda to, of: write_7scenes(to / "chess/seq-01", of, of.poses), SMALL_KINECT
    ),
    "scannet": Sample(
        "scannet",
        lambda to, of: write_scannet(to / "scene0000_00/frames", of, CAMERA).parent,
        in_millimetres(CAMERA),
        ".jpg",
    ),
    "sens": Sample(
        "sens",
        lambda to, of: write_sens(to / "scene0000_00/scene0000_00.sens", of),
        in_millimetres(CAMERA),
        ".jpg",
        start=5.0,
        step=0.033333,
    ),
    "replica": Sample(
        "replica",
        lambda to, of: write_replica(to / "Replica/office0", of),
        replace(CAMERA, depth_scale=6553.5),
        ".jpg",
    ),
    "open3d": Sample(
        "open3d",
        lambda to, of: write_open3d(to / "lounge", of),
        in_millimetres(CAMERA),
        ".jpg",
    ),
    "folder, matching numbers": Sample(
        "folder", lambda to, of: write_generic(to / "mine", of), in_millimetres(CAMERA)
    ),
    "folder, names that are times": Sample(
        "folder",
        lambda to, of: write_generic(
            to / "mine", of, "color", numbered(lambda i: f"{1_403_636_579_000 + 40 * i}000000")
        ),
        in_millimetres(CAMERA),
        start=1_403_636_579.0,
        step=0.04,
    ),
    "folder, lists": Sample(
        "folder",
        lambda to, of: lists(write_tum(to / "mine", of, scale=1000)),
        in_millimetres(CAMERA),
    ),
    **{
        f"ros, {kind}, {name}": Sample(
            "ros",
            bag(kind, **options),  # type: ignore[arg-type]
            replace(CAMERA, depth_scale=1.0 if name == "metres" else 1000.0),
            start=100.0,
            step=0.05,
        )
        for kind, name, options in (
            ("ros1", "raw", {}),
            ("ros1", "PNG", {"packed": True}),
            ("ros1", "lz4", {"compression": "lz4"}),
            ("sqlite3", "raw", {}),
            ("sqlite3", "PNG", {"packed": True}),
            ("mcap", "raw", {}),
            ("mcap", "PNG", {"packed": True}),
            ("mcap", "metres", {"metres": True}),
            ("mcap", "zstd", {"compression": "storage"}),
        )
    },
}


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_is_tracked_as_its_twin(edvo: Command, tmp_path: Path, name: str) -> None:
    sample = SAMPLES[name]
    seen = replace(sample.camera, distortion=(0.0,) * 5)
    if name == "7scenes":
        T = tuple(_T_COLOUR_DEPTH.ravel().tolist())
        of = recording(COLOUR_CAMERA, DEPTH_CAMERA, T)
    else:
        of = recording(replace(seen, name="", depth_scale=5000.0))
    given = sample.write(tmp_path / "sample", of)
    scale = sample.camera.depth_scale
    if sample.format == "povray":
        scale = 5000.0  # images of distances; whole numbers of 0.2 mm in the twin
    twin = write_tum(
        tmp_path / "twin",
        recording(COLOUR_CAMERA) if name == "7scenes" else of,
        scale=1000.0 if scale == 1.0 else scale,
        suffix=sample.suffix,
        camera=replace(sample.camera, depth_scale=1000.0 if scale == 1.0 else scale),
        stamps=numbered(lambda index: f"{sample.start + index * sample.step:.6f}"),
        truth=False,
    )
    tracks, summaries = [], []
    for source in (given, twin):
        out = tmp_path / f"out{len(tracks)}"
        done = edvo("run", source, "-o", out)
        assert done.status == 0, done.err
        tracks.append(Trajectory.read(out / "trajectory.txt"))
        summaries.append(json.loads((out / "summary.json").read_text()))
    assert [summary["source"]["format"] for summary in summaries] == [sample.format, "tum"]
    found = {key: summaries[0]["camera"][key] for key in sample.camera.to_dict() if key != "name"}
    wanted = {key: value for key, value in sample.camera.to_dict().items() if key != "name"}
    distortion = (found.pop("distortion"), wanted.pop("distortion"))
    assert list(distortion[0]) == list(distortion[1])
    assert found == pytest.approx(wanted, rel=1e-6)
    ours, theirs = tracks
    assert len(ours) == len(theirs) == FRAMES
    times = ours.timestamps
    if sample.format == "icl":
        times = times / RATE  # its stamps are frame numbers, and stay so in text
    np.testing.assert_allclose(times, theirs.timestamps, atol=1e-6)
    np.testing.assert_allclose(ours.poses[:, :3, 3], theirs.poses[:, :3, 3], atol=sample.metres)
    np.testing.assert_allclose(ours.poses[:, :3, :3], theirs.poses[:, :3, :3], atol=sample.metres)


def test_no_format_is_left_out() -> None:
    known = {each.name for each in registry.BUILT_IN}
    # Written and read by packages of their own, for which their tests ask.
    elsewhere = {"realsense", "azure"}
    assert {sample.format for sample in SAMPLES.values()} == known - elsewhere


def bag_of_real(folder: Path, to: Path, kind: str, frames: int, *, packed: bool) -> Path:
    """Write the images of a real folder into a bag, as they are."""
    camera = open_source(folder).camera
    messages = [
        camera_info(
            "/camera/rgb/camera_info",
            1.0,
            width=camera.width,
            height=camera.height,
            k=(camera.fx, camera.fy, camera.cx, camera.cy),
            d=camera.distortion,
        )
    ]
    for pair in read_lists(folder).pairs[:frames]:
        colour = cv2.imread(str(pair.colour), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(pair.depth), cv2.IMREAD_UNCHANGED)
        assert colour is not None
        assert depth is not None
        topics = "/camera/rgb/image_raw", "/camera/depth_registered/image_raw"
        time, depth_time = pair.time, pair.time + pair.depth_delay
        if packed:
            messages += [
                compressed(f"{topics[0]}/compressed", time, colour, "bgr8; png"),
                compressed(f"{topics[1]}/compressed", depth_time, depth, "16UC1; png"),
            ]
        else:
            metres = depth.astype(np.float32) / np.float32(camera.depth_scale)
            messages += [
                image(topics[0], time, colour, "bgr8"),
                image(topics[1], depth_time, metres, "32FC1"),
            ]
    return write_bag(to, kind, messages)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
@pytest.mark.parametrize("packed", [False, True], ids=["raw", "PNG"])
def test_a_bag_made_of_real_images_gives_the_folder_s_trajectory(
    edvo: Command, real_data: Path, tmp_path: Path, kind: str, packed: bool
) -> None:
    folder, frames = real_data / "tum_fr1_xyz", 12
    recorded = bag_of_real(folder, tmp_path / "bag", kind, frames, packed=packed)
    camera: tuple[object, ...] = ()
    if packed:  # values of 5000 a metre, which no bag can say
        camera = ("--camera", folder / "camera.yaml")
    for source, out, more in ((recorded, "a", camera), (folder, "b", ())):
        done = edvo("run", source, "-o", tmp_path / out, "--max-frames", frames, *more)
        assert done.status == 0, done.err
    ours, theirs = (Trajectory.read(tmp_path / out / "trajectory.txt") for out in "ab")
    np.testing.assert_array_equal(ours.timestamps, theirs.timestamps)
    np.testing.assert_allclose(ours.poses, theirs.poses, atol=1e-9)
