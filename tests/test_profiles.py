"""What edges look like across, and what those count that look otherwise than their matches."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from edvo.config import Config, EdgesConfig, RegistrationConfig
from edvo.edges import EdgePixels, extract_edges
from edvo.gathering import unknown
from edvo.kernels import LINE_DIRECTIONS
from edvo.matching import EdgeIndex

from . import problems
from .test_registration import moved, register
from .twins import directions_of

BLUR = 1.0  # px^2, the variance of the binomial blur that gradients are taken of,
BOX = 1 / 3  # and of what their central difference takes the mean over


def step(sigma, dark=60.0, bright=160.0, at=31.3, size=64):
    """A step that a Gaussian has blurred, as a grey image."""
    u = np.arange(size)
    row = dark + (bright - dark) * 0.5 * (1 + erf((u - at) / (np.sqrt(2) * sigma)))
    return np.tile(np.round(row).astype(np.uint8), (size, 1))


def profile(grey):
    camera = replace(problems.CAMERA, width=64, height=64, cx=31.5, cy=31.5)
    edges = extract_edges(grey, Config().edges).describe(camera)
    inside = (edges.pixels[:, 1] > 5) & (edges.pixels[:, 1] < 58)
    assert inside.sum() > 40
    return np.median(edges.profiles[inside], axis=0)


def some(count, seed=0, known=True):
    rng = np.random.default_rng(seed)
    profiles = rng.normal(size=(count if known else 0, 2)).astype(np.float32)
    return replace(problems.random_edges(rng, count), profiles=profiles)


# --------------------------------------------------------------------------------- what it tells


@pytest.mark.parametrize("sigma", [1.2, 1.6, 2.2])
def test_the_bend_of_a_step_tells_how_wide_it_is(sigma):
    assert profile(step(sigma))[1] == pytest.approx(-1 / (sigma**2 + BLUR + BOX), rel=0.06)


def test_light_changes_the_height_of_all_alike_and_no_bend():
    full, half = profile(step(1.5, 40, 200)), profile(step(1.5, 20, 100))
    assert full[0] - half[0] == pytest.approx(np.log(2), abs=0.02)
    assert full[1] == pytest.approx(half[1], rel=0.03)


def test_where_it_lies_between_pixels_makes_no_difference():
    found = np.array([profile(step(1.5, at=31 + share)) for share in np.linspace(0, 1, 5)])
    np.testing.assert_allclose(found, np.tile(found[0], (5, 1)), atol=0.02)


def test_edges_on_pixels_have_none():
    edges = extract_edges(step(1.5), EdgesConfig(position="pixel")).describe(problems.CAMERA)
    assert edges.profiles.shape == (0, 2)
    assert len(edges)


# ------------------------------------------------------------------------------ taking some edges


@pytest.mark.parametrize("known", [True, False])
def test_some_edges_keep_what_is_known_of_them(known):
    edges = some(20, known=known)
    chosen = np.arange(20) % 3 == 0
    for part, which in (
        (edges.every(3), np.arange(0, 20, 3)),
        (edges.first(7), np.arange(7)),
        (edges.where(chosen), np.flatnonzero(chosen)),
        (edges.where(np.array([4, 2])), np.array([4, 2])),
        (edges.where(chosen & False), np.array([], int)),
    ):
        np.testing.assert_array_equal(part.pixels, edges.pixels[which])
        np.testing.assert_array_equal(part.profiles, edges.profiles[which if known else []])
        assert part.profiles.flags.c_contiguous
        assert part.profiles.ndim == 2


def test_joined_edges_have_profiles_where_all_of_them_do():
    both = some(5).joined(some(3, 1))
    np.testing.assert_array_equal(both.profiles, [*some(5).profiles, *some(3, 1).profiles])
    assert some(5).joined(some(3, 1, known=False)).profiles.shape == (0, 2)
    assert some(5, known=False).joined(some(3, 1)).profiles.shape == (0, 2)
    none = EdgePixels(*(np.empty((0, *shape), np.float32) for shape in ((2,), (2,), ())))
    np.testing.assert_array_equal(some(5).joined(none).profiles, some(5).profiles)


def test_edges_that_nobody_knows_keep_theirs():
    edges = some(50)
    new = unknown(EdgeIndex(edges.first(20)), edges, problems.VGA)
    assert len(new) == len(new.profiles)
    assert {tuple(row) for row in new.profiles} <= {tuple(row) for row in edges.profiles[20:]}


# -------------------------------------------------------------------------------- what it is worth


def changed(seed, height=0.5, bend=0.0, off_px=0.4):
    """A third of the edges look otherwise, and lie elsewhere along their normals."""
    problem = moved(seed, count=900)
    rng = np.random.default_rng(seed)
    reference, samples = problem.reference, problem.samples
    which = rng.random(len(samples)) < 1 / 3
    pixels = samples.pixels + rng.normal(0, 0.05, samples.pixels.shape)
    pixels += np.where(which[:, None], off_px * samples.gradients, 0)
    profiles = rng.normal(0, 0.03, (len(samples), 2)) + which[:, None] * np.array([height, bend])
    known = np.zeros((len(reference), 2), np.float32)
    problem.reference = replace(reference, profiles=known)
    problem.samples = replace(
        samples, pixels=pixels.astype(np.float32), profiles=profiles.astype(np.float32)
    )
    return problem, which


@pytest.mark.parametrize(("height", "bend"), [(0.5, 0.0), (0.0, -0.5), (-0.4, 0.4)])
def test_what_looks_otherwise_drags_the_pose_less(height, bend):
    errors = np.zeros((4, 2))
    for seed in range(4):
        problem, which = changed(seed, height, bend)
        for k, spread in enumerate((3.0, 0.0)):
            found = register(problem, profile_spread=spread)
            errors[seed, k] = problems.error(problem.T_ref_cur, found.T_ref_cur)[0]
            matched = found.matches >= 0
            trust = found.trust[matched], found.trust[matched & which]
            assert np.median(trust[0]) == pytest.approx(1.0, abs=0.3)
            assert (np.median(trust[1]) < 0.4) == (spread > 0)
            assert (found.trust[~matched] == 1).all()
    assert errors[:, 0].mean() < 0.6 * errors[:, 1].mean()


def test_what_changes_all_edges_alike_changes_nothing():
    problem, _ = changed(1)
    before = register(problem)
    samples = problem.samples
    brighter = (samples.profiles + np.float32([0.75, -0.25])).astype(np.float32)
    problem.samples = replace(samples, profiles=brighter)
    after = register(problem)
    np.testing.assert_allclose(after.T_ref_cur, before.T_ref_cur, atol=1e-7)
    np.testing.assert_allclose(after.trust, before.trust, rtol=1e-4)


def test_what_changes_all_of_a_direction_alike_changes_nothing():
    """As blur does, of edges across which the camera moves: else they held the pose no longer."""
    problem, _ = changed(1, height=0.0)
    before = register(problem)
    samples = problem.samples
    level = directions_of(samples.gradients) % LINE_DIRECTIONS == 1
    assert 0.1 < level.mean() < 0.5
    softer = samples.profiles + level[:, None] * np.float32([-0.75, 0.25])
    problem.samples = replace(samples, profiles=softer.astype(np.float32))
    after = register(problem)
    np.testing.assert_allclose(after.trust, before.trust, rtol=1e-4)
    few = np.flatnonzero(level)[::15]  # that do tell of no blur
    assert len(few) < 20
    odd = samples.profiles.copy()
    odd[few] += np.float32([-0.75, 0.25])
    problem.samples = replace(samples, profiles=odd)
    assert (register(problem).trust[few] < 0.4).mean() > 0.8


@pytest.mark.parametrize("side", ["reference", "samples"])
def test_what_one_image_does_not_tell_counts_alike(side):
    problem, _ = changed(2)
    edges = getattr(problem, side)
    setattr(problem, side, replace(edges, profiles=np.empty((0, 2), np.float32)))
    found, plain = register(problem), register(problem, profile_spread=0.0)
    np.testing.assert_array_equal(found.T_ref_cur, plain.T_ref_cur)
    assert (found.trust == 1).all()


def test_residuals_are_told_as_they_are():
    """Inliers and clarity are of pixels, not of what they are weighed by."""
    problem, _ = changed(3)
    found = register(problem)
    matched = found.matches >= 0
    points = problem.samples.points(problem.camera)[matched]
    Y = points @ found.T_ref_cur[:3, :3].T + found.T_ref_cur[:3, 3]
    camera = problem.camera
    pixels = Y[:, :2] / Y[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    edge = found.matches[matched]
    off = pixels - problem.reference.pixels[edge]
    expected = (off * problem.reference.gradients[edge]).sum(axis=1)
    np.testing.assert_allclose(found.residuals[matched], expected, atol=0.02)


def test_the_paper_knows_none():
    assert Config.preset("paper").registration.profile_spread == 0
    assert RegistrationConfig().profile_spread > 0
