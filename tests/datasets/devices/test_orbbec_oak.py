"""Orbbec and OAK cameras on stand-ins for their SDKs: only what is used of each, as it is named."""

import sys
from collections.abc import Callable
from datetime import timedelta
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from edvo.datasets.devices import open_device
from edvo.datasets.devices.device import Device
from edvo.datasets.source import Reading
from edvo.errors import DatasetError, MissingExtraError

IMAGE = cv2.GaussianBlur(
    np.random.default_rng(2).integers(0, 255, (480, 640, 3), dtype=np.uint8), (9, 9), 0
)
DEPTH = np.full((480, 640), 1500, np.uint16)
NUMBERS = (1, 2, 2, 5)  # one image twice, two never
LATE_US = {1: 4000, 2: -7000, 5: 900_000}  # depth after colour; the last by another clock
GREY = cv2.cvtColor(IMAGE, cv2.COLOR_BGR2GRAY)


def given(**values: Any) -> Any:
    """Make methods that give these values."""
    return SimpleNamespace(**{name: (lambda *_, v=value: v) for name, value in values.items()})


class Module(ModuleType):
    """A module of stand-ins; anything else that is asked of it is an AttributeError."""

    def __init__(self, name: str, **contents: Any) -> None:
        super().__init__(name)
        self.__dict__.update(contents)


class OrbbecSdk:
    """A device with an SDK about it."""

    def __init__(self, layout: str = "RGB", devices: int = 1) -> None:
        self.layout, self.started, self.stopped = layout, False, 0
        self.numbers = iter(NUMBERS)
        info = given(get_name="Gemini 2", get_serial_number="AB12")
        device = given(get_device_info=info)
        listed = given(
            get_count=devices, get_device_by_index=device, get_device_by_serial_number=device
        )
        sdk = self

        class OBError(Exception):
            pass

        class Config:
            enable_stream = set_frame_aggregate_output_mode = lambda self, what: None

        class Profiles:
            def get_video_stream_profile(self, width: int, height: int, form: str, fps: int) -> Any:
                if form != sdk.layout:
                    raise OBError("no such mode")
                lens = SimpleNamespace(
                    fx=500.0, fy=501.0, cx=320.0, cy=240.0, width=640, height=480
                )
                bent = dict.fromkeys(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), 0.0)
                bent["k1"] = 0.05
                return given(get_intrinsic=lens, get_distortion=SimpleNamespace(**bent))

            def get_default_video_stream_profile(self) -> Any:
                return "depth"

        class Pipeline:
            def __init__(self, of: Any) -> None:
                assert of is device

            get_stream_profile_list = lambda self, sensor: Profiles()  # noqa: E731
            enable_frame_sync = lambda self: None  # noqa: E731

            def start(self, config: Config) -> None:
                sdk.started = True

            def stop(self) -> None:
                sdk.stopped += 1

            def wait_for_frames(self, milliseconds: int) -> Any:
                number = next(sdk.numbers, None)
                return None if number is None else sdk.frames(number)

        class AlignFilter:
            def __init__(self, *, align_to_stream: str) -> None:
                assert align_to_stream == "COLOR"

            def process(self, frames: Any) -> Any:
                return given(as_frame_set=frames)

        self.module = Module(
            "pyorbbecsdk",
            OBError=OBError,
            Context=lambda: given(query_devices=listed),
            Pipeline=Pipeline,
            Config=Config,
            AlignFilter=AlignFilter,
            OBStreamType=SimpleNamespace(COLOR_STREAM="COLOR"),
            OBSensorType=SimpleNamespace(COLOR_SENSOR="c", DEPTH_SENSOR="d"),
            OBFormat=SimpleNamespace(RGB="RGB", BGR="BGR", MJPG="MJPG"),
            OBFrameAggregateOutputMode=SimpleNamespace(FULL_FRAME_REQUIRE=1),
        )

    def frames(self, number: int) -> Any:
        image = IMAGE[:, :, ::-1] if self.layout == "RGB" else IMAGE
        data = np.ascontiguousarray(image).ravel()
        if self.layout == "MJPG":
            data = cv2.imencode(".jpg", IMAGE, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].ravel()
        colour = given(
            get_index=number,
            get_timestamp_us=1_000_000 + 33_333 * number,
            get_format=self.layout,
            get_data=data,
            get_height=480,
            get_width=640,
        )
        depth = given(
            get_timestamp_us=1_000_000 + 33_333 * number + LATE_US[number],
            get_data=(2 * DEPTH).view(np.uint8).ravel(),
            get_height=480,
            get_width=640,
            get_depth_scale=0.5,
        )
        return given(get_color_frame=colour, get_depth_frame=depth)


class OakSdk:
    """The same of Luxonis."""

    def __init__(self, devices: int = 1) -> None:
        self.started, self.stopped, self.links = False, 0, []
        self.numbers = iter(NUMBERS)
        sdk = self

        class Out:
            def __init__(self, name: str) -> None:
                self.name = name

            def link(self, to: Any) -> None:
                sdk.links.append((self.name, to))

            def createOutputQueue(self, *, maxSize: int, blocking: bool) -> Any:
                assert (maxSize, blocking) == (1, False)
                return SimpleNamespace(tryGet=sdk.take)

        class Camera:
            def build(self, socket: str) -> "Camera":
                self.socket = socket
                return self

            def requestOutput(self, size: Any, kind: Any = None, **options: Any) -> Out:
                if self.socket == "A":
                    assert options == {"fps": 30, "enableUndistortion": True}
                    assert (size, kind) == ((640, 480), "bgr")
                return Out(self.socket)

        class Stereo:
            left, right, depth = "left", "right", Out("depth")

        class Align:
            input, inputAlignTo, outputAligned = "raw depth", "align to", Out("aligned")

        class Sync:
            inputs: Any = {"colour": "sync colour", "depth": "sync depth"}  # noqa: RUF012
            out = Out("both")

        class Pipeline:
            def __init__(self, device: Any) -> None:
                pass

            create = lambda self, kind: kind()  # noqa: E731

            def start(self) -> None:
                sdk.started = True

            def stop(self) -> None:
                sdk.stopped += 1

        def device(info: Any = None) -> Any:
            if not devices:
                raise RuntimeError("No available devices")
            matrix = [[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]]
            return given(getDeviceId="AB12", readCalibration=given(getCameraIntrinsics=matrix))

        self.module = Module(
            "depthai",
            Device=device,
            DeviceInfo=str,
            Pipeline=Pipeline,
            CameraBoardSocket=SimpleNamespace(CAM_A="A", CAM_B="B", CAM_C="C"),
            ImgFrame=SimpleNamespace(Type=SimpleNamespace(BGR888i="bgr")),
            node=SimpleNamespace(Camera=Camera, StereoDepth=Stereo, ImageAlign=Align, Sync=Sync),
        )

    def take(self) -> Any:
        number = next(self.numbers, None)
        if number is None:
            return None
        time = timedelta(microseconds=1_000_000 + 33_333 * number)
        colour = given(getSequenceNum=number, getTimestamp=time, getCvFrame=IMAGE)
        later = time + timedelta(microseconds=LATE_US[number])
        return {"colour": colour, "depth": given(getFrame=DEPTH, getTimestamp=later)}


def check(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw on a camera until it falls silent."""
    monkeypatch.setattr("edvo.datasets.devices.waiting.LONGEST_S", 0.05)
    readings, found = device.readings(), list[Reading]()
    with pytest.raises(DatasetError, match=r"AB12: no image for 0\.05 s"):
        found.extend(readings)
    assert [reading.index for reading in found] == [0, 1, 2]
    assert [reading.stamp for reading in found] == ["1.033333", "1.066666", "1.166665"]
    assert device.missed == 2
    for reading, delay in zip(found, (0.004, -0.007, 0.0), strict=True):
        assert reading.frame is not None
        assert reading.frame.depth_delay == pytest.approx(delay, abs=1e-9)
        assert np.abs(reading.frame.grey.astype(int) - GREY).max() <= 6
        np.testing.assert_allclose(reading.frame.depth, 1.5, rtol=1e-6)
    assert device.sensor == "realsense_d435"
    assert device.camera.fx == 500.0
    assert device.camera_origin == "the device"


@pytest.mark.parametrize("layout", ["RGB", "BGR", "MJPG"])
def test_orbbec(monkeypatch: pytest.MonkeyPatch, layout: str) -> None:
    sdk = OrbbecSdk(layout)
    monkeypatch.setitem(sys.modules, "pyorbbecsdk", sdk.module)
    device = open_device("orbbec:AB12")
    assert sdk.started
    assert (device.name, str(device.path)) == ("Gemini 2 AB12", "orbbec:AB12")
    check(device, monkeypatch)
    assert device.camera.distortion[0] == pytest.approx(0.05)
    device.close()
    device.close()
    assert sdk.stopped == 1


def test_oak(monkeypatch: pytest.MonkeyPatch) -> None:
    sdk = OakSdk()
    monkeypatch.setitem(sys.modules, "depthai", sdk.module)
    device = open_device("oak")
    assert sdk.started
    assert set(sdk.links) == {
        ("B", "left"),
        ("C", "right"),
        ("depth", "raw depth"),
        ("A", "align to"),
        ("A", "sync colour"),
        ("aligned", "sync depth"),
    }
    check(device, monkeypatch)
    assert not device.camera.is_distorted  # the device takes it out
    device.close()
    device.close()
    assert sdk.stopped == 1


@pytest.mark.parametrize(
    ("name", "package", "sdk"),
    [("orbbec", "pyorbbecsdk", OrbbecSdk), ("oak", "depthai", OakSdk)],
)
def test_no_camera_and_no_package(
    monkeypatch: pytest.MonkeyPatch, name: str, package: str, sdk: Callable[..., Any]
) -> None:
    monkeypatch.setitem(sys.modules, package, sdk(devices=0).module)
    with pytest.raises(DatasetError, match=f"{name}: .*connected"):
        open_device(name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=package):
        open_device(name)
