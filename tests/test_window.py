"""Keyframes that are placed by several: what registrations say together, and what is left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.odometry import Odometry
from edvo.registration import EDGES_ALONE
from edvo.synthesis.sequence import make_recipe
from edvo.window import KeyframeWindow

from . import problems

SIGMA = 1e-3


class Given:
    """Stands in for registration and covariance: what is found with an earlier keyframe."""

    def __init__(self, T_world_cam, agreeing=100, converged=True, scale=1.0):
        self.T_world_cam, self.agreeing, self.converged, self.scale = (
            T_world_cam,
            agreeing,
            converged,
            scale,
        )
        self.asked = []

    def align(self, edges, samples, starts, planes, points, term):
        self.asked.append(edges)
        self.given = len(samples), term.weight
        T = se3.inverse(edges.T_world_key) @ self.T_world_cam
        return SimpleNamespace(converged=self.converged, agreeing=self.agreeing, T_ref_cur=T)

    def covariance(self, *_):
        return self.scale * SIGMA**2 * np.eye(6)


def keyframe(index, T_world_key):
    edges = SimpleNamespace(index=index, T_world_key=T_world_key)
    return SimpleNamespace(
        index=index, T_world_key=T_world_key, edges_for=lambda *, near: edges, planes=None
    )


def at(x, y=0.0, z=0.0):
    return se3.exp([x, y, z, 0, 0, 0])


TERM = EDGES_ALONE._replace(weight=1.0)


class Samples(list):
    def every(self, stride):
        return self[::stride]


SEEN = SimpleNamespace(samples=Samples(range(200)), points=None, is_near=True)


class Walk:
    """Keyframes placed one after the other."""

    def __init__(self, given, size=5):
        self.window = KeyframeWindow(
            Config().with_overrides(
                [f"keyframes.window={size}", "keyframes.max_translation_m=0.3"]
            ),
            given,
            given,
        )
        self.last = keyframe(0, np.eye(4))

    def go(self, T_last_cur, scale=1.0, seen=SEEN):
        C = scale * SIGMA**2 * np.eye(6)
        T, self.is_asked = self.window.place(self.last, seen, T_last_cur, C, TERM)
        self.last = keyframe(self.last.index + 1, T)
        self.window.take(self.last)
        return T


def test_the_first_ones_are_where_they_were_registered():
    walk = Walk(Given(np.eye(4)))
    np.testing.assert_array_equal(walk.go(at(0.1)), at(0.1))
    assert not walk.is_asked
    walk.go(at(0.1))
    assert walk.is_asked


@pytest.mark.parametrize(("samples", "stride"), [(200, 2), (1500, 2), (4500, 6)])
def test_a_second_registration_takes_no_more_samples_than_are_quick(samples, stride):
    """Depth counts less beside them by as much."""
    given = Given(at(0.2))
    walk = Walk(given)
    for _ in range(2):
        walk.go(
            at(0.1),
            seen=SimpleNamespace(samples=Samples(range(samples)), points=None, is_near=True),
        )
    assert given.given == (samples // stride, 1 / stride)


@pytest.mark.parametrize(("scale", "share"), [(1.0, 2 / 3), (2.0, 1 / 2), (8.0, 1 / 5)])
def test_registrations_count_by_their_covariances(scale, share):
    """Two steps of variance 1 lead to one place, one of variance ``scale`` to another."""
    given = Given(at(1e-4), scale=scale)
    walk = Walk(given)
    walk.go(at(0, 1e-6))
    T = walk.go(at(0, -1e-6))
    np.testing.assert_allclose(T, at(share * 1e-4), atol=1e-8)
    assert [edges.index for edges in given.asked] == [0]
    # and the one between has moved by half of that, which it is as far from both
    np.testing.assert_allclose(walk.window._poses[1], at(share * 0.5e-4, 1e-6), atol=1e-8)


def test_what_fits_leaves_all_where_they_are():
    rng = np.random.default_rng(0)
    steps = [se3.exp(rng.normal(0, 0.02, 6)) for _ in range(8)]
    given, T = Given(np.eye(4)), np.eye(4)
    walk = Walk(given)
    for step in steps:
        T = T @ step
        given.T_world_cam = T
        np.testing.assert_allclose(walk.go(step, rng.uniform(0.5, 2)), T, atol=1e-9)
    assert len(given.asked) == 7


def test_of_the_poses_solved_for_none_costs_less():
    """The squares that are left, by finite differences about the solution."""
    rng = np.random.default_rng(1)
    given, T = Given(np.eye(4), scale=1.7), np.eye(4)
    walk = Walk(given)
    for index in range(4):
        if index:
            walk.last = keyframe(index, walk.window._poses[-1])
            walk.window.take(walk.last)
        step = se3.exp(rng.normal(0, 0.03, 6))
        T = T @ step
        given.T_world_cam = T @ se3.exp(rng.normal(0, 0.5 * SIGMA, 6))
        walk.window.place(
            walk.last,
            SEEN,
            step @ se3.exp(rng.normal(0, 0.5 * SIGMA, 6)),
            np.diag(rng.uniform(1, 3, 6)) * SIGMA**2,
            TERM,
        )
    poses, links = walk.window._poses, walk.window._links
    assert any(link.second > link.first + 1 for link in links)

    def cost(k, xi):
        moved = [T @ se3.exp(xi) if i == k else T for i, T in enumerate(poses)]
        total = 0.0
        for link in links:
            T = se3.inverse(moved[link.first]) @ moved[link.second]
            away = se3.log(T @ se3.inverse(link.T_first_second))
            total += away @ np.linalg.solve(link.covariance, away)
        return total

    for k in range(1, len(poses)):
        for axis in np.eye(6):
            ahead, behind = cost(k, 1e-6 * axis), cost(k, -1e-6 * axis)
            curvature = ahead + behind - 2 * cost(k, 0 * axis)
            assert abs(ahead - behind) / 2 < 0.02 * SIGMA / 1e-6 * curvature


def test_the_nearest_earlier_one_is_asked():
    given = Given(np.eye(4))
    walk = Walk(given)
    for step, T in ((0.2, 0.2), (0.2, 0.4), (-0.18, 0.22), (0.01, 0.23)):
        given.T_world_cam = at(T)
        walk.go(at(step))
    # 0 from 0.4; 1 (at 0.2) from 0.22, and again from 0.23, not 2 (at 0.4) nor 3, the last one
    assert [edges.index for edges in given.asked] == [0, 1, 1]


@pytest.mark.parametrize(
    "given",
    [
        Given(at(0.2), agreeing=59),
        Given(at(0.2), converged=False),
        Given(at(0.2 + 10 * SIGMA)),  # beyond chance
    ],
)
def test_what_does_not_fit_is_left_out(given):
    walk = Walk(given)
    walk.go(at(0.1))
    np.testing.assert_array_equal(walk.go(at(0.1)), at(0.1) @ at(0.1))
    assert len(given.asked) == 1


@pytest.mark.parametrize(("jump", "is_believed"), [(0.015, True), (0.04, False)])
def test_a_jump_is_not_believed_however_likely_it_is(jump, is_believed):
    walk = Walk(Given(at(0.2 + jump)))
    walk.go(at(0.1), scale=1e4)  # known to 10 cm
    T = walk.go(at(0.1), scale=1e4)
    assert abs(T[0, 3] - 0.2) == pytest.approx(jump if is_believed else 0.0, abs=1e-5)
    assert len(walk.window._links) == (3 if is_believed else 2)


def test_of_those_at_the_same_place_the_one_turned_alike_is_asked():
    given = Given(np.eye(4))
    walk = Walk(given)
    for step, yaw in ((-17, -17), (16, -1), (-8, -9), (7, -2)):
        given.T_world_cam = se3.exp([0, 0, 0, 0, np.radians(yaw), 0])
        walk.go(se3.exp([0, 0, 0, 0, np.radians(step), 0]))
    # 0 alone is before the last at first; then 1 is 8 degrees away, 0 is 9; then 2 is 1, 0 is 2
    assert [edges.index for edges in given.asked] == [0, 1, 2]


def test_one_that_is_far_is_not_asked():
    given = Given(at(0.5))
    walk = Walk(given)
    walk.go(at(0.25))
    walk.go(at(0.25))
    turned = Walk(given)
    for _ in range(2):
        turned.go(se3.exp([0, 0, 0, 0, np.radians(12), 0]))
    assert not given.asked


def test_no_more_are_kept_than_asked_for():
    given = Given(np.eye(4))
    walk = Walk(given, size=3)
    for _ in range(6):
        walk.go(np.eye(4))
    assert [key.index for key in walk.window._keyframes] == [5, 6]
    assert all(0 <= link.first < link.second < 2 for link in walk.window._links)


@pytest.mark.parametrize("moved", [True, False])
def test_it_begins_anew_from_a_keyframe_that_it_does_not_know(moved):
    given = Given(np.eye(4))
    walk = Walk(given)
    for _ in range(3):
        walk.go(np.eye(4))
    asked = len(given.asked)
    index = walk.last.index if moved else 77  # of a piece that was joined, or found again
    walk.last = keyframe(index, at(1.0))
    np.testing.assert_array_equal(walk.go(at(0.1)), at(1.0) @ at(0.1))
    assert len(given.asked) == asked


@pytest.mark.parametrize("without", ["status.covariance=none", "keyframes.window=2"])
def test_without_covariances_or_earlier_ones_the_last_one_places_it(to_and_fro, without):
    source, frames = to_and_fro
    close = ["keyframes.max_translation_m=0.04", "keyframes.max_rotation_deg=2"]
    poses = []
    for overrides in ([without], [without, "keyframes.window=1"]):
        odometry = Odometry(source.camera, Config().with_overrides([*close, *overrides]))
        poses.append([odometry.track(frame).T_world_cam for frame in frames])
    np.testing.assert_array_equal(*poses)


@pytest.fixture(scope="module")
def to_and_fro():
    source = problems.Remembered(make_recipe("office", frames=40))
    order = (*range(0, 40, 2), *range(38, -1, -2))
    frames = [replace(source.read(i).frame, timestamp=n / 30) for n, i in enumerate(order)]
    return source, frames


def test_a_camera_that_comes_back_is_placed_by_where_it_was(to_and_fro, monkeypatch):
    source, frames = to_and_fro
    close = ["keyframes.max_translation_m=0.04", "keyframes.max_rotation_deg=2"]
    links = []
    register = KeyframeWindow._register
    monkeypatch.setattr(
        KeyframeWindow, "_register", lambda *given: links.append(register(*given)) or links[-1]
    )
    off = {}
    for size in (1, 5):
        odometry = Odometry(
            source.camera, Config().with_overrides([*close, f"keyframes.window={size}"])
        )
        results = [odometry.track(frame) for frame in frames]
        off[size] = np.linalg.norm(results[-1].T_world_cam[:3, 3])
        assert bool(links) is (size > 1)
    assert any(link is not None for link in links)
    assert off[5] < 0.8 * off[1] < 1e-3  # 0.3 and 0.6 mm; so it is with other seeds and scenes
