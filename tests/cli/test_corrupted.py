"""Corrupted bags and folders through the command: a clear line, no traceback, bounded memory.

All are run in one process of their own, which may map only a little more memory than what a whole
recording took: whoever believes a declared size is refused by the system.
"""

import json
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ..datasets.conftest import colour_image, depth_image  # noqa: TID252 - as in datasets/
from ..datasets.layouts import CAMERA, recording, write_tum  # noqa: TID252
from ..datasets.ros_bags import (  # noqa: TID252
    Message,
    camera_info,
    compressed,
    image,
    serialise,
    write_bag,
)
from ..datasets.test_folders import write_generic, write_open3d, write_replica  # noqa: TID252
from ..datasets.test_tum_kin import write_eth3d, write_icl, write_povray  # noqa: TID252
from ..datasets.test_two_cameras import write_7scenes, write_scannet, write_sens  # noqa: TID252
from .conftest import make_sequence

COLOUR, DEPTH, INFO = "/camera/rgb/image_raw", "/camera/depth/image_raw", "/camera/rgb/camera_info"
STAMPS = [100 + index / 30 for index in range(4)]
MOST_MEMORY = 300e6  # bytes, mapped in addition; threads alone reserve some of it
MOST_RESIDENT = 100e6  # bytes, in use in addition

PROGRAM = """
import json, os, resource, sys, tempfile
from pathlib import Path
from edvo.cli import main

def call(arguments):
    sys.argv = ["edvo", *arguments]
    status, kept = 0, [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        sys.stdout.flush(), sys.stderr.flush()
        os.dup2(out.fileno(), 1), os.dup2(err.fileno(), 2)  # what libraries print counts too
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException as error:
            status = f"{type(error).__name__}: {error}"
        finally:
            sys.stdout.flush(), sys.stderr.flush()
            for number, descriptor in zip((1, 2), kept):
                os.dup2(descriptor, number), os.close(descriptor)
        texts = [(stream.seek(0), stream.read().decode())[1] for stream in (out, err)]
    return status, *texts

def resident():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

folder, most, whole, cases = json.loads(sys.stdin.read())
for command in (["info", whole], ["run", whole, "-o", folder + "/whole"]) * 2:
    assert call(command)[0] == 0
mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (mapped + int(most), resource.RLIM_INFINITY))
results = {}
for number, (name, path) in enumerate(cases.items()):
    before = resident()
    results[name] = {
        "info": call(["info", path]),
        "run": call(["run", path, "-o", f"{folder}/out{number}"]),
        "written": os.path.exists(f"{folder}/out{number}"),
        "grown": resident() - before,
    }
print(json.dumps(results))
"""


def good() -> list[Message]:
    messages = [camera_info(INFO, STAMPS[0])]
    for index, stamp in enumerate(STAMPS):
        messages.append(image(COLOUR, stamp, colour_image(index), "bgr8"))
        messages.append(image(DEPTH, stamp, depth_image(index), "16UC1"))
    return messages


def changed(topic: str, **fields: object) -> list[Message]:
    return [
        replace(each, fields={**each.fields, **fields}) if each.topic == topic else each
        for each in good()
    ]


def without(topic: str) -> list[Message]:
    return [each for each in good() if each.topic != topic]


def bag(kind: str, messages: list[Message] | None = None, compression: str | None = None):
    def make(folder: Path) -> Path:
        whole = good() if messages is None else messages
        return write_bag(folder / "recording", kind, whole, compression=compression)

    return make


def patch(make: Callable[[Path], Path], mark: bytes, offset: int, value: bytes):
    """Change some bytes of the file of a bag."""

    def patched(folder: Path) -> Path:
        path = make(folder)
        file = file_of(path)
        data = bytearray(file.read_bytes())
        at = data.index(mark) + offset
        data[at : at + len(value)] = value
        file.write_bytes(data)
        return path

    return patched


def cut(make: Callable[[Path], Path], share: float):
    def shortened(folder: Path) -> Path:
        path = make(folder)
        file = file_of(path)
        data = file.read_bytes()
        file.write_bytes(data[: int(len(data) * share)])
        return path

    return shortened


def file_of(path: Path) -> Path:
    return next(f for f in path.iterdir() if f.suffix != ".yaml") if path.is_dir() else path


def holding(write: Callable[[Path], Path], file: str, content: bytes | str | None):
    """Give a file of a recording another content, or take it away."""

    def spoiled(folder: Path) -> Path:
        path = write(folder)
        if content is None:
            (path / file).unlink()
        else:
            data = content.encode() if isinstance(content, str) else content
            (path / file).write_bytes(data)
        return path

    return spoiled


def each_image(write: Callable[[Path], Path], pattern: str, spoil: Callable[[bytes], bytes]):
    def spoiled(folder: Path) -> Path:
        path = write(folder)
        for file in path.glob(pattern):
            file.write_bytes(spoil(file.read_bytes()))
        return path

    return spoiled


def file(name: str, content: bytes):
    def make(folder: Path) -> Path:
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
        return folder / name

    return make


def claiming(width: int, height: int) -> Callable[[bytes], bytes]:
    """Let the header of a PNG say another size, its checksum right."""

    def spoil(data: bytes) -> bytes:
        head = b"IHDR" + width.to_bytes(4, "big") + height.to_bytes(4, "big") + data[24:29]
        return data[:12] + head + zlib.crc32(head).to_bytes(4, "big") + data[33:]

    return spoil


def png(array: np.ndarray) -> bytes:
    return cv2.imencode(".png", array)[1].tobytes()


def huge_packed() -> list[Message]:
    messages = without(COLOUR)
    for index, stamp in enumerate(STAMPS):
        one = compressed(f"{COLOUR}/compressed", stamp, colour_image(index), "bgr8; png")
        data = claiming(60_000, 60_000)(one.fields["data"].tobytes())
        one.fields["data"] = np.frombuffer(data, np.uint8)
        messages.append(one)
    return messages


def tum(folder: Path) -> Path:
    return write_tum(folder / "mine", recording())


def generic(folder: Path) -> Path:
    return write_generic(folder / "mine", recording())


def rendered(folder: Path) -> Path:
    path = write_povray(folder / "mine", recording())
    recording().camera.to_yaml(path / "camera.yaml")
    return path


@dataclass(frozen=True)
class Case:
    """A damage, what the one line must say of it, and whether some frames are left."""

    make: Callable[[Path], Path]
    words: str
    frames_left: bool = False


IMU = Message("/imu", "sensor_msgs/msg/Imu", 1.0, raw=bytes(300))
EMPTY = {"data": np.zeros(0, np.uint8), "height": 0, "width": 0, "step": 0}
HUGE = {"height": 2**31, "width": 2**31, "step": 2**32 - 1}

CASES = {
    # Bags.
    "ROS 1, cut short": Case(cut(bag("ros1"), 0.5), "rosbag reindex"),
    "ROS 1, of no bytes": Case(file("a.bag", b""), "a.bag"),
    "ROS 1, never closed": Case(patch(bag("ros1"), b"index_pos=", 10, bytes(8)), "not indexed"),
    "ROS 1, huge chunk": Case(
        patch(bag("ros1", None, "lz4"), b"size=", 5, b"\xff\xff\xff\x7f"), "recording.bag"
    ),
    "ROS 1, huge record": Case(
        patch(bag("ros1"), b"conn_count=", 11, b"\xff\xff\xff\xff"), "recording.bag"
    ),
    "mcap, cut short": Case(cut(bag("mcap"), 0.5), "mcap recover"),
    "mcap, only its mark": Case(file("a.mcap", b"\x89MCAP0\r\n"), "a.mcap"),
    "mcap, huge record": Case(
        patch(bag("mcap"), b"\x89MCAP0\r\n", 9, (2**62).to_bytes(8, "little")), "recording"
    ),
    "mcap, huge chunk": Case(
        patch(bag("mcap", None, "storage"), b"zstd", -20, (2**40).to_bytes(8, "little")),
        "recording",
    ),
    "sqlite3, cut short": Case(cut(bag("sqlite3"), 0.1), "recording"),
    "sqlite3 that is text": Case(file("a.db3", b"no base\n" * 100), "a.db3"),
    "metadata of another kind": Case(
        holding(bag("mcap"), "metadata.yaml", "rosbag2_bagfile_information: 3\n"), "reindex"
    ),
    "metadata of a file that is gone": Case(
        lambda to: _without_file(bag("sqlite3")(to)), "missing"
    ),
    "no depth topic": Case(bag("mcap", without(DEPTH)), "no topic holds depth"),
    "no colour topic": Case(bag("ros1", without(COLOUR)), "no topic holds colour"),
    "no camera_info": Case(bag("sqlite3", without(INFO)), "--camera FILE"),
    "nothing but an IMU": Case(bag("mcap", [IMU]), "no topic of images"),
    "camera_info of zeros": Case(
        bag("ros1", [camera_info(INFO, 1.0, k=(0, 0, 0, 0)), *good()[1:]]), "not calibrated"
    ),
    "messages of another type": Case(
        bag(
            "ros1",
            [
                replace(each, raw=serialise(good()[0], False)) if each.topic == DEPTH else each
                for each in good()
            ],
        ),
        "no topic holds depth",
    ),
    "messages of five bytes": Case(
        bag("mcap", [replace(m, raw=b"\0\1\0\0\7") if m.topic == COLOUR else m for m in good()]),
        "no topic holds colour",
    ),
    "images of no bytes": Case(bag("mcap", changed(COLOUR, **EMPTY)), "empty"),
    "images that claim 2^62 pixels": Case(bag("ros1", changed(COLOUR, **HUGE)), COLOUR),
    "PNG that claims 60000 x 60000": Case(bag("mcap", huge_packed()), "60000x60000"),
    "an encoding nobody knows": Case(bag("mcap", changed(COLOUR, encoding="rgb12")), "rgb12"),
    "depth of another size": Case(
        bag("mcap", [*without(DEPTH), image(DEPTH, 100.0, depth_image(0, (32, 24)), "16UC1")]),
        "not registered",
    ),
    "depth a minute late": Case(
        bag("ros1", [*without(DEPTH), image(DEPTH, 160.0, depth_image(0), "16UC1")]),
        "within 20 ms",
    ),
    # Folders.
    "list cut within a row": Case(
        holding(tum, "rgb.txt", "0.000000 rgb/0.000000.png\n0.0333"), "rgb.txt:2"
    ),
    "list that is no text": Case(holding(tum, "rgb.txt", b"\xff\xfe\x89PNG"), "rgb.txt"),
    "list without rows": Case(holding(tum, "depth.txt", "# nothing\n"), "depth.txt"),
    "list that is gone": Case(holding(tum, "depth.txt", None), "depth.txt is missing"),
    "list with a time of 5000 digits": Case(
        holding(tum, "rgb.txt", "9" * 5000 + " rgb/0.000000.png\n"), "rgb.txt"
    ),
    "all images of no bytes": Case(each_image(tum, "*/*.png", lambda data: b""), "is empty"),
    "all images cut short": Case(
        each_image(tum, "*/*.png", lambda data: data[: len(data) // 2]), "cut short"
    ),
    "images that claim 30000 x 30000": Case(
        each_image(tum, "rgb/*.png", claiming(30_000, 30_000)), "30000x30000"
    ),
    "depth of 8 bits": Case(
        each_image(tum, "depth/*.png", lambda data: png(np.ones((120, 160), np.uint8))),
        "16-bit",
    ),
    "colour of 16 bits": Case(
        each_image(tum, "rgb/*.png", lambda data: png(np.ones((120, 160), np.uint16))), "8 bits"
    ),
    "camera of 10^18 pixels": Case(
        holding(
            tum,
            "camera.yaml",
            "width: 1000000000\nheight: 1000000000\nfx: 1e9\nfy: 1e9\ncx: 5e8\ncy: 5e8\n"
            "distortion: [0.01, 0, 0, 0, 0]\ndepth_scale: 5000\n",
        ),
        "1000000000x1000000000",
    ),
    "camera without fx": Case(holding(tum, "camera.yaml", "width: 5\n"), "camera.yaml"),
    "one image of no bytes": Case(
        holding(tum, "rgb/0.033333.png", b""), "0.033333.png is empty", frames_left=True
    ),
    "one image that is a web page": Case(
        holding(tum, "depth/0.066667.png", "<html>404</html>\n"), "0.066667.png", frames_left=True
    ),
    "true poses of another kind": Case(
        holding(tum, "groundtruth.txt", "nan inf 1e999\n" * 3), "groundtruth.txt", frames_left=True
    ),
    "folder without a camera": Case(holding(generic, "camera.yaml", None), "camera.yaml"),
    "ICL-NUIM with a list of another kind": Case(
        holding(
            lambda to: write_icl(to / "icl", recording()), "associations.txt", "0 rgb/0.png 0\n"
        ),
        "associations.txt:1",
    ),
    "render with too many distances": Case(
        each_image(rendered, "*.depth", lambda data: b"1.0 " * 400_000), "more than 19200"
    ),
    "calibration of three numbers": Case(
        holding(lambda to: write_eth3d(to / "a", recording()), "calibration.txt", "1 2 3\n"),
        "holds 3 numbers",
    ),
    "scene without its intrinsics": Case(
        holding(
            lambda to: write_scannet(to / "a", recording(), CAMERA),
            "intrinsic/intrinsic_color.txt",
            None,
        ),
        "intrinsic_color.txt",
    ),
    ".sens of 2^63 frames and huge images": Case(
        lambda to: write_sens(to / "a.sens", recording(), frames=2**63, size=(2**30, 2**30)),
        "is damaged",
    ),
    ".sens cut within its header": Case(
        cut(lambda to: write_sens(to / "a.sens", recording()), 0.001), "cut short"
    ),
    "7-Scenes without depth": Case(
        lambda to: _without_depth(write_7scenes(to / "seq-01", recording(), recording().poses)),
        "no depth images",
    ),
    "Replica with half a camera": Case(
        lambda to: _with(write_replica(to / "a/office0", recording()), "../cam_params.json", "{"),
        "is no JSON",
    ),
    "Open3D with deep JSON": Case(
        holding(
            lambda to: write_open3d(to / "a", recording()), "camera_intrinsic.json", "[" * 100_000
        ),
        "camera_intrinsic.json",
    ),
    # Neither.
    "an empty folder": Case(lambda to: to, "no known recording"),
    "a film": Case(file("a.mp4", b"\0\0\0 ftypisom" + bytes(1000)), "no known recording"),
}


def _without_file(path: Path) -> Path:
    file_of(path).unlink()
    return path


def _without_depth(path: Path) -> Path:
    for each in path.glob("*.depth.png"):
        each.unlink()
    return path


def _with(path: Path, name: str, content: str) -> Path:
    (path / name).write_text(content)
    return path


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """What the command says of each, by the kind of damage."""
    if not Path("/proc/self/statm").exists():
        pytest.skip("memory can be limited on Linux only")
    home = tmp_path_factory.mktemp("corrupted")
    paths = {}
    for number, (name, case) in enumerate(CASES.items()):
        folder = home / f"case{number}"
        folder.mkdir()
        paths[name] = str(case.make(folder))
    whole = str(make_sequence(home / "whole", frames=5))
    (home / "out").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input=json.dumps([str(home / "out"), MOST_MEMORY, whole, paths]),
        capture_output=True,
        text=True,
        # Else each thread reserves 128 MB by itself.
        env=os.environ | {"MALLOC_ARENA_MAX": "1"},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, dict] = json.loads(done.stdout.splitlines()[-1])
    for name, path in paths.items():
        found[name]["path"] = path
    return found


def test_there_are_enough() -> None:
    assert len(CASES) >= 20


@pytest.mark.parametrize("name", CASES)
def test_it_is_said_in_a_line(results: dict[str, dict], name: str) -> None:
    case, found = CASES[name], results[name]
    assert found["grown"] < MOST_RESIDENT
    for command in ("info", "run"):
        status, _, err = found[command]
        # What is wrong with single frames `info` tells among its warnings.
        assert status in ((0,) if case.frames_left else (1,) if command == "run" else (0, 1)), err
        lines = err.splitlines()
        assert all(line.startswith(("edvo: ", "warning: ", "skipped")) for line in lines), err
        assert not status or lines[-1].startswith("edvo: ")
    _, out, err = found["run"]
    lines = err.splitlines()
    assert any(case.words in line for line in lines), err
    if case.frames_left:
        assert sum(case.words in line for line in lines) == 1
    elif found["written"]:
        assert "no frame could be read" in lines[-1]
    else:
        path = Path(found["path"])
        assert path.name in err or path.parent.name in err
        assert (len(lines), out) == (1, "")
