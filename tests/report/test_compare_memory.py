"""Memory, measured in a process of its own."""

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.frame import Frame
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


def test_a_process_that_fails_says_why() -> None:
    with (
        frames_on_disk(frames(1)) as file,
        pytest.raises(EvaluationError, match="no baseline 'nobody'"),
    ):
        peak_megabytes(file, CAMERA, "nobody")
