"""Recordings of RealSense's SDK, against the SDK itself."""

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edvo import Odometry, se3
from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.realsense_camera import realsense_camera
from edvo.errors import DatasetError
from edvo.synthesis.sequence import SyntheticSource, make_recipe, write_sequence

pytest.importorskip("rosbags", reason="pip install 'edvo[ros]'")

from .realsense_files import Device, intrinsics, load_sdk, write_new, write_old, write_plain

CAMERA = Camera(160, 120, 150.0, 151.0, 79.0, 60.5)
INVERSE = (0.09, -0.05, 0.001, 0.002, 0.01)
# Turned and moved as no camera is, so that a wrong direction of either shows; not along z, since
# the SDK aligns depth without taking into account that it changes.
OFFSET = se3.exp(np.array([0.05, 0.01, 0.0, 0.0, 0.0, 0.1]))


@pytest.fixture(scope="module")
def source() -> SyntheticSource:
    recipe = make_recipe("texture_near", frames=6, camera=CAMERA, sensor="ideal", speed=0.3)
    return SyntheticSource(recipe)


def images(source: SyntheticSource, units: float) -> list[tuple[float, Any, Any]]:
    found = []
    for index in range(len(source)):
        frame = source.read(index).frame
        assert frame is not None
        colour = np.repeat(frame.grey[:, :, None], 3, axis=2)
        colour[:, :, 0] //= 2  # red, so that the order of the channels matters
        depth = np.round(frame.depth / units).astype(np.uint16)
        found.append((1_700_000_000 + frame.timestamp, colour, depth))
    return found


def write(kind: str, path: Path, device: Device, shown: Any) -> Path:
    if kind == "bag":
        return write_old(path.with_suffix(".bag"), device, shown)
    load_sdk()
    written = write_new(path.with_suffix(".db3"), device, shown)
    gc.collect()  # the SDK closes the file when nothing holds it any more
    with written.open("rb") as stream:
        is_old = stream.read(7) == b"#ROSBAG"  # of version 2.57 and before, whatever the name
    return written.rename(written.with_suffix(".bag")) if is_old else written


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_tracked_as_the_folder_it_was_made_from(
    source: SyntheticSource, tmp_path: Path, kind: str
) -> None:
    twin = open_source(write_sequence(source, tmp_path / "twin", command="a test"))
    shown = []
    for index in range(len(twin)):
        frame = twin.read(index).frame
        assert frame is not None
        depth = np.round(5000 * frame.depth).astype(np.uint16)
        colour = np.repeat(frame.grey[:, :, None], 3, axis=2)
        shown.append((frame.timestamp, colour, depth))
    path = write(kind, tmp_path / "recorded", Device(CAMERA, CAMERA, units=0.0002), shown)
    found = open_source(path)
    assert found.format == "realsense"
    assert found.camera.depth_scale == pytest.approx(5000.0)
    assert len(found) == len(twin)
    np.testing.assert_allclose(found.timestamps, twin.timestamps, atol=1e-6)
    paths = []
    for each in (found, twin):
        odometry = Odometry(each.camera)
        for index in range(len(each)):
            frame = each.read(index).frame
            assert frame is not None
            odometry.track(frame)
        paths.append(odometry.trajectory.poses)
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-6)


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_says_what_the_sdk_says(source: SyntheticSource, tmp_path: Path, kind: str) -> None:
    """The SDK plays the file, and aligns depth to colour; so do we."""
    rs = load_sdk()
    depth_camera = Camera(160, 120, 140.0, 141.0, 80.0, 59.0)
    device = Device(CAMERA, depth_camera, OFFSET, units=0.0005, coefficients=INVERSE)
    path = write(kind, tmp_path / "recorded", device, images(source, device.units))
    found = open_source(path)

    pipeline, config = rs.pipeline(), rs.config()
    config.enable_device_from_file(str(path), False)
    profile = pipeline.start(config)
    profile.get_device().as_playback().set_real_time(False)
    colour = profile.get_stream(rs.stream.color).as_video_stream_profile()
    told = colour.get_intrinsics()
    assert (found.camera.fx, found.camera.cy) == pytest.approx((told.fx, told.ppy))
    # A ray of the SDK, seen by our camera, is at the pixel the SDK took it from.
    pixels = np.array([[3.0, 4.0], [80.0, 60.0], [155.0, 10.0], [150.0, 118.0]])
    rays = [rs.rs2_deproject_pixel_to_point(told, pixel.tolist(), 2.0) for pixel in pixels]
    np.testing.assert_allclose(found.camera.project(np.array(rays)), pixels, atol=0.2)
    aligned, greys = {}, {}
    align = rs.align(rs.stream.color)
    while True:
        good, both = pipeline.try_wait_for_frames(2000)
        if not good:
            break
        depth, image = both.get_depth_frame(), both.get_color_frame()
        if depth and image and depth.get_timestamp() == image.get_timestamp():
            time = round(image.get_timestamp())
            aligned[time] = np.array(align.process(both).get_depth_frame().get_data()) * 0.0005
            greys[time] = np.array(image.get_data())
    pipeline.stop()
    assert len(aligned) >= 3
    for index in range(len(found)):
        frame = found.read(index).frame
        assert frame is not None
        theirs = aligned.get(round(1000 * frame.timestamp))
        if theirs is None:
            continue
        red, green, blue = np.moveaxis(greys[round(1000 * frame.timestamp)].astype(float), 2, 0)
        grey = 0.299 * red + 0.587 * green + 0.114 * blue
        assert np.abs(grey - frame.grey).max() <= 1.0
        seen = (theirs > 0) & (frame.depth > 0)
        assert seen.sum() > 0.8 * (theirs > 0).sum()
        # The SDK lets each depth pixel cover its neighbours, the nearest one wins: some mm here.
        assert np.median(np.abs(theirs - frame.depth)[seen]) < 0.007


@pytest.mark.parametrize(
    "model", ["Brown Conrady", "Modified Brown Conrady", "Inverse Brown Conrady"]
)
def test_distortion_is_the_sdks(model: str) -> None:
    rs = load_sdk()
    told = intrinsics(CAMERA, model, INVERSE)
    ours = realsense_camera(
        (160, 120),
        (150.0, 151.0),
        (79.0, 60.5),
        model=model,
        coefficients=INVERSE,
        depth_scale=1000.0,
        name="test",
    )
    pixels = np.array([[u, v] for u in (2.0, 40.0, 79.0, 157.0) for v in (1.0, 60.0, 118.0)])
    rays = np.column_stack(((pixels - (79.0, 60.5)) / (150.0, 151.0), np.ones(len(pixels))))
    expected = [rs.rs2_project_point_to_pixel(told, ray.tolist()) for ray in rays]
    np.testing.assert_allclose(ours.project(rays), expected, atol=0.3)
    if not model.startswith("Modified"):  # of which the SDK knows only the way forth
        back = [rs.rs2_deproject_pixel_to_point(told, pixel.tolist(), 1.0) for pixel in pixels]
        np.testing.assert_allclose(ours.project(np.array(back)), pixels, atol=0.3)


def test_a_fisheye_is_refused() -> None:
    with pytest.raises(DatasetError, match="Ftheta"):
        realsense_camera(
            (160, 120),
            (150.0, 150.0),
            (80.0, 60.0),
            model="Ftheta",
            coefficients=INVERSE,
            depth_scale=1000.0,
            name="test",
        )


def test_other_bags_stay_ros_bags(source: SyntheticSource, tmp_path: Path) -> None:
    from .ros_bags import camera_info, image, write_bag

    messages = []
    for time, colour, depth in images(source, 0.001):
        messages += [
            image("/camera/color/image_raw", time, colour, "rgb8"),
            image("/camera/aligned_depth_to_color/image_raw", time, depth, "16UC1"),
            camera_info("/camera/color/camera_info", time, width=160, height=120),
        ]
    for kind in ("ros1", "sqlite3"):
        assert open_source(write_bag(tmp_path / kind, kind, messages)).format == "ros"


@pytest.mark.parametrize(
    ("topic", "change", "named"),
    [
        ("Color_0/info/camera_info", None, "camera_info is missing"),
        ("Color_0/image/data", None, "no color stream"),
        ("Depth_0/image/data", None, "no depth stream"),
        ("Color_0/tf/1", None, "tf is missing"),
        ("Color_0/tf/1", b"\0" * 8, "tf/1 cannot be read"),
        ("Depth_0/info/camera_info", b"\1\2\3", "shorter"),
    ],
)
def test_what_is_missing_is_named_in_one_line(
    source: SyntheticSource, tmp_path: Path, topic: str, change: bytes | None, named: str
) -> None:
    path = write_old(
        tmp_path / "bad", Device(CAMERA, CAMERA), images(source, 0.001)[:2], **{topic: change}
    )
    with pytest.raises(DatasetError, match=named) as caught:
        open_source(path)
    assert "\n" not in str(caught.value)


def test_units_are_assumed_aloud(source: SyntheticSource, tmp_path: Path) -> None:
    path = write_old(
        tmp_path / "old",
        Device(CAMERA, CAMERA),
        images(source, 0.001)[:2],
        **{"Depth_Units/value": None},
    )
    found = open_source(path)
    assert found.camera.depth_scale == 1000.0
    assert any("depth units" in warning for warning in found.warnings)


def delays(path: Path) -> list[float]:
    found = open_source(path)
    frames = [found.read(index).frame for index in range(len(found))]
    assert len(frames) == 4
    return [frame.depth_delay for frame in frames if frame is not None]


@pytest.mark.parametrize("late", [0.004, -0.011])
def test_the_delay_of_depth_is_that_of_the_device(
    source: SyntheticSource, tmp_path: Path, late: float
) -> None:
    device, shown = Device(CAMERA, CAMERA), images(source, 0.001)[:4]
    for path in (
        write_old(tmp_path / "old", device, shown, late=late),
        write_plain(tmp_path / "new", device, shown, late=late),
    ):
        np.testing.assert_allclose(delays(path), [late] * 4, rtol=0, atol=1e-6)


@pytest.mark.parametrize("untold", [("Depth_0", "Color_0"), ("Depth_0",)])
def test_times_of_recording_tell_no_delay(
    source: SyntheticSource, tmp_path: Path, untold: tuple[str, ...]
) -> None:
    # Of one stream alone they match those of the other only if both clocks happen to.
    shown = [(1.009 + k / 30, *both) for k, (_, *both) in enumerate(images(source, 0.001)[:4])]
    path = write_plain(tmp_path / "new", Device(CAMERA, CAMERA), shown, late=0.004, untold=untold)
    assert any("times are those of recording" in told for told in open_source(path).warnings)
    assert delays(path) == [0.0] * 4
