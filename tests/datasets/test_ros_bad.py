"""Bad bags: one line that names the file, bounded memory, and never another exception."""

import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from edvo.datasets import open_source, read_ahead
from edvo.datasets.ros import open_bag
from edvo.datasets.ros_files import MAX_CHUNK_BYTES
from edvo.errors import DatasetError, EdvoError, MissingExtraError

from .conftest import colour_image, depth_image
from .ros_bags import KINDS, Message, camera_info, compressed, image, serialise, write_bag

COLOUR, DEPTH, INFO = "/camera/rgb/image_raw", "/camera/depth/image_raw", "/camera/rgb/camera_info"
STAMPS = np.arange(6) / 30.0 + 100.0
MOST_MEMORY = 32e6  # bytes; the bags have some 100 kB


def good(stamps=STAMPS):
    messages = [camera_info(INFO, stamps[0])]
    for index, stamp in enumerate(stamps):
        messages.append(image(COLOUR, stamp, colour_image(index), "bgr8"))
        messages.append(image(DEPTH, stamp, depth_image(index), "16UC1"))
    return messages


def file_of(bag):
    return next(f for f in bag.iterdir() if f.suffix != ".yaml") if bag.is_dir() else bag


def refused(bag, *words, error=DatasetError, **options):
    """Open it, which must be refused in one line that names it and has the words."""
    with pytest.raises(error) as caught:
        open_source(bag, format="ros", **options)
    text = str(caught.value)
    assert "\n" not in text
    assert bag.name in text
    for word in words:
        assert word in text
    return text


def problems(source):
    return [source.read(index).problem for index in range(len(source))]


def refusal_or_problems(bag):
    """Open it, or each frame, which may be refused in a line; nothing else may be raised."""
    refusal, lines = None, []
    try:
        lines = problems(open_source(bag, format="ros"))
    except EdvoError as error:
        refusal = str(error)
        lines = [refusal]
    for line in lines:
        assert line is None or ("\n" not in line and bag.name in line)
    return refusal


@pytest.fixture(autouse=True)
def _bounded_memory():
    tracemalloc.start()
    yield
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MOST_MEMORY


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.5, 0.9, 0.999])
def test_cut_short(tmp_path, kind, share):
    bag = write_bag(tmp_path / "a", kind, good())
    file = file_of(bag)
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * share)])
    refusal = refusal_or_problems(bag)
    # SQLite finds what lies before the cut.
    assert refusal or (kind == "sqlite3" and share > 0.4)


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
@pytest.mark.parametrize(
    "content", [b"", b"no bag\n" * 50, bytes(1000), b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"]
)
def test_no_bag_at_all(tmp_path, name, content):
    bag = tmp_path / name
    bag.write_bytes(content)
    refused(bag)


def test_an_old_or_unindexed_ros_1_bag_says_so(tmp_path):
    bag = tmp_path / "a.bag"
    bag.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    refused(bag, "version")
    data = bytearray(write_bag(tmp_path / "b", "ros1", good()).read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at : at + 8] = bytes(8)
    bag.write_bytes(data)
    refused(bag, "not indexed", "rosbag reindex")


@pytest.mark.parametrize(
    "text",
    ["", "nonsense", "{", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {}"],
)
def test_bad_metadata(tmp_path, text):
    bag = write_bag(tmp_path / "a", "mcap", good())
    (bag / "metadata.yaml").write_text(text)
    refused(bag, "reindex")


def test_metadata_of_files_that_are_not_there(tmp_path):
    bag = write_bag(tmp_path / "a", "sqlite3", good())
    file_of(bag).unlink()
    refused(bag, "missing")


def test_a_folder_without_bags(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    refused(folder, "no .mcap or .db3")


@pytest.mark.parametrize("kind", KINDS)
def test_missing_topics(tmp_path, kind):
    def without(topic):
        return [message for message in good() if message.topic != topic]

    imu = Message("/imu", "sensor_msgs/msg/Imu", 1.0, raw=bytes(300))
    refused(write_bag(tmp_path / "a", kind, without(DEPTH)), "no topic holds depth", COLOUR)
    refused(write_bag(tmp_path / "b", kind, without(COLOUR)), "no topic holds colour", DEPTH)
    refused(write_bag(tmp_path / "c", kind, without(INFO)), "no camera_info", "--camera FILE")
    refused(write_bag(tmp_path / "d", kind, [imu]), "no topic of images")
    refused(write_bag(tmp_path / "e", kind, []), "no topic of images")


@pytest.mark.parametrize("kind", KINDS)
def test_types_that_are_not_what_they_say(tmp_path, kind):
    ros2 = kind != "ros1"
    text = serialise(good()[0], ros2)
    wrong = [replace(m, raw=text) if m.topic == DEPTH else m for m in good()]
    refused(write_bag(tmp_path / "a", kind, wrong), "no topic holds depth")
    short = [replace(m, raw=b"\x00\x01\x00\x00\x07") if m.topic == COLOUR else m for m in good()]
    refused(write_bag(tmp_path / "b", kind, short), "no topic holds colour")
    empty = [replace(m, raw=b"") if m.topic == COLOUR else m for m in good()]
    refused(write_bag(tmp_path / "c", kind, empty), "no topic holds colour")
    no_info = [replace(m, raw=b"\x00\x01\x00\x00") if m.topic == INFO else m for m in good()]
    refused(write_bag(tmp_path / "d", kind, no_info), "no camera_info")
    strange = [image(COLOUR, 1.0, colour_image(0), "rgb16"), *good()[2::2]]
    refused(write_bag(tmp_path / "e", kind, strange), "rgb16")


@pytest.mark.parametrize("kind", KINDS)
def test_camera_info_that_is_not_calibrated(tmp_path, kind):
    messages = [camera_info(INFO, 1.0, k=(0, 0, 0, 0)), *good()[1:]]
    refused(write_bag(tmp_path / "a", kind, messages), "not calibrated", "--camera FILE")


@pytest.mark.parametrize("kind", KINDS)
def test_bad_frames_are_problems_and_the_others_are_read(tmp_path, kind):
    messages = good()

    def spoil(index, **fields):
        at = 1 + 2 * index
        messages[at] = replace(messages[at], fields={**messages[at].fields, **fields})

    spoil(1, data=np.zeros(0, np.uint8))
    spoil(2, height=2**31, width=2**31, step=2**32 - 1)
    spoil(3, step=3)
    spoil(4, encoding="nonsense")
    messages[2 + 2 * 5].fields["data"][:] = 0
    found = problems(open_source(write_bag(tmp_path / "a", kind, messages)))
    assert found[0] is None
    for problem, word in zip(
        found[1:], ["empty", "claims", "rows of 3", "nonsense", "no valid depth"], strict=True
    ):
        assert word in problem
        assert "\n" not in problem
        assert (COLOUR if word != "no valid depth" else DEPTH) in problem


@pytest.mark.parametrize("kind", KINDS)
def test_all_images_empty(tmp_path, kind):
    messages = good()
    for message in messages[1::2]:
        message.fields.update(data=np.zeros(0, np.uint8), height=0, width=0, step=0)
    refused(write_bag(tmp_path / "a", kind, messages), "empty")


def test_compressed_images_that_are_damaged_or_claim_too_much(tmp_path):
    messages = [camera_info(INFO, 100.0)]
    for index, stamp in enumerate(STAMPS):
        messages.append(compressed(f"{COLOUR}/compressed", stamp, colour_image(index), "png"))
        messages.append(image(DEPTH, stamp, depth_image(index), "16UC1"))
    jpeg = compressed(COLOUR, 1.0, colour_image(0), "jpeg", suffix=".jpg").fields["data"].tobytes()
    size = jpeg.index(b"\xff\xc0") + 5
    png = messages[1].fields["data"].tobytes()
    for number, data in enumerate(
        [
            png[: len(png) // 2],
            png[:16] + b"\x00\x00\xff\xff" * 2 + png[24:],
            jpeg[:size] + b"\xff\xff\xff\xff" + jpeg[size + 4 :],
            b"",
            png[:60] + bytes(40) + png[100:],
        ],
        start=1,
    ):
        messages[1 + 2 * number].fields["data"] = np.frombuffer(data, np.uint8)
    found = problems(open_source(write_bag(tmp_path / "a", "mcap", messages)))
    words = ["cut short", "65535x65535", "65535x65535", "empty", f"{COLOUR}/compressed"]
    assert found[0] is None
    for problem, word in zip(found[1:], words, strict=True):
        assert word in problem
        assert "\n" not in problem


def _patched(bag, mark, offset, value):
    file = file_of(bag)
    data = bytearray(file.read_bytes())
    at = data.index(mark) + offset
    data[at : at + len(value)] = value
    file.write_bytes(data)
    return bag


@pytest.mark.parametrize("size", [2**32 - 1, 2**31, MAX_CHUNK_BYTES + 1])
def test_declared_sizes_of_ros_1(tmp_path, size):
    """Of a compressed chunk, of what it holds, of records."""
    value = size.to_bytes(4, "little")
    for number, (mark, offset) in enumerate([(b"compression=lz4", 15), (b"size=", 5)]):
        bag = write_bag(tmp_path / f"a{number}", "ros1", good(), compression="lz4")
        refusal_or_problems(_patched(bag, mark, offset, value))
    bag = write_bag(tmp_path / "b", "ros1", good())
    for number, mark in enumerate((b"conn_count=", b"chunk_count=", b"count=")):
        copy = tmp_path / f"c{number}.bag"
        copy.write_bytes(bag.read_bytes())
        refusal_or_problems(_patched(copy, mark, len(mark), value))


@pytest.mark.parametrize("size", [2**63, 2**64 - 1, 2**40])
def test_declared_sizes_of_mcap(tmp_path, size):
    value = size.to_bytes(8, "little")
    bag = write_bag(tmp_path / "a", "mcap", good(), compression="storage")
    refusal_or_problems(_patched(bag, b"zstd", -12 - 8, value))  # what the chunk unpacks to
    bag = write_bag(tmp_path / "b", "mcap", good(), compression="storage")
    refusal_or_problems(_patched(bag, b"zstd", 4, value))  # what it is packed to
    bag = write_bag(tmp_path / "c", "mcap", good())
    refusal_or_problems(_patched(bag, b"\x89MCAP0\r\n", 9, value))  # the first record


@pytest.mark.parametrize(
    ("kind", "compression"),
    [("ros1", None), ("ros1", "lz4"), ("ros1", "bz2"), ("sqlite3", None), ("sqlite3", "message"),
     ("mcap", None), ("mcap", "storage")],
)  # fmt: skip
def test_damaged_anywhere(tmp_path, kind, compression):
    """Bytes at random places become others; headers and indices more often than images."""
    bag = write_bag(tmp_path / "a", kind, good(STAMPS[:3]), compression=compression)
    file = file_of(bag)
    data = file.read_bytes()
    # Noise has few runs of zeros, headers have many.
    plain = [at for at in range(len(data) - 3) if data[at : at + 3] == b"\x00\x00\x00"]
    rng = np.random.default_rng(7)
    for trial in range(30):
        broken = bytearray(data)
        for _ in range(rng.integers(1, 6)):
            at = int(rng.choice(plain)) if trial % 3 else int(rng.integers(len(data)))
            broken[at] = int(rng.integers(256))
        file.write_bytes(broken)
        refusal_or_problems(bag)


def test_a_bag_that_shrinks_while_it_is_read(tmp_path):
    bag = write_bag(tmp_path / "a", "ros1", good())
    source = open_source(bag)
    with bag.open("r+b") as file:
        file.truncate(5000)
    found = [reading.problem for reading in read_ahead(source, range(len(source)))]
    assert all("a.bag" in problem for problem in found[1:])


def test_without_rosbags_the_extra_is_named(tmp_path, monkeypatch):
    bag = write_bag(tmp_path / "a", "ros1", good())
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    refused(bag, "edvo[ros]", error=MissingExtraError)


def test_a_path_that_is_not_there(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        open_bag(tmp_path / "nothing.bag")
