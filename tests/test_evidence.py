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
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.planes import NO_PLANES, NO_POINTS
from edvo.registration import AT_ONCE, EDGES_ALONE, REASONS, Registration
from edvo.synthesis.sequence import SyntheticSource, make_recipe
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


def weights_by(weight: str, tuning: float):
    return lambda normalized: robust.weights(normalized, weight, tuning)


def registered(edges: EdgePixels, off: NDArray[np.float64]):
    """A registration of edges with themselves, but for residuals of that many pixels."""
    config, n = Config(), len(edges)
    registration = Registration(CAMERA, config.matching, config.registration)
    found = registration.align(registration.index(edges), edges, np.eye(4)[None])
    weights = weights_by(config.registration.weight, registration.solver.tuning)
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
    return registration, found


def untold(edges: EdgePixels, off: NDArray[np.float64], least: float = 0.25):
    registration, found = registered(edges, off)
    return Evidence(CAMERA, registration.solver, least).untold(edges, edges, found)


def off_where(level: int, share: float) -> NDArray[np.float64]:
    """No upright edge is off, and of those that lie level so many."""
    off = np.zeros(UPRIGHT + level)
    off[UPRIGHT : UPRIGHT + round(share * level)] = FAR
    return off


@pytest.mark.parametrize("weight", ["tukey", "huber", "cauchy", "t", "none"])
def test_what_is_left_out_is_that_of_the_twin(weight: str) -> None:
    rng, n = np.random.default_rng(1), 300
    config = Config().with_overrides([f"registration.weight={weight}"])
    registration = Registration(CAMERA, config.matching, config.registration)
    angle = rng.uniform(0, 2 * np.pi, 500)
    gradients = np.column_stack((np.cos(angle), np.sin(angle))).astype(np.float32)
    points = panels(0).points(CAMERA)[:n]
    points[7, 2] = -1.0  # behind the camera
    matches = rng.integers(0, 500, n).astype(np.int32)
    matches[rng.random(n) < 0.1] = -1
    residuals, trust = rng.normal(0, 0.4, n), rng.uniform(0.3, 2, n)
    residuals[matches < 0] = np.nan
    T = problems.motion(rng, 0.1, 8.0)
    there = (matches >= 0) & (np.arange(n) != 7)
    seen = SimpleNamespace(
        points=points @ T[:3, :3].T + T[:3, 3], matched=there, normals=gradients[matches[there]]
    )
    weights = weights_by(weight, registration.solver.tuning)
    left = twins.left_out(seen, CAMERA, residuals[there], trust[there], weights, SIGMA)
    J = trust[there, None] * twins.jacobian(seen, CAMERA)
    H = (J * weights((trust * residuals)[there] / SIGMA)[:, None]).T @ J
    enough = rng.uniform(0, 0.1, 6) * np.diag(H)
    told = H + SIGMA**2 * np.diag(enough)
    with_enough, written = np.empty((6, 6)), np.empty((6, 6))
    for times in (0.2, 1.0, 5.0, 500.0):
        is_told = kernels.is_told(
            points,
            gradients,
            matches,
            residuals,
            trust,
            registration._pinhole,
            T,
            registration.solver,
            SIGMA,
            H,
            enough,
            times,
            with_enough,
            written,
        )
        np.testing.assert_allclose(with_enough, told, rtol=1e-12)
        np.testing.assert_allclose(written, left, rtol=1e-6, atol=1e-9 * abs(told).max())
        assert is_told == (np.linalg.eigvalsh(times * told - left)[0] > 0)


def test_where_edges_that_lie_level_are_left_out_ways_up_and_down_are_not_told() -> None:
    ways = untold(panels(100), off_where(100, 1.0))
    assert len(ways) in (1, 2)  # a way up or down, and a nod that looks all but like it
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1)
    np.testing.assert_allclose(np.hypot(ways[:, 1], ways[:, 3]), 1, atol=0.05)


@pytest.mark.parametrize("level", [30, 100, 600])
@pytest.mark.parametrize(("share", "is_told"), [(0.0, True), (0.5, True), (0.9, False)])
def test_it_is_the_share_that_counts(level: int, share: float, is_told: bool) -> None:
    assert (len(untold(panels(level), off_where(level, share))) == 0) == is_told


def test_nobody_asks_or_nothing_was_found() -> None:
    edges, off = panels(100), off_where(100, 1.0)
    assert len(untold(edges, off, least=0)) == 0
    registration, found = registered(edges, off)
    evidence = Evidence(CAMERA, registration.solver, 0.25)
    failed = replace(found, reason=REASONS[kernels.SINGULAR])
    assert len(evidence.untold(edges, edges, failed)) == 0
    by_depth = replace(found, sigma_px=0.0)
    assert len(evidence.untold(edges, edges, by_depth)) == 0
    nonsense = replace(found, H=np.full((6, 6), np.nan))
    assert len(evidence.untold(edges, edges, nonsense)) == 0


def test_what_is_not_told_is_not_known() -> None:
    """The covariance says so, and names the motion."""
    edges = panels(100)
    names = []
    for share in (0.0, 1.0):
        registration, found = registered(edges, off_where(100, share))
        uncertainty = Uncertainty(CAMERA, Config(), registration.solver)
        index = registration.index(edges)
        C = uncertainty.covariance(index, edges, NO_PLANES, NO_POINTS, EDGES_ALONE, found)
        names.append([describe(way) for way in degenerate_directions(C)])
    assert names[0] == []
    assert any("translation along y" in name for name in names[1])


# ------------------------------------------------------------------------- a scale of their own


def scattered(level: int, scale: float) -> NDArray[np.float64]:
    """Upright edges scatter by sigma, those that lie level by a scale of their own."""
    rng = np.random.default_rng(4)
    return np.concatenate([rng.normal(0, SIGMA, UPRIGHT), rng.normal(0, scale, level)])


def own_scale(
    edges: EdgePixels, off: NDArray[np.float64], turned: float = 0.0, most_px: float = 3.0
):
    """What they count where such a share of those that lie level match upright ones."""
    registration, found = registered(edges, off)
    matches = found.matches.copy()
    matches[UPRIGHT : UPRIGHT + round(turned * (len(edges) - UPRIGHT))] = 0
    found = replace(found, matches=matches)
    own = Evidence(CAMERA, registration.solver, 0.25).own_scale(edges, edges, found, most_px)
    return None if own is None else own.factors


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_edges_that_scatter_more_count_by_how_they_scatter(scale: float) -> None:
    factors = own_scale(panels(200), scattered(200, scale))
    assert factors is not None
    assert np.median(factors[UPRIGHT:]) == pytest.approx(SIGMA / scale, rel=0.2)
    assert np.mean(factors[:UPRIGHT] == 1) > 0.9  # but for some that a nod moves, in the corners


@pytest.mark.parametrize("turned", [0.2, 0.5])
def test_edges_of_which_many_match_others_have_no_scale_of_their_own(turned: float) -> None:
    factors = own_scale(panels(200), scattered(200, 1.5), turned)
    assert (factors is None) == (turned > 0.3)


def test_nor_have_those_that_scatter_as_all_do_or_as_wrong_matches() -> None:
    assert own_scale(panels(200), scattered(200, SIGMA)) is None  # all is told
    assert own_scale(panels(200), scattered(200, 1.5)) is not None
    assert own_scale(panels(200), scattered(200, 1.5), most_px=1.0) is None


def test_by_a_scale_of_their_own_they_tell_where_the_camera_is() -> None:
    """Blurred as the camera moves up, they are off by pixels; the others hardly by any."""
    edges, rng = panels(200), np.random.default_rng(7)
    T = se3.exp(np.array([0, 0.012, 0, 0, 0, 0]))
    points = edges.points(CAMERA) @ T[:3, :3].T + T[:3, 3]
    pixels, depths = problems._project(CAMERA, points), points[:, 2]
    pixels[:UPRIGHT, 0] += rng.normal(0, 0.05, UPRIGHT)
    pixels[UPRIGHT:, 1] += rng.normal(0, 1.5, 200)
    looks = rng.normal(0, 1, (len(edges), 2)).astype(np.float32)
    edges = replace(edges, profiles=looks)
    samples = replace(edges, pixels=pixels.astype(np.float32), depths=depths.astype(np.float32))
    config = Config()
    registration = Registration(CAMERA, config.matching, config.registration)
    index, start = registration.index(edges), se3.inverse(T)[None]
    given = index, samples, start, NO_PLANES, NO_POINTS, EDGES_ALONE
    evidence = Evidence(CAMERA, registration.solver, config.status.min_told)
    alike = registration.align(*given)
    assert len(evidence.untold(edges, samples, alike))
    own = evidence.own_scale(edges, samples, alike, 3.0)
    assert own is not None
    weighed = registration.align(*given, AT_ONCE._replace(sharp=own.factors))
    assert not len(evidence.untold(edges, samples, weighed))
    assert problems.error(se3.inverse(T), weighed.T_ref_cur)[0] < 0.002


# ------------------------------------------------------------------------------- in motion


@dataclass(frozen=True)
class Nod:
    """A camera that nods, so that what tells how high it looks goes out of view and comes back."""

    start: NDArray[np.float64]
    turn: float  # degrees
    up: float  # m
    frequency: float  # Hz
    aside: float  # m/s
    duration: float = float("inf")

    def at(self, t: float) -> NDArray[np.float64]:
        phase = np.sin(2 * np.pi * self.frequency * t)
        T = self.start @ se3.exp(np.array([self.aside * t, -self.up * phase, 0, 0, 0, 0]))
        return T @ se3.exp(np.array([0, 0, 0, np.radians(self.turn) * phase, 0, 0]))


class Nodding:
    """Its frames, and how they are followed."""

    def __init__(self, scene: str, *how: float) -> None:
        recipe = make_recipe(scene, frames=40, seed=1)
        self.recipe = replace(recipe, motion=Nod(recipe.motion.at(0.0), *how))
        readings = read_ahead(SyntheticSource(self.recipe), range(40))
        self.frames = [reading.frame for reading in readings if reading.frame is not None]
        truth = [self.recipe.motion.at(frame.timestamp) for frame in self.frames]
        self.truth = [se3.inverse(truth[0]) @ T for T in truth]

    def followed(self, *changes: str) -> list[TrackedFrame]:
        odometry = Odometry(self.recipe.camera, Config().with_overrides(changes))
        return [odometry.track(frame) for frame in self.frames]

    def off(self, results: list[TrackedFrame]) -> float:
        """How far it is off in the end, m."""
        return problems.error(self.truth[-1], results[-1].T_world_cam)[0]


def test_a_camera_that_nods_at_panels_is_followed() -> None:
    nodding = Nodding("notexture_far", 12.0, 0.1, 0.8, 0.2)
    results = nodding.followed()
    assert nodding.off(results) < 0.005
    assert {result.status for result in results} == {Status.TRACKED}
    assert nodding.off(nodding.followed("status.min_told=0")) > 0.1


@pytest.fixture(scope="module")
def near() -> Nodding:
    """Half a second of it shows nothing that would tell how high it looks."""
    return Nodding("notexture_near", 25.0, 0.0, 0.6, 0.1)


def test_along_what_nothing_constrains_it_goes_on_as_it_went(near: Nodding) -> None:
    results = near.followed()
    assert near.off(results) < 0.001
    alone = "motion.along_px=0", "keyframes.tells_times=0"
    assert near.off(near.followed(*alone)) < 0.1
    assert near.off(near.followed(*alone, "motion.inertia=none")) > 0.5
    held = [
        result
        for result in results
        if result.alignment is not None
        and not result.is_keyframe
        and not np.array_equal(result.T_key_cur, result.alignment.T_ref_cur)
    ]
    assert len(held) > 5
    assert all(result.status is Status.DEGRADED for result in held)
    assert any("not constrained: translation along y" in result.reason for result in held)
