"""A web server on this machine, which can be told to misbehave, and archives for it."""

import gzip
import hashlib
import io
import re
import tarfile
import threading
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

Act = Callable[["Handler", bytes], None]


class Handler(BaseHTTPRequestHandler):
    """Answers as the server's `acts` say, one after the other, then as it should."""

    protocol_version = "HTTP/1.1"
    server: "Server"

    def do_GET(self) -> None:
        self.close_connection = True
        self.server.asked.append((self.path, self.headers.get("Range")))
        content = self.server.files.get(self.path)
        if content is None:
            send(self, 404, b"nothing here")
        elif self.server.acts and not self.path.endswith("SHA256SUMS"):
            self.server.acts.pop(0)(self, content)
        else:
            behave(self, content)

    def log_message(self, format: str, *args: object) -> None:
        pass


class Server(ThreadingHTTPServer):
    """Files by path, what to do at the next requests, and what was asked."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.files: dict[str, bytes] = {}
        self.acts: list[Act] = []
        self.asked: list[tuple[str, str | None]] = []
        self.url = f"http://127.0.0.1:{self.server_port}/"
        self.go = threading.Event()

    def handle_error(self, request: object, client_address: object) -> None:
        pass  # a client that went away


@contextmanager
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """Run a server, with no proxy on the way to it."""
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    with Server() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield server
        finally:
            server.go.set()
            server.shutdown()
            thread.join()


def send(
    handler: Handler,
    status: int,
    body: bytes,
    headers: Mapping[str, str] | None = None,
    *,
    length: int | None = None,
    tag: bool = True,
) -> None:
    handler.send_response(status)
    for name, value in (headers or {}).items():
        handler.send_header(name, value)
    if tag:
        whole = handler.server.files.get(handler.path, b"")
        handler.send_header("ETag", f'"{hashlib.md5(whole).hexdigest()}"')
    if length is None or length >= 0:
        handler.send_header("Content-Length", str(len(body) if length is None else length))
    handler.send_header("Connection", "close")
    handler.end_headers()
    handler.wfile.write(body)


def behave(handler: Handler, content: bytes, *, cut: int | None = None, tag: bool = True) -> None:
    """Answer as a good server does, but for a body that ends after so many bytes."""
    match = re.fullmatch(r"bytes=(\d+)-", handler.headers.get("Range", ""))
    same = handler.headers.get("If-Range") in (None, f'"{hashlib.md5(content).hexdigest()}"')
    if not match or not same:
        send(handler, 200, content[:cut], length=len(content), tag=tag)
        return
    start = int(match[1])
    if start >= len(content):
        send(handler, 416, b"", {"Content-Range": f"bytes */{len(content)}"})
        return
    span = {"Content-Range": f"bytes {start}-{len(content) - 1}/{len(content)}"}
    body = content[start:] if cut is None else content[start : start + cut]
    send(handler, 206, body, span, length=len(content) - start, tag=tag)


def breaks_off(after: int, *, tag: bool = True) -> Act:
    return lambda handler, content: behave(handler, content, cut=after, tag=tag)


def says(status: int, headers: Mapping[str, str] | None = None, body: bytes = b"") -> Act:
    return lambda handler, content: send(handler, status, body, headers)


def lies_about_length(by: int) -> Act:
    return lambda handler, content: send(handler, 200, content, length=len(content) + by)


def knows_no_ranges(after: int | None = None) -> Act:
    return lambda handler, content: send(handler, 200, content[:after], length=len(content))


def says_no_length(handler: Handler, content: bytes) -> None:
    send(handler, 200, content, length=-1)


def in_chunks(handler: Handler, content: bytes, *, cut: bool = False) -> None:
    handler.send_response(200)
    handler.send_header("Transfer-Encoding", "chunked")
    handler.end_headers()
    size = 10_000
    for start in range(0, len(content) // 2 if cut else len(content), size):
        block = content[start : start + size]
        handler.wfile.write(f"{len(block):x}\r\n".encode() + block + b"\r\n")
    if not cut:
        handler.wfile.write(b"0\r\n\r\n")


def stalls(after: int) -> Act:
    def act(handler: Handler, content: bytes) -> None:
        behave(handler, content, cut=after)
        handler.wfile.flush()
        handler.server.go.wait(60)

    return act


def noise(size: int, seed: int = 0) -> bytes:
    """Bytes that no packer makes smaller."""
    block, blocks = hashlib.sha256(bytes([seed])).digest(), []
    while len(blocks) * 32 < size:
        blocks.append(block)
        block = hashlib.sha256(block).digest()
    return b"".join(blocks)[:size]


def tgz(folder: Path, *, top: str | None) -> bytes:
    """Pack a folder, in a folder of its own or flat."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as archive:
        if top is not None:
            archive.add(folder, arcname=top)
        else:
            for file in sorted(folder.iterdir()):
                archive.add(file, arcname=file.name)
    return buffer.getvalue()


def zipped(folder: Path, *, top: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, f"{top}/{file.relative_to(folder).as_posix()}")
    return buffer.getvalue()


def tar_of(*members: tuple[tarfile.TarInfo, bytes], format: int = tarfile.GNU_FORMAT) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=format) as archive:
        for info, content in members:
            archive.addfile(info, io.BytesIO(content))
    return gzip.compress(buffer.getvalue())


def member(name: str, content: bytes = b"", **fields: object) -> tuple[tarfile.TarInfo, bytes]:
    info = tarfile.TarInfo(name)
    info.size = len(content)
    for key, value in fields.items():
        setattr(info, key, value)
    return info, content
