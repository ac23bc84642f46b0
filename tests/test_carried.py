"""What the camera carries with it, as dirt on its lens, is told from what it sees."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from benchmarks.defects import scratches

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.carried import LEAST_HITS, Carried, _more_than_chance
from edvo.config import Config
from edvo.edges import NO_TABLE, EdgeBuffers, extract_edges
from edvo.frame import Frame
from edvo.locating import Aligned
from edvo.odometry import Odometry, Status
from edvo.parting import Parting
from edvo.planes import camera_of
from edvo.registrar import Registrar

from . import problems, twins

CAMERA = Camera(width=160, height=120, fx=150, fy=140, cx=80, cy=60)
T = se3.exp([0.03, -0.02, 0.01, 0.01, -0.02, 0.03])
FRAMES = 40


# --------------------------------------------------------------------------------------- kernels


def edges_at(rng, n):
    """Pixels in row order, gradients as images have them, and depths, some of them missing."""
    index = np.sort(rng.choice(160 * 120, n, replace=False)).astype(np.int32)
    du, dv = rng.integers(-300, 300, (2, 120, 160)).astype(np.int16)
    du[(du == 0) & (dv == 0)] = 1
    depth = np.where(rng.random((120, 160)) < 0.1, 0, rng.uniform(0.5, 3, (120, 160)))
    rows, cols = index // 160, index % 160
    gradients = np.column_stack((du[rows, cols], dv[rows, cols])).astype(np.float64)
    gradients /= np.linalg.norm(gradients, axis=1)[:, None]
    pixels = np.column_stack((cols, rows))
    return index, du, dv, depth.astype(np.float32), pixels, gradients


def marked(index, du, dv):
    marks = np.full((120, 160), 255, np.uint8)
    kernels.mark_edges(index, du, dv, NO_TABLE, marks)
    return marks


@pytest.mark.parametrize("seed", range(3))
def test_marks_are_those_of_the_twin(seed):
    rng = np.random.default_rng(seed)
    index, du, dv, _, pixels, gradients = edges_at(rng, 800)
    bits = np.unpackbits(marked(index, du, dv)[..., None], axis=-1, bitorder="little")
    np.testing.assert_array_equal(bits, twins.mark_edges(pixels, gradients, (120, 160)))


def test_marks_lie_at_ideal_pixels():
    table = np.stack(np.meshgrid(np.arange(160), np.arange(120)), axis=-1).astype(np.float32)
    table += (3.4, -2.4)
    index, marks = np.array([50 * 160 + 70], np.int32), np.zeros((120, 160), np.uint8)
    ones = np.ones((120, 160), np.int16)
    kernels.mark_edges(index, ones, ones, table, marks)
    np.testing.assert_array_equal(np.argwhere(marks)[[0, -1]], [[47, 72], [49, 74]])


@pytest.mark.parametrize("seed", range(3))
def test_what_stays_is_that_of_the_twin(seed):
    rng = np.random.default_rng(seed)
    index, du, dv, _, pixels, gradients = edges_at(rng, 800)
    known = twins.mark_edges(pixels, gradients, (120, 160))
    samples = problems.random_edges(rng, 500, 170, 130)  # some of them outside
    depths = rng.uniform(0.5, 3, 500).astype(np.float32)
    found = np.empty((3, 500), bool)
    given = samples.pixels, samples.gradients, depths
    marks = marked(index, du, dv)
    kernels.stay_in_place(*given, camera_of(CAMERA), T, marks, 4.0, *found)
    np.testing.assert_array_equal(found, twins.stay_in_place(*given, CAMERA, T, known, 4.0))
    assert (found.sum(axis=1) > 40).all()
    assert (found.sum(axis=1) < 460).all()


@pytest.mark.parametrize("seed", range(3))
def test_counts_are_those_of_the_twin(seed):
    rng = np.random.default_rng(seed)
    index, du, dv, depth, pixels, gradients = edges_at(rng, 1500)
    marks, known = marked(index, du, dv), twins.mark_edges(pixels, gradients, (120, 160))
    room, counts = np.full((120, 160), 255, np.uint8), np.zeros((3, 120, 160), np.uint8)
    expected = np.zeros((3, 120, 160), int)
    for _ in range(3):  # other edges each time, before the same marks
        index, du, dv, depth, pixels, gradients = edges_at(rng, 1500)
        found = kernels.count_stays(
            index,
            du,
            dv,
            NO_TABLE,
            depth,
            camera_of(CAMERA),
            T,
            marks,
            4.0,
            room,
            counts,
            2,
        )
        depths = depth.reshape(-1)[index]
        given = pixels.astype(np.float64), gradients, depths
        wanted = twins.count_stays(*given, CAMERA, T, known, 4.0, expected, 2)
        np.testing.assert_array_equal(counts, expected)
        assert found == pytest.approx(wanted)
    assert counts.max() == 3
    assert found[0] > 0


def test_where_more_stays_by_chance_it_has_to_stay_more_often():
    assert _more_than_chance(0.0) == _more_than_chance(0.02) == LEAST_HITS
    assert LEAST_HITS < _more_than_chance(0.1) < _more_than_chance(0.2) < 30
    assert _more_than_chance(0.4) == _more_than_chance(1.0) > 80


# ------------------------------------------------------------------------------------- sequences


def frames_of(scene, **how):
    """Frames, and where they are in the camera of the first one."""
    return problems.rendered(scene, FRAMES, speed=0.5, seed=1, **how)


@pytest.fixture(scope="module")
def panels():
    return frames_of("notexture_far")


def scratched(frame):
    """Through a window with scratches that light up, and where they do."""
    spoiled = scratches(frame, np.random.default_rng(0))
    return spoiled, spoiled.grey.astype(int) > frame.grey + 15


def printed(frame):
    grey = frame.grey.copy()
    for row, text in ((30, "2026-11-27 12:00"), (60, "CAM 1")):
        cv2.putText(grey, text, (10, row), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 255, 2)
    return replace(frame, grey=grey), grey != frame.grey


def followed(sequence, spoil, *overrides):
    """How far each frame is off, m; whether it is tracked; what is the camera's; what is shown."""
    camera, frames, truth = sequence
    odometry = Odometry(camera, Config().with_overrides(overrides))
    off, tracked, own = [], [], np.zeros(frames[0].grey.shape, bool)
    for frame, T_true in zip(frames, truth, strict=True):
        spoiled, own = spoil(frame)
        result = odometry.track(spoiled)
        off.append(se3.distance(T_true, result.T_world_cam))
        tracked.append(result.status is Status.TRACKED)
    carried = odometry._front_end.carried
    shown = None if carried is None else carried.shown
    return np.array(off), np.array(tracked), own, shown


def test_past_scratches_the_scene_is_seen():
    """They outweigh it: before any is known to be the camera's, the others tell by depth."""
    cabinet = frames_of("cabinet")
    off, tracked, own, shown = followed(cabinet, scratched)
    assert off[10:].max() < 0.005
    assert off[tracked].max() < 0.03
    assert np.mean(shown[own] == 0) > 0.8
    assert np.mean(shown[~own] == 0) < 0.12
    off, _, _, shown = followed(cabinet, scratched, "edges.carried=kept")
    assert shown is None
    assert off[-1] > 0.05


@pytest.fixture(scope="module")
def along_a_cabinet():
    """As many frames as the longest case asks for: the others are beginnings of it."""
    return problems.rendered("cabinet", 81, speed=0.5, seed=2)


@pytest.mark.parametrize(("wiped", "rests"), [(20, False), (31, False), (20, True), (8, True)])
def test_where_depth_does_not_tell_what_moves_no_frame_is_sure(along_a_cabinet, wiped, rests):
    """Along a cabinet scratches and the rest lead elsewhere, and depth fits both ways."""
    count = wiped + 50
    camera, frames, truth = along_a_cabinet
    frames, truth = frames[:count], truth[:count]  # copies, which may be changed
    rng = np.random.default_rng(3)
    if rests:
        last, T = frames[wiped], truth[wiped]
        for i in range(wiped, count):
            noisy = np.clip(last.grey + rng.normal(0, 1, last.grey.shape), 0, 255)
            frames[i] = Frame(frames[i].timestamp, noisy.astype(np.uint8), last.depth)
            truth[i] = T
    of = {id(frame): i for i, frame in enumerate(frames)}

    def spoilt(frame):
        return scratched(frame) if of[id(frame)] < wiped else (frame, np.zeros(1, bool))

    off, tracked, _, _ = followed((camera, frames, truth), spoilt)
    assert off[6:wiped].min() > 0.1
    assert not tracked[2:wiped].any()
    assert tracked[-5:].all()  # a second and a half after the lens was wiped


def test_print_is_seen_past(panels):
    """It is little of what is seen, and found by poses that are right."""
    off, tracked, own, shown = followed(panels, printed)
    assert off.max() < 0.003
    assert tracked.all()
    assert np.mean(shown[own] == 0) > 0.9
    assert np.mean(shown[~own] == 0) < 0.03


@pytest.mark.parametrize("scene", ["notexture_far", "texture_near", "corridor"])
def test_of_a_clean_image_nothing_is_left_out(scene, panels):
    small = problems.CAMERA
    sequence = panels if scene == "notexture_far" else frames_of(scene, camera=small)
    off, tracked, _, shown = followed(sequence, lambda frame: (frame, np.zeros(1, bool)))
    assert shown is None
    assert tracked.all()
    assert off.max() < 0.01


def test_a_camera_that_stands_still_sees_all_of_what_does_so(panels, monkeypatch):
    """While half of the view goes by, nothing of the rest is the camera's own, by its depth."""
    camera, (first, *_), _ = panels
    tried, without = [], Parting._without

    def watched(*given):
        tried.append(without(*given))
        return tried[-1]

    monkeypatch.setattr(Parting, "_without", watched)
    rng, half = np.random.default_rng(1), camera.width // 2
    passing = problems.drawn_image(rng, (camera.height, 2 * camera.width), 40)
    odometry = Odometry(camera)
    for i in range(FRAMES):
        grey, depth = first.grey.copy(), first.depth.copy()
        grey[:, :half] = passing[:, 4 * i : 4 * i + half]
        depth[:, :half] = 0.8
        noisy = np.clip(grey + rng.normal(0, 1, grey.shape), 0, 255).astype(np.uint8)
        odometry.track(Frame(i / 30, noisy, depth))
    assert tried
    assert not any(tried)
    assert odometry._front_end.carried.shown is None


def test_a_frame_that_is_not_parted_is_not_registered_again(panels, monkeypatch):
    register, tried = Registrar.register, []

    def watched(self, seen, starts, term, *given, **options):
        tried.append((seen, starts.tobytes(), given, str(options)))
        return register(self, seen, starts, term, *given, **options)

    monkeypatch.setattr(Registrar, "register", watched)
    camera, frames, _ = panels
    odometry, parted, results = Odometry(camera), [], []
    align = odometry._locator.align

    def aligned(seen):
        parted.append(align(seen))
        return parted[-1]

    monkeypatch.setattr(odometry._locator, "align", aligned)
    for frame in frames:
        results.append(odometry.track(printed(frame)[0]))
    assert parted
    assert any(result.alignment is found for result in results for found in parted)
    for i, (seen, *how) in enumerate(tried):
        assert not any(seen is other and how == same for other, *same in tried[:i])


def test_what_was_registered_otherwise_does_not_serve(panels):
    camera, (first, second, *_), _ = panels
    odometry = Odometry(camera)
    odometry.track(first)
    odometry.track(second)
    locator, key = odometry._locator, odometry._course.key
    seen, found, starts = object(), object(), np.eye(4)[None]
    for other in (
        Aligned(object(), key, starts, found),
        Aligned(seen, object(), starts, found),
        Aligned(seen, key, starts + 1e-9, found),
        Aligned(seen, key, np.array([np.eye(4), np.eye(4)]), found),
    ):
        locator._aligned = other
        assert locator._known(seen, starts) is None
    locator._aligned = Aligned(seen, key, starts.copy(), found)
    assert locator._known(seen, starts) is found
    assert locator._known(seen, starts) is None  # it is asked for once


def test_one_look_is_what_a_frame_has_time_for(panels, monkeypatch):
    """A reference that is old gives way to the frame after the one that was counted."""
    when = {"_count": [], "_refer": []}
    for name, at in when.items():
        done = getattr(Carried, name)

        def noted(*given, done=done, at=at, **options):
            at.append(len(results))
            return done(*given, **options)

        monkeypatch.setattr(Carried, name, noted)
    camera, frames, _ = panels
    odometry, results = Odometry(camera), []
    for frame in frames:
        results.append(odometry.track(frame))
    assert when["_refer"][0] == 1
    assert len(when["_refer"]) > 1
    assert len(when["_count"]) > 1
    assert not set(when["_refer"]) & set(when["_count"])


def test_no_edge_is_made_by_leaving_some_out(panels):
    frame = scratched(panels[1][0])[0]
    config = Config().edges
    every = extract_edges(frame.grey, config)
    buffers = EdgeBuffers(*frame.grey.shape)
    buffers.shown = np.full(frame.grey.shape, 255, np.uint8)
    buffers.shown[100:200, 100:300] = 0
    some = extract_edges(frame.grey, config, buffers)
    hidden = buffers.shown.reshape(-1)[every.index] == 0
    assert hidden.any()
    np.testing.assert_array_equal(some.index, every.index[~hidden])


def test_bars_that_go_by_bar_for_bar_are_the_scenes():
    """Each is where another was a frame ago, and where that one ought to be by now."""
    camera = Camera(width=320, height=240, fx=300, fy=300, cx=160, cy=120)
    wall = problems.drawn_image(np.random.default_rng(3), (240, 1200), 60).astype(np.float32)
    wall[170:] = 110 + 90 * np.sign(np.sin(2 * np.pi * np.arange(1200) / 8))
    wall = cv2.GaussianBlur(wall, (0, 0), 0.8)
    odometry, depth = Odometry(camera), np.full((240, 320), 2.0, np.float32)
    rng = np.random.default_rng(1)
    for i in range(60):
        grey = wall[:, 8 * i : 8 * i + 320] + rng.normal(0, 1, (240, 320))
        result = odometry.track(Frame(i / 30, np.clip(grey, 0, 255).astype(np.uint8), depth))
        assert result.status is Status.TRACKED
        assert abs(result.T_world_cam[0, 3] - i * 8 / 150) < 0.005
    shown = odometry._front_end.carried.shown
    assert shown is None or np.mean(shown == 0) < 0.1


def test_where_a_lens_was_wiped_edges_are_taken_again():
    buffers = EdgeBuffers(120, 160)
    carried = Carried(CAMERA, buffers)
    ought, moved, stayed = carried._counts
    for side in (20, 100):
        ought[40:44, side : side + 40] = stayed[40:44, side : side + 40] = 8
    carried._see_past(6)
    assert np.mean(buffers.shown[40:44, 20:60] == 0) == 1
    assert np.mean(buffers.shown == 0) < 0.1
    carried._see_past(9)  # it stays out, though it has stayed less often than asked for
    assert buffers.shown[42, 40] == buffers.shown[42, 120] == 0
    moved[40:44, 20:60], ought[40:44, 20:60], stayed[40:44, 20:60] = 8, 1, 2
    carried._see_past(9)
    assert np.all(buffers.shown[40:44, 20:60] == 255)
    assert np.all(buffers.shown[40:44, 100:140] == 0)
    carried.forget()
    assert carried.shown is None


def test_more_than_half_of_an_image_is_not_left_out():
    carried = Carried(CAMERA, EdgeBuffers(120, 160))
    carried._counts[:, :70] = 8
    carried._counts[1] = 0
    carried._see_past(6)
    assert carried.shown is None


def test_what_is_hidden_is_asked_again(panels):
    """Else nobody could tell that it is gone."""
    grey, config = panels[1][0].grey, Config().edges
    buffers = EdgeBuffers(*grey.shape)
    carried = Carried(panels[0], buffers)
    every = extract_edges(grey, config, buffers)
    buffers.shown = np.full(grey.shape, 255, np.uint8)
    buffers.shown[100:300, 100:400] = 0
    some = extract_edges(grey, config, buffers)
    assert len(some) < len(every)
    np.testing.assert_array_equal(np.sort(carried._every(some)), every.index)


def test_after_a_jump_there_is_no_reference(panels):
    camera, frames, _ = panels
    odometry = Odometry(camera)
    for frame in frames[:3]:
        odometry.track(frame)
    carried = odometry._front_end.carried
    assert carried.has_reference
    odometry._rewind(frames[0].timestamp - 10)  # a clock that jumps back
    assert not carried.has_reference
