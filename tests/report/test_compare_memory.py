"""Memory, measured in a process of its own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.frame import Frame
from edvo.report import compare_memory
from edvo.report.compare_memory import frames_on_disk, peak_megabytes

CAMERA = Camera(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)


def frames(count: int) -> list[Frame]:
    v, u = np.mgrid[:120, :160]
    depth = np.full((120, 160), 1.5, np.float32)
    return [
        Frame(i / 30, (60 + 120 * (((u + i) // 16 + v // 16) % 2)).astype(np.uint8), depth)
        for i in range(count)
    ]


def test_standing_still_takes_nothing_and_edvo_something() -> None:
    with frames_on_disk(frames(3)) as file:
        nothing = peak_megabytes(file, CAMERA, "zero-motion")
        something = peak_megabytes(file, CAMERA, Config.preset("paper"), seed=1)
    assert not file.exists()
    assert 0 <= nothing < 8
    assert nothing + 1 < something < 500


def test_frames_come_back_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    given = [replace(frame, depth_delay=0.004 * k) for k, frame in enumerate(frames(3), -1)]
    tracked: list[Frame] = []
    tracker = SimpleNamespace(track=tracked.append)
    monkeypatch.setattr(compare_memory, "_tracker", lambda *_: tracker)
    with frames_on_disk(given) as file:
        job = {"frames": str(file), "camera": CAMERA.to_dict(), "system": "any", "seed": 0}
        compare_memory._grown(job)
    assert len(tracked) == 3
    for frame, other in zip(given, tracked, strict=True):
        assert (frame.timestamp, frame.depth_delay) == (other.timestamp, other.depth_delay)
        np.testing.assert_array_equal(frame.grey, other.grey)
        np.testing.assert_array_equal(frame.depth, other.depth)


def test_a_process_that_fails_says_why() -> None:
    with (
        frames_on_disk(frames(1)) as file,
        pytest.raises(EvaluationError, match="no baseline 'nobody'"),
    ):
        peak_megabytes(file, CAMERA, "nobody")
