"""Directional chamfer matching: scores against brute force, and turns that are found."""

import math

import numpy as np
import pytest

from edvo import chamfer, kernels, se3
from edvo.camera import Camera
from edvo.chamfer import ChamferMap
from edvo.edges import EdgePixels

from . import twins
from .test_kernels import both

CAMERA = Camera(width=320, height=240, fx=260.0, fy=262.0, cx=158.5, cy=121.0)


@pytest.fixture
def edges() -> EdgePixels:
    """Edges with depth, clustered as in images: chance alone gives no place away."""
    rng = np.random.default_rng(3)
    points = []
    for _ in range(40):
        along = np.linspace(0, rng.uniform(10, 60), 20)
        u, v, angle = rng.uniform(5, 315), rng.uniform(5, 235), rng.uniform(0, 2 * np.pi)
        points.append(
            np.column_stack(
                [
                    u + along * np.cos(angle),
                    v + along * np.sin(angle),
                    np.full(20, -np.sin(angle)),
                    np.full(20, np.cos(angle)),
                    np.full(20, rng.uniform(1.5, 4.0)),
                ]
            )
        )
    table = np.concatenate(points).astype(np.float32)
    inside = (table[:, 0] > 0) & (table[:, 0] < 319) & (table[:, 1] > 0) & (table[:, 1] < 239)
    table = table[inside]
    return EdgePixels(
        np.ascontiguousarray(table[:, :2]),
        np.ascontiguousarray(table[:, 2:4]),
        np.ascontiguousarray(table[:, 4]),
    )


def seen_from(edges: EdgePixels, T_ref_cur: np.ndarray) -> EdgePixels:
    """Carry edges over to the camera that looks from elsewhere."""
    points = edges.points(CAMERA)
    moved = (points - T_ref_cur[:3, 3]) @ T_ref_cur[:3, :3]
    roll = math.atan2(T_ref_cur[1, 0], T_ref_cur[0, 0])
    turn = np.array([[math.cos(roll), math.sin(roll)], [-math.sin(roll), math.cos(roll)]])
    pixels = moved[:, :2] / moved[:, 2:] * (CAMERA.fx, CAMERA.fy) + (CAMERA.cx, CAMERA.cy)
    keep = (pixels > 0).all(1) & (pixels[:, 0] < 319) & (pixels[:, 1] < 239)
    return EdgePixels(
        np.ascontiguousarray(pixels[keep], np.float32),
        np.ascontiguousarray((edges.gradients @ turn.T)[keep], np.float32),
        np.ascontiguousarray(moved[keep, 2], np.float32),
    )


def test_directions_go_round_once() -> None:
    angles = np.radians(np.arange(0, 360, 45) + 10)
    gradients = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
    directions = np.empty(8, np.int32)
    kernels.directions_of(gradients, directions)
    assert directions.tolist() == list(range(8))


def test_directions_are_those_of_the_twin() -> None:
    axes = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    gradients = np.random.default_rng(2).normal(size=(500, 2)).astype(np.float32)
    gradients = np.concatenate([gradients, np.array(axes, np.float32)])  # on the borders, too
    directions, expected = both(
        "directions_of",
        lambda: kernels.directions_of(gradients, found := np.empty(508, np.int32)) or found,
        lambda: twins.directions_of(gradients),
    )
    np.testing.assert_array_equal(directions, expected)


def test_scores_say_how_near_an_edge_of_like_direction_is(edges: EdgePixels) -> None:
    scores = chamfer.score_image(edges, CAMERA.width, CAMERA.height)
    assert scores.shape == (62, 82, 8)
    assert not scores[[0, -1]].any()  # beside the image
    assert not scores[:, [0, -1]].any()
    cells = np.floor((edges.pixels + 0.5) / chamfer.CELL_PX) + 1
    directions = twins.directions_of(edges.gradients)
    rng = np.random.default_rng(0)
    for _ in range(300):
        k, row, col = rng.integers(8), rng.integers(1, 61), rng.integers(1, 81)
        alike = np.isin((directions - k) % 8, (0, 1, 7))
        away = np.hypot(*(cells[alike] - (col, row)).T).min()
        expected = 255 * max(1 - away / chamfer.REACH_CELLS, 0)
        assert abs(scores[row, col, k] - expected) <= 255 * 0.06  # steps to 8 neighbours err so


def test_scores_are_those_of_the_twin(edges: EdgePixels) -> None:
    gradients = edges.gradients
    given = edges.pixels, gradients, chamfer.CELL_PX, chamfer.STRAIGHT, chamfer.SLANT
    scores, expected = both(
        "chamfer_scores",
        lambda: chamfer.score_image(edges, CAMERA.width, CAMERA.height),
        lambda: twins.chamfer_scores(*given, (62, 82, 8)),
    )
    np.testing.assert_array_equal(scores, expected)


@pytest.mark.parametrize("yaw", [0.03, 0.3, 0.8])
def test_the_score_is_that_of_the_twin(edges: EdgePixels, yaw: float) -> None:
    """Where half of it or less is in view, too."""
    problem = ChamferMap(edges, CAMERA)._problem(edges.every(3))
    T = se3.exp(np.array([0.02, -0.05, 0.1, 0.02, yaw, -0.04]))
    room = np.empty(len(problem.directions), np.int32)
    score, expected = both(
        "chamfer_score",
        lambda: kernels.chamfer_score(problem, T, room),
        lambda: twins.chamfer_score(problem, T),
    )
    assert score == pytest.approx(expected, abs=1.5)  # float32 moves a few to the next cell


def test_a_sweep_scores_poses_along_a_twist(edges: EdgePixels) -> None:
    problem = ChamferMap(edges, CAMERA)._problem(edges.every(3))
    rng, scores = np.random.default_rng(8), np.empty(7)
    T, twist = se3.exp(rng.normal(0, 0.05, 6)), rng.normal(0, 0.02, 6)
    kernels.chamfer_sweep(problem, T, twist, 1.5, scores)
    room = np.empty(len(problem.directions), np.int32)
    for k, score in enumerate(scores):
        there = se3.exp(1.5 * (k - 3) * twist) @ T
        assert score == pytest.approx(kernels.chamfer_score(problem, there, room), abs=1e-9)
    assert len(set(scores)) > 3


@pytest.mark.parametrize("asked", [12, 30])
@pytest.mark.parametrize(("apart_deg", "apart_m"), [(3.0, 0.1), (8.0, 1e3), (0.0, 0.0)])
def test_the_search_is_that_of_the_twin(
    edges: EdgePixels, apart_deg: float, apart_m: float, asked: int
) -> None:
    problem = ChamferMap(edges, CAMERA)._problem(edges.every(2))
    rng = np.random.default_rng(5)
    starts = np.array([se3.exp(rng.normal(0, 0.15, 6)) for _ in range(30)])
    room = np.empty(len(problem.directions), np.int32)
    found, scores = np.empty((5, 4, 4)), np.empty(5)
    bounds = (1 + 2 * math.cos(math.radians(apart_deg)), apart_m)
    few, climb = room[: (len(room) + 3) // 4], (0.1, 0.02, 3, 2)
    count, (poses, expected) = both(
        "chamfer_search",
        lambda: kernels.chamfer_search(problem, starts, *bounds, asked, *climb, found, scores),
        lambda: twins.chamfer_search(
            lambda T: kernels.chamfer_score(problem, T, few),
            lambda T: kernels.chamfer_score(problem, T, room),
            starts,
            *bounds,
            asked,
            *climb,
            5,
        ),
    )
    assert count == len(poses) > 1
    np.testing.assert_allclose(found[:count], poses, atol=1e-9)
    np.testing.assert_allclose(scores[:count], expected)


def test_at_home_all_edges_fall_on_edges(edges: EdgePixels) -> None:
    assert ChamferMap(edges, CAMERA).score(edges, np.eye(4)) > 250


@pytest.mark.parametrize("yaw", [-20.0, -7.0, 11.0, 19.0])
def test_a_wide_turn_is_found(edges: EdgePixels, yaw: float) -> None:
    T = se3.exp(np.array([0.03, 0.02, -0.05, math.radians(4.0), math.radians(yaw), 0.03]))
    found = ChamferMap(edges, CAMERA).likely(seen_from(edges, T), np.eye(4), 24.0, 3)
    assert [guess.score for guess in found] == sorted((g.score for g in found), reverse=True)
    off = se3.inverse(T) @ found[0].T_ref_cur
    assert math.degrees(se3.rotation_angle(off)) < 2.0
    assert np.linalg.norm(off[:3, 3]) < 0.15


@pytest.mark.parametrize("carried", [True, False])
def test_near_by_a_way_is_told_from_a_turn(edges: EdgePixels, carried: bool) -> None:
    """By 0.2 m past what is half a metre away; turns alone end elsewhere."""
    near = EdgePixels(edges.pixels, edges.gradients, edges.depths / 5)
    T = se3.exp(np.array([0.2, -0.05, 0.0, 0.0, 0.0, 0.0]))
    found = ChamferMap(near, CAMERA).likely(seen_from(near, T), np.eye(4), 24.0, 1, carried=carried)
    off = np.linalg.norm((se3.inverse(T) @ found[0].T_ref_cur)[:3, 3])
    assert off < 0.03 if carried else off > 0.05


def test_beside_a_pose_it_climbs(edges: EdgePixels) -> None:
    look = ChamferMap(edges, CAMERA)
    starts = np.array([se3.exp(np.array([s, 0.0, 0.0, 0.0, 0.0, 0.0])) for s in (0.08, -0.3, 0.5)])
    found = look.beside(edges, starts)
    assert len(found) == 3
    assert found[0].score > look.score(edges, starts[0])
    assert np.linalg.norm(found[0].T_ref_cur[:3, 3]) < 0.06
    for guess in found:
        assert guess.score == pytest.approx(look.score(edges, guess.T_ref_cur))


def test_what_lies_behind_the_camera_is_not_in_view(edges: EdgePixels) -> None:
    back = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, math.pi, 0.0]))
    assert ChamferMap(edges, CAMERA).score(edges, back) == 0.0


def test_nothing_to_see_scores_nothing(edges: EdgePixels) -> None:
    nothing = EdgePixels(*(np.empty((0, k), np.float32) for k in (2, 2)), np.empty(0, np.float32))
    assert ChamferMap(edges, CAMERA).score(nothing, np.eye(4)) == 0.0
    assert ChamferMap(nothing, CAMERA).score(edges, np.eye(4)) == 0.0
