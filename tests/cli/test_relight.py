"""`edvo relight` as from a shell."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from edvo.datasets import open_source
from edvo.synthesis.relight_models import LIGHT_MODELS

from .conftest import Command, Outcome, full_disk


def brightness(folder: Path) -> np.ndarray:
    source = open_source(folder)
    frames = [source.read(index).frame for index in range(len(source))]
    return np.array([frame.grey.mean() for frame in frames if frame is not None])


def assert_refused(done: Outcome, *words: str) -> None:
    assert done.status == 1
    assert done.out == ""
    assert done.err.startswith("edvo: ")
    assert done.err.count("\n") == 1
    for word in words:
        assert word in done.err


def test_only_the_colour_images_change(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    options = ("--model", "ambient+diffuse", "--frequency", 2, "--seed", 1, "--severity", 0.8)
    done = edvo("relight", whole_sequence, tmp_path / "a", *options)
    assert done.status == 0, done.err
    assert "36 images" in done.out
    for file in sorted(f for f in whole_sequence.rglob("*") if f.is_file()):
        name = file.relative_to(whole_sequence)
        same = (tmp_path / "a" / name).read_bytes() == file.read_bytes()
        assert same == (name.parent != Path("rgb")), name
    assert np.ptp(brightness(tmp_path / "a")) > 3 * np.ptp(brightness(whole_sequence))
    edvo("relight", whole_sequence, tmp_path / "b", *options)
    for file in (tmp_path / "a").rglob("*.png"):
        again = tmp_path / "b" / file.relative_to(tmp_path / "a")
        assert again.read_bytes() == file.read_bytes()


def test_the_light_jumps_when_told_to(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    # So slow a swing leaves nothing but the jumps, here given in no order.
    options = ("--model", "ambient", "--frequency", "0.001", "--jump", "1.21", "--jump", "0.62")
    assert edvo("relight", whole_sequence, tmp_path / "a", *options).status == 0
    ratio = brightness(tmp_path / "a") / brightness(whole_sequence)
    jumps = np.flatnonzero(np.abs(np.diff(np.log2(ratio))) > 0.1) + 1
    np.testing.assert_array_equal(jumps, [13, 25])  # the first frames after, at 20 Hz


def test_the_models_are_listed(edvo: Command) -> None:
    done = edvo("relight", "--list")
    assert done.status == 0
    assert [line.split()[0] for line in done.out.splitlines()] == list(LIGHT_MODELS)


def test_an_unknown_model_names_those_there_are(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    done = edvo("relight", whole_sequence, tmp_path / "a", "--model", "ambient+disco")
    assert_refused(done, "disco", *LIGHT_MODELS)
    assert not (tmp_path / "a").exists()


def test_an_unknown_camera_names_those_there_are(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    done = edvo("relight", whole_sequence, tmp_path / "a", "--camera", "leica")
    assert_refused(done, "leica", "tum-fr1")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("value", ["0", "-2", "nan", "inf"])
def test_a_frequency_that_cannot_be(
    edvo: Command, whole_sequence: Path, tmp_path: Path, value: str
) -> None:
    done = edvo("relight", whole_sequence, tmp_path / "a", "--frequency", value)
    assert_refused(done, "frequency", "above 0")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("value", ["nan", "inf", "-3"])
def test_a_jump_that_cannot_be(
    edvo: Command, whole_sequence: Path, tmp_path: Path, value: str
) -> None:
    done = edvo("relight", whole_sequence, tmp_path / "a", "--jump", value)
    assert_refused(done, "jump", value)
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("s", "a", "--severity", "-0.1"), "severity"),
        (("s", "a", "--severity", "1.5"), "severity"),
        (("s", "a", "--seed", "-1"), "seed"),
        (("s", "a", "--jump", "soon"), "jump"),
        (("s",), "--list"),
        ((), "--list"),
    ],
)
def test_wrong_usage(edvo: Command, arguments: tuple[str, ...], word: str) -> None:
    done = edvo("relight", *arguments)
    assert done.status == 2
    assert word in done.err


def test_a_filled_folder_needs_force(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "mine.txt").write_text("mine")
    assert_refused(edvo("relight", whole_sequence, tmp_path / "a"), "--force")
    assert [file.name for file in (tmp_path / "a").iterdir()] == ["mine.txt"]
    assert edvo("relight", whole_sequence, tmp_path / "a", "--force").status == 0
    assert (tmp_path / "a" / "mine.txt").read_text() == "mine"


def test_the_source_is_never_written_over(edvo: Command, sequence: Path) -> None:
    before = {file: file.read_bytes() for file in sequence.rglob("*.*")}
    assert_refused(edvo("relight", sequence, sequence, "--force"), "source itself")
    assert {file: file.read_bytes() for file in sequence.rglob("*.*")} == before


def test_a_source_without_depth(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "depth.txt").unlink()
    shutil.rmtree(sequence / "depth")
    refused = edvo("relight", sequence, tmp_path / "a", "--model", "diffuse")
    assert_refused(refused, "wall", "depth", "without 'diffuse'")
    assert not (tmp_path / "a").exists()
    assert edvo("relight", sequence, tmp_path / "a", "--model", "ambient").status == 0


def test_a_source_that_is_none(edvo: Command, tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    assert_refused(edvo("relight", tmp_path / "s", tmp_path / "a"), "rgb.txt")
    assert_refused(edvo("relight", tmp_path / "t", tmp_path / "a"), "rgb.txt")
    assert not (tmp_path / "a").exists()


def test_a_target_that_is_a_file(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    assert_refused(edvo("relight", whole_sequence, tmp_path / "a"), "another folder")
    assert (tmp_path / "a").read_text() == "mine"


def test_an_image_that_is_damaged_is_named(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "rgb/7.png").write_bytes(b"")
    done = edvo("relight", sequence, tmp_path / "a")
    assert done.status == 0
    assert "35 images" in done.out
    assert "rgb/7.png is empty" in done.err


@pytest.mark.parametrize("files", [1, 20, 74, 76])  # of mark, 72 images, truth, camera, lists
def test_a_full_disk_leaves_nothing_that_looks_whole(
    edvo: Command, whole_sequence: Path, tmp_path: Path, files: int
) -> None:
    target = tmp_path / "a"
    assert edvo("relight", whole_sequence, target, "--model", "ambient").status == 0
    with full_disk(files):
        done = edvo("relight", whole_sequence, target, "--force")
    assert_refused(done, "No space left", str(target))
    assert not all((target / name).exists() for name in ("rgb.txt", "depth.txt"))
    assert not list(target.rglob(".*"))
    assert edvo("info", target).status == 1
    assert edvo("relight", whole_sequence, target, "--force").status == 0
    assert edvo("info", target).status == 0
