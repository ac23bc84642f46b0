"""Which code made a result, so that none is taken for that of other code."""

import hashlib
from functools import cache
from pathlib import Path

import edvo

_PACKAGE = Path(edvo.__file__).parent
_ONLY_SHOW = ("cli", "report", "export")
_DECIDES = "report/compare_rule.py"


@cache
def code_digest(part: str = "") -> str:
    """Digest the source code that decides results.

    Parameters
    ----------
    part : str
        A package within edvo, such as ``synthesis``; all but what only shows results by default.

    Returns
    -------
    str
        Twelve hexadecimal digits, the same for the same code.
    """
    digest = hashlib.sha256()
    for file in sorted((_PACKAGE / part).rglob("*")):
        place = file.relative_to(_PACKAGE)
        shows = place.parts[0] in _ONLY_SHOW and place.as_posix() != _DECIDES
        if file.suffix in (".py", ".yaml") and not shows:
            digest.update(place.as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def recording_digest(path: Path) -> str:
    """Give a digest of a recording that changes with it, without reading its images.

    Parameters
    ----------
    path : pathlib.Path
        A file, or a folder whose lists and true poses lie beside folders of images.

    Returns
    -------
    str
        Twelve hexadecimal digits, made of the path and of name, size and time of those files.
    """
    place = path.resolve()
    files = sorted(place.iterdir()) if place.is_dir() else [place]
    told = [str(place)]
    for file in files:
        if file.is_file() and not file.name.startswith("."):
            status = file.stat()
            told.append(f"{file.name} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:12]
