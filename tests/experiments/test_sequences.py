"""Which sequence is which, and that stand-ins say that they are."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
import pytest

from edvo.datasets.incomplete import INCOMPLETE
from edvo.errors import DatasetError, SceneError
from edvo.experiments import sequences as module
from edvo.experiments.bench import Bench
from edvo.experiments.sequences import (
    PAPER_SEQUENCES,
    FrameMemory,
    Loaded,
    find_recordings,
    paper_name,
    short_name,
)
from edvo.frame import Frame

from .tiny import CAMERA, tiny_bench, write_recording


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("rgbd_dataset_freiburg3_structure_texture_far", "fr3/structure_texture_far"),
        ("tum_fr3_structure_notexture_far", "fr3/structure_notexture_far"),
        ("fr3_cabinet", "fr3/cabinet"),
        ("freiburg1_xyz", "fr1/xyz"),
        ("tum_fr3_cabinet_sparse", "fr3/cabinet_sparse"),
        (
            "rgbd_dataset_freiburg3_long_office_household_validation",
            "fr3/long_office_household_validation",
        ),
        ("icl_office_kt3", "icl_office_kt3"),
    ],
)
def test_names(folder: str, name: str) -> None:
    assert paper_name(folder) == name


def test_sparse_cabinet_stands_for_nothing_else() -> None:
    assert paper_name("tum_fr3_cabinet_sparse") not in PAPER_SEQUENCES


def test_short_names_are_the_papers() -> None:
    assert short_name("fr3/structure_notexture_near") == "fr3/ntxt/str/near"
    assert short_name("fr1/xyz") == "fr1/xyz"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A data folder with one of the paper's sequences, another one, and a file."""
    folder = tmp_path / "data"
    write_recording(folder / "rgbd_dataset_freiburg3_cabinet", frames=12)
    write_recording(folder / "hallway", frames=5)
    (folder / "README.md").write_text("not a recording\n")
    return folder


def test_found_by_name(data: Path) -> None:
    assert set(find_recordings(data)) == {"fr3/cabinet", "hallway"}


def test_the_folder_may_be_a_recording_itself(data: Path) -> None:
    assert set(find_recordings(data / "hallway")) == {"hallway"}


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"nowhere: no such folder"):
        find_recordings(tmp_path / "nowhere")


def test_nothing_in_it(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no recording in it"):
        find_recordings(tmp_path)


def test_real_where_there_are_and_labelled_stand_ins_elsewhere(data: Path, tmp_path: Path) -> None:
    bench = tiny_bench(tmp_path / "out", frames=3, data=data, limit=10)
    assert bench.names == (*PAPER_SEQUENCES, "hallway")
    labels = {sequence.name: sequence.label for sequence in bench.sequences()}
    assert labels["fr3/cabinet"] == "real, first 10 of 12 frames"
    assert labels["hallway"] == "real, 5 frames"
    assert labels["fr3/structure_texture_far"] == "stand-in: synthetic texture_far, 3 frames"
    assert [s.name for s in bench.sequences() if s.is_real] == ["fr3/cabinet", "hallway"]
    assert len(bench.sequence("fr3/cabinet").frames) == 10


def test_without_truth_it_is_not_used_and_that_is_said(data: Path, tmp_path: Path) -> None:
    (data / "hallway" / "groundtruth.txt").unlink()
    bench = tiny_bench(tmp_path / "out", data=data)
    assert "hallway" not in bench.names
    assert len(bench.notes) == 1
    assert "hallway" in bench.notes[0]
    assert "ground truth" in bench.notes[0]


def test_damaged_frames_are_counted(data: Path, tmp_path: Path) -> None:
    sorted((data / "hallway" / "rgb").iterdir())[2].write_bytes(b"no image")
    sequence = tiny_bench(tmp_path / "out", data=data).sequence("hallway")
    assert len(sequence.frames) == 4
    assert len(sequence.problems) == 1


def test_unknown_names(bench: Bench) -> None:
    with pytest.raises(DatasetError, match=r"no sequence 'fr9/moon'; there are fr3/"):
        bench.sequence("fr9/moon")
    with pytest.raises(SceneError, match="moon"):
        bench.sequence("moon")


def test_a_scene_by_name_is_no_row_of_the_tables(bench: Bench) -> None:
    assert bench.sequence("corridor").label.startswith("synthetic corridor")
    assert "corridor" not in bench.names


def test_rendered_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = []
    write = module.write_sequence

    def counting(*arguments: object, **more: object) -> object:
        written.append(arguments[1])
        return write(*arguments, **more)

    monkeypatch.setattr(module, "write_sequence", counting)
    name = "fr3/structure_notexture_far"
    first = tiny_bench(tmp_path, frames=3).sequence(name).frames
    again = tiny_bench(tmp_path, frames=3).sequence(name).frames
    assert len(written) == 1
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.grey, b.grey)
        np.testing.assert_array_equal(a.depth, b.depth)
    # Without its list it was not finished.
    (next((tmp_path / "sequences").iterdir()) / "rgb.txt").unlink()
    assert len(tiny_bench(tmp_path, frames=3).sequence(name).frames) == 3
    assert len(written) == 2
    # With the mark of an unfinished folder neither.
    (next((tmp_path / "sequences").iterdir()) / INCOMPLETE).write_text("interrupted")
    assert len(tiny_bench(tmp_path, frames=3).sequence(name).frames) == 3
    assert len(written) == 3
    forced = tiny_bench(tmp_path, frames=3, render_again=True)
    assert forced.sequence(name).frames
    forced.release()
    assert forced.sequence(name).frames
    assert len(written) == 4


def test_truth_belongs_to_the_frames(bench: Bench) -> None:
    sequence = bench.sequence("fr3/structure_notexture_far")
    for frame in sequence.frames:
        sequence.truth.at(frame.timestamp)


def test_relit(bench: Bench) -> None:
    sequence = bench.sequence("fr3/structure_notexture_far")
    relit = sequence.relit(0.5, seed=1)
    assert relit.label == f"{sequence.label}, changing light"
    assert relit.name == sequence.name
    greys = [frame.grey.mean() for frame in sequence.frames]
    changed = [frame.grey.mean() for frame in relit.frames]
    assert np.std(changed) > 5 * np.std(greys)
    pairs = list(zip(sequence.frames, relit.frames, strict=True))
    assert all(np.shares_memory(a.depth, b.depth) for a, b in pairs)
    again = sequence.relit(0.5, seed=1).frames
    assert all(np.array_equal(a.grey, b.grey) for a, b in zip(relit.frames, again, strict=True))


def frames(count: int) -> Loaded:
    frame = Frame(0.0, np.zeros((4, 4), np.uint8), np.ones((4, 4), np.float32))
    return Loaded((frame,) * count)


def test_memory_forgets_what_was_used_longest_ago() -> None:
    memory = FrameMemory(most=10)
    made = []

    def make(name: str, count: int) -> Loaded:
        made.append(name)
        return frames(count)

    for name, count in (("a", 4), ("b", 4), ("a", 4), ("c", 4), ("a", 4), ("b", 4)):
        assert len(memory.get(name, lambda n=name, c=count: make(n, c)).frames) == count
    assert made == ["a", "b", "c", "b"]
    assert len(memory.get("long", lambda: make("long", 20)).frames) == 20


def test_settings_tell_what_decides(tmp_path: Path, data: Path) -> None:
    plain = tiny_bench(tmp_path, frames=3).settings()
    assert plain == tiny_bench(tmp_path / "elsewhere", frames=3).settings()
    assert plain != tiny_bench(tmp_path, frames=4).settings()
    assert plain != tiny_bench(tmp_path, frames=3, seed=1).settings()
    assert plain != tiny_bench(tmp_path, frames=3, data=data).settings()


def test_another_recording_of_the_same_name_is_not_taken_for_it(tmp_path: Path, data: Path) -> None:
    def settings(folder: Path = data) -> dict[str, Any]:
        found = tiny_bench(tmp_path, frames=3, data=folder).settings()
        assert json.loads(json.dumps(found)) == found
        return found

    before = settings()
    assert before == settings()
    shutil.copytree(data, tmp_path / "elsewhere")
    assert settings(tmp_path / "elsewhere") != before
    for name in ("groundtruth.txt", "rgb.txt"):
        file = data / "hallway" / name
        file.write_text(file.read_text() + "# measured again\n")
        assert settings() != before
        before = settings()
    os.utime(file, ns=(0, 0))
    assert settings() != before


def test_camera_and_versions_decide_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = tiny_bench(tmp_path, frames=3).settings()
    longer = Bench(tmp_path, quick=True, stand_in_frames=3, camera=replace(CAMERA, fx=99.0))
    assert plain != longer.settings()
    for library in (np, numba, cv2):
        with monkeypatch.context() as patch:
            patch.setattr(library, "__version__", "0.0")
            assert plain != tiny_bench(tmp_path, frames=3).settings()


def test_remembered_once(bench: Bench) -> None:
    assert bench.remember("key", lambda: [1]) is bench.remember("key", lambda: [2])


def test_the_recordings_at_hand(real_data: Path, tmp_path: Path) -> None:
    bench = tiny_bench(tmp_path, data=real_data)
    real = {sequence.name for sequence in bench.sequences() if sequence.is_real}
    assert "fr3/structure_notexture_far" in real
    assert real <= set(bench.names)
    if "fr3/cabinet_sparse" in real and "fr3/cabinet" not in real:
        assert bench.sequence("fr3/cabinet").label.startswith("stand-in")
