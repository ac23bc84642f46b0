"""A recording played as a camera: at its pace, and without waiting for anyone."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.datasets import Reading, Source, open_source
from edvo.datasets.devices import device_kinds, open_device
from edvo.datasets.devices.replay import Replay
from edvo.errors import CameraError, DatasetError

STAMPS = [f"{100 + index / 10:.6f}" for index in range(20)]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    folder = tmp_path / "played"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        for index in range(20):
            image = np.full((48, 64), 40 + index, np.uint8 if kind == "rgb" else np.uint16)
            cv2.imwrite(str(folder / kind / f"{index}.png"), image)
        lines = [f"{stamp} {kind}/{index}.png" for index, stamp in enumerate(STAMPS)]
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    (folder / "camera.yaml").write_text(
        "{width: 64, height: 48, fx: 50, fy: 50, cx: 31.5, cy: 23.5, "
        "distortion: [0, 0, 0, 0, 0], depth_scale: 1000}"
    )
    return folder


class Time:
    """A clock that only waiting moves."""

    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


def play(
    source: Source, time: Time, rate: float, busy: dict[int, float]
) -> list[tuple[int, float]]:
    """Give which frames came when; `busy` is how long who takes them sits on one."""
    replay = Replay(source, rate=rate, now=time, wait=time.wait)
    came = []
    for reading in replay.readings():
        came.append((reading.index, time.now - 50.0))
        time.now += busy.get(reading.index, 0.0)
    assert replay.missed == 20 - len(came)
    return came


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_frames_come_when_they_were_taken(recording: Path, rate: float) -> None:
    came = play(open_source(recording), Time(), rate, {})
    np.testing.assert_array_equal([index for index, _ in came], range(20))
    np.testing.assert_allclose([when for _, when in came], np.arange(20) / 10 / rate, atol=1e-9)


def test_overdue_frames_are_missed_and_counted(recording: Path) -> None:
    came = play(open_source(recording), Time(), 1.0, {2: 1.0})
    indices = [index for index, _ in came]
    # Those that were being decoded still come, late; then the pace is kept again.
    assert indices[:6] == [0, 1, 2, 3, 4, 5]
    assert indices[6] >= 12
    assert indices[-1] == 19
    assert len(set(indices)) == len(indices)


def test_it_is_the_recording(recording: Path) -> None:
    device = open_device(f"replay:{recording}")
    assert (device.name, device.path, device.format) == ("played", recording, "replay")
    assert device.camera.fx == 50.0
    assert device.ground_truth is None
    first: Reading = next(device.readings())
    assert first.stamp == STAMPS[0]
    assert first.frame is not None
    assert first.frame.grey[0, 0] == 40
    device.close()


def test_another_camera_can_be_given(recording: Path, tmp_path: Path) -> None:
    text = (recording / "camera.yaml").read_text().replace("fx: 50", "fx: 51")
    (tmp_path / "other.yaml").write_text(text)
    device = open_device(f"replay:{recording}", camera=str(tmp_path / "other.yaml"))
    assert device.camera.fx == 51.0


@pytest.mark.parametrize(
    ("device", "named"),
    [("replay", "replay:PATH"), ("replay:/no/where", "/no/where"), ("webcam", "replay:RECORDING")],
)
def test_what_cannot_be_is_refused(device: str, named: str) -> None:
    with pytest.raises(DatasetError, match=named):
        open_device(device)


def test_a_missing_camera_file_is_named() -> None:
    with pytest.raises(CameraError, match=r"none\.yaml"):
        open_device("replay:.", camera="none.yaml")


def test_kinds_have_a_line_each() -> None:
    assert all(kind.about.startswith(kind.name) for kind in device_kinds())
