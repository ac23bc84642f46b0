"""One request over HTTP, and what can go wrong with it, in words."""

import http.client
import re
import socket
import ssl
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from email.message import Message
from typing import IO, Any
from urllib.parse import urlsplit

from edvo import __version__
from edvo.errors import DatasetError

TIMEOUT_S = 20.0
"""How long a server may say nothing, to a connection as to a request for more, seconds."""

_BLOCK = 1 << 16
_RETRIED = {408, 425, 429, 500, 502, 503, 504}
_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")
_NO_RANGE = re.compile(r"bytes \*/(\d+)")


class NotThereError(DatasetError):
    """The server has no such file."""


class WebPageError(DatasetError):
    """The server sends a page for people in place of the file."""


class TransientError(DatasetError):
    """What may be gone at the next attempt.

    Parameters
    ----------
    message : str
        For people.
    wait : float or None
        After how many seconds the server wants to be asked again, if it says so.
    heard : bool
        Whether there is a server at all.
    """

    def __init__(self, message: str, wait: float | None = None, *, heard: bool = True) -> None:
        super().__init__(message)
        self.wait, self.heard = wait, heard


@dataclass(frozen=True)
class Answer:
    """What a server sends.

    Parameters
    ----------
    start : int
        Which byte of the file comes first.
    total : int or None
        Bytes of the whole file, if it says so.
    validator : str or None
        What tells this version of the file from others: an ETag, or when it was changed.
    body : Iterator of bytes
        The bytes, as they come; raises `TransientError` if they cease.
    """

    start: int
    total: int | None
    validator: str | None
    body: Iterator[bytes]


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Follows no redirect from an encrypted connection to one that is not, or out of HTTP."""

    max_redirections = 5

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: http.client.HTTPMessage,
        newurl: str,
    ) -> urllib.request.Request | None:
        scheme = urlsplit(newurl).scheme
        if scheme not in ("http", "https") or (req.type == "https" and scheme != "https"):
            raise DatasetError(
                f"{req.full_url} redirects to {newurl}, which is not encrypted; not followed"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def check_url(url: str) -> str:
    """Let only addresses of web servers pass.

    Parameters
    ----------
    url : str
        What a user gave.

    Returns
    -------
    str
        The same, with a slash at its end.

    Raises
    ------
    DatasetError
        If it is no such address.
    """
    try:
        parts = urlsplit(url)
        good = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
        good = good and parts.username is None  # urllib would take it for the server's name
    except ValueError:
        good = False
    if not good or re.search(r"[\s\x00-\x1f?#]", url):
        raise DatasetError(f"'{url}' is no address of a server; give it as http://HOST/FOLDER")
    return url.rstrip("/") + "/"


@contextmanager
def ask(url: str, *, start: int = 0, validator: str | None = None) -> Iterator[Answer]:
    """Ask a server for a file.

    Parameters
    ----------
    url : str
        Its address; redirects are followed, proxies are those of the environment.
    start : int
        First byte wanted. The server may begin with the first of all.
    validator : str, optional
        Of the version of which a part is at hand; of any other version all is sent.

    Yields
    ------
    Answer

    Raises
    ------
    NotThereError, WebPageError, TransientError, DatasetError
        If it does not send it.
    """
    headers = {"User-Agent": f"edvo/{__version__}", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if validator is not None:
            headers["If-Range"] = validator
    request = urllib.request.Request(url, headers=headers)
    try:
        response = _opener().open(request, timeout=TIMEOUT_S)
    except urllib.error.HTTPError as error:
        with error:
            complete = _NO_RANGE.fullmatch(error.headers.get("Content-Range", ""))
            if start and error.code == 416:
                total = int(complete[1]) if complete else None
                yield Answer(0 if total != start else start, total, validator, iter(()))
                return
            raise _refusal(url, error.code, error.headers) from error
    except (OSError, http.client.HTTPException, UnicodeError) as error:
        raise _failure(url, error, heard=False) from error
    with response:
        kind = response.headers.get_content_type()
        if kind == "text/html":
            raise WebPageError(
                f"{url} sends a web page instead of the file; look at it in a browser: the file "
                "may have moved, or a login may be asked for"
            )
        yield Answer(*_span(response), _validator(response.headers), _read(response, url))


def _opener() -> urllib.request.OpenerDirector:
    # Handlers by hand: those urllib adds by itself would read local files and FTP as well.
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.ProxyHandler(),
        urllib.request.HTTPHandler(),
        urllib.request.HTTPSHandler(),
        urllib.request.HTTPDefaultErrorHandler(),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.UnknownHandler(),
        _SafeRedirects(),
    ):
        opener.add_handler(handler)
    return opener


def _span(response: Any) -> tuple[int, int | None]:
    headers: Message = response.headers
    if response.status == 206:
        match = _RANGE.fullmatch(headers.get("Content-Range", "").strip())
        if match is None:
            return -1, None
        return int(match[1]), None if match[2] == "*" else int(match[2])
    length = headers.get("Content-Length", "")
    return 0, int(length) if length.isdecimal() and len(length) < 20 else None


def _validator(headers: Message) -> str | None:
    tag: str | None = headers.get("ETag")
    if tag is not None and not tag.startswith("W/"):
        return tag
    return headers.get("Last-Modified")


def _read(response: Any, url: str) -> Iterator[bytes]:
    while True:
        try:
            block: bytes = response.read1(_BLOCK)
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise _failure(url, error) from error
        if not block:
            return
        yield block


def _refusal(url: str, code: int, headers: Message) -> DatasetError:
    said = f"{code} {http.client.responses.get(code, '')}".strip()
    if code in (404, 410):
        return NotThereError(f"{url} is not there ({said}); see its data set's page, or --mirror")
    if code in _RETRIED:
        after = headers.get("Retry-After", "")
        wait = float(after) if after.isdecimal() and len(after) < 5 else None
        return TransientError(f"{url}: the server cannot send it now ({said})", wait)
    if code == 407:
        return DatasetError(f"{url}: the proxy wants a login ({said}); see {_proxy(url)}")
    return DatasetError(f"{url}: the server refuses ({said}); try --mirror URL")


def _failure(url: str, error: Exception, *, heard: bool = True) -> DatasetError:
    """Say why there is no connection, and whether another attempt makes sense."""
    reason = error.reason if isinstance(error, urllib.error.URLError) else error
    host = urlsplit(url).hostname
    proxy = _proxy(url)
    through = f" through the proxy of {proxy}" if proxy else ""
    if isinstance(reason, ssl.SSLCertVerificationError):
        return DatasetError(
            f"{host}: its certificate is not accepted ({reason.verify_message}); check the clock "
            "and the proxy"
        )
    if isinstance(reason, socket.gaierror):
        where = f"the proxy of {proxy}" if proxy else host
        words = f"{where} is not found: no network, or a proxy must be set"
        return TransientError(words, heard=False)
    if isinstance(reason, TimeoutError):
        words = f"{host} has not answered{through} for {TIMEOUT_S:g} s"
        return TransientError(words, heard=heard)
    if isinstance(reason, UnicodeError | http.client.InvalidURL):
        return DatasetError(f"{url}: no such address can be; check it")
    words = (getattr(reason, "strerror", None) or str(reason) or type(reason).__name__).lower()
    if proxy and words.startswith("tunnel connection failed"):
        return DatasetError(f"{host}: the proxy of {proxy} refuses ({words})")
    words = " ".join(words.split())
    return TransientError(f"{host}: no connection{through} ({words})", heard=heard)


def _proxy(url: str) -> str | None:
    """Name the variable that sets a proxy for an address; never its value, which may hold words."""
    parts = urlsplit(url)
    if urllib.request.proxy_bypass(parts.hostname or ""):
        return None
    return f"{parts.scheme}_proxy" if parts.scheme in urllib.request.getproxies() else None
