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
