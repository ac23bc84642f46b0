import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.evaluation.honesty import error_speed

COUNT = 90
TIMES = np.arange(COUNT) / 30


def way(speed: float = 0.3) -> NDArray[np.float64]:
    """Walk along x and turn, 30 poses a second."""
    return np.array([se3.exp(np.array([speed * t, 0, 0, 0, 0.4 * t, 0])) for t in TIMES])


def all_but(*spans: range) -> NDArray[np.bool_]:
    trusted = np.ones(COUNT, bool)
    for span in spans:
        trusted[span] = False
    return trusted


def test_a_right_trajectory_in_another_world_has_no_error() -> None:
    T_other_world = se3.exp(np.array([1.0, 2.0, 3.0, 0.3, 0.2, 0.1]))
    speed = error_speed(TIMES, way(), T_other_world @ way(), all_but())
    assert np.isnan(speed[0])
    assert np.nanmax(speed) < 1e-9


def test_a_steady_drift_is_its_speed_once_a_second_has_passed() -> None:
    drifting = np.tile(np.eye(4), (COUNT, 1, 1))
    drifting[:, 0, 3] = 0.2 * TIMES
    speed = error_speed(TIMES, np.tile(np.eye(4), (COUNT, 1, 1)), drifting, all_but())
    assert speed[3] == pytest.approx(0.02)  # what is younger than a second counts as a second
    np.testing.assert_allclose(speed[31:], 0.2)


def test_a_jump_counts_for_one_second() -> None:
    poses = way()
    poses[40:, :3, 3] += (0.15, 0, 0)
    wrong = error_speed(TIMES, way(), poses, all_but()) > 0.1
    assert np.flatnonzero(wrong).tolist() == list(range(40, 70))


def test_a_jump_while_not_trusted_is_answered_for_by_those_that_follow() -> None:
    poses = way()
    poses[45:, :3, 3] += (0.15, 0, 0)
    speed = error_speed(TIMES, way(), poses, all_but(range(40, 50)))
    assert np.isnan(speed[40:50]).all()
    assert (speed[50:70] > 0.1).all()


def test_a_long_loss_does_not_thin_the_error_out() -> None:
    poses = way()
    poses[70:, :3, 3] += (0.15, 0, 0)
    speed = error_speed(TIMES, way(), poses, all_but(range(10, 70)))
    assert speed[70] == pytest.approx(0.15 / (1 + 1 / 30), rel=0.02)


def test_poses_that_are_not_trusted_or_have_no_truth_say_nothing() -> None:
    truth, poses = way(), way()
    truth[20] = np.nan
    poses[30, 0, 3] += 5
    speed = error_speed(TIMES, truth, poses, all_but(range(30, 31)))
    assert np.isnan(speed[[20, 30]]).all()
    assert np.nanmax(speed) < 1e-9


def test_a_slow_stream_is_measured_over_its_own_period() -> None:
    times = TIMES * 20  # a frame every two thirds of a second
    drifting = np.tile(np.eye(4), (COUNT, 1, 1))
    drifting[:, 0, 3] = 0.2 * times
    speed = error_speed(times, np.tile(np.eye(4), (COUNT, 1, 1)), drifting, all_but())
    np.testing.assert_allclose(speed[5:], 0.2)
