"""What a run wrote beside its results: summary.json names it, so that the next one can remove it.

Else a folder used again would hold the trajectory of one recording and the report of another. Names
come before the files, lest a run that is killed leaves some that nobody knows of.
"""

import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from edvo.errors import OutputError
from edvo.files import Unwritten, write_atomically

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


def names_to_be(folder: Path, planned: Sequence[str]) -> list[str]:
    """Say what the summary of a run is to name until all is written.

    Parameters
    ----------
    folder : pathlib.Path
        Of its results; it still has the summary of the run before.
    planned : sequence of str
        What will be written beside them, relative to the folder.

    Returns
    -------
    list of str
        What the run before named, and what is planned. A planned file that is there and that nobody
        named is the user's till it is overwritten.
    """
    new = [name for name in planned if not os.path.lexists(folder / name)]
    return list(dict.fromkeys([*more_files(folder), *new]))


def settle(
    folder: Path,
    results: Sequence[str],
    written: Sequence[str] = (),
    on_removed: Callable[[str], None] | None = None,
) -> None:
    """Remove what an earlier run wrote beside its results and this one did not, and nothing else.

    Parameters
    ----------
    folder : pathlib.Path
        Of the results. Of a file that is named but does not lie in it the name is forgotten.
    results : sequence of str
        Names that stay, and are not named.
    written : sequence of str
        What this run wrote beside them: it stays, and is named.
    on_removed : callable, optional
        Told the name of each file that is removed.

    Raises
    ------
    OutputError
        If one cannot be removed; the others are, and that one stays named.
    """
    stuck, unwritten = [], Unwritten()
    kept = {*results, *written}
    for name in more_files(folder):
        if str(PurePosixPath(name)) in kept or not _lies_within(folder, name):
            continue
        with unwritten.noted():
            try:
                _remove(folder, name)
            except OSError as error:
                stuck.append(name)
                raise OutputError(
                    f"cannot remove {folder / name}, which is of an earlier run: "
                    f"{error.strerror or error}; remove it"
                ) from error
            if on_removed is not None:
                on_removed(name)
    with unwritten.noted():
        name_files(folder, [*written, *stuck])
    unwritten.check()


def name_files(folder: Path, names: Sequence[str]) -> None:
    """Let the summary name what was written beside the results, and nothing else.

    Parameters
    ----------
    folder : pathlib.Path
        Of the results; nothing happens without a summary.
    names : sequence of str
        Relative to it.

    Raises
    ------
    OutputError
        If the summary cannot be written.
    """
    summary, names = _summary(folder), list(dict.fromkeys(names))
    if summary and more_files(folder) != names:
        summary[MORE_FILES] = names
        write_atomically(folder / SUMMARY, json.dumps(summary, indent=2) + "\n")


def _summary(folder: Path) -> dict[str, Any]:
    try:
        told = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) and "edvo" in told else {}


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
    except (OSError, ValueError, RuntimeError):  # no name of a file at all, or links in a circle
        return False


def _remove(folder: Path, name: str) -> None:
    (folder / name).unlink(missing_ok=True)
    for parent in PurePosixPath(name).parents[:-1]:
        with suppress(OSError):  # it stays if it holds anything else
            (folder / parent).rmdir()
