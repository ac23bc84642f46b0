"""What makes a pose that seems to fit a doubtful one: foreign edges, and depth that jumps."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from benchmarks.crowd import other_people

from edvo import se3
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.doubt import BEGUN_POORLY, CHANGED
from edvo.frame import Frame
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.unshared import EXCUSED

from . import problems

CAMERA = problems.CAMERA
PERIOD = 1 / 30
GAP_OF_ONE = "keyframes.gap_frames=1"
NOT_ASKED = [f"status.{of}_agreeing=0" for of in ("min", "doubt", "first")]


def dense(seed, size):
    """A texture all over the image, of edges that are about so far apart."""
    noise = np.random.default_rng(seed).normal(size=(CAMERA.height, CAMERA.width))
    grey = cv2.GaussianBlur(noise, (0, 0), size)
    grey = np.clip(128 + 50 * grey / grey.std(), 0, 255).astype(np.uint8)
    return Frame(seed * PERIOD, grey, np.full(grey.shape, 2.0, np.float32))


def second(first, then, *overrides, preset="default"):
    odometry = Odometry(CAMERA, Config.preset(preset).with_overrides(overrides))
    odometry.track(first)
    return odometry.track(then)


# ------------------------------------------------------------------------------- foreign images


@pytest.mark.parametrize("size", [0.8, 1.6, 3.0])
def test_dense_edges_of_another_place_fit_by_chance_and_are_lost(size):
    fine = "edges.max_noise=0"  # else it is blurred like noise
    believed = second(dense(0, size), dense(1, size), *NOT_ASKED, fine)
    assert believed.status is Status.TRACKED
    assert believed.alignment.inliers > 0.65 * len(believed.alignment.matches)
    assert second(dense(0, size), dense(1, size)).status is Status.LOST
    result = second(dense(0, size), dense(1, size), fine)
    assert result.status is Status.LOST
    assert "turned alike" in result.reason
    assert result.alignment.agreeing < 0.4 * len(result.alignment.matches)


@pytest.mark.parametrize("size", [0.8, 1.6, 3.0])
def test_dense_edges_of_the_same_place_agree(size):
    frame = dense(0, size)
    # the same plane, seen from a little to the left
    shift = np.float32([[1, 0, 2], [0, 1, 1]])
    grey = cv2.warpAffine(frame.grey, shift, (320, 240), borderMode=cv2.BORDER_REFLECT)
    result = second(frame, Frame(PERIOD, grey, frame.depth))
    assert result.status is Status.TRACKED
    assert result.alignment.agreeing > 0.8 * len(result.alignment.matches)


def test_little_agreement_is_degraded():
    frames, _ = problems.sequence(30)
    result = second(frames[0], frames[1], "status.doubt_agreeing=1.0")
    assert result.status is Status.DEGRADED
    assert "turned alike" in result.reason
    result = second(frames[0], frames[1], "status.min_agreeing=1.0", "planes.lead=none")
    assert result.status is Status.DEGRADED  # since both show the same
    assert result.reason.startswith("only")
    assert result.reason.endswith(EXCUSED)
    counted = "status.min_agreeing=1.0", "planes.lead=none", "status.unshared=counted"
    assert second(frames[0], frames[1], *counted).status is Status.LOST


def test_only_what_fits_can_agree():
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA)
    for frame in frames[:10]:
        alignment = odometry.track(frame).alignment
        if alignment is not None:
            assert 0 < alignment.agreeing <= alignment.inliers <= alignment.match_count


def test_the_paper_does_not_ask_whether_edges_agree():
    status = Config.preset("paper").status
    assert status.min_agreeing == status.doubt_agreeing == status.first_agreeing == 0
    result = second(dense(0, 0.8), dense(1, 0.8), preset="paper")
    assert result.status is not Status.LOST
    assert "turned alike" not in result.reason


# ------------------------------------------------------------------------------------ depth jump


def measured(frame, bend=0.0):
    """Depth with noise, bent as no rigid motion explains."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    noise = np.random.default_rng(int(frame.timestamp * 1000)).normal(size=frame.depth.shape)
    wave = 1 + bend * np.sin(u / 30) * np.sin(v / 30)
    depth = frame.depth * wave * (1 + 0.0012 * frame.depth * noise)
    return Frame(frame.timestamp, frame.grey, depth.astype(np.float32))


BENT = 0.02  # depth lies some times its noise off


def test_in_the_first_second_depth_has_to_fit_where_few_edges_agree():
    frames, _ = problems.sequence(40)
    strict, kept = "status.first_agreeing=1.0", ["keyframes.rule=gap", "keyframes.gap_frames=99"]
    odometry = Odometry(CAMERA, Config().with_overrides([strict, *kept]))
    bends = [0.0, *[BENT] * 39]
    results = [odometry.track(measured(*each)) for each in zip(frames, bends, strict=True)]
    asked = ["just begun" in result.reason for result in results]
    early = [0 < result.timestamp - frames[0].timestamp <= 1 for result in results]
    assert asked == early
    assert all(results[k].status is Status.DEGRADED for k in np.flatnonzero(early))
    assert results[-1].status is Status.TRACKED
    pair = measured(frames[0]), measured(frames[1])
    assert second(*pair, strict).status is Status.TRACKED  # as depth fits
    bent = measured(frames[0]), measured(frames[1], BENT)
    assert second(*bent).status is Status.TRACKED  # as edges do
    assert "just begun" not in second(*bent, strict, preset="paper").reason


@pytest.fixture(scope="module")
def walker():
    """A source, and its frames: most of each is one who walks."""
    source = SyntheticSource(make_recipe(other_people(3), frames=11, seed=3))
    return source, [reading.frame for reading in read_ahead(source, range(11))]


@pytest.mark.parametrize(
    ("agreeing", "scatter_px", "depth_sigma", "balance", "why"),
    [
        (0.6, 0.8, 0.5, 1.0, "these scatter by 0.8 px"),
        (0.6, 0.3, 2.5, 1.0, "depth is off by 2 times its noise"),
        (0.6, 0.3, 2.5, 0.0, ""),  # depth is not asked
        (0.6, 0.3, 0.5, 1.0, ""),
        (0.8, 0.8, 2.5, 1.0, ""),
    ],
)
def test_few_edges_that_agree_have_to_lie_close_in_the_first_second(
    agreeing, scatter_px, depth_sigma, balance, why
):
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA)
    alignment = [odometry.track(frame) for frame in frames[:2]][1].alignment
    start = replace(
        alignment,
        agreeing=int(agreeing * len(alignment.matches)),
        sigma_px=scatter_px,
        sigma_depth=depth_sigma,
        depth_balance=balance,
    )
    few = "only 60% of the samples fit edges that are turned alike, just begun, and "
    assert odometry._judge.poor_start(start) == (few + why if why else "")
    assert odometry._judge.is_poor_keyframe(start) == (bool(why) or agreeing > 0.7)


@pytest.mark.parametrize(
    ("scatter_px", "depth_sigma", "balance", "changes", "is_poor"),
    [
        (0.8, 1.6, 1.0, (), True),
        (0.7, 1.6, 1.0, (), False),
        (0.8, 1.4, 1.0, (), False),
        (0.8, 1.6, 0.0, (), False),
        (0.8, 1.6, 1.0, ("status.first_agreeing=0",), False),
    ],
)
def test_a_first_keyframe_is_poor_if_edges_scatter_and_depth_is_off(
    scatter_px, depth_sigma, balance, changes, is_poor
):
    odometry = Odometry(CAMERA, Config().with_overrides(changes))
    found = [odometry.track(frame) for frame in problems.sequence(30)[0][:2]][1].alignment
    all_agree = replace(found, agreeing=len(found.matches), sigma_px=scatter_px)
    start = replace(all_agree, sigma_depth=depth_sigma, depth_balance=balance)
    assert odometry._judge.is_poor_keyframe(start) == is_poor


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_who_walks_by_before_anything_is_known_is_not_tracked_for_long(walker, seed):
    """Four fifths of the first views are one who walks: edges and depth fit less and less.

    Where a keyframe is made of that, what comes after it fits, and is as wrong.
    """
    source, frames = walker
    truth, offs = source.ground_truth, []
    odometry = Odometry(source.camera, Config(seed=seed))
    T_first_world = se3.inverse(truth.at(source.timestamps[0]))
    for frame in frames:
        result = odometry.track(frame)
        offs.append(se3.distance(T_first_world @ truth.at(result.timestamp), result.T_world_cam))
        assert offs[-1] < 0.1 or result.status is not Status.TRACKED
    assert max(offs) > 0.1


@pytest.mark.parametrize(
    ("gap", "doubtful"), [("keyframes.gap_frames=6", True), ("keyframes.gap_frames=99", False)]
)
def test_what_fits_a_keyframe_of_what_fitted_poorly_is_doubtful(walker, gap, doubtful):
    source, frames = walker
    odometry = Odometry(source.camera, Config().with_overrides(["keyframes.rule=gap", gap]))
    results = [odometry.track(frame) for frame in frames[:9]]
    assert "just begun" in results[6].reason
    assert results[6].is_keyframe == doubtful
    assert (results[7].reason == BEGUN_POORLY) == doubtful
    assert odometry._doubt.is_way_loose(frames[8].timestamp)  # else it leaps by then
    assert (odometry._doubt.way_reason == BEGUN_POORLY) == doubtful


@pytest.mark.parametrize(("period", "doubtful"), [(PERIOD, True), (0.3, False)])
def test_of_a_step_that_does_not_follow_closely_nobody_asks_how_it_fits_at_first(
    monkeypatch, period, doubtful
):
    odometry = Odometry(CAMERA, Config().with_overrides(["keyframes.rule=gap", GAP_OF_ONE]))
    monkeypatch.setattr(odometry._judge, "poor_start", lambda alignment: "poor")
    for i, frame in enumerate(problems.sequence(30)[0][:3]):
        result = odometry.track(replace(frame, timestamp=i * period))
        assert result.is_keyframe
    assert odometry._doubt.is_way_loose(result.timestamp) == doubtful


def test_only_in_the_first_second_a_keyframe_that_fits_poorly_casts_doubt():
    frames, _ = problems.sequence(40)
    odometry = Odometry(CAMERA)
    results = [odometry.track(frame) for frame in frames]
    fits, doubt, begun = results[-1].alignment, odometry._doubt, frames[0].timestamp
    poor = replace(fits, agreeing=len(fits.matches) // 2, sigma_px=1.0)
    for alignment, after, doubtful in ((fits, 0.5, 0), (poor, 1.01, 0), (poor, 0.99, 1)):
        doubt.mind_start(alignment, begun + after)
        assert doubt.is_way_loose(begun + after) == doubtful
    assert doubt.way_reason == BEGUN_POORLY


def followed(bend, *overrides, usual=0.0, count=10):
    """Frames as ever, then one whose depth is bent, then another as ever."""
    frames, truth = problems.sequence(30)
    odometry = Odometry(CAMERA, Config().with_overrides(["status.max_conflict=0", *overrides]))
    before = [odometry.track(measured(frame, usual)) for frame in frames[:count]]
    assert {result.status for result in before} == {Status.TRACKED}
    bent = odometry.track(measured(frames[count], bend))
    after = odometry.track(measured(frames[count + 1], usual))
    assert problems.error(truth[count], bent.T_world_cam)[0] < 0.02
    return bent, after


@pytest.mark.parametrize("bend", [0.02, 0.05])
def test_depth_that_jumps_is_degraded(bend):
    bent, after = followed(bend)
    assert bent.status is Status.DEGRADED
    assert "depth is off" in bent.reason
    assert "times the usual" in bent.reason
    assert after.status is Status.TRACKED


def test_a_jump_is_not_taken_for_the_usual():
    frames, _ = problems.sequence(30)
    odometry = Odometry(CAMERA, Config().with_overrides(["status.max_conflict=0"]))
    for frame in frames[:5]:
        odometry.track(measured(frame))
    bent = [odometry.track(measured(frame, 0.03)) for frame in frames[5:15]]
    assert {result.status for result in bent} == {Status.DEGRADED}


def test_depth_that_is_mildly_worse_raises_no_doubt():
    bent, _ = followed(0.006)
    assert bent.status is Status.TRACKED


def test_a_camera_whose_depth_is_always_bent_is_not_doubted_for_that():
    bent, after = followed(0.02, usual=0.02)
    assert bent.status is after.status is Status.TRACKED


def test_how_far_depth_may_jump_is_told():
    bent, _ = followed(0.02, "status.depth_jump=100")
    assert bent.status is Status.TRACKED


def test_the_first_frames_are_not_doubted():
    bent, after = followed(0.03, count=1)
    assert bent.status is after.status is Status.TRACKED


# --------------------------------------------------------------- a view that changes all at once


def covered(frame, seed):
    """Something else in a part of the view, with depth."""
    grey = frame.grey.copy()
    other = problems.drawn_image(np.random.default_rng(seed), (CAMERA.height, 120), 20)
    grey[:, :120] = other
    return Frame(frame.timestamp, grey, frame.depth)


def changed_at(*places, count=45, key_gap=1, preset="default", more=()):
    """Track frames of which some are covered; a keyframe every so many."""
    frames, _ = problems.sequence(count)
    config = Config.preset(preset).with_overrides(
        ["keyframes.rule=gap", f"keyframes.gap_frames={key_gap}", "status.max_conflict=0", *more]
    )
    odometry = Odometry(CAMERA, config)
    return [
        odometry.track(covered(frame, 7) if k in places else frame)
        for k, frame in enumerate(frames)
    ]


def test_after_a_view_that_changed_at_once_a_pose_is_in_doubt_for_a_second():
    results = changed_at(5)
    assert "of the samples fit" in results[5].reason
    following = [result for result in results[7:] if result.timestamp - results[6].timestamp < 0.9]
    assert len(following) > 20
    assert {result.status for result in following} == {Status.DEGRADED}
    assert {result.reason for result in following} == {CHANGED}
    assert results[-1].status is Status.TRACKED


def test_a_poor_fit_with_what_was_seen_longer_ago_is_that_frame_s_alone():
    results = changed_at(4, key_gap=100)
    assert "of the samples fit" in results[4].reason
    assert results[4].status is Status.DEGRADED
    assert {result.status for result in results[5:]} == {Status.TRACKED}


@pytest.mark.parametrize(
    ("preset", "more"),
    [("paper", ()), ("default", ("status.sudden_change=ignore", "status.first_agreeing=0"))],
)
def test_no_frame_is_in_doubt_for_another_where_that_is_not_asked_for(preset, more):
    results = changed_at(5, preset=preset, more=more)
    assert "of the samples fit" in results[5].reason
    assert {result.status for result in results[7:]} == {Status.TRACKED}


# ------------------------------------------------------------------ how often depth is asked


def asked(moves, period, count=8):
    """Which of so many frames are held against the depth of a moment ago."""
    frames, _ = problems.sequence(count)
    odometry, times = Odometry(CAMERA), []
    conflict = odometry._doubt._conflict

    def watched(seen, alignment):
        times.append(round(seen.frame.timestamp / period))
        return moves, *conflict(seen, alignment)[1:]

    odometry._doubt._conflict = watched
    for k, frame in enumerate(frames):
        odometry.track(replace(frame, timestamp=k * period))
    return sorted(set(times))


def test_depth_is_asked_in_every_other_frame_while_nothing_moves():
    assert asked(0.0, 1 / 30) == [1, 3, 5, 7]
    assert asked(0.0, 1 / 15) == [1, 2, 3, 4, 5, 6, 7]  # these are as far apart as those


def test_in_each_where_a_little_moves_or_there_is_doubt():
    assert asked(0.01, 1 / 30) == [1, 2, 3, 4, 5, 6, 7]
    assert asked(0.1, 1 / 30) == [1, 2, 3, 4, 5, 6, 7]
