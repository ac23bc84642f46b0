import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import se3
from edvo.errors import EvaluationError
from edvo.evaluation import absolute_trajectory_error
from edvo.evaluation.ate import align
from edvo.trajectory import Trajectory


@given(
    seed=st.integers(0, 2**32 - 1),
    true_rate=st.sampled_from([7.0, 30.0, 100.0]),
    jitter=st.sampled_from([0.0, 0.015]),
    limit=st.sampled_from([0.003, 0.02, 0.05]),
)
@settings(max_examples=25)
def test_it_equals_the_plain_loop(script, make_pair, as_dict, seed, true_rate, jitter, limit):
    reference, estimate = make_pair(seed, seconds=2.0, true_rate=true_rate, jitter=jitter, drop=0.1)
    truth, estimated = as_dict(reference), as_dict(estimate)
    if len(script.associate(truth, estimated, limit)) < 3:
        with pytest.raises(EvaluationError, match="true pose within"):
            absolute_trajectory_error(reference, estimate, max_difference=limit)
        return
    errors, R, t = script.evaluate_ate(truth, estimated, limit)
    ours = absolute_trajectory_error(reference, estimate, max_difference=limit)
    np.testing.assert_allclose(ours.errors, errors, rtol=0, atol=1e-10)
    np.testing.assert_allclose(ours.T_ref_est[:3, :3], R, atol=1e-6)
    np.testing.assert_allclose(ours.T_ref_est[:3, 3], t, atol=1e-6)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_alignment_is_found_again(seed):
    rng = np.random.default_rng(seed)
    T = se3.exp(rng.normal(size=6))
    points = rng.normal(size=(20, 3))
    np.testing.assert_allclose(align(points @ T[:3, :3].T + T[:3, 3], points), T, atol=1e-9)


def test_a_mirrored_estimate_is_not_mirrored_back():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(30, 3))
    T = align(points * [1, 1, -1], points)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_another_world_costs_nothing_and_another_scale_does(make_pair):
    reference, _ = make_pair(5)
    world = se3.exp(np.array([1.0, -2.0, 3.0, 0.4, 0.5, -0.6]))
    moved = Trajectory.from_poses(reference.timestamps, world @ reference.poses)
    assert absolute_trajectory_error(reference, moved).rmse < 1e-12
    scaled = reference.poses.copy()
    scaled[:, :3, 3] *= 1.2
    error = absolute_trajectory_error(
        reference, Trajectory.from_poses(reference.timestamps, scaled)
    )
    assert error.rmse > 0.01


def test_nothing_in_common_is_said(make_pair):
    reference, estimate = make_pair(5)
    later = Trajectory(estimate.timestamps + 1000, estimate.poses, estimate.stamps)
    with pytest.raises(EvaluationError, match="same clock"):
        absolute_trajectory_error(reference, later)
