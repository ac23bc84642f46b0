import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from edvo.errors import OutputError
from edvo.files import output_folder, write_atomically

unless_root = pytest.mark.skipif(
    hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write everywhere"
)


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    yield folder
    folder.chmod(0o700)


def test_text_and_bytes_are_written(tmp_path: Path) -> None:
    write_atomically(tmp_path / "text", "grün\n")
    write_atomically(str(tmp_path / "bytes"), b"\x00\r\n")
    assert (tmp_path / "text").read_bytes() == "grün\n".encode()
    assert (tmp_path / "bytes").read_bytes() == b"\x00\r\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bytes", "text"]


def test_what_stood_there_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "result"
    path.write_text("a much longer text than the new one")
    write_atomically(path, "new")
    assert path.read_text() == "new"


@pytest.mark.skipif(os.name != "posix", reason="rights are POSIX")
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_rights_follow_the_umask(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        write_atomically(tmp_path / "file", "x")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o666 & ~umask


def test_the_umask_of_the_process_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(mask: int) -> int:
        raise AssertionError("other threads would see it")

    monkeypatch.setattr(os, "umask", refuse)
    write_atomically(tmp_path / "file", "x")


def test_a_write_that_fails_leaves_the_old_file_and_nothing_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result"
    path.write_text("old")

    def no_room(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", no_room)
    with pytest.raises(
        OutputError, match=r"cannot write .*result: No space left on device; choose"
    ):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["result"]


def test_ctrl_c_in_the_middle_leaves_nothing_beside_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(self: Path, target: Path) -> Path:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "result", "new")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["missing/result", "", "folder"])
def test_places_that_cannot_be_files_are_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match=r"cannot write .*; choose a folder") as caught:
        write_atomically(tmp_path / name, "x")
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["folder"]


@unless_root
def test_a_folder_without_rights_is_named(locked: Path) -> None:
    with pytest.raises(OutputError, match="Permission denied"):
        write_atomically(locked / "result", "x")
    with pytest.raises(OutputError, match=r"cannot write into"):
        output_folder(locked)


def test_a_reader_sees_the_old_or_the_new_file_never_a_half(tmp_path: Path) -> None:
    path = tmp_path / "result"
    texts = {letter * 100_000 for letter in "ab"}
    write_atomically(path, "a" * 100_000)
    done = threading.Event()

    def write() -> None:
        for _ in range(50):
            for text in sorted(texts):
                write_atomically(path, text)
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    while not done.is_set():
        assert path.read_text() in texts
    writer.join()


def test_writers_at_the_same_time_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "result"
    failures: list[OutputError] = []

    def write(letter: str) -> None:
        try:
            for _ in range(20):
                write_atomically(path, letter * 10_000)
        except OutputError as error:
            failures.append(error)

    writers = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert not failures
    assert len(set(path.read_text())) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["result"]


def test_output_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    folder = output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert not list(folder.iterdir())
    assert output_folder(str(folder), must_be_empty=True) == folder


def test_output_folder_that_holds_something(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("x")
    assert output_folder(tmp_path) == tmp_path
    assert output_folder(tmp_path, must_be_empty=True, force=True) == tmp_path
    with pytest.raises(OutputError, match="is not empty; choose another folder or add --force"):
        output_folder(tmp_path, must_be_empty=True)


def test_output_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match=r"cannot write into .*; choose another folder"):
            output_folder(path)


def test_what_stands_in_the_way_of_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").mkdir()
    (tmp_path / "colmap").write_text("no folder")
    with pytest.raises(OutputError, match=r"poses\.txt: a folder stands there"):
        output_folder(tmp_path, files=["free.txt", "poses.txt"])
    with pytest.raises(OutputError, match=r"images\.txt: .*colmap is a file"):
        output_folder(tmp_path, files=["colmap/images.txt"])
    assert output_folder(tmp_path, files=["free.txt", "new/free.txt"]) == tmp_path
