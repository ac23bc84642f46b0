"""What the demo draws is what the tracker had."""

import numpy as np
import pytest

from edvo.config import Config
from edvo.datasets import Source
from edvo.errors import SceneError
from edvo.evaluation import evaluate
from edvo.odometry import Odometry
from edvo.report.demo import Watched, demo_recipe, demo_source, film_of, film_step, picture_of
from edvo.report.tracking import Run, track_source
from edvo.trajectory import Trajectory


@pytest.fixture(scope="module")
def tracked() -> tuple[Source, Run, Watched, Trajectory]:
    """Half a second of the demo, every second frame kept."""
    recipe = demo_recipe("notexture_far", seconds=0.5)
    source = demo_source(recipe)
    watched = Watched(Odometry(source.camera), 2)
    return source, track_source(source, watched), watched, recipe.truth()


def test_light_changes_and_repeats(tracked: tuple[Source, Run, Watched, Trajectory]) -> None:
    source, _, watched, _ = tracked
    means = [sight.frame.grey.mean() for sight in watched.sights]
    assert np.ptp(means) > 5
    again = source.read(4).frame
    assert again is not None
    np.testing.assert_array_equal(again.grey, watched.sights[2].frame.grey)


def test_matches_drawn_are_those_of_the_tracker(
    tracked: tuple[Source, Run, Watched, Trajectory],
) -> None:
    source, run, watched, truth = tracked
    errors = evaluate(truth, run.trajectory(), len(run.frames))
    film = film_of({"edvo": run}, {"edvo": errors}, watched.sights, truth, Config())
    assert [moment.index for moment in film.moments] == list(range(0, 15, 2))
    camera = source.camera
    for moment, sight in list(zip(film.moments, watched.sights, strict=True))[1:]:
        alignment = sight.result.alignment
        assert alignment is not None
        assert len(moment.samples) == alignment.match_count
        # Warped by the pose found they must lie where their matches do, up to the depth of edges,
        # which is looked up here at the pixel alone.
        column, row = np.rint(moment.samples).astype(int).T
        depth = sight.frame.depth[row, column]
        known = depth > 0
        points = camera.backproject(moment.samples[known].astype(float), depth[known].astype(float))
        T = alignment.T_ref_cur
        warped = camera.project(points @ T[:3, :3].T + T[:3, 3])
        gap = np.linalg.norm(warped - moment.references[known], axis=1)
        assert np.median(gap) < 2.0


def test_the_still_shows_a_frame_of_the_middle(
    tracked: tuple[Source, Run, Watched, Trajectory],
) -> None:
    _, run, watched, truth = tracked
    errors = evaluate(truth, run.trajectory(), len(run.frames))
    scene = picture_of(run, watched.sights, truth, errors, Config())
    np.testing.assert_array_equal(scene.grey, watched.sights[4].frame.grey)
    assert len(scene.pixels) == run.frames[8].edges


@pytest.mark.parametrize(("frames", "step"), [(1, 2), (90, 2), (100, 2), (101, 3), (1800, 36)])
def test_long_sequences_are_drawn_less_often(frames: int, step: int) -> None:
    assert film_step(frames) == step


def test_unknown_scene() -> None:
    with pytest.raises(SceneError, match="notexture_far"):
        demo_recipe("moon", seconds=1.0)
