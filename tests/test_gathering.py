"""Keyframes that gather the edges that another light shows."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.clock import no_clock
from edvo.config import Config, KeyframesConfig
from edvo.doubt import CHANGED
from edvo.edges import EdgePixels
from edvo.exposure import Exposure
from edvo.front_end import FrontEnd
from edvo.gathering import carried, gather, may_gather, unknown
from edvo.instants import Instants
from edvo.matching import Criterion, EdgeIndex
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, camera_of
from edvo.registration import Registration
from edvo.report.warmup import warm_up

from . import problems, twins

CAMERA = problems.CAMERA
CONFIG = Config()
BOUNDS = {
    "max_translation_m": 0.3,
    "max_rotation_deg": 15.0,
    "min_overlap": 0.75,
    "gather_share": 0.5,
}


def edges_of(seed=0, count=400):
    rng = np.random.default_rng(seed)
    edges = problems.random_edges(rng, count, CAMERA.width, CAMERA.height)
    depths = rng.uniform(0.5, 4, count).astype(np.float32)
    profiles = rng.normal(size=(count, 2)).astype(np.float32)
    return EdgePixels(edges.pixels, edges.gradients, depths, profiles)


def test_carrying_edges_equals_its_numpy_twin():
    edges = edges_of()
    edges.depths[::7] = 0
    edges.depths[1::40] = 0.06  # would come to lie behind the camera
    T = problems.motion(np.random.default_rng(2), 0.1, 12)
    n = len(edges)
    pixels, gradients, profiles = np.empty((3, n, 2), np.float32)
    depths = np.empty(n, np.float32)
    given = edges.pixels, edges.gradients, edges.depths, edges.profiles, T
    count = kernels.carry_edges(*given, camera_of(CAMERA), pixels, gradients, depths, profiles)
    wanted = twins.carry_edges(*given, CAMERA)
    assert 200 < count < n - n // 7
    for ours, twin in zip((pixels, gradients, depths, profiles), wanted, strict=True):
        np.testing.assert_allclose(ours[:count], twin, atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(gradients[:count], axis=1), 1, atol=1e-6)


def test_the_direction_of_an_edge_is_that_of_its_line_seen_from_there():
    """By differences of two points of the line, at one depth."""
    edges, step = edges_of(3), 1e-3
    T = problems.motion(np.random.default_rng(4), 0.1, 20)
    along = np.column_stack((-edges.gradients[:, 1], edges.gradients[:, 0]))

    def seen(pixels):
        X = CAMERA.backproject(pixels, edges.depths.astype(np.float64))
        return CAMERA.project(X @ T[:3, :3].T + T[:3, 3])

    here = edges.pixels.astype(np.float64)
    ahead, behind = seen(here + step * along), seen(here - step * along)
    inside = ((seen(here) >= 0) & (seen(here) <= (CAMERA.width - 1, CAMERA.height - 1))).all(axis=1)
    line = (ahead - behind)[inside]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    there = carried(edges, T, CAMERA)
    np.testing.assert_allclose((there.gradients * line).sum(axis=1), 0, atol=1e-4)
    turned = line[:, 0] * -there.gradients[:, 1] + line[:, 1] * there.gradients[:, 0]
    assert (turned > 0.999).all()  # dark and bright stay on their sides


def test_edges_come_back_to_where_they_were():
    edges = edges_of(5)
    T = problems.motion(np.random.default_rng(6), 0.05, 5)
    there = carried(edges, T, CAMERA)
    back = carried(there, se3.inverse(T), CAMERA)
    assert len(back) == len(there)  # all that is in view there was in view here
    one = np.argmin(abs(back.depths[:, None] - edges.depths), axis=1)  # each depth is its own
    np.testing.assert_allclose(back.depths, edges.depths[one], atol=1e-5)
    np.testing.assert_allclose(back.pixels, edges.pixels[one], atol=0.01)
    np.testing.assert_allclose(
        back.gradients, edges.gradients[one], atol=0.01
    )  # of one depth but there


@pytest.mark.parametrize(
    ("away", "turn_deg", "is_new"),
    [(0, 0, False), (2.9, 0, False), (3.1, 0, True), (0, 40, False), (0, 50, True), (0, 180, True)],
)
def test_an_edge_is_known_where_one_lies_near_and_is_turned_alike(away, turn_deg, is_new):
    def edge(u, angle):
        angle = np.radians(angle)
        gradient = np.array([[np.cos(angle), np.sin(angle)]], np.float32)
        return EdgePixels(np.array([[u, 90]], np.float32), gradient, np.ones(1, np.float32))

    known = EdgeIndex(edge(100, 20))
    assert len(unknown(known, edge(100 + away, 20 + turn_deg), CAMERA)) == is_new


class Scene:
    """A keyframe, and what is seen from elsewhere once the light has changed."""

    def __init__(self):
        self.registration = Registration(CAMERA, CONFIG.matching, CONFIG.registration)
        fitter = PlaneFitter(CAMERA, CONFIG.planes)
        self.exposure = Exposure(CAMERA, CONFIG)
        self.front_end = FrontEnd(
            CAMERA, CONFIG, self.registration, fitter, no_clock, self.exposure
        )
        seen = self.front_end.see(problems.render(np.eye(4)), 0)
        self.keyframe = self.front_end.keyframe(seen, 0, np.eye(4), 0)
        self.known = self.front_end.edges_with_depth(seen)
        self.T = se3.exp([0.03, 0.01, -0.02, 0.01, 0.02, 0.01])
        self.lit = self.edges(self.T)

    def edges(self, T):
        seen = self.front_end.see(problems.render(T, shaded=True), 1)
        return self.front_end.edges_with_depth(seen)

    def gather(self, keyframe, edges, T):
        return gather(keyframe, edges, T, 3.5, self.registration, CAMERA)


@pytest.fixture(scope="module")
def scene():
    return Scene()


def test_what_a_keyframe_knows_it_does_not_gather(scene):
    same = scene.gather(scene.keyframe, scene.known, np.eye(4))
    assert same.gathered == 0
    np.testing.assert_array_equal(same.edges.edges.pixels, scene.keyframe.edges.edges.pixels)


def test_what_another_light_shows_is_put_where_the_keyframe_would_see_it(scene):
    key = scene.keyframe
    more = scene.gather(key, scene.lit, scene.T)
    own, edges = len(key.edges), more.edges.edges
    assert 300 < more.gathered < len(scene.lit)
    assert more.gathered_at == 3.5
    assert len(edges) == own + more.gathered
    np.testing.assert_array_equal(edges.pixels[:own], key.edges.edges.pixels)
    assert more.planes is key.planes
    assert more.telling is key.telling  # places are told by what it has seen itself
    assert more.chamfer is key.chamfer
    assert more.look is key.look
    assert more.edges_for(near=False) is key.telling
    assert more.edges_for(near=True) is more.edges
    # what it would have seen itself in that light
    truth = EdgeIndex(scene.edges(np.eye(4)))
    found = truth.match(edges.pixels[own:], edges.gradients[own:], Criterion(0.0, CAMERA.width))
    away = np.sqrt(found.costs)
    assert np.median(away) < 0.5
    assert (away < 1.5).mean() > 0.9


def test_what_was_gathered_is_known_from_then_on(scene):
    more = scene.gather(scene.keyframe, scene.lit, scene.T)
    assert scene.gather(more, scene.lit, scene.T).gathered == more.gathered


@pytest.mark.parametrize(
    ("more", "motion", "overlap", "gathers"),
    [
        ({}, (0.14, 0), 0.74, True),
        ({}, (0.16, 0), 0.74, False),  # it has gone on
        ({}, (0, 7.4), 0.74, True),
        ({}, (0, 7.6), 0.74, False),
        ({}, (0, 0), 0.76, False),  # it still serves
        ({"gather_share": 0.0}, (0, 0), 0.5, False),
        ({"rule": "gap"}, (0, 0), 0.5, False),
    ],
)
def test_a_keyframe_gathers_where_light_and_not_motion_takes_its_edges(
    scene, more, motion, overlap, gathers
):
    config = KeyframesConfig(**(BOUNDS | more))
    T = problems.motion(np.random.default_rng(1), motion[0] + 1e-9, motion[1] + 1e-9)
    assert may_gather(config, scene.keyframe, T, overlap) is gathers


def test_one_that_has_gathered_more_than_it_has_seen_itself_gives_way(scene):
    config, own = KeyframesConfig(**BOUNDS), len(scene.keyframe.edges)
    for gathered, may in ((own // 2, True), (own // 2 + 1, False)):
        key = replace(scene.keyframe, gathered=gathered)
        assert may_gather(config, key, np.eye(4), 0.5) is may


# ------------------------------------------------------------------------------------- in a run


def in_two_lights(count=24, first=8, period=4):
    """Frames whose light is another one for some frames in every few."""
    poses = problems.path(count)
    shaded = [k >= first and (k - first) // period % 2 == 0 for k in range(count)]
    frames = [
        problems.render(T, 10 + k / 30, shaded=lit)
        for k, (T, lit) in enumerate(zip(poses, shaded, strict=True))
    ]
    return frames, poses


def follow(frames, *overrides):
    # light changes within a third of the reach of a keyframe
    config = Config().with_overrides(["keyframes.max_translation_m=0.3", *overrides])
    odometry = Odometry(CAMERA, config)
    return odometry, [odometry.track(frame) for frame in frames]


def test_a_keyframe_outlasts_a_change_of_light():
    frames, poses = in_two_lights()
    odometry, results = follow(frames)
    assert [r.index for r in results if r.is_keyframe] == [0]
    assert odometry._course.keyframe.gathered > 300
    assert odometry._course.keyframe.gathered_at == frames[8].timestamp  # and it was enough
    fitting = [r.alignment.inliers / r.samples for r in results[1:]]
    assert fitting[7] < 0.75 < min(fitting[8:])
    for result, T in zip(results, poses, strict=True):
        assert problems.error(T, result.T_world_cam)[0] < 0.004
    assert {r.status for r in results[9:] if r.reason != CHANGED} <= {Status.TRACKED}


def test_what_is_held_of_the_keyframe_stays_its_own():
    frames, _ = in_two_lights(10)
    odometry, _ = follow(frames)
    held = odometry._instants._held
    assert held.keyframe is odometry._course.keyframe
    assert odometry._course.keyframe.gathered
    np.testing.assert_array_equal(held.depth, frames[0].depth)


def test_a_result_tells_where_gathered_edges_lie():
    odometry, results = follow(in_two_lights()[0])
    key = odometry._course.keyframe
    matched = results[9].alignment.matches
    assert np.count_nonzero(matched >= len(key.edges) - key.gathered) > 100
    wanted = key.edges.edges.pixels[matched[matched >= 0]]
    np.testing.assert_array_equal(results[9].alignment.references[matched >= 0], wanted)


def test_one_that_gathers_and_serves_no_better_gives_way(monkeypatch):
    monkeypatch.setattr("edvo.upkeep.gather", nothing_new)
    frames, _ = in_two_lights(14)
    _, results = follow(frames)
    assert [r.index for r in results if r.is_keyframe][:2] == [0, 9]


def nothing_new(keyframe, edges, T_key_cur, timestamp, registration, camera):
    return replace(keyframe, gathered_at=timestamp)


def test_a_far_step_is_not_gathered():
    frames, _ = in_two_lights(10)
    late = [replace(f, timestamp=f.timestamp + 0.5 * (k >= 8)) for k, f in enumerate(frames)]
    odometry, _ = follow(late)
    assert not odometry._course.keyframe.gathered


def test_nothing_is_left_to_be_compiled_when_light_changes():
    warm_up(Config())
    used = (
        kernels.carry_edges,
        kernels.match_in_grid,
        kernels.blurred_gradients,
        kernels.put_strong_first,
        kernels.solve_damped,
        kernels.shared_depth_factor,
    )
    before = [len(kernel.signatures) for kernel in used]
    assert min(before) > 0
    odometry, _ = follow(in_two_lights(10)[0])
    assert odometry._course.keyframe.gathered
    assert [len(kernel.signatures) for kernel in used] == before


def test_without_it_each_change_makes_a_keyframe():
    frames, _ = in_two_lights()
    odometry, results = follow(frames, "keyframes.gather_share=0")
    assert [r.index for r in results if r.is_keyframe][:2] == [0, 8]
    assert odometry._course.keyframe.gathered == 0


def test_a_stored_keyframe_has_what_it_gathers():
    odometry, _ = follow(in_two_lights(12)[0])
    assert odometry._upkeep.store.newest() is odometry._course.keyframe
    assert odometry._instants._held.keyframe is odometry._course.keyframe


def test_it_is_gathered_before_anything_else_is_seen_and_in_the_time_of_the_next_frame():
    frames, _ = in_two_lights(9)
    odometry, results = follow(frames)
    assert odometry._course.keyframe.gathered == 0
    assert not results[-1].is_keyframe
    odometry.skip(11.0, "gone")
    assert odometry._course.keyframe.gathered > 300


def test_a_view_that_changes_at_once_is_in_doubt_though_the_keyframe_stays():
    """A hand is gathered like a light: what fits poorly what was seen just now is no motion."""
    odometry, results = follow(in_two_lights(9)[0])
    odometry.skip(10.301, "gone")  # gathers
    alignment = replace(results[-1].alignment, inliers=len(results[-1].alignment.matches) * 3 // 5)
    assert odometry._judge.fits_poorly(alignment)
    for later, doubted in ((0.2, False), (0.09, True)):
        odometry._doubt.mind_change(alignment, odometry._course.keyframe.gathered_at + later)
        assert (odometry._doubt.reason == CHANGED) is doubted


def test_a_keyframe_whose_edges_are_moved_forgets_what_it_gathered(scene):
    more = scene.gather(scene.keyframe, scene.lit, scene.T)
    fitter = PlaneFitter(CAMERA, CONFIG.planes)
    instants = Instants(CAMERA, CONFIG, scene.registration, fitter, scene.exposure)
    seen = scene.front_end.see(problems.render(np.eye(4)), 0)
    velocity = np.array([0.4, -0.3, 0.5, 0.3, -0.5, 0.4])
    instants.hold(scene.keyframe, seen, seen.edges.describe(CAMERA), velocity)
    instants.exchange(scene.keyframe, more)
    assert instants.renewed(more, velocity) is None
    instants.rolling.estimate.note(1e12, 1e12 * 0.02, 1 / 30)
    moved = instants.renewed(more, velocity)
    assert len(moved.edges) == len(scene.keyframe.edges)
    assert (moved.gathered, moved.gathered_at) == (0, -math.inf)


def test_only_the_keyframe_that_is_held_is_exchanged(scene):
    fitter = PlaneFitter(CAMERA, CONFIG.planes)
    instants = Instants(CAMERA, CONFIG, scene.registration, fitter, scene.exposure)
    instants.exchange(scene.keyframe, scene.keyframe)  # none is
    seen = scene.front_end.see(problems.render(np.eye(4)), 0)
    instants.hold(scene.keyframe, seen, seen.edges.describe(CAMERA), None)
    other = replace(scene.keyframe, index=5)
    instants.exchange(other, other)
    assert instants._held.keyframe is scene.keyframe


def test_the_preset_paper_gathers_nothing():
    assert Config.preset("paper").keyframes.gather_share == 0
