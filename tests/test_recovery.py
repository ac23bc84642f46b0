"""Finding back to a place that was seen before."""

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config, EdgesConfig
from edvo.edges import VIEW_COLS, VIEW_ROWS, EdgeImage, extract_edges
from edvo.frame import Frame
from edvo.keyframes import Keyframe, KeyframeStore
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe

PERIOD = 1 / 30
SEEN, COVERED_S = 40, 2.0


@pytest.fixture(scope="module", params=["stairs", "office"])
def walk(request):
    """Frames of a walk: of stairs, whose steps are alike, or round a desk."""
    source = SyntheticSource(make_recipe(request.param, frames=SEEN, seed=3))
    frames = [source.read(i).frame for i in range(SEEN)]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def covered_and_back(walk, back, *overrides):
    """Track a walk, cover the lens, and go on from an earlier frame; the results after that."""
    camera, frames, truth = walk
    odometry = Odometry(camera, Config().with_overrides(overrides))
    for frame in frames:
        odometry.track(frame)
    t = frames[-1].timestamp
    for _ in range(4):
        t += COVERED_S / 4
        dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
        assert odometry.track(dark).status is Status.LOST
    results = []
    for k in range(12):
        t += PERIOD
        frame = frames[back + k]
        result = odometry.track(Frame(t, frame.grey, frame.depth))
        off = se3.inverse(truth[back + k]) @ result.T_world_cam
        results.append((result.status, float(np.linalg.norm(off[:3, 3]))))
    return results


@pytest.mark.parametrize("back", [2, 12])
def test_found_again_after_two_seconds_in_the_dark(walk, back):
    results = covered_and_back(walk, back)
    assert results[-1][0] is Status.TRACKED
    assert results[-1][1] < 0.02
    # never somewhere else, though steps are alike
    assert all(error < 0.03 for status, error in results if status is not Status.LOST)


def test_a_place_never_seen_is_not_recognised(walk):
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:10]:
        odometry.track(frame)
    other = SyntheticSource(make_recipe("texture_near", frames=4, seed=1, camera=camera))
    t = frames[9].timestamp + COVERED_S
    dark = Frame(t, np.full_like(frames[0].grey, 5), frames[0].depth)
    odometry.track(dark)
    for k in range(4):
        frame = other.read(k).frame
        result = odometry.track(Frame(t + (k + 1) * PERIOD, frame.grey, frame.depth))
        assert result.status is Status.LOST


def keyframe(index, x, angle=0.0, view=None, piece=0):
    T = se3.exp(np.array([x, 0.0, 0.0, 0.0, angle, 0.0]))
    view = np.eye(4)[0] if view is None else view
    return Keyframe(index, T, None, None, None, None, view, None, 0.0, piece)


def stored(store):
    return sorted(k.index for k in store.likest(np.eye(4)[0], 100))


def test_a_full_store_lets_go_of_the_older_of_the_nearest_two():
    store = KeyframeStore(3)
    for index, x in enumerate([0.0, 1.0, 1.1]):
        store.add(keyframe(index, x))
    assert stored(store) == [0, 1, 2]
    store.add(keyframe(3, 3.0))
    assert stored(store) == [0, 2, 3]
    store.add(keyframe(4, 3.0, angle=1.5))  # another view from the same place is another place
    assert stored(store) == [2, 3, 4]


def test_keyframes_of_different_pieces_are_not_near_each_other():
    """Where they are to each other is a guess."""
    store = KeyframeStore(3)
    for index, (x, piece) in enumerate([(0.0, 0), (2.0, 0), (2.1, 1)]):
        store.add(keyframe(index, x, piece=piece))
    store.add(keyframe(3, 2.9, piece=1))
    assert stored(store) == [0, 1, 3]
    assert [index for index, _ in store.places(1)] == [3]


def test_the_likest_come_first():
    store = KeyframeStore(5)
    for index, cosine in enumerate([0.2, 0.9, 0.5]):
        store.add(keyframe(index, index, view=np.array([cosine, np.sqrt(1 - cosine**2), 0, 0])))
    assert [k.index for k in store.likest(np.eye(4)[0], 2)] == [1, 2]


def view_by_numpy(edges):
    height, width = edges.du.shape
    v, u = np.divmod(edges.index, width)
    angle = np.degrees(np.arctan2(edges.dv[v, u].astype(float), edges.du[v, u])) % 180
    direction = np.floor((angle + 22.5) / 45).astype(int) % 4
    cell = (v * VIEW_ROWS // height) * VIEW_COLS + u * VIEW_COLS // width
    counts = np.bincount(cell * 4 + direction, minlength=VIEW_ROWS * VIEW_COLS * 4)
    return np.sqrt(counts / max(len(edges.index), 1))


@pytest.mark.parametrize("seed", range(3))
def test_the_view_is_that_of_its_numpy_twin(seed):
    rng = np.random.default_rng(seed)
    index = np.sort(rng.choice(60 * 80, 700, replace=False)).astype(np.int32)
    du = rng.integers(-300, 300, (60, 80)).astype(np.int16)
    dv = rng.integers(-300, 300, (60, 80)).astype(np.int16)
    edges = EdgeImage(index, du, dv)
    np.testing.assert_allclose(edges.view(), view_by_numpy(edges), atol=0.04)  # on a border
    assert np.isclose(edges.view() @ edges.view(), 1)


def test_the_view_stays_when_bright_and_dark_change_places(walk):
    grey = walk[1][0].grey
    config = EdgesConfig(strong_share=0)
    once, inverted = extract_edges(grey, config).view(), extract_edges(255 - grey, config).view()
    assert once @ inverted > 0.99


def test_a_clock_that_starts_over_counts_how_long_it_has_been_lost(walk):
    camera, frames, _ = walk
    odometry = Odometry(camera)
    for frame in frames[:3]:
        odometry.track(Frame(frame.timestamp + 100.0, frame.grey, frame.depth))
    for k in range(4):
        assert odometry.skip(0.09 * k, "broken").status is Status.LOST
        assert not odometry._is_long_lost(0.09 * k)
    assert odometry._is_long_lost(0.5)
