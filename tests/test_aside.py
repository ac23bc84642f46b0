"""Frames that are registered from a few pixels beside where they were expected, or once more."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import scatter, se3
from edvo.aside import SIDES, Aside
from edvo.config import Config
from edvo.hunting import STRIDE
from edvo.odometry import Odometry, Status
from edvo.planes import NO_POINTS
from edvo.scatter import SURE

from . import problems, rooms


@pytest.fixture(scope="module")
def print_on_walls():
    """A camera that begins to move along print, two pixels to a frame."""
    return rooms.stretch(133, 2)


@pytest.fixture
def second(print_on_walls):
    """A tracker, its second frame, where that is expected, and where that leads alone."""
    odometry, _ = rooms.tracked(print_on_walls, count=1)
    frame = print_on_walls[1][1]
    seen = odometry._front_end.see(frame, 1, None, odometry._detail(frame.timestamp))
    locator = odometry._locator
    start, term = locator.starts(seen)[0], locator.registrar.term(frame.timestamp)
    return odometry, seen, start, term, locator.registrar.register(seen, start[None], term)


@pytest.mark.parametrize("seed", range(3))
def test_print_does_not_hold_a_camera_back(print_on_walls, seed):
    camera, frames, truth = print_on_walls
    off = {}
    for px in (0, 2, 4, 6):
        odometry = Odometry(
            camera,
            Config().with_overrides(
                [f"seed={seed}", f"motion.aside_px={px}", "motion.depth_slack=none"]
            ),
        )
        result = [odometry.track(frame) for frame in frames][-1]
        assert result.status is Status.TRACKED
        off[px] = problems.error(truth[1], result.T_world_cam)[0]
    assert off.pop(0) > 0.008
    assert max(off.values()) < 0.002


def test_the_paper_knows_no_aside():
    assert Config.preset("paper").motion.aside_px == 0
    assert Config().motion.aside_px == 4


def test_each_side_is_so_many_pixels_away(second):
    """Of what is as far away as the samples, in the directions of the image."""
    odometry, seen, start, term, found = second
    registrar, asked = odometry._locator.registrar, []

    class Noted:
        def register(self, part, starts, *given):
            asked.append((len(part.samples), starts))
            return registrar.register(part, starts, *given)

    turned = start @ se3.exp(np.array([0, 0, 0, 0.1, 0.2, 0.3]))
    kit = type("Kit", (), {"config": odometry.config, "camera": odometry.camera})
    Aside(kit, Noted()).look(seen, turned, term, found)
    few = seen.samples.every(STRIDE)
    assert [n for n, _ in asked[:4]] == [len(few)] * 4
    depth = np.median(few.depths)
    for (_, (T,)), side in zip(asked[:4], SIDES, strict=True):
        T_start_side = se3.inverse(turned) @ T
        np.testing.assert_allclose(T_start_side[:3, :3], np.eye(3), atol=1e-12)
        moved_px = odometry.camera.fx * T_start_side[:3, 3] / depth
        np.testing.assert_allclose(moved_px, 4 * side, atol=1e-9)


@pytest.mark.parametrize("is_sure", [False, True])
def test_it_is_asked_where_edges_do_not_agree(second, is_sure):
    odometry, seen, start, term, found = second
    assert found.agreeing < SURE * len(found.matches)
    aside = odometry._locator._aside
    again = aside.look(seen, start, term, found)
    assert scatter.is_sharper(again, found)
    agreeing = int(np.ceil(SURE * len(found.matches))) - (not is_sure)
    asked = replace(found, agreeing=agreeing)
    assert (aside.look(seen, start, term, asked) is asked) == is_sure


@pytest.mark.parametrize("few_fit", [False, True])
def test_what_is_no_sharper_there_is_left(second, monkeypatch, few_fit):
    """Nor what few samples promise, and all of them do not keep."""
    odometry, seen, start, term, found = second
    align, counts = odometry._registration.align, []

    def dull(edges, samples, *given, **options):
        counts.append(len(samples))
        again = align(edges, samples, *given, **options)
        if few_fit and len(samples) < len(seen.samples):
            return again
        return replace(again, residuals=again.residuals + 3)

    monkeypatch.setattr(odometry._registration, "align", dull)
    assert odometry._locator._aside.look(seen, start, term, found) is found
    assert len(counts) == (5 if few_fit else 4)


@pytest.fixture
def settled():
    """A tracker that knows how things fit, and its next frame."""
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA)
    for frame in frames[:8]:
        assert odometry.track(frame).status is Status.TRACKED
    return odometry, frames[8]


@pytest.mark.parametrize(("fewer", "is_asked"), [(0.25, True), (0.15, False)])
def test_where_far_fewer_edges_agree_at_once_it_is_asked(settled, monkeypatch, fewer, is_asked):
    """Though as many fit as before, as in print, and it is tracked; but not looked at widely."""
    odometry, frame = settled
    usual, align = odometry._judge._agreeing, odometry._registration.align
    look, asked, wide = odometry._locator._aside.look, [], []

    def narrow(*given, first_sigma_px=0.0, **options):
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        wide.append(first_sigma_px)
        return replace(found, agreeing=int((usual - fewer) * len(found.matches)))

    monkeypatch.setattr(odometry._registration, "align", narrow)
    monkeypatch.setattr(
        odometry._locator._aside, "look", lambda *given: asked.append(given[0]) or look(*given)
    )
    assert odometry.track(frame).status is Status.TRACKED
    assert bool(asked) == is_asked
    assert 2.0 not in wide


BESIDE = se3.exp(np.array([0.004, 0.0, 0.0, 0.0, 0.0, 0.0]))


def registered(settled):
    """The next frame of a tracker, how depth counts, where it belongs, and a worse place."""
    odometry, frame = settled
    seen = odometry._front_end.see(frame, 8)
    locator = odometry._locator
    first = locator.align(seen)
    worse = replace(first, T_ref_cur=first.T_ref_cur @ BESIDE, residuals=first.residuals + 1.0)
    return seen, locator.registrar.term(frame.timestamp), first, worse


@pytest.mark.parametrize("is_sharper", [False, True])
def test_what_something_else_has_led_to_is_registered_once_more(settled, monkeypatch, is_sharper):
    """From there, by all samples, and the usual scale; kept if edges are more in their places."""
    locator, (seen, term, first, worse) = settled[0]._locator, registered(settled)
    register, starts = locator.registrar.register, []

    def noted(part, begun, *given, **more):
        starts.append(begun)
        return register(part, begun, *given, **more)

    monkeypatch.setattr(locator.registrar, "register", noted)
    assert locator._once_more(seen, term, first, first) is first
    found = worse if is_sharper else replace(worse, residuals=0.1 * first.residuals)
    again = locator._once_more(seen, term, first, found)
    ((start,),) = starts
    np.testing.assert_array_equal(start, worse.T_ref_cur)
    assert (again is not found) == is_sharper
    if is_sharper:
        assert se3.distance(again.T_ref_cur, first.T_ref_cur) < 1e-3


@pytest.mark.parametrize(
    ("share", "is_sure", "is_left"), [(0.45, True, True), (0.45, False, False), (0.9, True, False)]
)
def test_where_depth_is_worse_only_what_is_in_doubt_is_left_for_what_is_not(
    settled, monkeypatch, share, is_sure, is_left
):
    """As where a camera is knocked and its depth is late."""
    locator, (seen, term, first, worse) = settled[0]._locator, registered(settled)
    found = replace(
        worse,
        agreeing=int(share * len(first.matches)),
        plane_points=2 * first.plane_points,
        plane_inliers=2 * first.plane_inliers,
    )
    assert not scatter.is_sharper(first, found)
    status = locator.assessor.assess(found, seen.frame.timestamp)[0]
    assert (status is Status.TRACKED) == (share > 0.5)
    register = locator.registrar.register

    def unsure(*given, **more):
        again = register(*given, **more)
        return again if is_sure else replace(again, agreeing=int(0.48 * len(again.matches)))

    monkeypatch.setattr(locator.registrar, "register", unsure)
    assert (locator._once_more(seen, term, first, found) is not found) == is_left


def test_what_is_tracked_is_not_left_for_what_is_not(settled, monkeypatch):
    """However sharp it is."""
    locator, (seen, term, first, worse) = settled[0]._locator, registered(settled)
    align = settled[0]._registration.align
    in_doubt = "no step lowers the cost any more"
    assert locator._once_more(seen, term, first, worse) is not worse
    monkeypatch.setattr(
        settled[0]._registration,
        "align",
        lambda *given, **more: replace(
            align(*given, **more), converged=False, reason=in_doubt, iterations=99
        ),
    )
    assert locator._once_more(seen, term, first, worse) is worse


def test_without_depth_neither_is_asked(second, monkeypatch):
    """There is nothing to hold against what only edges say."""
    odometry, seen, start, term, found = second
    bare, first = replace(seen, points=NO_POINTS), replace(found)
    monkeypatch.setattr(odometry._registration, "align", lambda *given: pytest.fail("asked"))
    assert odometry._locator._aside.look(bare, start, term, found) is found
    assert odometry._locator._once_more(bare, term, first, found) is found


def test_switched_off_nothing_is_asked(print_on_walls, second, monkeypatch):
    _, seen, start, term, found = second
    odometry, _ = rooms.tracked(print_on_walls, "motion.aside_px=0", count=1)
    monkeypatch.setattr(odometry._registration, "align", lambda *given: pytest.fail("asked"))
    assert odometry._locator._aside.look(seen, start, term, found) is found


def test_it_begins_where_the_frame_was_expected(print_on_walls, monkeypatch):
    odometry, _ = rooms.tracked(print_on_walls, count=1)
    asked = []
    look = odometry._locator._aside.look
    monkeypatch.setattr(
        odometry._locator._aside, "look", lambda *given: asked.append(given[1]) or look(*given)
    )
    odometry.track(print_on_walls[1][1])
    (start,) = asked
    np.testing.assert_array_equal(start, np.eye(4))


def test_a_far_step_has_searches_of_its_own(print_on_walls, monkeypatch):
    odometry, _ = rooms.tracked(print_on_walls, count=1)
    late = replace(print_on_walls[1][1], timestamp=print_on_walls[1][0].timestamp + 0.6)
    fail = lambda *given: pytest.fail("asked")  # noqa: E731
    monkeypatch.setattr(odometry._locator._aside, "look", fail)
    monkeypatch.setattr(odometry._locator, "_once_more", fail)
    odometry.track(late)


def test_what_the_glance_has_led_to_is_registered_once_more(settled, monkeypatch):
    """And what comes of that is what the frame is placed by."""
    odometry, frame = settled
    locator, align = odometry._locator, odometry._registration.align
    monkeypatch.setattr(odometry._judge, "_poor_fit", lambda alignment: "in doubt")
    others, more = [], []

    def around(*given):
        others.append(replace(given[-1], agreeing=given[-1].agreeing))
        return others[-1]

    def once_more(seen, term, first, found):
        assert found is not first
        edges = odometry._course.key.edges_for(near=seen.is_near)
        more.append(align(edges, seen.samples, found.T_ref_cur[None]))
        return more[-1]

    monkeypatch.setattr(odometry._search, "around", around)
    monkeypatch.setattr(locator.assessor, "better", lambda found, other, when: other)
    monkeypatch.setattr(locator, "_once_more", once_more)
    monkeypatch.setattr(locator.mender, "mend", lambda seen, found: found)
    monkeypatch.setattr(locator.mender, "weighed", lambda seen, found: found)
    assert odometry.track(frame).alignment is more[-1]
    assert others
