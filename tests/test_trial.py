"""Readouts tried out on frames of a camera that turns fast."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.config import Config
from edvo.evaluation import evaluate
from edvo.measuring import Moment
from edvo.odometry import Odometry, Status
from edvo.planes import NO_PLANES, NO_POINTS, PlaneFitter
from edvo.synthesis.renderer import Shutter
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory
from edvo.trial import FARTHEST, SAMPLES, STEP_S, STEPS, ReadoutTrial, Rolled

from . import problems
from .test_rolling import PERIOD, registration_of, rolled

VGA, CAMERA = problems.VGA, problems.CAMERA
READOUT = 0.02
KEY_VELOCITY = np.array([0.2, -0.1, 0.1, 0.5, -0.9, 0.3])  # rad/s, and m/s
VELOCITY = np.array([-0.1, 0.2, 0.1, -0.6, 0.7, -0.4])


class Scene:
    """A frame and its keyframe, both seen row by row, registered as if at once."""

    def __init__(self, readout=READOUT, velocity=VELOCITY, key_velocity=KEY_VELOCITY):
        self.registration = registration_of(VGA)
        T = se3.exp([0.02, -0.01, 0.015, 0.01, -0.015, 0.01])
        problem = problems.segments_problem(4, T)
        key = problems.segments_problem(4, np.eye(4))
        self.key_edges = rolled(key.samples, key_velocity, readout)
        seen = rolled(problem.samples, velocity, readout)
        reference = self.registration.index(self.key_edges)
        found = self.registration.align(reference, seen, T[None])
        keyframe = SimpleNamespace(edges=reference, planes=NO_PLANES)
        seen = SimpleNamespace(samples=seen, points=NO_POINTS)
        self.moment = Moment(keyframe, seen, found, PERIOD, velocity, velocity)
        self.key = Rolled(self.key_edges, self.key_edges.depths, key_velocity)

    def trial(self):
        return ReadoutTrial(VGA, self.registration, PlaneFitter(VGA, Config().planes))

    def measured(self, seconds):
        trial = self.trial()
        trial.begin(self.moment, self.key, seconds)
        *none, measured = [trial.go_on() for _ in STEPS]
        assert none == [None] * (len(STEPS) - 1)
        assert not trial.is_on
        return measured


def test_the_readout_that_fits_best_is_found():
    measured = Scene().measured(READOUT - 0.5 * STEP_S)
    assert measured.value == pytest.approx(READOUT, abs=2e-3)
    assert measured.off == pytest.approx(measured.value - (READOUT - 0.5 * STEP_S))
    assert Scene().measured(READOUT).value == pytest.approx(READOUT, abs=1e-3)


@pytest.mark.parametrize(("readout", "believed"), [(READOUT, -0.012), (-READOUT, 0.012)])
def test_one_that_is_far_is_looked_for_step_by_step(readout, believed):
    measured = Scene(readout).measured(believed)
    assert measured.off == pytest.approx(np.sign(readout) * FARTHEST * STEP_S)
    assert measured.information > 0


def test_a_frame_that_moves_as_its_keyframe_tells_nothing_to_speak_of():
    apart = Scene().measured(READOUT)
    alike = Scene(velocity=KEY_VELOCITY).measured(READOUT)
    assert alike.information < 0.1 * apart.information


def test_where_all_rows_are_taken_at_once_it_says_so():
    assert Scene(readout=0.0).measured(0.0).value == pytest.approx(0.0, abs=1e-3)


def test_depth_has_a_say(monkeypatch):
    """What its planes are off by is added, in units of the scales by the readout believed."""
    scene = Scene()
    alone = scene.measured(READOUT)
    found = scene.registration.align
    counted = []

    def with_depth(*given):
        alignment = found(*given)
        return replace(alignment, depth_balance=0.5, sigma_depth=2.0)

    def cost(near, count, points, sigma):
        counted.append((count, points, sigma))
        return [100.0, 0.0, 300.0][len(counted) - 1]  # by the one believed, a shorter, a longer

    monkeypatch.setattr(scene.registration, "align", with_depth)
    monkeypatch.setattr(kernels, "plane_cost", cost)
    both = scene.measured(READOUT)
    assert counted == [(0, 0, 2.0)] * 3
    stride = max(len(scene.moment.seen.samples) // SAMPLES, 1)
    bend = 0.5 * stride * (0.0 - 2 * 100.0 + 300.0) / STEP_S**2
    assert both.information == pytest.approx(alone.information + bend, rel=1e-6)
    assert both.value < alone.value


def test_too_few_edges_tell_nothing():
    scene = Scene()
    few = scene.moment.seen.samples.first(20)
    seen = SimpleNamespace(samples=few, points=NO_POINTS)
    alignment = replace(scene.moment.alignment, pixels=few.pixels)
    scene.moment = replace(scene.moment, seen=seen, alignment=alignment)
    assert scene.measured(0.0).information == 0


def test_what_a_registration_costs_by_its_own_scale_is_its_cost():
    scene = Scene()
    found = scene.moment.alignment
    cost = scene.registration.cost(found, found.sigma_px)
    assert cost == pytest.approx(found.cost, rel=1e-6)
    assert scene.registration.cost(found, 2 * found.sigma_px) < cost


def test_forgotten_it_ends():
    scene = Scene()
    trial = scene.trial()
    assert trial.go_on() is None
    trial.begin(scene.moment, scene.key, 0.0)
    assert trial.is_on
    trial.go_on()
    trial.forget()
    assert not trial.is_on
    assert trial.go_on() is None


def test_edges_that_were_moved_since_are_tried_where_they_were_seen():
    scene = Scene()
    samples = scene.moment.seen.samples
    moved = replace(samples, pixels=samples.pixels + 5)
    seen = SimpleNamespace(samples=moved, points=NO_POINTS)
    again = Scene()
    again.moment = replace(scene.moment, seen=seen)
    assert again.measured(0.0) == scene.measured(0.0)


# ------------------------------------------------------------------------------------- sequences


def turning(path, readout, frames):
    """A camera that is turned to and fro by up to 80 degrees a second."""
    t = np.arange(0, frames / 30 + 0.2, 1 / 200)
    sway = np.stack([0.16 * np.sin(7 * t), 0.2 * np.sin(6 * t + 1) - 0.17, 0.1 * np.sin(5 * t)])
    poses = np.array([se3.exp(np.concatenate([0.1 * w, w])) for w in sway.T])
    Trajectory.from_poses(1 + t, poses).write(path)
    recipe = make_recipe(
        "office",
        frames=frames,
        camera=CAMERA,
        trajectory=path,
        shutter=Shutter(exposure=0.0, steps=1, readout=readout),
        seed=3,
    )
    source = SyntheticSource(recipe)
    return [source.read(i).frame for i in range(frames)], source.ground_truth


def follow(frames, truth, *overrides):
    odometry = Odometry(CAMERA, Config().with_overrides(overrides))
    found = [odometry.track(frame) for frame in frames]
    assert all(result.status is not Status.LOST for result in found)
    return evaluate(truth, odometry.trajectory, len(frames)).ate.rmse, odometry


def test_where_a_camera_turns_fast_the_readout_is_found_soon(tmp_path):
    frames, truth = turning(tmp_path / "path.txt", READOUT, 40)
    at_once, _ = follow(frames, truth, "motion.readout=none")
    measured, odometry = follow(frames, truth)
    assert odometry.readout == pytest.approx(READOUT, abs=8e-3)
    assert measured < 0.75 * at_once
    known, odometry = follow(frames, truth, "motion.readout=known", f"motion.readout_s={READOUT}")
    assert odometry.readout == READOUT
    assert known < measured
    odometry.reset()
    assert odometry.readout == READOUT


def test_nothing_is_tried_where_nobody_asks(tmp_path, monkeypatch):
    frames, truth = turning(tmp_path / "path.txt", READOUT, 12)
    begun = []
    monkeypatch.setattr(ReadoutTrial, "begin", lambda *given: begun.append(given))
    follow(frames, truth, "motion.readout=none")
    follow(frames, truth, "motion.readout=known", f"motion.readout_s={READOUT}")
    assert not begun
    follow(frames, truth)
    assert begun
