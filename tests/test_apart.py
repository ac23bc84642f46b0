"""Somebody near who walks while a recording begins: edges and depth lead apart."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import depth_alone, se3
from edvo.apart import LATE_S, LEAD_APART, SLACK_M, Apart
from edvo.clock import no_clock
from edvo.odometry import Odometry, Status

from . import problems, rooms


@pytest.fixture(scope="module")
def walker():
    """A plain room: nearly all its edges are of one who walks from the first frame on."""
    return rooms.stretch(318, 9)


@pytest.mark.parametrize("seed", range(3))
def test_who_walks_by_is_followed_for_one_frame_at_most(walker, seed):
    truth = walker[2]
    odometry, results = rooms.tracked(walker, f"seed={seed}")
    off = [se3.distance(T, each.T_world_cam) for T, each in zip(truth, results, strict=True)]
    assert off[1] > 0.02  # whose edges all agree
    assert results[2].reason == LEAD_APART
    assert max(off[2:]) < 0.01
    assert all(each.status is Status.DEGRADED for each in results[2:])
    assert all(each.reason != LEAD_APART for each in results[5:])
    assert odometry._doubt.moved(results[-1].timestamp)


@pytest.mark.parametrize("without", ["status.first_agreeing=0", "status.max_conflict=0"])
def test_where_it_is_not_asked_the_pose_goes_along(walker, without):
    results = rooms.tracked(walker, without)[1]
    assert se3.distance(walker[2][-1], results[-1].T_world_cam) > 0.2
    assert results[-1].status is Status.TRACKED


@pytest.fixture
def second():
    """A tracker at its first frame of a scene that stands still, and its second frame."""
    odometry, (first, frame) = Odometry(problems.CAMERA), problems.sequence(2)[0]
    odometry.track(first)
    seen = odometry._front_end.see(frame, 1, None, odometry._detail(frame.timestamp))
    return odometry, seen


def looked(second, off_m, speed, *, just_begun=True, far_start=False, **changes):
    """What is made of edges that agree on a pose so far to the left of where depth leads.

    The camera went there at a speed, m/s.
    """
    odometry, seen = second
    locator, told = odometry._locator, []
    start, term = locator.starts(seen)[0], locator.registrar.term(seen.frame.timestamp)
    true = locator.registrar.register(seen, start[None], term)
    T = se3.exp(np.array([-off_m, 0, 0, 0, 0, 0])) @ true.T_ref_cur
    found = replace(true, T_ref_cur=T, **{"sigma_depth": 6.0} | changes)
    period = 1 / 30
    ago = se3.exp(np.array([0, speed * period, 0, 0, 0, 0])) @ T

    class Asked:
        key, T_key_last, period = odometry._course.key, ago, lambda self, timestamp: period

        def has_just_begun(self, timestamp):
            return just_begun

        def see_motion(self, timestamp):
            told.append(timestamp)

    class Kit:
        config, depth_alone, judge = odometry.config, odometry._depth_alone, odometry._judge
        clock = staticmethod(no_clock)

    apart = Apart(Kit(), Asked(), Asked(), locator.registrar)
    again = apart.look(seen, T if far_start else start, term, found)
    assert told in ([], [seen.frame.timestamp])
    return found, again, true, bool(told)


@pytest.mark.parametrize("speed", [0.0, 0.5, 1.0])
def test_edges_and_depth_lead_apart_beyond_what_depth_may_be_late_by(second, speed):
    late = SLACK_M + LATE_S * speed
    found, again, _, is_told = looked(second, late - 0.005, speed)
    assert again is found
    assert not is_told
    found, again, true, is_told = looked(second, late + 0.005, speed)
    assert again is not found
    assert is_told
    assert se3.distance(again.T_ref_cur, true.T_ref_cur) < 0.001


def test_what_edges_and_depth_agree_on_more_is_kept(second):
    found, again, _, is_told = looked(second, 0.1, 0.0, plane_points=10**6)
    assert again is found
    assert is_told


def test_depth_is_followed_from_where_the_camera_was_expected_too(second):
    """From 30 cm aside it leads nowhere by itself."""
    _, again, true, is_told = looked(second, 0.3, 0.0)
    assert is_told
    assert se3.distance(again.T_ref_cur, true.T_ref_cur) < 0.001
    _, again, true, _ = looked(second, 0.3, 0.0, far_start=True)
    assert se3.distance(again.T_ref_cur, true.T_ref_cur) > 0.01


@pytest.mark.parametrize("changes", [{"agreeing": 0}, {"sigma_depth": 4.9}, {"just_begun": False}])
def test_nothing_is_asked_where_edges_do_not_agree_or_depth_fits_or_later(second, changes):
    found, again, _, is_told = looked(second, 0.1, 0.0, **changes)
    assert again is found
    assert not is_told


def test_depth_that_leaves_a_motion_open_says_nothing(second, monkeypatch):
    monkeypatch.setattr(depth_alone, "degenerate_directions", lambda covariance: np.eye(6)[:1])
    found, again, _, is_told = looked(second, 0.1, 0.0)
    assert again is found
    assert not is_told
