"""Edges that scatter at once: light makes new ones and turns others round, and moves none."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config, MatchingConfig, RegistrationConfig
from edvo.odometry import Odometry, Status
from edvo.registration import FAILURES, Registration
from edvo.status import Judge
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems
from .test_doubt import NOT_ASKED, dense

SPEED, TURN = 0.5, 10.0  # of a hand
LEFT = "status.edge_jump=0"


@pytest.fixture(scope="module")
def crisp():
    """A registration of crisp edges, all of which fit."""
    problem = problems.segments_problem(0, se3.exp([0.01, 0.0, 0.01, 0.0, 0.01, 0.0]))
    registration = Registration(problem.camera, MatchingConfig(), RegistrationConfig())
    found = registration.align(
        registration.index(problem.reference), problem.samples, np.eye(4)[None]
    )
    residuals = np.full(len(found.matches), 0.1)
    return replace(found, residuals=residuals, sigma_px=0.2, plane_points=800, plane_area=0.6)


def judging(alignment, *overrides, frames=30):
    judge = Judge(Config().with_overrides(overrides))
    for _ in range(frames):
        judge.note(alignment)
    return judge


def partly(alignment, inliers, agreeing, sigma_px=0.3):
    """So large shares of the samples fit, of which all are in their places, and agree."""
    n = len(alignment.matches)
    residuals = np.where(np.arange(n) < inliers * n, 0.1, 8.0)
    counts = {"inliers": round(inliers * n), "agreeing": round(agreeing * n)}
    return replace(alignment, residuals=residuals, sigma_px=sigma_px, **counts)


# ---------------------------------------------------------------------------------- the judge


def test_what_is_scattered_is_told_from_the_usual(crisp):
    judge = judging(crisp)
    assert not judge.scatter.is_wide(replace(crisp, sigma_px=0.49))
    assert judge.scatter.is_wide(replace(crisp, sigma_px=0.51))
    assert not judging(crisp, LEFT).scatter.is_wide(replace(crisp, sigma_px=5.0))
    assert judge.scatter.sharp_px == pytest.approx(0.4)


def test_nothing_is_scattered_before_the_usual_is_known(crisp):
    assert not judging(crisp, frames=0).scatter.is_wide(replace(crisp, sigma_px=50.0))


def test_the_usual_is_that_of_late(crisp):
    judge = judging(crisp)
    for _ in range(30):
        judge.note(replace(crisp, sigma_px=0.6))
    assert not judge.scatter.is_wide(replace(crisp, sigma_px=1.3))


def test_edges_in_their_places_are_counted(crisp):
    some = crisp.residuals.copy()
    some[:7], some[7:9] = 0.61, np.nan  # beyond three times the usual; without a match
    assert judging(crisp).scatter.in_place(replace(crisp, residuals=some)) == len(some) - 9


def test_sharper_is_clearly_more_in_place_with_depth_no_worse(crisp):
    scatter = judging(crisp).scatter
    before = partly(crisp, 0.5, 0.5)
    more = partly(crisp, 0.6, 0.5)
    assert scatter.is_sharper(more, before)
    assert not scatter.is_sharper(before, more)
    assert not scatter.is_sharper(partly(crisp, 0.54, 0.5), before)  # a tenth more is chance
    assert not scatter.is_sharper(replace(more, plane_points=700), before)
    assert not scatter.is_sharper(replace(more, sigma_depth=crisp.sigma_depth + 1), before)
    assert not scatter.is_sharper(replace(more, reason=FAILURES[1]), before)


def test_two_crowds_are_told_from_a_wide_one(crisp):
    """A scale of 3 px leaves one in six of a single crowd within 0.6 px: half are two crowds."""
    scatter = judging(crisp).scatter
    wide = partly(crisp, 0.5, 0.5, sigma_px=3.0)
    assert scatter.is_sharper(partly(crisp, 0.5, 0.5), wide)
    assert not scatter.is_sharper(partly(crisp, 0.48, 0.5), wide)  # fewer are no gain
    assert not scatter.is_sharper(partly(crisp, 0.3, 0.5), partly(crisp, 0.3, 0.5, sigma_px=3.0))


@pytest.mark.parametrize("finer", ["measured", "none"])
def test_the_usual_depth_is_an_area_not_a_count(finer):
    """Points that lie closely stand for less each."""
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides([f"planes.finer={finer}"]))
    found = [odometry.track(frame).alignment for frame in frames[:20]][1:]
    counts, areas = np.array([(each.plane_points, each.plane_area) for each in found]).T
    assert (counts[-1] > 2.5 * counts[0]) == (finer == "measured")
    assert np.abs(np.diff(areas)).max() < 0.08
    assert 0.3 < areas.mean() < 1


@pytest.mark.parametrize(("inliers", "agreeing"), [(0.45, 0.44), (0.9, 0.3)])
def test_enough_edges_in_their_places_are_degraded_not_lost(crisp, inliers, agreeing):
    seen = partly(crisp, inliers, agreeing)
    status, reason = judging(crisp).judge(seen, SPEED, TURN, follows=True)
    assert status is Status.DEGRADED
    assert "% of the samples fit" in reason
    for judge, follows in (
        (judging(crisp), False),  # after a gap it may be anywhere
        (judging(crisp, LEFT), True),
        (judging(crisp, frames=0), True),
    ):
        assert judge.judge(seen, SPEED, TURN, follows=follows)[0] is Status.LOST


def test_what_comes_before_the_lens_is_no_light(crisp):
    judge, seen = judging(crisp), partly(crisp, 0.45, 0.44, sigma_px=0.6)
    assert judge.scatter.is_wide(seen)
    hand = replace(seen, plane_area=0.45)
    assert not judge.scatter.is_wide(hand)
    assert judge.judge(seen, SPEED, TURN, follows=True)[0] is Status.DEGRADED
    assert judge.judge(hand, SPEED, TURN, follows=True)[0] is Status.LOST


def test_too_few_edges_in_their_places_are_lost(crisp):
    seen = partly(crisp, 0.38, 0.38)
    assert judging(crisp).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_where_edges_are_never_crisp_places_tell_nothing(crisp):
    blurred = replace(crisp, sigma_px=0.8)
    seen = partly(blurred, 0.9, 0.3, sigma_px=0.8)
    assert judging(blurred).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


# -------------------------------------------------------------------------------- registration


def test_a_known_scale_keeps_edges_out_that_belong_nowhere():
    """Three quarters of the samples lie by up to 25 px beside any edge."""
    worse = 0
    for seed in range(6):
        T = se3.exp(np.array([0.004, -0.003, 0.004, 0.001, 0.002, -0.001]))
        problem = problems.segments_problem(seed, T, outliers=0.75, count=900)
        matching = MatchingConfig(criterion="robust-then-normal")
        registration = Registration(problem.camera, matching, RegistrationConfig())
        index, start = registration.index(problem.reference), np.eye(4)[None]
        free = registration.align(index, problem.samples, start)
        bound = registration.align(index, problem.samples, start, max_sigma_px=0.3)
        assert bound.sigma_px <= 0.3 < free.sigma_px
        off = [problems.error(T, each.T_ref_cur)[0] for each in (free, bound)]
        assert off[1] < 0.002
        worse += off[0] > 2 * off[1]
    assert worse >= 4


# ---------------------------------------------------------------------------------- in a run


@pytest.fixture(scope="module")
def corridor():
    """A corridor whose lamps swing and jump, in its hardest second and a half."""
    source = SyntheticSource(make_recipe("corridor", frames=120, light="ambient+diffuse"))
    frames = [source.read(index).frame for index in range(64, 112)]
    first = se3.inverse(source.ground_truth.at(frames[0].timestamp))
    return source.camera, frames, [first @ source.ground_truth.at(f.timestamp) for f in frames]


def walked(corridor, *overrides):
    camera, frames, truth = corridor
    odometry = Odometry(camera, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames]
    off = [problems.error(T, r.T_world_cam)[0] for T, r in zip(truth, results, strict=True)]
    return [result.status for result in results], max(off)


def test_a_corridor_whose_lamps_jump_is_followed(corridor):
    statuses, off = walked(corridor)
    assert Status.LOST not in statuses
    assert statuses.count(Status.TRACKED) > 40
    assert off < 0.015


def test_without_the_scale_of_late_it_is_not(corridor):
    statuses, off = walked(corridor, LEFT)
    assert Status.LOST in statuses
    assert off > 0.05


@pytest.mark.parametrize("size", [0.8, 1.6])
@pytest.mark.parametrize("noise", [1.5, 25])  # grey levels; edges scatter by up to 0.3 px
@pytest.mark.parametrize("overrides", [[], ["planes.weight=0"], NOT_ASKED[:1]])
def test_dense_edges_of_another_place_fit_no_better_than_they_did(size, noise, overrides):
    """By chance up to two thirds of them are where edges are."""
    said = []
    for jump in (2.5, 0):
        config = Config().with_overrides([*overrides, f"status.edge_jump={jump}"])
        odometry = Odometry(problems.CAMERA, config)
        for k in range(14):
            frame = dense(k // 12, size)
            rough = frame.grey + np.random.default_rng(k).normal(0, noise, frame.grey.shape)
            grey = np.clip(rough, 0, 255).astype(np.uint8)
            result = odometry.track(replace(frame, timestamp=k / 30, grey=grey))
            said.append(result.status)
        assert result.alignment.agreeing < 0.3 * len(result.alignment.matches)
    assert said[:14] == said[14:]


def test_a_few_inliers_are_lost_whatever_else_is_not_asked(crisp):
    seen = partly(crisp, 0.02, 0.02)
    judge = judging(crisp, *NOT_ASKED)
    assert judge.judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_after_a_rest_motion_is_not_scattered():
    """Images that are all but the same give edges that are all but in the same places."""
    frames, truth = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides(["edges.position=pixel"]))
    for k in range(12):
        grey = frames[0].grey.copy()
        grey[0, : k + 1] ^= 1
        odometry.track(replace(frames[0], timestamp=(k - 12) / 30, grey=grey))
    off = [problems.error(truth[i], odometry.track(f).T_world_cam)[0] for i, f in enumerate(frames)]
    assert max(off[:20]) < 0.004


def test_a_lasting_change_becomes_the_usual(crisp):
    judge = judging(crisp)
    wide = replace(crisp, sigma_px=1.2)
    for _ in range(20):
        assert judge.scatter.is_wide(wide)
        judge.scatter.widen()
    for _ in range(20):
        judge.scatter.widen()
    assert not judge.scatter.is_wide(wide)


def test_without_depth_on_planes_nothing_is_told_from_a_hand(crisp):
    bare = replace(crisp, plane_points=0, plane_area=0.0)
    assert not judging(bare).scatter.is_wide(replace(bare, sigma_px=5.0))
    seen = partly(bare, 0.45, 0.44)
    assert judging(bare).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_a_registration_that_failed_is_not_scattered_and_wins_nothing(crisp):
    failed = replace(crisp, sigma_px=5.0, reason=FAILURES[0])
    judge = judging(crisp)
    assert not judge.scatter.is_wide(failed)
    assert judge.scatter.in_place(failed) == 0
