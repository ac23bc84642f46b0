"""Unpacking archives that are not trusted: .zip, and .tar compressed with gzip.

Nothing but files and folders is made, none of it outside the folder given, no more of it than the
archive says beforehand, and no more than a multiple of its own size. Links, devices, encrypted and
sparse members are refused: recordings need none. Memory stays bounded whatever the archive says of
itself, for which reason headers of tar files are read here: `tarfile` reads as much of one into
memory as it claims to have.
"""

import gzip
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Protocol

from edvo.datasets.fetching.download import check_room, room
from edvo.errors import DatasetError

MOST_MEMBERS = 300_000
"""The longest public sequences have some 10,000 files."""

RATIO = 10
"""What an archive unpacks to at most, against its own size; images hardly shrink."""

SLACK_BYTES = 64 << 20
"""What a small archive may unpack to beyond that: text does shrink."""

_BLOCK = 1 << 18
_TAR_BLOCK = 512
_LONGEST_HEADER = 1 << 16
_LARGEST_DIRECTORY = 64 << 20
_ZIP_END, _ZIP64_END = b"PK\x05\x06", b"PK\x06\x06"
_REGULAR = (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.CONTTYPE)
_WORDS = {
    tarfile.SYMTYPE: "a link",
    tarfile.LNKTYPE: "a link",
    tarfile.CHRTYPE: "a device",
    tarfile.BLKTYPE: "a device",
    tarfile.FIFOTYPE: "a pipe",
    tarfile.GNUTYPE_SPARSE: "a sparse file",
}
_DAMAGE = (
    OSError,
    EOFError,
    zlib.error,
    struct.error,
    tarfile.TarError,
    zipfile.BadZipFile,
    NotImplementedError,
    ValueError,
    RuntimeError,
)


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


class ArchiveError(DatasetError):
    """An archive that is damaged, or asks for what it must not have."""


def unpack(
    archive: Path,
    folder: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Unpack an archive; see the module for what it may hold.

    Parameters
    ----------
    archive : pathlib.Path
        Its first bytes say which kind it is.
    folder : pathlib.Path
        An empty one. After an error something may be in it.
    progress : callable, optional
        Is told how many bytes are unpacked, and how many the archive has (of a .zip: will be).

    Raises
    ------
    ArchiveError
        If the archive is not as it must be.
    OutputError
        If there is no room.
    """
    size = archive.stat().st_size
    limit = RATIO * size + SLACK_BYTES
    try:
        with archive.open("rb") as stream:
            start = stream.read(4)
            stream.seek(0)
            if start[:2] == b"\x1f\x8b":
                _unpack_tar(stream, size, folder, limit, progress or (lambda done, total: None))
            elif start[:2] == b"PK":
                _unpack_zip(stream, size, folder, limit, progress or (lambda done, total: None))
            else:
                raise ArchiveError("it is neither a .tar.gz nor a .zip file")
    except ArchiveError as error:
        raise ArchiveError(f"{archive.name}: {error}") from error
    except _DAMAGE as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise ArchiveError(f"{archive.name} is damaged ({said})") from error


class _Writer:
    """Makes the files and folders that an archive names."""

    def __init__(self, folder: Path, limit: int) -> None:
        self._folder, self._limit = folder, limit
        self._bytes = self._members = 0

    def begin(self, name: str, size: int) -> Path | None:
        """Count a member; gives the path it is to have, or None for one that nobody needs."""
        parts = _safe_parts(name)
        self._members += 1
        self._bytes += size
        if self._members > MOST_MEMBERS:
            raise ArchiveError(f"more than {MOST_MEMBERS} files are in it; not unpacked")
        if size < 0 or self._bytes > self._limit:
            raise ArchiveError(
                f"it would unpack to more than {self._limit} bytes, far too many for its size; "
                "not unpacked"
            )
        # What macOS writes beside each file.
        if any(part == "__MACOSX" or part.startswith("._") for part in parts):
            return None
        return self._folder.joinpath(*parts)

    def make_folder(self, path: Path) -> None:
        """Make a folder, with those it is in."""
        with self._once(path):
            path.mkdir(parents=True, exist_ok=True)

    def write(self, path: Path, blocks: Iterator[bytes]) -> None:
        """Write a file that is not there yet."""
        with self._once(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            stream = path.open("xb")
        with stream:
            for block in blocks:
                with room(self._folder):
                    stream.write(block)

    @contextmanager
    def _once(self, path: Path) -> Iterator[None]:
        with room(self._folder):
            try:
                yield
            except (FileExistsError, NotADirectoryError) as error:
                name = path.relative_to(self._folder)
                raise ArchiveError(f"'{name}' is in it twice; not unpacked") from error


def _safe_parts(name: str) -> tuple[str, ...]:
    """Take a name apart; none of its parts leads out of the folder on any system."""
    parts = tuple(part for part in PurePosixPath(name).parts if part != ".")
    bad = (
        name.startswith("/")
        or ".." in parts
        or any(mark in name for mark in ("\\", ":", "\0"))
        or any(len(part.encode(errors="surrogateescape")) > 255 for part in parts)
        or len(parts) > 32
    )
    if bad:
        shown = name.encode("ascii", "backslashreplace").decode()[:80]
        raise ArchiveError(f"'{shown}' in it would lie outside of the folder; not unpacked")
    return parts


def _unpack_tar(
    stream: IO[bytes],
    size: int,
    folder: Path,
    limit: int,
    progress: Callable[[int, int], None],
) -> None:
    check_room(folder, size)
    writer = _Writer(folder, limit)
    with gzip.GzipFile(fileobj=stream) as plain:
        for header, name, length in _tar_members(plain):
            if header.isdir():
                path = writer.begin(name, 0)
                if path is not None:
                    writer.make_folder(path)
            elif header.type in _REGULAR:
                path = writer.begin(name, length)
                blocks = _blocks(plain, length)
                if path is not None:
                    writer.write(path, blocks)
                for _ in blocks:
                    pass
                _skip(plain, -length % _TAR_BLOCK)
            else:
                what = _WORDS.get(header.type, "of a kind no recording needs")
                shown = name.encode("ascii", "backslashreplace").decode()[:80]
                raise ArchiveError(f"'{shown}' in it is {what}; not unpacked")
            progress(stream.tell(), size)
        # To the end, where the checksum of the whole is. What follows the last member is padding.
        padding = 0
        while block := plain.read(_BLOCK):
            padding += len(block)
            if padding > SLACK_BYTES:
                raise ArchiveError("it does not end where it says; not unpacked")


def _tar_members(plain: _Readable) -> Iterator[tuple[tarfile.TarInfo, str, int]]:
    """Read headers: each member with its whole name and size; the caller reads what is in it."""
    name: str | None = None
    size: int | None = None
    while True:
        block = plain.read(_TAR_BLOCK)
        if not block or not any(block):
            return
        if len(block) < _TAR_BLOCK:
            raise EOFError("a header is cut off")
        header = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
        if header.type == tarfile.GNUTYPE_LONGNAME:
            name = _header_text(plain, header.size).rstrip("\0")
        elif header.type == tarfile.GNUTYPE_LONGLINK:
            _header_text(plain, header.size)
        elif header.type in (tarfile.XHDTYPE, tarfile.SOLARIS_XHDTYPE):
            fields = _fields(_header_text(plain, header.size))
            if any(key.startswith("GNU.sparse") for key in fields):
                raise ArchiveError("a sparse file is in it; not unpacked")
            name = fields.get("path", name)
            size = int(fields["size"]) if "size" in fields else size
        elif header.type == tarfile.XGLTYPE:
            _header_text(plain, header.size)
        else:
            length = header.size if size is None else size
            yield header, header.name if name is None else name, length
            name = size = None


def _header_text(plain: _Readable, size: int) -> str:
    if not 0 <= size <= _LONGEST_HEADER:
        raise ArchiveError(f"a header of {size} bytes is in it; not unpacked")
    text = b"".join(_blocks(plain, size))
    _skip(plain, -size % _TAR_BLOCK)
    return text.decode("utf-8", "surrogateescape")


def _fields(text: str) -> dict[str, str]:
    """Read a pax header: rows of "length key=value", of which the length counts bytes."""
    data = text.encode("utf-8", "surrogateescape")
    fields = {}
    while data.strip(b"\0"):
        digits, _, _ = data.partition(b" ")
        length = int(digits)
        if not len(digits) + 2 < length <= len(data) or data[length - 1 : length] != b"\n":
            raise ValueError("a pax header is wrong")
        key, _, value = data[len(digits) + 1 : length - 1].partition(b"=")
        fields[key.decode("utf-8", "surrogateescape")] = value.decode("utf-8", "surrogateescape")
        data = data[length:]
    return fields


def _blocks(stream: _Readable, size: int) -> Iterator[bytes]:
    while size:
        block = stream.read(min(size, _BLOCK))
        if not block:
            raise EOFError("a file in it is cut off")
        size -= len(block)
        yield block


def _skip(stream: _Readable, size: int) -> None:
    if len(stream.read(size)) != size:
        raise EOFError("it is cut off")


def _unpack_zip(
    stream: IO[bytes],
    size: int,
    folder: Path,
    limit: int,
    progress: Callable[[int, int], None],
) -> None:
    _check_directory(stream, size)
    writer, done = _Writer(folder, limit), 0
    with zipfile.ZipFile(stream) as archive:
        members = archive.infolist()
        paths = [writer.begin(_zip_name(member), member.file_size) for member in members]
        total = sum(member.file_size for member in members)
        check_room(folder, total)
        for member, path in zip(members, paths, strict=True):
            if path is not None and member.is_dir():
                writer.make_folder(path)
            elif path is not None:
                with archive.open(member) as plain:
                    writer.write(path, _exactly(plain, member.file_size))
            done += member.file_size
            progress(done, total)


def _check_directory(stream: IO[bytes], size: int) -> None:
    """Refuse a .zip whose list of members, which `zipfile` reads at once, is huge."""
    stream.seek(max(0, size - (1 << 16) - 128))
    tail = stream.read()
    stream.seek(0)
    end = tail.rfind(_ZIP_END)
    if end < 0:
        raise zipfile.BadZipFile("it has no end")
    (length,) = struct.unpack_from("<L", tail, end + 12)
    larger = tail.rfind(_ZIP64_END)
    if length == 0xFFFFFFFF and larger >= 0:
        (length,) = struct.unpack_from("<Q", tail, larger + 40)
    if length > _LARGEST_DIRECTORY:
        raise ArchiveError(f"its list of files has {length} bytes; not unpacked")


def _zip_name(member: zipfile.ZipInfo) -> str:
    mode = member.external_attr >> 16
    kind = stat.S_IFMT(mode)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        what = "a link" if stat.S_ISLNK(mode) else "no file"
        raise ArchiveError(f"'{member.filename[:80]}' in it is {what}; not unpacked")
    if member.flag_bits & 1:
        raise ArchiveError(f"'{member.filename[:80]}' in it is encrypted; not unpacked")
    # As it stands in the file: zipfile cuts names at a zero and turns the marks of Windows.
    return member.orig_filename


def _exactly(stream: _Readable, size: int) -> Iterator[bytes]:
    """Read a member whole, with its checksum; one with more than it says is damaged."""
    yield from _blocks(stream, size)
    if stream.read(1):
        raise ArchiveError("a file in it is longer than it says; not unpacked")
