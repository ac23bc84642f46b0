"""Sequences: in memory, in files, repeatable, with exact truth."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.incomplete import INCOMPLETE
from edvo.datasets.readahead import read_ahead
from edvo.errors import DatasetError, OutputError, SceneError
from edvo.evaluation.rpe import relative_pose_error
from edvo.synthesis.clock import Clock
from edvo.synthesis.image_sensor import AutoExposure
from edvo.synthesis.light import LightState
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import Recipe, SyntheticSource, make_recipe, write_sequence
from edvo.trajectory import Trajectory

CAMERA = Camera(160, 120, 133.85, 134.8, 79.65, 61.5)


def recipe(scene: str = "notexture_far", **more: Any) -> Recipe:
    return make_recipe(scene, **{"frames": 5, "camera": CAMERA, **more})


def content(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    a = content(write_sequence(SyntheticSource(recipe("crowd")), tmp_path / "a", workers=2))
    b = content(write_sequence(SyntheticSource(recipe("crowd")), tmp_path / "b", workers=1))
    c = content(write_sequence(SyntheticSource(recipe("crowd", seed=1)), tmp_path / "c"))
    assert a == b
    assert a.keys() == c.keys()
    assert a["groundtruth.txt"] != c["groundtruth.txt"]
    assert a["rgb/0.000000.png"] != c["rgb/0.000000.png"]
    assert a["depth/0.000000.png"] != c["depth/0.000000.png"]
    assert len(a) == 5 + 5 + 5


def test_what_is_read_from_files_is_what_is_in_memory(tmp_path: Path) -> None:
    clocks = {
        "colour_clock": Clock(30, jitter=0.001),
        "depth_clock": Clock(30, offset=0.012, jitter=0.001),
    }
    source = SyntheticSource(recipe("texture_far", **clocks))
    written = open_source(write_sequence(source, tmp_path / "s"))
    assert tuple(written.stamps) == source.stamps
    assert written.camera == replace(CAMERA, name=written.camera.name)
    np.testing.assert_array_equal(written.timestamps, source.timestamps)
    for a, b in zip(read_ahead(written, range(5)), read_ahead(source, range(5)), strict=True):
        assert a.frame is not None
        assert b.frame is not None
        np.testing.assert_array_equal(a.frame.grey, b.frame.grey)
        np.testing.assert_array_equal(a.frame.depth, b.frame.depth)
        assert a.timestamp == b.timestamp
        assert a.frame.depth_delay == b.frame.depth_delay != 0.0
    truth = written.ground_truth
    assert truth is not None
    np.testing.assert_allclose(truth.poses, source.ground_truth.poses, atol=1e-9)


def test_truth_is_there_at_100_hz_and_at_each_colour_stamp(tmp_path: Path) -> None:
    made = recipe(frames=40, colour_clock=Clock(30, jitter=0.002), depth_clock=Clock(30, 0.01))
    truth = made.truth()
    assert set(made.colour_times) <= set(truth.timestamps)
    regular = made.colour_times[0] + np.arange(100) / 100
    assert set(np.round(regular, 6)) <= set(truth.timestamps)
    assert np.diff(truth.timestamps).max() < 0.010001
    for t, pose in zip(truth.timestamps, truth.poses, strict=True):
        np.testing.assert_array_equal(pose, made.motion.at(float(t)))


def test_an_ideal_tracker_scores_nothing_through_the_files(tmp_path: Path) -> None:
    made = recipe(frames=90, colour_clock=Clock(30, jitter=0.002))
    made.truth().write(tmp_path / "groundtruth.txt")
    # The first camera is the world of a tracker.
    first = se3.inverse(made.motion.at(float(made.colour_times[0])))
    poses = [first @ made.motion.at(float(t)) for t in made.colour_times]
    Trajectory.from_poses(made.colour_times, poses).write(tmp_path / "trajectory.txt")
    reference = Trajectory.read(tmp_path / "groundtruth.txt")
    estimate = Trajectory.read(tmp_path / "trajectory.txt")
    for formula in ("script", "sturm"):
        error = relative_pose_error(reference, estimate, formula=formula)
        assert len(error.translation) > 50
        assert error.rmse < 1e-6
        assert error.rotation_rmse < 1e-6


def test_depth_comes_from_its_own_instant() -> None:
    late = Clock(30, offset=0.015)
    fast = {"speed": 3.0, "sensor": "ideal", "scene": "texture_far"}
    together, apart = (
        SyntheticSource(recipe(**fast, depth_clock=clock)) for clock in (Clock(30), late)
    )
    np.testing.assert_array_equal(together.colour(2), apart.colour(2))
    assert (together.depth(2) != apart.depth(2)).mean() > 0.5
    view = apart._renderer.render(apart.recipe.motion.at(float(apart.recipe.depth_times[2])))
    seen = view.depth < 13
    metres = apart.depth(2)[seen] / CAMERA.depth_scale
    np.testing.assert_allclose(metres, view.depth[seen], atol=5.1e-4)  # by whole millimetres
    frames = [source.read(2).frame for source in (together, apart)]
    delays = [frame.depth_delay for frame in frames if frame is not None]
    np.testing.assert_allclose(delays, [0.0, 0.015], rtol=0, atol=1.1e-6)


def test_depth_is_taken_at_once_whatever_the_rows_of_the_colour_image() -> None:
    """A delay of nothing must not differ from one of a microsecond."""
    fast = recipe("cabinet", speed=1.0)
    rolling = replace(fast, shutter=Shutter(readout=0.03))
    at_once, rolled = SyntheticSource(fast), SyntheticSource(rolling)
    late = SyntheticSource(replace(rolling, depth_clock=Clock(30, offset=2e-6)))
    for index in range(2):
        frame = rolled.read(index).frame
        expected, beside = at_once.read(index).frame, late.read(index).frame
        assert frame is not None
        assert expected is not None
        assert beside is not None
        np.testing.assert_array_equal(frame.depth, expected.depth)
        assert np.mean(np.abs(frame.depth - beside.depth) > 0.002) < 0.01
        assert not np.array_equal(frame.grey, expected.grey)


def test_depth_may_be_the_older_one() -> None:
    # The second colour image, at 33 ms, is nearest to the first depth image, at 18 ms.
    frame = SyntheticSource(recipe(depth_clock=Clock(30, offset=0.018))).read(1).frame
    assert frame is not None
    assert frame.depth_delay == pytest.approx(-1 / 30 + 0.018, abs=1.1e-6)


def test_a_frame_without_depth_nearby_has_a_problem() -> None:
    source = SyntheticSource(recipe(frames=2, depth_clock=Clock(30, offset=0.5)))
    reading = source.read(0)
    assert reading.frame is None
    assert reading.problem is not None
    assert "20 ms" in reading.problem


def test_light_exposure_and_shutter_take_part() -> None:
    class Doubling:
        def at(self, t: float) -> LightState:
            return LightState(0.1 * 2.0 ** (30 * t))

    made = recipe("texture_far", light=Doubling(), noise=False)
    plain = SyntheticSource(made)
    means = [float(plain.render(i).colour.mean()) for i in range(5)]
    np.testing.assert_allclose(np.divide(means[1:], means[:-1]), 2.0, rtol=0.1)
    steered = SyntheticSource(replace(made, exposure=AutoExposure(lag=0.05)))
    assert steered.exposures[0] == steered.exposures[1]  # it sees a frame late
    assert (np.diff(steered.exposures[1:]) < 0).all()
    brighter = [s.colour(4).mean() / s.colour(1).mean() for s in (steered, plain)]
    assert brighter[0] < 0.8 * brighter[1]
    blurred = SyntheticSource(
        recipe("texture_far", speed=2.0, noise=False, shutter=Shutter(0.03, steps=5))
    )
    sharp = SyntheticSource(recipe("texture_far", speed=2.0, noise=False))
    a, b = (s.colour(3)[:, :, 1].astype(float) for s in (blurred, sharp))
    assert np.abs(np.diff(a, axis=1)).mean() < 0.8 * np.abs(np.diff(b, axis=1)).mean()


def test_light_by_name() -> None:
    made = recipe(frames=60, light="ambient+diffuse", noise=False)
    assert made.light is not None
    states = [made.light.at(float(t)).ambient for t in made.colour_times]
    assert np.ptp(states) > 0.05
    with pytest.raises(SceneError, match="there are"):
        recipe(light="disco")


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    source = SyntheticSource(recipe(frames=1))
    with pytest.raises(OutputError, match="not empty"):
        write_sequence(source, tmp_path)
    assert content(tmp_path) == {"thesis.tex": b"precious"}
    write_sequence(source, tmp_path, force=True, command="edvo synth")
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    assert len(open_source(tmp_path)) == 1
    assert "edvo synth" in (tmp_path / "README.txt").read_text()


def test_half_a_sequence_does_not_look_whole(tmp_path: Path) -> None:
    source = SyntheticSource(recipe())
    write_sequence(source, tmp_path / "s")

    def interrupt(done: int, total: int) -> None:
        assert total == 5
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_sequence(source, tmp_path / "s", force=True, progress=interrupt)
    # Not even the lists of the sequence that was there before.
    assert not {"rgb.txt", "depth.txt", "groundtruth.txt"} & content(tmp_path / "s").keys()


def test_an_interrupted_folder_is_refused_until_it_is_written_again(tmp_path: Path) -> None:
    source, folder = SyntheticSource(recipe()), tmp_path / "s"

    def interrupt(done: int, total: int) -> None:
        if done == total:  # every image is there
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_sequence(source, folder, command="edvo synth panels s", progress=interrupt)
    with pytest.raises(DatasetError) as refused:
        open_source(folder)
    message = str(refused.value)
    assert message.startswith(f"{folder} is incomplete: synthetic sequence")
    assert "edvo synth panels s --force" in message
    assert "\n" not in message
    write_sequence(source, folder, force=True)
    assert len(open_source(folder)) == 5
    assert INCOMPLETE not in content(folder)


def test_a_full_disk_leaves_no_lists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from edvo.synthesis import sequence

    real, count = sequence.write_atomically, []

    def full(path: Path, data: bytes | str) -> None:
        count.append(path)
        if len(count) == 6:
            raise OutputError(f"cannot write {path}: No space left on device")
        real(path, data)

    monkeypatch.setattr(sequence, "write_atomically", full)
    with pytest.raises(OutputError, match="No space"):
        write_sequence(SyntheticSource(recipe()), tmp_path / "s")
    assert not {"rgb.txt", "depth.txt", "groundtruth.txt"} & content(tmp_path / "s").keys()


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"frames": 0}, "at least 1"),
        ({"seed": -1}, "seed"),
        ({"sensor": "lidar"}, "kinect_v1"),
        ({"trajectory": "flying"}, "handheld"),
        ({"speed": -1.0}, "speed"),
        ({"scene": "kitchen"}, "office"),
    ],
)
def test_what_cannot_be_is_said(wrong: dict[str, Any], word: str) -> None:
    with pytest.raises(SceneError, match=word):
        recipe(**wrong)


def test_a_recording_shorter_than_the_sequence(tmp_path: Path) -> None:
    file = tmp_path / "poses.txt"
    poses = [se3.exp(np.array([0.1 * k, 0, 0, 0, 0, 0])) for k in range(5)]
    Trajectory.from_poses(np.arange(5) / 10, poses).write(file)
    assert len(SyntheticSource(recipe(trajectory=file, frames=12))) == 12
    with pytest.raises(SceneError, match=r"ends after 0\.40 s"):
        recipe(trajectory=file, frames=20)


def test_the_source_describes_itself() -> None:
    source = SyntheticSource(recipe(frames=31))
    assert source.name == "notexture_far"
    assert source.format == "synthetic"
    told = source.describe()
    assert told["frames"] == 31
    assert told["duration_s"] == pytest.approx(1.0)
    assert told["camera"]["width"] == 160
    with pytest.raises(DatasetError, match="notexture_far: no frame 31; there are 0 to 30"):
        source.read(31)


def test_the_hard_scenes_are_as_hard_as_they_say() -> None:
    crowd = SyntheticSource(recipe("crowd", frames=600))
    world = crowd._renderer.world
    walking = np.unique(world.at(0.0).thing[world._walker >= 0])
    shares = [np.isin(crowd.render(k).things, walking).mean() for k in range(0, 600, 60)]
    assert np.mean(shares) == pytest.approx(1 / 3, abs=0.07)
    wall = SyntheticSource(recipe("white_wall", frames=600))
    views = [cv2.GaussianBlur(wall.colour(k), (5, 5), 0) for k in range(0, 600, 30)]
    plain = [not cv2.Canny(view, 50, 100).any() for view in views]
    assert 0.1 < np.mean(plain) < 0.6
