"""Edges across a motion that lie nowhere near their places: how they are noticed, and found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.grain import SCENES
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.chamfer import ChamferMap
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.edges import EdgePixels
from edvo.evidence import ALIKE, Evidence
from edvo.odometry import Odometry, Status
from edvo.planes import camera_of
from edvo.registration import REASONS, Alignment, Registration
from edvo.synthesis.scene import load_scene
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins

CAMERA, SIGMA, DEPTH = problems.VGA, 0.1, 1.5
REACH = Config().motion.along_px
UP = np.array([0, 1.0, 0, 0, 0, 0])


def slats(level: tuple[float, ...] = (150.0, 260.0)) -> EdgePixels:
    """Long upright edges all over a wall, and short ones that lie level at these rows."""
    v = np.arange(10, 470, 2.0)
    upright = [np.column_stack((np.full(len(v), u), v)) for u in range(20, 620, 25)]
    u = np.arange(300, 360, 2.0)
    lying = [np.column_stack((u, np.full(len(u), row))) for row in level]
    pixels = np.concatenate(upright + lying).astype(np.float32)
    gradients = np.zeros_like(pixels)
    gradients[: len(v) * len(upright), 0] = gradients[len(v) * len(upright) :, 1] = 1
    return EdgePixels(pixels, gradients, np.full(len(pixels), DEPTH, np.float32))


def up_by(edges: EdgePixels, px: float) -> EdgePixels:
    """Draw what a camera sees that is as much higher: all is that much lower."""
    pixels = edges.pixels + np.array([0, px], np.float32)
    return replace(edges, pixels=pixels.astype(np.float32))


def registered(reference: EdgePixels, samples: EdgePixels) -> tuple[Alignment, Evidence]:
    """A registration that has stayed where the camera was, each edge with the nearest one."""
    config = Config()
    registration = Registration(CAMERA, config.matching, config.registration)
    found = registration.align(registration.index(reference), samples, np.eye(4)[None])
    apart = samples.pixels[:, None] - reference.pixels
    matches = (apart**2).sum(2).argmin(1).astype(np.int32)
    normals = reference.gradients[matches]
    off = (samples.pixels - reference.pixels[matches]).astype(np.float64)
    residuals = (normals * off).sum(1)
    seen = SimpleNamespace(
        points=samples.points(CAMERA), matched=np.ones(len(samples), bool), normals=normals
    )
    J = twins.jacobian(seen, CAMERA)[np.abs(residuals) < SIGMA]
    found = replace(
        found,
        reason=REASONS[kernels.CONVERGED],
        T_ref_cur=np.eye(4),
        H=J.T @ J,
        matches=matches,
        residuals=residuals,
        trust=np.ones(len(samples)),
        sigma_px=SIGMA,
    )
    return found, Evidence(CAMERA, registration.solver, config.status.min_told)


@pytest.mark.parametrize("rim", [0.0, 8.0, 60.0])
def test_what_is_amiss_is_that_of_the_twin(rim: float) -> None:
    rng, n, m = np.random.default_rng(4), 400, 300
    angles = rng.uniform(0, 2 * np.pi, n + m)
    gradients = np.column_stack((np.cos(angles), np.sin(angles))).astype(np.float32)
    own, others = gradients[:n].copy(), gradients[n:].copy()
    own[9] = 0
    pixels = rng.uniform((0, 0), (639, 479), (n, 2)).astype(np.float32)
    points = EdgePixels(pixels, own, rng.uniform(1, 3, n).astype(np.float32)).points(CAMERA)
    points[7, 2] = -1.0
    matches = rng.integers(0, m, n).astype(np.int32)
    close = rng.random(n) < 0.4  # of so many the match is turned as they are
    others[matches[close]] = own[close]
    matches[rng.random(n) < 0.1] = -1
    residuals, trust = rng.normal(0, 0.3, n), rng.uniform(0.3, 2, n)
    residuals[matches < 0] = np.nan
    T = problems.motion(rng, 0.1, 20.0)
    rows, amiss = np.full((n, 6), np.nan), np.full(n, 7, np.uint8)
    places = kernels.Places(0.3, ALIKE, rim)
    given = points, own, others, matches, residuals, trust, camera_of(CAMERA), T, places
    kernels.find_amiss(*given, rows, amiss)
    expected_rows, expected = twins.amiss(
        points, own, others, matches, trust * residuals, CAMERA, T, *places
    )
    np.testing.assert_allclose(rows, expected_rows, rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(amiss, expected)
    assert 0.1 < amiss.mean() < 0.9
    # and what is left of the curvature, against the eigenvalues
    config = Config()
    solver = Registration(CAMERA, config.matching, config.registration).solver
    H, enough = rows.T @ rows, rng.uniform(0, 0.1, 6)
    told, left = np.empty((6, 6)), np.empty((6, 6))
    answers = set()
    for times in (0.01, 0.5, 1.0, 3.0):
        is_amiss = kernels.is_amiss(*given, solver, SIGMA, H, enough, times, told, left)
        J = rows[amiss > 0]
        np.testing.assert_allclose(told, H + SIGMA**2 * np.diag(enough))
        np.testing.assert_allclose(left, J.T @ J, rtol=1e-9, atol=1e-6)
        assert is_amiss == (np.linalg.eigvalsh(times * told - left)[0] <= 0)
        answers.add(is_amiss)
    assert answers == {True, False}


@pytest.mark.parametrize("px", [-14.0, 18.0, 25.0])
@pytest.mark.parametrize("new", [0, 1, 3])
def test_edges_that_fit_upright_ones_are_amiss_and_are_found_where_they_belong(
    px: float, new: int
) -> None:
    """Level edges are nearest to upright ones there, which have no residual.

    And of so many in five upright edges there is no match: they tell nothing of a way up or down.
    """
    reference = slats()
    samples = up_by(reference, px)
    found, evidence = registered(reference, samples)
    is_new = (np.arange(len(samples)) % 5 < new) & (samples.gradients[:, 0] > 0)
    found = replace(
        found,
        matches=np.where(is_new, -1, found.matches).astype(np.int32),
        residuals=np.where(is_new, np.nan, found.residuals),
    )
    assert np.mean(np.abs(found.residuals[~is_new]) < SIGMA) > 0.97
    assert len(evidence.untold(reference, samples, found)) == 0
    amiss = evidence.amiss(reference, samples, found)
    assert amiss is not None
    np.testing.assert_array_equal(amiss.across, samples.gradients[:, 1] > 0)
    few = samples.where(amiss.across)
    T = ChamferMap(reference, CAMERA).along(few, found.T_ref_cur, amiss.twist, REACH)
    assert T is not None
    there = few.points(CAMERA) @ T[:3, :3].T + T[:3, 3]
    v = CAMERA.fy * there[:, 1] / there[:, 2] + CAMERA.cy
    np.testing.assert_allclose(v, few.pixels[:, 1] - px, atol=4.0)  # a cell


def test_where_all_are_in_their_places_nothing_is_amiss() -> None:
    reference = slats()
    found, evidence = registered(reference, reference)
    assert evidence.amiss(reference, reference, found) is None


def test_nobody_asks_or_nothing_was_found() -> None:
    reference = slats()
    samples = up_by(reference, 18.0)
    found, evidence = registered(reference, samples)
    for other in (
        replace(found, reason=REASONS[kernels.SINGULAR]),
        replace(found, sigma_px=0.0),
        replace(found, H=np.full((6, 6), np.nan)),
    ):
        assert evidence.amiss(reference, samples, other) is None
    config = Config()
    registration = Registration(CAMERA, config.matching, config.registration)
    nobody = Evidence(CAMERA, registration.solver, 0.0)
    assert nobody.amiss(reference, samples, found) is None


def along(reference: EdgePixels, px: float) -> NDArray[np.float64] | None:
    edges = slats(level=(240.0,))
    few = up_by(edges.where(edges.gradients[:, 1] > 0), px)
    return ChamferMap(reference, CAMERA).along(few, np.eye(4), UP * DEPTH / CAMERA.fy, REACH)


def test_where_two_places_fit_or_none_does_better_it_is_neither() -> None:
    assert along(slats(level=(240.0,)), 20.0) is not None
    assert along(slats(level=(220.0, 260.0)), 0.0) is None  # above and below
    assert along(slats(level=(240.0,)), 1.0) is None  # where it is already
    assert along(slats(level=(240.0,)), 2 * REACH) is None  # too far


def test_before_slats_a_few_shelves_hold_the_camera() -> None:
    recipe = make_recipe(load_scene(SCENES / "slats.yaml"), frames=16, speed=0.4, seed=2)
    source, indices = SyntheticSource(recipe), range(9, 16)
    frames = [reading.frame for reading in read_ahead(source, indices)]
    off = {}
    for reach in (REACH, 0.0):
        odometry = Odometry(source.camera, Config().with_overrides([f"motion.along_px={reach}"]))
        results = [odometry.track(frame) for frame in frames if frame is not None]
        truth = [recipe.motion.at(result.timestamp) for result in results]
        off[reach] = [
            problems.error(se3.inverse(truth[0]) @ T, result.T_world_cam)[0]
            for T, result in zip(truth, results, strict=True)
        ]
        if reach:
            assert {result.status for result in results} == {Status.TRACKED}
    assert max(off[REACH]) < 0.002
    assert max(off[0.0]) > 0.01
