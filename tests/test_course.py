"""Where a camera was last: what stamps tell of it, and what a jump of the clock leaves."""

from types import SimpleNamespace

import numpy as np
import pytest

from edvo import se3
from edvo.course import LONGEST_PREDICTION_S, NOMINAL_PERIOD_S, Course
from edvo.errors import TrajectoryError

AHEAD = np.array([0.3, 0.0, 0.0, 0.0, 0.1, 0.0])


@pytest.fixture
def course():
    """A camera that has moved for a tenth of a second."""
    course = Course()
    course.keyframe = SimpleNamespace(T_world_key=se3.exp([1.0, 0, 0, 0, 0, 0]))
    course.last_time = 10.0
    course.step(se3.exp(0.1 * AHEAD), se3.exp(0.1 * AHEAD), 0.1)
    return course


def test_it_goes_on_as_it_went(course):
    np.testing.assert_allclose(course.velocity, AHEAD, atol=1e-12)
    np.testing.assert_array_equal(
        course.T_world_last, course.keyframe.T_world_key @ course.T_key_last
    )
    np.testing.assert_allclose(course.ahead(10.1), se3.exp(0.1 * AHEAD), atol=1e-12)
    longest = se3.exp(LONGEST_PREDICTION_S * AHEAD)
    np.testing.assert_allclose(course.ahead(99.0), longest, atol=1e-12)


@pytest.mark.parametrize("stamp", [10.0, 10.0005, 9.5])
def test_stamps_that_make_no_sense_are_a_usual_period_apart(course, stamp):
    assert course.period(stamp) == NOMINAL_PERIOD_S
    assert Course().period(stamp) == NOMINAL_PERIOD_S


@pytest.mark.parametrize(
    ("losses", "after", "follows", "is_far"),
    [
        (0, 0.1, True, False),
        (0, 0.3, False, True),
        (1, 0.1, False, False),
        (1, 0.3, False, False),  # as frames come that often, it is no step
        (1, 0.5, False, True),
        (3, 9.0, False, False),  # it is lost
    ],
)
def test_what_follows_and_what_is_far(course, losses, after, follows, is_far):
    course.losses = losses
    assert course.follows(10.0 + after) is follows
    assert course.is_far_step(10.0 + after) is is_far


def test_what_has_drifted_is_held_against_where_it_was_last_known(course):
    known = se3.exp([0.2, -0.1, 0.4, 0.3, 0.0, -0.2])
    course.anchor = 9.0, known
    T, seconds = course.moved(course.T_key_last, 10.1)  # edges gave the last pose
    np.testing.assert_allclose(T, np.eye(4), atol=1e-12)
    assert seconds == pytest.approx(0.1)
    course.is_blind = True
    T, seconds = course.moved(course.T_key_last, 10.1)
    np.testing.assert_allclose(known @ T, course.T_world_last, atol=1e-12)
    assert seconds == course.unseen(10.1) == pytest.approx(1.1)


def test_a_clock_that_jumps_back_begins_to_count_anew(course):
    course.anchor = 9.0, np.eye(4)
    assert not course.rewind(9.5)
    assert course.unseen(10.1) == pytest.approx(1.1)
    assert course.rewind(2.0)
    assert course.unseen(2.1) == pytest.approx(0.1)
    course.last_time = 2.9  # depth alone has followed it till then, and it drifts as before
    assert course.unseen(3.0) == pytest.approx(1.0)


def test_it_begins_where_it_is_told_to():
    start = se3.exp(AHEAD)
    np.testing.assert_allclose(Course(start).T_world_last, start, atol=1e-12)
    with pytest.raises(TrajectoryError, match="no rigid motion"):
        Course(2 * start)


def test_what_drifts_moves_since_a_registration_stood(course):
    """A gap that is closed in one frame is no speed."""
    T = course.T_key_last
    for k in range(1, 4):
        ahead = T @ se3.exp(0.1 * k * AHEAD)
        course.drift(ahead, AHEAD)
        course.last_time = 10.0 + 0.1 * k
    np.testing.assert_array_equal(course.velocity, AHEAD)
    T_stood_cur, seconds = course.moved(T @ se3.exp(0.5 * AHEAD), 10.4)
    np.testing.assert_allclose(T_stood_cur, se3.exp(0.5 * AHEAD), atol=1e-12)
    assert seconds == pytest.approx(0.4)
    course.step(T, np.eye(4), 0.1)
    assert course.moved(T, 10.5)[1] == pytest.approx(0.2)
    course.drift(T, AHEAD)
    assert course.rewind(5.0)
    assert course.stood is None
