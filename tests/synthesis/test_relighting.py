import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.datasets.incomplete import INCOMPLETE
from edvo.errors import DatasetError, FrameError, OutputError, SceneError
from edvo.frame import Frame
from edvo.synthesis import photometry, relight_folder
from edvo.synthesis.light_signals import Jumps, Swing
from edvo.synthesis.randomness import generator
from edvo.synthesis.relight_models import LIGHT_MODELS
from edvo.synthesis.relighting import Relighter, RelitSource, relight
from edvo.synthesis.surface import estimate_surface

CAMERA = Camera(width=640, height=480, fx=535.4, fy=539.2, cx=320.1, cy=247.6)
SMALL = Camera(160, 120, fx=133.0, fy=134.0, cx=79.6, cy=61.5, depth_scale=5000.0)
ALL = [*LIGHT_MODELS, "ambient+diffuse", "flicker+fade"]


def picture(seed: int = 0, camera: Camera = SMALL) -> NDArray[np.uint8]:
    """Blobs of colour that stay clear of black and white."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(40, 160, (camera.height // 8, camera.width // 8, 3))
    smooth = cv2.resize(noise, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(smooth, dtype=np.uint8)


def room(camera: Camera = SMALL) -> NDArray[np.float32]:
    """Two walls that meet in a corner, and a box in front."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    depth = np.repeat((2.5 / (1 + 0.6 * np.abs(x)))[None], camera.height, axis=0)
    depth[camera.height // 2 :, : camera.width // 4] = 1.2
    return depth.astype(np.float32)


# --- the models -----------------------------------------------------------------------------


@pytest.mark.parametrize("model", ALL)
def test_no_severity_leaves_every_byte(model: str) -> None:
    image = picture()
    assert (relight(image, room(), SMALL, 0.37, model, severity=0.0) == image).all()


@pytest.mark.parametrize("model", ALL)
def test_the_same_seed_and_time_give_the_same_bytes_in_any_order(model: str) -> None:
    image, times = picture(), [0.0, 0.4, 1.7, 3.1]

    def run(order: Sequence[float]) -> dict[float, bytes]:
        relighter = Relighter(model, severity=0.8, seed=5)
        return {t: relighter.relight(image, room(), SMALL, t).tobytes() for t in order}

    assert run(times) == run(times[::-1])


@pytest.mark.parametrize("model", ALL)
def test_more_severity_changes_more(model: str) -> None:
    image = picture()
    severities = np.linspace(0, 1, 6)
    change = [
        np.mean(
            [
                np.abs(
                    photometry.decode(relight(image, room(), SMALL, t, model, severity=s))
                    - photometry.decode(image)
                ).mean()
                for t in (0.13, 0.9, 2.2, 4.6)
            ]
        )
        for s in severities
    ]
    assert change[0] == 0
    assert (np.diff(change) > 0).all()
    assert change[-1] > 0.01


@pytest.mark.parametrize("model", ALL)
def test_grey_and_colour_keep_shape_and_type_and_the_input_is_untouched(model: str) -> None:
    colour, depth = picture(), room()
    for image in (colour, np.ascontiguousarray(colour[..., 0])):
        before = image.copy()
        relit = relight(image, depth, SMALL, 0.2, model, severity=0.5)
        assert relit.shape == image.shape
        assert relit.dtype == np.uint8
        assert (image == before).all()
    assert (depth == room()).all()


def test_mean_brightness_follows_the_ambient_model() -> None:
    grey = np.ascontiguousarray(picture()[..., 1])
    times = np.arange(0, 3, 1 / 30)
    for frequency in (2.0, 0.5):
        relighter = Relighter("ambient", severity=0.6, frequency=frequency, jumps=())
        light = [
            photometry.decode(relighter.relight(grey, None, None, t)).astype(np.float64).mean()
            for t in times
        ]
        stops = np.log2(np.array(light) / photometry.decode(grey).astype(np.float64).mean())
        expected = 0.6 * (-1.125 + 1.375 * np.sin(2 * np.pi * frequency * times))
        assert stops == pytest.approx(expected, abs=0.03)


def test_jumps_come_at_the_given_instants_and_nowhere_else() -> None:
    grey = np.ascontiguousarray(picture()[..., 1])
    relighter = Relighter("exposure", severity=0.5, jumps=(0.5, 1.25))
    times = np.arange(60) / 30
    means = np.array([relighter.relight(grey, None, None, t).mean() for t in times])
    jumped = times[1:][np.abs(np.diff(means)) > 3]
    assert jumped == pytest.approx([0.5, 1.2667], abs=1e-3)
    assert (np.abs(np.diff(means)) < 1e-9).sum() == 57


def test_the_lamp_lights_what_faces_it() -> None:
    # In the far corner of a room, the left wall faces to the right, and so to a lamp there.
    x = (np.arange(640) - CAMERA.cx) / CAMERA.fx
    corner = np.repeat((3.0 / (1 + 0.9 * np.abs(x)))[None], 480, axis=0).astype(np.float32)
    grey = np.full((480, 640), 120, np.uint8)
    at_right, at_left = (
        relight(grey, corner, CAMERA, t, "diffuse", severity=1.0, frequency=1.0, jumps=())
        for t in (0.25, 0.75)
    )
    left, right = np.s_[100:380, 60:260], np.s_[100:380, 380:580]
    assert at_right[left].mean() > at_right[right].mean() + 10
    assert at_left[right].mean() > at_left[left].mean() + 10


def test_quadrants_differ_and_have_no_hard_border() -> None:
    grey = np.full((480, 640), 110, np.uint8)
    relit = relight(grey, None, None, 0.05, "quadrants", severity=1.0).astype(int)
    corners = [relit[10, 10], relit[10, -10], relit[-10, -10], relit[-10, 10]]
    assert len({c // 8 for c in corners}) >= 3
    assert max(np.abs(np.diff(relit, axis=a)).max() for a in (0, 1)) <= 5


@pytest.mark.parametrize(("mains", "beat"), [(100.0, 10.0), (120.0, 0.0)])
def test_mains_flicker_aliases_with_the_frame_rate(mains: float, beat: float) -> None:
    row = [
        relight(np.full((48, 64), 120, np.uint8), None, None, i / 30, "flicker", severity=0.5,
                frequency=mains)[0].mean()
        for i in range(60)
    ]  # fmt: skip
    spectrum = np.abs(np.fft.rfft(np.array(row) - np.mean(row)))
    if beat:
        assert np.fft.rfftfreq(60, 1 / 30)[spectrum.argmax()] == pytest.approx(beat)
    else:
        assert np.ptp(row) < 1e-9


def test_a_rolling_shutter_puts_bands_into_the_image() -> None:
    relit = relight(np.full((480, 64), 120, np.uint8), None, None, 0.0, "flicker", severity=0.8)
    assert np.ptp(relit.mean(axis=1)) > 20
    assert np.ptp(relit[:, :].mean(axis=0)) == 0


def test_fading_ends_near_dark_and_noisy() -> None:
    grey = np.full((120, 160), 130, np.uint8)
    dark = relight(grey, None, None, 5.0, "fade", severity=1.0, seed=1)
    assert dark.mean() < 25
    assert dark.std() > 1.5
    assert (dark != relight(grey, None, None, 5.0, "fade", severity=1.0, seed=2)).any()


def test_a_spotlight_wanders_over_a_dim_image() -> None:
    grey = np.full((120, 160), 100, np.uint8)
    brightest = []
    for t in (0.0, 0.7, 1.4):
        light = photometry.decode(relight(grey, None, None, t, "spotlight", severity=1.0))
        light /= photometry.decode(grey)
        assert light.min() < 0.2
        assert light.max() > 2
        brightest.append(np.array(np.unravel_index(light.argmax(), light.shape)))
    steps = [np.linalg.norm(b - a) for a, b in pairwise(brightest)]
    assert min(steps) > 10


def test_exposure_goes_in_steps_that_light_the_whole_image() -> None:
    grey = np.full((60, 80), 90, np.uint8)
    light = []
    for t in np.arange(0.0, 6.0, 0.1):
        relit = relight(grey, None, None, float(t), "exposure", severity=0.5)
        assert np.ptp(relit) == 0
        light.append(float(photometry.decode(relit).mean()))
    changes = np.flatnonzero(np.diff(light))
    assert 4 <= len(changes) <= 7  # one each second
    assert np.abs(np.diff(np.log2(light))[changes]).min() > 0.5  # stops


def test_gamma_keeps_black_and_white() -> None:
    ends = np.array([[0, 255]], np.uint8)
    for t in (0.125, 0.375):
        assert (relight(ends, None, None, t, "gamma", severity=1.0) == ends).all()


# --- signals --------------------------------------------------------------------------------


def test_a_swing_is_a_sine() -> None:
    t = np.linspace(0, 2, 101)
    assert [Swing(2.0).at(x) for x in t] == pytest.approx(np.sin(4 * np.pi * t))


def test_random_jumps_are_rare_big_and_repeatable() -> None:
    jumps = Jumps(seed=3)
    times = np.arange(0, 30, 0.01)
    levels = np.array([jumps.at(t) for t in times])
    assert (levels == [Jumps(seed=3).at(t) for t in times]).all()
    changes = np.abs(np.diff(levels))
    assert 18 <= np.count_nonzero(changes) <= 21
    assert changes[changes > 0][1:].min() >= 1.2
    assert np.abs(levels).max() <= 1.0
    assert (levels != [Jumps(seed=4).at(t) for t in times]).any()


def test_jump_instants_must_rise() -> None:
    with pytest.raises(SceneError, match="do not rise"):
        Jumps(instants=(2.0, 1.0))


# --- surfaces -------------------------------------------------------------------------------


def test_the_normal_of_a_plane_is_found_within_a_degree() -> None:
    normal = np.array([0.5, -0.3, -0.8])
    normal /= np.linalg.norm(normal)
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    rays = np.dstack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)])
    depth = (-2.0 / (rays @ normal)).astype(np.float32)
    depth[200:260, 300:380] = 0.0
    surface = estimate_surface(depth, CAMERA)
    off = np.arccos(np.clip(surface.normals @ normal.astype(np.float32), -1, 1))
    assert np.degrees(off).max() < 1.0


def test_noise_and_holes_of_a_kinect_leave_the_normals_smooth() -> None:
    rng = generator(0, "test")
    depth = np.full((480, 640), 2.5, np.float32)
    depth += rng.standard_normal(depth.shape, dtype=np.float32) * np.float32(0.0096)
    depth[rng.random(depth.shape) < 0.05] = 0
    depth[:, :40] = 0
    depth[100:180, 200:330] = 0
    surface = estimate_surface(depth, CAMERA)
    angle = np.degrees(np.arccos(np.clip(-surface.normals[..., 2], -1, 1)))
    assert angle.max() < 5
    lit = surface.spread(surface.normals[..., 0])
    assert np.abs(np.diff(lit, axis=1)).max() < 0.005


def test_without_any_depth_all_faces_the_camera() -> None:
    surface = estimate_surface(np.zeros((48, 64), np.float32), SMALL)
    rays = surface.points / np.linalg.norm(surface.points, axis=-1, keepdims=True)
    assert np.abs(surface.normals + rays).max() < 1e-5
    assert np.isfinite(surface.points).all()


def test_relighting_a_plain_scene_makes_no_edges(real_data: Path) -> None:
    source = open_source(real_data / "tum_fr3_structure_notexture_far")

    def edges(image: NDArray[np.uint8], low: float) -> NDArray[np.bool_]:
        return np.asarray(cv2.Canny(cv2.GaussianBlur(image, (5, 5), 0), low, 2 * low) > 0)

    before = new = 0
    for i in range(3, 120, 29):
        frame = source.read(i).frame
        assert frame is not None
        relit = relight(frame.grey, frame.depth, source.camera, i / 30, "diffuse", severity=1.0)
        near_an_edge = cv2.dilate(edges(frame.grey, 10).astype(np.uint8), np.ones((7, 7)))
        before += np.count_nonzero(edges(frame.grey, 20))
        new += np.count_nonzero(edges(relit, 20) & (near_an_edge == 0))
    assert before > 2000
    assert new < 0.005 * before


# --- refusals -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "disco"}, "unknown light model 'disco'; there are: ambient, diffuse"),
        ({"model": "ambient+"}, "unknown light model ''"),
        ({"severity": 1.5}, "severity is 1.5; give a number from 0 to 1"),
        ({"severity": float("nan")}, "severity is nan"),
        ({"frequency": 0.0}, "frequency is 0.0 Hz; give one above 0"),
        ({"seed": -1}, "seed is -1; give 0 or more"),
        ({"jumps": (1.0, 1.0)}, "do not rise"),
    ],
)
def test_wrong_settings_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message.replace("+", r"\+")):
        relight(picture(), room(), SMALL, 2.0, **options)


def test_diffuse_light_needs_depth_that_fits() -> None:
    with pytest.raises(SceneError, match="needs depth images"):
        relight(picture(), None, SMALL, 0.0, "diffuse")
    with pytest.raises(FrameError, match="160x120 with a depth image of 64x48"):
        relight(picture(), np.ones((48, 64), np.float32), SMALL, 0.0, "diffuse")
    with pytest.raises(FrameError, match="8-bit"):
        relight(np.zeros((4, 4), np.uint16), None, None, 0.0, "ambient")  # type: ignore[arg-type]


# --- folders --------------------------------------------------------------------------------


def sequence(
    folder: Path, *, depth: bool = True, kind: str = "png", frames: int = 4, clock: int = 100
) -> Path:
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    rgb, deep = ["# colour images"], ["# depth images"]
    for i in range(frames):
        stamp, later = f"{clock + i / 30:.6f}", f"{clock + 0.012 + i / 30:.6f}"
        cv2.imwrite(str(folder / f"rgb/{stamp}.{kind}"), picture(i))
        values = np.rint(room() * 5000).astype(np.uint16)
        cv2.imwrite(str(folder / f"depth/{later}.png"), values)
        rgb.append(f"{stamp} rgb/{stamp}.{kind}")
        deep.append(f"{later} depth/{later}.png")
    (folder / "rgb.txt").write_text("\n".join(rgb) + "\n")
    if depth:
        (folder / "depth.txt").write_text("\n".join(deep) + "\n")
    (folder / "groundtruth.txt").write_text(f"{clock} 0 0 0 0 0 0 1\n{clock}.2 0 0 0 0 0 0 1\n")
    SMALL.to_yaml(folder / "camera.yaml")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_a_relit_folder_differs_in_its_colour_images_alone(tmp_path: Path) -> None:
    source = sequence(tmp_path / "a")
    calls: list[tuple[int, int]] = []
    result = relight_folder.relight_folder(
        source, tmp_path / "b", seed=1, progress=lambda done, total: calls.append((done, total))
    )
    assert (result.relit, result.problems) == (4, ())
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    before, after = contents(source), contents(tmp_path / "b")
    assert before.keys() == after.keys()
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {name for name in before if name.startswith("rgb/")}
    stored = cv2.imread(str(tmp_path / "b/rgb/100.000000.png"), cv2.IMREAD_UNCHANGED)
    depth = np.rint(room() * 5000) / np.float32(5000)
    assert (stored == relight(picture(0), depth, SMALL, 0.0, seed=1)).all()
    relight_folder.relight_folder(source, tmp_path / "c", seed=1)
    assert contents(tmp_path / "c") == after


def test_the_relit_source_shows_what_the_relit_folder_holds(tmp_path: Path) -> None:
    source = open_source(sequence(tmp_path / "a"))
    relighter = Relighter("ambient", severity=0.4, seed=1)
    relight_folder.relight_folder(tmp_path / "a", tmp_path / "b", "ambient", severity=0.4, seed=1)
    lit, stored = RelitSource(source, relighter), open_source(tmp_path / "b")
    assert len(lit) == len(stored) == 4
    assert list(lit.stamps) == list(stored.stamps)
    assert lit.name == "a+ambient"
    assert lit.describe()["light"] == {"model": "ambient", "severity": 0.4}
    for i in (3, 0):
        one, other, plain = lit.read(i).frame, stored.read(i).frame, source.read(i).frame
        assert isinstance(one, Frame)
        assert other is not None
        assert plain is not None
        assert np.abs(one.grey.astype(int) - other.grey).max() <= 2
        assert (one.depth == plain.depth).all()
        assert one.depth_delay == other.depth_delay == pytest.approx(0.012, abs=1e-6)
        assert (one.grey != plain.grey).any()


def test_jpeg_stays_jpeg(tmp_path: Path) -> None:
    source = sequence(tmp_path / "a", kind="jpg")
    relight_folder.relight_folder(source, tmp_path / "b", "gamma", severity=0.5)
    files = sorted((tmp_path / "b/rgb").iterdir())
    assert [file.suffix for file in files] == [".jpg"] * 4
    assert all(file.read_bytes().startswith(b"\xff\xd8\xff") for file in files)
    stored = cv2.imread(str(files[1]))
    assert stored is not None
    original = cv2.imread(str(source / f"rgb/{files[1].name}"))
    wanted = relight(np.asarray(original, np.uint8), None, None, 0.033333, "gamma")
    assert np.abs(stored.astype(int) - wanted).mean() < 1.5


def test_a_folder_without_depth_takes_every_model_but_diffuse(tmp_path: Path) -> None:
    source = sequence(tmp_path / "a", depth=False)
    assert relight_folder.relight_folder(source, tmp_path / "b", "flicker").relit == 4
    with pytest.raises(SceneError, match="has no depth images"):
        relight_folder.relight_folder(source, tmp_path / "c", "ambient+diffuse")
    assert not (tmp_path / "c").exists()


def test_a_filled_target_is_refused_without_force(tmp_path: Path) -> None:
    source = sequence(tmp_path / "a")
    (tmp_path / "b").mkdir()
    (tmp_path / "b/note.txt").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        relight_folder.relight_folder(source, tmp_path / "b", "gamma")
    assert contents(tmp_path / "b") == {"note.txt": b"mine"}
    relight_folder.relight_folder(source, tmp_path / "b", "gamma", force=True)
    assert (tmp_path / "b/note.txt").read_text() == "mine"
    with pytest.raises(OutputError, match="is the source itself"):
        relight_folder.relight_folder(source, source, "gamma", force=True)


def test_the_lists_come_last_so_that_half_a_sequence_does_not_look_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, target = sequence(tmp_path / "a"), tmp_path / "b"
    relight_folder.relight_folder(source, target, "gamma")
    write = relight_folder.write_atomically

    def full(path: str | os.PathLike[str], content: bytes | str) -> None:
        if Path(path).name.startswith("100.066"):
            raise OutputError(f"cannot write {path}: No space left on device")
        write(path, content)

    monkeypatch.setattr(relight_folder, "write_atomically", full)
    with pytest.raises(OutputError, match="No space left"):
        relight_folder.relight_folder(source, target, "ambient", force=True)
    assert not (target / "rgb.txt").exists()
    assert not (target / "depth.txt").exists()


@pytest.mark.parametrize("truth", [True, False])
def test_an_interrupted_folder_is_refused_until_it_is_written_again(
    tmp_path: Path, truth: bool
) -> None:
    source, target = sequence(tmp_path / "a", clock=1_300_000_000), tmp_path / "b"
    if not truth:
        (source / "groundtruth.txt").unlink()

    def interrupt(done: int, total: int) -> None:
        if done == total:  # every image is there
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        relight_folder.relight_folder(
            source, target, "gamma", severity=0.5, jumps=[0.1], progress=interrupt
        )
    for format in (None, "folder", "tum"):
        with pytest.raises(DatasetError) as refused:
            open_source(target, format=format)
        message = str(refused.value)
        assert message.startswith(f"{target} is incomplete")
        assert f"edvo relight {source} {target} --model gamma --severity 0.5" in message
        assert "--jump 0.1 --force" in message
        assert "\n" not in message
    with pytest.raises(DatasetError, match="b is incomplete"):
        relight_folder.relight_folder(target, tmp_path / "c", "gamma")
    # It is the mark alone that keeps this folder from being read.
    (target / INCOMPLETE).rename(tmp_path / "aside")
    assert len(open_source(target)) == 4
    (tmp_path / "aside").rename(target / INCOMPLETE)

    with pytest.raises(OutputError, match="not empty"):
        relight_folder.relight_folder(source, target, "gamma")
    relight_folder.relight_folder(source, target, "gamma", force=True)
    assert contents(target).keys() == contents(source).keys()
    assert len(open_source(target)) == 4


def test_a_damaged_image_is_named_and_passed_on(tmp_path: Path) -> None:
    source = sequence(tmp_path / "a")
    bad, gone = (source / f"rgb/{name}.png" for name in ("100.033333", "100.066667"))
    bad.write_bytes(bad.read_bytes()[:200])
    gone.unlink()
    result = relight_folder.relight_folder(source, tmp_path / "b", "gamma")
    assert result.relit == 2
    assert [name in line for name, line in zip(
        ("100.033333", "100.066667"), result.problems, strict=True)] == [True, True]  # fmt: skip
    assert (tmp_path / "b/rgb/100.033333.png").read_bytes() == bad.read_bytes()
    assert not (tmp_path / "b/rgb/100.066667.png").exists()


def test_what_is_no_sequence_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(DatasetError, match=r"no rgb\.txt"):
        relight_folder.relight_folder(tmp_path / "empty", tmp_path / "b")
    source = sequence(tmp_path / "a")
    (source / "rgb.txt").write_text("100.0 ../outside.png\n")
    with pytest.raises(DatasetError, match="outside of the folder"):
        relight_folder.relight_folder(source, tmp_path / "b")
    assert not (tmp_path / "b").exists()
    (source / "rgb.txt").write_text("100.0 rgb/none.png\n")
    with pytest.raises(DatasetError, match="no colour image can be relit"):
        relight_folder.relight_folder(source, tmp_path / "b")
    assert not (tmp_path / "b/rgb.txt").exists()
