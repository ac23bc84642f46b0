import doctest
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from edvo import se3
from edvo.errors import TrajectoryError

Array = NDArray[np.float64]

# Rotation about 90 degrees of z that also lifts: known by hand.
QUARTER_TURN = np.array(
    [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
)


def unit(values: tuple[float, float, float]) -> Array:
    vector = np.array(values)
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 1e-3 else np.array([0.0, 0.0, 1.0])


number = st.floats(-1.0, 1.0)
axes = st.tuples(number, number, number).map(unit)
# Angles of every order of magnitude, and those that come as near to pi.
angles = st.one_of(
    st.just(0.0),
    st.floats(-12.0, math.log10(3.0)).map(lambda power: 10.0**power),
    st.floats(0.0, math.pi - 1e-9),
    st.floats(-9.0, 0.0).map(lambda power: math.pi - 10.0**power),
    st.sampled_from([0.299999, 0.3, 0.300001, math.pi / 2, 2 * math.pi / 3]),
)
translations = st.tuples(*[st.floats(-10.0, 10.0)] * 3).map(np.array)


@st.composite
def twists(draw: st.DrawFn) -> Array:
    return np.concatenate((draw(translations), draw(axes) * draw(angles)))


motions = twists().map(se3.exp)


def assert_rigid(T: Array) -> None:
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


@given(twists())
def test_log_inverts_exp(xi: Array) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-13, rtol=1e-13)


@given(motions)
def test_exp_inverts_log(T: Array) -> None:
    np.testing.assert_allclose(se3.exp(se3.log(T)), T, atol=1e-13)


@given(axes, translations)
def test_half_turns_come_back(axis: Array, translation: Array) -> None:
    T = np.eye(4)
    T[:3, :3] = 2.0 * np.outer(axis, axis) - np.eye(3)  # by exactly pi
    T[:3, 3] = translation
    xi = se3.log(T)
    assert np.linalg.norm(xi[3:]) == pytest.approx(math.pi, abs=1e-14)
    np.testing.assert_allclose(se3.exp(xi), T, atol=1e-13)


@pytest.mark.parametrize("diagonal", [(1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_half_turns_about_the_axes_are_exact(diagonal: tuple[int, ...]) -> None:
    xi = se3.log(np.diag([*diagonal, 1]))
    np.testing.assert_array_equal(np.abs(xi[3:]), np.where(np.array(diagonal) == 1, math.pi, 0))


@given(axes, st.floats(-15.0, 0.0))
def test_small_rotations_keep_their_relative_precision(axis: Array, power: float) -> None:
    w = axis * 10.0**power
    error = se3.log(se3.exp([0, 0, 0, *w]))[3:] - w
    assert np.linalg.norm(error) <= 4e-15 * np.linalg.norm(w)


@given(twists())
def test_exp_is_the_matrix_exponential(xi: Array) -> None:
    generator = np.zeros((4, 4))
    generator[:3, :3] = se3.hat(xi[3:])
    generator[:3, 3] = xi[:3]
    np.testing.assert_allclose(se3.exp(xi), expm(generator), atol=1e-12)


@pytest.mark.parametrize("angle", [math.pi + 0.5, 2 * math.pi, 20.0])
def test_exp_takes_more_than_half_a_turn(angle: float) -> None:
    w = angle * unit((1.0, -2.0, 0.5))
    T = se3.exp([1, 2, 3, *w])
    assert_rigid(T)
    np.testing.assert_allclose(T[:3, :3], Rotation.from_rotvec(w).as_matrix(), atol=1e-14)


def test_exp_and_log_of_nothing() -> None:
    np.testing.assert_array_equal(se3.exp(np.zeros(6)), np.eye(4))
    np.testing.assert_array_equal(se3.log(np.eye(4)), np.zeros(6))
    np.testing.assert_array_equal(
        se3.log(se3.exp([1, 2, 3, 0, 0, 1e-200])), [1, 2, 3, 0, 0, 1e-200]
    )


def test_exp_and_log_by_hand() -> None:
    quarter = math.pi / 2
    # While it turns by a quarter, a unit of forward speed goes 2/pi ahead and 2/pi aside.
    T = se3.exp([quarter, 0, 5, 0, 0, quarter])
    np.testing.assert_allclose(T[:3, 3], [1, 1, 5], atol=1e-15)
    np.testing.assert_allclose(T[:3, :3], QUARTER_TURN[:3, :3], atol=1e-15)
    np.testing.assert_allclose(se3.log(T), [quarter, 0, 5, 0, 0, quarter], atol=1e-15)


@given(motions)
def test_inverse_undoes(T: Array) -> None:
    assert_rigid(T)
    np.testing.assert_allclose(se3.inverse(T) @ T, np.eye(4), atol=1e-13)
    np.testing.assert_allclose(T @ se3.inverse(T), np.eye(4), atol=1e-13)


def test_inverse_by_hand_leaves_its_input() -> None:
    before = QUARTER_TURN.copy()
    np.testing.assert_array_equal(se3.inverse(QUARTER_TURN)[:3, 3], [-2, 1, -3])
    np.testing.assert_array_equal(before, QUARTER_TURN)


@given(motions, motions, motions)
def test_compose_is_the_product_from_left_to_right(A: Array, B: Array, C: Array) -> None:
    np.testing.assert_allclose(se3.compose(A, B, C), A @ B @ C, atol=1e-12)
    np.testing.assert_array_equal(se3.compose(A), A)
    np.testing.assert_array_equal(se3.compose(), np.eye(4))


@given(motions, motions)
def test_interpolate_ends_at_both_poses(A: Array, B: Array) -> None:
    np.testing.assert_array_equal(se3.interpolate(A, B, 0.0), A)
    np.testing.assert_allclose(se3.interpolate(A, B, 1.0), B, atol=1e-11)


@given(motions, twists(), st.floats(0.0, 1.0))
def test_interpolate_moves_at_constant_speed(T_a: Array, xi: Array, alpha: float) -> None:
    T_b = T_a @ se3.exp(xi)
    middle = se3.interpolate(T_a, T_b, alpha)
    np.testing.assert_allclose(middle, T_a @ se3.exp(alpha * xi), atol=1e-11)
    # Along the screw it does not matter in which frame the step is taken.
    left = se3.exp(alpha * se3.log(T_b @ se3.inverse(T_a))) @ T_a
    np.testing.assert_allclose(middle, left, atol=1e-6 if np.linalg.norm(xi[3:]) > 3.1 else 1e-10)


@given(motions, twists())
def test_adjoint_carries_twists_through(T: Array, xi: Array) -> None:
    np.testing.assert_allclose(
        T @ se3.exp(xi), se3.exp(se3.adjoint(T) @ xi) @ T, atol=1e-10, rtol=1e-10
    )


@given(motions, motions)
def test_adjoint_keeps_products(A: Array, B: Array) -> None:
    np.testing.assert_allclose(se3.adjoint(A @ B), se3.adjoint(A) @ se3.adjoint(B), atol=1e-11)


@given(motions)
def test_adjoint_is_the_derivative_of_a_right_step_on_the_left(T: Array) -> None:
    step = 1e-6
    columns = [
        (se3.log(T @ se3.exp(e) @ se3.inverse(T)) - se3.log(T @ se3.exp(-e) @ se3.inverse(T)))
        / (2 * step)
        for e in step * np.eye(6)
    ]
    np.testing.assert_allclose(np.column_stack(columns), se3.adjoint(T), atol=1e-7)


@given(motions, translations)
def test_left_perturbation_of_a_point(T: Array, point: Array) -> None:
    """d exp(delta) T p / d delta at zero is [I, -hat(T p)], which registration relies on."""
    step = 1e-6
    moved = T[:3, :3] @ point + T[:3, 3]
    columns = []
    for e in step * np.eye(6):
        plus, minus = se3.exp(e) @ T, se3.exp(-e) @ T
        difference = (plus - minus) / (2 * step)
        columns.append(difference[:3, :3] @ point + difference[:3, 3])
    expected = np.hstack((np.eye(3), -se3.hat(moved)))
    np.testing.assert_allclose(np.column_stack(columns), expected, atol=1e-7)


@given(translations, translations)
def test_hat_is_the_cross_product(w: Array, p: Array) -> None:
    np.testing.assert_allclose(se3.hat(w) @ p, np.cross(w, p), atol=1e-13)
    np.testing.assert_array_equal(se3.hat(w), -se3.hat(w).T)


@given(motions)
def test_quaternions_come_back_and_agree_with_scipy(T: Array) -> None:
    translation, quaternion = se3.to_quaternion(T)
    assert quaternion[3] >= 0.0
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(se3.from_quaternion(translation, quaternion), T, atol=1e-14)
    other = Rotation.from_matrix(T[:3, :3]).as_quat()
    assert abs(float(other @ quaternion)) == pytest.approx(1.0, abs=1e-14)


def test_quaternion_by_hand() -> None:
    half = math.sqrt(0.5)
    translation, quaternion = se3.to_quaternion(QUARTER_TURN)
    np.testing.assert_allclose(quaternion, [0, 0, half, half], atol=1e-15)
    np.testing.assert_array_equal(translation, [1, 2, 3])
    translation[0] = 9.0
    assert QUARTER_TURN[0, 3] == 1.0
    np.testing.assert_allclose(
        se3.from_quaternion([1, 2, 3], [0, 0, half, half]), QUARTER_TURN, atol=1e-15
    )


@given(axes, angles, st.floats(-200, 200))
def test_quaternions_of_any_length_and_sign(axis: Array, angle: float, power: float) -> None:
    quaternion = np.append(axis * math.sin(angle / 2), math.cos(angle / 2))
    T = se3.from_quaternion([0, 0, 0], quaternion)
    assert_rigid(T)
    scaled = se3.from_quaternion([0, 0, 0], -quaternion * 10.0**power)
    np.testing.assert_allclose(scaled, T, atol=1e-14)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, math.nan, 1], [math.inf, 0, 0, 1]])
def test_what_is_no_quaternion_is_refused(quaternion: list[float]) -> None:
    with pytest.raises(TrajectoryError, match="no rotation; give a unit one"):
        se3.from_quaternion([0, 0, 0], quaternion)


@given(axes, angles)
def test_rotation_angle_is_accurate_everywhere(axis: Array, angle: float) -> None:
    T = se3.exp(np.concatenate(([1.0, 2.0, 3.0], axis * angle)))
    assert se3.rotation_angle(T) == pytest.approx(angle, abs=2e-15, rel=1e-14)
    assert se3.rotation_angle(T[:3, :3]) == se3.rotation_angle(T)


def test_examples() -> None:
    assert doctest.testmod(se3).failed == 0


def test_cameras_are_as_far_apart_as_their_centres_whatever_way_they_look() -> None:
    turned = se3.exp(np.array([0.0, 0.0, 0.0, 0.3, -0.2, 0.9]))
    aside = turned.copy()
    aside[:3, 3] = 0.3, -0.4, 1.2
    assert se3.distance(turned, np.eye(4)) == 0.0
    assert se3.distance(turned, aside) == pytest.approx(1.3)
    assert se3.distance(aside, turned) == pytest.approx(1.3)
