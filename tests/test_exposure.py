"""For how long images are exposed: measured by what motion smears, and what edges count for it."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.exposure import ENOUGH, LARGEST_S, LASTING, LEAST_S, Exposure, sharp_variance
from edvo.frame import Frame
from edvo.measuring import Moment
from edvo.odometry import Odometry
from edvo.planes import camera_of
from edvo.report.warmup import warm_up
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins

CAMERA = problems.CAMERA
PERIOD = 1 / 30
EXPOSED_S = 0.02
VELOCITY = np.array([0.3, -0.2, 0.1, 0.4, -0.6, 0.2])
KEY_VELOCITY = np.array([-0.1, 0.1, 0.05, 0.1, 0.1, -0.1])
SHARP_PX2 = sharp_variance(5)


def exposure(*overrides):
    return Exposure(CAMERA, Config().with_overrides(overrides))


def known(seconds):
    return "motion.exposure=known", f"motion.exposure_s={seconds}"


def smeared(edges, softness, velocity, seconds, depths=None):
    """The profiles of edges, soft by themselves, that a camera exposes for so long."""
    depths = edges.depths if depths is None else depths
    speeds = twins.speeds_across(edges.pixels, edges.gradients, depths, velocity, CAMERA)
    bends = -1 / (softness + seconds**2 * speeds**2 / 12)
    heights = edges.pixels[:, 0] % 1  # one as strong as the other
    profiles = np.column_stack((heights, bends)).astype(np.float32)
    return replace(edges, profiles=profiles)


def moment(
    seed,
    seconds=EXPOSED_S,
    velocity=VELOCITY,
    key_velocity=KEY_VELOCITY,
    n=600,
    gathered=0,
    noise=0.05,
):
    """Edges, each as soft as its match by itself, that the camera smears by how it moves."""
    rng = np.random.default_rng(seed)
    edges = problems.random_edges(rng, n, CAMERA.width, CAMERA.height)
    depths = rng.uniform(0.8, 3, n).astype(np.float32)
    soft = rng.exponential(1.0, n)
    key = smeared(edges, SHARP_PX2 + soft, key_velocity, seconds, depths)
    softer = np.maximum(SHARP_PX2 + soft + rng.normal(0, noise, n), 0.5)
    samples = smeared(replace(edges, depths=depths), softer, velocity, seconds)
    keyframe = SimpleNamespace(edges=SimpleNamespace(edges=key), gathered=gathered)
    alignment = SimpleNamespace(
        pixels=samples.pixels,
        matches=np.arange(n, dtype=np.int32),
        residuals=rng.normal(0, 0.3, n),
    )
    seen = SimpleNamespace(samples=samples, edges=SimpleNamespace(blur_px2=0.0))
    return Moment(keyframe, seen, alignment, PERIOD, velocity, velocity), key_velocity


def learned(measured, *, count=3, **how):
    for seed in range(count):
        measured.learn(*moment(seed, **how))
    return measured.seconds


# --------------------------------------------------------------------------------------- kernels


def test_the_speed_of_edges_is_that_of_what_they_belong_to():
    rng = np.random.default_rng(0)
    edges = problems.random_edges(rng, 50, CAMERA.width, CAMERA.height)
    depths = rng.uniform(0.5, 4, 50).astype(np.float32)
    X = CAMERA.backproject(edges.pixels.astype(np.float64), depths.astype(np.float64))
    h = 1e-5
    before, after = (
        CAMERA.project(X @ T[:3, :3].T + T[:3, 3])
        for T in (se3.exp(-h * VELOCITY), se3.exp(h * VELOCITY))
    )
    flow = (after - before) / (2 * h)
    wanted = (edges.gradients * flow).sum(axis=1)
    pinhole = camera_of(CAMERA)
    for i in range(50):
        near = kernels.nearness(depths[i])
        place = (np.float64(c) for c in (*edges.pixels[i], *edges.gradients[i]))
        found = kernels.speed_across(*place, near, VELOCITY, pinhole)
        assert found == pytest.approx(wanted[i], rel=1e-3, abs=1e-2)
    twin = twins.speeds_across(edges.pixels, edges.gradients, depths, VELOCITY, CAMERA)
    np.testing.assert_allclose(twin, wanted, rtol=1e-3, atol=1e-2)


def test_what_has_no_depth_is_turned_but_not_carried():
    assert kernels.nearness(np.float32(0)) == kernels.nearness(np.float32(0.01)) == 0
    assert kernels.nearness(np.float32(2)) == pytest.approx(0.5)


def test_sharpness_equals_its_numpy_twin():
    rng = np.random.default_rng(1)
    edges = problems.random_edges(rng, 200, CAMERA.width, CAMERA.height)
    depths = np.where(rng.random(200) < 0.1, 0, rng.uniform(0.5, 4, 200)).astype(np.float32)
    edges = replace(edges, depths=depths)
    where = edges.pixels, edges.gradients, depths
    speeds = [twins.speeds_across(*where, each, CAMERA) for each in (VELOCITY, KEY_VELOCITY)]
    measured = exposure(*known(EXPOSED_S))
    for key_velocity, squares in (
        (KEY_VELOCITY, speeds[0] ** 2 + speeds[1] ** 2),
        (None, speeds[0] ** 2),
    ):
        found = measured.sharpness(edges, VELOCITY, key_velocity)
        wanted = (1 + kernels.SMEARED_DOUBT * EXPOSED_S**2 * squares / 12) ** -0.5
        np.testing.assert_allclose(found, wanted, rtol=1e-4)
    assert found.min() < 0.8 < 0.99 < found.max() <= 1


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("n", [80, 399, 1500])
def test_the_change_of_smear_equals_its_numpy_twin(seed, n):
    rng = np.random.default_rng(seed)
    edges, key = (problems.random_edges(rng, size, CAMERA.width, CAMERA.height) for size in (n, 90))
    matches = rng.integers(-1, 90, n).astype(np.int32)
    turned = rng.random(n) < 0.7  # as their match; others as chance has it
    gradients = np.where(turned[:, None], key.gradients[matches], edges.gradients)
    key = replace(key, profiles=rng.uniform((0, -1), (1, 0.02), (90, 2)).astype(np.float32))
    given = (
        edges.pixels,
        np.where(rng.random(n) < 0.1, 0, rng.uniform(0.5, 4, n)).astype(np.float32),
        gradients,
        rng.uniform((0, -1), (1, 0.02), (n, 2)).astype(np.float32),
    )
    residuals = np.where(matches >= 0, rng.normal(0, 1.5, n), np.nan)
    how = 6.0, VELOCITY, KEY_VELOCITY
    found = kernels.smear_change(
        *given,
        key.pixels,
        key.gradients,
        key.profiles,
        70,
        matches,
        residuals,
        2.0,
        *how,
        camera_of(CAMERA),
    )
    wanted = twins.smear_change(*given, key, 70, matches, residuals, 2.0, *how, CAMERA)
    assert found[0] == wanted[0] >= 4
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)


def test_no_edges_tell_nothing():
    (given, key_velocity) = moment(0, n=3)
    measured = exposure()
    measured.learn(given, key_velocity)
    given.alignment.matches[:] = -1
    measured.learn(given, key_velocity)
    assert measured.estimate.value == 0


# ------------------------------------------------------------------------------------- measuring


def test_what_is_far_away_is_smeared_by_how_far_the_camera_turns():
    known = Config().with_overrides(["motion.exposure=known", "motion.exposure_s=0.02"])
    exposure = Exposure(problems.CAMERA, known)
    assert exposure.smeared_px(np.array([9.0, 9, 9, 0, 0, 9])) == 0.0
    assert exposure.smeared_px(np.array([0.0, 0, 0, 0.3, 0.4, 0])) == pytest.approx(
        0.01 * problems.CAMERA.fx
    )
    assert Exposure(problems.CAMERA, Config()).smeared_px(np.ones(6)) == 0.0


@pytest.mark.parametrize("seconds", [0.015, 0.02, 0.03])
def test_the_exposure_shows_in_how_much_wider_edges_are_that_move_the_more(seconds):
    assert learned(exposure(), seconds=seconds, count=8) == pytest.approx(seconds, rel=0.15)


def test_texture_that_is_soft_by_itself_is_not_smeared():
    assert learned(exposure(), seconds=0.0, count=20) == 0
    measured = exposure()
    assert learned(measured, seconds=0.5 * LEAST_S, count=20) == 0  # too little to matter
    assert 0 < measured.estimate.likely < LEAST_S**2


def test_a_camera_at_one_velocity_says_nothing():
    measured = exposure()
    assert learned(measured, key_velocity=VELOCITY) == 0
    assert measured.estimate.variance == pytest.approx(exposure().estimate.variance, rel=1e-2)


def test_no_more_than_a_frame_can_last_is_believed():
    assert learned(exposure(), seconds=1.05 * LARGEST_S, count=40) == LARGEST_S
    assert learned(exposure(), seconds=2 * LARGEST_S, count=40) == 0  # it is something else


def test_edges_that_were_gathered_or_that_are_few_tell_nothing():
    measured = exposure()
    assert learned(measured, gathered=600) == 0
    assert learned(measured, n=2 * ENOUGH - 2) == 0
    assert measured.estimate.likely == 0
    learned(measured, n=2 * ENOUGH + 2, count=1)
    assert measured.estimate.likely > 0


def test_it_is_forgotten():
    measured = exposure()
    assert learned(measured, count=8)
    assert len(measured.sharpness(moment(0)[0].seen.samples, VELOCITY))
    measured.forget()
    assert measured.seconds == 0
    assert not len(measured.sharpness(moment(0)[0].seen.samples, VELOCITY))


@pytest.mark.parametrize("soft_px", [2.5, 4.0])
def test_texture_that_is_soft_by_itself_is_softer_from_nearer(soft_px):
    """Where the camera has come nearer its edges move faster, too; none of it is smear."""
    rng = np.random.default_rng(0)
    scale, size = 4, (1536, 2048)
    texture = np.full(size, 120, np.float32)
    for _ in range(500):
        centre, radius = rng.uniform((0, 0), size[::-1]), rng.uniform(40, 160)
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 6)))
        corners = centre + radius * np.column_stack((np.cos(angles), np.sin(angles)))
        cv2.fillPoly(texture, [corners.astype(np.int32)], float(rng.uniform(20, 235)))
    texture = cv2.GaussianBlur(texture, (0, 0), soft_px * scale)
    odometry = Odometry(CAMERA, Config())
    for k in range(75):
        z = 1.5 - 0.5 * np.sin(2 * np.pi * 0.3 * k / 30) ** 2
        s = 1.5 / z / scale
        middle = CAMERA.cx - s * size[1] / 2, CAMERA.cy - s * size[0] / 2
        shown = np.array([[s, 0, middle[0]], [0, s, middle[1]]])
        grey = cv2.warpAffine(texture, shown, (320, 240), flags=cv2.INTER_AREA)
        grey = np.clip(grey + rng.normal(0, 1, grey.shape), 0, 255).astype(np.uint8)
        odometry.track(Frame(k / 30, grey, np.full(grey.shape, z, np.float32)))
        assert odometry.exposure == 0


def test_once_it_matters_it_does_so_down_to_a_little_less():
    measured = exposure()
    assert learned(measured, seconds=1.2 * LEAST_S, count=20) > LEAST_S
    for seconds, matters in ((0.85, True), (0.5, False), (0.85, False)):
        for _ in range(10):
            learned(measured, seconds=seconds * LEAST_S, count=20)
        assert (measured.seconds > LASTING * LEAST_S) is matters


def test_what_is_not_seen_for_long_is_forgotten():
    measured = exposure()
    assert learned(measured, count=8)
    for _ in range(1800):
        measured.learn(*moment(0, n=10))
    assert measured.seconds == 0


def test_what_is_known_is_not_measured():
    measured = exposure(*known(0.012))
    learned(measured)
    assert measured.seconds == 0.012
    assert measured.estimate.likely == 0
    measured.forget()
    assert measured.seconds == 0.012
    assert exposure(*known(0.005)).seconds == 0  # too little to matter


@pytest.mark.parametrize("asked", ["motion.exposure=none", "registration.profile_spread=0"])
def test_nothing_is_measured_where_nobody_asks(asked):
    measured = exposure(asked)
    assert learned(measured) == 0
    assert not measured.is_on
    assert exposure(*known(0.02), "registration.profile_spread=0").seconds == 0


def test_images_without_profiles_tell_nothing():
    measured = exposure()
    given, key_velocity = moment(0)
    bare = EdgePixels(*(getattr(given.seen.samples, k) for k in ("pixels", "gradients", "depths")))
    measured.learn(replace(given, seen=SimpleNamespace(samples=bare)), key_velocity)
    assert measured.estimate.likely == 0


def test_paper_takes_images_as_instants():
    paper = Config.preset("paper")
    assert (paper.motion.exposure, paper.edges.smear) == ("none", "none")


# ------------------------------------------------------------------------------------- sequences


@cache
def clip(exposed_s, scene="texture_near", *, speed=0.6, frames=45):
    """Frames, shared, so not to be changed."""
    recipe = make_recipe(
        scene,
        frames=frames,
        camera=CAMERA,
        speed=speed,
        shutter=Shutter(exposure=exposed_s, steps=5 if exposed_s else 1),
        seed=4,
    )
    source = SyntheticSource(recipe)
    return tuple(source.read(i).frame for i in range(frames))


def follow(frames, *overrides):
    odometry = Odometry(CAMERA, Config().with_overrides(overrides))
    return [odometry.track(frame) for frame in frames], odometry


def test_nothing_is_left_to_be_compiled_when_images_are_smeared():
    warm_up(Config())
    compiled = kernels.write_sharpness, kernels.smear_change
    before = [len(kernel.signatures) for kernel in compiled]
    assert min(before) > 0
    follow(clip(0.0)[:6], *known(0.02))
    follow(clip(0.0)[:6])
    assert [len(kernel.signatures) for kernel in compiled] == before


def test_the_exposure_of_a_camera_is_measured():
    frames = clip(0.03, "notexture_near", speed=0.8, frames=30)
    results, odometry = follow(frames, "edges.smear=measured")
    assert 0.012 < odometry.exposure < 0.035  # the most smeared edges are not found
    assert max(result.edge_passes for result in results) > 0
    trust = results[-1].alignment.trust
    assert np.percentile(trust, 5) < 0.8  # as smeared edges count
    odometry.reset()
    assert odometry.exposure == 0
    alike, odometry = follow(frames, "motion.exposure=none")
    assert odometry.exposure == 0
    assert {result.edge_passes for result in alike} == {0}


def test_a_camera_that_exposes_for_an_instant_is_followed_as_ever():
    frames = clip(0.0)
    results, odometry = follow(frames)
    assert odometry.exposure == 0
    others, _ = follow(frames, "motion.exposure=none")
    for result, other in zip(results, others, strict=True):
        np.testing.assert_array_equal(result.T_world_cam, other.T_world_cam)


def test_what_is_out_of_focus_is_not_taken_to_be_smeared():
    soft = [replace(f, grey=cv2.GaussianBlur(f.grey, (0, 0), 1.5)) for f in clip(0.0)]
    results, odometry = follow(soft, "edges.smear=measured")
    assert odometry._front_end._smear._variance > 1  # wide enough to be blurred by more
    assert odometry.exposure == 0
    assert {result.edge_passes for result in results} == {0}
    results, _ = follow(soft, "edges.smear=measured", "motion.exposure=none")
    assert max(result.edge_passes for result in results) > 0


def test_it_is_known_once_it_is_certain_to_a_third():
    measured = exposure("motion.exposure=measured")
    assert not measured.is_known
    for seed in range(40):
        measured.learn(*moment(seed))
    assert measured.is_known
    assert measured.seconds == pytest.approx(EXPOSED_S, rel=0.3)
    measured.forget()
    assert not measured.is_known
    assert exposure(*known(0.02)).is_known  # nobody asks


def test_it_fades_by_the_time_since_the_frame_before_that_told():
    often, seldom = (exposure("motion.exposure=measured") for _ in range(2))
    for _ in range(12):
        often.learn(*moment(0), PERIOD)
        seldom.learn(*moment(0), 20 * PERIOD)
    assert seldom.estimate.variance > 1.5 * often.estimate.variance
