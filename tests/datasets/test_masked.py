"""What is not of the scene, left out by a mask."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.datasets.masked import Mask, MaskedSource, read_mask
from edvo.datasets.source import Reading
from edvo.errors import DatasetError
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import make_recipe

from .. import problems  # noqa: TID252 - tests is no package to import by name

FRAMES = 30
PLACES = [(10, 40 + 60 * line) for line in range(4)]


def printed(grey: np.ndarray) -> np.ndarray:
    """Four lines of a clock, as recorders print it into an image."""
    grey = grey.copy()
    for place in PLACES:
        cv2.putText(grey, "2026-11-25 04:12", place, cv2.FONT_HERSHEY_SIMPLEX, 1.4, 255, 3)
    return grey


class Printed(MaskedSource):
    """A rendered recording into which a clock was printed."""

    def read(self, index: int) -> Reading:
        reading = self._source.read(index)
        assert reading.frame is not None
        return replace(reading, frame=replace(reading.frame, grey=printed(reading.frame.grey)))


@pytest.fixture(scope="module")
def source() -> Printed:
    rendered = problems.Remembered(make_recipe("cabinet", frames=FRAMES, seed=3))
    return Printed(rendered, Mask(Path("none"), np.zeros((480, 640), np.bool_)))


@pytest.fixture
def mask(tmp_path: Path) -> Path:
    shown = np.where(printed(np.zeros((480, 640), np.uint8)) > 0, 0, 255).astype(np.uint8)
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), cv2.erode(shown, np.ones((9, 9), np.uint8)))
    return path


def off_by(source: MaskedSource) -> tuple[float, set[Status]]:
    """Track it: how far the last pose is off, in metres, and what was said."""
    odometry = Odometry(source.camera)
    readings = [source.read(index) for index in range(FRAMES)]
    statuses = {odometry.track(each.frame).status for each in readings if each.frame is not None}
    truth = source.ground_truth
    assert truth is not None
    first, last = (truth.at(readings[index].timestamp) for index in (0, -1))
    error = np.linalg.inv(np.linalg.inv(first) @ last) @ odometry.trajectory.poses[-1]
    return float(np.linalg.norm(error[:3, 3])), statuses


def test_print_drags_the_camera_along(source: Printed) -> None:
    assert off_by(source)[0] > 0.05


def test_masked_it_does_not(source: Printed, mask: Path) -> None:
    read = read_mask(mask, source.camera)
    left_out = read.left_out
    assert 0.02 < left_out.mean() < 0.3
    masked = MaskedSource(source, read)
    told = {"path": str(mask), "left_out": round(float(left_out.mean()), 4)}
    assert masked.describe()["mask"] == told
    off, statuses = off_by(masked)
    assert off < 0.003
    assert statuses == {Status.TRACKED}
    depth, frame = source.read(0).frame.depth, masked.read(0).frame
    np.testing.assert_array_equal(frame.depth, np.where(left_out, 0, depth))
    np.testing.assert_array_equal(frame.grey, source.read(0).frame.grey)
    assert (masked.name, len(masked), masked.stamps) == (source.name, FRAMES, source.stamps)


def test_where_no_depth_is_left_it_says_so(source: Printed) -> None:
    seen = source.read(0).frame.depth > 0
    reading = MaskedSource(source, Mask(Path("all"), seen)).read(0)
    assert reading.frame is None
    assert "beyond the mask" in reading.problem


def test_colours_count_by_what_is_black(source: Printed, tmp_path: Path) -> None:
    image = np.full((480, 640, 4), 255, np.uint8)
    image[:100, :, :3] = 0
    image[200:, :, :2] = 0  # red
    cv2.imwrite(str(tmp_path / "m.png"), image)
    left_out = read_mask(tmp_path / "m.png", source.camera).left_out
    assert left_out[:100].all()
    assert not left_out[100:].any()


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.zeros((480, 640)), "leaves out all"),
        (np.ones((480, 640)), "leaves out nothing"),
        (np.ones((240, 320)), "320x240 pixels, the images have 640x480"),
        (np.ones((480, 640), np.uint16), "8 bits"),
    ],
)
def test_masks_of_no_use(source: Printed, tmp_path: Path, image: np.ndarray, said: str) -> None:
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), image if image.dtype == np.uint16 else image.astype(np.uint8))
    with pytest.raises(DatasetError, match=said) as caught:
        read_mask(path, source.camera)
    assert str(path) in str(caught.value)


def test_a_mask_that_is_not_there(source: Printed, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="mask: cannot read"):
        read_mask(tmp_path / "none.png", source.camera)
