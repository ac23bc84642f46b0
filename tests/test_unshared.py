"""Edges that only one of two images has in view, and frames that are lost for them, or not."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import progress
from edvo.assessing import LEAPT
from edvo.config import Config
from edvo.doubt import DOUBTFUL_S
from edvo.odometry import Status
from edvo.registration import FAILURES
from edvo.status import Judge
from edvo.unshared import EXCUSED

from . import problems, rooms

FIRST, LAST = 68, 78  # of a room: people and floor come in beside a plain wall
AT = 4  # the frame of these that shows most of it for the first time
COUNTED = "status.unshared=counted"


@pytest.fixture(scope="module")
def turn():
    """A camera that turns away from a plain wall, in a room drawn at random."""
    return rooms.stretch(56, LAST, FIRST)


@pytest.fixture
def lost(turn):
    """A tracker, and the frame and its registration, which it calls lost for how few edges fit."""
    odometry, _ = rooms.tracked(turn, count=AT)
    seen = odometry._front_end.see(turn[1][AT], AT, None, odometry._detail(turn[1][AT].timestamp))
    found, status, reason = odometry._locator.register(seen)
    assert status is Status.LOST
    assert reason.startswith("only")
    return odometry, seen, found


@pytest.mark.parametrize("seed", range(3))
def test_a_frame_that_shows_much_that_is_new_is_not_lost(turn, seed):
    _, results = rooms.tracked(turn, f"seed={seed}")
    assert all(result.status is not Status.LOST for result in results)
    result = results[AT]
    assert result.status is Status.DEGRADED
    assert result.reason.endswith(EXCUSED)
    assert result.alignment.inliers < 0.5 * len(result.alignment.matches)
    assert result.is_keyframe
    for each, T in zip(results, turn[2], strict=True):
        assert problems.error(T, each.T_world_cam)[0] < 0.02
    assert all(result.status is Status.LOST for result in rooms.tracked(turn, COUNTED)[1][AT:])


def test_the_paper_counts_them():
    assert Config.preset("paper").status.unshared == "counted"
    assert Config().status.unshared == "excused"


def test_what_is_shared_excuses_how_few_fit_and_nothing_else(lost):
    odometry, _, found = lost
    judge = odometry._judge
    assert judge.judge(found, 0.3, 30.0, follows=True)[0] is Status.LOST
    status, reason = judge.judge(found, 0.3, 30.0, follows=True, is_shared=True)
    assert status is Status.DEGRADED
    assert "samples fit" in reason
    for speed, turn in ((9.0, 30.0), (0.3, 900.0)):
        jump = judge.judge(found, speed, turn, follows=True, is_shared=True)
        assert jump[0] is Status.LOST
        assert "jump" in jump[1]
    off = Judge(Config()).judge(replace(found, sigma_depth=9.0), 0.3, 30.0, is_shared=True)
    assert off[0] is Status.LOST
    assert "contradicts" in off[1]


def test_it_is_excused_where_nothing_else_is_amiss(lost, monkeypatch):
    odometry, seen, found = lost
    unshared, course = odometry._placer._unshared, odometry._course
    assert unshared.excuse(seen, found).endswith(EXCUSED)
    monkeypatch.setattr(odometry._search, "is_shared", lambda *given: True)
    assert unshared.excuse(seen, found)
    assert not unshared.excuse(seen, replace(found, reason=FAILURES[0]))
    off = replace(found, sigma_depth=3.0)  # by more than of late, but no contradiction
    assert odometry._judge.is_off(off)
    assert not unshared.excuse(seen, off)
    far = found.T_ref_cur.copy()
    far[0, 3] += 0.08  # a hand moves no camera so; it is no jump yet
    leaps = replace(found, T_ref_cur=far)
    reason = odometry._locator.assessor.assess(leaps, seen.frame.timestamp, is_shared=True)[1]
    assert reason == LEAPT
    assert not unshared.excuse(seen, leaps)
    assert not unshared.excuse(replace(seen, is_stale=True), found)  # its depth tells nothing
    bare = replace(seen, samples=seen.samples.every(len(seen.samples) // 20))
    assert not unshared.excuse(bare, found)
    course.is_blind = True
    assert not unshared.excuse(seen, found)
    course.is_blind = False
    course.last_time -= 1.0  # it does not follow closely
    assert not unshared.excuse(seen, found)


@pytest.mark.parametrize(("share", "is_enough"), [(0.74, False), (0.8, True)])
def test_six_tenths_have_to_be_explained(lost, monkeypatch, share, is_enough):
    odometry, seen, found = lost
    hunter = odometry._search._hunter
    monkeypatch.setattr(hunter, "_explained", lambda *given: share)
    assert odometry._search.is_shared(odometry._course.key, found, seen) == is_enough


def test_both_have_to_explain_what_they_share(lost):
    odometry, seen, found = lost
    search, key = odometry._search, odometry._course.key
    assert search.is_shared(key, found, seen)
    none = np.full_like(found.residuals, 9.0)
    assert not search.is_shared(key, replace(found, residuals=none), seen)  # of the frame's
    turned = replace(key.samples, gradients=-key.samples.gradients)
    assert not search.is_shared(replace(key, samples=turned), found, seen)  # of the keyframe's
    aside = found.T_ref_cur.copy()
    aside[:3, 3] += (0.06, 0.0, 0.0)  # the way back leads elsewhere
    assert not search.is_shared(key, replace(found, T_ref_cur=aside), seen)


@pytest.mark.parametrize("moves", [True, False])
def test_not_while_something_moves(turn, monkeypatch, moves):
    odometry, _ = rooms.tracked(turn, count=AT)
    if moves:
        odometry._doubt.moving_time = turn[1][AT - 1].timestamp
    asked = []
    monkeypatch.setattr(
        odometry._placer._unshared, "excuse", lambda *given: asked.append(given) or ""
    )
    monkeypatch.setattr(
        odometry._standing, "register", lambda seen: (*odometry._locator.register(seen), None)
    )
    odometry.track(turn[1][AT])
    assert bool(asked) != moves


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("was_sure", "way_is_loose", "is_open"),
    [
        (True, False, True),
        (True, True, True),
        (False, False, True),
        (False, True, True),
        (False, True, False),
    ],
)
def test_a_keyframe_that_is_hardly_constrained_after_a_doubtful_frame(
    turn, monkeypatch, was_sure, way_is_loose, is_open, held
):
    """It hands on what it is off by: what follows is no better than the way to it.

    But where contours of depth tell it is off by little.
    """
    odometry, _ = rooms.tracked(turn, "keyframes.rule=gap", "keyframes.gap_frames=2", count=2)
    odometry._doubt.is_sure = was_sure
    if way_is_loose:  # till this frame
        odometry._doubt.cast_on_way(turn[1][1].timestamp - DOUBTFUL_S + 1e-3)
    step = odometry._progress.step

    def stepped(*given):
        return step(*given)._replace(is_held=held)

    monkeypatch.setattr(odometry._progress, "step", stepped)
    motions = np.eye(6)[:1] if is_open else np.empty((0, 6))
    monkeypatch.setattr(progress, "degenerate_directions", lambda covariance: motions)
    frame = turn[1][2]
    assert odometry.track(frame).is_keyframe
    doubtful = is_open and not held and (way_is_loose or not was_sure)
    assert odometry._doubt.is_way_loose(frame.timestamp) == doubtful
