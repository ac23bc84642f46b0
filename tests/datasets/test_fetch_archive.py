"""Archives as they should be, and those that want more than to be unpacked."""

import errno
import gzip
import io
import os
import stat
import struct
import tarfile
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from edvo.datasets.fetching import archive as archive_module
from edvo.datasets.fetching.archive import ArchiveError, unpack
from edvo.errors import OutputError

from . import fetch_server as web

TEXTS = {"rgb.txt": b"# list\n", "rgb/1.png": web.noise(3000), "rgb/2.png": b"", "a/b/c": b"x"}


@pytest.fixture
def unpacked(tmp_path):
    """Unpack bytes into a folder that lies beside nothing else."""

    def run(content: bytes, **options) -> dict[str, bytes]:
        archive = tmp_path / "evil.tgz"
        archive.write_bytes(content)
        folder = tmp_path / "inner" / "folder"
        folder.mkdir(parents=True)
        try:
            unpack(archive, folder, **options)
        finally:
            outside = [path for path in tmp_path.rglob("*") if not path.is_relative_to(folder)]
            assert set(outside) == {archive, folder.parent}
            assert all(path.is_dir() or path.is_file() for path in folder.rglob("*"))
            assert not any(path.is_symlink() for path in folder.rglob("*"))
        return {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }

    return run


def zip_of(members, **options) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, **options) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return buffer.getvalue()


def zip_info(name: str, mode: int) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return info


@pytest.mark.parametrize("format", [tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_tar(unpacked, format):
    folder = web.member("top", type=tarfile.DIRTYPE)
    files = [web.member(f"./{name}", content) for name, content in TEXTS.items()]
    assert unpacked(web.tar_of(folder, *files, format=format)) == TEXTS


def test_zip(unpacked):
    assert unpacked(zip_of([("empty/", b""), *TEXTS.items()])) == TEXTS


@pytest.mark.parametrize("format", [tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_names_that_need_a_header_of_their_own(unpacked, format):
    name = "/".join(["a" * 90, "ö" * 80, "c" * 100 + ".png"])
    members = web.member(name, b"long"), web.member("short", b"after it")
    assert unpacked(web.tar_of(*members, format=format)) == {name: b"long", "short": b"after it"}


def test_sizes_in_a_pax_header(unpacked):
    info, content = web.member("a", b"hello")
    info.pax_headers = {"size": "5", "comment": "x = y"}
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
        archive.addfile(info, io.BytesIO(content))
    assert unpacked(gzip.compress(buffer.getvalue())) == {"a": b"hello"}


def test_progress(unpacked):
    seen = []
    content = zip_of(TEXTS.items())
    unpacked(content, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (3008, 3008)
    assert seen == sorted(seen)


def test_what_macos_adds_is_left_out(unpacked):
    extra = {"__MACOSX/rgb/._1.png": b"?", "rgb/._1.png": b"??"}
    assert unpacked(zip_of([*TEXTS.items(), *extra.items()])) == TEXTS


def test_what_macos_adds_to_tar_is_left_out(unpacked):
    members = [web.member("._rgb", b"?" * 700), web.member("rgb/1", b"1")]
    assert unpacked(web.tar_of(*members)) == {"rgb/1": b"1"}


BAD_NAMES = [
    "../evil",
    "../../evil",
    "a/../../evil",
    "a/..",
    "/evil",
    "//evil",
    "..\\evil",
    "C:\\evil",
    "C:evil",
    "a/" * 40 + "evil",
    "a" * 300,
]


@pytest.mark.parametrize("name", BAD_NAMES, ids=range(len(BAD_NAMES)))
def test_names_that_lead_out(unpacked, name):
    with pytest.raises(
        ArchiveError, match=r"evil.tgz: '.*' in it would lie outside .*not unpacked"
    ):
        unpacked(web.tar_of(web.member("good", b"1"), web.member(name, b"2")))


@pytest.mark.parametrize("name", BAD_NAMES, ids=range(len(BAD_NAMES)))
def test_names_that_lead_out_of_a_zip(unpacked, name):
    with pytest.raises(ArchiveError, match="would lie outside"):
        unpacked(zip_of([("good", b"1"), (name, b"2")]))


def test_folders_that_lead_out(unpacked):
    with pytest.raises(ArchiveError, match="would lie outside"):
        unpacked(web.tar_of(web.member("../evil", type=tarfile.DIRTYPE)))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (tarfile.SYMTYPE, "a link"),
        (tarfile.LNKTYPE, "a link"),
        (tarfile.CHRTYPE, "a device"),
        (tarfile.BLKTYPE, "a device"),
        (tarfile.FIFOTYPE, "a pipe"),
        (tarfile.GNUTYPE_SPARSE, "a sparse file"),
        (b"V", "no recording needs"),
    ],
)
@pytest.mark.parametrize("target", ["/etc/passwd", "../..", "good"])
def test_what_is_neither_file_nor_folder(unpacked, kind, words, target):
    # A link, and a file to be written through it.
    members = web.member("x", type=kind, linkname=target), web.member("x/evil", b"2")
    with pytest.raises(ArchiveError, match=f"'x' in it is .*{words}; not unpacked"):
        unpacked(web.tar_of(web.member("good", b"1"), *members))


def test_links_in_a_zip(unpacked):
    with pytest.raises(ArchiveError, match="'x' in it is a link"):
        unpacked(zip_of([(zip_info("x", stat.S_IFLNK | 0o777), b"/etc/passwd")]))


def test_devices_in_a_zip(unpacked):
    with pytest.raises(ArchiveError, match="'x' in it is no file"):
        unpacked(zip_of([(zip_info("x", stat.S_IFCHR | 0o777), b"")]))


def test_encrypted_members(unpacked):
    content = bytearray(zip_of([("x", b"secret")]))
    at = content.index(b"PK\x01\x02") + 8
    content[at] |= 1
    with pytest.raises(ArchiveError, match="'x' in it is encrypted"):
        unpacked(bytes(content))


def test_a_name_twice(unpacked):
    with pytest.raises(ArchiveError, match="'a' is in it twice"):
        unpacked(web.tar_of(web.member("a", b"1"), web.member("a", b"2")))


def test_a_file_where_a_folder_is_needed(unpacked):
    with pytest.raises(ArchiveError, match="'a/b' is in it twice"):
        unpacked(web.tar_of(web.member("a", b"1"), web.member("a/b", b"2")))


def test_a_folder_where_a_file_is(unpacked):
    with pytest.raises(ArchiveError, match="'a' is in it twice"):
        unpacked(web.tar_of(web.member("a", b"1"), web.member("a", type=tarfile.DIRTYPE)))


def test_a_bomb_of_zeros(unpacked, monkeypatch):
    monkeypatch.setattr(archive_module, "SLACK_BYTES", 1 << 20)
    with pytest.raises(ArchiveError, match=r"would unpack to more than .* bytes, far too many"):
        unpacked(web.tar_of(web.member("zeros", bytes(20 << 20))))


def test_a_bomb_of_zeros_in_a_zip(unpacked, monkeypatch):
    monkeypatch.setattr(archive_module, "SLACK_BYTES", 1 << 20)
    with pytest.raises(ArchiveError, match="would unpack to more than"):
        unpacked(zip_of([("zeros", bytes(20 << 20))]))


def test_many_small_bombs(unpacked, monkeypatch):
    monkeypatch.setattr(archive_module, "SLACK_BYTES", 1 << 20)
    with pytest.raises(ArchiveError, match="would unpack to more than"):
        unpacked(zip_of([(str(index), bytes(1 << 18)) for index in range(40)]))


def test_zeros_after_the_end(unpacked, monkeypatch):
    monkeypatch.setattr(archive_module, "SLACK_BYTES", 1 << 20)
    plain = gzip.decompress(web.tar_of(web.member("a", b"1")))
    with pytest.raises(ArchiveError, match="does not end where it says"):
        unpacked(gzip.compress(plain + bytes(20 << 20)))


def test_more_files_than_any_recording_has(unpacked, monkeypatch):
    monkeypatch.setattr(archive_module, "MOST_MEMBERS", 100)
    members = [web.member(str(index)) for index in range(101)]
    with pytest.raises(ArchiveError, match="more than 100 files"):
        unpacked(web.tar_of(*members))


@pytest.mark.parametrize("kind", [tarfile.XHDTYPE, tarfile.GNUTYPE_LONGNAME, tarfile.XGLTYPE])
def test_a_huge_header_is_not_read(unpacked, kind):
    header = tarfile.TarInfo("x")
    header.type, header.size = kind, 1 << 40
    block = header.tobuf(tarfile.GNU_FORMAT)[-512:]
    content = gzip.compress(block + bytes(64 << 20), compresslevel=1)
    tracemalloc.start()
    try:
        with pytest.raises(ArchiveError, match=f"a header of {1 << 40} bytes"):
            unpacked(content)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "field", ["5 path=x\n", "99999 path=x\n", "x path=x\n", "-8 a=b\n", "11 size=xx\n", "3 \n"]
)
def test_wrong_pax_headers(unpacked, field):
    header = tarfile.TarInfo("x")
    header.type, header.size = tarfile.XHDTYPE, len(field)
    text = field.encode().ljust(512, b"\0")
    end = web.member("y", b"1")
    plain = header.tobuf(tarfile.USTAR_FORMAT) + text + gzip.decompress(web.tar_of(end))
    with pytest.raises(ArchiveError, match="damaged"):
        unpacked(gzip.compress(plain))


def test_a_path_in_a_pax_header_is_checked_too(unpacked):
    info, content = web.member("good", b"1")
    info.pax_headers = {"path": "../../evil"}
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
        archive.addfile(info, io.BytesIO(content))
    with pytest.raises(ArchiveError, match="would lie outside"):
        unpacked(gzip.compress(buffer.getvalue()))


def test_a_negative_size(unpacked):
    block = bytearray(tarfile.TarInfo("x").tobuf())
    block[124:136] = b"\xff" * 12  # base 256: -1
    block[148:156] = b" " * 8
    block[148:156] = b"%06o\0 " % sum(block)
    with pytest.raises(ArchiveError):
        unpacked(gzip.compress(bytes(block) + bytes(1024)))


GOOD_TAR = web.tar_of(*(web.member(name, content) for name, content in TEXTS.items()))
GOOD_ZIP = zip_of(TEXTS.items())


@pytest.mark.parametrize("whole", [GOOD_TAR, GOOD_ZIP], ids=["tar", "zip"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.3, 0.9, 0.999])
def test_cut_off(unpacked, whole, share):
    with pytest.raises(ArchiveError, match=r"damaged|neither"):
        unpacked(whole[: int(share * len(whole))])


@pytest.mark.parametrize("whole", [GOOD_TAR, GOOD_ZIP], ids=["tar", "zip"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_byte_that_is_wrong(unpacked, whole, share):
    content = bytearray(whole)
    content[int(share * len(content))] ^= 0x55
    try:
        found = unpacked(bytes(content))
    except ArchiveError:
        return
    assert found == TEXTS  # a byte that no reader needs


@pytest.mark.parametrize("end", [100, 520, 700, 3000])
def test_a_tar_that_is_cut_off_before_it_was_packed(unpacked, end):
    with pytest.raises(ArchiveError, match=r"damaged .*cut off"):
        unpacked(gzip.compress(gzip.decompress(GOOD_TAR)[:end]))


@pytest.mark.parametrize("content", [b"", b"<html>no</html>", b"\x1f\x8b", b"PK", b"\x89PNG" * 99])
def test_what_is_no_archive(unpacked, content):
    with pytest.raises(ArchiveError, match=r"neither|damaged"):
        unpacked(content)


def test_gzip_without_tar(unpacked):
    with pytest.raises(ArchiveError, match="damaged"):
        unpacked(gzip.compress(b"words " * 400))


def test_a_zip_that_hides_what_is_in_it(unpacked):
    """A member that is longer than the list says."""
    content = bytearray(zip_of([("x", b"y" * 1000)]))
    at = content.index(b"PK\x01\x02") + 24
    content[at : at + 4] = struct.pack("<L", 10)
    with pytest.raises(ArchiveError, match=r"longer than it says|damaged"):
        unpacked(bytes(content))


@pytest.mark.parametrize("large", [False, True])
def test_a_zip_with_a_huge_list(unpacked, large):
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 1, 1, 0xF0000000, 0, 0)
    if large:
        end = (
            struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, 1, 1, 1 << 40, 0)
            + struct.pack("<4sLQL", b"PK\x06\x07", 0, 2000, 1)
            + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 1, 1, 0xFFFFFFFF, 0, 0)
        )
    with pytest.raises(ArchiveError, match="its list of files has"):
        unpacked(b"PK\x03\x04" + bytes(1996) + end)


def test_a_full_disk(unpacked, monkeypatch):
    real = Path.open

    def refuse(path, mode="r", *arguments, **options):
        if mode == "xb":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(path, mode, *arguments, **options)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(OutputError, match="No space left on device; make room"):
        unpacked(GOOD_TAR)
