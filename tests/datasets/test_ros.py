"""Bags of each kind, written by rosbags, give the images that were put into them."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.known_cameras import KNOWN_CAMERAS
from edvo.datasets.ros import RosFormat, open_bag
from edvo.errors import DatasetError
from edvo.frame import Frame

from .conftest import CAMERA, colour_image, depth_image
from .layouts import FRAMES, RATE, assert_same, recording, write_tum
from .ros_bags import (
    KINDS,
    Message,
    camera_info,
    compressed,
    depth_header,
    image,
    write_bag,
)

COLOUR, DEPTH, INFO = (
    "/camera/color/image_raw",
    "/camera/depth_registered",
    "/camera/color/camera_info",
)
STAMPS = (1305031102.175304, 1305031102.211214, 1305031102.243211)


def colours(stamps=STAMPS, topic=COLOUR, **more):
    return [image(topic, s, colour_image(i), "bgr8", **more) for i, s in enumerate(stamps)]


def depths(stamps=STAMPS, topic=DEPTH, late=0.005, **more):
    return [image(topic, s + late, depth_image(i), "16UC1", **more) for i, s in enumerate(stamps)]


def whole(**info):
    return [*colours(), *depths(), camera_info(INFO, STAMPS[0], **info)]


def expected(index, depth_scale=1000.0):
    return Frame.from_images(0.0, colour_image(index), depth_image(index), depth_scale=depth_scale)


def assert_frames(source, count=3, depth_scale=1000.0):
    assert len(source) == count
    for index in range(count):
        reading = source.read(index)
        assert reading.problem is None
        assert (reading.frame.grey == expected(index).grey).all()
        assert (reading.frame.depth == expected(index, depth_scale).depth).all()


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        ("ros1", None),
        ("ros1", "bz2"),
        ("ros1", "lz4"),
        ("sqlite3", None),
        ("sqlite3", "message"),
        ("sqlite3", "file"),
        ("mcap", None),
        ("mcap", "storage"),
        ("mcap", "message"),
        ("mcap", "file"),
    ],
)
def test_every_kind_of_bag(tmp_path, kind, compression):
    path = write_bag(tmp_path / "recording", kind, whole(), compression=compression)
    source = open_source(path)
    assert source.format == "ros"
    assert source.stamps == tuple(f"{stamp:.6f}000" for stamp in STAMPS)
    np.testing.assert_array_equal(source.timestamps, STAMPS)
    assert source.warnings == ()
    assert source.camera == Camera(64, 48, 50.0, 51.0, 31.5, 23.5, depth_scale=1000.0)
    assert source.camera_origin == INFO
    assert_frames(source)
    described = source.describe()
    assert described["colour_topic"] == f"{COLOUR} (bgr8)"
    assert described["depth_topic"] == f"{DEPTH} (16UC1)"
    assert described["bag"] == {"ros1": "ROS 1"}.get(kind, f"ROS 2 {kind}")


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_tracked_as_its_tum_twin(tmp_path, kind):
    of = recording()
    camera = of.camera
    size = {"width": camera.width, "height": camera.height}
    k = (camera.fx, camera.fy, camera.cx, camera.cy)
    messages = [camera_info(INFO, 0.0, k=k, **size)]
    for index in range(FRAMES):
        time = index / RATE
        messages.append(image(COLOUR, time, of.colour[index], "bgr8"))
        messages.append(image(DEPTH, time, of.values(index, 1000.0), "16UC1"))
    twin = write_tum(tmp_path / "twin", of, scale=1000.0, truth=False)
    source = open_source(write_bag(tmp_path / "bag", kind, messages))
    assert_same(source, twin, stamps=False)


@pytest.mark.parametrize(("kind", "end"), [("sqlite3", ".db3"), ("mcap", ".mcap")])
def test_one_file_of_a_ros_2_bag_and_a_folder_without_metadata(tmp_path, kind, end):
    folder = write_bag(tmp_path / "recording", kind, whole())
    (file,) = folder.glob(f"*{end}")
    assert_frames(open_source(file))
    (folder / "metadata.yaml").unlink()
    assert RosFormat().recognise(folder) == file.name
    assert_frames(open_source(folder))


def test_a_split_bag_is_one_recording(tmp_path):
    folder = tmp_path / "both"
    folder.mkdir()
    for part in (0, 1, 2):
        one = [colours()[part], depths()[part], camera_info(INFO, STAMPS[part])]
        written = write_bag(tmp_path / f"part{part}", "mcap", one)
        (written / f"part{part}.mcap").rename(folder / f"recording_{part}.mcap")
    assert_frames(open_source(folder))


def test_threads_read_the_same_as_one(tmp_path):
    stamps = np.arange(40) / 30.0 + 100.0
    messages = [*colours(stamps), *depths(stamps), camera_info(INFO, 100.0)]
    for kind, compression in (("ros1", "lz4"), ("mcap", "storage"), ("sqlite3", None)):
        source = open_bag(write_bag(tmp_path / kind, kind, messages, compression=compression))
        order = np.random.default_rng(0).permutation(np.tile(np.arange(40), 3))
        with ThreadPoolExecutor(4) as pool:
            for index, reading in zip(order, pool.map(source.read, order.tolist()), strict=True):
                assert (reading.frame.grey == expected(index).grey).all()
                assert (reading.frame.depth == expected(index).depth).all()


def test_an_unchunked_mcap_is_read(tmp_path):
    """As the recorder writes it in its fastwrite preset: messages outside of chunks."""
    folder = write_bag(tmp_path / "recording", "mcap", whole())
    (file,) = folder.glob("*.mcap")
    data = file.read_bytes()
    begin = b"\x89MCAP0\r\n"
    out, at = bytearray(begin), len(begin)
    while data[at] != 0x0F:  # the end of the data section
        size = int.from_bytes(data[at + 1 : at + 9], "little")
        record = data[at : at + 9 + size]
        if data[at] == 0x06:  # a chunk: its content instead; 8 8 8 4, a text, 8
            length = int.from_bytes(record[37:41], "little")
            assert length == 0, "not compressed"
            out += record[49:]
        elif data[at] != 0x07:  # the index of a chunk
            out += record
        at += 9 + size
    out += b"\x0f" + (4).to_bytes(8, "little") + bytes(4)
    out += b"\x02" + (20).to_bytes(8, "little") + bytes(20) + begin
    plain = tmp_path / "plain.mcap"
    plain.write_bytes(out)
    assert_frames(open_source(plain))


ENCODINGS = {
    "mono8": lambda bgr: cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY),
    "8UC1": lambda bgr: cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY),
    "bgr8": lambda bgr: bgr,
    "8UC3": lambda bgr: bgr,
    "rgb8": lambda bgr: bgr[:, :, ::-1].copy(),
    "bgra8": lambda bgr: cv2.cvtColor(bgr, cv2.COLOR_BGR2BGRA),
    "rgba8": lambda bgr: cv2.cvtColor(bgr, cv2.COLOR_BGR2RGBA),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("padding", [0, 5])
def test_encodings_of_colour(tmp_path, kind, padding):
    for encoding, make in ENCODINGS.items():
        array = make(colour_image(0))
        step = array[0].size + padding
        messages = [
            image(COLOUR, 1.0, array, encoding, step=step),
            *depths([1.0]),
            camera_info(INFO, 1.0),
        ]
        source = open_bag(write_bag(tmp_path / f"{encoding}{padding}", kind, messages))
        assert_frames(source, 1)


def test_bayer_and_yuv_give_the_grey_of_the_scene(tmp_path):
    """A grey scene has the same values in each Bayer pixel and in Y; a red one tells the order."""
    rows, columns = np.mgrid[:48, :64]
    red = np.zeros((48, 64, 3), np.uint8)
    red[:, :, 2] = 200
    grey = cv2.cvtColor(red, cv2.COLOR_BGR2GRAY)[0, 0]
    for pattern in ("rggb", "bggr", "gbrg", "grbg"):
        at = np.array(list(pattern)).reshape(2, 2)[rows % 2, columns % 2]
        mosaic = np.where(at == "r", 200, 0).astype(np.uint8)
        read = _one(tmp_path, image(COLOUR, 1.0, mosaic, f"bayer_{pattern}8"))
        assert np.abs(read.grey[4:-4, 4:-4].astype(int) - grey).max() <= 2
    luma = colour_image(1, channels=1)
    for encoding, order in (("yuv422", (1, 0)), ("yuv422_yuy2", (0, 1)), ("yuyv", (0, 1))):
        pixels = np.full((48, 64, 2), 128, np.uint8)
        pixels[:, :, order.index(0)] = luma
        assert (_one(tmp_path, image(COLOUR, 1.0, pixels, encoding)).grey == luma).all()


def _one(tmp_path, colour, depth=None):
    name = f"bag{len(list(tmp_path.iterdir()))}"
    depth = depths([1.0])[0] if depth is None else depth
    bag = write_bag(tmp_path / name, "ros1", [colour, depth, camera_info(INFO, 1.0)])
    reading = open_bag(bag).read(0)
    assert reading.problem is None
    return reading.frame


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("big_endian", [False, True])
def test_encodings_of_depth(tmp_path, kind, big_endian):
    metres = depth_image(0).astype(np.float32) / 1000
    holes = metres.copy()
    holes[:5], holes[5:10], holes[10:15] = np.nan, np.inf, -1.0
    for number, (array, encoding, step) in enumerate(
        [
            (depth_image(0), "16UC1", None),
            (depth_image(0), "mono16", 64 * 2 + 6),
            (metres, "32FC1", None),
            (holes, "32FC1", 64 * 4 + 3),
        ]
    ):
        messages = [
            *colours([1.0]),
            image(DEPTH, 1.0, array, encoding, step=step, big_endian=big_endian),
            camera_info(INFO, 1.0),
        ]
        path = write_bag(tmp_path / f"{number}{big_endian}", kind, messages)
        source = open_bag(path, colour_topic=COLOUR, depth_topic=DEPTH)
        frame = source.read(0).frame
        first = 15 if array is holes else 0
        np.testing.assert_allclose(frame.depth[first:], metres[first:], rtol=1e-6)
        assert not frame.depth[:first].any()
        assert source.camera.depth_scale == (1.0 if encoding == "32FC1" else 1000.0)


@pytest.mark.parametrize("kind", KINDS)
def test_compressed_topics(tmp_path, kind):
    colour = compressed(f"{COLOUR}/compressed", 1.0, colour_image(0), "bgr8; png compressed bgr8")
    depth = compressed(
        f"{DEPTH}/compressedDepth", 1.0, depth_image(0), "16UC1; compressedDepth png",
        header=depth_header(),
    )  # fmt: skip
    source = open_bag(write_bag(tmp_path / "a", kind, [colour, depth, camera_info(INFO, 1.0)]))
    assert source.camera_origin == INFO
    assert_frames(source, 1)


def test_compressed_grey_jpeg_and_depth_in_the_plain_transport(tmp_path):
    smooth = cv2.GaussianBlur(colour_image(0, channels=1), (0, 0), 8)
    colour = compressed(
        f"{COLOUR}/compressed", 1.0, smooth, "mono8; jpeg compressed", suffix=".jpg"
    )
    depth = compressed(f"{DEPTH}/compressed", 1.0, depth_image(0), "16UC1; png compressed ")
    frame = _one(tmp_path, colour, depth)
    assert np.abs(frame.grey.astype(int) - smooth).max() <= 6
    assert (frame.depth == expected(0).depth).all()


def test_quantised_inverse_depth(tmp_path):
    """What image_transport makes of 32FC1: A / depth + B in 16 bits."""
    metres = depth_image(0).astype(np.float32) / 2500
    a, b = 100.0 * 101.0, 1 - 100.0 * 101.0 / 10.0
    stored = (a / metres + b).astype(np.uint16)
    stored[0] = 0
    depth = compressed(
        f"{DEPTH}/compressedDepth", 1.0, stored, "32FC1; compressedDepth", header=depth_header(a, b)
    )
    frame = _one(tmp_path, colours([1.0])[0], depth)
    assert not frame.depth[0].any()
    np.testing.assert_allclose(frame.depth[1:], metres[1:], rtol=2e-3)


def test_rvl_is_refused_with_the_mend(tmp_path):
    depth = compressed(
        f"{DEPTH}/compressedDepth", 1.0, depth_image(0), "16UC1; compressedDepth rvl",
        header=depth_header(),
    )  # fmt: skip
    messages = [*colours([1.0]), depth, camera_info(INFO, 1.0)]
    problem = open_bag(write_bag(tmp_path / "a", "ros1", messages)).read(0).problem
    assert "RVL" in problem
    assert "png" in problem


# Topics


def test_a_realsense_bag_has_its_topics_guessed(tmp_path):
    ns = "/camera/camera"
    messages = [
        image(
            f"{ns}/infra1/image_rect_raw", 1.0, colour_image(5, channels=1), "mono8", frame="infra1"
        ),
        image(f"{ns}/depth/image_rect_raw", 1.0, depth_image(7), "16UC1", frame="depth"),
        image(f"{ns}/color/image_raw", 1.0, colour_image(0), "rgb8", frame="color"),
        image(
            f"{ns}/aligned_depth_to_color/image_raw", 1.0, depth_image(0), "16UC1", frame="color"
        ),
        camera_info(f"{ns}/depth/camera_info", 1.0, frame="depth", k=(40, 40, 30, 20)),
        camera_info(f"{ns}/color/camera_info", 1.0, frame="color"),
        camera_info(f"{ns}/aligned_depth_to_color/camera_info", 1.0, frame="color"),
        Message("/imu", "sensor_msgs/msg/Imu", 1.0, raw=bytes(400)),
    ]
    source = open_bag(write_bag(tmp_path / "a", "mcap", messages))
    facts = source.describe()
    assert facts["colour_topic"].startswith(f"{ns}/color/image_raw ")
    assert facts["depth_topic"].startswith(f"{ns}/aligned_depth_to_color/image_raw ")
    assert (source.camera.fx, source.warnings) == (50.0, ())


def test_raw_is_preferred_over_the_same_compressed(tmp_path):
    messages = [
        *colours([1.0]),
        compressed(f"{COLOUR}/compressed", 1.0, colour_image(3), "bgr8; png compressed bgr8"),
        *depths([1.0]),
        camera_info(INFO, 1.0),
    ]
    assert (
        open_bag(write_bag(tmp_path / "a", "mcap", messages))
        .describe()["colour_topic"]
        .startswith(f"{COLOUR} ")
    )


def test_two_cameras_are_not_guessed_between_but_chosen(tmp_path):
    messages = []
    for number, name in enumerate(("left", "right")):
        frame = f"cam_{name}"
        messages += [
            image(f"/{name}/rgb/image_raw", 1.0, colour_image(number), "bgr8", frame=frame),
            image(f"/{name}/depth/image_raw", 1.0, depth_image(number), "16UC1", frame=frame),
            camera_info(f"/{name}/rgb/camera_info", 1.0, frame=frame, k=(50 + number, 51, 31, 23)),
        ]
    bag = write_bag(tmp_path / "a", "sqlite3", messages)
    with pytest.raises(DatasetError, match=r"/left/.*/right/.*--colour-topic") as caught:
        open_bag(bag)
    assert "\n" not in str(caught.value)
    for number, name in enumerate(("left", "right")):
        source = open_bag(bag, colour_topic=f"/{name}/rgb/image_raw")
        assert source.describe()["depth_topic"].startswith(f"/{name}/depth")
        assert source.camera.fx == 50 + number
        assert (source.read(0).frame.grey == expected(number).grey).all()
        # The leading slash may be left out.
        assert len(open_bag(bag, depth_topic=f"{name}/depth/image_raw")) == 1


def test_topics_that_are_not_there_or_something_else(tmp_path):
    imu = Message("/imu", "sensor_msgs/msg/Imu", 1.0, raw=bytes(400))
    bag = write_bag(tmp_path / "a", "mcap", [*whole(), imu])
    with pytest.raises(DatasetError, match=rf"no topic /nothing .*{COLOUR}"):
        open_bag(bag, colour_topic="/nothing")
    with pytest.raises(DatasetError, match=r"/imu is sensor_msgs/msg/Imu, no image"):
        open_bag(bag, depth_topic="/imu")
    with pytest.raises(DatasetError, match=rf"{COLOUR} holds colour .*--depth-topic"):
        open_bag(bag, depth_topic=COLOUR)


# Time


def test_pairs_are_by_header_stamp_not_by_recording(tmp_path):
    """Depth arrives half a second late; its headers tell when it was taken."""
    late = [
        image(DEPTH, s + 0.004, depth_image(i), "16UC1", recorded=s + 0.5)
        for i, s in enumerate(STAMPS)
    ]
    bag = write_bag(tmp_path / "a", "mcap", [*colours(), *late, camera_info(INFO, STAMPS[0])])
    assert_frames(open_bag(bag))


def test_colour_without_depth_is_left_out_and_said(tmp_path):
    stamps = np.arange(10) / 10.0 + 5.0
    some = [d for i, d in enumerate(depths(stamps)) if i < 6]
    bag = write_bag(tmp_path / "a", "ros1", [*colours(stamps), *some, camera_info(INFO, 5.0)])
    source = open_bag(bag)
    assert_frames(source, 6)
    assert source.warnings == ("4 of 10 colour images have no depth image within 20 ms: left out",)


def test_nothing_in_common_in_time_is_an_error(tmp_path):
    messages = [*colours(), *depths(late=60.0), camera_info(INFO, 1.0)]
    with pytest.raises(DatasetError, match=r"within 20 ms; choose by"):
        open_bag(write_bag(tmp_path / "a", "mcap", messages))


def test_headers_without_stamps_fall_back_on_recording(tmp_path):
    messages = [
        *[image(COLOUR, 0.0, colour_image(i), "bgr8", recorded=s) for i, s in enumerate(STAMPS)],
        *[image(DEPTH, 0.0, depth_image(i), "16UC1", recorded=s) for i, s in enumerate(STAMPS)],
        camera_info(INFO, 1.0),
    ]
    source = open_bag(write_bag(tmp_path / "a", "mcap", messages))
    assert any("no stamps" in warning for warning in source.warnings)
    np.testing.assert_array_equal(source.timestamps, STAMPS)
    assert_frames(source)


def test_stamps_that_go_back_or_repeat_are_mended_and_said(tmp_path):
    order = (1.0, 1.2, 1.1, 1.2)
    messages = [camera_info(INFO, 1.0), *depths([1.0, 1.1, 1.2])]
    for position, stamp in enumerate(order):
        index = (1.0, 1.1, 1.2).index(stamp)
        recorded = 1.0 + position
        messages.append(image(COLOUR, stamp, colour_image(index), "bgr8", recorded=recorded))
    source = open_bag(write_bag(tmp_path / "a", "mcap", messages))
    assert_frames(source)
    assert [w.split(": ", 1)[1] for w in source.warnings] == [
        "1 images go back in time: sorted",
        "1 images repeat a time: left out",
    ]


# Registration


def test_depth_of_another_size_is_refused(tmp_path):
    small = [image(DEPTH, 1.0, depth_image(0, (32, 24)), "16UC1")]
    messages = [*colours([1.0]), *small, camera_info(INFO, 1.0)]
    with pytest.raises(DatasetError, match=r"32x24 .* 64x48: depth is not registered"):
        open_bag(write_bag(tmp_path / "a", "mcap", messages))


def test_depth_of_another_frame_or_camera_is_warned_of(tmp_path):
    other = depths([1.0], frame="depth_optical")
    messages = [*colours([1.0]), *other, camera_info(INFO, 1.0)]
    (warning,) = open_bag(write_bag(tmp_path / "a", "mcap", messages)).warnings
    assert "depth_optical" in warning
    assert "registered" in warning
    beside = camera_info("/camera/camera_info", 1.0, k=(58.0, 58.0, 31.5, 23.5))
    messages = [*colours([1.0]), *depths([1.0]), camera_info(INFO, 1.0), beside]
    (warning,) = open_bag(write_bag(tmp_path / "b", "mcap", messages)).warnings
    assert "other intrinsics (fx 58.0)" in warning


def test_ros_1_slashes_before_frames_do_not_matter(tmp_path):
    messages = [*colours([1.0], frame="/camera"), *depths([1.0]), camera_info(INFO, 1.0)]
    assert open_bag(write_bag(tmp_path / "a", "ros1", messages)).warnings == ()


# Camera


def test_the_camera_given_wins_and_a_known_one_takes_the_units_of_the_bag(tmp_path):
    bag = write_bag(tmp_path / "a", "mcap", whole())
    file = tmp_path / "mine.yaml"
    file.write_text(CAMERA)
    source = open_source(bag, camera=str(file))
    assert source.camera.depth_scale == 5000.0, "said in a file"
    assert_frames(source, depth_scale=5000.0)
    big = [
        image(COLOUR, 1.0, colour_image(0, (640, 480)), "bgr8"),
        image(DEPTH, 1.0, depth_image(0, (640, 480)), "16UC1"),
    ]
    source = open_source(write_bag(tmp_path / "b", "mcap", big), camera="tum-fr1")
    assert source.camera.fx == KNOWN_CAMERAS["tum-fr1"].fx
    assert source.camera.depth_scale == 1000.0, "known, but not of TUM's files"


def test_no_camera_info_is_an_error_unless_the_name_tells(tmp_path):
    messages = [*colours([1.0]), *depths([1.0])]
    with pytest.raises(DatasetError, match=r"no camera_info goes with .*--camera FILE"):
        open_bag(write_bag(tmp_path / "a", "mcap", messages))
    elsewhere = camera_info("/other/camera_info", 1.0, frame="elsewhere")
    with pytest.raises(DatasetError, match="no camera_info"):
        open_bag(write_bag(tmp_path / "b", "mcap", [*messages, elsewhere]))
    same = camera_info("/other/camera_info", 1.0)
    source = open_bag(write_bag(tmp_path / "c", "mcap", [*messages, same]))
    assert source.camera_origin == "/other/camera_info"


def test_a_camera_of_another_size_is_an_error(tmp_path):
    bag = write_bag(tmp_path / "a", "mcap", whole(width=128, height=96))
    with pytest.raises(DatasetError, match=r"64x48 and the camera .* is 128x96"):
        open_bag(bag)


def test_driver_defaults_in_a_bag_of_a_known_set_are_doubted(tmp_path):
    """TUM's own bags have the driver's 525 for a calibration."""
    size = (640, 480)
    messages = [
        image(COLOUR, 1.0, colour_image(0, size), "bgr8"),
        image(DEPTH, 1.0, depth_image(0, size), "16UC1"),
        camera_info(INFO, 1.0, width=640, height=480, k=(525.0, 525.0, 319.5, 239.5)),
    ]
    bag = write_bag(tmp_path / "rgbd_dataset_freiburg1_xyz", "ros1", messages)
    (warning,) = open_bag(bag).warnings
    assert "--camera tum-fr1" in warning
    assert open_bag(bag, camera="tum-fr1").warnings == ()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [0.005, -0.013])
def test_the_delay_of_depth_is_that_of_the_headers(tmp_path, kind, late):
    messages = [*colours(), *depths(late=late), camera_info(INFO, STAMPS[0])]
    source = open_source(write_bag(tmp_path / "recording", kind, messages))
    found = [source.read(index).frame.depth_delay for index in range(3)]
    np.testing.assert_allclose(found, late, rtol=0, atol=1e-9)


@pytest.mark.parametrize("without", ["both", "depth"])
def test_times_of_recording_tell_no_delay(tmp_path, without):
    messages = [camera_info(INFO, 1.0)]
    for index in range(3):
        time = 1.0 + index / 30
        stamp = 0.0 if without == "both" else time
        first = image(COLOUR, stamp, colour_image(index), "bgr8", recorded=time)
        second = image(DEPTH, 0.0, depth_image(index), "16UC1", recorded=time + 0.007)
        messages += [first, second]
    source = open_source(write_bag(tmp_path / "bag", "mcap", messages))
    assert "headers have no stamps; times are those of recording" in source.warnings
    assert [source.read(index).frame.depth_delay for index in range(3)] == [0.0, 0.0, 0.0]
