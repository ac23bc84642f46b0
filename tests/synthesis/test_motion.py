"""Motions: smooth, plausible, repeatable."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from edvo import se3
from edvo.errors import SceneError, TrajectoryError
from edvo.synthesis.motion import (
    MOTIONS,
    TREMOR,
    HandHeld,
    Jerk,
    Motion,
    Still,
    Tremor,
    look_at,
    make_motion,
)
from edvo.synthesis.scene import CameraPath, load_scene
from edvo.synthesis.spline import ClosedSpline
from edvo.trajectory import Trajectory

F64 = NDArray[np.float64]
PATH = CameraPath(
    points=((0, -3, 1), (2, -3, 1.2), (3, -2, 1)),
    targets=((0, 0, 1), (1, 0, 1), (1, 0, 1)),
    centre=(0.5, 0, 1),
    radius=2.5,
    height=1.3,
)


def test_looking_at_a_point_puts_it_ahead_and_keeps_the_horizon() -> None:
    T = look_at(np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 2.5]))
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    ahead = se3.inverse(T) @ [2.0, 4.0, 2.5, 1.0]
    np.testing.assert_allclose(ahead[:2], 0, atol=1e-12)
    assert ahead[2] > 0
    assert T[2, 0] == pytest.approx(0)  # x stays level
    assert T[2, 1] < 0  # y points down
    with pytest.raises(SceneError, match="upright"):
        look_at(np.zeros(3), np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("closed", [True, False])
def test_a_spline_is_travelled_at_the_speed_asked_for_and_closes(closed: bool) -> None:
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 1.0]])
    spline = ClosedSpline(points, closed=closed)
    at = np.linspace(0, 2 * spline.length, 801)
    places = np.array([spline.at(float(s))[0] for s in at])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(at)
    np.testing.assert_allclose(steps[5:-5], 1.0, atol=0.08 if closed else 1.0)
    assert np.median(steps) == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(places[0], places[-1], atol=1e-9)
    assert (places >= points.min(0) - 1e-12).all()
    assert (places <= points.max(0) + 1e-12).all()


def test_a_spline_needs_points_and_targets() -> None:
    with pytest.raises(SceneError, match="1 points"):
        ClosedSpline(np.zeros((1, 3)))
    with pytest.raises(SceneError, match="3 targets"):
        ClosedSpline(np.zeros((2, 3)), companion=np.zeros((3, 3)))


@pytest.mark.parametrize("kind", MOTIONS)
def test_every_motion_is_rigid_continuous_and_the_same_each_time(kind: str) -> None:
    a, b = (make_motion(kind, PATH, seed=3) for _ in range(2))
    times = np.arange(0, 6, 0.005)
    poses = np.array([a.at(float(t)) for t in times])
    for t in (5.0, 1.0, 3.3):  # in any order
        assert (b.at(t) == a.at(t)).all()
    Trajectory.from_poses(times, poses)  # checks that they are rigid
    steps = np.array([se3.log(se3.inverse(x) @ y) for x, y in pairwise(poses)])
    assert np.abs(steps[:, :3]).max() / 0.005 < 4.0  # m/s
    assert np.abs(steps[:, 3:]).max() / 0.005 < 8.0  # rad/s
    assert a.duration == float("inf")


def test_another_seed_is_another_hand() -> None:
    a, b = (make_motion("handheld", PATH, seed=s).at(1.0) for s in (0, 1))
    assert np.abs(a - b).max() > 1e-4
    assert np.abs(a - b).max() < 0.2


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_hand_walks_at_the_speed_asked_for(speed: float) -> None:
    motion = make_motion("handheld", PATH, speed=speed)
    rail = HandHeld(PATH, speed=speed, tremor=0.0)
    span = 0.9 * 3.0 / speed / 2
    way = np.array([rail.at(float(t))[:3, 3] for t in np.linspace(0, span, 500)])
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert length / span == pytest.approx(speed, rel=0.2)
    off = [np.linalg.norm(motion.at(t)[:3, 3] - rail.at(t)[:3, 3]) for t in (0.0, 1.0, 2.0)]
    assert max(off) < 0.03


def band(signal: F64, rate: float, low: float, high: float) -> F64:
    """RMS of a signal (N, D) between two frequencies."""
    window = np.hanning(len(signal))[:, None]
    power = np.abs(np.fft.rfft(signal * window, axis=0)) ** 2 * 2 / len(signal) ** 2 / 0.375
    frequency = np.fft.rfftfreq(len(signal), 1 / rate)
    inside = (frequency >= low) & (frequency < high)
    result: F64 = np.sqrt(power[inside].sum(0))
    return result


def test_the_tremor_has_the_spectrum_it_claims() -> None:
    rate = 50.0
    times = np.arange(0, 200, 1 / rate)
    for seed in range(2):
        tremor = Tremor(seed)
        twists = np.array([tremor.at(float(t)) for t in times])
        for low, high, shift, turn in TREMOR:
            rms = band(twists, rate, low, high)
            np.testing.assert_allclose(rms[:3], shift, rtol=0.25)
            np.testing.assert_allclose(rms[3:], turn, rtol=0.25)
        assert band(twists, rate, 15.0, 25.0).max() < 1e-4


def test_an_orbit_stays_at_its_radius_and_looks_at_its_centre() -> None:
    motion = make_motion("orbit", PATH, speed=0.5)
    for t in (0.0, 2.0, 31.4):
        T = motion.at(t)
        assert np.hypot(*(T[:2, 3] - [0.5, 0])) == pytest.approx(2.5)
        assert T[2, 3] == pytest.approx(1.3)
        ahead = se3.inverse(T) @ [0.5, 0, 1, 1]
        np.testing.assert_allclose(ahead[:2], 0, atol=1e-9)
    assert np.linalg.norm(motion.at(0.1)[:3, 3] - motion.at(0.0)[:3, 3]) == pytest.approx(
        0.05, rel=1e-3
    )


def test_still_is_still_and_rotation_only_turns() -> None:
    still = make_motion("still", PATH)
    assert (still.at(0.0) == still.at(9.9)).all()
    turning = make_motion("rotation", PATH, speed=0.5)
    first, later = turning.at(0.0), turning.at(1.0)
    np.testing.assert_array_equal(first, still.at(0.0))
    np.testing.assert_allclose(first[:3, 3], later[:3, 3], atol=1e-12)
    assert se3.rotation_angle(se3.inverse(first) @ later) > 0.3
    rates = [
        se3.rotation_angle(se3.inverse(turning.at(t)) @ turning.at(t + 0.01)) / 0.01
        for t in np.arange(0, 5, 0.05)
    ]
    assert max(rates) < 0.6


def test_a_jerk_is_sudden_and_over_soon() -> None:
    base = Still(look_at(np.zeros(3), np.array([0.0, 1.0, 0.0])))
    for motion in (Jerk(base, instants=(1.0, 1.5)), Jerk(base, seed=4)):
        away: Callable[[float], F64] = lambda t, m=motion: se3.log(  # noqa: E731
            se3.inverse(base.at(t)) @ m.at(t)
        )
        assert np.linalg.norm(away(1.0)[:3]) == pytest.approx(0.04, rel=0.05)
        assert np.linalg.norm(away(1.0)[3:]) == pytest.approx(np.radians(5), rel=1e-6)
        for calm in (0.0, 0.9, 1.1, 1.3, 2.0):
            np.testing.assert_allclose(away(calm), 0, atol=1e-12)
    assert np.linalg.norm(away(3.0)) > 0.03  # every two seconds


def test_a_recorded_motion_starts_where_the_scene_does(tmp_path: Path) -> None:
    source: Motion = make_motion("orbit", PATH, speed=0.7)
    times = np.arange(0, 2.0, 0.05)
    file = tmp_path / "poses.txt"
    Trajectory.from_poses(times + 1305.0, [source.at(float(t)) for t in times]).write(file)
    motion = make_motion(file, PATH)
    start = make_motion("still", PATH).at(0.0)
    np.testing.assert_allclose(motion.at(0.0), start, atol=1e-9)
    assert motion.duration == pytest.approx(1.95)
    for t in (0.5, 0.71, 1.95):
        expected = se3.inverse(source.at(0.0)) @ source.at(t)
        np.testing.assert_allclose(se3.inverse(start) @ motion.at(t), expected, atol=2e-4)
    np.testing.assert_allclose(motion.at(5.0), motion.at(1.95), atol=1e-12)


def test_motions_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no trajectory 'flying'; there are handheld, orbit"):
        make_motion("flying", PATH)
    for speed in (0.0, -1.0, float("nan")):
        with pytest.raises(SceneError, match="speed"):
            make_motion("handheld", PATH, speed=speed)
    with pytest.raises(TrajectoryError):
        make_motion(tmp_path / "none.txt", PATH)
    (tmp_path / "one.txt").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(SceneError, match="too few poses"):
        make_motion(tmp_path / "one.txt", PATH)


def test_the_packaged_paths_keep_clear_of_what_is_in_the_scene() -> None:
    from edvo.camera import Camera
    from edvo.synthesis.renderer import Renderer
    from edvo.synthesis.scene import scene_names

    eye = Camera(32, 24, 27.0, 27.0, 15.5, 11.5)
    for name in scene_names():
        scene = load_scene(name)
        renderer = Renderer(scene, eye, samples=1, threads=1)
        motion = make_motion("handheld", scene.camera)
        for t in np.arange(0.0, 40.0, 2.0):
            depth = renderer.render(motion.at(float(t)), t=float(t), lit=False).depth
            assert depth[depth > 0].min() > 0.3, f"{name} at {t} s"
            assert (depth > 0).mean() > 0.6, f"{name} at {t} s"
