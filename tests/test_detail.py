"""How closely a frame is looked at, by what the frames of late share."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edvo.config import (
    Config,
    EdgesConfig,
    MatchingConfig,
    PlanesConfig,
    RegistrationConfig,
    SamplingConfig,
)
from edvo.detail import (
    BLURRED_PX,
    DEPTH_ENOUGH,
    EDGES_ENOUGH,
    usual_detail,
    worthwhile_detail,
)
from edvo.edges import EdgeBuffers, extract_edges
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, PlanePoints, thinned
from edvo.registration import Registration
from edvo.sampling import sample_edges
from edvo.sensor import DEPTH_NOISE
from edvo.sharing import SharedErrors

from . import problems
from .test_sharing import SIGMA, cell_of, edges, found, shared_errors, wall

NOISE = DEPTH_NOISE["kinect_v1"]
COARSE, FINE = 16.0, 8.0


class Told(SharedErrors):
    """What is shared, as it is told."""

    matches, edge_share, depth_share, scatter_px = 1500, math.nan, math.nan, 0.3

    def __init__(self, **told):
        for name, value in told.items():
            setattr(self, name, value)


def detail(*overrides, **told):
    config = Config().with_overrides(overrides)
    return worthwhile_detail(config, problems.VGA, Told(**told))


def test_the_usual_is_taken_where_nothing_is_known():
    assert detail()[:2] == usual_detail(Config())[:2] == (1500, False)
    assert usual_detail(Config.preset("paper")) == (450, False, False, False)


def test_faint_edges_count_where_frames_follow_and_the_keyframe_has_some():
    told = Told()
    for faint in (False, True):
        near = worthwhile_detail(Config(), problems.VGA, told, shows_faint=faint)
        assert (near.is_near, near.is_faint) == (True, faint)
    usual = usual_detail(Config())
    assert not usual.is_near
    assert not usual.is_faint


def fine_after_fine(depth_share):
    told = Told(depth_share=depth_share)
    return worthwhile_detail(Config(), problems.VGA, told, was_fine=True).is_fine


@pytest.mark.parametrize(
    ("share", "samples"),
    [
        (-0.001, 4500),
        (0.0, 4500),
        (EDGES_ENOUGH / 1501, 4500),
        (EDGES_ENOUGH / 1499, 1500),
        (0.1, 1500),
    ],
)
def test_more_samples_are_drawn_where_the_usual_share_little(share, samples):
    assert detail(edge_share=share).samples == samples
    assert detail("sampling.max_growth=1", edge_share=share).samples == 1500
    assert detail("sampling.max_growth=2", edge_share=share).samples == min(samples, 3000)
    assert detail("sampling.count=0", edge_share=share).samples == 0  # all there are
    few = detail("sampling.count=300", edge_share=5 * share).samples
    assert few == samples // 5  # of fewer samples each may share more


@pytest.mark.parametrize(("times", "samples"), [(0.99, 4500), (1.0, 1500), (1.5, 1500)])
def test_no_more_are_drawn_of_edges_that_are_blurred(times, samples):
    assert detail(edge_share=0.0, scatter_px=times * BLURRED_PX).samples == samples


def test_planes_are_fine_where_depth_errs_by_itself():
    few = DEPTH_ENOUGH / 1200  # points, 16 px apart
    assert detail(depth_share=0.9 * few).is_fine
    assert not detail(depth_share=1.1 * few).is_fine
    assert not detail("planes.finer=none", depth_share=0.0).is_fine
    assert detail("planes.point_step_px=32", depth_share=3.9 * few).is_fine
    assert not detail(depth_share=0.0, matches=700).is_fine  # of few edges, depth alone is heard
    assert not detail("sampling.count=0", depth_share=0.0, matches=700).is_fine
    assert detail(depth_share=0.0, matches=800).is_fine
    assert fine_after_fine(1.4 * few)  # so that it does not go to and fro
    assert not fine_after_fine(1.6 * few)


def noted(shared_px, shared_depth, **changes):
    """What is measured where edges, and depth, share so much within their cells."""
    reference, rng, errors = edges(spread=0.1), np.random.default_rng(1), shared_errors(**changes)
    cells = cell_of(reference)
    for k in range(12):
        residuals = rng.normal(0, SIGMA, len(reference)) + rng.normal(0, shared_px, 192)[cells]
        seen = replace(
            found(residuals),
            depth_balance=1.0,
            sigma_depth=math.hypot(0.3, shared_depth),
            plane_points=1200,
            plane_inliers=1200,
        )
        errors.note(reference, seen, 0.03, *wall(shared_depth, seed=k))
    return errors


def test_both_are_told_from_residuals():
    config = Config()
    alone = worthwhile_detail(config, problems.VGA, noted(0.0, 0.0))
    assert alone[:2] == (4500, True)
    together = worthwhile_detail(config, problems.VGA, noted(4 * SIGMA, 0.4))
    assert together[:2] == (1500, False)
    assert noted(SIGMA, 0.0).edge_share > noted(SIGMA / 4, 0.0).edge_share > 0.0001
    assert noted(0.0, 0.0).scatter_px == found(np.zeros(1500)).sigma_px > 0
    assert shared_errors().scatter_px == 0


def test_few_matches_are_noticed_at_once():
    """So few that they tell nothing of what they share."""
    errors = noted(0.0, 0.0)
    assert worthwhile_detail(Config(), problems.VGA, errors).is_fine
    errors.note(edges(), found(np.zeros(100)), 0.03)
    assert errors.matches == 100
    assert not worthwhile_detail(Config(), problems.VGA, errors).is_fine


def test_of_fine_points_as_many_tell_what_they_share():
    reference, rng, errors = edges(), np.random.default_rng(1), shared_errors()
    for k in range(12):
        planes, points, term = wall(0.4, seed=k)
        four = PlanePoints(*(np.repeat(part, 4, axis=0) for part in points[:3]), FINE)
        seen = replace(
            found(rng.normal(0, SIGMA, len(reference))),
            depth_balance=1.0,
            sigma_depth=0.5,
            plane_points=4800,
            plane_inliers=4800,
        )
        errors.note(reference, seen, 0.03, planes, four, term)
    once = noted(0.0, 0.4).depth_share
    assert errors.depth_share == pytest.approx(once, rel=0.2)


def test_odd_steps_are_kept():
    depth = np.full((480, 640), 2.0, np.float32)
    fitter = PlaneFitter(problems.VGA, PlanesConfig(point_step_px=15, stride_px=1))
    usual, fine = (fitter.points(depth, fine=each) for each in (False, True))
    assert len(usual.sigma) == len(fine.sigma)
    assert thinned(fine, 15.0) is fine


def test_it_is_measured_without_the_rules_of_balance():
    rules = {"edge_doubt_rule": "fixed", "depth_doubt_rule": "none"}
    errors = noted(0.0, 0.0, **rules)
    assert worthwhile_detail(Config(), problems.VGA, errors)[:2] == (4500, True)
    assert errors.most == math.inf
    assert errors.px == PlanesConfig().edge_doubt_px
    assert math.isnan(noted(0.0, 0.0, finer="none", **rules).depth_share)


def test_fine_planes_are_freed_of_more_noise():
    """Four times the pixels leave half the noise, of the direction and of the distance."""
    camera = problems.VGA
    rng = np.random.default_rng(0)
    depth = np.full((480, 640), 2.0, np.float32)
    noisy = (depth + rng.normal(0, 0.005, depth.shape)).astype(np.float32)
    fitter = PlaneFitter(camera, PlanesConfig())
    coarse, fine = (fitter.points(noisy, fine=each) for each in (False, True))
    assert (coarse.step_px, fine.step_px) == (COARSE, FINE)
    assert len(fine.sigma) == pytest.approx(4 * len(coarse.sigma), rel=0.05)
    tilt, off = zip(
        *((np.std(each.normals[:, :2]), np.std(each.X[:, 2])) for each in (coarse, fine)),
        strict=True,
    )
    assert 0.4 < tilt[1] / tilt[0] < 0.7
    assert 0.4 < off[1] / off[0] < 0.7
    maps = [fitter.planes(noisy, fine=each) for each in (False, True)]
    assert np.std(maps[1].normals[:, :2]) < 0.7 * np.std(maps[0].normals[:, :2])
    assert maps[0].normals.shape == maps[1].normals.shape


def test_fine_points_are_thinned_to_the_usual():
    depth = np.full((480, 640), 2.0, np.float32)
    fine = PlaneFitter(problems.VGA, PlanesConfig()).points(depth, fine=True)
    few = thinned(fine, COARSE)
    assert few.step_px == COARSE
    assert thinned(few, COARSE) is few
    for all_of_it, some in zip(fine[:3], few[:3], strict=True):
        np.testing.assert_array_equal(some, all_of_it[::4])


def test_a_registration_begins_with_the_usual_points():
    """They lead to where all of them do, which count in the end."""
    frames, _ = problems.sequence(30)
    registration = Registration(problems.CAMERA, MatchingConfig(), RegistrationConfig())
    fitter = PlaneFitter(problems.CAMERA, PlanesConfig(point_step_px=4, stride_px=2))
    edges = [extract_edges(f.grey, EdgesConfig(), EdgeBuffers(240, 320)) for f in frames[:2]]
    reference = registration.index(edges[0].describe(problems.CAMERA))
    samples = sample_edges(
        edges[1], frames[1].depth, problems.CAMERA, SamplingConfig(), EdgesConfig(), 0
    )
    planes, points = fitter.planes(frames[0].depth), fitter.points(frames[1].depth)
    usual = int(registration.solver.first_points)
    assert len(points.sigma) > 2 * usual
    found = []
    for first in (usual, len(points.sigma)):
        registration._solver = registration.solver._replace(first_points=np.int64(first))
        found.append(
            registration.align(reference, samples, np.eye(4)[None], planes, points, fitter.term)
        )
    assert found[0].plane_points > 2 * usual
    assert problems.error(*(each.T_ref_cur for each in found))[0] < 1e-4
    assert found[0].depth_balance == pytest.approx(found[1].depth_balance, rel=0.1)
    assert found[0].history[0, 4] != found[1].history[0, 4]  # the first step is another one
    few = RegistrationConfig(max_iterations=2)  # which the first stage uses up
    short = Registration(problems.CAMERA, MatchingConfig(), few).align(
        reference, samples, np.eye(4)[None], planes, points, fitter.term
    )
    assert short.steps()[-1].robust
    assert short.plane_points > 0.9 * found[0].plane_points


def run(*overrides, gap=None):
    frames, truth = problems.sequence(30)
    rng = np.random.default_rng(0)
    noise = [rng.normal(0, 1, frame.depth.shape) for frame in frames]
    frames = [
        replace(f, depth=(f.depth + 0.2 * NOISE.sigma_z(f.depth) * n).astype(np.float32))
        for f, n in zip(frames, noise, strict=True)
    ]
    # images are free of noise: rounded to grey levels, edges err each by itself
    config = Config().with_overrides(["edges.grey_steps=1", *overrides])
    odometry = Odometry(problems.CAMERA, config)
    results = []
    for k, frame in enumerate(frames):
        late = 0.0 if gap is None or k < gap else 0.5
        results.append(odometry.track(replace(frame, timestamp=frame.timestamp + late)))
    assert all(result.status is Status.TRACKED for result in results)
    off = [problems.error(truth[k], each.T_world_cam)[0] for k, each in enumerate(results)]
    on_planes = [each.alignment.plane_points for each in results[1:]]
    key = odometry._course.keyframe  # is held against others by the usual
    assert 0.45 * config.sampling.count < len(key.samples) <= config.sampling.count
    assert key.points.step_px == COARSE
    return [each.samples for each in results], on_planes, off


FEW = "sampling.count=500"  # the room is small, and so is its image: 1,500 edges share more


def test_a_run_takes_more_once_it_knows():
    samples, on_planes, off = run(FEW)
    assert samples[:2] == [500, 500]  # the first one that was registered says what edges share
    assert min(samples[12:25]) == 1500
    assert min(on_planes[12:]) > 2.5 * max(on_planes[:7])  # of depth that takes a while
    plain, few, usual = run(FEW, "sampling.max_growth=1", "planes.finer=none")
    assert set(plain) == {500}
    assert max(few) < 1.2 * max(on_planes[:7])
    assert np.mean(off[12:]) < 0.7 * np.mean(usual[12:])


def test_after_a_gap_the_usual_is_taken():
    samples, on_planes, _ = run(FEW, gap=20)
    assert samples[19] > samples[20] == 500
    assert on_planes[18] > 2.5 * on_planes[19]
