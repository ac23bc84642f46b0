from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.errors import OutputError
from edvo.evaluation import evaluate
from edvo.report.plots import Scene, draw_evaluation, draw_scenes, edge_picture
from edvo.trajectory import Trajectory


def paths() -> tuple[Trajectory, Trajectory]:
    times = np.arange(60) / 30.0
    poses = np.tile(np.eye(4), (60, 1, 1))
    poses[:, 0, 3] = 0.2 * np.sin(times)
    poses[:, 2, 3] = 0.1 * times
    truth = Trajectory.from_poses(times, poses)
    poses[:, 0, 3] += 0.01 * times
    return truth, Trajectory.from_poses(times, poses)


def test_edges_are_painted_by_direction() -> None:
    grey = np.full((20, 30), 100, np.uint8)
    pixels = np.array([[5.0, 5.0], [20.0, 10.0]])
    gradients = np.array([[1.0, 0.0], [-1.0, 0.0]])
    picture = edge_picture(grey, pixels, gradients)
    assert picture.shape == (20, 30, 3)
    assert picture.min() >= 0
    assert picture.max() <= 1
    red, cyan = picture[5, 5], picture[10, 20]
    assert red[0] > red[1] == red[2]
    assert cyan[0] < cyan[1] == cyan[2]
    np.testing.assert_allclose(picture[15, 15], 0.45 * 100 / 255)


def test_edge_at_the_border_stays_inside() -> None:
    picture = edge_picture(
        np.zeros((4, 6), np.uint8), np.array([[5.0, 3.0]]), np.array([[0.0, 1.0]])
    )
    assert picture[3, 5].max() == 1.0
    assert picture[0, 0].max() == 0.0


@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_draws_an_evaluation(tmp_path: Path, ending: str) -> None:
    truth, estimate = paths()
    file = tmp_path / f"plot{ending}"
    draw_evaluation(file, truth, estimate, evaluate(truth, estimate), title="a path")
    assert file.stat().st_size > 10_000


def test_draws_without_one_of_the_errors(tmp_path: Path) -> None:
    truth, estimate = paths()
    errors = evaluate(truth, estimate)
    for name in ("rpe", "ate"):
        file = tmp_path / f"{name}.png"
        draw_evaluation(file, truth, estimate, replace(errors, **{name: None}), title=name)
        assert cv2.imread(str(file)).std() > 5


def test_draws_a_row_for_each_scene(tmp_path: Path) -> None:
    truth, estimate = paths()
    grey = np.tile(np.arange(64, dtype=np.uint8), (48, 1))
    scene = Scene(
        "bars",
        grey,
        [grey, grey[::-1]],
        np.array([[10.0, 10.0]]),
        np.array([[1.0, 0.0]]),
        truth,
        estimate,
        evaluate(truth, estimate),
    )
    draw_scenes(tmp_path / "one.png", [scene], title="one")
    draw_scenes(tmp_path / "two.png", [scene, scene], title="two")
    one, two = (cv2.imread(str(tmp_path / f"{name}.png")) for name in ("one", "two"))
    assert one.shape[1] == two.shape[1]
    assert two.shape[0] > 1.7 * one.shape[0]


def test_refuses_another_ending(tmp_path: Path) -> None:
    truth, estimate = paths()
    with pytest.raises(OutputError, match="xyz"):
        draw_evaluation(
            tmp_path / "plot.xyz", truth, estimate, evaluate(truth, estimate), title="a path"
        )
    assert not list(tmp_path.iterdir())
