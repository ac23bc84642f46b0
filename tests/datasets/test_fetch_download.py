"""Downloads from a server that breaks off, lies, stalls and changes its mind."""

import errno
import hashlib
import json
import os
import shutil
import socket
import tracemalloc
import urllib.request
from pathlib import Path

import pytest

from edvo.datasets.fetching import download as download_module
from edvo.datasets.fetching import transport
from edvo.datasets.fetching.download import ATTEMPTS, UNHEARD_ATTEMPTS, download, read_small
from edvo.datasets.fetching.transport import check_url
from edvo.errors import DatasetError, OutputError

from . import fetch_server as web

CONTENT = web.noise(700_000)
SUM = hashlib.sha256(CONTENT).hexdigest()

GIVE_UP = [web.says(503)] * (ATTEMPTS - 1)  # after an attempt that broke off


@pytest.fixture
def server(monkeypatch):
    with web.serving(monkeypatch) as server:
        server.files["/a.tgz"] = CONTENT
        yield server


@pytest.fixture
def waits(monkeypatch):
    """What was waited for, without waiting."""
    seconds: list[float] = []
    monkeypatch.setattr("time.sleep", seconds.append)
    return seconds


def start(server, tmp_path, **options) -> str:
    return download(server.url + "a.tgz", tmp_path / "a.tgz", **options)


def check_whole(tmp_path: Path, sha256: str) -> None:
    assert sha256 == SUM
    assert (tmp_path / "a.tgz").read_bytes() == CONTENT
    assert [file.name for file in tmp_path.iterdir()] == ["a.tgz"]


def fails(server, tmp_path, error=DatasetError) -> str:
    with pytest.raises(error) as caught:
        start(server, tmp_path)
    assert not (tmp_path / "a.tgz").exists()
    message = str(caught.value)
    assert "\n" not in message
    return message


def ranges(server) -> list[str | None]:
    return [asked for _, asked in server.asked]


def test_in_one_go(server, tmp_path, waits):
    seen = []
    sha256 = start(server, tmp_path, progress=lambda done, total: seen.append((done, total)))
    check_whole(tmp_path, sha256)
    assert ranges(server) == [None]
    assert seen[0] == (0, len(CONTENT))
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert seen == sorted(seen)
    assert not waits


def test_goes_on_where_it_broke_off(server, tmp_path, waits):
    server.acts = [web.breaks_off(100_000), web.breaks_off(250_000)]
    notes = []
    check_whole(tmp_path, start(server, tmp_path, note=notes.append))
    assert ranges(server) == [None, "bytes=100000-", "bytes=350000-"]
    assert len(notes) == 2
    assert "broke off after 100000 of 700000 bytes" in notes[0]


def test_many_breaks_are_no_failure_as_long_as_something_comes(server, tmp_path, waits):
    server.acts = [web.breaks_off(70_000) for _ in range(9)]
    check_whole(tmp_path, start(server, tmp_path))
    assert len(server.asked) == 10


def test_another_start_goes_on(server, tmp_path, waits):
    server.acts = [web.breaks_off(100000), *GIVE_UP]
    message = fails(server, tmp_path)
    assert "100000 bytes are kept in" in message
    assert (tmp_path / "a.tgz.part").read_bytes() == CONTENT[:100_000]
    server.asked.clear()
    notes = []
    check_whole(tmp_path, start(server, tmp_path, note=notes.append))
    assert ranges(server) == ["bytes=100000-"]
    assert notes == [f"going on after the 100000 bytes in {tmp_path / 'a.tgz.part'}"]


def test_a_whole_part_is_only_confirmed(server, tmp_path, waits):
    server.acts = [web.breaks_off(100000), *GIVE_UP]
    fails(server, tmp_path)
    (tmp_path / "a.tgz.part").write_bytes(CONTENT)
    check_whole(tmp_path, start(server, tmp_path))
    assert ranges(server)[-1] == f"bytes={len(CONTENT)}-"


def test_a_part_that_is_too_long_is_thrown_away(server, tmp_path, waits):
    server.acts = [web.breaks_off(100000), *GIVE_UP]
    fails(server, tmp_path)
    (tmp_path / "a.tgz.part").write_bytes(CONTENT + b"more")
    check_whole(tmp_path, start(server, tmp_path))


def test_parts_of_two_versions_are_not_joined(server, tmp_path, waits):
    server.files["/a.tgz"] = web.noise(len(CONTENT), seed=1)
    server.acts = [web.breaks_off(100000), *GIVE_UP]
    fails(server, tmp_path)
    server.files["/a.tgz"] = CONTENT
    check_whole(tmp_path, start(server, tmp_path))


def test_without_a_tag_another_length_is_another_version(server, tmp_path, waits):
    server.files["/a.tgz"] = web.noise(len(CONTENT) + 1, seed=1)
    server.acts = [web.breaks_off(100000, tag=False), *GIVE_UP]
    fails(server, tmp_path)
    server.files["/a.tgz"] = CONTENT
    server.acts = [lambda handler, content: web.behave(handler, content, tag=False)] * 2
    check_whole(tmp_path, start(server, tmp_path))


@pytest.mark.parametrize("memory", [None, "", "{", "[]", '{"url": 1}', '{"url": "http://other/"}'])
def test_a_part_of_unknown_origin_is_not_used(server, tmp_path, waits, memory):
    (tmp_path / "a.tgz.part").write_bytes(b"x" * 1000)
    if memory is not None:
        (tmp_path / "a.tgz.part.json").write_text(memory)
    check_whole(tmp_path, start(server, tmp_path))
    assert ranges(server) == [None]


def test_a_part_is_kept_until_something_comes_in_its_place(server, tmp_path, waits):
    server.acts = [web.breaks_off(100_000), *GIVE_UP]
    fails(server, tmp_path)
    with pytest.raises(DatasetError, match="is not there"):
        download(server.url + "other/a.tgz", tmp_path / "a.tgz")
    server.asked.clear()
    check_whole(tmp_path, start(server, tmp_path))
    assert ranges(server) == ["bytes=100000-"]


def test_a_server_that_knows_no_ranges(server, tmp_path, waits):
    server.acts = [web.knows_no_ranges(300_000), web.knows_no_ranges()]
    check_whole(tmp_path, start(server, tmp_path))


def test_one_that_never_comes_to_its_end(server, tmp_path, waits):
    server.acts = [web.knows_no_ranges(300_000)] * 20
    message = fails(server, tmp_path)
    assert f"broke off after 300000 of 700000 bytes, {ATTEMPTS} times" in message
    assert len(server.asked) == ATTEMPTS
    assert waits == [1, 2, 4, 8]


def test_a_length_that_is_a_lie(server, tmp_path, waits):
    server.acts = [web.lies_about_length(+5000)] * 20
    assert "broke off after 700000 of 705000 bytes" in fails(server, tmp_path)


def test_without_a_length(server, tmp_path, waits):
    server.acts = [web.says_no_length]
    check_whole(tmp_path, start(server, tmp_path))


def test_in_chunks(server, tmp_path, waits):
    server.acts = [
        lambda handler, content: web.in_chunks(handler, content, cut=True),
        web.in_chunks,
    ]
    check_whole(tmp_path, start(server, tmp_path))


def test_busy_then_well(server, tmp_path, waits):
    server.acts = [web.says(503, {"Retry-After": "7"}), web.says(500), web.says(429)]
    check_whole(tmp_path, start(server, tmp_path))
    assert waits == [7, 2, 4]


def test_a_server_that_wants_an_hour_does_not_get_it(server, tmp_path, waits):
    server.acts = [web.says(503, {"Retry-After": "3600"})]
    check_whole(tmp_path, start(server, tmp_path))
    assert waits == [60]


def test_redirects_are_followed_with_the_range(server, tmp_path, waits):
    server.files["/b.tgz"] = CONTENT
    there = web.says(302, {"Location": server.url + "b.tgz"})
    server.acts = [there, web.breaks_off(100_000), there]
    check_whole(tmp_path, start(server, tmp_path))
    assert server.asked[-1] == ("/b.tgz", "bytes=100000-")


@pytest.mark.parametrize("location", ["file:///etc/passwd", "ftp://127.0.0.1/a", "/a.tgz"])
def test_redirects_elsewhere_are_not(server, tmp_path, waits, location):
    server.acts = [web.says(302, {"Location": location})] * 20
    fails(server, tmp_path)
    assert len(server.asked) < 20


@pytest.mark.parametrize("location", ["http://b/a.tgz", "ftp://b/a.tgz", "file:///etc/passwd"])
def test_no_redirect_leaves_an_encrypted_connection(location):
    asked = urllib.request.Request("https://a/a.tgz")
    with pytest.raises(DatasetError, match="which is not encrypted; not followed"):
        transport._SafeRedirects().redirect_request(asked, None, 302, "Found", {}, location)
    followed = transport._SafeRedirects().redirect_request(
        asked, None, 302, "Found", {}, "https://b/a.tgz"
    )
    assert followed.full_url == "https://b/a.tgz"


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (web.says(404), "is not there (404 Not Found)"),
        (web.says(410), "is not there (410 Gone)"),
        (web.says(403), "refuses (403 Forbidden)"),
        (web.says(200, {"Content-Type": "text/html"}, b"<html>log in</html>"), "a web page"),
        (web.says(200), "is empty"),
    ],
)
def test_refusals_leave_nothing(server, tmp_path, waits, act, words):
    server.acts = [act] * 20
    assert words in fails(server, tmp_path)
    assert not list(tmp_path.iterdir())


def test_one_that_says_nothing(server, tmp_path, waits, monkeypatch):
    monkeypatch.setattr(transport, "TIMEOUT_S", 0.05)
    server.acts = [lambda handler, content: handler.server.go.wait(60)] * 20
    message = fails(server, tmp_path)
    assert f"127.0.0.1 has not answered for 0.05 s, {UNHEARD_ATTEMPTS} times" in message


def test_one_that_stops_in_the_middle(server, tmp_path, waits, monkeypatch):
    monkeypatch.setattr(transport, "TIMEOUT_S", 2.0)  # what comes at all comes within that
    server.acts = [web.stalls(200_000)]
    check_whole(tmp_path, start(server, tmp_path))
    assert ranges(server) == [None, "bytes=200000-"]


def test_nobody_there(tmp_path, waits, monkeypatch):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(DatasetError, match=r"127.0.0.1: no connection .*refused.*, 3 times"):
        download(f"http://127.0.0.1:{port}/a.tgz", tmp_path / "a.tgz")
    assert waits == [1, 2]
    assert not list(tmp_path.iterdir())


def test_no_network(tmp_path, waits, monkeypatch):
    def unknown(*arguments, **options):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(DatasetError, match=r"example.org is not found: no network, or a proxy"):
        download("https://example.org/a.tgz", tmp_path / "a.tgz")


def test_a_proxy_that_lets_nothing_through(server, tmp_path, waits, monkeypatch):
    monkeypatch.setenv("https_proxy", server.url.replace("//", "//user:secret@"))
    with pytest.raises(DatasetError) as caught:
        download("https://example.org/a.tgz", tmp_path / "a.tgz")
    assert "example.org: the proxy of https_proxy refuses (tunnel connection failed: 501" in str(
        caught.value
    )
    assert "secret" not in str(caught.value)


def test_a_proxy_is_used(server, tmp_path, waits, monkeypatch):
    monkeypatch.setenv("http_proxy", server.url)
    server.files["http://example.org/a.tgz"] = CONTENT
    check_whole(tmp_path, download("http://example.org/a.tgz", tmp_path / "a.tgz"))


def test_what_is_too_long_is_not_begun(server, tmp_path, waits, monkeypatch):
    monkeypatch.setattr(download_module, "LIMIT_BYTES", 600_000)
    assert "is said to have 700000 bytes" in fails(server, tmp_path)
    server.acts = [web.says_no_length]
    assert "does not end; stopped" in fails(server, tmp_path)


def test_no_room_for_it(server, tmp_path, waits, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=500_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    message = fails(server, tmp_path, OutputError)
    assert "1 MB more are needed and 0 MB are free; make room" in message


def test_a_disk_that_fills_up_keeps_what_is_there(server, tmp_path, waits, monkeypatch):
    real = download_module._Part.add
    written = 0

    def add(part, block):
        nonlocal written
        written += len(block)
        if written > 300_000:
            with download_module.room(part.file.parent):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(part, block)

    monkeypatch.setattr(download_module._Part, "add", add)
    assert "No space left on device; make room" in fails(server, tmp_path, OutputError)
    size = (tmp_path / "a.tgz.part").stat().st_size
    assert 0 < size <= 300_000
    monkeypatch.undo()
    check_whole(tmp_path, start(server, tmp_path))
    assert ranges(server)[-1] == f"bytes={size}-"


def test_a_folder_that_takes_nothing(server, tmp_path, waits):
    with pytest.raises(OutputError, match="choose another"):
        download(server.url + "a.tgz", tmp_path / "nowhere" / "a.tgz")


def test_memory_stays_small(server, tmp_path, waits):
    server.files["/a.tgz"] = bytes(40_000_000)
    start(server, tmp_path)
    (tmp_path / "a.tgz").unlink()
    tracemalloc.start()
    try:
        # The server is in this process too, and holds nothing new.
        start(server, tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 4_000_000
    finally:
        tracemalloc.stop()


def test_what_a_part_belongs_to_is_written_before_it(server, tmp_path, waits):
    server.acts = [web.breaks_off(0), *GIVE_UP]
    fails(server, tmp_path)
    server.acts = [web.breaks_off(10), *GIVE_UP]
    fails(server, tmp_path)
    memory = json.loads((tmp_path / "a.tgz.part.json").read_text())
    assert memory["url"] == server.url + "a.tgz"
    assert memory["total"] == len(CONTENT)


def test_small_texts(server, waits):
    server.files["/s"] = b"words"
    assert read_small(server.url + "s") == "words"
    assert read_small(server.url + "none") is None
    server.acts = [web.says(200, {"Content-Type": "text/html"})]
    assert read_small(server.url + "s") is None
    server.acts = [web.says(503), web.says(503)]
    assert read_small(server.url + "s") == "words"
    server.acts = [web.says(503)] * 3
    with pytest.raises(DatasetError, match="503"):
        read_small(server.url + "s")
    server.files["/s"] = bytes(2 << 20)
    with pytest.raises(DatasetError, match="too long"):
        read_small(server.url + "s")


@pytest.mark.parametrize("url", ["https://host/a", "http://host:8000", "http://[::1]:80/a/b/"])
def test_good_addresses(url):
    assert check_url(url) == url.rstrip("/") + "/"


@pytest.mark.parametrize(
    "url",
    [
        "",
        "host",
        "/data",
        "file:///data",
        "ftp://host/",
        "http://",
        "http://h:x",
        "http://me:secret@host/",
        "http://a b",
    ],
)
def test_bad_addresses(url):
    with pytest.raises(DatasetError, match="is no address of a server"):
        check_url(url)
