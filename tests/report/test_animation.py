"""The animation shows what it is given, moment by moment."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.errors import OutputError
from edvo.report.animation import DrawnPath, Film, Moment, draw_film
from edvo.trajectory import Trajectory

FRAMES = 6


def moment(index: int, *, matched: bool = True) -> Moment:
    """One frame of a bright image with a line of edges."""
    count = 30 if matched else 0
    pixels = np.stack([np.linspace(20, 300, 30), np.full(30, 120.0)], axis=1)
    return Moment(
        index=index,
        grey=np.full((240, 320), 180, np.uint8),
        pixels=pixels,
        gradients=np.tile([0.0, 1.0], (30, 1)),
        samples=pixels[:count],
        references=pixels[:count] + 5.0,
        residuals=np.linspace(-4, 4, 30)[:count],
        words=["one: tracked"],
    )


def film(moments: list[Moment], lost: int | None = None) -> Film:
    """A camera that goes to the right, and an estimate that lags behind."""
    times = np.arange(FRAMES) / 30
    truth, found = np.tile(np.eye(4), (2, FRAMES, 1, 1))
    truth[:, 0, 3] = 0.1 * np.arange(FRAMES)
    found[:, 0, 3] = 0.09 * np.arange(FRAMES)
    path = DrawnPath("one", "#d1495b", found, np.arange(FRAMES) == lost)
    return Film("a film", times, Trajectory.from_poses(times, truth), [path], moments, 0.08)


def frames_of(path: Path) -> tuple[list[np.ndarray], list[int]]:
    done, animation = cv2.imreadanimation(str(path))
    assert done
    return list(animation.frames), np.ravel(animation.durations).tolist()


def test_one_picture_a_moment_and_the_last_stays(tmp_path: Path) -> None:
    draw_film(tmp_path / "film.webp", film([moment(0, matched=False), moment(2), moment(5)]))
    frames, durations = frames_of(tmp_path / "film.webp")
    assert len(frames) == 3
    assert durations[:2] == [80, 80]
    assert durations[2] > 1000
    # Matches are drawn into the right image, where the first moment has none.
    right = [frame[64:424, 530:1010, :3].astype(float) for frame in frames]
    assert right[0].std() < 2 < right[1].std()


def test_paths_grow(tmp_path: Path) -> None:
    draw_film(tmp_path / "film.webp", film([moment(1), moment(3), moment(5)]))
    inked = [
        int(np.count_nonzero(np.ptp(frame[470:630, 90:350, :3], axis=2) > 60))
        for frame in frames_of(tmp_path / "film.webp")[0]
    ]
    assert inked[0] < inked[1] < inked[2]


def test_a_lost_frame_leaves_a_gap(tmp_path: Path) -> None:
    draw_film(tmp_path / "film.webp", film([moment(5)], lost=3))
    draw_film(tmp_path / "whole.webp", film([moment(5)]))
    gap, whole = (frames_of(tmp_path / name)[0][0] for name in ("film.webp", "whole.webp"))
    assert np.any(gap != whole)


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\*\.webp"):
        draw_film(tmp_path / "film.mp4", film([moment(1)]))
    assert not list(tmp_path.iterdir())
