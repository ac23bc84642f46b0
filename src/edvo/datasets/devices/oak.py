"""OAK cameras of Luxonis with stereo depth (OAK-D), through depthai 3.

Written against the SDK's interface and tested on stand-ins for it: never run on a device. The
device undistorts colour and aligns depth to it.
"""

import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np

from edvo.camera import Camera
from edvo.datasets.association import stamped_delay
from edvo.datasets.devices.driven import Driven
from edvo.datasets.devices.noise import noise_of
from edvo.datasets.devices.package import load_package
from edvo.datasets.devices.waiting import images_of
from edvo.datasets.source import Reading
from edvo.errors import FrameError
from edvo.frame import Frame

_WIDTH, _HEIGHT, _RATE = 640, 480, 30
_STEREO = (640, 400)
_PAUSE_S = 0.002


class Oak(Driven):
    """An OAK camera; fulfils `edvo.datasets.devices.Device`.

    Parameters
    ----------
    which : str
        Its device id or address; the first one there is if empty.
    camera : Camera, optional
        Instead of what the device says.

    Raises
    ------
    DatasetError
        If there is none, or it does not start.
    MissingExtraError
        If depthai is not installed.
    """

    format = "oak"

    def __init__(self, which: str = "", camera: Camera | None = None) -> None:
        self._sdk = sdk = load_package("depthai", "", "'depthai>=3'")
        super().__init__(RuntimeError)
        with self._starting(f"oak: {which or 'a camera'} is not connected or does not start"):
            device = sdk.Device(sdk.DeviceInfo(which)) if which else sdk.Device()
            self.name = f"OAK {device.getDeviceId()}"
            self.sensor = noise_of("OAK")
            self.path = Path(f"oak:{device.getDeviceId()}")
            self._pipeline = sdk.Pipeline(device)
            self._stops.callback(self._pipeline.stop)
            self._queue = self._connect()
            self.camera_origin = "given" if camera else "the device"
            self.camera = camera or self._told(device)
            self._pipeline.start()

    def readings(self) -> Generator[Reading, None, None]:
        """Wait for each pair of images."""
        index = 0
        for both in images_of(self._take, self.name, self._closed):
            colour = both["colour"]
            if not self._count.is_new(colour.getSequenceNum()):
                continue
            yield self._reading(index, colour, both["depth"])
            index += 1

    def _connect(self) -> Any:
        """Lay out what the device computes; gives the queue of its results."""
        sdk, create = self._sdk, self._pipeline.create
        sockets = sdk.CameraBoardSocket
        colour = create(sdk.node.Camera).build(sockets.CAM_A)
        image = colour.requestOutput(
            (_WIDTH, _HEIGHT), sdk.ImgFrame.Type.BGR888i, fps=_RATE, enableUndistortion=True
        )
        stereo = create(sdk.node.StereoDepth)
        for socket, side in ((sockets.CAM_B, stereo.left), (sockets.CAM_C, stereo.right)):
            create(sdk.node.Camera).build(socket).requestOutput(_STEREO, fps=_RATE).link(side)
        align = create(sdk.node.ImageAlign)
        stereo.depth.link(align.input)
        image.link(align.inputAlignTo)
        sync = create(sdk.node.Sync)
        image.link(sync.inputs["colour"])
        align.outputAligned.link(sync.inputs["depth"])
        return sync.out.createOutputQueue(maxSize=1, blocking=False)

    def _told(self, device: Any) -> Camera:
        matrix = device.readCalibration().getCameraIntrinsics(
            self._sdk.CameraBoardSocket.CAM_A, _WIDTH, _HEIGHT
        )
        (fx, _, cx), (_, fy, cy), _ = matrix
        return Camera(_WIDTH, _HEIGHT, fx, fy, cx, cy, depth_scale=1000.0)

    def _take(self) -> Any:
        both = self._queue.tryGet()
        if both is None:
            time.sleep(_PAUSE_S)
        return both

    def _reading(self, index: int, colour: Any, depth: Any) -> Reading:
        seconds = colour.getTimestamp().total_seconds()
        delay = stamped_delay(seconds, depth.getTimestamp().total_seconds())
        frame, problem = None, None
        try:
            image = np.asarray(colour.getCvFrame())
            frame = Frame.from_images(
                seconds, image, depth.getFrame(), depth_scale=1000.0, depth_delay=delay
            )
        except FrameError as error:
            problem = f"{self.name}: image {colour.getSequenceNum()}: {error}"
        return Reading(index, f"{seconds:.6f}", seconds, frame, problem)
