"""Where a camera is along what nothing constrains: against plain NumPy, and known answers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edvo import kernels, se3
from edvo.config import Config
from edvo.course import FADING_S, HAND
from edvo.inertia import Inertia
from edvo.uncertainty import DEGENERATE_M

from . import problems, twins

PERIOD = 1 / 30
VELOCITY = np.array([0.2, -0.3, 0.1, 0.1, 0.0, -0.2])
SURE = 1e-8 * np.eye(6)


def loose(axis, deviation=1.0):
    """A covariance by which one motion is not known."""
    C = SURE.copy()
    C[axis, axis] = deviation**2
    return C


def own(T, C):
    """A covariance of the camera's own frame, as that of the keyframe's."""
    Ad = se3.adjoint(T)
    return Ad @ C @ Ad.T


def moving(count=12, **changes):
    """A camera that has moved for a while at constant velocity, and where it is."""
    inertia = Inertia(Config().with_overrides([f"motion.{k}={v}" for k, v in changes.items()]))
    T_key_last = np.eye(4)
    for k in range(count):
        T = T_key_last @ se3.exp(PERIOD * VELOCITY)
        assert inertia.settle(0, T_key_last, T, SURE, PERIOD, follows=k > 0) is None
        T_key_last = T
    return inertia, T_key_last


def spd(rng, size):
    A = rng.normal(size=(size, size))
    return A @ A.T + 0.1 * np.eye(size)


@given(seed=st.integers(0, 2**31), seconds=st.floats(0.005, 0.2))
def test_filter_pose_is_a_kalman_filter(seed, seconds):
    rng = np.random.default_rng(seed)
    whole, C = spd(rng, 12), spd(rng, 6)
    P = np.array([whole[:6, :6], whole[:6, 6:], whole[6:, 6:]])
    velocity, off, moved = rng.normal(size=6), rng.normal(size=6), np.empty(6)
    T = problems.motion(rng, 0.3, 30.0)
    expected = twins.filter_pose(whole, T, C, HAND**2, seconds, off, velocity)
    assert kernels.filter_pose(P, T, C, HAND**2, seconds, off, velocity, moved)
    whole, velocity_after, moved_by = expected
    np.testing.assert_allclose(P[0], whole[:6, :6], atol=1e-9)
    np.testing.assert_allclose(P[1], whole[:6, 6:], atol=1e-9)
    np.testing.assert_allclose(P[2], whole[6:, 6:], atol=1e-9)
    np.testing.assert_allclose(velocity, velocity_after, atol=1e-9)
    np.testing.assert_allclose(moved, moved_by, atol=1e-9)


def test_what_is_no_covariance_is_refused():
    P = np.zeros((3, 6, 6))
    C = np.full((6, 6), np.nan)
    given = np.eye(4), C, HAND**2, PERIOD, np.zeros(6), np.zeros(6)
    assert not kernels.filter_pose(P, *given, np.empty(6))


def test_a_registration_that_is_sure_stands():
    inertia, T = moving()
    elsewhere = T @ se3.exp(np.array([0.02, 0.02, 0.02, 0, 0, 0]))
    assert inertia.settle(0, T, elsewhere, SURE, PERIOD, follows=True) is None
    assert not inertia.is_adrift


@pytest.mark.parametrize("axis", range(6))
def test_along_what_is_not_known_it_goes_on_as_it_went(axis):
    """And everywhere else it is where it was registered."""
    inertia, T = moving(30)
    astray = np.full(6, 0.004)
    astray[axis] = 0.3
    ahead = T @ se3.exp(PERIOD * VELOCITY)
    registered = ahead @ se3.exp(astray)
    C = own(registered, loose(axis))
    held = inertia.settle(0, T, registered, C, PERIOD, follows=True)
    assert held is not None
    off = se3.log(se3.inverse(ahead) @ held)
    others = np.arange(6) != axis
    np.testing.assert_allclose(off[others], astray[others], atol=6e-4)
    faded = abs(PERIOD * VELOCITY[axis]) * (1 - np.exp(-PERIOD / FADING_S))
    assert abs(off[axis]) < faded + 0.01 * astray[axis]


def test_its_velocity_fades_and_the_pose_is_adrift_after_a_while():
    inertia, T = moving(30)
    assert not inertia.is_adrift
    way = np.zeros(6)
    for k in range(20):
        ahead = T @ se3.exp(PERIOD * VELOCITY)
        ahead[:3, 3] += ahead[:3, 1] * 0.1  # of no account: along y nothing is known
        held = inertia.settle(0, T, ahead, own(ahead, loose(1)), PERIOD, follows=True)
        assert held is not None
        way += se3.log(se3.inverse(T) @ held)
        T = held
        assert inertia.is_adrift == (k > 3)
    shares = np.exp(-PERIOD * np.arange(1, 21) / FADING_S)
    assert way[1] == pytest.approx(PERIOD * VELOCITY[1] * shares.sum(), rel=0.1)
    np.testing.assert_allclose(way[[0, 2]], 20 * PERIOD * VELOCITY[[0, 2]], rtol=0.1, atol=0.003)
    # what is seen again tells where it is
    assert inertia.settle(0, T, T, SURE, PERIOD, follows=True) is None
    assert not inertia.is_adrift


def test_a_frame_that_is_the_keyframe_is_where_it_is_but_for_how_it_came_there():
    inertia, T = moving(30)
    for _ in range(20):
        T = inertia.settle(0, T, T, loose(1), PERIOD, follows=True)
    assert inertia.is_adrift
    sd = 2.0 / np.sqrt(2) * DEGENERATE_M  # by the last keyframe's 20 frames it would be left out
    T = inertia.settle(20, np.eye(4), np.eye(4), loose(1, sd), PERIOD, follows=True)
    assert np.linalg.norm(T[:3, 3]) < 2 * PERIOD * np.linalg.norm(inertia.velocity[:3])
    assert inertia.is_adrift  # a keyframe before it was
    assert inertia.settle(20, T, T, SURE, PERIOD, follows=True) is None
    assert not inertia.is_adrift


def test_what_is_weak_for_long_is_adrift_however_sure_the_filter_is():
    inertia, T = moving(30)
    weak = loose(1, 1.1 * DEGENERATE_M / 3)
    said = []
    for _ in range(8):
        T = inertia.settle(0, T, T, weak, PERIOD, follows=True)
        said.append(inertia.is_adrift)
    assert said == [False] * 4 + [True] * 4


def test_a_weak_registration_is_weighed_by_how_sure_it_is():
    parts = []
    for deviation in (1.1 * DEGENERATE_M / 3, DEGENERATE_M, 1.0):
        inertia, T = moving(30)
        ahead = T @ se3.exp(PERIOD * inertia.velocity)
        registered = ahead @ se3.exp(np.array([0, 0.01, 0, 0, 0, 0]))
        C = own(registered, loose(1, deviation))
        held = inertia.settle(0, T, registered, C, PERIOD, follows=True)
        parts.append(se3.log(se3.inverse(ahead) @ held)[1] / 0.01)
    assert 0.5 > parts[0] > parts[1] > parts[2] > 0
    assert parts[2] < 0.001


def test_it_begins_anew_where_the_last_pose_is_not_that_of_a_moment_ago():
    inertia, T = moving(30)
    assert inertia.settle(0, T, T, loose(1), PERIOD, follows=False) is None
    np.testing.assert_array_equal(inertia.velocity, 0)


def test_none_is_none():
    inertia, T = moving(inertia="none")
    assert inertia.settle(0, T, T, loose(1), PERIOD, follows=True) is None
    assert not inertia.is_adrift
