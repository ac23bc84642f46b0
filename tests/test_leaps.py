"""A registration that leads where no hand moves a camera is looked at again from depth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import scatter, se3
from edvo.assessing import LEAPT
from edvo.config import Config
from edvo.doubt import DOUBTFUL_S, FOUND_FAR
from edvo.odometry import Odometry, Status
from edvo.status import Judge
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

KNOWN = 6  # frames, until the usual scale is known
# what else may find that it is wrong
ALONE = "motion.search_deg=0", "keyframes.earlier=0", "status.max_conflict=0"
ALONE = *ALONE, "status.depth_jump=1e6", "status.max_depth_sigma=1e6", "edges.carried=kept"
ALONE = *ALONE, "planes.lead=none"
LOST = Config().with_overrides(["status.leaps=lost"])  # whether they are borne out is not asked
ONE_UP = np.array([0.0, -0.17, 0.28, 0.0, 0.0, 0.0])  # about a step of the stairs


@pytest.fixture(scope="module")
def stairs():
    """Frames before stairs, and where they are in the camera of the first one."""
    source = SyntheticSource(make_recipe("stairs", frames=KNOWN + 1))
    frames = [source.read(i).frame for i in range(len(source))]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def after_a_wrong_start(stairs, monkeypatch, *overrides, known=KNOWN):
    """Track, and let the last frame be registered first from one step up alone."""
    camera, frames, truth = stairs
    odometry = Odometry(camera, Config().with_overrides(overrides))
    for frame in frames[:known]:
        assert odometry.track(frame).status is Status.TRACKED
    align, asked = odometry._registration.align, []

    def wrong_at_first(reference, samples, starts, *given, **more):
        asked.append(starts)
        if len(asked) == 1:
            starts = (starts[0] @ se3.exp(ONE_UP))[None]
        return align(reference, samples, starts, *given, **more)

    monkeypatch.setattr(odometry._registration, "align", wrong_at_first)
    result = odometry.track(frames[known])
    off = se3.inverse(truth[known]) @ result.T_world_cam
    return result, float(np.linalg.norm(off[:3, 3])), len(asked)


@pytest.mark.parametrize("known", [1, KNOWN])
def test_one_step_is_not_taken_for_the_next(stairs, monkeypatch, known):
    """Nor is it in the second frame, of which no scale is known yet."""
    result, off, asked = after_a_wrong_start(stairs, monkeypatch, *ALONE, known=known)
    assert result.status is Status.TRACKED
    assert off < 0.002
    assert asked > 1


@pytest.mark.parametrize("is_off", [False, True])
def test_how_depth_fits_where_no_camera_can_be_does_not_matter(stairs, monkeypatch, is_off):
    """In a turn the next step may be in view whole, the true one in part; its depth must fit."""
    fitting, may_be_off = scatter.fitting_depth, Judge.may_be_off

    def fits(alignment):
        is_true = se3.distance(alignment.T_ref_cur, stairs[2][KNOWN]) < 0.1
        return fitting(alignment) * (1 if is_true else 2)

    monkeypatch.setattr(scatter, "fitting_depth", fits)
    monkeypatch.setattr(Judge, "may_be_off", lambda *given: is_off or may_be_off(*given))
    result, off, _ = after_a_wrong_start(stairs, monkeypatch, *ALONE)
    assert result.status is (Status.LOST if is_off else Status.TRACKED)
    assert is_off or off < 0.002


@pytest.mark.parametrize("overrides", [["status.edge_jump=0"], ["planes.weight=0"]])
def test_where_it_is_not_asked_or_there_is_no_depth_it_is(stairs, monkeypatch, overrides):
    result, off, asked = after_a_wrong_start(stairs, monkeypatch, *ALONE, *overrides)
    assert result.status is Status.LOST or off > 0.05
    assert asked == 1


def test_where_nothing_else_is_found_it_is_lost(stairs, monkeypatch):
    camera, frames, _ = stairs
    odometry = Odometry(camera, LOST)
    for frame in frames[: KNOWN - 1]:
        assert odometry.track(frame).status is Status.TRACKED
    odometry._course.velocity[:3] += 2.0  # by which it is expected 0.1 m off
    results = [odometry.track(frame) for frame in frames[KNOWN - 1 :]]
    assert [result.status for result in results] == [Status.LOST, Status.LOST]
    assert {result.reason for result in results} == {LEAPT}


def test_found_again_after_a_leap_the_way_there_is_in_doubt_for_a_second(stairs):
    """Among things that are alike it may be the next one, now as then."""
    camera, frames, _ = stairs
    odometry = Odometry(camera, LOST)
    results = [odometry.track(frame) for frame in frames[:2]]
    odometry._course.velocity[:3] += 2.0
    results += [odometry.track(frames[2])]
    odometry._course.velocity[:3] -= 2.0
    results += [odometry.track(frame) for frame in frames[3:]]
    assert results[2].status is Status.LOST
    assert results[2].reason == LEAPT
    for result in results[3:]:
        assert (result.status, result.reason) == (Status.DEGRADED, FOUND_FAR)
    assert not odometry._doubt.is_way_loose(results[3].timestamp + DOUBTFUL_S)
    skipped = Odometry(camera)
    for frame in frames[:2]:
        skipped.track(frame)
    skipped.skip(frames[2].timestamp, "its file is broken")
    assert skipped.track(frames[3]).status is Status.TRACKED


@pytest.mark.parametrize(
    ("agreeing", "aside_m", "found"), [(0.6, 0.0, 1), (0.9, 0.0, 0), (0.6, 0.1, 0)]
)
def test_after_a_frame_that_a_jerk_has_blurred_it_may_be_where_it_was_bound_for(
    stairs, agreeing, aside_m, found
):
    """Expected 0.07 m off by a pose that fitted poorly, but not by that before it."""
    camera, frames, _ = stairs
    odometry = Odometry(camera, LOST)
    for frame in frames[:KNOWN]:
        odometry.track(frame)
    course = odometry._course
    course.velocity[:3] += 2.0
    course.before[1][0, 3] += aside_m
    odometry._judge._agreeing = agreeing
    status = odometry.track(frames[KNOWN]).status
    assert status is (Status.TRACKED if found else Status.LOST)


@pytest.mark.parametrize(("speed", "leaps"), [(1.9, False), (5.0, True)])
def test_at_first_a_camera_may_go_as_fast_as_one_walks(stairs, speed, leaps):
    camera, frames, _ = stairs
    odometry = Odometry(camera)
    odometry.track(frames[0])
    found = SimpleNamespace(
        T_ref_cur=se3.exp([speed / 30, 0, 0, 0, 0, 0]), agreeing=90, matches=np.zeros(100)
    )
    assert odometry._locator.assessor.leaps(found, frames[0].timestamp + 1 / 30) is leaps
    odometry._course.velocity[2] = 0.01
    assert odometry._locator.assessor.leaps(found, frames[0].timestamp + 1 / 30)
    assert not odometry._locator.assessor.leaps(found, frames[0].timestamp + 0.3)


@pytest.mark.parametrize(("before", "now"), [(0.013, 0.053), (0.053, 0.013), (1 / 30, 1 / 30)])
def test_stamps_that_jitter_are_no_leap(stairs, before, now):
    """Frames come at 30 Hz, whatever they are stamped."""
    camera, frames, _ = stairs
    odometry = Odometry(camera)
    odometry.track(frames[0])
    course, metres = odometry._course, 0.8 / 30
    course.last_time, course.before = 1.0, (1.0 - before, np.eye(4), np.zeros(6))
    course.velocity[0] = metres / before
    alike = {"agreeing": 90, "matches": np.zeros(100)}
    found = SimpleNamespace(T_ref_cur=se3.exp([metres, 0, 0, 0, 0, 0]), **alike)
    assessor = odometry._locator.assessor
    assert not assessor.leaps(found, 1.0 + now)
    farther = SimpleNamespace(T_ref_cur=se3.exp([metres + 0.4, 0, 0, 0, 0, 0]), **alike)
    assert assessor.leaps(farther, 1.0 + now)
    course.before = None  # nothing tells how long the last step took
    assert assessor.leaps(found, 1.0 + now) is (now < before)


def test_a_stream_whose_stamps_jitter_is_tracked():
    recipe = make_recipe("office", frames=30, camera=problems.CAMERA, speed=0.5, seed=1)
    source = SyntheticSource(recipe)
    odometry, rng = Odometry(source.camera), np.random.default_rng(6)
    for i in range(len(source)):
        frame = source.read(i).frame
        late = float(np.clip(rng.normal(0, 0.008), -0.015, 0.015))
        assert odometry.track(replace(frame, timestamp=frame.timestamp + late)).status is (
            Status.TRACKED
        )


@pytest.mark.parametrize(("rate", "limit_m"), [(30, 30 / 30**2), (60, 0.02), (90, 0.02)])
def test_however_often_frames_come_poses_scatter(stairs, rate, limit_m):
    camera, frames, _ = stairs
    odometry = Odometry(camera)
    odometry.track(frames[0])
    course = odometry._course
    course.last_time, course.before = 1.0, (1.0 - 1 / rate, np.eye(4), np.zeros(6))
    course.velocity[0] = 0.3
    assessor = odometry._locator.assessor
    assert assessor.limit(1.0 + 1 / rate) == pytest.approx(limit_m)


def test_where_depth_fits_nothing_is_taken_that_leaves_it(stairs, monkeypatch):
    """However well edges fit there: nothing of what a camera sees can be gone at once."""
    camera, frames, _ = stairs
    odometry = Odometry(camera)
    for frame in frames[:2]:
        found = odometry.track(frame).alignment
    lost = replace(found, inliers=0, agreeing=0)
    near, left = (
        replace(found, plane_points=int(share * found.plane_inliers)) for share in (1, 0.2)
    )
    assessor, later = odometry._locator.assessor, frames[1].timestamp + 1 / 30
    assert assessor.is_lost(lost, later)
    assert assessor.better(lost, near, later) is near
    assert assessor.better(lost, left, later) is lost
