"""Edges and depth that say different things."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.room_drawing import draw

from edvo import kernels, se3
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.doubt import WAS_TORN
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.registration import FAILURES
from edvo.status import TORN, Judge
from edvo.synthesis.sequence import SyntheticSource
from edvo.torn import SMEARED_PX

from . import problems

SPEED, TURN = 0.1, 1.0


@pytest.fixture(scope="module")
def usual():
    """A registration as they are as a rule."""
    odometry = Odometry(problems.CAMERA)
    found = [odometry.track(frame) for frame in problems.sequence(30)[0][:4]][-1].alignment
    return replace(found, sigma_px=0.2, sigma_depth=0.5, plane_points=1000, plane_inliers=990)


def judging(alignment, *overrides, frames=30):
    judge = Judge(Config().with_overrides(overrides))
    for _ in range(frames):
        judge.note(alignment)
    return judge


@pytest.mark.parametrize(
    ("px", "sigma", "balance", "torn", "doubted"),
    [
        (0.4, 2.1, 1.0, True, True),  # both, and depth by four times
        (0.4, 1.6, 1.0, True, True),  # and by more than one and a half times the noise
        (0.4, 1.2, 1.0, True, False),  # both, but depth by little
        (0.3, 2.1, 1.0, False, False),  # edges as ever
        (0.4, 0.9, 1.0, False, False),  # depth as ever
        (0.4, 2.1, 0.0, False, False),  # no depth
    ],
)
def test_it_is_torn_where_both_fit_worse_than_of_late(usual, px, sigma, balance, torn, doubted):
    found = replace(usual, sigma_px=px, sigma_depth=sigma, depth_balance=balance)
    judge = judging(usual, "status.depth_jump=9")
    assert (judge.torn.is_torn(found), judge.torn.is_in_doubt(found)) == (torn, doubted)
    assert judge.may_be_off(found) == torn
    expected = (Status.DEGRADED, TORN) if doubted else (Status.TRACKED, "")
    assert judge.judge(found, SPEED, TURN, follows=True) == expected
    assert judge.judge(found, SPEED, TURN)[0] is Status.TRACKED  # after a gap all may be different
    ignoring = judging(usual, "status.depth_jump=9", "status.torn=ignore")
    assert not ignoring.torn.is_torn(found)
    assert ignoring.judge(found, SPEED, TURN, follows=True)[0] is Status.TRACKED


def test_of_depth_of_little_noise_less_is_in_doubt(usual):
    fine = replace(usual, sigma_depth=0.1)
    torn = judging(fine).torn
    assert torn.is_in_doubt(replace(fine, sigma_px=0.4, sigma_depth=0.41))
    assert not torn.is_in_doubt(replace(fine, sigma_px=0.4, sigma_depth=0.39))


def test_what_is_usual_has_to_be_known(usual):
    found = replace(usual, sigma_px=0.4, sigma_depth=2.1)
    assert not judging(usual, frames=0).torn.is_torn(found)
    early = judging(usual, frames=9).torn
    assert early.is_torn(found)
    assert not early.is_in_doubt(found)
    assert judging(usual, frames=10).torn.is_in_doubt(found)


def test_a_lasting_change_becomes_the_usual(usual):
    """By frames in doubt that are not noted, at 3 % each."""
    found = replace(usual, sigma_px=0.4, sigma_depth=2.1, plane_area=0.1)
    judge = judging(usual)
    for _ in range(7):  # of edges: 1.03^7 < 2 / 1.6 < 1.03^8
        judge.torn.widen(found)
    assert judge.torn.is_torn(found)
    judge.torn.widen(found)
    assert not judge.torn.is_torn(found)
    by_depth = replace(found, sigma_px=2.0, sigma_depth=1.52)
    judge = judging(usual)
    for _ in range(14):  # of depth: 1.03^14 < 3.04 / 2 < 1.03^15
        judge.torn.widen(by_depth)
    assert judge.torn.is_torn(by_depth)
    judge.torn.widen(by_depth)
    assert not judge.torn.is_torn(by_depth)


def test_what_is_wide_already_is_not_widened_twice(usual):
    usual = replace(usual, plane_area=0.5)
    wide = replace(usual, sigma_px=0.6, sigma_depth=2.1)
    judge = judging(usual)
    before = judge.scatter.usual_px
    assert judge.scatter.is_wide(wide)
    judge.torn.widen(wide)
    assert judge.scatter.usual_px == before
    judge.torn.widen(replace(wide, sigma_px=0.4))
    assert judge.scatter.usual_px == pytest.approx(1.03 * before)


def test_what_is_usual_follows_what_is_trusted(usual):
    later = replace(usual, sigma_px=0.4, sigma_depth=2.0, plane_inliers=800)
    judge = judging(usual)
    found = replace(later, plane_inliers=790, sigma_px=0.7, sigma_depth=4.1)
    assert judge.torn.is_torn(found)
    for _ in range(30):
        judge.note(later)
    assert judge.torn.is_torn(found)  # twice that still
    assert not judge.torn.is_torn(replace(found, sigma_depth=3.7))
    judge = judging(usual)
    assert judge.torn.outvotes_depth(found)
    for _ in range(30):
        judge.note(replace(later, sigma_depth=0.5))
    assert not judge.torn.outvotes_depth(found)


def test_stale_depth_says_nothing(usual):
    stale = replace(usual, sigma_px=0.4, sigma_depth=2.1, plane_inliers=700, is_stale=True)
    torn = judging(usual).torn
    assert not torn.is_torn(stale)
    assert not torn.outvotes_depth(stale)
    other = replace(usual, plane_inliers=500)
    assert torn.fits_more_depth(replace(stale, is_stale=False, sigma_depth=0.5), other)
    assert not torn.fits_more_depth(replace(stale, sigma_depth=0.5), other)
    assert not torn.fits_more_depth(usual, replace(stale, plane_inliers=1, sigma_depth=0.5))
    for without in (replace(usual, depth_balance=0.0), replace(usual, is_stale=True)):
        assert not judging(without).torn.is_torn(replace(usual, sigma_px=9.0, sigma_depth=9.0))


def torn_stream(monkeypatch, *overrides, again):
    """Sixteen frames, and one that registration leads astray, once or (``again``) each time."""
    frames, truth = problems.sequence(30)
    given = "status.depth_jump=99", "motion.inertia=none", *overrides
    odometry = Odometry(problems.CAMERA, Config().with_overrides(given))
    results = [odometry.track(frame) for frame in frames[:16]]
    align, astray = odometry._registration.align, se3.exp([0.0, 0.0, 0.012, 0.0, 0.0, 0.0])
    px = 2.2 * odometry._judge.scatter.usual_px
    sigma = 4.5 * max(each.alignment.sigma_depth for each in results[1:])
    left = [1_000 if again else 1]

    def leads_astray(*given, **options):
        found = align(*given, **options)
        if not left[0]:
            return found
        left[0] -= 1
        return replace(
            found, T_ref_cur=astray @ found.T_ref_cur, sigma_px=px, sigma_depth=max(sigma, 1.6)
        )

    monkeypatch.setattr(odometry._registration, "align", leads_astray)
    monkeypatch.setattr(odometry._locator, "_sharpest", lambda seen, starts, term, found: found)
    result = odometry.track(frames[16])
    monkeypatch.setattr(odometry._registration, "align", align)
    after = [odometry.track(frame) for frame in frames[17:20]]
    return result, after, problems.error(truth[16], result.T_world_cam)[0]


def test_from_where_depth_leads_it_is_whole_again(monkeypatch):
    result, after, error = torn_stream(monkeypatch, again=False)
    assert [each.status for each in (result, *after)] == [Status.TRACKED] * 4
    assert error < 0.003


def test_where_it_is_not_it_is_doubted_for_a_second(monkeypatch):
    result, after, error = torn_stream(monkeypatch, again=True)
    assert (result.status, result.reason) == (Status.DEGRADED, TORN)
    assert {(each.status, each.reason) for each in after} == {(Status.DEGRADED, WAS_TORN)}
    assert error > 0.005


def test_it_may_be_ignored(monkeypatch):
    result, after, error = torn_stream(monkeypatch, "status.torn=ignore", again=False)
    assert WAS_TORN not in {each.reason for each in after}
    assert result.status is Status.TRACKED
    assert error > 0.005


@pytest.mark.parametrize(
    ("px", "agree", "inliers", "balance", "is_asked", "smeared"),
    [
        (0.3, 0.81, 940, 1.0, True, True),
        (0.24, 0.81, 940, 1.0, False, False),  # edges are sharp, and agree
        (0.24, 0.79, 940, 1.0, True, True),
        (0.24, 0.79, 955, 1.0, False, True),  # hardly more are left out than ever
        (0.3, 0.81, 955, 1.0, False, True),
        (0.3, 0.81, 980, 1.0, False, False),
        (0.3, 0.81, 940, 0.0, False, False),
    ],
)
def test_outvoted_depth_is_asked_where_edges_are_unsure(
    usual, px, agree, inliers, balance, is_asked, smeared
):
    agreeing = round(agree * len(usual.matches))
    found = replace(
        usual, sigma_px=px, agreeing=agreeing, plane_inliers=inliers, depth_balance=balance
    )
    assert judging(usual).torn.outvotes_depth(found) == is_asked
    assert not judging(usual, "planes.outvoted=left").torn.outvotes_depth(found)
    assert not judging(usual, frames=0).torn.outvotes_depth(found)
    noisy = judging(replace(usual, sigma_depth=0.61))
    assert not noisy.torn.outvotes_depth(found)
    assert judging(usual).torn.outvotes_depth(found, SMEARED_PX) == smeared
    assert judging(usual).torn.outvotes_depth(found, 0.99 * SMEARED_PX) == is_asked
    often = judging(replace(usual, plane_inliers=940))  # as where people are about
    assert not often.torn.outvotes_depth(found)


@pytest.mark.parametrize(
    ("changes", "is_better"),
    [
        ({"plane_inliers": 960}, True),
        ({"plane_inliers": 925}, False),  # 3 % at least
        ({"plane_inliers": 960, "sigma_depth": 0.56}, False),  # off by more
        ({"plane_inliers": 960, "agreeing": 790}, False),  # a fifth of the edges
        ({"plane_inliers": 960, "agreeing": 810}, True),
        ({"plane_inliers": 960, "reason": FAILURES[0]}, False),
    ],
)
def test_more_depth_fits_as_closely_for_hardly_fewer_edges(usual, changes, is_better):
    other = replace(usual, plane_inliers=900, agreeing=1000)
    better = replace(other, **changes)
    assert judging(usual).torn.fits_more_depth(better, other) == is_better
    assert not judging(usual, "planes.outvoted=left").torn.fits_more_depth(better, other)


@pytest.fixture(scope="module")
def smeared_turn():
    """Eight frames of a camera that turns fast while it exposes, in a room drawn at random."""
    source = SyntheticSource(draw(27).recipe(170))
    readings = read_ahead(source, range(162, 170))
    frames = [reading.frame for reading in readings]
    return source.camera, frames, [source.recipe.motion.at(each.timestamp) for each in frames]


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(("rule", "least", "most"), [("asked", 0.0, 0.005), ("left", 0.015, 1.0)])
def test_a_wall_that_alone_tells_is_not_outvoted(smeared_turn, seed, rule, least, most):
    camera, frames, truth = smeared_turn
    odometry = Odometry(
        camera, Config().with_overrides([f"planes.outvoted={rule}", f"seed={seed}"])
    )
    results = [odometry.track(frame) for frame in frames]
    errors = [
        problems.error(se3.inverse(truth[0]) @ T, each.T_world_cam)[0]
        for each, T in zip(results, truth, strict=True)
    ]
    assert least < max(errors) < most


@pytest.mark.parametrize("count", [0, 1, 40])
def test_points_that_fit_are_those_that_weights_leave_in(count):
    residuals = np.random.default_rng(3).normal(0.0, 4.0, 50)
    within = np.abs(residuals[:count]) < kernels.TUKEY_TUNING * 0.8
    assert kernels.count_fitting(residuals, count, 0.8) == np.count_nonzero(within)


def test_a_registration_counts_them(usual):
    """A fifth of the points are 2 cm farther off than they were."""
    frames, _ = problems.sequence(30)
    depth = frames[1].depth.copy()
    depth[:, : depth.shape[1] // 6] += 0.02
    odometry = Odometry(problems.CAMERA)
    odometry.track(frames[0])
    as_it_is = odometry.track(frames[1]).alignment
    odometry.reset()
    odometry.track(frames[0])
    moved = odometry.track(Frame(frames[1].timestamp, frames[1].grey, depth)).alignment
    assert as_it_is.outliers < 0.1
    assert 0.2 < moved.outliers < 0.3
    assert replace(usual, plane_points=0, plane_inliers=0).outliers == 0.0


@pytest.fixture
def located():
    """An odometry, its seventeenth frame as seen, and what was found of it."""
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA)
    for frame in frames[:16]:
        odometry.track(frame)
    seen = odometry._front_end.see(frames[16], 16)
    return odometry, seen, odometry._locator.align(seen)


def outvoting(odometry, monkeypatch, again):
    """Let each frame outvote depth, and count those that are asked."""
    asked = []
    monkeypatch.setattr(odometry._judge.torn, "outvotes_depth", lambda *_: True)

    def by_depth(seen, start, term, found):
        asked.append(seen)
        return again

    monkeypatch.setattr(odometry._locator, "_by_outvoted_depth", by_depth)
    return asked


def test_what_depth_leads_to_is_taken(located, monkeypatch):
    odometry, seen, found = located
    better = replace(found, cost=found.cost + 1)
    asked = outvoting(odometry, monkeypatch, better)
    assert odometry._locator.locate(seen)[0] is better
    assert asked == [seen]
    outvoting(odometry, monkeypatch, None)
    odometry._locator.align(seen)
    assert odometry._locator.locate(seen)[0].cost == found.cost


def test_what_depth_led_to_is_not_left_for_what_fits_less_of_it(located, monkeypatch):
    odometry, seen, found = located
    locator, led = odometry._locator, replace(found, plane_inliers=found.plane_points)
    less = replace(found, plane_inliers=int(0.9 * found.plane_points))
    assert locator._kept(led, less) is led
    assert locator._kept(None, less) is less
    assert locator._kept(led, replace(less, plane_inliers=found.plane_points)) is not led
    outvoting(odometry, monkeypatch, led)
    monkeypatch.setattr(locator, "_leaves_out", lambda *given: True)
    monkeypatch.setattr(locator, "_widely", lambda *given: less)
    assert locator.locate(seen)[0] is led


def test_far_steps_are_not_asked(located, monkeypatch):
    odometry, seen, found = located
    asked = outvoting(odometry, monkeypatch, found)
    monkeypatch.setattr(type(odometry._course), "is_far_step", lambda course, timestamp: True)
    odometry._locator.locate(seen)
    assert not asked


def test_a_registration_of_depth_that_repeats_says_so(located):
    odometry, seen, found = located
    assert not found.is_stale
    assert odometry._locator.align(replace(seen, is_stale=True)).is_stale


def test_what_is_in_doubt_becomes_the_usual_as_it_is_doubted(located):
    odometry, seen, found = located
    torn, t = odometry._judge.torn, seen.frame.timestamp
    odometry._doubt.mind_torn(found, t)
    assert not odometry._doubt.lasts(t)
    before = torn._sigma
    wide = 1.7 * odometry._judge.scatter.usual_px
    odometry._doubt.mind_torn(replace(found, sigma_px=wide, sigma_depth=9.0), t)
    assert odometry._doubt.lasts(t)
    assert torn._sigma == pytest.approx(1.03 * before)


@pytest.mark.parametrize("better", ["found", "start"])
def test_of_two_levels_the_one_that_more_of_depth_fits_is_begun_from(located, monkeypatch, better):
    odometry, seen, found = located
    start, begun = se3.exp([0.01, 0.0, 0.0, 0.0, 0.0, 0.0]), []
    fits = {"found": found.T_ref_cur, "start": start}[better]

    def level(key, samples, points, T):
        return replace(found, T_ref_cur=T, plane_points=900 if T is fits else 800)

    def register(seen, starts, term, max_sigma_px):
        begun.append((starts, max_sigma_px))
        return replace(found, plane_inliers=2 * found.plane_inliers)

    monkeypatch.setattr(odometry._locator._depth_alone, "align", level)
    monkeypatch.setattr(odometry._locator.registrar, "register", register)
    monkeypatch.setattr("edvo.depth_alone.degenerate_directions", lambda covariance: np.eye(6)[:0])
    term = odometry._fitter.term
    again = odometry._locator._by_outvoted_depth(seen, start, term, found)
    assert again.plane_inliers == 2 * found.plane_inliers
    (starts, scale_px), *_ = begun
    np.testing.assert_array_equal(starts, fits[None])
    assert scale_px == odometry._judge.scatter.sharp_px
    more = replace(found, plane_inliers=3 * found.plane_inliers)
    assert odometry._locator._by_outvoted_depth(seen, start, term, more) is None
    with monkeypatch.context() as patch:
        patch.setattr(odometry._locator.assessor, "is_lost", lambda *given: True)
        assert odometry._locator._by_outvoted_depth(seen, start, term, found) is None
    monkeypatch.setattr("edvo.depth_alone.degenerate_directions", lambda covariance: np.eye(6)[:1])
    assert odometry._locator._by_outvoted_depth(seen, start, term, found) is None


def test_of_depth_alone_all_points_that_count_fit(located):
    odometry, seen, found = located
    parts = odometry._course.key, seen.samples, seen.points
    alone = odometry._depth_alone.align(*parts, found.T_ref_cur)
    assert 100 < alone.plane_inliers == alone.plane_points
