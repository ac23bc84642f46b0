"""Fetching a sequence: its archive, the checksum, and a folder that edvo reads.

Everything is made aside and renamed, so that the folder is either whole or not there. It then
holds ``FETCHED.json``, which says where it is from and how many files belong to it.
"""

import contextlib
import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edvo.datasets.fetching.archive import ArchiveError, unpack
from edvo.datasets.fetching.catalogue import Entry
from edvo.datasets.fetching.checksums import (
    SUMS_FILE,
    check_sum,
    remember,
    remembered,
    sha256_of,
    sum_in,
)
from edvo.datasets.fetching.download import PART, download, read_small, room
from edvo.datasets.fetching.transport import NotThereError, check_url
from edvo.errors import DatasetError, EdvoError, OutputError
from edvo.files import output_folder, write_atomically

RECORD = "FETCHED.json"
"""Name of the file that says where a folder is from."""


@dataclass(frozen=True)
class Watch:
    """Who is told what happens.

    Parameters
    ----------
    progress : callable
        Is given what goes on, how many bytes are done and how many there are, if that is known.
    note : callable
        Is given a line that a person should read.
    """

    progress: Callable[[str, int, int | None], None] = lambda what, done, total: None
    note: Callable[[str], None] = lambda line: None


@dataclass(frozen=True)
class Fetched:
    """What there is now.

    Parameters
    ----------
    folder : pathlib.Path
        The sequence.
    sha256 : str or None
        Of its archive, hexadecimal; None of a folder that was not fetched.
    checked_by : str or None
        What said that it must be this one; None if nothing did.
    new : bool
        Whether it was not there before.
    """

    folder: Path
    sha256: str | None
    checked_by: str | None
    new: bool


def fetch(
    entry: Entry,
    out: Path,
    *,
    mirror: str | None = None,
    checksum: str | None = None,
    keep_archive: bool = False,
    watch: Watch | None = None,
) -> Fetched:
    """Have a sequence in a folder; what is complete there is not fetched again.

    Parameters
    ----------
    entry : Entry
        Which one.
    out : pathlib.Path
        Folder for its folder. An archive that is there already is taken instead of a download.
    mirror : str, optional
        Address to take the archive from instead of the data set's: below it as there, or flat.
    checksum : str, optional
        SHA-256 that the archive must have, whatever else is known of it.
    keep_archive : bool
        Leave the archive beside the folder.
    watch : Watch, optional
        Who is told.

    Returns
    -------
    Fetched

    Raises
    ------
    DatasetError
        If it cannot be had, its archive is not the right one, or it is no recording.
    OutputError
        If it cannot be written.
    """
    watch = watch or Watch()
    wanted = None if checksum is None else check_sum(checksum)
    base = None if mirror is None else check_url(mirror)
    out = output_folder(out)
    with _alone(out, entry):
        there = _there(out / entry.folder, wanted, watch)
        if there is not None:
            return there
        archive = out / entry.file
        own = archive.exists()  # then it is not ours to remove
        if own:
            watch.note(f"{archive} is there already: not fetched")
            url, sha256 = None, sha256_of(archive)
        else:
            url, sha256 = _download(entry, archive, base, watch)
        try:
            checked_by = _check(entry, out, sha256, wanted, url, base is not None)
            folder = _unpack(entry, archive, sha256, checked_by, url, watch)
        except (_WrongSumError, ArchiveError) as error:
            if own:
                raise DatasetError(f"{error}; remove {archive} to fetch it") from error
            with room(out):
                archive.unlink(missing_ok=True)
            raise DatasetError(f"{error}; it is removed") from error
        if checked_by is None:
            watch.note(
                f"no checksum of {entry.file} is known: its SHA-256 is kept in {out / SUMS_FILE} "
                "and checked from now on"
            )
        remember(out, entry.file, sha256)
        if not keep_archive and not own:
            with room(out):
                archive.unlink(missing_ok=True)
    return Fetched(folder, sha256, checked_by, new=True)


def unfinished(entry: Entry, out: Path) -> Path | None:
    """Find what an interruption has left to go on from.

    Parameters
    ----------
    entry : Entry
        What was fetched.
    out : pathlib.Path
        Where to.

    Returns
    -------
    pathlib.Path or None
        A file, if there is one.
    """
    archive = out / entry.file
    for file in (archive, archive.with_name(archive.name + PART)):
        if file.is_file() and file.stat().st_size:
            return file
    return None


class _WrongSumError(DatasetError):
    """An archive that is not the one it should be."""


def _download(entry: Entry, archive: Path, base: str | None, watch: Watch) -> tuple[str, str]:
    urls = [entry.url]
    if base is not None:
        urls = list(dict.fromkeys((base + entry.archive, base + entry.file)))
    for url in urls[:-1]:
        with contextlib.suppress(NotThereError):
            return url, _from(url, entry, archive, watch)
    return urls[-1], _from(urls[-1], entry, archive, watch)


def _from(url: str, entry: Entry, archive: Path, watch: Watch) -> str:
    def progress(done: int, total: int | None) -> None:
        watch.progress(f"fetching {entry.name}", done, total)

    watch.note(f"{entry.name} from {url}")
    return download(url, archive, progress=progress, note=watch.note)


def _check(
    entry: Entry, out: Path, sha256: str, wanted: str | None, url: str | None, mirrored: bool
) -> str | None:
    """Hold a sum against all that is known; gives what confirmed it."""
    known: dict[str, str] = {}
    if wanted is not None:
        known["--checksum"] = wanted
    elif entry.sha256 is not None:
        known["edvo's catalogue"] = entry.sha256
    if mirrored and url is not None:
        sums = url.rsplit("/", 1)[0] + "/" + SUMS_FILE
        of_mirror = sum_in(read_small(sums) or "", entry.file)
        if of_mirror is not None:
            known[sums] = of_mirror
    earlier = remembered(out, entry.file)
    if earlier is not None and wanted is None:
        known[str(out / SUMS_FILE)] = earlier
    for origin, right in known.items():
        if right != sha256:
            raise _WrongSumError(
                f"wrong checksum of {entry.file}: {sha256} instead of {right} ({origin}); where "
                "the data set was published anew, --checksum accepts it"
            )
    return next(iter(known), None)


def _unpack(
    entry: Entry,
    archive: Path,
    sha256: str,
    checked_by: str | None,
    url: str | None,
    watch: Watch,
) -> Path:
    aside = archive.with_name(f".{entry.folder}.unpacking")
    target = archive.with_name(entry.folder)
    _remove(aside)
    try:
        with room(archive.parent):
            (aside / "all").mkdir(parents=True)
        unpack(
            archive,
            aside / "all",
            progress=lambda done, total: watch.progress(f"unpacking {entry.name}", done, total),
        )
        staged = aside / entry.folder
        with room(archive.parent):
            _root(aside / "all").rename(staged)
        _complete(staged)
        files, size = _count(staged)
        record = {
            "name": entry.name,
            "url": url,
            "sha256": sha256,
            "checked_by": checked_by,
            "licence": entry.data_set.licence,
            "page": entry.data_set.page,
            "files": files,
            "bytes": size,
        }
        write_atomically(staged / RECORD, json.dumps(record, indent=2) + "\n")
        _see_that_it_opens(staged, entry)
        with room(archive.parent):
            if target.is_dir():
                target.rmdir()  # an empty one, which not every system renames onto
            staged.rename(target)
    finally:
        _remove(aside)
    return target


def _root(folder: Path) -> Path:
    """Find the recording in what was unpacked: all of it, or the one folder in it."""
    inside = list(folder.iterdir())
    if not inside:
        raise ArchiveError("there is nothing in the archive")
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else folder


def _complete(folder: Path) -> None:
    """Write the list of pairs where an archive has numbered images and no list (ICL-NUIM)."""
    from edvo.datasets.tum import PAIR_LISTS, lists_in

    if lists_in(folder) is not None:
        return
    colour, depth = (
        {int(file.stem) for file in (folder / kind).glob("*.png") if file.stem.isdecimal()}
        for kind in ("rgb", "depth")
    )
    rows = [
        f"{index} depth/{index}.png {index} rgb/{index}.png\n" for index in sorted(colour & depth)
    ]
    if rows:
        write_atomically(folder / PAIR_LISTS[0], "".join(rows))


def _see_that_it_opens(folder: Path, entry: Entry) -> None:
    from edvo.datasets.registry import open_source

    try:
        source = open_source(folder)
        first = source.read(0)
    except EdvoError as error:
        raise ArchiveError(f"what is in {entry.file} is no recording ({error})") from error
    if first.frame is None:
        raise ArchiveError(f"what is in {entry.file} cannot be read ({first.problem})")


def _there(folder: Path, wanted: str | None, watch: Watch) -> Fetched | None:
    """Say whether a sequence is there; raises `DatasetError` if something else is."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return None
    if not folder.is_dir():
        raise OutputError(f"{folder} is in the way; remove it or choose another folder with -o")
    mend = f"remove {folder} to fetch it, or choose another folder with -o"
    record = _read_record(folder)
    if record is None:
        from edvo.datasets.registry import open_source

        try:
            open_source(folder)
        except EdvoError as error:
            raise DatasetError(f"{folder} is there and cannot be read ({error}); {mend}") from error
        watch.note(f"{folder} is there and can be read; whether it is whole, nothing tells")
        return Fetched(folder, None, None, new=False)
    files, size = _count(folder)
    if files < record["files"] or size < record["bytes"]:
        raise DatasetError(
            f"{folder} is not whole: {files} of {record['files']} files, {size} of "
            f"{record['bytes']} bytes; {mend}"
        )
    if wanted not in (None, record["sha256"]):
        raise DatasetError(
            f"{folder} is from an archive of checksum {record['sha256']}, not {wanted}; {mend}"
        )
    watch.note(f"{folder} is complete: not fetched again")
    return Fetched(folder, record["sha256"], record["checked_by"], new=False)


def _read_record(folder: Path) -> dict[str, Any] | None:
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        whole = isinstance(record["files"], int) and isinstance(record["bytes"], int)
        return record if whole and {"sha256", "checked_by"} <= record.keys() else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _count(folder: Path) -> tuple[int, int]:
    """Count files and their bytes, but for the record."""
    sizes = [
        file.stat().st_size
        for file in folder.rglob("*")
        if file.is_file() and file != folder / RECORD
    ]
    return len(sizes), sum(sizes)


def _remove(folder: Path) -> None:
    with room(folder.parent), contextlib.suppress(FileNotFoundError):
        shutil.rmtree(folder)


@contextmanager
def _alone(out: Path, entry: Entry) -> Iterator[None]:
    """Keep another process from fetching the same into the same place."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        yield
        return
    lock = out / f".{entry.folder}.lock"
    with room(out):
        stream = lock.open("w")
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(
                f"another edvo fetch is at {entry.name} in {out}; wait for it"
            ) from error
        except OSError:  # a network disk without locks
            pass
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)
