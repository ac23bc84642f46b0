import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.camera import Camera

from .conftest import CAMERA, HEIGHT, WIDTH, Command


def test_says_what_is_assumed(edvo: Command, whole_sequence: Path) -> None:
    done = edvo("info", whole_sequence)
    assert done.status == 0
    assert "format: tum" in done.out
    assert "frames: 36" in done.out
    assert "depth scale 5000" in done.out.replace("_", " ")
    (depth,) = (line for line in done.out.splitlines() if line.startswith("depth: "))
    told = json.loads(edvo("info", whole_sequence, "--json").out)["checks"]["depth range"]
    assert depth == (
        f"depth: {told['nearest_m']:.3g} to {told['farthest_m']:.3g} m, half of it beyond "
        f"{told['median_m']:.3g} m; {told['valid']:.1%} of the pixels have it"
    )
    assert 0 < told["nearest_m"] <= told["median_m"] <= told["farthest_m"]
    assert "warning" not in done.out
    assert "not checked: focal length: the camera turns too little" in done.out


def test_json_is_for_programs(edvo: Command, whole_sequence: Path) -> None:
    described = json.loads(edvo("info", whole_sequence, "--json").out)
    assert described["format"] == "tum"
    assert described["camera"]["fx"] == 150.0
    assert described["ground_truth"]["poses"] == 36
    assert abs(described["frame_rate_hz"] - 20.0) < 1e-6
    assert described["warnings"] == []
    assert described["checks"]["depth range"]["verdict"] == "sound"
    focal = described["checks"]["focal length"]
    assert focal["verdict"] == "not observable"
    assert "turns too little" in focal["why"]


def test_warns_of_a_depth_scale_that_cannot_be(edvo: Command, sequence: Path) -> None:
    (sequence / "camera.yaml").write_text(CAMERA.replace("depth_scale: 5000", "depth_scale: 500"))
    warned = edvo("info", sequence)
    assert warned.status == 0
    assert "depth_scale (500 now" in warned.out


def test_warns_of_stamps_that_repeat(edvo: Command, sequence: Path) -> None:
    lines = (sequence / "rgb.txt").read_text()
    (sequence / "rgb.txt").write_text(lines + lines.splitlines()[3] + "\n")
    done = edvo("info", sequence)
    assert done.status == 0
    assert "warning: rgb.txt" in done.out


@pytest.mark.parametrize(
    ("late", "told"),
    [
        (0.014, ["depth is 14 ms after colour (median of the stamps)"]),
        (-0.0085, ["depth is 8.5 ms before colour (median of the stamps)"]),
        (0.0, []),
    ],
)
def test_says_by_how_much_depth_is_later(
    edvo: Command, sequence: Path, late: float, told: list[str]
) -> None:
    rows = [line.split() for line in (sequence / "rgb.txt").read_text().splitlines()[1:]]
    times = {name: float(time) for time, name in rows}
    lines = [f"{time + late:.6f} {name.replace('rgb', 'depth', 1)}" for name, time in times.items()]
    (sequence / "depth.txt").write_text("\n".join(lines))
    done = edvo("info", sequence)
    assert [line for line in done.out.splitlines() if line.startswith("depth is")] == told
    checks = json.loads(edvo("info", sequence, "--json").out)["checks"]
    assert checks["depth delay"] == {"verdict": "sound", "median_s": late}


def test_says_in_how_many_frames_depth_repeats(edvo: Command, sequence: Path) -> None:
    assert "of the frames depth is" not in edvo("info", sequence).out  # that of a flat wall
    images = sorted((sequence / "depth").iterdir(), key=lambda path: int(path.stem))
    for index, image in enumerate(images):
        tilted = 5000 + 10 * np.arange(WIDTH) + index // 2
        cv2.imwrite(str(image), np.tile(tilted.astype(np.uint16), (HEIGHT, 1)))
    done = edvo("info", sequence)
    share = f"{(len(images) // 2) / (len(images) - 1):.0%}"
    assert f"in {share} of the frames depth is that of the frame before" in done.out.splitlines()
    checks = json.loads(edvo("info", sequence, "--json").out)["checks"]
    assert checks["repeated depth"]["verdict"] == "sound"


def test_a_camera_of_another_size_is_one_finding(edvo: Command, sequence: Path) -> None:
    half = Camera.from_yaml(sequence / "camera.yaml").scaled(0.5)
    half.to_yaml(sequence / "camera.yaml")
    (sequence / "rgb/3.png").write_bytes(b"")
    done = edvo("info", sequence)
    assert done.status == 0
    assert [line for line in done.out.splitlines() if line.startswith("warning")] == [
        f"warning: {sequence / 'rgb/3.png'} is empty",
        f"warning: images are {WIDTH} x {HEIGHT}, the camera is for {half.width} x {half.height}: "
        "give the camera of these images, or scale it with them: Camera.scaled(2)",
    ]
    checks = json.loads(edvo("info", sequence, "--json").out)["checks"]
    assert checks["size of images"]["verdict"] == "suspect"
    assert checks["readable images"] == {"verdict": "suspect", "unreadable": 1, "looked_at": 36}


def test_a_frame_of_another_size_is_told_as_one(edvo: Command, sequence: Path) -> None:
    for kind in ("rgb", "depth"):
        file = sequence / kind / "3.png"
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), cv2.resize(image, (80, 60), interpolation=cv2.INTER_NEAREST))
    done = edvo("info", sequence)
    (line,) = (line for line in done.out.splitlines() if line.startswith("warning"))
    assert "3.png is 80x60 and the camera is 160x120" in line


def test_many_damaged_images_are_a_few_lines(edvo: Command, sequence: Path) -> None:
    for index in range(3, 33):
        (sequence / f"rgb/{index}.png").write_bytes(b"no image")
    done = edvo("info", sequence)
    assert done.status == 0
    warnings = [line for line in done.out.splitlines() if line.startswith("warning: ")]
    told = [line for line in warnings if "damaged" in line or "skipped" in line]
    assert told[:5] == [
        f"warning: {sequence / f'rgb/{index}.png'} is damaged or no image" for index in range(3, 8)
    ]
    assert told[5:] == ["warning: skipped 30 frames in all, of 36 that were looked at"]
