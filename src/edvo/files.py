"""Writing results so that nothing is ever half-written: aside first, then renamed."""

import contextlib
import os
import secrets
import tempfile
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


def output_folder(
    path: str | os.PathLike[str], *, must_be_empty: bool = False, force: bool = False
) -> Path:
    """Make a folder for results and see that it takes files.

    Parameters
    ----------
    path : path-like
        Made with its parents where it is missing.
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
        If it is a file, cannot be made or written, or is not empty where it must be.
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
    return folder
