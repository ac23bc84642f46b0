"""Azure Kinect recordings in the layout of k4arecorder's, made of EBML elements by hand."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

# Numbers of a device: shares of the sensor; k1..k6, two zeros, p2, p1.
DEPTH = [0.5026, 0.5058, 0.4915, 0.4917]
DEPTH += [5.35, 3.62, 0.189, 5.68, 5.32, 1.02, 0.0, 0.0, -4e-05, 8e-05]
COLOUR = [0.4977, 0.5026, 0.4745, 0.6325]
COLOUR += [0.512, -2.69, 1.55, 0.391, -2.50, 1.47, 0.0, 0.0, 2e-05, 4e-04]
ROTATION = [1.0, 0.0, 0.0, 0.0, 0.9945, -0.1045, 0.0, 0.1045, 0.9945]
TRANSLATION = [-0.032, -0.002, 0.004]


def calibration(**changes: Any) -> dict[str, Any]:
    """Make a calibration.json as the device has it; `changes` go into colour's entry."""

    def camera(purpose: str, values: list[float], size: tuple[int, int], place: Any) -> Any:
        return {
            "Purpose": f"CALIBRATION_CameraPurpose{purpose}",
            "Location": "CALIBRATION_CameraLocation" + ("D0" if purpose == "Depth" else "PV0"),
            "SensorWidth": size[0],
            "SensorHeight": size[1],
            "MetricRadius": 1.74,
            "Intrinsics": {
                "ModelParameterCount": len(values),
                "ModelParameters": values,
                "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
            },
            "Rt": {"Rotation": place[0], "Translation": place[1]},
        }

    here = (np.eye(3).ravel().tolist(), [0.0, 0.0, 0.0])
    cameras = [
        camera("Depth", DEPTH, (1024, 1024), here),
        camera("PhotoVideo", COLOUR, (4096, 3072), (ROTATION, TRANSLATION)),
    ]
    cameras[1].update(changes)
    return {"CalibrationInformation": {"Cameras": cameras, "InertialSensors": []}}


def element(kind: int, content: bytes | int | str, *, unknown: bool = False) -> bytes:
    """Make an EBML element."""
    name = kind.to_bytes((kind.bit_length() + 7) // 8, "big")
    if isinstance(content, int):
        content = content.to_bytes(max((content.bit_length() + 7) // 8, 1), "big")
    if isinstance(content, str):
        content = content.encode()
    length = b"\x01" + b"\xff" * 7 if unknown else ((1 << 56) | len(content)).to_bytes(8, "big")
    return name + length + content


def track(number: int, name: str, fourcc: str, size: tuple[int, int]) -> bytes:
    """Make a track of raw video, with the header that Video for Windows has."""
    header = struct.pack("<IiiHH4s5I", 40, *size, 1, 24, fourcc.encode(), 0, 0, 0, 0, 0)
    video = element(0xB0, size[0]) + element(0xBA, size[1])
    parts = [
        element(0xD7, number),
        element(0x73C5, 1000 + number),
        element(0x83, 1),
        element(0x536E, name),
        element(0x86, "V_MS/VFW/FOURCC"),
        element(0x63A2, header),
        element(0xE0, video),
    ]
    return element(0xAE, b"".join(parts))


def block(number: int, relative: int, data: bytes, *, group: bool = False) -> bytes:
    """Make a block, or a group that holds one."""
    content = bytes([0x80 | number]) + struct.pack(">hB", relative, 0) + data
    return element(0xA0, element(0xA1, content)) if group else element(0xA3, content)


def write_azure(
    path: Path,
    frames: Sequence[tuple[float, np.ndarray, np.ndarray]],
    *,
    told: dict[str, Any] | None = None,
    colour: str = "MJPG",
    names: tuple[str, str] = ("COLOR", "DEPTH"),
    unknown: bool = False,
    late: int = 150,
) -> Path:
    """Write a recording of frames: seconds, colour (BGR), depth (`late` by microseconds), in mm."""
    sizes = [frames[0][i].shape[1::-1] for i in (1, 2)]
    head = element(0x1A45DFA3, element(0x4282, "matroska"))
    info = element(0x1549A966, element(0x2AD7B1, 1000))  # microseconds
    tracks = track(1, names[0], colour, sizes[0]) + track(2, names[1], "b16g", sizes[1])
    tracks += track(3, "IR", "b16g", sizes[1])
    json_file = json.dumps(calibration() if told is None else told).encode() + b"\0"
    attached = element(0x466E, "calibration.json") + element(0x4660, "application/octet-stream")
    attached = element(0x61A7, attached + element(0x465C, json_file))
    parts = [info, element(0x1654AE6B, tracks), element(0x1941A469, attached)]
    parts.append(element(0xEC, bytes(20)))  # nothing, as recorders leave room
    for index, (seconds, image, depth) in enumerate(frames):
        raw = depth.astype(">u2").tobytes()
        blocks = [
            element(0xE7, round(1e6 * seconds)),
            block(1, 0, coded(image, colour)),
            block(2, late, raw, group=index % 2 == 1),
            block(3, late, raw),
        ]
        parts.append(element(0x1F43B675, b"".join(blocks), unknown=unknown))
    path.write_bytes(head + element(0x18538067, b"".join(parts), unknown=unknown))
    return path


def coded(image: np.ndarray, kind: str) -> bytes:
    """Lay an image out as a recorder does."""
    if kind == "MJPG":
        return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    if kind == "BGRA":
        return cv2.cvtColor(image, cv2.COLOR_BGR2BGRA).tobytes()
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if kind == "NV12":
        return grey.tobytes() + bytes([128]) * (grey.size // 2)
    return np.stack([grey, np.full_like(grey, 128)], axis=2).tobytes()
