"""Keyframes by information."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.config import Config, KeyframesConfig
from edvo.frame import Frame
from edvo.information import MEMORY_S, Information, spread
from edvo.keyframes import is_due
from edvo.odometry import Odometry, Status

from . import problems

PERIOD = 1 / 30
BOUND_M = 0.12
BOUNDS = (f"keyframes.max_translation_m={BOUND_M}", "keyframes.max_rotation_deg=90")
EARLY = "keyframes.early_share=0.67"
# what is taken from each frame, and what its edges count
ALIKE = ("sampling.max_growth=1", "planes.finer=none", "registration.profile_spread=0")


def covariance(seed, size=1.0):
    A = np.random.default_rng(seed).normal(size=(6, 6))
    return size**2 * (A @ A.T + 0.1 * np.eye(6))


@pytest.mark.parametrize("seed", range(3))
def test_the_spread_is_the_mean_half_axis_of_a_region(seed):
    C = covariance(seed)
    half_axes = np.sqrt(np.linalg.eigvalsh(C))
    assert spread(C) == pytest.approx(np.exp(np.log(half_axes).mean()))
    assert spread(covariance(seed, 3.0)) == pytest.approx(3 * spread(C))


def test_ratios_of_spreads_do_not_depend_on_units():
    to_mm_and_deg = np.diag([1e3] * 3 + [57.3] * 3)
    a, b = covariance(1), covariance(2)
    in_other_units = [to_mm_and_deg @ C @ to_mm_and_deg for C in (a, b)]
    assert spread(in_other_units[0]) / spread(in_other_units[1]) == pytest.approx(
        spread(a) / spread(b)
    )


def test_better_is_better_than_the_mean_of_late():
    sizes = np.random.default_rng(3).uniform(0.5, 2, 200)
    information, usual = Information(), None
    for size in sizes:
        better = information.is_better(size**2 * np.eye(6), PERIOD)
        assert better == (usual is not None and size < usual)
        usual = size if usual is None else usual + (size - usual) * PERIOD / MEMORY_S


def test_what_is_always_the_same_or_grows_is_never_better():
    for growth in (1.0, 1.01, 1.3):
        information = Information()
        for k in range(60):
            assert not information.is_better(1.01 * growth ** (2 * k) * np.eye(6), PERIOD)


def test_after_a_gap_only_the_last_one_is_remembered():
    information = Information()
    information.is_better(np.eye(6), PERIOD)
    information.is_better(100 * np.eye(6), 10 * MEMORY_S)
    assert information.is_better(81 * np.eye(6), PERIOD)


@pytest.mark.parametrize("well_placed", [False, True])
def test_bounds_on_motion_are_lower_for_a_frame_that_is_well_placed(well_placed):
    config = KeyframesConfig(max_translation_m=0.1, max_rotation_deg=10.0, early_share=0.5)
    reach = 0.5 if well_placed else 1.0

    def due(motion, overlap=1.0):
        return is_due(config, se3.exp(motion), overlap, 1, well_placed=well_placed)

    for part, bound in ((2, 0.1), (4, np.radians(10.0))):
        motion = np.zeros(6)
        motion[part] = 0.99 * reach * bound
        assert not due(motion)
        motion[part] = 1.01 * reach * bound
        assert due(motion)
    assert not due(np.zeros(6), overlap=0.76)
    assert due(np.zeros(6), overlap=0.74)


def test_at_a_share_of_one_and_by_gap_it_does_not_matter():
    moved = se3.exp([0.09, 0, 0, 0, 0, 0])
    alone = KeyframesConfig(max_translation_m=0.1, early_share=1.0)
    assert not is_due(alone, moved, 1.0, 1, well_placed=True)
    gap = KeyframesConfig(rule="gap", gap_frames=5, max_translation_m=0.1)
    assert not is_due(gap, moved, 1.0, 4, well_placed=True)


def track(frames, *overrides):
    odometry = Odometry(problems.CAMERA, Config().with_overrides([*BOUNDS, *overrides]))
    return [odometry.track(frame) for frame in frames]


def blurred(frame):
    return Frame(frame.timestamp, cv2.GaussianBlur(frame.grey, (0, 0), 2.5), frame.depth)


@pytest.fixture(scope="module")
def way():
    """Frames, and how far each is from the first."""
    frames, truth = problems.sequence(30)
    return frames, [float(np.linalg.norm((se3.inverse(truth[0]) @ T)[:3, 3])) for T in truth]


def test_the_sharp_one_among_blurred_frames_becomes_the_keyframe(way):
    frames, far = way
    reach = [k for k, distance in enumerate(far) if 0.7 * BOUND_M < distance < 0.95 * BOUND_M]
    near = [k for k in range(1, reach[0]) if far[k] > 0.2 * BOUND_M]
    assert all(a < b for a, b in pairwise(far[: reach[-1] + 1]))
    assert len(reach) > 2
    sharp = reach[1]
    spoiled = [
        blurred(frame) if k in (*near, *reach) and k != sharp else frame
        for k, frame in enumerate(frames)
    ]
    results = track(spoiled, EARLY, *ALIKE)
    assert all(result.status is not Status.LOST for result in results)
    taken = [result.index for result in results if result.is_keyframe]
    assert taken[:2] == [0, sharp]
    late = [r.index for r in track(spoiled, *ALIKE) if r.is_keyframe]
    assert far[late[1]] > 0.95 * BOUND_M


def test_without_a_covariance_keyframes_come_at_the_bounds(way):
    results = track(way[0], "status.covariance=none", EARLY)
    alone = track(way[0], "status.covariance=none")
    assert [r.is_keyframe for r in results] == [r.is_keyframe for r in alone]
