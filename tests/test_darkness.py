"""In darkness keyframes are made of depth alone: a camera is followed as long as it lasts."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.odometry import Odometry, Status

from . import problems

PERIOD = 1 / 30
LIT, DARK = 4, 30  # frames
OFF = "planes.alone_keyframes=none"
LEFT, RIGHT = -10.0, 40.0  # degrees, of the view: the wall ahead, and the corner to its right
DOWN = se3.exp(np.array([0.0, 0.0, 0.0, -0.35, 0.0, 0.0]))  # so that the floor is in view


def seen(way, timestamp, *, dark=False):
    """The corner of a room, from somewhere on the way from the left view to the right one."""
    turn = np.radians(LEFT + way * (RIGHT - LEFT))
    T = se3.exp(np.array([0.2 * way, -0.1 * way, 0.1 * way, 0.0, 0.0, 0.0]))
    T = T @ se3.exp(np.array([0.0, 0.0, 0.0, 0.0, turn, 0.0])) @ DOWN
    frame = problems.render(T, timestamp)
    return (replace(frame, grey=np.full_like(frame.grey, 5)) if dark else frame), T


def tracked(ways, *overrides):
    """Track frames, dark or not, somewhere on that way; with how far off each is, m."""
    odometry, results, off, first = Odometry(problems.CAMERA, with_set(overrides)), [], [], None
    for k, (way, dark) in enumerate(ways):
        frame, T = seen(way, k * PERIOD, dark=dark)
        first = T if first is None else first
        results.append(odometry.track(frame))
        T_true = se3.inverse(first) @ T
        off.append(problems.error(T_true, results[-1].T_world_cam)[0])
    return odometry, results, np.array(off)


def with_set(overrides):
    return Config().with_overrides(overrides)


def lit(way, count):
    """So many frames in the light, which go on slowly from there."""
    return [(way + 1e-3 * (k + 1), False) for k in range(count)]


def dark(start, end, count=DARK):
    """So many in darkness."""
    return [(start + (end - start) * (k + 1) / count, True) for k in range(count)]


@pytest.fixture(scope="module")
def across():
    """From one view to the other in the dark, which have nothing in common; and then it is lit."""
    return tracked(lit(0.0, LIT) + dark(0.0, 1.0) + lit(1.0, 40))


def test_it_is_followed_beyond_the_view_of_the_last_keyframe(across):
    _, results, off = across
    assert off[: LIT + DARK].max() < 0.01
    for result in results[LIT : LIT + DARK]:
        assert result.status is Status.DEGRADED
        assert result.reason.startswith("depth alone: 0 edges with depth; 30 needed")
    made = [result.index for result in results[LIT : LIT + DARK] if result.is_keyframe]
    assert 2 <= len(made) <= 6
    assert results[LIT + DARK - 1].keyframe in made
    _, without, _ = tracked(lit(0.0, LIT) + dark(0.0, 1.0), OFF)
    assert without[-1].status is Status.LOST
    assert not any(result.is_keyframe for result in without[1:])


def test_what_is_lit_then_goes_on_from_there(across):
    odometry, results, off = across
    after = results[LIT + DARK :]
    assert after[0].status is Status.DEGRADED
    assert after[0].is_keyframe
    assert Status.LOST not in {result.status for result in after}
    assert after[-1].status is Status.TRACKED
    assert off[-1] < 0.01
    stored = {index for index, _ in odometry._upkeep.store.places(0)}
    assert stored == {result.index for result in results if result.is_keyframe} - {
        result.index for result in results[LIT : LIT + DARK]
    }


def test_back_in_view_of_what_was_lit_it_goes_on_from_that():
    ways = lit(0.0, LIT) + dark(0.0, 0.6) + dark(0.6, 0.02) + lit(0.02, 3)
    _, results, off = tracked(ways)
    assert any(result.is_keyframe for result in results[LIT:-3])
    assert {result.keyframe for result in results[-3:]} == {0}
    assert Status.LOST not in {result.status for result in results[-3:]}
    assert off[-3:].max() < 0.003


def test_lost_in_the_dark_it_is_looked_for_by_what_was_lit():
    """What hid the view as well showed nothing of where it went: it may have come back."""
    ways = lit(0.0, LIT) + dark(0.0, 0.6)
    odometry, results, _ = tracked(ways)
    assert results[-1].keyframe >= LIT
    for k in range(len(ways), len(ways) + 3):
        frame, _ = seen(0.6, k * PERIOD, dark=True)
        depth = np.where(np.arange(problems.CAMERA.width) < 20, frame.depth, np.float32(0))
        assert odometry.track(replace(frame, depth=depth)).status is Status.LOST
    found = odometry.track(seen(0.01, (len(ways) + 3) * PERIOD)[0])
    assert found.status is not Status.LOST
    assert found.keyframe < LIT
    T_true = se3.inverse(seen(0.0, 0.0)[1]) @ seen(0.01, 0.0)[1]
    assert problems.error(T_true, found.T_world_cam)[0] < 0.003


def test_a_flash_in_the_dark_that_fits_nothing_changes_nothing():
    """After a frame that is lost it is compared with what was lit, and then no longer."""
    ways = lit(0.0, LIT) + dark(0.0, 0.6)
    odometry, results, _ = tracked(ways)
    key, k = results[-1].keyframe, len(ways)
    assert key >= LIT
    frame, _ = seen(0.6, k * PERIOD, dark=True)
    depth = np.where(np.arange(problems.CAMERA.width) < 20, frame.depth, np.float32(0))
    assert odometry.track(replace(frame, depth=depth)).status is Status.LOST
    flash, _ = seen(0.61, (k + 1) * PERIOD)
    grey = np.random.default_rng(0).integers(0, 255, flash.grey.shape).astype(np.uint8)
    assert odometry.track(replace(flash, grey=grey)).status is not Status.TRACKED
    after = odometry.track(seen(0.62, (k + 2) * PERIOD, dark=True)[0])
    assert (after.status, after.keyframe) == (Status.DEGRADED, key)


def test_without_a_store_of_places_as_well():
    ways = lit(0.0, LIT) + dark(0.0, 1.0) + lit(1.0, 5)
    _, results, off = tracked(ways, "keyframes.stored=0", "keyframes.earlier=0")
    assert Status.LOST not in {result.status for result in results}
    assert off.max() < 0.01


def test_the_paper_makes_none():
    assert Config.preset("paper").planes.alone_keyframes == "none"
    assert Config().planes.alone_keyframes == "made"
