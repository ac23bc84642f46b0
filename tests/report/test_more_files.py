"""What an earlier run wrote beside its results goes with it, and nothing else does."""

import json
from pathlib import Path
from typing import Any

import pytest

from edvo.errors import OutputError
from edvo.report import more_files as more_files_module
from edvo.report.more_files import more_files, name_files, names_to_be, settle


def summary(folder: Path, **values: Any) -> None:
    (folder / "summary.json").write_text(json.dumps({"edvo": "1", **values}))


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}


def test_what_is_named_is_removed(tmp_path: Path) -> None:
    (tmp_path / "colmap").mkdir()
    (tmp_path / "both").mkdir()
    for name in ("a.ply", "colmap/b.txt", "both/c.txt", "both/mine.txt", "mine.ply"):
        (tmp_path / name).write_text(name)
    summary(tmp_path, frames=3)
    name_files(tmp_path, ["a.ply", "colmap/b.txt", "both/c.txt", "a.ply"])
    assert more_files(tmp_path) == ["a.ply", "colmap/b.txt", "both/c.txt"]
    removed: list[str] = []
    settle(tmp_path, (), on_removed=removed.append)
    assert removed == ["a.ply", "colmap/b.txt", "both/c.txt"]
    assert files(tmp_path) == {"both/mine.txt", "mine.ply", "summary.json"}
    assert not (tmp_path / "colmap").exists()
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told == {"edvo": "1", "frames": 3, "more_files": []}


def test_nothing_outside_of_the_folder_is_touched(tmp_path: Path) -> None:
    outside, folder = tmp_path / "outside", tmp_path / "out"
    for each in (outside, folder, folder / "a folder"):
        each.mkdir()
    (outside / "mine.txt").write_text("mine")
    (folder / "linked").symlink_to(outside)
    (folder / "link.ply").symlink_to(outside / "mine.txt")
    (folder / "loop").symlink_to("loop")
    names = ["../outside/mine.txt", str(outside / "mine.txt"), "linked/mine.txt", "a folder"]
    more = ["./trajectory.txt", "no such", "", ".", "/", "nul\0", "x" * 5000, "link.ply", "linked"]
    more += ["loop", "loop/a.txt"]
    (folder / "trajectory.txt").write_text("new")
    summary(folder, more_files=[*names, *more])
    settle(folder, ["trajectory.txt"])
    assert (outside / "mine.txt").read_text() == "mine"
    assert files(folder) == {"trajectory.txt", "summary.json", "link.ply", "loop"}
    assert (folder / "linked").is_symlink()
    assert (folder / "a folder").is_dir()
    assert more_files(folder) == []


@pytest.mark.parametrize(
    "text",
    [
        '{"more_files": ["mine.txt"]}',  # of another program
        '{"edvo": "1", "more_files": "mine.txt"}',
        '{"edvo": "1", "more_files": ["mine.txt", 3]}',
        '["edvo", "mine.txt"]',
        '{"edvo": "1"}',
        "{",
        "[" * 100_000,
    ],
)
def test_what_is_no_summary_of_ours_names_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / "summary.json").write_text(text)
    (tmp_path / "mine.txt").write_text("mine")
    settle(tmp_path, ())
    assert (tmp_path / "mine.txt").exists()
    assert (tmp_path / "summary.json").read_text() == text


def test_what_cannot_be_removed_stays_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unlink = Path.unlink

    def refuse(self: Path, missing_ok: bool = False) -> None:
        if self.name == "a.ply":
            raise PermissionError(1, "Operation not permitted")
        unlink(self, missing_ok=missing_ok)

    for name in ("a.ply", "b.ply"):
        (tmp_path / name).write_text(name)
    summary(tmp_path, more_files=["a.ply", "b.ply"])
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(
        OutputError, match=r"cannot remove .*a\.ply, which is of an earlier run: Op"
    ):
        settle(tmp_path, ())
    assert more_files(tmp_path) == ["a.ply"]
    assert files(tmp_path) == {"a.ply", "summary.json"}
    monkeypatch.setattr(more_files_module, "write_atomically", full)
    summary(tmp_path, more_files=["a.ply", "b.ply"])
    with pytest.raises(OutputError, match=r"cannot remove .*a\.ply"):  # and not the second
        settle(tmp_path, ())


def full(path: Path, content: bytes | str) -> None:
    raise OutputError(f"cannot write {path}")


def test_what_is_written_stays_and_is_named(tmp_path: Path) -> None:
    for name in ("a.ply", "b.ply", "c.ply", "d.ply"):
        (tmp_path / name).write_text(name)
    summary(tmp_path, more_files=["a.ply", "b.ply"])
    # A file that edvo did not write is no business of the next run till it is overwritten.
    assert names_to_be(tmp_path, ["b.ply", "c.ply", "e.ply"]) == ["a.ply", "b.ply", "e.ply"]
    settle(tmp_path, (), ["b.ply", "c.ply"])
    assert files(tmp_path) == {"b.ply", "c.ply", "d.ply", "summary.json"}
    assert more_files(tmp_path) == ["b.ply", "c.ply"]
