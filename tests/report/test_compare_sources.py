"""What counts as a source among the paths that a shell's pattern gives."""

from pathlib import Path

import pytest

from edvo.errors import DatasetError, SceneError
from edvo.report.compare_sources import find_sources, open_any

SMALL = """width: 40
height: 30
fx: 33.5
fy: 33.7
cx: 19.5
cy: 14.5
depth_scale: 5000
"""


def recording(folder: Path) -> Path:
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        (folder / f"{kind}.txt").write_text(f"1.0 {kind}/1.png\n")
    return folder


@pytest.fixture
def data(tmp_path: Path) -> Path:
    recording(tmp_path / "desk")
    recording(tmp_path / "room")
    (tmp_path / "README.md").write_text("read me\n")
    (tmp_path / "targets.json").write_text("{}\n")
    (tmp_path / "empty").mkdir()
    return tmp_path


def test_what_is_no_recording_among_several_is_noted_and_left_out(data: Path) -> None:
    notes: list[str] = []
    found = find_sources([str(path) for path in sorted(data.iterdir())], note=notes.append)
    assert found == [str(data / "desk"), str(data / "room")]
    assert len(notes) == 3
    assert all("left out" in note and "\n" not in note for note in notes)


def test_a_folder_of_recordings_stands_for_them(data: Path) -> None:
    notes: list[str] = []
    found = find_sources([str(data), str(data / "desk")], note=notes.append)
    assert found == [str(data / "desk"), str(data / "room")]
    assert not notes


def test_a_scene_needs_no_file(data: Path) -> None:
    assert find_sources(["synth:texture_far"], note=pytest.fail) == ["synth:texture_far"]


def test_nothing_left_is_an_error(data: Path) -> None:
    notes: list[str] = []
    with pytest.raises(DatasetError, match="no recording among them"):
        find_sources([str(data / "README.md"), str(data / "empty")], note=notes.append)


def test_one_that_is_none_says_what_it_should_be(data: Path) -> None:
    with pytest.raises(DatasetError, match="known formats are"):
        find_sources([str(data / "README.md")], note=pytest.fail)


def test_a_path_that_is_not_there_is_an_error_even_among_several(data: Path) -> None:
    with pytest.raises(DatasetError, match="desc: no such file"):
        find_sources([str(data / "desk"), str(data / "desc")], note=pytest.fail)


def test_a_scene_is_rendered_with_the_camera_asked_for(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    camera = str(tmp_path / "small.yaml")
    source = open_any("synth:notexture_far", camera=camera, frames=4, seed=3)
    assert (len(source), source.camera.width) == (4, 40)
    assert source.ground_truth is not None
    other = open_any("synth:notexture_far", camera=camera, frames=4, seed=4)
    assert (other.ground_truth.poses[-1] != source.ground_truth.poses[-1]).any()  # type: ignore[union-attr]


@pytest.mark.parametrize("text", ["synth:", "synth:no_such_scene"])
def test_a_scene_that_is_not_there(text: str) -> None:
    with pytest.raises(SceneError):
        open_any(find_sources([text], note=pytest.fail)[0])


def test_light_is_put_on(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    options = {"camera": str(tmp_path / "small.yaml"), "frames": 20}
    plain = open_any("synth:notexture_far", **options)  # type: ignore[arg-type]
    lit = open_any("synth:notexture_far", light="ambient", severity=1.0, **options)  # type: ignore[arg-type]
    assert lit.name == "notexture_far+ambient"
    one, other = plain.read(4).frame, lit.read(4).frame
    assert one is not None
    assert other is not None
    assert (one.depth == other.depth).all()
    assert (one.grey != other.grey).any()
