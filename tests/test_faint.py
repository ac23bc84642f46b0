"""Faint edges of frames that are lost just after another."""

from dataclasses import replace

import pytest

from edvo import faint
from edvo.config import Config
from edvo.odometry import Status

from . import problems, rooms

COUNT = 8
AT = 5  # the frame after one that is lost; its floor shows more than that of the keyframe
HELD = "motion.depth_slack=none"  # else no frame is lost there
AS_ANY = "status.just_lost=as-any"


@pytest.fixture(scope="module")
def floor():
    """A camera that is knocked before a floor whose edges are faint in some of its images."""
    return rooms.stretch(113, COUNT)


@pytest.fixture
def lost(floor):
    """A tracker that has lost a frame, and the next one as it would lose it."""
    odometry, results = rooms.tracked(floor, HELD, count=AT)
    assert results[-1].status is Status.LOST
    seen = odometry._front_end.see(floor[1][AT], AT, None, odometry._detail(floor[1][AT].timestamp))
    assert odometry._locator.locate(seen)[1] is Status.LOST
    return odometry, seen


def test_a_lost_frame_is_found_by_the_edges_that_its_keyframe_shows_faintly(floor):
    _, results = rooms.tracked(floor, HELD)
    assert results[AT - 1].status is Status.LOST
    for each, T in list(zip(results, floor[2], strict=True))[AT:]:
        assert each.status is Status.DEGRADED
        assert problems.error(T, each.T_world_cam)[0] < 0.01
    assert results[AT].samples == len(results[AT].alignment.matches)
    assert results[AT].alignment.agreeing > 0.8 * len(results[AT].alignment.matches)
    assert all(
        result.status is Status.LOST for result in rooms.tracked(floor, HELD, AS_ANY)[1][AT:]
    )


def test_the_paper_takes_them_as_any_frame():
    assert Config.preset("paper").status.just_lost == "as-any"
    assert Config().status.just_lost == "by-faint-edges"


def test_it_shows_faint_edges_and_is_judged_by_them(lost):
    odometry, seen = lost
    found = odometry._placer._faint.look(seen, AT)
    assert found is not None
    assert found.seen.is_near
    assert found.seen.edges.is_faint
    assert len(found.seen.edges) > len(seen.edges)
    assert len(found.alignment.matches) == len(found.seen.samples)
    assert found.status is not Status.LOST


def test_only_of_a_frame_just_lost(lost):
    odometry, seen = lost
    look, course = odometry._placer._faint.look, odometry._course
    assert look(seen, AT)
    for losses in (0, 4):
        course.losses = losses
        assert look(seen, AT) is None
    course.losses = 3
    assert look(seen, AT)
    course.last_time -= 0.2
    assert look(seen, AT) is None


@pytest.mark.parametrize(("seconds", "is_just"), [(0.19, True), (0.21, False)])
def test_just_lost_is_within_a_fifth_of_a_second(lost, seconds, is_just):
    course = lost[0]._course
    assert course.is_just_lost(course.last_time + seconds) is is_just


def test_how_smeared_a_frame_is_counts_once(lost, monkeypatch):
    odometry, seen = lost
    noted = []
    monkeypatch.setattr(odometry._front_end._smear, "note", lambda *given: noted.append(given))
    assert odometry._placer._faint.look(seen, AT)
    assert not noted


def test_not_where_it_would_tell_nothing_new(lost):
    odometry, seen = lost
    look, course = odometry._placer._faint.look, odometry._course
    assert look(replace(seen, is_stale=True), AT) is None
    assert look(replace(seen, is_parted=True), AT) is None
    course.is_blind = True
    assert look(seen, AT) is None
    course.is_blind = False
    course.anchor = seen.frame.timestamp, course.T_world_last
    assert look(seen, AT) is None
    course.anchor = None
    odometry._pieces.here = 1  # a path begun anew
    assert look(seen, AT) is None
    odometry._pieces.here = 0
    course.keyframe = replace(course.key, telling=course.key.edges)
    assert look(seen, AT) is None


@pytest.mark.parametrize("share", [0.79, 0.81])
def test_eight_tenths_have_to_agree(lost, monkeypatch, share):
    odometry, seen = lost
    locate = odometry._placer._faint._locator.locate

    def fewer(again):
        alignment, status, reason = locate(again)
        agreeing = int(share * len(again.samples)) + 1
        return replace(alignment, agreeing=agreeing), status, reason

    monkeypatch.setattr(odometry._placer._faint._locator, "locate", fewer)
    assert (odometry._placer._faint.look(seen, AT) is not None) == (share > faint.SURE)


def test_not_what_is_lost_all_the_same(lost, monkeypatch):
    odometry, seen = lost
    locate = odometry._placer._faint._locator.locate

    def fails(again):
        return locate(again)[0], Status.LOST, "elsewhere"

    monkeypatch.setattr(odometry._placer._faint._locator, "locate", fails)
    assert odometry._placer._faint.look(seen, AT) is None
