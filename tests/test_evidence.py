"""Evidence that is left out: which motions edges could tell, but those that do fit nowhere."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import kernels, robust, se3
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.edges import EdgePixels
from edvo.evidence import Evidence
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.planes import NO_PLANES, NO_POINTS
from edvo.registration import EDGES_ALONE, REASONS, Registration
from edvo.synthesis.sequence import Recipe, SyntheticSource, make_recipe
from edvo.uncertainty import Uncertainty, degenerate_directions, describe

from . import problems, twins

CAMERA, SIGMA = problems.VGA, 0.1
UPRIGHT = 600
FAR = 10.0  # px: no edge counts that is so far off


def panels(level: int, seed: int = 0) -> EdgePixels:
    """Upright edges, and so many that lie level, between one and three metres away."""
    rng, n = np.random.default_rng(seed), UPRIGHT + level
    gradients = np.zeros((n, 2), np.float32)
    gradients[:UPRIGHT, 0] = gradients[UPRIGHT:, 1] = 1
    pixels = rng.uniform((20, 20), (620, 460), (n, 2)).astype(np.float32)
    return EdgePixels(pixels, gradients, rng.uniform(1, 3, n).astype(np.float32))


def registered(edges: EdgePixels, off: NDArray[np.float64], weight: str = "tukey"):
    """A registration of edges with themselves, but for residuals of that many pixels."""
    config = Config().with_overrides([f"registration.weight={weight}"])
    registration = Registration(CAMERA, config.matching, config.registration)
    found = registration.align(registration.index(edges), edges, np.eye(4)[None])
    n, tuning = len(edges), registration.solver.tuning

    def weights(normalized: NDArray[np.float64]) -> NDArray[np.float64]:
        most = robust.weights(np.zeros(1), weight, tuning)[0]
        return robust.weights(normalized, weight, tuning) / most

    seen = SimpleNamespace(
        points=edges.points(CAMERA), matched=np.ones(n, bool), normals=edges.gradients
    )
    left = twins.left_out(seen, CAMERA, off, np.ones(n), weights, SIGMA)
    J = twins.jacobian(seen, CAMERA)
    found = replace(
        found,
        T_ref_cur=np.eye(4),
        H=J.T @ J - left,
        matches=np.arange(n, dtype=np.int32),
        residuals=off,
        trust=np.ones(n),
        sigma_px=SIGMA,
    )
    return registration, found, left


def untold(edges: EdgePixels, off: NDArray[np.float64], least: float = 0.25):
    registration, found, _ = registered(edges, off)
    return Evidence(CAMERA, registration.solver, least).untold(edges, edges, found)


def off_where(level: int, share: float) -> NDArray[np.float64]:
    """No upright edge is off, and of those that lie level so many."""
    off = np.zeros(UPRIGHT + level)
    off[UPRIGHT : UPRIGHT + round(share * level)] = FAR
    return off


@pytest.mark.parametrize("weight", ["tukey", "huber", "cauchy", "t", "none"])
def test_what_is_left_out_is_that_of_the_twin(weight: str) -> None:
    edges, rng = panels(200), np.random.default_rng(1)
    registration, found, left = registered(edges, rng.normal(0, 0.4, UPRIGHT + 200), weight)
    written = np.empty((6, 6))
    for times in (0.2, 1.0, 5.0, 500.0):
        is_told = kernels.is_told(
            edges.points(CAMERA),
            edges.gradients,
            found.matches,
            found.residuals,
            found.trust,
            registration._pinhole,
            found.T_ref_cur,
            registration.solver,
            SIGMA,
            found.H,
            times,
            written,
        )
        np.testing.assert_allclose(written, left, rtol=1e-9, atol=1e-6 * abs(left).max() + 1e-9)
        assert is_told == (np.linalg.eigvalsh(times * found.H - left)[0] > 0)


def test_where_edges_that_lie_level_are_left_out_ways_up_and_down_are_not_told() -> None:
    ways = untold(panels(100), off_where(100, 1.0))
    assert len(ways) == 1 or len(ways) == 2  # a way up, and a turn that looks all but like it
    for v, w in (np.split(way, 2) for way in ways):
        assert np.linalg.norm(v + w) == pytest.approx(1, abs=1)
        assert abs(v[0]) < 0.1 * abs(v[1])
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1)


@pytest.mark.parametrize("level", [30, 100, 600])
@pytest.mark.parametrize(("share", "is_told"), [(0.0, True), (0.5, True), (0.9, False)])
def test_it_is_the_share_that_counts(level: int, share: float, is_told: bool) -> None:
    assert (len(untold(panels(level), off_where(level, share))) == 0) == is_told


def test_nobody_asks_or_nothing_was_found() -> None:
    edges, off = panels(100), off_where(100, 1.0)
    assert len(untold(edges, off, least=0)) == 0
    registration, found, _ = registered(edges, off)
    evidence = Evidence(CAMERA, registration.solver, 0.25)
    failed = replace(found, reason=REASONS[kernels.SINGULAR])
    assert len(evidence.untold(edges, edges, failed)) == 0
    by_depth = replace(found, sigma_px=0.0)
    assert len(evidence.untold(edges, edges, by_depth)) == 0


def test_what_is_not_told_is_not_known() -> None:
    """The covariance says so, and names the motion."""
    edges = panels(100)
    names = []
    for share in (0.0, 1.0):
        registration, found, _ = registered(edges, off_where(100, share))
        uncertainty = Uncertainty(CAMERA, Config(), registration.solver)
        index = registration.index(edges)
        C = uncertainty.covariance(index, edges, NO_PLANES, NO_POINTS, EDGES_ALONE, found)
        names.append([describe(way) for way in degenerate_directions(C)])
    assert names[0] == []
    assert any("translation along y" in name for name in names[1])


# ------------------------------------------------------------------------------- in motion


@dataclass(frozen=True)
class Nod:
    """A camera that nods, so that what tells how high it looks goes out of view and comes back."""

    start: NDArray[np.float64]
    duration: float = float("inf")

    def at(self, t: float) -> NDArray[np.float64]:
        phase = np.sin(1.6 * np.pi * t)
        aside = se3.exp(np.array([0.2 * t, -0.1 * phase, 0, 0, 0, 0]))
        return self.start @ aside @ se3.exp(np.array([0, 0, 0, np.radians(12) * phase, 0, 0]))


@pytest.fixture(scope="module")
def nodding() -> tuple[Recipe, list[Frame]]:
    recipe = make_recipe("notexture_far", frames=40, seed=1)
    recipe = replace(recipe, motion=Nod(recipe.motion.at(0.0)))
    readings = read_ahead(SyntheticSource(recipe), range(40))
    return recipe, [reading.frame for reading in readings if reading.frame is not None]


def followed(nodding: tuple[Recipe, list[Frame]], *changes: str):
    """How far it is off in the end, m, and what was said on the way."""
    recipe, frames = nodding
    odometry = Odometry(recipe.camera, Config().with_overrides(changes))
    results = [odometry.track(frame) for frame in frames]
    truth = [recipe.motion.at(result.timestamp) for result in results]
    off, _ = problems.error(se3.inverse(truth[0]) @ truth[-1], results[-1].T_world_cam)
    return off, [result.status for result in results]


def test_a_camera_that_nods_at_panels_is_followed(nodding: tuple[Recipe, list[Frame]]) -> None:
    off, statuses = followed(nodding)
    assert off < 0.005
    assert set(statuses) == {Status.TRACKED}
    off, statuses = followed(nodding, "status.min_told=0", "motion.inertia=none")
    assert off > 0.1
