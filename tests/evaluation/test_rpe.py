import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import se3
from edvo.errors import EvaluationError
from edvo.evaluation import relative_pose_error, standing_still
from edvo.trajectory import Trajectory


@given(
    seed=st.integers(0, 2**32 - 1),
    delta=st.sampled_from([0.2, 0.5, 1.0, 1.7]),
    drop=st.sampled_from([0.0, 0.3, 0.9]),
    true_rate=st.sampled_from([8.0, 30.0, 100.0]),
    jitter=st.sampled_from([0.0, 0.01]),
    formula=st.sampled_from(["script", "sturm"]),
)
@settings(max_examples=40)
def test_it_equals_the_plain_loop(
    script, make_pair, as_dict, seed, delta, drop, true_rate, jitter, formula
):
    reference, estimate = make_pair(seed, true_rate=true_rate, drop=drop, jitter=jitter)
    if len(estimate) < 2:
        return
    rows = script.evaluate_rpe(as_dict(reference), as_dict(estimate), delta, formula=formula)
    if len(rows) < 2:
        with pytest.raises(EvaluationError):
            relative_pose_error(reference, estimate, delta=delta, formula=formula)
        return
    error = relative_pose_error(reference, estimate, delta=delta, formula=formula)
    stamps, translation, rotation = np.array(rows).T
    np.testing.assert_array_equal(error.stamps, stamps)
    np.testing.assert_allclose(error.translation, translation, rtol=0, atol=1e-12)
    # The script's arc cosine keeps half the digits near zero.
    np.testing.assert_allclose(error.rotation, rotation, rtol=0, atol=1e-7)


@given(seed=st.integers(0, 2**32 - 1), delta=st.integers(1, 40))
@settings(max_examples=15)
def test_it_equals_the_plain_loop_in_frames(script, make_pair, as_dict, seed, delta):
    reference, estimate = make_pair(seed, drop=0.2)
    rows = script.evaluate_rpe(as_dict(reference), as_dict(estimate), delta, unit="f")
    error = relative_pose_error(reference, estimate, delta=delta, unit="f")
    np.testing.assert_allclose(error.translation, np.array(rows)[:, 1], rtol=0, atol=1e-12)


def test_a_known_error_comes_out_by_hand():
    # 1 m/s along x in truth, 1.1 m/s in the estimate, no rotation: 0.1 m over each second.
    times = np.arange(0.0, 5.05, 0.1)
    true = np.tile(np.eye(4), (len(times), 1, 1))
    true[:, 0, 3] = times
    estimated = true.copy()
    estimated[:, 0, 3] *= 1.1
    error = relative_pose_error(
        Trajectory.from_poses(times, true), Trajectory.from_poses(times, estimated)
    )
    np.testing.assert_allclose(error.translation, 0.1, atol=1e-12)
    np.testing.assert_allclose(error.rotation, 0.0, atol=1e-12)
    assert len(error) == len(times) - 11  # the last second starts no pair, and one ends on the last
    assert error.rmse == pytest.approx(0.1)


def test_the_two_formulas_differ_in_translation_only(make_pair):
    reference, estimate = make_pair(3, seconds=8.0, noise=0.01)
    script, sturm = (
        relative_pose_error(reference, estimate, formula=formula) for formula in ("script", "sturm")
    )
    np.testing.assert_allclose(script.rotation, sturm.rotation, atol=1e-9)
    assert np.abs(script.translation - sturm.translation).max() > 1e-4
    assert script.rmse == pytest.approx(sturm.rmse, rel=0.3)


def test_small_rotations_keep_their_digits():
    times = np.arange(0.0, 3.05, 0.1)
    true = np.tile(np.eye(4), (len(times), 1, 1))
    estimated = np.array([se3.exp(np.array([0, 0, 0, 1e-10 * time, 0, 0])) for time in times])
    error = relative_pose_error(
        Trajectory.from_poses(times, true), Trajectory.from_poses(times, estimated)
    )
    np.testing.assert_allclose(error.rotation, 1e-10, rtol=1e-4)


def test_many_pairs_are_sampled_by_seed(make_pair):
    reference, estimate = make_pair(1, seconds=6.0)
    everything = relative_pose_error(reference, estimate, max_pairs=0)
    some = relative_pose_error(reference, estimate, max_pairs=50, seed=4)
    again = relative_pose_error(reference, estimate, max_pairs=50, seed=4)
    other = relative_pose_error(reference, estimate, max_pairs=50, seed=5)
    assert len(some) == 50
    assert len(everything) > 100
    assert set(some.stamps) < set(everything.stamps)
    assert (np.diff(some.stamps) > 0).all()
    np.testing.assert_array_equal(some.translation, again.translation)
    assert not np.array_equal(some.stamps, other.stamps)


def test_a_pair_with_itself_is_skipped_where_the_script_counts_zero(script, make_pair, as_dict):
    reference, estimate = make_pair(2, seconds=8.0)
    early, late = estimate.between(0.0, 102.0), estimate.between(105.0, 200.0)
    gapped = Trajectory.from_poses(
        np.concatenate([early.timestamps, late.timestamps]),
        np.concatenate([early.poses, late.poses]),
    )
    as_script = script.evaluate_rpe(as_dict(reference), as_dict(gapped), count_self_pairs=True)
    self_pairs = [row for row in as_script if row[1] < 1e-12]
    error = relative_pose_error(reference, gapped)
    assert self_pairs
    assert len(error) == len(as_script) - len(self_pairs)
    assert error.translation.min() > 0


def test_standing_still_errs_by_the_motion(make_pair):
    reference, estimate = make_pair(6)
    error = relative_pose_error(reference, standing_still(estimate))
    rows = [
        np.linalg.norm((np.linalg.inv(reference.poses[j]) @ reference.poses[i])[:3, 3])
        for i, j in [
            (reference.nearest(t), reference.nearest(estimate.timestamps[estimate.nearest(t + 1)]))
            for t in error.stamps
        ]
    ]
    np.testing.assert_allclose(error.translation, rows, atol=1e-12)


def test_what_cannot_be_compared_says_why(make_pair):
    reference, estimate = make_pair(7)
    later = Trajectory(estimate.timestamps + 1000, estimate.poses, estimate.stamps)
    with pytest.raises(EvaluationError, match="same clock"):
        relative_pose_error(reference, later)
    with pytest.raises(EvaluationError, match="shorter delta"):
        relative_pose_error(reference, estimate, delta=60)
    with pytest.raises(EvaluationError, match="two of each"):
        relative_pose_error(reference, Trajectory.from_poses([], []))
    for delta in (0, -1, math.nan):
        with pytest.raises(EvaluationError, match="positive"):
            relative_pose_error(reference, estimate, delta=delta)
    with pytest.raises(EvaluationError, match="unknown unit"):
        relative_pose_error(reference, estimate, unit="m")
    with pytest.raises(EvaluationError, match="unknown formula"):
        relative_pose_error(reference, estimate, formula="evo")


def poses_at(times):
    return Trajectory.from_poses(times, np.tile(np.eye(4), (len(times), 1, 1)))


STEADY = np.arange(100) / 30
ON_A_CLOCK = 1.6e9 + np.arange(100) / 10
TWO_PARTS = np.array([0.0, 1.0, 1000.0, 1001.0])


@pytest.mark.parametrize(
    ("times", "delta", "unit", "mend", "will_do"),
    [
        (STEADY, 0.001, "s", "give a longer delta: 0.0334 s will do", 0.0334),
        (STEADY, 0.3, "f", "give a longer delta: 1 frame will do", 1),
        (STEADY, 60, "s", "give a shorter delta: up to 3.23 s will do", 3.23),
        (STEADY, 99, "f", "give a shorter delta: up to 97 frames will do", 97),
        (ON_A_CLOCK, 0.001, "s", "give a longer delta: 0.1 s will do", 0.1),
        (TWO_PARTS, 300, "s", "there is a gap between them; give another delta", 999),
        (STEADY[:3], 1, "s", "give 4 poses at least", None),
    ],
)
def test_a_span_without_pairs_says_which_will_do(times, delta, unit, mend, will_do):
    still = poses_at(times)
    with pytest.raises(EvaluationError) as told:
        relative_pose_error(still, still, delta=delta, unit=unit)
    assert str(told.value).endswith(f"; {mend}")
    if will_do is not None:
        assert len(relative_pose_error(still, still, delta=will_do, unit=unit)) > 1
