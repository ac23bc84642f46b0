"""What stands still is told from what moves by itself, and followed."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import crowd
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.background import AGES_S, APART_S, FAR_EDGES, FAR_LEFT, Align, Background, Still
from edvo.config import Config
from edvo.datasets import open_source
from edvo.datasets.readahead import read_ahead
from edvo.doubt import MOVED
from edvo.edges import EdgePixels
from edvo.frame import Frame
from edvo.keyframes import Keyframe
from edvo.matching import Criterion, EdgeIndex
from edvo.odometry import Odometry, Status
from edvo.placing import Placed
from edvo.planes import PlaneFitter, PlaneMap, PlanePoints
from edvo.registration import AT_ONCE, Alignment
from edvo.report.sights import look
from edvo.seen import Seen
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins
from .test_kernels import both
from .test_witness import CAMERA, STILL, noisy, room

PINHOLE = kernels.Pinhole(535.4, 539.2, 320.1, 247.6, 640, 480)
FOLLOW = ("status.moving=follow",)
# keyframes that last, and edges that count alike: the pose goes along the farther
LONG = ("keyframes.max_translation_m=0.3", "registration.profile_spread=0")
# by whose luck these people are noticed late
LATE = (
    *LONG,
    "registration.kept_px=0",
    "edges.grey_steps=1",
    "keyframes.edge_scale=1",
    "edges.depth_rule=window",
    "motion.along_px=0",
    "status.first_agreeing=0.67",
)


def background() -> Background:
    return Background(CAMERA, PlaneFitter(CAMERA, Config().planes))


def errors(
    source: SyntheticSource, indices: range, *changes: str
) -> tuple[NDArray[np.float64], list[Status]]:
    """Distance to the truth, metres, and the status of each frame."""
    frames = [reading.frame for reading in read_ahead(source, indices)]
    return followed(source, [frame for frame in frames if frame is not None], *changes)


def followed(
    source: SyntheticSource, frames: Sequence[Frame], *changes: str
) -> tuple[NDArray[np.float64], list[Status]]:
    """The same, of frames that were taken there."""
    odometry = Odometry(source.camera, Config().with_overrides(changes))
    results = [odometry.track(frame) for frame in frames]
    truth = [source.recipe.motion.at(result.timestamp) for result in results]
    away = [
        (truth[0] @ result.T_world_cam)[:3, 3] - true[:3, 3]
        for result, true in zip(results, truth, strict=True)
    ]
    return np.linalg.norm(away, axis=1), [result.status for result in results]


@pytest.fixture(scope="module")
def small_hall() -> SyntheticSource:
    """A crowd whose walls are within the reach of depth: three people, a third of the view."""
    return problems.Remembered(make_recipe(crowd.small_hall(), frames=260, speed=0.35, seed=4))


def test_where_a_third_of_the_view_moves_the_rest_is_followed(small_hall: SyntheticSource) -> None:
    indices = range(240, 260)
    view = small_hall.render(250).things
    world = small_hall._renderer.world
    walking = np.unique(world.at(0.0).thing[world._walker >= 0])
    assert np.isin(view, walking).mean() == pytest.approx(1 / 3, abs=0.1)
    away, statuses = errors(small_hall, indices)
    assert away[:6].max() > 0.01  # the pose goes along before it is noticed, and comes back
    assert away[6:].max() < 0.01
    assert set(statuses[1:]) == {Status.DEGRADED}  # the edges of the walls are missed at once
    assert errors(small_hall, range(240, 243), "status.min_told=0")[1][1] is Status.TRACKED
    assert errors(small_hall, indices, *FOLLOW, *LONG)[0][6:].max() > 0.02


def test_depth_that_is_late_is_taken_so_where_much_of_the_view_moves(
    small_hall: SyntheticSource,
) -> None:
    away, statuses = followed(small_hall, late(small_hall, range(240, 260)))
    assert set(statuses[2:]) == {Status.DEGRADED}
    assert away[7:].max() < 0.02  # the pose goes along before that


def late(source: SyntheticSource, indices: range) -> list[Frame]:
    """Frames that have the depth of the one before each, and say so."""
    readings = read_ahead(source, range(indices.start - 1, indices.stop))
    frames = [reading.frame for reading in readings if reading.frame is not None]
    return [
        replace(frame, depth=old.depth, depth_delay=old.timestamp - frame.timestamp)
        for old, frame in itertools.pairwise(frames)
    ]


def test_parts_stay_where_they_were_expected_as_long_as_the_last_pose_is_wrong(
    small_hall: SyntheticSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    odometry = Odometry(small_hall.camera)
    registrar, placer = odometry._locator.registrar, odometry._placer
    register, confirm = registrar.register, placer.confirm
    at_once: list[bool] = []
    confirmed: list[tuple[Placed, Placed, bool]] = []

    def registered(*given: Any, **options: Any) -> Alignment:
        at_once.append(options.get("at_once", False))
        return register(*given, **options)

    def confirming(placed: Placed) -> Placed:
        at_once.clear()
        result = confirm(placed)
        confirmed.append((placed, result, any(at_once)))
        return result

    monkeypatch.setattr(registrar, "register", registered)
    monkeypatch.setattr(placer, "confirm", confirming)
    for frame in late(small_hall, range(240, 252)):
        odometry.track(frame)
    backs = [before.still is None and after.still is not None for before, after, _ in confirmed]
    assert [asked for *_, asked in confirmed] == backs
    assert 0 < sum(backs) < len(backs) - 3
    for (before, after, _), back in zip(confirmed, backs, strict=True):
        parts = [(before.seen, after.seen)]
        if before.still and after.still:
            parts.append((before.still.seen, after.still.seen))
        for was, now in parts:
            there, here = was.T_world_depth(np.eye(4)), now.T_world_depth(np.eye(4))
            assert np.array_equal(there, here) == back


@pytest.fixture(scope="module")
def far_hall() -> SyntheticSource:
    """A crowd whose walls have no depth."""
    return problems.Remembered(make_recipe("crowd", frames=25, seed=3))


def test_where_walls_are_out_of_reach_their_edges_hold_the_pose(far_hall: SyntheticSource) -> None:
    assert errors(far_hall, range(25))[0][8:].max() < 0.1
    assert errors(far_hall, range(25), *FOLLOW)[0][8:].min() > 0.3


@pytest.fixture(scope="module")
def others() -> SyntheticSource:
    """A hall that people fill, who are noticed late."""
    return problems.Remembered(make_recipe(crowd.other_people(3), frames=14, seed=3))


def test_where_people_fit_no_longer_the_hall_is_found_in_the_frame(others: SyntheticSource) -> None:
    away, statuses = errors(others, range(14), *LATE)
    assert away[7] > 0.1  # gone along with them
    assert away[8:].max() < 0.06
    assert set(statuses[8:]) == {Status.DEGRADED}
    away, statuses = errors(others, range(14), *LATE, *FOLLOW)
    assert set(statuses[8:13]) == {Status.LOST}  # depth leads half of the way back in the last one
    assert away[12] > 0.3


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_what_stands_still_is_no_place_unless_the_rest_moves_past_it(
    others: SyntheticSource, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Edges that fit no more where nothing moves, or all does, are another place's."""
    odometry = Odometry(others.camera, Config().with_overrides(LATE))
    frames = [reading.frame for reading in read_ahead(others, range(9))]
    for index, frame in enumerate(frames):
        assert frame is not None
        if index == 8:
            monkeypatch.setattr(odometry._doubt._witness, "question", lambda *given: share)
        result = odometry.track(frame)
        assert (result.status is Status.LOST) == (index == 8)


def test_where_nothing_moves_nothing_changes() -> None:
    source = problems.Remembered(make_recipe("stairs", frames=12, seed=3))
    with_it, without = errors(source, range(12)), errors(source, range(12), *FOLLOW)
    np.testing.assert_array_equal(with_it[0], without[0])
    assert with_it[1] == without[1] == [Status.TRACKED] * 12


@pytest.fixture(scope="module")
def still() -> SyntheticSource:
    """An office, where nothing moves."""
    return problems.Remembered(make_recipe("office", frames=14, seed=3))


def test_where_it_is_mistaken_and_nothing_moves_poses_stay_right(still: SyntheticSource) -> None:
    """As if the witness had seen something move a moment ago."""
    source, odometry = still, Odometry(still.camera)
    for reading in read_ahead(source, range(14)):
        assert reading.frame is not None
        if reading.index == 6:
            odometry._doubt.moving_time = reading.frame.timestamp - 1e-3
        result = odometry.track(reading.frame)
        true = source.recipe.motion.at(0.0) @ result.T_world_cam
        away = np.linalg.norm((true - source.recipe.motion.at(result.timestamp))[:3, 3])
        assert away < 0.005
        assert result.status is (Status.DEGRADED if reading.index >= 6 else Status.TRACKED)


@pytest.fixture(scope="module")
def office(still: SyntheticSource) -> tuple[SyntheticSource, list[Frame]]:
    """Where nothing moves."""
    return still, [frame for i in range(9) if (frame := still.read(i).frame) is not None]


def after_eight(source: SyntheticSource, frames: list[Frame], bound: float) -> Odometry:
    """Depth that is off by more than ``bound`` times its noise is out of step."""
    changes = [f"status.max_depth_sigma={bound}", "motion.inertia=none"]  # where it is put stands
    odometry = Odometry(source.camera, Config().with_overrides(changes))
    for frame in frames[:8]:
        assert odometry.track(frame).status is Status.TRACKED
    return odometry


@pytest.mark.parametrize(
    ("stride", "bound", "is_followed"), [(1, 1e-6, True), (3, 1e-6, False), (3, 5.0, True)]
)
def test_less_than_half_is_not_followed_where_depth_is_out_of_step(
    office: tuple[SyntheticSource, list[Frame]],
    monkeypatch: pytest.MonkeyPatch,
    stride: int,
    bound: float,
    is_followed: bool,
) -> None:
    source, frames = office
    odometry = after_eight(source, frames, bound)
    aside = se3.exp(np.array([0.05, 0, 0, 0, 0, 0]))
    register = odometry._standing._background.register

    def astray(*given: Any) -> Still | None:
        still = register(*given)
        assert still is not None
        seen = replace(still.seen, samples=given[1].samples.every(stride))
        n, found = len(seen.samples), still.alignment
        there = replace(
            found,
            T_ref_cur=found.T_ref_cur @ aside,
            matches=np.resize(found.matches, n),
            residuals=np.resize(found.residuals, n),
            trust=np.resize(found.trust, n),
            pixels=np.resize(found.pixels, (n, 2)),
            lag=AT_ONCE,
        )
        return replace(still, seen=seen, alignment=there)

    monkeypatch.setattr(odometry._standing._background, "register", astray)
    odometry._doubt.moving_time = frames[8].timestamp - 1e-3
    odometry._doubt.cast(frames[8].timestamp - 1e-3, MOVED)
    result = odometry.track(frames[8])
    true = source.recipe.motion.at(0.0) @ result.T_world_cam
    away = np.linalg.norm((true - source.recipe.motion.at(result.timestamp))[:3, 3])
    assert result.status is Status.DEGRADED
    assert (away > 0.04) if is_followed else (away < 0.005)


@pytest.mark.parametrize(
    ("bound", "conflict", "goes_back"), [(1e-6, 0.1, False), (5.0, 0.1, True), (1e-6, 0.5, True)]
)
def test_a_frame_whose_depth_is_out_of_step_is_registered_anew_only_if_else_lost(
    office: tuple[SyntheticSource, list[Frame]],
    monkeypatch: pytest.MonkeyPatch,
    bound: float,
    conflict: float,
    goes_back: bool,
) -> None:
    source, frames = office
    odometry = after_eight(source, frames, bound)
    called: list[Seen] = []
    monkeypatch.setattr(odometry._standing, "_go_back", called.append)
    monkeypatch.setattr(odometry._doubt._witness, "question", lambda *given: conflict)
    odometry._doubt.forget()  # else it has just been asked
    result = odometry.track(frames[8])
    assert result.status is (Status.LOST if conflict > 0.3 else Status.DEGRADED)
    assert "something moves" in result.reason
    assert bool(called) == goes_back


def seen_at(timestamp: float, depth: NDArray[np.float32]) -> Frame:
    return Frame(timestamp, np.zeros(depth.shape, np.uint8), depth)


def test_a_past_that_is_too_young_to_go_back_to_is_kept() -> None:
    past = background()
    assert not past.reaches(1.0)
    past.remember(seen_at(1.0, np.ones((480, 640), np.float32)), np.eye(4))
    assert not past.reaches(1.0)
    assert past.reaches(1.01)


def test_depth_is_kept_though_its_memory_is_used_again() -> None:
    past, depth = background(), np.ones((480, 640), np.float32)
    past.remember(seen_at(1.0, depth), np.eye(4))
    depth[:] = 9.0
    assert (past._past[0].depth == 1.0).all()


def test_a_clock_that_starts_over_ends_the_doubt(small_hall: SyntheticSource) -> None:
    odometry = Odometry(small_hall.camera)
    for reading in read_ahead(small_hall, range(240, 248)):
        assert reading.frame is not None
        odometry.track(reading.frame)
    assert odometry._standing.is_moving(reading.frame.timestamp)
    odometry.skip(reading.frame.timestamp - 5, "starts over")
    assert not odometry._standing.is_moving(reading.frame.timestamp)
    assert odometry._standing._background.last_pose() is None


def test_what_was_registered_of_such_a_frame_can_be_drawn(small_hall: SyntheticSource) -> None:
    config = Config()
    odometry = Odometry(small_hall.camera, config)
    for reading in read_ahead(small_hall, range(240, 250)):
        assert reading.frame is not None
        result = odometry.track(reading.frame)
    assert result.status is Status.DEGRADED
    assert result.alignment is not None
    drawn = look(reading.frame, result, small_hall.camera, config)
    assert len(drawn.samples) == result.alignment.match_count
    assert drawn.samples.min() > 0


@pytest.mark.parametrize(
    ("stride", "speed", "is_place"),
    [(1, 0.0, True), (1, 20.0, True), (40, 0.0, True), (40, 20.0, False)],
)
def test_edges_without_depth_alone_are_no_place_but_where_it_was_bound_for(
    hall: tuple[Background, Keyframe, Seen, Align],
    monkeypatch: pytest.MonkeyPatch,
    stride: int,
    speed: float,
    is_place: bool,
) -> None:
    """One in six is left in the end beside what else stands still; alone all, and only if near."""
    kept, key, seen, align = hall
    standing, start = kept._standing, se3.inverse(key.T_world_key) @ kept._past[-1].T_world_cam

    def some(view: Any, T: NDArray[np.float64]) -> Seen:
        held = standing(view, T)
        return replace(held, samples=held.samples.every(stride))

    monkeypatch.setattr(kept, "_standing", some)
    still = kept.register(key, seen, [start], np.array([0, 0, speed, 0, 0, 0]), align)
    assert (still is not None) == is_place
    if still is not None:
        far = np.count_nonzero(still.seen.samples.depths > seen.samples.depths.max())
        assert still.is_far == (stride > 1)
        assert (far > FAR_EDGES / 2) if still.is_far else (far <= FAR_EDGES / FAR_LEFT + 1)


@pytest.fixture(scope="module")
def hall(far_hall: SyntheticSource) -> tuple[Background, Keyframe, Seen, Align]:
    """On the way through a crowd, whose walls have no depth."""
    return on_the_way(far_hall, range(9))


def on_the_way(source: SyntheticSource, indices: range) -> tuple[Background, Keyframe, Seen, Align]:
    """What knows the past of a way, its keyframe, the last frame, and how it is registered."""
    odometry = Odometry(source.camera)
    registered: list[Seen] = []
    register = odometry._standing.register

    def noted(seen: Seen) -> tuple[Alignment, Status, str, Still | None]:
        registered.append(seen)
        return register(seen)

    odometry._standing.register = noted  # type: ignore[method-assign]
    for reading in read_ahead(source, indices):
        assert reading.frame is not None
        odometry.track(reading.frame)
    seen = registered[-1].kept()
    registrar = odometry._locator.registrar
    term = registrar.term(seen.frame.timestamp)

    def align(kept: Seen, T_key_start: NDArray[np.float64]) -> Alignment:
        return registrar.register(kept, T_key_start[None], term)

    return odometry._standing._background, odometry._course.key, seen, align


def test_a_kinect_that_turns_fast_between_few_frames_is_not_led_astray(real_data: Path) -> None:
    """Its depth is out of step, so that something seems to move, and little to stand still."""
    sequence = open_source(real_data / "tum_fr1_xyz")
    truth = sequence.ground_truth
    assert truth is not None
    frames = [sequence.read(index).frame for index in range(1, len(sequence), 6)]
    odometry = Odometry(sequence.camera, Config(seed=1))
    poses = {frame.timestamp: odometry.track(frame).T_world_cam for frame in frames if frame}
    known = [time for time in poses if truth.timestamps[0] <= time <= truth.timestamps[-1]]
    for before, after in itertools.pairwise(known):
        true = se3.inverse(truth.at(before)) @ truth.at(after)
        assert se3.distance(true, se3.inverse(poses[before]) @ poses[after]) < 0.15


def test_the_preset_paper_follows_whatever_moves() -> None:
    assert Config.preset("paper").status.moving == "follow"


def test_images_are_kept_a_while_and_not_all_of_them() -> None:
    kept = background()
    depth = room(STILL)
    for k in range(60):
        kept.remember(seen_at(k / 30, depth), se3.exp(np.array([k, 0, 0, 0, 0, 0.0])))
    times = [past.timestamp for past in kept._past]
    assert min(np.diff(times)) >= APART_S - 1e-9
    assert 59 / 30 - times[0] <= AGES_S[-1] + 2 * APART_S
    assert times[-1] > 59 / 30 - APART_S - 1e-9
    kept.forget(1.5)
    last = kept.last_pose()
    assert last is not None
    assert last[0, 3] < 45
    kept.remember(seen_at(0.0, depth), STILL)  # the clock has jumped back
    assert [past.timestamp for past in kept._past] == [0.0]
    kept.forget()
    assert kept.last_pose() is None


def test_a_box_that_has_moved_is_told_from_the_wall() -> None:
    fitter = PlaneFitter(CAMERA, Config().planes)
    planes = fitter.planes(noisy(room(STILL, box=-0.3), 1))
    points = fitter.points(noisy(room(STILL, box=0.3), 2))
    held, broken = weighed(points, planes, STILL)
    on_box = points.X[:, 2] < 2.2
    wall = points.X[:, 2] > 2.8
    assert held[wall].mean() > 0.6  # where the box was nothing is known, nor contradicted
    assert broken[wall].mean() < 0.05
    assert held[on_box].mean() < 0.05
    assert broken[on_box].mean() > 0.6
    X = np.array([[0.3, 0.0, 2.0], [1.2, 0.0, 3.0], [0.3, 0.0, 1.0]])
    still = asked(points, held, broken, X)
    np.testing.assert_array_equal(still, [False, True, False])


def weighed(
    points: PlanePoints, planes: PlaneMap, T: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    held, broken = np.zeros((2, len(points.sigma)), np.int32)
    kernels.weigh_points(points, planes, PINHOLE, T, 2.5, 0.8, 0.25, held, broken)
    return held, broken


def asked(
    points: PlanePoints,
    held: NDArray[np.int32],
    broken: NDArray[np.int32],
    X: NDArray[np.float64],
) -> NDArray[np.bool_]:
    still = np.empty(len(X), np.bool_)
    kernels.ask_neighbours(points, held, broken, PINHOLE, 16.0, 2, 0.01, 2.0, X, still)
    return still


# ---------------------------------------------------------------------- kernels and their twins


@pytest.mark.parametrize("seed", range(3))
def test_points_are_weighed_and_neighbours_asked_as_the_twins_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fitter = PlaneFitter(CAMERA, Config().planes)
    planes = fitter.planes(noisy(room(STILL, box=-0.1), seed))
    points = fitter.points(noisy(room(STILL, box=0.2), seed + 10))
    T = problems.motion(rng, 0.05, 2.0)
    (held, broken), expected = both(
        "weigh_points",
        lambda: weighed(points, planes, T),
        lambda: twins.weigh_points(points, planes, PINHOLE, T, 2.5, 0.8, 0.25),
    )
    assert 0 < held.sum() < len(held)
    assert 0 < broken.sum() < len(broken)
    np.testing.assert_array_equal(held, expected[0])
    np.testing.assert_array_equal(broken, expected[1])
    X = points.X[::3] * rng.uniform(0.98, 1.02, (len(points.X[::3]), 1))
    still, expected_still = both(
        "ask_neighbours",
        lambda: asked(points, held, broken, X),
        lambda: twins.ask_neighbours(points, held, broken, PINHOLE, 16.0, 2, 0.01, 2.0, X),
    )
    assert 0 < still.mean() < 1
    np.testing.assert_array_equal(still, expected_still)


@pytest.mark.parametrize("stride", [1, 3])
def test_edges_without_depth_are_found_as_the_twin_does(stride: int) -> None:
    rng = np.random.default_rng(1)
    depth = np.zeros((60, 80), np.float32)
    depth[20:40, 30:50] = 2.0
    index = np.flatnonzero(rng.random(depth.shape) < 0.2).astype(np.int32)
    chosen = np.empty(len(index), np.int32)
    count, expected = both(
        "edges_without_depth",
        lambda: kernels.edges_without_depth(index, depth, stride, 8, 4, chosen),
        lambda: twins.edges_without_depth(index, depth, stride, 8, 4),
    )
    assert 0 < count < len(index[::stride])
    np.testing.assert_array_equal(chosen[:count], expected)


def test_rays_fit_at_their_own_depth_as_the_twin_says() -> None:
    rng = np.random.default_rng(2)
    angle = rng.uniform(0, 2 * math.pi, 300)
    gradients = np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    pixels = rng.uniform(40, 440, (300, 2)).astype(np.float32)
    index = EdgeIndex(EdgePixels(pixels, gradients, np.zeros(300, np.float32)), "grid", 8.0)
    rays = np.column_stack(
        [(pixels[:, 0] - 320.1) / 535.4, (pixels[:, 1] - 247.6) / 539.2, np.ones(300)]
    )
    T = se3.exp(np.array([0.3, -0.1, 0.1, 0.01, -0.02, 0.01]))
    seen = (rays * 5.0 - T[:3, 3]) @ T[:3, :3]  # of points that are 5 m away
    seen /= seen[:, 2:]
    nearness = np.array([0.0, 0.1, 0.2, 0.5])
    fits = np.empty((4, 300))
    criterion = Criterion(0.0, 640, 2.0, 45.0).compile()
    rays = (seen, gradients, PINHOLE, T)
    _, expected = both(
        "fit_rays",
        lambda: kernels.fit_rays(index.grid, *rays, criterion, nearness, 1.0, fits),
        lambda: twins.fit_rays(index.edges, *rays, 2.0, 45.0, nearness, 1.0),
    )
    assert fits.mean(axis=1).argmax() == 2
    np.testing.assert_allclose(fits, expected)
