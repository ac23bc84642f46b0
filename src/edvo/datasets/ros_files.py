"""Parts of a bag file, read from several threads and never more than is there."""

import bz2
import os
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
from io import DEFAULT_BUFFER_SIZE, SEEK_END, BufferedReader, FileIO
from pathlib import Path
from typing import Any

from edvo.errors import DatasetError

MAX_CHUNK_BYTES = 1 << 29
"""Largest chunk that is decompressed; recorders write some hundred kilobytes to some megabytes."""

_CHUNKS_KEPT = 8  # colour and depth of one frame lie in neighbouring chunks


class SharedFile:
    """A file of which threads read parts.

    Parameters
    ----------
    path : pathlib.Path
        The file; held open.

    Raises
    ------
    DatasetError
        If it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        try:
            self._file = path.open("rb", buffering=0)
            self.size = path.stat().st_size
        except OSError as error:
            raise DatasetError(f"cannot read {path}: {error.strerror or error}") from error

    def read(self, offset: int, count: int) -> bytes:
        """Read some bytes.

        Parameters
        ----------
        offset, count : int
            Where and how many.

        Returns
        -------
        bytes
            So many, never fewer.

        Raises
        ------
        DatasetError
            If the file ends before; nothing is allocated for a size that is only claimed.
        """
        if count < 0 or offset < 0 or offset + count > self.size:
            raise DatasetError(f"{self.path} is cut short or damaged; record or copy it again")
        try:
            data = self._take(offset, count)
        except OSError as error:
            raise DatasetError(f"cannot read {self.path}: {error.strerror or error}") from error
        if len(data) != count:
            raise DatasetError(f"{self.path} became shorter while it was read")
        return data

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _take(self, offset: int, count: int) -> bytes:
        if hasattr(os, "pread"):  # threads need not wait for each other
            return os.pread(self._file.fileno(), count, offset)
        with self._lock:
            self._file.seek(offset)
            return self._file.read(count)


class BoundedPath(type(Path())):  # type: ignore[misc]
    """A path whose file gives no more than it has, however much is asked for.

    Python allocates what is asked for before it reads, and rosbags asks for what a record claims.
    """

    def open(self, mode: str = "r", *args: Any, **options: Any) -> Any:
        """Open the file; binary files are bounded."""
        if mode != "rb":
            return super().open(mode, *args, **options)
        return _Bounded(FileIO(self))


class _Bounded(BufferedReader):
    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > DEFAULT_BUFFER_SIZE:
            at = self.tell()
            size = max(min(size, self.seek(0, SEEK_END) - at), 0)
            self.seek(at)
        return super().read(size)


class Recent:
    """What was computed last, computed once however many threads ask for it.

    Parameters
    ----------
    compute : callable
        Gives the value of a key.
    keep : int
        How many values are kept; bounds the memory.
    """

    def __init__(self, compute: Callable[[int], bytes], keep: int = _CHUNKS_KEPT) -> None:
        self._compute = compute
        self._keep = keep
        self._lock = threading.Lock()
        self._values: OrderedDict[int, Future[bytes]] = OrderedDict()

    def __call__(self, key: int) -> bytes:
        """Give the value of a key; raise what `compute` raised."""
        with self._lock:
            value = self._values.get(key)
            mine = value is None
            if value is None:
                value = self._values[key] = Future()
            self._values.move_to_end(key)
            while len(self._values) > self._keep:
                self._values.popitem(last=False)
        if mine:
            try:
                value.set_result(self._compute(key))
            except BaseException as error:
                value.set_exception(error)
        return value.result()


class Inflating:
    """A chunk that is decompressed as far as it is needed, and no further than it promised.

    Parameters
    ----------
    data : bytes
        Compressed.
    compression : {"bz2", "lz4", "zstd"}
        How.
    where : str
        Named in errors.
    """

    def __init__(self, data: bytes, compression: str, where: str) -> None:
        self._left = data
        self._decompressor = decompressor(compression)
        self._where = where
        self._done = bytearray()

    def part(self, offset: int, count: int) -> bytes:
        """Give some bytes of what comes out.

        Parameters
        ----------
        offset, count : int
            Where and how many.

        Returns
        -------
        bytes
            So many, or fewer at the end.

        Raises
        ------
        DatasetError
            If the data are damaged.
        """
        while len(self._done) < offset + count:
            try:
                wanted = offset + count - len(self._done)
                piece = self._decompressor.decompress(self._left, max_length=wanted)
            except EOFError:  # all is out
                break
            except Exception as error:  # ZstdError derives from it directly, lz4's RuntimeError too
                raise DatasetError(f"{self._where}: damaged; copy the bag again") from error
            self._left = b""
            if not piece:
                break
            self._done += piece
        return bytes(self._done[offset : offset + count])


def inflate(data: bytes, compression: str, size: int | None, where: str) -> bytes:
    """Decompress all of a chunk.

    Parameters
    ----------
    data : bytes
        Compressed.
    compression : {"bz2", "lz4", "zstd"}
        How.
    size : int or None
        Bytes that must come out; None if nobody said.
    where : str
        Named in errors.

    Returns
    -------
    bytes
        Decompressed.

    Raises
    ------
    DatasetError
        If it is damaged, of another size, or too large to be a chunk of a bag.
    """
    if size is not None and size > MAX_CHUNK_BYTES:
        raise DatasetError(f"{where}: claims {size} bytes, which no bag holds at once: damaged")
    limit = MAX_CHUNK_BYTES if size is None else size
    result = Inflating(data, compression, where).part(0, limit + 1)
    if len(result) > limit or (size is not None and len(result) != size):
        raise DatasetError(f"{where}: has another size than it claims; copy the bag again")
    return result


def decompressor(compression: str) -> Any:
    """Make a decompressor with ``decompress(data, max_length)``.

    Parameters
    ----------
    compression : {"bz2", "lz4", "zstd"}
        What it decompresses.

    Returns
    -------
    object
        For one stream.

    Raises
    ------
    DatasetError
        If there is none.
    """
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return LZ4FrameDecompressor()
    if compression == "zstd":
        own = sys.version_info >= (3, 14)
        return import_module("compression.zstd" if own else "backports.zstd").ZstdDecompressor()
    raise DatasetError(f"compression '{compression}' is not known; decompress the bag first")
