"""Writing results so that nothing is ever half-written: aside first, then renamed."""

import contextlib
import os
import secrets
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from edvo.errors import OutputError


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : path-like
        The file to write; its folder must exist.
    content : bytes or str
        Text is written as UTF-8.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, or the disk is full; what stood at ``path``
        before is then untouched.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    aside = path.parent / f".{path.name}.{secrets.token_hex(8)}"
    made = False
    try:
        # Opened as any file, not by tempfile, so that it gets the rights the user's umask gives.
        with aside.open("xb") as stream:
            made = True
            stream.write(data)
        aside.replace(path)
    except OSError as error:
        raise OutputError(
            f"cannot write {path}: {error.strerror or error}; choose a folder with room and rights"
        ) from error
    finally:
        if made:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)


class Unwritten:
    """Lets the next file be written though one could not be, and fails at the end.

    What took minutes to compute is not lost because one of its files cannot be written.
    """

    def __init__(self) -> None:
        self._first: OutputError | None = None

    @contextlib.contextmanager
    def noted(self) -> Iterator[None]:
        """Take note of a file that cannot be written, and go on behind the block."""
        try:
            yield
        except OutputError as error:
            self._first = self._first or error

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return self._first is not None

    def check(self) -> None:
        """Fail if a file could not be written.

        Raises
        ------
        OutputError
            The first one that was noted.
        """
        if self._first is not None:
            raise self._first


def output_folder(
    path: str | os.PathLike[str],
    *,
    files: Sequence[str] = (),
    must_be_empty: bool = False,
    force: bool = False,
) -> Path:
    """Make a folder for results and see that it takes files.

    Parameters
    ----------
    path : path-like
        Made with its parents where it is missing.
    files : sequence of str
        What will be written there, so that what stands in the way is told before it takes time.
    must_be_empty : bool
        Refuse a folder that holds anything.
    force : bool
        Take it all the same.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    OutputError
        If it is a file, cannot be made or written, or is not empty where it must be; or if a
        folder stands where a file is to be, or a file where a folder is.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        filled = must_be_empty and any(folder.iterdir())
    except OSError as error:
        raise OutputError(
            f"cannot write into {folder}: {error.strerror or error}; choose another folder"
        ) from error
    if filled and not force:
        raise OutputError(f"{folder} is not empty; choose another folder or add --force")
    for name in files:
        _check_place(folder, name)
    return folder


def _check_place(folder: Path, name: str) -> None:
    file = folder / name
    if file.is_dir():
        raise OutputError(
            f"cannot write {file}: a folder stands there; move it or choose another folder"
        )
    for parent in file.relative_to(folder).parents:
        if (folder / parent).exists() and not (folder / parent).is_dir():
            raise OutputError(
                f"cannot write {file}: {folder / parent} is a file; move it or choose another "
                "folder"
            )
