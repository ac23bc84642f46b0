"""The viewer: what it is given it shows, and who gives it never waits."""

import resource
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.clock import StageClock
from edvo.config import Config
from edvo.errors import ConfigError, MissingExtraError, OutputError
from edvo.evaluation.rpe import relative_pose_error
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.report import viewer_backlog, viewer_outputs
from edvo.report.viewer import Viewer
from edvo.report.viewer_backlog import Backlog
from edvo.report.viewer_places import Places
from edvo.report.viewer_shot import Shot
from edvo.report.viewer_truth import Truth
from edvo.trajectory import Trajectory

CAMERA = Camera(width=320, height=240, fx=260.0, fy=260.0, cx=159.5, cy=119.5)
DEPTH_M = 2.0
FRAMES = 25
PATIENCE_S = 60  # of what comes at once, but for a busy machine
GREY = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
BLANK = Frame(0.0, GREY, np.full(GREY.shape, DEPTH_M, np.float32))
EMPTY = Odometry(CAMERA).skip(0.0, "")


def shot(index: int, *, keyframe: bool = False) -> Shot:
    result = replace(EMPTY, index=index, timestamp=index / 10, is_keyframe=keyframe)
    return Shot(result, None, None, {}, BLANK)


class Slow:
    """Draws nothing before it is allowed to."""

    def __init__(self) -> None:
        self.may, self.begun = threading.Event(), threading.Event()
        self.drawn: list[Shot] = []

    def draw(self, shot: Shot) -> None:
        self.begun.set()
        assert self.may.wait(PATIENCE_S)
        self.drawn.append(shot)

    def hold(self, backlog: Backlog) -> None:
        """Hand in a first frame, and wait until it is being drawn."""
        backlog.put(shot(0))
        assert self.begun.wait(PATIENCE_S)


def indices(shots: list[Shot], *, pictures: bool) -> list[int]:
    return [shot.result.index for shot in shots if (shot.frame is not None) or not pictures]


def test_who_is_slow_gets_all_numbers_and_some_pictures() -> None:
    slow = Slow()
    backlog = Backlog(slow.draw, most_pictures=3)
    slow.hold(backlog)
    for index in range(1, 10):
        backlog.put(shot(index, keyframe=index == 7))
    slow.may.set()
    assert backlog.close()
    assert indices(slow.drawn, pictures=False) == list(range(10))
    # 0 was in hand; 1 to 3 waited; the keyframe took the place of 1.
    assert indices(slow.drawn, pictures=True) == [0, 2, 3, 7]
    assert (backlog.put_count, backlog.dropped_pictures, backlog.dropped) == (10, 6, 0)


def test_keyframes_do_not_push_out_keyframes() -> None:
    slow = Slow()
    backlog = Backlog(slow.draw, most_pictures=2)
    slow.hold(backlog)
    for index in range(1, 6):
        backlog.put(shot(index, keyframe=True))
    slow.may.set()
    assert backlog.close()
    assert indices(slow.drawn, pictures=True) == [0, 1, 2]


def test_numbers_are_bounded_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_backlog, "MOST_SHOTS", 5)
    slow = Slow()
    backlog = Backlog(slow.draw, most_pictures=1)
    slow.hold(backlog)
    for index in range(1, 10):
        backlog.put(shot(index))
    slow.may.set()
    assert backlog.close()
    assert indices(slow.drawn, pictures=False) == list(range(6))
    assert backlog.dropped == 4


def test_a_drawing_that_fails_ends_alone() -> None:
    def fail(shot: Shot) -> None:
        raise ValueError("no paint")

    backlog = Backlog(fail, most_pictures=2)
    backlog.put(shot(0))
    assert not backlog.close()
    backlog.put(shot(1))
    assert isinstance(backlog.failure, ValueError)


def test_a_drawing_that_hangs_is_given_up() -> None:
    slow = Slow()
    backlog = Backlog(slow.draw, most_pictures=2)
    for index in range(5):
        backlog.put(shot(index))
    assert not backlog.close(timeout_s=0.05)
    slow.may.set()


def path(count: int, rate: float, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    steps = [se3.exp(rng.normal(0, 0.02, 6)) for _ in range(count)]
    return Trajectory.from_poses(np.arange(count) / rate, np.array(list(accumulated(steps))))


def accumulated(steps: list[Any]) -> Iterator[Any]:
    T = np.eye(4)
    for step in steps:
        T = T @ step
        yield T


def test_error_so_far_is_that_of_the_evaluation() -> None:
    true, estimate = path(120, 60.0, 1), path(60, 30.0, 2)
    follower = Truth(true)
    errors = [
        follower.error(float(t), T)
        for t, T in zip(estimate.timestamps, estimate.poses, strict=True)
    ]
    expected = relative_pose_error(true, estimate)
    assert errors[:30] == [None] * 30
    # The evaluation drops the pair that ends on the last pose.
    found = np.array(errors[30:-1])
    np.testing.assert_allclose(found[:, 0], expected.translation, rtol=1e-9)
    np.testing.assert_allclose(found[:, 1], expected.rotation, rtol=1e-9)


def test_worlds_join_where_tracking_begins() -> None:
    true = path(60, 30.0, 3)
    follower = Truth(true)
    T = se3.exp(np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))
    assert follower.at(0.0, None) is None
    assert follower.at(99.0, T) is None
    first = follower.at(float(true.timestamps[4]), T)
    assert first is not None
    np.testing.assert_allclose(first, T)
    later = follower.at(float(true.timestamps[9]), None)
    assert later is not None
    np.testing.assert_allclose(
        se3.inverse(first) @ later, se3.inverse(true.poses[4]) @ true.poses[9], atol=1e-12
    )


def test_no_error_behind_a_gap_or_when_lost() -> None:
    true = path(300, 30.0, 4)
    follower = Truth(true)
    for index in (*range(40), *range(200, 225)):
        last = follower.error(float(true.timestamps[index]), true.poses[index])
    assert last is None
    assert follower.error(float(true.timestamps[226]), None) is None


def wall() -> np.ndarray:
    rng = np.random.default_rng(7)
    image = np.full((320, 700), 120, np.uint8)
    for u, v, width, height, grey in rng.integers(
        (0, 0, 15, 15, 30), (660, 300, 90, 70, 225), (160, 5)
    ):
        image[v : v + height, u : u + width] = grey
    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0), np.uint8)


def frames() -> list[Frame]:
    image, step = wall(), 4
    depth = np.full((CAMERA.height, CAMERA.width), DEPTH_M, np.float32)
    views = (image[20:260, 20 + step * i :][:, : CAMERA.width] for i in range(FRAMES))
    return [Frame(5 + i / 15, np.ascontiguousarray(view), depth) for i, view in enumerate(views)]


def truth() -> Trajectory:
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 0, 3] = np.arange(FRAMES) * 4 * DEPTH_M / CAMERA.fx
    return Trajectory.from_poses(5 + np.arange(FRAMES) / 15, poses)


def show(file: Path, **options: Any) -> list[TrackedFrame]:
    """Track all frames and one that cannot be read, and save the view."""
    clock = StageClock()
    odometry = Odometry(CAMERA, clock=clock)
    results = []
    with Viewer(CAMERA, odometry.config, file=file, **options) as viewer:
        for frame in frames():
            result = odometry.track(frame)
            if len(results) == FRAMES - 1 and result.alignment is not None:
                # The scene fits too well to show all colours.
                residuals = np.linspace(-4, 4, len(result.alignment.residuals))
                result = replace(result, alignment=replace(result.alignment, residuals=residuals))
            results.append(result)
            viewer.show(frame, result, track_s=0.004, stages=clock.take())
        results.append(odometry.skip(99.0, "cannot read depth/25.png"))
        viewer.show(None, results[-1])
    assert viewer.dropped_pictures == 0
    assert viewer.frames == FRAMES + 1
    return results


Rows = dict[str, list[tuple[int | None, dict[str, Any]]]]


def read(file: Path) -> Rows:
    """Read a recording by the viewer's own library: frame and components of each row."""
    rerun = pytest.importorskip("rerun")
    rows: Rows = defaultdict(list)
    for chunk in rerun.chunk.RrdReader(str(file)).stream().to_chunks():
        batch = chunk.to_record_batch().to_pydict()
        numbers = batch.get("frame", [None] * chunk.num_rows)
        for row, number in enumerate(numbers):
            parts = {name.split(":")[-1]: batch[name][row] for name in batch if ":" in name}
            rows[chunk.entity_path].append((number, parts))
    for entity in rows.values():
        entity.sort(key=lambda pair: -1 if pair[0] is None else pair[0])
    return rows


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[TrackedFrame], Rows]:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install 'edvo[view]'")
    file = tmp_path_factory.mktemp("view") / "wall.rrd"
    results = show(file, truth=truth(), title="wall")
    assert [each.name for each in file.parent.iterdir()] == ["wall.rrd"]
    return results, read(file)


def timed(rows: Rows, entity: str) -> list[tuple[int | None, dict[str, Any]]]:
    return [(number, parts) for number, parts in rows[entity] if number is not None]


def test_every_frame_is_there(saved: tuple[list[TrackedFrame], Rows]) -> None:
    results, rows = saved
    every = list(range(FRAMES))
    for entity in ("/world/camera/image", "/world/camera/image/edges", "/world/camera/depth"):
        assert [number for number, _ in timed(rows, entity)] == every, entity
    registered = [r.index for r in results if r.alignment is not None]
    for entity in ("/plots/fit/sigma_px", "/plots/fit/inliers", "/plots/iterations"):
        assert [number for number, _ in timed(rows, entity)] == registered, entity
    assert [number for number, _ in timed(rows, "/plots/time/track")] == every
    assert len(timed(rows, "/plots/time/registration")) == len(registered)
    assert [number for number, _ in timed(rows, "/world/camera")] == [*every, FRAMES]
    assert [number for number, _ in timed(rows, "/world/path")] == every[1:]
    assert [number for number, _ in timed(rows, "/world/truth")] == every[1:]
    # The first error is that of the frame a second after the first one.
    assert [n for n, _ in timed(rows, "/plots/error/translation_mm")] == every[15:]


def test_keyframes_and_map(saved: tuple[list[TrackedFrame], Rows]) -> None:
    results, rows = saved
    keyframes = [r.index for r in results if r.is_keyframe]
    assert len(keyframes) > 1
    for entity in ("/world/keyframes", "/world/edges"):
        assert [number for number, _ in timed(rows, entity)] == keyframes, entity
    pieces = [np.array(parts["positions"]) for _, parts in timed(rows, "/world/edges")]
    assert all(np.abs(piece[:, 2] - DEPTH_M).max() < 0.1 for piece in pieces)
    assert len(pieces[0]) > 500
    # Only what is new is added: a keyframe overlaps with the one before.
    assert 0 < len(pieces[1]) < 0.5 * len(pieces[0])
    places = np.floor(np.concatenate(pieces) / 0.02).astype(int)
    assert len(np.unique(places, axis=0)) > 0.97 * len(places)


def test_places_are_known_again() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-3, 3, (2000, 3))
    places = Places(0.02)
    assert places.add(points).all()
    assert not places.add(points + rng.uniform(-0.009, 0.009, points.shape)).any()
    apart = np.array([[0.05, 0.0, 0.0], [0.0, -0.05, 0.0], [0.0, 0.0, 0.05]])
    fresh = Places(0.02)
    fresh.add(np.zeros((1, 3)))
    assert fresh.add(apart).all()
    assert len(fresh) == 4
    assert len(fresh.add(np.empty((0, 3)))) == 0


def test_matches_and_residuals(saved: tuple[list[TrackedFrame], Rows]) -> None:
    results, rows = saved
    samples = dict(timed(rows, "/world/camera/image/samples"))
    strips = dict(timed(rows, "/world/camera/image/matches"))
    for result in results[1:FRAMES]:
        assert result.alignment is not None
        assert len(samples[result.index]["positions"]) == result.alignment.match_count
        lines = np.array(strips[result.index]["strips"])
        # The camera goes right, so what it sees goes left, 4 px a frame since the keyframe.
        gone = lines[:, 1] - lines[:, 0]
        assert np.median(gone[:, 0]) == pytest.approx(4 * (result.index - result.keyframe), abs=1)
        assert np.median(np.abs(gone[:, 1])) <= 1
    # Residuals of both signs have colours of both ends.
    last = results[FRAMES - 1].alignment
    assert last is not None
    residuals = last.residuals[last.matches >= 0]
    colours = np.array(samples[FRAMES - 1]["colors"], np.uint32)
    hotter = (colours >> 24).astype(int) - ((colours >> 8) & 255).astype(int)  # red less blue
    assert (np.diff(hotter[np.argsort(residuals)]) >= -1).all()
    assert hotter[np.argmin(residuals)] < -150 < 150 < hotter[np.argmax(residuals)]


def test_images_are_those_of_the_frames(saved: tuple[list[TrackedFrame], Rows]) -> None:
    _, rows = saved
    shown, frame = dict(timed(rows, "/world/camera/image")), frames()[3]
    packed = np.array(shown[3]["blob"], np.uint8).ravel()
    grey = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    assert np.abs(grey.astype(int) - frame.grey).mean() < 3
    edges = dict(timed(rows, "/world/camera/image/edges"))[3]
    classes = np.array(edges["buffer"], np.uint8).reshape(CAMERA.height, CAMERA.width)
    assert classes.max() <= 36
    assert 0.01 < (classes > 0).mean() < 0.4
    # Class 1 is a gradient to the right, 19 one to the left.
    du = cv2.Sobel(frame.grey, cv2.CV_32F, 1, 0)[1:-1, 1:-1]
    inner = classes[1:-1, 1:-1]
    assert du[inner == 1].mean() > 10 > -10 > du[inner == 19].mean()
    depth = dict(timed(rows, "/world/camera/depth"))[3]
    raw = np.array(depth["buffer"], np.uint8).ravel().view(np.uint16)
    assert (raw == 1000 * DEPTH_M).all()


def test_poses_errors_and_words(saved: tuple[list[TrackedFrame], Rows]) -> None:
    results, rows = saved
    poses = dict(timed(rows, "/world/camera"))
    for result in results:
        np.testing.assert_allclose(
            np.ravel(poses[result.index]["translation"]), result.T_world_cam[:3, 3], atol=1e-6
        )
    last = dict(timed(rows, "/world/truth"))[FRAMES - 1]
    end = np.array(last["strips"])[0, 1]
    np.testing.assert_allclose(end, [24 * 4 * DEPTH_M / CAMERA.fx, 0, 0], atol=1e-4)
    errors = [np.ravel(p["scalars"])[0] for _, p in timed(rows, "/plots/error/translation_mm")]
    assert 0 < np.median(errors) < 20
    states = [np.ravel(p["state"])[0] for _, p in timed(rows, "/status/state")]
    assert states == [Status.TRACKED.value, Status.LOST.value]
    words = [np.ravel(parts["text"])[0] for _, parts in timed(rows, "/status/log")]
    assert words[0].startswith("wall: 320 x 240")
    assert words[-1] == "frame 25: lost: cannot read depth/25.png"


def test_layout_shows_what_is_logged(tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    show(tmp_path / "plain.rrd")
    blueprint = rerun.chunk.RrdReader(str(tmp_path / "plain.rrd"))
    assert len(blueprint.blueprints()) == len(blueprint.recordings()) == 1
    (store,) = blueprint.blueprints()
    chunks = blueprint.stream(store=store).to_chunks()
    shown = repr([chunk.to_record_batch().to_pydict() for chunk in chunks])
    rows = read(tmp_path / "plain.rrd")
    assert "error over 1 s" not in shown  # there is no truth
    assert "/plots/error/translation_mm" not in {entity for entity in rows if timed(rows, entity)}
    for name in ("world", "edges", "matches", "depth", "sigma", "iterations", "time", "status"):
        assert name in shown
    for entity in ("world/edges", "world/path", "world/truth", "world/keyframes"):
        assert any(f"overrides/{entity}" in chunk.entity_path for chunk in chunks)


def test_a_viewer_that_hangs_does_not_hold_up(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    viewer = Viewer(CAMERA, file=tmp_path / "slow.rrd")
    slow = Slow()
    viewer._backlog._draw = slow.draw
    for index in range(3000):
        result = replace(EMPTY, index=index)
        viewer.show(BLANK, result)
    assert len(slow.drawn) == 0
    assert viewer.dropped_pictures > 2000
    slow.may.set()
    viewer.discard()
    assert list(tmp_path.iterdir()) == []


def test_what_is_interrupted_leaves_no_file(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    file = tmp_path / "kept.rrd"
    file.write_bytes(b"of old")

    def fail() -> None:
        with Viewer(CAMERA, file=file) as viewer:
            viewer.show(BLANK, EMPTY)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [each.name for each in tmp_path.iterdir()] == ["kept.rrd"]
    assert file.read_bytes() == b"of old"


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_no_room(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    show(tmp_path / "whole.rrd")  # compiled, and as large as it will be
    room = (tmp_path / "whole.rrd").stat().st_size
    for share in (0.3, 0.6):
        with (
            largest_file(int(share * room)),
            pytest.raises(OutputError, match=r"view\.rrd: .*room"),
        ):
            show(tmp_path / "view.rrd")
        assert [each.name for each in tmp_path.iterdir()] == ["whole.rrd"], share


def test_a_file_without_its_end_is_none(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    output = viewer_outputs.RrdFile(tmp_path / "view.rrd")
    output.stream.disconnect()
    output._drain.close()
    (aside,) = tmp_path.iterdir()
    aside.write_bytes(aside.read_bytes()[:-1])
    with pytest.raises(OutputError, match="its end is missing"):
        output.close()
    assert list(tmp_path.iterdir()) == []


def test_bad_places(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    for place in (tmp_path / "missing" / "a.rrd", tmp_path):
        with pytest.raises(OutputError, match="cannot write") as refusal:
            Viewer(CAMERA, file=place)
        assert str(place) in str(refusal.value)
        assert "\n" not in str(refusal.value)
    with pytest.raises(ConfigError, match="window"):
        Viewer(CAMERA, Config())


def test_no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_outputs.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OutputError, match=r"no display.*--save-view"):
        viewer_outputs.Window()


def test_a_window_that_does_not_open(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    monkeypatch.setattr(viewer_outputs, "OPENING_S", PATIENCE_S)
    monkeypatch.setattr(viewer_outputs, "SETTLING_S", PATIENCE_S)
    monkeypatch.setenv("DISPLAY", ":7777")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OutputError, match=r"does not open a window \(.+\); use --save-view") as no:
        viewer_outputs.Window()
    assert "\n" not in str(no.value)


def test_a_window_that_is_closed_ends_the_window_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a stand-in for the process: it listens, takes all there is, and then is gone."""
    rerun = pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    gone = threading.Event()

    class Closing(viewer_outputs.RrdFile):
        def __init__(self) -> None:
            super().__init__(tmp_path / "stand-in.rrd")

        def flush(self) -> None:
            if gone.is_set():
                raise OutputError("the viewer was closed or takes no more")
            super().flush()

    monkeypatch.setattr("edvo.report.viewer.Window", Closing)
    file = tmp_path / "view.rrd"
    odometry = Odometry(CAMERA)
    with Viewer(CAMERA, file=file, window=True) as viewer:
        for index, frame in enumerate(frames()):
            if index == 10:
                gone.set()
            viewer.show(frame, odometry.track(frame))
            time.sleep(0.01)
    assert isinstance(viewer.problem, OutputError)
    assert rerun is not None
    assert [n for n, _ in timed(read(file), "/world/camera/image")] == list(range(FRAMES))


def test_library_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r'pip install "edvo\[view\]"') as missing:
        Viewer(CAMERA, file="a.rrd")
    assert "\n" not in str(missing.value)
