"""A frame's parts put together at one instant, and a keyframe's once more is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edvo import se3
from edvo.clock import no_clock
from edvo.config import Config
from edvo.edges import depth_at_edges
from edvo.exposure import Exposure
from edvo.front_end import FrontEnd
from edvo.instants import HASTY_S, KNOWN_S, NEWS_SHARE, ROUGH_PX, SELDOM, TELLING_S, Instants
from edvo.measuring import Measured
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, move_points
from edvo.registration import AT_ONCE, Registration
from edvo.rolling import EXPECTED_S

from . import problems

CAMERA = problems.CAMERA
CONFIG = Config()
PERIOD = 1 / 30
VELOCITY = np.array([0.4, -0.3, 0.5, 0.3, -0.5, 0.4])
DELAY, READOUT = -0.012, 0.02


def know(instants, delay=DELAY, readout=READOUT):
    """Let it have measured so much for certain."""
    for estimate, seconds in (
        (instants.depth.estimate, delay),
        (instants.rolling.estimate, readout),
    ):
        estimate.note(1e12, 1e12 * seconds, PERIOD)


class Problem:
    """A frame, and the keyframe made of it before anything is known."""

    def __init__(self):
        registration = Registration(CAMERA, CONFIG.matching, CONFIG.registration)
        self.fitter = PlaneFitter(CAMERA, CONFIG.planes)
        exposure = Exposure(CAMERA, CONFIG)
        self.instants = Instants(CAMERA, CONFIG, registration, self.fitter, exposure)
        front_end = FrontEnd(CAMERA, CONFIG, registration, self.fitter, no_clock, exposure)
        self.frame = problems.sequence()[0][0]
        self.seen = front_end.see(self.frame, 0)
        self.edges = self.seen.edges.describe(CAMERA)
        self.keyframe = front_end.keyframe(self.seen, 7, np.eye(4), 0, self.edges)

    def hold(self, velocity=None):
        self.instants.hold(self.keyframe, self.seen, self.edges, velocity)


@pytest.fixture
def problem():
    return Problem()


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_a_keyframe_is_moved_once_its_velocity_is_known(problem):
    instants, keyframe = problem.instants, problem.keyframe
    problem.hold()
    assert instants.renewed(keyframe, VELOCITY) is None  # taken at once, for all that is known
    know(instants)
    problem.hold()
    changed = instants.renewed(keyframe, VELOCITY)
    T_cam_depth = instants.depth.motion(VELOCITY, problem.frame.depth_delay)
    assert same(changed.planes, problem.fitter.planes(problem.frame.depth, T_cam_depth))
    assert not same(changed.planes, keyframe.planes)
    points = move_points(keyframe.points, T_cam_depth)
    np.testing.assert_allclose(changed.points.X, points.X, atol=1e-12)
    rough = CONFIG.edges.model_copy(update={"depth_window_px": ROUGH_PX})
    depths, rough_ones = (
        depth_at_edges(problem.frame.depth, problem.seen.edges.index, config)
        for config in (CONFIG.edges, rough)
    )
    edges = instants.rolling.unrolled(problem.edges, VELOCITY, rough_ones)
    np.testing.assert_array_equal(changed.edges.edges.pixels, edges.pixels)
    exact = instants.rolling.unrolled(problem.edges, VELOCITY, depths)
    known = (depths > 0) & (rough_ones > 0)
    off = np.abs(edges.pixels - exact.pixels)[known]
    assert np.percentile(off, 99) < 0.1  # a rough depth will do: 4 px and more it moves them by
    assert abs(changed.edges.edges.pixels - keyframe.edges.edges.pixels).max() > 1
    assert changed.chamfer is not keyframe.chamfer
    assert (changed.index, changed.timestamp) == (keyframe.index, keyframe.timestamp)
    assert instants.renewed(changed, -VELOCITY) is None  # as good as before: its own is known


def test_it_is_moved_again_where_more_is_known(problem):
    problem.hold(VELOCITY)
    assert problem.instants.renewed(problem.keyframe, VELOCITY) is None
    know(problem.instants, delay=0.0)
    rolled = problem.instants.renewed(problem.keyframe, VELOCITY)
    assert rolled.planes is problem.keyframe.planes
    assert rolled.edges is not problem.keyframe.edges
    know(problem.instants)
    moved = problem.instants.renewed(rolled, VELOCITY)
    assert moved.planes is not rolled.planes
    assert moved.edges is rolled.edges
    assert problem.instants.renewed(moved, VELOCITY) is None


def test_parts_are_looked_at_anew_only_when_more_is_known(problem, monkeypatch):
    instants, asked = problem.instants, []
    motion = instants.depth.motion
    monkeypatch.setattr(instants.depth, "motion", lambda *given: asked.append(1) or motion(*given))
    know(instants)
    problem.hold()
    key = instants.renewed(problem.keyframe, VELOCITY)
    for _ in range(3):
        assert instants.renewed(key, VELOCITY) is None
    assert len(asked) == 1
    know(instants, readout=READOUT / 2)
    assert instants.renewed(key, VELOCITY) is not None
    assert len(asked) == 2


def test_only_the_keyframe_that_is_held_is_moved(problem):
    know(problem.instants)
    assert problem.instants.renewed(problem.keyframe, VELOCITY) is None
    problem.hold()
    assert problem.instants.renewed(Problem().keyframe, VELOCITY) is None
    changed = problem.instants.renewed(problem.keyframe, VELOCITY)
    assert changed is not None
    assert problem.instants.renewed(problem.keyframe, VELOCITY) is None  # no longer it


def test_nothing_is_known_after_forgetting(problem):
    instants = problem.instants
    know(instants)
    problem.hold()
    instants.forget()
    assert instants.depth.seconds == instants.rolling.seconds == 0.0
    know(instants)
    assert instants.renewed(problem.keyframe, VELOCITY) is None


def test_samples_and_points_are_moved_to_the_instant_of_the_image(problem):
    instants, seen = problem.instants, problem.seen
    T_last_cur = se3.exp(VELOCITY * PERIOD)
    same_as_before = instants.settled(seen, T_last_cur, PERIOD)
    assert same_as_before.samples is seen.samples
    assert same_as_before.points is seen.points
    know(instants)
    settled = instants.settled(seen, T_last_cur, PERIOD)
    samples = instants.rolling.unrolled(seen.samples, VELOCITY)
    np.testing.assert_allclose(settled.samples.pixels, samples.pixels, atol=1e-3)
    np.testing.assert_allclose(settled.samples.depths, samples.depths, rtol=1e-5)
    assert abs(samples.pixels - seen.samples.pixels).max() > 1
    T_cam_depth = instants.depth.motion(VELOCITY, problem.frame.depth_delay)
    np.testing.assert_allclose(settled.T_cam_depth, T_cam_depth, atol=1e-12)
    np.testing.assert_allclose(
        settled.points.X, move_points(seen.points, T_cam_depth).X, atol=1e-12
    )
    # what it has been moved by before is taken back
    again = instants.depth.settled(settled, -VELOCITY)
    np.testing.assert_allclose(
        again.points.X, instants.depth.settled(seen, -VELOCITY).points.X, atol=1e-12
    )


def test_samples_go_by_the_velocity_at_the_image_and_points_where_they_were_found(problem):
    instants, seen = problem.instants, problem.seen
    know(instants)
    found = SimpleNamespace(T_cam_points=se3.exp(np.full(6, 0.004)), faster=0.01 * VELOCITY)
    settled = instants.settled(seen, se3.exp(VELOCITY * PERIOD), PERIOD, found)
    samples = instants.rolling.unrolled(seen.samples, VELOCITY * (1 + 0.01 / PERIOD))
    np.testing.assert_allclose(settled.samples.pixels, samples.pixels, atol=1e-3)
    np.testing.assert_allclose(settled.T_cam_depth, found.T_cam_points, atol=1e-12)


@pytest.mark.parametrize("readout", [READOUT, -READOUT])
def test_rows_that_are_read_from_either_end_matter(problem, readout):
    instants, seen = problem.instants, problem.seen
    assert not instants.matter(seen)
    know(instants, delay=0.0, readout=readout)
    assert instants.matter(seen)
    settled = instants.settled(seen, se3.exp(VELOCITY * PERIOD), PERIOD)
    assert abs(settled.samples.pixels - seen.samples.pixels).max() > 1
    assert settled.T_cam_depth is None


def test_a_registration_is_told_of_both(problem):
    T_last = se3.exp(VELOCITY)
    given = problem.seen, problem.keyframe, T_last, PERIOD, VELOCITY
    assert problem.instants.lag(*given) is AT_ONCE
    know(problem.instants, delay=0.0)
    rows = problem.instants.lag(*given)
    assert rows.share == 0.0
    assert rows.T_ref_last is T_last
    np.testing.assert_allclose(
        rows.rows, problem.instants.rolling.rows(problem.seen.samples.pixels) / PERIOD
    )
    problem.instants.forget()
    know(problem.instants)
    both = problem.instants.lag(*given)
    assert both.share == pytest.approx(DELAY / PERIOD, rel=1e-5)
    assert both.rows.size == len(problem.seen.samples)


@pytest.mark.parametrize("delay", [0.0, DELAY])
def test_a_registration_is_told_which_edges_are_smeared(problem, delay):
    instants, seen, keyframe, T_last = problem.instants, problem.seen, problem.keyframe, np.eye(4)
    know(instants, delay=delay, readout=0.0)
    instants.exposure.seconds = 0.02
    alone = instants.lag(seen, keyframe, T_last, PERIOD, VELOCITY)
    assert (alone.share != 0) == (delay != 0)
    assert not alone.rows.size
    wanted = instants.exposure.sharpness(seen.samples, VELOCITY)
    np.testing.assert_array_equal(alone.sharp, wanted)
    assert wanted.min() < 0.8
    problem.hold()  # how fast it went is not known
    np.testing.assert_array_equal(
        instants.lag(seen, keyframe, T_last, PERIOD, VELOCITY).sharp, wanted
    )
    problem.hold(-2 * VELOCITY)
    both = instants.lag(seen, keyframe, T_last, PERIOD, VELOCITY).sharp
    assert (both < wanted).mean() > 0.9
    other = replace(keyframe, index=8)
    np.testing.assert_array_equal(instants.lag(seen, other, T_last, PERIOD, VELOCITY).sharp, wanted)


# ------------------------------------------------------------------------------------- odometry


class Learning:
    """In the place of an exposure: the velocities of keyframes that it was told of."""

    def __init__(self):
        self.is_on, self.is_known, self.told = True, False, []

    def forget(self):
        self.told.clear()

    def learn(self, moment, key_velocity, seconds):
        self.told.append(key_velocity)


def test_an_exposure_is_learned_of_keyframes_whose_velocity_is_known(problem):
    instants, key = problem.instants, problem.keyframe
    instants.exposure = exposure = Learning()
    know(instants, delay=0.0, readout=0.0)

    def three_frames(keyframe):
        instants.interrupt()
        for k in (1, 2, 3):
            frame = replace(problem.frame, timestamp=k * PERIOD)
            seen = replace(problem.seen, frame=frame)
            alignment = SimpleNamespace(T_ref_cur=se3.exp(k * PERIOD * VELOCITY))
            instants._count = 0  # nothing else is learned of these
            instants.note(keyframe, seen, alignment, PERIOD)
        told = list(exposure.told)
        exposure.forget()
        return told

    assert not three_frames(key)  # none is held
    problem.hold()
    assert not three_frames(key)  # how fast it went is not known
    problem.hold(VELOCITY)
    told = three_frames(key)
    assert told
    assert all(velocity is VELOCITY for velocity in told)
    assert not three_frames(replace(key, index=3))  # an earlier one
    more = replace(key, gathered=5)
    instants.exchange(key, more)
    assert len(three_frames(more)) == len(told)
    exposure.is_known = True
    assert not three_frames(more)  # one frame in so many is enough


def test_a_lost_frame_interrupts():
    frames, _ = problems.sequence()
    odometry = Odometry(CAMERA)
    for frame in frames[:4]:
        odometry.track(frame)
    moments = odometry._instants._moments
    assert moments._last is not None
    odometry.skip(frames[4].timestamp, "broken")
    assert moments._last is None


@pytest.mark.parametrize("stray", [1 / 30, 0.0333, 0.0315], ids=["equal", "jitter", "2 ms"])
def test_a_stray_stamp_is_got_over(stray):
    """All that was measured times a speed that never was."""
    frames, poses = problems.sequence()
    odometry = Odometry(CAMERA)
    for k, frame in enumerate(frames[:20]):
        know(odometry._instants, delay=0.02, readout=-0.02)
        stamp = frame.timestamp - (stray if k in (8, 9) else 0.0)
        result = odometry.track(replace(frame, timestamp=stamp))
        assert np.isfinite(result.T_world_cam).all()
        if k == 9:
            odometry._instants.forget()
    assert result.status is not Status.LOST
    assert problems.error(poses[19], result.T_world_cam)[0] < 0.02


# ------------------------------------------------------------------------------ readouts on trial


class Tried:
    """In the place of a trial: what it was given, and how often it went on."""

    def __init__(self):
        self.given, self.left = [], 0

    @property
    def is_on(self):
        return self.left > 0

    def forget(self):
        self.left = 0

    def begin(self, moment, key, seconds):
        self.given.append((moment, key, seconds))
        self.left = 3

    def go_on(self):
        self.left -= 1
        return None if self.left else Measured(0.02, 1e9, 0.0)


@pytest.fixture
def tried(problem, monkeypatch):
    """Notes a frame that tells so much, and how often a trial then begins, and is left undone."""
    instants, trial = problem.instants, Tried()
    instants._trial = trial
    problem.hold(VELOCITY)

    def note(sigma_s, keyframe=problem.keyframe, **how):
        moment = SimpleNamespace(keyframe=keyframe)
        certainty = sigma_s**-2
        monkeypatch.setattr(instants.rolling, "learn", lambda *given: certainty)
        instants._learn_readout(moment, **how)
        return len(trial.given), trial.left

    return instants, trial, note


def test_readouts_are_tried_on_frames_that_tell(tried):
    instants, trial, note = tried
    assert note(1.1 * TELLING_S) == (0, 0)
    assert note(0.9 * TELLING_S) == (1, 3)
    assert note(0.9 * TELLING_S) == (1, 3)  # one after the other
    for _ in range(3):
        assert instants.rolling.seconds == 0.0
        instants.go_on()
    assert instants.rolling.seconds == pytest.approx(0.02, rel=0.02)
    _, key, seconds = trial.given[0]
    assert seconds == 0.0
    assert key.velocity is VELOCITY
    assert len(key.depths) == len(key.edges)


def test_at_once_where_much_is_at_stake_and_nothing_known(tried):
    instants, _, note = tried
    assert note(0.9 * HASTY_S, has_time=False) == (0, 0)  # in the next frame, then
    assert not instants.is_trying
    assert note(0.9 * TELLING_S) == (1, 3)  # by and by: what is more urgent goes before it
    assert note(0.9 * HASTY_S) == (2, 0)
    assert instants.is_trying
    assert instants.rolling.seconds > 0
    assert instants.rolling.estimate.is_known(KNOWN_S)
    assert note(0.9 * HASTY_S) == (3, 3)


def test_on_frames_that_tell_a_share_of_what_is_known(tried):
    instants, _, note = tried
    instants._count, known = 1, 0.003
    instants.rolling.estimate._know(known**-2 - EXPECTED_S**-2, 0.0)
    assert note(1.1 * known / NEWS_SHARE**0.5) == (0, 0)
    assert note(0.9 * known / NEWS_SHARE**0.5) == (1, 3)


def test_seldom_once_it_is_known_for_sure(tried):
    instants, trial, note = tried
    know(instants)
    begun = []
    for instants._count in range(1, 2 * SELDOM + 1):
        begun.append(note(0.9 * HASTY_S)[0])
        trial.forget()
    assert begun[-1] == 2


def test_only_on_frames_of_the_keyframe_that_is_held(tried):
    _, _, note = tried
    assert note(0.9 * HASTY_S, Problem().keyframe) == (0, 0)
