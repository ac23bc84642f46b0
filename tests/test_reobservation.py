"""What edges are worth, by how well those like them fitted of late."""

from dataclasses import replace

import numpy as np
import pytest

from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.kernels import direction_of
from edvo.odometry import Odometry
from edvo.registration import Alignment
from edvo.reobservation import EMPHASIS, GUESS, GUESSES, Reobserved
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

CAMERA = problems.VGA


def samples_at(u, v, gradients):
    n = len(gradients)
    pixels = np.tile(np.float32([u, v]), (n, 1))
    return EdgePixels(pixels, np.float32(gradients), np.ones(n, np.float32))


def alignment(residuals, sigma=0.5, trust=1.0):
    some = np.empty(0)
    n = len(residuals)
    return Alignment(
        np.eye(4), np.eye(6), np.zeros(n, np.int32), np.array(residuals, float), np.full(n, trust),
        np.zeros((n, 2)), np.zeros((n, 2)), n, n, sigma, 0, 0, 0.0, 0.0, 0.0, 0.0, 1, True, "", some
    )  # fmt: skip


def test_at_first_all_are_alike():
    worth = Reobserved(CAMERA).worth
    assert worth.shape == (15, 20, 4)
    assert worth.dtype == np.float32
    np.testing.assert_allclose(worth, GUESS**EMPHASIS, rtol=1e-6)


def test_a_cell_learns_from_its_own_edges_and_lines():
    known, across = Reobserved(CAMERA), [[1, 0]] * 3
    fits = 1 - (1 / 4.6851) ** 2  # at one sigma
    known.note(samples_at(100, 70, across), alignment([0.25, np.nan, 50.0], trust=2.0))
    expected = (GUESSES * GUESS + fits**2) / (GUESSES + 3)
    worth = known.worth
    line = direction_of(1.0, 0.0) % 4
    assert worth[2, 3, line] == pytest.approx(expected**EMPHASIS, rel=1e-5)
    worth[2, 3, line] = GUESS**EMPHASIS
    np.testing.assert_allclose(worth, GUESS**EMPHASIS, rtol=1e-6)


def test_light_and_dark_may_change_sides():
    one, other = Reobserved(CAMERA), Reobserved(CAMERA)
    for known, side in ((one, 1), (other, -1)):
        known.note(samples_at(100, 70, [[0.6 * side, 0.8 * side]]), alignment([9.0]))
    np.testing.assert_array_equal(one.worth, other.worth)
    assert (one.worth < GUESS**EMPHASIS - 0.1).any()


def test_it_forgets_bit_by_bit_and_all_at_once():
    known, never = Reobserved(CAMERA), Reobserved(CAMERA).worth
    known.note(samples_at(100, 70, [[1, 0]] * 20), alignment([9.0] * 20))
    elsewhere = samples_at(600, 400, [[1, 0]])
    lows = []
    for _ in range(30):
        lows.append(known.worth[2, 3].min())
        known.note(elsewhere, alignment([0.0]))
    assert (np.diff(lows) > 0).all()
    assert lows[-1] > 0.9 * GUESS**EMPHASIS
    known.forget()
    np.testing.assert_array_equal(known.worth, never)


def test_depth_alone_tells_nothing_of_edges():
    known = Reobserved(CAMERA)
    known.note(samples_at(100, 70, [[1, 0]]), alignment([9.0], sigma=0.0))
    np.testing.assert_array_equal(known.worth, Reobserved(CAMERA).worth)


def test_a_camera_is_followed_by_what_tells_most():
    source = SyntheticSource(make_recipe("office", frames=12, camera=problems.CAMERA))
    config = Config().with_overrides(["sampling.selection=informative", "sampling.count=400"])
    frames = [source.read(k).frame for k in range(12)]
    odometry = Odometry(source.camera, config)
    first = [odometry.track(frame) for frame in frames]
    first_pose, last_pose = (source.ground_truth.at(frames[k].timestamp) for k in (0, -1))
    truth = np.linalg.inv(first_pose) @ last_pose
    assert all(each.status.value == "tracked" for each in first)
    worth = odometry._front_end._reobserved.worth
    assert (worth < 0.9 * GUESS**EMPHASIS).any()  # it has learned
    assert (worth > GUESS**EMPHASIS + 0.05).any()
    few = odometry._front_end.see(frames[-1], 12).samples
    with pytest.MonkeyPatch.context() as patch:
        flat = np.full_like(worth, 0.5)
        patch.setattr(Reobserved, "worth", flat)
        others = odometry._front_end.see(frames[-1], 12).samples
    assert not np.array_equal(few.pixels, others.pixels)  # and what it has learned is asked
    error = np.linalg.norm(first[-1].T_world_cam[:3, 3] - truth[:3, 3])
    assert error < 0.002
    odometry.reset()  # what was learned is gone: the same once more, to the bit
    again = [odometry.track(replace(frame)) for frame in frames]
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.T_world_cam, other.T_world_cam)
