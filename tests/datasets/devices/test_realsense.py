"""A RealSense camera, stood in for by the SDK's own software device."""

import sys
import threading
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets.devices import open_device
from edvo.datasets.devices.realsense import RealSense
from edvo.errors import DatasetError, MissingExtraError
from edvo.odometry import Odometry
from edvo.report.live import track_device

from ..realsense_files import Device, add_streams, load_sdk  # noqa: TID252 - as in cli/

CAMERA = Camera(640, 480, 600.0, 601.0, 320.5, 241.25)
DEPTH = Camera(640, 480, 590.0, 590.0, 322.0, 238.0)
INVERSE = (0.09, -0.05, 0.001, 0.002, 0.01)
LATE_S = 0.003  # depth after colour


class Software:
    """A software device that shows a wall 1.5 m away, 30 times a second."""

    def __init__(self, *, colour: bool = True) -> None:
        rs = load_sdk()
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Fake D435")
        self.device.register_info(rs.camera_info.serial_number, "0123")
        T_colour_depth = np.eye(4)
        T_colour_depth[0, 3] = 0.015
        told = Device(CAMERA, DEPTH, T_colour_depth, coefficients=INVERSE, units=0.0005)
        self.streams = add_streams(self.device, told, colour=colour)
        self._stop = threading.Event()

    def play(self, gaps: bool = False) -> None:
        """Send until it is stopped; with `gaps`, three images of seven are never sent."""
        rng = np.random.default_rng(5)
        colour = np.kron(rng.integers(30, 220, (24, 32, 3)), np.ones((20, 20, 1))).astype(np.uint8)
        depth = np.full((480, 640), 3000, np.uint16)
        depth[:50] = 0
        start = time.time()
        for number in count():
            if self._stop.is_set():
                return
            if not gaps or number % 7 < 4:
                for stream, image in zip(self.streams, (depth, colour), strict=True):
                    late = LATE_S if image is depth else 0.0
                    stream.send(image, number, start + number / 30 + late)
            time.sleep(1 / 30)

    def stop(self) -> None:
        self._stop.set()


@pytest.fixture
def software(monkeypatch: pytest.MonkeyPatch) -> Iterator[Software]:
    monkeypatch.setattr("edvo.datasets.devices.waiting.LONGEST_S", 60.0)
    made = Software()
    yield made
    made.stop()


def test_gives_aligned_frames_and_the_devices_camera(software: Software) -> None:
    camera = RealSense(software.device)
    assert camera.name == "Fake D435 0123"
    assert str(camera.path) == "realsense:0123"
    assert (camera.camera.fx, camera.camera.cy) == pytest.approx((600.0, 241.25))
    assert camera.sensor == "realsense_d435"
    assert camera.camera.is_distorted
    assert camera.camera_origin == "the device"
    thread = threading.Thread(target=software.play)
    thread.start()
    readings = camera.readings()
    found = [next(readings) for _ in range(5)]
    readings.close()
    camera.close()
    software.stop()
    thread.join()
    for index, reading in enumerate(found):
        assert reading.index == index
        assert reading.problem is None
        assert reading.frame is not None
        assert reading.timestamp == pytest.approx(time.time(), abs=60)
        assert len(reading.stamp.partition(".")[2]) == 6
        assert reading.frame.depth_delay == pytest.approx(LATE_S, abs=1e-5)
        depth = reading.frame.depth
        assert depth.shape == (480, 640)
        assert np.median(depth[depth > 0]) == pytest.approx(1.5)
        # What is missing lies above, and is carried with the rest.
        assert (depth[:20] == 0).all()
        assert (depth[240, 100:500] > 0).all()
    stamps = [reading.timestamp for reading in found]
    assert (np.diff(stamps) > 0).all()


def test_is_tracked_and_counts_what_the_driver_dropped(software: Software) -> None:
    camera = RealSense(software.device)
    thread = threading.Thread(target=software.play, kwargs={"gaps": True})
    thread.start()
    run, failure = track_device(camera, Odometry(camera.camera), max_frames=8)
    software.stop()
    thread.join()
    assert failure is None
    assert len(run.frames) == 8
    assert run.dropped >= 3
    assert run.source.name == "Fake D435 0123"
    poses = run.trajectory().poses
    assert np.abs(poses - np.eye(4)).max() < 1e-3


def test_a_camera_that_falls_silent(software: Software, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("edvo.datasets.devices.waiting.LONGEST_S", 0.5)
    camera = RealSense(software.device)
    with pytest.raises(DatasetError, match=r"Fake D435 0123: no image for 0\.5 s"):
        next(camera.readings())
    camera.close()
    camera.close()


def test_a_camera_may_be_given(software: Software) -> None:
    camera = RealSense(software.device, camera=CAMERA)
    assert camera.camera is CAMERA
    assert camera.camera_origin == "given"
    camera.close()


def test_depth_alone_is_not_enough() -> None:
    software = Software(colour=False)
    with pytest.raises(DatasetError, match="no color images"):
        RealSense(software.device)


def test_no_camera_is_connected() -> None:
    load_sdk()
    with pytest.raises(DatasetError, match="realsense: no camera"):
        open_device("realsense:999")


def test_without_a_library_of_the_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As on a machine that has no libusb: there pip install would not help."""
    monkeypatch.delitem(sys.modules, "pyrealsense2", raising=False)
    (tmp_path / "pyrealsense2.py").write_text("raise ImportError('libusb-1.0.so.0: no such file')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingExtraError, match=r"libusb-1\.0.*package manager") as caught:
        open_device("realsense")
    assert "pip" not in str(caught.value)


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match=r"edvo\[realsense\]"):
        open_device("realsense")


@pytest.mark.parametrize(("late_ms", "delay"), [(11.0, 0.011), (-6.5, -0.0065), (1.7e12, 0.0)])
def test_the_delay_of_depth_is_that_of_the_stamps(late_ms: float, delay: float) -> None:
    """On a stand-in for the SDK's frames; the last has stamps of two clocks."""

    def image(values: object, milliseconds: float) -> Any:
        return SimpleNamespace(
            get_data=lambda: values,
            get_timestamp=lambda: milliseconds,
            get_units=lambda: 0.001,
        )

    colour = image(np.full((4, 6, 3), 90, np.uint8), 5000.0)
    depth = image(np.full((4, 6), 1500, np.uint16), 5000.0 + late_ms)
    images = SimpleNamespace(get_depth_frame=lambda: depth, get_color_frame=lambda: colour)
    device = cast(RealSense, SimpleNamespace(_is_rgb=True, name="Fake D435"))
    frame = RealSense._reading(device, 0, images).frame
    assert frame is not None
    assert frame.timestamp == 5.0
    assert frame.depth_delay == pytest.approx(delay, abs=1e-9)
