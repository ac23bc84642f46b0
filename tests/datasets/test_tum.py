import json
import zlib

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets import Source, open_source
from edvo.errors import DatasetError
from edvo.trajectory import Trajectory

SIZE = (64, 48)


def test_a_frame_is_what_the_files_hold(make_folder):
    folder = make_folder()
    source = open_source(folder)
    assert isinstance(source, Source)
    assert len(source) == 3
    reading = source.read(1)
    assert (reading.index, reading.stamp, reading.timestamp) == (1, "1.100000", 1.1)
    assert reading.problem is None
    colour = cv2.imread(str(folder / "rgb/1.png"), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(reading.frame.grey, cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY))
    depth = cv2.imread(str(folder / "depth/1.png"), cv2.IMREAD_UNCHANGED)
    assert reading.frame.depth.dtype == np.float32
    np.testing.assert_allclose(reading.frame.depth, depth / 5000.0, rtol=1e-6)
    assert reading.frame.timestamp == 1.1


@pytest.mark.parametrize("index", [-1, 3])
def test_a_frame_that_is_none_is_refused_in_a_line(make_folder, index):
    folder = make_folder()
    with pytest.raises(DatasetError, match=f"^{folder.name}: no frame {index}; there are 0 to 2$"):
        open_source(folder).read(index)


@pytest.mark.parametrize(
    ("suffix", "channels"), [(".png", 1), (".jpg", 1), (".jpg", 3), (".png", 4)]
)
def test_grey_colour_alpha_png_and_jpeg_are_read(make_folder, suffix, channels):
    folder = make_folder(suffix=suffix, channels=channels)
    image = cv2.imread(str(folder / f"rgb/2{suffix}"), cv2.IMREAD_UNCHANGED)
    if channels > 1:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY)
    np.testing.assert_array_equal(open_source(folder).read(2).frame.grey, image)


def test_each_colour_image_gets_its_nearest_depth_image(make_folder):
    folder = make_folder(
        colour=("1.000", "1.030", "1.060", "2.000"),
        depth=("0.995", "1.004", "1.045", "1.900"),
    )
    source = open_source(folder)
    # 1.045 serves both of the images beside it; 2.000 has none within 20 ms.
    assert list(source.stamps) == ["1.000", "1.030", "1.060"]
    for index, partner in enumerate([1, 2, 2]):
        depth = cv2.imread(str(folder / f"depth/{partner}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_allclose(source.read(index).frame.depth, depth / 5000.0, rtol=1e-6)
    assert source.describe()["colour_images_without_depth"] == 1
    assert "1 of 4 colour images have no depth image within 20 ms" in source.warnings[0]


def test_real_sequences_give_every_colour_image_with_depth_near(real_data):
    for name, frames in [("tum_fr3_structure_notexture_far", 123), ("tum_fr1_xyz", 120)]:
        source = open_source(real_data / name)
        assert len(source) == frames
        assert source.read(frames - 1).problem is None
        assert source.warnings == ()
        assert len(source.ground_truth) > 400


def test_a_few_names_that_are_not_in_the_order_of_their_times_are_told(make_folder):
    times = [f"{i}.5" for i in range(20)]
    folder = make_folder(colour=times, depth=times)
    assert open_source(folder).warnings == ()
    lines = (folder / "rgb.txt").read_text().splitlines()
    rows = [i for i, line in enumerate(lines) if not line.startswith("#")]
    (time, file), (other, other_file) = (lines[rows[i]].split() for i in (7, 8))
    lines[rows[7]], lines[rows[8]] = f"{time} {other_file}", f"{other} {file}"
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    (warning,) = open_source(folder).warnings
    assert warning.startswith("rgb.txt: 1 file names are not in the order of their times")
    assert file in warning


def test_stamps_that_repeat_or_go_back_are_put_right_and_told(make_folder):
    folder = make_folder(colour=("1.2", "1.0", "1.1", "1.0"), depth=("1.0", "1.1", "1.1", "1.2"))
    source = open_source(folder)
    assert list(source.stamps) == ["1.0", "1.1", "1.2"]
    assert (np.diff(source.timestamps) > 0).all()
    first = cv2.cvtColor(cv2.imread(str(folder / "rgb/1.png")), cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(source.read(0).frame.grey, first)
    told = "\n".join(source.warnings)
    assert "rgb.txt: 2 rows go back in time (first: line 3)" in told
    assert "rgb.txt: 1 rows repeat a time (first: line 5)" in told
    assert "depth.txt: 1 rows repeat a time (first: line 4)" in told


@pytest.mark.parametrize("order", ["depth first", "colour first"])
def test_associations_with_frame_numbers_as_in_icl_nuim(make_folder, order):
    folder = make_folder("office_traj0_frei_png", camera=None)
    (folder / "rgb.txt").unlink()
    (folder / "depth.txt").unlink()
    rows = [(f"{i} depth/{i}.png", f"{i} rgb/{i}.png") for i in range(3)]
    if order == "colour first":
        rows = [row[::-1] for row in rows]
    (folder / "associations.txt").write_text("\n".join(" ".join(row) for row in rows))
    (folder / "groundtruth.txt").write_text("".join(f"{i} {i} 0 0 0 0 0 1\n" for i in range(3)))
    source = open_source(folder)
    assert list(source.stamps) == ["0", "1", "2"]
    np.testing.assert_allclose(source.timestamps, [0, 1 / 30, 2 / 30])
    np.testing.assert_allclose(source.ground_truth.timestamps, source.timestamps)
    assert source.camera.name == "icl-nuim"
    (folder / "groundtruth.txt").write_text("0.0 0 0 0 0 0 0 1\n0.05 1 0 0 0 0 0 1\n")
    assert open_source(folder).ground_truth.stamps == ("0.0", "0.05")
    assert open_source(folder).ground_truth.timestamps[1] == 0.05
    assert "frame numbers" in source.warnings[0]
    # The camera of ICL-NUIM is larger than these images.
    assert "64x48" in source.read(0).problem
    assert open_source(folder, camera=Camera(64, 48, 50, 50, 31.5, 23.5)).read(0).problem is None


def test_a_list_with_commas_a_bom_and_blanks_in_names(make_folder):
    folder = make_folder()
    (folder / "rgb" / "0.png").rename(folder / "rgb" / "my image.png")
    (folder / "rgb.txt").write_bytes(
        b"\xef\xbb\xbf# stamps\r\n1.0, rgb/my image.png\r\n\r\n1.1 rgb/1.png\r\n"
    )
    source = open_source(folder)
    assert list(source.stamps) == ["1.0", "1.1"]
    assert source.read(0).problem is None


def chunkless(data, kind):
    """A PNG without its chunks of one kind, in every other respect whole."""
    at, out = 8, data[:8]
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if data[at + 4 : at + 8] != kind:
            out += data[at : at + 12 + length]
        at += 12 + length
    return out


def damaged(data):
    """A PNG whose pixels are cut short, with a right checksum and a right end."""
    at = data.index(b"IDAT") - 4
    length = int.from_bytes(data[at : at + 4], "big")
    body = b"IDAT" + data[at + 8 : at + 8 + length // 2]
    chunk = (len(body) - 4).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
    return data[:at] + chunk + data[-12:]


@pytest.mark.parametrize("file", ["rgb/1.png", "depth/1.png"])
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: None, "cannot read"),
        (lambda data: b"", "is empty"),
        (lambda data: data[:4], "is cut short"),
        (lambda data: data[: len(data) // 2], "is cut short"),
        (lambda data: data[:-14], "is cut short"),
        (damaged, "damaged"),
        (lambda data: chunkless(data, b"IDAT"), "damaged"),
        (lambda data: b"no image at all", "damaged or no image"),
    ],
)
def test_a_bad_image_is_a_named_problem_and_the_rest_is_read(make_folder, file, spoil, words):
    folder = make_folder()
    data = spoil((folder / file).read_bytes())
    if data is None:
        (folder / file).unlink()
    else:
        (folder / file).write_bytes(data)
    source = open_source(folder)
    readings = [source.read(index) for index in range(3)]
    assert [reading.frame is not None for reading in readings] == [True, False, True]
    problem = readings[1].problem
    assert str(folder / file) in problem
    assert words in problem
    assert "\n" not in problem


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_jpeg_cut_short_is_seen_even_behind_a_thumbnail(make_folder, share):
    folder = make_folder(suffix=".jpg")
    file = folder / "rgb/1.jpg"
    data = file.read_bytes()
    thumbnail = b"\xff\xe1" + (len(data) + 2).to_bytes(2, "big") + data
    whole = data[:2] + thumbnail + data[2:]
    file.write_bytes(whole)
    assert open_source(folder).read(1).problem is None
    file.write_bytes(whole[: int(share * len(whole))])
    assert str(file) in open_source(folder).read(1).problem


def test_images_that_do_not_fit_name_both_sizes(make_folder):
    folder = make_folder()
    cv2.imwrite(str(folder / "depth/0.png"), np.full((24, 32), 5000, np.uint16))
    cv2.imwrite(str(folder / "rgb/1.png"), np.zeros((240, 320, 3), np.uint8))
    cv2.imwrite(str(folder / "depth/1.png"), np.full((240, 320), 5000, np.uint16))
    source = open_source(folder)
    assert "64x48" in source.read(0).problem
    assert "32x24" in source.read(0).problem
    assert "320x240" in source.read(1).problem
    assert "64x48" in source.read(1).problem


def test_images_of_another_kind_are_problems(make_folder):
    folder = make_folder()
    cv2.imwrite(str(folder / "depth/0.png"), np.zeros((48, 64), np.uint16))
    cv2.imwrite(str(folder / "depth/1.png"), np.zeros((48, 64, 3), np.uint8))
    cv2.imwrite(str(folder / "rgb/2.png"), np.zeros((48, 64), np.uint16))
    source = open_source(folder)
    assert "no valid depth" in source.read(0).problem
    assert "one 16-bit value" in source.read(1).problem
    assert "8 bits" in source.read(2).problem


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("rgb.txt", None, "rgb.txt is missing"),
        ("depth.txt", None, "depth.txt is missing"),
        ("rgb.txt", "# timestamp filename\n", "list is empty"),
        ("depth.txt", "", "list is empty"),
        ("rgb.txt", "1.0 rgb/0.png\n1.1\n", "rgb.txt:2: '1.1' is no"),
        ("rgb.txt", "one rgb/0.png\n", "rgb.txt:1: 'one' is no time"),
        ("depth.txt", "nan depth/0.png\n", "depth.txt:1: 'nan' is no time"),
        ("depth.txt", "900.0 depth/0.png\n", "no colour image has a depth image within 20 ms"),
    ],
)
def test_a_bad_list_is_one_line_that_names_it(make_folder, name, content, words):
    folder = make_folder()
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(content)
    with pytest.raises(DatasetError, match=words) as caught:
        open_source(folder)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_binary_list_is_refused(make_folder):
    folder = make_folder()
    (folder / "rgb.txt").write_bytes(b"\x89PNG\xff\x00")
    with pytest.raises(DatasetError, match="no text file"):
        open_source(folder)


def test_ground_truth_is_optional_and_a_bad_one_only_warns(make_folder):
    folder = make_folder()
    assert open_source(folder).ground_truth is None
    file = folder / "groundtruth.txt"
    file.write_text("1.0 0 0 0 0 0 0 1\n1.2 1 0 0 0 0 0 1\n")
    source = open_source(folder)
    assert isinstance(source.ground_truth, Trajectory)
    assert source.warnings == ()
    file.write_text("1.0 0 0 0 0 0 0\n")
    source = open_source(folder)
    assert source.ground_truth is None
    assert "groundtruth.txt:1" in source.warnings[0]
    file.write_text("901.0 0 0 0 0 0 0 1\n")
    assert "no time in common" in open_source(folder).warnings[0]


def test_describe_says_what_is_assumed_in_plain_types(make_folder):
    folder = make_folder(
        colour=("1.0", "1.1", "1.2", "1.3", "1.6"), depth=("1.0", "1.1", "1.2", "1.3", "1.6")
    )
    (folder / "groundtruth.txt").write_text("1.05 0 0 0 0 0 0 1\n1.5 1 0 0 0 0 0 1\n")
    told = json.loads(json.dumps(open_source(folder).describe()))
    assert told["format"] == "tum"
    assert told["recognised_by"] == "rgb.txt and depth.txt"
    assert told["camera"]["fx"] == 50.0
    assert told["camera"]["origin"] == "camera.yaml in the folder"
    assert told["frames"] == 5
    assert told["duration_s"] == pytest.approx(0.6)
    assert told["frame_rate_hz"] == pytest.approx(10.0)
    assert told["gaps"] == 1
    assert told["longest_gap_s"] == pytest.approx(0.3)
    assert told["ground_truth"] == {"poses": 2, "duration_s": pytest.approx(0.45), "frames": 3}
    assert told["warnings"] == []


def test_a_single_frame_is_a_source(make_folder):
    source = open_source(make_folder(colour=("1.0",), depth=("1.0",)))
    assert len(source) == 1
    assert source.describe()["frame_rate_hz"] is None


def test_the_delay_of_depth_is_that_of_the_stamps(make_folder):
    folder = make_folder(
        colour=("1.000", "1.030", "1.060", "2.000"), depth=("0.995", "1.004", "1.045", "2.000")
    )
    delays = [0.004, 0.015, -0.015, 0.0]
    source = open_source(folder)
    found = [source.read(index).frame.depth_delay for index in range(4)]
    np.testing.assert_allclose(found, delays, rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", ["depth first", "colour first"])
def test_the_delay_in_a_list_of_pairs(make_folder, order):
    folder = make_folder()
    (folder / "rgb.txt").unlink()
    (folder / "depth.txt").unlink()
    # The last two have nothing to do with their partners: other clocks, paired by hand.
    stamps = [("1.0", "1.012"), ("1.1", "1.095"), ("1.2", "1.225"), ("1.3", "77.0")]
    rows = [
        (f"{colour} rgb/{i % 3}.png", f"{depth} depth/{i % 3}.png")
        for i, (colour, depth) in enumerate(stamps)
    ]
    if order == "depth first":
        rows = [row[::-1] for row in rows]
    (folder / "associations.txt").write_text("\n".join(" ".join(row) for row in rows))
    source = open_source(folder)
    assert list(source.stamps) == ["1.0", "1.1", "1.2", "1.3"]
    found = [source.read(index).frame.depth_delay for index in range(4)]
    np.testing.assert_allclose(found, [0.012, -0.005, 0.0, 0.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("joint", [True, False])
def test_the_delay_in_frame_numbers(make_folder, joint):
    colour, depth = ("0", "1", "2"), ("0", "1.015", "1.985")
    folder = make_folder(colour=colour, depth=depth)
    if joint:
        (folder / "rgb.txt").unlink()
        rows = [f"{colour[i]} rgb/{i}.png {depth[i]} depth/{i}.png" for i in range(3)]
        (folder / "associations.txt").write_text("\n".join(rows))
    source = open_source(folder)
    np.testing.assert_allclose(source.timestamps, [0, 1 / 30, 2 / 30])
    found = [source.read(index).frame.depth_delay for index in range(3)]
    np.testing.assert_allclose(found, [0.0, 0.0005, -0.0005], rtol=0, atol=1e-12)


def test_neighbouring_frame_numbers_are_no_delay(make_folder):
    folder = make_folder()
    (folder / "rgb.txt").unlink()
    rows = [f"{i} rgb/{i}.png {i + 1} depth/{i}.png" for i in range(3)]
    (folder / "associations.txt").write_text("\n".join(rows))
    source = open_source(folder)
    assert [source.read(index).frame.depth_delay for index in range(3)] == [0.0, 0.0, 0.0]
