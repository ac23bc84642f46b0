"""What is measured of a camera while it is tracked: known answers, and what is refused."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import se3
from edvo.measuring import (
    LONGEST_S,
    MEMORY_S,
    REACHED,
    SETTLING_S,
    SHARED,
    Changes,
    Equations,
    Estimate,
    Measured,
    Moments,
    taken_by_pose,
)

EXPECTED = 0.01
AS_THE_PRIOR = SHARED / EXPECTED**2  # information
CERTAIN = 1e6 * AS_THE_PRIOR
TWIST = np.array([0.3, -0.2, 0.1, 0.4, -0.5, 0.6])
PERIOD = 1 / 30


# -------------------------------------------------------------------------------------- estimate


def noted(*measurements):
    estimate = Estimate(EXPECTED)
    for information, value, seconds in measurements:
        estimate.note(information, information * value, seconds)
    return estimate


def test_a_number_is_weighed_against_its_prior():
    assert Estimate(EXPECTED).value == 0.0
    assert noted((AS_THE_PRIOR, 0.02, PERIOD)).likely == pytest.approx(0.01)
    assert noted((CERTAIN, 0.02, PERIOD)).value == pytest.approx(0.02, rel=1e-5)
    both = noted((CERTAIN, 0.01, 0.0), (3 * CERTAIN, 0.02, 0.0))
    assert both.value == pytest.approx(0.0175, rel=1e-5)
    both.forget()
    assert both.value == 0.0


def test_a_number_counts_once_it_is_told_from_zero():
    vague, sure = noted((AS_THE_PRIOR, 0.02, PERIOD)), noted((24 * AS_THE_PRIOR, 0.02, PERIOD))
    assert vague.likely**2 < 4 * vague.variance
    assert vague.value == 0.0
    assert sure.value == sure.likely == pytest.approx(0.0192)


def test_a_number_is_known_once_it_is_certain_or_if_nobody_asks():
    assert not Estimate(EXPECTED).is_known(0.4 * EXPECTED)
    three = noted((3 * AS_THE_PRIOR, 0.0, PERIOD))  # four with the prior: half of its sigma
    assert three.is_known(0.51 * EXPECTED)
    assert not three.is_known(0.49 * EXPECTED)
    assert Estimate(EXPECTED, wanted=False).is_known(0.0)


@pytest.mark.parametrize("value", [0.04, -0.04, math.nan, math.inf])
def test_what_contradicts_is_refused(value):
    assert noted((CERTAIN, value, PERIOD)).value == 0.0
    known = noted((CERTAIN, 0.005, PERIOD), (CERTAIN, value, 0.0))
    assert known.value == pytest.approx(0.005, rel=1e-5)


def test_a_measurement_that_says_nothing_is_not_refused_for_being_far_off():
    vague = noted((1e-4 * AS_THE_PRIOR, 1.0, PERIOD))
    assert vague.likely == pytest.approx(1e-4, rel=1e-3)


def test_what_was_measured_long_ago_fades():
    estimate = noted((CERTAIN, 0.01, PERIOD), (CERTAIN, 0.02, MEMORY_S))
    old = math.exp(-1)
    assert estimate.value == pytest.approx((0.01 * old + 0.02) / (old + 1), rel=1e-5)


def learned(sigma_px, **options):
    """What one frame tells, and how surely, as its edges fit to so many pixels."""
    told = Equations(1e-3 * CERTAIN, -0.02e-3 * CERTAIN, np.zeros(6), np.zeros(6))
    estimate = Estimate(EXPECTED)
    alignment = SimpleNamespace(H=np.eye(6), sigma_px=sigma_px)
    estimate.learn(told, alignment, PERIOD, **options)
    return estimate.likely, 1 / estimate.variance - 1 / EXPECTED**2


def test_a_frame_tells_the_more_the_more_closely_its_residuals_fit():
    number, sure = learned(0.1)
    assert number == pytest.approx(0.02, rel=0.1)
    assert learned(0.05)[1] == pytest.approx(4 * sure)
    assert learned(0.2)[1] == pytest.approx(sure / 4)
    assert learned(0.05, least_px=0.1) == learned(0.0, least_px=0.1) == (number, sure)
    assert learned(0.2, least_px=0.1) == learned(0.2)


@pytest.mark.parametrize("off", [0.0, 0.01, -0.03])
def test_what_is_extrapolated_is_the_less_certain(off):
    estimate = Estimate(EXPECTED)
    estimate.take(Measured(0.01, 4 * AS_THE_PRIOR, off))
    variance = 1 / (4 * AS_THE_PRIOR / SHARED) + (REACHED * off) ** 2
    assert 1 / estimate.variance - 1 / EXPECTED**2 == pytest.approx(1 / variance)
    assert estimate.likely == pytest.approx(0.01 * estimate.variance / variance)


@pytest.mark.parametrize("information", [0.0, math.nan])
def test_what_tells_nothing_leaves_all_as_it_was(information):
    estimate = noted((CERTAIN, 0.01, PERIOD))
    known = estimate.likely, estimate.variance
    estimate.take(Measured(0.03, information, 0.0))
    assert (estimate.likely, estimate.variance) == known


def test_the_certainty_of_a_frame_is_what_it_would_add():
    told = Equations(1e-3 * CERTAIN, 0.0, np.zeros(6), np.zeros(6))
    alignment = SimpleNamespace(H=np.eye(6), sigma_px=0.2)
    assert told.certainty(alignment) == pytest.approx(learned(0.2)[1])
    assert told.certainty(alignment, 0.4) == pytest.approx(learned(0.4)[1])
    shared = replace(told, mixed=np.array([np.sqrt(1e-3 * CERTAIN), 0, 0, 0, 0, 0]))
    assert shared.certainty(alignment) == pytest.approx(0.0, abs=1e-6 * CERTAIN)
    loose = SimpleNamespace(H=np.zeros((6, 6)), sigma_px=0.2)
    assert told.certainty(loose) == 0.0


@pytest.mark.parametrize("left", [0.9, 0.5, 0.05])
def test_what_little_is_left_after_the_pose_counts_less_for_it(left):
    """Nobody knows to better than a tenth what it takes up; the number stays what it was."""
    push = np.array([math.sqrt(1 - left), 0, 0, 0, 0, 0])
    alone = Equations(1.0, -0.02 * left, push, np.zeros(6))
    alignment = SimpleNamespace(H=np.eye(6), sigma_px=0.5)
    information, gradient = alone.without_pose(alignment)
    assert -gradient / information == pytest.approx(0.02)
    assert information == pytest.approx(left / (left + 0.1 * (1 - left)) * left / 0.25)


# --------------------------------------------------------------------------------------- moments


def follow(poses, periods, keyframes=None):
    """The moments that frames give."""
    moments, keyframe = Moments(), object()
    keyframes = keyframes or [keyframe] * len(poses)
    return [
        moments.note(key, f"frame {k}", SimpleNamespace(T_ref_cur=T), period)
        for k, (key, T, period) in enumerate(zip(keyframes, poses, periods, strict=True))
    ]


def at(*seconds):
    start = se3.exp([0.5, 0.1, -0.2, 0.3, 0.2, -0.1])
    return [start @ se3.exp(TWIST * t) for t in seconds]


def test_each_frame_gets_a_velocity_once_the_next_one_is_there():
    first, second, *moments = follow(at(0.0, 0.03, 0.08, 0.1), (0.03, 0.03, 0.05, 0.02))
    assert first is second is None
    for k, (moment, period) in enumerate(zip(moments, (0.03, 0.05), strict=True)):
        assert moment.seen == f"frame {k + 1}"
        assert moment.period == period
        np.testing.assert_allclose(moment.expected, TWIST, atol=1e-9)
        np.testing.assert_allclose(moment.velocity, TWIST, atol=1e-9)


def test_the_velocity_is_that_of_both_steps_in_the_frame_between_them():
    before, here = np.eye(4), se3.exp([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    after = here @ se3.exp([0.0, 0.0, 0.0, 0.0, 0.2, 0.0])
    *_, moment = follow((before, here, after), (0.03, 0.03, 0.05))
    motion = after @ se3.inverse(before)  # of the camera, by the keyframe's axes
    expected = se3.inverse(here) @ motion @ here
    np.testing.assert_allclose(se3.exp(moment.velocity * 0.08), expected, atol=1e-12)
    np.testing.assert_allclose(moment.expected, [0.05 / 0.03, 0, 0, 0, 0, 0], atol=1e-12)


def test_a_wrong_pose_does_not_change_its_own_velocity():
    before, here, after = at(0.0, PERIOD, 2 * PERIOD)
    wrong = here @ se3.exp([0.005, -0.004, 0.003, 0.004, 0.005, -0.003])
    *_, moment = follow((before, wrong, after), [PERIOD] * 3)
    np.testing.assert_allclose(moment.velocity, TWIST, atol=0.01)
    assert abs(moment.expected - TWIST).max() > 0.1


@pytest.mark.parametrize("what", ["keyframe", "pause"])
def test_a_velocity_is_that_of_frames_that_follow_one_another(what):
    periods, keyframes = [PERIOD] * 6, ["first"] * 6
    if what == "pause":
        periods[3] = 1.01 * LONGEST_S
    else:
        keyframes[3:] = ["second"] * 3
    moments = follow(at(*np.cumsum(periods)), periods, keyframes)
    assert [moment is None for moment in moments] == [True, True, False, True, True, False]
    assert moments[-1].seen == "frame 4"
    np.testing.assert_allclose(moments[-1].velocity, TWIST, atol=1e-9)


def test_a_keyframe_is_the_frame_before_the_one_after_it():
    moments, poses = Moments(), at(0.0, PERIOD, 2 * PERIOD, 3 * PERIOD)

    def note(key, T, **options):
        return moments.note(key, "frame", SimpleNamespace(T_ref_cur=T), PERIOD, **options)

    assert note("first", poses[1], is_second=True) is None
    assert note("first", poses[2]) is None  # of the very first one the velocity is not known
    key = poses[2]
    assert note("second", se3.inverse(key) @ poses[3], is_second=True) is None
    after = se3.inverse(key) @ at(4 * PERIOD)[0]
    moment = note("second", after)
    np.testing.assert_allclose(moment.velocity, TWIST, atol=1e-9)
    np.testing.assert_allclose(moment.expected, TWIST, atol=1e-9)


def test_an_interruption_begins_anew():
    moments, keyframe = Moments(), object()
    found = []
    for k, T in enumerate(at(*np.arange(6) * PERIOD)):
        if k == 3:
            moments.interrupt()
        found.append(moments.note(keyframe, k, SimpleNamespace(T_ref_cur=T), PERIOD))
    assert [moment is None for moment in found] == [True, True, False, True, True, False]


# --------------------------------------------------------------------------------------- changes


ALIKE = np.eye(6)  # each direction is told as well as the others


def test_changes_are_from_the_mean_since_the_keyframe_began():
    changes, keyframe, fade = Changes(), object(), math.exp(-PERIOD / SETTLING_S)
    rows = [(ALIKE, np.full((2, 6), v), np.full(6, -v)) for v in (0.0, 1.0, 5.0)]
    assert changes.of(*rows[0], keyframe, PERIOD) is None
    so_far = 0.0
    for row, expected in ((rows[1], 1.0), (rows[2], 5.0 - 1 / (1 + fade))):
        change = changes.of(*row, keyframe, PERIOD)
        so_far = fade * so_far + 1
        kept = so_far / (so_far + 1 / SHARED)  # the mean of few frames is not known either
        np.testing.assert_allclose(change.whole, expected, rtol=1e-6)
        np.testing.assert_allclose(change.twists, kept * expected, rtol=1e-6)
        np.testing.assert_allclose(change.gradient, -kept * expected, rtol=1e-6)
    assert changes.of(*rows[2], object(), PERIOD) is None  # another's misfits are others


def test_a_misfit_that_stays_is_no_change_however_much_frames_tell():
    """Of a wall now and of a corner then, closely and roughly: the twist asked for is the same."""
    rng, changes, keyframe = np.random.default_rng(2), Changes(), object()
    twist = rng.normal(size=6)
    for k in range(8):
        J = rng.normal(size=(20, 6)) * [1, 1, 1, 1, 1, k % 2]
        H = 10.0 ** rng.uniform(-3, 3) * J.T @ J
        change = changes.of(H, twist[None], H @ twist, keyframe, PERIOD)
        if k > 1:  # by then each direction has been told
            assert np.abs(change.whole).max() < 1e-4
            assert np.abs(change.gradient).max() < 1e-4 * np.abs(H @ twist).max()


@pytest.mark.parametrize("faint", [1.0, 0.01])
def test_noise_of_a_corner_after_walls_is_no_number(faint):
    """Of a direction that is hardly told at first the mean is noise, and counts as such."""
    rng, off = np.random.default_rng(0), []
    for _ in range(300):
        changes, keyframe = Changes(), object()
        for _ in range(8):
            J = rng.normal(size=(200, 6))
            J[:, 3:] *= faint if rng.random() < 0.5 else 1.0
            H, gradient = J.T @ J, J.T @ rng.normal(size=200)
            change = changes.of(H, rng.normal(size=(1, 6)), gradient, keyframe, PERIOD)
            if change is not None:
                told = change.whole @ H @ change.twists[0]
                off.append(change.whole @ change.gradient / np.sqrt(told))
    assert np.sqrt(np.mean(np.square(off))) < 3.0  # of residuals of which a hundred count as one


def test_frames_that_tell_nothing_leave_the_mean_as_it_is():
    changes, keyframe, nothing = Changes(), object(), np.zeros((6, 6))
    for H, value in ((nothing, 7.0), (ALIKE, 1.0), (nothing, 3.0), (np.nan * ALIKE, 5.0)):
        change = changes.of(H, np.full((1, 6), value), H @ np.full(6, value), keyframe, PERIOD)
        assert (change is None) == (value != 3.0)  # nothing is known till then
        if change is not None:
            np.testing.assert_allclose(change.whole, 2.0, rtol=1e-6)
            assert not change.gradient.any()
    assert changes.of(ALIKE, np.ones((1, 6)), np.ones(6), keyframe, PERIOD) is not None


def test_a_misfit_that_stays_is_no_change_after_a_while():
    changes, keyframe = Changes(), object()
    steps, none, some = round(SETTLING_S / PERIOD), np.zeros((1, 6)), np.ones((1, 6))
    for _ in range(3 * steps):
        changes.of(ALIKE, none, none[0], keyframe, PERIOD)
    left = [changes.of(ALIKE, some, some[0], keyframe, PERIOD).whole[0] for _ in range(2 * steps)]
    assert left[0] == pytest.approx(1.0)
    assert left[steps] == pytest.approx(math.exp(-1), rel=0.05)
    assert left[-1] < 0.15


# ------------------------------------------------------------------------------------------ pose


def test_a_pose_follows_what_pushes_it_where_it_is_constrained():
    rng = np.random.default_rng(0)
    J = rng.normal(size=(20, 6))
    pushed = rng.normal(size=6)
    np.testing.assert_allclose(J.T @ J @ taken_by_pose(J.T @ J, pushed), pushed, atol=1e-9)
    J[:, 1] = 0.0
    assert taken_by_pose(J.T @ J, pushed) is None
    assert taken_by_pose(np.full((6, 6), np.nan), pushed) is None
