import numpy as np
import pytest

from edvo import se3
from edvo.config import Config, KeyframesConfig
from edvo.keyframes import is_due
from edvo.odometry import Odometry
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

MOTION = KeyframesConfig(
    rule="motion", max_translation_m=0.1, max_rotation_deg=8.0, min_overlap=0.6
)
GAP = KeyframesConfig(rule="gap", gap_frames=4)


def pose(translation=0.0, rotation_deg=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return problems.motion(rng, translation + 1e-12, rotation_deg + 1e-12)


@pytest.mark.parametrize(("age", "due"), [(0, False), (1, False), (3, False), (4, True), (9, True)])
def test_by_gap_only_the_age_counts(age, due):
    assert is_due(GAP, np.eye(4), 1.0, age) is due
    assert is_due(GAP, pose(5.0, 170.0), 0.0, age) is due


@pytest.mark.parametrize("seed", range(4))
def test_by_motion_translation_counts_in_any_direction(seed):
    assert not is_due(MOTION, pose(0.0999, seed=seed), 1.0, 1)
    assert is_due(MOTION, pose(0.1001, seed=seed), 1.0, 1)


@pytest.mark.parametrize("seed", range(4))
def test_by_motion_rotation_counts_about_any_axis(seed):
    assert not is_due(MOTION, pose(0, 7.99, seed), 1.0, 1)
    assert is_due(MOTION, pose(0, 8.01, seed), 1.0, 1)
    assert is_due(MOTION, pose(0, 175.0, seed), 1.0, 1)


def test_by_motion_overlap_counts_and_age_does_not():
    assert not is_due(MOTION, np.eye(4), 0.6, 10_000)
    assert is_due(MOTION, np.eye(4), 0.59, 1)


def test_rotation_and_translation_do_not_mix():
    turned = se3.exp([0, 0, 0, 0, np.radians(7), 0])
    turned[:3, 3] = [0.05, 0.05, 0.05]
    assert not is_due(MOTION, turned, 1.0, 1)


@pytest.mark.parametrize(("most", "far"), [(0.1, 0.3), (0.3, 0.1)])
def test_where_a_place_is_not_as_sure_the_wider_bound_counts(most, far):
    config = KeyframesConfig(max_translation_m=most, far_translation_m=far, max_rotation_deg=8.0)
    for moved, due in ((0.299, False), (0.301, True)):
        assert is_due(config, pose(moved), 1.0, 1, close=False) is due
    assert is_due(config, pose(most + 0.001), 1.0, 1)
    assert is_due(config, pose(0, 8.01), 1.0, 1, close=False)


def test_frames_that_come_seldom_are_held_to_the_wider_bound():
    recipe = make_recipe("office", frames=60, camera=problems.CAMERA, speed=0.4)
    source = SyntheticSource(recipe)
    frames = [source.read(k).frame for k in range(0, 60, 8)]  # every 0.27 s, 0.1 m

    def keyframes(*changes):
        odometry = Odometry(source.camera, Config().with_overrides(changes))
        return [r.index for r in map(odometry.track, frames) if r.is_keyframe]

    narrow = keyframes("keyframes.far_translation_m=0.15")
    assert len(keyframes()) < len(narrow)
    assert keyframes("keyframes.max_translation_m=0.3") == keyframes()
