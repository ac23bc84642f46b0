"""Each warning fires on the fault that it is for, and on nothing else."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edvo.datasets import open_source
from edvo.datasets.inspection import Finding, inspect
from edvo.datasets.inspection.blur import check_blur
from edvo.datasets.inspection.delay import check_delay
from edvo.datasets.inspection.depth_range import check_depth_range
from edvo.datasets.inspection.depth_steps import check_depth_steps
from edvo.datasets.inspection.light import check_darkness, check_exposure
from edvo.datasets.inspection.order import check_order, check_stamps
from edvo.datasets.inspection.registration import check_registration
from edvo.datasets.inspection.repeats import check_repeats
from edvo.datasets.inspection.step import check_step
from edvo.datasets.inspection.thumbnail import thumbnail
from edvo.frame import Frame

from .faults import (
    Altered,
    Given,
    Remembered,
    focal,
    found,
    looks,
    moved,
    scaled,
    stretched,
    swapped,
    truth,
)

SEQUENCES = (
    "tum_fr1_xyz",
    "tum_fr3_structure_notexture_far",
    "icl_office_kt3",
    "tum_fr3_cabinet_sparse",
)


@pytest.fixture(scope="module", params=SEQUENCES)
def real(request: pytest.FixtureRequest, real_data: Path) -> Remembered:
    folder = real_data / request.param
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return Remembered(open_source(folder))


@pytest.fixture(params=["handheld", "turning"])
def rendered(request: pytest.FixtureRequest) -> Remembered:
    source: Remembered = request.getfixturevalue(request.param)
    return source


@pytest.fixture(scope="module")
def sound(handheld: Remembered) -> dict[str, Finding]:
    """What each check says of a recording that nothing is wrong with."""
    return found(handheld)


def lagging(count: int) -> Any:
    return np.maximum(np.arange(count) - 2, 0)


def blurred(frame: Frame) -> Frame:
    return replace(frame, grey=cv2.blur(frame.grey, (11, 11)))


def darkened(frame: Frame) -> Frame:
    return replace(frame, grey=frame.grey // 8)


def unsteady(frame: Frame) -> Frame:
    gain = 0.8 if round(frame.timestamp * 30) % 2 else 1.0
    return replace(frame, grey=(frame.grey * gain).astype(np.uint8))


def banded(frame: Frame) -> Frame:
    rows = np.arange(frame.grey.shape[0])[:, None]
    gain = 0.8 + 0.2 * np.sin(rows / 15 + 2 * round(frame.timestamp * 30))
    return replace(frame, grey=(frame.grey * gain).astype(np.uint8))


def of_another_camera(frame: Frame) -> Frame:
    """Depth of a narrower field of view."""
    height, width = frame.depth.shape
    u, v = (width - 1) / 2, (height - 1) / 2
    matrix = np.array([[1.3, 0, -0.3 * u], [0, 1.3, -0.3 * v]])
    depth = cv2.warpAffine(frame.depth, matrix, (width, height), flags=cv2.INTER_NEAREST)
    return replace(frame, depth=np.asarray(depth, np.float32))


def test_sound_rendered_recordings(rendered: Remembered) -> None:
    assert inspect(rendered) == []  # type: ignore[arg-type]


def test_sound_real_recordings(real: Remembered) -> None:
    assert inspect(real) == []  # type: ignore[arg-type]


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_wrong_scale_of_real_recordings(real: Remembered, factor: float) -> None:
    wrong = looks(Altered(real, scaled(factor)))
    (warning,) = check_depth_steps(wrong.frames, 5000).warnings
    assert f"try {5000 * factor:g}" in warning
    (warning,) = truth(wrong).warnings
    assert "times as far as ground truth says" in warning


@pytest.mark.parametrize("offset", [(8, 0), (-8, 0), (0, 8), (0, -8)])
def test_shifted_depth_of_real_recordings(real: Remembered, offset: tuple[int, int]) -> None:
    finding = check_registration(looks(Altered(real, moved(*offset))).frames)
    assert finding.warnings
    off = np.subtract((finding.measured["right_px"], finding.measured["down_px"]), offset)
    assert np.abs(off).max() < 4  # that these recordings have of their own


def test_swapped_images_of_real_recordings(real: Remembered) -> None:
    order = swapped(len(real))
    colour, _ = check_order(looks(Altered(real, order=order)).spans).warnings
    assert colour.startswith("colour images are not in the order")
    (depth,) = check_order(looks(Altered(real, depth_order=order)).spans).warnings
    assert depth.startswith("depth images are not in the order")


@pytest.mark.parametrize("factor", [1.15, 1 / 1.15])
def test_wrong_focal_length_of_real_recordings(real: Remembered, factor: float) -> None:
    finding = focal(Altered(real, camera=stretched(real.camera, factor)))
    assert finding.warnings
    assert (finding.measured["best_factor"] < 1) == (factor > 1)


@pytest.mark.parametrize("factor", [1.15, 1 / 1.15])
def test_wrong_focal_length_of_rendered_recordings(rendered: Remembered, factor: float) -> None:
    finding = focal(Altered(rendered, camera=stretched(rendered.camera, factor)))
    assert finding.warnings
    assert abs(finding.measured["best_factor"] * factor - 1) < 0.04


def test_focal_length_is_not_observable_where_nothing_turns(handheld: Remembered) -> None:
    still = Altered(handheld, order=np.zeros(len(handheld), np.intp))
    finding = focal(still)
    assert finding.verdict == "not observable"
    assert "turns too little" in finding.undecided


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_wrong_scale_without_truth_or_with_it(handheld: Remembered, factor: float) -> None:
    altered = looks(Altered(handheld, scaled(factor)))
    assert check_depth_steps(altered.frames, 5000).warnings
    finding = truth(altered)
    assert finding.warnings
    assert abs(finding.measured["scale"] / factor - 1) < 0.1


@pytest.mark.parametrize(
    ("alter", "check", "word"),
    [
        (moved(4, 0), check_registration, "4 px right"),
        (moved(-5, 0), check_registration, "5 px left"),
        (moved(0, 6), check_registration, "6 px below"),
        (moved(0, -6), check_registration, "6 px above"),
        (of_another_camera, check_registration, "scaled by 0.77"),
        (darkened, check_darkness, "too dark"),
        (blurred, check_blur, "blurred"),
    ],
)
def test_altered_images(
    handheld: Remembered,
    alter: Callable[[Frame], Frame],
    check: Callable[[Sequence[Frame]], Finding],
    word: str,
) -> None:
    (warning,) = check(looks(Altered(handheld, alter)).frames).warnings
    assert word in warning


@pytest.mark.parametrize(
    ("alter", "word"), [(unsteady, "brightness changes by"), (banded, "bands of rows")]
)
def test_light_that_changes(
    handheld: Remembered, alter: Callable[[Frame], Frame], word: str
) -> None:
    seen = looks(Altered(handheld, alter))
    warnings = check_exposure(seen.spans, seen.interval).warnings
    assert any(word in warning for warning in warnings), warnings


def test_depth_late(handheld: Remembered) -> None:
    seen = looks(Altered(handheld, depth_order=lagging(len(handheld))))
    finding = check_step(seen.spans, seen.interval)
    (warning,) = finding.warnings
    assert warning.startswith("depth lags colour by about")
    assert abs(finding.measured["delay_frames"] - 2) < 0.25


def test_swapped_images(rendered: Remembered) -> None:
    order = swapped(len(rendered))
    colour, _ = check_order(looks(Altered(rendered, order=order)).spans).warnings
    assert colour.startswith("colour")


def test_poses_of_another_recording(handheld: Remembered, turning: Remembered) -> None:
    mixed = Altered(handheld)
    mixed.ground_truth = turning.ground_truth  # type: ignore[attr-defined]
    (warning,) = truth(looks(mixed)).warnings
    assert "turns otherwise" in warning


def test_still_camera_raises_no_alarm(handheld: Remembered) -> None:
    still = Altered(handheld, order=np.full(len(handheld), 5))
    still.ground_truth = None  # type: ignore[attr-defined]
    assert inspect(still) == []  # type: ignore[arg-type]
    findings = found(still)
    for check in ("order of images", "colour and depth in step", "motion against ground truth"):
        assert findings[check].verdict == "not observable"


def test_images_of_another_size(handheld: Remembered) -> None:
    other = replace(handheld.camera, width=640, height=480)
    warnings = found(Altered(handheld, camera=other))["size of images"].warnings
    assert "images are 320 x 240, the camera is for 640 x 480" in warnings[0]


def test_stamps_that_go_back(handheld: Remembered) -> None:
    altered = Altered(handheld)
    times = handheld.timestamps.copy()
    times[[4, 5]] = times[[5, 4]]
    times[9] = times[8]
    altered.timestamps = times  # type: ignore[attr-defined]
    back, same = check_stamps(looks(altered).timestamps).warnings
    assert back.startswith("1 stamps go back in time (first: frame 5)")
    assert same.startswith("1 stamps repeat the one before (first: frame 9)")


@pytest.mark.parametrize(("factor", "word"), [(0.02, "below"), (20.0, "above")])
def test_implausible_depth_range(handheld: Remembered, factor: float, word: str) -> None:
    (warning,) = check_depth_range(looks(Altered(handheld, scaled(factor))).frames, 5000).warnings
    assert word in warning
    assert "depth_scale" in warning


def test_hardly_any_depth(handheld: Remembered) -> None:
    def sparse(frame: Frame) -> Frame:
        depth = np.zeros_like(frame.depth)
        depth[:20, :20] = 1.0
        return replace(frame, depth=depth)

    (warning,) = check_depth_range(looks(Altered(handheld, sparse)).frames, 5000).warnings
    assert "depth pixels" in warning


def test_flat_wall_tells_nothing(handheld: Remembered) -> None:
    rng = np.random.default_rng(0)
    grey = cv2.GaussianBlur(rng.integers(0, 255, (240, 320), np.uint8), (0, 0), 2)
    wall = Frame(0.0, np.asarray(grey, np.uint8), np.full((240, 320), 2.0, np.float32))
    findings = found(Given([wall] * 20, handheld.camera))
    assert findings["registration"].verdict == "not observable"
    assert findings["depth steps"].verdict == "not observable"


def test_unreadable_frames_are_named(handheld: Remembered) -> None:
    frame = handheld.read(0).frame
    given = Given([frame, None], handheld.camera)
    assert inspect(given) == ["1.png is cut short"]  # type: ignore[arg-type]
    assert inspect(Given([None], handheld.camera)) == ["0.png is cut short"]  # type: ignore[arg-type]


def test_images_of_several_sizes_are_named(handheld: Remembered) -> None:
    frame = handheld.read(0).frame
    assert frame is not None
    half = Frame(1 / 30, frame.grey[::2, ::2].copy(), frame.depth[::2, ::2].copy())
    warnings = inspect(Given([frame, half], handheld.camera))  # type: ignore[arg-type]
    assert warnings == ["frame 1 is 160 x 120, those before it 320 x 240: give images of one size"]


def test_the_delay_of_depth_is_the_median_of_the_stamps(
    handheld: Remembered, sound: dict[str, Finding]
) -> None:
    frame = handheld.read(0).frame
    assert frame is not None
    late = [replace(frame, depth_delay=delay) for delay in (0.019, -0.004, 0.011)]
    finding = check_delay(late)
    assert finding.measured == {"median_s": 0.011}
    assert finding.verdict == "sound"
    assert sound["depth delay"].measured == {"median_s": 0.0}


def test_depth_that_repeats_is_counted_but_not_where_all_repeats(
    handheld: Remembered, sound: dict[str, Finding]
) -> None:
    frames = [handheld.read(i).frame for i in range(5)]
    assert not any(frame is None for frame in frames)
    new = [frame for frame in frames if frame is not None]
    twice = [replace(new[i], depth=new[i // 2 * 2].depth) for i in range(5)]
    frozen = [replace(new[0], timestamp=i / 30) for i in range(5)]
    for given, share in ((new, 0.0), (twice, 0.5), (frozen, 0.0)):
        finding = check_repeats([[thumbnail(frame) for frame in given]])
        assert finding.measured == {"share": share}
        assert finding.verdict == "sound"
    assert check_repeats([[thumbnail(new[0])]]).verdict == "not observable"
    assert sound["repeated depth"].measured == {"share": 0.0}
