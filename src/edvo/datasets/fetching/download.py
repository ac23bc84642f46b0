"""A download that goes on where it broke off, at once or after another start.

What has come lies in ``NAME.part``; ``NAME.part.json`` beside it says of which version of which
file, so that parts of two versions are never joined.
"""

import contextlib
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from edvo.datasets.fetching.transport import (
    Answer,
    NotThereError,
    TransientError,
    WebPageError,
    ask,
)
from edvo.errors import DatasetError, OutputError
from edvo.files import write_atomically

PART = ".part"
"""What the name of an unfinished download ends with."""

ATTEMPTS = 5
"""How often in a row nothing may come."""

UNHEARD_ATTEMPTS = 3
"""How often in a row, as long as no server has answered at all."""

LIMIT_BYTES = 20_000_000_000
"""What no archive of a sequence comes near."""

_LONGEST_WAIT_S = 60.0
_WORTH = 1 << 16  # bytes that make an attempt one that brought something
_BLOCK = 1 << 20
_LONGEST_TEXT = 1 << 20

Progress = Callable[[int, int | None], None]
"""Is told how many bytes are there, and how many it will be if that is known."""


@dataclass
class _Part:
    """An unfinished download.

    Parameters
    ----------
    file : pathlib.Path
        Where it lies.
    stream : BinaryIO
        The same, open.
    url : str
        Where it comes from.
    """

    file: Path
    stream: BinaryIO
    url: str

    def __post_init__(self) -> None:
        self.total: int | None = None
        self.validator: str | None = None
        self.size = 0
        self.digest = hashlib.sha256()
        if self._recall():
            while block := self.stream.read(_BLOCK):
                self.digest.update(block)
                self.size += len(block)

    @property
    def memory(self) -> Path:
        """The file that says what this is a part of."""
        return memory_of(self.file)

    def restart(self) -> None:
        """Throw away what is there: only when something comes in its place."""
        self.stream.seek(0)
        self.stream.truncate()
        self.size, self.digest = 0, hashlib.sha256()
        self.total = self.validator = None

    def describe(self, total: int | None, validator: str | None) -> None:
        """Remember what this is a part of."""
        self.total, self.validator = total, validator
        words = {"url": self.url, "total": total, "validator": validator}
        write_atomically(self.memory, json.dumps(words) + "\n")

    def add(self, block: bytes) -> None:
        """Append what came."""
        with room(self.file.parent):
            left = memoryview(block)
            while left:
                left = left[self.stream.write(left) :]
        self.digest.update(block)
        self.size += len(block)

    def _recall(self) -> bool:
        try:
            words = json.loads(self.memory.read_text(encoding="utf-8"))
            if words["url"] != self.url:
                return False
            total, validator = words["total"], words["validator"]
        except (OSError, ValueError, KeyError, TypeError):
            return False
        self.total = total if isinstance(total, int) else None
        self.validator = validator if isinstance(validator, str) else None
        # With neither of them, nothing would tell another version from this one.
        return self.total is not None or self.validator is not None


def download(
    url: str,
    target: Path,
    *,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> str:
    """Fetch a file, with several attempts.

    Parameters
    ----------
    url : str
        Its address.
    target : pathlib.Path
        Where to; its folder must exist. It appears when it is complete.
    progress : callable, optional
        Is told how far it is.
    note : callable, optional
        Is told of each attempt that failed, and of what is there already.

    Returns
    -------
    str
        SHA-256 of the file, hexadecimal.

    Raises
    ------
    DatasetError
        If the server does not send it, or not all of it; what came is kept for another start.
    OutputError
        If it cannot be written.
    """
    with _part(target, url) as part:
        failures, most, heard = 0, part.size, False
        if part.size and note is not None:
            note(f"going on after the {part.size} bytes in {part.file}")
        while True:
            try:
                _receive(part, progress or (lambda done, total: None))
                break
            except TransientError as error:
                failures = 1 if part.size >= most + _WORTH else failures + 1
                most, heard = max(most, part.size), heard or error.heard
                if failures >= (ATTEMPTS if heard else UNHEARD_ATTEMPTS):
                    raise DatasetError(f"{error}, {failures} times; {_kept(part)}") from error
                wait = min(error.wait or 2.0 ** (failures - 1), _LONGEST_WAIT_S)
                if note is not None:
                    note(f"{error}; again in {wait:g} s")
                time.sleep(wait)
        sha256 = part.digest.hexdigest()
    try:
        part.file.replace(target)
        part.memory.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot write {target}: {error.strerror or error}; choose another folder with -o"
        ) from error
    return sha256


def memory_of(part: Path) -> Path:
    """Name the file that says what a part belongs to.

    Parameters
    ----------
    part : pathlib.Path
        An unfinished download.

    Returns
    -------
    pathlib.Path
    """
    return part.with_name(part.name + ".json")


def read_small(url: str) -> str | None:
    """Fetch a short text, with several attempts.

    Parameters
    ----------
    url : str
        Its address.

    Returns
    -------
    str or None
        The text; None if the server has none.

    Raises
    ------
    DatasetError
        If the server has one and does not send it, or it is long.
    """
    failures = 0
    while True:
        text = b""
        try:
            with ask(url) as answer:
                for block in answer.body:
                    text += block
                    if len(text) > _LONGEST_TEXT:
                        raise DatasetError(f"{url} is too long for what it should be; check it")
            return text.decode("utf-8", errors="replace")
        except (NotThereError, WebPageError):
            return None
        except TransientError:
            failures += 1
            if failures >= UNHEARD_ATTEMPTS:
                raise
            time.sleep(2.0 ** (failures - 1))


@contextmanager
def room(folder: Path) -> Iterator[None]:
    """Say in one line that a disk is full, or why else nothing can be written.

    Parameters
    ----------
    folder : pathlib.Path
        Where it is written.

    Yields
    ------
    None

    Raises
    ------
    OutputError
        In place of what the system says.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write into {folder}: {error.strerror or error}; make room or choose another "
            "folder with -o; what is complete is kept"
        ) from error


def check_room(folder: Path, needed: int) -> None:
    """Refuse what the disk has no room for.

    Parameters
    ----------
    folder : pathlib.Path
        On that disk.
    needed : int
        Bytes.

    Raises
    ------
    OutputError
        If fewer are free.
    """
    with contextlib.suppress(OSError):
        free = shutil.disk_usage(folder).free
        if free < needed:
            raise OutputError(
                f"{folder}: {needed / 1e6:.0f} MB more are needed and {free / 1e6:.0f} MB are "
                "free; make room or choose another folder with -o"
            )


@contextmanager
def _part(target: Path, url: str) -> Iterator[_Part]:
    file = target.with_name(target.name + PART)
    with room(target.parent):
        # Unbuffered, so that whatever ends the program, what came is in the file.
        handle = os.open(file, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        stream = os.fdopen(handle, "r+b", buffering=0)
    with stream:
        part = _Part(file, stream, url)
        try:
            yield part
        except BaseException:
            with contextlib.suppress(OSError):
                if not file.stat().st_size:
                    stream.close()  # before it is removed, for Windows
                    part.memory.unlink(missing_ok=True)
                    file.unlink()
            raise


def _receive(part: _Part, progress: Progress) -> None:
    """Take what a server sends in one go; raises `TransientError` if it is not all."""
    with ask(part.url, start=part.size, validator=part.validator) as answer:
        if not _continues(part, answer):
            part.restart()
            if answer.start:
                raise TransientError(f"{part.url}: the file has changed, from its beginning", 0.001)
        if not part.size:
            part.restart()
            part.describe(answer.total, answer.validator)
        elif part.total is None:
            part.total = answer.total
        if part.total is not None:
            if part.total > LIMIT_BYTES:
                raise DatasetError(
                    f"{part.url} is said to have {part.total} bytes; no sequence has so many"
                )
            check_room(part.file.parent, part.total - part.size)
        progress(part.size, part.total)
        for block in answer.body:
            part.add(block)
            if part.size > LIMIT_BYTES:
                raise DatasetError(f"{part.url} does not end; stopped after {part.size} bytes")
            progress(part.size, part.total)
    if part.total is not None and part.size != part.total:
        raise TransientError(f"{part.url} broke off after {part.size} of {part.total} bytes")
    if not part.size:
        raise TransientError(f"{part.url} is empty")


def _continues(part: _Part, answer: Answer) -> bool:
    return answer.start == part.size and (
        not part.size or part.total is None or answer.total in (None, part.total)
    )


def _kept(part: _Part) -> str:
    if not part.size:
        return "try later, or another server with --mirror URL"
    return f"{part.size} bytes are kept in {part.file}, the same command goes on from there"
