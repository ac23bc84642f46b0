"""Azure Kinect recordings."""

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edvo import Odometry, se3
from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.errors import DatasetError
from edvo.frame import register_depth

from . import azure_files
from .azure_files import calibration, write_azure
from .layouts import FRAMES, RATE, recording, track, write_tum


def wall(index: int, size: tuple[int, int] = (1280, 720)) -> Any:
    """Cards on a wall that goes past."""
    rng = np.random.default_rng(7)
    image = np.full((size[1], size[0] + 200, 3), 110, np.uint8)
    for u, v, w, h, grey in rng.integers((0, 0, 20, 20, 20), (1400, 700, 150, 120, 235), (150, 5)):
        image[v : v + h, u : u + w] = grey
    left = 8 * index
    return cv2.GaussianBlur(image[:, left : left + size[0]], (5, 5), 0)


def frames(count: int = 4, depth_size: tuple[int, int] = (640, 576)) -> Any:
    depth = np.full(depth_size[::-1], 1800, np.uint16)
    depth[:, : depth_size[0] // 8] = 0
    return [(2.0 + index / 30, wall(index), depth) for index in range(count)]


def lens_of_colour() -> tuple[Any, Any]:
    """Give matrix and distortion of colour at 1280x720, as OpenCV has them."""
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = azure_files.COLOUR
    matrix = np.array([[fx * 1280, 0, cx * 1280 - 0.5], [0, fy * 960, cy * 960 - 120.5], [0, 0, 1]])
    return matrix, np.array([k1, k2, p1, p2, k3, k4, k5, k6])


def test_distortion_is_taken_out(tmp_path: Path) -> None:
    """A point of the scene is where the frames' camera sees it, though the lens bent it."""
    points = np.array([[x, y, 2.0] for x in (-1.5, -0.4, 0.5, 1.4) for y in (-0.7, 0.1, 0.75)])
    matrix, lens = lens_of_colour()
    bent = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens)[0][:, 0]
    image = np.zeros((720, 1280, 3), np.uint8)
    v, u = np.mgrid[:720, :1280]
    for at in bent:
        spot = 255 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 6.0**2))
        image = np.maximum(image, spot[:, :, None].astype(np.uint8))
    shown = [(1.0, image, np.full((576, 640), 2000, np.uint16))]
    source = open_source(write_azure(tmp_path / "a.mkv", shown, colour="BGRA"))
    assert source.format == "azure"
    assert (source.camera.width, source.camera.height) == (640, 360)  # as fine as depth
    assert not source.camera.is_distorted
    frame = source.read(0).frame
    assert frame is not None
    for straight in source.camera.project(points):
        left, top = np.rint(straight).astype(int) - 8
        patch = frame.grey[top : top + 17, left : left + 17].astype(float)
        y, x = np.mgrid[:17, :17]
        found = np.array([(patch * x).sum(), (patch * y).sum()]) / patch.sum() + (left, top)
        np.testing.assert_allclose(found, straight, atol=0.3)
    assert np.abs(bent / 2 - source.camera.project(points)).max() > 3  # it was not straight before


@pytest.mark.parametrize("kind", ["MJPG", "NV12", "YUY2", "BGRA"])
def test_frames_are_what_was_recorded(tmp_path: Path, kind: str) -> None:
    shown = frames(2)
    source = open_source(write_azure(tmp_path / "a.mkv", shown, colour=kind))
    assert source.stamps == ("2.000000000", "2.033333000")
    for index, (_, image, _) in enumerate(shown):
        frame = source.read(index).frame
        assert frame is not None
        straight = cv2.undistort(image, *lens_of_colour())
        small = cv2.resize(straight, (640, 360), interpolation=cv2.INTER_AREA)
        off = np.abs(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(int) - frame.grey)
        assert off[60:-60, 100:-100].max() <= 12
        # The wall is in the depth camera's axes; colour is turned by 6 degrees.
        seen = frame.depth[frame.depth > 0]
        assert seen.size > 0.35 * frame.depth.size
        rows = frame.depth[:, 320][frame.depth[:, 320] > 0]
        assert rows.max() - rows.min() > 0.1
        assert np.median(seen) == pytest.approx(1.8, abs=0.05)


def test_depth_is_carried_by_the_devices_motion(tmp_path: Path) -> None:
    shown = frames(1)
    source = open_source(write_azure(tmp_path / "a.mkv", shown))
    T = np.eye(4)
    T[:3, :3] = np.array(azure_files.ROTATION).reshape(3, 3)
    T[:3, 3] = azure_files.TRANSLATION
    # A point of the depth camera's middle lies where both cameras say.
    point = np.array([[0.1, -0.1, 1.8]])
    moved = point @ T[:3, :3].T + T[:3, 3]
    u, v = np.rint(source.camera.project(moved)[0]).astype(int)
    frame = source.read(0).frame
    assert frame is not None
    assert frame.depth[v, u] == pytest.approx(moved[0, 2], abs=0.01)


def test_is_tracked(tmp_path: Path) -> None:
    source = open_source(write_azure(tmp_path / "a.mkv", frames(4), unknown=True))
    odometry = Odometry(source.camera)
    for index in range(len(source)):
        frame = source.read(index).frame
        assert frame is not None
        tracked = odometry.track(frame)
    assert len(odometry.trajectory) == 4
    assert np.isfinite(tracked.T_world_cam).all()
    # The images went 8 pixels a frame to the left.
    assert tracked.T_world_cam[0, 3] > 0.02


def test_is_tracked_as_its_twin(tmp_path: Path) -> None:
    """The same walk, recorded by the device and rendered as the frames' camera sees it."""
    told = calibration()
    for camera in told["CalibrationInformation"]["Cameras"]:
        camera["Intrinsics"]["ModelParameters"][4:] = [0.0] * 10  # as the renderer's lenses
    colour, (dx, dy, dfx, dfy) = lens_of_colour()[0], azure_files.DEPTH[:4]
    seen = Camera(1280, 720, colour[0, 0], colour[1, 1], colour[0, 2], colour[1, 2])
    depth = Camera(640, 576, dfx * 1024, dfy * 1024, dx * 1024 - 192.5, dy * 1024 - 180.5)
    T_colour_depth = np.eye(4)
    T_colour_depth[:3, :3] = np.array(azure_files.ROTATION).reshape(3, 3)
    T_colour_depth[:3, 3] = azure_files.TRANSLATION
    recorded = recording(seen, depth, tuple(T_colour_depth.ravel().tolist()))
    shown = [
        (index / RATE, recorded.colour[index], recorded.values(index, 1000))
        for index in range(FRAMES)
    ]
    source = open_source(write_azure(tmp_path / "a.mkv", shown, told=told))
    plain = replace(source.camera, name="")
    twin = open_source(write_tum(tmp_path / "twin", recording(plain), scale=1000.0))
    assert replace(twin.camera, name="") == plain
    ours, theirs = track(source), track(twin)
    np.testing.assert_allclose(ours.timestamps, theirs.timestamps, atol=1e-6)
    # As far as images made smaller are others than those rendered small.
    np.testing.assert_allclose(ours.poses, theirs.poses, atol=0.0015)
    assert np.linalg.norm(theirs.poses[-1, :3, 3]) > 0.05


@pytest.mark.parametrize("size", [(320, 288), (512, 512), (1024, 1024)])
def test_other_modes(tmp_path: Path, size: tuple[int, int]) -> None:
    source = open_source(write_azure(tmp_path / "a.mkv", frames(1, size)))
    frame = source.read(0).frame
    assert frame is not None
    assert source.camera.width == size[0]
    assert np.median(frame.depth[frame.depth > 0]) == pytest.approx(1.8, abs=0.05)


def test_a_cut_file_gives_what_it_has(tmp_path: Path) -> None:
    path = write_azure(tmp_path / "a.mkv", frames(4))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole))])
    source = open_source(path)
    assert 1 <= len(source) < 4
    assert any("cut short" in warning for warning in source.warnings)
    assert source.read(0).frame is not None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"names": ("COLOR", "IR2")}, "ffmpeg"),
        ({"names": ("video", "DEPTH")}, "these are DEPTH, IR, VIDEO"),
        ({"told": {}}, "calibration.json cannot be read"),
        ({"told": calibration(Rt={"Rotation": [1.0] * 9, "Translation": [0, 0, 0]})}, "rigid"),
        (
            {"told": calibration(Intrinsics={"ModelType": "Theta", "ModelParameters": []})},
            "distortion Theta",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(
    tmp_path: Path, change: dict[str, Any], named: str
) -> None:
    path = write_azure(tmp_path / "a.mkv", frames(1), **change)
    with pytest.raises(DatasetError, match=named) as caught:
        open_source(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.1])
def test_a_stub_is_refused(tmp_path: Path, share: float) -> None:
    path = write_azure(tmp_path / "a.mkv", frames(1))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(DatasetError, match=r"a\.mkv"):
        open_source(path)


def test_garbage_never_raises_anything_else(tmp_path: Path) -> None:
    whole = bytearray(write_azure(tmp_path / "a.mkv", frames(1)).read_bytes())
    rng = np.random.default_rng(0)
    for _ in range(60):
        spoilt = bytearray(whole)
        for at in rng.integers(0, 6000, 4):
            spoilt[at] = rng.integers(0, 256)
        (tmp_path / "b.mkv").write_bytes(spoilt)
        with suppress(DatasetError):
            open_source(tmp_path / "b.mkv").read(0)


def test_pyav_reads_the_same(tmp_path: Path) -> None:
    """The sample is Matroska to others too, with the tracks that ours has."""
    av = pytest.importorskip("av", reason="pip install av, to hold the sample against FFmpeg")
    shown = frames(3)
    path = write_azure(tmp_path / "a.mkv", shown)
    with av.open(str(path)) as container:
        videos = container.streams.video
        assert [stream.codec_context.name for stream in videos] == ["mjpeg", "rawvideo", "rawvideo"]
        assert videos[1].codec_context.pix_fmt == "gray16be"
        found = [frame.to_ndarray() for frame in container.decode(videos[1])]
    assert len(found) == 3
    np.testing.assert_array_equal(found[0].astype(np.uint16), shown[0][2])


def test_register_depth_agrees(tmp_path: Path) -> None:
    """Whole, at the size of depth, by the numbers of the file alone."""
    source = open_source(write_azure(tmp_path / "a.mkv", frames(1)))
    told = json.loads(json.dumps(calibration()))["CalibrationInformation"]["Cameras"][0]
    cx, cy, fx, fy = told["Intrinsics"]["ModelParameters"][:4]
    plain = Camera(640, 576, fx * 1024, fy * 1024, cx * 1024 - 192.5, cy * 1024 - 180.5)
    T = np.eye(4)
    T[:3, :3] = np.array(azure_files.ROTATION).reshape(3, 3)
    T[:3, 3] = azure_files.TRANSLATION
    depth = np.full((576, 640), 1.8, np.float32)
    expected = register_depth(depth, plain, source.camera, T)
    frame = source.read(0).frame
    assert frame is not None
    middle = slice(150, 210), slice(300, 340)
    np.testing.assert_allclose(frame.depth[middle], expected[middle], atol=0.01)
    assert se3.rotation_angle(T) > 0.1


def test_the_delay_of_depth_is_that_of_the_blocks(tmp_path: Path) -> None:
    source = open_source(write_azure(tmp_path / "a.mkv", frames(2)))
    for index in range(2):
        frame = source.read(index).frame
        assert frame is not None
        assert frame.depth_delay == pytest.approx(150e-6, abs=1e-12)
    source = open_source(write_azure(tmp_path / "b.mkv", frames(2), late=-12_000))
    frame = source.read(1).frame
    assert frame is not None
    assert frame.depth_delay == pytest.approx(-0.012, abs=1e-12)
