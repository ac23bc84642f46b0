from collections.abc import Sequence

import numpy as np
import pytest

from edvo.camera import Camera
from edvo.errors import SceneError
from edvo.frame import Frame
from edvo.synthesis.breakage import BLACK, BREAKAGES, NEAREST_DEPTH_M, Shown, broken

CAMERA = Camera(160, 120, 133.85, 134.8, 79.65, 61.5)
COUNT, START, END = 20, 5, 15


def stream(seed: int, count: int = COUNT) -> list[Frame]:
    rng = np.random.default_rng(seed)
    shape = (CAMERA.height, CAMERA.width)
    return [
        Frame(
            k / 30,
            rng.integers(60, 200, shape, np.uint8),
            rng.uniform(1, 3, shape).astype(np.float32),
            depth_delay=seed / 100 + k / 1000,
        )
        for k in range(count)
    ]


GOOD, ELSEWHERE = stream(0), stream(1, 4)


def make(kind: str, seed: int = 0) -> list[Shown]:
    return broken(kind, GOOD, START, END, camera=CAMERA, foreign=ELSEWHERE, seed=seed)


def images(shown: Sequence[Shown]) -> list[tuple[bytes, bytes]]:
    return [(s.frame.grey.tobytes(), s.frame.depth.tobytes()) for s in shown if s.frame]


@pytest.mark.parametrize("kind", BREAKAGES)
def test_only_the_span_is_broken_and_stamps_stay(kind: str) -> None:
    before = images([Shown(f.timestamp, f) for f in GOOD])
    shown = make(kind)
    assert [s.timestamp for s in shown] == [f.timestamp for f in GOOD]
    assert [bool(s.fault) for s in shown] == [START <= i < END for i in range(COUNT)]
    for i, one in enumerate(shown):
        if START <= i < END:
            assert one.fault == kind
            assert one.frame is None or one.frame.timestamp == one.timestamp
        else:
            assert one.frame is GOOD[i]
    assert images([Shown(f.timestamp, f) for f in GOOD]) == before


@pytest.mark.parametrize("kind", BREAKAGES)
def test_the_same_seed_gives_the_same_bytes(kind: str) -> None:
    assert images(make(kind, seed=3)) == images(make(kind, seed=3))


@pytest.mark.parametrize("kind", ["black", "hand", "arm"])
def test_another_seed_gives_other_noise(kind: str) -> None:
    assert images(make(kind, seed=3)) != images(make(kind, seed=4))


@pytest.mark.parametrize("kind", BREAKAGES)
def test_depth_is_as_late_as_it_was_where_it_was_taken(kind: str) -> None:
    for k, one in enumerate(make(kind)[START:END]):
        if one.frame is not None:
            taken = {"frozen": GOOD[START - 1], "swapped": ELSEWHERE[k % 4]}
            assert one.frame.depth_delay == taken.get(kind, GOOD[START + k]).depth_delay


def test_black_is_dark_but_not_without_noise_and_depth_goes_on() -> None:
    shown = make("black")
    for i in range(START, END):
        frame = shown[i].frame
        assert frame is not None
        assert frame.grey.max() < BLACK + 10
        assert 0.5 < frame.grey.std() < 2
        np.testing.assert_array_equal(frame.depth, GOOD[i].depth)
    assert len(set(images(shown[START:END]))) == END - START


def test_a_frozen_stream_repeats_the_last_good_frame_to_the_bit() -> None:
    assert set(images(make("frozen")[START:END])) == set(images([Shown(0, GOOD[START - 1])]))


def test_a_swapped_stream_goes_on_elsewhere() -> None:
    found = images(make("swapped")[START:END])
    elsewhere = images([Shown(f.timestamp, f) for f in ELSEWHERE])
    assert found == [elsewhere[k % 4] for k in range(END - START)]


def test_without_depth_there_is_no_frame() -> None:
    assert all(s.frame is None for s in make("without_depth")[START:END])


def covered(kind: str) -> tuple[list[float], list[float]]:
    """Share of the view whose depth is another, and depths there, frame by frame."""
    shares, nearest = [], []
    for i, one in list(enumerate(make(kind)))[START:END]:
        assert one.frame is not None
        other = one.frame.depth != GOOD[i].depth
        shares.append(float(other.mean()))
        nearest.append(float(one.frame.depth[other].max(initial=0)))
    return shares, nearest


def test_a_hand_covers_most_of_the_view_and_has_no_depth() -> None:
    shares, depths = covered("hand")
    assert max(shares) > 0.5
    assert shares[0] < 0.5 * max(shares)
    assert shares[-1] < 0.5 * max(shares)
    assert max(depths) == 0


def test_an_arm_covers_less_and_has_depth_that_a_sensor_can_measure() -> None:
    shares, depths = covered("arm")
    assert 0.1 < max(shares) < 0.4
    assert min(depths) > NEAREST_DEPTH_M
    assert max(depths) < 0.4


def test_what_cannot_be_broken_is_refused() -> None:
    with pytest.raises(SceneError, match="no breakage 'smoke'; there are black"):
        make("smoke")
    for start, end in ((0, 5), (5, 4), (5, COUNT + 1)):
        with pytest.raises(SceneError, match="cannot break"):
            broken("black", GOOD, start, end, camera=CAMERA, foreign=ELSEWHERE)
    with pytest.raises(SceneError, match="no foreign frames"):
        broken("black", GOOD, 1, 2, camera=CAMERA, foreign=[])
