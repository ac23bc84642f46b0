"""What moves in a small part of the view is left out, before it is much."""

from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.frame import Frame
from edvo.movers import KEPT_S, LEAST, LITTLE, MOST, Movers
from edvo.odometry import Odometry, Status
from edvo.planes import PlanePoints
from edvo.seen import Seen
from edvo.witness import RISEN_S, Surface, Witness

from . import problems
from .test_witness import CAMERA, MOVED, STILL, noisy, rays, room

PERIOD = 1 / 30
STEP = 0.008  # by which the box moves in a frame, m
STANDS, NOTICED, FRAMES = (
    35,
    56,
    85,
)  # frames for which the box stands still, till it is noticed, and all
AHEAD = se3.exp(np.array([0.002, 0, 0, 0, 0, 0]))  # of the camera, in a frame


def painted(T_world_cam, box, timestamp):
    """A frame of the room of `test_witness`: a box in cloth before a wall with a few marks."""
    depth = room(T_world_cam, camera=CAMERA, box=box)
    X = T_world_cam[:3, :3] @ (rays(CAMERA) * depth.ravel()) + T_world_cam[:3, 3:]
    X = X.reshape(3, *depth.shape)
    is_box = np.abs(X[2] - 2) < 1e-4
    if box is not None:
        X[0, is_box] -= box
    maps = (X[:2] * 160 + 512).astype(np.float32)
    wall, cloth = (cv2.remap(image, *maps, cv2.INTER_LINEAR) for image in IMAGES)
    grey = np.where(is_box, cloth, wall).astype(np.uint8)
    return Frame(timestamp, grey, noisy(depth, round(timestamp / PERIOD)))


def pictures():
    rng = np.random.default_rng(5)
    wall = np.full((1024, 1024), 120, np.uint8)
    for _ in range(120):
        a, b = rng.integers(150, 874, (2, 2))
        cv2.line(wall, a.tolist(), (a + (b - a) // 8).tolist(), int(rng.integers(140, 200)), 3)
    cloth = cv2.GaussianBlur(rng.normal(size=wall.shape), (0, 0), 5)
    cloth = np.clip(120 + 50 * cloth / cloth.std(), 0, 255).astype(np.uint8)
    return cv2.GaussianBlur(wall, (0, 0), 1), cloth


IMAGES = pictures()


@pytest.fixture(scope="module")
def passing():
    """Frames of a box that begins to move, and the poses."""
    truth, frames = [], []
    for i in range(FRAMES):
        truth.append(np.linalg.matrix_power(AHEAD, i))
        box = -0.5 + STEP * max(i - STANDS, 0)
        frames.append(painted(truth[-1], box, i * PERIOD))
    return frames, truth


def tracked(passing, *overrides):
    frames, truth = passing
    odometry = Odometry(CAMERA, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames]
    off = [problems.error(T, r.T_world_cam)[0] for T, r in zip(truth, results, strict=True)]
    return np.array(off), results


# ------------------------------------------------------------------------------ what has moved


def risen(before, after, T=STILL, since=-np.inf, age=RISEN_S):
    """What stands where it did not, as against an image of so long ago."""
    witness = Witness(CAMERA, "kinect_v1")
    witness.remember(1.0, STILL, witness.surface(before))
    return witness.risen(1.0 + age, T, witness.surface(after), since)


@pytest.mark.parametrize("T", [STILL, MOVED])
def test_what_has_come_to_where_nothing_was_is_found_in_the_world(T):
    found = risen(noisy(room(STILL, box=0.0), 1), noisy(room(T, box=0.15), 2), T)
    assert len(found) > 20
    np.testing.assert_allclose(found[:, 2], 2, atol=0.05)
    # less the margin at the contour
    assert 0.25 < found[:, 0].min() < found[:, 0].max() < 0.405
    assert found[:, 0].max() > 0.36


def test_where_nothing_has_moved_nothing_is_found():
    assert len(risen(noisy(room(STILL, box=0.0), 1), noisy(room(MOVED, box=0.0), 2), MOVED)) == 0


@pytest.mark.parametrize(
    ("age", "since", "is_asked"),
    [(0.4, 0.0, False), (RISEN_S, 0.9, True), (RISEN_S, 1.0, False), (0.9, 0.0, True)],
)
def test_it_is_asked_of_half_a_second_ago_and_not_of_what_is_in_doubt(age, since, is_asked):
    found = risen(room(STILL, box=0.0), room(STILL, box=0.15), since=since, age=age)
    assert (len(found) > 0) == is_asked


def test_the_last_that_is_old_enough_is_asked():
    witness = Witness(CAMERA, "kinect_v1")
    here, there = (witness.surface(room(STILL, box=x)) for x in (0.0, 0.15))
    for time, surface in ((1.0, here), (1.1, there), (1.3, there)):
        witness.remember(time, STILL, surface)
    assert len(witness.risen(1.55, STILL, there, -np.inf)) > 0
    assert len(witness.risen(1.65, STILL, there, -np.inf)) == 0
    # a question drops what is older than either may ask for
    witness.question(1.65, STILL, there)
    assert len(witness.risen(1.55, STILL, there, -np.inf)) == 0


# ----------------------------------------------------------------------------- what is left out


def seen(X, time=0.0):
    """A frame whose samples and points are these."""
    pixels = (X[:, :2] / X[:, 2:] * (CAMERA.fx, CAMERA.fy) + (CAMERA.cx, CAMERA.cy)).astype("f4")
    up = np.tile(np.float32([0, 1]), (len(X), 1))
    points = PlanePoints(X, np.tile([0.0, 0, -1], (len(X), 1)), np.full(len(X), 0.01), 16.0)
    frame = Frame(time, np.zeros((480, 640), "u1"), np.ones((480, 640), "f4"))
    return Seen(frame, None, EdgePixels(pixels, up, X[:, 2].astype("f4")), points)


def movers(*overrides, T_world_last=STILL, velocity=STILL, risen=(), follows=True, camera=CAMERA):
    """One that is told by a witness what has moved."""
    config = Config().with_overrides(overrides)
    kit = SimpleNamespace(
        camera=camera,
        config=config,
        clock=lambda _: nullcontext(),
        depth_alone=SimpleNamespace(has_to_tell=lambda samples: len(samples) < 30),
    )
    expected = T_world_last @ velocity
    course = SimpleNamespace(follows=lambda _: follows, expected=lambda _: expected)
    witness = SimpleNamespace(risen=lambda *_: np.asarray(risen, float))
    return Movers(kit, course, witness)


GRID = np.stack(np.meshgrid(np.arange(-1, 1, 0.1), np.arange(-1, 1, 0.1)), -1).reshape(-1, 2)
WALL = np.column_stack([GRID, np.full(len(GRID), 3.0)])
SPOT = np.array([[0.5, 0.5, 3], [0.501, 0.5, 3], [0.5, 0.501, 3], [0.501, 0.501, 3]])


@pytest.mark.parametrize("reach", [0.23, 0.47])
@pytest.mark.parametrize("velocity", [STILL, MOVED])
def test_samples_and_points_near_by_are_left_out(reach, velocity):
    last = se3.exp(np.array([0.1, 0.2, -0.3, 0.05, 0.1, -0.2]))
    of = movers(f"status.moving_m={reach}", T_world_last=last, velocity=velocity, risen=SPOT)
    of.note(1.0, STILL, None)
    T_cam_world = se3.inverse(last @ velocity)
    X = WALL @ T_cam_world[:3, :3].T + T_cam_world[:3, 3]
    rest = of.apart(seen(X, 1.03))
    away = np.linalg.norm(WALL[:, None] - SPOT, axis=-1).min(axis=1)
    np.testing.assert_allclose(rest.points.X, X[away > reach], atol=1e-12)
    np.testing.assert_allclose(rest.samples.points(CAMERA), X[away > reach], atol=1e-5)
    assert len(rest.points.normals) == len(rest.points.sigma) == len(rest.points.X)
    assert 0 < len(rest.samples) < len(WALL)


def spread(times):
    return SPOT[0] + times * (SPOT - SPOT[0])


@pytest.mark.parametrize(
    ("spot", "is_noise"),
    [(SPOT, False), (SPOT[: LEAST - 1], True), (spread(90), False), (spread(180), True)],
)
def test_a_few_points_or_far_apart_ones_are_noise(spot, is_noise):
    """At 3.1 m they lie 0.09 m apart as a rule."""
    of = movers(risen=spot)
    of.note(1.0, STILL, None)
    assert (of.apart(seen(WALL, 1.0)) is None) == is_noise


def test_lone_points_beside_others_are_left_alone():
    of = movers(risen=np.vstack([SPOT, [[-0.8, -0.8, 3.0]]]))
    of.note(1.0, STILL, None)
    rest = of.apart(seen(WALL, 1.0)).points.X
    assert np.linalg.norm(rest - (-0.8, -0.8, 3.0), axis=1).min() < 1e-9


@pytest.mark.parametrize(("time", "is_kept"), [(1.0, True), (KEPT_S, True), (1.8, False)])
def test_it_is_left_out_for_a_while(time, is_kept):
    of = movers(risen=SPOT)
    of.note(0.1 if time < 1 else 1.0, STILL, None)
    assert (of.apart(seen(WALL, time)) is not None) == is_kept


def test_what_is_old_is_dropped_even_if_no_frame_asks():
    of = movers(risen=SPOT)
    for time in np.arange(1.0, 20.0, 0.1):
        of.note(time, STILL, None)
    assert max(len(times) for _, times in of._moved.values()) <= KEPT_S / 0.1 + 2


def test_a_clock_that_jumps_back_ends_it():
    of = movers(risen=SPOT)
    of.note(1.0, STILL, None)
    assert of.apart(seen(WALL, 0.9)) is None
    assert of.apart(seen(WALL, 1.1)) is None


def test_it_is_forgotten_with_the_poses_that_told():
    of = movers(risen=SPOT)
    for time in (1.0, 1.2):
        of.note(time, STILL, None)
    of.forget(1.1)
    assert of.apart(seen(WALL, 1.2)) is not None
    of.forget(1.0)
    assert of.apart(seen(WALL, 1.2)) is None


@pytest.mark.parametrize(("share", "is_left"), [(0.35, False), (0.45, True)])
def test_what_is_most_of_a_frame_is_not_left_out(share, is_left):
    near = np.tile(SPOT, (100, 1))[: round(300 * (1 - share))]
    far = np.tile([[-0.5, -0.5, 3.0]], (round(300 * share), 1))
    of = movers(risen=SPOT)
    of.note(1.0, STILL, None)
    assert (of.apart(seen(np.vstack([near, far]), 1.0)) is not None) == is_left


@pytest.mark.parametrize(("count", "is_left"), [(29, False), (30, True)])
def test_as_many_samples_are_left_as_edges_need_to_tell(count, is_left):
    of = movers(risen=SPOT)
    of.note(1.0, STILL, None)
    X = np.vstack([SPOT, np.tile([[-0.5, -0.5, 3.0]], (count, 1))])
    assert (of.apart(seen(X, 1.0)) is not None) == is_left


def test_where_none_of_it_is_in_view_a_frame_is_as_it_was():
    of = movers(risen=SPOT + 9)
    of.note(1.0, STILL, None)
    assert of.apart(seen(WALL, 1.0)) is None


@pytest.mark.parametrize("off", ["moving_m=0", "moving=follow"])
def test_it_can_be_switched_off_and_the_paper_does(off):
    assert Config.preset("paper").status.moving_m == 0
    of = movers(f"status.{off}", risen=SPOT)
    of.note(1.0, STILL, None)
    assert of.apart(seen(WALL, 1.0)) is None


@pytest.mark.parametrize(("share", "is_left"), [(0.15, True), (0.25, False)])
def test_no_more_of_the_depth_is_left_out_than_may_be(share, is_left):
    count = round(100 * share)
    X = np.vstack([np.tile(SPOT[:1], (count, 1)), np.tile([[-0.5, -0.5, 3.0]], (100 - count, 1))])
    of = movers(risen=SPOT)
    of.note(1.0, STILL, None)
    assert (of.apart(seen(X, 1.0), 0.2) is not None) == is_left


def test_where_a_frame_is_not_foreseen_none_is_left_out():
    of = movers(risen=SPOT, follows=False)
    of.note(1.0, STILL, None)
    assert of.apart(seen(WALL, 1.0)) is None


def test_what_is_far_from_another_cluster_counts_by_its_own_distance():
    """Four points beside each other, and as many that lie as far apart, but farther away."""
    near, far = spread(60) / 3, spread(180)
    of = movers(risen=np.vstack([near, far]))
    of.note(1.0, STILL, None)
    kept = np.array([point for point, _ in of._moved.values()])
    assert len(kept)
    assert kept[:, 2].max() < 2


@pytest.mark.parametrize(("back", "is_noise"), [(0, True), (3, False)])
def test_points_are_beside_each_other_as_seen_from_the_camera(back, is_noise):
    of = movers(risen=spread(180))
    of.note(1.0, se3.exp(np.array([0, 0, -back, 0, 0, 0])), None)
    assert (of.apart(seen(WALL, 1.0)) is None) == is_noise


def test_in_a_wide_image_points_lie_farther_apart():
    camera = CAMERA.scaled(2)  # a step of twice the pixels: as far in the scene
    for times, is_noise in ((90, False), (180, True)):
        of = movers(risen=spread(times), camera=camera)
        of.note(1.0, STILL, None)
        assert (len(of._moved) == 0) == is_noise


def test_much_that_has_come_is_no_little():
    for count, is_little in ((MOST, True), (MOST + 1, False)):
        of = movers(risen=np.tile(SPOT[:1], (count, 1)))
        of.note(1.0, STILL, None)
        assert (len(of._moved) > 0) == is_little


def test_of_points_that_lie_together_one_is_kept():
    of = movers(risen=np.tile(SPOT, (40, 1)))
    for time in (1.0, 1.1, 1.2):
        of.note(time, STILL, None)
    assert len(of._moved) <= 4


# ------------------------------------------------------------------------ what doubt does to it


@pytest.fixture(scope="module")
def after_a_second(passing):
    """A tracker, some time after the first second, and its last alignment; not to be changed."""
    odometry = Odometry(CAMERA, Config())
    results = [odometry.track(frame) for frame in passing[0][:40]]
    return odometry, results[-1].alignment


@pytest.fixture
def doubting(passing, after_a_second):
    """The same, a copy for each test, with what it asks `Movers`."""
    odometry, alignment = deepcopy(after_a_second)
    said = []
    of = odometry._doubt.movers
    of.note = lambda timestamp, *_: said.append("note")
    of.mind_doubt = lambda timestamp: said.append("doubt")
    return odometry, passing[0][40], alignment, said


def asked(doubting, status):
    odometry, frame, alignment, said = doubting
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    odometry._doubt._calm_time = -np.inf
    odometry._doubt.question(seen, alignment, status, "")
    return said


def test_a_sure_pose_tells_and_a_degraded_one_does_not(doubting):
    assert asked(doubting, Status.TRACKED) == ["note"]
    assert asked(doubting, Status.DEGRADED) == ["note", "doubt"]


def test_nor_does_one_in_doubt(doubting):
    odometry, frame = doubting[:2]
    odometry._doubt.cast(frame.timestamp - 0.5, "for a test")
    assert asked(doubting, Status.TRACKED) == ["doubt"]


def test_across_a_way_in_doubt_nothing_is_told(doubting):
    """But after it."""
    odometry, frame, _, said = doubting
    odometry._doubt.cast_on_way(frame.timestamp - 0.3)
    assert said.pop() == "doubt"
    assert asked(doubting, Status.TRACKED) == ["note"]


def test_where_something_moves_it_is_told_all_the_same(doubting):
    odometry, frame = doubting[:2]
    odometry._doubt.moving_time = frame.timestamp - 0.5
    odometry._doubt.cast(frame.timestamp - 0.5, "something moves")
    assert asked(doubting, Status.DEGRADED) == ["note"]


def all_are_far(points, _):
    return np.ones(len(points), np.bool_)


@pytest.mark.parametrize(
    ("without", "conflict", "apart", "said"),
    [
        (True, 0.1, 0.0049, Status.TRACKED),
        (True, 0.1, 0.0051, Status.DEGRADED),
        (True, 0.1, np.inf, Status.DEGRADED),
        (False, 0.1, 0.0, Status.DEGRADED),  # it was registered with all that moves
        (True, 0.31, 0.0, Status.LOST),
    ],
)
def test_where_the_rest_stands_still_what_moves_raises_no_doubt(
    doubting, monkeypatch, without, conflict, apart, said
):
    odometry, frame, alignment, _ = doubting
    doubt, witness = odometry._doubt, odometry._doubt._witness
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    monkeypatch.setattr(witness, "question", lambda *_: conflict)
    monkeypatch.setattr(witness, "question_apart", lambda *_: apart)
    doubt._calm_time = -np.inf
    monkeypatch.setattr(doubt.movers, "are_far", all_are_far)
    status, reason = doubt.question(
        replace(seen, without_movers=without), alignment, Status.TRACKED, ""
    )
    assert doubt._calm_time == -np.inf  # each frame is asked
    assert status is said
    assert (reason == "") == (said is Status.TRACKED)
    assert doubt.lasts(frame.timestamp) == (said is not Status.TRACKED)
    assert doubt.moved(frame.timestamp)


@pytest.mark.parametrize(("share", "is_sure"), [(0.19, True), (0.21, False)])
def test_where_much_was_left_out_it_does(doubting, monkeypatch, share, is_sure):
    """The rest would be held against itself."""
    odometry, frame, alignment, _ = doubting
    doubt, witness = odometry._doubt, odometry._doubt._witness
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    monkeypatch.setattr(witness, "question", lambda *_: 0.1)
    monkeypatch.setattr(witness, "question_apart", lambda *_: 0.0)

    def are_far(points, _):
        return np.arange(len(points)) >= share * len(points)

    monkeypatch.setattr(doubt.movers, "are_far", are_far)
    doubt._calm_time = -np.inf
    given = replace(seen, without_movers=True), alignment, Status.TRACKED, ""
    assert (doubt.question(*given)[0] is Status.TRACKED) == is_sure


@pytest.mark.parametrize("without", [False, True])
def test_what_is_registered_with_all_that_moves_is_in_doubt_for_as_long(doubting, without):
    """Though no frame before was, by what had been left out of it."""
    odometry, frame, alignment, _ = doubting
    doubt, now = odometry._doubt, frame.timestamp
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(now))
    doubt.moving_time = now - 0.3
    doubt.question(replace(seen, without_movers=without), alignment, Status.TRACKED, "")
    assert doubt.lasts(now) != without
    assert doubt.lasts(now + 0.69) != without
    assert not doubt.lasts(now + 0.71)


def test_a_longer_doubt_is_not_made_shorter(doubting):
    odometry, frame, alignment, _ = doubting
    doubt, now = odometry._doubt, frame.timestamp
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(now))
    doubt.cast(now - 0.1, "for a test")
    doubt.moving_time = now - 0.3
    doubt.question(seen, alignment, Status.TRACKED, "")
    assert doubt.lasts(now + 0.89)
    assert doubt.reason == "for a test"


def test_what_is_far_is_told_in_the_world():
    of = movers(risen=SPOT)
    of.note(1.0, STILL, None)
    T = se3.exp(np.array([1.0, -2.0, 0.5, 0.2, 0.4, -0.3]))
    T_cam_world = se3.inverse(T)
    X = WALL @ T_cam_world[:3, :3].T + T_cam_world[:3, 3]
    away = np.linalg.norm(WALL[:, None] - SPOT, axis=-1).min(axis=1)
    np.testing.assert_array_equal(of.are_far(X, T), away > 0.35)
    rest = of.rest_of(Surface(X, None, None), T)
    np.testing.assert_array_equal(rest.points, X[away > 0.35])
    assert movers().are_far(X, T).all()


def test_it_makes_no_pose_better_than_it_is(doubting, monkeypatch):
    odometry, frame, alignment, _ = doubting
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    monkeypatch.setattr(odometry._doubt._witness, "question", lambda *_: 0.1)
    monkeypatch.setattr(odometry._doubt._witness, "question_apart", lambda *_: 0.0)
    monkeypatch.setattr(odometry._doubt.movers, "are_far", all_are_far)
    given = replace(seen, without_movers=True), alignment, Status.DEGRADED, "for a test"
    assert odometry._doubt.question(*given) == (Status.DEGRADED, "for a test")


def test_doubt_forgets_what_moved_with_what_was_seen(doubting):
    odometry, frame, alignment, _ = doubting
    of, time = odometry._doubt.movers, frame.timestamp

    def noted():
        of._moved = {(i,): (SPOT[0], {time - age}) for i, age in enumerate((0.0, 0.1, 0.2))}

    for forget, left in (
        (odometry._doubt.forget, 0),
        (odometry._doubt.rewind, 0),
        (lambda: odometry._doubt.forget_since(time - 0.15), 1),
        (lambda: odometry._doubt.finds_motion(odometry._front_end.see(
            frame, 40, None, odometry._detail(time)), alignment), 2),
    ):  # fmt: skip
        noted()
        forget()
        assert len(of._moved) == left


def test_a_clock_that_jumps_back_ends_doubt_about_the_future():
    of = movers()
    of.mind_doubt(20.5)
    of.forget(10.0)
    assert of._doubted <= 10.0


def test_what_is_lost_without_those_edges_is_registered_whole(doubting, monkeypatch):
    odometry, frame = doubting[:2]
    placer = odometry._placer
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    rest = replace(seen, samples=seen.samples.every(4), without_movers=True)
    monkeypatch.setattr(placer._movers, "apart", lambda *_: rest)
    assert placer.place(seen, 40).seen is rest
    few = replace(rest, samples=seen.samples.every(400))
    monkeypatch.setattr(placer._movers, "apart", lambda *_: few)
    assert len(placer.place(seen, 40).seen.samples) == len(seen.samples)
    parted = replace(seen, is_parted=True)
    assert placer.place(parted, 40).seen.without_movers is False


def test_where_much_is_said_to_move_little_may_be_left_out(doubting, monkeypatch):
    odometry, frame = doubting[:2]
    seen = odometry._front_end.see(frame, 40, None, odometry._detail(frame.timestamp))
    given = []
    monkeypatch.setattr(odometry._placer._movers, "apart", lambda _, *most: given.append(most))
    odometry._placer.place(seen, 40)
    odometry._doubt.moving_time = frame.timestamp
    odometry._placer.place(seen, 40)
    assert given == [(), (LITTLE,)]


# --------------------------------------------------------------------------------- a whole clip


@pytest.mark.parametrize("seed", range(2))
def test_what_moves_slowly_is_left_out_once_it_is_noticed(passing, seed):
    frames, _ = passing
    left, off = {}, {}
    for reach in (0, 0.35):
        off[reach], results = tracked(passing, f"seed={seed}", f"status.moving_m={reach}")
        left[reach] = [on_box(frames[i], results[i], i) for i in range(NOTICED, FRAMES)]
        if reach:
            assert {result.status for result in results[NOTICED:]} == {Status.TRACKED}
        else:
            assert sum(result.status is not Status.TRACKED for result in results[NOTICED:]) >= 2
    assert min(left[0]) > 0.25
    assert max(left[0.35]) < 0.1
    assert max(left[0.35][12:]) < 0.01
    assert off[0.35][NOTICED:].max() < off[0][NOTICED:].max() / 4


@pytest.mark.parametrize("reach", [0, 0.35])
def test_once_it_is_left_out_frames_are_sure_though_something_moves(passing, reach):
    odometry = Odometry(CAMERA, Config().with_overrides([f"status.moving_m={reach}"]))
    ask, states = odometry._doubt._witness.question, []
    for frame in passing[0]:
        if frame.timestamp > (NOTICED + 6) * PERIOD:  # as if it had just grown, or gone faster
            odometry._doubt._witness.question = lambda *given: 0.03 + ask(*given)
        states.append(odometry.track(frame).status)
    after = states[NOTICED + 7 :]
    assert set(after) == {Status.TRACKED if reach else Status.DEGRADED}


def on_box(frame, result, i):
    """Share of the samples that lie on the box."""
    middle = CAMERA.cx + (-0.5 + STEP * (i - STANDS) - AHEAD[0, 3] * i) * CAMERA.fx / 2
    u, v = result.alignment.pixels.astype(int).T
    return np.mean((np.abs(u - middle) < 66) & (np.abs(frame.depth[v, u] - 2) < 0.15))


def test_the_first_second_does_not_tell_what_moves(passing):
    frames, _ = passing
    odometry = Odometry(CAMERA, Config())
    asked = []
    odometry._doubt.movers.note = lambda timestamp, *_: asked.append(timestamp)
    for frame in frames[:40]:
        odometry.track(frame)
    assert asked
    assert min(asked) > 1.0
