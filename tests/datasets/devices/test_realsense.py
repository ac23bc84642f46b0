"""A RealSense camera, stood in for by the SDK's own software device."""

import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.datasets.devices import open_device
from edvo.datasets.devices.realsense import RealSense
from edvo.errors import DatasetError, MissingExtraError
from edvo.odometry import Odometry
from edvo.report.live import track_device

CAMERA = Camera(640, 480, 600.0, 601.0, 320.5, 241.25)
DEPTH = Camera(640, 480, 590.0, 590.0, 322.0, 238.0)
INVERSE = (0.09, -0.05, 0.001, 0.002, 0.01)


class Software:
    """A software device that shows a wall 1.5 m away, 30 times a second."""

    def __init__(self, *, colour: bool = True) -> None:
        rs = pytest.importorskip("pyrealsense2", reason="pip install 'edvo[realsense]'")
        self.rs, self.device = rs, rs.software_device()
        self.device.register_info(rs.camera_info.name, "Fake D435")
        self.device.register_info(rs.camera_info.serial_number, "0123")
        self.sensors = [self.device.add_sensor("Stereo Module")]
        self.profiles = [self._add(0, rs.stream.depth, rs.format.z16, 2, DEPTH, ())]
        self.sensors[0].add_read_only_option(rs.option.depth_units, 0.0005)
        if colour:
            self.sensors.append(self.device.add_sensor("RGB Camera"))
            self.profiles.append(self._add(1, rs.stream.color, rs.format.rgb8, 3, CAMERA, INVERSE))
            place = rs.extrinsics()
            place.rotation, place.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0.015, 0.0, 0.0]
            self.profiles[0].register_extrinsics_to(self.profiles[1], place)
        self._stop = threading.Event()
        self.sent = 0

    def _add(
        self, number: int, kind: Any, layout: Any, size: int, camera: Camera, inverse: Any
    ) -> Any:
        rs = self.rs
        told, stream = rs.intrinsics(), rs.video_stream()
        told.width, told.height = camera.width, camera.height
        told.fx, told.fy, told.ppx, told.ppy = camera.fx, camera.fy, camera.cx, camera.cy
        told.model = rs.distortion.inverse_brown_conrady if inverse else rs.distortion.none
        told.coeffs = list(inverse) or [0.0] * 5
        stream.type, stream.fmt, stream.bpp, stream.intrinsics = kind, layout, size, told
        stream.index, stream.uid, stream.fps = 0, number + 1, 30
        stream.width, stream.height = camera.width, camera.height
        return self.sensors[number].add_video_stream(stream)

    def play(self, skip: tuple[int, ...] = (), frames: int = 10**6) -> None:
        rng = np.random.default_rng(5)
        colour = np.kron(rng.integers(30, 220, (24, 32, 3)), np.ones((20, 20, 1))).astype(np.uint8)
        depth = np.full((480, 640), 3000, np.uint16)
        depth[:50] = 0
        start = 1000 * time.time()
        for number in range(frames):
            if self._stop.is_set():
                return
            if number not in skip:
                for index, image in enumerate((depth, colour)[: len(self.sensors)]):
                    self._send(index, image, number, start + 1000 * number / 30)
                self.sent += 1
            time.sleep(1 / 30)

    def _send(self, index: int, image: Any, number: int, milliseconds: float) -> None:
        frame = self.rs.software_video_frame()
        frame.pixels, frame.bpp = image, (2, 3)[index]
        frame.stride = 640 * frame.bpp
        frame.timestamp, frame.frame_number = milliseconds, number
        frame.domain = self.rs.timestamp_domain.system_time
        frame.profile = self.profiles[index].as_video_stream_profile()
        if index == 0:
            frame.depth_units = 0.0005
        self.sensors[index].on_video_frame(frame)

    def stop(self) -> None:
        self._stop.set()


@pytest.fixture
def software() -> Iterator[Software]:
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
    thread = threading.Thread(target=software.play, kwargs={"frames": 90})
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
    # Again and again: on a busy machine the first images may pass before anybody listens.
    skip = tuple(index for index in range(90) if index % 7 > 3)
    thread = threading.Thread(target=software.play, kwargs={"skip": skip})
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
    pytest.importorskip("pyrealsense2", reason="pip install 'edvo[realsense]'")
    with pytest.raises(DatasetError, match="realsense: no camera"):
        open_device("realsense:999")


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtraError, match=r"edvo\[realsense\]"):
        open_device("realsense")
