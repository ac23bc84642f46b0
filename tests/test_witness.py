from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets.readahead import read_ahead
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.witness import AGE_S, MAX_AGE_S, Rest, Surface, Witness, step_px

from . import problems

CAMERA = Camera(640, 480, 535.4, 539.2, 320.1, 247.6)
BENT = Camera(640, 480, 517.3, 516.5, 318.6, 255.3, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633))
STILL = np.eye(4)
MOVED = se3.exp(np.array([0.03, -0.02, 0.05, 0.02, -0.03, 0.01]))


@cache
def rays(camera: Camera) -> NDArray[np.float64]:
    """Where the pixels of a camera look, row by row, at a depth of 1; shared, not to be changed."""
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    ideal = camera.undistort(pixels) if camera.is_distorted else pixels
    flat = (ideal - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    found = np.stack([flat[:, 0], flat[:, 1], np.ones(len(flat))])
    found.flags.writeable = False
    return found


def room(
    T_world_cam: NDArray[np.float64], *, camera: Camera = CAMERA, box: float | None = None
) -> NDArray[np.float32]:
    """See a wall at z = 3, a floor at y = 1, and a box 0.5 m wide at z = 2 and x = box."""
    way = T_world_cam[:3, :3] @ rays(camera)
    x0, y0, z0 = T_world_cam[:3, 3]
    depth = (3 - z0) / way[2]
    with np.errstate(divide="ignore"):
        floor = (1 - y0) / way[1]
    depth = np.where((floor > 0) & (floor < depth), floor, depth)
    if box is not None:
        near = (2 - z0) / way[2]
        x, y = x0 + near * way[0], y0 + near * way[1]
        depth = np.where((np.abs(x - box) < 0.25) & (np.abs(y) < 0.7), near, depth)
    return depth.reshape(camera.height, camera.width).astype(np.float32)


def noisy(depth: NDArray[np.float32], seed: int = 0) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    depth = depth + rng.normal(0, 0.002 * depth**2).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    return depth


def conflict(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    T_a_b: NDArray[np.float64],
    camera: Camera = CAMERA,
) -> float:
    witness = Witness(camera, "kinect_v1")
    return witness.conflict(witness.surface(a), witness.surface(b), T_a_b)


@pytest.mark.parametrize("camera", [CAMERA, BENT])
def test_a_scene_that_stands_still_does_not_contradict_the_right_pose(camera: Camera) -> None:
    a = noisy(room(STILL, camera=camera, box=0.1), 1)
    b = noisy(room(MOVED, camera=camera, box=0.1), 2)
    assert conflict(a, b, MOVED, camera) < 0.003


def test_a_wrong_pose_is_contradicted() -> None:
    a, b = noisy(room(STILL, box=0.1), 1), noisy(room(MOVED, box=0.1), 2)
    ahead = se3.exp(np.array([0.0, 0, 0.2, 0, 0, 0])) @ MOVED
    assert conflict(a, b, ahead) > 0.3


@pytest.mark.parametrize("direction", [-1, 1])
def test_what_moves_is_found_by_the_area_that_it_fills_or_frees(direction: int) -> None:
    a = noisy(room(STILL, box=0.0), 1)
    b = noisy(room(MOVED, box=0.15 * direction), 2)
    found = conflict(a, b, MOVED)
    # 0.15 m of the 0.5 m, less the margin at the contour, at both ends
    assert 0.01 < found < 0.08
    assert conflict(b, a, se3.inverse(MOVED)) == pytest.approx(found)


def test_a_larger_image_is_looked_at_as_widely() -> None:
    """A contour that lies 16 px off in one of twice the size contradicts as little."""
    assert [step_px(width) for width in (320, 640, 960, 1280)] == [4, 4, 6, 8]
    found = []
    for times, aside in ((1, 8), (2, 16)):
        camera = CAMERA.scaled(times)
        a = room(STILL, camera=camera, box=0.0)
        surface = Witness(camera, "kinect_v1").surface(a)
        assert surface.near.shape == (120, 160)
        found.append(conflict(a, np.roll(a, aside, axis=1), STILL, camera))
        moved = room(STILL, camera=camera, box=0.2)
        found.append(conflict(a, moved, STILL, camera))
    assert found[0] < 0.002
    assert found[1] > 0.02
    np.testing.assert_allclose(found[2:], found[:2], atol=0.004)


def test_what_comes_into_view_from_behind_is_no_contradiction() -> None:
    aside = se3.exp(np.array([0.3, 0, 0, 0, 0, 0]))
    a, b = room(STILL, box=0.0), room(aside, box=0.0)
    assert conflict(a, b, aside) == 0


def test_hardly_any_depth_says_nothing() -> None:
    a, b = room(STILL), np.zeros((480, 640), np.float32)
    b[200:220, 200:220] = 1.0
    assert conflict(a, b, STILL) == 0
    assert conflict(b, b, STILL) == 0


def test_it_is_asked_of_what_was_seen_a_moment_ago_and_not_long_ago() -> None:
    witness = Witness(CAMERA, "kinect_v1")
    free, blocked = witness.surface(room(STILL)), witness.surface(room(STILL, box=0.0))
    assert witness.question(0.0, STILL, blocked) == 0  # nothing was seen
    witness.remember(0.0, STILL, free)
    assert witness.question(0.03, STILL, blocked) > 0.05
    witness.remember(0.03, STILL, blocked)
    assert witness.question(0.06, STILL, blocked) > 0.05  # too young to be asked alone
    assert witness.question(0.04 + AGE_S, STILL, blocked) == 0
    assert witness.question(0.04 + AGE_S + MAX_AGE_S, STILL, free) == 0  # too old
    witness.remember(2.0, STILL, free)
    witness.forget()
    assert witness.question(2.1, STILL, blocked) == 0


@pytest.fixture(scope="module")
def crowd() -> SyntheticSource:
    return problems.Remembered(make_recipe("crowd", frames=7, camera=problems.CAMERA, seed=3))


def statuses(source: SyntheticSource, config: Config) -> list[Status]:
    odometry = Odometry(source.camera, config)
    frames = [reading.frame for reading in read_ahead(source, range(len(source)))]
    return [odometry.track(frame).status for frame in frames if frame is not None]


def test_where_people_take_the_pose_along_it_is_not_called_tracked(crowd: SyntheticSource) -> None:
    asked = statuses(crowd, Config())
    assert Status.TRACKED not in asked[4:]
    # by the sides of edges some are doubted without being asked
    unasked = Config().with_overrides(
        ["status.max_conflict=0", "status.min_told=0", "edges.depth_rule=window"]
    )
    assert set(statuses(crowd, unasked)) == {Status.TRACKED}


def test_where_nothing_moves_nobody_is_doubted() -> None:
    recipe = make_recipe("stairs", frames=5, camera=problems.CAMERA, seed=3)
    source = SyntheticSource(recipe)
    assert set(statuses(source, Config())) == {Status.TRACKED}


def test_the_preset_paper_does_not_ask() -> None:
    assert Config.preset("paper").status.max_conflict == 0


def test_the_less_time_there_was_to_move_in_the_more_a_conflict_says() -> None:
    free, blocked = (
        Witness(CAMERA, "kinect_v1").surface(room(STILL, **box)) for box in ({}, {"box": 0.0})
    )
    asked = {}
    for age in (0.01, 0.5 * AGE_S, 0.8 * AGE_S, AGE_S, 2 * AGE_S):
        witness = Witness(CAMERA, "kinect_v1")
        witness.remember(0.0, STILL, free)
        asked[age] = witness.question(age, STILL, blocked)
    full = asked[AGE_S]
    assert full > 0.02
    expected = [2 * full, 2 * full, full / 0.8, full, full]
    np.testing.assert_allclose(list(asked.values()), expected)


def asked_apart(box: float, rest_of: Rest) -> tuple[float, float]:
    """Of a box that has moved: what contradicts, and of the points that count alone."""
    witness = Witness(CAMERA, "kinect_v1")
    witness.remember(1.0, STILL, witness.surface(room(STILL, box=0.0)))
    surface, when = witness.surface(room(MOVED, box=box)), 1.0 + AGE_S / 2
    whole = witness.question(when, MOVED, surface)
    return whole, witness.question_apart(when, MOVED, rest_of(surface, MOVED), rest_of)


def left_of(limit: float) -> Rest:
    def rest_of(surface: Surface, T: NDArray[np.float64]) -> Surface:
        is_left = (surface.points @ T[:3, :3].T + T[:3, 3])[:, 0] < limit
        return replace(surface, points=surface.points[is_left])

    return rest_of


def test_some_of_the_points_may_be_asked_alone() -> None:
    """Those that count are told by where they are in the world."""
    whole, apart = asked_apart(0.2, left_of(9.0))
    assert apart == whole > 0.02
    assert asked_apart(0.2, left_of(-0.3))[1] == 0
    assert asked_apart(-0.2, left_of(-0.1))[1] > 0.02


def test_of_hardly_any_points_nothing_is_known() -> None:
    assert asked_apart(0.0, left_of(-9.0)) == (0.0, np.inf)
    witness = Witness(CAMERA, "kinect_v1")
    surface = witness.surface(room(STILL))
    assert witness.question(1.0, STILL, surface) == 0
    assert witness.question_apart(1.0, STILL, surface, left_of(9.0)) == np.inf


def test_what_counts_is_asked_of_the_image_that_was_asked() -> None:
    asked, far = [], se3.exp(np.array([1.0, 0, 0, 0, 0, 0]))

    def rest_of(surface: Surface, T: NDArray[np.float64]) -> Surface:
        asked.append((surface, T[0, 3]))
        return surface

    witness = Witness(CAMERA, "kinect_v1")
    then, holes = witness.surface(room(far)), room(far)
    holes[::2] = 0
    witness.remember(1.0, far, then)
    witness.remember(1.0 + AGE_S, STILL, witness.surface(holes))  # too young to be asked
    given = 1.05 + AGE_S, STILL, witness.surface(room(STILL))
    witness.question(*given)
    witness.question_apart(*given, rest_of)
    ((surface, x),) = asked
    assert surface is then
    assert x == 1
