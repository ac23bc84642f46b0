"""Matroska files (.mkv): which tracks there are, what is attached, and where each frame lies.

Only what recorders of raw video write is read: blocks without lacing, without encryption. Elements
are gone through in the order of the file, so that neither an index nor known sizes are needed, and
a file that is cut short gives what it has.

Source: RFC 8794 (EBML) and RFC 9559 (Matroska).
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from edvo.errors import DatasetError, FrameError

MAGIC = b"\x1a\x45\xdf\xa3"
"""First bytes of a file."""

_SEGMENT, _CLUSTER, _BLOCK_GROUP = 0x18538067, 0x1F43B675, 0xA0
_INFO, _TRACKS, _TRACK, _VIDEO = 0x1549A966, 0x1654AE6B, 0xAE, 0xE0
_ATTACHMENTS, _ATTACHED = 0x1941A469, 0x61A7
# Their children follow as if they were their own siblings.
_ENTERED = frozenset(
    (_SEGMENT, _CLUSTER, _BLOCK_GROUP, _INFO, _TRACKS, _TRACK, _VIDEO, _ATTACHMENTS, _ATTACHED)
)
_TIMESTAMP_SCALE, _CLUSTER_TIME = 0x2AD7B1, 0xE7
_NUMBER, _NAME, _CODEC, _PRIVATE, _WIDTH, _HEIGHT = 0xD7, 0x536E, 0x86, 0x63A2, 0xB0, 0xBA
_FILE_NAME, _FILE_DATA = 0x466E, 0x465C
_SIMPLE_BLOCK, _BLOCK = 0xA3, 0xA1

_LONGEST_TEXT = 4096
_LARGEST_ATTACHMENT = 1 << 24
_LACING = 0x06
_FOURCC = "V_MS/VFW/FOURCC"


@dataclass
class Track:
    """A track of a file.

    Parameters
    ----------
    number : int
        By which its blocks name it.
    name : str
        For people.
    codec : str
        Matroska's name of how it is coded.
    private : bytes
        What the codec needs to know.
    width, height : int
        Of its images, pixels; 0 if it has none.
    """

    number: int = 0
    name: str = ""
    codec: str = ""
    private: bytes = b""
    width: int = 0
    height: int = 0

    @property
    def fourcc(self) -> str:
        """Four letters that tell how raw video is laid out; empty if it is coded otherwise."""
        if self.codec != _FOURCC or len(self.private) < 20:
            return ""
        return self.private[16:20].decode("ascii", "replace")


@dataclass(frozen=True, slots=True)
class Block:
    """Where a frame lies in the file: its time (nanoseconds), its first byte, and its length."""

    time: int
    at: int
    size: int


@dataclass
class Matroska:
    """What a file holds.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    tracks : list of Track
        As they are declared.
    attachments : dict of str to bytes
        Attached files by name.
    blocks : dict of int to list of Block
        Frames of each track, in the order of the file.
    cut_short : bool
        Whether it ends in the middle of an element.
    """

    path: Path
    tracks: list[Track] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    blocks: dict[int, list[Block]] = field(default_factory=dict)
    cut_short: bool = False

    def read(self, block: Block, name: str) -> bytes:
        """Read a frame.

        Parameters
        ----------
        block : Block
            Which one.
        name : str
            Named in errors.

        Returns
        -------
        bytes
            As it is coded.

        Raises
        ------
        FrameError
            If it cannot be read.
        """
        try:
            with self.path.open("rb") as stream:
                stream.seek(block.at)
                data = stream.read(block.size)
        except OSError as error:
            raise FrameError(f"cannot read {self.path}: {error.strerror or error}") from error
        if len(data) != block.size:
            raise FrameError(f"{name} is cut short")
        return data


def read_matroska(path: Path) -> Matroska:
    """Go through a file once, without reading its images.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    Matroska
        What it holds.

    Raises
    ------
    DatasetError
        If it is none, or damaged.
    """
    found = Matroska(path)
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            if stream.read(4) != MAGIC:
                raise DatasetError(f"{path} is no Matroska file; record or copy it again")
            stream.seek(0)
            _go_through(stream, size, found)
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror or error}") from error
    return found


def _go_through(stream: BinaryIO, size: int, found: Matroska) -> None:
    scale, cluster, attached = 1_000_000, 0, ""
    for kind, length in _elements(stream, size, found):
        at = stream.tell()
        if kind == _TRACK:
            found.tracks.append(Track())
        elif kind == _TIMESTAMP_SCALE:
            scale = _number(stream, length, found)
        elif kind == _CLUSTER_TIME:
            cluster = _number(stream, length, found)
        elif kind in (_SIMPLE_BLOCK, _BLOCK):
            _add_block(stream, length, cluster, scale, found)
        elif kind == _FILE_NAME:
            attached = _text(stream, length, found)
        elif kind == _FILE_DATA:
            found.attachments[attached] = _bytes(stream, length, _LARGEST_ATTACHMENT, found)
        elif found.tracks and not found.blocks:
            _add_to_track(stream, kind, length, found)
        if kind not in _ENTERED:
            stream.seek(at + length)


def _add_to_track(stream: BinaryIO, kind: int, length: int, found: Matroska) -> None:
    track = found.tracks[-1]
    if kind == _NUMBER:
        track.number = _number(stream, length, found)
    elif kind == _WIDTH:
        track.width = _number(stream, length, found)
    elif kind == _HEIGHT:
        track.height = _number(stream, length, found)
    elif kind == _NAME:
        track.name = _text(stream, length, found)
    elif kind == _CODEC:
        track.codec = _text(stream, length, found)
    elif kind == _PRIVATE:
        track.private = _bytes(stream, length, 1 << 20, found)


def _add_block(stream: BinaryIO, length: int, cluster: int, scale: int, found: Matroska) -> None:
    start = stream.tell()
    number = _variable(stream, keep_marker=False)
    head = stream.read(3)
    if number is None or len(head) < 3:
        return
    relative, flags = struct.unpack(">hB", head)
    at = stream.tell()
    if flags & _LACING or at > start + length:
        return
    block = Block((cluster + relative) * scale, at, start + length - at)
    found.blocks.setdefault(number[0], []).append(block)


def _elements(stream: BinaryIO, size: int, found: Matroska) -> Iterator[tuple[int, int]]:
    """Give kind and length of each element; the stream is behind both."""
    while stream.tell() < size:
        kind, length = _variable(stream, keep_marker=True), _variable(stream, keep_marker=False)
        if kind is None or length is None:
            found.cut_short = True
            return
        # A length of ones alone is unknown, as of what was written while it was recorded.
        unknown = length[0] == (1 << (7 * length[1])) - 1
        if kind[0] not in _ENTERED and (unknown or stream.tell() + length[0] > size):
            found.cut_short = True
            return
        yield kind[0], length[0]


def _variable(stream: BinaryIO, *, keep_marker: bool) -> tuple[int, int] | None:
    """Read a number of variable length: its value and its bytes; None at the end or if damaged."""
    first = stream.read(1)
    if not first or not first[0]:
        return None
    count = 9 - first[0].bit_length()
    rest = stream.read(count - 1)
    if len(rest) < count - 1:
        return None
    value = first[0] if keep_marker else first[0] & ((1 << (8 - count)) - 1)
    return int.from_bytes(bytes([value]) + rest, "big"), count


def _bytes(stream: BinaryIO, length: int, limit: int, found: Matroska) -> bytes:
    if length > limit:
        raise DatasetError(f"{found.path} is damaged: {length} bytes where {limit} are too many")
    return stream.read(length)


def _number(stream: BinaryIO, length: int, found: Matroska) -> int:
    return int.from_bytes(_bytes(stream, length, 8, found), "big")


def _text(stream: BinaryIO, length: int, found: Matroska) -> str:
    return _bytes(stream, length, _LONGEST_TEXT, found).rstrip(b"\0").decode("utf-8", "replace")
