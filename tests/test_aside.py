"""Frames that are registered from a few pixels beside where they were expected, or once more."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import scatter, se3
from edvo.aside import SIDES, Aside
from edvo.config import Config
from edvo.odometry import Odometry, Status
from edvo.status import SURE

from . import problems, rooms

STRIDE = 4


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
            camera, Config().with_overrides([f"seed={seed}", f"motion.aside_px={px}"])
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
def test_it_is_asked_where_edges_do_not_agree(second, monkeypatch, is_sure):
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
def test_where_far_fewer_edges_agree_at_once_it_is_in_doubt(settled, monkeypatch, fewer, is_asked):
    """Though as many fit as before, as in print, and it would be tracked."""
    odometry, frame = settled
    usual, align, wide = odometry._judge._agreeing, odometry._registration.align, []

    def narrow(*given, first_sigma_px=0.0, **options):
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        wide.append(first_sigma_px)
        return replace(found, agreeing=int((usual - fewer) * len(found.matches)))

    monkeypatch.setattr(odometry._registration, "align", narrow)
    assert odometry.track(frame).status is Status.TRACKED
    assert (2.0 in wide) == is_asked


@pytest.mark.parametrize("is_sharper", [False, True])
def test_what_something_else_has_led_to_is_registered_once_more(settled, monkeypatch, is_sharper):
    """By all samples, and the usual scale; kept if edges are more in their places."""
    odometry, frame = settled
    seen = odometry._front_end.see(frame, 8)
    locator = odometry._locator
    term = locator.registrar.term(frame.timestamp)
    first = locator.align(seen)
    assert locator._once_more(seen, term, first, first) is first
    off = 0.0 if is_sharper else -0.9  # px
    found = replace(first, residuals=np.abs(first.residuals) * (0.2 if off else 1.0) + 1.0 + off)
    again = locator._once_more(seen, term, first, found)
    assert (again is not found) == is_sharper
    if is_sharper:
        assert se3.distance(again.T_ref_cur, first.T_ref_cur) < 1e-3
