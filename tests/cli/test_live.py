"""`edvo live`: the files of a run, from something that does not wait."""

import json
import signal
from collections.abc import Generator
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.config import Config
from edvo.datasets import Reading, open_source
from edvo.datasets.devices.replay import Replay
from edvo.errors import DatasetError
from edvo.trajectory import Trajectory

from .conftest import Command, images_of, interrupted, rows, stamp


class Fake:
    """A camera that gives its frames at once, and may fail."""

    format = "fake"
    sensor = "realsense_d415"
    missed = 0

    def __init__(self, recording: Path, fails_after: int | None = None) -> None:
        self._source = open_source(recording)
        self.name, self.path = "fake 1", Path("fake")
        self.camera, self.camera_origin = self._source.camera, "the device"
        self.ground_truth = None
        self.closed = False
        self._fails_after = fails_after

    def readings(self) -> Generator[Reading, None, None]:
        for index in range(len(self._source)):
            if index == self._fails_after:
                raise DatasetError("fake 1: unplugged; plug it in")
            yield self._source.read(index)

    def close(self) -> None:
        self.closed = True


def test_writes_what_run_writes(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    done = edvo("live", f"replay:{whole_sequence}", "-o", tmp_path / "out")
    assert done.status == 0, done.err
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        "trajectory.txt",
        "frames.csv",
        "summary.json",
        "config.yaml",
    }
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    found = rows(tmp_path / "out")
    frames = summary["frames"]
    assert frames["processed"] == len(found) >= 1
    assert frames["processed"] + frames["dropped"] == 36
    assert f"dropped {frames['dropped']} of 36 frames" in done.err
    assert {row["timestamp"] for row in found} <= {stamp(index) for index in range(36)}
    kept = [row["timestamp"] for row in found if row["status"] != "lost"]
    assert list(Trajectory.read(tmp_path / "out/trajectory.txt").stamps) == kept
    assert summary["source"]["format"] == "replay"
    assert summary["interrupted"] is False


def test_leaves_nothing_of_a_run_before(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    assert edvo("run", whole_sequence, "-o", tmp_path, "--export", "kitti").status == 0
    (tmp_path / "mine.txt").write_text("mine")
    assert edvo("live", f"replay:{whole_sequence}", "-o", tmp_path).status == 0
    assert len(list(tmp_path.iterdir())) == 5
    assert (tmp_path / "mine.txt").exists()


def test_a_mask_leaves_out_what_is_not_of_the_scene(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    shown = np.full((120, 160), 255, np.uint8)
    shown[:, :80] = 0
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), shown)
    device, found = f"replay:{whole_sequence}", []
    for name, more in (("out", ("--mask", mask)), ("all", ())):
        done = edvo("live", device, "-o", tmp_path / name, "--max-frames", 1, *more)
        assert done.status == 0, done.err
        (row,) = rows(tmp_path / name)
        found.append(int(row["samples"]))
    assert 0.2 < found[0] / found[1] < 0.8
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["source"]["mask"] == {"path": str(mask), "left_out": 0.5}


def test_a_mask_of_another_size_is_told_at_once(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.eye(30, dtype=np.uint8))
    done = edvo("live", f"replay:{whole_sequence}", "-o", tmp_path / "out", "--mask", mask)
    assert done.status == 1
    assert done.err.splitlines()[-1].endswith("give one of their size")
    assert not (tmp_path / "out").exists()


def test_a_camera_that_fails_leaves_its_results(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = Fake(whole_sequence, fails_after=8)
    monkeypatch.setattr("edvo.cli.live.open_device", lambda which, camera: device)
    done = edvo("live", "fake", "-o", tmp_path)
    assert done.status == 1
    assert "unplugged" in done.err
    assert str(tmp_path) in done.err.splitlines()[-1]
    assert device.closed
    assert (
        len(rows(tmp_path))
        + json.loads((tmp_path / "summary.json").read_text())["frames"]["dropped"]
        == 8
    )


def test_a_camera_without_a_frame_writes_nothing(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = Fake(whole_sequence, fails_after=0)
    monkeypatch.setattr("edvo.cli.live.open_device", lambda which, camera: device)
    done = edvo("live", "fake", "-o", tmp_path)
    assert done.status == 1
    assert "unplugged" in done.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "taken"),
    [
        ((), "realsense_d415"),
        (("--set", "planes.sensor=azure_kinect"), "azure_kinect"),
        (("--config", "mine.yaml"), "kinect_v1"),
    ],
)
def test_depth_is_as_noisy_as_the_devices_unless_told_otherwise(
    edvo: Command,
    whole_sequence: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    given: tuple[str, ...],
    taken: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("planes: {weight: 0.5}\n")
    device = Fake(whole_sequence)
    monkeypatch.setattr("edvo.cli.live.open_device", lambda which, camera: device)
    done = edvo("live", "fake", "-o", "out", "--max-frames", 1, *given)
    assert done.status == 0, done.err
    assert Config.load(Path("out/config.yaml")).planes.sensor == taken
    assert ("realsense_d415" in done.err) == (taken == "realsense_d415")


def test_a_covered_lens_is_no_success(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    for file in (sequence / "depth").iterdir():
        cv2.imwrite(str(file), np.zeros((120, 160), np.uint16))
    done = edvo("live", f"replay:{sequence}", "-o", tmp_path / "out", "--max-frames", 3)
    assert done.status == 1
    assert "no valid depth" in done.err.splitlines()[-1]
    assert all(row["status"] == "lost" for row in rows(tmp_path / "out"))


def test_shows_itself(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="pip install 'edvo[view]'")
    file = tmp_path / "seen.rrd"
    done = edvo("live", f"replay:{whole_sequence}", "-o", tmp_path, "--save-view", file)
    assert done.status == 0, done.err
    assert images_of(file) == len(rows(tmp_path))


def test_ends_after_so_many_frames(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    done = edvo("live", f"replay:{whole_sequence}", "-o", tmp_path, "--max-frames", 1)
    assert done.status == 0, done.err
    assert len(rows(tmp_path)) == 1


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_interrupting_keeps_the_results(
    whole_sequence: Path, tmp_path: Path, how: signal.Signals
) -> None:
    halting = """
after = live._Line.after
def tell(self, record, dropped):
    after(self, record, dropped)
    halt()
live._Line.after = tell
"""
    done = interrupted(halting, "live", f"replay:{whole_sequence}", "-o", tmp_path, how=how)
    assert done.status == 0, done.err
    assert "Traceback" not in done.err
    assert len(rows(tmp_path)) == 1  # the one in hand
    assert (tmp_path / "summary.json").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["webcam", "-o", "x"], "webcam"), (["replay:/no/where", "-o", "x"], "/no/where")],
)
def test_what_is_no_camera(
    edvo: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = edvo("live", *arguments)
    assert done.status == 1
    assert named in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_lists_what_there_is(edvo: Command) -> None:
    done = edvo("live", "--list")
    assert done.status == 0
    assert "replay" in done.out


def test_needs_a_device_and_a_folder(edvo: Command) -> None:
    assert edvo("live").status == 2
    assert edvo("live", "realsense").status == 2


def test_replay_is_a_device(whole_sequence: Path) -> None:
    with pytest.raises(DatasetError, match="rate"):
        Replay(open_source(whole_sequence), rate=0.0)
