"""Leaps that a frame bears out, and frames that are lost for theirs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import leaping, se3
from edvo.assessing import LEAPT
from edvo.clock import no_clock
from edvo.config import Config
from edvo.doubt import LEAPT_HERE
from edvo.leaping import BORNE_OUT, SLID
from edvo.odometry import Status
from edvo.placing import Placed, Way

from . import problems, rooms

COUNT = 5
AT = 2  # the frame before which the camera is knocked
LOST = "status.leaps=lost"


@pytest.fixture(scope="module")
def knocked():
    """A camera that is knocked, in a room drawn at random."""
    return rooms.stretch(89, COUNT)


@pytest.fixture
def leapt(knocked):
    """A tracker, and the frame and its registration, which it calls lost for its leap."""
    odometry, _ = rooms.tracked(knocked, count=AT)
    frame = knocked[1][AT]
    detail, lead = odometry._detail(frame.timestamp), odometry._lead(frame)
    seen = odometry._front_end.see(frame, AT, lead, detail)
    found, status, reason = odometry._locator.locate(seen)
    assert (status, reason) == (Status.LOST, LEAPT)
    return odometry, seen, found


@pytest.mark.parametrize("seed", range(3))
def test_a_frame_that_is_where_a_knock_has_put_it_is_not_lost(knocked, seed):
    _, results = rooms.tracked(knocked, f"seed={seed}")
    assert results[AT].reason == LEAPT + BORNE_OUT
    assert results[AT].status is Status.DEGRADED
    for each, T in zip(results, knocked[2], strict=True):
        assert problems.error(T, each.T_world_cam)[0] < 0.002
    assert all(result.status is Status.DEGRADED for result in results[AT + 1 :])
    lost = rooms.tracked(knocked, f"seed={seed}", LOST)[1][AT]
    assert (lost.status, lost.reason) == (Status.LOST, LEAPT)


def test_without_a_search_they_are_lost(leapt):
    odometry, seen, found = leapt
    config = odometry.config.with_overrides(["motion.search_deg=0"])
    kit = SimpleNamespace(
        config=config,
        clock=no_clock,
        search=odometry._search,
        uncertainty=odometry._uncertainty,
        fitter=odometry._fitter,
    )
    without = leaping.Leaping(kit, odometry._course, odometry._locator)
    assert not without.excuse(seen, found, LEAPT)


def test_the_paper_knows_no_leaps():
    assert Config.preset("paper").status.leaps == "lost"
    assert Config().status.leaps == "asked"


def test_doubt_of_the_way_lasts_for_a_second(knocked):
    odometry, results = rooms.tracked(knocked, count=AT + 1)
    now = results[AT].timestamp
    assert odometry._doubt.is_way_loose(now + 0.9)
    assert odometry._doubt.way_reason == LEAPT_HERE
    assert not odometry._doubt.is_way_loose(now + 1.1)


def test_what_depth_contradicts_then_is_lost_by_a_leap(knocked, monkeypatch):
    odometry, _ = rooms.tracked(knocked, count=AT)
    lost = Status.LOST, "something moves"
    monkeypatch.setattr(odometry._doubt, "question", lambda *given: lost)
    assert odometry.track(knocked[1][AT]).status is Status.LOST
    assert odometry._doubt._has_leapt
    assert not odometry._doubt.is_way_loose(knocked[1][AT].timestamp)


def test_it_is_excused_for_a_leap_alone(leapt):
    odometry, seen, found = leapt
    excuse, course = odometry._placer._leaping.excuse, odometry._course
    assert excuse(seen, found, LEAPT)
    assert not excuse(seen, found, "only 43% of the samples fit")
    assert not excuse(replace(seen, is_stale=True), found, LEAPT)
    bare = replace(seen, samples=seen.samples.every(len(seen.samples) // 20))
    assert not excuse(bare, found, LEAPT)  # so few that depth has to tell
    course.is_blind = True
    assert not excuse(seen, found, LEAPT)
    course.is_blind = False
    course.losses = 1  # it does not follow closely
    assert not excuse(seen, found, LEAPT)
    course.losses = 0
    odometry._judge._usual = 0.1  # for once it is known, depth is off
    assert not excuse(seen, replace(found, sigma_depth=3.0), LEAPT)


def test_nothing_beside_it_may_fit_as_well(leapt, monkeypatch):
    odometry, seen, found = leapt
    asked = []
    monkeypatch.setattr(odometry._search, "is_alone", lambda *given: asked.append(given) or False)
    assert not odometry._placer._leaping.excuse(seen, found, LEAPT)
    ((key, T_key_cur, what),) = asked
    assert key is odometry._course.key
    assert T_key_cur is found.T_ref_cur
    assert what is seen


@pytest.mark.parametrize(("share", "is_enough"), [(0.89, False), (0.9, True)])
def test_eight_tenths_have_to_be_explained(leapt, monkeypatch, share, is_enough):
    odometry, seen, found = leapt
    monkeypatch.setattr(odometry._search._hunter, "_explained", lambda *given: share)
    assert bool(odometry._placer._leaping.excuse(seen, found, LEAPT)) == is_enough


def test_no_motion_may_be_left_open(leapt, monkeypatch):
    odometry, seen, found = leapt
    open_ways = np.eye(6)[:1]
    monkeypatch.setattr(leaping, "degenerate_directions", lambda covariance: open_ways)
    assert not odometry._placer._leaping.excuse(seen, found, LEAPT)


@pytest.fixture(scope="module")
def bare():
    """A camera that begins before a plain wall, which does not say how far it goes along."""
    return rooms.stretch(348, 5)


@pytest.mark.parametrize("seed", range(3))
def test_what_slides_along_what_nothing_constrains_is_not_lost(bare, seed):
    _, results = rooms.tracked(bare, f"seed={seed}")
    assert results[3].reason == LEAPT + SLID
    assert results[3].degenerate
    assert not any(result.status is Status.LOST for result in results)
    off = [se3.distance(T, each.T_world_cam) for T, each in zip(bare[2], results, strict=True)]
    assert max(off) < 0.04
    at, key = results[3], results[results[3].keyframe]
    T_registered = key.T_world_cam @ at.alignment.T_ref_cur
    assert se3.distance(T_registered, at.T_world_cam) > 0.05  # it went on as it was going
    assert se3.distance(results[2].T_world_cam, at.T_world_cam) < 0.04
    for without in (LOST, "motion.inertia=none", "status.covariance=none"):
        lost = rooms.tracked(bare, f"seed={seed}", without)[1][3]
        assert (lost.status, lost.reason) == (Status.LOST, LEAPT)


def slid(leapt, monkeypatch, ways):
    """What is said of a leap if nothing constrains these motions of it, by a function."""
    odometry, seen, found = leapt
    T_world_cur = odometry._course.key.T_world_key @ found.T_ref_cur
    T_world_expected = odometry._course.expected(seen.frame.timestamp)
    leap = se3.log(se3.inverse(T_world_expected) @ T_world_cur)
    monkeypatch.setattr(leaping, "degenerate_directions", lambda covariance: ways(leap))
    return odometry._placer._leaping.slides(seen, found, LEAPT)


def across(leap):
    """A translation at right angles to that of a leap."""
    way = np.zeros(6)
    way[:3] = np.cross(leap[:3], [0.6, 0.8, 0.0])
    return way[None]


def along(leap):
    """That of a leap, and another one."""
    return np.stack([np.append(3 * leap[:3], np.zeros(3)), across(leap)[0] + 0.1 * leap])


@pytest.mark.parametrize(
    ("ways", "is_excused"),
    [(along, True), (across, False), (lambda leap: np.empty((0, 6)), False)],
)
def test_only_what_leaps_along_an_open_motion_slides(leapt, monkeypatch, ways, is_excused):
    assert slid(leapt, monkeypatch, ways) == (LEAPT + SLID if is_excused else "")


def test_what_is_open_is_told_in_the_camera_of_the_frame(leapt, monkeypatch):
    """Which is turned by a quarter: what is open to the right of the keyframe is up or down."""
    odometry, seen, found = leapt
    wide = np.eye(6) * 1e-8
    wide[0, 0] = 1.0
    quarter = se3.exp(np.array([0, 0, 0, 0, 0, np.pi / 2]))
    monkeypatch.setattr(odometry._uncertainty, "covariance", lambda *given: wide)
    turned = replace(found, T_ref_cur=quarter)
    (way,) = odometry._placer._leaping._open_ways(seen, turned)
    np.testing.assert_allclose(np.abs(way), [0, 1, 0, 0, 0, 0], atol=1e-6)


def test_only_a_leap_is_called_a_slide(leapt, monkeypatch):
    odometry, seen, found = leapt
    slides = odometry._placer._leaping.slides
    assert slid(leapt, monkeypatch, along)
    assert not slides(seen, found, "only 43% of the samples fit")
    assert not slides(replace(seen, is_stale=True), found, LEAPT)


@pytest.fixture
def still(knocked):
    """A tracker before the knock, and a frame like the last one that follows."""
    odometry, _ = rooms.tracked(knocked, count=AT)
    frame = knocked[1][AT - 1]
    seen = odometry._front_end.see(frame, AT, None, odometry._detail(frame.timestamp))
    return odometry, replace(seen, frame=replace(frame, timestamp=frame.timestamp + 1 / 30))


def confirmed(odometry, seen, away_m, way=Way.KEYFRAME):
    """Whether the way is in doubt to a frame that is so far from where it was expected."""
    timestamp, key = seen.frame.timestamp, odometry._course.key
    T_world_cam = odometry._course.expected(timestamp) @ se3.exp([away_m, 0, 0, 0, 0, 0])
    found = odometry._locator.register(seen)[0]
    found = replace(found, T_ref_cur=se3.inverse(key.T_world_key) @ T_world_cam)
    placed = Placed(seen, found, Status.DEGRADED, "for a test", way=way)
    assert not odometry._placer.confirm(placed).is_lost
    return odometry._doubt.is_way_loose(timestamp)


@pytest.mark.parametrize(
    ("away_m", "way", "is_doubted"),
    [
        (0.04, Way.KEYFRAME, False),  # more than a hand moves it, but no more than may be wrong
        (0.06, Way.KEYFRAME, True),
        (0.06, Way.DEPTH, True),
        (0.06, Way.EARLIER, False),  # it is where it was before
        (0.06, Way.RETURN, False),
        (0.0, Way.LEAP, True),
    ],
)
def test_a_leap_from_a_doubtful_pose_puts_the_way_in_doubt(
    still, monkeypatch, away_m, way, is_doubted
):
    odometry, seen = still
    monkeypatch.setattr(odometry._doubt, "question", lambda *given: given[2:])
    odometry._judge._agreeing = 1.0  # none fits better
    monkeypatch.setattr(odometry._placer._earlier, "settle", lambda: None)
    assert confirmed(odometry, seen, away_m, way) == is_doubted
    assert not is_doubted or odometry._doubt.way_reason == LEAPT_HERE


def test_within_what_a_hand_does_it_is_no_leap(still, monkeypatch):
    """However far that is, as where images are farther apart."""
    odometry, seen = still
    monkeypatch.setattr(odometry._doubt, "question", lambda *given: given[2:])
    odometry._judge._agreeing = 1.0
    monkeypatch.setattr(odometry._locator.assessor, "limit", lambda _: 0.2)
    assert not confirmed(odometry, seen, 0.15)
    assert confirmed(odometry, seen, 0.25)


def test_it_is_where_it_was_placed_at_last_that_counts(still, monkeypatch):
    """As where depth has put it elsewhere."""
    odometry, seen = still
    monkeypatch.setattr(odometry._judge, "_agreeing", 1.0)
    here = odometry._locator.register(seen)[0]
    monkeypatch.setattr(
        odometry._standing, "confirm", lambda *_: (seen, here, Status.DEGRADED, "", None)
    )
    assert not confirmed(odometry, seen, 0.5)


def test_the_paper_does_not_ask_how_far_it_leapt(still, monkeypatch):
    odometry, seen = still
    monkeypatch.setattr(odometry._doubt, "question", lambda *given: given[2:])
    odometry._judge._agreeing = 1.0
    odometry._locator.assessor._asks_scatter = False
    assert not confirmed(odometry, seen, 0.5)
    assert Config.preset("paper").status.edge_jump == 0
