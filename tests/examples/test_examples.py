"""The other examples, each run from its file."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edvo.synthesis.sequence import SyntheticSource, make_recipe, write_sequence
from edvo.trajectory import Trajectory

from . import stubs

LATE_S = 0.004  # depth after colour


@pytest.fixture(scope="module")
def source() -> SyntheticSource:
    return SyntheticSource(make_recipe("texture_near", frames=6, speed=0.3))


def test_each_is_python_that_compiles() -> None:
    files = sorted(stubs.EXAMPLES.glob("*.py"))
    assert [file.name for file in files] == ["realsense.py", "ros2_node.py", "tsdf_fusion.py"]
    for file in files:
        compile(file.read_text(encoding="utf-8"), file.name, "exec")


def test_readme_tells_of_each() -> None:
    text = (stubs.EXAMPLES / "README.md").read_text(encoding="utf-8")
    for file in stubs.EXAMPLES.iterdir():
        if file.suffix in (".py", ".ipynb"):
            assert f"({file.name})" in text


class Images:
    """Frames of pyrealsense2, as `align` gives them: 640x480, millimetres, ms."""

    def __init__(self, grey: Any, metres: Any, seconds: float) -> None:
        self._bgr = np.repeat(grey[:, :, None], 3, axis=2)
        self._depth = np.round(metres * 1000).astype(np.uint16)
        self._seconds = seconds

    def get_color_frame(self) -> "Image":
        return Image(self._bgr, self._seconds)

    def get_depth_frame(self) -> "Image":
        return Image(self._depth, self._seconds + LATE_S)


class Image:
    def __init__(self, values: Any, seconds: float) -> None:
        self._values, self._seconds = values, seconds

    def get_data(self) -> Any:
        return self._values

    def get_units(self) -> float:
        return 0.001

    def get_timestamp(self) -> float:
        return 1000 * self._seconds


def test_realsense_follows_and_writes_on_interrupt(
    source: SyntheticSource,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Pyrealsense2 itself has no pipeline without a device, so it is stood in for."""
    stopped = []
    camera = source.camera

    class Profile:
        def get_stream(self, stream: object) -> "Profile":
            return self

        as_video_stream_profile = property(lambda self: lambda: self)

        def get_intrinsics(self) -> Any:
            class Intrinsics:
                width, height = camera.width, camera.height
                fx, fy, ppx, ppy = camera.fx, camera.fy, camera.cx, camera.cy

            return Intrinsics

    class Pipeline:
        def __init__(self) -> None:
            self._next = 0

        def start(self, wanted: object) -> Profile:
            return Profile()

        def wait_for_frames(self) -> Images:
            if self._next == len(source):
                raise KeyboardInterrupt
            frame = source.read(self._next).frame
            self._next += 1
            assert frame is not None
            return Images(frame.grey, frame.depth, frame.timestamp)

        def stop(self) -> None:
            stopped.append(True)

    class Config:
        def enable_stream(self, *what: object) -> None:
            assert what[1:3] == (640, 480)

    class Align:
        def __init__(self, to: str) -> None:
            assert to == "colour"

        def process(self, images: Images) -> Images:
            return images

    class Stream:
        color, depth = "colour", "depth"

    class Format:
        bgr8, z16 = "bgr8", "z16"

    stubs.put(
        monkeypatch,
        "pyrealsense2",
        pipeline=Pipeline,
        config=Config,
        align=Align,
        stream=Stream,
        format=Format,
        pipeline_profile=Profile,
    )
    monkeypatch.chdir(tmp_path)
    example = stubs.load("realsense.py")
    assert next(example["frames"](Pipeline())).depth_delay == pytest.approx(LATE_S)
    example["main"]()
    out = capsys.readouterr().out.splitlines()
    assert stopped
    poses = Trajectory.read(tmp_path / "trajectory.txt")
    assert f"{len(poses)} poses" in out[-1]
    assert "tracked" in out[0]
    assert set(poses.timestamps.tolist()) <= set(source.timestamps.tolist())


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    def run(name: str, *arguments: object) -> None:
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        stubs.load(name)["main"](*map(str, arguments))

    return run


def test_tsdf_fusion_writes_a_surface_that_is_there(
    source: SyntheticSource, tmp_path: Path, script: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    open3d = pytest.importorskip("open3d", reason="pip install 'edvo[open3d]'")
    write_sequence(source, tmp_path / "sequence", command="a test")
    script("tsdf_fusion.py", tmp_path / "sequence", tmp_path / "mesh.ply")
    assert "of 2 frames" in capsys.readouterr().out
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    points = np.asarray(mesh.vertices)
    assert len(points) > 5000
    # The first camera is the world: points project into its depth image.
    first = min((tmp_path / "sequence/depth").iterdir())
    image = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
    assert image is not None
    camera = source.camera
    pixels = camera.project(points)
    seen = points[:, 2] > 0.1
    u, v = np.rint(pixels[seen]).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    depth = image[v[inside], u[inside]] / 5000.0
    off = np.abs(depth - points[seen][inside, 2])[depth > 0]
    assert np.median(off) < 0.02
