"""A folder that is being written says so, lest what an interruption leaves is read as whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from edvo.errors import DatasetError, OutputError
from edvo.files import write_atomically

INCOMPLETE = "INCOMPLETE.txt"
"""Name of the file that lies in a recording's folder as long as a part of it is missing."""

_LONGEST = 1000  # characters of it that are shown


@contextmanager
def being_written(folder: Path, what: str, command: str) -> Iterator[None]:
    """Keep readers off a folder until everything is in it.

    Parameters
    ----------
    folder : pathlib.Path
        It exists, and is marked first of all and freed last; after an error it stays marked.
    what : str
        Is written, in a few words.
    command : str
        Writes it again.

    Yields
    ------
    None
        To write.

    Raises
    ------
    OutputError
        If the mark cannot be written or taken away.
    """
    mark = folder / INCOMPLETE
    write_atomically(mark, f"{what}, not finished; to do it again: {command}\n")
    yield
    try:
        mark.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot remove {mark}: {error.strerror or error}; the folder is whole, remove it"
        ) from error


def is_incomplete(folder: Path) -> bool:
    """Say whether a folder was begun and not finished.

    Parameters
    ----------
    folder : pathlib.Path
        Or a file, which never is.

    Returns
    -------
    bool
    """
    return (folder / INCOMPLETE).is_file()


def refuse_incomplete(folder: Path) -> None:
    """Let only finished folders pass.

    Parameters
    ----------
    folder : pathlib.Path
        Or a file, which passes.

    Raises
    ------
    DatasetError
        If it is not finished, with how to write it again.
    """
    if not is_incomplete(folder):
        return
    try:
        with (folder / INCOMPLETE).open(encoding="utf-8", errors="replace") as stream:
            words = stream.read(_LONGEST).split()
    except OSError:
        words = []
    about = " ".join(words) or "write it again"
    raise DatasetError(f"{folder} is incomplete: {about} (by its {INCOMPLETE})")
