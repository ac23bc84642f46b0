"""Text files of recordings, and each way they can be bad put into one line."""

from pathlib import Path

from edvo.errors import DatasetError

LARGEST_TEXT = 1 << 28
"""Bytes of the largest text that is read: a list of some million images."""


def check_size(file: Path, wanted: str, largest: int = LARGEST_TEXT) -> None:
    """Refuse a file before it is read by someone who would read all of it.

    Parameters
    ----------
    file : pathlib.Path
        The file.
    wanted : str
        What it must hold, for errors.
    largest : int
        Bytes.

    Raises
    ------
    DatasetError
        If it is larger or cannot be looked at; the message names it.
    """
    try:
        size = file.stat().st_size
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}") from error
    if size > largest:
        raise DatasetError(f"{file} has {size} bytes, more than is read of such a file; {wanted}")


def read_text(file: Path, wanted: str) -> str:
    """Read a text file.

    Parameters
    ----------
    file : pathlib.Path
        UTF-8, with or without its mark.
    wanted : str
        What it must hold, for errors: ``it must hold numbers``.

    Returns
    -------
    str
        All of it.

    Raises
    ------
    DatasetError
        If it cannot be read, is no text, or is larger than `LARGEST_TEXT`; the message names it.
    """
    check_size(file, wanted)
    try:
        return file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DatasetError(f"{file} is no text file; {wanted}") from error
