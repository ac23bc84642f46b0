"""Which sequences can be fetched: names, addresses, sizes, licences, checksums."""

import difflib
import re
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import PurePosixPath
from typing import Any

from edvo.errors import DatasetError

_ARCHIVES = (".tar.gz", ".tgz", ".zip")
_ALL_BUT_WORDS = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True)
class DataSet:
    """Sequences that were published together.

    Parameters
    ----------
    title : str
        Its name and where it was published.
    page : str
        Its own page.
    licence : str
        As that page states it.
    base : str
        Address that those of the archives begin with, up to a slash.
    """

    title: str
    page: str
    licence: str
    base: str


@dataclass(frozen=True)
class Entry:
    """A sequence.

    Parameters
    ----------
    name : str
        As ``fr1/xyz``.
    data_set : DataSet
        Where it belongs.
    archive : str
        Where its archive is, from the base of the data set on.
    folder : str
        What it is called when unpacked.
    size : int or None
        Bytes of the archive, if known.
    exact : bool
        Whether that is not rounded.
    sha256 : str or None
        Checksum of the archive, hexadecimal, if known.
    """

    name: str
    data_set: DataSet
    archive: str
    folder: str
    size: int | None = None
    exact: bool = False
    sha256: str | None = None

    @property
    def file(self) -> str:
        """Name of the archive."""
        return PurePosixPath(self.archive).name

    @property
    def url(self) -> str:
        """Address of the archive."""
        return self.data_set.base + self.archive


@cache
def catalogue() -> tuple[Entry, ...]:
    """List what can be fetched.

    Returns
    -------
    tuple of Entry
        Those of a data set side by side.
    """
    import yaml

    text = resources.files(__package__).joinpath("catalogue.yaml").read_text(encoding="utf-8")
    entries = []
    for stated in yaml.safe_load(text):
        data_set = DataSet(stated["title"], stated["page"], stated["licence"], stated["base"])
        for name, facts in stated["sequences"].items():
            entries.append(_entry(name, data_set, facts))
    return tuple(entries)


def find(name: str) -> Entry:
    """Find a sequence.

    Parameters
    ----------
    name : str
        Its name, with any character between its words; ``freiburg1_xyz``, ``tum_fr1_xyz`` and the
        name of its archive or folder do as well.

    Returns
    -------
    Entry

    Raises
    ------
    DatasetError
        If there is none; with those whose names are like it.
    """
    known = {_words(entry.name): entry for entry in catalogue()}
    for entry in catalogue():
        for other in (_stem(entry.file), entry.folder):
            known.setdefault(_words(other), entry)
    wanted = _words(_stem(name.rstrip("/").rsplit("/", 1)[-1] if _is_archive(name) else name))
    if wanted in known:
        return known[wanted]
    near = difflib.get_close_matches(wanted, known, n=6, cutoff=0.5)
    near += [words for words in known if wanted and wanted in words]
    names = list(dict.fromkeys(known[words].name for words in near))[:3]
    hint = f"did you mean {' or '.join(names)}? " if names else ""
    raise DatasetError(f"no sequence '{name}' to fetch; {hint}edvo fetch --list shows all")


def _entry(name: str, data_set: DataSet, facts: dict[str, Any]) -> Entry:
    return Entry(
        name=name,
        data_set=data_set,
        archive=facts["archive"],
        folder=facts.get("folder", _stem(PurePosixPath(facts["archive"]).name)),
        size=facts.get("bytes", facts.get("about")),
        exact="bytes" in facts,
        sha256=facts.get("sha256"),
    )


def _is_archive(name: str) -> bool:
    return name.lower().endswith(_ARCHIVES)


def _stem(file: str) -> str:
    for suffix in _ARCHIVES:
        if file.lower().endswith(suffix):
            return file[: -len(suffix)]
    return file


def _words(name: str) -> str:
    """Bring the ways of writing a name together."""
    plain = _ALL_BUT_WORDS.sub("_", name.lower()).strip("_")
    plain = re.sub(r"^(?:rgbd_dataset_|tum_)+", "", plain)
    plain = plain.removeprefix("rgbd_")
    return re.sub(r"^(?:freiburg|fr)_?([123])", r"fr\1", plain)
