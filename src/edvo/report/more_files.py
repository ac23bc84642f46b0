"""What a run wrote beside its results: summary.json names it, so that the next one can remove it.

Else a folder used again would hold the trajectory of one recording and the report of another.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from edvo.errors import OutputError
from edvo.files import write_atomically

SUMMARY = "summary.json"
MORE_FILES = "more_files"
"""Key of the summary: names relative to the folder."""


def more_files(folder: Path) -> list[str]:
    """Look up what a run wrote beside its results.

    Parameters
    ----------
    folder : pathlib.Path
        Of its results, or of anything.

    Returns
    -------
    list of str
        As its summary has them; empty if there is none, or not one of edvo's.
    """
    names = _summary(folder).get(MORE_FILES)
    return names if isinstance(names, list) and all(isinstance(n, str) for n in names) else []


def name_file(folder: Path, name: str) -> None:
    """Let the summary name one more file that was written.

    Parameters
    ----------
    folder : pathlib.Path
        Of the results; nothing happens without a summary.
    name : str
        Relative to it.

    Raises
    ------
    OutputError
        If the summary cannot be written.
    """
    _name(folder, [*more_files(folder), name])


def remove_more(folder: Path, keep: Sequence[str]) -> None:
    """Remove what an earlier run wrote beside its results, and nothing else.

    Parameters
    ----------
    folder : pathlib.Path
        Of the results. Of a file that is named but does not lie in it the name is forgotten.
    keep : sequence of str
        Names that stay though they be named.

    Raises
    ------
    OutputError
        If one cannot be removed; the others are.
    """
    names = more_files(folder)
    stuck, first = [], None
    for name in names:
        if str(PurePosixPath(name)) in keep or not _lies_within(folder, name):
            continue
        try:
            _remove(folder, name)
        except OSError as error:
            stuck.append(name)
            first = first or error
    if names:
        _name(folder, stuck)
    if first is not None:
        raise OutputError(
            f"cannot remove {folder / stuck[0]}, which is of an earlier run: "
            f"{first.strerror or first}; remove it"
        ) from first


def _summary(folder: Path) -> dict[str, Any]:
    try:
        told = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) and "edvo" in told else {}


def _name(folder: Path, names: Sequence[str]) -> None:
    if summary := _summary(folder):
        summary[MORE_FILES] = list(dict.fromkeys(names))
        write_atomically(folder / SUMMARY, json.dumps(summary, indent=2) + "\n")


def _lies_within(folder: Path, name: str) -> bool:
    """Say whether a name is that of a file in the folder, whatever links there are on the way.

    A link is none: edvo makes none.
    """
    parts = PurePosixPath(name)
    if parts.is_absolute() or ".." in parts.parts:
        return False
    try:
        place, home = folder / name, folder.resolve()
        is_in = place.parent.resolve().is_relative_to(home)
        return is_in and place.is_file() and not place.is_symlink()
    except (OSError, ValueError):  # no name of a file at all
        return False


def _remove(folder: Path, name: str) -> None:
    (folder / name).unlink(missing_ok=True)
    for parent in PurePosixPath(name).parents[:-1]:
        with suppress(OSError):  # it stays if it holds anything else
            (folder / parent).rmdir()
