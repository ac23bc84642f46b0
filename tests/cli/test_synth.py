"""`edvo synth` as from a shell."""

import os
import shlex
import shutil
import signal
from pathlib import Path
from typing import Any

import cv2
import pytest

from edvo.datasets import open_source

from .conftest import full_disk, interrupted

SMALL = """width: 80
height: 60
fx: 67
fy: 67
cx: 39.5
cy: 29.5
distortion: [0, 0, 0, 0, 0]
depth_scale: 5000
"""


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    file = tmp_path / "small.yaml"
    file.write_text(SMALL)
    return file


def test_a_sequence_is_written_and_can_be_opened(edvo: Any, tmp_path: Path, camera: Path) -> None:
    target = tmp_path / "s"
    options = ("--frames", 4, "--camera", camera, "--seed", 3, "--light", "ambient+diffuse")
    done = edvo("synth", "notexture_far", target, *options)
    assert done.status == 0, done.err
    assert "4 frames" in done.out
    source = open_source(target)
    assert len(source) == 4
    assert source.camera.width == 80
    assert source.read(3).problem is None
    assert "--seed 3" in (target / "README.txt").read_text()
    again = edvo("synth", "notexture_far", tmp_path / "t" / "s", *options)
    assert again.status == 0, again.err
    for file in sorted(target.rglob("*.*")):
        assert file.read_bytes() == (tmp_path / "t" / "s" / file.relative_to(target)).read_bytes()


def test_a_camera_as_real_ones_are(edvo: Any, tmp_path: Path, camera: Path) -> None:
    options = ("--frames", 3, "--camera", camera, "--speed", 1.0, "--light", "ambient")
    assert edvo("synth", "cabinet", tmp_path / "plain", *options).status == 0
    plain = cv2.imread(str(tmp_path / "plain" / "rgb" / "0.066667.png"))
    for name, more in {
        "blurred": ("--exposure", 0.03),
        "rolling": ("--readout", 0.03),
        "following": ("--auto-exposure",),
        "jumping": ("--jump", 0.05),
    }.items():
        done = edvo("synth", "cabinet", tmp_path / name, *options, *more)
        assert done.status == 0, done.err
        image = cv2.imread(str(tmp_path / name / "rgb" / "0.066667.png"))
        assert (image != plain).mean() > 0.05, name
        assert " ".join(map(str, more)) in (tmp_path / name / "README.txt").read_text()
    done = edvo("synth", "cabinet", tmp_path / "apart", *options, "--depth-delay", 0.01)
    assert done.status == 0, done.err
    stamps = [path.stem for path in sorted((tmp_path / "apart" / "depth").iterdir())]
    delays = [float(stamp) - k / 30 for k, stamp in enumerate(stamps)]
    assert delays == pytest.approx([0.01] * 3, abs=0.005)
    assert open_source(tmp_path / "apart").read(1).problem is None


def test_a_scene_of_ones_own_with_a_mesh(edvo: Any, tmp_path: Path, camera: Path) -> None:
    pytest.importorskip("trimesh", reason="reading mesh files needs edvo[mesh]")
    (tmp_path / "roof.obj").write_text("v -1 0 0\nv 1 0 0\nv 0 0 2\nf 1 2 3\n")
    scene = tmp_path / "mine.yaml"
    scene.write_text(
        "materials: {grey: {albedo: [0.5, 0.5, 0.5]}}\n"
        "shapes: [{shape: mesh, file: roof.obj, material: grey}]\n"
        "camera: {points: [[0, -3, 1], [0.1, -3, 1]], targets: [[0, 0, 1], [0, 0, 1]]}\n"
    )
    more = ("--frames", 1, "--camera", camera, "--sensor", "ideal", "--trajectory", "still")
    done = edvo("synth", scene, tmp_path / "s", *more)
    assert done.status == 0, done.err
    frame = open_source(tmp_path / "s").read(0).frame
    assert frame is not None
    assert 0.05 < (frame.depth > 0).mean() < 0.5
    assert frame.depth.max() == pytest.approx(3.0, abs=0.1)
    (tmp_path / "roof.obj").unlink()
    refused = edvo("synth", scene, tmp_path / "t", *more)
    assert refused.status == 1
    assert "roof.obj" in refused.err
    assert not (tmp_path / "t").exists()


def test_a_filled_folder_needs_force(edvo: Any, tmp_path: Path, camera: Path) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "mine.txt").write_text("mine")
    options = ("synth", "cabinet", tmp_path / "s", "--frames", 1, "--camera", camera)
    refused = edvo(*options)
    assert refused.status == 1
    assert "--force" in refused.err
    assert edvo(*options, "--force").status == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("kitchen", "x"), ("kitchen", "office")),
        (("office", "x", "--light", "disco"), ("disco", "ambient")),
        (("office", "x", "--sensor", "lidar"), ("lidar", "kinect_v1")),
        (("office", "x", "--camera", "leica"), ("leica", "tum-fr1")),
        (("office", "x", "--trajectory", "flying"), ("flying", "handheld")),
        (("office", "x", "--speed", "-1"), ("speed", "-1")),
        (("office", "x", "--speed", "0"), ("speed", "0")),
        (("office", "x", "--frames", "0"), ("frames",)),
        (("office", "x", "--frames", "-5"), ("frames",)),
        (("office", "x", "--frequency", "0"), ("frequency", "above 0")),
        (("office", "x", "--frequency", "-2"), ("frequency", "above 0")),
        (("office", "x", "--severity", "2"), ("severity",)),
        (("office", "x", "--light", "ambient", "--jump", "nan"), ("jump", "nan")),
        (("office", "x", "--light", "ambient", "--jump", "-3"), ("jump", "-3")),
        (("office", "x", "--light", "ambient", "--jump", "inf"), ("jump", "inf")),
        (("office", "x", "--exposure", "-0.1"), ("exposure",)),
        (("office", "x", "--readout", "1"), ("readout",)),
        (("office", "x", "--depth-delay", "0.5"), ("depth-delay",)),
        (("office", "x", "--seed", "-1"), ("seed",)),
        (("nowhere.yaml", "x"), ("nowhere.yaml",)),
        (("office", "x", "--camera", "nowhere.yaml"), ("nowhere.yaml",)),
        ((), ("SCENE", "--list")),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    edvo: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: Any, words: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    result = edvo("synth", *arguments)
    assert result.status != 0
    for word in words:
        assert word in result.err
    assert "Traceback" not in result.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", ["width: 0", "width: -80"])
def test_a_camera_without_size(edvo: Any, tmp_path: Path, camera: Path, size: str) -> None:
    camera.write_text(SMALL.replace("width: 80", size))
    done = edvo("synth", "cabinet", tmp_path / "s", "--camera", camera)
    assert done.status == 1
    assert "small.yaml" in done.err
    assert "width" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "s").exists()


def test_a_scene_of_no_size(edvo: Any, tmp_path: Path, camera: Path) -> None:
    scene = tmp_path / "mine.yaml"
    scene.write_text(
        "materials: {grey: {albedo: [0.5, 0.5, 0.5]}}\n"
        "shapes: [{shape: box, size: [1, 0, 1], material: grey}]\n"
        "camera: {points: [[0, 3, 1], [1, 3, 1]], targets: [[0, 0, 1], [0, 0, 1]]}\n"
    )
    done = edvo("synth", scene, tmp_path / "s", "--camera", camera)
    assert done.status == 1
    assert "mine.yaml" in done.err
    assert "shapes.0.box.size.1" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("files", [1, 4, 8, 9, 10, 11])  # mark, 6 images, camera, notes, lists
def test_a_full_disk_leaves_nothing_that_looks_whole(
    edvo: Any, tmp_path: Path, camera: Path, files: int
) -> None:
    target = tmp_path / "s"
    options = ("synth", "notexture_far", target, "--frames", 3, "--camera", camera, "--force")
    assert edvo(*options).status == 0
    with full_disk(files):
        done = edvo(*options)
    assert done.status == 1
    assert "No space left" in done.err
    assert str(target) in done.err
    assert done.err.count("\n") == 1
    assert not (target / "rgb.txt").exists()
    assert not list(target.rglob(".*"))
    told = edvo("info", target)
    assert told.status == 1
    assert "is incomplete: synthetic sequence" in told.err
    assert f"edvo synth notexture_far {target} " in told.err
    assert edvo(*options).status == 0
    assert edvo("info", target).status == 0


def test_a_disk_too_full_to_begin_leaves_what_was_whole(
    edvo: Any, tmp_path: Path, camera: Path
) -> None:
    target = tmp_path / "s"
    options = ("synth", "notexture_far", target, "--frames", 3, "--camera", camera, "--force")
    assert edvo(*options).status == 0
    with full_disk(0):
        assert edvo(*options, "--seed", 1).status == 1
    assert edvo("info", target).status == 0
    assert "--seed 0" in (target / "README.txt").read_text()


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_it_leaves_nothing_that_looks_whole(
    edvo: Any, tmp_path: Path, camera: Path, how: signal.Signals, status: int
) -> None:
    target = tmp_path / "s"
    change = "from edvo.cli import synth; synth.progress = progress"
    options = ("synth", "notexture_far", target, "--frames", 9, "--camera", camera)
    done = interrupted(change, *options, steps=2, how=how)
    assert done.status == status
    assert done.err == "edvo: interrupted\n"
    told = edvo("info", target)
    assert told.status == 1
    assert "is incomplete: synthetic sequence" in told.err


@pytest.mark.parametrize("named", ["sub/s", ".", "..", "../there", "linked"])
def test_a_folder_begun_says_how_to_write_it_again_from_anywhere(
    edvo: Any, tmp_path: Path, camera: Path, monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    place = tmp_path / "here"
    place.mkdir()
    (tmp_path / "elsewhere").mkdir()
    (place / "linked").symlink_to(tmp_path / "elsewhere")
    shutil.copy(camera, place / "own.yaml")
    (place / "mine.yaml").write_text("like: notexture_far\n")
    monkeypatch.chdir(place)
    options = ("--frames", 1, "--camera", "own.yaml", "--jump", 0.5, "--auto-exposure")
    with full_disk(2):
        assert edvo("synth", "mine.yaml", named, *options, "--force").status == 1
    folder = Path(os.path.normpath(place / named))
    mark = (folder / "INCOMPLETE.txt").read_text()
    words = shlex.split(mark.partition("to do it again: ")[2])
    assert words[:4] == ["edvo", "synth", str(place / "mine.yaml"), str(folder)]
    assert words[words.index("--camera") + 1] == str(place / "own.yaml")
    monkeypatch.chdir("/")
    again = edvo(*words[1:])
    assert again.status == 0, again.err
    made = (folder / "README.txt").read_text()
    assert f"mine.yaml {folder.name} --frames 1 --camera " in made
    monkeypatch.chdir(place)
    assert edvo("synth", "mine.yaml", named, *options, "--force").status == 0
    made = (folder / "README.txt").read_text()
    command = f"edvo synth mine.yaml {folder.name} --frames 1 --camera own.yaml "
    assert f"Made by: {command}" in made


def test_a_name_stays_a_name_in_the_command(edvo: Any, tmp_path: Path) -> None:
    with full_disk(2):
        edvo("synth", "notexture_far", tmp_path / "s", "--frames", 1, "--camera", "tum-fr1")
    mark = (tmp_path / "s/INCOMPLETE.txt").read_text()
    assert " notexture_far " in mark
    assert " --camera tum-fr1 " in mark


def test_the_list_comes_with_thumbnails(edvo: Any, tmp_path: Path) -> None:
    result = edvo("synth", "--list", "--sheet", tmp_path / "sheet.png")
    assert result.status == 0, result.err
    for name in ("notexture_far", "office", "white_wall"):
        assert name in result.out
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[1] == 1080
