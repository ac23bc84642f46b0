"""Fetching sequences: the catalogue, checksums, and folders that are whole or not there."""

import gzip
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from edvo.datasets import open_source
from edvo.datasets.fetching import Watch, archive, catalogue, fetch, find
from edvo.datasets.fetching.checksums import check_sum, remember, remembered, sum_in
from edvo.datasets.fetching.sequence import RECORD
from edvo.datasets.known_cameras import recognise_camera
from edvo.errors import DatasetError, OutputError

from . import fetch_server as web

RPY = find("fr1/rpy")  # no sum of it is in the catalogue
XYZ = find("fr1/xyz")
BALLOON = find("bonn/balloon")
OFFICE = find("icl/of_kt1n")


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    with web.serving(monkeypatch) as server:
        yield server


@pytest.fixture
def recording(make_folder, tmp_path_factory):
    folder = shutil.move(make_folder(), tmp_path_factory.mktemp("recording") / "sequence")
    (folder / "groundtruth.txt").write_text("1.0 0 0 0 0 0 0 1\n1.1 0 0 0 0 0 0 1\n")
    return folder


@pytest.fixture
def rpy(server, recording):
    """The archive of `RPY`, on the server."""
    content = web.tgz(recording, top=RPY.folder)
    server.files[f"/{RPY.archive}"] = content
    return content


class Notes(list[str]):
    def watch(self) -> Watch:
        return Watch(note=self.append)


def get(server, out, entry=RPY, **options):
    return fetch(entry, out, mirror=server.url, **options)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def same_files(one: Path, other: Path) -> bool:
    def files(folder: Path) -> dict[str, bytes]:
        return {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file() and path.name != RECORD
        }

    return files(one) == files(other)


# The catalogue


def test_each_sequence_is_there_once():
    entries = catalogue()
    assert len(entries) == 47 + 16 + 26
    for kind in ("name", "url", "folder", "file"):
        assert len({getattr(entry, kind) for entry in entries}) == len(entries)


@pytest.mark.parametrize("entry", catalogue(), ids=lambda entry: entry.name)
def test_entries_are_as_they_must_be(entry):
    assert entry.url.startswith("https://")
    assert re.fullmatch(r"[A-Za-z0-9_]+\.(tgz|tar\.gz|zip)", entry.file)
    assert re.fullmatch(r"[a-z0-9_]+", entry.folder)
    assert entry.sha256 is None or check_sum(entry.sha256) == entry.sha256
    assert entry.size is None or 1e8 < entry.size < 1e10
    assert entry.data_set.licence
    # The reader tells the camera by the folder's name.
    camera = {"fr": f"tum-fr{entry.name[2]}", "ic": "icl-nuim", "bo": "bonn"}[entry.name[:2]]
    assert recognise_camera(Path(entry.folder))[0].name == camera


def test_it_is_part_of_the_package():
    text = Path(archive.__file__).with_name("catalogue.yaml").read_text()
    assert text.count("sha256: ") == sum(entry.sha256 is not None for entry in catalogue())


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("fr1/xyz", "fr1/xyz"),
        ("fr1_xyz", "fr1/xyz"),
        ("FR1-XYZ", "fr1/xyz"),
        ("tum_fr1_xyz", "fr1/xyz"),
        ("freiburg1_xyz", "fr1/xyz"),
        ("rgbd_dataset_freiburg1_xyz", "fr1/xyz"),
        ("rgbd_dataset_freiburg1_xyz/", "fr1/xyz"),
        ("rgbd_dataset_freiburg1_xyz.tgz", "fr1/xyz"),
        ("fr2/360_hemisphere", "fr2/360_hemisphere"),
        ("bonn/balloon2", "bonn/balloon2"),
        ("rgbd_bonn_balloon2", "bonn/balloon2"),
        ("icl/lr_kt2", "icl/lr_kt2"),
        ("living_room_traj2_frei_png", "icl/lr_kt2"),
        ("traj3n_frei_png.tar.gz", "icl/of_kt3n"),
        ("office_traj3n_frei_png", "icl/of_kt3n"),
    ],
)
def test_names_are_found_however_they_are_written(name, found):
    assert find(name).name == found


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("fr1/xzy", "fr1/xyz"),
        ("fr3/long_office", "fr3/long_office_household"),
        ("balloon", "bonn/balloon"),
        ("kt3", "icl/lr_kt3"),
        ("freiburg3_structure_no_texture_far", "fr3/structure_notexture_far"),
    ],
)
def test_names_that_are_not_there_bring_those_that_are(name, near):
    with pytest.raises(DatasetError, match=f"no sequence '{name}' to fetch; did you mean.*{near}"):
        find(name)


@pytest.mark.parametrize("name", ["", "/", "zzzzzzzz", "../../etc/passwd"])
def test_names_that_are_like_none(name):
    with pytest.raises(DatasetError, match="edvo fetch --list"):
        find(name)


# Checksums


def test_lists_of_sums(tmp_path):
    one, two = "a" * 64, "B" * 64
    listing = f"{one}  x.tgz\n{two} *folder/y.tgz\nwords\n{one[:-1]}  z.tgz\n"
    assert sum_in(listing, "x.tgz") == one
    assert sum_in(listing, "y.tgz") == two.lower()
    assert sum_in(listing, "z.tgz") is None
    remember(tmp_path, "x.tgz", one)
    remember(tmp_path, "y.tgz", one)
    remember(tmp_path, "x.tgz", two.lower())
    assert remembered(tmp_path, "x.tgz") == two.lower()
    assert (tmp_path / "SHA256SUMS").read_text() == f"{one}  y.tgz\n{two.lower()}  x.tgz\n"


@pytest.mark.parametrize("text", ["", "12", "g" * 64, "a" * 63])
def test_what_is_no_sum(text):
    with pytest.raises(DatasetError, match="is no SHA-256 checksum"):
        check_sum(text)


def test_sums_are_those_of_sha256sum(server, rpy, tmp_path):
    if shutil.which("sha256sum") is None:
        pytest.skip("sha256sum is not installed")
    get(server, tmp_path, keep_archive=True)
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=tmp_path, check=True)


# Sequences


def test_a_sequence(server, rpy, recording, tmp_path):
    notes, out = Notes(), tmp_path / "deep" / "out"
    done = get(server, out, watch=notes.watch())
    sha256 = hashlib.sha256(rpy).hexdigest()
    assert done.folder == out / RPY.folder
    assert (done.sha256, done.checked_by, done.new) == (sha256, None, True)
    assert same_files(done.folder, recording)
    assert names(out) == sorted(["SHA256SUMS", RPY.folder])
    record = json.loads((done.folder / RECORD).read_text())
    assert record["url"] == server.url + RPY.archive
    assert record["sha256"] == sha256
    assert record["licence"] == "CC BY 4.0"
    assert any("no checksum" in note and "SHA256SUMS" in note for note in notes)
    source = open_source(done.folder)
    assert source.format == "tum"
    assert len(source) == 3


def test_what_is_whole_is_not_fetched_again(server, rpy, tmp_path):
    get(server, tmp_path)
    server.asked.clear()
    notes = Notes()
    done = get(server, tmp_path, watch=notes.watch())
    assert not done.new
    assert not server.asked
    assert notes == [f"{tmp_path / RPY.folder} is complete: not fetched again"]
    # What a user puts there does no harm.
    (done.folder / "notes.txt").write_text("mine")
    assert not get(server, tmp_path).new


def test_what_has_lost_files_is_said(server, rpy, tmp_path):
    folder = get(server, tmp_path).folder
    (folder / "rgb" / "1.png").unlink()
    with pytest.raises(DatasetError, match=r"is not whole: 9 of 10 files.*remove"):
        get(server, tmp_path)


def test_what_was_cut_is_said(server, rpy, tmp_path):
    folder = get(server, tmp_path).folder
    (folder / "rgb" / "1.png").write_bytes(b"")
    with pytest.raises(DatasetError, match=r"is not whole: 10 of 10 files"):
        get(server, tmp_path)


def test_a_folder_from_elsewhere_is_taken_as_it_is(server, rpy, recording, tmp_path):
    shutil.copytree(recording, tmp_path / "out" / RPY.folder)
    notes = Notes()
    done = get(server, tmp_path / "out", watch=notes.watch())
    assert (done.new, done.sha256) == (False, None)
    assert "whether it is whole, nothing tells" in notes[0]
    assert not server.asked


def test_a_folder_that_is_none_is_left_alone(server, rpy, tmp_path):
    (tmp_path / RPY.folder).mkdir()
    (tmp_path / RPY.folder / "mine.txt").write_text("mine")
    with pytest.raises(DatasetError, match="is there and cannot be read"):
        get(server, tmp_path)
    assert names(tmp_path / RPY.folder) == ["mine.txt"]


def test_an_empty_folder_is_filled(server, rpy, tmp_path):
    (tmp_path / RPY.folder).mkdir()
    assert get(server, tmp_path).new


def test_a_file_in_the_way(server, rpy, tmp_path):
    (tmp_path / RPY.folder).write_text("mine")
    with pytest.raises(OutputError, match="is in the way"):
        get(server, tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError):
        get(server, tmp_path / "file")


def test_a_flat_mirror(server, recording, tmp_path):
    server.files[f"/some/where/{RPY.file}"] = web.tgz(recording, top=RPY.folder)
    assert fetch(RPY, tmp_path, mirror=server.url + "some/where").new
    assert [path for path, _ in server.asked] == [
        f"/some/where/{RPY.archive}",
        f"/some/where/{RPY.file}",
        "/some/where/SHA256SUMS",
    ]


def test_an_archive_that_is_kept_serves_again(server, rpy, tmp_path):
    get(server, tmp_path / "one", keep_archive=True)
    assert names(tmp_path / "one") == sorted(["SHA256SUMS", RPY.folder, RPY.file])
    # That folder, put on a server, is a mirror with sums.
    server.files = {
        f"/{RPY.file}": (tmp_path / "one" / RPY.file).read_bytes(),
        "/SHA256SUMS": (tmp_path / "one" / "SHA256SUMS").read_bytes(),
    }
    done = get(server, tmp_path / "two")
    assert done.checked_by == server.url + "SHA256SUMS"


def test_an_archive_that_is_there_is_not_fetched(server, rpy, tmp_path):
    (tmp_path / RPY.file).write_bytes(rpy)
    assert fetch(RPY, tmp_path).new  # from no server at all
    assert not server.asked
    assert names(tmp_path) == sorted(["SHA256SUMS", RPY.folder, RPY.file])


def test_a_wrong_archive_that_is_there_is_not_removed(server, tmp_path):
    (tmp_path / RPY.file).write_bytes(b"mine")
    with pytest.raises(DatasetError, match=r"neither .*; remove .* to fetch it"):
        fetch(RPY, tmp_path)
    assert names(tmp_path) == [RPY.file]


def test_the_sum_of_the_user(server, rpy, tmp_path):
    right, wrong = hashlib.sha256(rpy).hexdigest(), "0" * 64
    with pytest.raises(DatasetError, match=f"wrong checksum of {RPY.file}: {right} instead of 000"):
        get(server, tmp_path, checksum=wrong)
    assert names(tmp_path) == []
    done = get(server, tmp_path, checksum="SHA256:" + right.upper())
    assert done.checked_by == "--checksum"
    with pytest.raises(DatasetError, match=f"is from an archive of checksum {right}, not 000"):
        get(server, tmp_path, checksum=wrong)


def test_the_sum_of_the_catalogue(server, recording, tmp_path):
    content = web.tgz(recording, top=XYZ.folder)
    server.files[f"/{XYZ.archive}"] = content
    with pytest.raises(DatasetError, match=f"instead of {XYZ.sha256} .edvo's catalogue"):
        get(server, tmp_path, XYZ)
    assert names(tmp_path) == []
    # A user who knows better.
    done = get(server, tmp_path, XYZ, checksum=hashlib.sha256(content).hexdigest())
    assert done.checked_by == "--checksum"


def test_the_sum_of_the_mirror(server, rpy, tmp_path):
    server.files["/freiburg1/SHA256SUMS"] = f"{'0' * 64}  {RPY.file}\n".encode()
    with pytest.raises(DatasetError, match=r"instead of 000.*freiburg1/SHA256SUMS"):
        get(server, tmp_path)
    assert names(tmp_path) == []


def test_the_sum_of_the_first_time(server, rpy, recording, tmp_path):
    get(server, tmp_path)
    shutil.rmtree(tmp_path / RPY.folder)
    assert get(server, tmp_path).checked_by == str(tmp_path / "SHA256SUMS")
    shutil.rmtree(tmp_path / RPY.folder)
    (recording / "new.txt").write_text("published anew")
    server.files[f"/{RPY.archive}"] = web.tgz(recording, top=RPY.folder)
    with pytest.raises(DatasetError, match="wrong checksum"):
        get(server, tmp_path)
    new = hashlib.sha256(server.files[f"/{RPY.archive}"]).hexdigest()
    assert get(server, tmp_path, checksum=new).new
    assert remembered(tmp_path, RPY.file) == new


@pytest.mark.parametrize(
    "evil",
    [
        web.tar_of(web.member("a/b", b"1"), web.member("../../evil", b"2")),
        web.tar_of(web.member("a/b", type=b"2", linkname="/etc/passwd")),
        b"<html>",
        gzip.compress(b"words" * 1000),
        web.tar_of(web.member("a/readme.txt", b"no recording")),
        web.tar_of(),
    ],
    ids=["out", "link", "page", "gzip", "other", "empty"],
)
def test_evil_archives_leave_nothing(server, tmp_path, evil):
    server.files[f"/{RPY.archive}"] = evil
    with pytest.raises(DatasetError, match=r"; it is removed$") as caught:
        get(server, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["out"]
    assert names(tmp_path / "out") == []


def test_images_that_cannot_be_read(server, recording, tmp_path):
    (recording / "rgb" / "0.png").write_bytes(b"no image")
    server.files[f"/{RPY.archive}"] = web.tgz(recording, top=RPY.folder)
    with pytest.raises(DatasetError, match="cannot be read"):
        get(server, tmp_path)


def test_what_a_killed_process_left_is_cleared_away(server, rpy, tmp_path):
    left = tmp_path / f".{RPY.folder}.unpacking" / "all"
    left.mkdir(parents=True)
    (left / "half.png").write_bytes(b"half")
    assert get(server, tmp_path).new
    assert names(tmp_path) == sorted(["SHA256SUMS", RPY.folder])


def test_two_at_once(server, rpy, tmp_path):
    pytest.importorskip("fcntl")
    code = (
        "import sys, fcntl, time; stream = open(sys.argv[1], 'w'); "
        "fcntl.flock(stream, fcntl.LOCK_EX); print('locked', flush=True); sys.stdin.read()"
    )
    lock = tmp_path / f".{RPY.folder}.lock"
    with subprocess.Popen(
        [sys.executable, "-c", code, lock], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout.readline() == b"locked\n"
        with pytest.raises(OutputError, match="another edvo fetch is at fr1/rpy"):
            get(server, tmp_path)
        other.stdin.close()
    assert get(server, tmp_path).new


def test_an_interruption_while_unpacking_keeps_the_archive(server, rpy, tmp_path):
    def interrupt(what: str, done: int, total: int | None) -> None:
        if what.startswith("unpacking"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        get(server, tmp_path, watch=Watch(progress=interrupt))
    assert names(tmp_path) == [RPY.file]
    server.asked.clear()
    assert get(server, tmp_path).new
    assert not server.asked


def test_an_interruption_while_fetching_keeps_the_part(server, rpy, tmp_path):
    def interrupt(what: str, done: int, total: int | None) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        get(server, tmp_path, watch=Watch(progress=interrupt))
    assert names(tmp_path) == [f"{RPY.file}.part", f"{RPY.file}.part.json"]
    assert get(server, tmp_path).new
    assert names(tmp_path) == sorted(["SHA256SUMS", RPY.folder])
    assert server.asked[1][1] is not None


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_a_folder_that_may_not_be_written(server, rpy, tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot write into"):
        get(server, tmp_path)


def test_bonn(server, recording, tmp_path):
    server.files[f"/{BALLOON.file}"] = web.zipped(recording, top=BALLOON.folder)
    done = get(server, tmp_path, BALLOON)
    assert done.folder.name == "rgbd_bonn_balloon"
    assert open_source(done.folder).format == "bonn"


def make_icl(recording: Path, *, lists: bool) -> Path:
    """Make it as ICL-NUIM's archives are: numbers for times, and no lists of colour and depth."""
    shutil.copy(recording / "groundtruth.txt", recording / "traj1n.gt.freiburg")
    (recording / "traj1n.gt.freiburg").write_text("1 0 0 0 0 0 0 1\n2 0 0.5 0 0 0 0 1\n")
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        (recording / name).unlink()
    rows = [f"{index} depth/{index}.png {index} rgb/{index}.png\n" for index in range(3)]
    if lists:
        (recording / "associations.txt").write_text("".join(rows))
    return recording


@pytest.mark.parametrize("lists", [True, False])
def test_icl_nuim(server, recording, tmp_path, lists):
    flat = web.tgz(make_icl(recording, lists=lists), top=None)
    server.files[f"/{OFFICE.file}"] = flat
    done = get(server, tmp_path, OFFICE)
    assert done.folder.name == "office_traj1n_frei_png"
    source = open_source(done.folder)
    assert source.format == "icl"
    assert tuple(source.stamps) == ("0", "1", "2")
    assert source.ground_truth.poses[1][1, 3] == -0.5  # y down
    assert not get(server, tmp_path, OFFICE).new
