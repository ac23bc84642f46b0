"""SHA-256 sums, and the files that list them as ``sha256sum`` writes them."""

import hashlib
import re
from pathlib import Path

from edvo.errors import DatasetError
from edvo.files import write_atomically

SUMS_FILE = "SHA256SUMS"
"""Name of a list of sums beside archives, here and on mirrors."""

_LINE = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")
_BLOCK = 1 << 20


def check_sum(text: str) -> str:
    """Let only what can be a SHA-256 sum pass.

    Parameters
    ----------
    text : str
        64 hexadecimal digits, after "sha256:" or not.

    Returns
    -------
    str
        The digits, in small letters.

    Raises
    ------
    DatasetError
        If it is none.
    """
    digits = text.strip().lower().removeprefix("sha256:")
    if not re.fullmatch("[0-9a-f]{64}", digits):
        raise DatasetError(f"'{text}' is no SHA-256 checksum; give its 64 hexadecimal digits")
    return digits


def sha256_of(file: Path) -> str:
    """Compute the sum of a file.

    Parameters
    ----------
    file : pathlib.Path
        It is read once, a piece at a time.

    Returns
    -------
    str
        Hexadecimal.

    Raises
    ------
    DatasetError
        If it cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError as error:
        raise DatasetError(f"cannot read {file}: {error.strerror or error}; check it") from error
    return digest.hexdigest()


def sum_in(listing: str, file: str) -> str | None:
    """Find a sum in a list.

    Parameters
    ----------
    listing : str
        Rows of "sum  name"; others are passed over.
    file : str
        Name of the file, in whatever folder.

    Returns
    -------
    str or None
        Hexadecimal, of the last row that names it.
    """
    found = None
    for line in listing.splitlines():
        match = _LINE.fullmatch(line.strip())
        if match and match[2].rsplit("/", 1)[-1] == file:
            found = match[1].lower()
    return found


def remembered(folder: Path, file: str) -> str | None:
    """Find the sum that a file had when it was fetched into a folder before.

    Parameters
    ----------
    folder : pathlib.Path
        Where to.
    file : str
        Its name.

    Returns
    -------
    str or None
        Hexadecimal.
    """
    return sum_in(_listing(folder), file)


def remember(folder: Path, file: str, sha256: str) -> None:
    """Write down the sum of a file beside it.

    Parameters
    ----------
    folder : pathlib.Path
        Where it is; `SUMS_FILE` there is written anew.
    file : str
        Its name.
    sha256 : str
        Its sum.

    Raises
    ------
    OutputError
        If the list cannot be written.
    """
    rows = [row for row in _listing(folder).splitlines() if sum_in(row, file) is None]
    write_atomically(
        folder / SUMS_FILE, "".join(f"{row}\n" for row in rows) + f"{sha256}  {file}\n"
    )


def _listing(folder: Path) -> str:
    listing = folder / SUMS_FILE
    try:
        return listing.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise DatasetError(
            f"cannot read {listing}: {error.strerror or error}; check or remove it"
        ) from error
