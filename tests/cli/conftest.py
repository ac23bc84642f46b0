"""A command line to call, and a small recording to call it on."""

import csv
import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
import pytest

from edvo.cli import main

WIDTH, HEIGHT, FOCAL, DEPTH_M = 160, 120, 150.0, 1.5
CAMERA = f"""width: {WIDTH}
height: {HEIGHT}
fx: {FOCAL}
fy: {FOCAL}
cx: 79.5
cy: 59.5
distortion: [0, 0, 0, 0, 0]
depth_scale: 5000
"""


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    status: int
    out: str
    err: str


Command = Callable[..., Outcome]


@pytest.fixture
def edvo(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """`edvo ARGUMENTS` as from a shell, but within this process."""
    threads = cv2.getNumThreads()

    def command(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["edvo", *map(str, arguments)])
        status = 0
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            cv2.setNumThreads(threads)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return command


# Says that it is in the middle, and waits there for a signal, however long that takes.
HALT = """
import os, signal
from contextlib import contextmanager
from edvo.cli import compare, live, main, run

reader, writer = os.pipe()
os.set_blocking(writer, False)
signal.set_wakeup_fd(writer)

def halt():
    print("in the middle", flush=True)
    os.read(reader, 1)

@contextmanager
def progress(what, total):
    count = 0
    def advance():
        nonlocal count
        count += 1
        if count == {steps}:
            halt()
    yield advance

{change}
main()
"""


def interrupted(
    change: str, *arguments: object, steps: int = 0, how: signal.Signals = signal.SIGINT
) -> Outcome:
    """Run a command in a process of its own, and interrupt it where a change of it calls `halt`.

    `progress`, put in the place of a command's own, does so after that many steps.
    """
    code = HALT.format(steps=steps, change=change)
    process = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "in the middle\n"
    os.killpg(process.pid, how)
    out, errors = process.communicate(timeout=300)
    return Outcome(process.returncode, out, errors)


@contextmanager
def interrupting(what: str, total: int) -> Iterator[Callable[[], None]]:
    """Stand in for a command's `progress`, and press Ctrl-C at the seventh step."""
    steps = iter(range(total))

    def advance() -> None:
        if next(steps) == 6:
            signal.raise_signal(signal.SIGINT)

    yield advance


def rows(folder: Path) -> list[dict[str, str]]:
    """Read the frames.csv of a run."""
    with (folder / "frames.csv").open() as stream:
        return list(csv.DictReader(stream))


def images_of(file: Path) -> int:
    """Count the images in a recording of the viewer's."""
    import rerun

    chunks = rerun.chunk.RrdReader(str(file)).stream().to_chunks()
    return sum(
        chunk.num_rows
        for chunk in chunks
        if chunk.entity_path == "/world/camera/image" and not chunk.is_static
    )


def stamp(index: int) -> str:
    """Give a time with its trailing zeros, which a float would lose."""
    return f"{1000 + index / 20:.4f}"


def position(index: int) -> float:
    """Say how far right the camera is, metres: two pixels a frame and back."""
    pixels = 2 * min(index, 40 - index)
    return pixels * DEPTH_M / FOCAL


def make_sequence(folder: Path, frames: int = 36) -> Path:
    """Write a recording of a wall of cards, past which the camera slides."""
    # Cards of all sizes: a regular pattern would look the same from several places.
    rng = np.random.default_rng(7)
    wall = np.full((240, 480), 120, np.uint8)
    cards = rng.integers((0, 0, 8, 8, 30), (470, 230, 60, 50, 225), (180, 5))
    for u, v, width, height, grey in cards:
        wall[v : v + height, u : u + width] = grey
    wall = cv2.GaussianBlur(wall, (3, 3), 0)
    depth = np.full((HEIGHT, WIDTH), int(DEPTH_M * 5000), np.uint16)
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for index in range(frames):
        left = 60 + round(position(index) * FOCAL / DEPTH_M)
        grey = wall[50 : 50 + HEIGHT, left : left + WIDTH]
        cv2.imwrite(str(folder / f"rgb/{index}.png"), cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
        cv2.imwrite(str(folder / f"depth/{index}.png"), depth)
        for kind in ("rgb", "depth"):
            lists[kind].append(f"{stamp(index)} {kind}/{index}.png")
        lists["groundtruth"].append(f"{stamp(index)} {position(index):.6f} 0 0 0 0 0 1")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("# a comment\n" + "\n".join(lines) + "\n")
    (folder / "camera.yaml").write_text(CAMERA)
    return folder


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """A recording that a test may spoil."""
    return make_sequence(tmp_path / "wall")


@pytest.fixture(scope="session")
def whole_sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording that no test may change."""
    return make_sequence(tmp_path_factory.mktemp("recordings") / "wall")


@contextmanager
def full_disk(files: int) -> Iterator[None]:
    """Let the disk be full after so many files."""
    replace, written = Path.replace, 0

    def refuse(self: Path, target: Path) -> Path:
        nonlocal written
        written += 1
        if written > files:
            raise OSError(errno.ENOSPC, "No space left on device")
        return replace(self, target)

    with patch.object(Path, "replace", refuse):
        yield
