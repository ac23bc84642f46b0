import logging
from pathlib import Path

import pytest

from edvo.datasets import formats, open_source, registry
from edvo.errors import DatasetError


class Other:
    name = "other"
    layout = "a file that ends in .other"

    def recognise(self, path):
        return "its name" if path.suffix == ".other" else None

    def open(self, path, *, camera):
        return ("opened", path.name, camera)


class Entry:
    def __init__(self, name, thing):
        self.name, self.thing = name, thing

    def load(self):
        if isinstance(self.thing, Exception):
            raise self.thing
        return self.thing


@pytest.fixture
def _other(monkeypatch):
    entries = [Entry("other", Other()), Entry("broken", ImportError("gone"))]
    monkeypatch.setattr(registry, "entry_points", lambda group: entries)


@pytest.mark.parametrize("mark", [b"", b"\xff\n\n" * 9, b"a" * 5000, b"one\nmore\n"])
def test_whatever_the_mark_of_an_unfinished_folder_holds_it_is_one_line(tmp_path, mark):
    (tmp_path / "INCOMPLETE.txt").write_bytes(mark)
    with pytest.raises(DatasetError, match="is incomplete") as refused:
        open_source(tmp_path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 1500


def test_a_missing_path_is_one_line(tmp_path):
    with pytest.raises(DatasetError, match="no such file or folder"):
        open_source(tmp_path / "nowhere")


def test_what_no_format_knows_is_told_what_is_known(tmp_path):
    with pytest.raises(DatasetError, match=r"tum: a folder with rgb\.txt and depth\.txt"):
        open_source(tmp_path)
    (tmp_path / "video.mp4").write_bytes(b"")
    with pytest.raises(DatasetError, match="no known recording"):
        open_source(tmp_path / "video.mp4")


def test_a_format_can_be_forced(make_folder, tmp_path):
    folder = make_folder()
    assert open_source(folder, format="tum").format == "tum"
    with pytest.raises(DatasetError, match=r"choose one of .*\btum\b"):
        open_source(folder, format="video")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DatasetError, match=r"rgb\.txt is missing"):
        open_source(tmp_path / "empty", format="tum")
    with pytest.raises(DatasetError, match="not a folder"):
        open_source(folder / "rgb.txt", format="tum")


def test_the_current_folder_has_a_name(make_folder, monkeypatch):
    monkeypatch.chdir(make_folder("freiburg1_here"))
    assert open_source(".").name == "freiburg1_here"
    assert open_source(Path()).name == "freiburg1_here"


@pytest.mark.usefixtures("_other")
def test_another_package_adds_a_format(tmp_path, caplog):
    (tmp_path / "a.other").write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        assert open_source(tmp_path / "a.other") == ("opened", "a.other", None)
    assert "broken does not load" in caplog.text
    assert [known.name for known in formats()][-1] == "other"
