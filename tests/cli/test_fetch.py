"""`edvo fetch`: what it shows, prints and leaves behind; from a server on this machine."""

import contextlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from edvo.datasets.fetching import catalogue, find

from ..datasets import fetch_server as web  # noqa: TID252 - tests is no package to import by name
from .conftest import Command

NAME = "fr1/rpy"  # no sum of it is in the catalogue
ENTRY = find(NAME)
ICL = find("icl/lr_kt3n")
MAIN = "from edvo.cli import main; main()"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[web.Server]:
    monkeypatch.delenv("EDVO_DATA", raising=False)
    with web.serving(monkeypatch) as server:
        yield server


@pytest.fixture
def archive(server: web.Server, whole_sequence: Path) -> bytes:
    content = web.tgz(whole_sequence, top=ENTRY.folder)
    server.files[f"/{ENTRY.file}"] = content
    return content


def test_without_a_name_it_lists_and_asks_nobody(edvo: Command, tmp_path: Path) -> None:
    done = edvo("fetch")
    assert done.status == 0
    assert done.out == edvo("fetch", "--list").out
    for entry in catalogue():
        assert f"\n{entry.name} " in done.out
    for words in ("CC BY 4.0", "CC BY 3.0", "none stated", "2.20 GB", "~0.52 GB", "?", "known"):
        assert words in done.out
    assert not done.err


def test_fetch_then_run(edvo: Command, server: web.Server, archive: bytes, tmp_path: Path) -> None:
    out = tmp_path / "data"
    done = edvo("fetch", "freiburg1_rpy", "-o", out, "--mirror", server.url)
    assert done.status == 0
    assert done.out == f"{out / ENTRY.folder}\n"
    assert "no checksum of rgbd_dataset_freiburg1_rpy.tgz is known" in done.err
    assert "not checked; licence: CC BY 4.0" in done.err
    again = edvo("fetch", NAME, "-o", out)  # no mirror: nobody is asked
    assert (again.status, again.out) == (0, done.out)
    assert "is complete: not fetched again" in again.err
    ran = edvo("run", done.out.strip(), "-o", tmp_path / "results", "--max-frames", "12")
    assert ran.status == 0, ran.err


def test_icl_nuim_runs_as_it_was_fetched(
    edvo: Command, server: web.Server, whole_sequence: Path, tmp_path: Path
) -> None:
    """Its archives have no folder of their own, numbers for times and y up."""
    folder = shutil.copytree(whole_sequence, tmp_path / "icl")
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        (folder / name).unlink()
    rows, poses = [], []
    for index in range(12):
        rows.append(f"{index} depth/{index}.png {index} rgb/{index}.png\n")
        if index:
            poses.append(f"{index} {0.02 * index:.6f} 0 0 0 0 0 1\n")
    (folder / "associations.txt").write_text("".join(rows))
    (folder / "livingRoom3n.gt.freiburg").write_text("".join(poses))
    server.files[f"/{ICL.file}"] = web.tgz(folder, top=None)
    done = edvo("fetch", ICL.name, "-o", tmp_path / "data", "--mirror", server.url)
    assert done.status == 0, done.err
    ran = edvo("run", done.out.strip(), "-o", tmp_path / "results")
    assert ran.status == 0, ran.err
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    assert summary["source"]["format"] == "icl"


def test_several(edvo: Command, server: web.Server, archive: bytes, tmp_path: Path) -> None:
    other = find("fr3/cabinet")
    server.files[f"/{other.file}"] = archive
    names = [NAME, "fr3_cabinet", ENTRY.folder]
    done = edvo("fetch", *names, "-o", tmp_path, "--mirror", server.url)
    assert done.status == 0
    assert done.out == f"{tmp_path / ENTRY.folder}\n{tmp_path / other.folder}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fr1/xzy"], "did you mean fr1/xyz"),
        ([NAME, "fr1/xzy"], "did you mean fr1/xyz"),
        ([NAME, "--mirror", "nowhere"], "is no address of a server"),
        ([NAME, "--checksum", "abc"], "is no SHA-256 checksum"),
        ([NAME, "fr1/xyz", "--checksum", "0" * 64], "give one sequence"),
        ([NAME, "-o", "/dev/null/x"], "cannot write"),
    ],
)
def test_wrong_words_are_one_line(
    edvo: Command,
    server: web.Server,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [*arguments, *([] if "--mirror" in arguments else ["--mirror", server.url])]
    done = edvo("fetch", *arguments)
    assert done.status == 1
    assert words in done.err
    assert done.err.count("\n") == 1
    assert not done.out
    assert not server.asked


def test_what_is_not_there_is_one_line(edvo: Command, server: web.Server, tmp_path: Path) -> None:
    done = edvo("fetch", NAME, "-o", tmp_path, "--mirror", server.url)
    assert done.status == 1
    assert done.err.splitlines()[-1].startswith(f"edvo: {server.url}{ENTRY.file} is not there")
    assert "Traceback" not in done.err
    assert not list(tmp_path.iterdir())


def test_a_wrong_checksum_is_one_line(
    edvo: Command, server: web.Server, archive: bytes, tmp_path: Path
) -> None:
    done = edvo(
        "fetch", NAME, "-o", tmp_path, "--mirror", server.url, "--checksum", "sha256:" + "0" * 64
    )
    assert done.status == 1
    assert "wrong checksum" in done.err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_the_folder_of_the_environment(
    edvo: Command,
    server: web.Server,
    archive: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("EDVO_DATA", str(tmp_path / "all"))
    assert edvo("fetch", NAME, "--mirror", server.url).out == f"{tmp_path / 'all' / ENTRY.folder}\n"


def start(*arguments: object, **options: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", MAIN, "fetch", *map(str, arguments)]
    return subprocess.Popen(command, start_new_session=True, **options)  # type: ignore[call-overload]


def wait_for(file: Path, size: int) -> None:
    for _ in range(2400):
        with contextlib.suppress(FileNotFoundError):
            if file.stat().st_size >= size:
                return
        time.sleep(0.05)
    raise AssertionError(f"{file} does not come")


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_says_how_to_go_on(
    edvo: Command,
    server: web.Server,
    archive: bytes,
    tmp_path: Path,
    how: signal.Signals,
    status: int,
) -> None:
    content = archive + bytes(200_000)  # zeros after the end of an archive are padding
    server.files[f"/{ENTRY.file}"] = content
    # The first question is for the address below a mirror, which this one does not have.
    server.acts = [web.stalls(100_000)]
    arguments = [NAME, "-o", tmp_path, "--mirror", server.url]
    process = start(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    part = tmp_path / f"{ENTRY.file}.part"
    wait_for(part, 100_000)
    os.kill(process.pid, how)
    out, errors = (text.decode() for text in process.communicate(timeout=300))
    assert process.returncode == status
    assert not out
    last = errors.splitlines()[-1]
    assert last.startswith(f"edvo: interrupted; 0.1 MB are kept in {part}, to go on: edvo fetch")
    assert shlex.split(last.split("to go on: ")[1]) == ["edvo", "fetch", *map(str, arguments)]
    assert "Traceback" not in errors
    assert part.read_bytes() == content[:100_000]
    server.asked.clear()
    assert edvo("fetch", *arguments).status == 0
    assert server.asked[1] == (f"/{ENTRY.file}", "bytes=100000-")
    assert not part.exists()


def test_a_bar_on_a_terminal_only(server: web.Server, archive: bytes, tmp_path: Path) -> None:
    arguments = [NAME, "-o", tmp_path / "one", "--mirror", server.url]
    piped = start(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert b"\x1b" not in piped.communicate(timeout=300)[1]
    master, terminal = pytest.importorskip("pty").openpty()
    arguments[2] = tmp_path / "two"
    shown = start(*arguments, stdout=subprocess.PIPE, stderr=terminal)
    os.close(terminal)
    text = b""
    with contextlib.suppress(OSError):  # what the end of a terminal is on Linux
        while block := os.read(master, 4096):
            text += block
    os.close(master)
    assert shown.communicate(timeout=300)[0].decode() == f"{tmp_path / 'two' / ENTRY.folder}\n"
    assert b"unpacking fr1/rpy" in text
    assert b"\x1b" in text
