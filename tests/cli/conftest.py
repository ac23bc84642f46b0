"""A command line to call, and a small recording to call it on."""

import errno
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
