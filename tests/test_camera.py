import doctest
import math
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, reject
from hypothesis import strategies as st

from edvo import camera as camera_module
from edvo.camera import Camera
from edvo.errors import CameraError, OutputError
from edvo.frame import Frame

FR1 = Camera(
    640,
    480,
    517.306,
    516.469,
    318.643,
    255.314,
    (0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
)
FR2 = Camera(
    640,
    480,
    520.909,
    521.007,
    325.141,
    249.702,
    (0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
)
BARREL = Camera(
    752, 480, 458.654, 457.296, 367.215, 248.375, (-0.2834, 0.0739, 0.0002, 1.8e-5, 0.0)
)
PINHOLE = Camera(640, 480, 535.4, 539.2, 320.1, 247.6)
DISTORTED = [FR1, FR2, BARREL]
VALUES: dict[str, Any] = {
    "width": 640,
    "height": 480,
    "fx": 517.3,
    "fy": 516.5,
    "cx": 318.6,
    "cy": 255.3,
    "distortion": [0.1, -0.2, 0.001, 0.002, 0.05],
    "depth_scale": 5000,
}


def all_pixels(camera: Camera) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.column_stack((u.ravel(), v.ravel())).astype(float)


def brown(camera: Camera, x: float, y: float) -> tuple[float, float]:
    """Brown's model as a textbook writes it, for one ray."""
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    yd = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return camera.fx * xd + camera.cx, camera.fy * yd + camera.cy


@pytest.mark.parametrize("camera", DISTORTED)
def test_undistort_is_exact_on_the_whole_image(camera: Camera) -> None:
    raw = all_pixels(camera)
    ideal = camera.undistort(raw)
    np.testing.assert_allclose(camera.distort(ideal), raw, atol=1e-8, rtol=0)
    # And the other way round: the root is the right one, not another.
    np.testing.assert_allclose(camera.undistort(camera.distort(ideal)), ideal, atol=1e-8, rtol=0)


@given(
    st.sampled_from(DISTORTED),
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=20),
)
def test_undistort_inverts_distort_between_pixels(
    camera: Camera, shares: list[tuple[float, float]]
) -> None:
    raw = np.array(shares) * [camera.width, camera.height] - 0.5
    np.testing.assert_allclose(camera.distort(camera.undistort(raw)), raw, atol=1e-8, rtol=0)


@given(
    st.tuples(
        st.floats(-0.2, 0.4),
        st.floats(-0.05, 0.4),
        st.floats(-0.01, 0.01),
        st.floats(-0.01, 0.01),
        st.floats(0.0, 0.5),
    )
)
def test_undistort_inverts_any_camera_that_is_accepted(coefficients: tuple[float, ...]) -> None:
    try:
        camera = Camera(64, 48, 50.0, 50.0, 31.0, 24.0, coefficients)  # type: ignore[arg-type]
    except CameraError:
        reject()  # it folds
    raw = all_pixels(camera)
    np.testing.assert_allclose(camera.distort(camera.undistort(raw)), raw, atol=1e-8, rtol=0)


@pytest.mark.parametrize("camera", DISTORTED)
def test_undistort_agrees_with_opencv(camera: Camera) -> None:
    raw = all_pixels(camera)[::97]
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    coefficients = np.array(camera.distortion)
    theirs = cv2.undistortPoints(
        raw[:, None], camera.matrix, coefficients, None, np.eye(3), camera.matrix, stop
    )
    np.testing.assert_allclose(camera.undistort(raw), theirs[:, 0], atol=1e-6, rtol=0)


@pytest.mark.parametrize("camera", [*DISTORTED, PINHOLE])
def test_project_agrees_with_opencv(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.5, -0.4, 1.0], [0.5, 0.4, 1.5], (500, 3))
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9, rtol=0)


def test_project_by_hand() -> None:
    np.testing.assert_allclose(
        PINHOLE.project([[0, 0, 2], [1, -1, 2]]), [[320.1, 247.6], [587.8, -22.0]], atol=1e-12
    )
    np.testing.assert_allclose(FR1.project([[0.2, -0.3, 2.0]])[0], brown(FR1, 0.1, -0.15))


@pytest.mark.parametrize("camera", [*DISTORTED, PINHOLE])
def test_backproject_inverts_project(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    raw = rng.uniform([0, 0], [camera.width - 1, camera.height - 1], (500, 2))
    depth = rng.uniform(0.3, 8.0, 500)
    points = camera.backproject(raw, depth)
    np.testing.assert_array_equal(points[:, 2], depth)
    np.testing.assert_allclose(camera.project(points), raw, atol=1e-8, rtol=0)


def test_what_no_camera_sees_is_not_a_pixel() -> None:
    assert np.isnan(PINHOLE.project([[0, 0, 0], [1, 1, -2], [math.nan, math.nan, 1]])).all()
    assert PINHOLE.project(np.empty((0, 3))).shape == (0, 2)
    # 60 degrees aside the fold of this lens would bring the point back into the image.
    folding = Camera(640, 480, 500.0, 500.0, 319.5, 239.5, (-0.2, 0.0, 0.0, 0.0, 0.0))
    u, _ = brown(folding, 2.1, 0.0)
    assert 0 < u < 640
    assert np.isnan(folding.project([[2.1, 0.0, 1.0]])).all()
    assert np.isnan(folding.undistort([[1e5, 0.0]])).all()


def test_a_pinhole_leaves_pixels_and_images_as_they_are() -> None:
    raw = np.array([[0.0, 0.0], [639.0, 479.0]])
    assert not PINHOLE.is_distorted
    assert FR1.is_distorted
    np.testing.assert_array_equal(PINHOLE.undistort(raw), raw)
    np.testing.assert_array_equal(PINHOLE.distort(raw), raw)
    assert PINHOLE.undistort(raw) is not raw
    image = np.zeros((480, 640), np.uint8)
    assert PINHOLE.undistort_image(image) is image
    assert PINHOLE.undistort_depth(image) is image


def test_matrix() -> None:
    np.testing.assert_array_equal(PINHOLE.matrix, [[535.4, 0, 320.1], [0, 539.2, 247.6], [0, 0, 1]])


@pytest.mark.parametrize("camera", [FR1, PINHOLE])
def test_undistortion_table_is_undistort_at_every_pixel(camera: Camera) -> None:
    table = camera.undistortion_table()
    assert table.dtype == np.float32
    assert table.shape == (480, 640, 2)
    np.testing.assert_allclose(
        table.reshape(-1, 2), camera.undistort(all_pixels(camera)), atol=5e-5, rtol=0
    )
    assert table.flags.c_contiguous
    assert not table.flags.writeable
    assert replace(camera).undistortion_table() is table  # an equal camera: made once


def test_undistort_image_takes_each_pixel_from_where_the_lens_put_it() -> None:
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    image = (u * 0.25 + v * 0.1).astype(np.float32)  # bilinear interpolation is exact on a ramp
    result = FR1.undistort_image(image)
    raw = FR1.distort(all_pixels(FR1))
    inside = ((raw >= 0) & (raw <= [639, 479])).all(axis=1)
    assert inside.mean() > 0.9
    expected = raw[:, 0] * 0.25 + raw[:, 1] * 0.1
    np.testing.assert_allclose(result.ravel()[inside], expected[inside], atol=0.02)


def test_undistort_image_invents_no_border() -> None:
    white = np.full((480, 752, 3), 200, np.uint8)
    result = Camera(752, 480, 458.0, 457.0, 367.0, 248.0, (0.2, 0, 0, 0, 0)).undistort_image(white)
    assert result.dtype == np.uint8
    assert (result == 200).all()


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_undistort_depth_never_mixes_values(dtype: Any) -> None:
    rng = np.random.default_rng(2)
    depth = rng.choice(np.array([0, 1000, 4000], dtype), (480, 640))
    result = FR1.undistort_depth(depth)
    assert result.dtype == dtype
    assert set(np.unique(result)) == {0, 1000, 4000}
    raw = FR1.distort(all_pixels(FR1))
    nearest = np.rint(raw).astype(int)
    inside = ((nearest >= 0) & (nearest < [640, 480])).all(axis=1)
    assert not result.ravel()[~inside].any()  # missing where the lens saw nothing
    clear = inside & (np.abs(raw - np.floor(raw) - 0.5) > 0.02).all(axis=1)  # ties aside
    u, v = nearest[clear].T
    np.testing.assert_array_equal(result.ravel()[clear], depth[v, u])


def test_undistort_refuses_images_of_another_camera() -> None:
    with pytest.raises(CameraError, match="image of 320x240 and camera of 640x480"):
        FR1.undistort_image(np.zeros((240, 320, 3), np.uint8))
    with pytest.raises(CameraError, match="320x240"):
        PINHOLE.undistort_depth(np.zeros((240, 320), np.float32))


@pytest.mark.parametrize("camera", [*DISTORTED, PINHOLE])
@pytest.mark.parametrize("factor", [0.5, 2.0, 0.37, 1.0])
def test_scaled_sees_the_same_rays(camera: Camera, factor: float) -> None:
    scaled = camera.scaled(factor)
    assert (scaled.width, scaled.height) == (
        round(camera.width * factor),
        round(camera.height * factor),
    )
    points = np.random.default_rng(3).uniform([-0.5, -0.4, 1], [0.5, 0.4, 1.5], (50, 3))
    ratio = np.array([scaled.width / camera.width, scaled.height / camera.height])
    expected = (camera.project(points) + 0.5) * ratio - 0.5
    np.testing.assert_allclose(scaled.project(points), expected, atol=1e-9)
    assert scaled.depth_scale == camera.depth_scale


def test_scaled_by_hand_and_as_opencv_resizes() -> None:
    half = PINHOLE.scaled(0.5)
    assert (half.width, half.height, half.fx, half.fy) == (320, 240, 267.7, 269.6)
    assert (half.cx, half.cy) == pytest.approx((159.8, 123.55))
    # The centre of a blob moves as the camera says, when cv2.resize halves the image.
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    blob = np.exp(-((u - 320.1) ** 2 + (v - 247.6) ** 2) / 200).astype(np.float32)
    small = cv2.resize(blob, (320, 240), interpolation=cv2.INTER_AREA)
    v, u = np.indices(small.shape)
    centre = (small * u).sum() / small.sum(), (small * v).sum() / small.sum()
    assert centre == pytest.approx((half.cx, half.cy), abs=1e-3)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, 1e-4])
def test_scaled_refuses_what_leaves_no_image(factor: float) -> None:
    with pytest.raises(CameraError, match="factor"):
        PINHOLE.scaled(factor)


def test_a_camera_is_a_value() -> None:
    array = np.array(FR1.distortion)
    same = Camera(np.int64(640), 480.0, np.float64(517.306), 516.469, 318.643, 255.314, array)  # type: ignore[arg-type]
    assert same == FR1
    assert hash(same) == hash(FR1)
    assert isinstance(same.width, int)
    with pytest.raises(FrozenInstanceError):
        FR1.fx = 1.0  # type: ignore[misc]


def test_file_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    for camera in (
        FR1,
        PINHOLE,
        replace(FR1, name="my: camera # 1", depth_scale=1000.1, distortion=(1e-7, 0, 0, 0, 0)),
    ):
        camera.to_yaml(path)
        assert Camera.from_yaml(path) == camera
        assert yaml.safe_load(path.read_text()) == camera.to_dict()
    assert "# k1 k2 p1 p2 k3" in path.read_text()
    assert [file.name for file in tmp_path.iterdir()] == ["camera.yaml"]


def test_file_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"missing"):
        FR1.to_yaml(tmp_path / "missing" / "camera.yaml")


def test_dict_comes_back() -> None:
    assert Camera.from_dict(FR1.to_dict()) == FR1
    assert "name" not in FR1.to_dict()
    assert Camera.from_dict({**VALUES, "distortion": [0.1, 0.2, 0, 0]}).distortion[4] == 0.0
    assert not Camera.from_dict(
        {key: value for key, value in VALUES.items() if key != "distortion"}
    ).is_distorted


def test_real_cameras(real_data: Path) -> None:
    cameras = {path.parent.name: Camera.from_yaml(path) for path in real_data.glob("*/camera.yaml")}
    assert cameras["tum_fr1_xyz"] == replace(FR1, depth_scale=5000.0)
    assert cameras["tum_fr3_cabinet_sparse"] == replace(PINHOLE, depth_scale=5000.0)
    assert cameras["icl_office_kt3"].fy == 480.0


def test_depth_is_in_millimetres_unless_it_is_said_otherwise_as_that_of_frames_is() -> None:
    depth = np.full((480, 640), 1500, np.uint16)
    frame = Frame.from_images(0.0, np.zeros((480, 640), np.uint8), depth)
    assert PINHOLE.depth_scale == 1000.0
    assert frame.depth[0, 0] == np.float32(1500 / PINHOLE.depth_scale)


def test_numbers_that_yaml_takes_for_text(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(VALUES).replace("- 0.001", "- 1e-3"))
    assert Camera.from_yaml(path) == Camera.from_dict(VALUES)


BAD_VALUES = [
    ("width", 0, "width is 0; it must be positive"),
    ("width", 640.5, "width is 640.5; write whole pixels"),
    ("height", -480, "height is -480; it must be positive"),
    ("fx", "wide", "fx is 'wide'; write a number"),
    ("fx", None, "fx is None; write a number"),
    ("fx", True, "fx is True; write a number"),
    ("fy", -480.0, "fy is -480.0; it must be positive; for an image whose y axis points up"),
    ("cx", math.nan, "cx is nan; write a finite number"),
    ("cy", math.inf, "cy is inf; write a finite number"),
    ("cy", [1, 2], r"cy is \[1, 2\]; write a number"),
    ("depth_scale", 0, "depth_scale is 0; it must be positive"),
    ("distortion", [0.1, 0.2], r"distortion is \[0.1, 0.2\]; write five numbers"),
    ("distortion", 0.1, "distortion is 0.1; write five numbers"),
    ("distortion", [0.1, "a", 0, 0, 0], "distortion is 'a'; write a number"),
    # k3 where p1 belongs: the image would fold.
    ("distortion", [0.26, -0.95, 1.16, -0.005, 0.002], "folds the image over itself; check the"),
]


@pytest.mark.parametrize(("key", "value", "message"), BAD_VALUES)
def test_bad_values_are_named_with_their_file(
    tmp_path: Path, key: str, value: Any, message: str
) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump({**VALUES, key: value}))
    with pytest.raises(CameraError, match=message) as caught:
        Camera.from_yaml(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", [key for key in VALUES if key != "distortion"])
def test_missing_keys_are_named(key: str) -> None:
    values = {name: value for name, value in VALUES.items() if name != key}
    with pytest.raises(CameraError, match=f"^here: missing key {key}; add a line '{key}: VALUE'$"):
        Camera.from_dict(values, where="here")


def test_unknown_keys_are_named() -> None:
    with pytest.raises(
        CameraError, match=r"^camera: unknown key k1; remove it, the keys are width"
    ):
        Camera.from_dict({**VALUES, "k1": 0.1})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"width: [640", "is no YAML: .*; write one 'key: value' a line"),
        (b"width: 640\n\theight: 480", "is no YAML: .*line 2"),
        (b"\xff\xfe\x00", "is no text file"),
        (b"width: \x00", "is no YAML"),
        (b"width: " + b"9" * 5000, "is no YAML: a value that cannot be read"),
        (b"[" * 100_000, "is no YAML: nested too deeply"),
        (b"", "no camera; write one"),
        (b"- 1\n- 2", "no camera; write one"),
        (b"640", "no camera; write one"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_bytes(content)
    with pytest.raises(CameraError, match=message) as caught:
        Camera.from_yaml(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        CameraError, match=r"cannot read .*none\.yaml: No such file.*; give a camera"
    ):
        Camera.from_yaml(tmp_path / "none.yaml")
    with pytest.raises(CameraError, match="Is a directory"):
        Camera.from_yaml(tmp_path)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(CameraError, match=r"array of shape \(3,\); give shape \(N, 3\)"):
        PINHOLE.project([1.0, 2.0, 3.0])
    with pytest.raises(CameraError, match=r"give shape \(N, 2\)"):
        PINHOLE.undistort(np.zeros((2, 3)))


def test_examples() -> None:
    assert doctest.testmod(camera_module).failed == 0
